"""What geometry a pose is refused for, and what it may be estimated from where DLT may not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenes import cube_fiducials, read_only, system_of, with_noise
from tailstack import score
from tailstack.errors import IllPosedError
from tailstack.estimation.checks import check_geometry
from tailstack.estimation.least_squares import resect_pose
from tailstack.estimation.resection import project
from tailstack.system import Estimator, System, Triangulation


def plate(half_mm: float, azimuth: float = 0.0) -> System:
    """Nine fiducials in a plane with normal y, seen from both sides of it at this azimuth, and across at another."""
    side = (-half_mm, 0.0, half_mm)
    fiducials = np.array([(x, 0.0, z - 40.0) for x in side for z in side])
    views = with_noise(0.5, azimuths_rad=(azimuth, azimuth + 1.0))
    return system_of(fiducials, views=views, estimator=Estimator.POSE)


def refusal(system: System):
    with pytest.raises(IllPosedError) as caught:
        check_geometry(system)
    return caught.value.problems[0]


def test_four_fiducials_are_enough_for_a_pose_and_three_are_not():
    corners = cube_fiducials(50)[[0, 3, 5, 6]]
    system = system_of(corners, views=with_noise(0.5), estimator=Estimator.POSE)
    assert np.isfinite(score(system).targets[0].p95_mm)
    five = cube_fiducials(50)[[0, 1, 3, 5, 6]]
    (losses,) = score(system_of(five, views=with_noise(0.5), estimator=Estimator.POSE)).losses
    assert losses.single.value_mm is not None  # one may be lost, two may not
    assert losses.double is not None
    assert "needs 4" in losses.double.reason
    few = refusal(replace(system, fiducials_mm=read_only(corners[:3]), fiducial_labels=("A", "B", "C"),
                          manufacturing_half_width_mm=read_only(np.zeros((3, 3)))))  # fmt: skip
    assert (few.code, few.pointer) == ("too-few-fiducials", "/fiducials")
    assert "at least 4" in few.hint
    assert refusal(replace(system, estimator=Estimator.REPROJECTION)).code == "too-few-fiducials"


def test_a_plane_seen_obliquely_is_enough_for_a_pose():
    system = plate(40, 0.5)
    assert not check_geometry(system)
    flat = refusal(replace(system, estimator=Estimator.DLT))
    assert flat.code == "coplanar-fiducials"
    assert "model.estimator: pose takes a flat structure" in flat.hint


@pytest.mark.parametrize("azimuth", [0.0, 0.1, 0.2])
def test_a_small_plane_seen_head_on_is_refused_with_the_two_poses(azimuth):
    """independent: noisy images of the true pose are explained as well by one that is found from the other side."""
    system = plate(10, azimuth)
    said = refusal(system)
    assert said.code == "ambiguous-pose"
    assert "view0" in said.detail
    assert "with the normal along y and along (" in said.detail
    view, points = system.views[0], system.fiducials_mm
    text = said.detail.split("along y and along (")[1].split(")")[0]
    rival = np.array([float(part) for part in text.split(",")])
    rng = np.random.default_rng(3)
    images = project(view.projection, points) + 0.5 * rng.normal(size=(400, 9, 2))
    normal = np.array([0.0, 1.0, 0.0])
    axis = np.cross(normal, rival)
    angle = np.arcsin(min(float(np.linalg.norm(axis)), 1.0))
    axis /= np.linalg.norm(axis)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turned = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turned, points.mean(axis=0) - turned @ points.mean(axis=0)
    other = resect_pose(points, images, replace(view, projection=view.projection @ motion))
    here = resect_pose(points, images, view)
    squares = [((project(p, points) - images) ** 2).sum(axis=(1, 2)) for p in (here, other)]
    known = np.isfinite(squares[0] + squares[1])
    assert (squares[1][known] < squares[0][known]).mean() > 0.001  # as often as the refusal tolerates


def test_weights_of_views_without_noise_are_refused():
    views = with_noise(0.0, azimuths_rad=(0.0, 1.5))
    said = refusal(system_of(cube_fiducials(50), views=views, triangulation=Triangulation.WEIGHTED))
    assert (said.code, said.pointer) == ("no-noise", "/views/0")


def test_a_score_says_what_its_estimator_takes_for_exact():
    system = system_of(cube_fiducials(50), views=with_noise(0.5))
    exact = score(replace(system, estimator=Estimator.POSE)).provenance
    assert exact.estimator == "pose"
    assert any("takes for exact (view0, view1)" in line for line in exact.not_included)
    assert not any("for exact" in line for line in score(system).provenance.not_included)
