"""What the images do to the point of one target, compiled: gains and Eq 16's covariance."""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .noise import mean_rows, noise_gains_jit


@kernel(nogil=True)
def image_gains(
    projections: Array, points: Array, target: Array, per_error: Array, std: Array, gains: Array
) -> tuple[bool, Array, float]:
    """Gains of every image noise and manufacturing error on the reconstructed point, by column.

    projections (V, 3, 4), points (N, 3) and target (3,) mm as ``noise_gains`` takes them; per_error (3, 3): what a
    manufacturing error does to the points; std (N, 3) mm of it.  Fills the first columns of gains (3, K): for each view
    2 N of its fiducials (u and v of each) and 2 of the target, mm per px; then 3 N of the manufacturing errors (x, y, z
    of each), mm per mm, if any is not 0.  Returns (whether all gains of noise
    are finite, (3, 3) mm^2 covariance of the manufacturing errors as Eq 16 has it: cross-view terms dropped,
    distance of the target from the points' centroid over their RMS radius).
    """
    views, count = projections.shape[0], points.shape[0]
    fiducial, aimed = np.zeros((views, count, 3, 2)), np.zeros((views, 3, 2))
    made, perspective = np.zeros((views, count, 3, 3)), np.zeros((views, count, 2))
    noise_gains_jit(projections, points, target, fiducial, aimed, made, perspective)
    first = 0
    total = 0.0
    for v in range(views):
        for j in range(3):
            for i in range(count):
                gains[j, first + 2 * i] = fiducial[v, i, j, 0]
                gains[j, first + 2 * i + 1] = fiducial[v, i, j, 1]
                total += abs(fiducial[v, i, j, 0]) + abs(fiducial[v, i, j, 1])
            for c in range(2):
                gains[j, first + 2 * count + c] = aimed[v, j, c]
                total += abs(aimed[v, j, c])
        first += 2 * count + 2
    block_diagonal = np.zeros((3, 3))
    if std.any():
        through = np.empty((3, 3))
        for i in range(count):
            for v in range(views):
                for j in range(3):
                    for k in range(3):
                        through[j, k] = 0.0
                        for x in range(3):
                            through[j, k] += made[v, i, j, x] * per_error[x, k]
                        if v == 0:
                            gains[j, first + 3 * i + k] = 0.0
                        gains[j, first + 3 * i + k] += through[j, k]
                for j in range(3):
                    for x in range(3):
                        for k in range(3):
                            block_diagonal[j, x] += through[j, k] * through[x, k] * std[i, k] ** 2
    centroid = mean_rows(points)
    away = 0.0
    square = 0.0
    for k in range(3):
        away += (target[k] - centroid[k]) ** 2
        for i in range(count):
            square += (points[i, k] - centroid[k]) ** 2 / count
    return np.isfinite(total), block_diagonal, sqrt(away / square)
