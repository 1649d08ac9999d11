"""A Gaussian law on its principal axes, and the checks on a mean and a covariance."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.arrays import Array
from ..geometry.symmetric import eigen_symmetric
from ..kernels.store import kernel

VANISHING_MM = 1e-30  # a spread below it is none at any length that matters, and its powers leave the floating point
_EPS = 2.220446049250313e-16
SYMMETRY_TOLERANCE = 1e-9  # of the largest entry
PSD_TOLERANCE = 1e-9  # of the largest eigenvalue: what products like J S J^T leave behind, with a margin


@kernel()
def principal_axes(mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """(variances (3,) descending and >= 0, mean (3,) in the eigenbasis, eigenvectors (3, 3) in columns).

    Variances below the rounding of a rotated matrix are set to zero; those of a diagonal one are exact and stay, down
    to a spread that vanishes.
    """
    values, vectors, rotated = eigen_symmetric(covariance)
    floor = max(4.0 * _EPS * values[0] if rotated else 0.0, VANISHING_MM * VANISHING_MM)
    along = np.zeros(3)
    for i in range(3):
        if not values[i] > floor:
            values[i] = 0.0
        for k in range(3):
            along[i] += vectors[k, i] * mean[k]
    return values, along, vectors


def law_iv(mean: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Check a mean (3,) mm and a covariance (3, 3) mm^2 and return them as contiguous float arrays.

    Raises ValueError naming the rule that is broken and what arrived.
    """
    mean = np.ascontiguousarray(mean, dtype=np.float64)
    covariance = np.ascontiguousarray(covariance, dtype=np.float64)
    if mean.shape != (3,):
        raise ValueError(f"mean must have shape (3,), got {mean.shape}")
    if covariance.shape != (3, 3):
        raise ValueError(f"covariance must have shape (3, 3), got {covariance.shape}")
    if not np.isfinite(mean).all():
        raise ValueError(f"mean must be finite, got {mean.tolist()}")
    if not np.isfinite(covariance).all():
        raise ValueError(f"covariance must be finite, got {covariance.tolist()}")
    if np.abs(covariance - covariance.T).max() > SYMMETRY_TOLERANCE * np.abs(covariance).max():
        raise ValueError(
            f"covariance must be symmetric to {SYMMETRY_TOLERANCE:g} of its largest entry, got {covariance.tolist()}"
        )
    values, _, _ = eigen_symmetric(covariance)
    if values[2] < -PSD_TOLERANCE * max(values[0], 0.0):
        raise ValueError(
            f"covariance must be positive semidefinite; its smallest eigenvalue is {values[2]:.3g}, "
            f"its largest {values[0]:.3g}"
        )
    return mean, covariance


_FAR, _NEAR = 1e8, 1e6  # lengths of the mean, in largest standard deviations


@kernel()
def brought_near(variances: Array, m: Array) -> tuple[Array, float]:
    """(a mean (3,) in the same direction, by how much it is shorter): where the noise is lost in the digits of |m|.

    What |e| exceeds |m| by depends on the direction of m and, through the curvature of the sphere, on sigma / |m|.
    From a mean 1e8 standard deviations away, taking one 1e6 away changes it by less than 1e-6 standard deviations, a
    relative 1e-14 of |e|, and the contour of the nearer law has all its digits.
    """
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    sigma = sqrt(variances[0])
    if sigma == 0.0 or size < _FAR * sigma:
        return m, 0.0
    near = m * (_NEAR * sigma / size)
    return near, size - _NEAR * sigma
