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
    """Name of the file."""
    sha256: str
    """SHA-256 of its bytes, hexadecimal."""
    form: Literal["points", "vectors", "norms", "summary"]
    """What it holds: points, error vectors, error norms, or summary statistics."""
    unit: str
    """Unit of the lengths in it."""
    rows: int
    """Rows that were read."""
    notes: tuple[str, ...]
    """What was done to the numbers on the way."""


@dataclass(frozen=True, slots=True)
class BiasCompared:
    """Mean error vector of all trials, mm, in the frame of the error."""

    measured_mm: Vector3
    """Measured mean error vector, in the frame of the error, mm."""
    interval_mm: Intervals3
    """Confidence interval of each component by itself, mm."""
    interval_of: Literal["this installation", "installations of this kind"]
    """What the interval is of: this installation's mean, or that of installations of this kind."""
    predicted_mm: Vector3
    """Predicted mean error vector, mm."""
    predicted_range_mm: Intervals3
    """Where the mean of 95 % of such benches would be, each component by itself, mm."""


@dataclass(frozen=True, slots=True)
class NormCompared:
    """Mean error norm of all trials, mm."""

    measured_mm: float
    """Measured mean of the error's norm, mm."""
    interval_mm: Interval | None
    """Confidence interval of it, of this installation or of installations, mm; null for summary statistics without n.
    """
    predicted_mm: float
    """Predicted mean, mm."""
    predicted_range_mm: Interval
    """Where the mean of 95 % of such benches would be, mm."""


@dataclass(frozen=True, slots=True)
class SpreadCompared:
    """Standard deviation from trial to trial, within installations, or between their means."""

    of: Literal["vectors", "norms"]
    """vectors: root of the trace of the covariance; norms: standard deviation of the norms."""
    measured_mm: float
    """Measured spread, mm."""
    predicted_mm: float
    """Predicted spread, mm."""
    ratio: float
    """Measured over predicted."""
    interval: Interval | None
    """Confidence interval of the ratio, as if the law had the predicted shape; null without n."""


@dataclass(frozen=True, slots=True)
class TailShape:
    """How far the P95 of the error norm stands above its mean, of summary statistics; no test, as n is not enough."""

    p95_over_mean: float
    """Measured P95 of the error's norm over its mean."""
    standard_deviations: float | None
    """Measured P95 less the mean, over the standard deviation; a normal law has 1.645. Null: nothing varies."""
    predicted_p95_over_mean: float
    """The first ratio, median of simulated benches."""
    predicted_standard_deviations: float | None
    """The second ratio, median of simulated benches; null: nothing varies from trial to trial."""


@dataclass(frozen=True, slots=True)
class ComparisonTest:
    """One test of one level at one target."""

    test: TestName
    """What is tested."""
    statistic: float
    """The test's statistic."""
    sides: Literal["upper", "both"]
    """Whether large values alone count, or small ones too."""
    p_value: float
    """How often a bench as predicted would be as far off, 0 to 1."""
    p_adjusted: float
    """The same for all tests of the file together (Holm)."""
    differs: bool
    """Whether the adjusted one is below one less the confidence."""
    says: str
    """What the test says, in a sentence."""


@dataclass(frozen=True, slots=True)
class QuantilePoint:
    """One ordered error norm against the same place in simulated benches."""

    probability: float
    """Place in the ordered error norms, 0 to 1."""
    measured_mm: float
    """Measured norm there, mm."""
    predicted_mm: float
    """Median over simulated benches, mm."""
    envelope_mm: Interval
    """Where 95 % of benches are, at this place alone, mm."""
    outside: bool
    """Whether the measured norm is outside of it."""


@dataclass(frozen=True, slots=True)
class LevelCompared:
    """One level at one target."""

    level: str
    """Name of the level in the file."""
    target: str
    """Name of the target."""
    trials: int | None
    """Trials; null for summary statistics without n."""
    installations: int
    """Installations that the trials belong to."""
    deliberate_deg_mm: tuple[float, float, float, float, float, float] | None
    """Installation error that was set on purpose: rx, ry, rz in deg and tx, ty, tz in mm; null where none was stated.
    """
    benches: int
    """Simulated benches; 0 when nothing could be tested."""
    bias: BiasCompared | None
    """Mean error vectors; null for norms and summaries."""
    norm: NormCompared
    """Mean norms."""
    spread: SpreadCompared | None
    """Spread from trial to trial within installations; null where nothing can be said of it."""
    spread_between: SpreadCompared | None
    """Spread of the means of two or more installations; null for one."""
    tests: tuple[ComparisonTest, ...]
    """The tests."""
    quantiles: tuple[QuantilePoint, ...]
    """Ordered norms against simulated benches."""
    ratio_to_reprojection_mm_per_px: float | None
    """Mean norm over the reprojection error that the file states, mm per px; null where it states none."""
    not_tested: str
    """Why nothing was tested; empty where it was."""
    tail_shape: TailShape | None = None
    """How far P95 stands above the mean, of summary statistics that state a P95; otherwise null."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """How large one contributor alone would have to be for the measurements to be plausible."""

    kind: Literal["factor", "value"]
    """factor: on the declared tolerance or noise of a contributor; value: fixed, of one component."""
    target: str
    """Name of the target."""
    contributor: str
    """Source of error."""
    component: str
    """Its component."""
    unit: str
    """Unit of the values: deg or mm; empty for a factor."""
    declared: float | None
    """Declared half-width, in `unit`; 1 for a factor; null where none is declared."""
    most_plausible: float | None
    """The most plausible factor or value, in `unit`; null: none explains the difference."""
    intervals: tuple[Interval, ...]
    """95 % intervals of it, in `unit`; empty when none does. The last end may be the end of the search."""
    search_end: float
    """Largest factor or value that was tried, in `unit`."""
    explains: str
    """Which tests it is held against."""


@dataclass(frozen=True, slots=True)
class StudyComparison:
    """Bench measurements against the prediction of a design."""

    schema: Literal["tailstack/study-comparison/1"]
    """Name and version of this record's schema."""
    error: Literal["tcp", "localisation"]
    """Error that was measured: tcp (at the tool) or localisation (of the target)."""
    frame: str
    """Frame of vectors: con or tcp."""
    file: MeasuredFile
    """The measurements."""
    seed: int
    """Seed of the simulated benches."""
    confidence: float
    """Confidence of intervals and of all tests together, 0 to 1."""
    instrument_sd_mm: float
    """Standard deviation of the instrument per coordinate, which is added to the prediction, mm."""
    levels: tuple[LevelCompared, ...]
    """Every level at every target."""
    explanations: tuple[Explanation, ...]
    """How large one contributor alone would have to be for the measurements to be plausible."""
    verdict: Literal["agrees", "differs", "not testable"]
    """What all tests together say."""
    conclusions: tuple[str, ...]
    """What can be said of the comparison."""
    findings: tuple[Finding, ...]
    """Remarks about design and measurements."""
    validity: Validity
    """How far the linearisation can be trusted."""
    provenance: Provenance
    """Which design, by which version, under which model, and what is not included."""
