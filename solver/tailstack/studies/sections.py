"""Estimates from simulated trials with intervals by sectioning (Asmussen and Glynn 2007, III.5a).

The trials are cut into sections, each gives an estimate of its own, and their spread about the estimate of the whole
gives the interval (Student's t).  It assumes that sections are large enough for their estimates to be about normal, and
nothing about how several samples of the same trials depend on one another, so that what they share may cancel.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ..geometry.arrays import Array
from ..results import Interval

SECTIONS = 32


class SectionEstimate(NamedTuple):
    """An estimate from all trials, and its interval."""

    value: float
    interval: Interval


def estimate_by_sections(estimate: Callable[[slice], float], trials: int, confidence: float) -> SectionEstimate:
    """``estimate(part)`` gives the estimate from the trials of a slice; ``trials`` is a multiple of ``SECTIONS``."""
    size = trials // SECTIONS
    whole = estimate(slice(0, trials))
    parts = np.array([estimate(slice(k * size, (k + 1) * size)) for k in range(SECTIONS)])
    variance = float(((parts - whole) ** 2).sum()) / (SECTIONS * (SECTIONS - 1))
    half = float(stdtrit(SECTIONS - 1, (1 + confidence) / 2)) * sqrt(variance)
    return SectionEstimate(whole, (whole - half, whole + half))


def take_quantile(values: Array, p: float) -> float:
    """The order statistic of rank ceil(n p) of values (n,)."""
    rank = ceil(len(values) * p) - 1
    return float(np.partition(values, rank)[rank])
