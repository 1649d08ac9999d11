"""Bench measurements against prediction: statistics against their closed forms, tests against their stated size.

Where expected values come from is said at each test; random checks state seed and error rate.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2, kstest

import reference_chain
from scenes import broken_system, cube8_system, mount, with_noise
from tailstack.errors import LimitError, OutOfRangeError
from tailstack.geometry.arrays import Array
from tailstack.montecarlo.chain import draw
from tailstack.montecarlo.plan import compile_plan
from tailstack.propagation.linear import covariance, linearise
from tailstack.studies.bench import levels
from tailstack.studies.bench.compare import StudyComparison, study_comparison
from tailstack.studies.bench.file import Group, Measurements
from tailstack.studies.bench.levels import (
    MOST_REPLICATES,
    BenchDraws,
    count_benches,
    count_least_benches,
    expect,
    share_draws,
    simulate_benches,
)
from tailstack.studies.bench.statistics import departure, distance, holm, moments_of, p_value, pooled_sd, tail_mean
from tailstack.system import Law, System

HALF = np.array([np.deg2rad(0.1)] * 3 + [0.05] * 3)
SIZES = (4, 4, 4)


@cache
def scene() -> System:
    """The oracles' cube with uniform seats at both interfaces, manufacturing and hand-eye error, 0.5 px."""
    base = cube8_system()
    return replace(
        base,
        structure_connector=mount("structure_connector", (0, 0, -95.0), half_width=HALF, law=Law.UNIFORM),
        connector_flange=mount("connector_flange", (0, 0, -145.0), half_width=HALF, coverage_factor=2.0),
        hand_eye=mount("hand_eye", half_width=HALF * [0, 0, 0, 1, 1, 1], law=Law.TRIANGULAR),
        manufacturing_half_width_mm=np.full(base.fiducials_mm.shape, 0.03),
    )


def measured(values: Array, sizes: tuple[int, ...], deliberate: Array | None = None) -> Measurements:
    """What reading a file of vectors (n, 3) or norms (n,) gives."""
    form = "vectors" if values.ndim == 2 else "norms"
    group = Group("L", "target", deliberate, values, sizes, tuple(map(str, sizes)), 2)
    return Measurements("bench.csv", "0" * 64, form, "mm", len(values), (group,), True, ())  # type: ignore[arg-type]


# --- statistics -----------------------------------------------------------------------------------


def test_moments_are_those_of_numpy() -> None:
    """independent: numpy.cov of each installation and of their means."""
    rng = np.random.default_rng(1)
    errors, sizes = rng.normal(size=(2, 9, 3)), (2, 4, 3)
    found = moments_of(errors, sizes)
    for bench in range(2):
        parts = np.split(errors[bench], [2, 6])
        pooled = sum((len(part) - 1) * np.cov(part.T) for part in parts) / 6
        means = np.array([part.mean(axis=0) for part in parts])
        np.testing.assert_allclose(found.mean[bench], means.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(found.within[bench], pooled, rtol=1e-12)
        np.testing.assert_allclose(found.between[bench], np.cov(means.T), rtol=1e-12)
    norms = np.linalg.norm(errors, axis=2)
    by_hand = np.sqrt(sum(part.var(ddof=0) * len(part) for part in np.split(norms[0], [2, 6])) / 6)
    assert pooled_sd(norms, sizes)[0] == pytest.approx(by_hand, rel=1e-12)
    assert tail_mean(np.array([[3.0, 9.0, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0, 8.0, 0.0, 10.0]]))[0] == 9.5
    assert moments_of(errors, (9,)).between is None
    assert moments_of(errors[:, :3], (1, 1, 1)).within is None


@pytest.mark.parametrize("freedom", [2, 4, 5, 9, 400])
def test_departure_has_its_known_law(freedom: int) -> None:
    """closed_form: the ratio of traces is chi-squared with 3 nu degrees over 3 nu; the likelihood ratio nearly with 6
    once its mean is 6 (Anderson 2003).  2,000 Wishart matrices of SciPy, seed 2; a correct one fails once in
    1000."""
    expected_covariance = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
    normals = np.linalg.cholesky(expected_covariance) @ np.random.default_rng(2).standard_normal((2000, 3, freedom))
    found = departure(normals @ normals.swapaxes(1, 2) / freedom, expected_covariance, freedom)
    scaled, degrees = (3 * freedom * found, 3 * freedom) if freedom < 4 else (6 * found / found.mean(), 6)
    assert kstest(scaled, chi2(degrees).cdf).pvalue > 1e-3


def test_distances_p_values_and_holm_are_those_of_their_definitions() -> None:
    rng = np.random.default_rng(3)
    covariance_matrix = np.cov(rng.normal(size=(3, 20)))
    vectors = rng.normal(size=(5, 3))
    by_hand = [vector @ np.linalg.inv(covariance_matrix) @ vector for vector in vectors]
    np.testing.assert_allclose(distance(vectors, covariance_matrix), by_hand, rtol=1e-12)
    sample = np.arange(1.0, 100.0)  # 99 of them
    assert p_value(200.0, sample, both_sides=False) == 0.01
    assert p_value(95.0, sample, both_sides=False) == 0.06
    assert p_value(0.0, sample, both_sides=True) == 0.02
    assert p_value(50.0, sample, both_sides=True) == 1.0
    # closed_form: sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1, made monotone.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert 2 / (count_least_benches(200, 0.05) + 1) < 0.05 / 200


# --- the predicted bench --------------------------------------------------------------------------


def test_a_bench_shares_what_it_shares() -> None:
    plan = compile_plan(scene())
    fresh = draw(plan, 5, np.arange(24))
    z = share_draws(plan, fresh.copy(), (2, 4, 6))
    for block in plan.blocks:
        columns = z[:, block.start : block.stop].reshape(2, 12, -1)
        distinct = [len(np.unique(columns[bench], axis=0)) for bench in range(2)]
        once = ("fiducial_manufacturing", "hand_eye")
        wanted = 1 if block.name in once else 3 if block.name in ("structure_connector", "connector_flange") else 12
        assert distinct == [wanted, wanted], block.name
        assert not np.array_equal(columns[0], columns[1])


def test_expected_moments_are_those_of_the_chain() -> None:
    """sampled: 4,999 benches, seed 0; a covariance is good to 2.5 % of its trace (more than 4 sigma)."""
    system = scene()
    law = expect(linearise(system, system.targets[0]), "tcp", 0.1)
    total = covariance(linearise(system, system.targets[0]), "tcp") + 0.01 * np.eye(3)
    np.testing.assert_allclose(law.unit + law.installation + law.shot, total, rtol=1e-10)
    errors = simulate_benches(system, 0, "tcp", SIZES, BenchDraws(0, MOST_REPLICATES, instrument_sd_mm=0.1))
    found = moments_of(errors, SIZES)
    for sample, predicted in (
        (np.cov(found.mean.T), law.of_mean(SIZES)),
        (found.within.mean(axis=0), law.shot),  # type: ignore[union-attr]
        (found.between.mean(axis=0), law.between(SIZES)),  # type: ignore[union-attr]
    ):
        np.testing.assert_allclose(sample, predicted, atol=0.025 * np.trace(predicted))


def plain_bench(system: System, rng: np.random.Generator, sizes: tuple[int, ...], noise: float = 0.5) -> Array:
    """One bench (n, 3) mm by the plain chain of the tests: TCP error, drawn here and not by the package."""
    once = {
        "fiducial_manufacturing": rng.normal(0, 0.03, system.fiducials_mm.size),
        "hand_eye": HALF[3:] * (rng.random(3) - rng.random(3)),
    }
    found = []
    for count in sizes:
        mounted = {"structure_connector": rng.uniform(-HALF, HALF), "connector_flange": rng.normal(0, HALF / 2)}
        for _ in range(count):
            shot = {
                f"{kind}_noise:{view.name}": rng.normal(0, noise, size)
                for view in system.views
                for kind, size in (("fiducial", 16), ("target", 2))
            }
            found.append(reference_chain.run(system, system.targets[0], once | mounted | shot)["tcp"])
    return np.array(found)


def p_values_of(system: System, values: Array, many: Array) -> dict[str, float]:
    """p-value of every test of one bench against simulated ones."""
    read = measured(values, SIZES)
    bench = levels.describe_bench(system, read, read.groups[0], "tcp", 0.0)
    found = levels.test_bench(bench, many, np.linalg.norm(many, axis=2))
    return {test.test: test.p_value for test in found}


@pytest.mark.long
def test_every_test_has_its_size() -> None:
    """independent, sampled: 400 benches of the plain chain that are as designed.  At 5 % a test of the right size
    refuses 20; fewer than 7 or more than 36 come once in 2000.  Seed 4."""
    system, rng = scene(), np.random.default_rng(4)
    many = simulate_benches(system, 0, "tcp", SIZES, BenchDraws(0, 999))
    refused: dict[str, int] = {}
    for _ in range(400):
        errors = plain_bench(system, rng, SIZES)
        for form, values in (("vectors", errors), ("norms", np.linalg.norm(errors, axis=1))):
            for name, p in p_values_of(system, values, many).items():
                refused[f"{name} of {form}"] = refused.get(f"{name} of {form}", 0) + (p < 0.05)
    assert len(refused) == 8
    assert all(7 <= count <= 36 for count in refused.values()), refused


def test_a_difference_is_found() -> None:
    """sampled: 40 benches with noise of 1 px instead of 0.5 px; spread refused in at least 36.  Seed 6."""
    system, rng = scene(), np.random.default_rng(6)
    many = simulate_benches(system, 0, "tcp", SIZES, BenchDraws(0, 999))
    found = [p_values_of(system, plain_bench(system, rng, SIZES, noise=1.0), many)["spread"] < 0.05 for _ in range(40)]
    assert sum(found) >= 36


# --- the study ------------------------------------------------------------------------------------


def studied(system: System, errors: Array, sizes: tuple[int, ...], **options: object) -> StudyComparison:
    return study_comparison(system, measured(errors, sizes), **options)  # type: ignore[arg-type]


def test_a_bench_as_designed_agrees() -> None:
    """independent: a bench of the plain chain, seed 7."""
    study = studied(scene(), plain_bench(scene(), np.random.default_rng(7), SIZES), SIZES)
    level = study.levels[0]
    assert study.verdict == "agrees"
    assert len(level.tests) == 4
    assert level.spread.interval[0] < 1 < level.spread.interval[1]
    assert "That is not equality" in study.conclusions[1]


def test_a_tilt_is_found() -> None:
    """closed_form: a tilt of connector_flange by rx about (0, 0, -145) displaces the target at z = 70 by 215 mm times
    the angle along -y; independent: the bench is the plain chain's, seed 8."""
    tilt = np.deg2rad(0.35)
    seat = scene().connector_flange
    bent = replace(scene(), connector_flange=replace(seat, known=np.array([tilt, 0, 0, 0, 0, 0])))
    study = studied(scene(), plain_bench(bent, np.random.default_rng(8), (3,) * 6), (3,) * 6)
    assert study.verdict == "differs"
    low, high = study.levels[0].bias.interval_mm[1]
    assert low < -215 * tilt < high
    assert any("mean" in said and "outside the predicted range in y" in said for said in study.conclusions)


def test_loud_images_are_found() -> None:
    """independent: the plain chain with 1 px instead of 0.5 px, one installation of 20, seed 9.  The spread is then
    twice the predicted one."""
    study = studied(scene(), plain_bench(scene(), np.random.default_rng(9), (20,), noise=1.0), (20,))
    low, high = study.levels[0].spread.interval
    assert low < 2 < high
    assert "spread from trial to trial" in study.conclusions[-1]


def test_the_interval_of_a_spread_is_that_of_its_scale() -> None:
    """sampled: with four trials the root of the trace varies from q1 to q2 of its own (40,000 NumPy benches), so that
    a ratio r leaves open r / q2 .. r / q1, and not r q1 .. r q2: the law is skewed.  2 % is 4 sigma."""
    system = cube8_system()
    sigma = covariance(linearise(system, system.targets[0]), "tcp")
    rng = np.random.default_rng(23)
    many = rng.multivariate_normal(np.zeros(3), sigma, (40_000, 4))
    q1, q2 = np.quantile(np.sqrt(many.var(axis=1, ddof=1).sum(axis=1) / np.trace(sigma)), [0.025, 0.975])
    spread = studied(system, many[0], (4,)).levels[0].spread
    assert spread.interval == pytest.approx((spread.ratio / q2, spread.ratio / q1), rel=0.02)


def test_as_many_benches_are_simulated_as_the_tests_need() -> None:
    assert count_benches([32], 4, 0.05) == 4999
    assert count_benches([2000], 3, 0.05) == 1000
    assert count_benches([100] * 10, 30, 0.05) == 2000
    with pytest.raises(LimitError, match="3,000 trials and 90 tests need 16,200,000"):
        count_benches([100] * 30, 90, 0.05)


def test_a_level_is_predicted_with_its_installation_error() -> None:
    """closed_form: with the structure moved by a torsor, q_hat = T^-1 q; noise of 0.5 px moves the mean of 12 by less
    than 0.1 mm."""
    torsor = np.array([np.deg2rad(1.0), 0, 0, 0, 1.0, 0])
    system = cube8_system()
    r = reference_chain.rotation(torsor[:3], system.rotation_form)
    pivot = np.array([0, 0, -95.0])
    bias = r.T @ (np.array([0, 0, 70.0]) - pivot - torsor[3:]) + pivot - np.array([0, 0, 70.0])
    errors = bias + np.random.default_rng(12).normal(0, 0.09, (12, 3))
    study = study_comparison(system, measured(errors, (12,), torsor), error="localisation")
    level = study.levels[0]
    assert level.bias.predicted_mm == pytest.approx(tuple(bias), abs=0.01)
    assert level.deliberate_deg_mm == pytest.approx((1.0, 0, 0, 0, 1.0, 0))
    assert not next(test for test in level.tests if test.test == "mean").differs
    elsewhere = study_comparison(system, measured(errors, (12,)), error="localisation")
    assert next(test for test in elsewhere.levels[0].tests if test.test == "mean").differs


def test_bounded_components_are_given_the_benefit_of_the_doubt() -> None:
    """closed_form: a bounded seat of +-1 mm along z.  A mean at its end is no difference, one 1 mm beyond it is; norms
    cannot be held against it."""
    half = np.array([0, 0, 0, 0, 0, 1.0])
    system = cube8_system(connector_flange=mount("connector_flange", (0, 0, -145.0), half_width=half, law=Law.BOUNDED))
    noise = np.random.default_rng(13).normal(0, 0.09, (12, 3))
    for shift, differs in ((1.0, False), (-1.0, False), (2.0, True)):
        study = studied(system, noise + np.array([0, 0, shift]), (12,))
        assert next(test for test in study.levels[0].tests if test.test == "mean").differs is differs
    with pytest.raises(OutOfRangeError, match="without a law"):
        studied(system, np.linalg.norm(noise, axis=1), (12,))


def test_norms_say_less() -> None:
    bent = replace(
        scene(), connector_flange=replace(scene().connector_flange, known=np.array([np.deg2rad(0.5), 0, 0, 0, 0, 0]))
    )
    norms = np.linalg.norm(plain_bench(bent, np.random.default_rng(14), (12,)), axis=1)
    study = studied(scene(), norms, (12,))
    assert study.verdict == "differs"
    assert study.levels[0].bias is None


def test_the_tail_is_held_against_order_statistics() -> None:
    """closed_form: the median of the k-th of n simulated benches is the predicted place of the k-th measured error; a
    bench three times too loud lies above the envelope at its top."""
    rng = np.random.default_rng(15)
    system = cube8_system()
    errors = 3 * rng.multivariate_normal(np.zeros(3), covariance(linearise(system, system.targets[0]), "tcp"), 80)
    level = studied(system, errors, (80,)).levels[0]
    assert len(level.quantiles) <= 60
    assert [point.measured_mm for point in level.quantiles] == sorted(point.measured_mm for point in level.quantiles)
    top = level.quantiles[-1]
    assert top.probability == pytest.approx(79.5 / 80)
    assert top.measured_mm == pytest.approx(np.linalg.norm(errors, axis=1).max())
    assert top.outside
    assert top.measured_mm > top.envelope_mm[1]
    # P(max of 80 <= x) = 1/2 at the quantile 0.5^(1/80) of one: by 2e6 NumPy draws of the Gaussian.
    draws = rng.multivariate_normal(np.zeros(3), covariance(linearise(system, system.targets[0]), "tcp"), 2_000_000)
    assert top.predicted_mm == pytest.approx(np.quantile(np.linalg.norm(draws, axis=1), 0.5 ** (1 / 80)), rel=0.01)


@pytest.mark.long
def test_the_instrument_s_own_error_is_part_of_the_prediction() -> None:
    rng = np.random.default_rng(16)
    errors = plain_bench(scene(), rng, (15,)) + rng.normal(0, 0.4, (15, 3))
    assert studied(scene(), errors, (15,)).verdict == "differs"
    told = studied(scene(), errors, (15,), instrument_sd_mm=0.4)
    assert told.verdict == "agrees"
    with pytest.raises(OutOfRangeError, match="standard deviation"):
        studied(scene(), errors, (15,), instrument_sd_mm=-1.0)


@pytest.mark.long
def test_the_answer_is_the_seed_s() -> None:
    errors = plain_bench(scene(), np.random.default_rng(17), (6,))
    once, again = (studied(scene(), errors, (6,), threads=threads) for threads in (1, 2))
    assert once == again
    assert studied(scene(), errors, (6,), seed=1).levels != once.levels


@pytest.mark.long
def test_a_design_that_predicts_no_spread_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="predicts no spread"):
        studied(cube8_system(views=with_noise(0.0)), np.zeros((3, 3)), (3,))


def test_beyond_first_order_the_chain_itself_is_the_reference() -> None:
    """A small cluster at half a pixel: the linear law is wrong there, and a bench of the chain must still agree."""
    system = broken_system()
    plan_errors = simulate_benches(system, 0, "tcp", (4,), BenchDraws(99, 4))[3]
    study = studied(system, plan_errors, (4,))
    assert study.validity.expected_error_percent is None
    assert study.verdict == "agrees"
