"""Compiled steps of the risk per unit: units drawn and bounded, their quantiles solved, ranks averaged."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..system import Array
from .gaussian import law_on_axes
from .quantile import quantile_on_axes
from .sampling import SingleArray
from .spectrum import principal_axes


@njit(cache=True, error_model="numpy")
def survey(
    mean: Array,
    root: Array,
    z: SingleArray,
    h: Array,
    u: SingleArray,
    covariance: Array,
    along: float,
    top: float,
    normal: float,
) -> tuple[Array, Array, Array, Array, Array, bool]:
    """(d (n, 3), |d|, low, high, closed form of R(d), whether there is one) for n units.

    Units ``d = mean + root z + u h``, z (k, n) and u (K, n) transposed so that loops run along the units.  low, high:
    bounds of R(d); along < 0: only 0 is known from below, else the normal quantile s(d) is measured in; covariance
    (3, 3) of the shot, top: the quantile of |shot|, normal: ndtri(p).
    """
    n = max(z.shape[1], u.shape[1])
    x = np.empty((3, n))
    x[0] = mean[0]
    x[1] = mean[1]
    x[2] = mean[2]
    first, second, third = x[0], x[1], x[2]
    for j in range(z.shape[0]):
        for i in range(n):
            first[i] += root[0, j] * z[j, i]
            second[i] += root[1, j] * z[j, i]
            third[i] += root[2, j] * z[j, i]
    for j in range(u.shape[0]):
        for i in range(n):
            first[i] += u[j, i] * h[j, 0]
            second[i] += u[j, i] * h[j, 1]
            third[i] += u[j, i] * h[j, 2]
    S = covariance
    T = np.zeros((3, 3))
    trace = 0.0
    square = 0.0
    cube = 0.0
    for a in range(3):
        trace += S[a, a]
        for b in range(3):
            for c in range(3):
                T[a, b] += S[a, c] * S[c, b]
    for a in range(3):
        square += T[a, a]
        for b in range(3):
            cube += T[a, b] * S[b, a]
    d = np.empty((n, 3))
    size = np.empty(n)
    low = np.empty(n)
    high = np.empty(n)
    guess = np.empty(n)
    for i in range(n):
        p, q, r = first[i], second[i], third[i]
        length2 = p * p + q * q + r * r
        spread = S[0, 0] * p * p + S[1, 1] * q * q + S[2, 2] * r * r
        spread += 2.0 * (S[0, 1] * p * q + S[0, 2] * p * r + S[1, 2] * q * r)
        wider = T[0, 0] * p * p + T[1, 1] * q * q + T[2, 2] * r * r
        wider += 2.0 * (T[0, 1] * p * q + T[0, 2] * p * r + T[1, 2] * q * r)
        length = sqrt(length2)
        size[i] = length
        least = length + along * sqrt(max(spread, 0.0)) / length if along >= 0.0 and length > 0.0 else 0.0
        low[i] = least
        high[i] = max(length + top, least)
        # Pearson's quantile of ``approximation.py``
        c2 = square + 2.0 * spread
        scale = sqrt(c2)
        gamma = (cube + 3.0 * wider) / (c2 * scale)
        b = sqrt(2.0) / 3.0 * normal - gamma * (2.0 / 9.0)
        w = gamma * b
        guess[i] = sqrt(max(trace + length2 + scale * b * (3.0 + 3.0 * w + w * w), 0.0))
    for i in range(n):
        d[i, 0] = first[i]
        d[i, 1] = second[i]
        d[i, 2] = third[i]
    return d, size, low, high, guess, square > 0.0


@njit(cache=True, error_model="numpy")
def _turned(d: Array, axes: Array, out: Array) -> None:
    """out = axes' d, as ``principal_axes`` turns a mean."""
    for a in range(3):
        out[a] = 0.0
        for k in range(3):
            out[a] += axes[k, a] * d[k]


@njit(cache=True, error_model="numpy")
def gaussian_quantiles(p: float, d: Array, covariance: Array, agreement: float) -> Array:
    """(n,) p-quantile of |d + shot| for each row of d (n, 3); NaN: not converged.  The axes are found once for all."""
    out = np.empty(d.shape[0])
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    for i in range(d.shape[0]):
        _turned(d[i], axes, m)
        out[i] = quantile_on_axes(p, variances, m, agreement)
    return out


@njit(cache=True, error_model="numpy")
def gaussian_meets(p: float, limit: float, d: Array, covariance: Array, agreement: float) -> NDArray[np.bool_]:
    out = np.empty(d.shape[0], dtype=np.bool_)
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    for i in range(d.shape[0]):
        _turned(d[i], axes, m)
        out[i] = law_on_axes(variances, m, limit, agreement)[0] >= p
    return out


@njit(cache=True, error_model="numpy")
def drawn_together(low: Array, high: Array, guess: Array, below: float, above: float) -> tuple[Array, Array]:
    """Bounds (n,) no farther from the guess (n,) than this."""
    n = low.size
    least = np.empty(n)
    most = np.empty(n)
    for i in range(n):
        least[i] = max(low[i], guess[i] + below)
        most[i] = max(min(high[i], guess[i] + above), least[i])
    return least, most


@njit(cache=True, error_model="numpy")
def solve_within(
    p: float,
    d: Array,
    covariance: Array,
    low: Array,
    high: Array,
    floor: float,
    ceiling: float,
    agreement: float,
) -> tuple[Array, int]:
    """(R (n,), how many were solved): exact where the bounds reach into [floor, ceiling], else their middle."""
    n = low.size
    out = np.empty(n)
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    solved = 0
    for i in range(n):
        out[i] = 0.5 * (low[i] + high[i])
        if low[i] <= ceiling and high[i] >= floor and low[i] < high[i]:
            _turned(d[i], axes, m)
            out[i] = quantile_on_axes(p, variances, m, agreement)
            solved += 1
    return out, solved


@njit(cache=True, error_model="numpy")
def rank_average(ranked: Array, position: float, width: int) -> float:
    """Mean of the ascending values (n,) about a position, ranks from 0, weights a triangle of this half-width.

    Continuous and monotone in the position; half-width 1 is linear interpolation.
    """
    total = 0.0
    weights = 0.0
    for k in range(max(int(position) - width, 0), min(int(position) + width + 1, ranked.size - 1) + 1):
        weight = max(width - abs(k - position), 0.0)
        total += weight * ranked[k]
        weights += weight
    return total / weights


@njit(cache=True, error_model="numpy")
def position_of(level: float, ranked: Array, width: int) -> float:
    """Where the average over ranks equals the level; the nearest end if nowhere.  By bisection."""
    low = 0.0
    high = ranked.size - 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if rank_average(ranked, middle, width) < level:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
