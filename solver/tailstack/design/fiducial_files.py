"""Fiducial files: CSV with units in its header, 3D Slicer ``.mrk.json`` and ``.fcsv``.

The connector frame is LPS, the frame of DICOM.  RAS coordinates have x and y of the opposite sign; they
are converted on reading and the conversion is noted, so that no result hides it.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from ..errors import DesignError, LimitError, Problem
from ..json_text import write_json
from .document import FiducialOrigin
from .reading import Limits, decode, read_text, show

System = Literal["LPS", "RAS"]

FORMATS = (".csv", ".fcsv", ".mrk.json")
_MM = {"um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_SYSTEMS: dict[str, System] = {"LPS": "LPS", "RAS": "RAS", "0": "RAS", "1": "LPS"}


@dataclass(frozen=True, slots=True)
class FiducialTable:
    """What a file of fiducials holds, as it stands there."""

    rows: Sequence[tuple[str, list[float]]]  # label and x, y, z
    unit: str
    system: System
    stated: bool = True  # false: the system is what files of the format meant that do not say
    left_out: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class FiducialList:
    """Fiducials in con (LPS), mm, and where they were read from, unless they were written into the design."""

    labels: tuple[str, ...]
    positions_mm: tuple[tuple[float, float, float], ...]
    origin: FiducialOrigin | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the numbers on the way, in words."""
        return () if self.origin is None else tuple(_notes(self.origin))


def _notes(origin: FiducialOrigin) -> Iterator[str]:
    name = origin.file
    if origin.left_out:
        yield f"{name}: left out, position not defined: {', '.join(origin.left_out)[:200]}"
    if not origin.coordinate_system_stated:
        yield f"{name}: no coordinate system is stated; read as {origin.coordinate_system}, as Slicer wrote such files"
    if origin.coordinate_system == "RAS":
        yield f"{name}: coordinates were RAS; converted to LPS (x and y change sign)"
    if origin.coordinate_unit != "mm":
        yield f"{name}: coordinates were converted to mm (factor {_MM[origin.coordinate_unit]:g})"
    if origin.changed:
        yield f"{name}: the fiducials are no longer those of the file: they were moved, or some were left out"


def format_of(name: str) -> str:
    """Which of FORMATS a file name asks for.  Raises DesignError."""
    lowered = name.lower()
    for ending in FORMATS:
        if lowered.endswith(ending):
            return ending
    raise DesignError(
        Problem(
            "", "unknown-format", f"{name[:80]!r} is not a fiducial file", f"endings read here: {', '.join(FORMATS)}"
        )
    )


def read_fiducials(content: bytes, name: str, limits: Limits) -> FiducialList:
    """Read a file in the format its name asks for.  Raises DesignError with file and line, LimitError."""
    ending = format_of(name)
    text = decode(content, name).removeprefix("\ufeff")
    if not text.strip():
        raise DesignError(Problem("", "empty-document", f"{name} is empty", file=name))
    try:
        if ending == ".mrk.json":
            table = _read_markups(text, name, limits)
        else:
            table = _read_fcsv(text, name) if ending == ".fcsv" else _read_csv(text, name)
    except csv.Error as error:
        raise DesignError(Problem("", "csv-syntax", f"this is not CSV: {error}", file=name)) from None
    return make_list(table, content, name, limits)


def make_list(table: FiducialTable, content: bytes, name: str, limits: Limits) -> FiducialList:
    """The fiducials of a table that was read from a file: in mm and LPS, each with a label.  Raises as reading does."""
    if not table.rows:
        raise DesignError(Problem("", "empty-document", f"{name} holds no fiducial", file=name))
    for count, what in ((len(table.rows), "fiducials"), (len(table.left_out), "points that are not defined")):
        if count > limits.fiducials:
            detail = f"{name} holds {count} {what}; at most {limits.fiducials}"
            raise LimitError(Problem("", "too-many", detail, file=name))
    labels, positions_mm = _read_position(table, name)
    return FiducialList(labels, positions_mm, _origin(table, name, hashlib.sha256(content).hexdigest()))


def _origin(table: FiducialTable, name: str, sha256: str) -> FiducialOrigin:
    """What is not as usual is stated, and nothing else: it is written into designs."""
    unusual: dict[str, Any] = {} if table.stated else {"coordinate_system_stated": False}
    if table.unit != "mm":
        unusual["coordinate_unit"] = "um" if table.unit == "µm" else table.unit
    if table.left_out:
        unusual["left_out"] = table.left_out
    return FiducialOrigin(file=name, sha256=sha256, coordinate_system=table.system, **unusual)


def write_fiducials(fiducials: FiducialList, name: str) -> str:
    """The text of a fiducial file in the format its name asks for: LPS, mm, every digit."""
    ending = format_of(name)
    if ending == ".mrk.json":
        points = [
            {
                "id": str(number),
                "label": label,
                "position": list(position),
                "positionStatus": "defined",
                "visibility": True,
                "selected": True,
                "locked": False,
            }
            for number, (label, position) in enumerate(zip(fiducials.labels, fiducials.positions_mm, strict=True), 1)
        ]
        markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": points}
        schema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
        return write_json({"@schema": schema + "markups-schema-v1.0.3.json#", "markups": [markup]}, indent=1) + "\n"
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    if ending == ".csv":
        writer.writerow(["label", "x_mm", "y_mm", "z_mm"])
        writer.writerows(
            [label, *map(repr, p)] for label, p in zip(fiducials.labels, fiducials.positions_mm, strict=True)
        )
        return stream.getvalue()
    stream.write("# Markups fiducial file version = 5.0\n# CoordinateSystem = LPS\n")
    stream.write("# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n")
    for number, (label, p) in enumerate(zip(fiducials.labels, fiducials.positions_mm, strict=True), 1):
        writer.writerow([number, *map(repr, p), 0, 0, 0, 1, 1, 1, 0, label, "", ""])
    return stream.getvalue()


def _is_name(label: str) -> bool:
    """What a label in a design may be."""
    return len(label) <= 80 and not re.search(r"[\x00-\x1f\x7f]", label)


def refuse(name: str, line: int | None, code: str, detail: str, hint: str = "") -> DesignError:
    """What is wrong in a line of a file, to be raised."""
    return DesignError(Problem("", code, detail, hint, name, line))


def read_number(text: Any, name: str, line: int | None, what: str) -> float:
    """A number of a file, finite and of a size that a coordinate can have.  Raises DesignError."""
    if isinstance(text, str):
        cleaned = text.strip()
        if not re.fullmatch(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", cleaned):
            hint = "write decimals with a point" if re.fullmatch(r"[-+]?[0-9]+,[0-9]+", cleaned) else ""
            raise refuse(name, line, "wrong-type", f"{what} is a number; got {show(text)}", hint)
        value = float(cleaned)
    elif isinstance(text, bool) or not isinstance(text, int | float):
        raise refuse(name, line, "wrong-type", f"{what} is a number; got {show(text)}")
    else:
        value = float(text)
    if not math.isfinite(value) or abs(value) > 1e9:
        raise refuse(name, line, "out-of-range", f"{what} is not a usable number: {show(text)}")
    return value


def _read_position(table: FiducialTable, name: str) -> tuple[tuple[str, ...], tuple[tuple[float, float, float], ...]]:
    """Scale to mm, turn RAS into LPS, fill in labels."""
    scale, flip = _MM[table.unit], -1.0 if table.system == "RAS" else 1.0
    labels = tuple(label or f"F{number}" for number, (label, _) in enumerate(table.rows, 1))
    for label in labels:
        if not _is_name(label):
            detail = f"a label has at most 80 characters and no control characters; got {show(label)}"
            raise refuse(name, None, "bad-label", detail, "rename it in the file")
    # adding 0.0 turns -0.0 into 0.0
    points = tuple((flip * scale * x + 0.0, flip * scale * y + 0.0, scale * z + 0.0) for _, (x, y, z) in table.rows)
    for label, point in zip(labels, points, strict=True):
        if max(map(abs, point)) > 1e5:
            raise refuse(name, None, "out-of-range", f"{label} lies more than 100 m away: {list(point)} mm")
    return labels, points


def _system_comment(line: str) -> str | None:
    found = re.match(r"#\s*coordinate\s*system\s*[=:]\s*(\S+)\s*$", line.strip(), re.IGNORECASE)
    return found.group(1) if found else None


def _system(text: str, name: str, line: int | None) -> System:
    known = _SYSTEMS.get(text.upper())
    if known is None:
        raise refuse(
            name, line, "unknown-value", f"coordinate system {text[:40]!r} cannot be read", "export in LPS or RAS"
        )
    return known


_HEADING = re.compile(r"([xyz])(?:\s*[_/]\s*(\w+)|\s*\[\s*(\w+)\s*\]|\s*\(\s*(\w+)\s*\)|\s+(\w+))?")


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip().lower() for cell in next(csv.reader([line], delimiter=delimiter))]


def _read_heading(cell: str, axis: str) -> str | None:
    """The unit in an axis' heading: x_mm, x [mm], x (mm), x/mm, x mm; empty without one, None of another column."""
    found = _HEADING.fullmatch(cell)
    if found is None or found[1] != axis:
        return None
    return _unit_of(next((unit for unit in found.groups()[1:] if unit), ""))


def _unit_of(cell: str) -> str:
    """A unit by itself, as it is or in brackets."""
    return cell.strip(" []()").replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")


def _read_csv(text: str, name: str) -> FiducialTable:
    system: System = "LPS"
    body: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("#"):
            said = _system_comment(line)
            system = _system(said, name, number) if said else system
        elif line.strip():
            body.append((number, line))
    if not body:
        raise refuse(name, None, "empty-document", f"{name} holds no fiducial")
    delimiter = next((mark for mark in ("\t", ";") if mark in body[0][1]), ",")
    header, *below = [_split(line, delimiter) for _, line in body[:2]]
    units_below = [_unit_of(cell) for cell in below[0]] if below else []
    example = "label,x_mm,y_mm,z_mm"
    columns: list[int] = []
    units: list[str] = []
    unit_row = False
    for axis in "xyz":
        hits = [(index, found) for index, cell in enumerate(header) if (found := _read_heading(cell, axis)) is not None]
        index, unit = hits[0] if len(hits) == 1 else (-1, "")
        if index >= 0 and not unit and index < len(units_below):
            unit, unit_row = units_below[index], True
        if unit not in _MM:
            raise refuse(
                name,
                body[0][0],
                "csv-header",
                f"the header needs one column for {axis} with its unit ({', '.join(f'{axis}_{u}' for u in _MM)}); "
                f"got {show(body[0][1])}",
                f"for example {example}; {axis} [mm], {axis} (mm), or the units in a row of their own are read too; "
                "of a cage of XMALab, convert --xmalab says the unit",
            )
        columns.append(index)
        units.append(unit)
    if len(set(units)) > 1 or (unit_row and [units_below[index] for index in columns] != units):
        stated = ", ".join(units_below[index] for index in columns) if unit_row else ", ".join(units)
        raise refuse(name, body[int(unit_row)][0], "csv-header", f"x, y and z have different units: {stated}")
    others = [cell for index, cell in enumerate(header) if index not in columns]
    unknown = [cell for cell in others if cell not in ("label", "name")]
    if unknown or len(others) > 1:
        raise refuse(
            name, body[0][0], "csv-header", f"unknown or repeated column {show((unknown or others)[0])}", example
        )
    at_label = header.index(others[0]) if others else None
    rows: list[tuple[str, list[float]]] = []
    for number, line in body[2 if unit_row else 1 :]:
        cells = next(csv.reader([line], delimiter=delimiter))
        if len(cells) != len(header):
            detail = f"{len(cells)} cells in a table of {len(header)} columns"
            hint = "write decimals with a point; a label that holds a comma stands in double quotes"
            hint = hint if delimiter == "," and len(cells) > len(header) else ""
            raise refuse(name, number, "csv-row", detail, hint)
        xyz = [read_number(cells[index], name, number, axis) for axis, index in zip("xyz", columns, strict=True)]
        rows.append(("" if at_label is None else cells[at_label].strip(), xyz))
    return FiducialTable(rows, units[0], system)


def _read_fcsv(text: str, name: str) -> FiducialTable:
    """Slicer's legacy format.  Without a stated system the file is RAS, as Slicer wrote it then."""
    system: System | None = None
    columns = ["id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc", "associatednodeid"]
    rows: list[tuple[str, list[float]]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        if line.lstrip().startswith("#"):
            said = _system_comment(line)
            system = _system(said, name, number) if said else system
            stated = re.match(r"#\s*columns\s*=\s*(.*)", line.strip(), re.IGNORECASE)
            columns = [cell.strip().lower() for cell in stated.group(1).split(",")] if stated else columns
            continue
        cells = next(csv.reader([line]))
        entry = dict(zip(columns, cells, strict=False))
        if not {"x", "y", "z"} <= entry.keys():
            raise refuse(name, number, "csv-row", f"a row needs x, y and z; got {show(line)}")
        xyz = [read_number(entry[axis], name, number, axis) for axis in "xyz"]
        rows.append((entry.get("label", "").strip(), xyz))
    return FiducialTable(rows, "mm", system or "RAS", stated=system is not None)


def _read_markups(text: str, name: str, limits: Limits) -> FiducialTable:
    source = read_text(text, limits, file=name, directory=None, form="json")
    data = source.data

    def refuse_at(path: tuple[str | int, ...], code: str, detail: str, hint: str = "") -> DesignError:
        return refuse(name, source.locate(path)[0], code, detail, hint)

    markups = data.get("markups") if isinstance(data, dict) else None
    if not isinstance(markups, list) or not markups or not all(isinstance(item, dict) for item in markups):
        raise refuse_at(
            (), "not-markups", "a .mrk.json file has a list called markups", "save it from 3D Slicer's Markups"
        )
    filled = [index for index, item in enumerate(markups) if item.get("controlPoints")]
    if len(filled) != 1:
        raise refuse_at(
            ("markups",),
            "several-lists",
            f"the file holds {len(filled)} point lists with points; one is needed",
            "export one list",
        )
    at = filled[0]
    markup = markups[at]
    stated = markup.get("coordinateSystem", "LPS")
    if not isinstance(stated, str | int):
        raise refuse_at(
            ("markups", at, "coordinateSystem"), "wrong-type", f"coordinateSystem is a text; got {show(stated)}"
        )
    system = _system(str(stated), name, source.locate(("markups", at, "coordinateSystem"))[0])
    unit = markup.get("coordinateUnits", "mm")
    unit = unit[0] if isinstance(unit, list) and unit else unit  # newer schemas: [code, scheme, meaning]
    if not isinstance(unit, str) or unit not in _MM:
        raise refuse_at(
            ("markups", at, "coordinateUnits"),
            "unknown-value",
            f"coordinateUnits {show(unit)} cannot be read",
            "use mm",
        )
    points = markup["controlPoints"]
    if not isinstance(points, list):
        raise refuse_at(("markups", at, "controlPoints"), "wrong-type", f"controlPoints is a list; got {show(points)}")
    rows: list[tuple[str, list[float]]] = []
    skipped: list[str] = []
    for index, point in enumerate(points):
        path = ("markups", at, "controlPoints", index)
        if not isinstance(point, dict):
            raise refuse_at(path, "wrong-type", f"a control point is a mapping; got {show(point)}")
        label = point.get("label") or ""
        if not isinstance(label, str):
            raise refuse_at((*path, "label"), "wrong-type", f"a label is a text; got {show(label)}")
        if point.get("positionStatus", "defined") != "defined":
            skipped.append(label if label and _is_name(label) else f"number {index + 1}")
            continue
        position = point.get("position")
        if not isinstance(position, list) or len(position) != 3:
            raise refuse_at(
                (*path, "position"), "wrong-type", f"a position is a list of 3 numbers; got {show(position)}"
            )
        line = source.locate((*path, "position"))[0] if any(not isinstance(v, float | int) for v in position) else None
        rows.append(
            (label, [read_number(value, name, line, axis) for axis, value in zip("xyz", position, strict=True)])
        )
    return FiducialTable(rows, unit, system, left_out=skipped)
