"""Half-widths at the layout as it is: against the optimiser's own search, conditions of optimality, and refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from optimise_scenes import solve_placement
from plain_data import EVERY, EXAMPLES, problems_of
from tailstack import Design, DesignError, allocate, load_design, score
from tailstack.errors import OutOfRangeError
from tailstack.geometry.arrays import Array
from tailstack.optimisation import PlacementProblem
from tailstack.optimisation.closed_limits import close_limits
from tailstack.optimisation.half_widths import _hold_all, _Readings
from tailstack.optimisation.least_cost import Programme, Widths, curves_of, log_costs, log_squares, solve_programme
from tailstack.optimisation.prices import Price, reciprocal
from tailstack.optimisation.problem import present_choice
from tailstack.optimisation.request import read_request


def example(name: str, **changes: object) -> Design:
    design = load_design(EXAMPLES / f"{name}.yaml")
    for path, value in changes.items():
        design = design.with_value(path.replace("__", "."), value)
    return design


def bounded() -> Design:
    """What a seat may turn by is known to stay within bounds, and of no law."""
    seats = "interfaces.structure_connector.tolerances"
    return example("first_carrier", **{f"{seats}.r{axis}.distribution": "bounded" for axis in "xyz"})


def priced() -> Design:
    """Half-widths of two curves, some of them at a bound."""
    seat = {"interface": "connector_flange", "min_deg": 0.02, "max_deg": 0.2}
    own = [
        seat | {"component": "rx", "cost": {"curve": "exponential", "weight": 900, "scale_deg": 0.1}},
        seat | {"component": "ry", "cost": {"curve": "reciprocal_square", "weight": 0.4}},
        seat | {"component": "rz", "min_deg": 0.19, "cost_weight": 0.01},
    ]
    return example("first_carrier", **{"optimise.tolerances": own})


def clipped() -> Design:
    """Both seats from a tenth to three times what they are; of each unit, whole steps swing further and further."""
    free = [
        {"interface": seat, "component": component, f"min_{unit}": value / 10, f"max_{unit}": 3 * value}
        for seat, each in EVERY["clip_on"]["interfaces"].items()
        for component, tolerance in each["tolerances"].items()
        for unit in ("deg", "mm")
        if (value := tolerance.get(f"half_width_{unit}"))
    ]
    return load_design(EVERY["clip_on"] | {"optimise": {"tolerances": free}})


def searched(design: Design, name: str, limit: float, locked: tuple[str, ...] = ()) -> tuple[float, float]:
    """Cost of the optimiser's optimum by the exact law with nothing but these half-widths free, and the largest part of
    a limit that it came to."""
    problem = read_request(design).problem
    free = tuple(
        each
        for each in problem.half_widths
        if not {each.contributor, f"{each.contributor}.{each.component}"} & {*locked}
    )
    wanted = tuple(replace(each, limit=limit) if each.name == name else each for each in problem.requirements)
    fixed: PlacementProblem = replace(problem, places=(), pivots=(), half_widths=free, requirements=wanted)
    found = solve_placement(fixed, starts=1)
    return found.cost, found.worst_ratio


LOCKED = ("connector_flange", "structure_connector.rx")
CASES = {
    "one requirement": (example("demo"), "tip-accuracy", 0.8, ()),
    "locked rows": (example("first_carrier"), "tip-accuracy", 1.2, LOCKED),
    "bounded": (bounded(), "tip-accuracy", 1.1, ()),
    "curves and bounds": (priced(), "tip-accuracy", 0.9, ()),
    "two requirements": (example("locators_321"), "workspace-accuracy", 0.36, ()),
    "per unit": (example("locators_321"), "unit-yield", 0.4, ()),
    "several statistics": (example("mean_and_tail"), "tail", 0.6, ()),
    "steps that swing": (clipped(), "each-unit", 0.9359, ()),
}
MISSED = {
    "missed fiducials": (example("demo", fiducials__loss_probability=0.03), "tip-accuracy", 0.8, ()),
    "a mean, missed fiducials": (
        example("mean_and_tail", fiducials__loss_probability=0.01), "mean-accuracy", 0.33, (),
    ),
}  # fmt: skip


@pytest.mark.long("per unit", "steps that swing")
@pytest.mark.parametrize("name", CASES)
def test_it_costs_what_the_optimiser_finds_at_that_layout(name: str) -> None:
    """independent: IPOPT on the closed form corrected to the exact law, by which the optimiser goes."""
    design, requirement, limit, locked = CASES[name]
    expected, reached = searched(design, requirement, limit, locked)
    # A quantile over units is sampled: the optimiser stops as far below its limit as that is known
    found = allocate(design, limit=limit * reached, requirement=requirement, locked=locked)
    assert found.status == "kept"
    assert found.cost_after == pytest.approx(expected, rel=1e-4)


@pytest.mark.long("a mean, missed fiducials")
@pytest.mark.parametrize("name", ["one requirement", "several statistics", *MISSED])
def test_no_change_of_the_half_widths_is_cheaper(name: str) -> None:
    """independent: first-order conditions by finite differences of ``score``: every half-width between its bounds gives
    the same cost for the same part of the limit."""
    design, requirement, limit, _ = (CASES | MISSED)[name]
    (place,) = [k for k, each in enumerate(design.document.requirements) if each.name == requirement]
    found = allocate(design, limit=limit, requirement=requirement)
    worth = []

    def value(**changed: float) -> float:
        at = design.with_value(f"/requirements/{place}/limit_mm", limit)
        for each in found.tolerances:
            half_width = changed.get(each.label, each.after_half_width)
            path = f"/interfaces/{each.contributor}/tolerances/{each.component}/half_width_{each.unit}"
            at = at.with_value(path, half_width)
        checks = score(at, losses=False).verdict.checks
        return next(check.value for check in checks if check.requirement == requirement)

    assert value() <= limit
    assert value() == pytest.approx(limit, rel=1e-4)
    for each in found.tolerances:
        if not 0.0101 < each.after_half_width < 0.499:
            continue
        wider, tighter = (value(**{each.label: each.after_half_width * (1 + step)}) for step in (1e-3, -1e-3))
        worth.append(each.cost_after / ((wider - tighter) / 2e-3))  # price 1 / h: d cost / d log h is the cost
    assert len(worth) >= 3
    assert np.ptp(worth) < 0.01 * max(worth)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_step_is_the_cheapest_within_every_limit_of_its_model(count: int) -> None:
    """independent: SciPy's SLSQP in the logarithms, from the least half-widths; 20 random models, seeded."""
    rng = np.random.default_rng(count)
    prices = [
        *(reciprocal(float(weight)) for weight in rng.uniform(0.5, 5, 4)),
        *[Price("exponential", 9.0, 1.0, 0.2)] * 2,
    ]
    curves, lower, upper = curves_of(prices), np.full(6, 0.02), np.full(6, 1.5)
    widths = Widths(curves, lower, upper)

    def solve(fixed: Array, by_square: Array) -> Array:
        return solve_programme(Programme(widths, fixed, by_square), np.zeros(len(fixed)))

    for _ in range(20):
        fixed, by_square = rng.uniform(0, 0.5, count), rng.uniform(0, 6, (count, 6)) * rng.integers(0, 2, (count, 6))
        found = solve(fixed, by_square)
        expected = minimize(
            lambda u: np.log(np.exp(log_costs(curves, np.exp(u))).sum()),
            np.log(lower),
            bounds=np.log([lower, upper]).T,
            constraints={"type": "ineq", "fun": lambda u, f=fixed, b=by_square: 1 - f - b @ np.exp(2 * u)},
            method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 500},
        )
        assert (fixed + by_square @ found**2).max() <= 1 + 1e-8
        assert np.log(np.exp(log_costs(curves, found)).sum()) == pytest.approx(expected.fun, abs=1e-6)
    parts, slope = np.linspace(1.0, 0.5, count), rng.uniform(1, 6, 6)  # of one error: only the tightest is in the way
    every = solve(0.1 * parts, parts[:, None] * slope)
    np.testing.assert_allclose(every, solve(np.array([0.1]), slope[None]), rtol=1e-6)
    beyond = np.full(count, 2.0)
    np.testing.assert_array_equal(solve(beyond, np.ones((count, 6))), lower)


@pytest.mark.parametrize("name", ["locators_321", "mean_and_tail", "clipped"])
def test_a_limit_under_a_hand_is_kept_and_reached_wherever_it_stands(name: str) -> None:
    """From a little above the least that can be kept, where half-widths are so small that rounding them is felt."""
    design = clipped() if name == "clipped" else example(name)
    asked = design.document.requirements[-1].name
    free = allocate(design, requirement=asked)
    locked = [f"{free.tolerances[0].contributor}.{free.tolerances[0].component}"]
    costs = []
    for limit in np.geomspace(0.27 / 0.45, 1.3, 7) * free.limit:
        found = allocate(design, limit=round(float(limit), 4), requirement=asked, locked=locked)
        assert (found.status, found.value <= found.limit) == ("kept", True)
        costs.append(found.cost_after)
    assert costs == sorted(costs, reverse=True)


def test_out_of_reach_says_what_holds_it() -> None:
    """independent: ``score`` at the least half-widths, and its shares of the variance."""
    design = example("demo")
    found = allocate(design, limit=0.5)
    assert found.status == "out of reach"
    assert {each.after_half_width for each in found.tolerances} == {0.01}
    least = design
    for each in found.tolerances:
        least = least.with_value(f"/interfaces/{each.contributor}/tolerances/{each.component}/half_width_deg", 0.01)
    target = score(least, losses=False).targets[0]
    assert found.least == found.value == pytest.approx(target.p95_mm, rel=1e-9)
    assert found.binding == ("P95 at target 'tip', limit 0.5 mm (tip-accuracy)",)
    most = max((each for each in target.contributors if each.component == "all"), key=lambda each: each.variance_share)
    assert (found.held_by, found.held_label) == (most.name, most.label)
    near = allocate(design, limit=found.least * 1.0001)  # just above what is least there is an answer
    assert (near.status, near.value <= near.limit) == ("kept", True)
    assert near.cost_after < found.cost_after


def test_what_is_locked_stays_and_what_moved_most_is_named() -> None:
    design = example("demo")
    found = allocate(design, limit=0.9, locked=["structure_connector.rx"])
    assert "structure_connector.rx" in found.locked
    assert [each.component for each in found.tolerances if each.contributor == "structure_connector"] == ["ry", "rz"]
    moved = {each.label: abs(each.at_target_mm - each.at_target_before_mm) for each in found.tolerances}
    assert found.moved_most == max(moved, key=moved.__getitem__)
    assert found.cost_before == pytest.approx(sum(each.cost_before for each in found.tolerances))
    assert found.cost_after > allocate(design, limit=0.9).cost_after - 1 / np.radians(0.05)  # less is free


BOX = {"min_mm": [-45, -45, -85], "max_mm": [45, 45, 15]}
REFUSALS: dict[str, tuple[Design, dict[str, Any], str, str]] = {
    "grades": (example("tube_carrier"), {}, "not-allocated", "tables of grades"),
    "no requirement of that name": (example("demo"), {"requirement": "tip"}, "unknown-requirement", "tip-accuracy"),
    "which of several": (example("mean_and_tail"), {"limit": 1.0}, "unknown-requirement", "mean-accuracy, tail"),
    "no half-width of that name": (example("demo"), {"locked": ["rx"]}, "unknown-tolerance", "structure_connector.rx"),
    "all locked": (
        example("demo"), {"locked": ["structure_connector", "connector_flange"]}, "not-allocated", "lock fewer",
    ),
    "a limit that is none": (example("demo"), {"limit": -1.0}, "out-of-range", "-1"),
    "a limit that no length has": (example("demo"), {"limit": 1.4e308}, "out-of-range", "1.4e+308"),
    "missed fiducials, of each unit": (
        example("locators_321", fiducials__loss_probability=0.02), {}, "not-allocated", "of units at target 'centre'",
    ),
    "more missed than a limit leaves": (
        example("demo", fiducials__loss_probability=0.1), {}, "not-allocated", "too few fiducials for P95 at target",
    ),
    "nothing free": (example("demo", optimise={"box": BOX}), {}, "not-allocated", "free some by bounds"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSALS)
def test_refusals(name: str) -> None:
    design, options, code, words = REFUSALS[name]
    error = OutOfRangeError if "missed" in name else DesignError
    (problem,) = problems_of(allocate, design, error=error, **options)
    assert problem.code == code
    assert words in f"{problem.detail} {problem.hint}"


LIMITS = {name: example(name) for name in ("mean_and_tail", "locators_321", "half_shell")} | {
    "bounded": bounded(),
    "of each unit and mounting": clipped(),
}


@pytest.mark.parametrize("name", LIMITS)
def test_closed_limits_are_near_what_is_read_and_pass_through_it(name: str) -> None:
    """independent: the exact law; slopes by differences of the closed form, and of the exact one once it was read."""
    problem = read_request(LIMITS[name]).problem
    problem = replace(problem, places=(), pivots=(), stay=None)
    held, here = _hold_all(problem, problem.demands), present_choice(problem).half_width
    read = _Readings(problem, held, here)
    every = [read.at(t, fine=True) for t in range(len(held))]
    closed = close_limits(
        [each.demand for each in held],
        [each.model for each in held],
        [each.places for each in held],
        [each.exact.worst for each in every],
        here,
    )
    exact = np.array([each.ratio for each in every])
    logs, slopes = log_squares(closed, here)
    np.testing.assert_allclose(np.exp(logs / 2), exact, rtol=0.04)
    steps = 1e-5 * np.eye(len(here))
    apart = [
        log_squares(closed, here * np.exp(step))[0] - log_squares(closed, here * np.exp(-step))[0] for step in steps
    ]
    np.testing.assert_allclose(np.transpose(apart) / 2e-5, slopes, atol=0.02)
    closed.anchor(logs, exact)
    for t, each in enumerate(every):
        closed.turn(t, here, each.slopes())
    logs, slopes = log_squares(closed, here)
    np.testing.assert_allclose(np.exp(logs / 2), exact, rtol=1e-9)
    np.testing.assert_allclose(slopes / 2, [each.slopes() for each in every], atol=1e-9)
