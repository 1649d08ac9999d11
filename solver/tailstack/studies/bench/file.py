"""Files of bench measurements: the trials of every level at every target, and what a file may not say.

The table is text whose column names state units (``people_tables``).  It has four forms, told apart by their header:
measured points, error vectors, error norms, and summary statistics by level. Whatever cannot be what it claims to be
is refused with its line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Literal

import numpy as np

from ...errors import Problem, TailstackError
from ...geometry.arrays import Array
from ...people_tables import NUMBERINGS, PeopleTable, is_missing, read_people_table, split_heading
from ...people_tables import quote as shown
from ...system import ROTATIONS, TORSOR_COMPONENTS, TRANSLATIONS
from ...units import LENGTHS_MM

__all__ = ["Group", "MeasurementError", "Measurements", "Summary", "read_measurements"]


@dataclass(frozen=True, slots=True)
class Summary:
    """One line of summary statistics; mm, px."""

    n: int | None
    mean_mm: float
    sd_mm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The measurements of one level at one target, installation by installation."""

    level: str
    target: str
    deliberate: Array | None  # (6,) rad, mm: the installation error that the level sets, where the file states it
    values_mm: Array  # (n, 3) points or error vectors; (n,) norms; empty for a summary
    sizes: tuple[int, ...]  # trials of each installation, in the order of values_mm
    installations: tuple[str, ...]
    line: int  # where the group begins
    summary: Summary | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """A file of measurements."""

    name: str
    sha256: str
    form: Form
    unit: str
    rows: int
    groups: tuple[Group, ...]
    states_installations: bool
    notes: tuple[str, ...]


def read_measurements(source: Path | bytes, targets: Sequence[str], name: str | None = None) -> Measurements:
    """Read a file, or its bytes.  ``targets``: names in the design; a file without targets needs just one there.

    Raises MeasurementError with the line and the reason, OSError.
    """
    if isinstance(source, Path):
        name = str(source) if name is None else name
        with source.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    else:
        name, content = name or "measurements", source
    if len(content) > MOST_BYTES:
        raise refusal(name, None, "too-large", f"the file is longer than {MOST_BYTES:,} bytes")
    table = MeasurementTable.of(name, content)
    rows = table.rows()
    return Measurements(
        name=name,
        sha256=sha256(content).hexdigest(),
        form=table.form,
        unit=table.unit,
        rows=len(rows),
        groups=_groups(table, rows, targets),
        states_installations="installation" in table.columns,
        notes=(*table.describe(), *_notes(table, rows)),
    )


def _groups(table: MeasurementTable, rows: Sequence[MeasuredRow], targets: Sequence[str]) -> tuple[Group, ...]:
    by_key: dict[tuple[str, str], list[MeasuredRow]] = {}
    seen: dict[tuple[str | None, ...], int] = {}
    for row in rows:
        target = _target(table, row, targets)
        level = row.labels.get("level", "all")
        if "trial" in row.labels:
            key = (level, target, row.labels.get("installation"), row.labels["trial"])
            if key in seen:
                detail = f"this trial is in line {seen[key]} already"
                hint = "trials of one level, installation and target differ"
                raise refusal(table.name, row.line, "given-twice", detail, hint)
            seen[key] = row.line
        by_key.setdefault((level, target), []).append(row)
    _one_deliberate(table, rows)
    make = _summary_group if table.form == "summary" else _trials_group
    return tuple(make(table, level, target, group_rows) for (level, target), group_rows in by_key.items())


def _target(table: MeasurementTable, row: MeasuredRow, targets: Sequence[str]) -> str:
    target = row.labels.get("target")
    if target is None:
        if len(targets) == 1:
            return targets[0]
        detail = f"the design has {len(targets)} targets, and the file does not say which was measured"
        raise refusal(table.name, table.header_line, "csv-header", detail, "add a column target")
    if target not in targets:
        detail = f"the design has no target {shown(target)}"
        raise refusal(table.name, row.line, "unknown-target", detail, f"targets: {', '.join(targets[:20])}", "target")
    return target


def _one_deliberate(table: MeasurementTable, rows: Sequence[MeasuredRow]) -> None:
    """A level is one installation error, at every target."""
    first: dict[str, MeasuredRow] = {}
    for row in rows:
        level = row.labels.get("level", "all")
        known = first.setdefault(level, row)
        if known.deliberate != row.deliberate:
            detail = f"level {shown(level)} has another installation error in line {known.line}"
            raise refusal(table.name, row.line, "contradiction", detail, "one level, one installation error")


def _deliberate_of(row: MeasuredRow) -> Array | None:
    return None if row.deliberate is None else np.array(row.deliberate)


def _summary_group(table: MeasurementTable, level: str, target: str, rows: Sequence[MeasuredRow]) -> Group:
    if len(rows) > 1:
        detail = f"level {shown(level)} is summed up in line {rows[0].line} already"
        raise refusal(table.name, rows[1].line, "given-twice", detail)
    row = rows[0]
    summary = Summary(row.n, row.values[0], row.sd)
    return Group(level, target, _deliberate_of(row), np.zeros(0), (), (), row.line, summary)


def _trials_group(table: MeasurementTable, level: str, target: str, rows: Sequence[MeasuredRow]) -> Group:
    if not LEAST_TRIALS <= len(rows) <= MOST_TRIALS:
        code, bound = "too-many", f"at most {MOST_TRIALS:,} are read"
        if len(rows) < LEAST_TRIALS:
            code, bound = "too-few-trials", f"at least {LEAST_TRIALS} are needed"
        detail = f"level {shown(level)} at target {shown(target)} has {len(rows)} trials; {bound}"
        raise refusal(table.name, rows[-1].line, code, detail)
    names = list(dict.fromkeys(row.labels.get("installation", "1") for row in rows))
    ordered = [row for name in names for row in rows if row.labels.get("installation", "1") == name]
    values = np.array([row.values for row in ordered])
    sizes = tuple(sum(row.labels.get("installation", "1") == name for row in rows) for name in names)
    return Group(
        level,
        target,
        _deliberate_of(rows[0]),
        values[:, 0] if table.form == "norms" else values,
        sizes,
        tuple(names),
        rows[0].line,
    )


def _notes(table: MeasurementTable, rows: Sequence[MeasuredRow]) -> tuple[str, ...]:
    notes = []
    if table.unit != "mm":
        notes.append(f"lengths were converted from {table.unit} to mm (factor {LENGTHS_MM[table.unit]:g})")
    if table.form != "summary":
        first: dict[tuple[float, ...], int] = {}
        twins = [(first[row.values], row.line) for row in rows if first.setdefault(row.values, row.line) != row.line]
        if twins:
            count = "once" if len(twins) == 1 else f"{len(twins)} times"
            notes.append(
                f"the same numbers stand in two lines {count} (first in lines {twins[0][0]} and {twins[0][1]}): "
                "measured twice alike, or copied?"
            )
    return tuple(notes)


Form = Literal["points", "vectors", "norms", "summary"]

UNITS = ", ".join(LENGTHS_MM)
MOST_BYTES, MOST_TRIALS, LEAST_TRIALS = 20_000_000, 2_000, 3  # the last two: of one level at one target
MOST_LINES = 20_000
FARTHEST_MM = 1e5
AXES: dict[Form, tuple[str, ...]] = {
    "points": ("x", "y", "z"),
    "vectors": ("error_x", "error_y", "error_z"),
    "norms": ("error",),
    "summary": ("mean",),
}
EXAMPLES: dict[Form, str] = {
    "points": "level,installation,trial,target,x_mm,y_mm,z_mm",
    "vectors": "level,installation,trial,target,error_x_mm,error_y_mm,error_z_mm",
    "norms": "level,installation,trial,target,error_mm",
    "summary": "level,target,n,mean_mm,sd_mm",
}
LABELS: dict[Form, tuple[str, ...]] = {
    **dict.fromkeys(("points", "vectors", "norms"), ("level", "installation", "trial", "target")),
    "summary": ("level", "target"),
}


class MeasurementError(TailstackError, slug="invalid-request", title="The measurements are not valid", exit_code=2):
    """The measurement file does not say what it must, or says what cannot be."""


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    line: int
    labels: dict[str, str]
    values: tuple[float, ...]  # mm
    deliberate: tuple[float, ...] | None  # rad, mm
    n: int | None  # of a summary, as is the next
    sd: float | None  # mm


def refusal(name: str, line: int | None, code: str, detail: str, hint: str = "", column: str = "") -> MeasurementError:
    at = None if line is None else 1
    return MeasurementError(Problem(f"/{column}" if column else "", code, detail, hint, name, line, at))


@dataclass(frozen=True, slots=True)
class MeasurementTable:
    name: str
    header_line: int
    columns: dict[str, int]  # name without unit -> place
    heads: dict[str, str]  # and with it
    form: Form
    unit: str
    text: PeopleTable
    numberings: tuple[str, ...]  # columns that only count the rows

    @classmethod
    def of(cls, name: str, content: bytes) -> MeasurementTable:
        text = read_people_table(content, name, MeasurementError, _is_header)
        at, header = text.header_line, text.delimiter.join(text.header)
        numberings = tuple(cell for cell in text.header if cell.lower() in NUMBERINGS)
        headings = ["" if cell in numberings else _heading(cell) for cell in text.header]
        for place, unit in enumerate(text.units or ()):
            stem, own = split_heading(text.header[place])
            if unit and own and unit != own:
                detail = f"column {shown(text.header[place])} has the unit {unit} in the row below"
                raise refusal(name, at, "mixed-units", detail, "state one unit")
            if unit and not own and headings[place]:
                headings[place] = f"{stem}_{unit}"
        used = [cell for cell, own in zip(headings, text.header, strict=True) if own not in numberings]
        form = _form(name, at, header, used)
        passed = {place for place, own in enumerate(text.header) if own in numberings}
        columns, unit = _columns(name, at, headings, form, passed)
        heads = {stem: headings[place] for stem, place in columns.items()}
        return cls(name, at, columns, heads, form, unit, text, numberings)

    def rows(self) -> list[MeasuredRow]:
        lines = list(self.text.rows)
        if not lines:
            detail = "there is a header, and no measurement below it"
            raise refusal(self.name, self.header_line, "empty-document", detail, " ".join(self.text.describe()))
        if len(lines) > MOST_LINES:
            detail = f"{len(lines):,} lines of measurements; at most {MOST_LINES:,} are read"
            raise refusal(self.name, lines[MOST_LINES][0], "too-many", detail, "several files are compared one by one")
        rows = [self._row(line, cells) for line, cells in lines if not self._is_missing(line, cells)]
        if not rows:
            raise refusal(self.name, None, "empty-document", "no row is left", " ".join(self.text.describe()))
        return rows

    def describe(self) -> tuple[str, ...]:
        """What was left out of the file, and what was read in another way than it is written."""
        more = [f"column {shown(cell)} was left out: it counts the rows" for cell in self.numberings]
        return (*self.text.describe(), *more)

    def _is_missing(self, line: int, cells: Sequence[str]) -> bool:
        """Whether a tracker of NDI's did not see what was to be measured; such a row is left out, and counted."""
        places = [self.columns[axis] for axis in AXES[self.form]]
        values = [self.text.find_number(cells[place], line, place) for place in places]
        missing = any(is_missing(value) for value in values if value is not None)
        if missing:
            self.text.counts.leave_out("missing", line)
            self.text.counts.read -= 1
        return missing

    def _row(self, line: int, raw: Sequence[str]) -> MeasuredRow:
        cells = [cell.strip() for cell in raw]
        scale = LENGTHS_MM[self.unit]
        values = tuple(scale * self._number(cells, line, axis) for axis in AXES[self.form])
        labels = {name: cells[self.columns[name]] for name in LABELS[self.form] if name in self.columns}
        for label, text in labels.items():
            if label in ("trial", "installation"):
                self.text.refuse_summary(text, line, f"one more {label}")
            if not text or len(text) > 120 or not text.isprintable():
                detail = f"{label} is a name of at most 120 printable characters; got {shown(text)}"
                hint = "every row has one; without it, leave the column out" if not text else "shorten it"
                raise refusal(self.name, line, "wrong-type", detail, hint, label)
        if max(map(abs, values)) > FARTHEST_MM:
            detail = f"a length of more than {FARTHEST_MM / 1000:g} m: {max(values, key=abs):g} mm"
            raise refusal(self.name, line, "out-of-range", detail, "is the unit in the header the right one?")
        if self.form in ("norms", "summary") and min(values) < 0:
            axis = self.heads[AXES[self.form][int(np.argmin(values))]]
            raise refusal(self.name, line, "out-of-range", f"{axis} cannot be negative", column=axis)
        deliberate = self._deliberate(cells, line)
        return MeasuredRow(line, labels, values, deliberate, self._n(cells, line), self._sd(cells, line))

    def _number(self, cells: Sequence[str], line: int, column: str) -> float:
        place, column = self.columns[column], self.heads[column]
        cell = cells[place]
        if not cell:
            hint = "leave out what was not measured"
            raise refusal(self.name, line, "missing-value", f"{column} is empty", hint, column)
        value = self.text.find_number(cell, line, place)
        if value is None:
            if re.fullmatch(r"[-+]?(nan|inf|infinity|#n/a|n/a|na)", cell.lower()):
                detail, hint = f"{column} is not a finite number: {shown(cell)}", "leave out what was not measured"
            else:
                detail, hint = f"{column} is a number; got {shown(cell)}", self.text.cure(cell, column)
            raise refusal(self.name, line, "wrong-type", detail, hint, column)
        return value

    def _deliberate(self, cells: Sequence[str], line: int) -> tuple[float, ...] | None:
        if not any(component in self.columns for component in TORSOR_COMPONENTS):
            return None
        torsor = []
        for component in TORSOR_COMPONENTS:
            value = self._number(cells, line, component) if component in self.columns else 0.0
            factor = np.pi / 180 if component in ROTATIONS else LENGTHS_MM[self.unit]
            if component in ROTATIONS and abs(value) > 45:
                head = self.heads[component]
                raise refusal(self.name, line, "out-of-range", f"{head} is beyond 45 deg: {value:g}", "", head)
            if component in TRANSLATIONS and abs(value * factor) > FARTHEST_MM:
                head = self.heads[component]
                hint = "is the unit in the header the right one?"
                raise refusal(self.name, line, "out-of-range", f"{head} is more than 100 m: {value:g}", hint, head)
            torsor.append(float(value * factor))
        return tuple(torsor)

    def _n(self, cells: Sequence[str], line: int) -> int | None:
        if "n" not in self.columns or self.form != "summary":
            return None
        cell = cells[self.columns["n"]]
        if not re.fullmatch(r"[0-9]{1,9}", cell) or not 2 <= int(cell) <= MOST_TRIALS:
            detail = f"n is a whole number from 2 to {MOST_TRIALS:,}; got {shown(cell)}"
            code = "too-few-trials" if cell in ("0", "1") else "out-of-range"
            hint = "leave the column out where the number is not known" if not cell else ""
            raise refusal(self.name, line, code, detail, hint, "n")
        return int(cell)

    def _sd(self, cells: Sequence[str], line: int) -> float | None:
        if "sd" not in self.columns:
            return None
        value, head = LENGTHS_MM[self.unit] * self._number(cells, line, "sd"), self.heads["sd"]
        if value < 0:
            raise refusal(self.name, line, "out-of-range", f"{head} cannot be negative", "", head)
        if value > FARTHEST_MM:
            hint = "is the unit in the header the right one?"
            raise refusal(self.name, line, "out-of-range", f"{head} is more than 100 m", hint)
        return value


def _heading(cell: str) -> str:
    """A column with its unit behind a line, however it is written."""
    stem, unit = split_heading(cell)
    return f"{stem}_{unit}" if unit else stem


def _is_header(cells: Sequence[str]) -> bool:
    """Whether cells name everything that one of the forms needs."""
    stems = {split_heading(cell)[0] for cell in cells}
    return any(set(axes) <= stems for axes in AXES.values())


def _form(name: str, line: int, header: str, headings: Sequence[str]) -> Form:
    """Which form the header names; a number without a unit is told so."""
    stems = {cell.rpartition("_")[0] for cell in headings}
    fits = [form for form, axes in AXES.items() if set(axes) <= stems]
    if len(fits) == 1:
        return fits[0]
    known = "; ".join(EXAMPLES.values())
    if len(fits) > 1:
        detail = f"the header fits several forms ({', '.join(fits)})"
        raise refusal(name, line, "csv-header", detail, f"one of: {known}")
    bare = [cell for cell in headings if any(cell in axes for axes in AXES.values())]
    if bare:
        detail = f"column {shown(bare[0])} states no unit"
        raise refusal(name, line, "csv-header", detail, f"for example {bare[0]}_mm; units: {UNITS}")
    partial = [(form, axes) for form, axes in AXES.items() if set(axes) & stems]
    if partial:
        form, axes = partial[0]
        missing = [f"{axis}_mm" for axis in axes if axis not in stems]
        raise refusal(name, line, "csv-header", f"column {missing[0]} is missing", f"for example {EXAMPLES[form]}")
    detail = f"this header names no measured quantity: {shown(header)}"
    raise refusal(name, line, "csv-header", detail, f"one of: {known}")


def _columns(name: str, line: int, headings: Sequence[str], form: Form, passed: set[int]) -> tuple[dict[str, int], str]:
    """Place of every column by its name without unit, and the one unit of all lengths."""
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    allowed = {*LABELS[form], *(("n",) if form == "summary" else ())}
    for place, cell in enumerate(headings):
        stem, _, unit = cell.rpartition("_")
        if place in passed:
            continue
        if cell in allowed:
            stem, unit = cell, ""
        elif stem in ROTATIONS:
            if unit != "deg":
                raise refusal(name, line, "csv-header", f"rotations are in degrees: {stem}_deg; got {shown(cell)}")
        elif stem in AXES[form] or stem in TRANSLATIONS or (stem == "sd" and form == "summary"):
            if unit not in LENGTHS_MM:
                detail = f"column {shown(cell)} has no known unit of length"
                raise refusal(name, line, "csv-header", detail, f"for example {stem}_mm; units: {UNITS}")
            units[cell] = unit
        else:
            detail, hint = f"unknown column {shown(cell)}", f"known here: {EXAMPLES[form]}, rx_deg ... tz_mm"
            if not cell:
                detail, hint = f"column {place + 1} has no name", "leave it out, with the delimiter before it"
            raise refusal(name, line, "csv-header", detail, hint)
        if stem in columns:
            raise refusal(name, line, "csv-header", f"column {shown(stem)} is there twice")
        columns[stem] = place
    if len(set(units.values())) > 1:
        listed = ", ".join(units)
        detail = f"the columns have different units: {listed}"
        raise refusal(name, line, "mixed-units", detail, "give all lengths of a file in one unit")
    return columns, next(iter(units.values()))
