"""The record of a comparison of bench measurements with the prediction of a design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..results import Finding, Interval, Provenance, Validity, Vector3

TestName = Literal["mean", "spread", "between installations", "tail"]
Intervals3 = tuple[Interval, Interval, Interval]


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    name: str
    sha256: str
    form: Literal["points", "vectors", "norms", "summary"]
    unit: str  # of the lengths in it
    rows: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BiasCompared:
    """Mean error vector of all trials, mm, in the frame of the error."""

    measured_mm: Vector3
    interval_mm: Intervals3  # each component by itself
    interval_of: Literal["this installation", "installations of this kind"]
    predicted_mm: Vector3
    predicted_range_mm: Intervals3  # of the mean of such a bench, 95 % of them


@dataclass(frozen=True, slots=True)
class NormCompared:
    """Mean error norm of all trials, mm."""

    measured_mm: float
    interval_mm: Interval | None  # of this installation's, or of installations'; None for summary statistics without n
    predicted_mm: float
    predicted_range_mm: Interval  # of the mean of such a bench, 95 % of them


@dataclass(frozen=True, slots=True)
class SpreadCompared:
    """Standard deviation from trial to trial, within installations, or between their means."""

    of: Literal["vectors", "norms"]  # vectors: root of the trace of the covariance
    measured_mm: float
    predicted_mm: float
    ratio: float
    interval: Interval | None  # of the ratio, as if the law had the predicted shape; None without n


@dataclass(frozen=True, slots=True)
class TailShape:
    """How far the P95 of the error norm stands above its mean, of summary statistics; no test, as n is not enough."""

    p95_over_mean: float
    standard_deviations: float | None  # (P95 - mean) / standard deviation; a normal law has 1.645
    predicted_p95_over_mean: float  # median of simulated benches, and the next
    predicted_standard_deviations: float | None  # None: nothing varies from trial to trial


@dataclass(frozen=True, slots=True)
class ComparisonTest:
    """One test of one level at one target."""

    test: TestName
    statistic: float
    sides: Literal["upper", "both"]
    p_value: float
    p_adjusted: float  # for all tests of the file (Holm)
    differs: bool
    says: str


@dataclass(frozen=True, slots=True)
class QuantilePoint:
    """One ordered error norm against the same place in simulated benches."""

    probability: float
    measured_mm: float
    predicted_mm: float  # median over benches
    envelope_mm: Interval  # 95 % of benches, at this place alone
    outside: bool


@dataclass(frozen=True, slots=True)
class LevelCompared:
    """One level at one target."""

    level: str
    target: str
    trials: int | None
    installations: int
    deliberate_deg_mm: tuple[float, float, float, float, float, float] | None  # rx ry rz deg, tx ty tz mm
    benches: int  # simulated ones; 0 when nothing could be tested
    bias: BiasCompared | None  # of vectors
    norm: NormCompared
    spread: SpreadCompared | None
    spread_between: SpreadCompared | None  # of the means of installations, two or more of them
    tests: tuple[ComparisonTest, ...]
    quantiles: tuple[QuantilePoint, ...]
    ratio_to_reprojection_mm_per_px: float | None
    not_tested: str  # why, or ""
    tail_shape: TailShape | None = None  # of summary statistics that state a P95


@dataclass(frozen=True, slots=True)
class Explanation:
    """How large one contributor alone would have to be for the measurements to be plausible."""

    kind: Literal["factor", "value"]  # factor: of its declared tolerance or noise; value: fixed, of one component
    target: str
    contributor: str
    component: str
    unit: str  # "" for a factor
    declared: float | None  # half-width, in the unit; 1 for a factor
    most_plausible: float | None  # None: no value explains the difference
    intervals: tuple[Interval, ...]  # 95 %; empty when none does.  The last end may be the end of the search
    search_end: float
    explains: str  # which tests it is held against


@dataclass(frozen=True, slots=True)
class StudyComparison:
    """Bench measurements against the prediction of a design."""

    schema: Literal["tailstack/study-comparison/1"]
    error: Literal["tcp", "localisation"]
    frame: str
    file: MeasuredFile
    seed: int
    confidence: float
    instrument_sd_mm: float  # per coordinate, added to the prediction
    levels: tuple[LevelCompared, ...]
    explanations: tuple[Explanation, ...]
    verdict: Literal["agrees", "differs", "not testable"]
    conclusions: tuple[str, ...]
    findings: tuple[Finding, ...]
    validity: Validity
    provenance: Provenance
