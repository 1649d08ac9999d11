"""The record of a sweep: one row for every point of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

from .outline import Column, Curve, Curves, Outline, Table, row_of
from .record import Result
from .verdicts import Interval, Provenance

MOST_TARGETS = 6  # with a curve of their own


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


@dataclass(frozen=True, slots=True)
class Sweep(Result):
    """A grid of designs: every combination of the axes' values, the last axis running fastest."""

    schema: Literal["tailstack/sweep/1"]
    """Name and version of this record's schema."""
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
        rows, worst = [], []
        for point in self.points:
            said = {**dict(zip(pointers, point.values, strict=True)), "status": point.status, "verdict": point.verdict}
            own = [
                {**said, "target": found.pop("name"), **found, "reason": point.reason}
                for found in ([row_of(target) for target in point.targets] or [dict(_NOTHING)])
            ]
            rows += own
            worst.append(max(own, key=lambda row: row["p95_mm"] or 0.0))
        computed = sum(point.status == "ok" for point in self.points)
        passing = sum(point.verdict == "pass" for point in self.points)
        shown = (
            *(Column(axis.pointer, axis.pointer) for axis in self.axes),
            Column("target", "target"), Column("p95_mm", "P95, mm", 3), Column("mean_norm_mm", "mean, mm", 3),
            Column("verdict", "verdict"),
        )  # fmt: skip
        refused = len(self.points) - computed
        sentence = f"{len(self.points):,} points, {passing:,} of them pass" + (
            f"; {refused:,} could not be computed, the column reason says why." if refused else "."
        )
        return Outline(
            "Sweep, " + ("estimates" if self.check == "score" else "Monte Carlo checks"),
            self.provenance.design_name,
            "",
            sentence,
            (Table("points", "Points, each at its worst target", tuple(rows), shown, tuple(worst)),),
            self._curves(),
        )

    def _curves(self) -> Curves:
        """P95 over the last axis of several values: a curve for each target, or for each value of the other axes."""
        sizes = [len(axis.values) for axis in self.axes]
        across = max((k for k, size in enumerate(sizes) if size > 1), default=0)
        others = [k for k, size in enumerate(sizes) if k != across and size > 1]
        index = {point.values: point for point in self.points}
        names = list(dict.fromkeys(target.name for point in self.points for target in point.targets))

        def read(name: str, fixed: dict[int, float], target: str | None) -> Curve:
            found: list[SweepTarget | None] = []
            for value in self.axes[across].values:
                held = {**fixed, across: value}
                point = index[tuple(held.get(k, axis.values[0]) for k, axis in enumerate(self.axes))]
                among = [entry for entry in point.targets if target in (None, entry.name)]
                found.append(max(among, key=lambda entry: entry.p95_mm, default=None))
            return Curve(
                name,
                tuple(None if entry is None else entry.p95_mm for entry in found),
                tuple(None if entry is None else entry.p95_interval_mm for entry in found),
            )

        if others:
            curves = []
            for values in product(*(self.axes[k].values for k in others)):
                words = [f"{_field(self.axes[k])} {value:g}" for k, value in zip(others, values, strict=True)]
                curves.append(read(", ".join(words), dict(zip(others, values, strict=True)), None))
            title = "P95 of the worst target"
        elif len(names) > MOST_TARGETS:
            curves, title = [read("", {}, None)], f"P95 at the worst of {len(names)} targets"
        else:
            curves = [read(name, {}, name) for name in names]
            title = "P95 at " + (f"target {names[0]}" if len(names) == 1 else "each target")
        axis = self.axes[across]
        return Curves(title, axis.pointer, "P95, mm", axis.values, tuple(curves))


def _field(axis: SweepAxis) -> str:
    return axis.pointer.rpartition("/")[2]


_NOTHING = dict.fromkeys(row_of(SweepTarget("", 0.0, None, 0.0, 0.0, 0.0)))  # of a point that was refused
