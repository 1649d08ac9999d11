"""Compiled steps of the risk per unit: units drawn and bounded, quantiles of some solved, ranks and shares read off.

A sample of n units is one table (8, n), whose rows are named here: it is handed from step to step as one array.

Risk per unit: the installation is drawn once and stays, noise is drawn again at each shot.

A unit has its own offset ``d = m + N(0, S_unit) + columns u``; its shots scatter about it by the shot law.  Its own
p-quantile over shots is ``R(d)``, the p-quantile of |d + shot|.  Asked for: the *yield* P_d(R(d) <= limit), and a
quantile of R(d) over units.  Both by scrambled Sobol points in d, 16 independent scramblings for a standard error.

Most units need no quantile: with r_s the p-quantile of |shot| and, for a Gaussian shot, s(d) its p-quantile along d,

    |d| + s(d) <= R(d) <= |d| + r_s     for p >= 1/2,

the left because the ball of radius R lies in the half-space x'd <= R |d|, the right by the triangle inequality.  A
closed form of R, calibrated at 32 units, brings the two together (:func:`sampled`).  Only units in between are
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
from math import fabs, hypot, isnan, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..arrays import Array
from ..kernels import kernel
from .contour import EXACT
from .declared import (
    UNIFORM,
    LinearLaw,
    lattice_columns,
    law_cdf_coarse,
    law_quantile_coarse,
    on_principal_axes,
    solve_on_axes,
    start_radius,
    tolerances,
)
from .gaussian import law_on_axes, norm_quantile_jit, normal_quantile_jit, probability_iv, quantile_on_axes
from .lattice import ball_sums
from .sampling import RANDOMISATIONS, SingleArray, sobol_rows
from .spectrum import principal_axes

# Of a unit, all in mm: its offset d, |d|, bounds of its own quantile R(d) that hold, and bounds drawn together.
X, Y, Z, SIZE, LOW, HIGH, LEAST, MOST = range(8)


@kernel()
def principal_root(covariance: Array) -> Array:
    """(rank, 3) root of a covariance, a row an axis, the largest first: it gets the evenest of Sobol's coordinates."""
    variances, _, axes = principal_axes(np.zeros(3), covariance)
    rank = 0
    while rank < 3 and variances[rank] > 0.0:
        rank += 1
    root = np.empty((rank, 3))
    for k in range(rank):
        for a in range(3):
            root[k, a] = axes[a, k] * sqrt(variances[k])
    return root


@kernel()
def _as_gaussian(covariance: Array, columns: Array, kinds: NDArray[np.int64]) -> tuple[Array, bool]:
    """(total covariance, whether taking the columns as Gaussian is felt at all, here by 1e-5 of probability).

    A column changes the characteristic function by at most ``max_x x^4/180 exp(-x^2 / (2 rho^2)) = 0.012 rho^4``,
    rho^2 = h'S^-1 h (``lattice.fold_small``).
    """
    variances, _, axes = principal_axes(np.zeros(3), covariance)
    singular = not variances[2] > 1e-9 * variances[0]
    total = covariance.copy()
    change = 0.0
    for j in range(kinds.size):
        if columns[0, j] == 0.0 and columns[1, j] == 0.0 and columns[2, j] == 0.0:
            continue
        variance = 1.0 / 3.0 if kinds[j] == UNIFORM else 1.0 / 6.0
        rho2 = 0.0
        for a in range(3):
            along = 0.0
            for b in range(3):
                along += axes[b, a] * columns[b, j]
                total[a, b] += columns[a, j] * variance * columns[b, j]
            rho2 += along * along / variances[a]
        change += np.inf if singular else 0.012 * rho2 * rho2
    return total, change > 1e-5


@kernel()
def _add_columns(h: Array, u: SingleArray, x: Array, y: Array, z: Array) -> None:
    """(x, y, z) += h' u, h (k, 3) and u (k, n), in the order of k; four at a time, to read and write the sums less."""
    count = h.shape[0]
    last = count - 1
    c = np.zeros((count + 3, 3))
    for j in range(count):
        for a in range(3):
            c[j, a] = h[j, a]
    for j in range(0, count, 4):
        u0, u1, u2, u3 = u[j], u[min(j + 1, last)], u[min(j + 2, last)], u[min(j + 3, last)]
        x0, x1, x2, x3 = c[j, 0], c[j + 1, 0], c[j + 2, 0], c[j + 3, 0]
        y0, y1, y2, y3 = c[j, 1], c[j + 1, 1], c[j + 2, 1], c[j + 3, 1]
        z0, z1, z2, z3 = c[j, 2], c[j + 1, 2], c[j + 2, 2], c[j + 3, 2]
        for i in range(x.size):
            a0, a1, a2, a3 = u0[i], u1[i], u2[i], u3[i]
            x[i] = x[i] + a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
            y[i] = y[i] + a0 * y0 + a1 * y1 + a2 * y2 + a3 * y3
            z[i] = z[i] + a0 * z0 + a1 * z1 + a2 * z2 + a3 * z3


@kernel()
def _survey(
    mean: Array, root: Array, z: SingleArray, h: Array, u: SingleArray, covariance: Array, p: float, normal: float
) -> tuple[Array, bool]:
    """(the table of n units, but with the closed form of R(d) in row LEAST; whether there is one).

    Units ``d = mean + root' z + h' u``, root (k, 3), h (K, 3), z (k, n), u (K, n): loops run along the units.
    """
    n = max(z.shape[1], u.shape[1])
    table = np.empty((8, n))
    first, second, third = table[X], table[Y], table[Z]
    size, low, high, guess = table[SIZE], table[LOW], table[HIGH], table[LEAST]
    for i in range(n):
        first[i], second[i], third[i] = mean[0], mean[1], mean[2]
    _add_columns(root, z, first, second, third)
    _add_columns(h, u, first, second, third)
    S = covariance
    T = np.zeros((3, 3))
    trace = 0.0
    square = 0.0
    cube = 0.0
    for a in range(3):
        trace += S[a, a]
        for b in range(3):
            for c in range(3):
                T[a, b] += S[a, c] * S[c, b]
    for a in range(3):
        square += T[a, a]
        for b in range(3):
            cube += T[a, b] * S[b, a]
    top = norm_quantile_jit(np.zeros(3), covariance, p)
    along = normal_quantile_jit(p) if p > 0.5 else -1.0  # below, nothing is known of R from below
    for i in range(n):
        dx, dy, dz = first[i], second[i], third[i]
        length2 = dx * dx + dy * dy + dz * dz
        spread = S[0, 0] * dx * dx + S[1, 1] * dy * dy + S[2, 2] * dz * dz
        spread += 2.0 * (S[0, 1] * dx * dy + S[0, 2] * dx * dz + S[1, 2] * dy * dz)
        wider = T[0, 0] * dx * dx + T[1, 1] * dy * dy + T[2, 2] * dz * dz
        wider += 2.0 * (T[0, 1] * dx * dy + T[0, 2] * dx * dz + T[1, 2] * dy * dz)
        length = sqrt(length2)
        size[i] = length
        least = length + along * sqrt(max(spread, 0.0)) / length if along >= 0.0 and length > 0.0 else 0.0
        low[i] = least
        high[i] = max(length + top, least)
        # Pearson's quantile of ``approximation.py``
        c2 = square + 2.0 * spread
        scale = sqrt(c2)
        gamma = (cube + 3.0 * wider) / (c2 * scale)
        b = sqrt(2.0) / 3.0 * normal - gamma * (2.0 / 9.0)
        w = gamma * b
        guess[i] = sqrt(max(trace + length2 + scale * b * (3.0 + 3.0 * w + w * w), 0.0))
    return table, square > 0.0


@kernel()
def sampled(
    mean: Array,
    root: Array,
    z: SingleArray,
    h: Array,
    u: SingleArray,
    shot: Array,
    columns: Array,
    kinds: NDArray[np.int64],
    p: float,
    normal: float,
    pilot: NDArray[np.int64],
    agreement: float,
) -> tuple[Array, Array, bool]:
    """(table (8, n), covariance (3, 3) of the shot taken as Gaussian, whether the shape of its columns matters).

    Units as :func:`_survey` has them; shot, columns, kinds: the law of the shot; normal: ndtri(p).  The bounds of R are
    drawn together about its closed form.  That form's error varies little and smoothly from unit to unit: its range
    over the units at the ranks ``pilot``, taken three times as wide, is trusted to hold for all; were it missed, two
    ranks might be exchanged.
    """
    covariance, mixed = _as_gaussian(shot, columns, kinds)
    table, formed = _survey(mean, root, z, h, u, covariance, p, normal)
    if not formed:
        for i in range(table.shape[1]):
            table[LEAST, i] = table[LOW, i]
            table[MOST, i] = table[HIGH, i]
        return table, covariance, mixed
    guess = table[LEAST]
    units = units_at_ranks(guess, pilot)
    own = gaussian_quantiles(p, table, units, covariance, agreement)
    least = np.inf
    most = -np.inf
    for i in range(units.size):
        difference = own[i] - guess[units[i]]
        least = min(least, difference)
        most = max(most, difference)
    below = 2.0 * least - most
    above = 2.0 * most - least
    for i in range(guess.size):
        middle = guess[i]
        table[LEAST, i] = max(table[LOW, i], middle + below)
        table[MOST, i] = max(min(table[HIGH, i], middle + above), table[LEAST, i])
    return table, covariance, mixed


@kernel()
def _turned(table: Array, unit: int, axes: Array, out: Array) -> None:
    """out = axes' d, as ``principal_axes`` turns a mean."""
    for a in range(3):
        out[a] = 0.0
        for k in range(3):
            out[a] += axes[k, a] * table[k, unit]


@kernel()
def gaussian_quantiles(p: float, table: Array, units: NDArray[np.int64], covariance: Array, agreement: float) -> Array:
    """R of these units (k,), the shot Gaussian; NaN: not converged.  The axes are found once for all."""
    out = np.empty(units.size)
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    for i in range(units.size):
        _turned(table, units[i], axes, m)
        out[i] = quantile_on_axes(p, variances, m, agreement)
    return out


@kernel()
def solved_between(
    p: float, table: Array, covariance: Array, first: int, last: int, agreement: float
) -> tuple[Array, int]:
    """(R (n,), how many were solved): exact for the ranks first ... last, from 0; elsewhere the middle of the bounds.

    The order statistics of R lie between those of its bounds; only units that may reach across need solving.
    """
    low, high = table[LEAST], table[MOST]
    rank = np.empty(1, np.int64)
    rank[0] = first
    floor = low[units_at_ranks(low, rank)[0]]
    rank[0] = last
    ceiling = high[units_at_ranks(high, rank)[0]]
    out = np.empty(low.size)
    across = np.empty(low.size, np.int64)
    solved = 0
    for i in range(low.size):
        out[i] = 0.5 * (low[i] + high[i])
        if low[i] <= ceiling and high[i] >= floor and low[i] < high[i]:
            across[solved] = i
            solved += 1
    own = gaussian_quantiles(p, table, across[:solved], covariance, agreement)
    for i in range(solved):
        out[across[i]] = own[i]
    return out, solved


@kernel()
def _mean_share(counts: NDArray[np.int64], each: int) -> tuple[float, float]:
    """(mean share, its standard error) from the counts (blocks,) among `each` units; error 0 of a single block."""
    blocks = counts.size
    mean = 0.0
    for count in counts:
        mean += count / blocks
    square = 0.0
    for count in counts:
        square += (count - mean) ** 2
    return mean / each, sqrt(square / (blocks * max(blocks - 1.0, 1.0))) / each


@kernel()
def percentile(
    p: float, fraction: float, table: Array, covariance: Array, blocks: int, distance: float, agreement: float
) -> tuple[Array, float, int, float, float, int]:
    """(R (n,), its quantile over units, rank of that, dR / dfraction there, standard error of the fraction, solved).

    distance: the fraction-quantile of |d|, which tells the rank; where all units are alike there is none.
    """
    n = table.shape[1]
    inside = fraction * n
    if blocks > 1:
        inside = 0.0
        for i in range(n):
            inside += table[SIZE, i] <= distance
    position = min(max(inside - 0.5, 0.0), n - 1.0)  # Hazen's, counted from 0
    rank = max(min(int(position), n - 2), 0)
    own, solved = solved_between(p, table, covariance, rank, min(rank + 1, n - 1), agreement)
    under = int(position)
    reach = max(n // 50, 1)
    before, after = max(rank - reach, 0), min(rank + reach, n - 1)
    ranks = np.empty(4, np.int64)
    ranks[0], ranks[1], ranks[2], ranks[3] = before, under, min(under + 1, n - 1), after
    unit = units_at_ranks(own, ranks)
    value = own[unit[1]] + (position - under) * (own[unit[2]] - own[unit[1]])
    slope = (own[unit[3]] - own[unit[0]]) * n / (after - before) if blocks > 1 else 0.0
    each = n // blocks
    excess = np.zeros(blocks, np.int64)
    for b in range(blocks):
        for i in range(b * each, (b + 1) * each):
            excess[b] += int(own[i] <= value) - int(table[SIZE, i] <= distance)
    return own, value, rank, slope, _mean_share(excess, each)[1], solved


@kernel()
def distance_like(table: Array, level: float) -> float:
    """The |d| of units with R at the level, by the hundredth of all that is nearest to it; NaN beyond everybody's."""
    n = table.shape[1]
    smallest = np.inf
    largest = -np.inf
    away = np.empty(n)
    for i in range(n):
        smallest = min(smallest, table[SIZE, i])
        largest = max(largest, table[SIZE, i])
        away[i] = fabs(0.5 * (table[LEAST, i] + table[MOST, i]) - level)
    near = nearest_units(away, max(n // 100, 1))
    more = 0.0
    for i in near:
        more += 0.5 * (table[LEAST, i] + table[MOST, i]) - table[SIZE, i]
    y = level - more / near.size
    return y if smallest < y < largest else np.nan


@kernel()
def share_within(
    p: float, level: float, table: Array, covariance: Array, blocks: int, distance: float, agreement: float
) -> tuple[float, float, int]:
    """(share of units with R <= level less that with |d| <= distance, its standard error, units solved)."""
    each = table.shape[1] // blocks
    excess = np.zeros(blocks, np.int64)
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    solved = 0
    for b in range(blocks):
        for i in range(b * each, (b + 1) * each):
            good = table[MOST, i] <= level
            if not good and table[LEAST, i] <= level:
                _turned(table, i, axes, m)
                good = law_on_axes(variances, m, level, agreement)[0] >= p
                solved += 1
            excess[b] += int(good) - int(table[SIZE, i] <= distance)
    share, error = _mean_share(excess, each)
    return share, error, solved


@kernel()
def rank_average(ranked: Array, position: float, width: int) -> float:
    """Mean of the ascending values (n,) about a position, ranks from 0, weights a triangle of this half-width.

    Continuous and monotone in the position; half-width 1 is linear interpolation.
    """
    total = 0.0
    weights = 0.0
    for k in range(max(int(position) - width, 0), min(int(position) + width + 1, ranked.size - 1) + 1):
        weight = max(width - abs(k - position), 0.0)
        total += weight * ranked[k]
        weights += weight
    return total / weights


@kernel()
def position_of(level: float, ranked: Array, width: int) -> float:
    """Where the average over ranks equals the level; the nearest end if nowhere.  By bisection."""
    low = 0.0
    high = ranked.size - 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if rank_average(ranked, middle, width) < level:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


_SHARED = 4  # values to a bucket


@kernel()
def _at_rank(values: Array, units: NDArray[np.int64], rank: int) -> int:
    """Which of the units (k,) has this rank among them, from 0; they are reordered.  The range of values is halved."""
    while True:
        low = np.inf
        high = -np.inf
        for unit in units:
            low = min(low, values[unit])
            high = max(high, values[unit])
        pivot = low + 0.5 * (high - low)
        if not low <= pivot < high:  # all alike, or neighbours
            pivot = low
        below = 0
        for i in range(units.size):
            if values[units[i]] <= pivot:
                units[i], units[below] = units[below], units[i]
                below += 1
        if below == units.size or below == 0:
            return units[rank]  # type: ignore[no-any-return]
        if rank < below:
            units = units[:below]
        else:
            units = units[below:]
            rank -= below


@kernel()
def units_at_ranks(values: Array, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """The units at these ranks (k,), from 0, of the values (n,) in ascending order.

    Values are dealt into buckets of equal width, and only those looked into that hold a rank.
    """
    n = values.size
    low = np.inf
    high = -np.inf
    for i in range(n):
        low = min(low, values[i])
        high = max(high, values[i])
    buckets = n // _SHARED + 1
    scale = buckets / (high - low)
    bucket = np.empty(n, np.int64)
    start = np.zeros(buckets + 1, np.int64)
    for i in range(n):
        place = (values[i] - low) * scale
        bucket[i] = int(place) if place < buckets else buckets - 1  # what is not a number too
        start[bucket[i] + 1] += 1
    for k in range(buckets):
        start[k + 1] += start[k]
    free = start.copy()
    dealt = np.empty(n, np.int64)
    for i in range(n):
        k = bucket[i]
        dealt[free[k]] = i
        free[k] += 1
    out = np.empty(ranks.size, np.int64)
    for i in range(ranks.size):
        k = bucket[dealt[ranks[i]]]
        out[i] = _at_rank(values, dealt[start[k] : start[k + 1]], ranks[i] - start[k])
    return out


@kernel()
def nearest_units(away: Array, count: int) -> NDArray[np.int64]:
    """The `count` units with the smallest values (n,), 1 <= count <= n."""
    near = np.empty(count, np.int64)
    kept = 0
    for i in range(away.size):
        if kept == count and not away[i] < away[near[kept - 1]]:
            continue
        kept = min(kept + 1, count)
        place = kept - 1
        while place > 0 and away[i] < away[near[place - 1]]:
            near[place] = near[place - 1]
            place -= 1
        near[place] = i
    return near


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
    table: Array  # (8, n) mm: rows as named above
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
