"""The quantile of a declared law without some of its parts, for many choices of parts in one compiled call."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel
from .declared_kernels import on_principal_axes, solve_on_axes, start_radius
from .quantile import excess_quantile
from .series import rows_where
from .spectrum import principal_axes

LATTICE, GAUSSIAN, UNSOLVED, NOT_A_PART = 0, 1, 2, 3
SLACK, ROUNDING = 1e-9, 1e-13  # of the trace: how negative an eigenvalue may be, and what is 0


@kernel()
def less_block(covariance: Array, block: Array) -> tuple[Array, float]:
    """(covariance - block (3, 3), its smallest eigenvalue over the trace of the covariance).

    What rounding leaves of a direction that was removed altogether is 0.
    """
    scale = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    values, vectors, _ = eigen_symmetric(covariance - block)
    least = values[2] / scale if scale > 0.0 else values[2]
    out = np.zeros((3, 3))
    for i in range(3):
        if values[i] >= ROUNDING * scale:
            for a in range(3):
                for b in range(3):
                    out[a, b] += values[i] * vectors[a, i] * vectors[b, i]
    return out, least


@kernel()
def _gaussian(p: float, mean: Array, covariance: Array) -> tuple[int, float, float, float]:
    variances, m, _ = principal_axes(mean, covariance)
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if variances[0] == 0.0:
        return GAUSSIAN, size, 0.0, 0.0
    d, density, converged = excess_quantile(p, variances, m)
    r = sqrt(max(size * size + d, 0.0))
    return (GAUSSIAN if converged else UNSOLVED), r, 2.0 * r * density, 1e-12 * r


@kernel(nogil=True)
def quantiles_without(
    p: float,
    mean: Array,
    covariance: Array,
    h: Array,
    blocks: Array,
    gone: NDArray[np.bool_],
    at: float,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """(how (G,), p-quantile (G,), density (G,), error of the quantile (G,)) of the law without each of G groups.

    h: (K, 3); blocks (G, 3, 3): Gaussian covariance to remove, zeros for none; gone (G, K): columns to remove; at: the
    quantile of the whole law, or 0 if unknown: it calibrates the starts.  how: LATTICE or GAUSSIAN, UNSOLVED (too
    large a lattice, or not converged), NOT_A_PART (a block that is no part of the covariance).
    """
    count = blocks.shape[0]
    how = np.empty(count, dtype=np.int64)
    r = np.zeros(count)
    density = np.zeros(count)
    error = np.zeros(count)
    ratio = 1.0
    if at > 0.0 and h.shape[0] > 0:
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, covariance, h)
        if at * at > offset:
            ratio = sqrt(at * at - offset) / start_radius(p, sigma, m, turned)
    for g in range(count):
        rest = covariance
        if blocks[g].any():
            rest, least = less_block(covariance, blocks[g])
            if least < -SLACK:
                how[g] = NOT_A_PART
                continue
        kept = rows_where(h, gone[g], False)
        if kept.shape[0] == 0:
            how[g], r[g], density[g], error[g] = _gaussian(p, mean, rest)
            continue
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(mean, rest, kept)
        start = ratio * start_radius(p, sigma, m, turned)
        found, rho, slope, doubt, _, _, _ = solve_on_axes(
            p, start, sigma, m, S, turned, dimension, threshold, aliasing, largest_box
        )
        how[g] = LATTICE if found else UNSOLVED
        if found:
            r[g] = sqrt(rho * rho + offset)
            density[g] = slope * r[g] / rho
            error[g] = doubt / density[g]
    return how, r, density, error
