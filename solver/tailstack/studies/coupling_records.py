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
    interval: Interval
    first_order: float | None  # the same ratio to first order; None where it is 1 by definition


@dataclass(frozen=True, slots=True)
class CouplingCase:
    """One installation error, in one reading, at one target.  All P95 are of the error norm, mm."""

    reading: Literal["physical", "eq18"]
    installation: str  # "as designed", or the level in words
    rotation_deg: float | None  # of a level: about each axis; None as designed
    translation_mm: float | None  # of a level: along (1, 1, 1); None as designed
    target: str
    p95_together_mm: float
    p95_installation_mm: float  # without noise
    p95_noise_mm: float  # at the nominal geometry
    p95_vector_sum_mm: float  # of (error without noise + noise at the nominal geometry), trial by trial
    p95_first_order_mm: float  # of the first-order law, linearised at the biased geometry
    nu: float  # of depths and crossing, the larger of both geometries'; beyond 0.2 the noise has no standard deviation
    largest_share: float  # of one trial in the sum of squares of the noise, the larger of both geometries'
    noise_rms_biased_mm: float | None  # root mean square of what image noise adds to the localisation error, installed
    noise_rms_nominal_mm: float | None  # and at the nominal geometry; None where there is no standard deviation
    gain: Ratio | None  # of the two
    against_quadrature: Ratio  # P95 together over the root of the sum of squares of the parts
    against_sum: Ratio  # over the sum of the parts
    against_vector_sum: Ratio  # of the means of the norms between their 94 % and 96 % quantiles
    against_first_order: Ratio
    coupling: Seen  # what the interval of against_vector_sum says
    sentence: str


@dataclass(frozen=True, slots=True)
class StudyCoupling:
    """Is the tail of installation error and noise together more than the parts?"""

    schema: Literal["tailstack/study-coupling/1"]
    error: Literal["tcp", "localisation"]
    quantile: float
    seed: int
    trials: int  # of each case, the same deviates in all of them
    confidence: float  # of each interval by itself
    interval_method: str
    installation: str  # which contributors are on that side
    noise: str  # and on this one
    cases: tuple[CouplingCase, ...]
    conclusions: tuple[str, ...]
    validity: Validity
    provenance: Provenance
