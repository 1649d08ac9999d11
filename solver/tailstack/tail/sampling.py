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
FOLDED = 1e-5  # bound of what taking small columns as Gaussian changes a probability by: less than sampling
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
def crossings(r: float, x: Array, h: Array) -> tuple[Array, Array, float]:
    """What moves the sphere's crossings of the lines x_i + u h, |u| < 1: derivatives of P(|x + h u| <= r), negated.

    (v (n, 3), w (n,), density): a displacement d of point i lowers the probability by ``v_i'd / n``, one of ``u d`` by
    ``w_i`` times d along h over n; density is that by r.  At a crossing e the line goes at e'h / r through the sphere.
    """
    n = x.shape[0]
    v = np.zeros((n, 3))
    w = np.zeros(n)
    total = 0.0
    hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2]
    for i in range(n):
        xh = x[i, 0] * h[0] + x[i, 1] * h[1] + x[i, 2] * h[2]
        xx = x[i, 0] * x[i, 0] + x[i, 1] * x[i, 1] + x[i, 2] * x[i, 2]
        room = xh * xh - hh * (xx - r * r)
        if room > 0.0:
            root = sqrt(room)
            for side in (-1.0, 1.0):
                u = (-xh + side * root) / hh
                if fabs(u) < 1.0:
                    for a in range(3):
                        v[i, a] += 0.5 * (x[i, a] + u * h[a]) / root
                    w[i] += 0.5 * side * u
                    total += 0.5 * r / root
    return v, w, total / n


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
        v, w, density = crossings(r, self.x, self.along)
        scale = 1.0 / (density * len(v))
        by_mean = scale * v.sum(axis=0)
        inverse = self.root / np.maximum((self.root**2).sum(axis=1, keepdims=True), 1e-300)
        by_deviate = scale * (v.T @ self.z) @ inverse if len(self.root) else np.zeros((3, 3))
        by_covariance = 0.25 * (by_deviate + by_deviate.T)
        own = np.empty(int(self.explicit.sum()))
        others = np.arange(len(own)) != self.left_out
        own[others] = scale * ((v.T @ self.u).T * self.rest).sum(axis=1)
        own[self.left_out] = scale * w.sum()
        by_column = np.empty(len(h))
        by_column[self.explicit] = own
        small = h[~self.explicit]  # h h' / 3 in the covariance: twice that for a relative change of the length
        by_column[~self.explicit] = 2.0 / 3.0 * np.einsum("ja,ab,jb->j", small, by_covariance, small)
        return by_mean, by_covariance, by_column


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
    folded, explicit, bound = fold_many(covariance, h, FOLDED, MOST_EXPLICIT)
    kept = h[explicit]
    # The column that crosses the sphere most steeply: near a large mean, the one along it.
    spread = np.trace(covariance) + (h**2).sum() / 3.0
    along = int(np.argmax((kept @ mean) ** 2 + (kept**2).sum(axis=1) * spread))
    variances, _, axes = principal_axes(mean, folded)
    rank = int((variances > 0).sum())
    root = (axes[:, :rank] * np.sqrt(variances[:rank])).T
    rest = np.delete(kept, along, axis=0)
    z, u = sobol_points(rank, rest.shape[0], log2_count)
    x = mean + u @ rest + (z @ root if rank else 0.0)
    weights = _edgeworth_weights(z, root, h[~explicit]) if bound > FOLDED else np.zeros(0)
    return Sample(
        np.ascontiguousarray(x), np.ascontiguousarray(kept[along]), z, root, u, rest, along, explicit, bound, weights
    )


def _edgeworth_weights(z: Array, root: Array, small: Array) -> Array:
    """(n,) ``1/24 sum_j -2/15 ((g_j'z)^4 - 6 g_j'g_j (g_j'z)^2 + 3 (g_j'g_j)^2)``, g_j column j on the deviates z.

    The fourth cumulant of a uniform column h is -2/15 h^4, and a Gaussian density's fourth derivative along it is that
    Hermite polynomial times the density.  The sums over columns are taken first.
    """
    g = small @ (root / (root**2).sum(axis=1, keepdims=True)).T
    size = (g**2).sum(axis=1)
    pairs = (g[:, :, None] * g[:, None, :]).reshape(len(g), -1)
    z2 = (z[:, :, None] * z[:, None, :]).reshape(len(z), -1)
    quartic = ((z2 @ (pairs.T @ pairs)) * z2).sum(axis=1)
    return np.asarray(-2 / 15 / 24 * (quartic - 6 * z2 @ (pairs.T @ size) + 3 * float((size**2).sum())))


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
        rho2 = np.einsum("ja,ab,jb->j", small, np.linalg.pinv(folded, rcond=1e-12, hermitian=True), small)
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
    """(r, density, standard error of r) by bisection and secant steps on the averaged conditional probability."""
    bound = np.sqrt((x**2).sum(axis=1))
    reach = sqrt(float(h @ h))
    low, high = max(float(bound.min()) - reach, 0.0), float(bound.max()) + reach
    f_low, f_high = -p, 1.0 - p
    for step in range(200):
        middle = 0.5 * (low + high)
        if step % 3:  # regula falsi, kept off the ends
            secant = low - f_low * (high - low) / (f_high - f_low)
            middle = min(max(secant, low + 0.02 * (high - low)), high - 0.02 * (high - low))
        value = float(conditional_probability(middle, x, h, RANDOMISATIONS).mean()) - p
        if value < 0:
            low, f_low = middle, value
        else:
            high, f_high = middle, value
        if high - low < 1e-12 * high or fabs(value) < 1e-13:
            break
    r = high if high - low < 1e-12 * high else middle
    blocks = conditional_probability(r, x, h, RANDOMISATIONS)
    _, _, density = crossings(r, x, h)
    error = float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS)
    return r, density, error / density if density > 0 else 0.0
