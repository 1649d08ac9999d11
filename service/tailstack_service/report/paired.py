"""The difference of two quantiles that were drawn with the same random numbers, with an interval.

Sectioning: the trials are cut into sections, each gives its own difference, and their spread about the difference of
the whole gives the interval (Student's t).  It assumes that sections are large enough for their quantiles to be about
normal and nothing about how the two samples depend on each other, so that what they share may cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from scipy.special import stdtrit

from tailstack.arrays import Array

SECTIONS = 32
FEWEST = 64 * SECTIONS  # trials: below, the P95 of a section hangs on three of them


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Second minus first, in the unit of the samples."""

    first: float
    second: float
    difference: float
    interval: tuple[float, float]


def paired_difference(first: Array, second: Array, quantile: float, confidence: float) -> PairedDifference:
    """The difference of the ``quantile`` of two samples (n,) in which trial k of both has the same random numbers.

    Raises ValueError for samples of different sizes, or fewer than FEWEST trials.
    """
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(f"paired samples have one length; got {first.shape} and {second.shape}")
    if len(first) < FEWEST:
        raise ValueError(f"a paired difference takes at least {FEWEST} trials; got {len(first)}")
    each = len(first) // SECTIONS
    a, b = _quantile(first[None], quantile)[0], _quantile(second[None], quantile)[0]
    parts = [_quantile(sample[: each * SECTIONS].reshape(SECTIONS, each), quantile) for sample in (first, second)]
    apart = parts[1] - parts[0] - (b - a)
    error = sqrt(float((apart**2).sum()) / (SECTIONS - 1) / SECTIONS)
    reach = float(stdtrit(SECTIONS - 1, (1 + confidence) / 2)) * error
    return PairedDifference(float(a), float(b), float(b - a), (float(b - a - reach), float(b - a + reach)))


def _quantile(samples: Array, quantile: float) -> Array:
    """(m,) of (m, n): the order statistic that the check takes, too."""
    rank = ceil(quantile * samples.shape[1]) - 1
    return np.asarray(np.partition(samples, rank, axis=1)[:, rank])
