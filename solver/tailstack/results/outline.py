"""What of a result people see first, whatever shows it: its verdict in a sentence, its tables, its chart.

Each result says it once (``outline``); a notebook's page, data frames and plots are made from it alike for all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from .verdicts import Check, Finding, Interval, Matrix3, Vector3, Verdict, check_sentence, decisive_check

Row = Mapping[str, Any]  # by column; units are in the names of the columns
UNITS = ("mm", "mm2", "px", "deg")
PARTS: dict[Any, tuple[tuple[str, tuple[int, ...]], ...]] = {  # of a field of several numbers: ending, place
    Vector3: (("x", (0,)), ("y", (1,)), ("z", (2,))),
    Interval: (("low", (0,)), ("high", (1,))),
    tuple[float, float | None]: (("low", (0,)), ("high", (1,))),
    Matrix3: (
        ("xx", (0, 0)), ("xy", (0, 1)), ("xz", (0, 2)), ("yy", (1, 1)), ("yz", (1, 2)), ("zz", (2, 2)),
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table as people see it."""

    name: str  # in the rows
    heading: str
    decimals: int | None = None  # of a number; None: as many as it has
    bar: bool = False  # a share, per cent, drawn as a bar too


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of a result, by a name that ``to_frame`` takes."""

    name: str
    title: str
    rows: tuple[Row, ...]  # all with the same columns
    shown: tuple[Column, ...] = ()  # what a notebook shows of it; empty: nothing
    selected: tuple[Row, ...] = ()  # the rows that it shows; empty: the first ones
    columns: tuple[str, ...] = ()  # of a table that may have no rows


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar of a chart."""

    label: str
    value: float
    interval: tuple[float, float | None] | None = None
    limit: float | None = None
    before: float | None = None  # a paler bar behind it


@dataclass(frozen=True, slots=True)
class Bars:
    """Bars one below the other."""

    title: str
    axis: str  # what they measure, with its unit
    bars: tuple[Bar, ...]


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve over the values of an axis; None where nothing could be computed."""

    name: str
    values: tuple[float | None, ...]
    intervals: tuple[tuple[float, float] | None, ...] = ()


@dataclass(frozen=True, slots=True)
class Curves:
    """Curves over one axis."""

    title: str
    across: str  # what varies, with its unit
    up: str  # what is drawn, with its unit
    places: tuple[float, ...]
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Outline:
    """A result at a glance."""

    kind: str
    title: str  # name of the design
    status: str
    sentence: str
    tables: tuple[Table, ...]  # the first is what ``to_frame`` gives unless asked for another
    chart: Bars | Curves
    remarks: tuple[Finding, ...] = ()


# --- records as rows --------------------------------------------------------------------------------------


def row_of(record: Any, **more: Any) -> dict[str, Any]:
    """A record as one row; ``more`` stands before it.

    A vector has a column for each component (``bias_x_mm``), an interval one for each end (``p95_low_mm``), a record
    inside a column for each of its fields (``localisation_p95_mm``).  Lists of records are tables of their own.
    """
    return {**more, **dict(_columns(type(record), record))}


def _columns(kind: type, record: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of the columns of a kind of record; all are None where there is no record."""
    hints = _hints(kind)
    for field in fields(kind):
        value = None if record is None else getattr(record, field.name)
        yield from _column(field.name, hints[field.name], value)


def _column(name: str, hint: Any, value: Any) -> Iterator[tuple[str, Any]]:
    stem, _, ending = name.rpartition("_")
    stem, unit = (stem, f"_{ending}") if ending in UNITS else (name, "")
    if get_origin(hint) in (Union, UnionType):  # of something and None
        hint = next((option for option in get_args(hint) if option in PARTS or is_dataclass(option)), hint)
    if isinstance(hint, type) and is_dataclass(hint):
        for inner, part in _columns(hint, value):
            yield f"{stem}_{inner}{unit}", part
    elif hint in PARTS:
        stem = stem.removesuffix("_interval")
        for part_name, place in PARTS[hint]:
            part = value
            for index in place:
                part = None if part is None else part[index]
            yield f"{stem}_{part_name}{unit}", part
    elif get_origin(hint) is tuple:
        if get_args(hint)[0] is str:
            yield name, None if value is None else "; ".join(value)
    elif get_origin(hint) is not dict:
        yield name, value.value if isinstance(value, Enum) else value


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def plain(value: Any) -> Any:
    """A record as dictionaries, lists, texts, numbers and None: what its JSON holds."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value.value if isinstance(value, Enum) else value


# --- what several results say alike -----------------------------------------------------------------------


def table(kind: type, name: str, title: str, records: Sequence[Any], *shown: Column) -> Table:
    """Records of one kind as a table."""
    columns = tuple(column for column, _ in _columns(kind, None))
    return Table(name, title, tuple(row_of(record) for record in records), shown, columns=columns)


def verdict_sentence(verdict: Verdict) -> str:
    """The check that decides, in words."""
    check = decisive_check(verdict.checks)
    return "The design states no requirement." if check is None else check_sentence(check)


def checks_table(verdict: Verdict) -> Table:
    """Every requirement at every target; a single one is shown as the sentence alone."""
    columns = (
        Column("requirement", "requirement"), Column("target", "target"), Column("headline", "of the error"),
        Column("value_mm", "value, mm", 3), Column("interval_low_mm", "from", 3), Column("interval_high_mm", "to", 3),
        Column("limit_mm", "limit, mm"), Column("status", "status"),
    )  # fmt: skip
    return table(Check, "checks", "Requirements", verdict.checks, *(columns if len(verdict.checks) > 1 else ()))
