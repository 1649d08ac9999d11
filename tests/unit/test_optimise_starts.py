"""Starting, careless and textbook layouts: they keep every rule, depend on their seed alone, and are what they say."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from optimise_scenes import BOX_MM, oracle_problem
from scenes import mount, target
from tailstack.geometry.arrays import Array
from tailstack.optimisation.present import broken_rules as found_broken
from tailstack.optimisation.problem import FreeFiducial, PlacementProblem
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, KeepOut, Shape, contains, mirror, turns
from tailstack.optimisation.starts import careless_layouts, starting_layouts, textbook_layout
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


def given(problem: PlacementProblem) -> tuple[PlacementProblem, Any]:
    return problem, tuple(terms_of(problem, demand) for demand in problem.demands)


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


@pytest.mark.parametrize("name", PROBLEMS)
def test_starts_keep_every_rule(name: str) -> None:
    """independent: the rules written out a second time, on four starts after the first."""
    problem = PROBLEMS[name]
    for layout in starting_layouts(*given(problem), 5, 3)[1:]:
        assert broken_rules(problem, layout) == []


@pytest.mark.parametrize("name", PROBLEMS)
def test_careless_layouts_keep_every_rule_and_differ(name: str) -> None:
    """independent: the same rules, on twenty layouts of which no two are the same."""
    problem = PROBLEMS[name]
    layouts = careless_layouts(*given(problem), 20, 3)
    assert len(layouts) == 20
    assert [broken for layout in layouts if (broken := broken_rules(problem, layout))] == []
    assert len({layout.tobytes() for layout in layouts}) == 20


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_start_depends_on_the_seed_and_its_number_alone(name: str) -> None:
    """independent: more starts only add; another seed gives others."""
    args = given(PROBLEMS[name])
    some, more = starting_layouts(*args, 3, 11), starting_layouts(*args, 5, 11)
    np.testing.assert_array_equal(some, more[:3])
    assert not np.array_equal(starting_layouts(*args, 2, 12)[1], some[1])
    np.testing.assert_array_equal(careless_layouts(*args, 2, 11), careless_layouts(*args, 4, 11)[:2])


def test_the_first_start_is_the_present_layout() -> None:
    """closed form: inside its region it stays; outside it moves to the nearest point; copies follow."""
    problem = PROBLEMS["box"]
    args = given(problem)
    np.testing.assert_array_equal(starting_layouts(*args, 1, 0)[0], problem.system.fiducials_mm)
    nothing = replace(problem, places=())
    np.testing.assert_array_equal(starting_layouts(*given(nothing), 4, 0), [problem.system.fiducials_mm])
    outside = problem.system.fiducials_mm.copy()
    outside[0] = [80.0, 10.0, -200.0]
    moved = replace(problem, system=replace(problem.system, fiducials_mm=outside))
    np.testing.assert_allclose(starting_layouts(*given(moved), 1, 0)[0][0], [50.0, 10.0, -90.0])
    mirrored = PROBLEMS["mirrored box"]
    layout = starting_layouts(*given(mirrored), 1, 0)[0]
    kept = np.minimum(mirrored.system.fiducials_mm[::2], NOT_SYMMETRIC.high_mm)
    np.testing.assert_array_equal(layout[::2], kept)
    np.testing.assert_allclose(layout[1::2], layout[::2] * [-1.0, 1.0, 1.0], atol=1e-12)


def _mean_square(problem: PlacementProblem, layout: Array) -> float:
    """Image noise at the target, mm^2, by the compiled model that the score uses."""
    model = linearise(replace(problem.system, fiducials_mm=layout), problem.targets[0])
    gains = [block.columns_mm("tcp") for block in model.blocks if "noise" in block.contributor]
    return float(sum((gain**2).sum() for gain in gains))


@pytest.mark.parametrize("name", PROBLEMS)
def test_exchanged_starts_are_better_than_careless_ones(name: str) -> None:
    """independent: by the score's own linear model the worst of four starts beats the best of ten careless layouts."""
    problem = PROBLEMS[name]
    args = given(problem)
    exchanged = [_mean_square(problem, layout) for layout in starting_layouts(*args, 5, 3)[1:]]
    careless = [_mean_square(problem, layout) for layout in careless_layouts(*args, 10, 3)]
    assert max(exchanged) < min(careless)


def test_careless_layouts_are_uniform_without_rules() -> None:
    """sampled: a coordinate lies in the middle half of its side half of the time; five sigma (1 in 2 million)."""
    free = oracle_problem(
        8, min_spacing_mm=0.0, min_projected_spacing_px=0.0, image_margin_px=0.0, target_clearance_px=0.0
    )
    layouts = np.array(careless_layouts(*given(free), 200, 1))
    middle = np.abs(layouts - (BOX.low_mm + BOX.high_mm) / 2) < (BOX.high_mm - BOX.low_mm) / 4
    assert abs(middle.mean() - 0.5) <= 5 * 0.5 / np.sqrt(middle.size)


def test_rules_that_are_too_tight_for_chance_give_fewer_layouts() -> None:
    """closed form: eight fiducials 95 mm apart must be near the eight corners; chance finds none."""
    tight = oracle_problem(8, min_spacing_mm=95.0, min_projected_spacing_px=0.0)
    assert careless_layouts(*given(tight), 3, 1) == []


def test_the_exchange_weighs_targets_by_their_limits() -> None:
    """independent: a far target with a limit so loose that it never matters changes no start; with the same it does."""
    near = replace(oracle_problem(8), target_clearance_px=0.0)
    far = target((0.0, 0.0, 200.0), "far")
    turned = mount(
        "connector_flange", (0.0, 0.0, -145.0), bias=(0.01, 0, 0, 0, 0, 0), half_width=[np.deg2rad(0.05)] * 3 + [0] * 3
    )
    near = replace(near, system=replace(near.system, targets=(*near.system.targets, far), connector_flange=turned))
    first = near.requirements[0]
    alone = starting_layouts(*given(near), 3, 3)
    for limit, same in ((100.0, True), (first.limit, False)):
        second = replace(first, name="far", targets=("far",), limit=limit)
        both = starting_layouts(*given(replace(near, requirements=(first, second))), 3, 3)
        assert np.array_equal(both, alone) == same


def _textbook(problem: PlacementProblem, **changes: Any) -> tuple[str, Array]:
    found = textbook_layout(replace(problem, **changes))
    assert found is not None
    return found


def test_eight_go_to_the_corners_of_the_box() -> None:
    """closed form: every corner once; of six or seven the ones left out are opposite; a fixed one stays."""
    name, layout = _textbook(oracle_problem(8))
    every = {tuple(x) for x in layout}
    assert name == "the corners of the box"
    assert every == {(x, y, z) for x in (-50.0, 50.0) for y in (-50.0, 50.0) for z in (-90.0, 10.0)}
    seven = {tuple(x) for x in _textbook(oracle_problem(7))[1]}
    assert len(seven) == 7
    assert seven < every
    six = every - {tuple(x) for x in _textbook(oracle_problem(6))[1]}
    assert np.linalg.norm(np.subtract(*six)) == pytest.approx(100 * np.sqrt(3))
    one_fixed = oracle_problem(9, places=places_of(BOX, range(1, 9)))
    layout = _textbook(one_fixed)[1]
    np.testing.assert_array_equal(layout[0], one_fixed.system.fiducials_mm[0])
    assert {tuple(x) for x in layout[1:]} == every


@pytest.mark.parametrize(
    ("count", "levels"), [(8, [8, 0, 0, 0]), (13, [8, 5, 0, 0]), (20, [8, 12, 0, 0]), (23, [8, 12, 3, 0]),
                          (27, [8, 12, 6, 1])]
)  # fmt: skip
def test_more_go_to_edges_faces_and_the_centre(count: int, levels: list[int]) -> None:
    """closed form: points of the 3 x 3 x 3 lattice by how many of their coordinates are central, each once."""
    layout = _textbook(oracle_problem(count))[1]
    unit = (layout - [0.0, 0.0, -40.0]) / 50
    assert np.isin(unit, [-1.0, 0.0, 1.0]).all()
    assert len({tuple(x) for x in layout}) == count
    assert np.bincount((unit == 0).sum(axis=1), minlength=4).tolist() == levels


@pytest.mark.parametrize("count", [8, 11])
def test_a_cylinder_gets_two_rings(count: int) -> None:
    """closed form: regular polygons on both rims; with equal rings the second is turned by half a step."""
    tilted = Cylinder(BASE_MM, np.array([2.0, -1.0, 2.0]) / 3, 60.0, 40.0, 20.0)
    name, layout = _textbook(oracle_problem(count), places=places_of(tilted, range(count)))
    assert name.startswith("two rings at the ends of the cylinder")
    along = (layout - BASE_MM) @ tilted.axis
    for end, size in ((0.0, (count + 1) // 2), (60.0, count // 2)):
        ring = layout[np.abs(along - end) < 1e-9]
        assert len(ring) == size
        np.testing.assert_allclose(np.linalg.norm(ring - BASE_MM - end * tilted.axis, axis=1), 40.0)
        sides = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
        np.testing.assert_allclose(sides, 80 * np.sin(np.pi / size))
    if count == 8:
        across = layout - BASE_MM - along[:, None] * tilted.axis
        nearest = np.linalg.norm(across[:4, None] - across[None, 4:], axis=2).min(axis=1)
        np.testing.assert_allclose(nearest, 80 * np.sin(np.pi / 8))


def test_a_textbook_layout_may_break_rules() -> None:
    """closed form: 100 mm apart are the corners; the clamp covers one of them."""
    corners = replace(oracle_problem(8), min_projected_spacing_px=0.0)
    zone = KeepOut("corner", Ball(np.array([50.0, 50.0, 10.0]), 5.0), 0.0)
    for changes, broken in (
        ({"min_spacing_mm": 99.9}, 0), ({"min_spacing_mm": 100.1}, 12), ({"keep_out": (zone,)}, 1),
    ):  # fmt: skip
        problem = replace(corners, **changes)
        assert len([*found_broken(*given(problem), _textbook(problem)[1])]) == broken
    margin = replace(corners, image_margin_px=400.0)
    assert any(found_broken(*given(margin), _textbook(margin)[1]))


@pytest.mark.parametrize(
    "problem",
    [
        PROBLEMS["mirrored box"],
        PROBLEMS["sphere about a clamp"],
        PROBLEMS["two regions, one fixed"],
        oracle_problem(28),
        oracle_problem(8, places=places_of(BOX, range(5))),
        oracle_problem(8, places=places_of(BoxRegion(BOX.low_mm, np.array([50.0, 50.0, -90.0])), range(8))),
        oracle_problem(8, places=places_of(Cylinder(BASE_MM, UP, 0.0, 50.0), range(8))),
        oracle_problem(8, places=()),
    ],
)
def test_the_textbook_has_no_answer_for_the_rest(problem: PlacementProblem) -> None:
    """closed form: symmetry, balls, several regions, more than 27, fewer than six, and what has no depth."""
    assert textbook_layout(problem) is None
