"""Write a design as JSON or YAML, change some of its numbers, convert it from and into other files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from ..arrays import Array
from ..errors import DesignError, LimitError, Problem
from ..geometry.camera import turn_view
from ..json_text import write_json
from .document import DistanceView, FiducialPoint, PresetView
from .fiducial_files import FORMATS, FiducialList, read_fiducials, write_fiducials
from .loading import (
    Design,
    load_design,
)
from .reading import DEFAULT_LIMITS, DOCUMENTS, Format, Limits, read_bytes, scalar

if TYPE_CHECKING:
    from .calibration_cages import CageForm
    from .step import StepBody, StepContact, StepSelection


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


def turn_entry(
    entry: Mapping[str, Any], view: PresetView | DistanceView, right_deg: float, up_deg: float
) -> dict[str, Any]:
    """What a document says of a view, turned with its image to the right and up (``turn_view``)."""
    beam, up = turn_view(np.array(view.beam), np.array(view.up_direction), right_deg, up_deg)
    rest = {name: value for name, value in entry.items() if name != "orientation"}
    return rest | {"beam_direction": list(beam), "up_direction": list(up)}


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


def dump_flow(value: Any, *, spaced: bool = True) -> str:
    """Plain data as YAML on one line; ``spaced``: with spaces inside the braces of mappings."""
    space = " " if spaced else ""
    if value in ({}, []):
        return "{}" if isinstance(value, dict) else "[]"
    if isinstance(value, dict) and value:
        fields = ", ".join(f"{dump_flow(name)}: {dump_flow(item, spaced=spaced)}" for name, item in value.items())
        return f"{{{space}{fields}{space}}}"
    if isinstance(value, list) and value:
        return f"[{', '.join(dump_flow(item, spaced=spaced) for item in value)}]"
    # within brackets, where a comma or a colon in a text needs quotes
    text: str = yaml.dump([value], Dumper=_Dumper, default_flow_style=True, allow_unicode=True, width=1_000_000)
    return text.strip()[1:-1]


WIDTH = 100  # of a line that holds a mapping


def dump_block(data: Mapping[str, Any], indent: int = 0) -> str:
    """Fields as YAML, a line for each field and for each item of a list, as far as they fit."""
    space, text = " " * indent, ""
    for name, value in data.items():
        flow = dump_flow(value)
        nested = isinstance(value, dict) and any(isinstance(item, dict | list) for item in value.values())
        text += f"{space}{dump_flow(name)}:"
        if isinstance(value, dict) and value and (nested or len(space + name + flow) + 2 > WIDTH):
            text += "\n" + dump_block(value, indent + 2)
        elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
            text += "\n" + "".join(f"{space}  - {dump_flow(item)}\n" for item in value)
        else:
            text += f" {flow}\n"
    return text


ROTATIONS = ("rx", "ry", "rz")


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """What to change: interfaces as the document calls them, half-widths in rad or mm."""

    labels: Sequence[str] | None = None  # of fiducials_mm; None: those of the design
    fiducials_mm: Array | None = None  # (N, 3) con; None: they stay
    half_width: Mapping[tuple[str, str], float] = field(default_factory=dict)  # (interface, component or locator)
    pivot_mm: Mapping[str, Array] = field(default_factory=dict)  # (3,) con
    locator_scale: Mapping[str, float] = field(default_factory=dict)  # about the locators' centre


def revise_design(design: Design, change: Revision, limits: Limits = DEFAULT_LIMITS) -> Design:
    """The design with a change made, loaded and checked anew.

    Fiducials from a file become points of the document, so the result stands alone.  Raises DesignError.
    """
    data: dict[str, Any] = design_to_data(design, inline=True)
    if change.fiducials_mm is not None:
        labels = design.fiducials.labels if change.labels is None else change.labels
        own = dict(zip(design.fiducials.labels, data["fiducials"].get("points") or (), strict=False))
        data["fiducials"]["points"] = [
            {**own.get(label, {}), "label": label, "position_mm": [float(value) for value in position]}
            for label, position in zip(labels, change.fiducials_mm, strict=True)
        ]
        same = tuple(labels) == design.fiducials.labels
        if design.fiducials.origin is not None and not (
            same and np.array_equal(change.fiducials_mm, design.fiducials.positions_mm)
        ):
            data["fiducials"]["origin"]["changed"] = True
        _forget_missing_labels(data, set(labels))
    for (contributor, component), value in change.half_width.items():
        _set_half_width(data["interfaces"][contributor], component, float(value))
    for contributor, position in change.pivot_mm.items():
        data["interfaces"][contributor]["pivot_mm"] = [float(value) for value in position]
    for contributor, scale in change.locator_scale.items():
        locators = data["interfaces"][contributor]["locators"]
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
    # what was written in degrees comes back as it was, without the last digits of the two conversions
    unit, shown = ("deg", round(degrees(value), 12)) if component in ROTATIONS else ("mm", value)
    interface["tolerances"][component][f"half_width_{unit}"] = shown


def _forget_missing_labels(data: dict[str, Any], labels: set[str]) -> None:
    """Fiducials that were left out are no longer named in the optimise section."""
    wanted = data.get("optimise")
    if not wanted:
        return
    wanted["fixed"] = [label for label in wanted.get("fixed") or [] if label in labels]


Base = Design | Callable[[FiducialList], Design]
STEP_FILES = (".step", ".stp", ".p21")
SEAT_HALF_WIDTH_MM = 0.02  # of a contact that a STEP file brings, which states no tolerance: a start


@dataclass(frozen=True, slots=True)
class Conversion:
    """The converted text, the fiducials in it, and what was done to the numbers on the way."""

    text: str  # of the new file
    notes: tuple[str, ...]  # sentences: what was converted, left out or renamed
    fiducials: FiducialList  # as they stand in it
    bodies: tuple[StepBody, ...] = ()  # of a STEP file: those that became fiducials, and those that were left


def convert(
    content: bytes,
    source_name: str,
    target_name: str,
    *,
    directory: Path | None = None,
    allow_files: bool = True,
    limits: Limits = DEFAULT_LIMITS,
    selection: StepSelection | None = None,
    base: Base | None = None,
    cage: CageForm | None = None,
) -> Conversion:
    """Convert by the endings of two file names: .csv, .fcsv, .mrk.json (fiducials); .yaml, .yml, .json (designs).

    A design converts to a design that stands alone (a fiducial file it refers to is read in), or to its
    fiducials.  Fiducials convert to another fiducial file, or to the ``fiducials`` section of a design.
    A STEP file (.step, .stp, .p21) is read for its balls, which are fiducials; ``selection`` says for which.
    With ``base``, a design or what makes one for the fiducials, they replace those of that design, as its seat is
    replaced where ``selection`` names seats and pins.  With ``cage``, a .csv that is read is a frame specification of
    XMALab, or else the one that is written.  Raises DesignError, LimitError.
    """
    known = (*FORMATS, *DOCUMENTS)
    for name, endings in ((source_name, (*known, *STEP_FILES)), (target_name, known)):
        if not name.lower().endswith(endings):
            problem = Problem(
                "", "unknown-format", f"{name[:80]!r} has no known ending", f"known: {', '.join(endings)}"
            )
            raise DesignError(problem)
    reads_table = source_name.lower().endswith(".csv")
    written = None if reads_table else cage
    if source_name.lower().endswith(STEP_FILES):
        from .step import read_step

        reading = read_step(content, source_name, selection, limits)
        data, notes = _place_fiducials(base, reading.fiducials, reading.contacts)
        text = _write_data(data, reading.fiducials, target_name, written)
        return Conversion(text, (*reading.notes, *notes), reading.fiducials, reading.bodies)
    if len(content) > limits.document_bytes:
        raise LimitError(Problem("", "too-large", f"{source_name} is longer than {limits.document_bytes} bytes"))
    if source_name.lower().endswith(FORMATS):
        if cage is not None and reads_table:
            from .calibration_cages import read_cage

            fiducials = read_cage(content, source_name, cage, limits)
        else:
            fiducials = read_fiducials(content, source_name, limits)
        data, _ = _place_fiducials(base, fiducials)
        return Conversion(_write_data(data, fiducials, target_name, written), fiducials.notes, fiducials)
    form: Format = "json" if source_name.lower().endswith(".json") else "yaml"
    design = load_design(content, form=form, base_directory=directory, allow_files=allow_files, limits=limits)
    text = _write_data(design_to_data(design), design.fiducials, target_name, written)
    return Conversion(text, design.fiducials.notes, design.fiducials)


def _write_text(target: Path, text: str) -> None:
    target.write_text(text, encoding="utf-8")


def convert_file(
    source: Path,
    target: Path,
    *,
    limits: Limits = DEFAULT_LIMITS,
    write: Callable[[Path, str], None] = _write_text,
    selection: StepSelection | None = None,
    base: Base | None = None,
) -> Conversion:
    """Convert ``source`` and write ``target``.  Raises DesignError, LimitError; an unwritable target included.

    write: how the text gets into its file; raises OSError.  selection, base: as those of ``convert``.
    """
    content = read_source_file(source, limits)
    conversion = convert(
        content, source.name, target.name, directory=source.parent, limits=limits, selection=selection, base=base
    )
    try:
        write(target, conversion.text)
    except OSError as error:
        raise DesignError(Problem("", "file-unwritable", f"cannot write {target}: {error.strerror}")) from None
    return conversion


def read_source_file(source: Path, limits: Limits = DEFAULT_LIMITS) -> bytes:
    """The bytes of a file to convert, within the limit of its kind.  Raises DesignError, LimitError."""
    from .step.part21 import MOST_BYTES

    limit = MOST_BYTES if source.name.lower().endswith(STEP_FILES) else limits.document_bytes
    return read_bytes(source, limit, str(source))


def _place_fiducials(
    base: Base | None, fiducials: FiducialList, contacts: Sequence[StepContact] = ()
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The design with other fiducials and perhaps contacts; without one, these sections of it.  And what to mind."""
    base = base(fiducials) if callable(base) else base
    data = {} if base is None else design_to_data(base)
    before = data.get("fiducials", {})
    own = {point.get("label"): point for point in before.pop("points", [])}
    before.pop("origin", None)
    section: dict[str, Any] = {
        "points": [
            {**own.get(label, {}), "label": label, "position_mm": list(position)}
            for label, position in zip(fiducials.labels, fiducials.positions_mm, strict=True)
        ],
        **(
            {} if fiducials.origin is None else {"origin": fiducials.origin.model_dump(mode="json", exclude_unset=True)}
        ),
        **before,
    }
    data["fiducials"] = section
    if data.get("optimise", {}).get("fixed"):
        _forget_missing_labels(data, set(fiducials.labels))
    notes = _place_contacts(data, contacts) if contacts else ()
    return data if base is None else design_to_data(load_design(data)), notes


def _place_contacts(data: dict[str, Any], contacts: Sequence[StepContact]) -> tuple[str, ...]:
    """Contacts as the locators of the structure on its connector; half-widths of those that had them before stay."""
    interface = data.setdefault("interfaces", {}).setdefault("structure_connector", {})
    before = {locator["name"]: locator for locator in interface.get("locators") or ()}
    start = {"half_width_mm": SEAT_HALF_WIDTH_MM, "distribution": "uniform"}
    interface.pop("tolerances", None)
    interface["pivot_mm"] = [float(value) for value in np.mean([each.position_mm for each in contacts], axis=0)]
    interface["locators"] = [
        {
            **before.get(each.name, start),
            "name": each.name,
            "position_mm": [*each.position_mm],
            "normal": [*each.normal],
        }
        for each in contacts
    ]
    new = [each.name for each in contacts if each.name not in before]
    if not new:
        return ()
    words = (
        f"half-width {SEAT_HALF_WIDTH_MM} mm, uniform, of {', '.join(new)}: a start, as STEP states none; correct it"
    )
    return (words,)


def _write_data(data: Mapping[str, Any], fiducials: FiducialList, target: str, cage: CageForm | None = None) -> str:
    """A design or sections of one as the target's ending asks for, or only the fiducials."""
    if cage is not None and target.lower().endswith(".csv"):
        from .calibration_cages import write_cage

        return write_cage(fiducials, cage.unit)
    if target.lower().endswith(FORMATS):
        return write_fiducials(fiducials, target)
    return to_json(data) if target.lower().endswith(".json") else data_to_yaml(data)
