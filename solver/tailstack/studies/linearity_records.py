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

    noise_px: float
    """Noise of every image coordinate, fiducials and targets, px."""
    rotation_deg: float
    """Standard deviation of each random rotation of the structure's mount, deg."""
    spread: float
    """Factor on the layout about its centroid."""
    fiducials: int
    """Number of fiducials."""
    status: Literal["ok", "refused"]
    """refused: this point could not be computed."""
    reason: str | None
    """Why it was refused; otherwise null."""
    nu: float | None
    """Validity number; null where it was refused."""
    promise: str | None
    """What the validity statement says: good to 1 % ...; null where it was refused."""
    promised_percent: float | None
    """Relative error of P95 that it promises, %; null where it says that first order is not valid."""
    first_order_p95_mm: float | None
    """First-order P95, mm; null where it was refused."""
    second_order_p95_mm: float | None
    """Second-order P95, mm; null where there is none."""
    second_order_reason: str | None
    """Why there is none; otherwise null."""
    monte_carlo_p95_mm: float | None
    """Sampled P95, mm; null where it was refused."""
    ratio: float | None
    """First order over Monte Carlo; null where it was refused."""
    ratio_interval: Interval | None
    """Confidence interval of that ratio; null where it was refused."""
    second_order_ratio: float | None
    """Second order over Monte Carlo; null where there is none."""
    within: Within | None
    """How far first order is from Monte Carlo, by the ratio; null where it was refused."""
    sure: bool | None
    """Whether the whole interval says the same; null where it was refused."""
    trials: int | None
    """Trials drawn: an eighth of them where first order is plainly beyond all levels; null where it was refused."""
    errs: Literal["optimistic", "pessimistic", "none seen"] | None
    """On which side first order errs, by the whole interval; null where it was refused."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """How the validity statement did on this grid, one line for each thing it may say."""

    promise: str
    """What the validity statement says."""
    points: int
    """Points at which it says so."""
    kept: int
    """Points within what it promises, with the whole interval; of not valid: beyond 20 %."""
    broken: int
    """Points beyond what it promises, with the whole interval; of not valid: none."""
    open: int
    """Points whose interval reaches across the limit."""
    lowest_ratio: float
    """Smallest ratio of first order to Monte Carlo."""
    highest_ratio: float
    """Largest ratio of first order to Monte Carlo."""


@dataclass(frozen=True, slots=True)
class StudyLinearity:
    """Where first order is good, and where it is optimistic."""

    schema: Literal["tailstack/study-linearity/1"]
    """Name and version of this record's schema."""
    target: str
    """Name of the target."""
    error: Literal["tcp", "localisation"]
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    seed: int
    """Seed of the trials."""
    trials: int
    """Trials of each point, at most."""
    confidence: float
    """Confidence of each interval by itself, 0 to 1."""
    interval_method: str
    """How intervals are made, in words."""
    noises_px: tuple[float, ...]
    """Noises of the grid, px."""
    rotations_deg: tuple[float, ...]
    """Standard deviations of the rotations of the grid, deg."""
    spreads: tuple[float, ...]
    """Factors on the layout of the grid."""
    counts: tuple[int, ...]
    """Numbers of fiducials of the grid."""
    points: tuple[LinearityPoint, ...]
    """Every combination: count, spread, noise, rotation; the last runs fastest."""
    calibration: tuple[Calibration, ...]
    """How the validity statement did, one entry for each thing that it may say."""
    sentences: tuple[str, ...]
    """What can be said of the grid."""
    varied: str
    """What was changed in the design, in words."""
    provenance: Provenance
    """Which design, by which version, under which model, and what is not included."""
