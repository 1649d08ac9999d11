"""Risk per unit: the installation is drawn once and stays, noise is drawn again at each shot.

A unit has its own offset ``d = m + N(0, S_unit) + columns u``; its shots scatter about it by the law of the shot.  Its
own p-quantile over shots is ``R(d)``, the p-quantile of |d + shot|.  Two numbers are wanted: a quantile of R(d) over
units, and the *yield* P_d(R(d) <= limit).  Both come from one sample of units, drawn in 16 independent blocks, whose
spread is the standard error.

Few units need a quantile of their own.  With r_s the p-quantile of |shot| and, for a Gaussian shot, s(d) its p-quantile
along d,

    |d| + s(d) <= R(d) <= |d| + r_s     for p >= 1/2,

the left because the ball of radius R lies in the half-space x'd <= R |d|, the right by the triangle inequality.
Pearson's closed form of R (``approximation.py``) errs little and smoothly from unit to unit: its range of errors at 32
units, taken three times as wide, brings the two bounds together.  Only units in between are solved, with the exact
Gaussian law of the shot.

The law of |d| is known exactly (``declared.py``), and |d| orders the units nearly as R does.  So it is the control
variate, of coefficient 1: its own quantile tells at which rank of the sample R is read, and the share of units with
|d| <= y is replaced by its probability, y being the distance of units whose R is the limit.

The optimiser compares neighbouring laws, so the quantile is continuous in both laws: the points are fixed, the Gaussian
part has its symmetric root (eigenvectors jump where eigenvalues cross), and the ranks of R and of |d| are averaged over
one tapered window.

A shot with bounded columns is taken as the Gaussian of equal covariance and then corrected: for about twelve units near
the quantile (or the limit) the declared law of d + shot is solved, and the mean difference shifts the result.  What
that leaves, the spread of the difference over those units, is added to the standard error.

Of two vectors that go together (``pairs.py``) R is that of the longer, solved for every unit from one small sample of
rays of the shot, and corrected in the same way by a large one: the small one alone is up to 5 % off, alike in all
units.  What the large one leaves, at units near the value, is part of the standard error.

Of one number that counts on one side R is the unit's offset and the quantile of its shots, the same for all: exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..geometry.arrays import Array
from ..kernels.numerics import principal_axes
from ..kernels.store import kernel
from ..laws import shape_deviates
from .approximation import pearson_square
from .declared import (
    LawGradient,
    LawQuantile,
    LinearLaw,
    OneSidedLaw,
    law_cdf,
    law_gradient,
    law_quantile,
    quantiles_at,
)
from .gaussian import norm_gradient_jit, norm_quantile_jit, norm_quantiles, probability_iv
from .pairs import PairSample, lengths_of, sample_pair
from .sampling import mean_and_error

BLOCKS = 16
CORRECTED = 12  # units whose declared law is solved where a shot has bounded columns
PILOT = 32
WINDOW = 25  # ranks within 1/25 of all units are averaged: narrower ones leave the optimiser no slope to settle by
LOG2_RAYS = 4  # of each of 16 scramblings, of the shot of a pair, that R of every unit is solved from
STEP_OF_R = 1e-3  # relative, of a density by differences
SEED = 20240229


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
    units: int  # that were drawn; 0: none, as their law is known


@dataclass(frozen=True, slots=True, eq=False)
class Units:
    """A sample of n installed units, what is known of each, and the law of their shots."""

    p: float
    shot: LinearLaw
    shot_covariance: Array  # (3, 3) mm^2, total: what the shot is first taken to be a Gaussian of
    mixed: bool  # whether R near the value is corrected: the shape of the shot's columns matters, or R is by few rays
    offset: Array  # (n, 3) mm; of two vectors (n, 6)
    distance: Array  # (n,) mm, |offset|
    low: Array  # (n,) mm, bounds of R for the Gaussian shot
    high: Array  # (n,) mm
    rays: PairSample | None = None  # of the shot, of two vectors: many; the bounds are R by few then

    @property
    def blocks(self) -> int:
        """Independent parts of the sample; 1 when all units are alike, and then n is 1."""
        return BLOCKS if self.distance.size > 1 else 1

    def solve_first(self, which: NDArray[np.intp]) -> Array:
        """R (k,) of these units before it is corrected: of the Gaussian shot, or of two vectors by few rays."""
        return self.high[which] if self.rays else norm_quantiles(self.p, self.offset[which], self.shot_covariance)

    def solve_declared(self, which: NDArray[np.intp], own: Array) -> Array:
        """R (k,) of these units under the declared law of the shot; own (k,): before it is corrected."""
        if self.rays:
            return self.rays.quantiles(self.offset[which], self.p, self.shot.pair_room, own)
        return quantiles_at(self.shot, self.offset[which], self.p)

    def doubt_of_rays(self, near: NDArray[np.intp], own: Array) -> float:
        """By how much rays leave R of these units, own (k,), open: a standard error of them all."""
        if self.rays is None or not near.size or not own.all():
            return 0.0
        room = self.shot.pair_room
        ends = ((1 - STEP_OF_R) * own, own, (1 + STEP_OF_R) * own)
        pairs = (zip(self.offset[near], radii.tolist(), strict=True) for radii in ends)
        below, at, above = (np.mean([self.rays.shares(d, r, room) for d, r in each], axis=0) for each in pairs)
        density = float((above - below).mean() / (2 * STEP_OF_R * own.mean()))
        return mean_and_error(at)[1] / density if density > 0 else 0.0

    def standard_error(self, value: Array) -> float:
        """Of the mean of value (n,), from the means of the blocks."""
        if self.blocks == 1:
            return 0.0
        return float(value.reshape(self.blocks, -1).mean(axis=1).std(ddof=1)) / sqrt(self.blocks)


@lru_cache(maxsize=12)
def unit_coordinates(normals: int, kinds: tuple[int, ...], log2_units: int) -> tuple[Array, Array]:
    """(z (n, normals) standard normal, u (n, K) on (-1, 1), of these laws) of n = 16 x 2^log2_units units; read-only.

    Each block is a Latin hypercube: every coordinate takes each of 2^log2_units equal parts of its range once.
    """
    count = 1 << log2_units
    blocks = []
    for block in range(BLOCKS):
        rng = np.random.default_rng([SEED, block])
        ranks = rng.permuted(np.tile(np.arange(count), (normals + len(kinds), 1)), axis=1).T
        blocks.append((ranks + rng.random(ranks.shape)) / count)
    points = np.concatenate(blocks)
    z, u = ndtri(np.clip(points[:, :normals], 1e-16, 1 - 1e-16)), 2.0 * points[:, normals:] - 1.0
    u = shape_deviates(u, kinds)
    z.setflags(write=False)
    u.setflags(write=False)
    return z, u


def draw_units(installation: LinearLaw, shot: LinearLaw, p: float, log2_units: int) -> Units:
    """16 x 2^log2_units units with bounds of their own p-quantile.  Raises ValueError."""
    p = probability_iv(p)
    if shot.mean.any():
        raise ValueError(f"the shot's mean belongs to the installation; it must be 0 here, got {shot.mean.tolist()}")
    random, pair = installation.columns.any(axis=0), len(installation.mean) > 3
    offset = installation.mean[None]
    if random.any() or installation.covariance.any():
        if pair:
            variances, axes = np.linalg.eigh(installation.covariance)
        else:
            variances, _, axes = principal_axes(installation.mean, installation.covariance)
        z, u = unit_coordinates(len(variances), tuple(installation.kinds[random].tolist()), log2_units)
        columns = np.ascontiguousarray(installation.columns[:, random].T)
        offset = offset + z @ ((axes * np.sqrt(variances.clip(0.0))) @ axes.T) + u @ columns
    covariance = shot.total_covariance
    if pair:
        distance = lengths_of(offset, shot.room)
        if not covariance.any():
            return Units(p, shot, covariance, False, offset, distance, distance, distance)
        own, rays = _solve_pairs(p, offset, shot), sample_pair(shot.covariance, shot.columns, shot.kinds)
        return Units(p, shot, covariance, True, offset, distance, own, own, rays)
    distance = np.sqrt(np.einsum("ia,ia->i", offset, offset))
    low, high = _bound(p, offset, distance, covariance)
    return Units(p, shot, covariance, _shape_matters(shot), offset, distance, low, high)


def _solve_pairs(p: float, offset: Array, shot: LinearLaw) -> Array:
    """R (n,) of two vectors at offsets (n, 6), by few rays."""
    rays, room, alone = sample_pair(shot.covariance, shot.columns, shot.kinds, LOG2_RAYS), shot.pair_room, []
    for rows in (slice(0, 3), slice(3, 6)):
        own, covariance = offset[:, rows], shot.total_covariance[rows, rows]
        alone.append(_pearson_quantiles(p, own, np.linalg.norm(own, axis=1), covariance) - room[rows][:2].min())
    return rays.quantiles(offset, p, room, np.max(alone, axis=0))


def _bound(p: float, offset: Array, distance: Array, covariance: Array) -> tuple[Array, Array]:
    """Bounds (n,), (n,) of R at offsets (n, 3) for shots N(0, covariance): see the module's text."""
    wide = norm_quantile_jit(np.zeros(3), covariance, p)
    if wide == 0.0:
        return distance, distance
    spread = np.einsum("ia,ia->i", offset @ covariance, offset)  # d'S d
    low = np.zeros_like(distance)
    if p > 0.5:
        low = distance + ndtri(p) * np.sqrt(spread) / np.maximum(distance, 1e-300)
    high = np.maximum(distance + wide, low)
    closed = _pearson_quantiles(p, offset, distance, covariance)
    pilot = np.argsort(closed)[np.linspace(0, closed.size - 1, min(closed.size, PILOT)).astype(int)]
    error = norm_quantiles(p, offset[pilot], covariance) - closed[pilot]
    low = np.maximum(low, closed + 2.0 * error.min() - error.max())
    return low, np.maximum(np.minimum(high, closed + 2.0 * error.max() - error.min()), low)


def _pearson_quantiles(p: float, offset: Array, distance: Array, covariance: Array) -> Array:
    """R (n,) by Pearson's closed form, at offsets (n, 3) of these lengths (n,), for shots N(0, covariance)."""
    square = covariance @ covariance
    c1 = np.trace(covariance) + distance**2
    c2 = np.trace(square) + 2.0 * np.einsum("ia,ia->i", offset @ covariance, offset)
    c3 = np.trace(square @ covariance) + 3.0 * np.einsum("ia,ia->i", offset @ square, offset)
    return np.asarray(np.sqrt(pearson_square(c1, c2, c3, float(ndtri(p))).clip(0.0)))


def _shape_matters(shot: LinearLaw) -> bool:
    """Whether taking the shot's columns as Gaussian may change a probability by more than 1e-5.

    A column changes the characteristic function by at most ``max_x x^4/180 exp(-x^2 / (2 rho^2)) = 0.012 rho^4``,
    rho^2 = h'S^-1 h (``lattice.fold_small``).
    """
    columns = shot.columns[:, shot.columns.any(axis=0)]
    variances, _, axes = principal_axes(shot.mean, shot.covariance)
    if not columns.size:
        return False
    if not variances[2] > 1e-9 * variances[0]:
        return True
    along = ((axes.T @ columns) ** 2 / variances[:, None]).sum(axis=0)
    return float(0.012 * (along**2).sum()) > 1e-5


def solve_between(units: Units, first: int, last: int) -> Array:
    """R (n,) of all units: exact for those of the ranks first ... last, from 0, elsewhere the middle of the bounds.

    The order statistics of R lie between those of its bounds; only units that may reach across need solving.
    """
    floor, ceiling = np.partition(units.low, first)[first], np.partition(units.high, last)[last]
    across = (units.low <= ceiling) & (units.high >= floor) & (units.low < units.high)
    own = 0.5 * (units.low + units.high)
    own[across] = norm_quantiles(units.p, units.offset[across], units.shot_covariance)
    return own


def _correct(units: Units, near: NDArray[np.intp], own: Array, weight: Array | None = None) -> tuple[float, float]:
    """(mean, standard deviation) over these units (k,) of R under the declared law of the shot less own (k,).

    weight: (k,) of the units in both, equal by default.
    """
    if not units.mixed or near.size == 0:
        return 0.0, 0.0
    difference = units.solve_declared(near, own) - own
    mean = float(np.average(difference, weights=weight))
    return mean, sqrt(float(np.average((difference - mean) ** 2, weights=weight)))


@kernel()
def average_rank(ranked: Array, width: int, rank: int) -> float:
    """The mean of the ascending values (n,) about a rank, weights a triangle of this half-width."""
    total = 0.0
    weight = 0.0
    for k in range(max(rank - width + 1, 0), min(rank + width, ranked.size)):
        total += (width - abs(k - rank)) * ranked[k]
        weight += width - abs(k - rank)
    return total / weight


@kernel()
def average_at(ranked: Array, width: int, position: float) -> float:
    """:func:`average_rank` between ranks, by linear interpolation: continuous in the position, which is from 0 to
    n - 1, and ascending as the values (n,) are."""
    rank = min(int(position), ranked.size - 1)
    here = average_rank(ranked, width, rank)
    return here + (position - rank) * (average_rank(ranked, width, min(rank + 1, ranked.size - 1)) - here)


@kernel()
def position_of(ranked: Array, width: int, value: float) -> float:
    """Where :func:`average_at` has this value; one of the ends where it is beyond."""
    low, high = 0, ranked.size
    while high - low > 1:
        middle = (low + high) // 2
        if average_rank(ranked, width, middle) <= value:
            low = middle
        else:
            high = middle
    here = average_rank(ranked, width, low)
    if high == ranked.size or value <= here:
        return float(low)
    return low + (value - here) / (average_rank(ranked, width, high) - here)


@dataclass(frozen=True, slots=True, eq=False)
class UnitReading:
    """A sample of units, R of those that decide the fraction-quantile of all, and the quantile of its control, |d|."""

    installation: LinearLaw
    units: Units
    distance: LawQuantile  # of |d|
    width: int  # half of the triangle that ranks are averaged over
    position: float  # of its middle
    by_distance: NDArray[np.intp]  # (n,) units by |d|
    own: Array  # (n,) mm, R: solved over twice the window, of which some may enter it, and from which its slope is read
    corrected: int  # how many units are solved under the declared law of the shot

    @property
    def quantile(self) -> UnitQuantile:
        """The fraction-quantile of R over units."""
        units, width, position, own = self.units, self.width, self.position, self.own
        n, order = own.size, np.argsort(own)
        rank, distance_rank = np.empty(n), np.empty(n)
        rank[order] = distance_rank[self.by_distance] = np.arange(n)
        weight = width - np.abs(rank - position)
        # A unit is taken by its number in the sample: neighbouring laws take the same ones.
        near = np.flatnonzero(weight[: max(self.corrected * n // (2 * width), 1)] > 0)
        shift, error = _correct(units, near, own[near], weight[near])
        ends = max(position - width, 0.0), min(position + width, n - 1.0)
        ranked = own[order]
        low, value, high = (average_at(ranked, width, at) for at in (ends[0], position, ends[1]))
        density = 0.0
        if units.blocks > 1:
            slope = (high - low) * n / (ends[1] - ends[0])
            density = 1 / slope if slope > 0 else 0.0
            # The indicators R <= value and |d| <= y, each a ramp across the window.
            inside, control = (np.clip((position - r) / (2 * width) + 0.5, 0, 1) for r in (rank, distance_rank))
            share_error = hypot(units.standard_error(inside - control), 1 / (n * sqrt(2 * width)))
            error = hypot(error, share_error * slope, self.distance.error_mm)
        error = hypot(error, units.doubt_of_rays(near, own[near] + shift))
        return UnitQuantile(value + shift, error, density)

    def gradient(self) -> tuple[LawGradient, Array]:
        """Derivatives of the quantile: by the law of the installation, and by the covariance of the shot (3, 3), 1/mm,
        its columns taken as normal.

        The units stay the same ones, so each has a derivative of its own: of R, which averages over the ranks as the
        value does, and of |d|, which moves the place that the ranks are read at.
        """
        installation, units, width, position, own = self.installation, self.units, self.width, self.position, self.own
        control = law_gradient(installation, self.distance, fine=False)
        n, order = own.size, np.argsort(own)
        weight, control_weight = np.zeros(n), np.zeros(n)
        steepness = []
        for weights, by, value in ((weight, order, own), (control_weight, self.by_distance, units.distance)):
            at, after = (_rank_weights(n, width, min(int(position) + step, n - 1)) for step in (0, 1))
            weights[by] = at + (position - int(position)) * (after - at)
            steepness.append(float((after - at) @ value[by]))
        ratio = steepness[0] / steepness[1] if steepness[1] > 0 else 0.0
        each = np.flatnonzero(weight)
        by_offset, by_shot = mean_gradients(units.p, units.offset[each], units.shot_covariance, weight[each])
        moved = np.zeros((n, 3))
        moved[each] = by_offset
        moved -= ratio * (control_weight / np.maximum(units.distance, 1e-300))[:, None] * units.offset
        random = installation.columns.any(axis=0)
        by_column, by_covariance = np.zeros(installation.kinds.size), np.zeros((3, 3))
        if n > 1:
            variances, _, axes = principal_axes(installation.mean, installation.covariance)
            z, u = unit_coordinates(3, tuple(installation.kinds[random].tolist()), (n // BLOCKS).bit_length() - 1)
            by_column[random] = np.einsum("ia,aj,ij->j", moved, installation.columns[:, random], u)
            root = np.sqrt(variances)
            # The symmetric root X of S has X dX + dX X = dS
            turned = axes.T @ (moved.T @ z) @ axes / np.maximum(np.add.outer(root, root), 1e-300)
            by_covariance = axes @ (0.5 * (turned + turned.T) * (np.minimum.outer(root, root) > 0)) @ axes.T
        return LawGradient(
            moved.sum(axis=0) + ratio * control.by_mean,
            by_covariance + ratio * control.by_covariance,
            by_column + ratio * control.by_log_column,
        ), by_shot


@dataclass(frozen=True, slots=True, eq=False)
class SignedReading:
    """Of one number that counts on one side: what of the units' own offset and what of the shots, whose quantile is the
    same in all of them.  Their sum is what the fraction of units keeps."""

    installation: LinearLaw
    shot: LinearLaw
    held: LawQuantile
    again: LawQuantile

    @property
    def quantile(self) -> UnitQuantile:
        """As that of :class:`UnitReading`."""
        value = max(self.held.quantile_mm + self.again.quantile_mm, 0.0)
        error = hypot(self.held.error_mm, self.again.error_mm)
        return UnitQuantile(value, error, self.held.density if value else 0.0)

    def gradient(self) -> tuple[LawGradient, Array]:
        """As that of :class:`UnitReading`."""
        here = float(self.held.quantile_mm + self.again.quantile_mm > 0)
        by_unit, by_shots = law_gradient(self.installation, self.held), law_gradient(self.shot, self.again)
        return LawGradient(*(here * part for part in by_unit)), here * by_shots.by_covariance


def read_units(
    installation: LinearLaw, shot: LinearLaw, p: float, fraction: float, log2_units: int = 8, corrected: int = CORRECTED
) -> UnitReading | SignedReading:
    """What the fraction-quantile over installed units of a unit's own p-quantile over shots, and its derivatives, are
    read from; continuous in both laws.

    installation: law of a unit's offset (its mean included); shot: law of what changes from shot to shot, mean 0; both
    in mm and one frame.  16 x 2^log2_units units are drawn, the same ones each time.  Raises ValueError.
    """
    fraction = probability_iv(fraction)
    if installation.is_one_sided:
        held = OneSidedLaw(installation, fraction, True).signed_quantile(fraction)
        return SignedReading(installation, shot, held, OneSidedLaw(shot, p, True).signed_quantile(p))
    units, distance = draw_units(installation, shot, p, log2_units), law_quantile(installation, fraction, fine=False)
    n = units.distance.size
    width = max(min(n // WINDOW, int(n * min(fraction, 1 - fraction))), 1)
    by_distance = np.argsort(units.distance)
    position = position_of(units.distance[by_distance], width, distance.quantile_mm)
    own = solve_between(units, max(int(position) - 2 * width, 0), min(int(position) + 2 * width + 1, n - 1))
    return UnitReading(installation, units, distance, width, position, by_distance, own, corrected)


def _rank_weights(n: int, width: int, rank: int) -> Array:
    """(n,) of :func:`average_rank`."""
    weights = np.maximum(width - np.abs(np.arange(n) - rank), 0).astype(np.float64)
    return np.asarray(weights / weights.sum())


@kernel()
def mean_gradients(p: float, offset: Array, covariance: Array, weight: Array) -> tuple[Array, Array]:
    """Of the p-quantile of |N(d, S)| at each offset d (n, 3) mm: its derivative by d, times the weight (n, 3), and the
    weighted sum of those by S (3, 3), 1/mm; 0 where it did not converge."""
    by_offset = np.zeros((weight.size, 3))
    by_covariance = np.zeros((3, 3))
    for i in range(weight.size):
        r, _, by_mean, by_own = norm_gradient_jit(offset[i].copy(), covariance, p)
        if r == r:
            by_offset[i] = weight[i] * by_mean
            by_covariance += weight[i] * by_own
    return by_offset, by_covariance


def unit_risk(
    installation: LinearLaw,
    shot: LinearLaw,
    p: float,
    limit: float | None = None,
    fraction: float = 0.95,
    log2_units: int = 8,
) -> UnitRisk:
    """The quantile of :func:`read_units` and, of the same units, the yield at a limit, mm.  Raises ValueError."""
    if limit is not None and not limit >= 0:
        raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    fraction = probability_iv(fraction)
    read = read_units(installation, shot, p, fraction, log2_units)
    found = read.quantile
    if isinstance(read, SignedReading):
        own = read.again.quantile_mm
        keep = None if limit is None else OneSidedLaw(installation, fraction, True).probability(limit - own)
        return UnitRisk(p, fraction, found.value_mm, found.standard_error_mm, limit, keep, keep and 0.0, 0)
    share, error = None, None
    if limit is not None:
        share, error = _yield(read.units, installation, limit)
        share = _agree(share, fraction, found.value_mm <= limit, read.units.blocks > 1)
    n = read.units.distance.size
    return UnitRisk(read.units.p, fraction, found.value_mm, found.standard_error_mm, limit, share, error, n)


def _agree(share: float, fraction: float, within: bool, differ: bool) -> float:
    """The yield, on the side of the required fraction on which the quantile is of the limit.

    ``F(limit) >= fraction`` is ``Q(fraction) <= limit`` for one law of R.  Quantile and yield are estimated with other
    controls, each the best for its own, so near one another they may disagree by less than their errors.
    """
    if not differ:
        return 1.0 if within else 0.0
    return max(share, fraction) if within else min(share, float(np.nextafter(fraction, 0.0)))


def _yield(units: Units, installation: LinearLaw, limit: float) -> tuple[float, float]:
    """(fraction of units with R <= limit, its standard error)."""
    if units.rays:
        near = np.argsort(np.abs(units.high - limit))[:CORRECTED]
    else:
        near = np.flatnonzero((units.low <= limit) & (units.high >= limit))
        near = near[np.unique(np.linspace(0, near.size - 1, min(near.size, CORRECTED)).astype(int))]
    shift, doubt = 0.0, 0.0
    if units.mixed:
        shift, doubt = _correct(units, near, units.solve_first(near))
    level = limit - shift  # what R for the Gaussian shot must not exceed
    good = units.high <= level
    between = ~good & (units.low <= level)
    good[between] = norm_quantiles(units.p, units.offset[between], units.shot_covariance) <= level
    radius = distance_at(units, level)
    within = 0.0 if np.isnan(radius) else law_cdf(installation, radius, fine=False)
    excess = good - 1.0 * (units.distance <= radius)
    share = min(max(float(excess.mean()) + within, 0.0), 1.0)
    # Units within the correction's own spread of the level, counted by their lower bound.
    unsure = float((np.abs(units.low - level) <= doubt).mean()) / 2 if doubt else 0.0
    coarse = 0.5 / good.size if 0.0 < share < 1.0 else 0.0
    return share, hypot(units.standard_error(excess), unsure, coarse)


def distance_at(units: Units, level: float) -> float:
    """The |d| of units with R at the level, by the hundredth of all that is nearest to it; NaN beyond everybody's."""
    middle = 0.5 * (units.low + units.high)
    count = max(middle.size // 100, 1)
    near = np.argpartition(np.abs(middle - level), count - 1)[:count]
    distance = level - float((middle - units.distance)[near].mean())
    return distance if units.distance.min() < distance < units.distance.max() else np.nan
