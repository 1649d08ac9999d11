"""The record of a sweep: one row for every point of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from . import Interval, Provenance


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
class Sweep:
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
