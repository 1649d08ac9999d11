"""The record of a sweep: one row for every point of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .results import Interval, Provenance


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """A number of the design that was varied."""

    pointer: str  # RFC 6901, into the design document; a step * stands for every element
    unit: str  # of the values: deg, mm, px, N or empty
    base: float | None  # what the design as it stands has there; None where a pointer with * leads to several values
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SweepTarget:
    """What was found at one target of one point: the TCP error."""

    name: str
    p95_mm: float
    p95_interval_mm: Interval | None  # of a Monte Carlo check; a score has none
    mean_norm_mm: float
    bias_norm_mm: float
    localisation_p95_mm: float


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One point of the grid."""

    values: tuple[float, ...]  # in the order of the axes
    status: Literal["ok", "refused"]
    reason: str | None  # of a refusal
    targets: tuple[SweepTarget, ...]  # none where it was refused
    verdict: Literal["pass", "fail", "inconclusive", "no requirement"] | None


@dataclass(frozen=True, slots=True)
class Sweep:
    """A grid of designs: every combination of the axes' values, the last axis running fastest."""

    schema: Literal["tailstack/sweep/1"]
    axes: tuple[SweepAxis, ...]
    check: Literal["score", "verification"]
    seed: int | None  # of every point's check, so that points differ by their designs alone; None for scores
    trials: int | None  # asked for at every point; None: a score, or as many as the precision takes
    max_trials: int | None  # at every point at most so many; None: a score, or trials were asked for
    points: tuple[SweepPoint, ...]
    provenance: Provenance  # of the design as it stands
