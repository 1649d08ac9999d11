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

from .tables import Table
from .verdicts import (
    Breach,
    Check,
    Finding,
    Interval,
    Matrix3,
    MeasureResult,
    Provenance,
    Vector3,
    Verdict,
    assumed_sentence,
    breaches_table,
    checks_sentence,
    checks_table,
    measures_table,
)

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
class Frame:
    """Rows of a result as data, by a name that ``to_frame`` takes."""

    name: str
    rows: tuple[Row, ...]  # all with the same columns
    columns: tuple[str, ...] = ()  # of one that may have no rows
    shown: Table | None = None  # what a notebook shows of it


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
    limits: tuple[tuple[float, str], ...] = ()  # value, what it is called


@dataclass(frozen=True, slots=True)
class Outline:
    """A result at a glance."""

    kind: str
    title: str  # name of the design
    status: str
    sentence: str
    frames: tuple[Frame, ...]  # the first is what ``to_frame`` gives unless asked for another
    chart: Bars | Curves
    remarks: tuple[Finding, ...] = ()


# --- records as rows --------------------------------------------------------------------------------------


_hints = cache(get_type_hints)


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


def frame(kind: type, name: str, records: Sequence[Any], shown: Table | None = None) -> Frame:
    """Records of one kind as data."""
    columns = tuple(column for column, _ in _columns(kind, None))
    return Frame(name, tuple(row_of(record) for record in records), columns, shown)


def verdict_sentence(verdict: Verdict, provenance: Provenance) -> str:
    """How many requirements are kept, the check that decides, and what nobody stated, in words."""
    sentence = checks_sentence(verdict.checks) or "The design states no requirement."
    assumed = assumed_sentence(provenance.assumed)
    return f"{sentence} It rests on {assumed}." if assumed else sentence


def measures_frames(measures: tuple[MeasureResult, ...]) -> tuple[Frame, ...]:
    """Measures made of the errors at targets, if there are any."""
    breaches = [breach for measure in measures for breach in measure.breaches]
    told = (frame(Breach, "breaches", breaches, breaches_table(measures)),) if breaches else ()
    return (frame(MeasureResult, "measures", measures, measures_table(measures)), *told) if measures else ()


def checks_frame(verdict: Verdict) -> Frame:
    """Every requirement at every target; a single one is shown as the sentence alone."""
    shown = checks_table(verdict) if len(verdict.checks) > 1 else None
    return frame(Check, "checks", verdict.checks, shown)
