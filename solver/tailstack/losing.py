"""Kernels of ``losses``: what is left of the gains of the images without some fiducials, and which loss is the worst.

A file of its own, so that they reach no more than they use: a new measure or effect compiles none of them.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry.arrays import Array
from .kernels.store import kernel
from .propagation.noise import Imaging, assemble_after, eliminate_for, room_for
from .tail.approximation import pearson_square


class LossGains(NamedTuple):
    """The S ways to lose so many fiducials, and what is left of the gains of the images at P places: at each target in
    mm, con, then of each measure that joins several in its own unit and frame.
    """

    kept: Array  # (S, N) 0 of what is lost, otherwise 1
    imaged: Array  # (P, S, 3, 3) mm^2: covariance of what acts through single images, and of believed intrinsics
    moved: Array  # (P, S, 3, K + G) mm: by each source that moves images together, then by all that is known


class Rest(NamedTuple):
    """What of the law of an error no loss changes, at T sites."""

    to_error: Array  # (T, 3, 3) from the frame of ``LossGains`` to the error's
    beyond: Array  # (T, 3, K + G) mm: what these do beyond the images
    std: Array  # (K,) of these sources
    mean: Array  # (T, 3) mm: less what comes through the images
    covariance: Array  # (T, 3, 3) mm^2
    by_second: Array  # (T,) mm^4: what columns that are not normal add to cumulants (``columns_in_cumulants``)
    by_third: Array  # (T,) mm^6
    shape: Array  # (T, 3, 3) mm^4


class Ranking(NamedTuple):
    """Losses at targets by Pearson's form, of manufacturing errors as if they were Gaussian."""

    quantile: Array  # (T, S) mm; inf where nothing is determined
    cumulants: Array  # (T, S, 3) of the square of the error
    covariance: Array  # (T, S, 3, 3) mm^2


@kernel(nogil=True)
def lose(
    imaging: Imaging,
    aims: Array,
    joints: Array,
    apart: NDArray[np.bool_],
    shifts: Array,
    std: Array,
    weights: Array,
    gains: tuple[Array, Array],
) -> None:
    """Fill the arrays of ``LossGains``.

    aims (T, 3) mm: the targets, reconstructed without noise; joints (P - T, T, 3, 3): what a displacement of each does
    to the measures that join several; apart (M,): which sources each target has of its own; shifts (T, V, 2 N + 2, C)
    px as ``noise.assemble`` takes them; std (M,) of the sources of its columns; weights (S, V, N): 1 where a view's
    estimate uses a fiducial; gains: imaged and moved.
    """
    imaged, moved = gains
    targets = aims.shape[0]
    each, row_weights = np.zeros((targets, 3, std.size + moved.shape[3])), np.zeros((weights.shape[1], 2, 2))
    joined = np.zeros((targets + 1, 3, std.size + moved.shape[3]))  # what is common, then what each target has
    eliminated = room_for(weights.shape[1], imaging.points)
    for s in range(weights.shape[0]):
        eliminate_for(imaging.estimation, imaging.projections, imaging.points, weights[s], eliminated)
        for t in range(targets):
            assemble_after(eliminated, imaging, weights[s], aims[t], shifts[t], each[t], row_weights)
            _sum_columns(each[t : t + 1], std, imaged[t, s], moved[t, s])
        for j in range(joints.shape[0]):
            joined[:] = 0.0
            for t in range(targets):
                for k in range(each.shape[2] if joints[j, t].any() else 0):
                    at = t + 1 if k < std.size and apart[k] else 0
                    for a in range(3):
                        for b in range(3):
                            joined[at, a, k] += joints[j, t, a, b] * each[t, b, k]
            _sum_columns(joined, std, imaged[targets + j, s], moved[targets + j, s])


@kernel()
def _sum_columns(columns: Array, std: Array, imaged: Array, moved: Array) -> None:
    """Fill imaged (3, 3) and moved (3, K + G); columns (J, 3, M + K + G): those of the first alone move together."""
    for a in range(3):
        for k in range(moved.shape[1]):
            moved[a, k] = columns[0, a, std.size + k]
        for b in range(a + 1):
            total = 0.0
            for j in range(columns.shape[0]):
                for n in range(std.size):
                    total += columns[j, a, n] * std[n] * (columns[j, b, n] * std[n])
            imaged[a, b] = total
            imaged[b, a] = total


@kernel(nogil=True)
def rank(imaged: Array, moved: Array, rest: Rest, z: float, ranking: Ranking) -> None:
    """Fill the ranking of losses; imaged, moved: of ``LossGains``; z: the standard normal quantile."""
    turned, mean, step = np.empty((3, 3)), np.empty(3), np.empty(3)
    for t in range(imaged.shape[0]):
        turn, shape = rest.to_error[t], rest.shape[t]
        for s in range(imaged.shape[1]):
            total = ranking.covariance[t, s]
            for a in range(3):
                mean[a] = rest.mean[t, a]
                for b in range(3):
                    turned[a, b] = 0.0
                    for c in range(3):
                        turned[a, b] += turn[a, c] * imaged[t, s, c, b]
            for a in range(3):
                for b in range(3):
                    total[a, b] = rest.covariance[t, a, b]
                    for c in range(3):
                        total[a, b] += turned[a, c] * turn[b, c]
            for k in range(rest.beyond.shape[2]):
                for a in range(3):
                    step[a] = rest.beyond[t, a, k]
                    for c in range(3):
                        step[a] += turn[a, c] * moved[t, s, c, k]
                if k >= rest.std.size:
                    mean += step
                else:
                    for a in range(3):
                        for b in range(3):
                            total[a, b] += step[a] * rest.std[k] * (step[b] * rest.std[k])
            c1, c2, c3 = 0.0, rest.by_second[t], rest.by_third[t]
            for a in range(3):
                along = 0.0  # of S m
                c1 += total[a, a] + mean[a] * mean[a]
                for b in range(3):
                    square = 0.0  # of S S
                    for c in range(3):
                        square += total[a, c] * total[c, b]
                    along += total[a, b] * mean[b]
                    c3 += square * total[b, a] + shape[a, b] * (total[b, a] + mean[a] * mean[b])
                    c2 += total[a, b] * total[b, a]
                c2 += 2.0 * mean[a] * along
                c3 += 3.0 * along * along
            # of an error that does not vary the quantile is the error itself; NaN, of what is not determined, is not 0
            square = c1 if c2 == 0.0 else pearson_square(c1, c2, c3, z) if c2 > 0.0 else np.nan
            ranking.quantile[t, s] = sqrt(square) if 0.0 <= square < np.inf else np.inf
            ranking.cumulants[t, s, 0] = c1
            ranking.cumulants[t, s, 1] = c2
            ranking.cumulants[t, s, 2] = c3
