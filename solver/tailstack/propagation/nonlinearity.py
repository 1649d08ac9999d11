"""What first order leaves out, measured against what it keeps: the four numbers whose largest is nu.

First order takes four things for small.  Each is the standard deviation of a relative error, in one compiled pass.

**Depth.**  The estimated depth of the target divides; its error, ``dw(q)/w(q) - dw(c)/w(c)`` with c the fiducials'
centroid, is free of gauge.  The largest over the views.

**Crossing.**  Triangulation divides by the smallest singular value of ``D = d(images)/d(point)``.  With d the weakest
direction, image noise turns the rays by a part of the angle between them: ``dD d / |D d|``.  Of it counts what no step
of the target across d would do as well: along ``D d`` it changes the singular value, along the normal of the epipolar
planes it turns the rays past each other.

**Disagreement.**  The 2 V rows of Eq 5, ``t p3 - p1`` and ``t p3 - p2``, are too many for three unknowns.  Written
about the point that first order finds, they are ``J x + rho`` with errors dJ and rho of first order.  Eq 7 takes the
unit vector ``(x, 1)/n``, ``n^2 = 1 + |x|^2``, for which ``|J x + rho|^2 / n^2`` is least, so that

    (J + dJ)' ((J + dJ) x + rho) = x |(J + dJ) x + rho|^2 / n^2.

To first order ``x1 = -(J'J)^-1 J' rho``; what is left of the rows is ``r = (1 - J (J'J)^-1 J') rho``, by which the
views disagree.  To second order, whatever moves rho and ``J' dJ x1`` apart (the first two numbers see those),

    x2 = -(J'J)^-1 (dJ' r - k |r|^2),     k = (q - o) / (l^2 + |q - o|^2),

with o and l the origin and the unit of length of the frame in which the vector has unit norm: the centroid of the
fiducials and their RMS distance over sqrt(3), or the connector's origin and 1 mm in the published form.  ``r' r`` is a
sum over rows as ``dJ' r`` is, so x2 is ``-(J'J)^-1 sum_a g_a r_a`` with ``g_a = dJ_a - k r_a``: a sum of products of
normal variables, whose second moment follows from their covariances alone (Isserlis 1918)::

    E[g_a g_b' r_a r_b] = E[g_a r_a] E[g_b r_b]' + E[g_a g_b'] E[r_a r_b] + E[g_a r_b] E[g_b r_a]'.

The number is ``sqrt(E|x2|^2 / E|x1|^2)``.  Third moments of normal variables vanish, so x1 and x2 are uncorrelated,
and the mean square of the error grows by the square of this number; its tail grows more.  Where the rays meet (r = 0)
it vanishes.  With two views r is the distance of the rays; each further view adds two rows, and a badly determined one
among them has the weight of every other.

**Gap.**  In the same equation, with ``|r|^2 / n^2 = s^2``, the step from x solves ``(J'J - s^2) dx = ...``: first order
takes s, the singular value that noise makes of the zero, for small beside the next one, the smallest of J.  The number
is the root mean square of s over that; beyond one, another singular vector is the smallest, and the point is anywhere.
The unit of length decides: in the published form a target at the connector's origin has n = 1 mm.

All of it is a function of the covariance of the estimated matrices, which no target changes: it is computed once.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel
from .noise import eliminate, inverse3, mean_rows


class Nonlinearity(NamedTuple):
    """Standard deviations of relative errors that first order takes for small (see the module)."""

    depth: float
    crossing: float
    disagreement: float
    gap: float

    @property
    def divisor(self) -> float:
        """Of what first order divides by: beyond 0.2 the error has no standard deviation."""
        return max(self.depth, self.crossing)

    @property
    def nu(self) -> float:
        """The validity number."""
        return max(self)


@kernel(nogil=True)
def motion_of_image(projection: Array, point: Array, out: Array) -> float:
    """Fill out (2, 3), px per mm, with how the image of a point (3,) moves with it; its depth, mm.  P (3, 4)."""
    seen = projection[:, 3].copy()
    for r in range(3):
        for k in range(3):
            seen[r] += projection[r, k] * point[k]
    for c in range(2):
        for k in range(3):
            out[c, k] = (projection[c, k] - seen[c] / seen[2] * projection[2, k]) / seen[2]
    return float(seen[2])


@kernel(nogil=True)
def matrix_gains(projection: Array, points: Array, centre: Array) -> Array:
    """(12, N, 2) change of a resected matrix per px of each fiducial's noise (its u and v).

    The matrix, row by row, is the one of ``eliminate``: origins at the centre and at its image.  Its gauge holds the
    depth of the centre, so the last row is zero.  projection (3, 4) with |p3| = 1, points (N, 3) and centre (3,) mm.
    """
    count = points.shape[0]
    _, image, local, d_inv, du, dv, s_inv, _ = eliminate(projection, points, centre)
    out = np.zeros((12, count, 2))
    y = np.empty((3, 4))
    wanted = np.zeros((3, 4))
    for entry in range(11):
        wanted[entry // 4, entry % 4] = 1.0
        y[:] = 0.0  # (M'M)^+ wanted, by the elimination of p1 and p2
        for j in range(3):
            for m in range(3):
                right = wanted[2, m]
                for k in range(4):
                    right += du[k, m] * wanted[0, k] + dv[k, m] * wanted[1, k]
                y[2, j] += s_inv[j, m] * right
        for j in range(4):
            for m in range(3):
                y[0, j] += du[j, m] * y[2, m]
                y[1, j] += dv[j, m] * y[2, m]
                if j < 3:
                    y[0, j] += d_inv[j, m] * wanted[0, m]
                    y[1, j] += d_inv[j, m] * wanted[1, m]
        y[0, 3] += wanted[0, 3] / count
        y[1, 3] += wanted[1, 3] / count
        wanted[entry // 4, entry % 4] = 0.0
        for i in range(count):
            of_row = np.zeros(3)
            for k in range(4):
                for r in range(3):
                    of_row[r] += local[i, k] * y[r, k]
            for c in range(2):
                out[entry, i, c] = image[i, 2] * (of_row[c] - image[i, c] * of_row[2])
    return out


@kernel(nogil=True)
def matrix_covariance(projections: Array, points: Array, per_error: Array, std: Array, noises: Array) -> Array:
    """(12 V, 12 V) covariance of the resected matrices, entries as in ``matrix_gains``.

    projections (V, 3, 4) with |p3| = 1, points (N, 3) mm; noises (V,) px of the fiducials' images; per_error (3, 3):
    what a manufacturing error does to the points; std (N, 3) mm of it.  One view knows of another only through the
    manufacturing errors that they share.
    """
    views, count = projections.shape[0], points.shape[0]
    centre = mean_rows(points)
    out = np.zeros((12 * views, 12 * views))
    made = std.any()
    shared = np.zeros((12 * views, 3 * count if made else 0))
    motion = np.empty((2, 3))
    for v in range(views):
        gains = matrix_gains(projections[v], points, centre)
        variance = noises[v] * noises[v]
        for a in range(12):
            for b in range(a + 1):
                total = 0.0
                for i in range(count):
                    total += gains[a, i, 0] * gains[b, i, 0] + gains[a, i, 1] * gains[b, i, 1]
                out[12 * v + a, 12 * v + b] = variance * total
        if made:
            for i in range(count):
                motion_of_image(projections[v], points[i], motion)
                for k in range(3):
                    if std[i, k] == 0.0:
                        continue
                    for c in range(2):
                        moved = 0.0
                        for m in range(3):
                            moved += motion[c, m] * per_error[m, k]
                        for a in range(12):
                            shared[12 * v + a, 3 * i + k] += gains[a, i, c] * moved * std[i, k]
    for a in range(12 * views):
        for b in range(a + 1):
            total = out[a, b]
            for j in range(shared.shape[1]):
                total += shared[a, j] * shared[b, j]
            out[a, b] = total
            out[b, a] = total
    return out


@kernel(nogil=True)
def _through(left: Array, covariance: Array, views: int, coupled: bool) -> Array:
    """(V k, V k): ``L C L'`` of left (V, k, 12), each of its blocks the functionals of one view, and C (12 V, 12 V)."""
    size = left.shape[1]
    out = np.zeros((views * size, views * size))
    half = np.empty((size, 12))
    for v in range(views):
        for w in range(v + 1):
            if w != v and not coupled:
                continue
            for a in range(size):
                for k in range(12):
                    total = 0.0
                    for m in range(12):
                        total += left[v, a, m] * covariance[12 * v + m, 12 * w + k]
                    half[a, k] = total
            for a in range(size):
                for b in range(size):
                    total = 0.0
                    for k in range(12):
                        total += half[a, k] * left[w, b, k]
                    out[v * size + a, w * size + b] = total
                    out[w * size + b, v * size + a] = total
    return out


@kernel(nogil=True)
def _look(projections: Array, centre: Array, target: Array) -> tuple[Array, Array, Array, Array, Array]:
    """What the views see of the target, in coordinates about the centre and its images.

    (V, 3, 4) matrices; (4,) the target; (V, 2) its images, px; (V,) its depths, mm; (V, 2, 3) rows of J, px.
    """
    views = projections.shape[0]
    heads, images, depths = np.empty((views, 3, 4)), np.empty((views, 2)), np.empty(views)
    rows = np.empty((views, 2, 3))
    place = np.ones(4)
    place[:3] = target - centre
    for v in range(views):
        heads[v] = projections[v]
        for r in range(3):
            for k in range(3):
                heads[v, r, 3] += projections[v, r, k] * centre[k]
        for c in range(2):
            heads[v, c] -= heads[v, c, 3] / heads[v, 2, 3] * heads[v, 2]
        seen = np.zeros(3)
        for r in range(3):
            for k in range(4):
                seen[r] += heads[v, r, k] * place[k]
        depths[v] = seen[2]
        for c in range(2):
            images[v, c] = seen[c] / seen[2]
            for k in range(3):
                rows[v, c, k] = heads[v, c, k] - images[v, c] * heads[v, 2, k]
    return heads, place, images, depths, rows


@kernel(nogil=True)
def _depth(place: Array, depths: Array, covariance: Array) -> float:
    """The first number, squared."""
    largest = 0.0
    for v in range(depths.size):
        variance = 0.0
        for j in range(3):
            for k in range(3):
                variance += place[j] * place[k] * covariance[12 * v + 8 + j, 12 * v + 8 + k]
        largest = max(largest, variance / depths[v] ** 2)
    return largest


@kernel(nogil=True)
def _crossing(
    heads: Array, place: Array, images: Array, depths: Array, rows: Array, covariance: Array, coupled: bool
) -> float:
    """The second number, squared."""
    views = depths.size
    moved = np.empty((3, 2 * views))  # px per mm along x, y, z
    for v in range(views):
        for c in range(2):
            for k in range(3):
                moved[k, 2 * v + c] = rows[v, c, k] / depths[v]
    normal = np.zeros((3, 3))
    for j in range(3):
        for k in range(3):
            for x in range(2 * views):
                normal[j, k] += moved[j, x] * moved[k, x]
    squares, axes, _ = eigen_symmetric(normal)  # the images move along the three axes at right angles
    weakest = axes[:, 2].copy()
    slopes = np.zeros((views, 2, 12))  # by the matrices: d(image)/d(point) along the weakest direction
    for v in range(views):
        depth = depths[v]
        towards = 0.0
        for k in range(3):
            towards += heads[v, 2, k] * weakest[k]
        for c in range(2):
            slope = 0.0
            for k in range(3):
                slope += rows[v, c, k] * weakest[k] / depth
                slopes[v, c, 4 * c + k] += weakest[k] / depth
                slopes[v, c, 8 + k] -= images[v, c] * weakest[k] / depth
            for k in range(4):
                slopes[v, c, 4 * c + k] -= towards * place[k] / depth**2
                slopes[v, c, 8 + k] += (towards * images[v, c] / depth - slope) * place[k] / depth
    found = _through(slopes, covariance, views, coupled)
    variance = 0.0
    for x in range(2 * views):
        variance += found[x, x]
    for u in range(2):  # what the images do across the weakest direction counts nothing
        unit = np.zeros(2 * views)
        for k in range(3):
            unit += axes[k, u] * moved[k]
        for x in range(2 * views):
            for y in range(2 * views):
                variance -= unit[x] * found[x, y] * unit[y] / squares[u]
    return float(max(variance, 0.0) / squares[2])


@kernel(nogil=True)
def _disagreement(
    heads: Array, place: Array, images: Array, depths: Array, rows: Array, covariance: Array, coupled: bool,
    target_noises: Array, origin: Array, unit: float,
) -> tuple[float, float]:  # fmt: skip
    """The third number and the fourth, squared.

    origin (3,), from the centre, and unit: mm, of the frame of the unit vector.
    """
    views = depths.size
    lines = 2 * views
    functionals = np.zeros((views, 8, 12))  # of each row: errors of J (3) with the gauge |p3| = 1, and of rho
    for v in range(views):
        for c in range(2):
            for k in range(3):
                functionals[v, 4 * c + k, 4 * c + k] += 1.0
                functionals[v, 4 * c + k, 8 + k] -= images[v, c]
                for m in range(3):
                    functionals[v, 4 * c + k, 8 + m] -= rows[v, c, k] * heads[v, 2, m]
            for k in range(4):
                functionals[v, 4 * c + 3, 4 * c + k] += place[k]
                functionals[v, 4 * c + 3, 8 + k] -= images[v, c] * place[k]
    found = _through(functionals, covariance, views, coupled)
    by_image = np.empty(4)
    for v in range(views):
        by_image[:3] = heads[v, 2, :3]
        by_image[3] = depths[v]
        for c in range(2):
            row = 8 * v + 4 * c
            for j in range(4):
                for k in range(4):
                    found[row + j, row + k] += target_noises[v] ** 2 * by_image[j] * by_image[k]

    normal = np.zeros((3, 3))
    flat = rows.reshape(lines, 3)
    for a in range(lines):
        for j in range(3):
            for k in range(3):
                normal[j, k] += flat[a, j] * flat[a, k]
    inverse = inverse3(normal)
    to_point = np.zeros((3, lines))  # (J'J)^-1 J'
    for a in range(lines):
        for j in range(3):
            for k in range(3):
                to_point[j, a] += inverse[j, k] * flat[a, k]
    left = np.zeros((lines, lines))  # 1 - J (J'J)^-1 J'
    for a in range(lines):
        left[a, a] = 1.0
        for b in range(lines):
            for j in range(3):
                left[a, b] -= flat[a, j] * to_point[j, b]

    rho = np.empty((lines, lines))
    for a in range(lines):
        for b in range(lines):
            rho[a, b] = found[4 * a + 3, 4 * b + 3]
    mixed = np.zeros((lines, 3, lines))  # E[dJ_a r_b], then E[g_a r_b]
    for a in range(lines):
        for j in range(3):
            for b in range(lines):
                for x in range(lines):
                    mixed[a, j, b] += found[4 * a + j, 4 * x + 3] * left[x, b]
    half, residual = np.zeros((lines, lines)), np.zeros((lines, lines))  # E[rho_a r_b], E[r_a r_b]
    for a in range(lines):
        for b in range(lines):
            for x in range(lines):
                half[a, b] += rho[a, x] * left[x, b]
    for a in range(lines):
        for b in range(lines):
            for x in range(lines):
                residual[a, b] += left[a, x] * half[x, b]
    away = place[:3] - origin
    square = unit * unit
    for k in range(3):
        square += away[k] * away[k]
    pull = away / square
    before = mixed.copy()
    for a in range(lines):
        for j in range(3):
            for b in range(lines):
                mixed[a, j, b] -= pull[j] * residual[a, b]

    mean = np.zeros(3)
    for a in range(lines):
        for j in range(3):
            mean[j] += mixed[a, j, a]
    moment = np.empty((3, 3))
    for j in range(3):
        for k in range(3):
            total = mean[j] * mean[k]
            for a in range(lines):
                for b in range(lines):
                    both = (
                        found[4 * a + j, 4 * b + k]
                        - pull[k] * before[a, j, b]
                        - pull[j] * before[b, k, a]
                        + pull[j] * pull[k] * residual[a, b]
                    )
                    total += both * residual[a, b] + mixed[a, j, b] * mixed[b, k, a]
            moment[j, k] = total
    second, first = 0.0, 0.0
    for i in range(3):
        for j in range(3):
            for k in range(3):
                second += inverse[i, j] * moment[j, k] * inverse[k, i]
        for a in range(lines):
            for b in range(lines):
                first += to_point[i, a] * rho[a, b] * to_point[i, b]
    singular, size = 0.0, 0.0  # of the rows: the mean square that noise makes of the zero; of (J'J)^-1
    for a in range(lines):
        singular += residual[a, a] / square
    for j in range(3):
        for k in range(3):
            size += inverse[j, k] ** 2
    gap = max(singular, 0.0) * sqrt(size)
    return (max(second, 0.0) / first if first > 0.0 else 0.0), gap


@kernel(nogil=True)
def _numbers(
    projections: Array, points: Array, target: Array, covariance: Array, target_noises: Array, published: bool,
    coupled: bool,
) -> tuple[float, float, float, float]:  # fmt: skip
    centre = mean_rows(points)
    heads, place, images, depths, rows = _look(projections, centre, target)
    origin = np.zeros(3)
    unit = 1.0
    if published:
        origin -= centre
    else:
        square = 0.0
        for i in range(points.shape[0]):
            for k in range(3):
                square += (points[i, k] - centre[k]) ** 2 / points.shape[0]
        unit = sqrt(square / 3.0)
    depth = _depth(place, depths, covariance)
    crossing = _crossing(heads, place, images, depths, rows, covariance, coupled)
    disagreement, gap = _disagreement(
        heads, place, images, depths, rows, covariance, coupled, target_noises, origin, unit
    )  # fmt: skip
    return sqrt(max(depth, 0.0)), sqrt(crossing), sqrt(disagreement), sqrt(gap)


def nonlinearity(
    projections: Array, points: Array, target: Array, covariance: Array, target_noises: Array, *, published: bool,
    coupled: bool,
) -> Nonlinearity:  # fmt: skip
    """The four numbers at one target.

    projections (V, 3, 4) with |p3| = 1, points (N, 3) and target (3,) mm as the estimator meets them; covariance: see
    ``matrix_covariance``; target_noises (V,) px of the target's images; published: the form of the triangulation;
    coupled: whether the views share manufacturing errors.
    """
    return Nonlinearity(*_numbers(projections, points, target, covariance, target_noises, published, coupled))
