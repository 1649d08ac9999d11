"""How firmly the rays cross: noise of the direction in which they do so least, relative to itself.

Triangulation divides by the smallest singular value of ``J = d(images)/d(point)``: at a target seen along rays that
are nearly parallel it is small, and image noise turns the rays by a part of the angle between them.  First order takes
that part to be small.  With d the weakest direction and ``s = |J d|``, that part is ``dJ d / s``: along d the noise of
an image must vary little beside the image itself.  Of ``dJ d`` counts what no step of the target across d would do as
well: along ``J d`` it changes s, along the normal of the epipolar planes it turns the rays past each other.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..arrays import Array
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel
from .noise import mean_rows, view_residual_gains

_STEP = 1e-3  # of the depth, between the points at which the noise of an image is compared: an error of its square


@kernel(nogil=True)
def _made_orthogonal(vector: Array, units: Array) -> None:
    """Take orthonormal units (k, n) out of a vector (n,), twice for the rounding."""
    for _ in range(2):
        for u in range(units.shape[0]):
            product = 0.0
            for k in range(vector.size):
                product += vector[k] * units[u, k]
            for k in range(vector.size):
                vector[k] -= product * units[u, k]


@kernel(nogil=True)
def motion_of_image(projection: Array, point: Array, out: Array) -> float:
    """Fill out (2, 3), px per mm, with how the image of a point (3,) moves with it; its depth, mm.  P (3, 4)."""
    seen = projection[:, 3].copy()
    for r in range(3):
        for k in range(3):
            seen[r] += projection[r, k] * point[k]
    for c in range(2):
        for k in range(3):
            out[c, k] = (projection[c, k] - seen[c] / seen[2] * projection[2, k]) / seen[2]
    return float(seen[2])


@kernel(nogil=True)
def parallax_gains(projections: Array, points: Array, target: Array) -> Array:
    """(V, N, 2, 2 V) relative change of how the images move with the target along its weakest direction.

    Per px of each fiducial's noise (its u and v); in all 2 V coordinates of the images, but for what moving the target
    across that direction would do as well.  projections (V, 3, 4) con mm to px with |p3| = 1, points (N, 3) and
    target (3,) mm as ``noise_gains`` takes them.
    """
    views, count = projections.shape[0], points.shape[0]
    centre = mean_rows(points)
    moved = np.zeros((3, 2 * views))  # px per mm along x, y, z
    nearest = np.inf
    motion = np.empty((2, 3))
    for v in range(views):
        nearest = min(nearest, motion_of_image(projections[v], target, motion))
        for c in range(2):
            for k in range(3):
                moved[k, 2 * v + c] = motion[c, k]
    normal = np.zeros((3, 3))
    for j in range(3):
        for k in range(3):
            for x in range(2 * views):
                normal[j, k] += moved[j, x] * moved[k, x]
    squares, axes, _ = eigen_symmetric(normal)  # the images move along the three axes at right angles
    direction = axes[:, 2].copy()
    firmness = sqrt(squares[2])
    units = np.zeros((2, 2 * views))  # what the images do across the weakest direction
    for u in range(2):
        for k in range(3):
            units[u] += axes[k, u] * moved[k]
        size = 0.0
        for x in range(2 * views):
            size += units[u, x] * units[u, x]
        units[u] /= sqrt(size)
    step = _STEP * nearest
    gains, perspective = np.empty((count, 2, 2)), np.empty((count, 2))
    out = np.zeros((views, count, 2, 2 * views))
    for v in range(views):
        for side in (-1.0, 1.0):
            there = target + 0.5 * side * step * direction
            image = view_residual_gains(projections[v], points, centre, there, gains, perspective)
            for i in range(count):
                for noise in range(2):
                    for c in range(2):
                        out[v, i, noise, 2 * v + c] += side * gains[i, c, noise] / (image[4] * step * firmness)
        for i in range(count):
            for noise in range(2):
                _made_orthogonal(out[v, i, noise], units)
    return out
