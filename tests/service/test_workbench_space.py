"""Beads, pivots and beams moved in space, and the surface that beads touch, on the page without a browser and in one.

Distances from a surface are `independent`: the nearest of all triangles by their planes and edges, with NumPy."""

from __future__ import annotations

import base64
import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import DEMO, used
from page_in_node import call_page
from scipy.stats import binom
from served import Served
from service_scenes import EXAMPLES

from tailstack import load_design, score
from tailstack.design import compile_design
from tailstack_service.report.chapters.coordinates import lay_out

MICROMETRE = 1e-3  # mm


def rounded_profile(outline: list[tuple[float, float]], height: float) -> np.ndarray:
    """(M, 3, 3) triangles of the walls and the lids (fans) of a prism about z, counterclockwise from outside; the
    outline need not be convex."""
    faces: list[tuple[tuple[float, ...], ...]] = []
    for (x0, y0), (x1, y1) in zip(outline, outline[1:] + outline[:1], strict=True):
        a, b, c, d = (x0, y0, 0.0), (x1, y1, 0.0), (x1, y1, height), (x0, y0, height)
        faces += [(a, b, c), (a, c, d)]
    for z in (0.0, height):
        fan = [((0, 0, z), (*outline[k - 1], z), (*outline[k], z)) for k in range(len(outline))]
        faces += fan if z else [face[::-1] for face in fan]
    return np.array(faces, dtype=np.float32).astype(float)


def star(corners: int) -> np.ndarray:
    """A prism with as many edges that stick out as that go in."""
    turns = np.linspace(0, 2 * np.pi, 2 * corners, endpoint=False)
    radii = np.where(np.arange(2 * corners) % 2, 20, 32)
    return rounded_profile([(r * np.cos(t), r * np.sin(t)) for r, t in zip(radii, turns, strict=True)], 25.0)


def tube(pieces: int) -> np.ndarray:
    turns = np.linspace(0, 2 * np.pi, pieces, endpoint=False)
    return rounded_profile([(30 * np.cos(t), 30 * np.sin(t)) for t in turns], 60.0)


def binary_stl(faces: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0) for face in faces]
    return b"solid is what it begins with".ljust(80) + struct.pack("<I", len(faces)) + b"".join(rows)


def text_stl(faces: np.ndarray) -> bytes:
    def corner(point: np.ndarray) -> str:
        return "      vertex {!r} {!r} {!r}\n".format(*map(float, point))

    facets = ["  facet normal 0 0 0\n    outer loop\n" + "".join(map(corner, face)) + "    endloop\n  endfacet\n"
              for face in faces]  # fmt: skip
    return ("solid part\n" + "".join(facets) + "endsolid part\n").encode()


def away(faces: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N,) how far places (N, 3) are from the nearest of the triangles (M, 3, 3)."""
    least = np.full(len(places), np.inf)
    for a, b, c in faces:
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        inside = np.ones(len(places), dtype=bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.cross(q - p, places - p) @ normal >= 0
            along = np.clip((places - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            least = np.minimum(least, np.linalg.norm(places - p - along[:, None] * (q - p), axis=1))
        least = np.where(inside, np.minimum(least, np.abs((places - a) @ normal)), least)
    return least


TOUCHED = """
const { readStl, treeOf, cast, walk, picture } = require("./mesh");
const tree = treeOf(readStl(Uint8Array.from(Buffer.from(asked.stl, "base64")).buffer));
const fly = ({ through, way }) => cast(tree, through, way, asked.radius);
answer({
  cast: asked.flights.map(fly),
  walked: asked.flights.map((each) => walk(tree, fly(each), each.step, asked.radius)),
  seen: [...picture(tree.mesh, asked.seen)].filter((_, k) => k % 4 === 3).map((alpha) => Number(alpha > 0)),
  low: tree.mesh.low, high: tree.mesh.high,
});
"""
SEEN = {"right": [1, 0, 0], "up": [0, 1, 0], "scale": 2, "centre": [0, 0, 0], "width": 160, "height": 140}


def unit_vectors(draw: random.Random, count: int) -> np.ndarray:
    ways = np.array([[draw.gauss(0, 1) for _ in range(3)] for _ in range(count)])
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


@pytest.mark.parametrize(("shape", "write"), [(star(5), binary_stl), (tube(24), text_stl)], ids=["star", "tube"])
def test_a_ball_comes_to_touch_the_surface_from_where_it_is_seen(tmp_path: Path, shape: Any, write: Any) -> None:
    draw, radius, count = random.Random(60), 1.5, 120
    ways, steps = unit_vectors(draw, count), 8 * unit_vectors(draw, count)
    through = np.array([[draw.uniform(-35, 35), draw.uniform(-35, 35), draw.uniform(-5, 30)] for _ in range(count)])
    rows = zip(through.tolist(), ways.tolist(), steps.tolist(), strict=True)
    flights = [{"through": place, "way": way, "step": step} for place, way, step in rows]
    asked = {"stl": base64.b64encode(write(shape)).decode(), "radius": radius, "flights": flights, "seen": SEEN}
    found = call_page(tmp_path, ("geometry", "mesh"), TOUCHED, asked)
    centres, walked = np.array(found["cast"]), np.array(found["walked"])
    assert away(shape, centres) == pytest.approx(radius, abs=MICROMETRE)
    assert away(shape, walked) == pytest.approx(radius, abs=MICROMETRE)
    off = centres - through
    missed = np.linalg.norm(off - np.sum(off * ways, axis=1)[:, None] * ways, axis=1) > MICROMETRE
    assert missed.mean() < 0.6  # the others stand on their line of sight
    for back in np.linspace(0.01, 80, 60):  # and were free on all of it
        assert (away(shape, centres[~missed] - back * ways[~missed]) >= radius - MICROMETRE).all()

    x, y = np.meshgrid(np.arange(160) + 0.5, np.arange(140) + 0.5)
    flat = np.column_stack([(x.ravel() - 80) / 2, (70 - y.ravel()) / 2, np.zeros(x.size)])
    lid = shape[np.all(shape[:, :, 2] == 0, axis=1)]
    covered, clear = away(lid, flat) < 1e-9, away(lid, flat) > 0.01
    seen = np.array(found["seen"], dtype=bool)
    assert seen[covered].all()
    assert not seen[clear].any()
    assert found["low"] == shape.min(axis=(0, 1)).tolist()
    assert found["high"] == shape.max(axis=(0, 1)).tolist()


def test_what_is_no_surface_is_refused_in_words(tmp_path: Path) -> None:
    huge, flat = star(3) * 1e9, np.zeros((4, 3, 3))
    files = [b"", b"solid nothing\nendsolid", b"\x00" * 90, text_stl(star(3))[:-90], binary_stl(huge), binary_stl(flat)]
    script = """
    const { readStl } = require("./mesh");
    const words = (stl) => {
      try { readStl(Uint8Array.from(Buffer.from(stl, "base64")).buffer); } catch (error) { return error.message; }
      return "";
    };
    answer(asked.map(words));
    """
    asked = [base64.b64encode(content).decode() for content in files]
    said = call_page(tmp_path, ("geometry", "mesh"), script, asked)
    assert all("no triangles" in words for words in said[:4]), said
    assert "farther than 1 km" in said[4]
    assert "has an area" in said[5]


def carrier() -> np.ndarray:
    """The drill guide's, as a tube about its beads."""
    return tube(48) + np.array([0, 0, -78.0])


@pytest.mark.long
def test_beads_pivots_and_beams_are_moved_in_space(service: Served) -> None:
    stl = base64.b64encode(binary_stl(carrier())).decode()
    design = yaml.safe_load(DEMO)
    design["execution"]["hand_eye"]["tolerances"]["rx"] = {"half_width_deg": 0.1, "distribution": "uniform"}
    design["transforms"] = {"T_tcp_flange": {"quaternion_wxyz": [0.8, 0.36, 0.48, 0.0], "translation_mm": [5, 6, -90]}}
    found = used(service.url, "space", yaml.safe_dump(design, sort_keys=False), script="space.mjs", stl=stl)
    before, after, eye = (yaml.safe_load(found[name]) for name in ("before", "after", "eye"))
    points = [np.array([each["position_mm"] for each in data["fiducials"]["points"]]) for data in (before, after)]
    (moved,) = np.flatnonzero((points[0] != points[1]).any(axis=1))
    assert before["fiducials"]["points"][moved]["label"] == found["bead"]
    assert np.linalg.norm(points[1][moved] - points[0][moved]) > 3
    turn = compile_design(load_design(found["after"])).T_tcp_con[:3, :3]
    shift = turn @ (points[1][moved] - points[0][moved])  # as far as the bead, in the frame that it is stated in
    pivots = [data["execution"]["hand_eye"].pop("pivot_mm") for data in (after, eye)]
    assert np.subtract(pivots[1], pivots[0]) == pytest.approx(shift, abs=0.02)
    assert after == eye
    assert found["steps"] == [1, 2, 3, 4, 5, 6, 7]  # one for each gesture
    along = yaml.safe_load(found["along"])["fiducials"]["points"][moved]["position_mm"]
    assert np.count_nonzero(np.array(along) - points[1][moved]) == 1  # an axis of con
    pivots = [
        data["interfaces"]["structure_connector"]["pivot_mm"] for data in (before, yaml.safe_load(found["pivot"]))
    ]
    assert pivots[0] != pivots[1]
    view = yaml.safe_load(found["turned"])["views"][0]
    x, y, z = view["beam_direction"]
    degrees = np.degrees(np.arctan2(-x, y))
    assert "orientation" not in view
    assert z == 0
    assert abs(degrees) >= 5
    assert degrees == pytest.approx(round(degrees), abs=1e-4)
    x, y, z = yaml.safe_load(found["tilted"])["views"][0]["beam_direction"]
    assert abs(np.degrees(np.arcsin(z))) == pytest.approx(1, abs=1e-4)
    assert yaml.safe_load(found["far"])["views"][0]["beam_direction"] != [x, y, z]  # at its source

    places = [
        yaml.safe_load(found[name])["fiducials"]["points"][moved]["position_mm"] for name in ("snapped", "stepped")
    ]
    assert places[0] != places[1]
    assert away(carrier(), np.array(places)) == pytest.approx(1.5, abs=MICROMETRE)
    assert found["axe"] == []
    assert found["watched"]["messages"] == []


@pytest.mark.long
def test_beads_are_optimised_onto_the_surface_that_was_dropped_which_stays_out_of_the_design(service: Served) -> None:
    part = {"surface": {"file": "cad/part.stl", "distance_mm": 4}}
    named = yaml.safe_load(DEMO)
    named["optimise"] = {**named["optimise"], "region": part, "starts": 1}
    del named["optimise"]["box"]
    design = DEMO.replace("starts: ", "starts: 1 # ", 1)
    stl = base64.b64encode(binary_stl(carrier())).decode()
    found = used(service.url, "surface", design, script="space.mjs", stl=stl, named=yaml.safe_dump(named))
    assert "drop that file on this page" in found["refused"]
    assert yaml.safe_load(found["named"])["optimise"]["region"] == part
    assert (found["title"], found["basis"]) == ("Optimisation with beads on part.stl", "simulation")
    before, taken = yaml.safe_load(design), yaml.safe_load(found["taken"])
    assert taken["optimise"] == before["optimise"]
    places, old = (np.array([each["position_mm"] for each in data["fiducials"]["points"]]) for data in (taken, before))
    assert (places != old).any()
    assert away(carrier(), places) == pytest.approx(1.5, abs=MICROMETRE)
    assert found["axe"] == []


def test_a_bead_is_taken_in_space_by_keys_on_a_phone(service: Served) -> None:
    found = used(service.url, "keys", DEMO, script="space.mjs", width=390, height=844)
    first, moved = (np.array(yaml.safe_load(text)["fiducials"]["points"][0]["position_mm"]) for text in found["texts"])
    assert np.linalg.norm(moved - first) == pytest.approx(1, abs=2e-3)  # up on the page, however it is turned
    assert "F1: the arrows move it" in found["said"]
    assert found["turns"] is True  # once it is let go
    assert found["wide"] == 0
    assert found["axe"] == []


@pytest.mark.long
def test_the_corridor_is_drawn_round_its_trajectory_with_fifty_ends_and_degrees_stand_beside_millimetres(
    service: Served,
) -> None:
    """`independent` of the page's projection: distances from the planned axis by cross products.  The share of axes
    that leave the corridor is within what fifty draws of the exact law may show, with an error rate of 1e-4; the draws
    are always the same."""
    text = (EXAMPLES / "pedicle_screw.yaml").read_text(encoding="utf-8")
    design = load_design(text)
    found = used(service.url, "trajectory", text, script="space.mjs")
    scene = lay_out(design, scene=True).scene
    assert scene is not None
    begin, end = (np.array(next(t for t in design.source.data["targets"] if t["name"] == name)["position_mm"])
                  for name in ("entry", "tip"))  # fmt: skip
    along = (end - begin) / np.linalg.norm(end - begin)
    axes = np.array([item["points"] for item in scene["items"] if item["look"] == "executed"])
    away = np.stack([np.linalg.norm(np.cross(axes[:, k] - at, along), axis=1) for k, at in ((0, begin), (1, end))])
    away /= scene["magnification"]
    assert away.shape == (2, 50)
    drawn = np.stack([np.linalg.norm(np.array(found[which]) - 100, axis=1) for which in ("begin", "end")])
    rims = np.linalg.norm(np.array(found["rims"]) - 100, axis=2)
    scale = rims.mean() / 1.25
    assert np.ptp(rims) < 1e-3 * scale
    np.testing.assert_allclose(drawn / scale, away, atol=1e-3)
    out = int((away.max(axis=0) > 1.25).sum())
    assert found["out"] == out
    assert f"{out} leave the corridor, radius 1.25 mm" in found["told"]
    record = score(design)
    leaves = next(each.breaches for each in record.measures if each.measure == "corridor")[0].probability
    low, high = binom.ppf([5e-5, 1 - 5e-5], 50, leaves)
    assert low <= out <= high
    checks = {check.requirement: check for check in record.verdict.checks if check.target != "entry"}
    position = f"{checks['position'].value:.2f} mm of 2.00 mm"
    assert found["beside"] == [["position, tip: ", position], ["breach, entry to tip: ", "0.00 % of 1 %"]]
    assert f"{checks['angle'].value:.2f}°" in found["p95"]
    whole = [line for line in record.targets[0].contributors if line.drawn and line.component == "all"]
    for level in ("unit", "shot"):
        share = sum(line.variance_share for line in whole if line.drawn == level)
        assert f"per {level}: {100 * share:.1f} %" in found["blame"]
    assert (found["planned"], found["axe"]) == (5, [])
