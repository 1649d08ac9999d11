"""Placement (IPOPT, exact law) and allocation (cvxpy, convex bound) on the same fixed layout and continuous budgets."""

from __future__ import annotations

import numpy as np
import pytest

from optimise_scenes import at_prices, fixed_layout, image_covariance_by_score, oracle_problem, silent_problem
from scenes import cube_fiducials
from tailstack.geometry.arrays import Array
from tailstack.optimisation import PlacementProblem, solve_placement
from tailstack.optimisation.allocation import allocate, gaussian_bracket
from tailstack.optimisation.prices import Price
from tailstack.optimisation.terms import free_laws, terms_of
from tailstack.system import Law

CURVES = {
    "reciprocal": Price("power", 1.0),
    "reciprocal square": Price("power", 1e-3, 2.0),
    "exponential": Price("exponential", 800.0, scale=float(np.deg2rad(0.1))),
}


def _arguments(problem: PlacementProblem) -> tuple[Array, Array, list[Price], Array, float]:
    """Noise, gains, prices, standard deviation per half-width and limit, as the allocation takes them."""
    (demand,) = problem.demands
    noise = image_covariance_by_score(problem, problem.system.fiducials_mm)
    per = np.array([value for _, value in free_laws(problem)])
    prices = [free.price for free in problem.half_widths]
    return noise, terms_of(problem, demand).free_gain.T, prices, per, demand.requirement.limit_mm


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("limit_mm", [0.5, 1.0])
def test_the_exact_optimum_lies_in_the_convex_bracket(name: str, limit_mm: float) -> None:
    """independent: two solvers, two formulations; normal laws and no bias, where the bracket is one."""
    problem = fixed_layout(oracle_problem(8, limit_mm, law=Law.NORMAL), cube_fiducials())
    problem = at_prices(problem, *[CURVES[name]] * 6)
    arguments = _arguments(problem)
    low, high = gaussian_bracket(*arguments, lower=problem.lower, upper=problem.upper)
    solution = solve_placement(problem)
    assert low * (1 - 1e-6) <= solution.cost <= high * (1 + 1e-6)
    assert high / low < 1.05  # the bracket says something
    convex = allocate(*arguments, lower=problem.lower, upper=problem.upper)
    levers = np.linalg.norm(arguments[1], axis=1) > 1  # without one, an exponential cost is flat out to the bound
    np.testing.assert_allclose(solution.choice.half_width[levers], convex.half_width[levers], rtol=0.05)


@pytest.mark.parametrize("name", CURVES)
def test_both_are_the_same_where_the_bound_is_exact(name: str) -> None:
    """closed form: all tolerances act along one axis and nothing else does, so the Frobenius bound is the quantile."""
    problem = silent_problem(0.5, ("rx",))
    problem = at_prices(problem, *[CURVES[name]] * len(problem.half_widths))
    convex = allocate(*_arguments(problem), lower=problem.lower, upper=problem.upper)
    solution = solve_placement(problem)
    assert solution.cost == pytest.approx(convex.cost, rel=2e-5)
    np.testing.assert_allclose(solution.choice.half_width, convex.half_width, rtol=1e-4)
