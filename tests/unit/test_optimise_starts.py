"""Starting layouts: they keep every rule, and depend on their seed and number alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from optimise_scenes import BOX_MM, oracle_problem, requirement
from scenes import mount, target
from tailstack.geometry.arrays import Array
from tailstack.optimisation.problem import FreeFiducial, PlacementProblem
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, KeepOut, Shape, contains, mirror, sample, turns
from tailstack.optimisation.search import MANY_DEMANDS, Control, prepare_search
from tailstack.optimisation.starts import starting_layouts, with_copies
from tailstack.optimisation.terms import terms_of
from tailstack.propagation.linear import linearise

BOX = BoxRegion(BOX_MM[0], BOX_MM[1])
UP = np.array([0.0, 0.0, 1.0])
BASE_MM = np.array([0.0, 0.0, -90.0])
TUBE = Cylinder(BASE_MM, UP, 100.0, 50.0, 35.0)
SPHERE = Ball(np.array([0.0, 0.0, -40.0]), 60.0, 60.0)
LEFT, RIGHT = BoxRegion(BOX.low_mm, np.array([-20.0, 50.0, 10.0])), Ball(np.array([30.0, 0.0, -40.0]), 25.0)
NOT_SYMMETRIC = BoxRegion(BOX.low_mm, np.array([25.0, 50.0, 10.0]))  # only a part of it has its mirror image in it
CLAMP = KeepOut("clamp", BoxRegion(np.array([-10.0, -60.0, -60.0]), np.array([60.0, 0.0, -20.0])), 3.0)
ROUNDING = 1e-9


def places_of(region: Shape, fiducials: range, group: int = 1) -> tuple[FreeFiducial, ...]:
    return tuple(FreeFiducial(tuple(fiducials[k : k + group]), region) for k in range(0, len(fiducials), group))


PROBLEMS: dict[str, PlacementProblem] = {
    "box": oracle_problem(8),
    "tube, turned three times": oracle_problem(
        12, places=places_of(TUBE, range(12), 3), symmetry=turns(np.zeros(3), UP, 3), keep_out=(CLAMP,)
    ),
    "mirrored box": oracle_problem(
        10, places=places_of(NOT_SYMMETRIC, range(10), 2), symmetry=mirror(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    ),
    "sphere about a clamp": oracle_problem(10, places=places_of(SPHERE, range(10)), keep_out=(CLAMP,)),
    "two regions, one fixed": oracle_problem(
        9, places=places_of(LEFT, range(4)) + places_of(RIGHT, range(5, 9)), keep_out=(CLAMP,)
    ),
}  # fmt: skip


def broken_rules(problem: PlacementProblem, layout: Array) -> list[str]:
    """Every rule written out from the record of the problem, for scenes without bias: told is true."""
    found = []
    free = set(problem.free_fiducials)
    fixed = [i for i in range(len(layout)) if i not in free]
    if not np.array_equal(layout[fixed], problem.system.fiducials_mm[fixed]):
        found.append("fixed fiducials")
    pairs = [(i, j) for i, j in combinations(range(len(layout)), 2) if {i, j} & free]
    if any(np.linalg.norm(layout[i] - layout[j]) < problem.min_spacing_mm - ROUNDING for i, j in pairs):
        found.append("spacing")

    def seen(view: Any, point: Array) -> Array:
        image: Array = view.projection @ np.append(point, 1.0)
        assert image[2] > 0
        return image[:2] / image[2]

    for view in problem.system.views:
        images = [seen(view, point) for point in layout]
        centre = seen(view, problem.targets[0].position_mm)
        if any(np.linalg.norm(images[i] - images[j]) < problem.min_projected_spacing_px - 1e-6 for i, j in pairs):
            found.append("spacing of images")
        for i in free:
            edge = min(*images[i], *(np.array(view.image_size_px) - 1 - images[i]))
            if edge < problem.image_margin_px - 1e-6:
                found.append("margin")
            if np.linalg.norm(images[i] - centre) < problem.target_clearance_px - 1e-6:
                found.append("target clearance")
    for place in problem.places:
        own = layout[list(place.fiducials)]
        if not contains(place.region, own).all():
            found.append("region")
        for isometry, copy in zip(problem.symmetry, own[1:], strict=True):
            if not np.allclose(isometry.rotation @ own[0] + isometry.shift_mm, copy, rtol=0, atol=1e-9):
                found.append("symmetry")
    for zone in problem.keep_out:
        assert isinstance(zone.shape, BoxRegion)
        for point in layout[sorted(free)]:
            beyond = np.maximum(zone.shape.low_mm - point, point - zone.shape.high_mm).max()
            if beyond < zone.clearance_mm - 1e-6:
                found.append("keep-out")
    return found


def list_layouts(problem: PlacementProblem, starts: int, seed: int) -> list[Array]:
    """All that the search would start from."""
    terms = tuple(terms_of(problem, demand) for demand in problem.demands)
    return list(starting_layouts(problem, terms, starts, seed))


@pytest.mark.parametrize("name", PROBLEMS)
def test_starts_keep_every_rule(name: str) -> None:
    """independent: the rules written out a second time, on four starts after the first."""
    problem = PROBLEMS[name]
    for layout in list_layouts(problem, 5, 3)[1:]:
        assert broken_rules(problem, layout) == []


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_start_depends_on_the_seed_and_its_number_alone(name: str) -> None:
    """independent: more starts only add; another seed gives others."""
    problem = PROBLEMS[name]
    some, more = list_layouts(problem, 3, 11), list_layouts(problem, 5, 11)
    np.testing.assert_array_equal(some, more[:3])
    assert not np.array_equal(list_layouts(problem, 2, 12)[1], some[1])


def test_the_first_start_is_the_present_layout() -> None:
    """closed form: inside its region it stays; outside it moves to the nearest point; copies follow."""
    problem = PROBLEMS["box"]
    np.testing.assert_array_equal(list_layouts(problem, 1, 0)[0], problem.system.fiducials_mm)
    nothing = replace(problem, places=())
    np.testing.assert_array_equal(list_layouts(nothing, 4, 0), [problem.system.fiducials_mm])
    outside = problem.system.fiducials_mm.copy()
    outside[0] = [80.0, 10.0, -200.0]
    moved = replace(problem, system=replace(problem.system, fiducials_mm=outside))
    np.testing.assert_allclose(list_layouts(moved, 1, 0)[0][0], [50.0, 10.0, -90.0])
    mirrored = PROBLEMS["mirrored box"]
    layout = list_layouts(mirrored, 1, 0)[0]
    kept = np.minimum(mirrored.system.fiducials_mm[::2], NOT_SYMMETRIC.high_mm)
    np.testing.assert_array_equal(layout[::2], kept)
    np.testing.assert_allclose(layout[1::2], layout[::2] * [-1.0, 1.0, 1.0], atol=1e-12)


def _mean_square(problem: PlacementProblem, layout: Array) -> float:
    """Image noise at the target, mm^2, by the compiled model that the score uses."""
    model = linearise(replace(problem.system, fiducials_mm=layout), problem.targets[0])
    gains = [block.columns_mm("tcp") for block in model.blocks if "noise" in block.contributor]
    return float(sum((gain**2).sum() for gain in gains))


@pytest.mark.parametrize("name", PROBLEMS)
def test_exchanged_starts_are_better_than_random_layouts(name: str) -> None:
    """independent: by the score's own linear model the worst of four starts beats the best of ten layouts drawn
    uniformly, rules or not."""
    problem, rng = PROBLEMS[name], np.random.default_rng(3)
    exchanged = [_mean_square(problem, layout) for layout in list_layouts(problem, 5, 3)[1:]]
    drawn = []
    for _ in range(10):
        layout = problem.system.fiducials_mm.copy()
        for place in problem.places:
            layout[list(place.fiducials)] = with_copies(problem, sample(place.region, rng, 1, 0.0))[0]
        drawn.append(_mean_square(problem, layout))
    assert max(exchanged) < min(drawn)


def test_where_no_layout_to_begin_with_determines_the_error_every_demand_enters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beyond MANY_DEMANDS those enter that lead at the first layouts: of which none leads where none tells."""
    names = [f"target {k}" for k in range(MANY_DEMANDS + 1)]
    targets = tuple(target((0.0, 0.0, 70.0 + k), name) for k, name in enumerate(names))
    system = replace(PROBLEMS["box"].system, targets=targets)
    limited = requirement(0.5, targets=tuple(names))
    monkeypatch.setattr("tailstack.optimisation.search.is_singular", lambda *_: True)
    problem = replace(PROBLEMS["box"], system=system, requirements=(limited,))
    prepared = prepare_search(problem, starts=1, control=Control(threads=1))
    assert len(prepared.program.terms) == len(prepared.terms) == len(names)


def test_the_exchange_weighs_targets_by_their_limits() -> None:
    """independent: a far target with a limit so loose that it never matters changes no start; with the same it does."""
    near = replace(oracle_problem(8), target_clearance_px=0.0)
    far = target((0.0, 0.0, 200.0), "far")
    turned = mount(
        "connector_flange", (0.0, 0.0, -145.0), bias=(0.01, 0, 0, 0, 0, 0), half_width=[np.deg2rad(0.05)] * 3 + [0] * 3
    )
    near = replace(near, system=replace(near.system, targets=(*near.system.targets, far), connector_flange=turned))
    first = near.requirements[0]
    alone = list_layouts(near, 3, 3)
    for limit, same in ((100.0, True), (first.limit, False)):
        second = replace(first, name="far", targets=("far",), limit=limit)
        both = list_layouts(replace(near, requirements=(first, second)), 3, 3)
        assert np.array_equal(both, alone) == same
