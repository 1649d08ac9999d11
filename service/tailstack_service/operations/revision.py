"""What an optimisation leaves behind: the new design in its author's own text, fiducials in a file beside it, and
a patch."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tailstack.design import DEFAULT_LIMITS, Design, design_to_data, load_design
from tailstack.design.document import DesignDocument
from tailstack.design.fiducial_files import write_fiducials
from tailstack.design.frames import FRAME_FIELDS
from tailstack.design.loading import sha256_of
from tailstack.design.pointers import find_places, replace_value, value_at
from tailstack.design.reading import decode, read_text
from tailstack.design.write import data_to_yaml, dump_block, to_json
from tailstack.design.yaml_text import revise_yaml
from tailstack.errors import DesignError, LimitError, Problem, TailstackError
from tailstack.results import Optimisation
from tailstack.results.json_text import write_json

from ..console.files import is_stream, refuse_overwriting, writable, write_and_tell
from ..problems import RequestError
from .editors import write_document

DOCUMENTS, FIDUCIALS = (".yaml", ".yml", ".json"), (".mrk.json", ".csv", ".fcsv")


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Where the new design and its fiducials are to be written; None: nowhere."""

    design: Path | None
    fiducials: Path | None


def read_output_files(arguments: argparse.Namespace) -> OutputFiles:
    """Raises RequestError for a file that cannot be written, or is another's and there without ``--force``, before
    any work."""
    design = None if arguments.output is None else writable(arguments.output, DOCUMENTS)
    refuse_overwriting([] if design is None else [design], force=arguments.force, own=arguments.design)
    if (name := arguments.fiducials_out) is None:
        return OutputFiles(design, None)
    if not name.lower().endswith(FIDUCIALS):
        hint = f"known: {', '.join(FIDUCIALS)}"
        raise RequestError(Problem("", "unknown-format", f"{name!r} is no file of fiducials", hint))
    fiducials = writable(name, (".json", ".csv", ".fcsv"))
    if design is None:
        raise RequestError(Problem("", "option-missing", "--fiducials-out goes with -o", "add -o NEW.yaml"))
    if not fiducials.parent.resolve().is_relative_to(design.parent.resolve()):
        detail = f"a design refers to files in or below its own folder; {name} is not below that of {design}"
        raise RequestError(Problem("", "file-refused", detail, f"--fiducials-out {design.parent / fiducials.name}"))
    refuse_overwriting([fiducials], force=arguments.force)
    return OutputFiles(design, fiducials)


def refuse_unasked_points(files: OutputFiles, moves_fiducials: bool) -> None:
    """A design on the disk that has its fiducials in a file would lose the file.  Raises RequestError."""
    if files.design is None or files.fiducials is not None or not moves_fiducials:
        return
    there = _read_design(files.design)
    if there is None or (name := there.document.fiducials.file) is None:
        return
    detail = f"{files.design} has its fiducials in {name}, and they are to move"
    hint = (
        f"--fiducials-out {files.design.parent / 'NEW.csv'} writes them there (or .mrk.json), or give -o a new name: "
        "the points are then written into the design"
    )
    raise RequestError(Problem("", "fiducials-elsewhere", detail, hint))


# --- files ----------------------------------------------------------------------------------------------


def write_results(design: Design, result: Optimisation, files: OutputFiles) -> None:
    """Write each whole or not at all, and say so on stderr.  Raises OSError."""
    if files.design is not None:
        text, note = design_text(design, result, files)
        if files.fiducials is not None:  # first what the design refers to
            fiducials = load_design(result.design).fiducials
            write_and_tell(files.fiducials, write_fiducials(fiducials, files.fiducials.name))
        if note:
            print(f"note: {note}", file=sys.stderr)
        write_document(files.design, text)
        print(f"wrote {files.design}", file=sys.stderr)


def design_text(design: Design, result: Optimisation, files: OutputFiles) -> tuple[str, str]:
    """The new design as its file's ending asks for, and why its author's text could not be kept, if so."""
    path = files.design
    assert path is not None
    there = _read_design(path)
    base = there if there is not None and there.name == result.design["name"] else None
    new = load_design(result.design)
    wanted, folder = _with_file(result, new, files, base), (base or design).source.directory
    if folder is not None and path.parent.resolve() == folder.resolve():
        wanted = _naming_surfaces(wanted, _as_written(base or design))
    if path.suffix.lower() == ".json":
        return to_json(wanted), ""
    base = base or design
    text = own_text(base)
    if text is None:
        return data_to_yaml(wanted), ""
    with suppress(TailstackError):
        revised = revise_yaml(text, _as_written(base), _like(wanted, _as_written(base)))
        if _hash_of_text(revised, new, folder) == new.sha256:
            return revised, ""
    return data_to_yaml(wanted), f"{path} is written anew, without its comments: they could not be kept"


def _with_file(result: Optimisation, new: Design, files: OutputFiles, there: Design | None) -> dict[str, Any]:
    """The new design, its fiducials in the file that is written beside it, or that it has and that still holds them."""
    data: dict[str, Any] = result.design
    name, frame = None, {}
    if files.fiducials is not None and files.design is not None:
        name = os.path.relpath(files.fiducials.resolve(), files.design.parent.resolve()).replace(os.sep, "/")
    elif there is not None and there.document.fiducials.file is not None and _points_of(new) == _points_of(there):
        name, stated = there.document.fiducials.file, there.source.data["fiducials"]
        frame = {key: stated[key] for key in FRAME_FIELDS if key in stated}
    if name is None:
        return data
    section: dict[str, Any] = data["fiducials"]
    others = {key: value for key, value in section.items() if key not in ("points", "origin")}
    return {**data, "fiducials": {"file": name, **frame, **others}}


def _points_of(design: Design) -> dict[str, tuple[float, float, float]]:
    return dict(zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True))


def _read_design(path: Path) -> Design | None:
    """The design that a file holds; None if it holds none."""
    with suppress(DesignError, LimitError):
        return None if is_stream(str(path)) else load_design(path)
    return None


def own_text(design: Design) -> str | None:
    """The YAML that a design was read from; None if it was JSON, or came from elsewhere, or changed meanwhile."""
    file = design.source.file
    if file is None or design.source.json_text is not None:
        return None
    with suppress(DesignError, LimitError, OSError):
        text = decode(Path(file).read_bytes(), file)
        if load_design(text, base_directory=Path(file).parent).sha256 == design.sha256:
            return text
    return None


def _as_written(design: Design) -> dict[str, Any]:
    return design_to_data(design, inline=False)


def _like(wanted: dict[str, Any], old: Mapping[str, Any]) -> dict[str, Any]:
    """The wanted data without what the old data leaves to a default: labels F1, F2, ..., and that nothing is fixed."""
    made = json.loads(write_json(wanted))
    section = made.get("optimise") or {}
    if section.get("fixed") == [] and "fixed" not in (old.get("optimise") or {}):
        del section["fixed"]
    points, before = made["fiducials"].get("points") or [], old["fiducials"].get("points") or []
    labels = [f"F{number}" for number in range(1, len(points) + 1)]
    if len(points) == len(before) and [point.get("label") for point in points] == labels:
        for point, written in zip(points, before, strict=True):
            if "label" not in written:
                del point["label"]
    return dict(made)


def _naming_surfaces(wanted: dict[str, Any], old: dict[str, Any]) -> dict[str, Any]:
    """The wanted data with the files of surfaces, beside which it is written, named and not written out."""
    for pointer in ("/optimise/region/surface", "/optimise/regions/*/surface"):
        for place in find_places(old, pointer):
            if "content" not in value_at(old, place) and (there := value_at(wanted, place)).get("content"):
                named = {name: value for name, value in there.items() if name != "content"}
                wanted = replace_value(wanted, place, named)
    return wanted


def _hash_of_text(text: str, new: Design, folder: Path | None) -> str:
    """The hash of a text with the fiducials of the new design, which may be in a file that is not written yet."""
    data = read_text(text, DEFAULT_LIMITS, file=None, directory=None, form="yaml").data
    try:
        document = DesignDocument.model_validate(data)
    except ValueError:
        return ""
    if document.fiducials.points is not None:
        return load_design(data, base_directory=folder).sha256
    return sha256_of(document, new.fiducials)


# --- a patch --------------------------------------------------------------------------------------------


def patch_text(design: Design, result: Optimisation) -> str:
    """What to change in a design, as a merge patch (RFC 7396) in YAML."""
    old = _as_written(design)
    return dump_block(merge_patch(old, _like(_naming_surfaces(result.design, old), old)))


def merge_patch(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """The merge patch that makes new data of old: fields that differ, lists whole, null for what goes."""
    patch: dict[str, Any] = {name: None for name in old if name not in new}
    for name, value in new.items():
        if name in old and isinstance(value, dict) and isinstance(old[name], dict):
            if below := merge_patch(old[name], value):
                patch[name] = below
        elif name not in old or value != old[name]:
            patch[name] = value
    return patch
