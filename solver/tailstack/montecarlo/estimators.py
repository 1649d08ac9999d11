"""What a plain run says about the tail: quantile, CVaR, exceedance, each with its uncertainty; when to stop.

Nothing here assumes a law.  If a run has not kept enough of its tail for the question, it is repeated
from its seed with more kept; the answer is never taken from a shorter tail.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, fsum, inf, log, sqrt

import numpy as np
from scipy.special import bdtr, betaincinv, ndtri

from ..arrays import Array
from ..errors import OutOfRangeError, Problem
from ..system import System
from .plan import ChainPlan, compile_plan
from .simulate import ErrorSample, Progress, Samples, ShardSampler, deepen, simulate

FIRST_LOOK = 2**14
TYPICAL = 3.3  # trials times squared relative half-width: what P95 of most errors takes
SURE = 0.64  # of the trials that a look says are needed: its half-width is itself known to ten per cent


@dataclass(frozen=True, slots=True)
class QuantileEstimate:
    quantile: float
    value_mm: float
    interval_mm: tuple[float, float]
    confidence: float  # of the interval, two-sided; never less than stated
    trials: int

    @property
    def relative_half_width(self) -> float:
        low, high = self.interval_mm
        return (high - low) / (2 * self.value_mm) if self.value_mm > 0 else float("inf")


@dataclass(frozen=True, slots=True)
class CvarEstimate:
    """Mean of the norm beyond its quantile."""

    quantile: float
    value_mm: float
    standard_error_mm: float


@dataclass(frozen=True, slots=True)
class ExceedanceEstimate:
    limit_mm: float
    count: int
    probability: float
    interval: tuple[float, float]
    confidence: float


def _probability_iv(name: str, value: float) -> None:
    if not 0 < value < 1:
        raise OutOfRangeError(Problem("", name, f"{name} must lie strictly between 0 and 1, got {value}"))


def _binomial_quantile(probability: float, trials: int, success: float) -> int:
    """Smallest k with P(B <= k) >= probability, B ~ Binomial(trials, success).

    A walk from the normal approximation: the tables of scipy.stats would cost 60 MB to import.
    """
    spread = sqrt(trials * success * (1 - success))
    k = min(max(round(trials * success + float(ndtri(probability)) * spread), 0), trials)
    while k > 0 and bdtr(k - 1, trials, success) >= probability:
        k -= 1
    while k < trials and bdtr(k, trials, success) < probability:
        k += 1
    return k


def interval_ranks(trials: int, quantile: float, confidence: float) -> tuple[int, int]:
    """Ranks (1-based) of the order statistics that enclose the quantile with at least this confidence.

    With B ~ Binomial(n, q) trials below the quantile, ``P(X_(l) <= x_q < X_(u)) = P(l <= B < u)``: l is the
    alpha/2 quantile of B, u one above its 1 - alpha/2 quantile.  No law is assumed.
    Raises OutOfRangeError when ``trials`` are too few for such an interval to exist.
    """
    low, high = enclosing_ranks(trials, quantile, confidence)
    if low is None or high is None:
        needed = ceil(log((1 - confidence) / 2) / log(max(quantile, 1 - quantile)))
        detail = f"{trials} trials have no {confidence:g} interval of the {quantile:g} quantile"
        raise OutOfRangeError(Problem("", "too-few-trials", detail, f"at least {needed} trials are needed"))
    return low, high


def enclosing_ranks(trials: int, quantile: float, confidence: float) -> tuple[int | None, int | None]:
    """The ranks of :func:`interval_ranks`; None at an end for which no order statistic is far enough out."""
    _probability_iv("quantile", quantile)
    _probability_iv("confidence", confidence)
    alpha = 1 - confidence
    low = _binomial_quantile(alpha / 2, trials, quantile)
    high = _binomial_quantile(1 - alpha / 2, trials, quantile) + 1
    return (low if low >= 1 else None, high if high <= trials else None)


def wilks_sample_size(quantile: float, confidence: float, order: int = 1) -> int:
    """Smallest n whose ``order``-th largest value is an upper confidence limit of the quantile (Wilks 1941)."""
    _probability_iv("quantile", quantile)
    _probability_iv("confidence", confidence)
    n = max(order, int(log(1 - confidence) / log(quantile)))
    while bdtr(n - order, n, quantile) < confidence:
        n += 1
    while n > order and bdtr(n - 1 - order, n - 1, quantile) >= confidence:
        n -= 1
    return n


def with_rank(samples: Samples, target: str | int, error: str, rank: int) -> ErrorSample:
    """The sample, with its ``rank``-th smallest norm in the kept tail."""
    sample = samples.of(target, error)
    if rank >= sample.trials - len(sample.tail) + 1:
        return sample
    return deepen(samples, sample.trials - rank + 1).of(target, error)


def order_statistic(sample: ErrorSample, rank: int) -> float:
    return float(sample.tail[len(sample.tail) - 1 - (sample.trials - rank)])


def between_ranks(
    samples: Samples, target: str | int, error: str, quantile: float, low: int | None, high: int | None
) -> tuple[float, tuple[float, float]]:
    """Quantile of the error norm, mm, by order statistics, and those of two ranks (1-based) about it.

    A rank of None has no order statistic: the end is then zero or infinite.
    """
    middle = ceil(samples.trials * quantile)
    sample = with_rank(samples, target, error, middle if low is None else min(low, middle))
    ends = (
        0.0 if low is None else order_statistic(sample, low),
        inf if high is None else order_statistic(sample, high),
    )
    return order_statistic(sample, middle), ends


def quantile_estimate(
    samples: Samples, target: str | int, error: str, quantile: float, confidence: float = 0.95
) -> QuantileEstimate:
    """Quantile of the error norm by order statistics, with its distribution-free interval."""
    low, high = interval_ranks(samples.trials, quantile, confidence)
    value, interval = between_ranks(samples, target, error, quantile, low, high)
    return QuantileEstimate(quantile, value, interval, confidence, samples.trials)


def cvar_estimate(samples: Samples, target: str | int, error: str, quantile: float) -> CvarEstimate:
    """``E[|e| given |e| beyond its quantile]`` with its standard error.

    ``x_q + mean((|e| - x_q)_+) / (1 - q)`` (Rockafellar and Uryasev 2000): first-order insensitive to the error
    of x_q, so the spread of its summands is its error.  Sums are exact (fsum): no order of summation.
    """
    _probability_iv("quantile", quantile)
    n = samples.trials
    rank = ceil(n * quantile)
    sample = with_rank(samples, target, error, rank)
    base = order_statistic(sample, rank)
    excess = sample.tail[len(sample.tail) - (n - rank) :] - base
    mean = fsum(excess) / n
    variance = fsum(excess**2) / n - mean**2
    value = base + mean / (1 - quantile)
    return CvarEstimate(quantile, value, sqrt(max(variance, 0.0) / n) / (1 - quantile))


def exceedance_estimate(
    samples: Samples, target: str | int, error: str, limit_mm: float, confidence: float = 0.95
) -> ExceedanceEstimate:
    """Fraction of trials above the limit, with the exact (Clopper-Pearson) interval."""
    _probability_iv("confidence", confidence)
    n = samples.trials
    sample = samples.of(target, error)
    if sample.above is not None and sample.above[0] == limit_mm:
        count = sample.above[1]
    else:
        if len(sample.tail) < n and limit_mm < sample.tail[0]:
            sample = deepen(samples, n).of(target, error)
        count = len(sample.tail) - int(np.searchsorted(sample.tail, limit_mm, side="right"))
    alpha = 1 - confidence
    low = float(betaincinv(count, n - count + 1, alpha / 2)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, n - count, 1 - alpha / 2)) if count < n else 1.0
    return ExceedanceEstimate(limit_mm, count, count / n, (low, high), confidence)


@dataclass(frozen=True, slots=True)
class Goal:
    """One quantile that has to be known to the requested precision."""

    target: str | int
    error: str
    quantile: float


@dataclass(frozen=True, slots=True, eq=False)
class AdaptiveRun:
    samples: Samples
    estimates: tuple[QuantileEstimate, ...]  # one per goal, at the confidence of the whole procedure
    precision_reached: float  # largest relative half-width
    reached: bool
    stopping: str  # why it stopped, in a sentence
    level: float  # confidence of each single look, so that all of them together hold with the stated one


def planned_looks(max_trials: int) -> list[int]:
    """Trial counts at which the precision is looked at: 2^14, doubling, the last one the cap."""
    looks = []
    count = FIRST_LOOK
    while count < max_trials:
        looks.append(count)
        count *= 2
    return [*looks, max_trials]


def simulate_to_precision(
    system: System | ChainPlan,
    *,
    precision: float,
    seed: int,
    goals: Sequence[Goal] | None = None,
    confidence: float = 0.95,
    max_trials: int = 2**24,
    threads: int | None = None,
    batch: int | None = None,
    vertex: Mapping[str, float] | Array | None = None,
    shots_per_unit: int = 1,
    reprojection: bool = False,
    progress: Progress | None = None,
    settled: Callable[[Samples, float], bool] | None = None,
    quantile: float | None = None,
    limits: Sequence[float] | None = None,
    source: ShardSampler | None = None,
) -> AdaptiveRun:
    """Simulate until the relative half-width of every goal's interval is at most ``precision``.

    goals default to P95 of the TCP error at every target.  Looking repeatedly spends confidence: each look
    uses ``1 - (1 - confidence) / looks`` (Bonferroni over the *planned* looks), so that the interval reported at
    the look at which it stops holds with ``confidence``, for each goal.  The looks do not depend on batch or threads.
    ``settled(samples, level)``: what else must hold before it stops, judged with intervals of confidence ``level``.
    quantile: the lowest that will be asked of the samples, where that is below the goals'.  limits, source: see
    ``simulate``.
    """
    if not precision > 0:
        raise OutOfRangeError(Problem("", "precision", f"precision must be positive, got {precision}"))
    _probability_iv("confidence", confidence)
    if isinstance(system, ChainPlan):
        plan = system
    else:
        plan = compile_plan(system, vertex=vertex, shots_per_unit=shots_per_unit)
    if goals is None:
        goals = [Goal(k, "tcp", 0.95) for k in range(len(plan.system.targets))]
    lowest = min(goal.quantile for goal in goals)
    lowest = lowest if quantile is None else min(lowest, quantile)
    looks = planned_looks(max_trials)
    level = 1 - (1 - confidence) / len(looks)
    highest = max(goal.quantile for goal in goals)
    while len(looks) > 1 and highest ** looks[0] > (1 - level) / 2:
        del looks[0]  # so few trials have no interval of that quantile
    samples: Samples | None = None
    needed = TYPICAL / precision**2
    for k, look in enumerate(looks):
        samples = simulate(
            plan,
            trials=look,
            seed=seed,
            quantile=lowest,
            threads=threads,
            batch=batch,
            reprojection=reprojection,
            progress=None if progress is None else (lambda done, _: progress(done, max_trials)),
            extend=samples,
            limits=limits,
            source=source,
            then=tuple(pair for pair in pairwise(looks[k:]) if pair[0] < SURE * needed) if k else (),
            expected=min(int(needed), max_trials),
        )
        found = [quantile_estimate(samples, g.target, g.error, g.quantile, level) for g in goals]
        worst = max(estimate.relative_half_width for estimate in found)
        needed = look * (worst / precision) ** 2  # the half-width falls with the square root of the trials
        if worst <= precision and (settled is None or settled(samples, level)):
            reason = (
                f"every interval is within ±{100 * worst:.2g} % of its quantile, as requested (±{100 * precision:g} %)"
            )
            break
    else:
        reason = f"the cap of {max_trials} trials was reached at ±{100 * worst:.2g} %, " + (
            f"short of the ±{100 * precision:g} % requested" if worst > precision else "with a requirement undecided"
        )
    assert samples is not None
    stopping = (
        f"Stopped after {samples.trials} trials because {reason}; each look used a confidence of {level:.5g}, "
        f"Bonferroni over {len(looks)} planned looks, for {confidence:g} in all."
    )
    estimates = tuple(QuantileEstimate(e.quantile, e.value_mm, e.interval_mm, confidence, e.trials) for e in found)
    return AdaptiveRun(samples, estimates, worst, worst <= precision, stopping, level)
