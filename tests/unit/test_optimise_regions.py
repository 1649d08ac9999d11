"""Regions, keep-out zones and isometries against brute force and closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from tailstack.geometry.arrays import Array
from tailstack.optimisation import regions
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, Isometry, KeepOut, Solid
from tailstack.optimisation.symbols import elements

TILTED = np.array([2.0, -1.0, 2.0]) / 3
BASE_MM = np.array([5.0, -10.0, -40.0])
TOWARDS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5)  # across the axis
SHAPES: dict[str, Solid] = {
    "box": BoxRegion(np.array([-50.0, -20.0, -90.0]), np.array([50.0, 40.0, 10.0])),
    "flat box": BoxRegion(np.array([-50.0, 7.0, -90.0]), np.array([50.0, 7.0, 10.0])),
    "cylinder": Cylinder(BASE_MM, TILTED, 60.0, 30.0),
    "tube": Cylinder(BASE_MM, TILTED, 60.0, 30.0, 22.0),
    "lateral surface": Cylinder(BASE_MM, TILTED, 60.0, 30.0, 30.0),
    "disc": Cylinder(BASE_MM, np.array([0.0, 0.0, 1.0]), 0.0, 30.0),
    "slice": Cylinder(BASE_MM, TILTED, 60.0, 30.0, 0.0, TOWARDS, np.radians(50)),
    "clip": Cylinder(BASE_MM, TILTED, 60.0, 30.0, 22.0, TOWARDS, np.radians(140)),
    "ball": Ball(BASE_MM, 30.0),
    "shell": Ball(BASE_MM, 30.0, 22.0),
    "sphere": Ball(BASE_MM, 30.0, 30.0),
}
SOLID = [name for name in SHAPES if name in ("box", "cylinder", "tube", "slice", "clip", "ball", "shell")]
ALL_ROUND = [name for name in SHAPES if name not in ("slice", "clip")]
FIVE_SIGMA = 5.0  # a correct sampler fails a check about once in two million


def brute_inside(shape: Solid, points: Array, grown_mm: float = 0.0) -> Any:
    """(M,) by coordinates, cross products and distances; grown outwards (and into a hollow) by a distance per face."""
    if isinstance(shape, BoxRegion):
        return ((points >= shape.low_mm - grown_mm) & (points <= shape.high_mm + grown_mm)).all(axis=1)
    inside = np.ones(len(points), dtype=bool)
    if isinstance(shape, Ball):
        radius = np.linalg.norm(points - shape.centre_mm, axis=1)
    else:
        from_base = points - shape.base_mm
        radius = np.linalg.norm(np.cross(from_base, shape.axis), axis=1)
        along = from_base @ shape.axis
        inside = (along >= -grown_mm) & (along <= shape.height_mm + grown_mm)
        if shape.towards is not None:
            # in the plane across the axis: past neither side by more than what it is grown by
            middle, turned = from_base @ shape.towards, from_base @ np.cross(TILTED, TOWARDS)
            angle = np.abs(np.arctan2(turned, middle))
            past = np.hypot(middle, turned) * np.sin(np.clip(angle - shape.half_angle, 0, np.pi / 2))
            inside &= past <= grown_mm
    return inside & (radius <= shape.radius_mm + grown_mm) & (radius >= shape.inner_radius_mm - grown_mm)


def around(shape: Solid, count: int, seed: int = 1) -> Array:
    """Random points of a box about the region that is larger than it."""
    low, high = regions.bounding_box(shape)
    return np.random.default_rng(seed).uniform(low - 15, high + 15, (count, 3))


def drawn(shape: Solid, count: int, on_surface: float = 0.0, seed: int = 2) -> Array:
    return regions.sample(shape, np.random.default_rng(seed), count, on_surface)


@pytest.mark.parametrize("name", SHAPES)
def test_membership_is_that_of_the_definition(name: str) -> None:
    """brute force: coordinates, cross products and distances, on points inside and about the region."""
    shape = SHAPES[name]
    points = np.vstack([around(shape, 4000), drawn(shape, 500, 0.5)])
    expected = brute_inside(shape, points, 1e-6)
    assert (regions.contains(shape, points) == expected).all()
    assert expected[4000:].all()
    assert not expected.all()


@pytest.mark.parametrize("name", SHAPES)
def test_clipping_gives_the_nearest_point(name: str) -> None:
    """brute force: it is in the region, and none of 40 000 points of the region is nearer."""
    shape = SHAPES[name]
    points = around(shape, 40)
    clipped = regions.clip(shape, points)
    assert brute_inside(shape, clipped, 1e-9).all()
    apart = np.linalg.norm(clipped - points, axis=1)
    cloud = drawn(shape, 40_000, 0.5)
    nearest = np.array([np.linalg.norm(cloud - point, axis=1).min() for point in points])
    assert (apart <= nearest + 1e-9).all()
    assert (apart >= nearest - 6.0).all()  # the cloud is that dense
    inside = drawn(shape, 50)
    np.testing.assert_allclose(regions.clip(shape, inside), inside, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "origin"), [("tube", BASE_MM), ("shell", BASE_MM), ("sphere", BASE_MM)])
def test_what_has_no_direction_is_still_pushed_out(name: str, origin: Array) -> None:
    """closed form: from the axis or the centre every point at the inner radius is nearest."""
    shape = SHAPES[name]
    clipped = regions.clip(shape, np.array([origin, origin]))
    assert isinstance(shape, Cylinder | Ball)
    np.testing.assert_allclose(np.linalg.norm(clipped - origin, axis=1), shape.inner_radius_mm, rtol=1e-12)
    np.testing.assert_array_equal(clipped[0], clipped[1])


@pytest.mark.parametrize("name", ALL_ROUND)
def test_bounds_and_diameter_are_reached_and_never_exceeded(name: str) -> None:
    """sampled: extremes of 20 000 points, three quarters of them moved outwards, lie just inside (seeded)."""
    shape = SHAPES[name]
    cloud = drawn(shape, 20_000, 0.75)
    low, high = regions.bounding_box(shape)
    assert (cloud >= low - 1e-9).all()
    assert (cloud <= high + 1e-9).all()
    np.testing.assert_allclose([cloud.min(axis=0), cloud.max(axis=0)], [low, high], atol=1.0)
    rim = cloud[np.argsort(np.linalg.norm(cloud - (low + high) / 2, axis=1))[-600:]]
    longest = max(float(np.linalg.norm(rim - point, axis=1).max()) for point in rim)
    assert regions.diameter_mm(shape) - 2.0 < longest <= regions.diameter_mm(shape) + 1e-9


@pytest.mark.parametrize("name", SOLID)
def test_samples_are_uniform_in_volume(name: str) -> None:
    """sampled: share of 100 000 samples in ten random balls against that of rejection from the bounding box."""
    shape = SHAPES[name]
    samples = drawn(shape, 100_000)
    points = around(shape, 400_000, seed=5)
    points = points[brute_inside(shape, points)]
    for centre in drawn(shape, 10, seed=6):
        ours = (np.linalg.norm(samples - centre, axis=1) < 15).mean()
        theirs = (np.linalg.norm(points - centre, axis=1) < 15).mean()
        spread = np.sqrt(theirs * (1 - theirs) * (1 / len(samples) + 1 / len(points)))
        assert abs(ours - theirs) <= FIVE_SIGMA * spread


@pytest.mark.parametrize(("name", "freedoms"), [("box", 3), ("cylinder", 2), ("tube", 2), ("ball", 1), ("shell", 1)])
def test_samples_go_to_the_surface_as_often_as_asked(name: str, freedoms: int) -> None:
    """sampled: a point stays strictly inside with probability 0.4 per coordinate that may go outwards; five sigma."""
    shape = SHAPES[name]
    samples = drawn(shape, 50_000, 0.6)
    filled = shape if isinstance(shape, BoxRegion) else replace(shape, inner_radius_mm=0.0)
    inner = brute_inside(filled, samples, -1e-7).mean()
    chance = 0.4**freedoms
    assert abs(inner - chance) <= FIVE_SIGMA * np.sqrt(chance * (1 - chance) / 5e4)


@pytest.mark.parametrize("name", SHAPES)
def test_rows_hold_exactly_inside(name: str) -> None:
    """brute force: all rows at least 0 is membership; equalities vanish on samples; no row is large nearby."""
    shape = SHAPES[name]
    points = np.vstack([around(shape, 2000), drawn(shape, 500, 0.5)])
    rows = regions.inside_rows(shape, points.T)
    met = np.ones(len(points), dtype=bool)
    for _, value, equal in rows:
        met &= (np.abs(value) <= 1e-9) if equal else (value >= -1e-9)
        assert np.abs(value[2000:]).max() <= 1 + 1e-9
    assert (met == brute_inside(shape, points, 1e-7)).all()
    assert len({text for text, _, _ in rows}) == len(rows)
    assert sum(equal for _, _, equal in rows) == (name in ("flat box", "lateral surface", "disc", "sphere"))


@pytest.mark.parametrize("name", SHAPES)
def test_symbols_take_the_same_values_as_floats(name: str) -> None:
    """independent: CasADi evaluates what it was handed, and its slopes are finite."""
    shape = SHAPES[name]
    symbol = ca.SX.sym("x", 3)

    def every(at: Any) -> tuple[list[Any], list[Any]]:
        held = [value for _, value, _ in regions.inside_rows(shape, at)]
        clear = [value for _, value in regions.outside_pieces(KeepOut("zone", shape, 2.0), at)]
        return held, [*held, *clear, *regions.move(regions.turns(BASE_MM, TILTED, 3)[0], at)]

    held, values = every(elements(symbol))
    function = ca.Function("f", [symbol], [ca.vertcat(*values), ca.jacobian(ca.vertcat(*held), symbol)])
    for point in around(shape, 5):
        values, slopes = function(point)
        np.testing.assert_allclose(values.full().ravel(), every(point)[1], rtol=1e-12, atol=1e-12)
        assert np.isfinite(slopes.full()).all()


@pytest.mark.parametrize("clearance_mm", [0.0, 4.0])
@pytest.mark.parametrize("name", ALL_ROUND)
def test_a_point_is_clear_of_a_zone_when_it_is_outside_the_grown_zone(name: str, clearance_mm: float) -> None:
    """brute force: every face moved out; then no clear point is nearer to any of 20 000 points of the zone, and none
    is refused further away than at a corner."""
    shape = SHAPES[name]
    zone = KeepOut("zone", shape, clearance_mm)
    points = np.vstack([around(shape, 2000), drawn(shape, 200)])
    clear = regions.clear_of(zone, points)
    strictly_inside = brute_inside(shape, points, clearance_mm - 1e-6)
    if isinstance(shape, Cylinder | Ball) and shape.inner_radius_mm == shape.radius_mm and clearance_mm == 0:
        strictly_inside[:] = False  # a surface without clearance takes no room
    assert (clear == ~strictly_inside).all()
    cloud = drawn(shape, 20_000, 0.5)
    nearest, _ = cKDTree(cloud).query(points[:400])
    assert (nearest[clear[:400]] >= clearance_mm - 1e-9).all()
    assert clear[:400][nearest > np.sqrt(3) * clearance_mm + 8.0].all()


def test_a_hollow_keeps_the_clearance_too() -> None:
    """closed form: inside a tube of inner radius 22 with 4 mm to be kept, 18 mm from the axis is clear and 18.1 not."""
    zone = KeepOut("tube", SHAPES["tube"], 4.0)
    across = np.cross(TILTED, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(TILTED, [0.0, 0.0, 1.0]))
    points = BASE_MM + 30 * TILTED + np.array([[18.0 - 1e-9], [18.1]]) * across
    assert regions.clear_of(zone, points).tolist() == [True, False]
    wide = KeepOut("tube", SHAPES["tube"], 22.0)
    assert len(regions.outside_pieces(wide, points[0])) == 3


def test_the_clearest_piece_is_the_face_that_a_point_is_beyond() -> None:
    """closed form: 30 mm beyond each face of a box, and beyond each end and the side of a cylinder."""
    box = SHAPES["box"]
    assert isinstance(box, BoxRegion)
    middle = (box.low_mm + box.high_mm) / 2
    beyond = np.array([middle] * 6)
    for k in range(3):
        beyond[2 * k, k] = box.low_mm[k] - 30
        beyond[2 * k + 1, k] = box.high_mm[k] + 30
    zone = KeepOut("box", box, 2.0)
    assert regions.clearest_piece(zone, beyond).tolist() == [0, 1, 2, 3, 4, 5]
    names = [text for text, _ in regions.outside_pieces(zone, middle)]
    assert [names[0], names[5]] == ["lower x face", "upper z face"]
    along = BASE_MM + np.array([[-30.0], [90.0]]) * TILTED
    side = BASE_MM + 30 * TILTED + 60 * np.cross(TILTED, [0.0, 0.0, 1.0])
    found = regions.clearest_piece(KeepOut("cylinder", SHAPES["cylinder"], 0.0), np.vstack([along, side]))
    names = [text for text, _ in regions.outside_pieces(KeepOut("cylinder", SHAPES["cylinder"], 0.0), side)]
    assert [names[k] for k in found] == ["base", "top", "side"]


def _keeps_distances(isometry: Isometry) -> None:
    points = np.random.default_rng(8).normal(size=(6, 3)) * 50
    after = regions.move(isometry, points)
    np.testing.assert_allclose(pdist(after), pdist(points), rtol=1e-12)


def test_a_mirror_reverses_its_normal_and_keeps_its_plane() -> None:
    """closed form: the plane stays, a point d off it goes to d on the other side, twice is nothing."""
    (isometry,) = regions.mirror(BASE_MM, 7 * TILTED)
    _keeps_distances(isometry)
    across = np.cross(TILTED, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(regions.move(isometry, BASE_MM + across), BASE_MM + across, atol=1e-12)
    there = BASE_MM + across + 12 * TILTED
    np.testing.assert_allclose(regions.move(isometry, there), BASE_MM + across - 12 * TILTED, atol=1e-12)
    np.testing.assert_allclose(regions.move(isometry, regions.move(isometry, there)), there, atol=1e-12)


@pytest.mark.parametrize("order", [2, 3, 4, 7])
def test_turns_are_the_roots_of_unity(order: int) -> None:
    """closed form: about z they multiply x + iy by exp(2 pi i k / n); about any line they keep it and come round."""
    points = np.random.default_rng(9).normal(size=(5, 3)) * 40
    about_z = regions.turns(np.array([3.0, -2.0, 11.0]), np.array([0.0, 0.0, 2.0]), order)
    assert len(about_z) == order - 1
    centred = points[:, 0] - 3 + 1j * (points[:, 1] + 2)
    for k, isometry in enumerate(about_z, start=1):
        after = regions.move(isometry, points)
        expected = centred * np.exp(2j * np.pi * k / order) + 3 - 2j
        np.testing.assert_allclose(after[:, 0] + 1j * after[:, 1], expected, atol=1e-11)
        np.testing.assert_allclose(after[:, 2], points[:, 2], atol=1e-12)
    first = regions.turns(BASE_MM, TILTED, order)[0]
    _keeps_distances(first)
    np.testing.assert_allclose(regions.move(first, BASE_MM + 9 * TILTED), BASE_MM + 9 * TILTED, atol=1e-12)
    after = points
    for _ in range(order):
        after = regions.move(first, after)
    np.testing.assert_allclose(after, points, atol=1e-11)


def test_corners_of_a_box_and_regions_of_equal_numbers() -> None:
    """closed form: every choice of low or high, once."""
    corners = {tuple(corner) for corner in regions.corners(np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]]))}
    assert corners == {(x, y, z) for x in (0.0, 10.0) for y in (1.0, 11.0) for z in (2.0, 12.0)}
    # closed form: four regions, of which the first and the third are equal.
    box = BoxRegion(np.zeros(3), np.ones(3))
    shapes: list[Solid] = [box, Ball(np.zeros(3), 1.0), BoxRegion(np.zeros(3), np.ones(3)), Ball(np.zeros(3), 1.0, 0.5)]
    found, which = regions.distinct(shapes)
    assert which == (0, 1, 0, 2)
    assert [type(shape) for shape in found] == [BoxRegion, Ball, Ball]
