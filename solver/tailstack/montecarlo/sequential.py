"""Is a quantile within a limit?  As many trials as that takes, with exact error rates whatever the law.

A quantile x_q is looked at after 8192 trials and at every doubling up to a cap.  Of n trials, B ~ Binomial(n, q) lie at
or below x_q, and the order statistics of ranks l and u enclose it exactly when ``l <= B < u``: whether an interval of
ranks misses depends on no law.  B at the looks is a walk with independent binomial increments, so the probability that
it *ever* leaves its ranks is a sum that can be carried out (repeated confidence intervals: Jennison and Turnbull 1984,
here for a quantile).  The ranks are chosen so that after look k of K at most k/K of ``(1 - confidence) / 2`` is spent
on either side.  A limit below the whole interval is missed, one above it is kept; whenever one stops looking,

    P(kept is said, x_q > limit) <= (1 - confidence) / 2,    P(missed is said, x_q <= limit) <= (1 - confidence) / 2.

Bonferroni over the same looks takes a tenth more trials, for it forgets that they share most of theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import ceil, inf, sqrt
from statistics import NormalDist

import numpy as np
from scipy.special import gammaln

from ..arrays import Array
from ..errors import OutOfRangeError, Problem
from .estimators import between_ranks
from .plan import ChainPlan
from .simulate import BLOCK, Progress, Samples, ShardSampler, simulate

SURE = 0.64  # of the trials that a look says are needed: what is asked for ahead where that can be done side by side
_SPREAD = 10.0  # standard deviations of a binomial that are kept: 1e-23 is left out
Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Question:
    """Does a quantile of an error at a target keep a limit?"""

    target: str
    error: str  # "tcp" or "localisation"
    quantile: float
    limit_mm: float


@dataclass(frozen=True, slots=True)
class CvarQuestion:
    """Does the mean of the worst 5 % of TCP errors at a target keep a limit?"""

    target: str
    limit_mm: float
    confidence: float


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


@dataclass(frozen=True, slots=True, eq=False)
class SequentialRun:
    samples: Samples
    looks: tuple[int, ...]  # planned
    decided: bool


def planned_looks(max_trials: int) -> tuple[int, ...]:
    """Trial counts at which a decision is tried: 8192, doubling, the last one the cap."""
    looks = []
    count = BLOCK
    while count < max_trials:
        looks.append(count)
        count *= 2
    return (*looks, max_trials)


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
    found: list[int | None] = []
    for k, look in enumerate(looks, 1):
        start, step = _binomial(look - before, chance)
        first, alive = first + start, _convolve(alive, step)
        ordered = alive if lower else alive[::-1]
        sums = np.cumsum(ordered)
        count = int(np.searchsorted(sums, error * k / len(looks) - spent, side="right"))
        if count > 0:
            spent += float(sums[count - 1])
            found.append(first + count - 1 if lower else first + len(alive) - count)
            alive = alive[count:] if lower else alive[:-count]
            first += count if lower else 0
        elif lower and first > 0:
            found.append(first - 1)  # no walk that is alive comes there, so nothing is spent
        else:
            found.append(None)
        before = look
    return found


def _binomial(trials: int, chance: float) -> tuple[int, Array]:
    """(first, p): the probability of ``first + i`` successes, where it is not nothing."""
    spread = _SPREAD * sqrt(trials * chance * (1 - chance)) + 50  # 50: a few rare events are a skewed law
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
    p95_mm: float, cvar_mm: float, worst_mm: float, trials: int, confidence: float, looks: int
) -> Interval:
    """Interval of the mean of the worst 5 %, mm, from what a check's record holds; Bonferroni over the looks.

    CVaR is P95 + mean(x) / 0.05 with x = (|e| - P95)_+ in [0, worst - P95]; a variable on [0, b] with mean m has a
    variance of at most m (b - m) (Bhatia and Davis 2000), some four times the true one for a Gaussian tail.  The mean
    is taken for normal: of a mean, no interval is free of the law.
    """
    deviate = NormalDist().inv_cdf(1 - (1 - confidence) / (2 * looks))
    mean = 0.05 * (cvar_mm - p95_mm)
    error = deviate * sqrt(max(mean * (worst_mm - p95_mm - mean), 0.0) / trials) / 0.05
    return cvar_mm - error, cvar_mm + error


def simulate_to_decision(
    plan: ChainPlan,
    *,
    seed: int,
    questions: Sequence[Question],
    confidence: float,
    max_trials: int,
    quantile: float,
    settled: Callable[[Samples, int], bool] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    limits: Sequence[float] | None = None,
    source: ShardSampler | None = None,
) -> SequentialRun:
    """Simulate until every question is answered by the intervals of one look, or ``max_trials`` are drawn.

    quantile: the lowest that will be asked of the samples.  ``settled(samples, looks)``: what else must be decided,
    told how many looks are planned.  limits, source: see ``simulate``.  Raises what ``simulate`` raises.
    """
    looks = planned_looks(max_trials)
    samples: Samples | None = None
    needed = 0.0
    decided = False
    for k, look in enumerate(looks):
        samples = simulate(
            plan,
            trials=look,
            seed=seed,
            quantile=quantile,
            threads=threads,
            reprojection=True,
            progress=None if progress is None else (lambda done, _: progress(done, max_trials)),
            extend=samples,
            limits=limits,
            source=source,
            then=tuple(pair for pair in pairwise(looks[k:]) if pair[0] < SURE * needed) if k else (),
            expected=int(min(needed, max_trials)),
        )
        open_ones = [question for question in questions if not answers(samples, question, looks, k, confidence)]
        decided = not open_ones and (settled is None or settled(samples, len(looks)))
        if decided:
            break
        needed = max((_needed(samples, question, looks, k, confidence) for question in open_ones), default=2.0 * look)
    assert samples is not None
    return SequentialRun(samples, looks, decided)


def answers(samples: Samples, question: Question, looks: tuple[int, ...], k: int, confidence: float) -> bool:
    """Whether the interval of look ``k`` leaves the limit on one side."""
    ranks = repeated_ranks(looks, question.quantile, confidence)[k]
    low, high = repeated_interval(samples, question.target, question.error, question.quantile, ranks).interval_mm
    return high <= question.limit_mm or low > question.limit_mm


def _needed(samples: Samples, question: Question, looks: tuple[int, ...], k: int, confidence: float) -> float:
    """Trials with which a question would be answered if quantile and density stayed as they look now."""
    ranks = repeated_ranks(looks, question.quantile, confidence)[k]
    found = repeated_interval(samples, question.target, question.error, question.quantile, ranks)
    low, high = found.interval_mm
    gap = abs(found.value_mm - question.limit_mm)
    width = high - found.value_mm if question.limit_mm > found.value_mm else found.value_mm - low
    return samples.trials * (width / gap) ** 2 if gap > 0 and width < inf else inf
