"""Whether a design is far from all that ``estimation.checks.examine`` refuses, for loops over many of them.

Refusals are not decided here: what is not certainly valid is examined as any design is.  What is certainly valid is
nowhere near an edge: ten times as far apart, as thick and as steep as it has to be, a hundred times as well determined.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimation.resection import COPLANAR, NO_PARALLAX, SINGULAR, THICK, TOUCHING_MM
from ..geometry.arrays import Array
from ..geometry.camera import image_of, sines_between_rays
from ..geometry.weighing import Weighing
from ..kernels.numerics import eigen_symmetric
from ..kernels.store import kernel
from .noise import Eliminated, eliminate_views, mean_rows, room_for

if TYPE_CHECKING:
    from ..system import System
    from .linear import Chain

SLACK = 1e-6  # px and mm: nearer to an edge than that, nothing is certain


class ValidityBounds(NamedTuple):
    """Where a point may stand so that nothing about its images is in doubt."""

    projections: Array  # (V, 3, 4) as the design states them
    weights: Array  # (V, N) 1 where a view sees a fiducial, otherwise 0
    windows: Array  # (V, 2, 2) px: first and last of u and of v
    detectors: Array  # (V,) mm from the source
    lift: float  # thickness over width that a structure has to have: of flat ones another pose is looked for
    divides: bool  # whether the estimator divides by the noise of each view

    @classmethod
    def of(cls, system: System, detectors: Array) -> ValidityBounds:
        """detectors: see there."""
        sizes = [(inf, inf) if view.image_size_px is None else view.image_size_px for view in system.views]
        windows = np.array([[[-inf if size == inf else -0.5, size - 0.5] for size in each] for each in sizes])
        lift = THICK if system.estimator.believes_intrinsics else 0.0
        divides = system.triangulation.traits.weighing is Weighing.BY_NOISE
        return cls(system.projections, system.sees, windows, detectors, lift, divides)

    def are_aims_certainly_valid(self, aims: Array, noise: Array) -> NDArray[np.bool_]:
        """Whether targets (m, T, 3) are seen well inside every view, by rays that meet at an angle, and noise (m, V, 2)
        px is there where the estimator divides by it; m is the number of rows or 1."""
        loud = np.all(np.any(noise > 0, axis=2), axis=1) if self.divides else np.ones(1, dtype=np.bool_)
        seen = np.einsum("vij,mtj->mvti", self.projections[:, :, :3], aims) + self.projections[:, None, :, 3]
        with np.errstate(all="ignore"):
            depth, images = seen[..., 2], image_of(seen)
            sines = sines_between_rays(self.projections, aims.reshape(-1, 3)).reshape(len(aims), -1)
        inside = (images > self.windows[:, None, :, 0] + SLACK) & (images < self.windows[:, None, :, 1] - SLACK)
        inside &= ((depth > SLACK) & (depth < self.detectors[:, None] - SLACK))[..., None]
        return np.asarray(loud & inside.all(axis=(1, 2, 3)) & (sines > 10 * NO_PARALLAX).all(axis=1))

    def are_certainly_valid(self, at_bias: Chain) -> bool:
        """Whether a system is."""
        system, imaging = at_bias.system, at_bias.imaging
        targets = np.array([target.position_mm for target in system.targets])
        plain = is_layout_certainly_valid(system.fiducials_mm.copy(), imaging.points, imaging.projections, self)
        return plain and bool(self.are_aims_certainly_valid(targets[None], imaging.estimation.noise[None])[0])


@kernel()
def is_layout_certainly_valid(fiducials: Array, points: Array, projections: Array, bounds: ValidityBounds) -> bool:
    """:func:`is_certainly_valid` of fiducials as designed and points as assumed, (N, 3) mm.

    projections: (V, 3, 4) effective.
    """
    eliminated = room_for(len(projections), points)
    eliminate_views(projections, points, bounds.weights, eliminated)
    return is_certainly_valid(fiducials, eliminated, bounds)


@kernel()
def is_certainly_valid(fiducials: Array, eliminated: Eliminated, bounds: ValidityBounds) -> bool:
    """Whether a layout is far from everything that ``examine`` refuses.  That it refuses nothing else rests on bounds:

    the second smallest eigenvalue of the normal matrix of a resection, G (12, 12) in normalised coordinates, is at
    least the smallest of a principal minor of order 11 (Cauchy), that one at least 1 / tr(minor^-1), and the largest at
    most tr(G).  What ``eliminate`` gives holds the blocks of the minor's inverse.

    fiducials (N, 3) mm as designed; eliminated: of all views.
    """
    weights, lift = bounds.weights, bounds.lift
    if not _is_spread(fiducials, np.ones(fiducials.shape[0]), lift):
        return False
    for v in range(weights.shape[0]):
        if not (weights[v].all() or _is_spread(fiducials, weights[v], lift)):
            return False
        nominal = bounds.projections[v, 2]
        for i in range(fiducials.shape[0]):
            depth = nominal[3]
            for k in range(3):
                depth += nominal[k] * fiducials[i, k]
            if not SLACK < depth < bounds.detectors[v] - SLACK:
                return False
        if not _is_seen_well(eliminated, v, weights[v], bounds.windows[v]):
            return False
    return True


@kernel()
def _is_spread(points: Array, weights: Array, lift: float) -> bool:
    """Whether points (N, 3) mm with weight are ten times as far apart, and as far from a plane, as they have to be, and
    so much thicker than wide along their principal axes."""
    centre = mean_rows(points, weights)
    scatter = np.zeros((3, 3))
    for i in range(points.shape[0]):
        if weights[i] == 0.0:
            continue
        for j in range(i):
            if weights[j] == 0.0:
                continue
            square = 0.0
            for k in range(3):
                square += (points[i, k] - points[j, k]) ** 2
            if not square > (10.0 * TOUCHING_MM) ** 2:
                return False
        for a in range(3):
            for b in range(3):
                scatter[a, b] += (points[i, a] - centre[a]) * (points[i, b] - centre[b])
    least = (10.0 * COPLANAR) ** 2
    trace = scatter[0, 0] + scatter[1, 1] + scatter[2, 2]
    determinant = (
        scatter[0, 0] * (scatter[1, 1] * scatter[2, 2] - scatter[1, 2] * scatter[1, 2])
        - scatter[0, 1] * (scatter[0, 1] * scatter[2, 2] - scatter[1, 2] * scatter[0, 2])
        + scatter[0, 2] * (scatter[0, 1] * scatter[1, 2] - scatter[1, 1] * scatter[0, 2])
    )
    if lift == 0.0 and determinant > least * trace * trace * trace:  # the smallest eigenvalue is at least det / tr^2
        return True
    values, axes, _ = eigen_symmetric(scatter)
    if lift > 0.0:
        extent = np.zeros(2)  # across the plane that they are nearest to, and the wider way in it
        for n in range(2):
            low, high = np.inf, -np.inf
            for i in range(points.shape[0]):
                if weights[i] != 0.0:
                    along = 0.0
                    for k in range(3):
                        along += axes[k, 2 - n] * points[i, k]
                    low, high = min(low, along), max(high, along)
            extent[n] = high - low
        if not extent[0] > 1.001 * lift * extent[1]:
            return False
    return bool(values[2] > least * values[0])


@kernel()
def _is_seen_well(eliminated: Eliminated, v: int, weights: Array, window: Array) -> bool:
    """Whether the points with weight (N,) are imaged by view v inside a window (2, 2) px, and determine the view a
    hundred times as well as they have to."""
    count = weights.sum()
    image, local, origin, d_inv = eliminated.image[v], eliminated.local[v], eliminated.origin[v], eliminated.d_inv[v]
    du, dv, s_inv = eliminated.du[v], eliminated.dv[v], eliminated.s_inv[v]
    square, image_square, largest = 0.0, 0.0, 0.0
    for i in range(weights.size):
        if weights[i] == 0.0:
            continue
        if not image[i, 2] > SLACK:
            return False
        for c in range(2):
            place = image[i, c] + origin[c]
            if not window[c, 0] + SLACK < place < window[c, 1] - SLACK:
                return False
            image_square += image[i, c] ** 2 / (2.0 * count)
        for k in range(3):
            square += local[i, k] ** 2 / (3.0 * count)
    for i in range(weights.size):  # in units in which points have the RMS distance sqrt(3), images sqrt(2)
        here = 1.0 + (local[i, 0] ** 2 + local[i, 1] ** 2 + local[i, 2] ** 2) / square
        largest += weights[i] * here * (2.0 + (image[i, 0] ** 2 + image[i, 1] ** 2) / image_square)
    inverse = 2.0 / count
    for k in range(3):
        inverse += s_inv[k, k] * square * image_square + 2.0 * d_inv[k, k] * square
    for j in range(4):
        for k in range(3):
            for m in range(3):
                term = (du[j, k] * du[j, m] + dv[j, k] * dv[j, m]) * s_inv[k, m]
                inverse += term * square if j < 3 else term
    return bool(0.0 < largest * inverse < 1.0 / (100.0 * SINGULAR) ** 2)
