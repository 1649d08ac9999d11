"""What a plain run says about the tail: quantile, CVaR, exceedance, each with its uncertainty.

Nothing here assumes a law.  If a run has not kept enough of its tail for the question, it is repeated
from its seed with more kept; the answer is never taken from a shorter tail.

*Repeated looks.*  Of n trials, B ~ Binomial(n, q) lie at or below the quantile x_q, and the order statistics of ranks
l and u enclose it exactly when ``l <= B < u``: whether an interval of ranks misses depends on no law.  B at the looks
is a walk with independent binomial increments, so the probability that it *ever* leaves its ranks is a sum that can be
carried out (repeated confidence intervals: Jennison and Turnbull 1984, here for a quantile).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import ceil, fsum, inf, log, sqrt
from statistics import NormalDist

import numpy as np
from scipy.special import bdtr, betaincinv, gammaln, ndtri

from ..errors import IllPosedError, OutOfRangeError, Problem
from ..geometry.arrays import Array
from .simulate import ErrorSample, Samples, deepen
from .tails import sum_exactly, to_float

SPREAD = 10.0  # standard deviations of a binomial law that are kept: 1e-23 is left out
Interval = tuple[float, float]


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
        return (high - low) / (2 * self.value_mm) if 0 < self.value_mm < inf else inf


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


def _refuse_unless_probability(name: str, value: float) -> None:
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
    _refuse_unless_probability("quantile", quantile)
    _refuse_unless_probability("confidence", confidence)
    alpha = 1 - confidence
    low = _binomial_quantile(alpha / 2, trials, quantile)
    high = _binomial_quantile(1 - alpha / 2, trials, quantile) + 1
    return (low if low >= 1 else None, high if high <= trials else None)


def with_ranks(samples: Samples, target: str | int, error: str, *ranks: int | None) -> ErrorSample:
    """The sample, with these of its norms (1-based, from the smallest) in the kept tail."""
    sample = samples.of(target, error)
    wanted = [rank for rank in ranks if rank is not None]
    if all(sample.place_of(rank) is not None for rank in wanted):
        return sample
    return deepen(samples, sample.trials - min(wanted) + 1).of(target, error)


def order_statistic(sample: ErrorSample, rank: int) -> float:
    place = sample.place_of(rank)
    assert place is not None  # with_ranks saw to it
    return float(sample.tail[place])


def between_ranks(
    samples: Samples, target: str | int, error: str, quantile: float, low: int | None, high: int | None
) -> tuple[float, tuple[float, float]]:
    """Quantile of the error norm, mm, by order statistics, and those of two ranks (1-based) about it.

    A rank of None has no order statistic: the end is then zero or infinite.  Raises IllPosedError where shots without
    an answer leave the quantile without a bound.
    """
    middle = ceil(samples.trials * quantile)
    sample = with_ranks(samples, target, error, low, middle, high)
    ends = (
        0.0 if low is None else order_statistic(sample, low),
        inf if high is None else order_statistic(sample, high),
    )
    if ends[0] == inf:
        raise no_bound(samples.unanswered, samples.trials, f"that {100 * quantile:g} % of shots keep")
    return order_statistic(sample, middle), ends


def no_bound(unanswered: int, trials: int, what: str) -> IllPosedError:
    """Why there is no bound of a kind."""
    detail = (
        f"in {unanswered} of {trials} shots ({100 * unanswered / trials:.2g} %) so many fiducials are missed that what "
        f"is left has no answer: there is no bound {what}"
    )
    hint = "use more fiducials, or an estimator with fewer unknowns (model.estimator: pose)"
    return IllPosedError(Problem("/fiducials/loss_probability", "no-bound", detail, hint))


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
    of x_q, so the spread of its summands is its error.  Sums are exact (fsum): no order of summation; of a long run the
    differences to x_q are too, which up to 2 x_q they always are.  Shots without an answer are beyond x_q and left out
    of the mean, which is infinite with them.
    """
    _refuse_unless_probability("quantile", quantile)
    n = samples.trials
    rank = ceil(n * quantile)
    sample = with_ranks(samples, target, error, rank)
    base = order_statistic(sample, rank)
    share = 1 - quantile - samples.unanswered / n
    count = n - rank - samples.unanswered
    if count <= 0 or share <= 0:
        return CvarEstimate(quantile, base, 0.0)
    total, squares = _sum_beyond(sample, rank, base, count)
    mean = total / n
    variance = squares / n - mean**2
    return CvarEstimate(quantile, base + mean / share, sqrt(max(variance, 0.0) / n) / share)


def _sum_beyond(sample: ErrorSample, rank: int, base: float, count: int) -> tuple[float, float]:
    """Sums of the differences to ``base``, mm, and of their squares, mm^2, of the ``count`` norms beyond a rank."""
    place = sample.place_of(rank)
    assert place is not None
    beyond = sample.tail[place + 1 : len(sample.tail) - sample.unanswered]
    if sample.gaps is None:
        return fsum(beyond - base), fsum((beyond - base) ** 2)
    above = sample.gaps_above(base)
    norms = sum_exactly(beyond) + sum(gap.total for gap in above)
    squares = sum_exactly(beyond * beyond) + sum(gap.squares for gap in above)
    each = np.array([base])
    first = to_float(norms - count * sum_exactly(each))
    return first, to_float(squares - count * sum_exactly(each * each)) - 2 * base * first


def exceedance_estimate(
    samples: Samples, target: str | int, error: str, limit_mm: float, confidence: float = 0.95
) -> ExceedanceEstimate:
    """Fraction of trials above the limit, with the exact (Clopper-Pearson) interval."""
    _refuse_unless_probability("confidence", confidence)
    n = samples.trials
    sample = samples.of(target, error)
    if sample.above is not None and sample.above[0] == limit_mm:
        count = sample.above[1]
    else:
        gaps = sample.gaps or ()
        if (len(sample.tail) < n and limit_mm < sample.tail[0]) or any(gap.low < limit_mm < gap.high for gap in gaps):
            sample = deepen(samples, n).of(target, error)
        count = len(sample.tail) - int(np.searchsorted(sample.tail, limit_mm, side="right"))
        count += sum(gap.count for gap in sample.gaps_above(limit_mm))
    alpha = 1 - confidence
    low = float(betaincinv(count, n - count + 1, alpha / 2)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, n - count, 1 - alpha / 2)) if count < n else 1.0
    return ExceedanceEstimate(limit_mm, count, count / n, (low, high), confidence)


@dataclass(frozen=True, slots=True)
class Ranks:
    """Order statistics (1-based) that enclose a quantile; None where there is no such order statistic yet."""

    low: int | None
    high: int | None


@dataclass(frozen=True, slots=True)
class RepeatedInterval:
    """A quantile and the interval that holds together with those of all the other looks."""

    value_mm: float
    interval_mm: Interval  # an end may be infinite (above) or zero (below)


@lru_cache(maxsize=64)
def repeated_ranks(looks: tuple[int, ...], quantile: float, confidence: float) -> tuple[Ranks, ...]:
    """Ranks for each look whose intervals hold the quantile at *all* looks with at least this confidence.

    Each side is spent by itself, ``(1 - confidence) / 2`` in equal parts over the looks; what a look cannot spend,
    because counts are whole, is left to the next.  Raises OutOfRangeError for numbers outside (0, 1) and looks that
    do not rise.
    """
    if not (0 < quantile < 1 and 0 < confidence < 1):
        detail = f"quantile and confidence lie strictly between 0 and 1, got {quantile} and {confidence}"
        raise OutOfRangeError(Problem("", "quantile", detail))
    if not looks or looks[0] < 1 or any(b <= a for a, b in pairwise(looks)):
        raise OutOfRangeError(Problem("", "looks", f"looks are rising counts of trials, got {looks}"))
    beyond = 1 - quantile  # counted are the trials above the quantile: few, so that sums begin at their small end
    few = _boundaries(looks, beyond, (1 - confidence) / 2, lower=True)
    many = _boundaries(looks, beyond, (1 - confidence) / 2, lower=False)
    # ``few`` or less above x_q: X_(n - few) <= x_q.  ``many`` or more: X_(n - many + 1) > x_q.
    return tuple(
        Ranks(None if up is None else n - up + 1, None if down is None else n - down)
        for n, up, down in zip(looks, many, few, strict=True)
    )


def _boundaries(looks: tuple[int, ...], chance: float, error: float, *, lower: bool) -> list[int | None]:
    """For each look the largest count (the smallest, where not ``lower``) at which the walk is absorbed so that the
    probability of having been absorbed stays within the part of ``error`` that is spent by then; None: at none."""
    first, alive = 0, np.ones(1)  # probability of count first + i, not absorbed so far
    spent, before = 0.0, 0
    boundaries: list[int | None] = []
    for k, look in enumerate(looks, 1):
        start, step = _binomial(look - before, chance)
        first, alive = first + start, _convolve(alive, step)
        ordered = alive if lower else alive[::-1]
        sums = np.cumsum(ordered)
        count = int(np.searchsorted(sums, error * k / len(looks) - spent, side="right"))
        if count > 0:
            spent += float(sums[count - 1])
            boundaries.append(first + count - 1 if lower else first + len(alive) - count)
            alive = alive[count:] if lower else alive[:-count]
            first += count if lower else 0
        elif lower and first > 0:
            boundaries.append(first - 1)  # no walk that is alive comes there, so nothing is spent
        else:
            boundaries.append(None)
        before = look
    return boundaries


def _binomial(trials: int, chance: float) -> tuple[int, Array]:
    """(first, p): the probability of ``first + i`` successes, where it is not nothing."""
    spread = SPREAD * sqrt(trials * chance * (1 - chance)) + 50  # 50: a few rare events are a skewed law
    low, high = max(0, int(trials * chance - spread)), min(trials, ceil(trials * chance + spread))
    count = np.arange(low, high + 1, dtype=float)
    logs = gammaln(trials + 1) - gammaln(count + 1) - gammaln(trials - count + 1)
    weights = np.exp(logs + count * np.log(chance) + (trials - count) * np.log1p(-chance))
    return low, weights / weights.sum()


def _convolve(a: Array, b: Array) -> Array:
    size = len(a) + len(b) - 1
    padded = 1 << size.bit_length()
    product = np.fft.irfft(np.fft.rfft(a, padded) * np.fft.rfft(b, padded), padded)[:size]
    return np.maximum(product, 0.0)  # rounding can leave -1e-17


def repeated_interval(
    samples: Samples, target: str | int, error: str, quantile: float, ranks: Ranks
) -> RepeatedInterval:
    """A quantile by its order statistic, with the interval between the ranks of this look."""
    return RepeatedInterval(*between_ranks(samples, target, error, quantile, ranks.low, ranks.high))


def cvar_interval(
    p95_mm: float, cvar_mm: float, worst_mm: float, trials: int, confidence: float, looks: int, unanswered: int = 0
) -> Interval:
    """Interval of the mean of the worst 5 %, mm, from what a check's record holds; Bonferroni over the looks.

    CVaR is P95 + mean(x) / 0.05 with x = (|e| - P95)_+ in [0, worst - P95]; a variable on [0, b] with mean m has a
    variance of at most m (b - m) (Bhatia and Davis 2000), some four times the true one for a Gaussian tail.  The mean
    is taken for normal: of a mean, no interval is free of the law.  Shots without an answer leave it without an end.
    """
    deviate = NormalDist().inv_cdf(1 - (1 - confidence) / (2 * looks))
    mean = 0.05 * (cvar_mm - p95_mm)
    error = deviate * sqrt(max(mean * (worst_mm - p95_mm - mean), 0.0) / trials) / 0.05
    return cvar_mm - error, inf if unanswered else cvar_mm + error
