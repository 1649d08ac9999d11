"""What moves the images of points without moving the points: an image's residual distortion, and balls that are no
points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array


def field_powers(degree: int) -> NDArray[np.int64]:
    """(n, 2) powers (i, j) of the monomials ``x**i y**j`` of one degree."""
    return np.array([(degree - j, j) for j in range(degree + 1)], dtype=np.int64)


def field_shifts(
    images: Array, centre_px: Array, half_diagonal_px: float, axis: NDArray[np.int64], powers: NDArray[np.int64]
) -> Array:
    """(n, 2, k) shift of images (n, 2), px, per px of each coefficient (``system.ImageField``)."""
    place = (images - centre_px) / half_diagonal_px
    values = place[:, None, 0] ** powers[:, 0] * place[:, None, 1] ** powers[:, 1]
    shifts = np.zeros((len(images), 2, len(axis)), values.dtype)
    for j, along in enumerate(axis.tolist()):
        shifts[:, along, j] = values[:, j]
    return shifts


def outline_shifts(projection: Array, points: Array, radius_mm: float) -> Array:
    """(n, 2) px: from the image of a ball's centre to the middle of the ellipse that is its outline.

    projection (3, 4), points (n, 3) mm.  With the dual quadric of the ball, ``X X' - r^2 diag(1, 1, 1, 0)``, the dual
    conic of its outline is ``p p' - r^2 A A'`` (p the image of the centre, A the left 3x3 block of the projection), and
    the pole of the line at infinity, its last column, is the ellipse's middle.  The centroid of the shadow of an even
    ball lies on the way there, at 0.8 to four digits for any ball that is small against its distance (integrated
    numerically; Clackdoyle and Mennessier 2011, doi:10.1088/0031-9155/56/23/003, give 20 % less).
    """
    left = projection[:, :3]
    image = points @ left.T + projection[:, 3]
    spread = radius_mm**2 * (left @ left[2])
    middle = (image * image[:, 2:] - spread)[:, :2] / (image[:, 2:] ** 2 - spread[2])
    return np.asarray(middle - image[:, :2] / image[:, 2:])
