"""Rotations and torsors against mpmath's matrix exponential and finite differences; projections against rays."""

from __future__ import annotations

import json
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tailstack.geometry.camera import (
    aim,
    depths,
    image_centre_px,
    intrinsic_matrix,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)
from tailstack.geometry.rotation import (
    RotationForm,
    displacement,
    rigid_transform,
    rigidity_defect,
    rotation_derivatives,
    rotation_from_quaternion,
    rotation_xyz,
    skew,
    torsor_transform,
    transform_points,
)

ORACLES = Path(__file__).parents[1] / "data" / "oracles"
angle = st.floats(-3.0, 3.0)
coordinate = st.floats(-300.0, 300.0)


@given(st.tuples(angle, angle, angle))
def test_full_rotation_is_the_product_of_three_matrix_exponentials(angles):
    with mpmath.workdps(30):
        expected = mpmath.eye(3)
        for axis, value in enumerate(angles):
            unit = [1.0 if k == axis else 0.0 for k in range(3)]
            expected = expected * mpmath.expm(mpmath.matrix((value * skew(np.array(unit))).tolist()))
    independent = np.array(expected.tolist(), dtype=float)
    np.testing.assert_allclose(rotation_xyz(np.array(angles)), independent, atol=4e-15)


def test_small_angles_torsors_and_quaternions_are_those_of_others():
    angles, v = np.array([0.01, -0.02, 0.03]), np.array([3.0, -5.0, 7.0])
    closed_form = v + np.cross(angles, v)
    np.testing.assert_allclose(rotation_xyz(angles, RotationForm.SMALL_ANGLE) @ v, closed_form, rtol=1e-15)
    case = json.loads((ORACLES / "rigid_bias_exact.json").read_text())
    torsor = np.array([*np.deg2rad([1.0, -0.5, 2.0]), 2.0, -1.0, 3.0])
    transform = torsor_transform(torsor, np.array([0.0, 0.0, -95.0]))
    np.testing.assert_allclose(transform, case["T_err1"], atol=1e-13)
    wxyz = np.random.default_rng(4).normal(size=(20, 4))
    for q in wxyz:
        expected = Rotation.from_quat(np.roll(q, -1)).as_matrix()
        np.testing.assert_allclose(rotation_from_quaternion(q), expected, atol=1e-14)
    assert rigidity_defect(rotation_xyz(np.array([0.3, 0.2, 0.1]))) < 1e-15
    assert rigidity_defect(1.01 * np.eye(3)) == pytest.approx(0.0201)
    assert rigidity_defect(np.diag([1.0, 1.0, -1.0])) == np.inf
    assert rigid_transform(np.eye(3), np.ones(3))[2, 3] == 1.0


@pytest.mark.parametrize("form", list(RotationForm))
@given(values=st.tuples(*[angle] * 3, *[coordinate] * 3), point=st.tuples(*[coordinate] * 3))
def test_derivatives_agree_with_central_differences(form, values, point):
    torsor, pivot, point = np.array(values), np.array([10.0, -20.0, -95.0]), np.array(point)
    step = 1e-5
    for k in range(6):
        ahead, behind = torsor + step * np.eye(6)[k], torsor - step * np.eye(6)[k]
        there, back = (transform_points(torsor_transform(each, pivot, form), point) for each in (ahead, behind))
        slope = displacement(torsor, pivot, form).by_torsor(point)[:, k]
        np.testing.assert_allclose(slope, (there - back) / (2 * step), atol=2e-6)
        if k < 3:
            finite = (rotation_xyz(ahead[:3], form) - rotation_xyz(behind[:3], form)) / (2 * step)
            np.testing.assert_allclose(rotation_derivatives(torsor[:3], form)[k], finite, atol=1e-9)


def test_leading_dimensions_are_a_batch():
    torsors = np.random.default_rng(2).normal(size=(4, 5, 6))
    pivot = np.array([1.0, 2.0, 3.0])
    batch = torsor_transform(torsors, pivot)
    assert batch.shape == (4, 5, 4, 4)
    np.testing.assert_array_equal(batch[2, 3], torsor_transform(torsors[2, 3], pivot))
    assert rotation_derivatives(torsors[..., :3]).shape == (4, 5, 3, 3, 3)
    points = np.random.default_rng(3).normal(size=(7, 3))
    np.testing.assert_allclose(
        transform_points(batch, points)[1, 1, 4], transform_points(batch[1, 1], points[4]), atol=1e-14
    )


@pytest.mark.parametrize("form", list(RotationForm))
def test_a_displacement_moves_points_as_its_matrix(form):
    rng = np.random.default_rng(5)
    for scale in (0.0, 1e-6, 0.1, 2.0):
        torsor, pivot, point = scale * rng.normal(size=6), 50 * rng.normal(size=3), 50 * rng.normal(size=3)
        at = displacement(torsor, pivot, form)
        matrix = torsor_transform(torsor, pivot, form)
        np.testing.assert_allclose(at.matrix(), matrix, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(at.move(point), matrix[:3, :3] @ point + matrix[:3, 3], rtol=1e-14, atol=1e-13)


UP, AHEAD = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
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


def test_a_matrix_is_scaled_by_sign_and_size_and_may_be_skewed():
    centre = image_centre_px((1536, 1536))
    matrix = projection_from_distances(1020.0, 700.0, (0.194, 0.194), centre, np.zeros(3), AHEAD, UP)
    points = np.random.default_rng(0).uniform(-50, 50, (9, 3))
    points[0] = [0.0, -900.0, 0.0]  # one point behind the source must not flip the others
    np.testing.assert_allclose(scale_to_unit_depth(-3.7 * matrix, points), matrix, rtol=1e-13, atol=1e-9)
    k = intrinsic_matrix((4000.0, 4100.0), (600.0, 500.0), 3.0)
    matrix = projection_from_pose(k, aim(-500.0 * AHEAD, AHEAD, UP))
    image = matrix @ [10.0, 0.0, -20.0, 1.0]  # camera coordinates (10, 20, 500)
    closed_form = [600 + 4000 * 10 / 500 + 3 * 20 / 500, 500 + 4100 * 20 / 500]
    np.testing.assert_allclose(image[:2] / image[2], closed_form, rtol=1e-14)
