"""Randomised quasi-Monte-Carlo for laws that are too sharp for a lattice, with one source integrated exactly.

x = m + A z + sum_j h_j u_j is sampled by scrambled Sobol points (Owen 1995; Matousek's linear scrambling as in SciPy),
16 independent scramblings for a standard error.  One deviate is not sampled: along its line ``|x + h t| <= r`` is an
interval of t, whose probability is known exactly.  That makes the integrand continuous, which is what
quasi-Monte-Carlo needs; a single source comes out exact.  Where the lines cross the sphere |e| = r is also all that
derivatives need: one sample gives the gradient by everything.

The line must cross the sphere.  So it is that of the deviate which moves |e| most: a uniform column, or an axis of the
Gaussian part where that is steeper.  (A law of 45 mm normal along x and some 0.3 mm of everything else has its quantile
where the sphere is a plane across x: lines along y touch it nowhere, and its density there would be read as 0.)

Beyond the 32 longest, columns are drawn as one Gaussian, and what that can change is part of the error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import hypot, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ..errors import NotConvergedError, Problem
from ..geometry.arrays import Array
from ..kernels.numerics import principal_axes

RANDOMISATIONS = 16
MOST_EXPLICIT = 32  # columns that are sampled; of more, the shortest are taken as Gaussian
_SEED = 20240229
_NORMAL_END = 9.0  # standard deviations: a normal deviate is beyond with a probability of 2e-19
_ROUNDING = 1e-11  # relative: a sample that is no wider has no law; its bracket alone is 1e-12 wide
_NODES_UNIFORM, _NODES_NORMAL = 16, 48  # of Gauss-Legendre in t; a normal density needs more


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


def mean_and_error(values: Array) -> tuple[float, float]:
    """The mean of values (n,), one a point, and its standard error from the means of the scramblings."""
    blocks = values.reshape(RANDOMISATIONS, -1).mean(axis=1)
    return float(blocks.mean()), float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS)


@dataclass(frozen=True, eq=False)
class Sample:
    """Points of a law, but for one of its deviates, which is integrated exactly: ``x + t along``."""

    x: Array  # (n, 3) mm
    along: Array  # (3,) mm
    z: Array  # (n, k) normal deviates
    root: Array  # (k, 3) mm, axes of the Gaussian part: x holds z @ root, but for an axis that is integrated
    u: Array  # (n, K) uniform deviates; K - 1 where a column is integrated
    rest: Array  # (K, 3) mm, their columns
    column: int | None  # which column is integrated: t is uniform on (-1, 1)
    axis: int | None  # otherwise which axis is: t is standard normal
    explicit: NDArray[np.bool_]  # (all,) columns that are sampled or integrated; the others are in the Gaussian part
    folded: float  # bound of what taking those as Gaussian changes a probability by

    @cached_property
    def _nearest(self) -> tuple[Array, Array]:
        """(t where each line x + t along is nearest to 0 (n,), squared distance there, mm^2 (n,))."""
        square = float(self.along @ self.along)
        middle = -(self.x @ self.along) / square
        return middle, (self.x**2).sum(axis=1) - square * middle**2

    def crossings(self, r: float) -> tuple[Array, Array, Array]:
        """(t where each line x + t along enters the ball of radius r (n,), where it leaves (n,), half its chord, mm^2:
        |along| times half the length inside (n,)); a line that misses the ball enters and leaves where it is nearest,
        with half a chord of 0."""
        square = float(self.along @ self.along)
        middle, nearest = self._nearest
        chord = np.sqrt(np.maximum(square * (r * r - nearest), 0.0))
        return middle - chord / square, middle + chord / square, chord

    @property
    def _end(self) -> float:
        """|t| does not exceed it."""
        return 1.0 if self.axis is None else _NORMAL_END

    def _below(self, t: Array) -> Array:
        """Probability that the integrated deviate is below t, up to a constant."""
        return np.asarray(0.5 * np.clip(t, -1.0, 1.0) if self.axis is None else ndtr(t))

    def _density_of(self, t: Array) -> Array:
        """Density of the integrated deviate at t."""
        if self.axis is None:
            return np.asarray(0.5 * (np.abs(t) < 1))
        return np.asarray(np.exp(-0.5 * t * t) / sqrt(2.0 * pi))

    def shares(self, r: float) -> Array:
        """(n,) P(|x + t along| <= r) over t, at each point."""
        enters, leaves, _ = self.crossings(r)
        return np.asarray(self._below(leaves) - self._below(enters))

    def probability(self, r: float) -> float:
        return float(self.shares(r).mean())

    def density(self, r: float) -> float:
        """Derivative of the probability by r, 1/mm: each crossing adds the density of t there times r over half the
        chord."""
        enters, leaves, chord = self.crossings(r)
        crossing = (chord > 0) * (self._density_of(enters) + self._density_of(leaves))
        return float((r * crossing / np.where(chord > 0, chord, 1.0)).mean())

    def shift(self, by: Array) -> Sample:
        """The same sample with the mean elsewhere, by (3,) mm."""
        return replace(self, x=self.x + by)

    def excess(self, r: float) -> float:
        """E[(|e| - r)+]: Gauss-Legendre in t beside the ball, where the integrand is smooth."""
        count, end = (_NODES_UNIFORM, 1.0) if self.axis is None else (_NODES_NORMAL, self._end)
        nodes, weights = np.polynomial.legendre.leggauss(count)
        enters, leaves, _ = (np.clip(value, -end, end) for value in self.crossings(r))
        last, total = np.full(len(self.x), end), np.zeros(len(self.x))
        square, (middle, nearest) = float(self.along @ self.along), self._nearest
        nearest = np.maximum(nearest, 0.0)
        for low, high in ((-last, enters), (leaves, last)):
            for node, weight in zip(nodes, weights, strict=True):
                t = 0.5 * (low + high) + 0.5 * (high - low) * node
                norm = np.sqrt(nearest + square * (t - middle) ** 2)
                total += 0.5 * (high - low) * weight * self._density_of(t) * np.maximum(norm - r, 0.0)
        return float(total.mean())

    def quantile(self, p: float) -> tuple[float, float, float]:
        """(r, density, error of r: one standard error, and what taking small columns as Gaussian changes).

        Raises NotConvergedError where no line crosses the sphere: the density, and with it the error, is not known.
        """
        from scipy.optimize import brentq  # as the Sobol points: few laws are sampled

        size, reach = np.sqrt((self.x**2).sum(axis=1)), self._end * sqrt(float(self.along @ self.along))
        low, high = float(size.min()) - reach, (float(size.max()) + reach) * (1 + 1e-12)
        r = float(brentq(lambda x: self.probability(x) - p, max(low * (1 - 1e-12), 0.0), high, xtol=1e-12 * high))
        density = self.density(r)
        if density == 0.0 and high - low <= _ROUNDING * high:  # all of the sample is one number but for its rounding
            return r, 0.0, high - low
        if density == 0.0:
            detail = (
                f"the {p:g} quantile of the error lies near {r:.4g} mm, in a gap of the sample of its law: "
                "how exact it is cannot be told"
            )
            hint = "one tolerance is out of all proportion to the others: see that it is what you mean"
            raise NotConvergedError(Problem("", "tail-not-converged", detail, hint))
        return r, density, hypot(mean_and_error(self.shares(r))[1], self.folded) / density

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
            on = np.flatnonzero((chord > 0) & (self._density_of(t) > 0))
            density, at, half, z = self._density_of(t[on]), t[on], chord[on], self.z[on]
            if self.axis is not None:
                z[:, self.axis] = at
            e = density[:, None] * (self.x[on] + at[:, None] * self.along) / half[:, None]
            by_mean += e.sum(axis=0)
            by_z += e.T @ z
            by_u += e.T @ self.u[on]
            by_along += side * float((density * at).sum())
            total += float((density * r / half).sum())
        by_deviate = by_z @ (self.root / (self.root**2).sum(axis=1, keepdims=True)) / total
        by_covariance = 0.25 * (by_deviate + by_deviate.T)
        own = np.empty(int(self.explicit.sum()))
        others = np.ones(len(own), dtype=bool)
        if self.column is not None:
            others[self.column] = False
            own[self.column] = by_along / total
        own[others] = (by_u.T * self.rest).sum(axis=1) / total
        by_column = np.empty(len(h))
        by_column[self.explicit] = own
        small = h[~self.explicit]  # h h' / 3 in the covariance: twice that for a relative change of the length
        by_column[~self.explicit] = 2.0 / 3.0 * np.einsum("ja,ab,jb->j", small, by_covariance, small)
        return by_mean / total, by_covariance, by_column


def sample(mean: Array, covariance: Array, h: Array, log2_count: int) -> Sample:
    """16 x 2^log2_count points of the law.  h: (K, 3) uniform columns, K >= 1."""
    folded, explicit, bound = _fold(covariance, h)
    columns = h[explicit]
    variances, _, axes = principal_axes(mean, folded)
    rank = int((variances > 0).sum())
    root = (axes[:, :rank] * np.sqrt(variances[:rank])).T
    # The deviate that crosses the sphere most steeply: near a large mean, the one along it.
    spread = np.trace(covariance) + (h**2).sum() / 3.0
    by_column, by_axis = ((line @ mean) ** 2 + (line**2).sum(axis=1) * spread for line in (columns, root))
    column, axis = int(np.argmax(by_column)), None
    if rank and by_axis.max() > by_column[column] / 3.0:  # both per variance
        axis = int(np.argmax(by_axis))
    rest = np.delete(columns, column, axis=0) if axis is None else columns
    z, u = sobol_points(rank, rest.shape[0], log2_count)
    if axis is None:
        x = mean + z @ root + u @ rest
        return Sample(x, columns[column], z, root, u, rest, column, None, explicit, bound)
    others = np.arange(rank) != axis
    x = mean + z[:, others] @ root[others] + u @ rest
    return Sample(x, root[axis], z, root, u, rest, None, axis, explicit, bound)


def _fold(S: Array, h: Array) -> tuple[Array, NDArray[np.bool_], float]:
    """(S with the variance of the shortest columns (3, 3), which are left (K,), what that may change a probability by).

    A uniform column with ``rho^2 = h'G^-1 h``, G the covariance of S and of all columns taken in, changes the
    distribution function of any projection by less than ``3.1e-3 rho^4``: the first term of Edgeworth's series,
    ``k4 / 24`` times 0.55, the largest of (x^3 - 3x) phi(x), with ``k4 = -2/15 rho^4``.
    """
    explicit = np.zeros(len(h), dtype=bool)
    explicit[np.argsort((h**2).sum(axis=1), kind="stable")[-MOST_EXPLICIT:]] = True
    small = h[~explicit]
    folded = S + small.T @ small / 3.0
    variances, _, axes = principal_axes(np.zeros(3), folded)
    rank = int((variances > 0).sum())
    rho2 = ((small @ axes[:, :rank]) ** 2 / variances[:rank]).sum(axis=1)
    return folded, explicit, 3.1e-3 * float((rho2**2).sum())
