"""Convert fiducial files and design documents into one another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import DesignError, LimitError, Problem
from .fiducial_files import FORMATS, FiducialList, read_fiducials, write_fiducials
from .loading import Design, data_to_yaml, design_to_json, design_to_yaml, load_design, to_json
from .reading import DEFAULT_LIMITS, Format, Limits, read_bytes

DOCUMENTS = (".yaml", ".yml", ".json")


@dataclass(frozen=True, slots=True)
class Conversion:
    """The converted text, and what was done to the numbers on the way."""

    text: str
    notes: tuple[str, ...]


def convert(
    content: bytes,
    source_name: str,
    target_name: str,
    *,
    directory: Path | None = None,
    allow_files: bool = True,
    limits: Limits = DEFAULT_LIMITS,
) -> Conversion:
    """Convert by the endings of two file names: .csv, .fcsv, .mrk.json (fiducials); .yaml, .yml, .json (designs).

    A design converts to a design that stands alone (a fiducial file it refers to is read in), or to its
    fiducials.  Fiducials convert to another fiducial file, or to the ``fiducials`` section of a design.
    Raises DesignError, LimitError.
    """
    for name in (source_name, target_name):
        if not name.lower().endswith((*FORMATS, *DOCUMENTS)):
            known = ", ".join((*FORMATS, *DOCUMENTS))
            raise DesignError(Problem("", "unknown-format", f"{name[:80]!r} has no known ending", f"known: {known}"))
    if len(content) > limits.document_bytes:
        raise LimitError(Problem("", "too-large", f"{source_name} is longer than {limits.document_bytes} bytes"))
    if source_name.lower().endswith(FORMATS):
        fiducials = read_fiducials(content, source_name, limits)
        return Conversion(_from_fiducials(fiducials, target_name), fiducials.notes)
    form: Format = "json" if source_name.lower().endswith(".json") else "yaml"
    design = load_design(content, form=form, base_directory=directory, allow_files=allow_files, limits=limits)
    return Conversion(_from_design(design, target_name), design.fiducials.notes)


def convert_file(source: Path, target: Path, *, limits: Limits = DEFAULT_LIMITS) -> Conversion:
    """Convert ``source`` and write ``target``.  Raises DesignError, LimitError; an unwritable target included."""
    content = read_bytes(source, limits.document_bytes, str(source))
    conversion = convert(content, source.name, target.name, directory=source.parent, limits=limits)
    try:
        target.write_text(conversion.text, encoding="utf-8")
    except OSError as error:
        raise DesignError(Problem("", "file-unwritable", f"cannot write {target}: {error.strerror}")) from None
    return conversion


def _from_fiducials(fiducials: FiducialList, target: str) -> str:
    if target.lower().endswith(FORMATS):
        return write_fiducials(fiducials, target)
    points = [
        {"label": label, "position_mm": list(position)}
        for label, position in zip(fiducials.labels, fiducials.positions_mm, strict=True)
    ]
    section: dict[str, Any] = {"fiducials": {"points": points}}
    if fiducials.origin is not None:
        section["fiducials"]["origin"] = fiducials.origin.model_dump(mode="json", exclude_unset=True)
    return to_json(section) if target.lower().endswith(".json") else data_to_yaml(section)


def _from_design(design: Design, target: str) -> str:
    if target.lower().endswith(FORMATS):
        return write_fiducials(design.fiducials, target)
    return design_to_json(design) if target.lower().endswith(".json") else design_to_yaml(design)
