"""Derivatives of the probability of a declared law, compiled: by the mean, the covariance and every column's length."""

from __future__ import annotations

from math import cos, exp, sin, sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .ball import balls
from .elementary import sine_and_cosine
from .series import LOG_SINC, fold_small, rows_where, sum_of_products

# x cot x - 1, the logarithmic derivative of sin x / x: the same series times its own degree.
_LOG_SLOPE = LOG_SINC * np.arange(LOG_SINC.size)


@kernel()
def lattice_gradient(
    r: float, k: Array, volume: float, m: Array, S: Array, h: Array, threshold: float
) -> tuple[Array, Array, Array]:
    """(dP by the mean (3,), by S (3, 3), by the logarithm of each column's length (K,)) at radius r.

    On principal axes, in three dimensions; k (n, 3), volume: the lattice that ``build`` made with this threshold.
    Long columns by prefix and suffix products (a factor may vanish), small ones (``fold_small``) by the series of
    their logarithm.
    """
    columns = h.shape[0]
    by_mean = np.zeros(3)
    by_covariance = np.zeros((3, 3))
    by_column = np.zeros(columns)
    folded, short, _ = fold_small(S, h, threshold)
    small = np.ascontiguousarray(rows_where(h, short, True).T)
    large = np.ascontiguousarray(rows_where(h, short, False).T)
    count = large.shape[1]
    squares = np.empty(small.shape[1])
    log_small = np.empty(small.shape[1])  # over the square
    slope_small = np.empty(small.shape[1])
    by_small = np.zeros(small.shape[1])
    by_large = np.zeros(count)
    psi = np.empty(count)
    slope = np.empty(count)
    before = np.empty(count + 1)
    t = np.empty(k.shape[0])
    for i in range(t.size):
        t[i] = sqrt(k[i, 0] * k[i, 0] + k[i, 1] * k[i, 1] + k[i, 2] * k[i, 2])
    ball = balls(r, t)
    for i in range(k.shape[0]):
        q = 0.0
        phase = 0.0
        for a in range(3):
            phase += k[i, a] * m[a]
            for b in range(3):
                q += k[i, a] * folded[a, b] * k[i, b]
        if t[i] == 0.0:
            continue
        for j in range(small.shape[1]):  # the whole series: no branch, no inner loop, in lanes
            x = k[i, 0] * small[0, j] + k[i, 1] * small[1, j] + k[i, 2] * small[2, j]
            z = x * x
            value = LOG_SINC[10] + z * LOG_SINC[12]
            value = LOG_SINC[8] + z * value
            value = LOG_SINC[6] + z * value
            value = LOG_SINC[4] + z * value
            rate = _LOG_SLOPE[10] + z * _LOG_SLOPE[12]
            rate = _LOG_SLOPE[8] + z * rate
            rate = _LOG_SLOPE[6] + z * rate
            rate = _LOG_SLOPE[4] + z * rate
            squares[j] = z
            log_small[j] = value * z
            slope_small[j] = rate * z * z - z * (1.0 / 3.0)
        factor = 2.0 * exp(sum_of_products(log_small, squares) - 0.5 * q) / volume * ball[i]
        before[0] = 1.0
        for j in range(count):  # no branch and no call: in lanes
            x = k[i, 0] * large[0, j] + k[i, 1] * large[1, j] + k[i, 2] * large[2, j]
            sine, cosine = sine_and_cosine(x)
            z = x * x
            near = z < 1e-4
            value = sine / (1.0 if near else x)
            psi[j] = 1.0 - z * (1.0 / 6.0) + z * z * (1.0 / 120.0) if near else value
            slope[j] = z * z * (1.0 / 30.0) - z * (1.0 / 3.0) if near else cosine - value
        for j in range(count):
            before[j + 1] = before[j] * psi[j]
        even = factor * cos(phase)
        odd = -factor * sin(phase) * before[count]
        after = even
        for j in range(count - 1, -1, -1):
            by_large[j] += before[j] * slope[j] * after
            after *= psi[j]
        for j in range(small.shape[1]):
            by_small[j] += after * slope_small[j]
        for a in range(3):
            by_mean[a] += odd * k[i, a]
            for b in range(3):
                by_covariance[a, b] -= 0.5 * after * k[i, a] * k[i, b]
    first = 0
    for j in range(columns):
        if short[j]:
            by_column[j] = by_small[first]
            first += 1
        else:
            by_column[j] = by_large[j - first]
    return by_mean, by_covariance, by_column
