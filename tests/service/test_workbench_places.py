"""Where a bead would be better, as the workbench draws it: pictures, arrows, contours, and what is red.

What is drawn is `independent` of what it is held against: `score` of designs written by hand, bead by bead and place by
place, and differences of them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import DEMO, used
from served import Served

from tailstack import IllPosedError, load_design, score
from tailstack_service.operations.validation import validate

pytestmark = pytest.mark.long
STEP_MM = 0.05  # of central differences: they are off by some 1e-6 of themselves


def drawn(service: Served, scenario: str, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, DEMO, script="places.mjs", **more)


class Moved:
    """What decides, of a design with one bead elsewhere in the plane of the front elevation, or without it."""

    def __init__(self, text: str) -> None:
        self.data = yaml.safe_load(text)
        self.points = {each["label"]: each for each in self.data["fiducials"]["points"]}

    def scored(self, points: list[dict[str, Any]]) -> Any:
        return score(
            load_design({**self.data, "fiducials": {**self.data["fiducials"], "points": points}}), losses=False
        )

    def at(self, label: str, x: float, z: float) -> Any:
        y = self.points[label]["position_mm"][1]
        moved = {"label": label, "position_mm": [x, y, z]}
        return self.scored([moved if each["label"] == label else each for each in self.points.values()])

    def value(self, label: str, x: float, z: float) -> float:
        (check,) = self.at(label, x, z).verdict.checks
        return float(check.value)

    def slope(self, label: str) -> np.ndarray:
        """(2,) along x and z, mm per mm."""
        x, _, z = self.points[label]["position_mm"]
        along = self.value(label, x + STEP_MM, z) - self.value(label, x - STEP_MM, z)
        up = self.value(label, x, z + STEP_MM) - self.value(label, x, z - STEP_MM)
        return np.array([along, up]) / (2 * STEP_MM)

    def without(self, label: str) -> float:
        (check,) = self.scored([each for each in self.points.values() if each["label"] != label]).verdict.checks
        return float(check.value)


def test_an_image_shows_what_is_there_and_a_bead_that_is_pointed_at_is_marked_everywhere(service: Served) -> None:
    found = drawn(service, "zoom")
    assert found["fit"] > 0.75 > 0.7 > found["whole"]
    assert found["again"] == found["fit"]
    assert found["pointed"] == found["row"] == 6  # two images, three elevations, the list
    assert found["space"] is True
    assert len(found["seen"]) == 1  # a bead in space marks its row
    (x, wide), (after, narrower) = found["wheel"]
    assert found["unfocused"][1] == wide
    assert narrower < wide < found["key"] * 1.3
    assert after == pytest.approx(x, abs=1.5)  # what is under the pointer stays there
    assert found["steps"] == 0


def test_arrows_are_differences_of_scores_and_contours_scores(service: Served) -> None:
    label, of = "F7", Moved(DEMO)
    found = drawn(service, "places", label=label, axe=True)
    drops = {name: np.array(path[2:4]) - path[:2] for name, path in found["arrows"]}
    assert len(drops) >= 8
    slopes = {name: of.slope(name) * [-1, 1] for name in drops}  # the way down, z upwards in the picture
    longest = max(drops, key=lambda name: float(np.linalg.norm(drops[name])))
    times = np.linalg.norm(drops[longest]) / np.linalg.norm(slopes[longest])
    for name, drop in drops.items():
        assert drop == pytest.approx(times * slopes[name], abs=1e-3 * float(np.linalg.norm(drop))), name
    costs = {
        name: of.without(name) - score(load_design(of.data), losses=False).verdict.checks[0].value for name in of.points
    }
    dearest = max(costs, key=costs.__getitem__)
    assert f"most of all {dearest}, +{costs[dearest]:.3g}" in found["legend"]
    shares = {name: int(re.search(r"(\d+)%", fill)[1]) for name, fill in found["fills"]}  # type: ignore[index]
    assert shares == {name: round(100 * max(cost, 0) / costs[dearest]) for name, cost in costs.items()}
    assert f"without it {of.without(label):.3f}" in found["title"]
    assert found["axe"] == []

    levels = [(float(level), path) for level, path in found["rest"]["levels"]]
    assert len(levels) >= 4
    span = max(level for level, _ in levels) - min(level for level, _ in levels)
    for level, path in levels:
        places = np.array(path).reshape(-1, 2)
        for x, down in places[:: max(1, len(places) // 6)]:
            assert of.value(label, x, -down) == pytest.approx(level, abs=0.01 * span)  # between two places it is a line
    assert found["held"][0] == 0
    assert found["held"][1] >= 4
    assert found["hidden"] == [0, 0]


def test_what_is_red_is_refused_or_lies_over_another_bead(service: Served) -> None:
    of, found = Moved(DEMO), drawn(service, "places", label="F9")
    red = found["rest"]["refusals"]
    assert red
    for why, x, down in red[:: max(1, len(red) // 12)]:
        try:
            scored = of.at("F9", x, -down)
        except IllPosedError as refusal:
            said = refusal.problems[0].detail
        else:
            said = "over " if "projected-overlap" in [each.rule for each in scored.verdict.findings] else "nothing"
        assert said in why


def test_how_near_the_layout_is_to_the_best_follows_a_drag_without_being_asked_again(service: Served) -> None:
    """independent: the score of the design over its bound, from the command's record."""
    found = drawn(service, "best", label="F1")
    (bound,) = validate(load_design(yaml.safe_load(DEMO)), bound=True).bounds
    assert bound.lower_bound_mm is not None
    least, own = bound.lower_bound_mm, Moved(DEMO).scored(list(Moved(DEMO).points.values())).verdict.checks[0].value
    words, whole = found["rest"]
    assert words.startswith(f"Within {100 * (own / least - 1):.2g} % of the best possible layout: none below 1.09")
    assert whole == bound.statement
    assert found["dragged"].startswith("Within ")
    assert found["dragged"] != words
    assert found["asked"] == found["hidden"] == 0
    assert len(found["places"]) > 8
    assert found["layer"]
