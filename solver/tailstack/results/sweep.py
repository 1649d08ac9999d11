"""The record of a sweep: one row for every point of a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, NamedTuple

from .digits import count_decimals
from .outline import Curve, Curves, Frame, Outline, row_of
from .record import Result
from .tables import EVERYWHERE, LONG_TABLE, PAPER, TERMINAL, Column, On, Table, fill
from .verdicts import Interval, MeasureResult, Provenance

MOST_TARGETS = 6  # with a curve of their own
MOST_LIMITS = 3  # drawn
CONTAINERS = ("interfaces", "locators", "tolerances")


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """A number of the design that was varied."""

    pointer: str
    """JSON pointer (RFC 6901) into the design document; a step * stands for every element."""
    unit: str
    """Unit of the values: deg, mm, px, N or empty."""
    base: float | None
    """What the design as it stands has there; null where a pointer with * leads to several values."""
    values: tuple[float, ...]
    """Values that were put there, in `unit`."""
    name: str = ""
    """The same place by names, as people write it: interfaces.structure_connector.locators.A3.half_width_mm."""

    @property
    def label(self) -> str:
        """What to call it: its name, or the pointer where there is none."""
        return self.name or self.pointer

    @property
    def short(self) -> str:
        """The same without the fields that hold lists and tables, for legends and narrow columns."""
        return ".".join(word for word in self.name.split(".") if word not in CONTAINERS) or self.pointer


@dataclass(frozen=True, slots=True)
class SweepTarget:
    """What was found at one target of one point: the TCP error."""

    name: str
    """Name of the target, or of one sample of a region (zone[3])."""
    p95_mm: float
    """95 % quantile of the TCP error's norm, mm."""
    p95_interval_mm: Interval | None
    """Confidence interval of it by Monte Carlo, mm; null for scores."""
    mean_norm_mm: float
    """Mean of the TCP error's norm, mm."""
    bias_norm_mm: float
    """Norm of the mean TCP error, mm."""
    localisation_p95_mm: float
    """95 % quantile of the localisation error's norm, mm."""
    limit_mm: float | None = None
    """Limit that the design sets on the error there, mm; null where it sets none."""


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One point of the grid."""

    values: tuple[float, ...]
    """Values at this point, in the order and units of the axes."""
    status: Literal["ok", "refused"]
    """refused: the design could not be computed with these values."""
    reason: str | None
    """Why it was refused; otherwise null."""
    targets: tuple[SweepTarget, ...]
    """What was found at each target; empty where it was refused."""
    verdict: Literal["pass", "fail", "inconclusive", "no requirement"] | None
    """Verdict on the design with these values; null where it was refused."""
    measures: tuple[MeasureResult, ...] = ()
    """Measures made of the errors at targets, wherever they are read."""


@dataclass(frozen=True, slots=True, repr=False)
class Sweep(Result):
    """A grid of designs: every combination of the axes' values, the last axis running fastest."""

    schema: Literal["tailstack/sweep/1"]
    axes: tuple[SweepAxis, ...]
    """The numbers of the design that were varied."""
    check: Literal["score", "verification"]
    """What was computed at each point: score (first order) or verification (Monte Carlo)."""
    seed: int | None
    """Seed of every point's check, so that points differ by their designs alone; null for scores."""
    trials: int | None
    """Trials asked for at every point; null: a score, or as many as the precision takes."""
    max_trials: int | None
    """At most so many at every point; null: a score, or trials were asked for."""
    points: tuple[SweepPoint, ...]
    """Every combination of the axes' values, the last axis running fastest."""
    provenance: Provenance
    """Of the design as it stands."""

    def outline(self) -> Outline:
        """A row for each point and target, and curves of P95 over an axis."""
        pointers = [axis.pointer for axis in self.axes]
        rows = []
        for point in self.points:
            shared: dict[str, Any] = dict(zip(pointers, point.values, strict=True))
            shared |= {"status": point.status, "verdict": point.verdict}
            rows += [
                {**shared, "target": row.pop("name"), **row, "reason": point.reason}
                for row in ([row_of(target) for target in point.targets] or [dict(_NOTHING)])
            ]
        passing = sum(point.verdict == "pass" for point in self.points)
        refused = sum(point.status == "refused" for point in self.points)
        left = sum(point.verdict == "inconclusive" for point in self.points)
        unsure = f", {left:,} open" if left else ""
        more = f"; {refused:,} could not be computed, the column reason says why." if refused else "."
        return Outline(
            "Sweep, " + ("estimates" if self.check == "score" else "Monte Carlo checks"),
            self.provenance.design_name,
            "",
            f"{len(self.points):,} points, {passing:,} of them pass{unsure}{more}",
            (Frame("points", tuple(rows), shown=points_table(self)),),
            self._curves(),
        )

    @property
    def letters(self) -> str:
        """What its axes are called where there is little room."""
        return "ABCDEF"[: len(self.axes)]

    @property
    def decimals(self) -> int:
        """Decimals of its lengths."""
        targets = [target for point in self.points for target in point.targets]
        sizes = [target.p95_mm if target.limit_mm is None else target.limit_mm for target in targets]
        return max((count_decimals(size) for size in sizes), default=3)

    def limits(self) -> list[tuple[float, str]]:
        """Limits that hold at every point, with the targets that have them; few enough to be drawn."""
        known: dict[str, set[float | None]] = {}
        for point in self.points:
            for target in point.targets:
                known.setdefault(target.name, set()).add(target.limit_mm)
        by_limit: dict[float, list[str]] = {}
        for name, values in known.items():
            limit = next(iter(values))
            if len(values) == 1 and limit is not None:
                by_limit.setdefault(limit, []).append(name)
        return [
            (limit, "limit" if len(by_limit) == 1 else f"limit of {names[0]}" + (", ..." if len(names) > 1 else ""))
            for limit, names in list(by_limit.items())[:MOST_LIMITS]
        ]

    def _curves(self) -> Curves:
        """P95 over the last axis of several values: a curve for each target, or for each value of the other axes."""
        sizes = [len(axis.values) for axis in self.axes]
        across = max((k for k, size in enumerate(sizes) if size > 1), default=0)
        others = [k for k, size in enumerate(sizes) if k != across and size > 1]
        index = {point.values: point for point in self.points}
        names = list(dict.fromkeys(target.name for point in self.points for target in point.targets))

        def read(name: str, fixed: dict[int, float], target: str | None) -> Curve:
            entries: list[SweepTarget | None] = []
            for value in self.axes[across].values:
                held = {**fixed, across: value}
                point = index[tuple(held.get(k, axis.values[0]) for k, axis in enumerate(self.axes))]
                among = [entry for entry in point.targets if target in (None, entry.name)]
                entries.append(max(among, key=lambda entry: entry.p95_mm, default=None))
            return Curve(
                name,
                tuple(None if entry is None else entry.p95_mm for entry in entries),
                tuple(None if entry is None else entry.p95_interval_mm for entry in entries),
            )

        if others:
            curves = []
            for values in product(*(self.axes[k].values for k in others)):
                words = [f"{self.axes[k].short} {value:g}" for k, value in zip(others, values, strict=True)]
                curves.append(read(", ".join(words), dict(zip(others, values, strict=True)), None))
            title = "P95 of the worst target"
        elif len(names) > MOST_TARGETS:
            curves, title = [read("", {}, None)], f"P95 at the worst of {len(names)} targets"
        else:
            curves = [read(name, {}, name) for name in names]
            title = "P95 at " + (f"target {names[0]}" if len(names) == 1 else "each target")
        axis = self.axes[across]
        across_words = axis.label + (f", {axis.unit}" if axis.unit else "")
        return Curves(title, across_words, "P95, mm", axis.values, tuple(curves), tuple(self.limits()))


_NOTHING = dict.fromkeys(row_of(SweepTarget("", 0.0, None, 0.0, 0.0, 0.0)))  # of a point that was refused


def points_table(sweep: Sweep) -> Table:
    """Every point at its worst target; paper has the other targets, too."""
    decimals, checked = sweep.decimals, sweep.check == "verification"
    several = any(len(point.targets) > 1 for point in sweep.points)

    def value(k: int) -> Callable[[_Place], float]:
        return lambda row: row.point.values[k]

    def of_target(name: str) -> Callable[[_Place], Any]:
        return lambda row: None if row.target is None else getattr(row.target, name)

    def of_measure(k: int) -> Callable[[_Place], float | None]:
        return lambda row: row.point.measures[k].p95 if row.point.measures else None

    def end(k: int) -> Callable[[_Place], float | None]:
        return lambda row: None if row.target is None else row.target.p95_interval_mm and row.target.p95_interval_mm[k]

    ends = (
        Column("P95 from", "mm", "fixed", decimals, brief="from\nmm", of=end(0)),
        Column("P95 to", "mm", "fixed", decimals, brief="to\nmm", of=end(1)),
    )
    columns = (
        Column("Point", on=TERMINAL, of=lambda row: str(row.number)),
        *(
            Column(axis.short, axis.unit, "given", brief=f"{letter}\n{axis.unit}", of=value(k))
            for k, (letter, axis) in enumerate(zip(sweep.letters, sweep.axes, strict=True))
        ),
        Column("Target", on=~TERMINAL, of=of_target("name")),
        Column("P95", "mm", "fixed", decimals, of=of_target("p95_mm")),
        *(ends if checked else ()),
        Column("Mean |e|", "mm", "fixed", decimals, brief="mean\nmm", of=of_target("mean_norm_mm")),
        Column("|bias|", "mm", "fixed", decimals, On.DETAIL | PAPER, of=of_target("bias_norm_mm")),
        Column(
            "P95 as located", "mm", "fixed", decimals, brief="P95 as\nlocated, mm", of=of_target("localisation_p95_mm")
        ),
        *((Column("Worst target", on=TERMINAL, of=of_target("name")),) if several else ()),
        # before what may be many tables
        Column("Verdict", kind="status", of=lambda row: row.point.verdict or "refused"),
        *(
            Column(f"P95 of {each.words}, {each.site}", each.unit, "fixed", 3, of=of_measure(k))
            for k, each in enumerate(next((point.measures for point in sweep.points if point.measures), ()))
        ),
    )
    rows = []
    for number, point in enumerate(sweep.points, 1):
        worst = max(point.targets, key=lambda target: target.p95_mm, default=None)
        rows += [
            fill(columns, _Place(number, point, target), on=EVERYWHERE if target is worst else PAPER)
            for target in point.targets or (None,)
        ]
    return Table("Points", "Every point of the grid", columns, tuple(rows), most=LONG_TABLE)


class _Place(NamedTuple):
    """What a row of a sweep is about."""

    number: int  # of the point, from one
    point: SweepPoint
    target: SweepTarget | None  # None: the point was refused
