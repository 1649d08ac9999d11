"""Kernels of ``batch``: the tails of a block of rows.

A file of its own, so that they reach no more than they use: of what reads a table and a design none is compiled anew.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry.arrays import Array
from .kernels.store import kernel
from .propagation.noise import Estimation, Imaging, assemble_after, eliminate_views, room_for
from .propagation.validity_bounds import ValidityBounds, is_certainly_valid
from .tail.declared import split_columns, tail_numbers
from .tail.lattice import Accuracy, assemble_law


class CompiledRows(NamedTuple):
    """What a block of n rows comes to, for the loop; m is n, or 1 where the table leaves something alone."""

    projections: Array  # (m, V, 3, 4) effective
    fiducials: Array  # (m, N, 3) mm, as designed
    points: Array  # (m, N, 3) mm, as the estimator assumes them
    per_error: Array  # (m, 3, 3) from a manufacturing error to a displacement of those
    weights: Array  # (V, N)
    unknowns: int  # see ``Estimation``
    weighing: int  # of the rows of a view in triangulation
    precision: Array  # (m, V, 3)
    noise: Array  # (m, V, 2) px
    factors: Array  # (V, 2, 2, 2) or (0, ...), see ``Estimation``
    believed: Array  # (3, B), see ``Imaging``
    views_of: NDArray[np.int64]  # (B,)
    assumed: Array  # (V, 3)
    aims: Array  # (T, m, 3) mm, reconstructed
    biases: Array  # (2, T, m, 3) mm of localisation and TCP, without what acts through the images
    to_tcp: Array  # (m, 3, 3)
    from_flange: Array  # (m, 3, 3)
    mounts: Array  # (2, T, m, 3, M): gains of the sources of mounts and execution
    shifts: Array  # (T, m, V, 2 N + 2, C + E) px: see ``shift_together``
    at_flange: Array  # (T, m, 3, C + E + V) mm
    shared: int  # C
    widths: Array  # (m, W) spreads, native units: standard deviations under normal laws, half-widths under others
    groups: NDArray[np.intp]  # (K,) which of them is that of each of G sources, then of those that a target has apart
    kinds: NDArray[np.int64]  # (K,)
    apart: NDArray[np.bool_]  # (G,) which sources each target has of its own
    joints: Array  # (m, M, T, 3, 6): the weights of each measure that is asked for, of the errors at the targets
    moving: bool  # whether the gains differ from row to row


class Asked(NamedTuple):
    """The quantiles that the columns take, each of a measure at a site; with its mean, if that is wanted."""

    metrics: NDArray[np.int64]  # (Q,) below M
    quantiles: Array  # (Q,)
    averaged: NDArray[np.bool_]  # (Q,)
    accuracies: Array  # (Q, 3), see ``Accuracy``


@kernel(nogil=True)
def score_rows(
    rows: CompiledRows,
    asked: Asked,
    validity_bounds: ValidityBounds,
    wanted: NDArray[np.bool_],
    tails: Array,
    biases: Array,
) -> None:
    """The tails of the rows (n,) that are wanted; those whose layout is not plain are no longer.

    Fills tails (n, Q, 2), each quantile that is asked for and its mean, NaN where there is none, and biases (n, T) mm,
    the norm of the bias of the TCP error.
    """
    views, size, targets = rows.weights.shape[0], rows.apart.size, rows.aims.shape[0]
    single = size - rows.mounts.shape[4] - rows.shared
    through, row_weights = np.zeros((3, single + rows.at_flange.shape[3])), np.zeros((views, 2, 2))
    gains = np.zeros((targets, 2, 3, size))  # of localisation and TCP
    means = np.zeros((targets, 2, 3))
    joined, middle = np.zeros((rows.joints.shape[1], 3, rows.kinds.size)), np.zeros((rows.joints.shape[1], 3))
    spread = np.zeros(rows.kinds.size)
    eliminated = room_for(views, rows.points[0])
    ready, plain = False, False
    for row in range(wanted.size):
        if not wanted[row]:
            continue
        if rows.moving or not ready:
            ready = True
            noise = pick(rows.noise, row)
            estimation = Estimation(rows.unknowns, rows.weighing, pick(rows.precision, row), noise, rows.factors)
            projections, assumed = pick(rows.projections, row), pick(rows.points, row)
            eliminate_views(projections, assumed, rows.weights, eliminated)
            plain = is_certainly_valid(pick(rows.fiducials, row), eliminated, validity_bounds)
            per_error = pick(rows.per_error, row)
            imaging = Imaging(
                projections, assumed, estimation, per_error, True, rows.believed, rows.views_of, rows.assumed
            )
            for t in range(targets if plain else 0):
                aim, shifts = pick(rows.aims[t], row), pick(rows.shifts[t], row)
                assemble_after(eliminated, imaging, rows.weights, aim, shifts, through, row_weights)
                _complete_gains(rows, row, t, through, gains[t], means[t])
            for m in range(joined.shape[0] if plain else 0):
                _join_gains(pick(rows.joints, row)[m], rows.apart, gains, means, joined[m], middle[m])
        if not plain:
            wanted[row] = False
            continue
        widths = pick(rows.widths, row)
        for j in range(spread.size):
            spread[j] = widths[rows.groups[j]]
        for t in range(targets):
            bias = means[t, 1]
            biases[row, t] = sqrt(bias[0] * bias[0] + bias[1] * bias[1] + bias[2] * bias[2])
        for q in range(asked.metrics.size):
            m = asked.metrics[q]
            covariance, columns, kinds = assemble_law(joined[m], spread, spread, rows.kinds)
            if not isfinite(covariance.sum() + columns.sum() + middle[m].sum()):
                continue
            h, _ = split_columns(columns, kinds)
            accuracy = Accuracy(asked.accuracies[q, 0], asked.accuracies[q, 1], asked.accuracies[q, 2])
            tails[row, q, 0], tails[row, q, 1] = tail_numbers(
                middle[m], covariance, h, asked.quantiles[q], accuracy, asked.averaged[q]
            )


@kernel()
def pick(array: Array, row: int) -> Array:
    """The part of a row of an array (m, ...) that may have one for all rows."""
    part: Array = array[row if array.shape[0] > 1 else 0]
    return part


@kernel()
def _complete_gains(rows: CompiledRows, row: int, t: int, through: Array, gains: Array, means: Array) -> None:
    """Fill the gains (2, 3, K) and the means (2, 3), mm; through: the columns of what acts through the images."""
    behind, mounted = pick(rows.at_flange[t], row), rows.mounts.shape[4]
    to_tcp, from_flange = pick(rows.to_tcp, row), pick(rows.from_flange, row)
    single = through.shape[1] - behind.shape[1]
    for error in range(2):
        bias, own = pick(rows.biases[error, t], row), pick(rows.mounts[error, t], row)
        for a in range(3):
            means[error, a] = bias[a]
            for j in range(mounted):
                gains[error, a, single + j] = own[a, j]
    for j in range(through.shape[1]):
        for a in range(3):
            tcp = to_tcp[a, 0] * through[0, j] + to_tcp[a, 1] * through[1, j] + to_tcp[a, 2] * through[2, j]
            if j >= single:
                for b in range(3):
                    tcp += from_flange[a, b] * behind[b, j - single]
            if j < single + rows.shared:
                k = j if j < single else j + mounted
                gains[0, a, k] = through[a, j]
                gains[1, a, k] = tcp
            else:
                means[0, a] += through[a, j]
                means[1, a] += tcp


@kernel()
def _join_gains(
    weights: Array, apart: NDArray[np.bool_], gains: Array, means: Array, joined: Array, middle: Array
) -> None:
    """Fill the columns (3, K) and the mean (3,) of a measure; weights (T, 3, 6) of the errors at the targets.

    What each target has of its own stands in its place for the first of them, for the others behind all.
    """
    joined[:], middle[:] = 0.0, 0.0
    end, first = apart.size, True
    for t in range(weights.shape[0]):
        if not weights[t].any():
            continue
        for k in range(apart.size):
            at = k
            if apart[k] and not first:
                at, end = end, end + 1
            for a in range(3):
                for b in range(3):
                    joined[a, at] += weights[t, a, b] * gains[t, 1, b, k] + weights[t, a, 3 + b] * gains[t, 0, b, k]
        for a in range(3):
            for b in range(3):
                middle[a] += weights[t, a, b] * means[t, 1, b] + weights[t, a, 3 + b] * means[t, 0, b]
        first = False
