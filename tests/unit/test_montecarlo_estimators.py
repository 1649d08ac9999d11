"""Estimators on runs: order statistics, CVaR, exceedance, adaptive stopping, and the radial estimator's referee; the
sequential test of a gate in mode auto, its error rates by simulation of counts and on the real chain.

Every observed rate of that is given its exact (Clopper-Pearson) 95 % interval, and each such comparison is wrong for a
right implementation with a probability of at most 2.5 %, were the seed not fixed.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.stats import beta

from laws import linear_law
from plain_trials import simulate
from scenes import cios_system, cube8_system, installation, mount, random_system, read_only, target, with_noise
from tailstack.errors import OutOfRangeError
from tailstack.montecarlo.chain import draw, evaluate
from tailstack.montecarlo.estimators import (
    cvar_estimate,
    cvar_interval,
    enclosing_ranks,
    exceedance_estimate,
    interval_ranks,
    interval_so_far,
    quantile_estimate,
)
from tailstack.montecarlo.plan import ChainPlan, compile_plan
from tailstack.montecarlo.radial import LinearChain, gains_in_plan_order, radial
from tailstack.montecarlo.simulate import Run, Samples, Simulation, deepen
from tailstack.montecarlo.stopping import (
    Goal,
    LimitQuestion,
    decision_looks,
    level_of_each,
    precision_looks,
    simulate_to_decision,
    simulate_to_precision,
)
from tailstack.propagation.linear import linearise
from tailstack.system import Law, System
from tailstack.tail.declared import law_exceedance, law_quantile

ORACLES = Path(__file__).parents[1] / "data" / "oracles"


@pytest.fixture(scope="module")
def run() -> tuple[Samples, np.ndarray]:
    """A run of 30,000 trials and, by another route, all its TCP norms."""
    plan = compile_plan(cios_system())
    norms = np.linalg.norm(evaluate(plan, draw(plan, 4, np.arange(30_000)))[:, 0, 0], axis=1)
    return simulate(plan, trials=30_000, seed=4), norms


def test_ranks_are_those_of_the_oracle_cover_and_are_tight() -> None:
    """Closed form (binomial)."""
    case = json.loads((ORACLES / "order_statistics.json").read_text())
    for trials, ranks in case["p95_two_sided_95_ranks"].items():
        assert list(interval_ranks(int(trials), 0.95, 0.95)) == ranks
    # Closed form: at least the stated confidence, less with either end moved inwards by its share.
    for trials, q, confidence in ((100, 0.9, 0.95), (6000, 0.999, 0.99), (777, 0.5, 0.9)):
        low, high = interval_ranks(trials, q, confidence)
        law = stats.binom(trials, q)
        assert law.cdf(high - 1) - law.cdf(low - 1) >= confidence
        assert law.sf(low - 1) >= 1 - (1 - confidence) / 2 > law.sf(low)
        assert law.cdf(high - 1) >= 1 - (1 - confidence) / 2 > law.cdf(high - 2)
    with pytest.raises(OutOfRangeError, match="at least 72 trials"):
        interval_ranks(71, 0.95, 0.95)
    interval_ranks(73, 0.95, 0.95)


@pytest.mark.parametrize("trials", [2, 8, 13, 8192 + 5])
def test_moments_of_odd_lengths(trials: int) -> None:
    plan = compile_plan(cios_system())
    errors = evaluate(plan, draw(plan, 4, np.arange(trials)))[:, 0, 1]
    samples = simulate(plan, trials=trials, seed=4, keep=trials)
    sample = samples.of(0, "localisation")
    assert samples.redone == 0
    assert sample.mean_norm == pytest.approx(np.linalg.norm(errors, axis=1).mean(), rel=1e-12)
    assert sample.worst == sample.tail[-1]
    np.testing.assert_allclose(sample.mean, errors.mean(axis=0), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(sample.covariance, np.cov(errors.T), rtol=1e-9)
    np.testing.assert_allclose(sample.tail, np.sort(np.linalg.norm(errors, axis=1)), rtol=1e-14)
    longer = simulate(plan, trials=8192 + 64, seed=4, keep=8192 + 64).of(0, "localisation")
    assert np.isin(sample.tail, longer.tail).all()


def test_quantile_cvar_and_exceedance_against_the_whole_sample(run: tuple[Samples, np.ndarray]) -> None:
    samples, norms = run
    ordered = np.sort(norms)
    found = quantile_estimate(samples, 0, "tcp", 0.95)
    low, high = interval_ranks(30_000, 0.95, 0.95)
    np.testing.assert_allclose(found.value_mm, ordered[28_500 - 1], rtol=1e-14)
    np.testing.assert_allclose(found.interval_mm, (ordered[low - 1], ordered[high - 1]), rtol=1e-14)
    cvar = cvar_estimate(samples, 0, "tcp", 0.95)
    np.testing.assert_allclose(cvar, ordered[28_500:].mean(), rtol=1e-12)
    above, count = exceedance_estimate(samples, 0, "tcp", 6.5), int((norms > 6.5).sum())
    assert above.probability == count / 30_000
    interval = stats.binomtest(count, 30_000).proportion_ci(0.95, "exact")
    np.testing.assert_allclose(above.interval, tuple(interval), rtol=1e-9)


def test_a_question_below_the_kept_tail_repeats_the_run(run: tuple[Samples, np.ndarray]) -> None:
    samples, norms = run
    assert len(samples.of(0).tail) < 3000
    assert quantile_estimate(samples, 0, "tcp", 0.5).value_mm == pytest.approx(np.sort(norms)[15_000 - 1], rel=1e-14)
    assert exceedance_estimate(samples, 0, "tcp", 1.0).probability == (norms > 1.0).mean()
    assert len(deepen(samples, 20_000).of(0).tail) == 20_000


def test_adaptive_run_stops_at_its_precision() -> None:
    plan = compile_plan(cube8_system())
    seen: list[tuple[int, int]] = []
    simulation = Simulation(plan, 3, progress=lambda done, total: seen.append((done, total)))
    run = simulate_to_precision(simulation, precision=0.01, goals=[Goal(0, "tcp", 0.95)])
    assert run.decided
    assert run.precision_reached <= 0.01
    assert run.samples.trials in precision_looks(2**24)
    assert "as requested" in run.stopping
    assert "Bonferroni" in run.stopping
    assert seen[-1][0] == run.samples.trials
    alone = simulate(plan, trials=run.samples.trials, seed=3)
    np.testing.assert_array_equal(alone.of(0).covariance, run.samples.of(0).covariance)
    assert quantile_estimate(alone, 0, "tcp", 0.95) == quantile_estimate(run.samples, 0, "tcp", 0.95)


def test_adaptive_run_says_when_it_hits_the_cap() -> None:
    run = simulate_to_precision(
        Simulation(compile_plan(cube8_system()), 3),
        precision=1e-4,
        max_trials=40_000,
        goals=[Goal("target", "localisation", 0.99)],
    )
    assert not run.decided
    assert run.samples.trials == 40_000
    assert "cap" in run.stopping


def test_a_run_goes_on_from_whole_blocks() -> None:
    plan = compile_plan(cube8_system())
    run = Run(Simulation(plan, 1))
    run.grow(5000)
    with pytest.raises(OutOfRangeError, match="multiple of 8192"):
        run.grow(32768)
    with pytest.raises(OutOfRangeError, match="threads must be at least 1"):
        simulate(plan, trials=100, seed=1, threads=0)
    with pytest.raises(OutOfRangeError, match="at least 2"):
        simulate(plan, trials=1, seed=1)


def linear_chain(system: System, quantile: float, error: str = "tcp", place: int = 0) -> LinearChain:
    """First order of the target at a place, with the exact law of the declared tolerances."""
    plan, model = compile_plan(system), linearise(system, system.targets[place])
    gain = gains_in_plan_order(plan, model.blocks, (place,), error)
    laws = plan.laws
    normal = np.array([law is Law.NORMAL for law in laws])
    kinds = [0 if law is Law.UNIFORM else 1 for law in laws if law is not Law.NORMAL]
    law = linear_law(model.bias_mm(error), gain[:, normal] @ gain[:, normal].T, gain[:, ~normal], kinds)
    r = law_quantile(law, quantile).quantile_mm
    density = (law_exceedance(law, 0.999 * r) - law_exceedance(law, 1.001 * r)) / (0.002 * r)
    return LinearChain(model.bias_mm(error), gain, lambda x: law_exceedance(law, x), r, density)


HALF = (0.009,) * 3 + (0.5,) * 3
SCENES = {
    "demo-like": cios_system(),
    "5px": cube8_system(views=with_noise(5.0)),
    "bias": cios_system(
        structure_connector=replace(
            installation("structure_connector", (0, 0, -95.0)), known=read_only([0.03, 0.02, 0, 1, 2, 0])
        )
    ),
    "uniform and triangular": cios_system(
        structure_connector=mount("structure_connector", (0, 0, -95.0), half_width=HALF, law=Law.UNIFORM),
        connector_flange=mount("connector_flange", (0, 0, -145.0), half_width=HALF, law=Law.TRIANGULAR),
    ),
    "everything": random_system(np.random.default_rng(3), 10),
}


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("quantile", [0.95, 0.999])
def test_radial_agrees_with_plain(name: str, quantile: float) -> None:
    """Referee: 2^18 plain trials; within the joint 5-sigma interval (t, 15 degrees of freedom: error rate 2e-4)."""
    system = SCENES[name]
    plan = compile_plan(system)
    found = radial(plan, linear_chain(system, quantile), quantile=quantile, seed=5, rays=16)
    plain = quantile_estimate(simulate(plan, trials=2**18, seed=6, quantile=quantile), 0, "tcp", quantile)
    plain_error = (plain.interval_mm[1] - plain.interval_mm[0]) / 3.92
    assert abs(found.value_mm - plain.value_mm) < 5 * np.hypot(found.standard_error_mm, plain_error)
    # variance of one evaluation, twenty times below plain sampling's at the very least (measured: 10^2 to 10^4)
    assert found.standard_error_mm**2 * found.evaluations < plain_error**2 * 2**18 / 20


def test_radial_interval_covers_as_often_as_it_says() -> None:
    """Sampled: 200 seeds of the 0.9 interval against the mean of all; five standard errors, error rate 1e-6."""
    system = cube8_system(views=with_noise(5.0))
    plan, linear = compile_plan(system), linear_chain(system, 0.95)
    found = [radial(plan, linear, seed=seed, confidence=0.9) for seed in range(100, 300)]
    truth = np.mean([f.value_mm for f in found])
    hits = sum(f.interval_mm[0] <= truth <= f.interval_mm[1] for f in found)
    assert hits / 200 > 0.9 - 5 * 0.0212


def test_radial_of_the_localisation_error_of_a_second_target() -> None:
    """Referee: plain sampling, joint 5-sigma interval."""
    system = cube8_system(targets=(target((0, 0, 70), "a"), target((20, 10, 40), "b")))
    plan, linear = compile_plan(system), linear_chain(system, 0.9, "localisation", place=1)
    found = radial(plan, linear, metric=3, quantile=0.9, seed=1, rays=16)
    plain = quantile_estimate(simulate(plan, trials=2**17, seed=2, quantile=0.9), "b", "localisation", 0.9)
    plain_error = (plain.interval_mm[1] - plain.interval_mm[0]) / 3.92
    assert abs(found.value_mm - plain.value_mm) < 5 * np.hypot(found.standard_error_mm, plain_error)


def test_radial_refuses_what_it_cannot_answer() -> None:
    system = cios_system()
    plan, linear = compile_plan(system), linear_chain(system, 0.95)
    with pytest.raises(OutOfRangeError, match="start outside"):
        radial(plan, replace(linear, mean=read_only([10.0, 0, 0])), seed=1)
    with pytest.raises(OutOfRangeError, match="the law given"):
        radial(plan, replace(linear, exceedance=lambda r: 0.2), seed=1)
    with pytest.raises(OutOfRangeError, match="16 randomisations"):
        radial(plan, linear, seed=1, randomisations=8)


def exact_interval(count: int, trials: int) -> tuple[float, float]:
    low = float(beta.ppf(0.025, count, trials - count + 1)) if count else 0.0
    return low, float(beta.ppf(0.975, count + 1, trials - count)) if count < trials else 1.0


def outcomes(
    looks: tuple[int, ...], quantile: float, confidence: float, below: float, runs: int, seed: int
) -> np.ndarray:
    """(3,) counts of runs that say kept, missed, nothing, when ``below`` of all trials keep the limit.

    The limit lies above the whole interval exactly when ``high`` trials or more keep it, and below it when fewer than
    ``low`` do: the test is one of counts.
    """
    random = np.random.default_rng(seed)
    steps = np.diff((0, *looks))
    kept = np.cumsum(random.binomial(steps, below, (runs, len(looks))), axis=1)
    said = np.zeros((runs, len(looks)), dtype=int)
    for k, look in enumerate(looks):
        low, high = enclosing_ranks(look, quantile, level_of_each(looks, confidence))
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


def test_what_has_no_order_statistic_yet_has_no_end() -> None:
    plan = compile_plan(cios_system())
    samples = simulate(plan, trials=8192, seed=1, quantile=0.95)
    value, (low, high) = interval_so_far(samples, 0, "tcp", 0.9999, 0.95)
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

CAP, CONFIDENCE = 2**15, 0.8


@pytest.fixture(scope="module")
def chain() -> tuple[ChainPlan, float]:
    """A compiled chain with two targets, and P95 of the first from 2^21 trials of another seed: the error of that is an
    eighth of what a run of ``CAP`` trials can tell."""
    plan = compile_plan(cios_system(targets=(target((0, 0, 70), "tip"), target((10, 0, 60), "shaft"))))
    samples = simulate(plan, trials=2**21, seed=1_000_003, quantile=0.95, threads=2)
    tail = samples.of("tip").tail
    return plan, float(tail[len(tail) - (2**21 - int(2**21 * 0.95))])


def decisions(chain: tuple[ChainPlan, float], factor: float, runs: int) -> dict[str, int]:
    plan, p95 = chain
    found = {"kept": 0, "missed": 0, "open": 0, "trials": 0}
    for seed in range(runs):
        question = LimitQuestion("tip", "tcp", 0.95, factor * p95)
        run = simulate_to_decision(Simulation(plan, seed, threads=1), [question], confidence=CONFIDENCE, max_trials=CAP)
        _, (low, high) = interval_so_far(run.samples, "tip", "tcp", 0.95, run.level)
        said = "kept" if high <= question.limit_mm else "missed" if low > question.limit_mm else "open"
        assert run.decided == (said != "open")
        assert run.decided or run.samples.trials == CAP
        found[said] += 1
        found["trials"] += run.samples.trials
    return found


@pytest.mark.parametrize(("factor", "right"), [(1.03, "kept"), (0.97, "missed")])
def test_a_design_beyond_its_limit_is_decided(chain: tuple[ChainPlan, float], factor: float, right: str) -> None:
    """sampled: 3 % from the limit, where P95 is known to 0.5 % at the cap."""
    found = decisions(chain, factor, 40)
    assert found[right] == 40
    assert found["trials"] / 40 < 0.6 * CAP, "it stops when it is decided"
