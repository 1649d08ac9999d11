"""Simulation of every estimator: the chain as it stands against a plain one, first order, and OpenCV's figures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_chain import run
from scenes import cube_fiducials, random_system, system_of, with_intrinsics, with_noise
from tailstack.errors import NotConvergedError
from tailstack.montecarlo.chain import draw, evaluate, run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.radial import gains_in_plan_order
from tailstack.propagation.linear import linearise
from tailstack.system import Estimator, Law, System, Triangulation
from tailstack.verification import verify

ORACLE = json.loads((Path(__file__).parents[1] / "data" / "oracles" / "estimators.json").read_text())


def doubtful(system: System, law: Law = Law.NORMAL) -> System:
    """The system with views that know their intrinsics to 1 % and 5 px and err by as much."""
    return with_intrinsics(system, [0.01, 5.0, 5.0], [0.002, 1.0, -1.0], law, prior=(0.01, 5.0))


@pytest.mark.parametrize("form", list(Triangulation))
@pytest.mark.parametrize("estimator", list(Estimator))
def test_a_trial_is_the_chain_of_its_deviates(estimator, form):
    """independent: one trial at a time, each contributor by its name."""
    system = doubtful(random_system(np.random.default_rng(2), fiducials=8, estimator=estimator, triangulation=form))
    plan = compile_plan(system)
    z = draw(plan, 5, np.arange(3))
    found = evaluate(plan, z)
    assert np.array_equal(found, np.moveaxis(run_indices(plan, 5, 0, 3).errors, -1, 0))
    named = {block.contributor: block for block in linearise(system, system.targets[0]).blocks}
    for trial in range(3):
        inputs = {}
        for place in plan.blocks:
            block, values = named[place.name], z[trial, place.start : place.stop]
            values = values[: len(block.laws)] / plan.standard_std[place.start : place.start + len(block.laws)]
            inputs[place.name] = values * block.std
        expected = run(system, system.targets[0], inputs)
        np.testing.assert_allclose(found[trial, 0], [expected["tcp"], expected["localisation"]], rtol=0, atol=1e-6)


def test_columns_of_assumed_intrinsics_come_last_and_leave_the_others_as_they_were():
    """The same seed draws the same noise and tolerances, whatever the estimator believes."""
    base = random_system(np.random.default_rng(2), fiducials=8)
    plans = [compile_plan(doubtful(replace(base, estimator=each))) for each in (Estimator.DLT, Estimator.POSE)]
    first, second = (draw(plan, 9, np.arange(16)) for plan in plans)
    assert second.shape[1] == first.shape[1] + 6
    np.testing.assert_array_equal(first, second[:, : first.shape[1]])
    assert [block.name for block in plans[1].blocks[-2:]] == ["assumed_intrinsics:view0", "assumed_intrinsics:view1"]


@pytest.mark.parametrize("estimator", [Estimator.POSE, Estimator.POSE_WITH_PRIOR, Estimator.REPROJECTION])
def test_first_order_is_the_simulation_where_noise_is_small(estimator):
    """sampled: both in the same 4000 deviates, so that chance cancels; uniform laws of the intrinsics."""
    system = doubtful(random_system(np.random.default_rng(12), fiducials=10, views=3, estimator=estimator), Law.UNIFORM)
    plan, model = compile_plan(system), linearise(system, system.targets[0])
    z = draw(plan, 3, np.arange(4000))
    simulated = np.linalg.norm(evaluate(plan, z)[:, 0, 0], axis=1)
    linear = np.linalg.norm(z @ gains_in_plan_order(plan, model.blocks, 0, "tcp").T + model.tcp_bias_mm, axis=1)
    assert np.quantile(simulated, 0.95) / np.quantile(linear, 0.95) == pytest.approx(1, abs=0.005)


def test_a_check_of_a_pose_says_what_ran_and_meets_the_published_interval():
    """sampled: 8000 trials of OpenCV's solvePnPRefineLM, two-sided 95 %."""
    published, width = ORACLE["monte_carlo_pose_p95_mm"]["50"]
    checked = verify(system_of(cube_fiducials(50), views=with_noise(0.5), estimator=Estimator.POSE), trials=16384)
    low, high = checked.targets[0].p95_interval_mm
    assert low < published + width
    assert high > published - width
    assert "Gauss-Newton for the pose, eight lanes" in checked.engine
    assert checked.targets[0].flagged_trials == 0


@pytest.mark.long
def test_trials_without_an_estimate_are_refused_and_counted():
    """Noise as large as the structure's image leaves poses that no step settles."""
    far = system_of(cube_fiducials(2), views=with_noise(60.0), estimator=Estimator.POSE)
    with pytest.raises(NotConvergedError, match="of 64 trials the estimate by pose does not converge"):
        run_indices(compile_plan(far), 1, 0, 64)
