"""Several beads at once: where they come to, and what they keep, on the page without a browser and in one.

The page's geometry is `independent` of the optimiser's regions and isometries that it is held against."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import DEMO, used
from page_in_node import call_page
from served import Served

from tailstack.optimisation import regions

KEPT = """
const { settle, wayOut } = require("./keeping");
answer({ settled: asked.scenes.map(({ places, others, rules }) => settle(places, others, rules)),
         out: asked.points.map(({ zone, point }) => wayOut(zone, point)) });
"""


def vector(draw: random.Random, reach: float) -> list[float]:
    return [draw.uniform(-reach, reach) for _ in range(3)]


def random_zone(draw: random.Random, name: str) -> dict[str, Any]:
    """A box, cylinder, tube, ball or shell with a clearance, as a design states it."""
    radius = draw.uniform(8, 20)
    shapes: list[dict[str, Any]] = [
        {"box": {"min_mm": [-8.0, -12.0, -5.0], "max_mm": [9.0, 4.0, draw.uniform(0, 15)]}},
        {"cylinder": {"base_mm": vector(draw, 10), "axis": vector(draw, 1), "height_mm": 15.0, "radius_mm": radius}},
        {"cylinder": {"base_mm": [0, 0, 0], "height_mm": 12.0, "radius_mm": radius + 5, "inner_radius_mm": radius}},
        {"ball": {"centre_mm": vector(draw, 10), "radius_mm": radius}},
        {"ball": {"centre_mm": vector(draw, 10), "radius_mm": radius + 4, "inner_radius_mm": radius}},
    ]
    return {"name": name, "clearance_mm": draw.choice([0.0, 2.5]), **draw.choice(shapes)}


def solver_zone(zone: dict[str, Any]) -> regions.KeepOut:
    def unit(axis: Any) -> np.ndarray:
        return np.array(axis, dtype=float) / np.linalg.norm(axis)

    if box := zone.get("box"):
        shape: regions.Solid = regions.BoxRegion(np.array(box["min_mm"]), np.array(box["max_mm"]))
    elif ball := zone.get("ball"):
        shape = regions.Ball(np.array(ball["centre_mm"]), ball["radius_mm"], ball.get("inner_radius_mm", 0.0))
    else:
        rod = zone["cylinder"]
        shape = regions.Cylinder(
            np.array(rod["base_mm"], dtype=float),
            unit(rod.get("axis", [0, 0, 1])),
            rod["height_mm"],
            rod["radius_mm"],
            rod.get("inner_radius_mm", 0.0),
        )
    return regions.KeepOut(zone["name"], shape, zone["clearance_mm"])


def test_what_is_moved_keeps_spacing_zones_and_locks_or_stays(tmp_path: Path) -> None:
    draw = random.Random(60)
    scenes: list[dict[str, Any]] = []
    for k in range(200):
        others = [{"label": f"O{n}", "position": vector(draw, 25)} for n in range(draw.randrange(6))]
        zones = [random_zone(draw, f"zone {n}") for n in range(draw.randrange(3))]
        locked = [draw.random() < 0.2 for _ in range(3)]
        places = [vector(draw, 25) for _ in range(1 + k % 3)]
        scenes.append(
            {"places": places, "others": others, "rules": {"spacing_mm": 9, "zones": zones, "locked": locked}}
        )
    points: list[dict[str, Any]] = [{"zone": random_zone(draw, "z"), "point": vector(draw, 30)} for _ in range(500)]
    found = call_page(tmp_path, ("geometry", "keeping"), KEPT, {"scenes": scenes, "points": points})
    came = 0
    for scene, answer in zip(scenes, found["settled"], strict=True):
        shift, rules = np.array(answer["shift"]), scene["rules"]
        assert not shift[np.array(rules["locked"])].any()
        if answer["why"] is not None:
            continue
        came += 1
        after = np.array(scene["places"]) + shift
        standing = np.array([other["position"] for other in scene["others"]]).reshape(-1, 3)
        apart = np.linalg.norm(after[:, None] - standing[None], axis=2)
        assert (apart >= rules["spacing_mm"] - 1e-9).all()
        for zone in rules["zones"]:
            assert regions.clear_of(solver_zone(zone), after).all()
    assert came > 150  # those that do not come are between beads, or locked before them
    for asked, way in zip(points, found["out"], strict=True):
        zone, point = solver_zone(asked["zone"]), np.array([asked["point"]])
        assert (way is None) == bool(regions.clear_of(zone, point).all())
        if way is not None:  # the shortest way leads just outside, and no further
            step = np.array(way["way"])
            assert regions.clear_of(zone, point + (way["mm"] + 1e-6) * step).all()
            assert not regions.clear_of(zone, point + (way["mm"] - 1e-3) * step).any()


PLACED = """
const { mirrored, turned, onCircle, repeats, labelsLike } = require("./arrange");
answer(asked.map(({ positions, point, along, degrees }) => ({
  mirrored: positions.map((each) => mirrored(each, { point, along })), circle: onCircle(positions, { point, along }),
  turned: positions.map((each) => turned(each, { point, along }, degrees)), repeats: repeats(degrees),
  labels: labelsLike(["F2", "pin"], ["F1", "F2", "pin1"]),
})));
"""


def test_beads_are_mirrored_turned_and_set_on_a_circle(tmp_path: Path) -> None:
    draw = random.Random(61)
    asked: list[dict[str, Any]] = [
        {"positions": [vector(draw, 40) for _ in range(3 + k % 6)], "point": vector(draw, 20), "along": vector(draw, 1),
         "degrees": 360 / (2 + k % 5)}
        for k in range(40)
    ]  # fmt: skip
    for each, found in zip(asked, call_page(tmp_path, ("geometry", "arrange"), PLACED, asked), strict=True):
        places, point, along = (np.array(each[name]) for name in ("positions", "point", "along"))
        order = round(360 / each["degrees"])
        (mirror,), (turn, *_) = regions.mirror(point, along), regions.turns(point, along, order)
        assert np.allclose(found["mirrored"], regions.move(mirror, places), atol=1e-9)
        assert np.allclose(found["turned"], regions.move(turn, places), atol=1e-9)
        assert found["repeats"] == order - 1
        assert found["labels"] == ["F3", "pin2"]

        circle, count = np.array(found["circle"]), len(places)
        unit = along / np.linalg.norm(along)
        heights = (circle - point) @ unit
        assert np.allclose(heights, ((places - point) @ unit).mean(), atol=1e-9)
        spokes = circle - point - np.outer(heights, unit)
        flat = places - point - np.outer((places - point) @ unit, unit)
        assert np.allclose(np.linalg.norm(spokes, axis=1), np.linalg.norm(flat, axis=1).mean(), atol=1e-9)
        first = regions.move(regions.turns(point, along, count)[0], circle)
        assert np.allclose(np.linalg.norm(first[:, None] - circle[None], axis=2).min(axis=1), 0, atol=1e-9)
        moves = [np.sum((turned_by(circle, point, unit, angle) - places) ** 2) for angle in (-0.01, 0, 0.01)]
        assert moves[1] == min(moves)


def turned_by(places: np.ndarray, point: np.ndarray, unit: np.ndarray, angle: float) -> np.ndarray:
    (x, y, z), offset = unit, places - point
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(point + offset @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross).T)


def beads_of(text: str) -> dict[str, np.ndarray]:
    points = yaml.safe_load(text)["fiducials"]["points"]
    return {each["label"]: np.array(each["position_mm"], dtype=float) for each in points}


def changed(before: dict[str, np.ndarray], text: str) -> dict[str, np.ndarray]:
    """What each bead moved by, of those that moved; of new ones, where they are."""
    after = beads_of(text)
    moves = {label: place - before.get(label, np.zeros(3)) for label, place in after.items()}
    return {label: move for label, move in moves.items() if move.any()}


@pytest.mark.long
def test_several_beads_are_moved_mirrored_turned_and_kept_apart(service: Served) -> None:
    found = used(service.url, "arrange", DEMO, script="arranged.mjs", axe=True)
    before = beads_of(found["before"])
    assert found["shift"] == ["F1", "F5"]
    text, steps = found["together"]
    moves = changed(before, text)
    assert (set(moves), steps) == ({"F1", "F5"}, 1)
    assert np.allclose(moves["F1"], moves["F5"], atol=1.1e-3)
    assert moves["F1"][0] < -1 < 1 > moves["F1"][1] == 0
    assert found["escaped"] == []
    assert set(found["framed"]) >= {"F7"}
    assert found["all"] == len(before) > len(found["framed"])
    assert {tuple(move) for move in changed(before, found["locked"]).values()} == {(1.0, 0.0, 0.0)}
    after = beads_of(found["spaced"])
    apart = min(np.linalg.norm(after["F9"] - place) for label, place in after.items() if label != "F9")
    assert 12 <= apart < 12.01
    assert list(changed(before, found["mirrored"])) == ["F9"]
    assert beads_of(found["mirrored"])["F9"].tolist() == [12, 6, -54]
    text, chosen = found["copied"]
    assert list(changed(before, text)) == chosen == ["F13", "F14"]
    (x, y, z), root = before["F9"], 3**0.5 / 2
    assert np.allclose(beads_of(text)["F13"], [-x / 2 - root * y, root * x - y / 2, z], atol=1e-3)
    assert found["axe"] == []


def test_fingers_choose_several_on_a_phone(service: Served) -> None:
    found = used(service.url, "finger", DEMO, script="arranged.mjs", width=390, height=844)
    assert found["chosen"] == ["F9", "F10"]
    assert found["wide"] == 0
    assert found["axe"] == []
