"""The law of |e| for the linear model with its declared tolerances: uniform and triangular ones as they are.

    e = m + N(0, S) + sum_j h_j u_j,       u_j uniform or triangular on (-1, 1), independent

Exact by a lattice sum of the characteristic function (``lattice.py``).  A law with no column is Gaussian and goes to
``gaussian.py``.  A law too sharp for the lattice (its spread in some direction tiny beside r, or few bounded
sources and no noise) goes to randomised quasi-Monte-Carlo with one source integrated exactly (``sampling.py``).
Which it was, and how far off it may be, is part of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import NotConvergedError, Problem
from ..system import Array
from .ball import lattice_gradient
from .declared_kernels import build, mean_excess, on_principal_axes, probability, solve
from .gaussian import (
    norm_cdf,
    norm_cvar,
    norm_gradient_jit,
    norm_mean,
    norm_quantile_jit,
    norm_sf,
    probability_iv,
)
from .sampling import (
    RANDOMISATIONS,
    conditional_excess,
    conditional_probability,
    sample_rest,
    sampled_quantile,
)
from .spectrum import law_iv

UNIFORM, TRIANGULAR = 0, 1
GAUSSIAN_METHOD = "exact (Gaussian, contour integral)"
LATTICE_METHOD = "exact (characteristic function on a lattice)"
SAMPLED_METHOD = "randomised quasi-Monte-Carlo of the linear model"

# Terms smaller than this are left out of a lattice sum: for the answer itself, and for the many laws of a budget.
_FINE, _COARSE = 1e-9, 1e-6
_LARGEST_BOX = 2e6  # lattice points looked at (about 30 ms) before sampling takes over
_LARGEST_COARSE_BOX = 2e5
_LOG2_POINTS, _LOG2_COARSE = 12, 10


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
        variance = np.where(self.kinds == UNIFORM, 1 / 3, 1 / 6)
        return np.asarray(self.covariance + (self.columns * variance) @ self.columns.T)


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


@dataclass(frozen=True, slots=True)
class LawQuantile:
    """A quantile and how it was got.

    error_mm estimates the numerical error: for the lattice, the root sum of squares of the smallest decade of
    terms kept plus the bound of the aliasing; for sampling, one standard error over 16 randomisations.
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


def lattice_columns(law: LinearLaw) -> tuple[Array, NDArray[np.int64]]:
    """((K, 3) uniform columns, (K,) source of each): a triangular source is the sum of two uniform ones of half width.

    Columns of length zero are dropped.
    """
    rows = law.columns.T
    keep = np.flatnonzero((rows != 0).any(axis=1))
    source = np.concatenate([keep, keep[law.kinds[keep] == TRIANGULAR]])
    scale = np.where(law.kinds[source] == TRIANGULAR, 0.5, 1.0)
    return np.ascontiguousarray(rows[source] * scale[:, None]), source


def _tolerances(p: float, fine: bool) -> tuple[float, float, float]:
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
    found, r, density, error = solve(p, law.mean, law.covariance, h, *_tolerances(p, fine))
    if found:
        return LawQuantile(p, float(r), float(density), LATTICE_METHOD, float(error / density))
    x, longest = sample_rest(law.mean, law.covariance, h, _LOG2_POINTS if fine else _LOG2_COARSE)
    r, density, error = sampled_quantile(p, x, longest)
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
    found, value, _ = probability(r, law.mean, law.covariance, h, *_tolerances(0.5, fine))
    if found:
        return float(value)
    x, longest = sample_rest(law.mean, law.covariance, h, _LOG2_POINTS if fine else _LOG2_COARSE)
    return float(conditional_probability(r, x, longest, RANDOMISATIONS).mean())


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
    # Out to the end of the law the box is several times larger, and the integral over r gains a factor 1/k.
    threshold, aliasing, largest = _tolerances(p, True)
    found, value = mean_excess(r, law.mean, law.covariance, h, 100.0 * threshold, 100.0 * aliasing, largest)
    if found:
        return float(value)
    x, longest = sample_rest(law.mean, law.covariance, h, _LOG2_POINTS)
    return float(conditional_excess(r, x, longest, RANDOMISATIONS).mean())


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


def without_group(law: LinearLaw, block: Array | None, indices: Sequence[int]) -> LinearLaw:
    """The law without a part of its Gaussian covariance (3, 3) and without the columns listed.

    Raises ValueError when the block is not a part of the covariance (the difference is not positive semidefinite).
    """
    covariance = law.covariance
    if block is not None:
        scale = float(np.trace(covariance))
        values, vectors = np.linalg.eigh(covariance - np.asarray(block, dtype=np.float64))
        if values[0] < -1e-9 * scale:
            raise ValueError(f"the block removed is not part of the covariance: eigenvalue {values[0]:.3g} remains")
        values[values < 1e-13 * scale] = 0.0  # what rounding leaves of a direction that was removed altogether
        covariance = (vectors * values) @ vectors.T
    keep = np.ones(law.kinds.size, dtype=bool)
    keep[list(indices)] = False
    return LinearLaw(law.mean, covariance, np.ascontiguousarray(law.columns[:, keep]), law.kinds[keep])


def _gradient(law: LinearLaw, h: Array, source: NDArray[np.int64], total: LawQuantile) -> tuple[Array, Array, Array]:
    """(dr/dmean, dr/dcovariance, dr/dlog column) by the implicit function theorem."""
    p, k = total.p, law.kinds.size
    if total.density == 0.0:
        size = float(np.linalg.norm(law.mean))
        return law.mean / size if size > 0 else np.zeros(3), np.zeros((3, 3)), np.zeros(k)
    if h.shape[0] == 0:
        _, _, dm, ds = norm_gradient_jit(law.mean, law.covariance, p)
        return dm, ds, np.zeros(k)
    sigma, m, S, turned, axes, dimension, offset = on_principal_axes(law.mean, law.covariance, h)
    rho = sqrt(max(total.quantile_mm**2 - offset, 0.0))
    # A decade below the budget's own threshold: derivatives weight the far terms by up to k^2 more.
    threshold, aliasing, largest = _tolerances(p, False)
    _, _, nodes, volume, _ = build(rho, sigma, m, m, S, turned, 0.1 * threshold, aliasing, largest, True)
    if volume == 0.0 or dimension < 3:
        return _differences(law, total)
    by_mean, by_covariance, by_column = lattice_gradient(rho, dimension, nodes, m, S, turned, volume)
    columns = np.zeros(k)
    np.add.at(columns, source, by_column)
    slope = -1.0 / total.density
    return slope * (axes @ by_mean), slope * (axes @ by_covariance @ axes.T), slope * columns


def _differences(law: LinearLaw, total: LawQuantile) -> tuple[Array, Array, Array]:
    """The same by differences: of one set of points (sampled laws), or of exact sums (laws in a plane or on a line)."""
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


def law_budget(law: LinearLaw, p: float, groups: Sequence[tuple[Array | None, Sequence[int]]]) -> LawBudget:
    """The p-quantile, its derivatives, and the quantile with each group removed.

    groups: (Gaussian covariance to remove (3, 3) mm^2 or None, indices of columns to remove).  Quantiles without a
    group are good to about 1e-4 of their value; ``error_mm`` of each says.  Raises ValueError as
    :func:`without_group`.
    """
    p = probability_iv(p)
    h, source = lattice_columns(law)
    total = _quantile(law, p, True)
    without = tuple(_quantile(without_group(law, block, indices), p, False) for block, indices in groups)
    return LawBudget(total, without, *_gradient(law, h, source, total))


def norm_quantile_of(law: LinearLaw, p: float) -> float:
    """The p-quantile of the Gaussian law with the same mean and covariance, mm."""
    return float(norm_quantile_jit(law.mean, law.total_covariance, probability_iv(p)))
