"""Regions near a surface of triangles: files, distances and sides, and where the optimiser puts beads."""

from __future__ import annotations

import base64
import gzip
import random
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from damage import damaged
from plain_data import DEMO, problems_of
from tailstack import load_design
from tailstack.design import design_to_data
from tailstack.design.surface_files import MOST_TRIANGLES, read_surface
from tailstack.design.write import Revision, data_to_yaml, revise_design
from tailstack.errors import DesignError, LimitError, TailstackError
from tailstack.geometry.arrays import Array
from tailstack.geometry.mesh import Mesh
from tailstack.optimisation.surface import NearSurface
from tailstack_service.operations.revision import OutputFiles, design_text, patch_text
from tailstack_service.report.chapters.optimisation import design_listing
from tailstack_service.report.scene import surface_lines

BOX_LOW, BOX_HIGH = np.array([-45.0, -45.0, -85.0]), np.array([45.0, 45.0, 15.0])


def hull(points: Array) -> Array:
    """(T, 3, 3) the triangles of a convex hull, counterclockwise from outside."""
    found = ConvexHull(points)
    triangles = points[found.simplices]
    flip = (
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) * found.equations[:, :3]
    ).sum(axis=1) < 0
    triangles[flip] = triangles[flip][:, ::-1]
    return triangles


def box(low: Array = BOX_LOW, high: Array = BOX_HIGH) -> Array:
    return hull(np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]))


def notched() -> Array:
    """A closed surface with edges and corners that point inwards: a box with a smaller one cut out of its top."""
    inner = box(np.array([-20.0, -25.0, -30.0]), np.array([25.0, 20.0, 15.0]))
    lid = inner[:, :, 2].min(axis=1) == 15
    sides = [each for each in box() if not (each[:, 2] == 15).all()]
    outer, hole = [[-45, -45], [45, -45], [45, 45], [-45, 45]], [[-20, -25], [25, -25], [25, 20], [-20, 20]]
    top = []
    for k in range(4):
        a, b, c, d = outer[k], outer[(k + 1) % 4], hole[(k + 1) % 4], hole[k]
        top += [[a, b, c], [a, c, d]]
    lifted = [[[*corner, 15.0] for corner in triangle] for triangle in top]
    return np.array([*sides, *inner[~lid][:, ::-1], *lifted], dtype=float)


def shell() -> Array:
    """A surface with a rim: half of an elliptic tube, as a forearm shell is."""
    angles, heights = np.linspace(0.2, np.pi - 0.2, 30), np.linspace(-90, 10, 12)
    at = np.array([[[45 * np.cos(a), 36 * np.sin(a), z] for z in heights] for a in angles])
    corners = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
    pairs = [np.stack([corners[i], corners[j], corners[k]], axis=2) for i, j, k in ((0, 1, 2), (0, 2, 3))]
    return np.concatenate([pair.reshape(-1, 3, 3) for pair in pairs])


SURFACES = {
    "box": box(),
    "notched": notched(),
    "stone": hull(np.random.default_rng(7).normal(size=(60, 3)) * [50, 30, 20]),
    "shell": shell(),
}
CLOSED = ["box", "notched", "stone"]


def binary(triangles: Array) -> bytes:
    records = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    records["corners"] = triangles
    return (
        b"solid, as headers of binary files begin, too".ljust(80)
        + len(triangles).to_bytes(4, "little")
        + records.tobytes()
    )


def text(triangles: Array) -> bytes:
    lines = ["solid part"]
    for triangle in np.asarray(triangles, dtype=np.float32).tolist():
        lines += [" facet normal 0 0 0", "  outer loop", *(f"   vertex {x!r} {y!r} {z!r}" for x, y, z in triangle)]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid part", ""]).encode()


def read(triangles: Array) -> Mesh:
    return read_surface(binary(triangles), "part.stl").mesh


def distance_by_parts(points: Array, triangles: Array) -> Array:
    """(M,) by enumeration: the least over every corner, side and face of every triangle, each by least squares."""
    least = np.full(len(points), np.inf)
    for triangle in triangles:
        for basis in ([], [1], [2], [1, 2]):
            for start in range(3):
                turned = np.roll(triangle, -start, axis=0)
                edges = (turned[basis] - turned[0]).reshape(-1, 3)
                weights = (points - turned[0]) @ np.linalg.pinv(edges) if basis else np.zeros((len(points), 0))
                on = (weights >= -1e-12).all(axis=1) & (weights.sum(axis=1) <= 1 + 1e-12)
                away = np.linalg.norm(points - turned[0] - weights @ edges, axis=1)
                least = np.where(on, np.minimum(least, away), least)
    return least


def is_inside(points: Array, triangles: Array) -> Any:
    """(M,) by the solid angle (van Oosterom and Strackee 1983): a full one from inside."""
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(each, axis=2) for each in (a, b, c))
    below = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    return 2 * np.arctan2((a * np.cross(b, c)).sum(axis=2), below).sum(axis=1) > 2 * np.pi


def around(triangles: Array, count: int) -> Array:
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    return np.random.default_rng(0).uniform(low - 25, high + 25, (count, 3))


@pytest.mark.parametrize("name", SURFACES)
def test_distances_are_those_to_the_nearest_part(name: str) -> None:
    """independent: enumeration of corners, sides and faces; binary and text hold the same surface."""
    mesh, points = read(SURFACES[name]), around(SURFACES[name], 300)
    expected = distance_by_parts(points, np.asarray(mesh.places_mm))
    np.testing.assert_allclose(mesh.nearest(points).distance_mm, expected, rtol=0, atol=1e-9)
    as_text = read_surface(text(SURFACES[name]), "part.stl").mesh
    np.testing.assert_array_equal(as_text.places_mm, mesh.places_mm)


@pytest.mark.parametrize("name", CLOSED)
def test_the_side_is_that_of_the_solid_angle(name: str) -> None:
    """independent: solid angles, near corners too; a surface that faces inwards is turned, and that is said."""
    triangles = SURFACES[name]
    points = np.vstack(
        [
            around(triangles, 400),
            triangles.reshape(-1, 3) + np.random.default_rng(1).normal(size=(triangles.size // 3, 3)),
        ]
    )
    near = NearSurface(read(triangles), 1e3, side=1)
    inside = is_inside(points, triangles)
    assert inside.any()
    np.testing.assert_array_equal(near.measure(points)[0] < 0, inside)
    turned = read_surface(binary(triangles[:, ::-1]), "part.stl")
    assert "faced inwards" in turned.remarks[0]
    np.testing.assert_array_equal(turned.mesh.volume_mm3, near.mesh.volume_mm3)


@pytest.mark.parametrize(
    ("name", "side", "least_mm", "most_mm"),
    [("box", -1, 1.5, 4.0), ("notched", 1, 0.0, 3.0), ("stone", 1, 2.0, 2.0), ("shell", 0, 0.0, 3.0)],
)
def test_what_is_drawn_and_clipped_is_in_the_region(name: str, side: int, least_mm: float, most_mm: float) -> None:
    """independent: enumeration and solid angles; clipping of what is in changes nothing, and where only the largest
    distance binds none of 1500 points of the region is nearer."""
    triangles = SURFACES[name]
    region = NearSurface(read(triangles), most_mm, least_mm, side)
    drawn = region.sample(np.random.default_rng(2), 400, 0.6)
    away = distance_by_parts(drawn, np.asarray(region.mesh.places_mm))
    assert (away >= least_mm - 1e-6).all()
    assert (away <= most_mm + 1e-6).all()
    if side:
        deep = away > 1e-5
        np.testing.assert_array_equal(is_inside(drawn[deep], triangles), side < 0)
    np.testing.assert_allclose(region.clip(drawn), drawn, rtol=0, atol=1e-9)
    cloud = region.sample(np.random.default_rng(3), 1500, 0.6)
    points = around(triangles, 30)
    points = points[region.measure(points)[0] > most_mm]
    gone = np.linalg.norm(region.clip(points) - points, axis=1)
    assert (gone <= [np.linalg.norm(cloud - point, axis=1).min() + 1e-6 for point in points]).all()


@pytest.mark.parametrize("name", ["notched", "shell"])
def test_the_spline_has_slopes_and_stands_for_the_distance(name: str) -> None:
    """independent: differences of the spline, and the distance itself on points of the region, to a fifth of it."""
    region = NearSurface(read(SURFACES[name]), 3.0, side=1 if name == "notched" else 0)
    points = region.sample(np.random.default_rng(4), 40, 0.6)
    slopes = region.level.jacobian()
    for point, exact in zip(points, region.exact_level(points), strict=True):
        assert abs(float(region.level(point)) - exact) < 0.2 * region.scale
        steps = [(float(region.level(point + h)) - float(region.level(point - h))) / 2e-4 for h in 1e-4 * np.eye(3)]
        np.testing.assert_allclose(slopes(point, 0.0).full().ravel(), steps, rtol=1e-5, atol=1e-6)


def data_near(content: bytes, /, **surface: Any) -> dict[str, Any]:
    """The demo with its beads near a surface."""
    section = {name: each for name, each in DEMO["optimise"].items() if name != "box"}
    there = {"content": base64.b64encode(content).decode(), "distance_mm": 3.0, **surface}
    near = {name: each for name, each in there.items() if each is not None}
    return DEMO | {"optimise": section | {"region": {"surface": near}}}


def test_a_file_beside_the_design_and_its_content_are_one_design(tmp_path: Path) -> None:
    """closed_form: the same hash, whatever stands for the file's bytes; written out, the design stands alone, and as
    its author wrote it, it names the file."""
    (tmp_path / "part.stl").write_bytes(binary(box()))
    named = load_design(data_near(b"", content=None, file="part.stl"), base_directory=tmp_path)
    plain, packed = binary(box()), gzip.compress(binary(box()), 1)
    hashes = {load_design(data_near(each)).sha256 for each in (plain, packed)}
    assert hashes == {named.sha256, load_design(design_to_data(named)).sha256}
    assert named.sha256 != load_design(data_near(binary(notched()))).sha256
    assert named.files == ["part.stl"]
    assert design_to_data(named, inline=False) == data_near(b"", content=None, file="part.stl")
    with pytest.raises(DesignError, match=r"files are not read here.*into content"):
        load_design(data_near(b"", content=None, file="part.stl"), base_directory=tmp_path, allow_files=False)


def test_a_new_design_beside_the_old_one_names_the_surface_too(tmp_path: Path) -> None:
    """closed_form: the author's text with other positions; elsewhere it holds the surface; both are the same design."""
    (tmp_path / "part.stl").write_bytes(binary(box()))
    (tmp_path / "elsewhere").mkdir()
    old = tmp_path / "old.yaml"
    old.write_text("# mine\n" + data_to_yaml(data_near(b"", content=None, file="part.stl")), encoding="utf-8")
    design = load_design(old)
    moved = revise_design(design, Revision(fiducials_mm=np.array(design.fiducials.positions_mm) + 0.5))
    result: Any = SimpleNamespace(design=design_to_data(moved))
    for folder, holds in ((tmp_path, False), (tmp_path / "elsewhere", True)):
        path = folder / "new.yaml"
        written, _ = design_text(design, result, OutputFiles(path, None))
        path.write_text(written, encoding="utf-8")
        assert (written.startswith("# mine"), "content" in written) == (True, holds)
        assert load_design(path).sha256 == moved.sha256
    assert "content" not in patch_text(design, result)
    assert "H4s" not in design_listing(result.design, "").text


def test_units_and_a_transform_put_a_surface_into_con() -> None:
    """closed_form: the box in inches, turned and shifted, and put back, has its corners where they were."""
    turn, shift = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix(), np.array([5.0, -60.0, 7.0])
    there = (box() - shift) @ turn / 25.4
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, shift
    design = load_design(data_near(binary(there), unit="in", T_con_file=matrix.tolist()))
    lines = np.concatenate(surface_lines(design.document.optimise.region.surface))
    np.testing.assert_allclose([lines.min(axis=0), lines.max(axis=0)], [BOX_LOW, BOX_HIGH], atol=0.2)
    np.testing.assert_allclose(np.abs(lines[:, :2]).max(axis=1), 45.0, atol=1e-4)


NAN = box()
NAN[3, 1, 2] = np.nan
RUBBISH = {
    "empty": (b"  \n", "empty-document"),
    "no triangle": (binary(np.zeros((0, 3, 3))), "empty-document"),
    "no area": (binary(np.repeat(box()[:, :1], 3, axis=1)), "empty-surface"),
    "not a number": (binary(NAN), "out-of-range"),
    "cut": (binary(box())[:-10], "stl-length"),
    "no STL": (b"\x89PNG\r\n\x1a\n" + bytes(200), "stl-length"),
    "text cut": (text(box())[:400], "stl-syntax"),
    "a comma": (text(box()).replace(b"45.0", b"45,0"), "wrong-type"),
    "too many": (b"part".ljust(80) + (MOST_TRIANGLES + 1).to_bytes(4, "little") + bytes(50), "too-many"),
}


@pytest.mark.parametrize("name", RUBBISH)
def test_rubbish_is_refused_with_what_to_do(name: str) -> None:
    content, code = RUBBISH[name]
    with pytest.raises((DesignError, LimitError)) as caught:
        read_surface(content, "part.stl")
    (problem,) = caught.value.problems
    assert (problem.code, problem.file) == (code, "part.stl")
    assert problem.hint
    (placed,) = problems_of(load_design, data_near(content)) if content.strip() else [problem]
    assert placed.code == code


@pytest.mark.parametrize(
    ("changes", "code", "at"),
    [
        ({"side": "inside"}, "not-closed", "side"),
        ({"at_least_mm": 4.0}, "empty-region", "at_least_mm"),
        ({"content": "not base64 at all!"}, "not-base64", "content"),
        ({"content": base64.b64encode(gzip.compress(binary(shell()))[:-9]).decode()}, "not-gzip", "content"),
        ({"content": base64.b64encode(gzip.compress(bytes(9_000_000))).decode()}, "too-large", "content"),
        ({"content": None}, "missing-field", "file"),
        ({"T_con_file": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "not-rigid", "T_con_file"),
    ],
)
def test_what_a_surface_cannot_be_is_refused_where_it_stands(changes: dict[str, Any], code: str, at: str) -> None:
    (problem,) = problems_of(load_design, data_near(binary(shell()), **changes))
    assert (problem.code, problem.pointer) == (code, f"/optimise/region/surface/{at}")
    assert problem.hint


def test_triangles_that_disagree_have_no_inside() -> None:
    """closed_form: one triangle of a box turned round."""
    turned = box()
    turned[0] = turned[0, ::-1]
    assert "do not agree on the outside" in read_surface(binary(turned), "part.stl").not_closed


@pytest.mark.hostile
def test_damaged_files_are_read_or_refused(run_seed: int) -> None:
    """random: 2000 damaged files, binary and text: none is an accident."""
    draw, seen = random.Random(run_seed), Counter[str]()
    whole = [form(SURFACES[name]) for form in (binary, text) for name in ("notched", "stone")]
    words = [b"nan", b"inf", b"1e400", b"-0", b"solid", b"endsolid", b"vertex", b"\x00", b"\xff\xff\xff\xff", b"1,5"]
    for _ in range(2000):
        content = damaged(draw.choice(whole), draw, words)
        try:
            mesh = read_surface(content, "part.stl").mesh
        except TailstackError as error:
            seen[error.problems[0].code] += 1
            continue
        seen["read"] += 1
        assert np.isfinite(mesh.nearest(np.array([[1.0, 2.0, 3.0]])).distance_mm).all()
    assert min(seen["read"], seen["stl-syntax"], seen["stl-length"]) >= 10, seen


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "surface"),
    [
        ("shell", {"distance_mm": 3.0}),
        ("box", {"distance_mm": 4.0, "at_least_mm": 1.5, "side": "inside"}),
        ("notched", {"distance_mm": 2.0, "side": "outside"}),
    ],
)
def test_an_optimum_keeps_its_beads_near_the_surface(name: str, surface: dict[str, Any]) -> None:
    """independent: enumeration to 1 um, solid angles; and it costs no more than beads that stay as they are drawn."""
    from tailstack import optimise

    data = data_near(binary(SURFACES[name]), **surface)
    data["optimise"] |= {"starts": 2}
    found = optimise(load_design(data))
    at = np.array(load_design(found.design).fiducials.positions_mm)
    triangles = np.asarray(read(SURFACES[name]).places_mm)
    away = distance_by_parts(at, triangles)
    assert (away <= surface["distance_mm"] + 1e-3).all()
    assert (away >= surface.get("at_least_mm", 0.0) - 1e-3).all()
    if (side := surface.get("side")) is not None:
        np.testing.assert_array_equal(is_inside(at, triangles)[away > 1e-3], side == "inside")
    ends = np.array([surface["distance_mm"], surface.get("at_least_mm", 0.0)])
    assert (np.abs(away[:, None] - ends) < 0.01).any(axis=1).sum() >= 4, "room is used"
