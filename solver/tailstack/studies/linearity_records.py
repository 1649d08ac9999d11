"""The record of ``study linearity``: first order and second order beside Monte Carlo over a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..results import Interval, Provenance

Within = Literal["1 %", "5 %", "20 %", "beyond"]
LEVELS: tuple[tuple[Within, float], ...] = (("1 %", 0.01), ("5 %", 0.05), ("20 %", 0.2))
SECTIONS = 16  # of the trials, for intervals
LEAST_TRIALS = SECTIONS * 8 * 64  # a section of the first look then has three trials beyond its own P95


@dataclass(frozen=True, slots=True)
class LinearityPoint:
    """One point of the grid."""

    noise_px: float  # of every image coordinate, fiducials and targets
    rotation_deg: float  # standard deviation of each random rotation of the structure's mount
    spread: float  # factor on the layout about its centroid
    fiducials: int
    status: Literal["ok", "refused"]
    reason: str | None
    nu: float | None
    promise: str | None  # what the validity statement says: "good to 1 %" ...
    promised_percent: float | None  # None where it says that first order is not valid
    first_order_p95_mm: float | None
    second_order_p95_mm: float | None
    second_order_reason: str | None  # why there is none
    monte_carlo_p95_mm: float | None
    ratio: float | None  # first order over Monte Carlo
    ratio_interval: Interval | None
    second_order_ratio: float | None
    within: Within | None  # of Monte Carlo, by the ratio
    sure: bool | None  # the whole interval says the same
    trials: int | None  # an eighth of them where first order is plainly beyond all levels
    errs: Literal["optimistic", "pessimistic", "none seen"] | None  # what the whole interval says


@dataclass(frozen=True, slots=True)
class Calibration:
    """How the validity statement did on this grid, one line for each thing it may say."""

    promise: str
    points: int
    kept: int  # within what it promises, with the whole interval; of "not valid": beyond 20 %
    broken: int  # beyond what it promises, with the whole interval; of "not valid": none
    open: int  # the interval reaches across the limit
    lowest_ratio: float
    highest_ratio: float


@dataclass(frozen=True, slots=True)
class StudyLinearity:
    """Where first order is good, and where it is optimistic."""

    schema: Literal["tailstack/study-linearity/1"]
    target: str
    error: Literal["tcp", "localisation"]
    quantile: float
    seed: int
    trials: int  # of each point, at most
    confidence: float  # of each interval by itself
    interval_method: str
    noises_px: tuple[float, ...]
    rotations_deg: tuple[float, ...]
    spreads: tuple[float, ...]
    counts: tuple[int, ...]
    points: tuple[LinearityPoint, ...]  # count, spread, noise, rotation; the last runs fastest
    calibration: tuple[Calibration, ...]
    sentences: tuple[str, ...]
    varied: str  # what was changed in the design, in words
    provenance: Provenance
