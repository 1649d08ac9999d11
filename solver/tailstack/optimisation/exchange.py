"""Exchange of fiducials for better candidates, compiled: Fedorov's (1972) algorithm on the mean square of the error."""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel
from ..propagation.noise import noise_gains

# Inlined into the kernels below it takes their error model: coplanar candidates get infinite gains, not an exception.
gains_or_infinity = register_jitable(noise_gains)


@kernel(nogil=True)
def mean_square(
    projections: Array, points: Array, told: Array, reconstructed: Array, to_error: Array, constant: Array,
    fiducial_px: Array, manufacturing_std: Array, work: tuple[Array, Array, Array, Array],
) -> float:  # fmt: skip
    """Largest over the demands of E|e|^2, mm^2; inf where the layout is singular.  points as the estimator is told."""
    fiducial, target_gain, manufacturing, perspective = work
    worst = 0.0
    for t in range(reconstructed.shape[0]):
        gains_or_infinity(projections, points, reconstructed[t], fiducial, target_gain, manufacturing, perspective)
        total = constant[t]
        for i in range(points.shape[0]):
            for r in range(3):
                for v in range(projections.shape[0]):
                    for c in range(2):
                        g = 0.0
                        for k in range(3):
                            g += to_error[t, r, k] * fiducial[v, i, k, c]
                        total += (g * fiducial_px[v]) ** 2
                for c in range(3):
                    g = 0.0
                    for v in range(projections.shape[0]):
                        for k in range(3):
                            for m in range(3):
                                g += to_error[t, r, k] * manufacturing[v, i, k, m] * told[m, c]
                    total += (g * manufacturing_std[i, c]) ** 2
        if not total < np.inf:
            return np.inf
        worst = max(worst, total)
    return worst


@kernel(nogil=True)
def far_enough(a: Array, b: Array, projections: Array, spacing_mm: float, spacing_px: float) -> bool:
    """Whether two told points (3,) keep the 3-D spacing, and that of their images in every view."""
    apart = 0.0
    for k in range(3):
        apart += (a[k] - b[k]) ** 2
    if apart < spacing_mm * spacing_mm:
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
        if apart < spacing_px * spacing_px:
            return False
    return True


@kernel(nogil=True)
def keeps_distance(
    points: Array, group: NDArray[np.int64], candidate: Array, projections: Array, spacing_mm: float, spacing_px: float
) -> bool:
    """Whether the fiducials of a group (G,), put at ``candidate`` (G, 3), keep their spacing to all others."""
    for j in range(points.shape[0]):
        if j in group:
            continue
        for m in range(group.shape[0]):
            if not far_enough(points[j], candidate[m], projections, spacing_mm, spacing_px):
                return False
    return True


@kernel(nogil=True)
def apart_from_copies(candidates: Array, projections: Array, spacing_mm: float, spacing_px: float) -> NDArray[np.bool_]:
    """(C,) whether the points of each candidate (C, G, 3) keep their spacing among themselves."""
    kept = np.ones(candidates.shape[0], np.bool_)
    for c in range(candidates.shape[0]):
        for m in range(candidates.shape[1]):
            for n in range(m):
                if not far_enough(candidates[c, n], candidates[c, m], projections, spacing_mm, spacing_px):
                    kept[c] = False
    return kept


@kernel(nogil=True)
def exchange(
    points: Array, groups: NDArray[np.int64], candidates: Array, first: NDArray[np.int64], last: NDArray[np.int64],
    sweeps: int, spacing_mm: float, spacing_px: float,
    projections: Array, told: Array, reconstructed: Array, to_error: Array, constant: Array, fiducial_px: Array,
    manufacturing_std: Array,
) -> float:  # fmt: skip
    """Move each group (P, G) as a whole to its best candidate (C, G, 3) in place; returns the mean square reached.

    The candidates of group p are those from ``first[p]`` up to ``last[p]``.
    """
    views, count = projections.shape[0], points.shape[0]
    work = (
        np.zeros((views, count, 3, 2)), np.zeros((views, 3, 2)), np.zeros((views, count, 3, 3)),
        np.zeros((views, count, 2)),
    )  # fmt: skip
    args = (told, reconstructed, to_error, constant, fiducial_px, manufacturing_std, work)
    best = mean_square(projections, points, *args)
    for _ in range(sweeps):
        improved = False
        for p in range(groups.shape[0]):
            group = groups[p]
            kept = points[group].copy()
            for c in range(first[p], last[p]):
                if not keeps_distance(points, group, candidates[c], projections, spacing_mm, spacing_px):
                    continue
                points[group] = candidates[c]
                value = mean_square(projections, points, *args)
                if value < best * (1 - 1e-9):
                    best = value
                    kept = candidates[c].copy()
                    improved = True
            points[group] = kept
        if not improved:
            break
    return best
