"""Compiled looks at a layout: where points are imaged, which are close, how firmly a view is determined."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel


@kernel()
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


@kernel()
def sight(projection: Array, points: Array, width: float, height: float) -> tuple[Array, Array, Array]:
    """(depth (N,) mm, images (N, 2) px, margin (N,) px) of points (N, 3) in one view, P (3, 4) of unit depth.

    The margin is the distance to the nearest edge, negative outside: pixel centres are integers, the image spans -0.5
    ... size - 0.5.  Images and margins of points at or behind the source are NaN, margins are where no size is known.
    """
    count = points.shape[0]
    depth, images, margin = np.empty(count), np.empty((count, 2)), np.empty(count)
    known = width == width and height == height  # a minimum passes NaN by
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
            margin[i] = min(min(u + 0.5, width - 0.5 - u), min(v + 0.5, height - 0.5 - v)) if known else np.nan
        else:
            images[i, 0], images[i, 1], margin[i] = np.nan, np.nan, np.nan
    return depth, images, margin


@kernel()
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


@kernel()
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


@kernel()
def firm(points: Array, images: Array, share: float) -> bool:
    """Whether the second smallest eigenvalue of :func:`design_squares` is surely above this share of the largest.

    False says nothing.  A Cholesky factor of its first eleven rows, less share times the trace on the diagonal, proves
    it: eigenvalues interlace, and the trace is no smaller than the largest.
    """
    squares = design_squares(points, images)
    trace = 0.0
    for a in range(12):
        trace += squares[a, a]
    for a in range(11):
        for b in range(a + 1):
            rest = squares[a, b] - (share * trace if a == b else 0.0)
            for c in range(b):
                rest -= squares[a, c] * squares[b, c]
            if b < a:
                squares[a, b] = rest / squares[b, b]
            elif rest > 1e-9 * trace:
                squares[a, a] = sqrt(rest)
            else:
                return False
    return True


@kernel()
def look(
    projections: Array, points: Array, count: int, sizes: Array, share: float
) -> tuple[Array, Array, Array, Array]:
    """(depth (V, M), images (V, M, 2), margin (V, M), facts (V, 9)) of points (M, 3) in all views, as :func:`sight`.

    The first ``count`` points are the fiducials.  sizes (V, 2): width and height, NaN where not known.  Facts: nearest
    and farthest depth and smallest margin (NaN where there is none) of the fiducials; smallest depth and margin of all
    points; indices and distance of the two fiducials whose images are closest; 1 where the fiducials determine the view
    firmly (:func:`firm`).
    """
    views, every = projections.shape[0], points.shape[0]
    depth, images, margin = np.empty((views, every)), np.empty((views, every, 2)), np.empty((views, every))
    facts = np.empty((views, 9))
    fiducials = points[:count].copy()
    for v in range(views):
        depth[v], images[v], margin[v] = sight(projections[v], points, sizes[v, 0], sizes[v, 1])
        smallest, least = np.nan, np.nan
        for i in range(every):
            if depth[v, i] > 0.0:  # nothing is less than NaN, the start
                least = margin[v, i] if not margin[v, i] >= least else least
                smallest = margin[v, i] if i < count and not margin[v, i] >= smallest else smallest
        own = images[v, :count].copy()
        first, second, distance = closest_two(own)
        facts[v, 0], facts[v, 1], facts[v, 2] = depth[v, :count].min(), depth[v, :count].max(), smallest
        facts[v, 3], facts[v, 4] = depth[v].min(), least
        facts[v, 5], facts[v, 6], facts[v, 7] = first, second, distance
        facts[v, 8] = 1.0 if facts[v, 0] > 0.0 and firm(fiducials, own, share) else 0.0
    return depth, images, margin, facts


@kernel()
def spread(points: Array) -> tuple[Array, Array, Array, int, int, float]:
    """(squared singular values (3,), largest first, of the centred points (N, 3); their directions, in rows (3, 3);
    extents (3,) along those; indices and distance of the two closest)."""
    count = points.shape[0]
    centred = points.copy()
    for a in range(3):
        mean = 0.0
        for i in range(count):
            mean += points[i, a]
        mean /= count
        for i in range(count):
            centred[i, a] -= mean
    scatter = np.zeros((3, 3))
    for i in range(count):
        for a in range(3):
            for b in range(3):
                scatter[a, b] += centred[i, a] * centred[i, b]
    squares, directions, _ = eigen_symmetric(scatter)
    extents = np.empty(3)
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(count):
            along = 0.0
            for a in range(3):
                along += centred[i, a] * directions[a, k]
            low, high = min(low, along), max(high, along)
        extents[k] = high - low
    first, second, distance = closest_two(points)
    return squares, directions.T.copy(), extents, first, second, distance


@kernel()
def sines_between_rays(projections: Array, targets: Array) -> Array:
    """(T,) largest sine of the angle between two rays to each target (T, 3) from the sources of views (V, 3, 4)."""
    views = projections.shape[0]
    centres = np.zeros((views, 3))
    for v in range(views):
        volume = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                cofactor = projections[v, s, i] * projections[v, t, j] - projections[v, s, j] * projections[v, t, i]
                centres[v, k] -= cofactor * projections[v, r, 3]
                if r == 0:
                    volume += cofactor * projections[v, 0, k]
        centres[v] /= volume
    out = np.zeros(targets.shape[0])
    for q in range(targets.shape[0]):
        for v in range(1, views):
            a = targets[q] - centres[v]
            for w in range(v):
                b = targets[q] - centres[w]
                normal, first, second = 0.0, 0.0, 0.0
                for k in range(3):
                    i, j = (k + 1) % 3, (k + 2) % 3
                    normal += (a[i] * b[j] - a[j] * b[i]) ** 2
                    first += a[k] * a[k]
                    second += b[k] * b[k]
                out[q] = max(out[q], sqrt(normal / (first * second)))
    return out
