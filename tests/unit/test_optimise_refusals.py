"""What the optimiser refuses: contradictions with the field at fault, limits out of reach with what is attainable."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from optimise_scenes import fixed_layout, free_rotations, oracle_problem, requirement
from scenes import cube_fiducials, mount, with_noise
from tailstack.errors import DesignError, InfeasibleError, Problem
from tailstack.optimisation import PlacementProblem, solve_placement
from tailstack.optimisation.contradictions import refuse_contradictions


def _only(error: pytest.ExceptionInfo[Any]) -> Problem:
    assert len(error.value.problems) == 1
    problem: Problem = error.value.problems[0]
    return problem


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    return np.array([low, high])


def test_a_consistent_problem_is_not_refused() -> None:
    refuse_contradictions(oracle_problem())


@pytest.mark.parametrize(
    ("changes", "pointer", "code"),
    [
        ({"box_mm": _box((0, 0, 5), (1, 1, -5))}, "/optimise/box", "empty-box"),
        ({"box_mm": _box((-50, -900, -50), (50, 50, 10))}, "/optimise/box", "behind-source"),
        ({"box_mm": _box((-50, -50, 300), (50, 50, 400))}, "/optimise/box", "outside-view"),
        ({"box_mm": _box((150, -50, -50), (190, 50, 10))}, "/optimise/box", "outside-view"),
        ({"min_spacing_mm": 130.0}, "/optimise/min_spacing_mm", "does-not-fit"),
        ({"box_mm": _box((0, 0, 0), (5, 5, 5))}, "/optimise/min_spacing_mm", "does-not-fit"),
        ({"min_projected_spacing_px": 600.0}, "/optimise/min_projected_spacing_px", "does-not-fit"),
        ({"image_margin_px": 800.0}, "/optimise/box", "outside-view"),
        ({"requirement": requirement(0.5, risk="per_unit")}, "/optimise/requirement", "unsupported-risk"),
        ({"free_fiducials": (), "half_widths": ()}, "/optimise", "nothing-free"),
        (
            {"half_widths": (replace(free_rotations()[0], minimum=0.09, pointer="/optimise/tolerances/0"),)},
            "/optimise/tolerances/0",
            "bounds-crossed",
        ),
    ],
)  # fmt: skip
def test_contradictions_point_at_their_field(changes: dict[str, Any], pointer: str, code: str) -> None:
    with pytest.raises(DesignError) as error:
        refuse_contradictions(replace(oracle_problem(), **changes))
    assert (_only(error).pointer, _only(error).code) == (pointer, code)


def test_the_densest_packing_that_fits_is_not_refused() -> None:
    """closed form: eight fiducials 99.9 mm apart fit the corners of a 100 mm box."""
    refuse_contradictions(replace(oracle_problem(8), min_spacing_mm=99.9, min_projected_spacing_px=0.0))


def test_fixed_fiducials_must_keep_the_spacing_among_themselves() -> None:
    problem = oracle_problem()
    layout = problem.system.fiducials_mm.copy()
    layout[1] = layout[0] + [3.0, 0.0, 0.0]
    problem = replace(problem, system=replace(problem.system, fiducials_mm=layout), free_fiducials=(2, 3, 4, 5, 6, 7))
    with pytest.raises(DesignError) as error:
        refuse_contradictions(problem)
    assert _only(error).pointer == "/optimise/fixed"
    assert "F1 and F2" in _only(error).detail
    assert "3 mm" in _only(error).detail


def test_a_layout_that_cannot_matter_is_refused() -> None:
    problem = oracle_problem()
    silent = replace(problem.system, views=with_noise(0.0, target_px=0.5))
    with pytest.raises(DesignError) as error:
        refuse_contradictions(replace(problem, system=silent))
    assert _only(error).code == "no-influence"


def test_a_tolerance_of_zero_has_no_cost_to_compare_with() -> None:
    problem = oracle_problem()
    first = problem.system.interface_1
    widths = first.sources.half_width.copy()
    widths[2] = 0.0
    system = replace(problem.system, interface_1=replace(first, sources=replace(first.sources, half_width=widths)))
    with pytest.raises(DesignError) as error:
        refuse_contradictions(replace(problem, system=system))
    assert _only(error).code == "zero-half-width"


def _attainable(problem: PlacementProblem, limit_mm: float) -> str:
    with pytest.raises(InfeasibleError) as error:
        solve_placement(replace(problem, requirement=requirement(limit_mm)), starts=3, seed=0)
    assert _only(error).code == "limit-out-of-reach"
    return _only(error).detail


def test_a_limit_out_of_reach_says_what_is_attainable() -> None:
    """independent: just above the smallest quantile stated the problem is solved, at a large cost."""
    problem = replace(oracle_problem(), free_fiducials=(0, 1, 2, 3))
    detail = _attainable(problem, 0.2)
    least = float(detail.split(" is ")[1].split(" mm")[0])
    assert "fiducial_noise:view0" in detail
    assert 0.2 < least < 0.5
    solution = solve_placement(replace(problem, requirement=requirement(least * 1.01)), starts=3, seed=0)
    assert solution.worst_mm <= least * 1.01
    assert solution.cost > 10 * 3264  # ten times the best known cost at 0.5 mm


def test_infeasible_at_a_fixed_layout_names_the_tolerance_that_is_not_free() -> None:
    """closed form: a fixed tolerance of std 0.5 mm along one axis alone has P95 0.98 mm."""
    problem = fixed_layout(oracle_problem(), cube_fiducials())
    second = mount("interface_2", (0.0, 0.0, -145.0), half_width=[0, 0, 0, 0.5, 0, 0])
    problem = replace(
        problem,
        system=replace(problem.system, interface_2=second),
        half_widths=tuple(free for free in problem.half_widths if free.contributor == "interface_1"),
    )
    detail = _attainable(problem, 0.9)
    assert "interface_2 " in detail
    assert float(detail.split(" is ")[1].split(" mm")[0]) > 0.98


def test_spacing_that_only_the_solver_finds_impossible_is_named() -> None:
    """Below the density that is refused at once, yet too much for a thin box: the row that fails is named."""
    problem = replace(
        oracle_problem(8),
        box_mm=_box((-30, -30, -20), (30, 30, -19)),
        min_spacing_mm=33.0,
        min_projected_spacing_px=0.0,
        target_clearance_px=0.0,
    )
    refuse_contradictions(problem)
    with pytest.raises(InfeasibleError) as error:
        solve_placement(problem, starts=3, seed=0)
    assert _only(error).code == "layout-out-of-reach"
    assert "spacing of F" in _only(error).detail
