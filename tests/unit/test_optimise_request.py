"""Each freedom of the ``optimise`` section, from the document to the new document, by plain geometry."""

from __future__ import annotations

import copy
from dataclasses import replace
from itertools import permutations
from math import dist, radians
from typing import Any

import numpy as np
import pytest

from optimise_documents import (
    BOX,
    PIVOT_MM,
    POINTS_MM,
    document,
    free,
    half_width,
    moving,
    normal,
    optimised,
    positions,
)
from plain_data import DEMO, EXAMPLES, problems_of
from scenes import taken
from tailstack import optimise, verify
from tailstack.design import Design, design_to_data, load_design
from tailstack.errors import DesignError
from tailstack.geometry.arrays import Array
from tailstack.optimisation import regions
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.request import read_request
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import every_terms, image_parts_at
from tailstack.propagation.linear import linearise
from tailstack.results import Optimisation
from tailstack.scoring import score

WRITTEN_MM = 2e-6  # positions on curved surfaces and copies of a symmetry are written to 1e-6 mm

SHAPES: dict[str, dict[str, Any]] = {
    "cylinder": {"cylinder": {"base_mm": [0, 0, -85], "height_mm": 100, "radius_mm": 45}},
    "tilted tube": {
        "cylinder": {
            "base_mm": [0, -40, -75], "axis": [0, 3, 3], "height_mm": 95, "radius_mm": 48, "inner_radius_mm": 30
        }
    },
    "on a cylinder": {
        "cylinder": {"base_mm": [0, 0, -85], "height_mm": 100, "radius_mm": 45, "inner_radius_mm": 45}
    },
    "ball": {"ball": {"centre_mm": [0, 0, -35], "radius_mm": 55}},
    "shell": {"ball": {"centre_mm": [0, 0, -40], "radius_mm": 60, "inner_radius_mm": 50}},
}  # fmt: skip


def excess_mm(region: dict[str, Any], points: Array) -> float:
    """How far the worst of some points (N, 3) is outside a region of the document; negative: all are inside."""
    ((kind, shape),) = region.items()
    if kind == "box":
        return float(np.maximum(np.subtract(shape["min_mm"], points), points - shape["max_mm"]).max())
    if kind == "ball":
        radius = np.linalg.norm(points - shape["centre_mm"], axis=1)
        return float(np.maximum(radius - shape["radius_mm"], shape.get("inner_radius_mm", 0) - radius).max())
    axis = np.array(shape.get("axis", [0, 0, 1])) / np.linalg.norm(shape.get("axis", [0, 0, 1]))
    along = (points - shape["base_mm"]) @ axis
    radius = np.linalg.norm(points - shape["base_mm"] - along[:, None] * axis, axis=1)
    ends = np.maximum(-along, along - shape["height_mm"])
    sides = np.maximum(radius - shape["radius_mm"], shape.get("inner_radius_mm", 0) - radius)
    return float(np.maximum(ends, sides).max())


def assert_scores_as_promised(result: Optimisation) -> None:
    """The written document scores what the record says, within the limits."""
    scored = score(load_design(result.design), losses=False)
    assert max(target.p95_mm for target in scored.targets) == pytest.approx(result.p95_after_mm, rel=1e-9)
    assert all(check.value <= check.limit for check in scored.verdict.checks)


@pytest.mark.parametrize("name", SHAPES)
def test_a_region_of_every_shape(name: str) -> None:
    """closed form: distance from the axis and the centre, of random points and of points of the region."""
    places = read_request(load_design(document(**moving(box=None, region=SHAPES[name])))).problem.places
    (shape,), _ = regions.distinct([place.region for place in places])
    rng = np.random.default_rng(8)
    points = np.vstack([rng.uniform(-70, 70, (2000, 3)) - [0, 0, 35], regions.sample(shape, rng, 200, 0.5)])
    inside = np.array([excess_mm(SHAPES[name], point[None]) < WRITTEN_MM for point in points])
    assert (regions.contains(shape, points) == inside).all()
    assert 200 <= inside.sum() < len(points)


def test_zones_and_groups_that_turn_are_those_of_the_section() -> None:
    """closed form: distance to a box, a cylinder and a ball; copies 120 degrees apart about a tilted axis."""
    zones: list[dict[str, Any]] = [
        {"name": "clamp", "clearance_mm": 4.0, "box": {"min_mm": [-60, -60, -100], "max_mm": [-20, 60, -60]}},
        {"name": "rod", "clearance_mm": 2.5,
         "cylinder": {"base_mm": [45, 45, -300], "height_mm": 600, "radius_mm": 15}},
        {"name": "head", "ball": {"centre_mm": [45, -45, -85], "radius_mm": 20}},
    ]  # fmt: skip
    axis, point = np.array([0.0, 0.2, 1.0]) / np.sqrt(1.04), np.array([2.0, -3.0, 0.0])
    symmetry = {"rotation": {"axis": [0, 0.4, 2.0], "point_mm": point.tolist(), "order": 3}}
    asked = moving(symmetry=symmetry, fixed=["F7"], keep_out=zones)
    problem = read_request(load_design(document(7, **asked))).problem
    assert [place.fiducials for place in problem.places] == [(0, 1, 2), (3, 4, 5)]
    points = np.random.default_rng(9).uniform([-80, -80, -120], [80, 80, 0], (3000, 3))
    beyond = np.maximum([-64, -64, -104] - points, points - [-16, 64, -56]).max(axis=1)  # each face moved out by 4 mm
    to_rod, to_head = np.linalg.norm(points[:, :2] - 45, axis=1), np.linalg.norm(points - [45, -45, -85], axis=1)
    for zone, gap in zip(problem.keep_out, (beyond, to_rod - 17.5, to_head - 20), strict=True):
        assert (regions.clear_of(zone, points) == (gap >= 0)).all()
        assert 10 < (gap < 0).sum() < len(points)
    along = (points - point) @ axis
    across = points - point - along[:, None] * axis
    for k, copy_of in enumerate(problem.symmetry, start=1):  # -1/2 of itself, sqrt(3)/2 across it
        turned = -across / 2 + (-1) ** (k + 1) * np.sqrt(3) / 2 * np.cross(axis, across)
        np.testing.assert_allclose(regions.move(copy_of, points), point + along[:, None] * axis + turned, atol=1e-9)


@pytest.mark.long
def test_regions_for_groups_leave_the_others_where_they_are() -> None:
    low = {"box": {"min_mm": [-45, -45, -85], "max_mm": [45, 10, -45]}}
    high = {"ball": {"centre_mm": [5, 5, -10], "radius_mm": 45, "inner_radius_mm": 10}}
    regions = [{"fiducials": ["F2", "F1"], **low}, {"fiducials": ["F5", "F4"], **high}]
    result = optimised(document(**moving(box=None, regions=regions)))
    now = positions(result.design)
    assert sorted(entry.label for entry in result.moved) == ["F1", "F2", "F4", "F5"]
    assert excess_mm(low, np.array([now["F1"], now["F2"]])) <= WRITTEN_MM
    assert excess_mm(high, np.array([now["F4"], now["F5"]])) <= WRITTEN_MM
    assert (now["F3"], now["F6"]) == (list(POINTS_MM[2]), list(POINTS_MM[5]))
    for entry in result.moved:
        assert entry.after_mm == tuple(now[entry.label])
        assert entry.before_mm == POINTS_MM[int(entry.label[1:]) - 1]
    assert_scores_as_promised(result)


@pytest.mark.long
def test_more_fiducials_where_they_pay() -> None:
    """Six are there, seven or eight are allowed, they are free of charge: eight, the new ones with new labels."""
    data = document(**moving(count={"min": 7, "max": 8}, fixed=["F2"]))
    data["fiducials"]["points"][0]["label"] = "F7"  # taken: the new ones are F1 and F8
    result = optimised(data)
    assert [tried.fiducials for tried in result.counts] == [7, 8]
    assert list(positions(result.design)) == ["F7", "F2", "F3", "F4", "F5", "F6", "F1", "F8"]
    assert positions(result.design)["F2"] == list(POINTS_MM[1])
    assert [entry.label for entry in result.moved] == ["F7", "F3", "F4", "F5", "F6", "F1", "F8"]
    assert [entry.before_mm for entry in result.moved[-2:]] == [None, None]
    assert result.moves is None  # there is no layout of eight that could be left
    assert result.counts[1].cost < result.counts[0].cost
    assert_scores_as_promised(result)
    # independent: the design with the new ones already in it, same freedom, no count
    there = document(8, **moving(fixed=["F2"]))
    assert result.counts[1].cost == pytest.approx(optimised(there).cost_closed_form, rel=2e-3)


@pytest.mark.long
def test_fewer_fiducials_where_each_has_its_price() -> None:
    """closed form: the cost is the half-widths' and 60 for each fiducial, before and after, in every count tried."""
    result = optimised(document(8, **moving(fixed=["F8"], count={"min": 6, "max": 8, "cost_per_fiducial": 60.0})))
    by_count = {tried.fiducials: tried.cost for tried in result.counts}
    chosen = len(positions(result.design))
    assert min(by_count, key=lambda count: by_count[count] or np.inf) == chosen == 6
    widths = [half_width(result.design, item, axis) for item in PIVOT_MM for axis in ("rx", "ry")]
    assert result.cost_after == pytest.approx(sum(1 / radians(width) for width in widths) + 60 * 6, rel=1e-9)
    assert result.cost_before == pytest.approx(4 / radians(0.1) + 60 * 8, rel=1e-9)
    assert by_count[6] == pytest.approx(result.cost_after, rel=0.02)
    # brute force: left out are the two without which the others move least
    now, before = (positions(each) for each in (result.design, result.design_before))
    ways = [[dist(now[label], before[own]) for own in list(before)[:7]] for label in list(now)[:-1]]
    least = min(sum(ways[k][j] for k, j in enumerate(own)) for own in permutations(range(7), len(ways)))
    told = [dist(entry.after_mm, entry.before_mm) for entry in result.moved if entry.after_mm and entry.before_mm]
    assert sum(told) == pytest.approx(least, rel=1e-12)
    assert [entry.label for entry in result.moved if entry.after_mm is None] == sorted(set(before) - set(now))
    assert positions(result.design)["F8"] == list(POINTS_MM[7])
    assert "fiducials included" in result.objective


@pytest.mark.long
def test_counts_go_by_the_symmetry_and_by_the_quantile_where_no_cost_is_asked_for() -> None:
    section: dict[str, Any] = {"box": BOX, "min_spacing_mm": 12.0, "symmetry": {"mirror": {"normal": [1, 1, 0]}}}
    result = optimised(document(7, count={"min": 6, "max": 9}, fixed=["F7"], **section))
    assert [tried.fiducials for tried in result.counts] == [7, 9]  # F7 and whole pairs
    assert [tried.cost for tried in result.counts] == [None, None]
    assert len(positions(result.design)) == 9
    ratios = [tried.worst_ratio for tried in result.counts]
    assert None not in ratios
    assert ratios[1] < ratios[0]  # type: ignore[operator]
    assert result.p95_after_mm == pytest.approx(ratios[1], rel=0.02)  # the limit is 1 mm


def test_common_bounds_and_exceptions() -> None:
    """Every rotation and translation declared, within the common bounds, but for the two that are listed."""
    flange_rx = {"min_deg": 0.02, "max_deg": 0.05, "cost_weight": 9.0}
    result = optimised(
        document(
            rotation_bounds={"min_deg": 0.15, "max_deg": 0.4, "cost_weight": 2.0},
            translation_bounds={"min_mm": 0.001, "max_mm": 0.06, "cost_weight": 0.5},
            tolerances=[free("connector_flange", "rx", **flange_rx),
                        free("structure_connector", "ry", min_deg=0.03, max_deg=0.03)],
        )
    )  # fmt: skip
    found = {(item.contributor, item.component): item for item in result.tolerances}
    assert list(found) == [("structure_connector", axis) for axis in ("rx", "ry", "tx")] + [
        ("connector_flange", axis) for axis in ("rx", "ry")
    ]
    limits = {("structure_connector", "rx"): (0.15, 0.4, 2.0), ("structure_connector", "ry"): (0.03, 0.03, 1.0),
              ("structure_connector", "tx"): (0.001, 0.06, 0.5), ("connector_flange", "rx"): (0.02, 0.05, 9.0),
              ("connector_flange", "ry"): (0.15, 0.4, 2.0)}  # fmt: skip
    for key, (low, high, weight) in limits.items():
        item = found[key]
        assert item.after_half_width == pytest.approx(half_width(result.design, *key), rel=1e-9)
        assert low * (1 - 1e-9) <= item.after_half_width <= high * (1 + 1e-9)
        native = radians(item.after_half_width) if item.unit == "deg" else item.after_half_width
        assert item.cost_after == pytest.approx(weight / native, rel=1e-9)
    assert found["structure_connector", "tx"].unit == "mm"
    assert not result.moved
    assert_scores_as_promised(result)


@pytest.mark.long
def test_locators_as_tolerances() -> None:
    """independent: cost by hand, P95 by the score of the document: the 3-2-1 example with one target and one limit."""
    names = ("A1", "A2", "A3", "B1", "B2", "C1")
    data = design_to_data(load_design(EXAMPLES / "locators_321.yaml"))
    data["targets"] = [target for target in data["targets"] if target["name"] == "centre"]
    data["requirements"] = [{"name": "accuracy", "error": "tcp", "limit_mm": 0.45}]
    tolerances = [free("structure_connector", name, min_mm=0.002, max_mm=0.2) for name in names]
    result = optimised(data | {"optimise": {"starts": 1, "tolerances": tolerances}})
    widths = {item.component: item.after_half_width for item in result.tolerances}
    assert widths == pytest.approx(
        {name: half_width(result.design, "structure_connector", name) for name in names}, rel=1e-9
    )
    assert result.cost_after == pytest.approx(sum(1 / width for width in widths.values()), rel=1e-9)
    assert_scores_as_promised(result)


def test_a_pivot_goes_where_two_targets_balance() -> None:
    """brute force: the score over a grid of pivots; closed form: midway between the targets but for their images."""
    data = document(pivots=[{"interface": "connector_flange",
                             "box": {"min_mm": [-5, 0, -145], "max_mm": [5, 0, 95]}}])  # fmt: skip
    data["interfaces"]["connector_flange"]["tolerances"] = {axis: normal("deg", 0.5) for axis in ("rx", "ry")}
    data["targets"].append({"name": "entry", "position_mm": [0.0, 0.0, 20.0]})
    result = optimised(data)
    (pivot,) = result.pivots
    assert pivot.before_mm == (0.0, 0.0, -145.0)
    assert list(pivot.after_mm) == result.design["interfaces"]["connector_flange"]["pivot_mm"]  # type: ignore[index]

    def worst(*pivot_mm: float) -> float:
        data["interfaces"]["connector_flange"]["pivot_mm"] = list(pivot_mm)
        return max(target.p95_mm for target in score(load_design(data), losses=False).targets)

    grid = np.linspace(35, 70, 15)
    values = [worst(0.0, 0.0, z) for z in grid]
    assert worst(*pivot.after_mm) == pytest.approx(result.p95_after_mm, rel=1e-9)
    assert result.p95_after_mm <= min(values) * (1 + 1e-6)
    assert abs(pivot.after_mm[2] - grid[int(np.argmin(values))]) <= grid[1] - grid[0]
    assert 45 < pivot.after_mm[2] < 70  # the far target has the larger image noise


def with_beads(count: int, survive: dict | None, **section: object) -> Design:
    """The drill guide with so many of its beads."""
    data = copy.deepcopy(DEMO)
    data["fiducials"]["points"] = data["fiducials"]["points"][:count]
    data["optimise"] |= {"starts": 1, **({} if survive is None else {"survive": survive}), **section}
    return load_design(data)


def beads_alone(count: int, survive: dict | None) -> Design:
    """Nothing but the places of the beads is free."""
    data = copy.deepcopy(with_beads(count, survive).source.data)
    data["optimise"] |= {"objective": "quantile"}
    data["optimise"].pop("rotation_bounds")
    data["requirements"][0]["limit_mm"] = 2.0
    return load_design(data)


@pytest.mark.long
@pytest.mark.parametrize(
    ("plain", "safe", "lost"),
    [
        (with_beads(7, None), with_beads(7, {"lost": 1, "limit_mm": 1.02}), 1),
        (beads_alone(7, None), beads_alone(7, {"lost": 1, "limit_mm": 1.12}), 1),
        (beads_alone(9, None), beads_alone(9, {"lost": 2, "limit_mm": 1.5}), 2),
    ],
    ids=["cost", "places", "places, pairs"],
)
def test_what_survives_a_loss_beats_what_was_not_asked_to(plain, safe, lost):
    """sampled: Monte Carlo of both designs without the beads whose loss is worst for each."""
    before, after = optimise(plain), optimise(safe)
    assert before.survived is None
    found = after.survived
    assert len(found.lost) == lost
    assert found.interval_mm[1] <= found.limit_mm
    for record, beaten in ((before, True), (after, False)):
        design = load_design(record.design)
        (losses,) = score(design).losses
        worst = losses.single if lost == 1 else losses.double
        assert (worst.value > found.limit_mm) == beaten
        left = copy.deepcopy(design.source.data)
        labels = [point["label"] for point in left["fiducials"]["points"]]
        gone = [labels.index(label) for label in worst.lost]
        left["fiducials"]["points"] = [p for k, p in enumerate(left["fiducials"]["points"]) if k not in gone]
        left.pop("optimise")
        estimate = verify(load_design(left), trials=2**15, seed=3).targets[0]
        assert (estimate.p95_interval_mm[0] > found.limit_mm) == beaten


def test_what_cannot_be_survived_is_refused_where_it_is_asked_for():
    problem = problems_of(with_beads, 7, {"lost": 2, "limit_mm": 1.0}, error=DesignError)[0]
    assert (problem.pointer, problem.code) == ("/optimise/survive/lost", "too-few-fiducials")
    with pytest.raises(DesignError):
        with_beads(8, {"lost": 1, "limit_mm": 1.0}, objective="pareto")
    data = copy.deepcopy(with_beads(8, {"lost": 2, "limit_mm": 1.0}).source.data)
    data["views"][0]["sees"] = [point["label"] for point in data["fiducials"]["points"]][:7]
    with pytest.raises(DesignError, match="5 fiducials would be left"):
        load_design(data)
    data["model"] = {"estimator": "pose"}  # which four fiducials determine
    load_design(data)


def test_every_loss_is_a_demand_with_the_covariance_of_what_is_left():
    """brute force: the linear model of the system without the fiducial."""
    problem = read_task(with_beads(8, {"lost": 1, "limit_mm": 1.0})).problems[0]
    terms = every_terms(problem)
    estimator = problem.estimation
    assert [term.demand.lost for term in terms] == [(), *((label,) for label in problem.system.fiducial_labels)]
    for term in terms:
        laid = replace(problem.system, fiducials_mm=plain(problem.system.fiducials_mm))
        given = (laid, plain(estimator.projections), plain(estimator.assumed_shift_mm))
        images = image_parts_at(estimator, term, *given, plain(term.reconstructed_mm))
        system = taken(problem.system, [problem.system.fiducial_labels.index(label) for label in term.demand.lost])
        expected = image_parts(linearise(system, system.targets[0]), "tcp")
        np.testing.assert_allclose(images.noise.astype(float), expected[0], rtol=1e-9)
        np.testing.assert_allclose(images.made.astype(float), expected[1], rtol=1e-9)
