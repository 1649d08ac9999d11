"""Between a declared law and its lattice: principal axes, start, period, solution, and what is read off it.

Whatever contains the lattice costs seconds to compile: that is :func:`build` and :func:`solve_on_axes` here, which the
plain functions call; more of them only where a loop needs it.

Derivatives are those of the probability by the mean, the covariance and every column's length.

The law of |e| for the linear model with its declared tolerances: uniform and triangular ones as they are.

    e = m + N(0, S) + sum_j h_j u_j,       u_j uniform or triangular on (-1, 1), independent

Exact by a lattice sum of the characteristic function (``lattice.py``).  A law with no column is Gaussian and goes to
``gaussian.py``.  A law too sharp for the lattice (its spread in some direction tiny beside r, or few bounded
sources and no noise) goes to randomised quasi-Monte-Carlo with one source integrated exactly (``sampling.py``).
Which it was, and how far off it may be, is part of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, exp, fabs, log, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import NotConvergedError, Problem
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel
from .contour import cumulant
from .elementary import sine_and_cosine
from .gaussian import (
    excess_quantile,
    norm_cdf,
    norm_cvar,
    norm_gradient_jit,
    norm_mean,
    norm_quantile_jit,
    norm_sf,
    normal_quantile_jit,
    probability_iv,
)
from .lattice import (
    LOG_SINC,
    ball_integral,
    ball_sums,
    balls,
    box_size,
    fold_small,
    gaussian_extent,
    lattice_terms,
    rows_where,
    spectral_extent,
    sum_of_products,
)
from .sampling import sample
from .spectrum import law_iv, principal_axes

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


UNIFORM, TRIANGULAR = 0, 1
_VARIANCES = np.array([1 / 3, 1 / 6])


@dataclass(frozen=True, slots=True, eq=False)
class LinearLaw:
    """e = mean + N(0, covariance) + columns @ u, in mm; any frame, the same for all three.

    columns are already multiplied by the half-widths: column j is the displacement at u_j = 1.
    """

    mean: Array  # (3,) mm
    covariance: Array  # (3, 3) mm^2: the Gaussian part only
    columns: Array  # (3, k) mm
    kinds: NDArray[np.int64]  # (k,) UNIFORM or TRIANGULAR

    @property
    def total_covariance(self) -> Array:
        """(3, 3) mm^2, bounded sources included."""
        return np.asarray(self.covariance + (self.columns * _VARIANCES[self.kinds]) @ self.columns.T)


def linear_law(
    mean: Array, covariance: Array, columns: Array | None = None, kinds: Sequence[int] | None = None
) -> LinearLaw:
    """A checked :class:`LinearLaw`; columns (3, k) mm and kinds (k,) default to none and to uniform.

    Raises ValueError for wrong shapes, values that are not finite, or a covariance that is not one.
    """
    mean, covariance = law_iv(mean, covariance)
    columns = np.zeros((3, 0)) if columns is None else np.asarray(columns, dtype=np.float64)
    if columns.ndim != 2 or columns.shape[0] != 3:
        raise ValueError(f"columns must have shape (3, k), got {columns.shape}")
    if not np.isfinite(columns).all():
        raise ValueError("columns must be finite")
    kind_array = np.zeros(columns.shape[1], dtype=np.int64) if kinds is None else np.asarray(kinds, dtype=np.int64)
    if kind_array.shape != (columns.shape[1],):
        raise ValueError(f"kinds must have shape ({columns.shape[1]},), got {kind_array.shape}")
    if not np.isin(kind_array, (UNIFORM, TRIANGULAR)).all():
        raise ValueError(f"kinds are {UNIFORM} (uniform) or {TRIANGULAR} (triangular), got {kind_array.tolist()}")
    return LinearLaw(mean, covariance, np.ascontiguousarray(columns), kind_array)


@kernel()
def uniform_columns(columns: Array, kinds: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """:func:`lattice_columns` of columns (3, k) and their kinds (k,)."""
    count = kinds.size
    kept = 0
    split = 0
    for j in range(count):
        if columns[0, j] != 0.0 or columns[1, j] != 0.0 or columns[2, j] != 0.0:
            kept += 1
            if kinds[j] == TRIANGULAR:
                split += 1
    h = np.empty((kept + split, 3))
    source = np.empty(kept + split, dtype=np.int64)
    one = 0
    two = kept
    for j in range(count):
        if columns[0, j] != 0.0 or columns[1, j] != 0.0 or columns[2, j] != 0.0:
            scale = 0.5 if kinds[j] == TRIANGULAR else 1.0
            for a in range(3):
                h[one, a] = columns[a, j] * scale
            source[one] = j
            one += 1
            if kinds[j] == TRIANGULAR:
                for a in range(3):
                    h[two, a] = columns[a, j] * scale
                source[two] = j
                two += 1
    return h, source


def lattice_columns(law: LinearLaw) -> tuple[Array, NDArray[np.int64]]:
    """((K, 3) uniform columns, (K,) source of each): a triangular source is the sum of two uniform ones of half width.

    Columns of length zero are dropped.
    """
    h, source = uniform_columns(law.columns, law.kinds)
    return h, source


__all__ = [
    "GAUSSIAN_METHOD",
    "LATTICE_METHOD",
    "SAMPLED_METHOD",
    "TRIANGULAR",
    "UNIFORM",
    "LawBudget",
    "LawQuantile",
    "LawSummary",
    "LinearLaw",
    "lattice_columns",
    "law_budget",
    "law_cdf",
    "law_cdf_coarse",
    "law_cvar",
    "law_exceedance",
    "law_mean_norm",
    "law_quantile",
    "law_quantile_coarse",
    "law_summary",
    "linear_law",
    "norm_quantile_of",
    "without_group",
]

GAUSSIAN_METHOD = "exact (Gaussian, contour integral)"
LATTICE_METHOD = "exact (characteristic function on a lattice)"
SAMPLED_METHOD = "randomised quasi-Monte-Carlo of the linear model"

# Terms smaller than this are left out of a lattice sum: for the answer itself, and for the many laws of a budget.
_FINE, _COARSE = 5e-10, 4e-7
_LARGEST_BOX = 2e6  # lattice points looked at (about 30 ms) before sampling takes over
_LARGEST_COARSE_BOX = 2e5
_LOG2_POINTS, _LOG2_COARSE = 12, 10


class LawQuantile(NamedTuple):
    """A quantile and how it was got.

    error_mm estimates the numerical error: for the lattice, the root sum of squares of the smallest decade of
    terms kept plus the bound of the aliasing; for sampling, one standard error over 16 randomisations and what taking
    small columns as Gaussian may change.
    """

    p: float
    quantile_mm: float
    density: float  # of |e| at the quantile, 1/mm; 0 for a law without spread
    method: str
    error_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class LawBudget:
    """What each part of a law does to its p-quantile r.

    dr_dlog_column[j]: mm per relative change of column j; divided by the half-width, mm per unit of half-width.
    For a Gaussian block B, ``sum(dr_dcovariance * B)`` is mm per relative change of its variance, and twice that is
    mm per relative change of its standard deviation.
    """

    total: LawQuantile
    without: tuple[LawQuantile, ...]  # one for each group removed
    dr_dmean: Array  # (3,)
    dr_dcovariance: Array  # (3, 3) 1/mm, symmetric
    dr_dlog_column: Array  # (k,) mm


def tolerances(p: float, fine: bool) -> tuple[float, float, float]:
    """(threshold of a term, bound of the aliasing, largest box); far tails need smaller absolute errors."""
    tail = min(p, 1.0 - p) / 0.05
    if fine:
        return _FINE * min(tail, 1.0), 1e-10 * min(tail, 1.0), _LARGEST_BOX
    return _COARSE * min(tail, 1.0), 1e-6 * min(tail, 1.0), _LARGEST_COARSE_BOX


def _gaussian_quantile(law: LinearLaw, p: float) -> LawQuantile:
    if not law.covariance.any():
        return LawQuantile(p, float(np.linalg.norm(law.mean)), 0.0, GAUSSIAN_METHOD, 0.0)
    r, density, _, _ = norm_gradient_jit(law.mean, law.covariance, p)
    if r != r:
        raise NotConvergedError(Problem("", "tail-not-converged", f"the Gaussian quantile did not converge for {law}"))
    return LawQuantile(p, float(r), float(density), GAUSSIAN_METHOD, 1e-12 * float(r))


def _quantile(law: LinearLaw, p: float, fine: bool) -> LawQuantile:
    h, _ = lattice_columns(law)
    if h.shape[0] == 0:
        return _gaussian_quantile(law, p)
    found, r, density, error = solve(p, law.mean, law.covariance, h, *tolerances(p, fine))
    if found:
        return LawQuantile(p, float(r), float(density), LATTICE_METHOD, float(error / density))
    points = sample(law.mean, law.covariance, h, _LOG2_POINTS if fine else _LOG2_COARSE)
    r, density, error = points.quantile(p)
    return LawQuantile(p, r, density, SAMPLED_METHOD, error)


def law_quantile(law: LinearLaw, p: float) -> LawQuantile:
    """The r with P(|e| <= r) = p.  Raises ValueError for p outside (0, 1)."""
    return _quantile(law, probability_iv(p), True)


def law_quantile_coarse(law: LinearLaw, p: float) -> LawQuantile:
    """As :func:`law_quantile`, to about 1e-4 and several times faster: for budgets and averages over many laws."""
    return _quantile(law, probability_iv(p), False)


def _cdf(law: LinearLaw, r: float, fine: bool) -> float:
    h, _ = lattice_columns(law)
    if h.shape[0] == 0:
        return norm_cdf(r, law.mean, law.covariance)
    found, value, _ = probability(r, law.mean, law.covariance, h, *tolerances(0.5, fine))
    if found:
        return float(value)
    return sample(law.mean, law.covariance, h, _LOG2_POINTS if fine else _LOG2_COARSE).probability(r)


def law_cdf(law: LinearLaw, r: float) -> float:
    """P(|e| <= r), r >= 0 mm; absolute error about 1e-8 (sampled laws: 1e-4).  Raises ValueError."""
    if not r >= 0:
        raise ValueError(f"a radius must be >= 0 mm, got {r}")
    return _cdf(law, float(r), True)


def law_cdf_coarse(law: LinearLaw, r: float) -> float:
    """As :func:`law_cdf`, to about 1e-4 and several times faster."""
    return _cdf(law, float(r), False)


def law_exceedance(law: LinearLaw, limit: float) -> float:
    """P(|e| > limit), limit >= 0 mm; absolute error about 1e-8, relative 1e-12 for Gaussian laws."""
    if law.columns.any():
        return 1.0 - law_cdf(law, limit)
    return norm_sf(limit, law.mean, law.covariance)


def _mean_excess(law: LinearLaw, h: Array, r: float, p: float) -> float:
    found, value = mean_excess(r, law.mean, law.covariance, h, *tolerances(p, True))
    if found:
        return float(value)
    return sample(law.mean, law.covariance, h, _LOG2_POINTS).excess(r)


def law_cvar(law: LinearLaw, p: float, quantile: LawQuantile | None = None) -> float:
    """E[|e| given |e| >= r_p], mm: the mean of the worst 1 - p; ``quantile`` is r_p where it is already known.

    Raises ValueError for p outside (0, 1).
    """
    p = probability_iv(p)
    h, _ = lattice_columns(law)
    if h.shape[0] == 0:
        return norm_cvar(p, law.mean, law.covariance)
    r = (_quantile(law, p, True) if quantile is None else quantile).quantile_mm
    return r + _mean_excess(law, h, r, p) / (1.0 - p)


def law_mean_norm(law: LinearLaw) -> float:
    """E|e|, mm."""
    h, _ = lattice_columns(law)
    if h.shape[0] == 0:
        return norm_mean(law.mean, law.covariance)
    return _mean_excess(law, h, 0.0, 0.5)


@dataclass(frozen=True, slots=True)
class LawSummary:
    """What a score says about a law, each to the accuracy of its own function."""

    quantile: LawQuantile
    mean_norm_mm: float
    cvar_mm: float
    exceedance: float | None  # of the limit; None without one


def law_summary(law: LinearLaw, p: float, limit: float | None = None, *, relaxed: float = 1.0) -> LawSummary:
    """:func:`law_quantile`, :func:`law_mean_norm`, :func:`law_cvar` and :func:`law_exceedance` from shared lattices.

    relaxed: how many times larger than theirs the numerical errors may be.  Raises ValueError for p outside (0, 1) or a
    limit below 0 mm.
    """
    p = probability_iv(p)
    if limit is not None and not limit >= 0:
        raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    h, _ = lattice_columns(law)
    if h.shape[0]:
        asked = np.nan if limit is None else float(limit)
        threshold, aliasing, largest_box = tolerances(p, True)
        found, r, density, error, mean_norm, excess, beyond = summary(
            p, asked, law.mean, law.covariance, h, relaxed * threshold, relaxed * aliasing, largest_box
        )
        if found:
            quantile = LawQuantile(p, float(r), float(density), LATTICE_METHOD, float(error / density))
            if limit is not None and beyond != beyond:
                beyond = law_exceedance(law, limit)
            exceedance = None if limit is None else float(beyond)
            return LawSummary(quantile, float(mean_norm), float(r + excess / (1.0 - p)), exceedance)
    quantile = _quantile(law, p, True)
    exceedance = None if limit is None else law_exceedance(law, limit)
    return LawSummary(quantile, law_mean_norm(law), law_cvar(law, p, quantile), exceedance)


def without_group(law: LinearLaw, block: Array | None, indices: Sequence[int]) -> LinearLaw:
    """The law without a part of its Gaussian covariance (3, 3) and without the columns listed.

    Raises ValueError when the block is not a part of the covariance (the difference is not positive semidefinite).
    """
    covariance = law.covariance
    if block is not None:
        covariance, least = less_block(law.covariance, np.asarray(block, dtype=np.float64))
        if least < -SLACK:
            raise ValueError(
                f"the block removed is not part of the covariance: eigenvalue {least:.3g} of its trace remains"
            )
    keep = np.ones(law.kinds.size, dtype=bool)
    keep[list(indices)] = False
    return LinearLaw(law.mean, covariance, np.ascontiguousarray(law.columns[:, keep]), law.kinds[keep])


def _gradient(
    law: LinearLaw, h: Array, source: NDArray[np.int64], total: LawQuantile, fine: bool
) -> tuple[Array, Array, Array]:
    """(dr/dmean, dr/dcovariance, dr/dlog column) by the implicit function theorem."""
    p, k = total.p, law.kinds.size
    if total.density == 0.0:
        size = float(np.linalg.norm(law.mean))
        return law.mean / size if size > 0 else np.zeros(3), np.zeros((3, 3)), np.zeros(k)
    if h.shape[0] == 0:
        _, _, dm, ds = norm_gradient_jit(law.mean, law.covariance, p)
        return dm, ds, np.zeros(k)
    if total.method == SAMPLED_METHOD:
        return _sampled_gradient(law, h, source, total)
    sigma, m, S, turned, axes, dimension, _ = on_principal_axes(law.mean, law.covariance, h)
    if dimension < 3:
        return _differences(law, total)
    # A decade below the budget's own threshold: derivatives weight the far terms by up to k^2 more.
    threshold, aliasing, largest = tolerances(p, fine)
    _, _, nodes, volume, _ = build(total.quantile_mm, sigma, m, m, S, turned, 0.1 * threshold, aliasing, largest, True)
    if volume == 0.0:
        return _sampled_gradient(law, h, source, total)
    by_mean, by_covariance, by_column = lattice_gradient(
        total.quantile_mm, nodes, volume, m, S, turned, 0.1 * threshold
    )
    columns = np.zeros(k)
    np.add.at(columns, source, by_column)
    slope = -1.0 / total.density
    return slope * (axes @ by_mean), slope * (axes @ by_covariance @ axes.T), slope * columns


def _sampled_gradient(
    law: LinearLaw, h: Array, source: NDArray[np.int64], total: LawQuantile
) -> tuple[Array, Array, Array]:
    """The same from one sample, where no lattice is small enough."""
    points = sample(law.mean, law.covariance, h, _LOG2_POINTS)
    by_mean, by_covariance, by_column = points.gradient(total.quantile_mm, h)
    columns = np.zeros(law.kinds.size)
    np.add.at(columns, source, by_column)
    return by_mean, by_covariance, columns


def _differences(law: LinearLaw, total: LawQuantile) -> tuple[Array, Array, Array]:
    """The same by differences of exact sums, for laws in a plane or on a line."""
    k = law.kinds.size
    spread = sqrt(float(np.trace(law.total_covariance)))
    step = 1e-2

    def quantile(mean: Array, covariance: Array, columns: Array) -> float:
        return _quantile(LinearLaw(mean, covariance, columns, law.kinds), total.p, True).quantile_mm

    dm = np.zeros(3)
    for a in range(3):
        shift = np.zeros(3)
        shift[a] = step * spread
        upper = quantile(law.mean + shift, law.covariance, law.columns)
        dm[a] = (upper - quantile(law.mean - shift, law.covariance, law.columns)) / (2 * step * spread)
    ds = np.zeros((3, 3))
    small = (step * spread) ** 2
    for a in range(3):
        for b in range(a + 1):  # one-sided along v v': a covariance may only be added to safely
            v = np.zeros(3)
            v[a] = v[b] = 1.0
            more = quantile(law.mean, law.covariance + small * np.outer(v, v), law.columns)
            ds[a, b] = (more - total.quantile_mm) / small
    for a in range(3):
        for b in range(a):
            ds[a, b] = ds[b, a] = 0.5 * (ds[a, b] - ds[a, a] - ds[b, b])
    dh = np.zeros(k)
    for j in range(k):
        longer, shorter = law.columns.copy(), law.columns.copy()
        longer[:, j] *= 1 + step
        shorter[:, j] *= 1 - step
        difference = quantile(law.mean, law.covariance, longer) - quantile(law.mean, law.covariance, shorter)
        dh[j] = difference / (2 * step)
    return dm, ds, dh


def law_budget(
    law: LinearLaw, p: float, groups: Sequence[tuple[Array | None, Sequence[int]]], total: LawQuantile | None = None
) -> LawBudget:
    """The p-quantile, its derivatives, and the quantile with each group removed.

    groups: (Gaussian covariance to remove (3, 3) mm^2 or None, indices of columns to remove).  total: the p-quantile
    where it is already known.  Quantiles without a group are good to about 1e-4 of their value; ``error_mm`` of each
    says.  Raises ValueError as :func:`without_group`.
    """
    p = probability_iv(p)
    h, source = lattice_columns(law)
    if total is None:
        total = _quantile(law, p, True)
    return LawBudget(total, _without(law, p, h, source, groups, total), *_gradient(law, h, source, total, False))


def law_gradient(law: LinearLaw, p: float) -> LawBudget:
    """The p-quantile and its derivatives, those as exact as the quantile itself: to drive an optimiser."""
    p = probability_iv(p)
    h, source = lattice_columns(law)
    total = _quantile(law, p, True)
    return LawBudget(total, (), *_gradient(law, h, source, total, True))


def _without(
    law: LinearLaw,
    p: float,
    h: Array,
    source: NDArray[np.int64],
    groups: Sequence[tuple[Array | None, Sequence[int]]],
    total: LawQuantile,
) -> tuple[LawQuantile, ...]:
    """The coarse p-quantile without each group."""
    if not groups:
        return ()
    blocks = np.zeros((len(groups), 3, 3))
    removed = np.zeros((len(groups), law.kinds.size), dtype=bool)
    for g, (block, indices) in enumerate(groups):
        if block is not None:
            blocks[g] = block
        removed[g, list(indices)] = True
    how, r, density, error = quantiles_without(
        p, law.mean, law.covariance, h, blocks, removed.take(source, axis=1), total.quantile_mm, *tolerances(p, False)
    )
    found = []
    for g, group in enumerate(groups):
        if how[g] in (LATTICE, GAUSSIAN):
            method = LATTICE_METHOD if how[g] == LATTICE else GAUSSIAN_METHOD
            found.append(LawQuantile(p, float(r[g]), float(density[g]), method, float(error[g])))
        else:  # sampled, or refused with the reason
            found.append(_quantile(without_group(law, *group), p, False))
    return tuple(found)


def norm_quantile_of(law: LinearLaw, p: float) -> float:
    """The p-quantile of the Gaussian law with the same mean and covariance, mm."""
    return float(norm_quantile_jit(law.mean, law.total_covariance, probability_iv(p)))


LATTICE, GAUSSIAN, UNSOLVED, NOT_A_PART = 0, 1, 2, 3
SLACK, ROUNDING = 1e-9, 1e-13  # of the trace: how negative an eigenvalue may be, and what is 0


@kernel()
def less_block(covariance: Array, block: Array) -> tuple[Array, float]:
    """(covariance - block (3, 3), its smallest eigenvalue over the trace of the covariance).

    What rounding leaves of a direction that was removed altogether is 0.
    """
    scale = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    values, vectors, _ = eigen_symmetric(covariance - block)
    least = values[2] / scale if scale > 0.0 else values[2]
    out = np.zeros((3, 3))
    for i in range(3):
        if values[i] >= ROUNDING * scale:
            for a in range(3):
                for b in range(3):
                    out[a, b] += values[i] * vectors[a, i] * vectors[b, i]
    return out, least


@kernel()
def _gaussian(p: float, mean: Array, covariance: Array) -> tuple[int, float, float, float]:
    variances, m, _ = principal_axes(mean, covariance)
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if variances[0] == 0.0:
        return GAUSSIAN, size, 0.0, 0.0
    d, density, converged = excess_quantile(p, variances, m)
    r = sqrt(max(size * size + d, 0.0))
    return (GAUSSIAN if converged else UNSOLVED), r, 2.0 * r * density, 1e-12 * r


@kernel(nogil=True)
def quantiles_without(
    p: float,
    mean: Array,
    covariance: Array,
    h: Array,
    blocks: Array,
    gone: NDArray[np.bool_],
    at: float,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """(how (G,), p-quantile (G,), density (G,), error of the quantile (G,)) of the law without each of G groups.

    h: (K, 3); blocks (G, 3, 3): Gaussian covariance to remove, zeros for none; gone (G, K): columns to remove; at: the
    quantile of the whole law, or 0 if unknown: it calibrates the starts.  how: LATTICE or GAUSSIAN, UNSOLVED (too
    large a lattice, or not converged), NOT_A_PART (a block that is no part of the covariance).
    """
    count = blocks.shape[0]
    how = np.empty(count, dtype=np.int64)
    r = np.zeros(count)
    density = np.zeros(count)
    error = np.zeros(count)
    ratio = 1.0
    if at > 0.0 and h.shape[0] > 0:
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
        if at * at > offset:
            ratio = sqrt(at * at - offset) / start_radius(p, sigma, m, turned)
    for g in range(count):
        rest = covariance
        if blocks[g].any():
            rest, least = less_block(covariance, blocks[g])
            if least < -SLACK:
                how[g] = NOT_A_PART
                continue
        kept = rows_where(h, gone[g], False)
        if kept.shape[0] == 0:
            how[g], r[g], density[g], error[g] = _gaussian(p, mean, rest)
            continue
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, rest, kept)
        start = ratio * start_radius(p, sigma, m, turned)
        found, rho, slope, doubt, _, _, _ = solve_on_axes(
            p, start, sigma, m, S, turned, dimension, threshold, aliasing, largest_box
        )
        how[g] = LATTICE if found else UNSOLVED
        if found:
            r[g] = sqrt(rho * rho + offset)
            density[g] = slope * r[g] / rho
            error[g] = doubt / density[g]
    return how, r, density, error
