"""Projections against the matrices of the oracle file and against the intersection of a ray with the detector."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tailstack.geometry.camera import (
    aim,
    camera_centre,
    depths,
    image_centre_px,
    intrinsic_matrix,
    principal_ray,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)

ORACLES = Path(__file__).parents[1] / "data" / "oracles"
UP = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)


def cios_fusion(beam):
    return projection_from_distances(
        1020.0, 700.0, (0.194, 0.194), image_centre_px((1536, 1536)), ORIGIN, np.array(beam), UP
    )


def test_ap_and_lat_reproduce_the_matrices_of_the_oracle():
    expected = np.array(json.loads((ORACLES / "noise_covariance_cube8.json").read_text())["P"])
    np.testing.assert_allclose(cios_fusion([0.0, 1.0, 0.0]), expected[0], atol=1e-9)
    np.testing.assert_allclose(cios_fusion([-1.0, 0.0, 0.0]), expected[1], atol=1e-9)


def test_sources_and_image_axes_of_ap_and_lat():
    ap, lat = cios_fusion([0.0, 1.0, 0.0]), cios_fusion([-1.0, 0.0, 0.0])
    np.testing.assert_allclose(camera_centre(ap), [0, -700, 0], atol=1e-9)
    np.testing.assert_allclose(camera_centre(lat), [700, 0, 0], atol=1e-9)
    np.testing.assert_allclose(principal_ray(lat), [-1, 0, 0], atol=1e-15)
    pose_ap, pose_lat = aim(ORIGIN, np.array([0.0, 1, 0]), UP), aim(ORIGIN, np.array([-1.0, 0, 0]), UP)
    np.testing.assert_allclose(pose_ap[:2, :3], [[1, 0, 0], [0, 0, -1]], atol=1e-15)
    np.testing.assert_allclose(pose_lat[:2, :3], [[0, 1, 0], [0, 0, -1]], atol=1e-15)


direction = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)


@given(direction, direction, st.tuples(*[st.floats(-80, 80)] * 3).map(np.array))
def test_projection_is_where_the_ray_meets_the_detector(beam, up, point):
    assume(np.linalg.norm(beam) > 0.1 and np.linalg.norm(np.cross(beam, up)) > 0.05)
    isocentre, sdd, sid, pixel = np.array([5.0, -8.0, 12.0]), 1020.0, 530.0, (0.2, 0.3)
    matrix = projection_from_distances(sdd, sid, pixel, (500.0, 400.0), isocentre, beam, up)
    z = beam / np.linalg.norm(beam)
    source = isocentre - sid * z
    # independent: intersect the ray with the detector plane and read off millimetres along its two edges
    ray = point - source
    hit = source + ray * sdd / (ray @ z)
    edge_v = -(up - (up @ z) * z) / np.linalg.norm(up - (up @ z) * z)
    edge_u = np.cross(edge_v, z)
    on_detector = hit - (source + sdd * z)
    expected = [500.0 + on_detector @ edge_u / pixel[0], 400.0 + on_detector @ edge_v / pixel[1]]
    image = matrix @ [*point, 1.0]
    np.testing.assert_allclose(image[:2] / image[2], expected, atol=1e-6)
    np.testing.assert_allclose(depths(matrix, point[None])[0], ray @ z, rtol=1e-10)
    assert abs(np.linalg.norm(matrix[2, :3]) - 1) < 1e-14


def test_scaling_takes_sign_and_size_out_of_a_matrix():
    matrix = cios_fusion([0.0, 1.0, 0.0])
    points = np.random.default_rng(0).uniform(-50, 50, (9, 3))
    points[0] = [0.0, -900.0, 0.0]  # one point behind the source must not flip the others
    np.testing.assert_allclose(scale_to_unit_depth(-3.7 * matrix, points), matrix, rtol=1e-13, atol=1e-9)


def test_skewed_intrinsics():
    k = intrinsic_matrix((4000.0, 4100.0), (600.0, 500.0), 3.0)
    matrix = projection_from_pose(k, aim(np.array([0.0, -500.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP))
    image = matrix @ [10.0, 0.0, -20.0, 1.0]  # camera coordinates (10, 20, 500)
    closed_form = [600 + 4000 * 10 / 500 + 3 * 20 / 500, 500 + 4100 * 20 / 500]
    np.testing.assert_allclose(image[:2] / image[2], closed_form, rtol=1e-14)
