"""Sums over a lattice of the Fourier transform of the ball: probability, density, their integral and derivatives.

``B_r(t) = 4 pi (sin rt - rt cos rt) / t^3`` for the ball, ``2 pi r J1(rt) / t`` for the disc, ``2 sin(rt) / t`` for the
interval; its derivative by r is the transform of the sphere of radius r.
"""

from __future__ import annotations

from math import cos, exp, fabs, pi, sin, sqrt

import numpy as np
from numba import njit

from ..system import Array


@njit(cache=True, error_model="numpy")
def bessel_j01(x: float) -> tuple[float, float]:
    """J0 and J1 at x >= 0: Miller's backward recurrence, Hankel's expansion beyond 30 (both to about 1e-15)."""
    if x < 1e-8:
        return 1.0, 0.5 * x
    if x < 30.0:
        order = 2 * int((x + 36.0) / 2.0)
        above = 0.0
        here = 1e-200
        even = 0.0
        for j in range(order, 0, -1):
            below = 2.0 * j / x * here - above
            above = here
            here = below
            if j % 2 == 1 and j > 1:
                even += here
        norm = here + 2.0 * even
        return here / norm, above / norm
    out0 = 0.0
    out1 = 0.0
    for nu in range(2):
        mu = 4.0 * nu * nu
        p = 1.0
        q = 0.0
        term = 1.0
        for j in range(1, 24):
            term *= (mu - (2.0 * j - 1.0) ** 2) / (8.0 * j * x)
            sign = 1.0 if (j // 2) % 2 == 0 else -1.0
            if j % 2 == 1:
                q += sign * term
            else:
                p += sign * term
            if fabs(term) < 1e-17:
                break
        angle = x - 0.5 * nu * pi - 0.25 * pi
        value = sqrt(2.0 / (pi * x)) * (p * cos(angle) - q * sin(angle))
        if nu == 0:
            out0 = value
        else:
            out1 = value
    return out0, out1


@njit(cache=True, error_model="numpy")
def ball_sums(r: float, dimension: int, t: Array, w: Array) -> tuple[float, float, float]:
    """sum w B_r(t) and its first two derivatives by r, for the ball, the disc or the interval of radius r."""
    f0 = 0.0
    f1 = 0.0
    f2 = 0.0
    if dimension == 3:
        for i in range(t.size):
            ti = t[i]
            x = r * ti
            if x < 1e-2:
                f0 += w[i] * r * r * r * (1.0 / 3.0 - x * x / 30.0 + x * x * x * x / 840.0)
                f1 += w[i] * r * r * (1.0 - x * x / 6.0 + x * x * x * x / 120.0)
                f2 += w[i] * r * (2.0 - 2.0 * x * x / 3.0)
            else:
                s = sin(x)
                c = cos(x)
                v = w[i] / ti
                f0 += v * (s - x * c) / (ti * ti)
                f1 += v * r * s
                f2 += v * (s + x * c)
        scale = 4.0 * pi
    elif dimension == 2:
        for i in range(t.size):
            j0, j1 = bessel_j01(r * t[i])
            f0 += w[i] * (r * j1 / t[i] if t[i] > 0.0 else 0.5 * r * r)
            f1 += w[i] * r * j0
            f2 += w[i] * (j0 - r * t[i] * j1)
        scale = 2.0 * pi
    else:
        for i in range(t.size):
            f0 += w[i] * (sin(r * t[i]) / t[i] if t[i] > 0.0 else r)
            f1 += w[i] * cos(r * t[i])
            f2 -= w[i] * t[i] * sin(r * t[i])
        scale = 2.0
    return scale * f0, scale * f1, scale * f2


@njit(cache=True, error_model="numpy")
def ball_integral(r: float, t: Array, w: Array) -> float:
    """int_0^r sum w B_x(t) dx in three dimensions: the integral of the probability over the radius."""
    total = 0.0
    for i in range(t.size):
        x = r * t[i]
        if x < 0.05:
            total += w[i] * r**4 * (1.0 / 12.0 - x * x / 180.0 + x**4 / 6720.0)
        else:
            total += w[i] * (2.0 * (1.0 - cos(x)) - x * sin(x)) / t[i] ** 4
    return 4.0 * pi * total


@njit(cache=True, error_model="numpy")
def lattice_gradient(
    r: float, dimension: int, k: Array, mean: Array, S: Array, h: Array, volume: float
) -> tuple[Array, Array, Array]:
    """Derivatives of the probability by mean (3,), S (3, 3) and the logarithm of each column's length (K,)."""
    columns = h.shape[0]
    by_mean = np.zeros(3)
    by_covariance = np.zeros((3, 3))
    by_column = np.zeros(columns)
    psi = np.empty(columns)
    slope = np.empty(columns)
    before = np.empty(columns + 1)
    t = np.empty(1)
    one = np.ones(1)
    for i in range(k.shape[0]):
        q = 0.0
        phase = 0.0
        size = 0.0
        for a in range(3):
            phase += k[i, a] * mean[a]
            size += k[i, a] * k[i, a]
            for b in range(3):
                q += k[i, a] * S[a, b] * k[i, b]
        if size == 0.0:
            continue
        t[0] = sqrt(size)
        ball, _, _ = ball_sums(r, dimension, t, one)
        factor = 2.0 * exp(-0.5 * q) / volume * ball
        before[0] = 1.0
        for j in range(columns):
            x = k[i, 0] * h[j, 0] + k[i, 1] * h[j, 1] + k[i, 2] * h[j, 2]
            if fabs(x) < 1e-2:
                psi[j] = 1.0 - x * x / 6.0 + x**4 / 120.0
                slope[j] = -x * x / 3.0 + x**4 / 30.0
            else:
                psi[j] = sin(x) / x
                slope[j] = cos(x) - psi[j]
            before[j + 1] = before[j] * psi[j]
        even = factor * cos(phase)
        odd = -factor * sin(phase) * before[columns]
        for a in range(3):
            by_mean[a] += odd * k[i, a]
            for b in range(3):
                by_covariance[a, b] -= 0.5 * even * before[columns] * k[i, a] * k[i, b]
        after = even
        for j in range(columns - 1, -1, -1):
            by_column[j] += before[j] * slope[j] * after
            after *= psi[j]
    return by_mean, by_covariance, by_column
