"""Randomised quasi-Monte-Carlo for laws that are too sharp for a lattice, with one source integrated exactly.

x = m + A z + sum_j h_j u_j is sampled by scrambled Sobol points (Owen 1995; Matousek's linear scrambling as in SciPy),
16 independent scramblings for a standard error.  One column is not sampled: along it ``|x + h u| <= r`` is an interval
of u, whose length is the exact conditional probability.  That makes the integrand continuous, which is what
quasi-Monte-Carlo needs; a single uniform source comes out exact.  Where the lines cross the sphere |e| = r is also all
that derivatives need: one sample gives the gradient by everything.

Columns that are many and small are drawn as one Gaussian, and what that changes is measured and stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..arrays import Array
from .spectrum import principal_axes

RANDOMISATIONS = 16
# What taking small columns as Gaussian may change a probability by (less than sampling), with 2^12 points and fewer.
FOLDED, FOLDED_COARSE, FINE = 1e-5, 1e-4, 12
MOST_EXPLICIT = 32  # columns that are sampled; beyond, more are taken as Gaussian and the error says so
_SEED = 20240229


@lru_cache(maxsize=12)
def sobol_points(normals: int, uniforms: int, log2_count: int) -> tuple[Array, Array]:
    """(z (R N, normals) standard normal, u (R N, uniforms) on (-1, 1)); R scramblings of N = 2^log2_count points.

    Read-only and the same in every process.
    """
    from scipy.stats import qmc  # takes most of a second to import, and few laws are sampled

    engines = [
        qmc.Sobol(max(normals + uniforms, 1), scramble=True, rng=np.random.default_rng([_SEED, 0, block]))
        for block in range(RANDOMISATIONS)
    ]
    points = np.concatenate([engine.random_base2(log2_count) for engine in engines])
    # The grid of scrambled points contains 0.
    z = np.ascontiguousarray(ndtri(np.clip(points[:, :normals], 1e-16, 1 - 1e-16)))
    u = np.ascontiguousarray(2.0 * points[:, normals : normals + uniforms] - 1.0)
    z.setflags(write=False)
    u.setflags(write=False)
    return z, u


def _block_error(values: Array) -> float:
    """Standard error of the mean of values (n,), one a point, from the means of the scramblings."""
    return float(values.reshape(RANDOMISATIONS, -1).mean(axis=1).std(ddof=1)) / sqrt(RANDOMISATIONS)


@dataclass(frozen=True, eq=False)
class Sample:
    """Points of a law, but for one of its columns, which is integrated exactly: ``x + u along``."""

    x: Array  # (n, 3) mm
    along: Array  # (3,) mm
    z: Array  # (n, k) normal deviates
    root: Array  # (k, 3) of the Gaussian part: x holds z @ root
    u: Array  # (n, K - 1) of the other columns
    rest: Array  # (K - 1, 3) mm
    left_out: int  # which column is integrated
    explicit: NDArray[np.bool_]  # (all,) columns that are sampled or integrated; the others are in the Gaussian part
    folded: float  # bound of what taking those as Gaussian changes a probability by
    edgeworth: Array  # (n,) weights whose mean inside a set is that change to first order; (0,) where the bound will do

    @cached_property
    def _nearest(self) -> tuple[Array, Array]:
        """(u where each line x + u along is nearest to 0 (n,), squared distance there, mm^2 (n,))."""
        square = float(self.along @ self.along)
        middle = -(self.x @ self.along) / square
        return middle, (self.x**2).sum(axis=1) - square * middle**2

    def crossings(self, r: float) -> tuple[Array, Array, Array]:
        """(u where each line x + u along enters the ball of radius r (n,), where it leaves (n,), half its chord, mm^2:
        |along| times half the length inside (n,)); a line that misses the ball enters and leaves where it is nearest,
        with half a chord of 0."""
        square = float(self.along @ self.along)
        middle, nearest = self._nearest
        chord = np.sqrt(np.maximum(square * (r * r - nearest), 0.0))
        return middle - chord / square, middle + chord / square, chord

    def shares(self, r: float) -> Array:
        """(n,) P(|x + u along| <= r), u uniform on (-1, 1), at each point."""
        enters, leaves, _ = self.crossings(r)
        return np.asarray(0.5 * np.maximum(np.minimum(leaves, 1.0) - np.maximum(enters, -1.0), 0.0))

    def probability(self, r: float) -> float:
        return float(self.shares(r).mean())

    def density(self, r: float) -> float:
        """Derivative of the probability by r, 1/mm: each crossing with |u| < 1 adds r over half the chord, halved."""
        enters, leaves, chord = self.crossings(r)
        crossing = (chord > 0) * (1.0 * (np.abs(enters) < 1) + (np.abs(leaves) < 1))
        return float((0.5 * r * crossing / np.where(chord > 0, chord, 1.0)).mean())

    def shift(self, by: Array) -> Sample:
        """The same sample with the mean elsewhere, by (3,) mm."""
        return replace(self, x=self.x + by)

    def excess(self, r: float) -> float:
        """E[(|e| - r)+]: 16-point Gauss-Legendre in u beside the ball, where the integrand is smooth."""
        nodes, weights = np.polynomial.legendre.leggauss(16)
        enters, leaves, _ = (np.clip(value, -1.0, 1.0) for value in self.crossings(r))
        one, total = np.ones(len(self.x)), np.zeros(len(self.x))
        square, (middle, nearest) = float(self.along @ self.along), self._nearest
        nearest = np.maximum(nearest, 0.0)
        for low, high in ((-one, enters), (leaves, one)):
            for node, weight in zip(nodes, weights, strict=True):
                u = 0.5 * (low + high) + 0.5 * (high - low) * node
                norm = np.sqrt(nearest + square * (u - middle) ** 2)
                total += 0.25 * (high - low) * weight * np.maximum(norm - r, 0.0)
        return float(total.mean())

    def quantile(self, p: float) -> tuple[float, float, float]:
        """(r, density, error of r: one standard error, and what taking small columns as Gaussian changes)."""
        from scipy.optimize import brentq  # as the Sobol points: few laws are sampled

        size, reach = np.sqrt((self.x**2).sum(axis=1)), sqrt(float(self.along @ self.along))
        low, high = float(size.min()) - reach, (float(size.max()) + reach) * (1 + 1e-12)
        r = float(brentq(lambda x: self.probability(x) - p, max(low * (1 - 1e-12), 0.0), high, xtol=1e-12 * high))
        density = self.density(r)
        if density == 0.0:
            return r, 0.0, 0.0
        return r, density, hypot(_block_error(self.shares(r)), self.folded_error(r)) / density

    def folded_error(self, r: float) -> float:
        """What taking small columns as Gaussian changes P(|e| <= r) by.

        Its bound, or where that is not small enough the first term of Edgeworth's series as measured, its standard
        error, and the size of the terms behind it.
        """
        if not len(self.edgeworth):
            return self.folded
        change = self.shares(r) * self.edgeworth
        return abs(float(change.mean())) + _block_error(change) + self.folded**2

    def gradient(self, r: float, h: Array) -> tuple[Array, Array, Array]:
        """(dr by the mean (3,), by the Gaussian covariance (3, 3), by the logarithm of each column's length (K,)).

        ``dr = E[e'de / r]`` over the sphere |e| = r: a displacement of the points counts where their lines cross it,
        weighted by the density each crossing adds over r.  A covariance grows along C as its deviates are displaced by
        ``C S^-1 (x - mean) / 2``.  h: (K, 3) all columns of the law.
        """
        enters, leaves, chord = self.crossings(r)
        by_mean, by_along, total = np.zeros(3), 0.0, 0.0
        by_z, by_u = np.zeros((3, self.z.shape[1])), np.zeros((3, self.u.shape[1]))
        for side, t in ((-1.0, enters), (1.0, leaves)):
            on = np.flatnonzero((chord > 0) & (np.abs(t) < 1))
            e = (self.x[on] + t[on, None] * self.along) / chord[on, None]
            by_mean += e.sum(axis=0)
            by_z += e.T @ self.z[on]
            by_u += e.T @ self.u[on]
            by_along += side * float(t[on].sum())
            total += float((r / chord[on]).sum())
        by_deviate = by_z @ (self.root / (self.root**2).sum(axis=1, keepdims=True)) / total
        by_covariance = 0.25 * (by_deviate + by_deviate.T)
        own = np.empty(int(self.explicit.sum()))
        others = np.arange(len(own)) != self.left_out
        own[others] = (by_u.T * self.rest).sum(axis=1) / total
        own[self.left_out] = by_along / total
        by_column = np.empty(len(h))
        by_column[self.explicit] = own
        small = h[~self.explicit]  # h h' / 3 in the covariance: twice that for a relative change of the length
        by_column[~self.explicit] = 2.0 / 3.0 * np.einsum("ja,ab,jb->j", small, by_covariance, small)
        return by_mean / total, by_covariance, by_column


def sample(mean: Array, covariance: Array, h: Array, log2_count: int) -> Sample:
    """16 x 2^log2_count points of the law.  h: (K, 3) uniform columns, K >= 1."""
    budget = FOLDED if log2_count >= FINE else FOLDED_COARSE
    folded, explicit, bound = fold_many(covariance, h, budget, MOST_EXPLICIT)
    columns = h[explicit]
    # The column that crosses the sphere most steeply: near a large mean, the one along it.
    spread = np.trace(covariance) + (h**2).sum() / 3.0
    along = int(np.argmax((columns @ mean) ** 2 + (columns**2).sum(axis=1) * spread))
    variances, _, axes = principal_axes(mean, folded)
    rank = int((variances > 0).sum())
    root = (axes[:, :rank] * np.sqrt(variances[:rank])).T
    rest = np.delete(columns, along, axis=0)
    z, u = sobol_points(rank, rest.shape[0], log2_count)
    weights = edgeworth_weights(z, root, h[~explicit]) if bound > budget else np.zeros(0)
    return Sample(mean + z @ root + u @ rest, columns[along], z, root, u, rest, along, explicit, bound, weights)


def edgeworth_weights(z: Array, root: Array, small: Array) -> Array:
    """(n,) ``1/24 sum_j -2/15 ((g_j'z)^4 - 6 g_j'g_j (g_j'z)^2 + 3 (g_j'g_j)^2)``, g_j: column j on the deviates.

    z (n, k): the deviates; root (k, 3): of the Gaussian part; small (s, 3): the columns in it.  The fourth cumulant of
    a uniform column h is -2/15 h^4, and a Gaussian density's fourth derivative along it is that Hermite polynomial
    times the density.
    """
    g = small @ root.T / (root**2).sum(axis=1)
    size = (g**2).sum(axis=1)
    parts = []
    for deviates in np.array_split(z, RANDOMISATIONS):  # the products of all points at once would fill the memory
        square = (deviates @ g.T) ** 2
        parts.append((square * (square - 6.0 * size) + 3.0 * size**2).sum(axis=1))
    return np.concatenate(parts) * (-2.0 / 15.0 / 24.0)


def fold_many(S: Array, h: Array, budget: float, most: int) -> tuple[Array, NDArray[np.bool_], float]:
    """(S with the variance of small columns (3, 3), which columns are left (K,), what that changes a probability by).

    A uniform column with ``rho^2 = h'G^-1 h``, G the covariance of S and of all columns taken in, changes the
    distribution function of any projection by less than ``3.1e-3 rho^4``: the first term of Edgeworth's series,
    ``k4 / 24`` times 0.55, the largest of (x^3 - 3x) phi(x), with ``k4 = -2/15 rho^4``.  Columns are taken in, the
    shortest first, while the sum stays below the budget, and beyond it until ``most`` are left; the longest is always
    left.
    """
    order = np.argsort((h**2).sum(axis=1), kind="stable")

    def taken(count: int) -> tuple[Array, float]:
        small = h[order[:count]]
        folded = S + small.T @ small / 3.0
        variances, _, axes = principal_axes(np.zeros(3), folded)
        rank = int((variances > 0).sum())
        rho2 = ((small @ axes[:, :rank]) ** 2 / variances[:rank]).sum(axis=1)
        return folded, 3.1e-3 * float((rho2**2).sum())

    least = max(len(h) - most, 0)
    for count in np.unique(np.linspace(least, len(h) - 1, 32).astype(int))[::-1]:
        folded, doubt = taken(int(count))
        if doubt <= budget:
            break
    explicit = np.ones(len(h), dtype=bool)
    explicit[order[:count]] = False
    return folded, explicit, doubt
