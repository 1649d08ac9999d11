"""Sums over a lattice of the Fourier transform of the ball: probability, density, and their integral.

``B_r(t) = 4 pi (sin rt - rt cos rt) / t^3`` for the ball, ``2 pi r J1(rt) / t`` for the disc, ``2 sin(rt) / t`` for the
interval; its derivative by r is the transform of the sphere of radius r.
"""

from __future__ import annotations

from math import cos, fabs, pi, sin, sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .elementary import sine_and_cosine
from .series import sum_of_products


@kernel()
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


@kernel()
def sines(scale: float, t: Array, s: Array, c: Array) -> None:
    """s, c (n,) = sin, cos of scale t, as :func:`sine_and_cosine`: in lanes."""
    for i in range(t.size):
        s[i], c[i] = sine_and_cosine(scale * t[i])


@kernel()
def _ball(r: float, t: Array, w: Array, s: Array, c: Array) -> tuple[float, float, float]:
    """sum w B_r(t) / (4 pi) and its first two derivatives by r; s, c: sin and cos of r t, which are overwritten."""
    terms = np.empty(t.size)
    for i in range(t.size):
        x = r * t[i]
        z = x * x
        near = x < 1e-2
        per = 1.0 / (1.0 if near else t[i])
        sine = s[i]
        turned = x * c[i]
        ball = (sine - turned) * (per * per * per)
        terms[i] = r * r * r * (1.0 / 3.0 - z / 30.0 + z * z / 840.0) if near else ball
        s[i] = r * r * (1.0 - z / 6.0 + z * z / 120.0) if near else r * sine * per
        c[i] = r * (2.0 - 2.0 * z / 3.0) if near else (sine + turned) * per
    return sum_of_products(w, terms), sum_of_products(w, s), sum_of_products(w, c)


@kernel()
def balls(r: float, t: Array) -> Array:
    """(n,) transforms B_r(t) of the ball in three dimensions."""
    s = np.empty(t.size)
    out = np.empty(t.size)
    sines(r, t, s, out)
    for i in range(t.size):
        x = r * t[i]
        if x < 1e-2:
            out[i] = 4.0 * pi * r * r * r * (1.0 / 3.0 - x * x / 30.0 + x * x * x * x / 840.0)
        else:
            out[i] = 4.0 * pi * (s[i] - x * out[i]) / (t[i] * t[i] * t[i])
    return out


@kernel()
def ball_sums(r: float, dimension: int, t: Array, w: Array) -> tuple[float, float, float]:
    """sum w B_r(t) and its first two derivatives by r, for the ball, the disc or the interval of radius r."""
    f0 = 0.0
    f1 = 0.0
    f2 = 0.0
    if dimension == 3:
        s = np.empty(t.size)
        c = np.empty(t.size)
        sines(r, t, s, c)
        f0, f1, f2 = _ball(r, t, w, s, c)
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


@kernel()
def _integral(r: float, t: Array, w: Array, s: Array, c: Array) -> float:
    """s is overwritten."""
    r2 = r * r
    for i in range(t.size):
        x = r * t[i]
        z = x * x
        near = x < 0.05
        t2 = 1.0 if near else t[i] * t[i]
        inner = r2 * r2 * (1.0 / 12.0 - z / 180.0 + z * z / 6720.0)
        s[i] = inner if near else (2.0 * (1.0 - c[i]) - x * s[i]) / (t2 * t2)
    return sum_of_products(w, s)


@kernel()
def ball_integral(r: float, t: Array, w: Array) -> float:
    """int_0^r sum w B_x(t) dx in three dimensions: the integral of the probability over the radius."""
    s = np.empty(t.size)
    c = np.empty(t.size)
    sines(r, t, s, c)
    return 4.0 * pi * _integral(r, t, w, s, c)
