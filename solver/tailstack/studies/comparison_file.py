"""Files of bench measurements: the trials of every level at every target, and what a file may not say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from ..system import Array
from .comparison_table import (
    LEAST_TRIALS,
    MM,
    MOST_BYTES,
    MOST_TRIALS,
    Form,
    MeasurementError,
    Row,
    Table,
    refusal,
    shown,
    text_of,
)

__all__ = ["Group", "MeasurementError", "Measurements", "Summary", "read_measurements"]


@dataclass(frozen=True, slots=True)
class Summary:
    """One line of summary statistics; mm, px."""

    n: int | None
    mean_mm: float
    sd_mm: float | None
    p95_mm: float | None
    reprojection_px: float | None


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
    table = Table.of(name, text_of(name, content))
    rows = table.rows()
    return Measurements(
        name=name,
        sha256=sha256(content).hexdigest(),
        form=table.form,
        unit=table.unit,
        rows=len(rows),
        groups=_groups(table, rows, targets),
        states_installations="installation" in table.columns,
        notes=_notes(table, rows),
    )


def _groups(table: Table, rows: Sequence[Row], targets: Sequence[str]) -> tuple[Group, ...]:
    by_key: dict[tuple[str, str], list[Row]] = {}
    seen: dict[tuple[str | None, ...], int] = {}
    for row in rows:
        target = _target(table, row, targets)
        level = row.labels.get("level", "all")
        if "trial" in row.labels:
            key = (level, target, row.labels.get("installation"), row.labels["trial"])
            if key in seen:
                detail = f"this trial is in line {seen[key]} already"
                raise refusal(
                    table.name, row.line, "given-twice", detail, "trials of one level, installation and target differ"
                )
            seen[key] = row.line
        by_key.setdefault((level, target), []).append(row)
    _one_deliberate(table, rows)
    make = _summary_group if table.form == "summary" else _trials_group
    return tuple(make(table, level, target, found) for (level, target), found in by_key.items())


def _target(table: Table, row: Row, targets: Sequence[str]) -> str:
    said = row.labels.get("target")
    if said is None:
        if len(targets) == 1:
            return targets[0]
        detail = f"the design has {len(targets)} targets, and the file does not say which was measured"
        raise refusal(table.name, table.header_line, "csv-header", detail, "add a column target")
    if said not in targets:
        detail = f"the design has no target {shown(said)}"
        raise refusal(table.name, row.line, "unknown-target", detail, f"targets: {', '.join(targets[:20])}", "target")
    return said


def _one_deliberate(table: Table, rows: Sequence[Row]) -> None:
    """A level is one installation error, at every target."""
    first: dict[str, Row] = {}
    for row in rows:
        known = first.setdefault(row.labels.get("level", "all"), row)
        if known.deliberate != row.deliberate:
            detail = (
                f"level {shown(row.labels.get('level', 'all'))} has another installation error in line {known.line}"
            )
            raise refusal(table.name, row.line, "contradiction", detail, "one level, one installation error")


def _deliberate_of(row: Row) -> Array | None:
    return None if row.deliberate is None else np.array(row.deliberate)


def _summary_group(table: Table, level: str, target: str, rows: Sequence[Row]) -> Group:
    if len(rows) > 1:
        detail = f"level {shown(level)} is summed up in line {rows[0].line} already"
        raise refusal(table.name, rows[1].line, "given-twice", detail)
    row = rows[0]
    (mean,) = row.values
    return Group(
        level,
        target,
        _deliberate_of(row),
        np.zeros(0),
        (),
        (),
        row.line,
        Summary(row.n, mean, row.sd, row.p95, row.reprojection_px),
    )


def _trials_group(table: Table, level: str, target: str, rows: Sequence[Row]) -> Group:
    if not LEAST_TRIALS <= len(rows) <= MOST_TRIALS:
        few = len(rows) < LEAST_TRIALS
        bound = f"at least {LEAST_TRIALS}" if few else f"at most {MOST_TRIALS:,}"
        detail = f"level {shown(level)} at target {shown(target)} has {len(rows)} trials; {bound} are needed"
        raise refusal(
            table.name,
            rows[-1].line,
            "too-few-trials" if few else "too-many",
            detail.replace("are needed", "are needed" if few else "are read"),
        )
    names = list(dict.fromkeys(row.labels.get("installation", "1") for row in rows))
    ordered = [row for name in names for row in rows if row.labels.get("installation", "1") == name]
    values = np.array([row.values for row in ordered])
    sizes = tuple(sum(row.labels.get("installation", "1") == name for row in rows) for name in names)
    return Group(
        level, target, _deliberate_of(rows[0]), values[:, 0] if table.form == "norms" else values, sizes, tuple(names),
        rows[0].line,
    )  # fmt: skip


def _notes(table: Table, rows: Sequence[Row]) -> tuple[str, ...]:
    notes = []
    if table.unit != "mm":
        notes.append(f"lengths were converted from {table.unit} to mm (factor {MM[table.unit]:g})")
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
