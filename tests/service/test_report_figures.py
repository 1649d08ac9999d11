"""Pictures of a report: what is drawn is where geometry and numbers put it, legible and harmless."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from itertools import combinations
from math import log10, sqrt
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.stats import chi2
from service_scenes import EXAMPLES, small_design

from tailstack import Design, load_design, score
from tailstack.design import compile_design
from tailstack.geometry.arrays import Array
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.propagation.linear import LinearModel
from tailstack.results import WorthyPlace
from tailstack.results.look import LIMIT_COLOUR
from tailstack.sweeping import read_axes, sweep
from tailstack_service.report import images
from tailstack_service.report import scene as scenes
from tailstack_service.report.chapters.coordinates import lay_out
from tailstack_service.report.charts import (
    PHONE,
    draw_budgets,
    draw_distribution,
    draw_errors,
    draw_levers,
    draw_scale,
    draw_shares,
    draw_sweep,
)
from tailstack_service.report.images import draw_images
from tailstack_service.report.records import ErrorDistribution, Headline
from tailstack_service.report.scene import Item, LayoutScene, scene_json, scene_of
from tailstack_service.report.scene_picture import CIRCLE, draw_scene
from tailstack_service.report.svg import WIDTH

SVG = "{http://www.w3.org/2000/svg}"
ROUNDING = 0.051  # the page has one decimal
WRITTEN = 6e-4  # mm: a scene has three decimals
HOSTILE = '</title><script>alert(1)</script>&"'
NAMES = [
    "demo",
    "flat_plate",
    "locators_321",
    "radiostereometry",
    "slicer_markups",
    "small_cluster_far_target",
    "tube_carrier",
]


def example(name: str) -> Design:
    return load_design(EXAMPLES / f"{name}.yaml")


def scene(design: Design, before: Design | None = None) -> LayoutScene:
    return scene_of(design, score(design), design.name, None if before is None else (before, score(before)), "before")


DEMO = example("demo")


@cache
def demo_scene() -> LayoutScene:
    return scene(DEMO)


def of(found: LayoutScene, kind: str, look: str) -> list[Item]:
    return [item for item in found.items if item.kind == kind and item.look == look]


def calls_of(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> list[str]:
    """What grows by one with every call of a function of a module, or a method of a class, from here on."""
    calls: list[str] = []
    whole = getattr(owner, name)

    def counted(*arguments: Any, **options: Any) -> Any:
        calls.append(name)
        return whole(*arguments, **options)

    monkeypatch.setattr(owner, name, counted)
    return calls


def read(svg: str) -> ElementTree.Element:
    return ElementTree.fromstring(svg)


def numbers(text: str) -> list[float]:
    return [float(value) for value in re.findall(r"-?\d+(?:\.\d+)?", text)]


def circles(root: ElementTree.Element, fill: str) -> Array:
    """(N, 2) centres of the circles of a colour that stand where they are written."""
    moved = {id(circle) for group in root.iter(f"{SVG}g") if "transform" in group.attrib for circle in group}
    return np.array(
        [
            (float(circle.attrib["cx"]), float(circle.attrib["cy"]))
            for circle in root.iter(f"{SVG}circle")
            if circle.attrib["fill"] == fill and id(circle) not in moved
        ]
    )


def texts(root: ElementTree.Element) -> list[tuple[str, float, float, float, float]]:
    """Texts with their boxes: capitals three quarters of the size, characters of Helvetica half of it on average."""
    found = []
    for entry in root.iter(f"{SVG}text"):
        words, size = str(entry.text), float(entry.attrib.get("font-size", 11))
        wide = 0.5 * size * len(words)
        left = (
            float(entry.attrib["x"]) - {"middle": 0.5, "end": 1.0}.get(entry.attrib.get("text-anchor", ""), 0.0) * wide
        )
        low = float(entry.attrib["y"])
        found.append((words, left, low - 0.72 * size, left + wide, low))
    return found


def check_picture(svg: str) -> ElementTree.Element:
    """An accessible picture whose texts lie on the page and do not hide one another."""
    root = read(svg)
    assert root.tag == f"{SVG}svg"
    assert [child.tag for child in root[:2]] == [f"{SVG}title", f"{SVG}desc"]
    assert root.attrib["role"] == "img"
    assert root.attrib["aria-labelledby"].split() == [root[0].attrib["id"], root[1].attrib["id"]]
    ids = [entry.attrib["id"] for entry in root.iter() if "id" in entry.attrib]
    assert len(set(ids)) == len(ids)
    for a, b in combinations(texts(root), 2):  # over one another by a unit at most
        assert min(a[3], b[3]) - max(a[1], b[1]) <= 1 or min(a[4], b[4]) - max(a[2], b[2]) <= 1, (a[0], b[0])
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    for words, left, top, right, low in texts(root):
        assert min(left, top, width - right, height - low) > -2, words
    assert not re.search(r"(?i)nan|inf\b|e[+-]\d\d", " ".join(re.findall(r'(?:d|cx|cy|x|y|points)="([^"]*)"', svg)))
    return root


# --- the scene in space ---------------------------------------------------------------------------


def test_where_fiducials_tell_most_balls_have_their_share_as_volume() -> None:
    """closed_form: an eighth of a fiducial is a ball of half the radius; the picture's legend says what balls are."""
    places = (WorthyPlace((10.0, 20.0, -30.0), 1.0), WorthyPlace((-10.0, 20.0, -30.0), 0.125))
    design = example("demo")
    found = scene_of(design, None, design.name, places=places)
    balls = [item for item in found.items if item.layer == "worthy"]
    assert [ball.points[0] for ball in balls] == [place.position_mm for place in places]
    whole, eighth = (np.linalg.norm(ball.points[1:], axis=1) for ball in balls)
    np.testing.assert_allclose(whole, 2 * eighth)
    assert "where fiducials tell most" in draw_scene(found)
    assert not [item for item in scene_of(design, None, design.name).items if item.layer == "worthy"]


def test_errors_stand_in_con_magnified_about_target_and_bias() -> None:
    """independent: tcp is turned by 45 degrees about z and shifted, so e_con = Rz(-45) e_tcp."""
    design = example("locators_321")
    found, judged = scene(design), score(design)
    c = sqrt(0.5)
    turn = np.array([[c, c, 0], [-c, c, 0], [0, 0, 1]])
    target = next(entry for entry in judged.targets if entry.name == "centre")
    (item,) = [entry for entry in of(found, "ellipsoid", "tcp") if " at centre:" in entry.title]
    points = np.array(item.points)
    magnified = found.magnification
    np.testing.assert_allclose(points[0], [0, 0, 45] + magnified * turn @ np.array(target.bias_mm), atol=WRITTEN)
    shape = points[1:].T @ points[1:] / magnified**2 / chi2.ppf(0.95, 3)
    expected = turn @ np.array(target.covariance_mm2) @ turn.T
    np.testing.assert_allclose(shape, expected, atol=1e-4 * np.trace(expected))
    workspace = [entry for entry in of(found, "ellipsoid", "tcp") if "workspace" in entry.title]
    assert len(workspace) == 1  # one of the eight samples of a region: the worst
    worst = max((entry for entry in judged.targets if "workspace" in entry.name), key=lambda entry: entry.p95_mm)
    assert worst.name in workspace[0].title


@pytest.mark.parametrize("name", NAMES)
def test_the_magnification_is_round_and_lets_errors_be_seen(name: str) -> None:
    """closed form: 1, 2 or 5 times a power of ten; the next round number would make the largest too large."""
    found = scene(example(name))
    mantissa = found.magnification / 10 ** np.floor(log10(found.magnification) + 1e-9)
    assert min(abs(mantissa - each) for each in (1, 2, 5)) < 1e-9
    near = np.array(found.near)
    across = float(np.linalg.norm(np.ptp(near, axis=0)))
    largest = max(
        [float(np.linalg.norm(entry.points[1])) for entry in of(found, "ellipsoid", "tcp")]
        + [float(np.linalg.norm(np.subtract(entry.points[0], entry.points[1]))) for entry in of(found, "arrow", "bias")]
    )
    assert 0.02 * across < largest < 0.2 * across
    said = "to scale" if found.magnification == 1 else f"magnified {found.magnification:g} times"
    assert said in found.note


def test_a_bias_is_an_arrow_from_its_target() -> None:
    data = small_design()
    data["interfaces"]["structure_connector"]["bias"] = {"tx_mm": 0.8}
    design = load_design(data)
    found = scene(design)
    (arrow,) = of(found, "arrow", "bias")
    bias = np.array(score(design).targets[0].bias_mm)
    np.testing.assert_allclose(
        np.subtract(arrow.points[1], arrow.points[0]), found.magnification * bias, atol=2 * WRITTEN
    )


def test_beams_are_those_of_the_data_sheet() -> None:
    """closed form: AP runs along +y; source 700 mm before the isocentre, detector of 1536 x 0.194 mm at 1020 mm."""
    points = {item.label: np.array(item.points[0]) for item in of(demo_scene(), "mark", "source")}
    np.testing.assert_allclose(points["AP source"], [0, -700, 0], atol=WRITTEN)
    np.testing.assert_allclose(points["LAT source"], [700, 0, 0], atol=WRITTEN)
    half = 1536 * 0.194 / 2
    corners = {item.label: np.array(item.points) for item in of(demo_scene(), "face", "detector")}
    expected = [[-half, 320, half], [half, 320, half], [half, 320, -half], [-half, 320, -half]]
    np.testing.assert_allclose(corners["AP detector"], expected, atol=WRITTEN)
    assert not of(demo_scene(), "face", "guessed")


def test_an_image_lies_on_the_line_from_the_source_through_its_fiducial() -> None:
    """independent: collinear with the structure as it sits, which the demo's bias moves by less than 0.2 mm."""
    source = np.array([0.0, -700.0, 0.0])
    images = np.array([item.points[0] for item in of(demo_scene(), "mark", "image")])
    on_ap = images[np.abs(images[:, 1] - 320) < WRITTEN]
    assert len(on_ap) == len(images) / 2 == 12
    through = np.array([item.points[0] for item in of(demo_scene(), "mark", "fiducial")])
    expected = source + (through - source) * (1020 / (through[:, 1] + 700))[:, None]
    np.testing.assert_allclose(on_ap, expected, atol=0.4)


def test_a_detector_at_an_unknown_distance_is_drawn_as_a_guess() -> None:
    found = scene(example("locators_321"))
    assert len(of(found, "face", "guessed")) == 2
    assert "is not stated" in found.note
    assert "frontal" in found.note


def test_zones_locators_frames_and_pivots_are_there() -> None:
    tube, seat = scene(example("tube_carrier")), scene(example("locators_321"))
    assert any("cable" in item.title for item in of(tube, "line", "keep-out"))
    assert of(tube, "line", "room")
    arrows = of(seat, "arrow", "locator")
    assert [item.label for item in arrows] == ["A1", "A2", "A3", "B1", "B2", "C1"]
    np.testing.assert_allclose(arrows[5].points[1], [-50, 0, -70])
    assert np.subtract(arrows[5].points[1], arrows[5].points[0])[0] > 0  # along its normal
    origins = {
        item.label.removesuffix(" x"): item.points[0] for item in of(seat, "arrow", "frame") if " " in item.label
    }
    assert origins == {"con": (0, 0, 0), "flange": (0, 0, -130), "tcp": (0, 0, 60)}
    assert {item.look for item in tube.items if item.kind == "mark"} >= {"pivot 1", "pivot 2", "target", "fiducial"}
    shown = {layer.key for layer in tube.layers}
    assert {item.layer for item in tube.items} <= shown
    assert "before" not in shown


def test_a_layout_over_another_tells_what_moved_is_new_or_is_gone() -> None:
    data = json.loads(json.dumps(DEMO.source.data))
    points = data["fiducials"]["points"]
    points[0]["position_mm"] = [float(v) + 5 for v in points[0]["position_mm"]]
    gone = points.pop(1)
    points.append({"label": "extra", "position_mm": [1, 2, -33]})
    found = scene(load_design(data), DEMO)
    assert [item.label for item in of(found, "mark", "new")] == ["extra"]
    olds = of(found, "mark", "old")
    assert len(olds) == 2
    assert any(gone["label"] in item.title and "only before" in item.title for item in olds)
    (line,) = of(found, "line", "moved")
    np.testing.assert_allclose(np.subtract(line.points[1], line.points[0]), [5, 5, 5])
    assert of(found, "ellipsoid", "tcp-before")


def test_scene_data_is_inert_and_complete() -> None:
    data = small_design(name=HOSTILE)
    data["targets"][0]["name"] = HOSTILE
    data["fiducials"]["points"][0]["label"] = "</script><b>"
    design = load_design(data)
    text = scene_json(scene(design))
    assert not set("<>&") & set(text)
    read_back = json.loads(text)
    assert any(item.get("label") == "</script><b>" for item in read_back["items"])
    looks = {item["look"] for item in read_back["items"] if item["kind"] != "mark"}
    assert looks <= set(read_back["looks"])
    assert text == scene_json(scene(design))


def test_a_design_without_errors_has_neither_ellipsoid_nor_magnification() -> None:
    data = small_design()
    for view in data["views"]:
        view["fiducial_noise_px"] = view["target_noise_px"] = 0.0
    data["fiducials"].pop("manufacturing", None)
    data["interfaces"] = {"structure_connector": {"pivot_mm": [0, 0, -90]}}
    for field in ("execution", "optimise"):
        data.pop(field, None)
    found = scene(load_design(data))
    assert found.magnification == 0
    assert not of(found, "ellipsoid", "tcp")
    check_picture(draw_scene(found))


# --- the scene on paper ---------------------------------------------------------------------------


def near_panel(found: LayoutScene) -> tuple[Array, ElementTree.Element]:
    """(4, 2) the affine map from con to the page of the left panel, fitted to the fiducials' circles."""
    root = check_picture(draw_scene(found))
    at = circles(root, "#0072b2")
    titles = [
        str(group[1].text)
        for group in root.iter(f"{SVG}g")
        if len(group) == 2 and group[0].tag == f"{SVG}circle" and "transform" not in group.attrib
        and group[0].attrib["fill"] == "#0072b2"
    ]  # fmt: skip
    con = np.array([[*numbers(title.split(": ")[1]), 1.0] for title in titles])
    at = at[: len(con)]
    affine, *_ = np.linalg.lstsq(con, at, rcond=None)
    np.testing.assert_allclose(con @ affine, at, atol=2 * ROUNDING)
    return affine, root


def test_the_picture_is_orthographic_and_its_bar_has_its_length() -> None:
    """independent: rows of the fitted map are orthogonal and of the bar's scale, and those of the first camera."""
    affine, root = near_panel(demo_scene())
    right, down = affine[:3].T
    scale = float(np.linalg.norm(right))
    assert right @ down == pytest.approx(0, abs=2e-3 * scale**2)
    assert float(np.linalg.norm(down)) == pytest.approx(scale, rel=3e-3)
    camera = demo_scene().cameras[0]
    np.testing.assert_allclose(right / scale, camera.right, atol=3e-3)
    np.testing.assert_allclose(-down / scale, camera.up, atol=3e-3)
    bars = [numbers(path.attrib["d"]) for path in root.iter(f"{SVG}path") if path.attrib.get("stroke-width") == "1.6"]
    level = [bar for bar in bars if len(bar) == 4 and bar[1] == bar[3] and bar[2] < 450]
    words = next(str(entry.text) for entry in root.iter(f"{SVG}text") if re.fullmatch(r"\d+ mm", str(entry.text)))
    assert level[-1][2] - level[-1][0] == pytest.approx(numbers(words)[0] * scale, rel=5e-3)


def test_an_ellipsoid_is_drawn_as_its_outline() -> None:
    """independent: the shadow of x' S^-1 x = 1 across the page is the ellipse of P S P'."""
    affine, root = near_panel(demo_scene())
    (item,) = of(demo_scene(), "ellipsoid", "tcp")
    axes = np.array(item.points[1:])
    flat = affine[:3].T @ axes.T @ axes @ affine[:3]
    (drawn,) = [entry for entry in root.iter(f"{SVG}ellipse") if entry.attrib.get("transform")]
    radii = sorted(float(drawn.attrib[key]) for key in ("rx", "ry"))
    np.testing.assert_allclose(radii, np.sqrt(np.linalg.eigvalsh(flat)), rtol=5e-3, atol=2 * ROUNDING)
    turn = np.deg2rad(numbers(drawn.attrib["transform"])[0])
    along = np.linalg.eigh(flat)[1][:, 1]
    assert abs(along @ [np.cos(turn), np.sin(turn)]) > 0.999
    rings = [entry.attrib["d"] for entry in root.iter(f"{SVG}path") if entry.attrib.get("stroke-width") == "0.6"]
    steps = [ring.count("L") for ring in rings if ring.count("M") > 10]
    assert sum(steps[:3]) == pytest.approx(3 * CIRCLE / 2, abs=3)  # the near half of each, once


@pytest.mark.parametrize("name", NAMES)
def test_every_example_is_legible(name: str) -> None:
    design = example(name)
    svg = draw_scene(scene(design))
    root = check_picture(svg)
    assert svg == draw_scene(scene(example(name)))
    plain = [entry for entry in root.iter(f"{SVG}text") if not {"text-anchor", "font-weight"} & entry.attrib.keys()]
    boxes = [(float(e.attrib["x"]), float(e.attrib["y"]), 6 * len(e.text or "")) for e in plain]
    for (x, y, wide), (left, low, across) in combinations(boxes, 2):
        assert abs(y - low) > 6 or x + wide < left + 3 or left + across < x + 3, "one label does not lie on another"
    check_picture(draw_images(design, design.name))


# --- images ---------------------------------------------------------------------------------------


def test_images_are_where_a_c_arm_projects() -> None:
    """closed form: similar triangles at 1020 mm of 0.194 mm pixels; the plot is 296 units for 1536 px."""
    data = json.loads(json.dumps(DEMO.source.data))
    del data["interfaces"]["structure_connector"]["bias"]
    root = check_picture(draw_images(load_design(data), "x"))
    at = circles(root, "#0072b2")[:24]
    points = np.array([entry["position_mm"] for entry in data["fiducials"]["points"]])
    expected = []
    for column, (beam, right) in enumerate((([0, 1, 0], [1, 0, 0]), ([-1, 0, 0], [0, 1, 0]))):
        magnified = 1020 / 0.194 / (points @ beam + 700)
        image = np.stack([767.5 + magnified * (points @ right), 767.5 - magnified * points[:, 2]], axis=1)
        expected.append(np.array([360 * column + 44, 54]) + 296 / 1536 * (image + 0.5))
    np.testing.assert_allclose(at, np.vstack(expected), atol=ROUNDING)
    words = " ".join(str(entry.text) for entry in root.iter(f"{SVG}text"))
    assert "1536 × 1536 px = 298 × 298 mm, 1020 mm from the source" in words
    assert "mm at the detector" in words


def test_what_overlaps_or_misses_the_detector_is_marked_and_named() -> None:
    data = json.loads(json.dumps(DEMO.source.data))
    points = data["fiducials"]["points"]
    points[1]["position_mm"] = [points[0]["position_mm"][0], 20.0, points[0]["position_mm"][2] * 720 / 671 + 0.1]
    points[1]["position_mm"][0] *= 720 / 671
    points[2]["position_mm"] = [0.0, 0.0, 130.0]
    root = check_picture(draw_images(load_design(data), "x"))
    words = [str(entry.text) for entry in root.iter(f"{SVG}text")]
    assert any(entry.startswith("closer than 25 px: F1–F2") for entry in words)
    assert sum(entry == "not on the detector: F3" for entry in words) == 2
    rings = [entry for entry in root.iter(f"{SVG}circle") if entry.attrib.get("stroke") == "#b3261e"]
    assert len(rings) >= 4  # the pair, F3 in both views, the legend


def test_images_that_rounding_brings_nearer_are_not_marked() -> None:
    """closed form: a distance that is asked for by 0.005 px more than there is is kept, by 0.02 px more it is not."""
    closest = min(view.closest_pair_px for view in score(DEMO, losses=False).views)
    for more, marked in ((0.005, False), (0.02, True)):
        data = json.loads(json.dumps(DEMO.source.data))
        data["optimise"]["min_projected_spacing_px"] = closest + more
        assert ("closer than" in draw_images(load_design(data), "x")) == marked


def test_a_small_cluster_is_drawn_once_more_enlarged() -> None:
    root = read(draw_images(example("small_cluster_far_target"), "x"))
    words = [str(entry.text) for entry in root.iter(f"{SVG}text")]
    assert {"AP", "AP, enlarged", "oblique", "oblique, enlarged"} <= set(words)
    at = circles(root, "#0072b2")
    assert len(at) == 4 * 8 + 1  # and the legend's
    small, large = np.ptp(at[:8], axis=0), np.ptp(at[8:16], axis=0)
    np.testing.assert_allclose(large / small, large[0] / small[0], rtol=0.05)
    assert large[0] > 2 * small[0]


def test_an_unknown_image_size_and_a_layout_before_are_drawn_as_such() -> None:
    data = json.loads(json.dumps(example("locators_321").source.data))
    for view in data["views"]:
        del view["image_size_px"]
    root = check_picture(draw_images(load_design(data), "x"))
    assert any("not stated" in str(entry.text) for entry in root.iter(f"{SVG}text"))
    data = json.loads(json.dumps(DEMO.source.data))
    for entry in data["fiducials"]["points"][:4]:
        entry["position_mm"][2] += 10
    root = check_picture(draw_images(load_design(data), "x", before=DEMO))
    moved = [path for path in root.iter(f"{SVG}path") if path.attrib.get("stroke-width") == "0.9"]
    assert len(moved) == 2 * 4 + 1  # and the legend's


# --- charts ---------------------------------------------------------------------------------------


def shares(mean: float, edges: Array) -> tuple[float, ...]:
    """Of a Rayleigh law: closed form."""
    beyond = np.exp(-((edges / mean) ** 2))
    return tuple(float(v) for v in beyond[:-1] - beyond[1:])


def distribution(target: str, mean: float, sampled: bool = True) -> ErrorDistribution:
    edges = np.linspace(0, 3 * mean, 31)
    law = shares(mean, edges)
    return ErrorDistribution(target, tuple(map(float, edges)), law if sampled else None, law, 5000 if sampled else None)


def test_the_histogram_has_area_by_its_scale() -> None:
    """closed form: heights over the ticks times the width of a bin are the shares."""
    shown = distribution("tip", 0.5)
    root = check_picture(draw_distribution(shown, 0.87, (0.85, 0.89), 1.0, "d"))
    bars = [b.attrib for b in root.iter(f"{SVG}rect") if b.attrib.get("stroke-width") == "0.6"][:30]
    ticks = [
        (float(str(e.text)), float(e.attrib["y"]) - 4)
        for e in root.iter(f"{SVG}text")
        if e.attrib.get("text-anchor") == "end" and re.fullmatch(r"[\d.]+", str(e.text))
    ]
    (low, y_low), (high, y_high) = ticks[0], ticks[-1]
    per_unit = (high - low) / (y_low - y_high)
    drawn = [float(bar["height"]) * per_unit * (3 * 0.5 / 30) for bar in bars]
    assert shown.sampled is not None
    np.testing.assert_allclose(drawn, shown.sampled, atol=0.1 * per_unit * 0.05 + 1e-9)
    red = [bar["fill"] == "#e8aaa5" for bar in bars]
    assert red == [edge >= 1.0 for edge in shown.edges_mm[:30]]
    words = [str(entry.text) for entry in root.iter(f"{SVG}text")]
    assert "interval of P95, 0.850 to 0.890 mm" in words


@pytest.mark.parametrize(
    ("interval", "limit"),
    [
        pytest.param(interval, limit, marks=pytest.mark.long if (k + i) % 4 else [])
        for k, interval in enumerate([None, (0.8, 0.95), (0.0, None)])
        for i, limit in enumerate([None, 0.2, 0.86, 0.87, 0.95, 5.0])
    ],
)
def test_charts_of_errors_are_legible_wherever_the_limit_is(
    interval: tuple[float, float | None] | None, limit: float | None
) -> None:
    check_picture(draw_distribution(distribution("tip", 0.5), 0.87, interval, limit, "d"))
    check_picture(draw_distribution(distribution("tip", 0.5, sampled=False), 0.87, interval, limit, "d"))
    others = (("mean", 0.44), ("CVaR95", 1.02))
    for quantile in ("P95", "P95 that 90 % of units keep"):
        ends, of = interval or (0.86, 0.88), {"headline": quantile, "limit": limit}
        shown = Headline("pass", "first order", "", None, "tip", 0.95, 0.87, ends, matters=(), **of)  # type: ignore[arg-type]
        for width in (WIDTH, PHONE):
            root = check_picture(draw_scale(shown, others, "s", width))
            value = next(box for box in texts(root) if "0.870" in box[0])
            lines = [line for line in root.iter(f"{SVG}path") if line.attrib.get("stroke") == LIMIT_COLOUR]
            assert len(lines) == (limit is not None)
            assert all(not value[1] < numbers(line.attrib["d"])[0] < value[3] for line in lines)


@pytest.mark.long("flat_plate", "slicer_markups", "tube_carrier")
@pytest.mark.parametrize("name", NAMES)
def test_charts_of_budgets_are_legible(name: str) -> None:
    found = score(example(name))
    target = max(found.targets, key=lambda entry: entry.p95_mm)
    root = check_picture(draw_shares(target.contributors, target.name))
    bars = [b.attrib for b in root.iter(f"{SVG}rect") if b.attrib["fill"] == "#5b9bc8"]
    ends = [float(bar["x"]) + float(bar["width"]) for bar in bars]
    assert ends == sorted(ends)
    for check in found.verdict.checks[:1]:
        levers = [lever for lever in found.levers if lever.requirement == check.requirement]
        check_picture(draw_levers(levers, check))


def test_budgets_side_by_side_add_as_squares() -> None:
    """independent: the last row is the trace of the covariance; one design lacks what the other has."""
    data = json.loads(json.dumps(DEMO.source.data))
    del data["execution"]
    first, second = (score(design).targets[0] for design in (DEMO, load_design(data)))
    root = check_picture(draw_budgets(first, second, ("as drawn", "without execution")))
    values = [str(e.text) for e in root.iter(f"{SVG}text") if e.attrib.get("font-size") == "10"]
    for value, target in zip(values[-2:], (first, second), strict=True):
        total = sqrt(sum(target.covariance_mm2[k][k] for k in range(3)))
        assert value == f"{total:.3f}"
    pairs = np.array(
        [[0.0 if v == "not there" else float(v) for v in values[k : k + 2]] for k in range(0, len(values), 2)]
    )
    np.testing.assert_allclose(np.sqrt((pairs[:-1] ** 2).sum(axis=0)), pairs[-1], atol=2e-3)
    assert "not there" in values


def test_errors_over_one_another() -> None:
    svg = draw_errors(distribution("tip", 0.5), distribution("tip", 0.4), (0.87, 0.69), 0.8, ("old", "new"))
    root = check_picture(svg)
    words = " ".join(str(entry.text) for entry in root.iter(f"{SVG}text"))
    assert "old, P95 0.870 mm" in words
    assert "new, P95 0.690 mm" in words
    check_picture(draw_errors(distribution("tip", 0.5, False), distribution("tip", 0.4), (0.9, 0.7), None))


@pytest.mark.long
def test_names_cannot_break_a_picture() -> None:
    data: dict[str, Any] = small_design(name=HOSTILE)
    data["targets"][0]["name"] = HOSTILE
    data["views"][0]["name"] = "</svg><script>"
    data["fiducials"]["points"][0]["label"] = '"><img src=x>'
    design = load_design(data)
    record = score(design)
    target, check = record.targets[0], replace(record.verdict.checks[0], requirement=HOSTILE)
    levers = [replace(lever, label=HOSTILE) for lever in record.levers]
    hostile = replace(distribution("tip", 0.5), target=HOSTILE)
    pictures = [
        draw_scene(scene(design)), draw_images(design, HOSTILE),
        draw_shares(target.contributors, HOSTILE), draw_levers(levers, check),
        draw_distribution(hostile, 0.8, None, None, "d"), draw_budgets(target, target, (HOSTILE, "\x1b[31m\u202e")),
        draw_errors(hostile, hostile, (0.8, 0.8), None, (HOSTILE, HOSTILE)),
        draw_sweep(sweep(design, read_axes(design, [{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.2]}]))),
    ]  # fmt: skip
    for svg in pictures:
        root = read(svg)
        assert {entry.tag.removeprefix(SVG) for entry in root.iter()}.isdisjoint({"script", "img", "b"})
        assert "\x1b" not in svg
        assert "\u202e" not in svg


def test_a_sweep_of_which_one_point_could_be_computed_is_drawn() -> None:
    design = load_design(small_design())
    axes = read_axes(design, [{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.2]}])
    found = sweep(design, axes)
    refused = replace(found.points[1], status="refused", reason="not possible", targets=(), verdict=None)
    words = "".join(check_picture(draw_sweep(replace(found, points=(found.points[0], refused)))).itertext())
    assert "1 of 2 points were refused and are not drawn" in words


def test_nothing_random_is_said() -> None:
    data = json.loads(json.dumps(DEMO.source.data))
    for view in data["views"]:
        view["fiducial_noise_px"] = view["target_noise_px"] = 0.0
    del data["fiducials"]["manufacturing"], data["execution"], data["interfaces"]["connector_flange"], data["optimise"]
    del data["interfaces"]["structure_connector"]["tolerances"]
    design = load_design(data)
    target = score(design).targets[0]
    svg = draw_shares(target.contributors, target.name)
    assert "nothing is random" in {str(entry.text) for entry in check_picture(svg).iter(f"{SVG}text")}
    assert of(scene(design), "arrow", "bias")


def test_hundreds_of_fiducials_and_many_views_stay_cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seed 5.  What is drawn grows with the fiducials and no faster, and nothing is scored again for it."""
    data = json.loads(json.dumps(DEMO.source.data))
    rng = np.random.default_rng(5)
    places = rng.uniform((-50, -50, -80), (50, 50, 30), (300, 3)).round(2).tolist()
    data["fiducials"]["points"] = [{"position_mm": place} for place in places]
    del data["optimise"], data["views"][0]["orientation"]
    data["views"] = [
        {**data["views"][0], "name": f"view {k}", "beam_direction": [np.cos(k / 2), np.sin(k / 2), 0.2]}
        for k in range(8)
    ]
    design = load_design(data)
    judged = score(design)
    half = load_design({**data, "fiducials": {**data["fiducials"], "points": data["fiducials"]["points"][:150]}})
    fewer = scene_of(half, judged, "x")
    fewer_drawn, fewer_imaged = draw_scene(fewer), draw_images(half, "x")
    models = calls_of(monkeypatch, LinearModel, "__init__")
    compiled = [calls_of(monkeypatch, module, "compile_design") for module in (scenes, images)]
    gaps = calls_of(monkeypatch, images, "needed_gaps")
    found = scene_of(design, judged, "x")
    drawn, imaged = draw_scene(found), draw_images(design, "x")
    assert models == []
    assert [len(calls) for calls in compiled] == [1, 1]
    assert len(gaps) == len(data["views"])
    assert len(found.items) - len(fewer.items) == 150 * (1 + len(data["views"]))  # one each, and its image in each view
    assert len(drawn) <= 2 * len(fewer_drawn)
    assert len(imaged) <= 2 * len(fewer_imaged)
    assert len(drawn) + len(imaged) + len(scene_json(found)) < 1_500_000
    words = {str(entry.text) for entry in read(drawn).iter(f"{SVG}text")}
    assert "view 7" in words
    assert "F1" not in words  # no room for three hundred names


def test_a_fiducial_that_a_view_does_not_use_is_drawn_hollow() -> None:
    data = small_design(optimise=None)
    labels = load_design(data).fiducials.labels
    whole = draw_images(load_design(data), "all")
    data["views"][1]["sees"] = list(labels[1:])
    picture = draw_images(load_design(data), "one less")
    assert whole.count("(not used)") == 0
    assert picture.count("(not used)") == 1
    assert "not used by this view" in picture
    assert [point.used for point in lay_out(load_design(data)).views[1].fiducials] == [
        False,
        *[True] * (len(labels) - 1),
    ]


def test_executed_axes_leave_a_corridor_as_trials_do() -> None:
    """independent: ends of the simulation's own shots across the axis, by cross products."""
    design = example("pedicle_screw")
    found, system = scene(design), compile_design(design)
    (planned,) = of(found, "line", "trajectory")
    rims = [np.array(item.points) for item in of(found, "line", "corridor") if len(item.points) > 2]
    begin, end = np.array(planned.points)
    along = (end - begin) / np.linalg.norm(end - begin)
    for rim, centre in zip(rims, (begin, end), strict=True):
        radii = np.linalg.norm(rim - centre, axis=1)
        assert radii == pytest.approx(np.full(len(rim), 1.25 * found.magnification), abs=2 * WRITTEN)
    drawn = np.array([item.points for item in of(found, "line", "executed")]) - [begin, end]
    off = np.linalg.norm(np.cross(drawn, along), axis=2) / found.magnification
    errors = run_indices(compile_plan(system), 0, 0, 50).errors[::-1, 0]  # entry, tip
    turned = system.T_tcp_con[:3, :3] @ along
    expected = np.linalg.norm(np.cross(np.moveaxis(errors, 1, 2), turned), axis=2)
    np.testing.assert_allclose(off.T, expected, atol=2 * WRITTEN)
    assert "executed axes" in found.note
    assert not of(scene_of(design, None, design.name), "line", "executed")
    apart = scene_of(design.with_value("targets.tip.ends", "two_shots"), score(design), design.name)
    of_two = np.array([item.points for item in of(apart, "line", "executed")]) - [begin, end]
    np.testing.assert_array_equal(of_two[:, 1], drawn[:, 1])
    share = [np.corrcoef(each[:, 0].T, each[:, 1].T)[0, 3] for each in (drawn, of_two)]
    assert 0.5 < share[1] < share[0]  # of seats alone, no longer of the beads' images
