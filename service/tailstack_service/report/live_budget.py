"""The budget of a target as a sheet that moves: half-widths may be changed there, and what hangs on them follows.

Shares and the root sum of squares are those of the covariance, exact for any half-widths.  The square of the value that
is limited grows by a sum over the half-widths h, which the design has as h0: by t x, where x = h^2 - h0^2, and towards
the limit by e x^2 more.  The slope t is that of the budget, and e is such that each half-width by itself meets the
limit where it was computed to.  So at h0 all numbers are what is printed; elsewhere the value is an estimate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import sqrt
from typing import NamedTuple

from tailstack.results import Check, TargetScore
from tailstack.results.score import group, heading_of
from tailstack.results.tables import Cell, Column, Row, Table
from tailstack.results.verdicts import what_is_limited

from ..rendering.blocks import ChangeableNumber, Formula
from .headline import tightest_check
from .records import Allowance

FIRST = 3  # row of a sheet in which the rows of its table begin
COLUMNS = (
    Column("Contributor"), Column("Component"), Column("Unit", kind="unit"),
    Column("Half-width as it is", "unit", "given"), Column("Half-width", "unit", "given"),
    Column("Std of the error", "mm/unit", "significant"), Column("Slope t", "mm²/unit²", "significant"),
    Column("Curvature e", "mm²/unit⁴", "significant"), Column("Contribution", "mm", "significant"),
    Column("Share of variance", "%", "percent", 1), Column("Square of the value grown", "mm²", "significant"),
    Column("At limit as it is", "unit", "significant"), Column("At limit", "unit", "significant"),
    Column("Slack", "unit", "significant"), Column("Value", "mm", "fixed"), Column("Limit", "mm", "stated"),
    Column("Limit less value", "mm", "signed"),
)  # fmt: skip
NOTE = (
    "The yellow numbers may be changed: contributions, shares, their root sum of squares (in the last row), value and "
    "slack follow. Contributions and shares are exact. The value is so as it is, and where one half-width by itself "
    "stands at its limit; elsewhere it is an estimate: score the design anew before it is drawn. Sources without a "
    "half-width of their own stay as they are, and those of 0 are left out."
)


class _LiveLine(NamedTuple):
    """A source or component that no other line holds too."""

    contributor: str
    component: str
    unit: str
    half_width: float | None  # None: none of its own
    contribution: float  # standard deviation of the error, mm
    slope: float = 0.0
    curvature: float = 0.0
    at_limit: float | None = None


def live_budget(target: TargetScore, name: str, allowances: Sequence[Allowance], checks: Sequence[Check]) -> Table:
    """The sheet of a target; checks: those to first order."""
    check = tightest_check(checks, target.name)
    if check is not None and check.beyond is not None:
        check = None  # its value is no quantile, as the half-widths at its limit are
    value, limit = (target.budget_p95_mm, None) if check is None else (check.value, check.limit)
    known = {(a.contributor, a.component): a for a in allowances if check and a.target == target.name}
    lines = list(_list_lines(target, value, limit, known))
    last, end = FIRST + len(lines) - 1, FIRST + len(lines)
    rss = sqrt(sum(line.contribution**2 for line in lines))
    as_it_is = f"{value!r}^2".upper()
    rows = [_write(line, rss, end, f"($P${end}^2-{as_it_is}-$K${end}+K{{row}})") for line in lines]
    together: tuple[Cell, ...] = (
        Formula(rss, f"SQRT(SUMSQ(I{FIRST}:I{last}))"),
        Formula(1.0 if rss else 0.0, f"SUM(J{FIRST}:J{last})"),
        Formula(0.0, f"SUM(K{FIRST}:K{last})"),
        None, None, None,
        Formula(value, f"SQRT(MAX(0,{as_it_is}+K{end}))"),
        None if limit is None else ChangeableNumber(limit),
        None if limit is None else Formula(limit - value, f"P{end}-O{end}"),
    )  # fmt: skip
    rows.append(Row(("Together", "", "", None, None, None, None, None, *together)))
    said = "P95 of the error at the tool" if check is None else f"{what_is_limited(check)} ({check.requirement})"
    return Table(name, f"What if, target {target.name}; value: {said}", COLUMNS, tuple(rows), NOTE)


def _list_lines(
    target: TargetScore, value: float, limit: float | None, known: Mapping[tuple[str, str], Allowance]
) -> Iterator[_LiveLine]:
    budget = [(total, part) for total, parts in group(target.contributors) for part in parts or [total]]
    of_all = sum(std**2 for std in target.std_mm)
    for _, line in budget:
        if line.std and line.sensitivity_mm_per_unit and line.variance_share:  # of shots that miss no fiducial
            of_all = (line.std * line.sensitivity_mm_per_unit) ** 2 / line.variance_share
            break
    for total, line in budget:
        named = (heading_of(total), "" if line.component in ("all", "known") else line.component)
        contribution, width = sqrt(max(line.variance_share, 0.0) * of_all), line.half_width
        if not width:
            if contribution:
                yield _LiveLine(*named, "", None, contribution)
            continue
        slope, curvature = value**2 / target.budget_p95_mm * line.slope / width, 0.0
        own = known.get((line.name, line.component))
        at_limit = None if own is None else own.at_limit
        if limit is not None and at_limit is not None and at_limit != width:
            further = at_limit**2 - width**2
            straight = (limit**2 - value**2) / further
            if straight <= slope / 2:  # a parabola would come to the limit on its other side
                slope = straight
            curvature = (straight - slope) / further
        yield _LiveLine(*named, line.unit, width, contribution, slope, curvature, at_limit)


def _write(line: _LiveLine, rss: float, end: int, room: str) -> Row:
    """Cells of a line; end: row of what all come to together, room: how much of its own the square may grow by."""
    width, empty = line.half_width, (None, None, None)
    share = Formula((line.contribution / rss) ** 2 if rss else 0.0, f"IF($I${end}=0,0,(I{{row}}/$I${end})^2)")
    if width is None:
        return Row((*line[:3], *empty, None, None, line.contribution, share, None, *empty, *empty))
    stated = (width, ChangeableNumber(width), line.contribution / width, line.slope, line.curvature)
    squares = "(E{row}^2-D{row}^2)"
    side = "MAX" if line.at_limit is not None and line.at_limit > width else "MIN"  # where the limit lies
    grown = Formula(0.0, f"G{{row}}*{squares}+H{{row}}*{side}(0,{squares})^2")
    at_limit: tuple[Cell, ...] = empty
    if line.at_limit is not None and line.slope > 0:
        root = f"SQRT(MAX(0,G{{row}}^2+4*H{{row}}*{side}(0,{room})))"
        now = Formula(line.at_limit, f"SQRT(MAX(0,D{{row}}^2+2*{room}/(G{{row}}+{root})))")
        at_limit = (line.at_limit, now, Formula(line.at_limit - width, "M{row}-E{row}"))
    contribution = Formula(line.contribution, "F{row}*E{row}")
    return Row((*line[:3], *stated, contribution, share, grown, *at_limit, *empty))
