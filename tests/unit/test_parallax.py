"""How firmly the rays cross: against estimates by SVD, and what the validity number says of rays that hardly do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenes import cube8_system, cube_fiducials, projection_looking, random_system, system_of, target, with_noise
from tailstack.geometry.symmetric import eigen_symmetric
from tailstack.montecarlo.estimators import quantile_estimate
from tailstack.montecarlo.simulate import simulate
from tailstack.propagation.linear import covariance, estimator_geometry, linearise
from tailstack.propagation.parallax import parallax_gains
from tailstack.scoring import score
from tailstack.tail.gaussian import norm_quantile


def resected(points, images):
    """(3, 4) by the plain DLT, points about their mean and in units of their size."""
    centre, size = points.mean(axis=0), np.ptp(points)
    rows = []
    for point, (u, v) in zip((points - centre) / size, images, strict=True):
        y = np.append(point, 1.0)
        rows += [np.concatenate([y, 0 * y, -u * y]), np.concatenate([0 * y, y, -v * y])]
    matrix = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 4)
    back = np.eye(4) / size
    back[:3, 3], back[3, 3] = -centre / size, 1.0
    return matrix @ back


def seen(matrix, point):
    x = matrix @ np.append(point, 1.0)
    return x[:2] / x[2]


def slope(matrices, point, direction, step):
    """(2 V,) how the images move with the point along the direction, px per mm."""
    ends = [np.concatenate([seen(m, point + s * step * direction) for m in matrices]) for s in (0.5, -0.5)]
    return (ends[0] - ends[1]) / step


@pytest.mark.parametrize("azimuth", [0.02, 0.3, 1.5])
def test_every_gain_equals_the_difference_of_two_estimates(azimuth):
    """independent: each image moved by +-0.02 px, resection by SVD, slopes of the estimated projections.  Images in
    units of a thousand px."""
    system = random_system(np.random.default_rng(3), fiducials=8, views=2)
    views = tuple(
        replace(view, projection=projection_looking(a))
        for view, a in zip(system.views, (0.1, 0.1 + azimuth), strict=True)
    )
    system = replace(system, views=views)
    projections, points, _ = estimator_geometry(system)
    aim = linearise(system, system.targets[0]).reconstructed_mm
    unit = np.diag([1e-3, 1e-3, 1.0])  # of the image, so that the columns of the DLT are alike
    matrices = [unit @ p for p in projections]
    moved = np.stack([slope(matrices, aim, axis, 1e-2) for axis in np.eye(3)], axis=1)
    _, values, right = np.linalg.svd(moved)
    direction, firmness = right[2], values[2]
    strong, _ = np.linalg.qr(moved @ right[:2].T)
    found = parallax_gains(projections, points, aim)
    largest = np.abs(found).max()
    for v, matrix in enumerate(matrices):
        images = np.array([seen(matrix, point) for point in points])
        for i in range(len(points)):
            for axis in range(2):
                ends = []
                for sign in (1.0, -1.0):
                    kicked = images.copy()
                    kicked[i, axis] += sign * 0.02e-3
                    estimated = [resected(points, kicked) if w == v else m for w, m in enumerate(matrices)]
                    ends.append(slope(estimated, aim, direction, 0.7))
                change = (ends[0] - ends[1]) / (2 * 0.02 * firmness)  # per px
                change -= strong @ (strong.T @ change)
                got = found[v, i, axis]
                assert min(abs(got - change).max(), abs(got + change).max()) < 2e-4 * largest, (v, i, axis)


def test_the_weakest_direction_is_the_last_eigenvector():
    """independent: LAPACK, condition numbers up to 1e9; the sign is free."""
    rng = np.random.default_rng(1)
    for k in range(200):
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        values = np.array([1.0, 10 ** -rng.uniform(0, 3), 0.5 * 10 ** -rng.uniform(3, 9)])
        matrix = (axes * values) @ axes.T
        assert abs(eigen_symmetric(0.5 * (matrix + matrix.T))[1][:, 2] @ axes[:, 2]) == pytest.approx(1.0, abs=1e-9), k


def test_first_order_is_not_trusted_where_rays_are_as_parallel_as_their_noise():
    """Eight beads, rays 0.23 deg apart, 0.3 px: by perspective alone nu was 0.001, and first order 'good to 1 %'."""
    views = tuple(
        replace(view, projection=projection_looking(azimuth))
        for view, azimuth in zip(cube8_system().views, (0.0, 0.004), strict=True)
    )
    said = score(cube8_system(views=views)).validity
    assert said.status == "not valid"
    assert "must not be used" in said.statement


@pytest.mark.parametrize(("angle_deg", "noise_px", "level"), [(1.0, 0.03, 1.0), (3.0, 0.3, 5.0), (2.0, 0.7, 20.0)])
def test_close_views_err_no_more_than_is_said(angle_deg, noise_px, level):
    """independent: the full chain, 60,000 trials, whose own error has a standard deviation of some 0.4 %."""
    views = with_noise(noise_px, azimuths_rad=(0.0, float(np.radians(angle_deg))))
    system = system_of(cube_fiducials(30.0), views=views, targets=(target((10.0, 5.0, 40.0)),))
    said = score(system).validity
    assert said.expected_error_percent == level
    first = norm_quantile(0.95, np.zeros(3), covariance(linearise(system, system.targets[0]), "localisation"))
    found = quantile_estimate(simulate(system, trials=60_000, seed=4), 0, "localisation", 0.95)
    assert abs(first / found.value_mm - 1) <= level / 100 + 0.01
