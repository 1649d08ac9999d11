"""What kernels compute without calling a library: exp, sin and cos, and the spectrum of a symmetric 3x3 matrix.

numba's own exp, sin and cos go to the maths library, one number at a time.  Those here are straight-line arithmetic, so
that LLVM takes eight turns of a loop around them at once: it runs in the processor's lanes.

LAPACK's call overhead (about 3 us from compiled code, 25 from Python) would be a third of the cost of a quantile, and
the closed trigonometric form loses half the digits of a small eigenvalue.  Cyclic Jacobi does neither: it keeps small
eigenvalues of a scaled diagonally dominant matrix to high relative accuracy (Demmel & Veselic 1992) and leaves a
diagonal matrix exactly as it is, so that a zero variance stays zero.
"""

from __future__ import annotations

from math import fabs, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from .store import kernel

Array = NDArray[np.float64]

_LEAST = -64.0  # exp is 0 to all purposes below it
# pi/2 in three parts of 33 bits (Cody and Waite): n times one of the first two is exact for n < 2^20.
_HALF_PI_1 = 1.57079632673412561417e00
_HALF_PI_2 = 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21
_TWO_OVER_PI = 6.36619772367581382433e-01
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and taking it away rounds to the nearest whole number


@kernel()
def _lossless(y: float) -> float:
    """exp(8 y) - 1 for -1 <= y <= 0.5, to a rounding or two however small y is: Taylor's polynomial and three times the
    square of what it is 1 less than."""
    u = 1.0 + y * (1.0 / 13.0)
    u = 1.0 + y * (1.0 / 12.0) * u
    u = 1.0 + y * (1.0 / 11.0) * u
    u = 1.0 + y * (1.0 / 10.0) * u
    u = 1.0 + y * (1.0 / 9.0) * u
    u = 1.0 + y * (1.0 / 8.0) * u
    u = 1.0 + y * (1.0 / 7.0) * u
    u = 1.0 + y * (1.0 / 6.0) * u
    u = 1.0 + y * (1.0 / 5.0) * u
    u = 1.0 + y * (1.0 / 4.0) * u
    u = 1.0 + y * (1.0 / 3.0) * u
    u = 1.0 + y * (1.0 / 2.0) * u
    u = y * u
    u *= 2.0 + u  # the square less 1: while u is small, nothing of it is lost
    u *= 2.0 + u
    u *= 2.0 + u
    return u


@kernel()
def exponential(x: float) -> float:
    """exp(x) for -64 <= x <= 30, exp(-64) below: relative error 4e-15 for -10 < x < 10, 1e-13 at -30, 2e-10 at -60.

    Taylor's polynomial of x / 64 and six squarings.
    """
    e = 1.0 + _lossless(max(x, _LEAST) * (1.0 / 64.0))
    e *= e
    e *= e
    e *= e
    return e


@kernel()
def share_lost(x: float) -> float:
    """1 - exp(-x) for x >= 0, to 1e-15 relative, however small x is."""
    u = _lossless(-min(x, -_LEAST) * (1.0 / 64.0))
    u *= 2.0 + u
    u *= 2.0 + u
    u *= 2.0 + u
    return -u


@kernel()
def sine_and_cosine(x: float) -> tuple[float, float]:
    """sin(x) and cos(x) to 2e-16 absolute for |x| < 1e6; beyond, and to 1e15, off by no more than rounding x itself is.

    Turned to |x| <= pi/4, Taylor's polynomials there.
    """
    turns = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    y = ((x - turns * _HALF_PI_1) - turns * _HALF_PI_2) - turns * _HALF_PI_3
    z = y * y
    s = 1.0 - z * (1.0 / 210.0)
    s = 1.0 - z * (1.0 / 156.0) * s
    s = 1.0 - z * (1.0 / 110.0) * s
    s = 1.0 - z * (1.0 / 72.0) * s
    s = 1.0 - z * (1.0 / 42.0) * s
    s = 1.0 - z * (1.0 / 20.0) * s
    s = y * (1.0 - z * (1.0 / 6.0) * s)
    c = 1.0 - z * (1.0 / 240.0)
    c = 1.0 - z * (1.0 / 182.0) * c
    c = 1.0 - z * (1.0 / 132.0) * c
    c = 1.0 - z * (1.0 / 90.0) * c
    c = 1.0 - z * (1.0 / 56.0) * c
    c = 1.0 - z * (1.0 / 30.0) * c
    c = 1.0 - z * (1.0 / 12.0) * c
    c = 1.0 - z * (1.0 / 2.0) * c
    quarter = turns - 4.0 * ((turns * 0.25 + _ROUND) - _ROUND)  # -2 ... 2
    odd = fabs(quarter) == 1.0
    first = c if odd else s
    second = s if odd else c
    sine = -first if (quarter < 0.0) | (quarter == 2.0) else first
    cosine = -second if (quarter == 1.0) | (fabs(quarter) == 2.0) else second
    return sine, cosine


# --- the spectrum -----------------------------------------------------------------------------------------

VANISHING_MM = 1e-30  # a spread below it is none at any length that matters, and its powers leave the floating point
_EPS = 2.220446049250313e-16


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
