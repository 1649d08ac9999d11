"""How far below a limit the exact quantile must be for a check by Monte Carlo to pass most of the time."""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist

from ..verification import UNITS
from .exact_law import Evaluation, error_of_trial
from .problem import QuantileConstraint

# Trials of a check: 2^20 hold P95 within 0.13 %, and every bit of that interval is paid for in tolerance.  Fewer
# for many targets, whose samples are all kept.
MOST_TRIALS, FEWEST_TRIALS, TARGET_TRIALS = 2**20, 2**16, 2**23
MARGIN = 1.5  # half-widths of the check's interval between the aim and the limit


def trials_for(targets: int) -> int:
    """Of a check at so many targets."""
    return min(max(TARGET_TRIALS // targets, FEWEST_TRIALS), MOST_TRIALS)


def aim_of(exact: Evaluation, demand: QuantileConstraint, trials: int) -> float:
    """As a part of the limit, for a check of so many trials.

    If first order is right, the estimate of a quantile scatters by ``sqrt(p (1 - p) / n) / density`` and the upper
    limit lies z times that above it; half as much again lets 5 of 6 checks pass.  Per unit, p is the fraction of
    units, n their number and the density that of the units' own quantiles.
    """
    if exact.density <= 0:
        return 1.0
    requirement = demand.requirement
    p, n = (demand.fraction, UNITS) if demand.is_nested else (requirement.quantile, trials)
    z = NormalDist().inv_cdf((1 + requirement.confidence) / 2)
    if not requirement.row.by_quantile:
        return max(1 - MARGIN * z * error_of_trial(exact, demand) / (sqrt(n) * exact.exact_mm), 0.5)
    return max(1 - MARGIN * z * sqrt(p * (1 - p) / n) / (exact.density * exact.exact_mm), 0.5)
