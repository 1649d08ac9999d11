"""Resection: a view's 3x4 projection from fiducials and their images, by normalised DLT (Eqs 2-3).

Each fiducial gives two rows (Eq 2), with ``X~ = (X, 1)``::

    [ X~'   0   -u X~' ]
    [  0   X~'  -v X~' ] a = 0

and ``a`` is the right singular vector of the smallest singular value, ``|a| = 1`` (Eq 3).  Both sides
are first normalised as Hartley (1997) does, here by the *RMS* distance; published codes that use the
mean distance agree to first order, not to digits.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..geometry.arrays import Array
from ..geometry.camera import image_of

# Where the geometry determines no answer
TOUCHING_MM = 1e-3  # two fiducials closer than this are one
COLLINEAR = 1e-5  # second over first singular value of the centred fiducials
COPLANAR = 1e-5  # third over first
SINGULAR = 1e-6  # second smallest over largest singular value of the normalised design matrix
NO_PARALLAX = 1e-4  # sine of the angle between two rays
THICK = 0.3  # thickness over width, above which a structure's images allow no mirrored pose


def hartley_similarity(points: Array) -> Array:
    """Similarity that moves points to centroid 0 and RMS distance sqrt(d).

    points: (..., N, d), any unit.  Returns (..., d+1, d+1), acting on homogeneous coordinates.
    """
    dimension = points.shape[-1]
    centroid = points.mean(axis=-2)
    spread = points - centroid[..., None, :]
    rms = np.sqrt((spread**2).sum(axis=-1).mean(axis=-1))
    scale = sqrt(dimension) / rms
    similarity = np.zeros((*points.shape[:-2], dimension + 1, dimension + 1))
    for axis in range(dimension):
        similarity[..., axis, axis] = scale
        similarity[..., axis, dimension] = -scale * centroid[..., axis]
    similarity[..., dimension, dimension] = 1.0
    return similarity


def homogeneous(points: Array) -> Array:
    """(..., d) -> (..., d+1) with a last coordinate of 1."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def design_matrix(points: Array, images: Array) -> Array:
    """Rows of Eq 2, u then v of each fiducial.  points (..., N, 4), images (..., N, 2) -> (..., 2N, 12)."""
    shape = np.broadcast_shapes(points.shape[:-1], images.shape[:-1])
    rows = np.zeros((*shape, 2, 12))
    rows[..., 0, 0:4] = points
    rows[..., 1, 4:8] = points
    rows[..., 0, 8:12] = -images[..., 0:1] * points
    rows[..., 1, 8:12] = -images[..., 1:2] * points
    return rows.reshape(*shape[:-1], 2 * shape[-1], 12)


def scale_to_depth(projection: Array, points: Array) -> Array:
    """Scale ``P`` so that ``|P[2, :3]| = 1`` and the mean depth of ``points`` (..., N, 3) is positive."""
    norm = np.linalg.norm(projection[..., 2, :3], axis=-1)
    depth = np.einsum("...j,...nj->...n", projection[..., 2, :], homogeneous(points)).mean(axis=-1)
    return np.asarray(projection / (norm * np.where(depth < 0, -1.0, 1.0))[..., None, None])


def resect(points: Array, images: Array, *, normalise: bool = True) -> Array:
    """Estimate projections by DLT (Eqs 2-3); leading dimensions are a batch.

    points: (..., N, 3) mm, the coordinates the estimator assumes; images: (..., N, 2) px.
    ``normalise=False`` leaves Hartley's step out (for comparison only: it is badly conditioned).
    Returns (..., 3, 4), scaled so that ``|P[2, :3]| = 1`` with positive mean depth.
    """
    if normalise:
        object_frame = hartley_similarity(points)
        image_frame = hartley_similarity(images)
    else:
        object_frame, image_frame = np.eye(4), np.eye(3)
    points_n = homogeneous(points) @ np.swapaxes(object_frame, -1, -2)
    images_n = homogeneous(images) @ np.swapaxes(image_frame, -1, -2)
    null = np.linalg.svd(design_matrix(points_n, images_n[..., :2]), full_matrices=False)[2][..., -1, :]
    estimate = np.linalg.solve(image_frame, null.reshape(*null.shape[:-1], 3, 4) @ object_frame)
    return scale_to_depth(np.asarray(estimate, dtype=np.float64), points)


def project(projection: Array, points: Array) -> Array:
    """Pinhole projection (Eq 1): P (..., 3, 4), points (..., N, 3) mm -> (..., N, 2) px."""
    return image_of(homogeneous(points) @ np.swapaxes(projection, -1, -2))
