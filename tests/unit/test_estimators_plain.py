"""The estimators beyond DLT in their plain form, against OpenCV, published figures, their limits and closed forms."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenes import cube_fiducials, random_system, system_of, target, with_noise
from tailstack.estimation.least_squares import estimate_views, locate, resect_pose, row_weights, split
from tailstack.estimation.resection import project, resect
from tailstack.geometry.rotation import rotation_xyz
from tailstack.system import Estimator, System, Triangulation

ORACLE = json.loads((Path(__file__).parents[1] / "data" / "oracles" / "estimators.json").read_text())


def cube(half_mm: float, estimator: Estimator, **changes) -> System:
    return system_of(cube_fiducials(half_mm), views=with_noise(0.5), estimator=estimator, **changes)


def noisy(system: System, trials: int, seed: int = 1):
    """Images of the fiducials (n, V, N, 2) and of the first target (n, V, 2), with the noise of each view."""
    rng = np.random.default_rng(seed)
    seen = [project(v.projection, system.fiducials_mm) for v in system.views]
    aims = [project(v.projection, system.targets[0].position_mm[None])[0] for v in system.views]
    fiducial, aimed = (
        np.array([getattr(v, name) for v in system.views]) for name in ("fiducial_noise_px", "target_noise_px")
    )
    shape = (trials, len(system.views))
    return (
        np.array(seen) + fiducial[:, None, None] * rng.normal(size=(*shape, len(system.fiducials_mm), 2)),
        np.array(aims) + aimed[:, None] * rng.normal(size=(*shape, 2)),
    )


def errors(system: System, images, aims, wrong=None):
    told = np.broadcast_to(system.fiducials_mm, (len(images), *system.fiducials_mm.shape))
    weights = row_weights(system, system.projections, system.fiducials_mm, system.targets[0].position_mm)
    return locate(system, estimate_views(system, told, images, wrong), aims, told, weights) - (
        system.targets[0].position_mm
    )


@pytest.fixture
def cv2(monkeypatch):
    """OpenCV, whose import adds to the environment and to the path of modules."""
    monkeypatch.setattr(os, "environ", os.environ.copy())
    monkeypatch.setattr(sys, "path", list(sys.path))
    return pytest.importorskip("cv2")


def test_the_pose_is_that_of_opencv(cv2):
    """independent: cv2.solvePnPRefineLM, to what it stops at."""
    system = cube(20, Estimator.POSE)
    images, _ = noisy(system, 5)
    view = system.views[1]
    camera = split(view.projection)
    assert np.allclose(camera.intrinsics @ np.column_stack([camera.rotation, camera.source_mm]), view.projection)
    for image in images[:, 1]:
        start = cv2.Rodrigues(camera.rotation)[0], camera.source_mm[:, None].copy()
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-14)
        turn, shift = cv2.solvePnPRefineLM(system.fiducials_mm, image, camera.intrinsics, None, *start, stop)
        theirs = camera.intrinsics @ np.column_stack([cv2.Rodrigues(turn)[0], shift])
        ours = resect_pose(system.fiducials_mm, image, view)
        np.testing.assert_allclose(
            project(ours, system.fiducials_mm), project(theirs, system.fiducials_mm), rtol=0, atol=1e-4
        )


def test_with_nothing_known_of_the_intrinsics_the_estimate_is_opencvs_calibration(cv2):
    """independent: cv2.calibrateCamera of one image, focal length and principal point free, to what it stops at."""
    rng = np.random.default_rng(9)
    points = rng.uniform((-45, -45, -85), (45, 45, 5), (12, 3))
    view = with_noise(0.3, azimuths_rad=(0.3,))[0]
    images = project(view.projection, points) + 0.3 * rng.normal(size=(5, 12, 2))
    camera = split(view.projection)
    fixed = cv2.CALIB_FIX_K1 + cv2.CALIB_FIX_K2 + cv2.CALIB_FIX_K3 + cv2.CALIB_ZERO_TANGENT_DIST
    free = cv2.CALIB_USE_INTRINSIC_GUESS + cv2.CALIB_FIX_ASPECT_RATIO
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 1000, 1e-15)
    ours = resect_pose(points, images, view, precision=np.zeros(3))
    for image, estimate in zip(images.astype(np.float32), ours, strict=True):
        _, intrinsics, _, turns, shifts = cv2.calibrateCamera(
            [points.astype(np.float32)], [image], (1536, 1536), camera.intrinsics.copy(), None, flags=fixed + free,
            criteria=stop,
        )  # fmt: skip
        theirs = intrinsics @ np.column_stack([cv2.Rodrigues(turns[0])[0], shifts[0]])
        np.testing.assert_allclose(project(estimate, points), project(theirs, points), rtol=0, atol=1e-3)
        assert split(estimate).intrinsics[0, 0] == pytest.approx(intrinsics[0, 0], rel=1e-3)


def test_without_noise_every_estimator_finds_the_target_and_a_moved_structure():
    """closed form: a rigid motion of the structure is absorbed, so that the target is found at T^-1 q."""
    rng = np.random.default_rng(5)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation_xyz(np.array([0.02, -0.01, 0.03])), (2.0, -1.0, 3.0)
    for estimator in Estimator:
        for form in Triangulation:
            system = random_system(rng, fiducials=8, views=3, estimator=estimator, triangulation=form)
            views = tuple(replace(view, intrinsics_prior=(0.01, 5.0)) for view in system.views)
            system = replace(system, views=views)
            aim = system.targets[0].position_mm
            moved = system.fiducials_mm @ motion[:3, :3].T + motion[:3, 3]
            images = np.array([project(v.projection, moved) for v in system.views])
            aims = np.array([project(v.projection, aim[None])[0] for v in system.views])
            estimates = estimate_views(system, system.fiducials_mm, images)
            weights = row_weights(system, estimates, system.fiducials_mm, aim)
            found = locate(system, estimates, aims, system.fiducials_mm, weights)
            np.testing.assert_allclose(found, np.linalg.solve(motion, [*aim, 1.0])[:3], rtol=0, atol=1e-7)


def test_a_prior_runs_from_the_pose_to_free_intrinsics():
    """closed form: nothing known is nine unknowns by reprojection, everything known is the pose."""
    system = cube(30, Estimator.POSE)
    images, _ = noisy(system, 20)
    view, points = system.views[0], np.broadcast_to(system.fiducials_mm, (20, 8, 3))
    pose = resect_pose(points, images[:, 0], view)
    known = resect_pose(points, images[:, 0], view, precision=np.full(3, 1e12))
    free = resect_pose(points, images[:, 0], view, precision=np.zeros(3))
    nearly = resect_pose(points, images[:, 0], view, precision=np.array([1e-6, 1e-14, 1e-14]))
    np.testing.assert_allclose(project(known, points), project(pose, points), rtol=0, atol=1e-6)
    np.testing.assert_allclose(project(nearly, points), project(free, points), rtol=0, atol=1e-6)
    wrong = np.array([0.03, 20.0, -10.0])
    away = resect_pose(points, images[:, 0], view, error=wrong, precision=np.zeros(3))
    np.testing.assert_allclose(project(away, points), project(free, points), rtol=0, atol=1e-6)
    # and what is free fits better than what is held, all eleven best of all
    eleven = estimate_views(cube(30, Estimator.REPROJECTION), points, images)[:, 0]
    squares = [((images[:, 0] - project(each, points)) ** 2).sum(axis=(1, 2)) for each in (pose, free, eleven)]
    linear = ((images[:, 0] - project(resect(points, images[:, 0]), points)) ** 2).sum(axis=(1, 2))
    for worse, better in ((squares[0], squares[1]), (squares[1], squares[2]), (linear, squares[2])):
        assert (worse > better).all()


def test_a_small_structure_whose_principal_point_is_hardly_known_has_the_least_squares():
    """independent: the sum that is to be least, written out, is larger wherever one goes from the estimate.

    Where beads are 0.2 mm off and the prior alone holds the principal point, whole Gauss-Newton steps turn about the
    answer, and left 9 of these 200 trials without an estimate.
    """
    rng, noise = np.random.default_rng(1), 0.05
    points = rng.uniform((-12, -12, -42), (12, 12, -18), (8, 3))
    view = with_noise(noise)[0]
    images = np.array([project(view.projection, points + 0.2 * rng.normal(size=(8, 3))) for _ in range(200)])
    images += noise * rng.normal(size=images.shape)
    told = rng.normal(size=(200, 3)) * [0.03, 30.0, 30.0]
    precision = (noise / np.array([0.03, 30.0, 30.0])) ** 2
    nominal = split(view.projection)
    estimates = resect_pose(points, images, view, error=told, precision=precision)
    assert np.isfinite(estimates).all()

    def weighed(intrinsics, rotation, shift, k):
        focal = intrinsics[0, 0] / nominal.intrinsics[0, 0] - 1
        away = np.array([focal, *(intrinsics[:2, 2] - nominal.intrinsics[:2, 2])]) - told[k]
        residuals = images[k] - project(intrinsics @ np.column_stack([rotation, shift]), points)
        return (residuals**2).sum() + (precision * away**2).sum()

    for k, estimate in enumerate(estimates):
        camera = split(estimate)
        least = weighed(camera.intrinsics, camera.rotation, camera.source_mm, k)
        for _ in range(10):
            size = 10.0 ** rng.uniform(-4, -1)
            intrinsics = camera.intrinsics.copy()
            intrinsics[:2, :2] *= 1 + size * 0.01 * rng.normal()
            intrinsics[:2, 2] += size * 10 * rng.normal(size=2)
            rotation = rotation_xyz(size * 0.01 * rng.normal(size=3)) @ camera.rotation
            shift = camera.source_mm + size * 3.0 * rng.normal(size=3)
            assert weighed(intrinsics, rotation, shift, k) > least * (1 - 1e-12)


def test_a_focal_length_wrong_by_ten_per_cent_hardly_moves_a_target_inside_the_structure():
    """published: with the pose estimated anew, +-500 px of some 5000 keep the mean error below 0.2 mm (arXiv
    2603.14031, five C-arms).  Its geometry is not printed; here the reference C-arm and targets inside the cube."""
    inside = np.random.default_rng(2).uniform((-25, -25, -65), (25, 25, -15), (20, 3))
    distances = []
    for wrong in (-0.1, 0.1):
        system = cube(50, Estimator.POSE)
        images, _ = noisy(system, 1)
        images = np.array([[project(v.projection, system.fiducials_mm) for v in system.views]])
        found = estimate_views(system, system.fiducials_mm[None], images, np.array([[[wrong, 0, 0]] * 2]))
        for point in inside:
            aims = np.array([[project(v.projection, point[None])[0] for v in system.views]])
            distances.append(np.linalg.norm(locate(system, found, aims, system.fiducials_mm[None])[0] - point))
    assert np.mean(distances) < 0.2
    outside = replace(system, targets=(target((0, 0, 70)),))
    aims = np.array([[project(v.projection, np.array([[0, 0, 70.0]]))[0] for v in system.views]])
    assert np.linalg.norm(errors(outside, images, aims, np.array([[[0.01, 0, 0]] * 2]))[0]) == pytest.approx(
        ORACLE["bias_if_focal_length_assumed_1pct_long_mm"]["50"], abs=1e-3
    )
