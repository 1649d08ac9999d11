"""Between a declared law and its lattice: principal axes, start, period, solution, and what is read off it.

Whatever contains the lattice costs seconds to compile: that is :func:`build` and :func:`solve_on_axes` here, which the
plain functions call; more of them only where a loop needs it.

Derivatives are those of the probability by the mean, the covariance and every column's length.
"""

from __future__ import annotations

from math import cos, exp, fabs, log, sin, sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .contour import cumulant
from .elementary import sine_and_cosine
from .gaussian import normal_quantile_jit
from .lattice import ball_integral, ball_sums, balls, box_size, gaussian_extent, lattice_terms, spectral_extent
from .series import LOG_SINC, fold_small, rows_where, sum_of_products
from .spectrum import principal_axes

SMALL_BOX = 1e3  # lattice points below which the plain bound of the extent is cheaper than the search for the true one
_FORGIVEN, _END = 30.0, 1e3  # how much coarser integrals over the radius are: threshold, probability beyond
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(80)


@kernel()
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


@kernel()
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


@kernel()
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


@kernel()
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
    S, short, degree = fold_small(S, h, threshold)
    small, h = rows_where(h, short, True), rows_where(h, short, False)
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
    n, decade = lattice_terms(period, extent, radius, m, S, h, small, degree, threshold, t, w, k)
    return t[:n], w[:n], k[:n], volume, decade


@kernel()
def solve_on_axes(
    p: float,
    rho: float,
    sigma: Array,
    m: Array,
    S: Array,
    h: Array,
    dimension: int,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[bool, float, float, float, float, Array, Array]:
    """(found, radius, density by it, error of the probability, largest radius of the lattice, its t (n,), w (n,)).

    On principal axes (:func:`on_principal_axes`), from a start rho > 0; not found when the lattice is too large.
    """
    cap = 1.08 * rho
    t, w, _, volume, decade = build(cap, sigma, m, m, S, h, threshold, aliasing, largest_box, False)
    low = 0.0
    for _ in range(60):
        if volume == 0.0:
            break
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
            t, w, _, volume, decade = build(cap, sigma, m, m, S, h, threshold, aliasing, largest_box, False)
            continue
        step = new - rho
        rho = new
        if fabs(step) < 1e-4 * rho and fabs(bend) < 0.5:  # Halley: the next step would be of the order of its cube
            return True, rho, f1 + step * f2, aliasing + decade + 1e-14, cap, t, w
    return False, 0.0, 0.0, 0.0, 0.0, t, w


def solve(
    p: float, mean: Array, covariance: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[bool, float, float, float]:
    """(found, r, density, error of the probability) at the p-quantile; found is False when the lattice is too large."""
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    start = start_radius(p, sigma, m, turned)
    found, rho, density, error, _, _, _ = solve_on_axes(
        p, start, sigma, m, S, turned, dimension, threshold, aliasing, largest_box
    )
    if not found:
        return False, 0.0, 0.0, 0.0
    r = sqrt(rho * rho + offset)
    return True, r, density * r / rho, error


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


@kernel()
def end_of(sigma: Array, m: Array, reach: Array, probability: float) -> float:
    """A radius on principal axes that |e| exceeds with this probability at most.

    The corner of the box of reaches (:func:`reach_of`, which bounded sources make finite), or Chernoff's bound of the
    Gaussian law, whichever is nearer.  The law is strictly sub-Gaussian: with z ~ N(0, I),
    ``E exp(s |e|^2) = E exp(sqrt(2 s) z'e)`` is at most what the Gaussian law of equal mean and covariance has.  On
    the curve ``d = k'(s)`` the bound is ``exp(k(s) - s k'(s))``, which falls as s grows.
    """
    variances = sigma * sigma
    goal = log(probability)
    low = 0.0
    high = 0.5 / variances[0]
    for _ in range(30):
        s = 0.5 * (low + high)
        k0, d, _, _ = cumulant(s, variances, m)
        if k0 - s * d > goal:
            low = s
        else:
            high = s
    _, d, _, _ = cumulant(high, variances, m)
    corner = ((np.abs(m) + reach) ** 2).sum()
    return sqrt(min((m * m).sum() + d, corner))


@kernel()
def excess_integral(low: float, high: float, dimension: int, offset: float, t: Array, w: Array) -> float:
    """int_low^high P(|e| > x) dx from a lattice for radii up to `high`; offset as :func:`on_principal_axes` has it."""
    if dimension == 3:
        return high - low - ball_integral(high, t, w) + ball_integral(low, t, w)
    # The radius in the reduced space is sqrt(x^2 - offset), smooth in theta where x = below + span sin^2(theta).
    below = max(low, sqrt(offset))
    span = high - below
    total = 0.0
    for i in range(_NODES.size):
        theta = 0.25 * np.pi * (1.0 + _NODES[i])
        x = below + span * np.sin(theta) ** 2
        f0, _, _ = ball_sums(sqrt(max(x * x - offset, 0.0)), dimension, t, w)
        total += _WEIGHTS[i] * (1.0 - f0) * np.sin(2.0 * theta)
    return max(below - low, 0.0) + 0.25 * np.pi * span * total


def _outer_lattice(
    sigma: Array, m: Array, S: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[float, Array, Array, float]:
    """(radius at the end of the law, t (n,), w (n,), volume; 0: too many points) for integrals of the probability.

    The box is larger out there, but an integral over the radius forgives: of its terms the far ones gain a factor 1/k,
    and of what lies beyond the end, or comes in from other copies, only the last step counts.
    """
    end = end_of(sigma, m, reach_of(sigma, S, h, _END * aliasing), _END * aliasing)
    t, w, _, volume, _ = build(end, sigma, m, m, S, h, _FORGIVEN * threshold, _END * aliasing, largest_box, False)
    return end, t, w, volume


def mean_excess(
    r: float, mean: Array, covariance: Array, h: Array, threshold: float, aliasing: float, largest_box: float
) -> tuple[bool, float]:
    """(found, E[(|e| - r)+]) = int_r^R (1 - P(|e| <= x)) dx, R at the end of the law."""
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    end, t, w, volume = _outer_lattice(sigma, m, S, turned, threshold, aliasing, largest_box)
    outer = sqrt(end * end + offset)
    if r >= outer:
        return True, 0.0
    if volume == 0.0:
        return False, 0.0
    return True, excess_integral(r, outer, dimension, offset, t, w)


def summary(
    p: float,
    limit: float,
    mean: Array,
    covariance: Array,
    h: Array,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[bool, float, float, float, float, float, float]:
    """(found, r, density, error of the probability, E|e|, E[(|e| - r)+], P(|e| > limit)) at the p-quantile r.

    One lattice serves quantile and limit, one (coarser, out to the end of the law) the two means.  The last is NaN
    where the limit is beyond the first lattice but not beyond the law; found is False when a lattice is too large.
    """
    sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
    corner = ((np.abs(m) + reach_of(sigma, S, turned, aliasing)) ** 2).sum()
    start = start_radius(p, sigma, m, turned)
    found, rho, density, error, cap, t, w = solve_on_axes(
        p, start, sigma, m, S, turned, dimension, threshold, aliasing, largest_box
    )
    if not found:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = sqrt(rho * rho + offset)
    beyond = np.nan
    if limit * limit <= offset:
        beyond = 1.0
    elif limit * limit - offset >= corner:
        beyond = 0.0
    elif sqrt(limit * limit - offset) <= cap:
        f0, _, _ = ball_sums(sqrt(limit * limit - offset), dimension, t, w)
        beyond = min(max(1.0 - f0, 0.0), 1.0)
    end, t, w, volume = _outer_lattice(sigma, m, S, turned, threshold, aliasing, largest_box)
    outer = sqrt(end * end + offset)
    if volume == 0.0:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mean_norm = excess_integral(0.0, outer, dimension, offset, t, w)
    excess = excess_integral(r, outer, dimension, offset, t, w) if r < outer else 0.0
    return True, r, density * r / rho, error, mean_norm, excess, beyond


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
