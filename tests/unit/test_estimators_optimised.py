"""Placement under each estimator: the programme's covariance is the score's, and it finds other layouts than DLT."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimise_scenes import oracle_problem
from scenes import read_only, with_intrinsics
from tailstack.contributors import error_law
from tailstack.optimisation import PlacementProblem, solve_placement
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.terms import estimator_of, image_parts_at, terms_of
from tailstack.propagation.linear import linearise
from tailstack.system import Estimator, Triangulation, Way
from tailstack.tail.declared import law_quantile


def problem_of(estimator: Estimator, form: Triangulation = Triangulation.NORMALISED) -> PlacementProblem:
    problem = oracle_problem(8, 0.5)
    views = tuple(replace(v, fiducial_noise_px=0.5 + 0.3 * k) for k, v in enumerate(problem.system.views))
    system = replace(problem.system, estimator=estimator, triangulation=form, views=views)
    system = with_intrinsics(system, [0.01, 5.0, 5.0], prior=(0.01, 5.0))
    return replace(problem, system=system)


@pytest.mark.parametrize("form", [Triangulation.NORMALISED, Triangulation.WEIGHTED, Triangulation.REPROJECTION])
@pytest.mark.parametrize("estimator", list(Estimator))
def test_symbols_have_the_covariances_of_the_score(estimator, form):
    """independent: the compiled linear model at the same layout; and the slopes of the expression are its own."""
    import casadi as ca

    problem = problem_of(estimator, form)
    system = replace(problem.system, manufacturing_half_width_mm=read_only(np.full((8, 3), 0.05)))
    problem = replace(problem, system=system)
    (demand,) = problem.demands
    term, imaging = terms_of(problem, demand), estimator_of(problem.system)
    x = ca.SX.sym("x", 24)
    points = np.array([x[k] for k in range(24)], dtype=object).reshape(8, 3)
    laid, told = replace(system, fiducials_mm=points), plain(imaging.assumed_shift_mm)
    parts = image_parts_at(imaging, term, laid, plain(imaging.projections), told, plain(term.reconstructed.base))
    both = ca.Function("both", [x], [ca.vertcat(*parts[0].ravel(), *parts[1].ravel())])
    here = both(system.fiducials_mm.ravel()).full().reshape(2, 3, 3)
    expected = image_parts(linearise(system, demand.target), demand.requirement.error)
    for found, part in zip(here, expected[:2], strict=True):
        np.testing.assert_allclose(found, part, rtol=0, atol=1e-9 * np.abs(expected[0]).max())
    slope = ca.Function("slope", [x], [ca.jacobian(both(x)[0], x)])(system.fiducials_mm.ravel()).full().reshape(8, 3)
    moved = [system.fiducials_mm.copy() for _ in range(2)]
    for sign, layout in zip((1, -1), moved, strict=True):
        layout[2, 1] += sign * 1e-3
    ends = [image_parts(linearise(replace(system, fiducials_mm=m), demand.target), "tcp")[0][0, 0] for m in moved]
    assert slope[2, 1] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-5, abs=1e-9)


@pytest.mark.long
def test_a_layout_placed_for_the_pose_is_better_for_it_and_its_quantile_is_the_score_s():
    """independent: the exact law of the linear model at the layouts that both estimators ask for."""
    pose, dlt = (problem_of(estimator) for estimator in (Estimator.POSE, Estimator.DLT))
    for_pose, for_dlt = (solve_placement(problem, starts=2) for problem in (pose, dlt))
    assert for_pose.worst_ratio == pytest.approx(1.0, rel=1e-4)
    assert for_pose.cost < for_dlt.cost  # known intrinsics leave more to the tolerances

    def p95_mm(solution) -> float:
        system = replace(pose.system, fiducials_mm=solution.choice.fiducials_mm)
        model = linearise(system, system.targets[0])
        kept = tuple(block for block in model.blocks if block.effect.way is Way.IMAGES)
        return law_quantile(error_law(replace(model, blocks=kept), "tcp", 0.95).law, 0.95).quantile_mm

    assert p95_mm(for_pose) <= p95_mm(for_dlt) * 1.001
