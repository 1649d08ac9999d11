"""The front of cost and limit: every point verified, none dominated, each reproduced from its own numbers."""

from __future__ import annotations

import copy
from itertools import pairwise
from math import radians
from typing import Any

import numpy as np
import pytest

from optimise_documents import document, free, moving, optimised
from tailstack.design import load_design
from tailstack.optimisation import optimise
from tailstack.results import Optimisation
from tailstack.scoring import score

SEAT, FLANGE = "structure_connector", "connector_flange"
FREE = [(SEAT, "rx"), (SEAT, "ry"), (FLANGE, "rx"), (FLANGE, "ry")]


def placed() -> Optimisation:
    return optimised(document(**moving(objective="pareto", front={"points": 5})))


def at_point(data: dict[str, Any], result: Optimisation, index: int) -> dict[str, Any]:
    """The document with the fiducials and half-widths of a point written into it by hand."""
    data, point = copy.deepcopy(data), result.front[index]
    del data["optimise"]
    for entry, position in zip(data["fiducials"]["points"], point.fiducials_mm, strict=True):
        entry["position_mm"] = list(position)
    for item, value in zip(result.tolerances, point.half_widths, strict=True):
        data["interfaces"][item.contributor]["tolerances"][item.component][f"half_width_{item.unit}"] = value
    return data


@pytest.mark.long
def test_a_looser_limit_costs_less_and_every_point_is_verified() -> None:
    front = placed().front
    assert len(front) == 5
    for tight, loose in pairwise(front):
        assert tight.limit_mm < loose.limit_mm
        assert tight.cost > loose.cost
        assert tight.quantile_mm < loose.quantile_mm
    for point in front:
        assert point.quantile_mm <= point.limit_mm
        assert point.verified_upper_mm <= point.limit_mm
        assert point.quantile_mm > 0.99 * point.limit_mm  # the limit is used up, but for the room of the check
    # by default from just above the smallest attainable to twice the limit
    assert front[-1].limit_mm == pytest.approx(2.0)
    ratios = [loose.limit_mm / tight.limit_mm for tight, loose in pairwise(front)]
    assert ratios == pytest.approx([ratios[0]] * 4, rel=1e-9)


@pytest.mark.long
def test_every_point_reproduces_its_quantile_and_its_cost() -> None:
    """independent: the score of a document with the point's numbers; closed form: sum of 1 / half-width in rad."""
    result = placed()
    assert [(item.contributor, item.component) for item in result.tolerances] == FREE
    for index, point in enumerate(result.front):
        scored = score(load_design(at_point(document(), result, index)))
        assert point.quantile_mm == pytest.approx(scored.targets[0].p95_mm, rel=1e-6)
        assert point.cost == pytest.approx(sum(1 / radians(value) for value in point.half_widths), rel=1e-9)


@pytest.mark.long
def test_a_point_is_the_optimum_at_its_limit() -> None:
    """independent: the same design optimised for the limit of a point in the middle."""
    front = placed().front
    middle = front[2]
    alone = optimised(document(limit_mm=middle.limit_mm, **moving()))
    # the check of a point has fewer trials, so its aim is a little lower
    assert middle.cost == pytest.approx(alone.cost_after, rel=0.01)


def test_the_tightest_limit_is_near_the_smallest_attainable() -> None:
    """closed form: 1.02 times the score of the best layout with every half-width at its smallest."""
    result = placed()
    smallest = at_point(document(), result, 0)
    for interface, component in FREE:
        smallest["interfaces"][interface]["tolerances"][component]["half_width_deg"] = 0.01
    least = score(load_design(smallest)).targets[0].p95_mm
    assert result.front[0].limit_mm == pytest.approx(1.02 * least, rel=0.01)


@pytest.mark.long
def test_limits_as_stated_on_two_requirements() -> None:
    """The first requirement's limit is stated; the other's follows in proportion, at every point."""
    tolerances = [free(*pair, min_deg=0.01, max_deg=0.5) for pair in FREE]
    front = {"points": 3, "min_limit_mm": 0.7, "max_limit_mm": 1.4}
    data = document(objective="pareto", front=front, tolerances=tolerances)
    data["requirements"].append({"name": "display", "error": "localisation", "limit_mm": 0.8, "quantile": 0.9})
    result = optimised(data)
    assert [point.limit_mm for point in result.front] == pytest.approx([0.7, np.sqrt(0.7 * 1.4), 1.4])
    for index, point in enumerate(result.front):
        checks = score(load_design(at_point(data, result, index))).verdict.checks
        factor = point.limit_mm / 1.0
        ratios = [check.value_mm / (check.limit_mm * factor) for check in checks]
        assert 0.99 < max(ratios) <= 1
        assert point.factor == pytest.approx(factor)
        first = [check for check in checks if check.requirement != "display"]
        assert point.quantile_mm == pytest.approx(max(check.value_mm for check in first), rel=1e-6)
        assert point.verified_upper_mm is not None
        assert point.verified_upper_mm <= point.limit_mm


@pytest.mark.long
def test_limits_out_of_reach_are_said_to_be() -> None:
    """No tolerance at its smallest holds the tightest: designs begin where one does, the others have a reason."""
    front = {"points": 4, "min_limit_mm": 0.2, "max_limit_mm": 1.4}
    result = optimised(document(objective="pareto", front=front, rotation_bounds={"min_deg": 0.05, "max_deg": 0.5}))
    limits = np.geomspace(0.2, 1.4, 4)
    assert [point.limit_mm for point in result.front] == pytest.approx(limits)
    held = [index for index, point in enumerate(result.front) if point.status == "verified"]
    data = at_point(document(), result, held[0])
    for interface, component in FREE:
        data["interfaces"][interface]["tolerances"][component]["half_width_deg"] = 0.05
    least = score(load_design(data)).targets[0].p95_mm
    assert list(np.flatnonzero(limits > least)) == held
    for point in result.front[: held[0]]:
        assert (point.status, point.cost, point.half_widths) == ("out of reach", None, ())
        assert "smallest P95" in point.note


def test_the_stages_of_a_front_and_stopping_it() -> None:
    seen: list[tuple[str, int, int]] = []

    def watch(stage: str, done: int, total: int, least: float | None) -> None:
        assert least is None or least > 0
        seen.append((stage, done, total))

    def enough() -> bool:
        return ("front", 1, 3) in seen

    data = document(objective="pareto", front={"points": 3}, rotation_bounds={"min_deg": 0.01, "max_deg": 0.5})
    data["optimise"]["starts"] = 1
    result = optimise(load_design(data), progress=watch, stop=enough)
    assert [entry for entry in seen if entry[0] == "start"] == [("start", 1, 1)]
    assert [stage for stage in dict.fromkeys(entry[0] for entry in seen) if stage in ("start", "check", "front")] == [
        "start",
        "check",
        "front",
    ]
    assert [entry for entry in seen if entry[0] == "front"] == [("front", 1, 3)]
    assert [point.status for point in result.front] == ["verified", "not tried", "not tried"]
    assert result.status == "verified"
