"""Risk per unit: the installation is drawn once and stays, noise is drawn again at each shot.

A unit has its own offset ``d = m + N(0, S_unit) + columns u``; its shots scatter about it by the shot law.  Its own
p-quantile over shots is ``R(d)``, the p-quantile of |d + shot|.  Asked for: the *yield* P_d(R(d) <= limit), and a
quantile of R(d) over units.  Both by scrambled Sobol points in d, 16 independent scramblings for a standard error.

Most units need no quantile: with r_s the p-quantile of |shot| and, for a Gaussian shot, s(d) its p-quantile along d,

    |d| + s(d) <= R(d) <= |d| + r_s     for p >= 1/2,

the left because the ball of radius R lies in the half-space x'd <= R |d|, the right by the triangle inequality.  A
closed form of R, calibrated at 32 units, brings the two together (``_narrowed``).  Only units in between are solved,
with the exact Gaussian law of the shot.

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
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..system import Array
from .contour import EXACT
from .declared import LinearLaw, lattice_columns, law_cdf_coarse, law_quantile_coarse
from .gaussian import probability_iv
from .quantile import norm_quantile_jit, normal_quantile_jit
from .sampling import RANDOMISATIONS, sobol_rows
from .spectrum import principal_axes
from .unit_kernels import (
    drawn_together,
    gaussian_meets,
    gaussian_quantiles,
    position_of,
    rank_average,
    solve_within,
    survey,
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
    """yield_fraction and its standard error are None without a limit."""

    p: float
    limit_mm: float | None
    yield_fraction: float | None
    yield_standard_error: float | None
    p95_of_units_mm: float  # 95th percentile over units of the unit's own p-quantile
    p95_standard_error_mm: float
    units: int
    solved: int  # units whose quantile or probability had to be computed


def _spread(units: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most twelve of these units, evenly spaced."""
    return units[np.unique(np.linspace(0, units.size - 1, min(units.size, _CORRECTED)).astype(np.int64))]


def _correction(p: float, shot: LinearLaw, d: Array, own: Array, weight: Array | None = None) -> tuple[float, float]:
    """(mean, standard deviation) over the rows of d (n, 3) of R(d) - own(d), R under the declared law of the shot.

    weight: (n,) of the units in both, equal by default.
    """
    if d.shape[0] == 0:
        return 0.0, 0.0
    laws = (LinearLaw(row, shot.covariance, shot.columns, shot.kinds) for row in d)
    difference = np.array([law_quantile_coarse(law, p).quantile_mm for law in laws]) - own
    mean = float(np.average(difference, weights=weight))
    return mean, sqrt(float(np.average((difference - mean) ** 2, weights=weight)))


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


@dataclass(frozen=True, slots=True, eq=False)
class _Units:
    """A sample of n installed units and what is known of each without solving it; the shot as a Gaussian."""

    p: float
    d: Array  # (n, 3) mm
    blocks: int  # randomisations; 1 when all units are alike, and then n is 1
    size: Array  # (n,) |d|, mm
    covariance: Array  # (3, 3) mm^2, total, of the shot
    low: Array  # (n,) mm, of R(d)
    high: Array
    guess: Array | None  # (n,) mm, closed form of R(d); None where there are no shots
    mixed: bool  # whether the shape of the shot's columns matters

    @property
    def agreement(self) -> float:
        return EXACT if self.blocks == 1 else _SAMPLED


def _principal_root(installation: LinearLaw) -> Array:
    """(3, rank) root of the Gaussian part, the largest variance first: it gets the most even of Sobol's coordinates."""
    variances, _, axes = principal_axes(installation.mean, installation.covariance)
    rank = int((variances > 0).sum())
    return np.asarray(axes[:, :rank] * np.sqrt(variances[:rank]))


def _symmetric_root(installation: LinearLaw) -> Array:
    """(3, 3) root of the Gaussian part, continuous in it; (3, 0) without one."""
    variances, _, axes = principal_axes(installation.mean, installation.covariance)
    return np.asarray((axes * np.sqrt(variances)) @ axes.T if variances[0] > 0 else np.zeros((3, 0)))


def _sample(installation: LinearLaw, root: Array, shot: LinearLaw, p: float, log2_units: int) -> _Units:
    """16 x 2^log2_units units, the Gaussian part by its root (3, k).  Raises ValueError."""
    p = probability_iv(p)
    if shot.mean.any():
        raise ValueError(f"the shot's mean belongs to the installation; it must be 0 here, got {shot.mean.tolist()}")
    h, _ = lattice_columns(installation)
    z, u, blocks = _ALIKE, _ALIKE, 1
    if root.shape[1] or h.shape[0]:
        z, u = sobol_rows(root.shape[1], h.shape[0], log2_units, 1)
        blocks = RANDOMISATIONS
    covariance = shot.total_covariance
    top = float(norm_quantile_jit(np.zeros(3), covariance, p))
    along = float(normal_quantile_jit(p)) if p > 0.5 else -1.0
    d, size, low, high, guess, formed = survey(
        installation.mean, root, z, h, u, covariance, along, top, float(ndtri(p))
    )
    return _Units(p, d, blocks, size, covariance, low, high, guess if formed else None, _shape_matters(shot))


def _standard_error(value: Array, blocks: int) -> float:
    """Of the mean of value (n,), from the means of its randomisations."""
    return float(value.reshape(blocks, -1).mean(axis=1).std(ddof=1)) / sqrt(blocks) if blocks > 1 else 0.0


def _control(installation: LinearLaw, units: _Units, middle: Array, level: float) -> Array:
    """(n,) of mean about 0: (|d| <= y) - P(|d| <= y), y where R (`middle`, nearly) is `level`; 0 where no unit is."""
    size = units.size
    closest = max(size.size // 100, 1)
    near = np.argpartition(np.abs(middle - level), closest - 1)[:closest]
    y = level - float((middle[near] - size[near]).mean())
    if size.size == 1 or not size.min() < y < size.max():
        return np.zeros(size.size)
    return np.asarray((size <= y) - law_cdf_coarse(installation, y))


def _narrowed(units: _Units) -> _Units:
    """The same units, the bounds of R drawn together about its closed form.

    The closed form's error varies little and smoothly from unit to unit.  Its range over 32 units, taken three times as
    wide, is trusted to hold for all; were it missed, two ranks might be exchanged.
    """
    S, n, guess = units.covariance, units.size.size, units.guess
    if guess is None:
        return units
    ranks = _evenly(n, _PILOT)
    pilot = np.argpartition(guess, ranks)[ranks]
    difference = gaussian_quantiles(units.p, units.d[pilot], S, units.agreement) - guess[pilot]
    least, most = float(difference.min()), float(difference.max())
    low, high = drawn_together(units.low, units.high, guess, 2 * least - most, 2 * most - least)
    return replace(units, low=low, high=high)


@lru_cache(maxsize=4)
def _evenly(n: int, count: int) -> NDArray[np.int64]:
    """At most ``count`` of n ranks, evenly spaced."""
    ranks = np.linspace(0, n - 1, min(n, count)).astype(np.int64)
    ranks.setflags(write=False)
    return ranks


def _solved_between(units: _Units, first: int, last: int) -> tuple[Array, int]:
    """(R (n,), number of units solved): exact for the ranks first ... last, counted from 0.

    The order statistics of R lie between those of its bounds; only units that may reach across need solving.
    """
    low, high = units.low, units.high
    floor, ceiling = np.partition(low, first)[first], np.partition(high, last)[last]
    return solve_within(  # type: ignore[no-any-return]
        units.p, units.d, units.covariance, low, high, floor, ceiling, units.agreement
    )


def unit_quantile(
    installation: LinearLaw, shot: LinearLaw, p: float, fraction: float, log2_units: int = 8
) -> UnitQuantile:
    """The fraction-quantile over installed units of a unit's own p-quantile over shots; continuous in both laws.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  16 x 2^log2_units units are drawn, the same ones each time.  Raises ValueError.
    """
    fraction = probability_iv(fraction)
    units = _narrowed(_sample(installation, _symmetric_root(installation), shot, p, log2_units))
    n = units.size.size
    width = max(min(n // _WINDOW, int(0.5 * n * min(fraction, 1 - fraction))), 1)
    distance = law_quantile_coarse(installation, fraction)
    by_size = np.argsort(units.size)
    position = position_of(distance.quantile_mm, units.size[by_size], width)
    first, last = max(int(position) - 2 * width, 0), min(int(position) + 2 * width + 1, n - 1)
    own, _ = _solved_between(units, first, last)
    order = np.argsort(own)
    ranked = own[order]
    value, shift, error, density = rank_average(ranked, position, width), 0.0, 0.0, 0.0
    rank = np.empty(n)
    rank[order] = np.arange(n)
    if units.mixed:
        weight = width - np.abs(rank - position)
        near = np.flatnonzero(weight[: max(_CORRECTED * n // (2 * width), 1)] > 0)
        shift, error = _correction(units.p, shot, units.d[near], own[near], weight[near])
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
    installation: LinearLaw, shot: LinearLaw, p: float, limit: float | None = None, log2_units: int = 8
) -> UnitRisk:
    """:func:`unit_risks` for one limit, or for none."""
    return unit_risks(installation, shot, p, (limit,), log2_units)[0]


def unit_risks(
    installation: LinearLaw, shot: LinearLaw, p: float, limits: Sequence[float | None], log2_units: int = 8
) -> tuple[UnitRisk, ...]:
    """Yield of installed units at each limit, and the 95th percentile over units of a unit's own p-quantile over shots.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  limits in mm.  16 x 2^log2_units units are drawn, once for all limits.  Raises ValueError.
    """
    for limit in limits:
        if limit is not None and not limit >= 0:
            raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    units = _sample(installation, _principal_root(installation), shot, p, log2_units)
    narrow = _narrowed(units)
    value, error, percentile_solved = _percentile(installation, shot, narrow)
    found = []
    for limit in limits:
        fraction: float | None = None
        fraction_error: float | None = None
        solved = percentile_solved
        if limit is not None:
            fraction, fraction_error, more = _yield(installation, shot, units, narrow, limit)
            solved += more
        found.append(UnitRisk(units.p, limit, fraction, fraction_error, value, error, units.size.size, solved))
    return tuple(found)


def _yield(
    installation: LinearLaw, shot: LinearLaw, units: _Units, narrow: _Units, limit: float
) -> tuple[float, float, int]:
    """(fraction of units with R <= limit, its standard error, units solved)."""
    n = units.size.size
    level, doubt = limit, 0.0
    if units.mixed:
        near = _spread(np.flatnonzero((units.low <= limit) & (units.high >= limit)))
        own = gaussian_quantiles(units.p, units.d[near], units.covariance, units.agreement)
        shift, doubt = _correction(units.p, shot, units.d[near], own)
        level -= shift
    good = narrow.high <= level
    between = np.flatnonzero((narrow.low <= level) & ~good)
    good[between] = gaussian_meets(units.p, level, units.d[between], units.covariance, units.agreement)
    excess = good - _control(installation, units, 0.5 * (narrow.low + narrow.high), level)
    # Units within the correction's own spread of the level, counted by their lower bound.
    unsure = float(((narrow.low > level - doubt) & (narrow.low <= level + doubt)).mean()) / 2 if doubt else 0.0
    fraction = min(max(float(excess.mean()), 0.0), 1.0)
    error = hypot(_standard_error(excess, units.blocks), unsure, 0.5 / n if 0.0 < fraction < 1.0 else 0.0)
    return fraction, error, between.size


def _percentile(installation: LinearLaw, shot: LinearLaw, units: _Units) -> tuple[float, float, int]:
    """(95th percentile of R over units, its standard error, units solved); the control is |d| at its own 95 %."""
    n = units.size.size
    control: Array = np.zeros(n)
    if units.blocks > 1:
        control = np.asarray((units.size <= law_quantile_coarse(installation, 0.95).quantile_mm) - 0.95)
    position = min(max((0.95 + float(control.mean())) * n - 0.5, 0.0), n - 1.0)  # Hazen's, counted from 0
    first = max(min(int(position), n - 2), 0)
    own, solved = _solved_between(units, first, min(first + 1, n - 1))
    ranked = np.sort(own)
    value = float(rank_average(ranked, position, 1))
    shift, error = 0.0, 0.0
    if units.mixed:
        near = _spread(np.argsort(own)[max(first - 40, 0) : first + 40])
        shift, error = _correction(units.p, shot, units.d[near], own[near])
    if units.blocks > 1:
        a, b = max(first - n // 50, 0), min(first + n // 50, n - 1)
        slope = float(ranked[b] - ranked[a]) * n / (b - a)
        error = hypot(error, _standard_error((own <= value) - control, units.blocks) * slope, slope / n)
    return value + shift, error, solved
