"""The sequential test of a gate in mode auto: its error rates, exactly, by simulation of counts, and on the real chain.

Every observed rate is given its exact (Clopper-Pearson) 95 % interval, and each such comparison is wrong for a right
implementation with a probability of at most 2.5 %, were the seed not fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import beta

from scenes import cios_system, target
from tailstack.montecarlo.estimators import cvar_interval, enclosing_ranks
from tailstack.montecarlo.plan import ChainPlan, compile_plan
from tailstack.montecarlo.simulate import Simulation, simulate
from tailstack.montecarlo.stopping import (
    Goal,
    LimitQuestion,
    decision_looks,
    interval_so_far,
    level_of_each,
    simulate_to_decision,
)

Counts = np.ndarray


def ranks_of(looks: tuple[int, ...], quantile: float, confidence: float) -> list[tuple[int | None, int | None]]:
    return [enclosing_ranks(look, quantile, level_of_each(looks, confidence)) for look in looks]


def exact_interval(count: int, trials: int) -> tuple[float, float]:
    low = float(beta.ppf(0.025, count, trials - count + 1)) if count else 0.0
    return low, float(beta.ppf(0.975, count + 1, trials - count)) if count < trials else 1.0


def outcomes(looks: tuple[int, ...], quantile: float, confidence: float, below: float, runs: int, seed: int) -> Counts:
    """(3,) counts of runs that say kept, missed, nothing, when ``below`` of all trials keep the limit.

    The limit lies above the whole interval exactly when ``high`` trials or more keep it, and below it when fewer than
    ``low`` do: the test is one of counts.
    """
    ranks = ranks_of(looks, quantile, confidence)
    random = np.random.default_rng(seed)
    steps = np.diff((0, *looks))
    kept = np.cumsum(random.binomial(steps, below, (runs, len(looks))), axis=1)
    said = np.zeros((runs, len(looks)), dtype=int)
    for k, (low, high) in enumerate(ranks):
        if high is not None:
            said[:, k] = np.where(kept[:, k] >= high, 1, said[:, k])
        if low is not None:
            said[:, k] = np.where(kept[:, k] < low, 2, said[:, k])
    first = said[np.arange(runs), np.argmax(said > 0, axis=1)]
    return np.bincount(first, minlength=3)[[1, 2, 0]]


@pytest.mark.parametrize(
    ("quantile", "confidence", "cap"), [(0.95, 0.95, 2**20), (0.95, 0.8, 2**17), (0.9999, 0.95, 2**20)]
)
def test_on_the_limit_wrong_decisions_are_as_rare_as_stated(quantile: float, confidence: float, cap: int) -> None:
    """sampled: 40,000 runs exactly on the limit, the worst case for either error; seed 20."""
    runs, stated = 40_000, (1 - confidence) / 2
    kept, missed, open_ones = outcomes(decision_looks(cap), quantile, confidence, quantile, runs, 20)
    for wrong in (kept, missed):
        low, high = exact_interval(wrong, runs)
        assert low <= stated
        assert high >= 0.3 * stated, "looks share most of their trials, not all"
    assert open_ones == runs - kept - missed
    assert open_ones / runs > confidence - 0.01


@pytest.mark.parametrize("beyond", [0.97, 1.03])
def test_beyond_the_limit_it_is_decided_and_hardly_ever_wrongly(beyond: float) -> None:
    """sampled: 3 % more or fewer trials above the limit than allowed, some seven standard deviations at the cap."""
    runs = 20_000
    kept, missed, open_ones = outcomes(decision_looks(2**20), 0.95, 0.95, 1 - 0.05 * beyond, runs, 21)
    right, wrong = (kept, missed) if beyond < 1 else (missed, kept)
    assert exact_interval(wrong, runs)[0] <= 0.025
    assert wrong < 0.02 * runs
    assert open_ones < 0.02 * runs
    assert right > 0.97 * runs


def test_far_from_the_limit_the_first_look_decides() -> None:
    kept, missed, _ = outcomes(decision_looks(8192), 0.95, 0.95, 1 - 0.05 * 0.8, 20_000, 22)
    assert kept / 20_000 > 0.97
    assert missed == 0


def test_all_intervals_hold_together() -> None:
    """sampled: the quantile lies in the intervals of *all* looks in at least 95 % of 40,000 runs; seed 23."""
    looks = decision_looks(2**18)
    ranks = ranks_of(looks, 0.95, 0.95)
    random = np.random.default_rng(23)
    below = np.cumsum(random.binomial(np.diff((0, *looks)), 0.95, (40_000, len(looks))), axis=1)
    inside = np.ones(len(below), dtype=bool)
    for k, (low, high) in enumerate(ranks):
        assert low is not None
        assert high is not None
        inside &= (below[:, k] >= low) & (below[:, k] < high)
    assert exact_interval(int(inside.sum()), len(inside))[1] >= 0.95


def test_what_has_no_order_statistic_yet_has_no_end() -> None:
    plan = compile_plan(cios_system())
    samples = simulate(plan, trials=8192, seed=1, quantile=0.95)
    value, (low, high) = interval_so_far(samples, Goal(0, "tcp", 0.9999), 0.95)
    assert high == float("inf")
    assert 0 < low <= value


def test_the_interval_of_the_tails_mean_holds() -> None:
    """sampled: CVaR95 of |N(0, I)| by 400 runs of 20,000 trials; truth from 20 million, seed 24."""
    random = np.random.default_rng(24)

    def tail(trials: int) -> tuple[float, float, float]:
        norms = np.sqrt(random.chisquare(3, trials))
        p95 = float(np.partition(norms, int(0.95 * trials))[int(0.95 * trials)])
        return p95, float(norms[norms >= p95].mean()), float(norms.max())

    truth = np.mean([tail(2_000_000)[1] for _ in range(10)])
    held = 0
    for _ in range(400):
        low, high = cvar_interval(*tail(20_000), 20_000, 0.95, looks=8)
        held += bool(low <= truth <= high)
    assert exact_interval(held, 400)[1] >= 0.95


# --- on the chain itself -----------------------------------------------------------------------------------------

CAP, RUNS, CONFIDENCE = 2**15, 300, 0.8


@pytest.fixture(scope="module")
def chain() -> tuple[ChainPlan, float]:
    """A compiled chain with two targets, and P95 of the first from 2^23 trials of another seed: the error of that is a
    sixteenth of what a run of ``CAP`` trials can tell."""
    plan = compile_plan(cios_system(targets=(target((0, 0, 70), "tip"), target((10, 0, 60), "shaft"))))
    samples = simulate(plan, trials=2**23, seed=1_000_003, quantile=0.95, threads=2)
    tail = samples.of("tip").tail
    return plan, float(tail[len(tail) - (2**23 - int(2**23 * 0.95))])


def decisions(chain: tuple[ChainPlan, float], factor: float, runs: int) -> dict[str, int]:
    plan, p95 = chain
    found = {"kept": 0, "missed": 0, "open": 0, "trials": 0}
    for seed in range(runs):
        question = LimitQuestion("tip", "tcp", 0.95, factor * p95)
        run = simulate_to_decision(Simulation(plan, seed, threads=1), [question], confidence=CONFIDENCE, max_trials=CAP)
        _, (low, high) = interval_so_far(run.samples, question, level_of_each(run.looks, CONFIDENCE))
        said = "kept" if high <= question.limit_mm else "missed" if low > question.limit_mm else "open"
        assert run.decided == (said != "open")
        assert run.decided or run.samples.trials == CAP
        found[said] += 1
        found["trials"] += run.samples.trials
    return found


@pytest.mark.long
def test_a_design_on_its_limit_stays_open_at_the_cap(chain: tuple[ChainPlan, float]) -> None:
    """sampled: 300 seeds, stated 10 % on either side, 95 % intervals.

    The limit is a sampled P95 itself: two of its standard errors, an eighth of one of a run at the cap, move the rate
    of one side by up to 0.022 (an eighth of the normal density at its 10 % point) and that of the other back.
    """
    found = decisions(chain, 1.0, RUNS)
    of_the_limit = 0.175 / 8
    for wrong in ("kept", "missed"):
        low, high = exact_interval(found[wrong], RUNS)
        assert low <= (1 - CONFIDENCE) / 2 + of_the_limit
        assert high >= 0.5 * (1 - CONFIDENCE) / 2
    assert exact_interval(found["kept"] + found["missed"], RUNS)[0] <= 1 - CONFIDENCE
    assert exact_interval(found["open"], RUNS)[1] >= CONFIDENCE


@pytest.mark.parametrize(("factor", "right"), [(1.03, "kept"), (0.97, "missed")])
def test_a_design_beyond_its_limit_is_decided(chain: tuple[ChainPlan, float], factor: float, right: str) -> None:
    """sampled: 3 % from the limit, where P95 is known to 0.5 % at the cap."""
    found = decisions(chain, factor, 100)
    assert found[right] == 100
    assert found["trials"] / 100 < 0.6 * CAP, "it stops when it is decided"
