"""The programme against the compiled model, and its optima against problems solved by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimise_scenes import fixed_layout, free_rotations, oracle_problem, requirement
from scenes import cube_fiducials, mount, random_system, target, with_noise
from tailstack.contributors import declared_law
from tailstack.optimisation import PlacementProblem, solve_placement
from tailstack.optimisation.certificate import binding, kkt_residual, shadow_prices
from tailstack.optimisation.placement import settle
from tailstack.optimisation.problem import apply_choice
from tailstack.optimisation.program import Parameters, build_program
from tailstack.optimisation.promise import closed_form_mm, image_part
from tailstack.optimisation.search import search
from tailstack.optimisation.starts import starting_layouts
from tailstack.optimisation.terms import estimator_of, is_flat, terms_of
from tailstack.propagation.linear import covariance, linearise
from tailstack.system import Law, Reading
from tailstack.tail.declared import law_quantile

NORMAL_P95 = 1.959963984540054  # closed form: |N(0, 1)|


def _random_problem(seed: int, **changes: object) -> PlacementProblem:
    """A general scene: two targets, biases, mixed laws and directions, manufacturing, hand-eye, execution."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, fiducials=7, targets=2, **changes)
    wanted = requirement(5.0, error="tcp" if seed % 2 else "localisation", targets=("t0", "t1"))
    free = free_rotations(("rx", "rz"))
    return PlacementProblem(system, wanted, (0, 2, 5), np.array([[-60.0] * 3, [50.0] * 3]), free, min_spacing_mm=5.0)


@pytest.mark.parametrize(("seed", "reading"), [(1, Reading.PHYSICAL), (2, Reading.EQ18), (3, Reading.EQ18)])
def test_symbolic_constraint_and_gradient_follow_the_compiled_model(seed: int, reading: Reading) -> None:
    """independent: value and central finite differences of the closed form through the numba gains."""
    problem = _random_problem(seed, reading=reading)
    terms = tuple(terms_of(problem, t) for t in problem.targets)
    program = build_program(problem, estimator_of(problem.system), terms)
    parameters = Parameters(np.log([5.0, 4.0]), np.zeros((2, 0)), np.ones((2, 4)))
    vector = parameters.vector(False)
    rng = np.random.default_rng(seed + 100)
    x = np.concatenate([rng.uniform(-0.9, 0.9, 9), np.log(np.deg2rad([0.3, 0.2, 0.5, 0.4])), [0.1]])

    def rows(at: np.ndarray) -> np.ndarray:
        layout, width, slack = program.split(at)
        values = []
        for term, limit in zip(terms, (5.0, 4.0), strict=True):
            model = linearise(replace(problem.system, fiducials_mm=layout), term.target)
            image = image_part(model, problem.requirement.error)
            form = closed_form_mm(problem, term, image, width, np.zeros(0), np.ones(4))
            values.append(2 * np.log(form / limit) - slack)
        return np.array(values)

    g, jacobian = (part.full() for part in program.jacobian(x, vector))
    np.testing.assert_allclose(g.ravel()[:2], rows(x), rtol=1e-9, atol=1e-10)
    step = 1e-5
    differences = np.array([(rows(x + step * e) - rows(x - step * e)) / (2 * step) for e in np.eye(len(x))]).T
    np.testing.assert_allclose(jacobian[:2], differences, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_split_model_has_the_covariance_of_the_score(seed: int) -> None:
    """independent: constants + image part + free half-widths add up to the linear model's own covariance."""
    problem = _random_problem(seed)
    for wanted in problem.targets:
        term = terms_of(problem, wanted)
        model = linearise(problem.system, wanted)
        error = problem.requirement.error
        total = term.covariance + image_part(model, error)
        for k, free in enumerate(problem.half_widths):
            sources = getattr(problem.system, free.contributor).sources
            std = sources.std[sources.names.index(free.component)]
            total = total + np.outer(term.free_gain[:, k], term.free_gain[:, k]) * std**2
        np.testing.assert_allclose(total, covariance(model, error), rtol=1e-12, atol=1e-15)
        law, _ = declared_law(model, error, model.bias_mm(error))
        np.testing.assert_array_equal(term.bias_mm, law.mean)


def _silent(limit_mm: float, components: tuple[str, ...], max_deg: float = 3.0) -> PlacementProblem:
    """No noise at all, a cube, normal laws: the error is what the free rotations make it."""
    half = [np.deg2rad(0.05) * (name in components) for name in ("rx", "ry", "rz")] + [0.0] * 3
    problem = fixed_layout(oracle_problem(8, limit_mm), cube_fiducials())
    system = replace(
        problem.system,
        views=with_noise(0.0),
        interface_1=mount("interface_1", (0.0, 0.0, -95.0), half_width=half),
        interface_2=mount("interface_2", (0.0, 0.0, -145.0), half_width=half),
    )
    return replace(problem, system=system, half_widths=free_rotations(components, max_deg))


def test_one_free_tolerance_solved_by_hand() -> None:
    """closed form: the error is 165 mm x angle along one axis, so 1.96 x 165 h = limit."""
    problem = _silent(0.5, ("rx",))
    held = replace(problem.system.interface_2, sources=mount("x", half_width=[0.0] * 6).sources)
    problem = replace(problem, system=replace(problem.system, interface_2=held), half_widths=problem.half_widths[:1])
    solution = solve_placement(problem)
    assert solution.half_width[0] == pytest.approx(0.5 / (NORMAL_P95 * 165), rel=1e-4)
    assert 0.5 * (1 - 1e-4) <= solution.worst_mm <= 0.5
    (price, *_) = shadow_prices(solution.program, solution.point, solution.cost)
    # cost = 1.96 x 165 / limit, so its derivative by the limit is -cost / limit
    assert price.cost_per_unit == pytest.approx(-solution.cost / 0.5, rel=1e-4)


def test_half_widths_go_as_lever_to_the_minus_two_thirds() -> None:
    """closed form: least sum of 1/h with 165^2 h1^2 + 215^2 h2^2 fixed has h ~ lever^(-2/3)."""
    solution = solve_placement(_silent(0.5, ("rx",)))
    levers = np.array([165.0, 215.0])
    shape = levers ** (-2 / 3)
    expected = shape * 0.5 / NORMAL_P95 / np.linalg.norm(levers * shape)
    np.testing.assert_allclose(solution.half_width, expected, rtol=1e-4)
    assert solution.kkt_residual < 1e-7


def test_an_axis_without_lever_goes_to_its_bound() -> None:
    """closed form: turning about the axis through pivot and target moves nothing."""
    solution = solve_placement(_silent(0.5, ("rx", "rz"), max_deg=0.7))
    np.testing.assert_allclose(np.rad2deg(solution.half_width[[1, 3]]), 0.7, rtol=1e-6)
    words = binding(solution.program, solution.point, solution.parameters)
    assert "P95 at target 'target', limit 0.5 mm (accuracy)" in words
    assert "interface_1 rz at its largest half-width, 0.7 deg" in words
    prices = {price.name: price for price in shadow_prices(solution.program, solution.point, solution.cost)}
    # closed form: the cost 1/h of an axis at its bound falls by 1/h^2 per rad
    expected = -np.deg2rad(0.01) / np.deg2rad(0.7) ** 2
    assert prices["interface_1 rz largest half-width"].cost_per_unit == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("law", [Law.UNIFORM, Law.TRIANGULAR, Law.NORMAL, Law.BOUNDED])
def test_the_exact_quantile_ends_just_below_the_limit(law: Law) -> None:
    problem = fixed_layout(oracle_problem(8, 0.5, law), cube_fiducials())
    solution = solve_placement(problem)
    assert 0.5 * (1 - 1e-4) <= solution.worst_mm <= 0.5 * (1 + 1e-6)
    assert solution.kkt_residual < 1e-6


def test_bounded_rotations_are_held_at_their_worst_ends() -> None:
    """closed form: without noise |sum of signed levers| at the worst vertex is the limit: h1 165 + h2 215 = limit."""
    problem = _silent(0.5, ("rx",))
    bounded = {
        name: replace(getattr(problem.system, name), sources=replace(
            getattr(problem.system, name).sources, laws=(Law.BOUNDED,)))
        for name in ("interface_1", "interface_2")
    }  # fmt: skip
    # A trace of noise gives the quantile a law to be the quantile of.
    problem = replace(problem, system=replace(problem.system, views=with_noise(1e-3), **bounded))
    solution = solve_placement(problem)
    levers = np.array([165.0, 215.0])
    # least sum of 1/h with sum lever h = limit: h ~ lever^(-1/2)
    expected = levers**-0.5 * 0.5 / (levers**0.5).sum()
    np.testing.assert_allclose(solution.half_width, expected, rtol=5e-3)
    assert solution.worst_mm <= 0.5


def test_fixed_bounded_sources_stand_at_the_scores_worst_vertex() -> None:
    """independent: the vertex is found again by trying all four, with the law of the score."""
    problem = fixed_layout(oracle_problem(), cube_fiducials())
    seat = mount(
        "interface_2", (0.0, 0.0, -145.0), bias=(0, 0, 0, 0.02, -0.01, 0), half_width=[1e-3, 1e-3, 1e-3, 0.06, 0, 0.04],
        law=(Law.UNIFORM,) * 3 + (Law.BOUNDED,) * 3,
    )  # fmt: skip
    problem = replace(problem, system=replace(problem.system, interface_2=seat))
    solution = solve_placement(problem)
    model = linearise(apply_choice(problem, solution.fiducials_mm, solution.half_width), problem.targets[0])
    block = next(block for block in model.blocks if block.contributor == "interface_2")
    columns = block.tcp[:, 3:5] * block.half_width[3:5]
    worst = 0.0
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        law, _ = declared_law(model, "tcp", model.bias_mm("tcp") + columns @ signs)
        worst = max(worst, law_quantile(law, 0.95).quantile_mm)
    assert solution.worst_mm == pytest.approx(worst, rel=1e-9)
    assert 0.5 * (1 - 1e-4) <= worst <= 0.5


def test_starts_never_rest_on_a_flat_layout() -> None:
    """A candidate in the plane of the others gives an infinite mean square, which no exchange accepts."""
    problem = oracle_problem(6)
    estimator, terms = estimator_of(problem.system), (terms_of(problem, problem.targets[0]),)
    flat = np.array([[x, y, 10.0] for x in (-50.0, 50.0) for y in (-50.0, 0.0, 50.0)])
    seen = replace(problem, system=replace(problem.system, fiducials_mm=flat))
    layouts = starting_layouts(seen, estimator, terms, 12, 3)
    assert is_flat(layouts[0])  # the present one is handed on as it is
    assert not any(is_flat(layout) for layout in layouts[1:])
    solution = solve_placement(replace(seen, requirement=requirement(2.0)), starts=2)
    assert solution.worst_mm <= 2.0


def test_a_looser_limit_never_costs_more() -> None:
    """property: the feasible set grows with the limit."""
    problem = fixed_layout(oracle_problem(), cube_fiducials())
    costs = [solve_placement(replace(problem, requirement=requirement(limit))).cost for limit in (0.4, 0.5, 0.7, 1.2)]
    assert costs == sorted(costs, reverse=True)
    moving = oracle_problem(8, 0.5)
    costs = [search(replace(moving, requirement=requirement(limit)), starts=2, seed=4).best_costs[0]
             for limit in (0.45, 0.5)]  # fmt: skip
    assert costs == sorted(costs, reverse=True)
    # The moving layout may also stay a cube up to the spacing of images: it never costs more than any fixed one.
    assert costs[1] < search(problem, starts=1).best_costs[0]


def test_same_seed_same_design_and_more_starts_never_cost_more() -> None:
    problem = replace(oracle_problem(), free_fiducials=(1, 4, 6))
    first, second = (solve_placement(problem, starts=3, seed=11, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(first.fiducials_mm, second.fiducials_mm)
    np.testing.assert_array_equal(first.half_width, second.half_width)
    few, more = (search(problem, starts=starts, seed=11).best_costs[0] for starts in (1, 4))
    assert more <= few * (1 + 1e-9)


def test_every_target_keeps_the_limit_and_only_binding_ones_enter() -> None:
    """property: of six targets those that bind are found, and none of the others is left above the limit."""
    problem = fixed_layout(oracle_problem(8, 1.0), cube_fiducials())
    targets = tuple(target((x, y, 60.0 + x / 5), f"t{x}{y}") for x in (-15.0, 15.0) for y in (-15.0, 0.0, 15.0))
    problem = replace(
        problem,
        system=replace(problem.system, targets=targets),
        requirement=requirement(1.0, targets=tuple(t.name for t in targets)),
    )
    solution = solve_placement(problem)
    assert len(solution.quantile_mm) == 6
    assert 1 - 1e-4 <= max(solution.quantile_mm) <= 1
    assert len(solution.program.terms) < 6


def test_without_free_tolerances_the_quantile_itself_is_least() -> None:
    """independent: no layout sampled in the box, nor the cube, has a smaller quantile under the score's own law."""
    problem = replace(oracle_problem(8, 1.0), half_widths=())
    solution = solve_placement(problem, starts=4, seed=0)
    assert solution.cost == 0
    assert solution.kkt_residual < 1e-6

    def quantile(layout: np.ndarray) -> float:
        model = linearise(replace(problem.system, fiducials_mm=layout), problem.targets[0])
        law, _ = declared_law(model, "tcp", model.bias_mm("tcp"))
        return law_quantile(law, 0.95).quantile_mm

    rng = np.random.default_rng(5)
    others = [rng.uniform(*problem.box_mm, (8, 3)) for _ in range(30)] + [np.array(cube_fiducials())]
    assert solution.worst_mm == pytest.approx(quantile(solution.fiducials_mm), rel=1e-9)
    assert solution.worst_mm < min(quantile(layout) for layout in others)


def test_kkt_residual_sees_a_wrong_multiplier_and_a_wrong_point() -> None:
    solution = solve_placement(_silent(0.5, ("rx", "ry")))
    good = kkt_residual(solution.program, solution.point, solution.parameters)
    wrong = replace(solution.point, row_multipliers=solution.point.row_multipliers * 1.01)
    moved = replace(solution.point, x=solution.point.x + np.array([0.01, 0, 0, 0, 0]))
    assert good < 1e-7
    assert kkt_residual(solution.program, wrong, solution.parameters) > 1e-3
    assert kkt_residual(solution.program, moved, solution.parameters) > 1e-3


def test_settling_to_a_tighter_aim_continues_from_a_solution() -> None:
    found = search(fixed_layout(oracle_problem(), cube_fiducials()))
    first = settle(found, 0.5)
    tighter = settle(found, 0.49, first)
    assert 0.49 * (1 - 1e-4) <= tighter.worst_mm <= 0.49
    assert tighter.cost > first.cost
