"""Randomised quasi-Monte-Carlo for laws that are too sharp for a lattice, with one source integrated exactly.

x = m + A z + sum_j h_j u_j is sampled by scrambled Sobol points (Owen 1995; Matousek's linear scrambling as in SciPy),
16 independent scramblings for a standard error.  The longest column is not sampled: along it ``|x + h u| <= r`` is
an interval of u, whose length is the exact conditional probability.  That makes the integrand continuous, which is what
quasi-Monte-Carlo needs; a single uniform source comes out exact.
"""

from __future__ import annotations

from functools import lru_cache
from math import fabs, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import ndtri

from ..system import Array
from .sobol import scrambled_sobol
from .spectrum import principal_axes

SingleArray = NDArray[np.float32]
RANDOMISATIONS = 16
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


def sample_rest(mean: Array, covariance: Array, h: Array, log2_count: int) -> tuple[Array, Array]:
    """(x (n, 3) without the longest column, that column (3,)).  h: (K, 3) uniform columns, K >= 1."""
    longest = int(np.argmax((h**2).sum(axis=1)))
    variances, _, axes = principal_axes(mean, covariance)
    rank = int((variances > 0).sum())
    rest = np.delete(h, longest, axis=0)
    z, u = sobol_points(rank, rest.shape[0], log2_count)
    x = np.broadcast_to(mean, (z.shape[0], 3)) + u @ rest
    if rank:
        x = x + z @ (axes[:, :rank] * np.sqrt(variances[:rank])).T
    return np.ascontiguousarray(x), np.ascontiguousarray(h[longest])


def sampled_quantile(p: float, x: Array, h: Array) -> tuple[float, float, float]:
    """(r, density, standard error of r) by bisection and secant steps on the averaged conditional probability."""
    bound = np.sqrt((x**2).sum(axis=1))
    low, high = 0.0, float(bound.max() + sqrt(float(h @ h)))
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
    width = 5e-3 * r
    density = float(
        (
            conditional_probability(r + width, x, h, RANDOMISATIONS).mean()
            - conditional_probability(r - width, x, h, RANDOMISATIONS).mean()
        )
        / (2 * width)
    )
    error = float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS)
    return r, density, error / density if density > 0 else 0.0
