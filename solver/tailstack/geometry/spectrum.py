"""The spectrum of a symmetric 3x3 matrix: its eigenvalues, a Gaussian law on its principal axes, checks of the law.

LAPACK's call overhead (about 3 us from compiled code, 25 from Python) would be a third of the cost of a quantile, and
the closed trigonometric form loses half the digits of a small eigenvalue.  Cyclic Jacobi does neither: it keeps small
eigenvalues of a scaled diagonally dominant matrix to high relative accuracy (Demmel & Veselic 1992) and leaves a
diagonal matrix exactly as it is, so that a zero variance stays zero.
"""

from __future__ import annotations

from math import fabs, hypot, sqrt

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.store import kernel
from .arrays import Array

VANISHING_MM = 1e-30  # a spread below it is none at any length that matters, and its powers leave the floating point
_EPS = 2.220446049250313e-16
SYMMETRY_TOLERANCE = 1e-9  # of the largest entry
PSD_TOLERANCE = 1e-9  # of the largest eigenvalue: what products like J S J^T leave behind, with a margin


@kernel()
def eigen_symmetric(matrix: Array) -> tuple[Array, Array, bool]:
    """(eigenvalues (3,) descending, eigenvectors (3, 3) in columns, whether any rotation was needed).

    matrix: (3, 3) symmetric; only its symmetric part is used.  Eigenvalues are not clipped.
    """
    a = np.empty((3, 3))
    v = np.zeros((3, 3))
    for i in range(3):
        v[i, i] = 1.0
        for j in range(3):
            a[i, j] = 0.5 * (matrix[i, j] + matrix[j, i])
    rotated = False
    for _ in range(30):
        off = fabs(a[0, 1]) + fabs(a[0, 2]) + fabs(a[1, 2])
        if off == 0.0:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                apq = a[p, q]
                if apq == 0.0:
                    continue
                # An entry that can no longer change either diagonal, nor a product of their roots, is finished.
                if fabs(apq) <= 1e-18 * sqrt(fabs(a[p, p]) * fabs(a[q, q])):
                    a[p, q] = 0.0
                    a[q, p] = 0.0
                    continue
                rotated = True
                theta = 0.5 * (a[q, q] - a[p, p]) / apq
                t = 1.0 / (fabs(theta) + hypot(theta, 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / sqrt(t * t + 1.0)
                s = t * c
                a[p, p] -= t * apq
                a[q, q] += t * apq
                a[p, q] = 0.0
                a[q, p] = 0.0
                k = 3 - p - q
                akp = a[k, p]
                akq = a[k, q]
                a[k, p] = c * akp - s * akq
                a[p, k] = a[k, p]
                a[k, q] = s * akp + c * akq
                a[q, k] = a[k, q]
                for i in range(3):
                    vip = v[i, p]
                    v[i, p] = c * vip - s * v[i, q]
                    v[i, q] = s * vip + c * v[i, q]
    values = np.empty(3)
    for i in range(3):
        values[i] = a[i, i]
    for i in range(2):  # selection sort, columns follow
        top = i
        for j in range(i + 1, 3):
            if values[j] > values[top]:
                top = j
        if top != i:
            values[i], values[top] = values[top], values[i]
            for k in range(3):
                v[k, i], v[k, top] = v[k, top], v[k, i]
    return values, v, rotated


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
