"""Compiled steps between a declared law and its lattice: principal axes, start, period, solution."""

from __future__ import annotations

from math import fabs, log, sqrt

import numpy as np
from numba import njit

from ..system import Array
from .ball import ball_integral, ball_sums
from .lattice import box_size, fold_small, gaussian_extent, lattice_terms, spectral_extent
from .quantile import norm_quantile_jit, normal_quantile_jit
from .spectrum import principal_axes

SMALL_BOX = 6e3  # lattice points below which the plain bound of the extent is cheaper than the search for the true one
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(80)


@njit(cache=True, error_model="numpy")
def on_principal_axes(mean: Array, covariance: Array, h: Array) -> tuple[Array, Array, Array, Array, Array, int, float]:
    """(sigma (3,), mean (3,), S (3, 3), h (K, 3), axes (3, 3), dimension, offset^2) on the total covariance's axes.

    Axes on which nothing varies have sigma 0, come last and are zeroed; offset is the length of the mean along them.
    """
    total = covariance.copy()
    for j in range(h.shape[0]):
        for a in range(3):
            for b in range(3):
                total[a, b] += h[j, a] * h[j, b] / 3.0
    variances, m, axes = principal_axes(mean, total)
    S = axes.T @ covariance @ axes
    turned = h @ axes
    sigma = np.sqrt(variances)
    dimension = 0
    offset = 0.0
    for a in range(3):
        if sigma[a] > 0.0:
            dimension += 1
        else:
            offset += m[a] * m[a]
            m[a] = 0.0
            S[a, :] = 0.0
            S[:, a] = 0.0
            turned[:, a] = 0.0
    return sigma, m, S, turned, axes, dimension, offset


@njit(cache=True, error_model="numpy")
def start_radius(p: float, sigma: Array, m: Array, h: Array) -> float:
    """Pearson's three cumulants of ``approximation.py``, on principal axes; never below a hundredth of the rms."""
    c1 = 0.0
    c2 = 0.0
    c3 = 0.0
    for a in range(3):
        v = sigma[a] * sigma[a]
        mm = m[a] * m[a]
        c1 += v + mm
        c2 += v * (v + 2.0 * mm)
        c3 += v * v * (v + 3.0 * mm)
    for j in range(h.shape[0]):
        gg = 0.0
        gm = 0.0
        gsg = 0.0
        for a in range(3):
            gg += h[j, a] * h[j, a]
            gm += h[j, a] * m[a]
            gsg += (h[j, a] * sigma[a]) ** 2
        c2 -= gg * gg / 15.0
        c3 += (-1.6 * gg * (gsg + gm * gm) + 16.0 / 63.0 * gg * gg * gg) / 8.0
    root = sqrt(c2)
    gamma = c3 / (c2 * root)
    b = sqrt(2.0) / 3.0 * normal_quantile_jit(p) - gamma * 2.0 / 9.0
    w = gamma * b
    square = c1 + root * b * (3.0 + 3.0 * w + w * w)
    return sqrt(max(square, 1e-4 * c1))


@njit(cache=True, error_model="numpy")
def reach_of(sigma: Array, S: Array, h: Array, aliasing: float) -> Array:
    """(3,) distance from the mean that each coordinate exceeds with total probability below `aliasing`."""
    c = sqrt(2.0 * log(6.0 / aliasing))
    reach = np.zeros(3)
    for a in range(3):
        bounded = c * sqrt(max(S[a, a], 0.0))
        for j in range(h.shape[0]):
            bounded += fabs(h[j, a])
        reach[a] = min(c * sigma[a], bounded)
    return reach


@njit(cache=True, error_model="numpy")
def build(
    radius: float,
    sigma: Array,
    m: Array,
    away: Array,
    S: Array,
    h: Array,
    threshold: float,
    aliasing: float,
    largest_box: float,
    keep: bool,
) -> tuple[Array, Array, Array, float, float]:
    """(t (n,), w (n,), k (n, 3) or empty, volume, last decade) for radii up to `radius`; volume 0: too many points.

    away: (3,) the farthest each mean coordinate may lie from 0 when k is used with other means than m.
    """
    dimension = 0
    for a in range(3):
        if sigma[a] > 0.0:
            dimension += 1
    S, h, small = fold_small(S, h, threshold)
    reach = reach_of(sigma, S, h, aliasing)
    period = np.zeros(3)
    volume = 1.0
    for a in range(dimension):
        period[a] = radius + max(fabs(m[a]), away[a]) + reach[a]
        volume *= period[a]
    extent = gaussian_extent(radius, volume, S, threshold)
    size = box_size(period, extent) if np.isfinite(extent).all() else np.inf
    if size > SMALL_BOX:  # worth the search for the true extent of all factors together
        extent = spectral_extent(radius, volume, sigma, S, h, threshold)
        size = box_size(period, extent)
    if not size < largest_box:
        return np.empty(0), np.empty(0), np.empty((0, 3)), 0.0, 0.0
    capacity = int(size) + 2
    t = np.empty(capacity)
    w = np.empty(capacity)
    k = np.zeros((capacity if keep else 0, 3))
    n, decade = lattice_terms(period, extent, radius, m, S, h, small, threshold, t, w, k)
    return t[:n], w[:n], k[:n], volume, decade


@njit(cache=True, error_model="numpy")
def solve(
    p: float, mean: Array, covariance: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[bool, float, float, float]:
    """(found, r, density, error of the probability) at the p-quantile; found is False when the lattice is too large."""
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    rho = start_radius(p, sigma, m, turned)
    cap = 1.08 * rho
    t, w, _, volume, decade = build(cap, sigma, m, m, S, turned, threshold, aliasing, largest_box, False)
    low = 0.0
    for _ in range(60):
        if volume == 0.0:
            return False, 0.0, 0.0, 0.0
        f0, f1, f2 = ball_sums(rho, dimension, t, w)
        g = f0 - p
        if g < 0.0:
            low = max(low, rho)
        v = -g / f1 if f1 > 0.0 else (0.3 * rho if g < 0.0 else -0.3 * rho)
        bend = 0.5 * f2 * v / f1 if f1 > 0.0 else 0.0
        step = v / (1.0 + bend) if fabs(bend) < 0.5 else v
        new = rho + step
        if new <= low and g > 0.0:
            new = 0.5 * (low + rho)
        if new > cap:
            new = min(new, 1.5 * cap)
            cap = 1.2 * new
            rho = new
            t, w, _, volume, decade = build(cap, sigma, m, m, S, turned, threshold, aliasing, largest_box, False)
            continue
        step = new - rho
        rho = new
        if fabs(step) < 1e-4 * rho and fabs(bend) < 0.5:  # Halley: the next step would be of the order of its cube
            r = sqrt(rho * rho + offset)
            density = (f1 + step * f2) * r / rho
            return True, r, density, aliasing + decade + 1e-14
    return False, 0.0, 0.0, 0.0


@njit(cache=True, error_model="numpy")
def probability(
    r: float, mean: Array, covariance: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[bool, float, float]:
    """(found, P(|e| <= r), density at r)."""
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    if r * r <= offset:
        return True, 0.0, 0.0
    rho = sqrt(r * r - offset)
    reach = reach_of(sigma, S, turned, aliasing)
    if rho >= sqrt(((np.abs(m) + reach) ** 2).sum()):
        return True, 1.0, 0.0
    t, w, _, volume, _ = build(rho, sigma, m, m, S, turned, threshold, aliasing, largest_box, False)
    if volume == 0.0:
        return False, 0.0, 0.0
    f0, f1, _ = ball_sums(rho, dimension, t, w)
    return True, min(max(f0, 0.0), 1.0), max(f1, 0.0) * r / rho


@njit(cache=True, error_model="numpy")
def vertex_probabilities(
    r: float,
    mean: Array,
    covariance: Array,
    h: Array,
    bounded: Array,
    count: int,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[bool, Array]:
    """(found, P(|e + B s| <= r) for the first `count` sign vectors s (count,)); bounded: (3, q).

    Vertex v has s_j = -1 where bit j of v is set.  Only cos(k'(m + B s)) differs between vertices.  They are visited
    in Gray code order, so that the next phase is the last one turned by +-2 k'b_j: no cosine, four multiplications.
    found is False when the lattice is too large or the law lies in a plane or on a line.
    """
    q = bounded.shape[1]
    sigma, m, S, turned, axes, dimension, _ = on_principal_axes(mean, covariance, h)
    out = np.zeros(count)
    if dimension < 3:
        return False, out
    b = axes.T @ bounded
    away = np.abs(m)
    for a in range(3):
        for j in range(q):
            away[a] += fabs(b[a, j])
    t, w, k, volume, _ = build(r, sigma, np.zeros(3), away, S, turned, threshold, aliasing, largest_box, True)
    if volume == 0.0:
        return False, out
    n = t.size
    re = np.empty(n)
    im = np.empty(n)
    turn_c = np.empty((q, n))
    turn_s = np.empty((q, n))
    one_t = np.empty(1)
    one_w = np.ones(1)
    for i in range(n):
        phase = k[i, 0] * m[0] + k[i, 1] * m[1] + k[i, 2] * m[2]
        for j in range(q):
            along = k[i, 0] * b[0, j] + k[i, 1] * b[1, j] + k[i, 2] * b[2, j]
            phase += along
            turn_c[j, i] = np.cos(2.0 * along)
            turn_s[j, i] = np.sin(2.0 * along)
        one_t[0] = t[i]
        ball, _, _ = ball_sums(r, 3, one_t, one_w)
        re[i] = w[i] * ball * np.cos(phase)
        im[i] = w[i] * ball * np.sin(phase)
    code = 0
    for step in range(1 << q):
        if code < count:
            total = 0.0
            for i in range(n):
                total += re[i]
            out[code] = total
        if step + 1 == 1 << q:
            break
        j = 0
        while ((step + 1) >> j) & 1 == 0:
            j += 1
        sign = -1.0 if (code >> j) & 1 == 0 else 1.0  # from +1 to -1 turns the phase back
        code ^= 1 << j
        line_c = turn_c[j]
        line_s = turn_s[j]
        for i in range(n):
            x = re[i]
            y = im[i]
            c = line_c[i]
            s = sign * line_s[i]
            re[i] = x * c - y * s
            im[i] = x * s + y * c
    return True, out


@njit(cache=True, error_model="numpy")
def gaussian_vertices(p: float, mean: Array, covariance: Array, bounded: Array, count: int) -> Array:
    """(count,) p-quantiles of |N(m + B s, S)|, vertices numbered as above; NaN where one did not converge."""
    out = np.empty(count)
    at = np.empty(3)
    for v in range(count):
        for a in range(3):
            at[a] = mean[a]
            for j in range(bounded.shape[1]):
                at[a] += -bounded[a, j] if (v >> j) & 1 else bounded[a, j]
        out[v] = norm_quantile_jit(at, covariance, p)
    return out


@njit(cache=True, error_model="numpy")
def mean_excess(
    r: float, mean: Array, covariance: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[bool, float]:
    """(found, E[(|e| - r)+]) = int_r^R (1 - P(|e| <= x)) dx, with R beyond every |e| but a fraction `aliasing`."""
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    reach = reach_of(sigma, S, turned, aliasing)
    end = sqrt(((np.abs(m) + reach) ** 2).sum())
    outer = sqrt(end * end + offset)
    if r >= outer:
        return True, 0.0
    t, w, _, volume, _ = build(end, sigma, m, m, S, turned, threshold, aliasing, largest_box, False)
    if volume == 0.0:
        return False, 0.0
    if dimension == 3:
        return True, outer - r - ball_integral(outer, t, w) + ball_integral(r, t, w)
    # The radius in the reduced space is sqrt(x^2 - offset), smooth in theta where x = below + span sin^2(theta).
    below = max(r, sqrt(offset))
    span = outer - below
    total = 0.0
    for i in range(_NODES.size):
        theta = 0.25 * np.pi * (1.0 + _NODES[i])
        x = below + span * np.sin(theta) ** 2
        f0, _, _ = ball_sums(sqrt(max(x * x - offset, 0.0)), dimension, t, w)
        total += _WEIGHTS[i] * (1.0 - f0) * np.sin(2.0 * theta)
    return True, max(below - r, 0.0) + 0.25 * np.pi * span * total
