"""Compiled looks at a layout: where points are imaged, which are close, how firmly a view is determined."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..system import Array


@njit(cache=True, error_model="numpy")
def closest_two(points: Array) -> tuple[int, int, float]:
    """Indices, ascending, and distance of the two closest of points (N, d); (0, 0, inf) when there are fewer than two.

    Points that are not finite are close to nothing.
    """
    first, second, least = 0, 0, np.inf
    for i in range(points.shape[0]):
        for j in range(i + 1, points.shape[0]):
            square = 0.0
            for a in range(points.shape[1]):
                square += (points[i, a] - points[j, a]) ** 2
            if square < least:
                first, second, least = i, j, square
    return first, second, sqrt(least)


@njit(cache=True, error_model="numpy")
def sight(projection: Array, points: Array, width: float, height: float) -> tuple[Array, Array, Array]:
    """(depth (N,) mm, images (N, 2) px, margin (N,) px) of points (N, 3) in one view, P (3, 4) of unit depth.

    The margin is the distance to the nearest edge, negative outside: pixel centres are integers, the image spans -0.5
    ... size - 0.5.  Images and margins of points at or behind the source are NaN, margins are where no size is known.
    """
    count = points.shape[0]
    depth, images, margin = np.empty(count), np.empty((count, 2)), np.empty(count)
    seen = np.empty(3)
    for i in range(count):
        for a in range(3):
            seen[a] = projection[a, 3]
            for b in range(3):
                seen[a] += projection[a, b] * points[i, b]
        depth[i] = seen[2]
        if seen[2] > 0.0:
            u, v = seen[0] / seen[2], seen[1] / seen[2]
            images[i, 0], images[i, 1] = u, v
            margin[i] = min(min(u + 0.5, width - 0.5 - u), min(v + 0.5, height - 0.5 - v))
        else:
            images[i, 0], images[i, 1], margin[i] = np.nan, np.nan, np.nan
    return depth, images, margin


@njit(cache=True, error_model="numpy")
def _normalised(points: Array) -> Array:
    """Points (N, d) in Hartley's frame (centroid 0, RMS distance sqrt(d)), homogeneous (N, d + 1)."""
    count, dimension = points.shape
    out = np.ones((count, dimension + 1))
    total = 0.0
    for a in range(dimension):
        mean = 0.0
        for i in range(count):
            mean += points[i, a]
        mean /= count
        for i in range(count):
            out[i, a] = points[i, a] - mean
            total += out[i, a] ** 2
    scale = sqrt(dimension * count / total)
    for i in range(count):
        for a in range(dimension):
            out[i, a] *= scale
    return out


@njit(cache=True, error_model="numpy")
def design_squares(points: Array, images: Array) -> NDArray[np.float64]:
    """(12, 12) A'A of the normalised design matrix (Eq 2) of one view: points (N, 3) mm, images (N, 2) px.

    With ``A = [[x, 0, -u x], [0, x, -v x]]`` its blocks are the moments of x weighted by 1, u, v and u^2 + v^2.
    """
    x, uv = _normalised(points), _normalised(images)
    out = np.zeros((12, 12))
    for i in range(x.shape[0]):
        u, v = uv[i, 0], uv[i, 1]
        for a in range(4):
            for b in range(4):
                moment = x[i, a] * x[i, b]
                out[a, b] += moment
                out[4 + a, 4 + b] += moment
                out[a, 8 + b] -= u * moment
                out[8 + a, b] -= u * moment
                out[4 + a, 8 + b] -= v * moment
                out[8 + a, 4 + b] -= v * moment
                out[8 + a, 8 + b] += (u * u + v * v) * moment
    return out
