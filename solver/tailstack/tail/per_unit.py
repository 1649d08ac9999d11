"""Risk per unit: the installation is drawn once and stays, noise is drawn again at each shot.

A unit has its own offset ``d = m + N(0, S_unit) + columns u``; its shots scatter about it by the shot law.  Its own
p-quantile over shots is ``R(d)``, the p-quantile of |d + shot|.  Asked for: the *yield* P_d(R(d) <= limit), and a
quantile of R(d) over units.  Both by scrambled Sobol points in d, 16 independent scramblings for a standard error.

Most units need no quantile: with r_s the p-quantile of |shot| and, for a Gaussian shot, s(d) its p-quantile along d,

    |d| + s(d) <= R(d) <= |d| + r_s     for p >= 1/2,

the left because the ball of radius R lies in the half-space x'd <= R |d|, the right by the triangle inequality.  A
closed form of R, calibrated at 32 units, brings the two together (``unit_kernels.sampled``).  Only units in between are
solved, with the exact Gaussian law of the shot.

The fraction of units with |d| <= y is known exactly (the law of |d| is in ``declared.py``).  With y where units begin
to fail, it differs from the yield's indicator for few units only: as a control variate of coefficient 1 it removes
most of the sampling error.  For a quantile y is that of |d|, and the control says at which rank of R to read.

A shot with bounded columns is taken as the Gaussian of equal covariance and then corrected: at about twelve units near
the limit (or the quantile) the declared law of d + shot is solved, and the mean difference shifts the level.  What that
leaves, the spread of the difference over those units, is added to the standard error.

An optimiser compares the quantiles of neighbouring laws, so :func:`unit_quantile` is continuous in both: the points
are fixed, the Gaussian part has its symmetric root (eigenvectors jump where eigenvalues cross), the ranks of R and of
|d| are averaged over one tapered window, and the units corrected are taken by their number in the sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot, isnan, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..arrays import Array
from .contour import EXACT
from .declared import LinearLaw, lattice_columns, law_cdf_coarse, law_quantile_coarse, tolerances
from .declared_kernels import on_principal_axes, solve_on_axes, start_radius
from .gaussian import probability_iv
from .lattice import ball_sums
from .sampling import RANDOMISATIONS, sobol_rows
from .spectrum import principal_axes
from .unit_kernels import (
    HIGH,
    LEAST,
    LOW,
    SIZE,
    distance_like,
    gaussian_quantiles,
    percentile,
    position_of,
    principal_root,
    rank_average,
    sampled,
    share_within,
    solved_between,
)

_CORRECTED = 12
_PILOT = 32
# Agreement of two steps of a contour where units are a sample: quantiles are good to 1e-8 on half the nodes, and
# thousands of units know their own to 1e-3.
_SAMPLED = 1e-4
_WINDOW = 50  # ranks within 1/50 of all units are averaged
_ALIKE = np.zeros((0, 1), np.float32)  # coordinates of units that are all alike
_ALIKE.setflags(write=False)  # as those of a sample are: kernels are compiled for one or the other


@dataclass(frozen=True, slots=True)
class UnitQuantile:
    """A quantile over units of the unit's own p-quantile over shots."""

    value_mm: float
    standard_error_mm: float
    density: float  # over units, of the unit's own quantile near the value, 1/mm; 0 where all units are alike


@dataclass(frozen=True, slots=True)
class UnitRisk:
    """What ``fraction`` of units keep their own p-quantile within, and the fraction that keeps a limit.

    The yield is None without a limit.  With one it is at least ``fraction`` just where the value is within the limit.
    """

    p: float
    fraction: float
    value_mm: float  # the fraction-quantile over units of the unit's own p-quantile
    standard_error_mm: float
    limit_mm: float | None
    yield_fraction: float | None
    yield_standard_error: float | None
    units: int
    solved: int  # units whose quantile or probability had to be computed


def _spread(units: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most twelve of these units, evenly spaced."""
    return units[np.unique(np.linspace(0, units.size - 1, min(units.size, _CORRECTED)).astype(np.int64))]


def _correction(p: float, shot: LinearLaw, d: Array, own: Array, weight: Array | None = None) -> tuple[float, float]:
    """(mean, standard deviation) over the columns of d (3, n) of R(d) - own(d), R under the declared law of the shot.

    weight: (n,) of the units in both, equal by default.
    """
    if own.size == 0:
        return 0.0, 0.0
    laws = (LinearLaw(offset, shot.covariance, shot.columns, shot.kinds) for offset in np.ascontiguousarray(d.T))
    difference = np.array([law_quantile_coarse(law, p).quantile_mm for law in laws]) - own
    mean = float(np.average(difference, weights=weight))
    return mean, sqrt(float(np.average((difference - mean) ** 2, weights=weight)))


@dataclass(frozen=True, slots=True, eq=False)
class _Units:
    """A sample of n installed units and what is known of each; the shot as a Gaussian."""

    p: float
    table: Array  # (8, n) mm: ``unit_kernels`` names its rows
    blocks: int  # randomisations; 1 when all units are alike, and then n is 1
    covariance: Array  # (3, 3) mm^2, total, of the shot
    mixed: bool  # whether the shape of the shot's columns matters
    agreement: float  # of two steps of a contour

    @property
    def d(self) -> Array:
        """(3, n) mm"""
        return self.table[:3]


def _symmetric_root(installation: LinearLaw) -> Array:
    """(3, 3) root of the Gaussian part, continuous in it; (0, 3) without one."""
    variances, _, axes = principal_axes(installation.mean, installation.covariance)
    return np.asarray((axes * np.sqrt(variances)) @ axes.T if variances[0] > 0 else np.zeros((0, 3)))


def _sample(installation: LinearLaw, root: Array, shot: LinearLaw, p: float, log2_units: int) -> _Units:
    """16 x 2^log2_units units, the Gaussian part by its root (k, 3).  Raises ValueError."""
    p = probability_iv(p)
    if shot.mean.any():
        raise ValueError(f"the shot's mean belongs to the installation; it must be 0 here, got {shot.mean.tolist()}")
    h, _ = lattice_columns(installation)
    z, u, blocks, agreement = _ALIKE, _ALIKE, 1, EXACT
    if root.shape[0] or h.shape[0]:
        z, u = sobol_rows(root.shape[0], h.shape[0], log2_units, 1)
        blocks, agreement = RANDOMISATIONS, _SAMPLED
    pilot = _evenly(max(z.shape[1], u.shape[1]), _PILOT)
    law = shot.covariance, shot.columns, shot.kinds
    table, covariance, mixed = sampled(installation.mean, root, z, h, u, *law, p, float(ndtri(p)), pilot, agreement)
    return _Units(p, table, blocks, covariance, mixed, agreement)


def _standard_error(value: Array, blocks: int) -> float:
    """Of the mean of value (n,), from the means of its randomisations."""
    return float(value.reshape(blocks, -1).mean(axis=1).std(ddof=1)) / sqrt(blocks) if blocks > 1 else 0.0


@lru_cache(maxsize=4)
def _evenly(n: int, count: int) -> NDArray[np.int64]:
    """At most ``count`` of n ranks, evenly spaced."""
    ranks = np.linspace(0, n - 1, min(n, count)).astype(np.int64)
    ranks.setflags(write=False)
    return ranks


def unit_quantile(
    installation: LinearLaw, shot: LinearLaw, p: float, fraction: float, log2_units: int = 8
) -> UnitQuantile:
    """The fraction-quantile over installed units of a unit's own p-quantile over shots; continuous in both laws.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  16 x 2^log2_units units are drawn, the same ones each time.  Raises ValueError.
    """
    fraction = probability_iv(fraction)
    units = _sample(installation, _symmetric_root(installation), shot, p, log2_units)
    size = units.table[SIZE]
    n = size.size
    width = max(min(n // _WINDOW, int(0.5 * n * min(fraction, 1 - fraction))), 1)
    distance = law_quantile_coarse(installation, fraction)
    by_size = np.argsort(size)
    position = position_of(distance.quantile_mm, size[by_size], width)
    first, last = max(int(position) - 2 * width, 0), min(int(position) + 2 * width + 1, n - 1)
    own, _ = solved_between(units.p, units.table, units.covariance, first, last, units.agreement)
    order = np.argsort(own)
    ranked = own[order]
    value, shift, error, density = rank_average(ranked, position, width), 0.0, 0.0, 0.0
    rank = np.empty(n)
    rank[order] = np.arange(n)
    if units.mixed:
        weight = width - np.abs(rank - position)
        near = np.flatnonzero(weight[: max(_CORRECTED * n // (2 * width), 1)] > 0)
        shift, error = _correction(units.p, shot, units.d[:, near], own[near], weight[near])
    if units.blocks > 1:
        a, b = max(position - width, 0.0), min(position + width, n - 1.0)
        slope = (rank_average(ranked, b, width) - rank_average(ranked, a, width)) * n / (b - a)
        density = 1 / slope if slope > 0 else 0.0
        # The indicators R <= value and |d| <= y, each a ramp across the window.
        size_rank = np.empty(n)
        size_rank[by_size] = np.arange(n)
        ramps = np.clip((position - np.stack([rank, size_rank])) / (2 * width) + 0.5, 0, 1)
        sampling = hypot(_standard_error(ramps[0] - ramps[1], units.blocks), 1 / (n * sqrt(2 * width)))
        error = hypot(error, sampling * slope, distance.error_mm)
    return UnitQuantile(value + shift, error, density)


def unit_risk(
    installation: LinearLaw,
    shot: LinearLaw,
    p: float,
    limit: float | None = None,
    fraction: float = 0.95,
    log2_units: int = 8,
) -> UnitRisk:
    """The fraction-quantile over installed units of a unit's own p-quantile over shots, and the yield at a limit.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  16 x 2^log2_units units are drawn, once for both.  Raises ValueError.
    """
    if limit is not None and not limit >= 0:
        raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    fraction = probability_iv(fraction)
    units = _sample(installation, principal_root(installation.covariance), shot, p, log2_units)
    level = None if limit is None else _level(shot, units, limit)
    radius = np.nan if level is None else distance_like(units.table, level[0])
    distance, within = np.nan, 0.0
    if units.blocks > 1:
        distance, (within,) = quantile_and_probabilities(installation, fraction, (radius,))
    value, error, solved = _percentile(shot, units, fraction, distance)
    found, found_error = None, None
    if limit is not None and level is not None:
        found, found_error, more = _yield(units, *level, radius, within)
        found = _on_the_same_side(found, fraction, value <= limit, units.blocks > 1)
        solved += more
    return UnitRisk(units.p, fraction, value, error, limit, found, found_error, units.table.shape[1], solved)


def _on_the_same_side(share: float, fraction: float, kept: bool, differ: bool) -> float:
    """The yield, on the side of the required fraction on which the quantile is of the limit.

    ``F(limit) >= fraction`` is ``Q(fraction) <= limit`` for one law of R.  Quantile and yield are estimated with other
    controls, each the best for its own, so near one another they may disagree by less than their errors.
    """
    if not differ:
        return 1.0 if kept else 0.0
    return max(share, fraction) if kept else min(share, float(np.nextafter(fraction, 0.0)))


def _level(shot: LinearLaw, units: _Units, limit: float) -> tuple[float, float]:
    """(what R for a Gaussian shot must not exceed for the limit to be met, how much that varies from unit to unit)."""
    if not units.mixed:
        return limit, 0.0
    near = _spread(np.flatnonzero((units.table[LOW] <= limit) & (units.table[HIGH] >= limit)))
    own = gaussian_quantiles(units.p, units.table, near, units.covariance, units.agreement)
    shift, doubt = _correction(units.p, shot, units.d[:, near], own)
    return limit - shift, doubt


def _yield(units: _Units, level: float, doubt: float, radius: float, within: float) -> tuple[float, float, int]:
    """(fraction of units with R <= level, its standard error, units solved).

    within: P(|d| <= radius), the control; radius NaN, within 0: there is none.
    """
    excess, error, solved = share_within(
        units.p, level, units.table, units.covariance, units.blocks, radius, units.agreement
    )
    least = units.table[LEAST]
    # Units within the correction's own spread of the level, counted by their lower bound.
    unsure = float(((least > level - doubt) & (least <= level + doubt)).mean()) / 2 if doubt else 0.0
    fraction = min(max(excess + within, 0.0), 1.0)
    return fraction, hypot(error, unsure, 0.5 / least.size if 0.0 < fraction < 1.0 else 0.0), solved


def _percentile(shot: LinearLaw, units: _Units, fraction: float, distance: float) -> tuple[float, float, int]:
    """(fraction-quantile of R over units, its standard error, units solved); the control is |d| at its own."""
    own, value, rank, slope, share_error, solved = percentile(
        units.p, fraction, units.table, units.covariance, units.blocks, distance, units.agreement
    )
    shift, error = 0.0, 0.0
    if units.mixed:
        near = _spread(np.argsort(own)[max(rank - 40, 0) : rank + 40])
        shift, error = _correction(units.p, shot, units.d[:, near], own[near])
    return value + shift, hypot(error, share_error * slope, slope / own.size), solved


def quantile_and_probabilities(law: LinearLaw, p: float, radii: Sequence[float]) -> tuple[float, list[float]]:
    """(p-quantile of |e|, P(|e| <= r) for each of the radii, 0 where that is NaN); mm.

    As good as ``law_quantile_coarse`` and ``law_cdf_coarse``.  The lattice of the quantile serves radii up to some 8 %
    above it; beyond, and for laws that have no lattice, it is those two.
    """
    h, _ = lattice_columns(law)
    found = False
    if h.shape[0]:
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(law.mean, law.covariance, h)
        start = start_radius(p, sigma, m, turned)
        found, rho, _, _, largest, t, w = solve_on_axes(p, start, sigma, m, S, turned, dimension, *tolerances(p, False))

    def probability(r: float) -> float:
        if isnan(r):
            return 0.0
        if not found or r * r - offset > largest * largest:
            return law_cdf_coarse(law, r)
        if r * r <= offset:
            return 0.0
        return min(max(float(ball_sums(sqrt(r * r - offset), dimension, t, w)[0]), 0.0), 1.0)

    quantile = sqrt(rho * rho + offset) if found else law_quantile_coarse(law, p).quantile_mm
    return quantile, [probability(r) for r in radii]
