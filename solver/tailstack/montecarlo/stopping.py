"""How many trials: looks at a run that grows, until its quantiles are precise or every question is answered.

*To a precision*: after 16384 trials and at every doubling up to a cap.  Looking repeatedly spends confidence: each look
uses ``1 - (1 - confidence) / looks`` (Bonferroni over the *planned* looks).

*To a decision*: is a quantile within a limit?  It is looked at after 8192 trials and at every doubling up to a cap, at
the same confidence of each look.  A limit below the whole interval is missed, one above it is kept; whenever one stops
looking,

    P(kept is said, x_q > limit) <= (1 - confidence) / 2,    P(missed is said, x_q <= limit) <= (1 - confidence) / 2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

from .estimators import QuantileEstimate, interval_so_far, quantile_estimate
from .shards import BLOCK
from .simulate import Run, Samples, Simulation

TYPICAL = 3.3  # trials times squared relative half-width: what P95 of most errors takes
SURE = 0.64  # of the trials that a look says are needed: its half-width is itself known to ten per cent


@dataclass(frozen=True, slots=True)
class Goal:
    """One quantile that has to be known to the requested precision."""

    target: str | int
    error: str
    quantile: float


@dataclass(frozen=True, slots=True)
class LimitQuestion:
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


@dataclass(frozen=True, slots=True, eq=False)
class AdaptiveRun:
    """A run at the look at which it stopped."""

    samples: Samples
    looks: tuple[int, ...]  # planned
    level: float  # confidence of each single look, so that all of them together hold with the stated one
    decided: bool  # it found what it was to find
    precision_reached: float = inf  # largest relative half-width of the goals' intervals
    stopping: str = ""  # why it stopped, in a sentence


def precision_looks(max_trials: int) -> tuple[int, ...]:
    """Trial counts at which the precision is looked at: 16384, doubling, the last one the cap."""
    return _double(2 * BLOCK, max_trials)


def decision_looks(max_trials: int) -> tuple[int, ...]:
    """Trial counts at which a decision is tried: 8192, doubling, the last one the cap."""
    return _double(BLOCK, max_trials)


def _double(first: int, cap: int) -> tuple[int, ...]:
    looks = []
    while first < cap:
        looks.append(first)
        first *= 2
    return (*looks, cap)


def level_of_each(looks: tuple[int, ...], confidence: float) -> float:
    """Confidence of each look with which all of them together hold with the stated one (Bonferroni)."""
    return 1 - (1 - confidence) / len(looks)


def simulate_to_precision(
    simulation: Simulation,
    *,
    precision: float,
    goals: Sequence[Goal],
    confidence: float = 0.95,
    max_trials: int = 2**24,
    settled: Callable[[Samples, float], bool] | None = None,
) -> AdaptiveRun:
    """Simulate until the relative half-width of every goal's interval is at most ``precision``.

    The interval of each goal at the look at which it stops holds with ``confidence``.  ``settled(samples, level)``:
    what else must hold before it stops, judged with intervals of confidence ``level``.
    """
    looks = precision_looks(max_trials)
    level = level_of_each(looks, confidence)
    highest = max(goal.quantile for goal in goals)
    while len(looks) > 1 and highest ** looks[0] > (1 - level) / 2:
        looks = looks[1:]  # so few trials have no interval of that quantile
    worst, finished = inf, False

    def examine(samples: Samples) -> float | None:
        nonlocal worst, finished
        each = (quantile_estimate(samples, goal.target, goal.error, goal.quantile, level) for goal in goals)
        worst = max(estimate.relative_half_width for estimate in each)
        finished = worst <= precision and (settled is None or settled(samples, level))
        # the half-width falls with the square root of the trials
        return None if finished else samples.trials * (worst / precision) ** 2

    samples = _grow(simulation, looks, TYPICAL / precision**2, examine)
    if finished:
        reason = f"every interval is within ±{100 * worst:.2g} % of its quantile, as requested (±{100 * precision:g} %)"
    else:
        lack = f"short of the ±{100 * precision:g} % requested" if worst > precision else "with a requirement undecided"
        reason = f"the cap of {max_trials} trials was reached at ±{100 * worst:.2g} %, {lack}"
    stopping = (
        f"Stopped after {samples.trials} trials because {reason}; each look used a confidence of {level:.5g}, "
        f"Bonferroni over {len(looks)} planned looks, for {confidence:g} in all."
    )
    return AdaptiveRun(samples, looks, level, finished, worst, stopping)


def simulate_to_decision(
    simulation: Simulation,
    questions: Sequence[LimitQuestion],
    *,
    confidence: float,
    max_trials: int,
    settled: Callable[[Samples, int], bool] | None = None,
) -> AdaptiveRun:
    """Simulate until every question is answered by the intervals of one look, or ``max_trials`` are drawn.

    ``settled(samples, looks)``: what else must be decided, given how many looks are planned.
    """
    looks = decision_looks(max_trials)
    level = level_of_each(looks, confidence)
    decided = False

    def examine(samples: Samples) -> float | None:
        nonlocal decided
        found = [(q, interval_so_far(samples, q.target, q.error, q.quantile, level)) for q in questions]
        undecided = [pair for pair in found if pair[1].interval_mm[0] <= pair[0].limit_mm < pair[1].interval_mm[1]]
        decided = not undecided and (settled is None or settled(samples, len(looks)))
        if decided:
            return None
        return max((_trials_needed(samples, *pair) for pair in undecided), default=2.0 * samples.trials)

    samples = _grow(simulation, looks, 0.0, examine)
    return AdaptiveRun(samples, looks, level, decided)


def _grow(
    simulation: Simulation, looks: tuple[int, ...], needed: float, examine: Callable[[Samples], float | None]
) -> Samples:
    """Draw to one look after the other until ``examine(samples)`` is None.

    Otherwise it returns how many trials are needed as far as can be told: a sampler that works side by side is told of
    looks that will almost certainly follow.  ``needed``: what is expected before the first look.
    """
    run = Run(simulation)
    for k, look in enumerate(looks):
        ahead = tuple(pair for pair in pairwise(looks[k:]) if pair[0] < SURE * needed) if k else ()
        samples = run.grow(look, most=looks[-1], then=ahead, expected=int(min(needed, looks[-1])))
        wanted = examine(samples)
        if wanted is None:
            break
        needed = wanted
    return samples


def _trials_needed(samples: Samples, question: LimitQuestion, found: QuantileEstimate) -> float:
    """Trials with which a question would be answered if quantile and density stayed as they look now."""
    (low, high), value_mm = found.interval_mm, found.value_mm
    gap = abs(value_mm - question.limit_mm)
    width = high - value_mm if question.limit_mm > value_mm else value_mm - low
    return samples.trials * (width / gap) ** 2 if gap > 0 and width < inf else inf
