"""Kernels of ``starts``: fiducials are exchanged for their best candidates.

A file of its own, so that they reach no more than they use.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..propagation.noise import Imaging, assemble


class Spacing(NamedTuple):
    """What two fiducials must be apart: in space, and in every image."""

    mm: float
    px: float


class Candidates(NamedTuple):
    """Where groups of G fiducials (a fiducial and its copies) may go, as the estimator assumes them."""

    points: Array  # (C, G, 3) mm
    first: NDArray[np.int64]  # (P,) the candidates of group p are those from first[p]
    last: NDArray[np.int64]  # (P,) up to last[p]


class ExchangeModel(NamedTuple):
    """What the mean square of the error at T demands depends on."""

    imaging: Imaging  # its points are moved
    weights: Array  # (V, N) 1 where a view's estimate uses a fiducial, otherwise 0
    std: Array  # (M,) of the sources of ``noise.assemble``, 0 of noise of the targets' images
    reconstructed: Array  # (Q, 3) mm: targets as the estimator sees them, of each demand in turn
    to_error: Array  # (Q, 3, 3) displacement of the triangulated point to the limited error, over its limit
    first: NDArray[np.int64]  # (T + 1,) the targets of demand t are those from first[t] to first[t + 1]
    constant: Array  # (T,) mm^2: what no fiducial changes, over its limit


@kernel(nogil=True)
def mean_square(model: ExchangeModel) -> float:
    """Largest over the demands of E|e|^2, mm^2; inf where the layout is singular: coplanar candidates get infinite
    gains, not an exception."""
    views = model.weights.shape[0]
    shifts, row_weights = np.zeros((views, 2 * model.imaging.points.shape[0] + 2, 0)), np.zeros((views, 2, 2))
    columns, moved = np.zeros((3, model.std.size + views)), np.zeros((3, model.std.size))
    worst = 0.0
    for t in range(model.constant.size):
        moved[:] = 0.0
        for q in range(model.first[t], model.first[t + 1]):
            assemble(model.imaging, model.weights, model.reconstructed[q], shifts, columns, row_weights)
            for r in range(3):
                for k in range(3):
                    for n in range(model.std.size):
                        moved[r, n] += model.to_error[q, r, k] * columns[k, n]
        total = model.constant[t]
        for n in range(model.std.size):
            for r in range(3):
                total += (moved[r, n] * model.std[n]) ** 2
        if not total < np.inf:
            return np.inf
        worst = max(worst, total)
    return worst


@kernel(nogil=True)
def far_enough(a: Array, b: Array, projections: Array, spacing: Spacing) -> bool:
    """Whether assumed points a, b (3,) mm are far enough apart, and their images under projections (V, 3, 4) are."""
    apart = 0.0
    for k in range(3):
        apart += (a[k] - b[k]) ** 2
    if apart < spacing.mm * spacing.mm:
        return False
    for v in range(projections.shape[0]):
        depth_a = projections[v, 2, 3]
        depth_b = projections[v, 2, 3]
        for k in range(3):
            depth_a += projections[v, 2, k] * a[k]
            depth_b += projections[v, 2, k] * b[k]
        apart = 0.0
        for r in range(2):
            along_a = projections[v, r, 3]
            along_b = projections[v, r, 3]
            for k in range(3):
                along_a += projections[v, r, k] * a[k]
                along_b += projections[v, r, k] * b[k]
            apart += (along_a / depth_a - along_b / depth_b) ** 2
        if apart < spacing.px * spacing.px:
            return False
    return True


@kernel(nogil=True)
def keeps_distance(
    points: Array, group: NDArray[np.int64], candidate: Array, projections: Array, spacing: Spacing
) -> bool:
    """Whether a group (G,) of the points (N, 3), put at a candidate (G, 3), is far enough from all others; mm, assumed.

    projections: (V, 3, 4).
    """
    for j in range(points.shape[0]):
        if j in group:
            continue
        for m in range(group.shape[0]):
            if not far_enough(points[j], candidate[m], projections, spacing):
                return False
    return True


@kernel(nogil=True)
def apart_from_copies(candidates: Array, projections: Array, spacing: Spacing) -> NDArray[np.bool_]:
    """(C,) whether the points of each candidate (C, G, 3) mm, assumed, are far enough apart; projections: (V, 3, 4)."""
    apart = np.ones(candidates.shape[0], np.bool_)
    for c in range(candidates.shape[0]):
        for m in range(candidates.shape[1]):
            for n in range(m):
                if not far_enough(candidates[c, n], candidates[c, m], projections, spacing):
                    apart[c] = False
    return apart


@kernel(nogil=True)
def exchange(
    groups: NDArray[np.int64], candidates: Candidates, spacing: Spacing, model: ExchangeModel, sweeps: int
) -> float:
    """Move each group (P, G) of the model's points to its best candidate in place; returns the mean square reached,
    mm^2.  At most so many sweeps over all groups.
    """
    points, projections = model.imaging.points, model.imaging.projections
    best = mean_square(model)
    for _ in range(sweeps):
        improved = False
        for p in range(groups.shape[0]):
            group = groups[p]
            best_points = points[group].copy()
            for c in range(candidates.first[p], candidates.last[p]):
                if not keeps_distance(points, group, candidates.points[c], projections, spacing):
                    continue
                points[group] = candidates.points[c]
                value = mean_square(model)
                if value < best * (1 - 1e-9):
                    best = value
                    best_points = candidates.points[c].copy()
                    improved = True
            points[group] = best_points
        if not improved:
            break
    return best
