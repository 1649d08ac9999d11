"""Load a design from a file, text, bytes or plain data; write it back.

A design has a canonical text, defaults filled in, and a hash of it; with some of its numbers changed it is what an
optimiser hands back.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from ..arrays import Array
from ..errors import DesignError, LimitError, Problem
from ..json_text import write_json
from .consistency import check_document, check_fiducials
from .document import SCHEMA_NAME, DesignDocument, FiducialPoint, Model, RequirementDocument, TargetDocument, Transforms
from .fiducial_files import FiducialList, format_of, read_fiducials
from .fields import Record
from .mount_document import Execution, Interfaces
from .optimise_document import Optimise
from .reading import DEFAULT_LIMITS, Format, Limits, Source, decode, plain_data, read_bytes, read_text, scalar, shown
from .refusals import place, refuse
from .remembering import FEW, recognised
from .view_document import view_class


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A design as it was read: the checked document, its fiducials, where everything stands, its hash."""

    document: DesignDocument
    fiducials: FiducialList
    source: Source
    sha256: str  # of the canonical content: defaults filled in, a fiducial file replaced by what it holds

    @property
    def name(self) -> str:
        return self.document.name

    def locate(self, pointer: str) -> tuple[str | None, int | None, int | None]:
        """File, line and column (1-based) of a JSON pointer, or of its nearest ancestor that is there."""
        placed = place(Problem(pointer, "located", ""), self.source)
        return placed.file, placed.line, placed.column


def load_design(
    source: str | bytes | Path | Mapping[str, Any] | Source,
    *,
    form: Format = "auto",
    base_directory: Path | None = None,
    allow_files: bool = True,
    limits: Limits = DEFAULT_LIMITS,
) -> Design:
    """Load and check a design document.

    source: a path; or a text with a line break or a leading ``{``, or bytes: the document itself; or plain
    data; or a source that was read before.  ``base_directory`` is what a ``fiducials/file`` is relative to when the
    document did not come from a file.  ``allow_files=False`` refuses such references (a service must not read its own
    disk for a stranger).  Raises DesignError or LimitError; each problem has a pointer and, from text, a line.
    """
    return _checked(read_source(source, form=form, base_directory=base_directory, limits=limits), allow_files, limits)


def read_source(
    source: str | bytes | Path | Mapping[str, Any] | Source,
    *,
    form: Format = "auto",
    base_directory: Path | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Source:
    """The plain data of a document, not yet checked against the schema."""
    if isinstance(source, Source):
        return source
    if isinstance(source, Mapping):
        return Source(plain_data(source, limits), None, base_directory)
    if isinstance(source, str) and _is_path(source):
        source = Path(source)
    if isinstance(source, Path):
        name = str(source)
        content = read_bytes(source, limits.document_bytes, name)
        if form == "auto" and name.lower().endswith(".json"):
            form = "json"
        return read_text(decode(content, name), limits, file=name, directory=source.parent, form=form)
    if isinstance(source, bytes):
        if len(source) > limits.document_bytes:
            raise LimitError(Problem("", "too-large", f"the document is longer than {limits.document_bytes} bytes"))
        source = decode(source, None)
    if not isinstance(source, str):
        raise DesignError(Problem("", "wrong-type", f"a design is a path, a text or a mapping; got {shown(source)}"))
    return read_text(source, limits, file=None, directory=base_directory, form=form)


def _is_path(text: str) -> bool:
    """No design fits on one short line, and no path has a line break."""
    return len(text) <= 1000 and not ("\n" in text or "\r" in text or text.lstrip()[:1] == "{")


def _checked(source: Source, allow_files: bool, limits: Limits) -> Design:
    data = source.data
    _check_schema_name(source)
    try:
        document = DesignDocument.model_validate(_with_known_sections(data))
    except ValidationError as error:
        raise refuse(error, source, limits) from None
    _raise(check_document(document, limits), source, limits)
    fiducials = _fiducials(document, source, allow_files, limits)
    _raise(check_fiducials(document, fiducials), source, limits)
    return Design(document, fiducials, source, sha256_of(document, fiducials))


_SECTIONS: dict[str, type[Record]] = {
    "interfaces": Interfaces, "transforms": Transforms, "execution": Execution, "model": Model, "optimise": Optimise,
}  # fmt: skip
_LISTS: dict[str, Callable[[Any], type[Record] | None]] = {
    "views": view_class, "targets": lambda _: TargetDocument, "requirements": lambda _: RequirementDocument,
}  # fmt: skip


def _with_known_sections(data: dict[str, Any]) -> dict[str, Any]:
    """The document with the records of what tends to stay as it is while a design is worked on: all but the points."""
    known = dict(data)
    for name, kind in _SECTIONS.items():
        if name in data:
            known[name] = recognised(kind, data[name])
    for name, kind_of in _LISTS.items():
        entries = data.get(name)
        if type(entries) is list and len(entries) <= FEW:
            known[name] = [recognised(kind_of(entry), entry) for entry in entries]
    return known


def _check_schema_name(source: Source) -> None:
    data = source.data
    if not isinstance(data, dict):
        detail = f"a design is a mapping of fields; got {shown(data)}"
        raise DesignError(place(Problem("", "wrong-type", detail, "start from examples/demo.yaml"), source))
    if data.get("schema") != SCHEMA_NAME:
        got = shown(data["schema"]) if "schema" in data else "no schema"
        problem = Problem(
            "/schema" if "schema" in data else "",
            "unsupported-schema",
            f"this version reads {SCHEMA_NAME}; got {got}",
            f"schema: {SCHEMA_NAME}",
        )
        raise DesignError(place(problem, source))


def _raise(problems: list[Problem], source: Source, limits: Limits) -> None:
    if not problems:
        return
    source = source.placed()
    placed = [place(problem, source) for problem in problems[: limits.problems]]
    if all(problem.code == "too-many" for problem in problems):
        raise LimitError(placed)
    raise DesignError(placed)


def _fiducials(document: DesignDocument, source: Source, allow_files: bool, limits: Limits) -> FiducialList:
    points = document.fiducials.points
    if points is not None:
        labels = tuple([point.label or f"F{number}" for number, point in enumerate(points, 1)])
        return FiducialList(labels, tuple([point.position_mm for point in points]), document.fiducials.origin)
    name = document.fiducials.file or ""
    try:
        path = _referenced(name, source, allow_files)
        format_of(name)
        return read_fiducials(read_bytes(path, limits.fiducial_file_bytes, name), name, limits)
    except (DesignError, LimitError) as error:
        # the pointer says which field led there, file and line where in the fiducial file it is wrong
        problems = [
            place(Problem("/fiducials/file", p.code, p.detail, p.hint, p.file, p.line, p.column), source)
            for p in error.problems
        ]
        raise type(error)(problems) from None


def _referenced(name: str, source: Source, allow_files: bool) -> Path:
    """The file a design refers to: relative, and below the design's own directory."""
    if not allow_files:
        raise DesignError(
            Problem(
                "", "file-refused", f"files are not read here; got {shown(name)}", "put the points inline (points:)"
            )
        )
    if source.directory is None:
        raise DesignError(
            Problem(
                "",
                "file-refused",
                "the document did not come from a file: there is no directory to look in",
                "put the points inline (points:), or load the design from its file",
            )
        )
    if "\0" in name or "\\" in name or Path(name).is_absolute() or ":" in name[:2]:
        raise DesignError(
            Problem("", "file-refused", f"a fiducial file is named by a relative path with /; got {shown(name)}")
        )
    try:
        base = source.directory.resolve()
        path = (base / name).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise DesignError(Problem("", "file-refused", f"cannot follow {shown(name)}: {error}")) from None
    if not path.is_relative_to(base):
        raise DesignError(
            Problem("", "file-refused", f"{shown(name)} leads out of the design's directory", "move the file beside it")
        )
    return path


# --- writing ----------------------------------------------------------------------------------------


def design_to_data(design: Design, *, inline: bool = True) -> dict[str, Any]:
    """The document as plain data, with what its author set and nothing else.

    ``inline`` replaces a fiducial file by its points (converted to con, mm) and their origin, so that the result stands
    alone and says what was done to them.
    """
    document = design.document
    if inline and document.fiducials.file is not None:
        points = [
            FiducialPoint(label=label, position_mm=position)
            for label, position in zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True)
        ]
        kept = {"manufacturing": document.fiducials.manufacturing} if document.fiducials.manufacturing else {}
        fiducials = type(document.fiducials).model_validate(
            {"points": points, "origin": design.fiducials.origin, **kept}
        )
        document = document.model_copy(update={"fiducials": fiducials})
    return document.model_dump(mode="json", by_alias=True, exclude_unset=True)


def design_to_json(design: Design, *, inline: bool = True) -> str:
    """The document as JSON text."""
    return to_json(design_to_data(design, inline=inline))


def to_json(data: Any) -> str:
    """Plain data as indented JSON text."""
    return write_json(data, indent=2) + "\n"


def design_to_yaml(design: Design, *, inline: bool = True) -> str:
    """The document as YAML text, vectors on one line."""
    return data_to_yaml(design_to_data(design, inline=inline))


class _Dumper(yaml.SafeDumper):
    """Quotes every text that this package (or YAML 1.1) would read as something else; never writes aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "'" if not isinstance(scalar(text), str) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _represent_list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.SequenceNode:
    flat = all(not isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(list, _represent_list)


def data_to_yaml(data: Any) -> str:
    """Plain data as YAML text that :func:`read_text` reads back unchanged."""
    text: str = yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120, default_flow_style=False
    )
    return text


_ELSEWHERE = {"fiducials": {"points", "file", "origin"}}  # the points are hashed apart, wherever they were read


def sha256_of(document: DesignDocument, fiducials: FiducialList) -> str:
    """The hash of a design, 64 hexadecimal digits: of its canonical text and its fiducials, wherever they were read."""
    content = document.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=_ELSEWHERE)
    points = [fiducials.labels, fiducials.positions_mm]
    # with spaces, unlike everything else: the hashes of designs that are in the field were made so
    spaced = json.dumps(points, ensure_ascii=False, allow_nan=False)  # noqa: TID251
    return hashlib.sha256(f"{write_json(content)}\n{spaced}".encode()).hexdigest()


CONTRIBUTOR = {"structure_connector": "interface_1", "connector_flange": "interface_2"}
FIELD = {contributor: name for name, contributor in CONTRIBUTOR.items()}
ROTATIONS = ("rx", "ry", "rz")


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """What to change.  Contributors are "interface_1" and "interface_2"; half-widths in rad or mm."""

    labels: Sequence[str] | None = None  # of fiducials_mm; None: those of the design
    fiducials_mm: Array | None = None  # (N, 3) con; None: they stay
    half_width: Mapping[tuple[str, str], float] = field(default_factory=dict)  # (contributor, component or locator)
    pivot_mm: Mapping[str, Array] = field(default_factory=dict)  # (3,) con
    locator_scale: Mapping[str, float] = field(default_factory=dict)  # about the locators' centre


def revise_design(design: Design, change: Revision, limits: Limits = DEFAULT_LIMITS) -> Design:
    """The design with a change made, loaded and checked anew.

    Fiducials from a file become points of the document, so the result stands alone.  Raises DesignError.
    """
    data: dict[str, Any] = design_to_data(design, inline=True)
    if change.fiducials_mm is not None:
        labels = design.fiducials.labels if change.labels is None else change.labels
        data["fiducials"]["points"] = [
            {"label": label, "position_mm": [float(value) for value in position]}
            for label, position in zip(labels, change.fiducials_mm, strict=True)
        ]
        same = tuple(labels) == design.fiducials.labels
        if design.fiducials.origin is not None and not (
            same and np.array_equal(change.fiducials_mm, design.fiducials.positions_mm)
        ):
            data["fiducials"]["origin"]["changed"] = True
        _forget_missing_labels(data, set(labels))
    for (contributor, component), value in change.half_width.items():
        _set_half_width(data["interfaces"][FIELD[contributor]], component, float(value))
    for contributor, position in change.pivot_mm.items():
        data["interfaces"][FIELD[contributor]]["pivot_mm"] = [float(value) for value in position]
    for contributor, scale in change.locator_scale.items():
        locators = data["interfaces"][FIELD[contributor]]["locators"]
        positions = np.array([locator["position_mm"] for locator in locators], dtype=float)
        centre = positions.mean(axis=0)
        for locator, position in zip(locators, centre + scale * (positions - centre), strict=True):
            locator["position_mm"] = [float(value) for value in position]
    return load_design(data, limits=limits)


def _set_half_width(interface: dict[str, Any], component: str, value: float) -> None:
    if interface.get("locators"):
        for locator in interface["locators"]:
            if locator["name"] == component:
                locator["half_width_mm"] = value
        return
    unit, shown = ("deg", degrees(value)) if component in ROTATIONS else ("mm", value)
    interface["tolerances"][component][f"half_width_{unit}"] = shown


def _forget_missing_labels(data: dict[str, Any], labels: set[str]) -> None:
    """Fiducials that were left out are no longer named in the optimise section."""
    wanted = data.get("optimise")
    if not wanted:
        return
    wanted["fixed"] = [label for label in wanted.get("fixed") or [] if label in labels]
