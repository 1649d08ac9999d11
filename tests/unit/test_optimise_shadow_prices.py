"""Shadow prices against problems solved again at slightly other limits; what binds, from the layout itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import combinations
from math import radians

import numpy as np
import pytest

import tailstack.optimisation.shadow_prices as module
from optimise_scenes import (
    ORACLE,
    fixed_layout,
    oracle_problem,
    pivot_in,
    places_in_box,
    requirement,
    seat,
    solve_placement,
)
from scenes import cube_fiducials
from tailstack.optimisation import FreeHalfWidth, PlacementProblem
from tailstack.optimisation.certificate import name_binding
from tailstack.optimisation.placement import PlacementSolution, settle
from tailstack.optimisation.prices import reciprocal
from tailstack.optimisation.program import build_program
from tailstack.optimisation.search import Search
from tailstack.optimisation.shadow_prices import price_bounds
from tailstack.optimisation.terms import terms_of
from tailstack.system import Law

LIMIT_MM = 0.7
TIGHT_MM = np.array([[-40.0, -40, -60], [40, 40, 60]])


def _free_layout() -> PlacementProblem:
    """Six fiducials in which every kind of rule binds."""
    return oracle_problem(
        6, LIMIT_MM, places=places_in_box(range(6), TIGHT_MM), min_spacing_mm=60.0, min_projected_spacing_px=250.0,
        target_clearance_px=400.0,
    )  # fmt: skip


def _mechanical() -> PlacementProblem:
    """A seat on locators and an interface with a free pivot, layout fixed."""
    problem = fixed_layout(oracle_problem(8, LIMIT_MM), cube_fiducials())
    held = seat("structure_connector", (0.0, 0.0, -95.0), [0.02] * 6)
    widths = (FreeHalfWidth("structure_connector", "L1", 1e-3, 0.5, reciprocal(0.2)), *problem.half_widths[3:])
    return replace(
        problem,
        system=replace(problem.system, structure_connector=held),
        half_widths=widths,
        pivots=(pivot_in("connector_flange", (-5, -5, -150), (5, 5, -120)),),
    )


PROBLEMS: dict[str, PlacementProblem] = {
    "cost, layout free": _free_layout(),
    "quantile, layout free": replace(_free_layout(), objective="quantile", cost_limit=2000.0),
    "scaling, layout free": replace(_free_layout(), objective="scaling"),
    "cost, mechanics free": _mechanical(),
    "quantile, mechanics free": replace(_mechanical(), objective="quantile", cost_limit=1500.0),
}


@cache
def _solved(name: str) -> PlacementSolution:
    return solve_placement(PROBLEMS[name], starts=3, seed=2, threads=1)


def _objective(solution: PlacementSolution) -> float:
    """Cost, or the quantile in mm."""
    if solution.problem.objective == "quantile":
        return solution.worst_ratio * LIMIT_MM
    return solution.cost


def _continued(problem: PlacementProblem, solution: PlacementSolution) -> float:
    """The objective of a slightly different problem at the same local optimum."""
    terms = tuple(terms_of(problem, demand) for demand in problem.demands)
    program = build_program(problem, terms)
    found = Search(program, (solution.iterate,), terms, 1, 1, (), "")
    return _objective(settle(found, np.ones(len(terms))))


def _with_limit(problem: PlacementProblem, change: float) -> PlacementProblem:
    return replace(problem, requirements=(requirement(LIMIT_MM + change),))


def _with_lower_x_face(problem: PlacementProblem, by: float) -> PlacementProblem:
    """The face moved outwards."""
    box = TIGHT_MM.copy()
    box[0, 0] -= by
    return replace(problem, places=places_in_box(range(6), box))


def _with_largest_flange_rz(problem: PlacementProblem, by: float) -> PlacementProblem:
    """by: in hundredths of a degree, as the price is told."""
    *others, last = problem.half_widths
    return replace(problem, half_widths=(*others, replace(last, maximum=last.maximum + by * radians(0.01))))


def _with_field(field: str) -> Callable[[PlacementProblem, float], PlacementProblem]:
    return lambda problem, by: replace(problem, **{field: getattr(problem, field) + by})


def _with_upper_z_of_the_pivot(problem: PlacementProblem, by: float) -> PlacementProblem:
    (free,) = problem.pivots
    return replace(problem, pivots=(replace(free, high_mm=free.high_mm + np.array([0.0, 0.0, by])),))


CHANGES: dict[str, tuple[Callable[[PlacementProblem, float], PlacementProblem], float]] = {
    "limit": (_with_limit, 0.001),
    "min_spacing_mm": (_with_field("min_spacing_mm"), 0.02),
    "target_clearance_px": (_with_field("target_clearance_px"), 0.2),
    "cost_limit": (_with_field("cost_limit"), 2.0),
    "lower x face of the box": (_with_lower_x_face, 0.02),
    "connector_flange rz largest half-width": (_with_largest_flange_rz, 1.0),
    "upper z bound of the pivot of connector_flange": (_with_upper_z_of_the_pivot, 0.05),
}  # fmt: skip


EXPECTED = {
    "cost, layout free": ("limit", "min_spacing_mm", "target_clearance_px", "lower x face of the box"),
    "quantile, layout free": ("cost_limit",),
    "scaling, layout free": ("limit",),
    "cost, mechanics free": (
        "limit", "upper z bound of the pivot of connector_flange", "connector_flange rz largest half-width",
    ),
    "quantile, mechanics free": ("cost_limit", "upper z bound of the pivot of connector_flange"),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", PROBLEMS)
def test_shadow_prices_are_slopes_of_the_optimum(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """independent: the problem solved again on both sides of each limit, from the same local optimum.

    A fiducial in a corner of several rules has more rules than freedom: the slopes of the two sides then differ, and
    a multiplier lies between them.
    """
    monkeypatch.setattr(module, "PRICED", 1e-4)  # per cent: also what would not be worth a line
    solution = _solved(name)
    objective = _objective(solution)
    prices = {price.name: price for price in price_bounds(solution.program, solution.iterate.point, objective)}
    for wanted in EXPECTED[name]:
        change, step = CHANGES[wanted]
        above, below = (_continued(change(solution.problem, side * step), solution) for side in (1, -1))
        low, high = sorted(((above - objective) / step, (objective - below) / step))
        slack = 2e-3 * abs(low + high)
        assert low - slack <= prices[wanted].cost_per_unit <= high + slack, wanted
        assert wanted == "lower x face of the box" or high - low <= 0.02 * abs(low + high), wanted


@pytest.mark.long
@pytest.mark.parametrize("law", [Law.UNIFORM, Law.NORMAL])
def test_the_price_of_a_per_unit_limit_is_the_slope_of_the_optimum(law: Law) -> None:
    """independent: the problem solved again 1 um on either side; where noise is most of the error, cost bends."""

    def problem(limit_mm: float) -> PlacementProblem:
        """Noise is most of the error: 0.25 mm of it in each unit, a known bias, uniform manufacturing errors."""
        found = fixed_layout(oracle_problem(8, limit_mm, law), cube_fiducials())
        system = replace(
            found.system,
            manufacturing_law=Law.UNIFORM,
            manufacturing_half_width_mm=np.full((8, 3), 0.05),
            structure_connector=replace(found.system.structure_connector, known=np.array([0, 0, 0, 0.05, 0, 0.03])),
        )
        return replace(found, system=system, requirements=(requirement(limit_mm, risk="per_unit", min_yield=0.9),))

    limit_mm, step = 0.36, 0.001
    solution = solve_placement(problem(limit_mm), starts=2, seed=2, threads=1)
    (price,) = (p for p in price_bounds(solution.program, solution.iterate.point, solution.cost) if p.name == "limit")
    above, below = (_continued(problem(limit_mm + side * step), solution) for side in (1, -1))
    assert price.cost_per_unit == pytest.approx((above - below) / (2 * step), rel=5e-3)
    assert abs(price.cost_per_unit) * limit_mm > 2 * solution.cost  # not what cost ~ 1 / limit would give


def test_what_a_tolerance_between_its_bounds_is_worth() -> None:
    """closed form: the slope of the price curve, -1 / h^2 per rad and -0.2 / h^2 per mm."""
    solution = _solved("cost, mechanics free")
    prices = {price.name: price for price in price_bounds(solution.program, solution.iterate.point, solution.cost)}
    contact, turn = solution.choice.half_width[:2]
    assert prices["structure_connector L1 half-width"].unit == "0.01 mm"
    assert prices["structure_connector L1 half-width"].cost_per_unit == pytest.approx(
        -0.2 / contact**2 * 0.01, rel=1e-9
    )
    assert prices["connector_flange rx half-width"].unit == "0.01 deg"
    assert prices["connector_flange rx half-width"].cost_per_unit == pytest.approx(-radians(0.01) / turn**2, rel=1e-9)


def test_binding_names_exactly_what_holds_with_equality() -> None:
    """brute force: distances, images by the matrices of the oracle, faces and bounds, each compared with its limit."""
    solution = _solved("cost, layout free")
    layout, half_width = solution.choice.fiducials_mm, solution.choice.half_width
    expected = {f"P95 at target 'target', limit {LIMIT_MM:g} mm (accuracy)"}
    pairs = list(combinations(range(6), 2))
    expected |= {
        f"spacing of F{i + 1} and F{j + 1} at 60 mm"
        for i, j in pairs if abs(np.linalg.norm(layout[i] - layout[j]) - 60) < 1e-4
    }  # fmt: skip
    for v, matrix in enumerate(ORACLE["P"]):
        homogeneous = np.vstack([np.hstack([layout, np.ones((6, 1))]), [*ORACLE["target"], 1.0]]) @ np.array(matrix).T
        image = homogeneous[:, :2] / homogeneous[:, 2:]
        expected |= {
            f"images of F{i + 1} and F{j + 1} in view{v} at 250 px"
            for i, j in pairs if abs(np.linalg.norm(image[i] - image[j]) - 250) < 1e-3
        } | {
            f"images of F{i + 1} and of target 'target' in view{v} at 400 px"
            for i in range(6) if abs(np.linalg.norm(image[i] - image[6]) - 400) < 1e-3
        }  # fmt: skip
    found = name_binding(solution.program, solution.iterate.point, solution.iterate.parameters)
    on_box = [text for text in found if "on the box at" in text]
    faces = {
        (label, f"{axis} = {side:g} mm")
        for i, label in enumerate(solution.problem.system.fiducial_labels)
        for k, axis in enumerate("xyz") for side in TIGHT_MM[:, k] if abs(layout[i, k] - side) < 1e-4
    }  # fmt: skip
    told = {
        (label, face)
        for text in on_box for label in text.split(" on the box at ")[0].split(", ")
        for face in text.split(" on the box at ")[1].split(", ")
    }  # fmt: skip
    assert told == faces
    expected |= {
        f"{free.contributor} {free.component} at its largest half-width, 3 deg"
        for free, value in zip(solution.problem.half_widths, half_width, strict=True)
        if abs(value / radians(3) - 1) < 1e-5
    }  # fmt: skip
    assert set(found) - set(on_box) == expected
    for kind in ("spacing of", "images of F", "of target", "largest"):
        assert any(kind in text for text in found)
