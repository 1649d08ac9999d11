"""Randomised quasi-Monte-Carlo for laws that are too sharp for a lattice, with one source integrated exactly.

x = m + A z + sum_j h_j u_j is sampled by scrambled Sobol points (Owen 1995; Matousek's linear scrambling as in SciPy),
16 independent scramblings for a standard error.  One column is not sampled: along it ``|x + h u| <= r`` is an interval
of u, whose length is the exact conditional probability.  That makes the integrand continuous, which is what
quasi-Monte-Carlo needs; a single uniform source comes out exact.  Where the lines cross the sphere |e| = r is also all
that derivatives need: one sample gives the gradient by everything.

Columns that are many and small are drawn as one Gaussian, and what that changes is measured and stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import fabs, hypot, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..arrays import Array
from ..kernels import kernel
from .sobol import scrambled_sobol
from .spectrum import principal_axes

SingleArray = NDArray[np.float32]
RANDOMISATIONS = 16
# What taking small columns as Gaussian may change a probability by (less than sampling), with 2^12 points and fewer.
FOLDED, FOLDED_COARSE, FINE = 1e-5, 1e-4, 12
MOST_EXPLICIT = 32  # columns that are sampled; beyond, more are taken as Gaussian and the error says so
_SEED = 20240229


@lru_cache(maxsize=12)
def sobol_points(normals: int, uniforms: int, log2_count: int, salt: int = 0) -> tuple[Array, Array]:
    """(z (R N, normals) standard normal, u (R N, uniforms) on (-1, 1)); R scramblings of N = 2^log2_count points.

    Read-only and the same in every process.
    """
    dimension = max(normals + uniforms, 1)
    blocks = [
        scrambled_sobol(dimension, log2_count, np.random.default_rng([_SEED, salt, i])) for i in range(RANDOMISATIONS)
    ]
    points = np.concatenate(blocks)
    # Scrambled points lie on a grid of 2^-64 or coarser that contains 0.
    z = np.ascontiguousarray(ndtri(np.clip(points[:, :normals], 1e-16, 1 - 1e-16)))
    u = np.ascontiguousarray(2.0 * points[:, normals : normals + uniforms] - 1.0)
    z.setflags(write=False)
    u.setflags(write=False)
    return z, u


@lru_cache(maxsize=12)
def sobol_rows(normals: int, uniforms: int, log2_count: int, salt: int = 0) -> tuple[SingleArray, SingleArray]:
    """(z (normals, R N), u (uniforms, R N)): :func:`sobol_points`, one coordinate a row, rounded to single precision.

    Half the memory to be read for every sample; the points stay the same ones for all laws, which is what counts.
    """
    points = sobol_points(normals, uniforms, log2_count, salt)
    z, u = (np.ascontiguousarray(columns.T, dtype=np.float32) for columns in points)
    z.setflags(write=False)
    u.setflags(write=False)
    return z, u


@kernel()
def conditional_probability(r: float, x: Array, h: Array, blocks: int) -> Array:
    """(blocks,) mean over each block of P(|x_i + h u| <= r), u uniform on (-1, 1).  x: (n, 3), h: (3,)."""
    out = np.zeros(blocks)
    n = x.shape[0] // blocks
    hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2]
    for b in range(blocks):
        total = 0.0
        for i in range(b * n, (b + 1) * n):
            xh = x[i, 0] * h[0] + x[i, 1] * h[1] + x[i, 2] * h[2]
            xx = x[i, 0] * x[i, 0] + x[i, 1] * x[i, 1] + x[i, 2] * x[i, 2]
            room = xh * xh - hh * (xx - r * r)
            if room > 0.0:
                root = sqrt(room)
                low = max(-1.0, (-xh - root) / hh)
                high = min(1.0, (-xh + root) / hh)
                if high > low:
                    total += 0.5 * (high - low)
        out[b] = total / n
    return out


@kernel()
def conditional_excess(r: float, x: Array, h: Array, blocks: int) -> Array:
    """(blocks,) mean over each block of E[(|x_i + h u| - r)+]: 16-point Gauss-Legendre in u beside the kinks."""
    nodes = np.array(
        [
            0.0950125098376374,
            0.2816035507792589,
            0.4580167776572274,
            0.6178762444026438,
            0.755404408355003,
            0.8656312023878318,
            0.9445750230732326,
            0.9894009349916499,
        ]
    )
    weights = np.array(
        [
            0.1894506104550685,
            0.1826034150449236,
            0.1691565193950025,
            0.1495959888165767,
            0.1246289712555339,
            0.0951585116824928,
            0.0622535239386479,
            0.0271524594117541,
        ]
    )
    out = np.zeros(blocks)
    n = x.shape[0] // blocks
    hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2]
    for b in range(blocks):
        total = 0.0
        for i in range(b * n, (b + 1) * n):
            xh = x[i, 0] * h[0] + x[i, 1] * h[1] + x[i, 2] * h[2]
            xx = x[i, 0] * x[i, 0] + x[i, 1] * x[i, 1] + x[i, 2] * x[i, 2]
            room = xh * xh - hh * (xx - r * r)
            centre = min(max(-xh / hh, -1.0), 1.0)
            low = centre
            high = centre
            if room > 0.0:
                root = sqrt(room)
                low = min(max((-xh - root) / hh, -1.0), 1.0)
                high = min(max((-xh + root) / hh, -1.0), 1.0)
            for side in range(2):
                a = -1.0 if side == 0 else high
                c = low if side == 0 else 1.0
                if c <= a:
                    continue
                for q in range(8):
                    for sign in (-1.0, 1.0):
                        u = 0.5 * (a + c) + 0.5 * (c - a) * sign * nodes[q]
                        norm = sqrt(max(xx + u * (2.0 * xh + u * hh), 0.0))
                        total += 0.25 * (c - a) * weights[q] * max(norm - r, 0.0)
        out[b] = total / n
    return out


@kernel()
def probability_and_density(r: float, x: Array, h: Array) -> tuple[float, float]:
    """(P(|x + h u| <= r), its derivative by r) over all points x (n, 3)."""
    hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2]
    inside = 0.0
    density = 0.0
    for i in range(x.shape[0]):
        xh = x[i, 0] * h[0] + x[i, 1] * h[1] + x[i, 2] * h[2]
        xx = x[i, 0] * x[i, 0] + x[i, 1] * x[i, 1] + x[i, 2] * x[i, 2]
        room = xh * xh - hh * (xx - r * r)
        if room > 0.0:
            root = sqrt(room)
            low = (-xh - root) / hh
            high = (-xh + root) / hh
            if fabs(low) < 1.0:
                density += 0.5 * r / root
            if fabs(high) < 1.0:
                density += 0.5 * r / root
            inside += 0.5 * max(min(1.0, high) - max(-1.0, low), 0.0)
    return inside / x.shape[0], density / x.shape[0]


@kernel()
def crossing_sums(r: float, x: Array, h: Array, z: Array, u: Array) -> tuple[Array, Array, Array, float, float]:
    """Sums over the sphere's crossings of the lines x_i + t h, |t| < 1, weighted by the density that each adds over r.

    (of e (3,), of e z_i' (3, k), of e u_i' (3, K), of e'h t, of r): a displacement d_i of the points moves the quantile
    by ``sum e'd_i`` over the last.  At a crossing e the line goes at |e'h| / r through the sphere.
    """
    by_mean = np.zeros(3)
    by_z = np.zeros((3, z.shape[1]))
    by_u = np.zeros((3, u.shape[1]))
    by_h = 0.0
    total = 0.0
    hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2]
    e = np.empty(3)
    for i in range(x.shape[0]):
        xh = x[i, 0] * h[0] + x[i, 1] * h[1] + x[i, 2] * h[2]
        xx = x[i, 0] * x[i, 0] + x[i, 1] * x[i, 1] + x[i, 2] * x[i, 2]
        room = xh * xh - hh * (xx - r * r)
        if room > 0.0:
            root = sqrt(room)
            for side in (-1.0, 1.0):
                t = (-xh + side * root) / hh
                if fabs(t) < 1.0:
                    for a in range(3):
                        e[a] = (x[i, a] + t * h[a]) / root
                        by_mean[a] += e[a]
                    for a in range(3):
                        for k in range(z.shape[1]):
                            by_z[a, k] += e[a] * z[i, k]
                        for k in range(u.shape[1]):
                            by_u[a, k] += e[a] * u[i, k]
                    by_h += side * t
                    total += r / root
    return by_mean, by_z, by_u, by_h, total


@kernel()
def _points_of(mean: Array, z: Array, root: Array, u: Array, rest: Array) -> Array:
    """(n, 3) mean + z root + u rest, summed in this order whatever the processor."""
    out = np.empty((z.shape[0], 3))
    for i in range(out.shape[0]):
        for a in range(3):
            total = mean[a]
            for k in range(z.shape[1]):
                total += z[i, k] * root[k, a]
            for k in range(u.shape[1]):
                total += u[i, k] * rest[k, a]
            out[i, a] = total
    return out


@kernel()
def _edgeworth_weights(z: Array, root: Array, small: Array) -> Array:
    """(n,) ``1/24 sum_j -2/15 ((g_j'z)^4 - 6 g_j'g_j (g_j'z)^2 + 3 (g_j'g_j)^2)``, g_j column j on the deviates z.

    The fourth cumulant of a uniform column h is -2/15 h^4, and a Gaussian density's fourth derivative along it is that
    Hermite polynomial times the density.  The sums over columns are taken first.
    """
    rank = root.shape[0]
    g = np.zeros((small.shape[0], rank))
    fourth = np.zeros((rank, rank, rank, rank))
    second = np.zeros((rank, rank))
    constant = 0.0
    for j in range(small.shape[0]):
        size = 0.0
        for k in range(rank):
            length = 0.0
            for a in range(3):
                g[j, k] += small[j, a] * root[k, a]
                length += root[k, a] * root[k, a]
            g[j, k] /= length
            size += g[j, k] * g[j, k]
        constant += 3.0 * size * size
        for k in range(rank):
            for l in range(rank):  # noqa: E741
                second[k, l] -= 6.0 * size * g[j, k] * g[j, l]
                for m in range(rank):
                    for n in range(rank):
                        fourth[k, l, m, n] += g[j, k] * g[j, l] * g[j, m] * g[j, n]
    out = np.empty(z.shape[0])
    for i in range(out.shape[0]):
        total = constant
        for k in range(rank):
            for l in range(rank):  # noqa: E741
                inner = second[k, l]
                for m in range(rank):
                    for n in range(rank):
                        inner += fourth[k, l, m, n] * z[i, m] * z[i, n]
                total += inner * z[i, k] * z[i, l]
        out[i] = total * (-2.0 / 15.0 / 24.0)
    return out


@dataclass(frozen=True, slots=True, eq=False)
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

    def probability(self, r: float) -> float:
        return float(conditional_probability(r, self.x, self.along, RANDOMISATIONS).mean())

    def probability_moved(self, r: float, by: Array) -> float:
        """The same with the mean elsewhere."""
        return float(conditional_probability(r, self.x + by, self.along, RANDOMISATIONS).mean())

    def excess(self, r: float) -> float:
        """E[(|e| - r)+]"""
        return float(conditional_excess(r, self.x, self.along, RANDOMISATIONS).mean())

    def quantile(self, p: float) -> tuple[float, float, float]:
        """(r, density, error of r: one standard error, and what taking small columns as Gaussian changes)."""
        r, density, error = sampled_quantile(p, self.x, self.along)
        return r, density, hypot(error, self.folded_error(r) / density) if density > 0 else error

    def folded_error(self, r: float) -> float:
        """What taking small columns as Gaussian changes P(|e| <= r) by.

        Its bound, or where that is not small enough the first term of Edgeworth's series as measured, its standard
        error, and the size of the terms behind it.
        """
        if not len(self.edgeworth):
            return self.folded
        each = conditional_probability(r, self.x, self.along, len(self.x)) * self.edgeworth
        blocks = each.reshape(RANDOMISATIONS, -1).mean(axis=1)
        return abs(float(blocks.mean())) + float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS) + self.folded**2

    def gradient(self, r: float, h: Array) -> tuple[Array, Array, Array]:
        """(dr by the mean (3,), by the Gaussian covariance (3, 3), by the logarithm of each column's length (K,)).

        ``dr = E[e'de / r]`` over the sphere |e| = r.  A covariance grows along C as its deviates are displaced by
        ``C S^-1 (x - mean) / 2``.  h: (K, 3) all columns of the law.
        """
        by_mean, by_z, by_u, by_along, total = crossing_sums(r, self.x, self.along, self.z, self.u)
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


@lru_cache(maxsize=4)
def sample_of(law: bytes, columns: int, log2_count: int) -> Sample:
    """:func:`sample` of a law in bytes: mean, covariance and columns one after another."""
    numbers = np.frombuffer(law)
    return _sample(numbers[:3], numbers[3:12].reshape(3, 3), numbers[12:].reshape(columns, 3), log2_count)


def sample(mean: Array, covariance: Array, h: Array, log2_count: int) -> Sample:
    """16 x 2^log2_count points of the law.  h: (K, 3) uniform columns, K >= 1.  The last few are remembered."""
    law = np.concatenate([mean, covariance.ravel(), h.ravel()])
    return sample_of(law.tobytes(), h.shape[0], log2_count)


def _sample(mean: Array, covariance: Array, h: Array, log2_count: int) -> Sample:
    budget = FOLDED if log2_count >= FINE else FOLDED_COARSE
    folded, explicit, bound = fold_many(covariance, h, budget, MOST_EXPLICIT)
    kept = h[explicit]
    # The column that crosses the sphere most steeply: near a large mean, the one along it.
    spread = np.trace(covariance) + (h**2).sum() / 3.0
    along = int(np.argmax((kept @ mean) ** 2 + (kept**2).sum(axis=1) * spread))
    variances, _, axes = principal_axes(mean, folded)
    rank = int((variances > 0).sum())
    root = (axes[:, :rank] * np.sqrt(variances[:rank])).T
    rest = np.delete(kept, along, axis=0)
    z, u = sobol_points(rank, rest.shape[0], log2_count)
    root, rest = np.ascontiguousarray(root), np.ascontiguousarray(rest)
    x = _points_of(mean, z, root, u, rest)
    weights = _edgeworth_weights(z, root, h[~explicit]) if bound > budget else np.zeros(0)
    return Sample(x, np.ascontiguousarray(kept[along]), z, root, u, rest, along, explicit, bound, weights)


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


def sampled_quantile(p: float, x: Array, h: Array) -> tuple[float, float, float]:
    """(r, density, standard error of r) by Newton's steps on the averaged conditional probability, in a bracket."""
    size = np.sqrt((x**2).sum(axis=1))
    reach = sqrt(float(h @ h))
    low, high = max(float(size.min()) - reach, 0.0), float(size.max()) + reach
    r = float(np.quantile(size, p))
    for _ in range(100):
        value, density = probability_and_density(r, x, h)
        low, high = (r, high) if value < p else (low, r)
        step = r - (value - p) / density if density > 0 else low
        step = step if low < step < high else 0.5 * (low + high)
        done = abs(step - r) < 1e-12 * high
        r = step
        if done:
            break
    blocks = conditional_probability(r, x, h, RANDOMISATIONS)
    _, density = probability_and_density(r, x, h)
    error = float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS)
    return r, density, error / density if density > 0 else 0.0
