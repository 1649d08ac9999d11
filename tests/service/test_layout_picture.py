"""The picture of two layouts: one over the other in space and in both views, legible and the same each time."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from service_scenes import EXAMPLES
from test_report_figures import SVG, check_picture, circles, covering, read, texts

from tailstack.design import Design, load_design
from tailstack_service.report.scene_picture import draw_layouts
from tailstack_service.report.svg import MarkedPoint, label_places

DEMO = load_design(EXAMPLES / "demo.yaml")
HOSTILE = ["<script>", 'a"b', "&amp;", "x\u00ad", "]]>"]
LONG = "bead at the very end of the carrier of the left arm, " + "x" * 27


def document() -> dict[str, Any]:
    return json.loads(json.dumps(DEMO.source.data))  # type: ignore[no-any-return]


def changed() -> Design:
    """F1 left out, F2 ... F11 moved, F12 as it was, F13 new."""
    data, rng = document(), np.random.default_rng(5)
    points = data["fiducials"]["points"][1:]
    for point in points[:10]:
        moved = np.array(point["position_mm"]) + rng.uniform(5, 12, 3) * np.array([1.0, -1.0, 1.0])
        point["position_mm"] = moved.round(3).tolist()
    data["fiducials"]["points"] = [*points, {"label": "F13", "position_mm": [0.0, 0.0, 8.0]}]
    return load_design(data)


AFTER = changed()


def words_of(svg: str) -> list[str]:
    return [words for words, *_ in texts(read(svg))]


def test_it_says_what_became_of_the_layout() -> None:
    svg = draw_layouts(AFTER, DEMO, "drill guide: before & after")
    root = check_picture(svg)
    assert root[0].text == "drill guide: before & after"
    assert "drill guide: before & after" in words_of(svg)
    assert "12 fiducials before, 12 after: 10 moved, 1 new, 1 left out. In grey: before." in words_of(svg)
    assert "10 moved, 1 new, 1 left out" in str(root[1].text)
    assert "Images of 12 fiducials" in str(root[1].text)
    assert {"F12", "F13", "AP", "LAT"} <= set(words_of(svg))
    assert "F1" not in words_of(svg)
    assert "none moved" in str(check_picture(draw_layouts(DEMO, DEMO, "x"))[1].text)


def test_the_same_input_gives_the_same_bytes() -> None:
    assert draw_layouts(AFTER, DEMO, "x").encode() == draw_layouts(changed(), DEMO, "x").encode()


def test_what_moved_has_a_line_from_where_it_was_in_space_and_in_both_views() -> None:
    root = read(draw_layouts(AFTER, DEMO, "x"))
    lines = [path for path in root.iter(f"{SVG}path") if path.attrib.get("stroke") == "#8a8a8a"]
    assert sum(path.attrib.get("stroke-width") == "0.9" for path in lines) == 3 * 10 + 2  # and both legends'
    places = circles(root, "#0072b2")
    for view in (0, 1):  # in a view a line ends at a fiducial
        ends = [path.attrib["d"].split("L")[1].split() for path in lines if path.attrib["stroke-width"] == "0.9"]
        last = np.array(ends[11 + 10 * view], dtype=float)
        assert np.abs(places - last).max(axis=1).min() < 0.11


def test_a_layout_that_determines_nothing_is_drawn_as_it_was() -> None:
    """Six beads of a plane: no score, and so no ellipsoid; what moved is there."""
    data = document()
    data["fiducials"]["points"] = [
        {**point, "position_mm": [*point["position_mm"][:2], -30.0]} for point in data["fiducials"]["points"]
    ]
    data.pop("optimise")
    svg = draw_layouts(DEMO, load_design(data), "x")
    check_picture(svg)
    assert "12 fiducials before, 12 after: 12 moved. In grey: before." in words_of(svg)
    assert "error at the tool, before" not in " ".join(words_of(svg))


def test_what_lies_behind_a_source_has_no_image() -> None:
    """A layout that was never checked may hold such a fiducial; AP's source is at y = -700 mm."""
    data = document()
    data["fiducials"]["points"][0]["position_mm"] = [0.0, -900.0, 0.0]
    data.pop("optimise")
    root = read(draw_layouts(DEMO, load_design(data), "x"))
    lines = [path for path in root.iter(f"{SVG}path") if path.attrib.get("stroke-width") == "0.9"]
    assert sum(path.attrib["stroke"] == "#8a8a8a" for path in lines) == 2 + 2  # in space and in LAT; both legends


def test_names_cannot_break_the_document() -> None:
    data = document()
    for point, label in zip(data["fiducials"]["points"], HOSTILE, strict=False):
        point["label"] = label
    data["targets"][0]["name"] = "]]>"
    hostile = load_design(data)
    svg = draw_layouts(hostile, hostile, "</title><script>alert(1)</script>")
    root = read(svg)
    tips = " ".join(str(title.text) for title in root.iter(f"{SVG}title"))
    assert all(label in tips for label in ("<script>", 'a"b', "&amp;", "]]>"))
    assert not list(root.iter(f"{SVG}script"))


def test_a_long_name_is_whole_in_lines() -> None:
    data = document()
    data["fiducials"]["points"][0]["label"] = LONG
    data["views"][0]["name"] = LONG
    for table in data["interfaces"].values():
        table["label"] = LONG
    for requirement in data["requirements"]:
        requirement.pop("targets", None)
    data.pop("optimise")
    design = load_design(data)
    everything = "".join(words_of(draw_layouts(design, design, LONG))).replace(" ", "")
    assert everything.count(LONG.replace(" ", "")) >= 7  # title, view, fiducial in three pictures, two interfaces
    assert not [pair for pair in covering(read(draw_layouts(design, design, LONG))) if LONG[:10] in "".join(pair)]


@pytest.mark.parametrize("count", [6, 12])
def test_labels_do_not_cover_one_another(count: int) -> None:
    data = document()
    data["fiducials"]["points"] = data["fiducials"]["points"][:count]
    data.pop("optimise")
    design = load_design(data)
    svg = draw_layouts(design, design, "x")
    check_picture(svg)
    assert all(words_of(svg).count(f"F{k + 1}") == 3 for k in range(count))


def test_forty_fiducials_are_named_in_the_images() -> None:
    rng, data = np.random.default_rng(11), document()
    places = rng.uniform((-40, -40, -80), (40, 40, 10), (40, 3)).round(2).tolist()
    data["fiducials"]["points"] = [{"label": f"F{k + 1}", "position_mm": at} for k, at in enumerate(places)]
    data.pop("optimise")
    design = load_design(data)
    root = read(draw_layouts(design, design, "x"))
    names = [words for words, *_ in texts(root)]
    assert all(names.count(f"F{k + 1}") >= 2 for k in range(40))
    assert len(covering(root)) < 0.1 * 80


def test_a_label_with_room_stands_right_of_its_point_and_twins_are_told_apart() -> None:
    frame = (0.0, 0.0, 300.0, 300.0)
    ((x, y),) = label_places([MarkedPoint(100.0, 100.0, "F1")], [], frame, 11)
    assert 100 < x < 115
    assert 98 < y < 108
    ((x, _),) = label_places([MarkedPoint(295.0, 100.0, "F1")], [], frame, 11)
    assert x < 295 - 13  # no room at the right
    twins = label_places([MarkedPoint(100.0, 100.0, "F1"), MarkedPoint(102.0, 101.0, "F2")], [], frame, 11)
    assert abs(twins[0][1] - twins[1][1]) >= 8 or abs(twins[0][0] - twins[1][0]) >= 12
