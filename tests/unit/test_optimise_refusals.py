"""What the optimiser refuses: contradictions with the field at fault, limits out of reach with what is attainable."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from optimise_scenes import BOX_MM, fixed_layout, free_rotations, oracle_problem, places_in_box, requirement
from scenes import cube_fiducials, mount, read_only, with_noise
from tailstack import load_design, optimise
from tailstack.errors import DesignError, InfeasibleError, NotConvergedError, Problem
from tailstack.optimisation import PlacementProblem, solve_placement, tightening
from tailstack.optimisation.contradictions import refuse_contradictions
from tailstack.optimisation.prices import PricedGrade, of_grades
from tailstack.optimisation.problem import FreeFiducial, FreeSpacing, PivotVariable
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, KeepOut, Shape, mirror, turns
from tailstack.verification import verify

UP = np.array([0.0, 0.0, 1.0])
CENTRE_MM = np.array([0.0, 0.0, -40.0])
BASE_MM = np.array([0.0, 0.0, -90.0])
FIRST = free_rotations()[0]  # structure_connector rx


def _only(error: pytest.ExceptionInfo[Any]) -> Problem:
    """The one problem found; each says what to do next."""
    assert [problem.code for problem in error.value.problems] == [error.value.problems[0].code]
    problem: Problem = error.value.problems[0]
    assert problem.hint
    return problem


def _refused(problem: PlacementProblem) -> Problem:
    with pytest.raises(DesignError) as error:
        refuse_contradictions(problem)
    return _only(error)


def _box(*low_high_mm: float) -> dict[str, Any]:
    return {"places": places_in_box(range(8), np.reshape(low_high_mm, (2, 3)))}


def _in(shape: Shape, pointer: str = "/optimise/region", group: int = 1, count: int = 8) -> dict[str, Any]:
    return {"places": tuple(FreeFiducial(tuple(range(k, k + group)), shape, pointer) for k in range(0, count, group))}


def _kept_out(zone: Shape, clearance_mm: float = 0.0) -> dict[str, Any]:
    return {"keep_out": (KeepOut("clamp", zone, clearance_mm, "/optimise/keep_out/0"),)}


def _pivot(low: float, high: float) -> PivotVariable:
    return PivotVariable(
        "structure_connector", np.array([0.0, low, 0.0]), np.array([0.0, high, 0.0]), "/optimise/pivots/0"
    )


def _spread(low: float, high: float) -> FreeSpacing:
    return FreeSpacing("connector_flange", low, high, np.eye(6), np.eye(6), "/optimise/locator_spacing/0")


TOO_SMALL = Cylinder(CENTRE_MM, UP, 4.0, 3.0)
HALF_TUBE = Cylinder(BASE_MM, UP, 100.0, 50.0, 45.0)


def test_a_consistent_problem_is_not_refused() -> None:
    refuse_contradictions(oracle_problem())


@pytest.mark.parametrize(
    ("changes", "pointer", "code"),
    [
        (_box(0, 0, 5, 1, 1, -5), "/optimise/box", "empty-box"),
        (_in(Ball(CENTRE_MM, 20.0, 21.0)), "/optimise/region", "empty-region"),
        (_in(Cylinder(BASE_MM, UP, 100.0, 20.0, 21.0)), "/optimise/region", "empty-region"),
        (_in(Cylinder(BASE_MM, UP, -1.0, 20.0)), "/optimise/region", "empty-region"),
        (_box(-50, -900, -50, 50, 50, 10), "/optimise/box", "behind-source"),
        (_in(Ball(CENTRE_MM, 701.0)), "/optimise/region", "behind-source"),
        (_in(Cylinder(BASE_MM, np.array([0.0, -1.0, 0.0]), 701.0, 40.0)), "/optimise/region", "behind-source"),
        (_box(-50, -50, 300, 50, 50, 400), "/optimise/box", "outside-view"),
        (_box(150, -50, -50, 190, 50, 10), "/optimise/box", "outside-view"),
        (_in(Ball(np.array([0.0, 0.0, 350.0]), 40.0)), "/optimise/region", "outside-view"),
        ({"image_margin_px": 800.0}, "/optimise/box", "outside-view"),
        (_kept_out(BoxRegion(BOX_MM[0] - 1, BOX_MM[1] + 1)), "/optimise/box", "kept-out"),
        (_kept_out(BoxRegion(BOX_MM[0] + 1, BOX_MM[1] - 1), 1.1), "/optimise/box", "kept-out"),
        (_kept_out(Ball(CENTRE_MM, 87.0)), "/optimise/box", "kept-out"),
        (_kept_out(Cylinder(BASE_MM - UP, UP, 102.0, 71.0)), "/optimise/box", "kept-out"),
        (_in(HALF_TUBE) | _kept_out(Cylinder(BASE_MM, UP, 100.0, 50.0, 46.0), 1.1), "/optimise/region", "kept-out"),
        (_in(Ball(CENTRE_MM, 50.0, 45.0)) | _kept_out(Ball(CENTRE_MM, 51.0, 44.0)), "/optimise/region", "kept-out"),
        (
            _in(Ball(np.array([30.0, 0.0, -40.0]), 14.0), group=2) | {"symmetry": mirror(np.zeros(3), np.eye(3)[0])},
            "/optimise/region",
            "outside-symmetry",
        ),
        (
            _in(BoxRegion(np.array([5.0, 5.0, -90.0]), BOX_MM[1]), group=4) | {"symmetry": turns(np.zeros(3), UP, 4)},
            "/optimise/region",
            "outside-symmetry",
        ),
        (_box(-30, -30, 10, 30, 30, 10), "/optimise/box", "flat-region"),
        (_in(Cylinder(CENTRE_MM, UP, 0.0, 50.0)), "/optimise/region", "flat-region"),
        ({"min_spacing_mm": 130.0}, "/optimise/min_spacing_mm", "does-not-fit"),
        (_box(0, 0, 0, 5, 5, 5), "/optimise/min_spacing_mm", "does-not-fit"),
        (_in(TOO_SMALL), "/optimise/min_spacing_mm", "does-not-fit"),
        ({"min_projected_spacing_px": 600.0}, "/optimise/min_projected_spacing_px", "does-not-fit"),
        ({"places": (), "half_widths": ()}, "/optimise", "nothing-free"),
        (
            {"half_widths": (replace(FIRST, minimum=0.09, pointer="/optimise/tolerances/0"),)},
            "/optimise/tolerances/0",
            "bounds-crossed",
        ),
        ({"half_widths": (replace(FIRST, minimum=0.0),)}, "/optimise/tolerances", "bounds-crossed"),
        ({"pivots": (_pivot(5.0, 4.0),)}, "/optimise/pivots/0", "empty-box"),
        ({"spacings": (_spread(1.2, 1.1),)}, "/optimise/locator_spacing/0", "bounds-crossed"),
        ({"spacings": (_spread(0.0, 1.1),)}, "/optimise/locator_spacing/0", "bounds-crossed"),
        ({"objective": "quantile"}, "/optimise/cost_limit", "missing-field"),
        ({"objective": "quantile", "cost_limit": 114.0}, "/optimise/cost_limit", "cost-out-of-reach"),
    ],
)  # fmt: skip
def test_contradictions_point_at_their_field(changes: dict[str, Any], pointer: str, code: str) -> None:
    refused = _refused(replace(oracle_problem(), **changes))
    assert (refused.pointer, refused.code) == (pointer, code)


@pytest.mark.parametrize(
    "changes",
    [
        _box(-30, -30, 9.9, 30, 30, 10),
        _in(Ball(CENTRE_MM, 20.0, 20.0)),
        _in(Cylinder(CENTRE_MM, UP, 0.1, 50.0)),
        # 699 mm towards the source 700 mm away: its bounding box reaches no further either
        _in(Ball(CENTRE_MM, 699.0)),
        # a corner of the box is 86.6 mm from its centre; the zone covers all but that
        _kept_out(Ball(CENTRE_MM, 86.5)),
        _kept_out(BoxRegion(BOX_MM[0] + 1, BOX_MM[1] - 1), 1.0),
        _kept_out(Cylinder(BASE_MM, UP, 100.0, 71.0)),
        _in(HALF_TUBE) | _kept_out(Cylinder(BASE_MM, UP, 100.0, 50.0, 46.0), 0.9),
        _in(HALF_TUBE) | _kept_out(Cylinder(BASE_MM - UP, UP, 102.0, 60.0, 51.0)),
        _in(Ball(CENTRE_MM, 50.0, 45.0)) | _kept_out(Ball(CENTRE_MM, 51.0, 45.5)),
        # the region reaches across the mirror, so a part of it has its copies inside
        _in(Ball(np.array([10.0, 0.0, -40.0]), 40.0), group=2) | {"symmetry": mirror(np.zeros(3), np.eye(3)[0])},
        _in(BoxRegion(np.array([-20.0, -20.0, -90.0]), BOX_MM[1]), group=4) | {"symmetry": turns(np.zeros(3), UP, 4)},
        {"requirements": (requirement(0.5, risk="per_unit", min_yield=0.95),)},
        {"half_widths": (replace(FIRST, minimum=0.01, maximum=0.01),)},
        {"pivots": (_pivot(4.0, 4.0),)},
        {"places": (), "half_widths": (), "pivots": (_pivot(4.0, 5.0),)},
        {"places": (), "half_widths": (), "spacings": (_spread(0.9, 1.1),)},
        # six half-widths at 3 degrees cost 6 / 0.05236 = 114.59
        {"objective": "quantile", "cost_limit": 114.6},
        {"objective": "quantile", "half_widths": ()},
        {"objective": "scaling"},
    ],
)  # fmt: skip
def test_what_is_only_nearly_impossible_is_not_refused(changes: dict[str, Any]) -> None:
    """closed form: each differs by a little from a contradiction above, and allows something."""
    refuse_contradictions(replace(oracle_problem(), **changes))


def test_each_region_is_refused_at_its_own_pointer() -> None:
    """Two of three regions are at fault; the others' fiducials do not count towards a packing."""
    places = (
        _in(Ball(CENTRE_MM, 30.0), "/optimise/regions/0", count=4)["places"]
        + (FreeFiducial((4,), BoxRegion(np.ones(3), np.zeros(3)), "/optimise/regions/1"),)
        + (FreeFiducial((5,), TOO_SMALL, "/optimise/regions/2"), FreeFiducial((6,), TOO_SMALL, "/optimise/regions/2"))
        + (FreeFiducial((7,), Ball(np.array([0.0, 0.0, 350.0]), 5.0), "/optimise/regions/3"),)
    )
    with pytest.raises(DesignError) as error:
        refuse_contradictions(oracle_problem(places=places))
    found = [(problem.pointer, problem.code) for problem in error.value.problems]
    assert found == [
        ("/optimise/regions/1", "empty-box"),
        ("/optimise/min_spacing_mm", "does-not-fit"),
        ("/optimise/regions/3", "outside-view"),
    ]


def test_the_densest_packing_that_fits_is_not_refused() -> None:
    """closed form: eight fiducials 99.9 mm apart fit the corners of a 100 mm box."""
    refuse_contradictions(replace(oracle_problem(8), min_spacing_mm=99.9, min_projected_spacing_px=0.0))


@pytest.mark.parametrize(
    ("shape", "diameter_mm"), [(Ball(CENTRE_MM, 30.0), 60.0), (Cylinder(BASE_MM, UP, 80.0, 30.0), 100.0)]
)
def test_two_fiducials_fit_up_to_the_diameter_of_their_region(shape: Shape, diameter_mm: float) -> None:
    """closed form: two points of a ball are at most 2 r apart, of a cylinder at most its diagonal."""
    problem = oracle_problem(2, **_in(shape, count=2))
    refuse_contradictions(replace(problem, min_spacing_mm=diameter_mm - 0.1))
    assert _refused(replace(problem, min_spacing_mm=diameter_mm + 0.1)).pointer == "/optimise/min_spacing_mm"


def test_fixed_fiducials_must_keep_the_spacing_among_themselves() -> None:
    problem = oracle_problem()
    layout = problem.system.fiducials_mm.copy()
    layout[1] = layout[0] + [3.0, 0.0, 0.0]
    system = replace(problem.system, fiducials_mm=layout)
    refused = _refused(replace(problem, system=system, places=places_in_box(range(2, 8))))
    assert refused.pointer == "/optimise/fixed"
    assert "F1 and F2" in refused.detail
    assert "3 mm" in refused.detail


def test_a_fixed_fiducial_may_stay_in_a_keep_out_zone() -> None:
    problem = oracle_problem()
    zone = Ball(problem.system.fiducials_mm[0], 5.0)
    refuse_contradictions(replace(problem, places=places_in_box(range(1, 8)), **_kept_out(zone)))


def test_a_layout_that_cannot_matter_is_refused() -> None:
    problem = oracle_problem()
    silent = replace(problem.system, views=with_noise(0.0, target_px=0.5))
    assert _refused(replace(problem, system=silent)).code == "no-influence"
    made = replace(silent, manufacturing_half_width_mm=read_only(np.full((8, 3), 0.01)))
    refuse_contradictions(replace(problem, system=made))


def _present(problem: PlacementProblem, component: int, half_width_deg: float) -> PlacementProblem:
    """The same with another present half-width of one component of structure_connector."""
    first = problem.system.structure_connector
    widths = first.sources.half_width.copy()
    widths[component] = np.deg2rad(half_width_deg)
    sources = replace(first.sources, half_width=read_only(widths))
    return replace(problem, system=replace(problem.system, structure_connector=replace(first, sources=sources)))


def test_a_factor_on_a_tolerance_of_zero_is_refused_and_only_that() -> None:
    zero = _present(oracle_problem(), 2, 0.0)
    refuse_contradictions(zero)
    refuse_contradictions(replace(zero, objective="quantile", cost_limit=1e4))
    refused = _refused(replace(zero, objective="scaling"))
    assert (refused.pointer, refused.code) == ("/optimise/tolerances", "zero-half-width")
    assert "structure_connector rz" in refused.detail


def test_one_factor_must_suit_every_tolerance() -> None:
    """closed form: rx from 0.05 to 1 deg needs a factor 20; ry from 0.05 to at most 0.9 deg allows 18, to 1 deg 20."""
    rx, ry = (replace(free, pointer=f"/optimise/tolerances/{k}") for k, free in enumerate(free_rotations()[:2]))
    rx = replace(rx, minimum=np.deg2rad(1.0))
    problem = oracle_problem(objective="scaling", half_widths=(rx, replace(ry, maximum=np.deg2rad(0.9))))
    refused = _refused(problem)
    assert (refused.pointer, refused.code) == ("/optimise/tolerances/0", "no-common-factor")
    assert "at least 20 for structure_connector rx" in refused.detail
    assert "at most 18 for structure_connector ry" in refused.detail
    refuse_contradictions(replace(problem, half_widths=(rx, replace(ry, maximum=np.deg2rad(1.0)))))


def test_the_least_possible_cost_is_stated() -> None:
    """closed form: the cheapest grade that the largest half-width holds, and 1 / 0.05236 for 3 degrees."""
    grades = of_grades((PricedGrade("ground", np.deg2rad(0.1), 70.0), PricedGrade("milled", np.deg2rad(1.0), 30.0)))
    graded = replace(FIRST, minimum=np.deg2rad(0.1), maximum=np.deg2rad(1.0), price=grades)
    problem = oracle_problem(objective="quantile", cost_limit=49.0, half_widths=(graded, free_rotations()[1]))
    assert "49.0986" in _refused(problem).detail
    refuse_contradictions(replace(problem, cost_limit=49.1))


def _attainable(problem: PlacementProblem, limit_mm: float) -> str:
    with pytest.raises(InfeasibleError) as error:
        solve_placement(replace(problem, requirements=(requirement(limit_mm),)), starts=3, seed=0)
    assert _only(error).code == "limit-out-of-reach"
    return _only(error).detail


@pytest.mark.long
def test_a_limit_out_of_reach_says_what_is_attainable() -> None:
    """independent: just above the smallest quantile stated the problem is solved, at a large cost."""
    problem = replace(oracle_problem(), places=places_in_box((0, 1, 2, 3)))
    detail = _attainable(problem, 0.2)
    least = float(detail.split(" is ")[1].split(" mm")[0])
    assert "fiducial_noise:view0" in detail
    assert 0.2 < least < 0.5
    solution = solve_placement(replace(problem, requirements=(requirement(least * 1.01),)), starts=3, seed=0)
    assert solution.worst_ratio <= 1
    assert solution.cost > 10 * 3264  # ten times the best known cost at 0.5 mm


def test_infeasible_at_a_fixed_layout_names_the_tolerance_that_is_not_free() -> None:
    """closed form: a fixed tolerance of std 0.5 mm along one axis alone has P95 0.98 mm."""
    problem = fixed_layout(oracle_problem(), cube_fiducials())
    second = mount("connector_flange", (0.0, 0.0, -145.0), half_width=[0, 0, 0, 0.5, 0, 0])
    problem = replace(
        problem,
        system=replace(problem.system, connector_flange=second),
        half_widths=tuple(free for free in problem.half_widths if free.contributor == "structure_connector"),
    )
    detail = _attainable(problem, 0.9)
    assert "connector_flange " in detail
    assert float(detail.split(" is ")[1].split(" mm")[0]) > 0.98


@pytest.mark.long
def test_spacing_that_only_the_solver_finds_impossible_is_named() -> None:
    """Below the density that is refused at once, yet too much for a thin box: the row that fails is named."""
    problem = replace(
        oracle_problem(8),
        **_box(-30, -30, -20, 30, 30, -19),
        min_spacing_mm=33.0,
        min_projected_spacing_px=0.0,
        target_clearance_px=0.0,
    )
    refuse_contradictions(problem)
    with pytest.raises(InfeasibleError) as error:
        solve_placement(problem, starts=3, seed=0)
    assert _only(error).code == "layout-out-of-reach"
    assert "spacing of F" in _only(error).detail


def test_an_optimum_that_its_check_never_confirms_is_refused_with_the_first_two_reasons(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every check is made to fail here, at three targets: none of the optima may be returned."""
    checked = []

    def fail(system: Any, seed: int, *_: Any) -> Any:
        found = verify(system, seed=seed, trials=2**12)
        checks = tuple(replace(check, status="fail") for check in found.verdict.checks)
        checked.append(len(checks))
        return replace(found, verdict=replace(found.verdict, checks=checks))

    monkeypatch.setattr(tightening, "verify", fail)
    design = yaml.safe_load((Path(__file__).parents[2] / "examples" / "demo.yaml").read_text(encoding="utf-8"))
    del design["optimise"]["box"]  # the tolerances alone
    tip = design["targets"][0]
    places = [[at + 3 * k for at in tip["position_mm"]] for k in range(3)]
    design["targets"] = [{**tip, "name": f"t{k}", "position_mm": place} for k, place in enumerate(places)]
    with pytest.raises(NotConvergedError) as error:
        optimise(load_design(design), starts=1)
    problem = _only(error)
    assert problem.code == "not-verified"
    assert checked == [3] * tightening.MAX_TIGHTENING
    assert f"after {tightening.MAX_TIGHTENING} rounds" in problem.detail
    assert [name for name in ("t0", "t1", "t2") if f"target {name}:" in problem.detail] == ["t0", "t1"]
