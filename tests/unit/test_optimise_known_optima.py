"""Optima that are known beforehand: by hand, by a scan, from their multipliers; and the best costs known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize, minimize_scalar

from optimise_scenes import (
    BOX_MM,
    NORMAL_P95,
    ORACLE,
    ROTATIONS,
    at_prices,
    first_interface_only,
    fixed_layout,
    image_covariance_by_score,
    oracle_levers_mm,
    oracle_p95_mm,
    oracle_problem,
    pivot_in,
    requirement,
    score_mm,
    silent_problem,
    solve_placement,
)
from plain_data import read_cases
from scenes import cube_fiducials, mount, target, with_noise
from tailstack.contributors import columns_of, declared_law
from tailstack.geometry.arrays import Array
from tailstack.optimisation import FreeFiducial, PlacementProblem
from tailstack.optimisation.certificate import bound_cost, name_binding
from tailstack.optimisation.exact_law import closed_form_mm, evaluate_demand
from tailstack.optimisation.grades import Optimum
from tailstack.optimisation.placement import PlacementSolution
from tailstack.optimisation.prices import Price, reciprocal
from tailstack.optimisation.problem import present_choice
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, KeepOut
from tailstack.optimisation.search import objective_for_people, search
from tailstack.optimisation.shadow_prices import price_bounds
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.terms import ImageParts, image_parts_at, terms_of
from tailstack.propagation.linear import linearise
from tailstack.system import Law
from tailstack.tail.declared import law_gradient, law_quantile

LEVERS_MM = np.array([165.0, 215.0])


@pytest.mark.parametrize(
    "prices",
    [
        (Price("exponential", 1.0, scale=6e-4), Price("exponential", 2.0, scale=4e-4)),
        (Price("exponential", 3.0, scale=8e-4), reciprocal(5e-4)),
        (Price("power", 2e-7, exponent=2.0), reciprocal(4e-4)),
        (reciprocal(), reciprocal(3.0)),
        (Price("power", 1e-9, exponent=3.5), Price("power", 3e-9, exponent=3.5)),
    ],
)
def test_two_tolerances_on_any_curves(prices: tuple[Price, Price]) -> None:
    """scan: h1 165 = R cos a, h2 215 = R sin a, least cost over the angle to 1e-12."""

    def cost(price: Price, h: float) -> float:
        if price.curve == "exponential":
            return float(price.weight * np.exp(-h / price.scale))
        return float(price.weight / h**price.exponent)

    def widths(angle: float) -> Array:
        return np.asarray(0.5 / NORMAL_P95 * np.array([np.cos(angle), np.sin(angle)]) / LEVERS_MM)

    def total(angle: float) -> float:
        return sum(cost(price, float(h)) for price, h in zip(prices, widths(angle), strict=True))

    best = minimize_scalar(total, bounds=(1e-3, np.pi / 2 - 1e-3), method="bounded", options={"xatol": 1e-10})
    problem = at_prices(silent_problem(0.5, ("rx",)), *prices)
    solution = solve_placement(problem)
    np.testing.assert_allclose(solution.choice.half_width, widths(best.x), rtol=1e-4)
    assert solution.cost == pytest.approx(best.fun, rel=1e-5)
    assert 1 - 1e-5 <= solution.worst_ratio <= 1
    bound = bound_cost(search(problem, starts=1), Optimum.of(solution), solution).lower_bound
    below = 0.02 if any(price.curve == "exponential" for price in prices) else 1e-4
    assert (1 - below) * best.fun <= bound <= best.fun


def test_bounded_rotations_are_held_at_their_worst_ends() -> None:
    """closed form: without noise |sum of signed levers| at the worst vertex is the limit: h1 165 + h2 215 = limit."""
    problem = silent_problem(0.5, ("rx",), law=Law.BOUNDED)
    # A trace of noise gives the quantile a law to be the quantile of.
    problem = replace(problem, system=replace(problem.system, views=with_noise(1e-3)))
    solution = solve_placement(problem)
    # least sum of 1/h with sum lever h = limit: h ~ lever^(-1/2)
    expected = LEVERS_MM**-0.5 * 0.5 / (LEVERS_MM**0.5).sum()
    np.testing.assert_allclose(solution.choice.half_width, expected, rtol=5e-3)
    assert solution.worst_ratio <= 1


@pytest.mark.long("uniform")
@pytest.mark.parametrize("law", [Law.NORMAL, Law.UNIFORM])
def test_the_common_factor_is_limit_over_present_quantile(law: Law) -> None:
    """closed form: without noise and bias the quantile is homogeneous in the half-widths, whatever the laws."""
    problem = silent_problem(0.5, ROTATIONS, law=law, objective="scaling")
    here = present_choice(problem)
    (quantile,) = score_mm(problem, here)
    solution = solve_placement(problem)
    np.testing.assert_allclose(solution.choice.half_width, here.half_width * 0.5 / quantile, rtol=1e-5)
    # The smallest maximum stops all of them.
    factor = 0.4 / quantile
    stopped = replace(problem.half_widths[1], maximum=factor * float(here.half_width[1]))
    held = replace(problem, half_widths=(problem.half_widths[0], stopped, *problem.half_widths[2:]))
    np.testing.assert_allclose(solve_placement(held).choice.half_width, factor * here.half_width, rtol=1e-6)


def test_least_quantile_within_a_cost_limit() -> None:
    """closed form: least 165^2 h1^2 + 215^2 h2^2 with 1/h1 + 1/h2 = C has h ~ lever^(-2/3)."""
    problem = silent_problem(0.5, ("rx",), objective="quantile", cost_limit=900.0)
    solution = solve_placement(problem)
    shape = LEVERS_MM ** (-2 / 3)
    h = shape * (1 / shape).sum() / 900
    np.testing.assert_allclose(solution.choice.half_width, h, rtol=1e-4)
    assert solution.worst_ratio * 0.5 == pytest.approx(NORMAL_P95 * np.linalg.norm(LEVERS_MM * h), rel=2e-5)
    assert 900 * (1 - 2e-5) <= solution.cost <= 900
    prices = {price.name: price for price in price_bounds(
        solution.program, solution.iterate.point, solution.worst_ratio * 0.5)}  # fmt: skip
    # the quantile goes as 1 / C
    assert prices["cost_limit"].cost_per_unit == pytest.approx(-solution.worst_ratio * 0.5 / 900, rel=1e-4)


@pytest.mark.parametrize("law", [Law.UNIFORM, Law.NORMAL, Law.TRIANGULAR])
def test_an_optimum_built_from_its_multiplier_is_found(law: Law) -> None:
    """primal-dual pair: at chosen half-widths the weights are such that w_k / h_k^2 = lambda dr/dh_k of the exact law.

    With the limit the quantile there, the first-order conditions hold at the chosen half-widths by construction.
    """
    half = np.deg2rad([0.05, 0.09, 0.06, 0.04, 0.07, 0.03])
    problem = fixed_layout(oracle_problem(8, 0.5, law), cube_fiducials())
    system = replace(
        problem.system,
        targets=(target((40.0, -25.0, 60.0)),),
        structure_connector=mount("structure_connector", (0, 0, -95), half_width=[*half[:3], 0, 0, 0], law=law),
        connector_flange=mount("connector_flange", (0, 0, -145), half_width=[*half[3:], 0, 0, 0], law=law),
    )
    model = linearise(system, system.targets[0])
    declared = declared_law(model, "tcp", model.bias_mm("tcp"))
    sources = [(block.contributor, j) for block in model.blocks for j in range(len(block.laws))]
    where = {sources[j]: column for column, j in enumerate(np.flatnonzero(columns_of(model, "tcp").wide))}
    total = law_quantile(declared, 0.95)
    slopes = law_gradient(declared, total, fine=False)
    by_log = []  # dr / dlog h
    for block in model.blocks:
        if block.contributor in ("structure_connector", "connector_flange"):
            for j in range(3):
                g = block.gain("tcp")[:, j] * block.std[j]
                column = where.get((block.contributor, j))
                gaussian = 2 * float(g @ slopes.by_covariance @ g)
                by_log.append(gaussian if column is None else float(slopes.by_log_column[column]))
    multiplier = 1234.5
    weights = multiplier * half * np.array(by_log)
    problem = replace(problem, system=system, requirements=(requirement(total.quantile_mm),))
    solution = solve_placement(at_prices(problem, *(reciprocal(float(w)) for w in weights)))
    np.testing.assert_allclose(solution.choice.half_width, half, rtol=1e-4)
    (price, *_) = price_bounds(solution.program, solution.iterate.point, solution.cost)
    assert price.cost_per_unit == pytest.approx(-multiplier, rel=1e-4)


def test_a_free_pivot_goes_to_the_bound_nearest_the_target() -> None:
    """closed form: one rotation about a pivot on the z axis has the lever |70 - z|."""
    problem = first_interface_only(silent_problem(0.5, ("rx",)))
    for low, high, lever in ((-140.0, -60.0, 130.0), (120.0, 190.0, 50.0)):
        freed = replace(problem, pivots=(pivot_in("structure_connector", (0, 0, low), (0, 0, high)),))
        solution = solve_placement(freed)
        assert abs(solution.choice.pivots_mm[0, 2] - 70) == pytest.approx(lever, rel=1e-7)
        assert solution.choice.half_width[0] == pytest.approx(0.5 / (NORMAL_P95 * lever), rel=1e-5)
        prices = {price.name: price for price in price_bounds(solution.program, solution.iterate.point, solution.cost)}
        (bound,) = [price for name, price in prices.items() if "pivot" in name]
        # cost = 1.96 lever / limit: a millimetre of lever is 1.96 / limit of it
        assert bound.cost_per_unit == pytest.approx(-NORMAL_P95 / 0.5, rel=1e-4)


def test_a_pivot_that_can_reach_the_target_goes_there() -> None:
    """closed form: rotations about the target itself do not move it; what is left is the quantile of the noise."""
    problem = first_interface_only(fixed_layout(oracle_problem(8, 0.5), cube_fiducials()))
    wide = mount(
        "structure_connector", (0.0, 0.0, -95.0), half_width=(np.deg2rad(0.5),) * 3 + (0.0,) * 3, law=Law.UNIFORM
    )
    problem = replace(
        problem,
        system=replace(problem.system, structure_connector=wide),
        half_widths=(),
        objective="quantile",
        pivots=(pivot_in("structure_connector", (-40, -30, -95), (30, 40, 120)),),
    )
    solution = solve_placement(problem)
    np.testing.assert_allclose(solution.choice.pivots_mm[0], [0, 0, 70], atol=0.05)
    still = replace(
        problem, system=replace(problem.system, structure_connector=mount("structure_connector")), pivots=()
    )
    (noise,) = score_mm(still, present_choice(still))
    assert solution.worst_ratio * 0.5 == pytest.approx(noise, rel=1e-6)


# One fiducial free among seven corners of a cube: its region is a line or a surface that can be scanned.


def _one_free(region: BoxRegion | Ball | Cylinder, **changes: object) -> PlacementProblem:
    """Least P95 without anything else free; nothing but the region holds the eighth fiducial."""
    problem = oracle_problem(
        8, 1.0, half_widths=(), objective="quantile", places=(FreeFiducial((7,), region),), min_spacing_mm=0.0,
        min_projected_spacing_px=0.0, image_margin_px=0.0, target_clearance_px=0.0,
    )  # fmt: skip
    system = replace(problem.system, fiducials_mm=cube_fiducials(half_mm=25.0))
    return replace(problem, system=system, **changes)  # type: ignore[arg-type]


def _quantile_at(problem: PlacementProblem, point: Array) -> float:
    layout = problem.system.fiducials_mm.copy()
    layout[7] = point
    model = linearise(replace(problem.system, fiducials_mm=layout), problem.system.targets[0])
    return float(law_quantile(declared_law(model, "tcp", model.bias_mm("tcp")), 0.95).quantile_mm)


def _along(problem: PlacementProblem, curve: Callable[[float], Array], low: float, high: float) -> tuple[Array, float]:
    """Where the exact quantile is least along a curve: a grid, then Brent about its best point."""
    grid = np.linspace(low, high, 41)
    values = [_quantile_at(problem, curve(float(t))) for t in grid]
    k = int(np.argmin(values))
    best = minimize_scalar(
        lambda t: _quantile_at(problem, curve(t)), bounds=(grid[max(k - 1, 0)], grid[min(k + 1, 40)]), method="bounded",
        options={"xatol": 1e-6},
    )  # fmt: skip
    return curve(float(best.x)), float(best.fun)


def _assert_found(solution: PlacementSolution, point: Array, quantile: float, atol_mm: float) -> None:
    assert solution.worst_ratio == pytest.approx(quantile, rel=1e-6)
    np.testing.assert_allclose(solution.choice.fiducials_mm[7], point, atol=atol_mm)


@pytest.mark.long
def test_one_fiducial_on_a_line() -> None:
    """scan: the exact quantile along the segment, least inside it; and at its end where it falls throughout."""
    for low, high, line, (a, b) in (
        ((-60, 10, 60), (60, 10, 60), lambda t: np.array([t, 10.0, 60.0]), (-60, 60)),
        ((-80, 0, 0), (80, 0, 0), lambda t: np.array([t, 0.0, 0.0]), (-80, 80)),
        ((20, 20, 0), (20, 20, 80), lambda t: np.array([20.0, 20.0, t]), (0, 80)),
    ):
        problem = _one_free(BoxRegion(np.array(low, dtype=float), np.array(high, dtype=float)))
        point, quantile = _along(problem, line, a, b)
        _assert_found(solve_placement(problem, starts=2), point, quantile, 0.05)


def test_one_fiducial_on_a_ring() -> None:
    """scan: the exact quantile around a circle, which has two local optima."""
    problem = _one_free(Cylinder(np.array([0.0, 0.0, 60.0]), np.array([0.0, 0.0, 1.0]), 0.0, 30.0, 30.0))
    point, quantile = _along(problem, lambda t: np.array([30 * np.cos(t), 30 * np.sin(t), 60.0]), 0, 2 * np.pi)
    _assert_found(solve_placement(problem, starts=6), point, quantile, 0.05)


@pytest.mark.long
@pytest.mark.parametrize("inner", [0.0, 12.0, 30.0])
def test_one_fiducial_in_a_ball_or_shell_goes_to_its_surface(inner: float) -> None:
    """brute force: a grid over the outer sphere with Nelder and Mead's simplex; no point inside is better."""
    centre = np.array([5.0, -10.0, 10.0])
    problem = _one_free(Ball(centre, 30.0, inner))

    def on_sphere(angles: Array) -> Array:
        polar, around = angles
        return np.asarray(centre + 30 * np.array([
            np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)
        ]))  # fmt: skip

    grid = [np.array([u, v]) for u in np.linspace(0.1, 3.0, 12) for v in np.linspace(0, 6.0, 12)]
    start = min(grid, key=lambda angles: _quantile_at(problem, on_sphere(angles)))
    best = minimize(lambda angles: _quantile_at(problem, on_sphere(angles)), start, method="Nelder-Mead", tol=1e-7)
    solution = solve_placement(problem, starts=3)
    _assert_found(solution, on_sphere(best.x), float(best.fun), 0.05)
    assert np.linalg.norm(solution.choice.fiducials_mm[7] - centre) == pytest.approx(30, abs=1e-5)
    rng = np.random.default_rng(0)
    inside = rng.normal(size=(200, 3))
    inside *= rng.uniform(inner / 30, 1, (200, 1)) * 30 / np.linalg.norm(inside, axis=1, keepdims=True)
    assert min(_quantile_at(problem, centre + offset) for offset in inside) > solution.worst_ratio


def test_one_fiducial_kept_out_of_its_best_place_stays_at_the_border() -> None:
    """scan: along a segment through a forbidden ball, the better of its two crossings (12 mm and 3 mm of clearance)."""
    region = BoxRegion(np.array([-60.0, 10, 60]), np.array([60.0, 10, 60]))
    zone = KeepOut("clamp", Ball(np.array([0.0, 10.0, 60.0]), 12.0), 3.0)
    problem = _one_free(region, keep_out=(zone,))
    solution = solve_placement(problem, starts=4)
    ends = [np.array([t, 10.0, 60.0]) for t in (-15.0, 15.0)]
    best = min(ends, key=lambda point: _quantile_at(problem, point))
    _assert_found(solution, best, _quantile_at(problem, best), 1e-4)
    assert "F8 outside keep-out zone 'clamp'" in name_binding(
        solution.program, solution.iterate.point, solution.iterate.parameters
    )  # fmt: skip


def test_the_recorded_optimum_is_reproduced() -> None:
    """independent: noise covariance, quantile and cost at the oracle's own positions and half-widths."""
    problem = oracle_problem()
    layout, tau = np.array(ORACLE["X"]), np.deg2rad(ORACLE["tau_deg"])
    term, estimator = terms_of(problem, problem.demands[0]), problem.estimation
    laid, told = replace(problem.system, fiducials_mm=plain(layout)), plain(estimator.assumed_shift_mm)
    parts = image_parts_at(estimator, term, laid, plain(estimator.projections), told, plain(term.reconstructed_mm))
    images = ImageParts(*(part.astype(float) for part in parts))
    noise, made = images.noise, images.made
    np.testing.assert_allclose(noise, ORACLE["Sigma_noise"], rtol=1e-9, atol=1e-15)
    assert not made.any()
    closed = closed_form_mm(term, images, tau, np.zeros(0), np.zeros(0))
    assert closed == pytest.approx(0.5, rel=1e-7)
    assert oracle_p95_mm(noise, oracle_levers_mm(), tau) == pytest.approx(0.5, rel=1e-7)
    assert problem.cost(tau) == pytest.approx(ORACLE["best_known_cost"], rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    ("fiducials", "limit_mm", "best_known", "starts", "seed"), read_cases("optimise", "best_known")
)
def test_best_known_cost_is_met(fiducials: int, limit_mm: float, best_known: float, starts: int, seed: int) -> None:
    """independent: cost within 0.2 % of the best known, evaluated by the approximation those costs used."""
    problem = oracle_problem(fiducials, limit_mm)
    found = search(problem, starts=starts, seed=seed, threads=1)
    choice = found.program.split(found.iterates[0].point.x)
    layout, tau = choice.fiducials_mm, choice.half_width
    image = image_covariance_by_score(problem, layout)
    # A violation of the limit would be a discount.
    assert oracle_p95_mm(image, oracle_levers_mm(), tau) <= limit_mm * (1 + 1e-6)
    assert float((1 / tau).sum()) <= best_known * 1.002
    assert objective_for_people(found.program, found.iterates[0].point.objective) == pytest.approx(
        (1 / tau).sum(), rel=1e-12
    )
    assert tau.max() <= np.deg2rad(3.0) * (1 + 1e-12)
    assert (layout >= BOX_MM[0] - 1e-9).all()
    assert (layout <= BOX_MM[1] + 1e-9).all()
    _assert_spacing(layout)
    assert found.converged >= starts - 1
    # before polishing
    assert found.optima[0].objective == pytest.approx(float((1 / tau).sum()), rel=1e-3)


def _assert_spacing(layout: Array) -> None:
    """closed form: distances recomputed with numpy from the matrices of the oracle file."""
    first, second = np.triu_indices(len(layout), 1)
    assert np.linalg.norm(layout[first] - layout[second], axis=1).min() >= 12 - 1e-5
    for matrix in ORACLE["P"]:
        image = np.hstack([layout, np.ones((len(layout), 1))]) @ np.array(matrix).T
        image = image[:, :2] / image[:, 2:]
        target = np.array(matrix) @ [*ORACLE["target"], 1.0]
        assert np.linalg.norm(image[first] - image[second], axis=1).min() >= 25 - 1e-4
        assert np.linalg.norm(image - target[:2] / target[2], axis=1).min() >= 25 - 1e-4
        assert ((image >= 15 - 1e-6) & (image <= 1520 + 1e-6)).all()


def test_half_widths_beside_a_uniform_source_are_the_cheapest_there_are() -> None:
    """scan: 200 ratios of two normal half-widths beside image noise and a uniform source, each as wide as the exact
    law allows."""
    problem = first_interface_only(fixed_layout(oracle_problem(8, 0.9, law=Law.NORMAL), cube_fiducials()))
    free = tuple(item for item in problem.half_widths if item.component != "rz")
    seat = problem.system.structure_connector
    laws = tuple(
        Law.UNIFORM if name == "rz" else law for name, law in zip(seat.sources.names, seat.sources.laws, strict=True)
    )
    sources = replace(seat.sources, laws=laws)
    system = replace(problem.system, structure_connector=replace(seat, sources=sources))
    problem = replace(problem, system=system, half_widths=free)
    solution = solve_placement(problem)
    relaxation = bound_cost(search(problem, starts=1), Optimum.of(solution), solution)
    (term,) = solution.program.terms

    def cost(angle: float) -> float:
        """Least along a direction, to 1e-9."""
        shape = np.array([np.cos(angle), np.sin(angle)])

        def excess(size: float) -> float:
            return evaluate_demand(problem, term, replace(solution.choice, half_width=size * shape)).exact_mm - 0.9

        return problem.cost(brentq(excess, 1e-5, 0.05, xtol=1e-12) * shape)

    best = min(cost(angle) for angle in np.linspace(0.02, np.pi / 2 - 0.02, 200))
    assert (1 - 1e-4) * best <= relaxation.lower_bound <= best * (1 + 1e-9)
