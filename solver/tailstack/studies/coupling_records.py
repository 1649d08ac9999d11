"""The record of a study of coupling: installation error and noise together against the parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..results import Interval, Provenance, Validity

SECTIONS = 32  # of the trials, for intervals
LEAST_TRIALS = SECTIONS * 256  # a section's own P95 then has a dozen trials beyond it

Seen = Literal["more", "less", "none seen"]


@dataclass(frozen=True, slots=True)
class Ratio:
    """A ratio of two sampled numbers, from the same trials."""

    value: float
    """The ratio."""
    interval: Interval
    """Its confidence interval."""
    first_order: float | None
    """The same ratio to first order; null where it is 1 by definition."""


@dataclass(frozen=True, slots=True)
class CouplingCase:
    """One installation error, in one reading, at one target.  All P95 are of the error norm, mm."""

    reading: Literal["physical", "eq18"]
    """Reading of the installation error."""
    installation: str
    """as designed, or the level in words."""
    rotation_deg: float | None
    """Of a level: about each axis, deg; null as designed."""
    translation_mm: float | None
    """Of a level: along (1, 1, 1), mm; null as designed."""
    target: str
    """Name of the target."""
    p95_together_mm: float
    """P95 of installation error and noise together, mm."""
    p95_installation_mm: float
    """P95 without noise, mm."""
    p95_noise_mm: float
    """P95 of the noise at the nominal geometry, mm."""
    p95_vector_sum_mm: float
    """P95 of the error without noise plus the noise at the nominal geometry, trial by trial, mm."""
    p95_first_order_mm: float
    """P95 of the first-order law, linearised at the biased geometry, mm."""
    nu: float
    """Validity number of depths and crossing, the larger of both geometries'; beyond 0.2 the noise has no standard
    deviation.
    """
    largest_share: float
    """Largest share of one trial in the sum of squares of the noise, the larger of both geometries'."""
    noise_rms_biased_mm: float | None
    """Root mean square of what image noise adds to the localisation error, installed, mm; null where there is no
    standard deviation.
    """
    noise_rms_nominal_mm: float | None
    """The same at the nominal geometry, mm; null where there is no standard deviation."""
    gain: Ratio | None
    """Ratio of the two; null where there is no standard deviation."""
    against_quadrature: Ratio
    """P95 together over the root of the sum of squares of the parts."""
    against_sum: Ratio
    """P95 together over the sum of the parts."""
    against_vector_sum: Ratio
    """Together over the vector sum: of the means of the norms between their 94 % and 96 % quantiles."""
    against_first_order: Ratio
    """P95 together over that of the first-order law."""
    coupling: Seen
    """What the interval of `against_vector_sum` says."""
    sentence: str
    """The case as a sentence."""


@dataclass(frozen=True, slots=True)
class StudyCoupling:
    """Is the tail of installation error and noise together more than the parts?"""

    schema: Literal["tailstack/study-coupling/1"]
    """Name and version of this record's schema."""
    error: Literal["tcp", "localisation"]
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    seed: int
    """Seed of the trials."""
    trials: int
    """Trials of each case, with the same deviates in all of them."""
    confidence: float
    """Confidence of each interval by itself, 0 to 1."""
    interval_method: str
    """How intervals are made, in words."""
    installation: str
    """Contributors that count as installation error."""
    noise: str
    """Contributors that count as noise."""
    cases: tuple[CouplingCase, ...]
    """Every installation error in every reading at every target."""
    conclusions: tuple[str, ...]
    """What can be said of the cases."""
    validity: Validity
    """How far the linearisation can be trusted."""
    provenance: Provenance
    """Which design, by which version, under which model, and what is not included."""
