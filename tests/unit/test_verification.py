"""The Monte Carlo check against first order where that holds, and against itself where seeds and threads change."""

from __future__ import annotations

import itertools
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_data import EXAMPLES
from scenes import cube8_system, cube_fiducials, mount, system_of, target, with_noise
from tailstack import DesignError, load_design, score, verify
from tailstack.system import Law, Requirement

DEMO = EXAMPLES / "demo.yaml"


def requirement(limit_mm, **changes):
    base = Requirement("r", "tcp", 0.95, limit_mm, 0.95, ("target",))
    return replace(base, **changes)


def test_demo_agrees_with_first_order_within_one_per_cent():
    """The issue's figure: mean, standard deviations and P95; 262,144 trials, sampling error below 0.3 %."""
    design = load_design(DEMO)
    first, check = score(design).targets[0], verify(design, trials=262_144, seed=20).targets[0]
    assert check.p95_mm == pytest.approx(first.p95_mm, rel=0.01)
    assert check.mean_norm_mm == pytest.approx(first.mean_norm_mm, rel=0.01)
    assert check.std_mm == pytest.approx(first.std_mm, rel=0.01)
    assert check.localisation.p95_mm == pytest.approx(first.localisation.p95_mm, rel=0.01)
    assert check.cvar95_mm == pytest.approx(first.cvar95_mm, rel=0.01)
    assert check.bias_mm == pytest.approx(first.bias_mm, abs=5 * max(first.std_mm) / 512)
    low, high = check.exceedance.interval
    assert low - 0.01 < first.exceedance_probability < high + 0.01


def test_one_seed_is_one_answer_whatever_the_threads():
    design = load_design(DEMO)
    one, two = (verify(design, trials=50_000, seed=3, threads=n) for n in (1, 2))
    assert asdict(one) == asdict(two)
    assert verify(design, trials=50_000, seed=4).targets[0].p95_mm != one.targets[0].p95_mm


def test_adaptive_run_goes_on_until_the_requirement_is_decided():
    """A limit 0.4 % above P95 is open at the precision asked for and decided by more trials."""
    value = score(cube8_system()).targets[0].p95_mm
    system = cube8_system(requirements=(requirement(1.006 * value),))
    loose = verify(cube8_system(), precision=0.01, seed=8)
    decided = verify(system, precision=0.01, seed=8)
    assert decided.trials > loose.trials
    assert decided.verdict.status == "pass"
    open_ = verify(cube8_system(requirements=(requirement(value),)), precision=0.01, seed=8, max_trials=2**16)
    assert open_.verdict.status == "inconclusive"
    assert "undecided" in open_.stopping


def test_too_few_trials_leave_a_close_limit_open():
    value = score(cube8_system()).targets[0].p95_mm
    near = cube8_system(requirements=(requirement(1.002 * value),))
    assert verify(near, trials=2000, seed=1).verdict.status == "inconclusive"
    far = cube8_system(requirements=(requirement(0.5 * value),))
    assert verify(far, trials=2000, seed=1).verdict.status == "fail"


@pytest.mark.parametrize(
    ("fiducials", "aim", "noise", "quantile"),
    [
        (cube_fiducials(5.0, (0, 0, 0)), (0, 0, 60), 3.0, 0.95),
        (np.random.default_rng(7).uniform(-5, 5, (7, 3)), (0, 0, 30), 1.0, 0.95),
    ],
)
def test_where_first_order_breaks_the_check_says_which_way(fiducials, aim, noise, quantile):
    """published: first order is optimistic for a small cluster with the target outside, and for few fiducials."""
    system = system_of(fiducials, views=with_noise(noise), targets=(target(aim),))
    trust = score(system).validity
    assert trust.status in ("good to 20 %", "not valid")
    assert "optimistic" in trust.statement
    result = verify(system, trials=40_000, seed=2)
    assert result.first_order_ratio < 0.97
    assert any(f.rule == "first-order-gap" and "too small" in f.message for f in result.verdict.findings)
    assert result.targets[0].flagged_trials > 0


@pytest.mark.parametrize("bias_mm", [0.0, 1e-4])
@pytest.mark.parametrize("aim", [(-40, 30, 70), (40, 30, 70)])
def test_the_worse_of_two_opposite_ends_is_reported_whichever_it_is(aim, bias_mm):
    """closed form: with hardly any noise P95 is the displacement that the rotation matrix at the worst end gives.

    To first order opposite ends agree without a bias (and within 1e-5 with one of 0.1 um); here one of them is 0.65 %
    worse, and which one it is changes with the side on which the target lies."""
    half = np.array([0.05, 0.04, 0.03, 0.5])
    pivot, aimed = np.array([0.0, 0.0, -145.0]), np.array(aim, dtype=float)
    second = mount("connector_flange", pivot, bias=(0, 0, 0, bias_mm, 0, 0), half_width=(*half, 0, 0), law=Law.BOUNDED)

    def displacement(ends):
        rx, ry, rz, tx = half * ends
        moved = Rotation.from_euler("XYZ", (rx, ry, rz)).apply(aimed - pivot) + pivot + (tx + bias_mm, 0, 0)
        return np.linalg.norm(moved - aimed)

    sizes = {ends: displacement(ends) for ends in itertools.product((1, -1), repeat=4)}
    worst = max(sizes, key=sizes.get)
    assert sizes[tuple(-end for end in worst)] < 0.995 * sizes[worst]
    limit = 0.998 * sizes[worst]
    system = cube8_system(
        views=with_noise(0.01), targets=(target(aim),), connector_flange=second,
        requirements=(requirement(limit, risk="per_unit", min_yield=0.5), requirement(limit)),
    )  # fmt: skip
    check = verify(system, trials=4000, seed=9)
    assert check.targets[0].p95_mm == pytest.approx(sizes[worst], rel=5e-4)
    assert np.linalg.norm(check.targets[0].bias_mm) == pytest.approx(sizes[worst], rel=5e-4)
    assert [one.status for one in check.verdict.checks] == ["fail", "fail"]
    assert "vertices of the bounded components" in check.stopping


def test_bounded_components_by_radial_and_by_plain_sampling_agree():
    """sampled: two 95 % intervals fail to overlap in fewer than 1 of 150 seeds."""
    ends = mount("connector_flange", (0, 0, -145), half_width=[0.03, 0.02, 0.01, 0.1, 0.1, 0.1], law=Law.BOUNDED)
    system = cube8_system(connector_flange=ends)
    plain, ray = verify(system, trials=40_000, seed=5), verify(system, trials=1000, seed=6, method="radial")
    assert ray.targets[0].p95_interval_mm[0] < plain.targets[0].p95_interval_mm[1]
    assert plain.targets[0].p95_interval_mm[0] < ray.targets[0].p95_interval_mm[1]
    assert "4 were run" in plain.stopping
    assert "4 were run" in ray.stopping


def test_a_radial_check_draws_the_plain_trials_that_were_asked_for():
    system = cube8_system(requirements=(requirement(0.3),))
    for trials in (300, 40_000):
        check = verify(system, trials=trials, seed=6, method="radial")
        assert check.trials == trials
        assert check.reprojection.trials == min(trials, 16_384)
        assert f"from {trials} plain trials" in check.stopping
    plain = verify(system, trials=40_000, seed=6)
    assert check.targets[0].std_mm == plain.targets[0].std_mm
    assert check.targets[0].cvar95_mm == plain.targets[0].cvar95_mm
    assert verify(system, seed=6, method="radial").trials == 32_768


def test_a_radial_check_reaches_the_precision_that_was_asked_for():
    """sampled: two 95 % intervals fail to overlap in fewer than 1 of 150 seeds."""
    system = cube8_system()
    few, many = (verify(system, precision=precision, seed=6, method="radial") for precision in (0.05, 1e-4))
    assert few.precision_reached > 1e-4 >= many.precision_reached
    assert (few.precision_requested, many.precision_requested) == (0.05, 1e-4)
    a, b = few.targets[0].p95_interval_mm, many.targets[0].p95_interval_mm
    assert a[0] < b[1]
    assert b[0] < a[1]
    assert verify(system, seed=6, method="radial").precision_requested is None


def test_per_unit_yield_by_nested_sampling_agrees_with_the_score():
    """sampled: 2048 units; 4 standard errors (1 in 16,000)."""
    installed = mount("connector_flange", (0, 0, -145), half_width=[0.002] * 3 + [0.05] * 3)
    system = cube8_system(connector_flange=installed, views=with_noise(1.0))
    middle = score(system).targets[0].p95_mm * 0.85
    system = replace(system, requirements=(requirement(middle, risk="per_unit", min_yield=0.5),))
    expected = score(system).verdict.checks[0].yield_fraction
    check = verify(system, trials=4000, seed=12).verdict.checks[0]
    assert 0.1 < check.yield_fraction < 0.99
    error = np.sqrt(expected * (1 - expected) / 2048)
    assert check.yield_fraction == pytest.approx(expected, abs=4 * error + 0.01)


def test_reprojection_is_the_residual_a_dlt_leaves():
    """closed form: 2N observations and 11 parameters a view leave sigma sqrt(2 (2N - 11) / 2N) in RMS distance."""
    result = verify(cube8_system(), trials=20_000, seed=1).reprojection
    expected = 0.5 * np.sqrt(2 * (16 - 11) / 16)
    assert result.mean_px == pytest.approx(expected, rel=0.04)  # mean of a root: below the root of the mean by 2 %
    assert result.p95_px > result.mean_px


def test_trials_and_precision_exclude_each_other():
    with pytest.raises(DesignError):
        verify(cube8_system(), trials=1000, precision=0.01)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda p: p.stem)
def test_every_example_verifies(path):
    result = verify(load_design(path), trials=20_000, seed=1)
    for estimate in result.targets:
        low, high = estimate.p95_interval_mm
        assert 0 < low <= estimate.p95_mm <= high <= estimate.worst_mm
        assert estimate.cvar95_mm > estimate.p95_mm
    assert result.provenance.design_sha256
