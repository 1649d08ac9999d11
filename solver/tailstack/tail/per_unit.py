"""Risk per unit: the installation is drawn once and stays, noise is drawn again at each shot.

A unit has its own offset ``d = m + N(0, S_unit) + columns u``; its shots scatter about it by the shot law.  Its own
p-quantile over shots is ``R(d)``, the p-quantile of |d + shot|.  Asked for: the *yield* P_d(R(d) <= limit), and the
95th percentile of R(d) over units.  Both by scrambled Sobol points in d, 16 independent scramblings for a standard
error.

Most units need no quantile: with r_s the p-quantile of |shot| and, for a Gaussian shot, s(d) its p-quantile along d,

    |d| + s(d) <= R(d) <= |d| + r_s     for p >= 1/2,

the left because the ball of radius R lies in the half-space x'd <= R |d|, the right by the triangle inequality.  Only
units in between are solved, with the exact Gaussian law of the shot.

The fraction of units with |d| <= y is known exactly (the law of |d| is in ``declared.py``).  With y where units begin
to fail, it differs from the yield's indicator for few units only: as a control variate of coefficient 1 it removes
most of the sampling error.

A shot with bounded columns is taken as the Gaussian of equal covariance and then corrected: at twelve units near the
limit (or the percentile) the declared law of d + shot is solved, and the mean difference shifts the level.  What that
leaves, the spread of the difference over those units, is added to the standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..system import Array
from .declared import LinearLaw, lattice_columns, law_cdf_coarse, law_quantile_coarse
from .gaussian import norm_law_jit, probability_iv
from .quantile import norm_quantile_jit, normal_quantile_jit
from .sampling import RANDOMISATIONS, sobol_points
from .spectrum import principal_axes

_CORRECTED = 12


@dataclass(frozen=True, slots=True)
class UnitRisk:
    """yield_fraction and its standard error are None without a limit."""

    p: float
    limit_mm: float | None
    yield_fraction: float | None
    yield_standard_error: float | None
    p95_of_units_mm: float  # 95th percentile over units of the unit's own p-quantile
    p95_standard_error_mm: float
    units: int
    solved: int  # units whose quantile or probability had to be computed


@njit(cache=True, error_model="numpy")
def _brackets(d: Array, covariance: Array, z: float, top: float) -> tuple[Array, Array]:
    """(low, high) of R(d) for each row of d (n, 3); z < 0: only 0 is known from below; covariance (3, 3) for s(d)."""
    n = d.shape[0]
    low = np.empty(n)
    high = np.empty(n)
    for i in range(n):
        size = 0.0
        spread = 0.0
        for a in range(3):
            size += d[i, a] * d[i, a]
            for b in range(3):
                spread += d[i, a] * covariance[a, b] * d[i, b]
        size = sqrt(size)
        low[i] = 0.0
        if z >= 0.0:
            low[i] = size + (z * sqrt(max(spread, 0.0)) / size if size > 0.0 else 0.0)
        high[i] = max(size + top, low[i])
    return low, high


@njit(cache=True, error_model="numpy")
def _gaussian_quantiles(p: float, d: Array, covariance: Array) -> Array:
    out = np.empty(d.shape[0])
    for i in range(d.shape[0]):
        out[i] = norm_quantile_jit(d[i], covariance, p)
    return out


@njit(cache=True, error_model="numpy")
def _gaussian_meets(p: float, limit: float, d: Array, covariance: Array) -> NDArray[np.bool_]:
    out = np.empty(d.shape[0], dtype=np.bool_)
    for i in range(d.shape[0]):
        out[i] = norm_law_jit(d[i], covariance, limit)[0] >= p
    return out


def _spread(units: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most twelve of these units, evenly spaced."""
    return units[np.unique(np.linspace(0, units.size - 1, min(units.size, _CORRECTED)).astype(np.int64))]


def _correction(p: float, shot: LinearLaw, d: Array, own: Array) -> tuple[float, float]:
    """(mean, standard deviation) over the rows of d (n, 3) of R(d) - own(d), R under the declared law of the shot."""
    if d.shape[0] == 0:
        return 0.0, 0.0
    laws = (LinearLaw(row, shot.covariance, shot.columns, shot.kinds) for row in d)
    difference = np.array([law_quantile_coarse(law, p).quantile_mm for law in laws]) - own
    return float(difference.mean()), float(difference.std())


def _shape_matters(shot: LinearLaw) -> bool:
    """Whether taking the shot's columns as Gaussian is felt at all, here by 1e-5 of probability.

    A column changes the characteristic function by at most ``max_x x^4/180 exp(-x^2 / (2 rho^2)) = 0.012 rho^4``,
    rho^2 = h'S^-1 h (``lattice.fold_small``).
    """
    if not shot.columns.any():
        return False
    variances, _, axes = principal_axes(shot.mean, shot.covariance)
    if not variances[2] > 1e-9 * variances[0]:
        return True
    rho2 = ((axes.T @ shot.columns) ** 2 / variances[:, None]).sum(axis=0)
    return bool(0.012 * (rho2**2).sum() > 1e-5)


def _offsets(installation: LinearLaw, log2_units: int) -> tuple[Array, int]:
    """((n, 3) offsets of the units, number of randomisations); one unit when all are alike."""
    h, _ = lattice_columns(installation)
    variances, _, axes = principal_axes(installation.mean, installation.covariance)
    rank = int((variances > 0).sum())
    if rank == 0 and h.shape[0] == 0:
        return installation.mean[None, :].copy(), 1
    z, u = sobol_points(rank, h.shape[0], log2_units, 1)
    d = installation.mean + u @ h
    if rank:
        d = d + z @ (axes[:, :rank] * np.sqrt(variances[:rank])).T
    return np.ascontiguousarray(d), RANDOMISATIONS


def _standard_error(value: Array, blocks: int) -> float:
    """Of the mean of value (n,), from the means of its randomisations."""
    return float(value.reshape(blocks, -1).mean(axis=1).std(ddof=1)) / sqrt(blocks) if blocks > 1 else 0.0


def _control(
    p: float, installation: LinearLaw, covariance: Array, d: Array, size: Array, middle: Array, level: float
) -> Array:
    """(n,) of mean about 0: (|d| <= y) - P(|d| <= y), y where R is about `level`; 0 where no unit is near it."""
    near = np.argsort(np.abs(middle - level))[: max(size.size // 100, 1)]
    near = _spread(near[np.argsort(middle[near])])
    y = level - float((_gaussian_quantiles(p, d[near], covariance) - size[near]).mean())
    if size.size == 1 or not size.min() < y < size.max():
        return np.zeros(size.size)
    return np.asarray((size <= y) - law_cdf_coarse(installation, y))


def unit_risk(
    installation: LinearLaw, shot: LinearLaw, p: float, limit: float | None = None, log2_units: int = 8
) -> UnitRisk:
    """Yield of installed units, and the 95th percentile over units of a unit's own p-quantile over shots.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  limit in mm.  16 x 2^log2_units units are drawn.  Raises ValueError.
    """
    p = probability_iv(p)
    if shot.mean.any():
        raise ValueError(f"the shot's mean belongs to the installation; it must be 0 here, got {shot.mean.tolist()}")
    if limit is not None and not limit >= 0:
        raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    d, blocks = _offsets(installation, log2_units)
    n = d.shape[0]
    mixed = _shape_matters(shot)
    covariance = shot.total_covariance
    top = float(norm_quantile_jit(np.zeros(3), covariance, p))
    z = float(normal_quantile_jit(p)) if p > 0.5 else -1.0
    low, high = _brackets(d, covariance, z, top)
    solved = 0

    size = np.sqrt((d**2).sum(axis=1))
    middle = 0.5 * (low + high)

    fraction: float | None = None
    fraction_error: float | None = None
    if limit is not None:
        level, doubt = limit, 0.0
        if mixed:
            near = _spread(np.flatnonzero((low <= limit) & (high >= limit)))
            shift, doubt = _correction(p, shot, d[near], _gaussian_quantiles(p, d[near], covariance))
            level -= shift
        good = high <= level
        between = np.flatnonzero((low <= level) & ~good)
        good[between] = _gaussian_meets(p, level, d[between], covariance)
        solved += between.size
        excess = good - _control(p, installation, covariance, d, size, middle, level)
        fraction = min(max(float(excess.mean()), 0.0), 1.0)
        # Units within the correction's own spread of the level, counted by their lower bound.
        unsure = float(((low > level - doubt) & (low <= level + doubt)).mean()) / 2 if doubt else 0.0
        fraction_error = hypot(_standard_error(excess, blocks), unsure, 0.5 / n if 0.0 < fraction < 1.0 else 0.0)

    # Where |d| has its own 95 % point R very nearly has its: the control here.
    control = np.zeros(n)
    if blocks > 1:
        control = (size <= law_quantile_coarse(installation, 0.95).quantile_mm) - 0.95
    position = min(max((0.95 + float(control.mean())) * n + 0.5, 1.0), float(n))  # Hazen's, counted from 1
    first = min(int(position), n - 1) - 1 if n > 1 else 0
    second = min(first + 1, n - 1)
    # The order statistics of R lie between those of its bounds; only units that may reach across need solving.
    floor, ceiling = np.partition(low, first)[first], np.partition(high, second)[second]
    own = middle
    between = np.flatnonzero((low <= ceiling) & (high >= floor) & (low < high))
    own[between] = _gaussian_quantiles(p, d[between], covariance)
    solved += between.size
    order = np.argsort(own)
    ranked = own[order]
    value = float(ranked[first] + (position - 1 - first) * (ranked[second] - ranked[first]))
    shift, error = 0.0, 0.0
    if mixed:
        near = _spread(order[max(first - 40, 0) : first + 40])
        shift, error = _correction(p, shot, d[near], own[near])
    if blocks > 1:
        a, b = max(first - n // 50, 0), min(first + n // 50, n - 1)
        slope = float(ranked[b] - ranked[a]) * n / (b - a)
        error = hypot(error, _standard_error((own <= value) - control, blocks) * slope, slope / n)
    return UnitRisk(p, limit, fraction, fraction_error, value + shift, error, n, solved)
