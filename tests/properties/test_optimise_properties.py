"""What holds for every placement problem: invariance to units, order, threads and rigid motion; freedom never costs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from optimise_scenes import (
    BOX_MM,
    at_prices,
    fixed_layout,
    free_rotations,
    oracle_problem,
    places_in_box,
    requirement,
    score_mm,
    solve_placement,
)
from scenes import TORSOR, cube_fiducials, mount, read_only, target
from tailstack.optimisation import PlacementProblem
from tailstack.optimisation.placement import settle
from tailstack.optimisation.prices import reciprocal
from tailstack.optimisation.problem import FreeFiducial, FreeHalfWidth
from tailstack.optimisation.program import build_program
from tailstack.optimisation.regions import BoxRegion, KeepOut, mirror
from tailstack.optimisation.search import explore, objective_for_people, search
from tailstack.optimisation.terms import terms_of
from tailstack.system import DirectEffect, Law

pytestmark = pytest.mark.long
LIMIT_MM = 0.7
FREE = oracle_problem(8, LIMIT_MM)


@cache
def _best(problem: PlacementProblem) -> float:
    found = search(problem, starts=2, seed=4, threads=1)
    return objective_for_people(found.program, found.iterates[0].point.objective)


def test_the_currency_does_not_matter() -> None:
    """property: all prices times 1000 give the same design at 1000 times the cost."""
    problem = oracle_problem(6, LIMIT_MM, places=places_in_box((1, 4)))
    dear = at_prices(problem, *(reciprocal(1000.0) for _ in problem.half_widths))
    first, second = (solve_placement(p, starts=2, seed=3, threads=1) for p in (problem, dear))
    np.testing.assert_allclose(second.choice.half_width, first.choice.half_width, rtol=1e-6)
    np.testing.assert_allclose(second.choice.fiducials_mm, first.choice.fiducials_mm, atol=1e-4)
    assert second.cost == pytest.approx(1000 * first.cost, rel=1e-6)


def _with_translations(problem: PlacementProblem) -> PlacementProblem:
    """The interfaces may also shift, by free amounts in mm."""
    half = (np.deg2rad(0.05),) * 3 + (0.05,) * 3
    mounts: dict[str, Any] = {
        name: mount(name, getattr(problem.system, name).pivot_mm, half_width=half, law=Law.UNIFORM)
        for name in ("structure_connector", "connector_flange")
    }
    shifts = tuple(FreeHalfWidth("structure_connector", name, 1e-3, 1.0, reciprocal(10.0)) for name in TORSOR[3:])
    return replace(problem, system=replace(problem.system, **mounts), half_widths=free_rotations() + shifts)


def _times(problem: PlacementProblem, factor: float) -> PlacementProblem:
    """Every length times a factor; pixels and angles as they are.  Costs of shifts are per millimetre."""
    system = problem.system

    def scaled(item: DirectEffect) -> DirectEffect:
        size = np.array([factor if unit == "mm" else 1.0 for unit in item.sources.units])
        widths = read_only(item.sources.half_width * size)
        return replace(
            item, pivot_mm=read_only(item.pivot_mm * factor), sources=replace(item.sources, half_width=widths)
        )

    # P (x / factor), depth in the new unit
    views = tuple(replace(view, projection=read_only(view.projection * [1, 1, 1, factor])) for view in system.views)
    free = tuple(
        FreeHalfWidth(item.contributor, item.component, low * size, high * size, reciprocal(size * item.price.weight))
        for item in problem.half_widths
        for low, high, size in [(item.minimum, item.maximum, factor if item.component.startswith("t") else 1.0)]
    )  # fmt: skip
    return replace(
        problem,
        system=replace(
            system, views=views, fiducials_mm=read_only(system.fiducials_mm * factor),
            structure_connector=scaled(system.structure_connector), connector_flange=scaled(system.connector_flange),
            targets=tuple(target(item.position_mm * factor, item.name) for item in system.targets),
        ),
        requirements=(requirement(LIMIT_MM * factor),),
        places=places_in_box(problem.free_fiducials, BOX_MM * factor),
        half_widths=free,
        min_spacing_mm=problem.min_spacing_mm * factor,
    )  # fmt: skip


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_the_unit_of_length_does_not_matter(factor: float) -> None:
    """property: a scene ten times as large, limit and all, has the same rotations and a layout ten times as large."""
    problem = _with_translations(oracle_problem(8, LIMIT_MM, places=places_in_box((1, 4, 6))))
    first, second = (solve_placement(p, starts=2, seed=3, threads=1) for p in (problem, _times(problem, factor)))
    assert second.cost == pytest.approx(first.cost, rel=1e-5)
    np.testing.assert_allclose(second.choice.half_width[:6], first.choice.half_width[:6], rtol=1e-4)
    np.testing.assert_allclose(second.choice.half_width[6:], first.choice.half_width[6:] * factor, rtol=1e-4)
    np.testing.assert_allclose(second.choice.fiducials_mm, first.choice.fiducials_mm * factor, atol=0.05 * factor)


@pytest.mark.parametrize("name", ["narrow", "ruled", "some fixed", "mirrored", "kept out"])
def test_freedom_never_costs(name: str) -> None:
    """property: with a larger box or fewer rules, from the optimum with less freedom or the same starts, no more."""
    free = FREE
    zone = KeepOut("clamp", BoxRegion(np.array([20.0, 20, -20]), np.array([60.0, 60, 20])), 5.0)
    held = {
        "narrow": replace(free, places=places_in_box(range(8), BOX_MM * 0.8)),
        "ruled": replace(free, min_spacing_mm=40.0, min_projected_spacing_px=100.0, target_clearance_px=300.0),
        "some fixed": replace(free, places=places_in_box((0, 1, 2))),
        "mirrored": replace(
            free,
            places=tuple(FreeFiducial((2 * k, 2 * k + 1), BoxRegion(BOX_MM[0], BOX_MM[1])) for k in range(4)),
            symmetry=mirror(np.zeros(3), np.array([1.0, 0, 0])),
        ),
        "kept out": replace(free, keep_out=(zone,)),
    }[name]
    less = solve_placement(held, starts=1, seed=4, threads=1)
    terms = tuple(terms_of(free, demand) for demand in free.demands)
    found = explore(build_program(free, terms), terms, [less.choice.fiducials_mm])  # from the optimum with less
    more = min(settle(found, np.ones(len(terms))).cost, _best(free))
    assert more <= less.cost * (1 + 2e-4)  # closed form against exact law, one of them not polished


def test_more_starts_never_cost_more_and_each_start_is_its_own() -> None:
    """property: start k depends on the seed and on k, not on how many there are."""
    problem = oracle_problem(6, 1.0, places=places_in_box((1, 4)))
    searches = [search(problem, starts=starts, seed=11, threads=1) for starts in (1, 2, 4)]
    costs = [objective_for_people(found.program, found.iterates[0].point.objective) for found in searches]
    assert costs[2] <= costs[1] * (1 + 1e-9)
    assert costs[1] <= costs[0] * (1 + 1e-9)
    # the optima that the first two starts ended at are among those of all four
    few = {entry.objective for entry in searches[1].optima}
    for value in few:
        assert any(abs(value / entry.objective - 1) < 1e-4 for entry in searches[2].optima)
    assert searches[2].optima[0].first_start in range(4)


def test_every_target_keeps_the_limit_and_only_binding_ones_enter() -> None:
    """property: of six targets those that bind are found, and none of the others is left above the limit."""
    problem = fixed_layout(oracle_problem(8, 1.0), cube_fiducials())
    targets = tuple(target((x, y, 60.0 + x / 5), f"t{x}{y}") for x in (-15.0, 15.0) for y in (-15.0, 0.0, 15.0))
    problem = replace(
        problem,
        system=replace(problem.system, targets=targets),
        requirements=(requirement(1.0, targets=tuple(t.name for t in targets)),),
    )
    solution = solve_placement(problem)
    quantiles = score_mm(problem, solution.choice)
    assert len(quantiles) == 6
    assert 1 - 1e-5 <= max(quantiles) <= 1
    np.testing.assert_allclose(solution.ratios, quantiles, rtol=1e-9)
    assert len(solution.program.terms) < 6
