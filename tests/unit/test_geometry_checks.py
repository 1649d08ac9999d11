"""Degenerate geometry, refused by name with the direction that is missing; what a pose may be estimated from where DLT
may not; and views that see some of the fiducials."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plain_data import DEMO, REMOVED, problems_of, replaced
from scenes import cube_fiducials, mount, random_rigid, system_of, taken, target, with_balls, with_noise
from tailstack import score
from tailstack.design import check_design, load_design
from tailstack.errors import DesignError, IllPosedError
from tailstack.estimation.checks import (
    check_geometry,
    check_views,
    closest_two,
    examine,
    imaged_fiducials,
)
from tailstack.estimation.least_squares import resect_pose
from tailstack.estimation.resection import project
from tailstack.geometry.camera import camera_centre
from tailstack.system import Estimator, Reading, System, Triangulation

CUBE = cube_fiducials()


def refused(system):
    problem = problems_of(check_geometry, system, error=IllPosedError)[0]
    assert problem.hint  # what would cure it
    return problem


def rules(system):
    return {finding.rule for finding in check_geometry(system)}


def in_plane(count, normal, seed=1, size=50.0):
    points = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    return points - np.outer(points @ normal, normal)


def test_a_good_layout_has_no_findings_and_a_flat_one_its_thickness():
    assert check_geometry(system_of(CUBE)) == ()
    points = CUBE.copy()
    points[:, 2] = np.where(points[:, 2] > -40, 2.5, -2.5)
    (finding,) = check_geometry(system_of(points))
    assert (finding.rule, finding.severity, finding.value) == ("flat-structure", "warning", pytest.approx(5.0))
    bias = mount("structure_connector", bias=(0, 0, 0, 0, 0, -30.0))
    system = system_of(CUBE, structure_connector=bias)
    np.testing.assert_allclose(imaged_fiducials(system), CUBE + np.array([0, 0, -30]))
    assert refused(system).code == "outside-view"
    assert check_geometry(replace(system, reading=Reading.EQ18)) == ()


@pytest.mark.parametrize(
    ("points", "code", "words"),
    [
        (CUBE[:5], "too-few-fiducials", ""),
        (CUBE[[0, 1, 2, 3, 4, 5, 2, 7]], "duplicate-fiducials", "F3 and F7"),
        (np.outer(np.linspace(-40, 40, 8), [0.6, 0.0, 0.8]), "collinear-fiducials", "(0.600, 0.000, 0.800)"),
        (in_plane(9, np.array([0, 0, 1])), "coplanar-fiducials", "normal z"),
        (in_plane(9, np.array([1, 0, 0])), "coplanar-fiducials", "normal x"),
        (in_plane(9, np.array([0.6, 0.8, 0])), "coplanar-fiducials", "(0.600, 0.800, 0.000)"),
    ],
)
def test_what_determines_no_projection_is_named_with_the_direction_that_is_missing(points, code, words):
    problem = refused(system_of(points))
    assert problem.code == code
    assert words in problem.detail


@pytest.mark.parametrize("size", [20.0, 80.0])
def test_a_plane_is_one_by_its_thickness_over_its_length(size):
    """independent: the ratio of the extents, by the eigenvalues of the second moments; 1e-5 is a plane, in any size."""
    for ratio, planar in ((0.8e-5, True), (1.25e-5, False)):
        points = in_plane(9, np.array([0.0, 0.0, 1.0]), size=size)
        moments = np.linalg.eigvalsh(np.cov(points[:, :2].T))
        off = np.array([1.0, -1, 0, 1, -1, 0, 1, -1, 0])
        points[:, 2] = ratio * np.sqrt(moments[-1] / np.var(off, ddof=1)) * off
        if planar:
            assert refused(system_of(points)).code == "coplanar-fiducials"
        else:
            assert "flat-structure" in rules(system_of(points))


def test_all_but_one_in_a_plane():
    """closed_form: with n . X = 0 for all but X_o, P + x_o n' images every fiducial alike; C slides towards X_o."""
    normal = np.array([0.0, 0.6, 0.8])
    points = in_plane(9, normal)
    points[4] += 30 * normal
    system = system_of(points)
    problem = refused(system)
    assert problem.code == "singular-resection"
    assert "all fiducials but F5" in problem.detail
    assert "(0.000, 0.600, 0.800)" in problem.detail
    ray = points[4] - camera_centre(system.views[0].projection)
    ray = ray / np.linalg.norm(ray)
    named = problem.detail.split("slide along (")[1].split(")")[0]
    np.testing.assert_allclose(np.abs([float(v) for v in named.split(",")]), np.abs(ray), atol=6e-4)


def test_a_twisted_cubic_through_the_source():
    """published: Hartley and Zisserman, Multiple View Geometry, section 7.1: points and centre on one twisted cubic."""
    source = np.array([0.0, -700.0, 0.0])
    first, second = np.array([100.0, 350.0, 60.0]), np.array([60.0, -250.0, 140.0])
    third = second - first - source  # so that the curve s -> first s + second s^2 + third s^3 meets the source at -1
    s = np.linspace(-0.25, 0.25, 9)[:, None]
    system = system_of(first * s + second * s**2 + third * s**3)
    np.testing.assert_allclose(camera_centre(system.views[0].projection), source, atol=1e-9)
    problem = refused(system)
    assert problem.code == "singular-resection"
    assert "twisted cubic" in problem.detail


def test_behind_the_source_and_outside_the_image():
    problem = refused(system_of(CUBE, targets=(target((0, -800, 0), "tip"),)))
    assert problem.code == "behind-source"
    assert "target tip" in problem.detail
    assert "100 mm" in problem.detail
    problem = refused(system_of(CUBE, targets=(target((0, 0, 150), "tip"),)))
    # closed_form: v = 767.5 - 5257.73 * 150 / 700 = -359.2, margin from the edge at -0.5
    assert (problem.code, problem.pointer) == ("outside-view", "/views/0")
    assert "(768, -359)" in problem.detail
    shifted = CUBE + np.array([0, 0, -60])
    assert "fiducial F1" in refused(system_of(shifted)).detail


@pytest.mark.parametrize(
    ("azimuths", "where", "code", "along"),
    [
        ((0.0, 0.0), (0, 0, 0), "same-source", "along y"),
        ((0.0, np.pi), (0, 0, 0), "target-on-baseline", "along y"),
        ((np.pi / 2, -np.pi / 2, np.pi / 2), (10, 0, 0), "target-on-baseline", "along x"),
        ((0.0, 0.1), (0, 9e6, 0), "target-too-far", "along y"),
    ],
)
def test_no_parallax(azimuths, where, code, along):
    views = tuple(replace(view, image_size_px=None) for view in with_noise(0.5, azimuths_rad=azimuths))
    problem = refused(system_of(cube_fiducials(20.0), views=views, targets=(target(where),)))
    assert problem.code == code
    assert along in problem.detail


def test_parallax_is_the_widest_of_all_pairs():
    """closed form: three level views of a target near the origin, 5 and 20 degrees from the first: 20 degrees."""
    azimuths = tuple(np.radians([0.0, 5.0, 20.0]))
    system = system_of(CUBE, views=with_noise(0.5, azimuths_rad=azimuths), targets=(target((0, 0, 1e-6)),))
    findings, views = examine(system)
    (finding,) = (f for f in findings if f.rule == "small-parallax")
    assert finding.value == pytest.approx(20.0, abs=1e-6)
    assert findings == check_geometry(system)
    assert views == check_views(system)


def test_small_parallax_and_overlap_and_unknown_size_are_remarked():
    assert rules(system_of(CUBE, views=with_noise(0.5, azimuths_rad=(0.0, 0.3)))) == {"small-parallax"}
    points = CUBE.copy()
    points[7] = [50.0, 50.3, -85.0]
    points[5] = [50.0 * 650 / 750.3, -50.0, -85.0 * 650 / 750.3]  # on the ray of F8 in the first view
    findings = check_geometry(system_of(points))
    assert [finding.rule for finding in findings] == ["projected-overlap"]
    assert "F6 and F8" in findings[0].message
    views = tuple(replace(view, image_size_px=None) for view in with_noise(0.5))
    system = system_of(CUBE + np.array([0, 0, -15]), views=views)  # outside, if the size were known
    assert rules(system) == {"field-of-view-not-checked"}
    assert [(check.checked, check.smallest_margin_px, check.outside) for check in check_views(system)] == [
        (False, None, ()),
        (False, None, ()),
    ]


def test_view_checks_of_the_cube():
    """closed_form: AP depths 650 and 750; the near corner (50, -50, -90) is imaged at 767.5 +- f * (50, 90) / 650."""
    check = check_views(system_of(CUBE))[0]
    focal = 1020 / 0.194
    assert check.depth_range_mm == pytest.approx((650, 750))
    assert check.smallest_margin_px == pytest.approx(1535.5 - (767.5 + focal * 90 / 650))
    pairs = [np.hypot(*(focal * (np.array([x, z]) * (1 / 650 - 1 / 750)))) for x, z in ((50, 10), (50, 90))]
    assert check.closest_pair_px == pytest.approx(min(pairs))
    assert check.outside == ()
    far = check_views(system_of(CUBE + np.array([0, 0, -15])))[0]
    assert far.outside == ("F1", "F5")  # low and near: f 105 / 650 = 849 > 768, but f 105 / 750 = 736


@settings(deadline=None)
@given(st.lists(st.tuples(*[st.integers(-1000, 1000)] * 2), min_size=2, max_size=30, unique=True))
def test_closest_pair_is_the_brute_force_one(points):
    array = np.array(points, dtype=float)
    distances = [np.linalg.norm(a - b) for i, a in enumerate(array) for b in array[:i]]
    first, second, distance = closest_two(array)
    assert first < second
    assert distance == pytest.approx(min(distances))
    assert np.linalg.norm(array[first] - array[second]) == distance


def test_fewer_than_two_points_are_not_close_and_points_of_no_size_keep_ten_pixels():
    assert closest_two(np.zeros((1, 3))) == (0, 0, np.inf)
    assert closest_two(np.array([[0.0, 0], [np.nan, 0], [3, 4]])) == (0, 2, 5.0)
    assert {check.closest_pair_needs_px for check in check_views(system_of(CUBE))} == {10.0}


@settings(deadline=None)  # the first call may compile
@given(st.integers(0, 10_000))
def test_verdicts_do_not_depend_on_where_the_frame_lies(seed):
    motion = random_rigid(np.random.default_rng(seed), 300.0)
    rotation, shift, inverse = motion[:3, :3], motion[:3, 3], np.linalg.inv(motion)
    for points, expected in ((CUBE, None), (in_plane(8, np.array([0.0, 0.6, 0.8])), "coplanar-fiducials")):
        system = system_of(
            points @ rotation.T + shift,
            views=tuple(replace(view, projection=view.projection @ inverse) for view in with_noise(0.5)),
            targets=(target(rotation @ [0, 0, 70] + shift),),
        )
        if expected is None:
            assert check_geometry(system) == ()
        else:
            assert refused(system).code == expected


def outline(projection, centre, radius, count=720):
    """(count, 2) px: a ball's outline, by the circle in which the cone from the source touches it."""
    source = camera_centre(projection)
    axis = centre - source
    distance = np.linalg.norm(axis)
    axis = axis / distance
    across = np.linalg.svd(axis[None])[2][1:]
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    middle = centre - axis * radius**2 / distance
    size = radius * np.sqrt(1 - (radius / distance) ** 2)
    rim = middle + size * (np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1])
    image = np.column_stack([rim, np.ones(count)]) @ projection.T
    return image[:, :2] / image[:, 2:]


@pytest.mark.parametrize("diameter", [2.0, 6.0, 12.0])
def test_images_of_balls_need_their_size_and_some_background(diameter):
    """independent: outlines of both balls by the cones that touch them, along the line between their centres; what is
    needed beside them is 3 px, to 2 % of the shadows."""
    points = CUBE.copy()
    points[7] = [30.0, 50.0, -40.0]  # behind F6, which is nearer to the source of the first view
    points[5] = [24.0, -50.0, -30.0]
    system = with_balls(system_of(points), diameter / 2)
    check = check_views(system)[0]
    assert check.closest_pair == ("F6", "F8")
    view = system.views[0].projection
    one, other = (outline(view, point, diameter / 2) for point in (points[5], points[7]))
    centres = np.column_stack([points[[5, 7]], np.ones(2)]) @ view.T
    centres = centres[:, :2] / centres[:, 2:]
    along = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    shadows = (one @ along - centres[0] @ along).max() + (centres[1] @ along - other @ along).max()
    assert check.closest_pair_needs_px == pytest.approx(shadows + 3.0, abs=0.02 * shadows)
    merged = check.closest_pair_px < check.closest_pair_needs_px
    found = [each for each in check_geometry(system) if each.rule == "projected-overlap"]
    assert bool(found) == merged
    if merged:
        assert "are needed by their size" in found[0].message
        assert (found[0].value, found[0].limit) == (check.closest_pair_px, check.closest_pair_needs_px)


def test_of_balls_the_pair_is_named_that_is_nearest_to_merging():
    """closed form: two pairs as far apart in the image; the one nearer to the source has the wider shadows."""
    points = CUBE.copy()
    near, far = points[5, 1] + 700, points[7, 1] + 700  # depths in the first view
    points[5], points[4] = [near * 0.04, -50, -20], [near * 0.04 + near * 0.01, -50, -20]
    points[6], points[7] = [far * 0.04, 50, 10], [far * 0.04 + far * 0.0099, 50, 10]
    plain, sized = system_of(points), with_balls(system_of(points), 6.0)
    assert check_views(plain)[0].closest_pair == ("F7", "F8")
    assert check_views(sized)[0].closest_pair == ("F5", "F6")


def plate(half_mm: float, azimuth: float = 0.0) -> System:
    """Nine fiducials in a plane with normal y, seen from both sides of it at this azimuth, and across at another."""
    side = (-half_mm, 0.0, half_mm)
    fiducials = np.array([(x, 0.0, z - 40.0) for x in side for z in side])
    views = with_noise(0.5, azimuths_rad=(azimuth, azimuth + 1.0))
    return system_of(fiducials, views=views, estimator=Estimator.POSE)


def test_four_fiducials_are_enough_for_a_pose_and_three_are_not():
    system = system_of(cube_fiducials(50)[[0, 3, 5, 6]], views=with_noise(0.5), estimator=Estimator.POSE)
    assert np.isfinite(score(system).targets[0].p95_mm)
    five = cube_fiducials(50)[[0, 1, 3, 5, 6]]
    (losses,) = score(system_of(five, views=with_noise(0.5), estimator=Estimator.POSE)).losses
    assert losses.single.value is not None  # one may be lost, two may not
    assert "needs 4" in losses.double.reason
    few = refused(taken(system, [3]))
    assert (few.code, few.pointer) == ("too-few-fiducials", "/fiducials")
    assert "at least 4" in few.hint
    assert refused(replace(system, estimator=Estimator.REPROJECTION)).code == "too-few-fiducials"


def test_a_plane_seen_obliquely_is_enough_for_a_pose():
    system = plate(40, 0.5)
    assert not check_geometry(system)
    flat = refused(replace(system, estimator=Estimator.DLT))
    assert flat.code == "coplanar-fiducials"
    assert "model.estimator: pose takes a flat structure" in flat.hint


@pytest.mark.parametrize("azimuth", [0.0, 0.1, 0.2])
def test_a_small_plane_seen_head_on_is_refused_with_the_two_poses(azimuth):
    """independent: noisy images of the true pose are explained as well by one that is found from the other side."""
    system = plate(10, azimuth)
    said = refused(system)
    assert said.code == "ambiguous-pose"
    assert "view0" in said.detail
    assert "with the normal along y and along (" in said.detail
    view, points = system.views[0], system.fiducials_mm
    text = said.detail.split("along y and along (")[1].split(")")[0]
    rival = np.array([float(part) for part in text.split(",")])
    rng = np.random.default_rng(3)
    images = project(view.projection, points) + 0.5 * rng.normal(size=(400, 9, 2))
    axis = np.cross([0.0, 1.0, 0.0], rival)
    sine = float(np.linalg.norm(axis))
    turned = Rotation.from_rotvec(np.arcsin(min(sine, 1.0)) * axis / sine).as_matrix()
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turned, points.mean(axis=0) - turned @ points.mean(axis=0)
    other = resect_pose(points, images, replace(view, projection=view.projection @ motion))
    here = resect_pose(points, images, view)
    squares = [((project(p, points) - images) ** 2).sum(axis=(1, 2)) for p in (here, other)]
    known = np.isfinite(squares[0] + squares[1])
    assert (squares[1][known] < squares[0][known]).mean() > 0.001  # as often as the refused tolerates


def test_weights_need_noise_and_a_score_says_what_is_taken_for_exact():
    views = with_noise(0.0, azimuths_rad=(0.0, 1.5))
    said = refused(system_of(cube_fiducials(50), views=views, triangulation=Triangulation.WEIGHTED))
    assert (said.code, said.pointer) == ("no-noise", "/views/0")
    system = system_of(cube_fiducials(50), views=with_noise(0.5))
    exact = score(replace(system, estimator=Estimator.POSE)).provenance
    assert exact.estimator == "pose"
    assert any("takes for exact (view0, view1)" in line for line in exact.not_included)
    assert not any("for exact" in line for line in score(system).provenance.not_included)


LABELS = [point["label"] for point in DEMO["fiducials"]["points"]]
REST = [label for label in LABELS if label != "F3"]


def seen(*lists):
    """The drill guide with what each of its views sees; None: everything."""
    data = copy.deepcopy(DEMO)
    for view, labels in zip(data["views"], lists, strict=True):
        if labels is not None:
            view["sees"] = labels
    return data


def test_a_fiducial_that_no_view_sees_is_as_good_as_left_out():
    """brute force: the document without it."""
    hidden = score(load_design(seen(REST, REST)))
    without = score(load_design(replaced(DEMO, ("fiducials", "points", LABELS.index("F3")), REMOVED)))
    for one, other in zip(hidden.targets, without.targets, strict=True):
        assert one.p95_mm == pytest.approx(other.p95_mm, rel=1e-9)
    assert hidden.validity.nu == pytest.approx(without.validity.nu, rel=0.05)  # the unit of length is another
    assert hidden.validity.layout_class == without.validity.layout_class
    assert score(load_design(seen(LABELS, LABELS))).targets[0].p95_mm == score(load_design(DEMO)).targets[0].p95_mm


def test_what_one_view_does_not_see_costs_less_and_changes_no_number():
    whole, one, none = (score(load_design(seen(*each))).targets[0].p95_mm for each in
                        ((None, None), (REST, None), (REST, REST)))  # fmt: skip
    assert whole < one < none
    data = seen(LABELS, None)
    data["optimise"]["count"] = {"min": 8, "max": 10}
    assert "count-and-sees" in [problem.code for problem in problems_of(load_design, data, error=DesignError)]


def test_a_fiducial_that_is_not_seen_may_lie_outside_the_image():
    data = copy.deepcopy(DEMO)
    data["fiducials"]["points"].append({"label": "far", "position_mm": [0.0, 400.0, 150.0]})
    with pytest.raises(IllPosedError):
        check_design(load_design(data))
    for view in data["views"]:
        view["sees"] = LABELS
    _, _, views = check_design(load_design(data))
    assert all("far" not in view.outside for view in views)


def test_a_flat_share_of_the_structure_is_refused_where_it_is_listed():
    low = [{"label": f"P{k}", "position_mm": [10.0 * k, (k * k) % 7 * 6.0, -40.0]} for k in range(6)]
    data = seen(None, [point["label"] for point in low])
    data["fiducials"]["points"] += low
    problem = problems_of(check_design, load_design(data), error=IllPosedError)[0]
    assert (problem.pointer, problem.code) == ("/views/1/sees", "coplanar-fiducials")
    assert problem.detail.startswith("view LAT: ")
