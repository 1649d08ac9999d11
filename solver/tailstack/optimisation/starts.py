"""Starting layouts: random points on the faces and edges of the box, improved by exchange.

The programme is not convex in the layout.  From uniformly random layouts 3 of 20 solves end within 0.2 %
of the best optimum known (8 fiducials, 0.5 mm); from layouts improved first by Fedorov's (1972) exchange,
one fiducial at a time to the best of a handful of candidates, most do, in half the iterations.
The exchange looks at the mean square of the error, as A-optimal designs do, with the free half-widths at
their smallest; it costs about 5 ms and runs on the same compiled gains as the score.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from ..propagation.noise import noise_gains
from ..system import Array
from .problem import PlacementProblem
from .terms import Estimator, TargetTerms, free_laws

CANDIDATES = 60
SWEEPS = 3
ON_FACE = 0.6  # probability that a coordinate of a candidate lies on a face of the box


# Inlined into the kernels below it takes their error model: coplanar candidates get infinite gains, not an exception.
# (A second njit of the same function would share its cache entry, which does not know about error models.)
gains_or_infinity = register_jitable(noise_gains)


@njit(cache=True, nogil=True, error_model="numpy")
def mean_square(
    projections: Array, points: Array, told: Array, reconstructed: Array, to_error: Array, constant: Array,
    fiducial_px: Array, manufacturing_std: Array, work: tuple[Array, Array, Array, Array],
) -> float:  # fmt: skip
    """Largest over targets of E|e|^2, mm^2; inf where the layout is singular.  points as the estimator is told."""
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


@njit(cache=True, nogil=True, error_model="numpy")
def keeps_distance(
    points: Array, i: int, candidate: Array, projections: Array, spacing_mm: float, spacing_px: float
) -> bool:
    """Whether fiducial i, put at ``candidate``, keeps the 3-D and projected spacing to all others."""
    for j in range(points.shape[0]):
        if j == i:
            continue
        apart = 0.0
        for k in range(3):
            apart += (points[j, k] - candidate[k]) ** 2
        if apart < spacing_mm * spacing_mm:
            return False
        for v in range(projections.shape[0]):
            depth_a = projections[v, 2, 3]
            depth_b = projections[v, 2, 3]
            for k in range(3):
                depth_a += projections[v, 2, k] * points[j, k]
                depth_b += projections[v, 2, k] * candidate[k]
            apart = 0.0
            for r in range(2):
                a = projections[v, r, 3]
                b = projections[v, r, 3]
                for k in range(3):
                    a += projections[v, r, k] * points[j, k]
                    b += projections[v, r, k] * candidate[k]
                apart += (a / depth_a - b / depth_b) ** 2
            if apart < spacing_px * spacing_px:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def exchange(
    points: Array, movable: NDArray[np.int64], candidates: Array, sweeps: int, spacing_mm: float, spacing_px: float,
    projections: Array, told: Array, reconstructed: Array, to_error: Array, constant: Array, fiducial_px: Array,
    manufacturing_std: Array,
) -> float:  # fmt: skip
    """Move the movable points (M,) to the best candidates (C, 3) in place; returns the mean square reached."""
    views, count = projections.shape[0], points.shape[0]
    work = (
        np.zeros((views, count, 3, 2)), np.zeros((views, 3, 2)), np.zeros((views, count, 3, 3)),
        np.zeros((views, count, 2)),
    )  # fmt: skip
    args = (told, reconstructed, to_error, constant, fiducial_px, manufacturing_std, work)
    best = mean_square(projections, points, *args)
    for _ in range(sweeps):
        improved = False
        for i in movable:
            kept = points[i].copy()
            for c in range(candidates.shape[0]):
                if not keeps_distance(points, i, candidates[c], projections, spacing_mm, spacing_px):
                    continue
                points[i] = candidates[c]
                value = mean_square(projections, points, *args)
                if value < best * (1 - 1e-9):
                    best = value
                    kept = candidates[c].copy()
                    improved = True
            points[i] = kept
        if not improved:
            break
    return best


def in_field(problem: PlacementProblem, estimator: Estimator, terms: tuple[TargetTerms, ...], points: Array) -> Array:
    """(M,) whether each told point (M, 3) is in front of every source, inside every image with its margin, and
    clear of the targets' images."""
    kept = np.ones(len(points), dtype=bool)
    for view, projection in zip(problem.system.views, estimator.projections, strict=True):
        image = points @ projection[:, :3].T + projection[:, 3]
        kept &= image[:, 2] > 0
        image = image[:, :2] / np.where(image[:, 2:] == 0, 1.0, image[:, 2:])
        if view.image_size_px is not None:
            edge = np.array(view.image_size_px) - 1 - problem.image_margin_px
            kept &= ((image >= problem.image_margin_px) & (image <= edge)).all(axis=1)
        for term in terms:
            centre = projection[:, :3] @ term.reconstructed_mm + projection[:, 3]
            apart = np.linalg.norm(image - centre[:2] / centre[2], axis=1)
            kept &= apart >= problem.target_clearance_px
    return kept


def _spread(
    rng: np.random.Generator, candidates: Array, points: Array, movable: NDArray[np.int64], projections: Array,
    spacing_mm: float, spacing_px: float,
) -> None:  # fmt: skip
    """Put the movable points on candidates that keep their distance, in place; anywhere when none does."""
    points[movable] = 1e6 * (1 + np.arange(len(movable)))[:, None]  # out of the way until placed
    for i in movable:
        order = rng.permutation(len(candidates))
        free = (
            c for c in order
            if keeps_distance(points, i, candidates[c], projections, spacing_mm, spacing_px)
        )  # fmt: skip
        points[i] = candidates[next(free, order[0])]


def starting_layouts(
    problem: PlacementProblem, estimator: Estimator, terms: tuple[TargetTerms, ...], starts: int, seed: int
) -> list[Array]:
    """``starts`` layouts (N, 3) mm: the present one, clipped to the box, then exchanged random ones.

    Start k depends on (seed, k) alone, so that more starts only add.
    """
    movable = np.array(problem.free_fiducials, dtype=np.int64)
    present = problem.system.fiducials_mm.copy()
    low, high = problem.box_mm
    present[movable] = np.clip(present[movable], low, high)
    if not len(movable):
        return [present]
    smallest = problem.lower * [per for _, per in free_laws(problem)]
    constant = np.array([
        term.bias_mm @ term.bias_mm + np.trace(term.covariance) + ((term.free_gain * smallest) ** 2).sum()
        for term in terms
    ])  # fmt: skip
    fixed = (
        np.ascontiguousarray(estimator.projections), np.ascontiguousarray(estimator.told),
        np.array([term.reconstructed_mm for term in terms]), np.array([term.to_error for term in terms]), constant,
        estimator.fiducial_px, estimator.manufacturing_std_mm,
    )  # fmt: skip
    layouts = [present]
    inverse = np.linalg.inv(estimator.told)
    for k in range(1, starts):
        rng = np.random.default_rng([seed, k])
        unit = rng.uniform(-1, 1, (4 * CANDIDATES, 3))
        unit = np.where(rng.random(unit.shape) < ON_FACE, np.sign(unit), unit)
        candidates = (low + high) / 2 + (high - low) / 2 * unit
        candidates = candidates @ estimator.told.T + estimator.told_shift_mm
        seen = candidates[in_field(problem, estimator, terms, candidates)]
        candidates = np.ascontiguousarray((seen if len(seen) else candidates)[:CANDIDATES])
        points = np.ascontiguousarray(problem.system.fiducials_mm @ estimator.told.T + estimator.told_shift_mm)
        spacing = (problem.min_spacing_mm, problem.min_projected_spacing_px)
        _spread(rng, candidates, points, movable, fixed[0], *spacing)
        exchange(points, movable, candidates, SWEEPS, *spacing, *fixed)
        layout = present.copy()
        layout[movable] = np.clip(((points - estimator.told_shift_mm) @ inverse.T)[movable], low, high)
        layouts.append(layout)
    return layouts
