"""The answer of a Monte Carlo check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .verdicts import Interval, Provenance, Vector3, Verdict


@dataclass(frozen=True, slots=True)
class Exceedance:
    limit_mm: float
    probability: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class MetricEstimate:
    """Sampled result for one error metric at one target."""

    bias_mm: Vector3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    p95_interval_mm: Interval
    cvar95_mm: float
    worst_mm: float
    exceedance: Exceedance | None
    first_order_ratio: float


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """``bias_mm`` ... ``exceedance`` are the TCP error; ``localisation`` is the same before interface 2."""

    name: str
    frame: str
    bias_mm: Vector3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    p95_interval_mm: Interval
    confidence: float
    cvar95_mm: float
    worst_mm: float
    exceedance: Exceedance | None
    flagged_trials: int
    first_order_p95_mm: float
    first_order_ratio: float
    localisation: MetricEstimate


@dataclass(frozen=True, slots=True)
class Reprojection:
    """RMS over fiducials and views of the distance between measured and reprojected images."""

    trials: int
    mean_px: float
    p95_px: float


@dataclass(frozen=True, slots=True)
class Verification:
    """Monte Carlo on the full nonlinear chain."""

    schema: Literal["tailstack/verification/1"]
    seed: int
    trials: int
    method: Literal["plain", "radial"]
    engine: str
    precision_requested: float | None
    max_trials: (
        int | None
    )  # at most so many; null where their number was asked for.  It sets the looks, so the intervals
    precision_reached: float
    stopping: str  # why it stopped, in a sentence
    targets: tuple[TargetEstimate, ...]
    reprojection: Reprojection
    first_order_ratio: float  # first-order P95 over verified P95 at the worst target
    verdict: Verdict
    provenance: Provenance
