"""The validity number of every estimator: what is called good to 1 % is, in the same deviates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenes import cube_fiducials, random_system, system_of, with_noise
from tailstack.montecarlo import compile_plan, draw, evaluate
from tailstack.montecarlo.radial import gains_in_plan_order
from tailstack.propagation.linear import linearise, linearise_all
from tailstack.scoring import score, trust_of
from tailstack.system import Estimator, Triangulation


@pytest.mark.parametrize("estimator", [Estimator.POSE, Estimator.POSE_WITH_PRIOR, Estimator.REPROJECTION])
def test_what_is_called_good_to_one_per_cent_is_within_three_thousandths(estimator):
    """sampled: 2000 trials of four layouts with two to four views, oblique and biased, first order and the chain in the
    same deviates, so that chance cancels."""
    for seed, views in ((21, 2), (22, 3), (23, 4), (24, 2)):
        system = random_system(np.random.default_rng(seed), fiducials=9 + seed % 3, views=views, estimator=estimator)
        quiet: dict[str, Any] = {"fiducial_noise_px": 0.15, "target_noise_px": 0.15, "intrinsics_prior": (0.01, 5.0)}
        known = tuple(replace(view, **quiet) for view in system.views)
        system = replace(system, views=known)
        assert trust_of(system, linearise_all(system)).status == "good to 1 %"
        plan, model = compile_plan(system), linearise(system, system.targets[0])
        z = draw(plan, 3, np.arange(2000))
        simulated = np.linalg.norm(evaluate(plan, z)[:, 0, 0], axis=1)
        linear = np.linalg.norm(z @ gains_in_plan_order(plan, model.blocks, 0, "tcp").T + model.tcp_bias_mm, axis=1)
        assert np.quantile(simulated, 0.95) / np.quantile(linear, 0.95) == pytest.approx(1, abs=0.003)


def test_a_class_that_was_not_sampled_is_not_called_valid():
    cube = system_of(cube_fiducials(50), views=with_noise(0.5), estimator=Estimator.POSE)
    assert score(cube).validity.calibrated
    for other in (Triangulation.WEIGHTED, Triangulation.PUBLISHED):
        trust = score(replace(cube, triangulation=other)).validity
        assert (trust.status, trust.calibrated) == ("not valid", False)
        assert f"{other} triangulation with the estimator pose" in trust.statement
    four = replace(system_of(cube_fiducials(50)[[0, 3, 5, 6]], views=with_noise(0.5)), estimator=Estimator.POSE)
    assert score(four).validity.calibrated
