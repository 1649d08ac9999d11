"""What a plain run says about the tail: quantile, CVaR, exceedance, each with its uncertainty.

Nothing here assumes a law.  If a run has not kept enough of its tail for the question, it is repeated
from its seed with more kept; the answer is never taken from a shorter tail.
"""

from __future__ import annotations

from math import ceil, fsum, inf, log, sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from scipy.special import bdtr, betaincinv, ndtri

from ..errors import IllPosedError, OutOfRangeError, Problem
from ..geometry.arrays import Array
from ..results import Exceedance, Interval
from ..results.digits import RESOLUTION_MM
from .simulate import ErrorSample, Samples, deepen


class QuantileEstimate(NamedTuple):
    value_mm: float
    interval_mm: Interval

    @property
    def relative_half_width(self) -> float:
        """0 where both ends are the same, as of a number on one side that hardly a shot is on."""
        low, high = self.interval_mm
        if low == high < inf:
            return 0.0
        return (high - low) / (2 * max(self.value_mm, RESOLUTION_MM)) if self.value_mm < inf else inf


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
    needed = sample.trials - min(rank for rank in ranks if rank is not None) + 1
    return sample if needed <= len(sample.tail) else deepen(samples, needed).of(target, error)


def order_statistic(sample: ErrorSample, rank: int) -> float:
    return float(sample.tail[len(sample.tail) - 1 - (sample.trials - rank)])


def between_ranks(
    samples: Samples, target: str | int, error: str, quantile: float, low: int | None, high: int | None
) -> QuantileEstimate:
    """Quantile of the error norm, by order statistics, and those of two ranks (1-based) about it.

    A rank of None has no order statistic: the end is then zero or infinite.  Raises IllPosedError where shots without
    an answer leave the quantile without a bound.
    """
    middle = ceil(samples.trials * quantile)
    sample = with_ranks(samples, target, error, low, middle, high)
    least = 0.0 if low is None else order_statistic(sample, low)
    most = inf if high is None else order_statistic(sample, high)
    if least == inf:
        raise no_bound(samples.unanswered, samples.trials, f"that {100 * quantile:g} % of shots keep")
    return QuantileEstimate(order_statistic(sample, middle), (least, most))


def no_bound(unanswered: int, trials: int, what: str) -> IllPosedError:
    """Why there is no bound of a kind."""
    detail = (
        f"in {unanswered} of {trials} shots ({100 * unanswered / trials:.2g} %) so many fiducials are missed that what "
        f"is left has no answer: there is no bound {what}"
    )
    hint = (
        "use more fiducials, or an estimator with fewer unknowns (model.estimator: pose), or require less: a lower "
        "quantile, the largest of fewer errors (max_of_n asks that one error keep a quantile nearer to 1)"
    )
    return IllPosedError(Problem("/fiducials/loss_probability", "no-bound", detail, hint))


def quantile_estimate(
    samples: Samples, target: str | int, error: str, quantile: float, confidence: float = 0.95
) -> QuantileEstimate:
    """Quantile of the error norm by order statistics, with its distribution-free interval."""
    low, high = interval_ranks(samples.trials, quantile, confidence)
    return between_ranks(samples, target, error, quantile, low, high)


def interval_so_far(
    samples: Samples, target: str | int, error: str, quantile: float, confidence: float
) -> QuantileEstimate:
    """The same; of few trials an end of the interval may be zero or infinite."""
    return between_ranks(samples, target, error, quantile, *enclosing_ranks(samples.trials, quantile, confidence))


def cvar_estimate(samples: Samples, target: str | int, error: str, quantile: float) -> float:
    """``E[|e| given |e| beyond its quantile]``, mm."""
    return cvar_of(samples, target, error, quantile)[0]


def cvar_of(samples: Samples, target: str | int, error: str, quantile: float) -> tuple[float, Array]:
    """The same and its summands that are not zero: ``x_q + mean((|e| - x_q)_+) / (1 - q)`` (Rockafellar and Uryasev
    2000), mm.

    Sums are exact (fsum): no order of summation.  Shots without an answer are beyond x_q and left out of the mean,
    which is infinite with them.
    """
    _refuse_unless_probability("quantile", quantile)
    n = samples.trials
    rank = ceil(n * quantile)
    sample = with_ranks(samples, target, error, rank)
    base = order_statistic(sample, rank)
    share = 1 - quantile - samples.unanswered / n
    count = n - rank - samples.unanswered
    if count <= 0 or share <= 0:
        return base, np.zeros(0)
    answered = sample.tail[: len(sample.tail) - sample.unanswered]
    beyond = answered[len(answered) - count :] - base
    return base + fsum(beyond) / n / share, beyond


def exceedance_estimate(
    samples: Samples, target: str | int, error: str, limit_mm: float, confidence: float = 0.95
) -> Exceedance:
    """Fraction of trials above the limit, with the exact (Clopper-Pearson) interval."""
    _refuse_unless_probability("confidence", confidence)
    n = samples.trials
    sample = samples.of(target, error)
    if sample.above is not None and sample.above[0] == limit_mm:
        count = sample.above[1]
    else:
        if len(sample.tail) < n and limit_mm < sample.tail[0]:
            sample = deepen(samples, n).of(target, error)
        count = len(sample.tail) - int(np.searchsorted(sample.tail, limit_mm, side="right"))
    return Exceedance(limit_mm, count / n, bound_share(count, n, (1 - confidence) / 2))


def bound_share(count: int, n: int, beyond: float) -> Interval:
    """Of the chance of what happened ``count`` times of n, exact (Clopper and Pearson): ``beyond`` either end with that
    probability at most."""
    low = float(betaincinv(count, n - count + 1, beyond)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, n - count, 1 - beyond)) if count < n else 1.0
    return low, high


class TrialsOfError(NamedTuple):
    """What trials say of an error at a target beside its quantiles: values, each with an interval."""

    samples: Samples
    target: str
    error: str
    confidence: float  # of the interval

    def mean(self) -> tuple[float, Interval]:
        """``E|e|`` of the trials that have an answer; its variance is E|e|^2, of mean and scatter, less its square."""
        sample = self.samples.of(self.target, self.error)
        answered = sample.trials - sample.unanswered
        square = float(np.trace(sample.scatter)) / answered + float(sample.mean @ sample.mean)
        return self._normal(sample.mean_norm, sqrt(max(square - sample.mean_norm**2, 0.0) / answered))

    def cvar(self, quantile: float) -> tuple[float, Interval]:
        """To first order it does not feel the error of the quantile: the spread of its summands is its error."""
        value, beyond = cvar_of(self.samples, self.target, self.error, quantile)
        mean = fsum(beyond) / self.samples.trials
        variance = max(fsum(beyond**2) / self.samples.trials - mean**2, 0.0)
        share = 1 - quantile - self.samples.unanswered / self.samples.trials
        return self._normal(value, sqrt(variance / self.samples.trials) / share if share > 0 else inf)

    def exceedance(self, limit: float) -> tuple[float, Interval]:
        """Clopper and Pearson's."""
        found = exceedance_estimate(self.samples, self.target, self.error, limit, self.confidence)
        return found.probability, found.interval

    def _normal(self, value: float, standard_error: float) -> tuple[float, Interval]:
        """By the central limit theorem; shots without an answer leave a mean without an upper end."""
        error = NormalDist().inv_cdf((1 + self.confidence) / 2) * standard_error
        return value, (max(value - error, 0.0), inf if self.samples.has_open_means else value + error)


def cvar_interval(
    p95_mm: float, cvar_mm: float, worst_mm: float, trials: int, confidence: float, looks: int, is_open: bool = False
) -> Interval:
    """Interval of the mean of the worst 5 %, mm, from what a check's record holds; Bonferroni over the looks.

    CVaR is P95 + mean(x) / 0.05 with x = (|e| - P95)_+ in [0, worst - P95]; a variable on [0, b] with mean m has a
    variance of at most m (b - m) (Bhatia and Davis 2000), some four times the true one for a Gaussian tail.  The mean
    is taken for normal: of a mean, no interval is free of the law.  is_open: shots without an answer leave it no end.
    """
    deviate = NormalDist().inv_cdf(1 - (1 - confidence) / (2 * looks))
    mean = 0.05 * (cvar_mm - p95_mm)
    error = deviate * sqrt(max(mean * (worst_mm - p95_mm - mean), 0.0) / trials) / 0.05
    return cvar_mm - error, inf if is_open else cvar_mm + error
