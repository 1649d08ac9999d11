"""Fiducial files: tables with units in their header, 3D Slicer's markups, ``.fcsv`` and table of control points.

The content of a file says what it is, not its name.  The connector frame is LPS, the frame of DICOM.  RAS coordinates
have x and y of the opposite sign; they are converted on reading and the conversion is noted, so that no result hides
it.
"""

from __future__ import annotations

import csv
import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, Literal

from ..cures import cure_text
from ..errors import DesignError, LimitError, Problem
from ..field_names import read_name
from ..people_tables import (
    DELIMITERS,
    KEPT_ENDS,
    NUMBERINGS,
    PeopleTable,
    Rows,
    decode_people_text,
    describe_marked_row,
    is_missing,
    quote,
    read_people_table,
    read_plain_number,
    split_heading,
)
from ..results.json_text import write_json
from ..units import LENGTHS_MM
from .document import FiducialOrigin
from .reading import Limits, decode, read_text, show
from .refusals import write_dlt

System = Literal["LPS", "RAS"]

FORMATS = (".csv", ".fcsv", ".mrk.json")  # that are written
ENDINGS = (*FORMATS, ".tsv", ".json")  # of files that are read
_SYSTEMS: dict[str, System] = {"LPS": "LPS", "RAS": "RAS", "0": "RAS", "1": "LPS"}
_AXES: tuple[tuple[str, System | None], ...] = (("xyz", None), ("lps", "LPS"), ("ras", "RAS"))
_OF_SLICER = ("defined", "selected", "visible", "locked", "description")  # more columns of its table
_OF_SHEET = ("diameter", "tolerance_x", "tolerance_y", "tolerance_z")  # more columns of the sheet for a supplier
_STATES = ("undefined", "preview", "defined", "missing")  # of a position in .fcsv, by their numbers
_FCSV: tuple[str, ...]
_FCSV = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc", "associatednodeid")
_FCSV_OF_SLICER_3: tuple[str, ...] = ("label", "x", "y", "z", "sel", "vis")
_SWITCHES = ("vis", "sel", "lock")


@dataclass(frozen=True, slots=True)
class FiducialTable:
    """What a file of fiducials holds, as it stands there."""

    rows: Sequence[tuple[str, list[float]]]  # label and x, y, z
    unit: str
    system: System
    stated: bool = True  # false: the system is what files of the format meant that do not say
    left_out: Sequence[str] = ()  # labels of points that have no position, with their state
    remarks: Sequence[str] = ()  # sentences: other rows that were left out, and what was read as it is not written
    lines: Sequence[int] = ()  # of the file, in which the rows stand; empty: it has none


@dataclass(frozen=True, slots=True)
class FiducialList:
    """Fiducials in con (LPS), mm, and where they were read from, unless they were written into the design."""

    labels: tuple[str, ...]
    positions_mm: tuple[tuple[float, float, float], ...]
    origin: FiducialOrigin | None = None
    lines: tuple[int, ...] = field(default=(), compare=False)  # of the file, each; empty where that is not known

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the numbers on the way, in words."""
        return () if self.origin is None else tuple(self.origin.list_notes())


_OTHER_ENDINGS = {  # of files that people have their beads in
    (".xlsx", ".xls", ".ods", ".numbers"): "save the sheet with the table as CSV UTF-8",
    (".txt", ".dat", ".asc", ".prn"): "name it .csv, where commas, semicolons or tabs stand between its cells",
    (".step", ".stp"): "tailstack convert reads the balls of a STEP file",
}


def check_ending(name: str) -> None:
    """Raises DesignError for a name that no fiducial file has."""
    if not name.lower().endswith(ENDINGS):
        detail, hint = f"{name[:80]!r} is not a fiducial file", f"endings read here: {', '.join(ENDINGS)}"
        hint = next((cure for endings, cure in _OTHER_ENDINGS.items() if name.lower().endswith(endings)), hint)
        raise DesignError(Problem("", "unknown-format", detail, hint))


def read_fiducials(content: bytes, name: str, limits: Limits) -> FiducialList:
    """Read a file as what its content is.  Raises DesignError with file and line, LimitError."""
    check_ending(name)
    if not content.strip(b"\xef\xbb\xbf \t\r\n"):
        raise DesignError(Problem("", "empty-document", f"{name} is empty", file=name))
    if name.lower().endswith(".json") or re.match(rb"(\xef\xbb\xbf)?\s*[{]", content):
        table = _read_markups(decode(content, name).removeprefix("\ufeff"), name, limits)
    elif name.lower().endswith(".fcsv") or content.lstrip(b"\xef\xbb\xbf").startswith(b"# Markups fiducial file"):
        table = _read_fcsv(*decode_people_text(content, name, DesignError), name)
    else:
        table = _read_table(content, name)
    return make_list(table, content, name, limits)


def make_list(table: FiducialTable, content: bytes, name: str, limits: Limits) -> FiducialList:
    """The fiducials of a table that was read from a file: in mm and LPS, each with a label.  Raises as reading does."""
    if not table.rows:
        left = f"; left out, position not defined: {', '.join(table.left_out)[:200]}" if table.left_out else ""
        hint = "place the points and save the file again" if left else "" if b"\n" in content else KEPT_ENDS
        raise DesignError(Problem("", "empty-document", f"{name} holds no fiducial{left}", hint, name))
    for count, what in ((len(table.rows), "fiducials"), (len(table.left_out), "points that are not defined")):
        if count > limits.fiducials:
            detail = f"{name} holds {count} {what}; at most {limits.fiducials}"
            raise LimitError(Problem("", "too-many", detail, file=name))
    labels, positions_mm = _read_position(table, name)
    origin = _origin(table, name, hashlib.sha256(content).hexdigest())
    return FiducialList(labels, positions_mm, origin, tuple(table.lines))


def _origin(table: FiducialTable, name: str, sha256: str) -> FiducialOrigin:
    """What is not as usual is stated, and nothing else: it is written into designs."""
    unusual: dict[str, Any] = {} if table.stated else {"coordinate_system_stated": False}
    if table.unit != "mm":
        unusual["coordinate_unit"] = "um" if table.unit == "µm" else table.unit
    if table.left_out:
        unusual["left_out"] = list(table.left_out)
    if table.remarks:
        unusual["remarks"] = [remark[:400] for remark in table.remarks[:20]]
    return FiducialOrigin(file=name, sha256=sha256, coordinate_system=table.system, **unusual)


def write_fiducials(fiducials: FiducialList, name: str) -> str:
    """The text of a fiducial file in the format its name asks for: LPS, mm, every digit."""
    ending = next(ending for ending in FORMATS if name.lower().endswith(ending))
    if ending == ".mrk.json":
        every = {"positionStatus": "defined", "visibility": True, "selected": True, "locked": False}
        points = [
            {"id": str(number), "label": label, "position": list(position), **every}
            for number, (label, position) in enumerate(zip(fiducials.labels, fiducials.positions_mm, strict=True), 1)
        ]
        markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": points}
        schema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
        return write_json({"@schema": schema + "markups-schema-v1.0.3.json#", "markups": [markup]}, indent=1) + "\n"
    rows = zip(map(_quote, fiducials.labels), (",".join(map(repr, p)) for p in fiducials.positions_mm), strict=True)
    if ending == ".csv":
        return "".join(["label,x_mm,y_mm,z_mm\n", *(f"{label},{place}\n" for label, place in rows)])
    head = "# Markups fiducial file version = 5.0\n# CoordinateSystem = LPS\n"
    head += "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
    return head + "".join(f"{k},{place},0,0,0,1,1,1,0,{label},,\n" for k, (label, place) in enumerate(rows, 1))


def _quote(label: str) -> str:
    """A cell of CSV, in quotes where it holds what separates cells here or in another country."""
    return '"' + label.replace('"', '""') + '"' if re.search(f'["\r\n{DELIMITERS}]', label) else label


def _is_name(label: str) -> bool:
    """What a label in a design may be."""
    return len(label) <= 80 and not re.search(r"[\x00-\x1f\x7f]", label)


def refuse(name: str, line: int | None, code: str, detail: str, hint: str = "") -> DesignError:
    """What is wrong in a line of a file, to be raised."""
    return DesignError(Problem("", code, detail, hint, name, line))


def read_number(text: Any, name: str, line: int | None, what: str) -> float:
    """A number of a file, finite and of a size that a coordinate can have.  Raises DesignError."""
    is_number = isinstance(text, int | float) and not isinstance(text, bool)
    value = read_plain_number(text) if isinstance(text, str) else float(text) if is_number else None
    if value is None:
        hint = (cure_text(text, what) or "leave out what was not measured") if isinstance(text, str) else ""
        raise refuse(name, line, "wrong-type", f"{what} is a number; got {show(text)}", hint)
    return _check_size(value, name, line, what)


def _check_size(value: float, name: str, line: int | None, what: str) -> float:
    if not math.isfinite(value) or (abs(value) > 1e9 and not is_missing(value)):
        raise refuse(name, line, "out-of-range", f"{what} is not a usable number: {value:g}")
    return value


def _name_left(label: str, otherwise: str, state: str) -> str:
    """How a point that was left out is called: by its label and its state."""
    called = label if label and _is_name(label) else otherwise
    return called if state == "undefined" else f"{called[: 78 - len(state) - 3]} ({state})"


def _read_position(table: FiducialTable, name: str) -> tuple[tuple[str, ...], tuple[tuple[float, float, float], ...]]:
    """Scale to mm, turn RAS into LPS, fill in labels."""
    scale, flip = LENGTHS_MM[table.unit], -1.0 if table.system == "RAS" else 1.0
    labels = tuple(label or f"F{number}" for number, (label, _) in enumerate(table.rows, 1))
    for label in labels:
        if not _is_name(label):
            detail = f"a label has at most 80 characters and no control characters; got {show(label)}"
            raise refuse(name, None, "bad-label", detail, "rename it in the file")

    def in_mm(value: float, factor: float) -> float:
        """Without the last digit, which a product of decimals has of its own, and without a negative zero."""
        return float(f"{factor * value:.15g}") + 0.0 if scale != 1 else factor * value + 0.0

    points = tuple((in_mm(x, flip * scale), in_mm(y, flip * scale), in_mm(z, scale)) for _, (x, y, z) in table.rows)
    for label, point in zip(labels, points, strict=True):
        if max(map(abs, point)) > 1e5:
            raise refuse(name, None, "out-of-range", f"{label} lies more than 100 m away: {list(point)} mm")
    return labels, points


def _system_comment(line: str) -> str | None:
    match = re.match(r"#\s*coordinate\s*system\s*[=:]\s*(\S+)\s*$", line.strip(), re.IGNORECASE)
    return match.group(1) if match else None


def _system(text: str, name: str, line: int | None) -> System:
    known = _SYSTEMS.get(text.upper())
    if known is None:
        detail = f"coordinate system {text[:40]!r} cannot be read"
        raise refuse(name, line, "unknown-value", detail, "export in LPS or RAS")
    return known


def _find_axes(cells: Sequence[str]) -> tuple[str, System | None]:
    """The letters of the axes in a header, and the system that they say; no letters where it is none."""
    stems = [split_heading(cell)[0] for cell in cells]
    return next(((axes, system) for axes, system in _AXES if set(axes) <= set(stems)), ("", None))


def _read_table(content: bytes, name: str) -> FiducialTable:
    """A table of x, y and z with units, or 3D Slicer's table of control points: l, p, s or r, a, s in mm."""
    table = read_people_table(content, name, DesignError, lambda cells: bool(_find_axes(cells)[0]))
    axes, system = _find_axes(table.header)
    columns, unit = _find_columns(table, axes or "xyz", bool(system))
    others = {cell.lower(): index for index, cell in enumerate(table.header) if index not in columns}
    numbering = [cell for cell in others if cell in NUMBERINGS]
    names = [cell for cell in others if cell in ("label", "name")]
    of_sheet = [cell for cell in others if split_heading(cell)[0] in _OF_SHEET]
    known = {*numbering[:1], *names[:1], *(_OF_SLICER if system else ()), *of_sheet}
    unknown = [cell for cell in others if cell not in known]
    if unknown or len(others) + 3 != len(table.header):
        repeated = [cell for cell in table.header if [*map(str.lower, table.header)].count(cell.lower()) > 1]
        heading = quote([*unknown, *repeated][0])
        raise table.refuse("csv-header", f"unknown or repeated column {heading}", EXAMPLE, table.header_line)
    at_label = others[(names or numbering)[0]] if names or numbering else None
    rows: list[tuple[str, list[float]]] = []
    lines: list[int] = []
    left_out: list[str] = []
    for line, cells in table.rows:
        label = "" if at_label is None else re.sub(r"^'(?=[=+\-@])", "", cells[at_label].strip())  # see sheet_csv
        table.refuse_summary(label, line, "one more fiducial")
        state = _state_in_slicer_s_table(table, cells, line, others) if system else "defined"
        if state == "defined":
            xyz = [
                _check_size(table.read_number(cells[index], line, index, axis), name, line, axis)
                for axis, index in zip(axes, columns, strict=True)
            ]
            if not any(map(is_missing, xyz)):
                rows.append((label, xyz))
                lines.append(line)
                continue
            state = "missing"
        left_out.append(_name_left(label, f"line {line}", state))
    remarks = list(table.describe())
    if names and numbering:
        remarks.append(f"its column {table.header[others[numbering[0]]]!r} was left out")
    if of_sheet:
        remarks.append(f"its columns {', '.join(of_sheet)} were left out: a design states them itself")
    stated = _find_system(table, name)
    if system and stated not in (None, system):
        detail = f"columns {', '.join(axes)} are {system}, and a remark says {stated}"
        raise table.refuse("contradiction", detail, "leave the remark out", table.header_line)
    return FiducialTable(rows, unit, system or stated or "LPS", left_out=left_out, remarks=remarks, lines=lines)


EXAMPLE = "for example label,x_mm,y_mm,z_mm"


def _find_columns(table: PeopleTable, axes: str, of_slicer: bool) -> tuple[list[int], str]:
    """Where the axes stand, and their one unit; Slicer's table is in mm.  Raises DesignError."""
    headings = [split_heading(cell) for cell in table.header]
    columns, units = [], []
    for axis in axes:
        hits = [index for index, (stem, _) in enumerate(headings) if stem == axis]
        index = hits[0] if len(hits) == 1 else -1
        unit = headings[index][1] if index >= 0 else ""
        below = table.units[index] if table.units and index >= 0 else ""
        if unit and below and unit != below:
            units += [unit, below]
            continue
        unit = unit or below or ("mm" if of_slicer else "")
        if all(read_plain_number(cell) is not None for cell in table.header):
            rows = [list(table.header), *(cells for _, cells in table.rows)]
            if len(rows) == 11:
                first = [read_plain_number(row[0]) for row in rows]
                detail = "eleven rows of numbers, a column for each camera as DLTdv has them, are no fiducials"
                raise table.refuse("csv-header", detail, f"of the first camera, {write_dlt(first)}", 1)
        if unit not in LENGTHS_MM or index < 0:
            listed = ", ".join(f"{axis}_{each}" for each in LENGTHS_MM)
            got = show(table.delimiter.join(table.header))
            detail = f"the header needs one column for {axis} with its unit ({listed}); got {got}"
            hint = _cure_header(table, axis) or (
                f"{EXAMPLE}; {axis} [mm], {axis} (mm), or the units in a row of their own are read too; "
                "of a cage of XMALab or DLTdv, convert --xmalab says the unit"
            )
            raise table.refuse("csv-header", detail, hint, table.header_line)
        columns.append(index)
        units.append(unit)
    if len(set(units)) > 1:
        detail = f"x, y and z have different units: {', '.join(units)}"
        raise table.refuse("csv-header", detail, "give all in one unit", table.units_line or table.header_line)
    return columns, units[0]


def _cure_header(table: PeopleTable, axis: str) -> str:
    """What to do with a table that begins with its numbers, or whose lengths are in a unit that is not read."""
    numbers = [read_plain_number(cell) is not None for cell in table.header]
    if sum(numbers) >= 3:
        names = table.delimiter.join(["label"] * (not numbers[0]) + ["x_mm", "y_mm", "z_mm"])
        return f"its first row is no header: put {names} above it, with the unit of the numbers"
    for stem, unit in ((each.stem, each.unit) for each in map(read_name, table.header)):
        if stem == (axis,) and unit is not None and unit.dimension == "length":
            return f"1 {unit} is {unit.factor:.9g} mm: multiply by that, and call the columns x_mm, y_mm, z_mm"
    return ""


def _state_in_slicer_s_table(table: PeopleTable, cells: list[str], line: int, others: dict[str, int]) -> str:
    """Whether a control point is defined.  Raises DesignError."""
    at = others.get("defined")
    flag = "1" if at is None else cells[at].strip()
    if flag not in ("0", "1"):
        detail = f"defined is 1 or 0; got {show(flag)}"
        raise table.refuse("wrong-type", detail, "export the table anew", line, (at or 0) + 1)
    return "defined" if flag == "1" else "undefined"


def _find_system(table: PeopleTable, name: str) -> System | None:
    """The coordinate system that a remark states.  Raises DesignError for two, or one that is not known."""
    systems: set[System] = set()
    for number, text in table.remarks:
        if system := _system_comment(text):
            systems.add(_system(system, name, number))
        if len(systems) > 1:
            raise refuse(name, number, "contradiction", "another coordinate system was stated above", "state one")
    return next(iter(systems), None)


def _read_fcsv(text: str, encoding: str, name: str) -> FiducialTable:
    """Slicer's legacy format.  Without a stated system the file is RAS, as Slicer wrote it then.

    Slicer 5 adds the state of the position behind the columns, and whether it was made by the program; only a state of
    2 is a bead.  A file that does not name its columns is of Slicer 3.
    """
    system: System | None = None
    columns, stated_columns = _FCSV_OF_SLICER_3, False
    rows: list[tuple[str, list[float]]] = []
    left_out: list[str] = []
    remarks = [f"it is no UTF-8 and was read as {encoding}: look at its names"] if encoding else []
    counts = Rows()
    for number, line in enumerate(re.split(r"\r\n|\n|\r", text.removeprefix("\ufeff")), 1):
        if not line.strip():
            continue
        system_name = _system_comment(line)
        named = re.match(r"#\s*columns\s*=\s*(.*)", line.strip(), re.IGNORECASE)
        if system_name or named:
            if rows or left_out:
                cure = "put it at the beginning of the file"
                raise refuse(name, number, "contradiction", "a row stands above this", cure)
            system = _system(system_name, name, number) if system_name else system
            columns = _read_fcsv_columns(named[1], name, number) if named else columns
            stated_columns = stated_columns or named is not None
            continue
        cells = _split_fcsv(line, name, number)
        expected = {len(columns), *((15, 16) if columns == _FCSV else ())}
        if line.lstrip().startswith("#") and (len(cells) not in expected or re.match(r"\s*#\s*\w+\s*=", line)):
            if not re.match(r"\s*#\s*(Markups fiducial file|Fiducial List file|\w+\s*=)", line):
                counts.leave_out("remark", number)
            continue
        if line.lstrip().startswith("#") and not re.match(r"\s*#\S", line):
            raise refuse(name, number, "csv-row", *describe_marked_row(line))
        entry, state = _read_fcsv_row(cells, columns, name, number, stated_columns, expected)
        label = entry.get("label", "").strip()
        own = entry.get("id", "").strip()
        if not label and not re.fullmatch(r"[0-9]*|vtkMRML\w*", own):
            label = own
        if state == "defined":
            xyz = [read_number(entry[axis], name, number, axis) for axis in "xyz"]
            if not any(map(is_missing, xyz)):
                rows.append((label, xyz))
                continue
            state = "missing"
        left_out.append(_name_left(label, f"line {number}", state))
    return FiducialTable(rows, "mm", system or "RAS", system is not None, left_out, [*remarks, *counts.describe()])


def _read_fcsv_columns(text: str, name: str, number: int) -> tuple[str, ...]:
    """The columns that a file names, without those of the state, which are known by their places."""
    columns = tuple(cell.strip().lower() for cell in text.split(","))
    if columns[: len(_FCSV)] == _FCSV:
        columns = tuple(cell for cell in columns if cell not in ("positionstatus", "autocreated"))
    for index, cell in enumerate(columns):
        if cell not in _FCSV or cell in columns[:index]:
            detail = f"unknown or repeated column {quote(cell)}"
            raise refuse(name, number, "csv-header", detail, f"columns read here: {', '.join(_FCSV)}")
    return columns


def _split_fcsv(line: str, name: str, number: int) -> list[str]:
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise refuse(name, number, "csv-syntax", f"this line is not CSV: {error}", "save it from Slicer anew") from None


def _read_fcsv_row(
    cells: list[str], columns: tuple[str, ...], name: str, number: int, stated: bool, expected: set[int]
) -> tuple[dict[str, str], str]:
    """The cells of a row by their columns, and the state of its position.  Raises DesignError."""
    if len(cells) not in expected:
        detail = f"{len(cells)} cells in a table of {len(columns)} columns"
        hint = "write decimals with a point; a label that holds a comma stands in double quotes"
        if not stated:
            hint = "a file without a line # columns = ... has Slicer 3's label,x,y,z,sel,vis: state its columns"
        elif len(cells) < len(columns):
            hint = "save it from Slicer anew; cells are separated by commas"
        raise refuse(name, number, "csv-row", detail, hint)
    entry = dict(zip(columns, cells, strict=False))  # what is behind the columns is looked at below
    if not {"x", "y", "z"} <= entry.keys():
        raise refuse(name, number, "csv-row", f"a row needs x, y and z; got {show(','.join(cells))}")
    switches = {each: entry[each].strip() for each in _SWITCHES if each in entry}
    more = [cell.strip() for cell in cells[len(columns) :]]
    if len(more) == 2:
        switches["autoCreated, the 16th field,"] = more[1]
    for what, flag in switches.items():
        if flag not in ("0", "1"):
            hint = "write decimals with a point: with commas, fields move to the right"
            raise refuse(name, number, "wrong-type", f"{what} is 0 or 1; got {show(flag)}", hint)
    if more and more[0] not in ("0", "1", "2", "3"):
        detail = f"the 15th field is the state of the position, 0 to 3; got {show(more[0])}"
        raise refuse(name, number, "wrong-type", detail, "write decimals with a point; save it from Slicer anew")
    return entry, _STATES[int(more[0])] if more else "defined"


def _read_markups(text: str, name: str, limits: Limits) -> FiducialTable:
    source = read_text(text, limits, file=name, directory=None, form="json")
    data = source.data

    def refuse_at(path: tuple[str | int, ...], code: str, detail: str, hint: str = "") -> DesignError:
        return refuse(name, source.locate(path)[0], code, detail, hint)

    def expect(kind: type | UnionType, value: Any, path: tuple[str | int, ...], rule: str) -> None:
        if not isinstance(value, kind):
            raise refuse_at(path, "wrong-type", f"{rule}; got {show(value)}")

    markups = data.get("markups") if isinstance(data, dict) else None
    if not isinstance(markups, list) or not markups or not all(isinstance(item, dict) for item in markups):
        detail = "a file of 3D Slicer's points has a list called markups"
        raise refuse_at((), "not-markups", detail, "save it from Slicer's Markups")
    filled = [index for index, item in enumerate(markups) if item.get("controlPoints")]
    if len(filled) != 1:
        detail = f"the file holds {len(filled)} point lists with points; one is needed"
        raise refuse_at(("markups",), "several-lists", detail, "export one list")
    whole = ("markups", filled[0])
    markup = markups[filled[0]]
    stated = markup.get("coordinateSystem", "LPS")
    expect(str | int, stated, (*whole, "coordinateSystem"), "coordinateSystem is a text")
    system = _system(str(stated), name, source.locate((*whole, "coordinateSystem"))[0])
    unit = markup.get("coordinateUnits", "mm")
    unit = unit[0] if isinstance(unit, list) and unit else unit  # newer schemas: [code, scheme, meaning]
    if not isinstance(unit, str) or unit not in LENGTHS_MM:
        detail = f"coordinateUnits {show(unit)} cannot be read"
        raise refuse_at((*whole, "coordinateUnits"), "unknown-value", detail, "use mm")
    expect(list, markup["controlPoints"], (*whole, "controlPoints"), "controlPoints is a list")
    rows: list[tuple[str, list[float]]] = []
    skipped: list[str] = []
    for index, point in enumerate(markup["controlPoints"]):
        path = (*whole, "controlPoints", index)
        expect(dict, point, path, "a control point is a mapping")
        label = point.get("label") or ""
        expect(str, label, (*path, "label"), "a label is a text")
        state = point.get("positionStatus", "defined")
        if state == "defined":
            position, at = point.get("position"), (*path, "position")
            if not isinstance(position, list) or len(position) != 3:
                raise refuse_at(at, "wrong-type", f"a position is a list of 3 numbers; got {show(position)}")
            line = source.locate(at)[0] if any(not isinstance(v, float | int) for v in position) else None
            xyz = [read_number(value, name, line, axis) for axis, value in zip("xyz", position, strict=True)]
            if not any(map(is_missing, xyz)):
                rows.append((label, xyz))
                continue
            state = "missing"
        skipped.append(_name_left(label, f"number {index + 1}", state if state in _STATES else "undefined"))
    kind, remarks = str(markup.get("type", "Fiducial"))[:40], []
    if kind != "Fiducial":
        remarks.append(f"its type is {kind}, which is no list of points; its control points were read as one")
    return FiducialTable(rows, unit, system, left_out=skipped, remarks=remarks)
