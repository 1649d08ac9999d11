"""Triangulation of a target from two or more views by homogeneous SVD (Eqs 4-7).

View v gives the rows ``u p3 - p1`` and ``v p3 - p2`` (Eq 5; its printed row indices should read 1, 2,
3).  Each projection is scaled to ``|p3[:3]| = 1`` in the frame the rows are written in, so that a row's
residual is a length at the detector times depth and no view is favoured by its normalisation.
"""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from ..geometry.camera import image_of
from ..system import Triangulation
from .resection import hartley_similarity, homogeneous


def triangulate(
    projections: Array,
    images: Array,
    points: Array,
    form: Triangulation = Triangulation.NORMALISED,
    factors: Array | None = None,
) -> Array:
    """Triangulate one target; leading dimensions are a batch.

    projections: (..., V, 3, 4), mm -> px; images: (..., V, 2) px; points: (..., N, 3) mm, the fiducials
    as the estimator assumes them, which define the frame of all forms but the published one.  In
    it the result is equivariant to rigid motion and units; PUBLISHED solves in plain mm, and its second-order error
    depends on where the origin lies.  factors: (V, 2, 2) Cholesky factors of the weights of
    each view's rows; None: all alike.  Returns (..., 3) mm.
    """
    frame = hartley_similarity(points) if form.traits.own_frame else np.eye(4)
    local = projections @ np.linalg.inv(frame)[..., None, :, :]
    local = local / np.linalg.norm(local[..., 2, :3], axis=-1)[..., None, None]
    rows = images[..., :, None] * local[..., 2:3, :] - local[..., :2, :]
    if factors is not None:
        rows = np.swapaxes(factors, -1, -2) @ rows
    stacked = rows.reshape(*rows.shape[:-3], 2 * rows.shape[-3], 4)
    solution = np.linalg.svd(stacked, full_matrices=False)[2][..., -1, :]
    point = np.einsum("...ij,...j->...i", np.linalg.inv(frame), solution)
    return np.asarray(point[..., :3] / point[..., 3:4])


def reprojection_rms(projections: Array, points: Array, images: Array, weights: Array) -> Array:
    """RMS over fiducials and views of the reprojection distance.

    projections (..., V, 3, 4), points (..., N, 3) mm, images (..., V, N, 2) px, weights (V, N): 1 where a view sees a
    fiducial, otherwise 0 -> (...,) px.
    """
    back = homogeneous(points)[..., None, :, :] @ np.swapaxes(projections, -1, -2)
    residual = images - image_of(back)
    return np.asarray(np.sqrt(((residual**2).sum(axis=-1) * weights).sum(axis=(-1, -2)) / weights.sum()))
