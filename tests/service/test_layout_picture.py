"""The picture of two layouts: what is on the page is where cameras and axes put it, legible and the same each time."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from service_scenes import EXAMPLES

from tailstack.arrays import Array
from tailstack.design import compile_design, load_design
from tailstack.system import System, Target, no_sources
from tailstack_service.rendering.layout_picture import layout_svg
from tailstack_service.report.svg import MarkedPoint, label_places

BEFORE = compile_design(load_design(Path(EXAMPLES / "demo.yaml")))
SVG = "{http://www.w3.org/2000/svg}"
ROUNDING = 0.051  # the page has one decimal
FOCAL_PX, CENTRE_PX, SOURCE_MM = 1020 / 0.194, 767.5, 700.0  # of the demo's views


def with_fiducials(system: System, positions: Array, labels: tuple[str, ...]) -> System:
    """The manufacturing arrays are not drawn and stay as they are."""
    return replace(system, fiducials_mm=positions, fiducial_labels=labels)


def moved_demo() -> System:
    """F1 left out, F2 ... F11 moved, F12 as it was, F13 new, the first pivot moved."""
    rng = np.random.default_rng(5)
    moved = BEFORE.fiducials_mm[1:11] + rng.uniform(5, 12, (10, 3)) * np.array([1.0, -1.0, 1.0])
    positions = np.vstack([moved, BEFORE.fiducials_mm[11:], [[0.0, 0.0, 8.0]]])
    labels = (*BEFORE.fiducial_labels[1:], "F13")
    mount = replace(BEFORE.structure_connector, pivot_mm=np.array([0.0, 0.0, -80.0]))
    return replace(with_fiducials(BEFORE, positions, labels), structure_connector=mount)


AFTER = moved_demo()


@dataclass(frozen=True)
class Drawn:
    """A mark as it was found on the page."""

    kind: str
    name: str
    column: int
    row: int
    at: Array  # (2,) page


def read(svg: str) -> ElementTree.Element:
    return ElementTree.fromstring(svg)


def numbers(text: str) -> list[float]:
    return [float(value) for value in re.findall(r"-?\d+(?:\.\d+)?", text)]


def marks(root: ElementTree.Element) -> list[Drawn]:
    """Every mark with its tooltip; a cross and a triangle are placed by their middle."""
    found = []
    for group in root.findall(f"{SVG}g"):
        shape = group[0]
        if shape.tag == f"{SVG}circle":
            at = np.array([float(shape.attrib["cx"]), float(shape.attrib["cy"])])
        else:
            points = np.array(numbers(shape.attrib.get("d") or shape.attrib["points"])).reshape(-1, 2)
            at = (points.min(axis=0) + points.max(axis=0)) / 2
        name = str(group[1].text).rsplit(": ", 1)[0]
        found.append(Drawn(group.attrib["class"], name, int((at[0] - 15) // 390), int(at[1] > 462), at))
    return found


def lines(root: ElementTree.Element, colour: str, width: str) -> list[Array]:
    """(2, 2) ends of the straight lines of a colour and width, legend (below 880) left out."""
    ends = [
        np.array(numbers(path.attrib["d"])).reshape(-1, 2)
        for path in root.findall(f"{SVG}path")
        if (path.attrib["stroke"], path.attrib["stroke-width"]) == (colour, width)
    ]
    return [line for line in ends if line[0, 1] < 880]


def test_it_is_svg_with_a_title_and_a_description() -> None:
    root = read(layout_svg(BEFORE, AFTER, "drill guide: before & after"))
    assert root.tag == f"{SVG}svg"
    assert [child.tag for child in root[:2]] == [f"{SVG}title", f"{SVG}desc"]
    assert root[0].text == "drill guide: before & after"
    assert root.attrib["aria-labelledby"].split() == [root[0].attrib["id"], root[1].attrib["id"]]
    assert "12 fiducials, 10 moved, 1 new, 1 left out" in str(root[1].text)
    assert "AP and LAT" in str(root[1].text)


def test_the_same_input_gives_the_same_bytes() -> None:
    assert layout_svg(BEFORE, AFTER, "x").encode() == layout_svg(BEFORE, moved_demo(), "x").encode()


@pytest.mark.parametrize(("column", "beam"), [(0, (0.0, 1.0, 0.0)), (1, (-1.0, 0.0, 0.0))])
def test_fiducials_and_targets_are_where_a_c_arm_images_them(column: int, beam: tuple[float, float, float]) -> None:
    """closed form: similar triangles, u to the right of the beam and v against z, both rows on one scale."""
    root = read(layout_svg(BEFORE, AFTER, "x"))
    right = np.cross(beam, (0.0, 0.0, 1.0))
    image, page = [], []
    for row, system in enumerate((BEFORE, AFTER)):
        names = dict(zip(system.fiducial_labels, system.fiducials_mm, strict=True))
        names |= {target.name: target.position_mm for target in system.targets}
        found = [mark for mark in marks(root) if (mark.column, mark.row) == (column, row)]
        assert sorted(mark.name for mark in found) == sorted(names)
        for mark in found:
            x = names[mark.name]
            magnified = FOCAL_PX / (x @ beam + SOURCE_MM)
            image.append((CENTRE_PX + magnified * (x @ right), CENTRE_PX - magnified * x[2]))
            page.append(mark.at - [0, row * 418])
    image_px, page_at = np.array(image), np.array(page)
    scale = 340 / 1536  # the image's border fills the panel
    expected = np.array([15 + 390 * column + 42, 52 + 30]) + scale * (image_px + 0.5)
    np.testing.assert_allclose(page_at, expected, atol=ROUNDING)


def test_ticks_stand_at_their_pixels() -> None:
    """closed form: column 500 of an image of 1536 is at 500.5 / 1536 of its width."""
    root = read(layout_svg(BEFORE, AFTER, "x"))
    found = [
        float(t.attrib["x"]) for t in root.findall(f"{SVG}text") if t.text == "500" and "middle" in t.attrib.values()
    ]
    assert sorted(found) == pytest.approx(
        sorted(2 * [15 + 390 * c + 42 + 340 * 500.5 / 1536 for c in (0, 1)]), abs=0.051
    )


def test_the_oblique_view_is_orthographic_and_its_bar_has_its_length() -> None:
    """independent: the page is an affine map of con whose rows are orthogonal and of the bar's scale."""
    root = read(layout_svg(BEFORE, AFTER, "x"))
    for row, system in enumerate((BEFORE, AFTER)):
        found = {mark.name: mark.at for mark in marks(root) if (mark.column, mark.row) == (2, row)}
        con = np.array([[*x, 1.0] for x in system.fiducials_mm])
        page = np.array([found[label] for label in system.fiducial_labels])
        affine, *_ = np.linalg.lstsq(con, page, rcond=None)
        np.testing.assert_allclose(con @ affine, page, atol=2 * ROUNDING)
        right, down = affine[:3].T
        assert right @ down == pytest.approx(0, abs=2e-3)
        assert np.linalg.norm(right) == pytest.approx(np.linalg.norm(down), rel=5e-3)
        assert down[2] < 0  # z is up
        for pivot, mount in (("pivot 1", system.structure_connector), ("pivot 2", system.connector_flange)):
            at = next(at for name, at in found.items() if name.startswith(pivot))
            expected = np.append(mount.pivot_mm, 1.0) @ affine
            np.testing.assert_allclose(at, expected, atol=1.2)  # a triangle's middle is not its box's
    bar = next(str(t.text) for t in root.findall(f"{SVG}text") if "across the line of sight" in str(t.text))
    level = lines(root, "#222222", "1.6")
    assert [abs(line[1, 0] - line[0, 0]) for line in level] == pytest.approx(
        2 * [numbers(bar)[0] * np.linalg.norm(right)], rel=5e-3
    )


def test_what_moved_has_a_line_from_where_it_was() -> None:
    """independent: old and new places are the circles of both rows, one row below the other."""
    root = read(layout_svg(BEFORE, AFTER, "x"))
    found = {(mark.column, mark.row, mark.name): mark.at for mark in marks(root)}
    expected = [
        np.array([found[column, 0, name] + [0, 418], found[column, 1, name]])
        for column in range(3)
        for name in AFTER.fiducial_labels
        if name not in ("F12", "F13")
    ]
    pivots = [mark.at for mark in marks(root) if mark.kind == "pivot-1"]
    drawn = lines(root, "#8a8a8a", "0.9")
    of_pivot = [line for line in drawn if abs(line[1] - pivots[1]).max() < 1.2]
    assert len(of_pivot) == 1
    rest = [line for line in drawn if line is not of_pivot[0]]
    assert len(rest) == len(expected) == 30
    for line in expected:
        assert min(abs(other - line).max() for other in rest) <= 2 * ROUNDING


def test_new_ones_are_hollow_and_those_left_out_are_gone() -> None:
    root = read(layout_svg(BEFORE, AFTER, "x"))
    assert {mark.name for mark in marks(root) if mark.kind == "new"} == {"F13"}
    assert {mark.row for mark in marks(root) if mark.name == "F13"} == {1}
    assert {mark.row for mark in marks(root) if mark.name == "F1"} == {0}
    fills = {group.attrib["class"]: group[0].attrib["fill"] for group in root.findall(f"{SVG}g")}
    assert fills["new"] == "#ffffff" != fills["fiducial"]


def test_nothing_moved() -> None:
    root = read(layout_svg(BEFORE, BEFORE, "x"))
    assert "none moved" in str(root[1].text)
    assert {mark.kind for mark in marks(root)} == {"fiducial", "target", "pivot-1", "pivot-2"}


def test_a_perfect_seat_has_no_pivot() -> None:
    perfect = replace(BEFORE.connector_flange, sources=no_sources(6), bias=np.zeros(6))
    root = read(layout_svg(replace(BEFORE, connector_flange=perfect), replace(AFTER, connector_flange=perfect), "x"))
    assert {mark.kind for mark in marks(root)} == {"fiducial", "new", "target", "pivot-1"}
    assert "pivot 2" not in " ".join(str(text.text) for text in root.findall(f"{SVG}text"))


def test_an_image_of_unknown_size_is_as_large_as_what_is_in_it() -> None:
    views = tuple(replace(view, image_size_px=None) for view in BEFORE.views)
    root = read(layout_svg(replace(BEFORE, views=views), replace(AFTER, views=views), "x"))
    boxes = [box for box in root.findall(f"{SVG}rect") if "stroke-dasharray" in box.attrib]
    assert len(boxes) == 4
    for box in boxes:
        left, top = float(box.attrib["x"]), float(box.attrib["y"])
        right, bottom = left + float(box.attrib["width"]), top + float(box.attrib["height"])
        column, row = int((left - 15) // 390), int(top > 462)
        inside = [mark.at for mark in marks(root) if (mark.column, mark.row) == (column, row)]
        assert len(inside) == 13
        assert all(left < x < right and top < y < bottom for x, y in inside)
    assert any("image size unknown" in str(text.text) for text in root.findall(f"{SVG}text"))


def test_a_small_layout_is_enlarged_and_says_so() -> None:
    """independent: px follow from the tooltips; a quarter of the size leaves a part of the image to be shown."""
    small = [
        replace(
            with_fiducials(system, 0.25 * system.fiducials_mm, system.fiducial_labels),
            targets=(Target("tip", np.array([0.0, 0.0, 12.0])),),
        )
        for system in (BEFORE, AFTER)
    ]
    root = read(layout_svg(small[0], small[1], "x"))
    captions = [str(text.text) for text in root.findall(f"{SVG}text") if "image 1536 × 1536" in str(text.text)]
    assert len(captions) == 4
    assert all("part of an image" in caption for caption in captions)
    groups = [group for group in root.findall(f"{SVG}g") if group[0].tag == f"{SVG}circle"]
    image = np.array(
        [numbers(str(group[1].text).rsplit(": ", 1)[1]) for group in groups if " px" in str(group[1].text)]
    )
    page = np.array([mark.at for mark in marks(root) if mark.column < 2 and mark.kind != "target"])
    scale = np.ptp(page[:12], axis=0) / np.ptp(image[:12], axis=0)
    assert scale[0] == pytest.approx(scale[1], rel=0.01)
    assert scale[0] > 2 * 340 / 1536


def test_what_lies_behind_a_source_has_no_image() -> None:
    """A layout that was never checked may hold such a fiducial; AP's source is at y = -700 mm."""
    positions = BEFORE.fiducials_mm.copy()
    positions[0] = (0.0, -900.0, 0.0)
    root = read(layout_svg(with_fiducials(BEFORE, positions, BEFORE.fiducial_labels), BEFORE, "x"))
    assert sorted((mark.column, mark.row) for mark in marks(root) if mark.name == "F1") == [
        (0, 1), (1, 0), (1, 1), (2, 0), (2, 1),
    ]  # fmt: skip


def test_names_cannot_break_the_document() -> None:
    labels = ("<script>", 'a"b', "&amp;", "x\x00\x1b[31m", "\ud800", *BEFORE.fiducial_labels[5:])
    hostile = replace(BEFORE, fiducial_labels=labels, targets=(Target("]]>", np.array([0.0, 0.0, 70.0])),))
    svg = layout_svg(hostile, hostile, "</title><script>alert(1)</script>")
    svg.encode()
    root = read(svg)
    assert {mark.name for mark in marks(root)} >= {"<script>", 'a"b', "&amp;", "]]>"}
    assert not list(root.iter(f"{SVG}script"))


def boxes_of_labels(root: ElementTree.Element, names: set[str]) -> list[tuple[float, float, float, float]]:
    """Labels as boxes: the height of capitals, six tenths of it per character."""
    return [
        (x, y - 8.0, x + 6.0 * len(str(text.text)), y)
        for text in root.findall(f"{SVG}text")
        if text.text in names
        for x, y in [(float(text.attrib["x"]), float(text.attrib["y"]))]
    ]


def covering(boxes: list[tuple[float, float, float, float]]) -> int:
    """Pairs of boxes that cover one another."""
    return sum(
        min(a[2], b[2]) - max(a[0], b[0]) > 0.5 and min(a[3], b[3]) - max(a[1], b[1]) > 0.5
        for k, a in enumerate(boxes)
        for b in boxes[:k]
    )


@pytest.mark.parametrize("count", [6, 12])
def test_labels_do_not_cover_one_another(count: int) -> None:
    names = BEFORE.fiducial_labels[:count]
    pair = [with_fiducials(system, system.fiducials_mm[:count], names) for system in (BEFORE, AFTER)]
    root = read(layout_svg(pair[0], pair[1], "x"))
    boxes = boxes_of_labels(root, set(names))
    assert len(boxes) == 6 * count
    assert covering(boxes) == 0


def test_forty_fiducials_are_named_in_the_images_only() -> None:
    rng = np.random.default_rng(11)
    names = tuple(f"F{k + 1}" for k in range(40))
    pair = [with_fiducials(BEFORE, rng.uniform((-40, -40, -80), (40, 40, 10), (40, 3)), names) for _ in range(2)]
    root = read(layout_svg(pair[0], pair[1], "x"))
    boxes = boxes_of_labels(root, set(names))
    assert len(boxes) == 4 * 40
    assert covering(boxes) < 0.1 * len(boxes)
    assert {mark.name for mark in marks(root) if mark.column == 2} >= set(names)


def test_a_region_is_named_once_per_panel() -> None:
    samples = tuple(Target(f"work[{k}]", np.array([x, 0.0, 60.0]), "work") for k, x in enumerate((-20.0, 0.0, 20.0)))
    system = replace(BEFORE, targets=samples)
    root = read(layout_svg(system, system, "x"))
    assert sum(text.text == "work" for text in root.findall(f"{SVG}text")) == 6
    assert sum(mark.kind == "target" for mark in marks(root)) == 18


def test_a_label_with_room_stands_right_of_its_point_and_twins_are_told_apart() -> None:
    frame = (0.0, 0.0, 300.0, 300.0)
    ((x, y),) = label_places([MarkedPoint(100.0, 100.0, "F1")], [], frame, 11)
    assert 100 < x < 115
    assert 98 < y < 108
    ((x, _),) = label_places([MarkedPoint(295.0, 100.0, "F1")], [], frame, 11)
    assert x < 295 - 13  # no room at the right
    twins = label_places([MarkedPoint(100.0, 100.0, "F1"), MarkedPoint(102.0, 101.0, "F2")], [], frame, 11)
    assert covering([(x, y - 8, x + 12, y) for x, y in twins]) == 0
