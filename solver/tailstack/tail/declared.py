"""The law of |e| for the linear model with its declared tolerances: uniform and triangular ones as they are.

    e = m + N(0, S) + sum_j h_j u_j,       u_j on (-1, 1) by a law in SUMS (uniform, triangular), independent

Exact by a lattice sum of the characteristic function (``lattice.py``).  A law with no column is Gaussian and goes to
``gaussian.py``.  A law too sharp for the lattice (its spread in some direction tiny beside r, or few bounded
sources and no noise) goes to randomised quasi-Monte-Carlo with one source integrated exactly (``sampling.py``).
Which it was, and how far off it may be, is part of the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, reduce
from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..geometry.arrays import Array
from ..kernels.numerics import principal_axes, sine_and_cosine
from ..kernels.store import kernel
from ..laws import PARTS, SUMS
from .approximation import pearson_square
from .gaussian import (
    cumulant,
    gaussian_cumulants,
    mean_on_axes,
    norm_cdf,
    norm_excess,
    norm_gradient_jit,
    norm_sf,
    normal_quantile,
    probability_iv,
    quantile_on_axes,
    sound,
)
from .lattice import (
    Accuracy,
    Lattice,
    PrincipalLaw,
    ball_integral,
    ball_sums,
    balls,
    build,
    flat_balls,
    on_principal_axes,
    reach_of,
    sum_of_products,
)
from .pairs import LOG2_POINTS, LOG2_RARE, SMALLEST_MM, PairGradient, PairSample, sample_pair
from .sampling import Sample, mean_and_error, sample

_WIDTHS = np.array([PARTS[law] for law in SUMS])  # (laws, 2)
_VARIANCES = (_WIDTHS**2).sum(axis=1) / 3

GAUSSIAN_METHOD = "exact (Gaussian, contour integral)"
LATTICE_METHOD = "exact (characteristic function on a lattice)"
SAMPLED_METHOD = "randomised quasi-Monte-Carlo of the linear model"
PAIR_METHOD = "exact at the worse end, what the other adds by rays"
# Standard error of a probability, of itself and besides, beyond which more is drawn
RARE_ERROR, RARE_FLOOR = 0.01, 1e-7

# Terms smaller than this are left out of a lattice sum: for the answer itself, and for the many laws of a budget.
_FINE, _COARSE = 5e-10, 4e-7
_LARGEST_BOX = 2e6  # lattice points looked at (about 30 ms) before sampling takes over
_LARGEST_COARSE_BOX = 2e5
_OF_CHANCES = Accuracy(1.5e-9, 3e-9, _LARGEST_BOX)  # of which a bound takes 1e-7 off
_LOG2_POINTS, _LOG2_COARSE = 12, 10
_FORGIVEN, _END = 30.0, 1e3  # how much coarser integrals over the radius are: threshold, probability beyond
_NO_OFFSET = 1e-24  # of a square: what rounding leaves of a mean in the plane beyond it
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(80)
_AROUND, _CHEBYSHEV = 0.015, -np.cos(np.pi * (np.arange(8) + 0.5) / 8)  # of a radius; where polynomials are taken from
FAR = 10.0  # standard deviations within which all of a law is: beyond is less than exp(-50)
MIXTURE_STEP, LARGEST_MIXTURE = 1.05, 1e12  # of the radius that is tried next; mm at which it is given up
WITHIN = 1e-4  # of its order, in which a quantile in the middle of a part may be off
_INTERVALS, _ROUNDS = 24, 60  # of the chords that these are found by


@dataclass(frozen=True, slots=True, eq=False)
class LinearLaw:
    """e = mean + N(0, covariance) + columns @ u, in mm; any frame, the same for all three.

    columns are already multiplied by the half-widths: column j is the displacement at u_j = 1.  Of two vectors that go
    together (6 in place of 3) |e| is the length of the longer; with room, the smallest r at which both are within
    ellipsoids of half-axes r + room.  Of one number that counts on one side |e| is max(e[0], 0).
    """

    mean: Array  # (3,) mm
    covariance: Array  # (3, 3) mm^2: the Gaussian part only
    columns: Array  # (3, k) mm
    kinds: NDArray[np.int64]  # (k,) places in SUMS
    room: Array | None = None  # (6,) mm, of two vectors; 0 or more, the least of them 0; (1,) of one number: one side

    @property
    def is_one_sided(self) -> bool:
        """Whether what is above 0 counts of one number."""
        return self.room is not None and len(self.room) == 1

    @property
    def pair_room(self) -> Array:
        """(6,) mm: the room of two vectors, 0 where none is told."""
        return np.zeros(6) if self.room is None else self.room

    @property
    def total_covariance(self) -> Array:
        """(3, 3) mm^2, bounded sources included."""
        return np.asarray(self.covariance + (self.columns * _VARIANCES[self.kinds]) @ self.columns.T)

    @property
    def ends(self) -> tuple[LinearLaw, ...]:
        """Of each of two vectors by itself; otherwise itself."""
        if len(self.mean) == 3:
            return (self,)
        return tuple(
            LinearLaw(self.mean[k], np.ascontiguousarray(self.covariance[k, k]), np.ascontiguousarray(h), self.kinds)
            for k, h in ((k, self.columns[k]) for k in (slice(0, 3), slice(3, 6)))
        )

    def without_room(self, r: float) -> LinearLaw:
        """The law without room whose lengths are within r where those of this one are."""
        if self.room is None:
            return self
        scale = self.scale_at(r)
        covariance = self.covariance * np.outer(scale, scale)
        return LinearLaw(self.mean * scale, covariance, self.columns * scale[:, None], self.kinds)

    def scale_at(self, r: float) -> Array:
        """(6,) by which components of two vectors are multiplied then."""
        r = max(r, SMALLEST_MM)  # a radius of 0 has a law, too
        return np.ones(6) if self.room is None else r / (r + self.room)


def lattice_columns(law: LinearLaw) -> tuple[Array, NDArray[np.int64]]:
    """((K, 3) uniform columns, (K,) source of each): each law is the sum of one or two, ``laws.PARTS``.

    Columns of length zero are dropped.
    """
    return split_columns(np.ascontiguousarray(law.columns), law.kinds)


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


class LawGradient(NamedTuple):
    """Derivatives of a quantile.

    by_log_column[j]: mm per relative change of column j; divided by the half-width, mm per unit of half-width.
    For a Gaussian block B, ``sum(by_covariance * B)`` is mm per relative change of its variance, and twice that is
    mm per relative change of its standard deviation.
    """

    by_mean: Array  # (3,)
    by_covariance: Array  # (3, 3) 1/mm, symmetric
    by_log_column: Array  # (k,) mm


Quantiles = Sequence[tuple[LawQuantile, float]]  # of one law, each with its weight in a sum


def add_gradients(each: Sequence[LawGradient]) -> LawGradient:
    """Of a sum."""
    return LawGradient(*(reduce(np.add, parts) for parts in zip(*each, strict=True)))


class LawSummary(NamedTuple):
    """What a score says about a law."""

    quantile: LawQuantile
    mean_norm_mm: float
    cvar_mm: float
    exceedance: float | None  # of the limit; None without one


def accuracy_for(p: float, fine: bool) -> Accuracy:
    """For the probability p: far tails need smaller absolute errors.  Fine: 1e-8; else 1e-4, several times faster."""
    tail = min(p, 1.0 - p, 0.05) / 0.05
    if fine:
        return Accuracy(_FINE * tail, 1e-10 * tail, _LARGEST_BOX)
    return Accuracy(_COARSE * tail, 1e-6 * tail, _LARGEST_COARSE_BOX)


class _Terms(NamedTuple):
    """The terms of probabilities, and of a law in a plane or on a line what it does where the mean leaves that."""

    k: Array  # (n, 3) 1/mm
    even: Array  # (n,) the terms
    odd: Array  # (n,) with the sine of the phase in place of the cosine
    radius: float = 0.0  # mm, in the plane; 0: the law fills space
    tilt: Array = np.zeros(3)  # derivative of that by the mean
    rising_odd: Array = np.zeros(0)  # (n,) derivative of ``odd`` by the radius
    first: float = 0.0  # 1/mm: derivative of the probability by the radius
    second: float = 0.0  # 1/mm^2


class DeclaredLaw:
    """A law with columns, and the lattices that answers about it have been read from so far."""

    def __init__(self, law: LinearLaw, accuracy: Accuracy) -> None:
        self.law, self.accuracy = law, accuracy
        self.h, self.source = lattice_columns(law)
        self.frame: PrincipalLaw = on_principal_axes(law.mean, law.covariance, self.h)
        self._lattice: Lattice | None = None  # that the quantile was solved on
        self._largest = 0.0  # mm, the radius it serves, in the frame

    @cached_property
    def points(self) -> Sample:
        """A sample, where no lattice is small enough."""
        fine = self.accuracy.largest_box == _LARGEST_BOX
        return sample(self.law.mean, self.law.covariance, self.h, _LOG2_POINTS if fine else _LOG2_COARSE)

    @cached_property
    def _outer(self) -> tuple[float, Lattice]:
        """:func:`outer_lattice` of this law."""
        end, lattice = outer_lattice(self.frame, self.accuracy)
        return float(end), lattice

    def quantile(self, p: float) -> LawQuantile:
        """On the lattice that is there, where the radius is one that it serves."""
        if self._lattice is None or self._lattice.volume == 0.0:
            solution = solve_on_axes(p, self.frame, self.accuracy)
        else:
            solution = solve_on_lattice(p, self.frame, self.accuracy, self._largest, self._lattice)
        if not solution.found:
            r, density, error = self.points.quantile(p)
            return LawQuantile(p, r, density, SAMPLED_METHOD, error)
        self._lattice, self._largest = solution.lattice, float(solution.largest)
        r = solution.quantile
        density = float(solution.density * r / solution.radius)
        return LawQuantile(p, float(r), density, LATTICE_METHOD, float(solution.error / density))

    @cached_property
    def _farthest_square(self) -> float:
        """In the frame, mm^2: nothing that counts is beyond its root."""
        farthest = np.abs(self.frame.mean) + reach_of(self.frame, self.accuracy.aliasing)
        return float((farthest**2).sum())

    def _is_certain(self, r: float) -> bool:
        """Whether nothing that counts is beyond r."""
        return r * r >= self.frame.offset + self._farthest_square

    def probability(self, r: float) -> float:
        """P(|e| <= r)"""
        if r * r <= self.frame.offset:
            return 0.0
        if self._is_certain(r):
            return 1.0
        rho, lattice = sqrt(r * r - self.frame.offset), self._lattice
        if lattice is None or rho > self._largest:
            lattice = build(rho, self.frame, self.accuracy, False)
            self._lattice, self._largest = lattice, rho
        if lattice.volume == 0.0:
            return self.points.probability(r)
        return min(max(float(ball_sums(rho, self.frame.dimension, lattice.t, lattice.w)[0]), 0.0), 1.0)

    def probabilities(self, radii: Array) -> Array:
        """P(|e| <= r) at each radius, (n,) mm, all from one lattice."""
        square = radii**2 - self.frame.offset
        chances = np.where(square >= self._farthest_square, 1.0, 0.0)
        between = (square > 0.0) & (chances == 0.0)
        if between.any():
            self.probability(float(radii[between].max()))  # which has a lattice that serves them all
            chances[between] = (
                probabilities_within(np.sqrt(square[between]), self.frame.dimension, self._lattice.t, self._lattice.w)
                if self._lattice is not None and self._lattice.volume > 0.0
                else [self.points.probability(r) for r in radii[between].tolist()]
            )
        return chances

    def exceedance(self, r: float) -> float:
        """P(|e| > r)"""
        return 1.0 - self.probability(r)

    def probability_gradient(self, r: float) -> tuple[float, LawGradient] | None:
        """P(|e| <= r) and its derivatives, of one lattice; None: it has none."""
        if r * r <= self.frame.offset or self._is_certain(r):
            none = LawGradient(np.zeros(3), np.zeros((3, 3)), np.zeros(self.law.kinds.size))
            return float(r * r > self.frame.offset), none
        if (terms := self._terms_at([(r, 1.0)])) is None:
            return None
        return float(terms[0].even.sum()), self._lattice_gradient(terms[0])

    def excess(self, r: float) -> float:
        """E[(|e| - r)+] = int_r^R (1 - P(|e| <= x)) dx, mm, R at the end of the law."""
        radius, lattice = self._outer
        end = sqrt(radius**2 + self.frame.offset)
        if r >= end:
            return 0.0
        if lattice.volume == 0.0:
            return self.points.excess(r)
        return float(excess_integral(r, end, self.frame, lattice.t, lattice.w))

    def gradient(self, mixture: Quantiles) -> LawGradient:
        """By the implicit function theorem, of a sum of quantiles of this law; a decade finer than the quantiles of
        this accuracy, as derivatives weight the far terms by up to k^2 more."""
        terms = self._terms_of(mixture)
        if terms is not None:
            return add_gradients([self._lattice_gradient(each) for each in terms])
        points = sample(self.law.mean, self.law.covariance, self.h, _LOG2_POINTS)
        each = ((points.gradient(quantile.quantile_mm, self.h), weight) for quantile, weight in mixture)
        total = add_gradients([LawGradient(*(weight * part for part in parts)) for parts, weight in each])
        return total._replace(by_log_column=self._by_source(total.by_log_column))

    def _terms_of(self, mixture: Quantiles) -> list[_Terms] | None:
        """:meth:`_terms_at` each quantile times ``-weight / density``; None: it has none."""
        if any(total.method == SAMPLED_METHOD or total.density == 0.0 for total, _ in mixture):
            return None
        return self._terms_at([(total.quantile_mm, -weight / total.density) for total, weight in mixture])

    def _terms_at(self, scaled: Sequence[tuple[float, float]]) -> list[_Terms] | None:
        """Those of the probability at each radius, mm, times its scale, in space of all in one, on a lattice of the law
        moved to mean 0, a decade finer than that of the quantiles; None: it has none."""
        accuracy, dimension = self.accuracy._replace(threshold=0.1 * self.accuracy.threshold), self.frame.dimension
        offset = self.frame.offset if dimension < 3 else 0.0
        each = [(sqrt(r**2 - offset), scale) for r, scale in scaled]
        lattice = build(max(each)[0], self.frame._replace(mean=np.zeros(3)), accuracy, True)
        if lattice.volume == 0.0:
            return None
        phase = lattice.k @ self.frame.mean
        cosine, sine = (np.cos(phase), np.sin(phase)) if phase.any() else (np.ones(len(phase)), phase)
        if dimension == 3:
            ball = lattice.w * sum(scale * balls(radius, lattice.t) for radius, scale in each)
            return [_Terms(lattice.k, ball * cosine, ball * sine)]
        terms = []
        for radius, scale in each:
            ball, rising, bent = (scale * lattice.w * f for f in flat_balls(radius, dimension, lattice.t))
            tilt = np.where(self.frame.sigma > 0.0, 0.0, -(self.law.mean @ self.frame.axes) / radius)
            first, second = float(rising @ cosine), float(bent @ cosine)
            terms.append(_Terms(lattice.k, ball * cosine, ball * sine, radius, tilt, rising * sine, first, second))
        return terms

    def column_gradient(self, mixture: Quantiles) -> Array | None:
        """(3, k) by each entry of the columns; None where there is no lattice.

        A uniform column h is the factor sin x / x of every term, x = k'h, whose logarithm has the derivative
        ``(cot x - 1 / x) k`` by h.
        """
        terms = self._terms_of(mixture)
        return None if terms is None else reduce(np.add, [self._column_gradient(each) for each in terms])

    def _column_gradient(self, terms: _Terms) -> Array:
        k, even, axes = terms.k, terms.even, self.frame.axes
        gradient = np.zeros((3, self.law.kinds.size))
        narrow = np.arange(self.source.size) >= np.unique(self.source).size
        shares = _WIDTHS[self.law.kinds[self.source], narrow.astype(np.int64)]
        for h, source, share in zip(self.frame.h, self.source, shares, strict=True):
            x = k @ h
            sine, near = np.sin(x), np.abs(x) < 1e-2
            far = np.where(near, 1.0, x)
            slope = np.where(near, -x / 3 - x**3 / 45, np.cos(x) * sine / np.maximum(sine**2, 1e-24) - 1 / far)
            gradient[:, source] += share * (axes @ ((even * slope) @ k))
            if terms.radius:
                gradient[:, source] += share * (axes @ (terms.rising_odd @ slope * terms.tilt))
        return gradient

    def _lattice_gradient(self, terms: _Terms) -> LawGradient:
        k, even, axes = terms.k, terms.even, self.frame.axes
        by_mean = -terms.odd @ k
        by_covariance = -0.5 * (k.T * even) @ k
        if terms.radius:  # beyond the plane, where the radius in it is sqrt(r^2 - |m|^2): half the Hessian by the mean
            across, beyond = np.outer(terms.rising_odd @ k, terms.tilt), np.outer(terms.tilt, terms.tilt)
            bend = terms.second * beyond - terms.first / terms.radius * (np.diag(self.frame.sigma == 0.0) + beyond)
            by_mean = by_mean + terms.first * terms.tilt
            by_covariance = by_covariance + 0.5 * (bend - across - across.T)
        by_column = self._by_source(column_slopes(even, k, self.frame.h))
        return LawGradient(axes @ by_mean, axes @ by_covariance @ axes.T, by_column)

    def _by_source(self, by_column: Array) -> Array:
        """(k,) sums over the uniform columns of each source."""
        return np.bincount(self.source, by_column, self.law.kinds.size).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class GaussianLaw:
    """A law without columns: what :class:`DeclaredLaw` answers, by the contour integral."""

    law: LinearLaw

    def quantile(self, p: float) -> LawQuantile:
        law = self.law
        if not law.covariance.any():
            return LawQuantile(p, float(np.linalg.norm(law.mean)), 0.0, GAUSSIAN_METHOD, 0.0)
        found, density, _, _ = norm_gradient_jit(law.mean, law.covariance, p)
        r = sound(found, "the quantile", law.mean, law.covariance)
        return LawQuantile(p, r, float(density), GAUSSIAN_METHOD, 1e-12 * r)

    def probability(self, r: float) -> float:
        """P(|e| <= r)"""
        return norm_cdf(r, self.law.mean, self.law.covariance)

    def exceedance(self, r: float) -> float:
        """P(|e| > r), to 1e-12 of itself."""
        return norm_sf(r, self.law.mean, self.law.covariance)

    def probability_gradient(self, r: float) -> tuple[float, LawGradient]:
        """P(|e| <= r) and its derivatives."""
        chance, none = self.probability(r), np.zeros(self.law.kinds.size)
        if not 0.0 < chance < 1.0:
            return chance, LawGradient(np.zeros(3), np.zeros((3, 3)), none)
        _, density, by_mean, by_covariance = norm_gradient_jit(self.law.mean, self.law.covariance, chance)
        return chance, LawGradient(-density * by_mean, -density * by_covariance, none)

    def excess(self, r: float) -> float:
        """E[(|e| - r)+], mm."""
        return norm_excess(r, self.law.mean, self.law.covariance)

    def gradient(self, mixture: Quantiles) -> LawGradient:
        each = [
            [weight * part for part in norm_gradient_jit(self.law.mean, self.law.covariance, total.p)[2:]]
            for total, weight in mixture
        ]
        return add_gradients([LawGradient(m, c, np.zeros(self.law.kinds.size)) for m, c in each])

    def column_gradient(self, mixture: Quantiles) -> Array | None:
        return np.zeros_like(self.law.columns)


class OneSidedLaw:
    """A law of max(x, 0), x the one number that varies: that of |x + shift|, less a shift from which nothing reaches
    below 0."""

    def __init__(self, law: LinearLaw, p: float, fine: bool) -> None:
        self.law = law
        self.shift = abs(float(law.mean[0])) + FAR * sqrt(float(law.total_covariance[0, 0]))
        moved = law.mean + np.array([self.shift, 0.0, 0.0])
        self.whole = single_evaluation(LinearLaw(moved, law.covariance, law.columns, law.kinds), p, fine)

    def signed_quantile(self, p: float) -> LawQuantile:
        """Of x itself, which may be below 0."""
        found = self.whole.quantile(p)
        return found._replace(quantile_mm=found.quantile_mm - self.shift)

    def quantile(self, p: float) -> LawQuantile:
        """Where it is 0 it has no density there, and no slope."""
        found = self.signed_quantile(p)
        return found if found.quantile_mm > 0 else found._replace(quantile_mm=0.0, density=0.0)

    def probability(self, r: float) -> float:
        """P(x <= r)"""
        return self.whole.probability(r + self.shift) if r > -self.shift else 0.0

    def exceedance(self, r: float) -> float:
        """P(x > r)"""
        return self.whole.exceedance(r + self.shift)

    def excess(self, r: float) -> float:
        """E[(x - r)+], mm."""
        return self.whole.excess(r + self.shift)

    def gradient(self, mixture: Quantiles) -> LawGradient:
        return self.whole.gradient(self._move(mixture))

    def column_gradient(self, mixture: Quantiles) -> Array | None:
        return self.whole.column_gradient(self._move(mixture))

    def _move(self, mixture: Quantiles) -> Quantiles:
        """Those with a slope, of x + shift."""
        return [(q._replace(quantile_mm=q.quantile_mm + self.shift), w) for q, w in mixture if q.density > 0]


class PairLaw:
    """A law of two vectors: P(both <= r) = P(|x_1| <= r) - P(|x_1| <= r < |x_2|), 1 the one that is longer at p.

    The first is exact, the second sampled, with a standard error over 16 scramblings.
    """

    def __init__(self, law: LinearLaw, p: float, fine: bool) -> None:
        self.law, self.p, self.fine = law, p, fine
        self.room = law.pair_room
        members = [single_evaluation(end, p, fine) for end in law.ends]
        quantiles = [member.quantile(p) for member in members]
        self.highest = max(quantile.quantile_mm for quantile in quantiles)  # that one alone is not beyond at p
        each = [quantile.quantile_mm - least for quantile, least in zip(quantiles, self._least_room, strict=True)]
        self.first = int(each[1] > each[0])
        self._longer, self.alone = members[self.first], quantiles[self.first]

    @property
    def _least_room(self) -> list[float]:
        """Of the components in which each vector varies, mm."""
        moves = (self.law.total_covariance.diagonal() > 0.0) | (self.law.mean != 0.0)
        return [float(self.room[k][moves[k]].min(initial=inf)) for k in (slice(0, 3), slice(3, 6))]

    def longer_at(self, r: float) -> DeclaredLaw | GaussianLaw:
        """The first alone, as it is within r."""
        if self.law.room is None:
            return self._longer
        return single_evaluation(self.law.without_room(r).ends[self.first], self.p, self.fine)

    @cached_property
    def points(self) -> PairSample:
        return self._sample(LOG2_POINTS)

    @cached_property
    def rare_points(self) -> PairSample:
        """Sixteen times as many."""
        return self._sample(LOG2_RARE)

    def _sample(self, log2_points: int) -> PairSample:
        return sample_pair(self.law.covariance, self.law.columns, self.law.kinds, log2_points)

    def probability_added(self, r: float, rare: bool = False) -> tuple[float, float]:
        """P(|x_1| <= r < |x_2|), and its standard error."""
        points = self.rare_points if rare else self.points
        return mean_and_error(points.outside(self.law.mean, r, self.room, self.first))

    def quantile(self, p: float) -> LawQuantile:
        low = 0.0
        if self.law.room is None:
            low = self.alone.quantile_mm if p == self.alone.p else self._longer.quantile(p).quantile_mm
        r = find_radius(self.probability, p, low or self.highest, low)
        density = (self.probability(1.001 * r) - self.probability(0.999 * r)) / (0.002 * r) if r else 0.0
        return LawQuantile(p, r, density, PAIR_METHOD, self.probability_added(r)[1] / density if density else 0.0)

    def probability(self, r: float) -> float:
        """P(|e| <= r)"""
        return max(self.longer_at(r).probability(r) - self.probability_added(r)[0], 0.0)

    def exceedance(self, r: float) -> float:
        """P(|e| > r)"""
        return self.exceedance_with_error(r)[0]

    def exceedance_with_error(self, r: float) -> tuple[float, float]:
        """The same, and the standard error of what is sampled of it."""
        alone, (added, error) = self.longer_at(r).exceedance(r), self.probability_added(r)
        if error > RARE_ERROR * (alone + added) + RARE_FLOOR:
            added, error = self.probability_added(r, rare=True)
        return alone + added, error

    def excess(self, r: float) -> float:
        """E[(|e| - r)+], mm; what the other adds (with room: all of it), to some 0.2 % of the whole, by Gauss and
        Legendre's rule up to six standard deviations."""
        ends = self.law.ends if self.law.room is not None else [self.law.ends[1 - self.first]]
        spreads = (sqrt(max(float(np.linalg.eigvalsh(end.total_covariance)[-1]), 0.0)) for end in ends)
        far = max(float(np.linalg.norm(end.mean)) + 6 * spread for end, spread in zip(ends, spreads, strict=True))
        span = max(far - r, 0.0)
        nodes, weights = np.polynomial.legendre.leggauss(24)
        at = (r + 0.5 * span * (1 + nodes)).tolist()
        if self.law.room is not None:
            return 0.5 * span * float(np.dot(weights, [1 - self.probability(x) for x in at]))
        return self._longer.excess(r) + 0.5 * span * float(np.dot(weights, [self.probability_added(x)[0] for x in at]))

    def gradient(self, mixture: Quantiles) -> LawGradient:
        return add_gradients([self._gradient_of(total, weight) for total, weight in mixture])

    def _gradient_of(self, total: LawQuantile, weight: float) -> LawGradient:
        """Of one quantile, times a weight."""
        slopes, (end, at, scale) = self._slopes(total), self._alone_at(total)
        added = slopes.by_mean, slopes.by_covariance, (slopes.by_columns * self.law.columns).sum(axis=0)
        own, mean, covariance = end.gradient([(at, 1.0)]), np.zeros(6), np.zeros((6, 6))
        mean[self._rows], covariance[self._rows, self._rows] = own.by_mean, own.by_covariance
        alone = mean * scale, covariance * np.outer(scale, scale), own.by_log_column
        pairs = zip(alone, added, strict=True)
        return LawGradient(*(weight * ((one * -at.density - more) * (-1.0 / total.density)) for one, more in pairs))

    def column_gradient(self, mixture: Quantiles) -> Array | None:
        whole = np.zeros_like(self.law.columns)
        for total, weight in mixture:
            end, at, scale = self._alone_at(total)
            if not total.quantile_mm or (found := end.column_gradient([(at, 1.0)])) is None:
                return None
            own = np.zeros_like(self.law.columns)
            own[self._rows] = found * (-at.density * scale[self._rows, None])
            whole += weight * ((own - self._slopes(total).by_columns) * (-1.0 / total.density))
        return whole

    def _slopes(self, total: LawQuantile) -> PairGradient:
        """Of what the other adds."""
        return self.points.slopes(self.law.mean, total.quantile_mm, self.room, self.first)

    @property
    def _rows(self) -> slice:
        return slice(3 * self.first, 3 * self.first + 3)

    def _alone_at(self, total: LawQuantile) -> tuple[DeclaredLaw | GaussianLaw, LawQuantile, Array]:
        """The first alone, its quantile at this one's radius, and what its components are multiplied by."""
        end = self.longer_at(total.quantile_mm)
        return end, end.quantile(end.probability(total.quantile_mm)), self.law.scale_at(total.quantile_mm)


def evaluation_of(law: LinearLaw, p: float, fine: bool = True) -> DeclaredLaw | GaussianLaw | PairLaw | OneSidedLaw:
    """What answers about a law near the probability p.  Raises ValueError for p outside (0, 1)."""
    if law.is_one_sided:
        return OneSidedLaw(law, probability_iv(p), fine)
    return PairLaw(law, probability_iv(p), fine) if len(law.mean) > 3 else single_evaluation(law, p, fine)


def single_evaluation(law: LinearLaw, p: float, fine: bool = True) -> DeclaredLaw | GaussianLaw:
    """The same of one vector, which has derivatives."""
    return _evaluate_to(law, accuracy_for(probability_iv(p), fine))


def _evaluate_to(law: LinearLaw, accuracy: Accuracy) -> DeclaredLaw | GaussianLaw:
    return DeclaredLaw(law, accuracy) if law.columns.any() else GaussianLaw(law)


def law_quantile(law: LinearLaw, p: float, *, fine: bool = True) -> LawQuantile:
    """The r with P(|e| <= r) = p; not fine: to about 1e-4 and several times faster, for averages over many laws.

    Raises ValueError for p outside (0, 1).
    """
    return evaluation_of(law, p, fine).quantile(float(p))


def law_quantiles(law: LinearLaw, levels: Sequence[float], near: float, *, fine: bool = True) -> list[LawQuantile]:
    """The quantiles at several levels, to the absolute error of a probability that is fit for one of them; the largest
    first, whose lattice serves the others."""
    evaluation = evaluation_of(law, near, fine)
    found = {p: evaluation.quantile(float(p)) for p in sorted(levels, reverse=True)}
    return [found[p] for p in levels]


def quantiles_at(law: LinearLaw, means: Array, p: float) -> Array:
    """(n,) mm: the p-quantiles of a law of one vector with each of the means (n, 3) mm in place of its own, to about
    1e-4; together where they are about alike."""
    frame = on_principal_axes(np.zeros(3), law.covariance, lattice_columns(law)[0])
    found = solve_about(p, means @ frame.axes, frame, accuracy_for(p, False))
    for i in np.flatnonzero(np.isnan(found)):
        found[i] = law_quantile(LinearLaw(means[i], law.covariance, law.columns, law.kinds), p, fine=False).quantile_mm
    return found


def law_cdf(law: LinearLaw, r: float, *, fine: bool = True) -> float:
    """P(|e| <= r), r >= 0 mm; absolute error about 1e-8 (sampled laws: 1e-4), not fine: 1e-4.  Raises ValueError."""
    if not r >= 0:
        raise ValueError(f"a radius must be >= 0 mm, got {r}")
    return evaluation_of(law, 0.5, fine).probability(float(r))


def chance_gradient(law: LinearLaw, r: float) -> tuple[float, LawGradient] | None:
    """P(|e| <= r) of one vector, r in mm, and its derivatives per mm, mm^2 and relative change of a column, to 1e-7;
    None where the law would have to be sampled."""
    return _evaluate_to(law, _OF_CHANCES).probability_gradient(r)


MIXED_METHOD = "mixture over missed fiducials of exact laws"


@dataclass(frozen=True, eq=False)
class MixedLaw:
    """One of several laws, each with its probability; what these lack to 1 is beyond every radius."""

    laws: Sequence[LinearLaw]
    weights: Array
    near: float = 0.95  # the quantile about which it is asked
    fine: bool = True  # how exactly

    @cached_property
    def _members(self) -> list[DeclaredLaw | GaussianLaw | PairLaw | OneSidedLaw]:
        members = [evaluation_of(law, self.near, self.fine) for law in self.laws]
        for member in members:
            if isinstance(member, DeclaredLaw):
                member.quantile(self.near)  # radii up to a little above it are read from one lattice
        return members

    def _probabilities_at(self, radii: Array) -> Array:
        """P(|e| <= r) at each radius, (n,) mm."""
        each = [
            member.probabilities(radii)
            if isinstance(member, DeclaredLaw)
            else np.array([member.probability(r) for r in radii.tolist()])
            for member in self._members
        ]
        return np.asarray(self.weights @ np.array(each))

    def probabilities(self, radii: Array) -> Array:
        """(S,) P_k(|e| <= r_k) of each of the laws; radii (S,) mm."""
        return np.array([member.probability(r) for member, r in zip(self._members, radii.tolist(), strict=True)])

    def probability(self, r: float) -> float:
        """P(|e| <= r)"""
        return float(self.weights @ self.probabilities(np.full(len(self.laws), r)))

    @property
    def given_answer(self) -> MixedLaw:
        """The law of what is not beyond every radius."""
        return MixedLaw(self.laws, self.weights / self.weights.sum(), self.near)

    def quantile(self, p: float) -> float:
        """The r with sum_k weights_k P_k(|e| <= r) = p, mm; infinite where p is among what is beyond.

        Raises ValueError for p outside (0, 1).
        """
        p = probability_iv(p)
        if len(self.laws) == 1 and self.weights[0] == 1:
            return law_quantile(self.laws[0], p).quantile_mm
        if self.weights.sum() <= p:
            return inf
        start = law_quantile(self.laws[int(self.weights.argmax())], p).quantile_mm
        return find_radius(self.probability, p, start)

    def exceedance(self, limit: float) -> float:
        """P(|e| > limit), limit >= 0 mm."""
        beyond = [law_exceedance(law, limit) for law in self.laws]
        return float(self.weights @ beyond) + max(1.0 - float(self.weights.sum()), 0.0)

    @property
    def mean(self) -> Array:
        """(3,) mm, of what is not beyond every radius."""
        return np.asarray(self.weights @ [law.mean for law in self.laws] / self.weights.sum())

    @property
    def total_covariance(self) -> Array:
        """(3, 3) mm^2, of what is not beyond every radius."""
        apart = np.array([law.mean for law in self.laws]) - self.mean
        each = np.array([law.total_covariance for law in self.laws]) + apart[:, :, None] * apart[:, None, :]
        return np.asarray(np.tensordot(self.weights, each, 1) / self.weights.sum())

    def summary(self, p: float, limit: float | None) -> LawSummary:
        """As of :class:`LawReading`; mean and mean of the worst 1 - p are of what is not beyond every radius.

        Where more than 1 - p is, the quantile is of the rest as well.
        """
        r, exceedance = self.quantile(p), None if limit is None else self.exceedance(limit)
        if r == inf:
            return self.given_answer.summary(p, None)._replace(exceedance=exceedance)
        whole = float(self.weights.sum())
        mean, beyond = (float(self.weights @ [member.excess(at) for member in self._members]) for at in (0.0, r))
        quantile = LawQuantile(p, r, 0.0, MIXED_METHOD, 1e-9 * r)
        return LawSummary(quantile, mean / whole, r + beyond / (whole - p), exceedance)

    def middles(self, parts: int) -> Array:
        """(parts,) mm, quantiles in the middles of equal parts, shots of a quantile dot plot (Kay et al., CHI 2016):
        each of its order to WITHIN, beside the error of the law itself, by chords over normal deviates; NaN: there is
        none."""
        orders = (np.arange(parts) + 0.5) / parts
        law = MixedLaw(self.laws, self.weights, orders[-1], fine=False)
        found, off = np.full(parts, np.nan), float(law.weights.sum()) >= orders
        end = law._members[int(law.weights.argmax())].quantile(law.near).quantile_mm or 1e-9
        while law.probability(end) < orders[off].max(initial=WITHIN) - WITHIN:
            end *= 1.1
        radii = end * np.linspace(0.0, 1.0, _INTERVALS + 1)
        known = law._probabilities_at(radii)
        for _ in range(_ROUNDS):
            found[off] = np.interp(ndtri(orders[off]), ndtri(np.clip(known, 1e-12, 1 - 1e-12)), radii)
            reached = law._probabilities_at(found[off])
            radii, known = np.sort(np.append(radii, found[off])), np.sort(np.append(known, reached))
            off[off] = (np.abs(reached - orders[off]) > WITHIN) & ((found[off] > 0) | (reached < orders[off]))
            if not off.any():
                break
        return found


def find_radius(probability: Callable[[float], float], p: float, start: float, low: float = 0.0) -> float:
    """The r, mm, at which a probability that rises with the radius comes to p; low where it is p there already,
    infinite where it never is.  start: where it is looked for first, mm."""
    from scipy.optimize import brentq  # as few scores take a mixture

    def beyond_p(r: float) -> float:
        return probability(r) - p

    high = start or 1e-9
    while beyond_p(high) < 0:
        low, high = high, MIXTURE_STEP * high
        if high > LARGEST_MIXTURE:  # p differs from what is reached by less than rounding
            return inf
    return float(brentq(beyond_p, low, high, xtol=1e-12, rtol=1e-10)) if beyond_p(low) < 0 else low


def law_exceedance(law: LinearLaw, limit: float) -> float:
    """P(|e| > limit), limit >= 0 mm; absolute error about 1e-8, for Gaussian laws 1e-12 of itself."""
    if not limit >= 0:
        raise ValueError(f"a limit must be >= 0 mm, got {limit}")
    return evaluation_of(law, 0.5).exceedance(float(limit))


class LawReading:
    """What a score says about a law, each number read when it is asked for; fine: as of :func:`law_quantile`.

    Raises ValueError for p outside (0, 1) or a limit below 0 mm.
    """

    def __init__(self, law: LinearLaw, p: float, limit: float | None = None, *, fine: bool = True) -> None:
        if limit is not None and not limit >= 0:
            raise ValueError(f"a limit must be >= 0 mm, got {limit}")
        self._evaluation, self._p, self.limit = evaluation_of(law, p, fine), float(p), limit

    @cached_property
    def quantile(self) -> LawQuantile:
        return self._evaluation.quantile(self._p)

    @cached_property
    def mean_norm_mm(self) -> float:
        """E|e|"""
        return self._evaluation.excess(0.0)

    @cached_property
    def cvar_mm(self) -> float:
        """E[|e| given |e| >= quantile]"""
        beyond = self._evaluation.excess(self.quantile.quantile_mm)
        return self.quantile.quantile_mm + beyond / (1.0 - self._p)

    @property
    def exceedance(self) -> float | None:
        """P(|e| > limit), of the limit that it has."""
        return None if self.limit is None else self.beyond(self.limit)

    def beyond(self, limit: float) -> float:
        """P(|e| > limit), limit >= 0 mm, on the lattice of the quantile where that serves."""
        _ = self.quantile  # first, for its lattice
        return self._evaluation.exceedance(float(limit))

    def at_limit(self, limit: float) -> LawReading:
        """The same of another limit, with what was read already."""
        other = copy(self)
        other.limit = limit
        return other


def law_gradient(law: LinearLaw, total: LawQuantile, *, fine: bool = True) -> LawGradient:
    """Derivatives of a quantile of this law; fine: as exact as the quantile itself, to drive an optimiser."""
    return mixture_gradient(law, [(total, 1.0)], total.p, fine=fine)


def mixture_gradient(law: LinearLaw, mixture: Quantiles, near: float, *, fine: bool = True) -> LawGradient:
    """Derivatives of a sum of quantiles of this law, as :func:`law_quantiles` has them near this probability."""
    total, weight = mixture[0][0], sum(weight for _, weight in mixture)
    if not any(each.density for each, _ in mixture):
        by_mean, room = np.zeros(len(law.mean)), np.zeros(len(law.mean))
        if law.room is not None and not law.is_one_sided:
            room = law.room
        outward = law.mean / (total.quantile_mm + room) if total.quantile_mm else by_mean
        rows = max(np.split(np.arange(len(law.mean)), len(law.mean) // 3), key=lambda k: (outward[k] ** 2).sum())
        out, wide = outward[rows], total.quantile_mm + room[rows]
        by_mean[rows] = weight * out / wide / (out**2 / wide).sum() if total.quantile_mm else 0.0
        return LawGradient(by_mean, np.zeros((len(law.mean),) * 2), np.zeros(law.kinds.size))
    return evaluation_of(law, near, fine).gradient(mixture)


def column_gradient(law: LinearLaw, total: LawQuantile) -> Array | None:
    """(3, k) derivative of a quantile by each entry of the columns, mm per mm: along a column it is ``by_log_column``.

    None where the law has no lattice, and a derivative is not known as exactly as the quantile.
    """
    return mixture_column_gradient(law, [(total, 1.0)], total.p)


def mixture_column_gradient(law: LinearLaw, mixture: Quantiles, near: float) -> Array | None:
    """:func:`column_gradient` of a sum, as :func:`mixture_gradient`."""
    if not any(each.density for each, _ in mixture):
        return np.zeros_like(law.columns)
    return evaluation_of(law, near).column_gradient(mixture)


# --- kernels ---------------------------------------------------------------------------------------------------------


@kernel()
def split_columns(columns: Array, kinds: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """:func:`lattice_columns` of columns (3, k) mm and their kinds (k,): the narrow parts come last."""
    count = kinds.size
    felt = np.zeros(count, dtype=np.bool_)
    size = 0
    for j in range(count):
        if columns[0, j] != 0.0 or columns[1, j] != 0.0 or columns[2, j] != 0.0:
            felt[j] = True
            size += 2 if _WIDTHS[kinds[j], 1] > 0.0 else 1
    h = np.empty((size, 3))
    source = np.empty(size, dtype=np.int64)
    n = 0
    for part in range(2):
        for j in range(count):
            width = _WIDTHS[kinds[j], part]
            if felt[j] and width > 0.0:
                for a in range(3):
                    h[n, a] = columns[a, j] * width
                source[n] = j
                n += 1
    return h, source


@kernel()
def tail_numbers(
    mean: Array, covariance: Array, h: Array, p: float, accuracy: Accuracy, averaged: bool
) -> tuple[float, float]:
    """(the p-quantile of |e|, E|e| if it is wanted), mm, of a law with uniform columns h (K, 3) mm: what
    :func:`law_summary` says.  NaN: the law has no lattice, or the quantile did not converge."""
    if h.shape[0] == 0:
        variances, m, _ = principal_axes(mean, covariance)
        return quantile_on_axes(p, variances, m), mean_on_axes(variances, m) if averaged else np.nan
    frame = on_principal_axes(mean, covariance, h)
    quantile = solve_on_axes(p, frame, accuracy).quantile
    average = np.nan
    if averaged:
        end, lattice = outer_lattice(frame, accuracy)
        if lattice.volume > 0.0:
            average = excess_integral(0.0, sqrt(end * end + frame.offset), frame, lattice.t, lattice.w)
    return quantile, average


class Solution(NamedTuple):
    """A quantile in the frame, and the lattice it was solved on."""

    found: bool  # False: the lattice is too large
    quantile: float  # mm
    radius: float  # mm, the quantile in the frame
    density: float  # 1/mm, by this radius
    error: float  # of the probability
    largest: float  # mm, the radius that the lattice serves
    lattice: Lattice


@kernel()
def start_radius(p: float, frame: PrincipalLaw) -> float:
    """The p-quantile by Pearson's closed form (``approximation.py``), mm; never below a hundredth of the rms."""
    m, h = frame.mean, frame.h
    c1, c2, c3 = gaussian_cumulants(frame.sigma * frame.sigma, m)
    for j in range(h.shape[0]):
        gg = 0.0
        gm = 0.0
        gsg = 0.0
        for a in range(3):
            gg += h[j, a] * h[j, a]
            gm += h[j, a] * m[a]
            gsg += (h[j, a] * frame.sigma[a]) ** 2
        c2 -= gg * gg / 15.0
        c3 += (-1.6 * gg * (gsg + gm * gm) + 16.0 / 63.0 * gg * gg * gg) / 8.0
    return sqrt(max(pearson_square(c1, c2, c3, normal_quantile(p)), 1e-4 * c1))


@kernel()
def solve_on_axes(p: float, frame: PrincipalLaw, accuracy: Accuracy) -> Solution:
    """The p-quantile in a frame, on a lattice for radii a little above it."""
    cap = 1.08 * start_radius(p, frame)
    return solve_on_lattice(p, frame, accuracy, cap, build(cap, frame, accuracy, False))


@kernel()
def solve_on_lattice(p: float, frame: PrincipalLaw, accuracy: Accuracy, cap: float, lattice: Lattice) -> Solution:
    """The p-quantile in a frame by Halley's steps from Pearson's form, in space from the ball with the density at 0 if
    that is larger, on a lattice that serves radii up to cap, mm, and grows where they lead out."""
    start, centre = start_radius(p, frame), lattice.w.sum()
    if frame.dimension == 3 and centre > 0.0:
        start = max(start, (0.75 / np.pi * p / centre) ** (1.0 / 3.0))
    rho = min(start, cap)
    low = 0.0
    for _ in range(60):
        if lattice.volume == 0.0:
            break
        f0, f1, f2 = ball_sums(rho, frame.dimension, lattice.t, lattice.w)
        g = f0 - p
        if g < 0.0:
            low = max(low, rho)
        v = -g / f1 if f1 > 0.0 else (0.3 * rho if g < 0.0 else -0.3 * rho)
        bend = 0.5 * f2 * v / f1 if f1 > 0.0 else 0.0
        step = v / (1.0 + bend) if abs(bend) < 0.5 else v
        new = rho + step
        if new <= low and g > 0.0:
            new = 0.5 * (low + rho)
        if new > cap:
            new = min(new, 1.5 * cap)
            cap = 1.2 * new
            rho = new
            lattice = build(cap, frame, accuracy, False)
            continue
        step = new - rho
        rho = new
        if abs(step) < 1e-4 * rho and abs(bend) < 0.5:  # the next step would be of the order of its cube
            error = accuracy.aliasing + lattice.decade + 1e-14
            return Solution(True, sqrt(rho * rho + frame.offset), rho, f1 + step * f2, error, cap, lattice)
    return Solution(False, np.nan, 0.0, 0.0, 0.0, 0.0, lattice)


@kernel()
def probabilities_within(radii: Array, dimension: int, t: Array, w: Array) -> Array:
    """(n,) probabilities within radii (n,) mm, by the terms t 1/mm and w of a lattice that serves the largest."""
    out = np.empty(radii.size)
    for i in range(radii.size):
        out[i] = min(max(ball_sums(radii[i], dimension, t, w)[0], 0.0), 1.0)
    return out


@kernel()
def solve_about(p: float, means: Array, about: PrincipalLaw, accuracy: Accuracy) -> Array:
    """(n,) mm: the p-quantiles of a law in space about 0 that is moved to each of the means (n, 3) mm, along its axes;
    NaN: not found here.

    On one lattice, whose terms a mean m multiplies by ``cos k'm``, probabilities are summed at some radii about those
    of Pearson's form.  The polynomial through them is right to 1e-5 where they lie within twice the least standard
    deviation; farther apart they are not looked for.
    """
    count, low, high = means.shape[0], np.inf, 0.0
    out, away, mean = np.full(count, np.nan), np.zeros(3), np.zeros(3)
    for i in range(count):
        for a in range(3):
            mean[a] = means[i, a]
            away[a] = max(away[a], abs(mean[a]))
        start = start_radius(p, PrincipalLaw(about.sigma, mean, about.S, about.h, away, about.axes, 3, 0.0))
        low, high = min(low, (1.0 - _AROUND) * start), max(high, (1.0 + _AROUND) * start)
    if about.dimension < 3 or high - low > 2.0 * about.sigma[2]:
        return out
    mean[:] = 0.0
    lattice = build(high, PrincipalLaw(about.sigma, mean, about.S, about.h, away, about.axes, 3, 0.0), accuracy, True)
    if lattice.volume == 0.0:
        return out
    radii = 0.5 * (low + high) + 0.5 * (high - low) * _CHEBYSHEV
    k, terms, cosines = lattice.k.T.copy(), np.empty((radii.size, lattice.w.size)), np.empty(lattice.w.size)
    chances = np.empty(radii.size)
    for j in range(radii.size):
        terms[j] = lattice.w * balls(radii[j], lattice.t)
    for i in range(count):
        x, y, z = means[i, 0], means[i, 1], means[i, 2]
        for n in range(cosines.size):  # no branch and no call: in lanes
            cosines[n] = sine_and_cosine(k[0, n] * x + k[1, n] * y + k[2, n] * z)[1]
        for j in range(radii.size):
            chances[j] = sum_of_products(terms[j], cosines)
        out[i] = _invert(radii, chances, p)
    return out


@kernel()
def _invert(x: Array, y: Array, level: float) -> float:
    """Where the polynomial through the values y (n,) at x (n,), both ascending, is at a level; NaN: beyond them."""
    if not y[0] <= level <= y[-1]:
        return np.nan
    newton = y.copy()  # divided differences
    for j in range(1, x.size):
        for i in range(x.size - 1, j - 1, -1):
            newton[i] = (newton[i] - newton[i - 1]) / (x[i] - x[i - j])
    low, high = x[0], x[-1]
    for _ in range(50):
        middle, value = 0.5 * (low + high), 0.0
        for i in range(x.size - 1, -1, -1):
            value = value * (middle - x[i]) + newton[i]
        low, high = (middle, high) if value < level else (low, middle)
    return float(low)


@kernel()
def end_of(frame: PrincipalLaw, reach: Array, probability: float) -> float:
    """A radius in the frame, mm, that |e| exceeds with this probability at most; reach (3,) mm: :func:`reach_of`.

    The corner of the box of reaches (which bounded sources make finite), or Chernoff's bound of the Gaussian law,
    whichever is nearer.  The law is strictly sub-Gaussian: with z ~ N(0, I),
    ``E exp(s |e|^2) = E exp(sqrt(2 s) z'e)`` is at most what the Gaussian law of equal mean and covariance has.  On
    the curve ``d = k'(s)`` the bound is ``exp(k(s) - s k'(s))``, which falls as s grows.
    """
    variances, m = frame.sigma * frame.sigma, frame.mean
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
def outer_lattice(frame: PrincipalLaw, accuracy: Accuracy) -> tuple[float, Lattice]:
    """(radius at the end of the law, mm, in the frame; a lattice up to there) for integrals of the probability.

    The box is larger out there, but an integral over the radius forgives: of its terms the far ones gain a factor 1/k,
    and of what lies beyond the end, or comes in from other copies, only the last step counts.
    """
    aliasing = _END * accuracy.aliasing
    end = end_of(frame, reach_of(frame, aliasing), aliasing)
    return end, build(end, frame, Accuracy(_FORGIVEN * accuracy.threshold, aliasing, accuracy.largest_box), False)


@kernel()
def excess_integral(low: float, high: float, frame: PrincipalLaw, t: Array, w: Array) -> float:
    """int_low^high P(|e| > x) dx, mm, from the terms t (n,) 1/mm and w (n,) of a lattice for radii up to `high`."""
    if frame.offset <= _NO_OFFSET * high * high:
        return high - low - ball_integral(high, frame.dimension, t, w) + ball_integral(low, frame.dimension, t, w)
    # The radius in the frame is sqrt(x^2 - offset), smooth in theta where x = below + span sin^2(theta).
    below = max(low, sqrt(frame.offset))
    span = high - below
    total = 0.0
    for i in range(_NODES.size):
        theta = 0.25 * np.pi * (1.0 + _NODES[i])
        x = below + span * np.sin(theta) ** 2
        f0, _, _ = ball_sums(sqrt(max(x * x - frame.offset, 0.0)), frame.dimension, t, w)
        total += _WEIGHTS[i] * (1.0 - f0) * np.sin(2.0 * theta)
    return max(below - low, 0.0) + 0.25 * np.pi * span * total


@kernel()
def column_slopes(even: Array, k: Array, h: Array) -> Array:
    """(K,) ``sum_i even_i (x cot x - 1)``, x = k_i'h_j: derivatives of the probability by each column's logarithm.

    even (n,): the terms of the probability; k (n, 3) 1/mm; h (K, 3) mm.  x cot x - 1 is the logarithmic derivative of
    sin x / x, which is a factor of the term: where it nearly vanishes so does what is lost by dividing by it.
    """
    along = k.T.copy()
    slope = np.empty(even.size)
    out = np.zeros(h.shape[0])
    for j in range(h.shape[0]):
        a, b, c = h[j, 0], h[j, 1], h[j, 2]
        for i in range(even.size):  # no branch and no call: in lanes
            x = along[0, i] * a + along[1, i] * b + along[2, i] * c
            z = x * x
            near = z < 1e-4
            sine, cosine = sine_and_cosine(x)
            far = x * cosine * sine / max(sine * sine, 1e-24) - 1.0
            slope[i] = z * z * (-1.0 / 45.0) - z * (1.0 / 3.0) if near else far
        out[j] = sum_of_products(even, slope)
    return out
