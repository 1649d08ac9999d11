"""Gains of everything that acts through the images on the triangulated point.  The one first-order model.

Every function here, the kernel of losses excepted, is written in scalar steps on arrays, without square roots or
branches on values, so that the same source runs three ways: as Python, also on complex numbers (``DesignFunction``);
compiled by numba, alone for the score (``assemble_jit``) and into the kernels of a batch and of losses; and on numpy
arrays of CasADi symbols, where it builds the expression that the optimiser differentiates.

Derivation (method: implicit function theorem at consistent data; paper Eqs 15-16, whose ``J_A^-1`` does
not exist, rank 11 of 12, and means a pseudo-inverse).  With ``Y = (X - centroid, 1)``, a view's null
vector ``a = (p1, p2, p3)`` and ``w_i = p3 . Y_i`` the depth, an image error ``n_i`` changes the rows of
Eq 2 by ``-w_i n_i``, so the least-squares null vector moves by ``da = (M'M)^+ M' (w n)``.  Derivatives of
Hartley's normalisation multiply a zero residual and drop out; so does the norm of ``a``.  ``M'M`` is ::

    [  D    0   -Gu ]      D  = sum Y Y'         (block diagonal: the centroid is the origin)
    [  0    D   -Gv ]      Gu = sum u Y Y'       Gv = sum v Y Y'
    [ -Gu  -Gv   Gw ]      Gw = sum (u^2 + v^2) Y Y'

and eliminating p1, p2 leaves ``S = Gw - Gu D^-1 Gu - Gv D^-1 Gv`` for p3.  Any gauge gives the same
point; the cheapest holds the centroid's depth fixed, ``dp3[3] = 0``, and inverts a 3x3.

The target's residual ``p1.Q - t_u p3.Q`` (Eq 5) has derivative ``h`` by ``a``, and ``y = (M'M)^+ h`` turns
the sum over fiducials into O(N): fiducial i contributes ``w_i (A_i y)' n_i``.  Finally the stacked rows
give ``dq = -J^+ (residuals)`` (Eq 16).

The other estimators make the images' residuals least.  Their unknowns a move by ``(J'J + precision)^-1 J' n``, J the
slopes of the images by them, and the target's image by its own slopes: the same residual, and everything behind it
stays.  No camera matrix is split for it: a turn and a shift of the structure do to its images what those of the camera
do, and with ``|p3| = 1`` the principal point is ``(p1 . p3, p2 . p3)``.  ``docs/estimators.md`` has the derivation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from ..geometry.arrays import Array, ArrayLike
from ..geometry.weighing import Weighing
from ..kernels.store import kernel


@register_jitable
def invert3(m: ArrayLike, out: ArrayLike) -> None:
    """Fills ``out`` (3, 3): the inverse of a 3x3 by cofactors: no pivoting, so that it also runs on symbols."""
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    det = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] = out[i, j] / det


@register_jitable
def sum_of(weights: ArrayLike) -> ArrayLike:
    """Sum of weights (N,): how many fiducials an estimate uses."""
    total = 0.0
    for i in range(weights.shape[0]):
        total = total + weights[i]
    return total


@register_jitable
def mean_rows(points: ArrayLike, weights: ArrayLike) -> ArrayLike:
    """Centroid of (N, 3) with weights (N,)."""
    total = sum_of(weights)
    out = np.zeros(3, points.dtype)
    for i in range(points.shape[0]):
        for k in range(3):
            out[k] = out[k] + points[i, k] * weights[i]
    for k in range(3):
        out[k] = out[k] / total
    return out


class Eliminated(NamedTuple):
    """The normal equations of the resection of each view, p1 and p2 eliminated: what every gain of a view takes.

    Their coordinates have their origin in the centroid of the fiducials that the view's estimate uses, and their image
    origin in the image of that.
    """

    head: ArrayLike  # (V, 3, 4) the projection
    image: ArrayLike  # (V, N, 3) u, v and depth of each fiducial
    local: ArrayLike  # (V, N, 4) the fiducials
    d_inv: ArrayLike  # (V, 3, 3) D^-1
    du: ArrayLike  # (V, 4, 4) D^-1 Gu
    dv: ArrayLike  # (V, 4, 4) D^-1 Gv
    s_inv: ArrayLike  # (V, 3, 3) S^-1
    origin: ArrayLike  # (V, 2) px: the image origin
    centre: ArrayLike  # (V, 3) mm: the centroid


@register_jitable
def room_for(views: int, points: ArrayLike) -> ArrayLike:
    """An ``Eliminated`` of so many views and points (N, 3), to be filled."""
    count, kind = points.shape[0], points.dtype
    return Eliminated(
        np.zeros((views, 3, 4), kind),
        np.zeros((views, count, 3), kind),
        np.zeros((views, count, 4), kind),
        np.zeros((views, 3, 3), kind),
        np.zeros((views, 4, 4), kind),
        np.zeros((views, 4, 4), kind),
        np.zeros((views, 3, 3), kind),
        np.zeros((views, 2), kind),
        np.zeros((views, 3), kind),
    )


@register_jitable
def eliminate(projection: ArrayLike, points: ArrayLike, weights: ArrayLike, out: ArrayLike, view: int) -> None:
    """Fills what ``out`` (``Eliminated``) has of a view.

    projection (3, 4) with |p3| = 1; points (N, 3) in mm; weights (N,): 1 of a fiducial that the estimate uses, 0 of
    one that the view does not see.
    """
    head, image, local = out.head[view], out.image[view], out.local[view]
    origin, centre = out.origin[view], out.centre[view]
    d_inv, du, dv = out.d_inv[view], out.du[view], out.dv[view]
    count = points.shape[0]
    total = sum_of(weights)
    for k in range(3):
        centre[k] = points[0, k] * weights[0]
        for i in range(1, count):
            centre[k] = centre[k] + points[i, k] * weights[i]
        centre[k] = centre[k] / total
    for r in range(3):
        head[r, 3] = projection[r, 3]
        for k in range(3):
            head[r, k] = projection[r, k]
            head[r, 3] = head[r, 3] + projection[r, k] * centre[k]
    # Image origin at the image of the centroid: without it Gw - Gu D^-1 Gu loses six digits to cancellation.
    origin[0] = head[0, 3] / head[2, 3]
    origin[1] = head[1, 3] / head[2, 3]
    for k in range(4):
        head[0, k] = head[0, k] - origin[0] * head[2, k]
        head[1, k] = head[1, k] - origin[1] * head[2, k]

    sums = np.zeros((4, 4, 4), points.dtype)
    gu, gv, scatter, s = sums[0], sums[1], sums[2], sums[3]
    for i in range(count):
        for k in range(3):
            local[i, k] = points[i, k] - centre[k]
        local[i, 3] = 1.0
        h0 = head[0, 3]
        h1 = head[1, 3]
        h2 = head[2, 3]
        for k in range(3):
            h0 = h0 + head[0, k] * local[i, k]
            h1 = h1 + head[1, k] * local[i, k]
            h2 = h2 + head[2, k] * local[i, k]
        u = h0 / h2
        v = h1 / h2
        image[i, 0] = u
        image[i, 1] = v
        image[i, 2] = h2
        square = u * u + v * v
        for j in range(4):
            for k in range(j + 1):  # all four are symmetric
                yy = local[i, j] * local[i, k] * weights[i]
                gu[j, k] = gu[j, k] + u * yy
                gv[j, k] = gv[j, k] + v * yy
                if j < 3:
                    scatter[j, k] = scatter[j, k] + yy
                    s[j, k] = s[j, k] + square * yy
    for j in range(4):
        for k in range(j):
            gu[k, j] = gu[j, k]
            gv[k, j] = gv[j, k]
            if j < 3:
                scatter[k, j] = scatter[j, k]
                s[k, j] = s[j, k]
    invert3(scatter, d_inv)

    # D^-1 Gu and D^-1 Gv: (4, 4), last row divided by N because D is block diagonal.
    for k in range(4):
        for j in range(3):
            du[j, k] = d_inv[j, 0] * gu[0, k]
            dv[j, k] = d_inv[j, 0] * gv[0, k]
            for m in range(1, 3):
                du[j, k] = du[j, k] + d_inv[j, m] * gu[m, k]
                dv[j, k] = dv[j, k] + d_inv[j, m] * gv[m, k]
        du[3, k] = gu[3, k] / total
        dv[3, k] = gv[3, k] / total
    for j in range(3):
        for k in range(3):
            for m in range(4):
                s[j, k] = s[j, k] - gu[j, m] * du[m, k] - gv[j, m] * dv[m, k]
    invert3(s, out.s_inv[view])


@register_jitable
def eliminate_views(projections: ArrayLike, points: ArrayLike, weights: ArrayLike, out: ArrayLike) -> None:
    """:func:`eliminate` of every view: projections (V, 3, 4), weights (V, N)."""
    for v in range(projections.shape[0]):
        eliminate(projections[v], points, weights[v], out, v)


@register_jitable
def linear_residual_gains(
    eliminated: ArrayLike, v: int, weights: ArrayLike, target: ArrayLike, gains: ArrayLike
) -> ArrayLike:
    """One view by DLT: gains of the target's residual by the fiducials' image noise.

    eliminated: what ``eliminate`` filled, of view v with weights (N,); target (3,) in mm.  Fills
    ``gains`` (N, 2, 2): residual (rows u, v) per px of noise (columns u, v), zero of what the view does not see.
    Returns (target image u, v relative to the centroid's image; the centroid's image u, v; target depth) as a (5,)
    array.
    """
    head, image, local = eliminated.head[v], eliminated.image[v], eliminated.local[v]
    origin, centre = eliminated.origin[v], eliminated.centre[v]
    d_inv, du, dv, s_inv = eliminated.d_inv[v], eliminated.du[v], eliminated.dv[v], eliminated.s_inv[v]
    count = image.shape[0]
    total = sum_of(weights)
    tq = np.zeros(4, image.dtype)
    for k in range(3):
        tq[k] = target[k] - centre[k]
    tq[3] = tq[3] + 1.0
    t0 = head[0, 3]
    t1 = head[1, 3]
    t2 = head[2, 3]
    for k in range(3):
        t0 = t0 + head[0, k] * tq[k]
        t1 = t1 + head[1, k] * tq[k]
        t2 = t2 + head[2, k] * tq[k]
    tu = t0 / t2
    tv = t1 / t2

    # y = (M'M)^+ h for the u row and the v row (columns 0, 1).
    y = np.zeros((3, 4, 2), image.dtype)  # [p1|p2|p3, coordinate, column]
    for c in range(2):
        rhs = np.zeros(3, image.dtype)
        for j in range(3):
            if c == 0:
                rhs[j] = rhs[j] - tu * tq[j]
                for m in range(4):
                    rhs[j] = rhs[j] + du[m, j] * tq[m]  # (Gu D^-1 q)_j, both symmetric
            else:
                rhs[j] = rhs[j] - tv * tq[j]
                for m in range(4):
                    rhs[j] = rhs[j] + dv[m, j] * tq[m]
        for j in range(3):
            for m in range(3):
                y[2, j, c] = y[2, j, c] + s_inv[j, m] * rhs[m]
        for j in range(4):
            for m in range(3):
                y[0, j, c] = y[0, j, c] + du[j, m] * y[2, m, c]
                y[1, j, c] = y[1, j, c] + dv[j, m] * y[2, m, c]
        for j in range(3):  # D^-1 q on the row that carries the target
            for m in range(3):
                y[c, j, c] = y[c, j, c] + d_inv[j, m] * tq[m]
        y[c, 3, c] = y[c, 3, c] + tq[3] / total
    for i in range(count):
        w = image[i, 2] * weights[i]
        for c in range(2):
            e1 = y[0, 3, c]
            e2 = y[1, 3, c]
            e3 = y[2, 3, c]
            for k in range(3):
                e1 = e1 + local[i, k] * y[0, k, c]
                e2 = e2 + local[i, k] * y[1, k, c]
                e3 = e3 + local[i, k] * y[2, k, c]
            gains[i, c, 0] = w * (e1 - image[i, 0] * e3)
            gains[i, c, 1] = w * (e2 - image[i, 1] * e3)
    out = np.zeros(5, image.dtype)
    out[0] = tu
    out[1] = tv
    out[2] = origin[0]
    out[3] = origin[1]
    out[4] = t2
    return out


@register_jitable
def solve_symmetric(matrix: ArrayLike, right: ArrayLike) -> None:
    """``right`` (n, m) becomes matrix^-1 right, by L D L' without pivoting; the positive definite matrix (n, n) is
    overwritten."""
    size = matrix.shape[0]
    for j in range(size):
        for k in range(j):
            for i in range(j, size):  # the lower triangle holds L, the diagonal D, the upper triangle D L'
                matrix[i, j] = matrix[i, j] - matrix[i, k] * matrix[k, j]
        for i in range(j + 1, size):
            matrix[j, i] = matrix[i, j]
            matrix[i, j] = matrix[i, j] / matrix[j, j]
    for c in range(right.shape[1]):
        for j in range(size):
            for k in range(j):
                right[j, c] = right[j, c] - matrix[j, k] * right[k, c]
        for j in range(size):
            right[j, c] = right[j, c] / matrix[j, j]
        for back in range(size):
            j = size - 1 - back
            for k in range(j + 1, size):
                right[j, c] = right[j, c] - matrix[k, j] * right[k, c]


@register_jitable
def image_slopes(
    projection: ArrayLike, point: ArrayLike, centre: ArrayLike, origin: ArrayLike, unknowns: int, out: ArrayLike
) -> ArrayLike:
    """Fills ``out`` (2, 11): how the image of a point moves with a view's unknowns; returns its u, v and depth (3,).

    projection (3, 4) with |p3| = 1; point (3,) and centre (3,) mm; origin (2,) px.  With eleven unknowns they are the
    entries of the matrix about the centre and its image, the depth of the centre held.  Otherwise columns 0-5 are a
    turn, rad, of the point about the centre and its shift, mm, which do to an image what a turn and a shift of the
    camera do; columns 6-8 are the intrinsics, of which the first ``unknowns - 6`` are sought: the focal length
    (relative; the slopes grow from the principal point, ``(p1 . p3, p2 . p3)``) and the principal point itself.
    """
    image = np.zeros(3, point.dtype)
    for r in range(3):
        image[r] = image[r] + projection[r, 3]
        for k in range(3):
            image[r] = image[r] + projection[r, k] * point[k]
    image[0] = image[0] / image[2]
    image[1] = image[1] / image[2]
    away = np.zeros(3, point.dtype)
    slope = np.zeros(3, point.dtype)
    for k in range(3):
        away[k] = point[k] - centre[k]
    for c in range(2):
        if unknowns == 11:
            for k in range(3):
                out[c, 4 * c + k] = away[k] / image[2]
                out[c, 8 + k] = -(image[c] - origin[c]) * away[k] / image[2]
            out[c, 4 * c + 3] = 1.0 / image[2]
        else:
            middle = projection[c, 0] * projection[2, 0]
            for k in range(1, 3):
                middle = middle + projection[c, k] * projection[2, k]
            for k in range(3):
                slope[k] = (projection[c, k] - image[c] * projection[2, k]) / image[2]
            for k in range(3):
                a = (k + 1) % 3
                b = (k + 2) % 3
                out[c, k] = away[a] * slope[b] - away[b] * slope[a]
                out[c, 3 + k] = slope[k]
            out[c, 6] = image[c] - middle
            out[c, 7 + c] = 1.0
    return image


@register_jitable
def least_squares_residual_gains(
    projection: ArrayLike,
    points: ArrayLike,
    weights: ArrayLike,
    target: ArrayLike,
    unknowns: int,
    precision: ArrayLike,
    gains: ArrayLike,
    intrinsics: ArrayLike,
) -> ArrayLike:
    """One view by least squares of the images: gains of the target's residual.

    As ``linear_residual_gains``, which see; unknowns: 6 to 9, or 11; precision (3,) px^2: variance of an image
    coordinate over that of each intrinsic beforehand, 0 where nothing is known (read of those that are sought).  The
    unknowns a move by ``I^-1 J' n`` with ``I = J'J + precision``, n the fiducials' noise, and the image of the target
    by its own slopes.  Also fills ``intrinsics`` (2, 3): residual per unit of error of the assumed intrinsics (but with
    eleven unknowns): an error d moves the images that are expected by J3 d, to which the unknowns give way as to noise
    of - J3 d.
    """
    count = points.shape[0]
    centre = mean_rows(points, weights)
    origin = np.zeros(2, points.dtype)
    slopes = np.zeros((count, 2, 11), points.dtype)
    aim = np.zeros((2, 11), points.dtype)
    middle = image_slopes(projection, centre, centre, origin, unknowns, aim)
    for c in range(2):
        origin[c] = middle[c]
    seen = image_slopes(projection, target, centre, origin, unknowns, aim)
    information = np.zeros((unknowns, unknowns), points.dtype)
    for i in range(count):
        image_slopes(projection, points[i], centre, origin, unknowns, slopes[i])
        for c in range(2):
            for j in range(unknowns):
                for k in range(unknowns):
                    information[j, k] = information[j, k] + slopes[i, c, j] * slopes[i, c, k] * weights[i]
    if unknowns < 11:
        for k in range(unknowns - 6):
            information[6 + k, 6 + k] = information[6 + k, 6 + k] + precision[k]
    y = np.zeros((unknowns, 2), points.dtype)
    for k in range(unknowns):
        for c in range(2):
            y[k, c] = y[k, c] + aim[c, k] * seen[2]
    solve_symmetric(information, y)
    if unknowns < 11:
        for c in range(2):
            for m in range(3):
                intrinsics[c, m] = aim[c, 6 + m] * seen[2]
    for i in range(count):
        for c in range(2):
            for e in range(2):
                gain = slopes[i, e, 0] * y[0, c]
                for k in range(1, unknowns):
                    gain = gain + slopes[i, e, k] * y[k, c]
                gains[i, c, e] = gain * weights[i]
                if unknowns < 11:
                    for m in range(3):
                        intrinsics[c, m] = intrinsics[c, m] - gains[i, c, e] * slopes[i, e, 6 + m]
    out = np.zeros(5, points.dtype)
    for c in range(2):
        out[c] = seen[c] - origin[c]
        out[2 + c] = origin[c]
    out[4] = seen[2]
    return out


class Estimation(NamedTuple):
    """What an estimator is and knows, in numbers (``linear.estimation_of`` makes it of a system)."""

    unknowns: int  # of a view: 0 eleven by DLT; 6 to 9, or 11 by least squares of the images
    weighing: int  # of ``system.Weighing``: by what triangulation weighs the rows of a view
    precision: ArrayLike  # (V, 3) px^2: variance of an image coordinate over that of each intrinsic; 0: nothing known
    noise: ArrayLike  # (V, 2) px: of fiducials and target; read by the weighted rows
    # (V, 2, 2, 2), of fiducials and target: by which independent noise along u and v is multiplied (rows); (0, ...)
    # where it is alike in all directions
    factors: ArrayLike

    def factors_of(self, kind: int) -> ArrayLike:
        """(V, 2, 2) of fiducials (0) or target (1), the identity where noise is alike in all directions."""
        return self.factors[:, kind] if len(self.factors) else np.broadcast_to(np.eye(2), (len(self.noise), 2, 2))

    def noise_of(self, kind: int) -> ArrayLike:
        """(V, 2, 2) px: by which independent noise of fiducials (0) or target (1) is multiplied."""
        return self.noise[:, kind, None, None] * self.factors_of(kind)


@register_jitable
def eliminate_for(
    estimation: ArrayLike, projections: ArrayLike, points: ArrayLike, weights: ArrayLike, out: ArrayLike
) -> None:
    """Fills what :func:`gains_after` takes: :func:`eliminate_views` if the estimator is DLT; no other reads it."""
    if estimation.unknowns == 0:
        eliminate_views(projections, points, weights, out)


@register_jitable
def mix_noise(gains: ArrayLike, factor: ArrayLike) -> ArrayLike:
    """(n, m, 2) gains by the independent noise of which a factor (2, 2) makes that of u and v, the columns of gains."""
    out = np.zeros(gains.shape, gains.dtype)
    for i in range(gains.shape[0]):
        for j in range(gains.shape[1]):
            for k in range(2):
                out[i, j, k] = gains[i, j, 0] * factor[0, k] + gains[i, j, 1] * factor[1, k]
    return out


@register_jitable
def weigh_rows(estimation: ArrayLike, view: int, gains: ArrayLike, depth: ArrayLike, out: ArrayLike) -> None:
    """Fills ``out`` (2, 2): the weight of one view's rows in triangulation.

    estimation: see ``Estimation``; gains (N, 2, 2) of the residual; depth of the target, mm.
    """
    weighing, noise, factors = estimation.weighing, estimation.noise[view], estimation.factors
    if weighing == Weighing.ALIKE:
        out[0, 0] = 1.0
        out[1, 1] = 1.0
    elif weighing == Weighing.BY_IMAGES:
        out[0, 0] = 1.0 / (depth * depth)
        out[1, 1] = 1.0 / (depth * depth)
    else:
        covariance = np.zeros((2, 2), gains.dtype)
        alike = factors.shape[0] == 0
        by_noise = gains if alike else mix_noise(gains, factors[view, 0])
        for c in range(2):
            for e in range(2):
                for i in range(gains.shape[0]):
                    both = by_noise[i, c, 0] * by_noise[i, e, 0] + by_noise[i, c, 1] * by_noise[i, e, 1]
                    covariance[c, e] = covariance[c, e] + both * noise[0] * noise[0]
                if not alike:
                    f = factors[view, 1]
                    both = f[c, 0] * f[e, 0] + f[c, 1] * f[e, 1]
                    covariance[c, e] = covariance[c, e] + both * depth * depth * noise[1] * noise[1]
            if alike:
                covariance[c, c] = covariance[c, c] + depth * depth * noise[1] * noise[1]
        det = covariance[0, 0] * covariance[1, 1] - covariance[0, 1] * covariance[1, 0]
        out[0, 0] = covariance[1, 1] / det
        out[1, 1] = covariance[0, 0] / det
        out[0, 1] = -covariance[0, 1] / det
        out[1, 0] = -covariance[1, 0] / det


class PointGains(NamedTuple):
    """Gains of the triangulated point, in the frame of the fiducials, by every random image-side input."""

    fiducial: ArrayLike  # (V, N, 3, 2) mm per px of image noise of fiducial i in view v
    target: ArrayLike  # (V, 3, 2) mm per px of the target's image noise
    # (V, N, 3, 3) mm per mm of m_i *through view v*.  The error is one and shared, so the gain of m_i is the sum over
    # v; adding the squares per view instead is the block-diagonal covariance of Eq 16, which drops Cov(A_1, A_2).
    manufacturing: ArrayLike
    # (V, 3, 3) mm per unit of error of a view's assumed intrinsics (``system.INTRINSICS``), 0 where none are believed
    intrinsics: ArrayLike
    row_weights: ArrayLike  # (V, 2, 2) the weight of each view's rows in triangulation


@register_jitable
def room_for_gains(points: ArrayLike, row_weights: ArrayLike) -> ArrayLike:
    """``PointGains`` of points (N, 3) and weights of V views, to be filled."""
    views, count, kind = row_weights.shape[0], points.shape[0], points.dtype
    return PointGains(
        np.zeros((views, count, 3, 2), kind),
        np.zeros((views, 3, 2), kind),
        np.zeros((views, count, 3, 3), kind),
        np.zeros((views, 3, 3), kind),
        row_weights,
    )


@register_jitable
def gains_after(
    eliminated: ArrayLike,
    projections: ArrayLike,
    points: ArrayLike,
    weights: ArrayLike,
    estimation: ArrayLike,
    target: ArrayLike,
    gains: ArrayLike,
) -> None:
    """Fills ``gains``, a ``PointGains``.

    eliminated: by :func:`eliminate_for`, the same for all targets; projections (V, 3, 4) mm -> px with |p3| = 1: the
    *effective* ones, ``P_v T_err1`` in the physical reading; points (N, 3) nominal fiducials, mm; weights (V, N): 1
    where a view's estimate uses a fiducial, 0 where it does not; estimation: see ``Estimation``; target (3,) the
    noise-free reconstructed point, mm.
    """
    fiducial, target_gain, manufacturing, intrinsics, row_weights = gains
    views = projections.shape[0]
    count = points.shape[0]
    residual = np.zeros((views, count, 2, 2), points.dtype)
    assumed = np.zeros((views, 2, 3), points.dtype)
    rows = np.zeros((views, 2, 3), points.dtype)
    weighed = np.zeros((views, 2, 3), points.dtype)  # the rows times their weights
    depth = np.zeros(views, points.dtype)
    normal = np.zeros((3, 3), points.dtype)
    for v in range(views):
        if estimation.unknowns == 0:
            image = linear_residual_gains(eliminated, v, weights[v], target, residual[v])
        else:
            image = least_squares_residual_gains(
                projections[v],
                points,
                weights[v],
                target,
                estimation.unknowns,
                estimation.precision[v],
                residual[v],
                assumed[v],
            )
        depth[v] = image[4]
        weigh_rows(estimation, v, residual[v], image[4], row_weights[v])
        for c in range(2):
            for k in range(3):
                rows[v, c, k] = projections[v, c, k] - (image[c] + image[2 + c]) * projections[v, 2, k]
        for c in range(2):
            for k in range(3):
                weighed[v, c, k] = rows[v, c, k] * row_weights[v, c, c]
                if estimation.weighing == Weighing.BY_NOISE:
                    weighed[v, c, k] = weighed[v, c, k] + rows[v, 1 - c, k] * row_weights[v, c, 1 - c]
        for j in range(3):
            for k in range(3):
                normal[j, k] = normal[j, k] + rows[v, 0, j] * weighed[v, 0, k] + rows[v, 1, j] * weighed[v, 1, k]
    inverse = np.zeros((3, 3), points.dtype)
    invert3(normal, inverse)
    for v in range(views):
        to_point = np.zeros((3, 2), points.dtype)  # dq per unit residual of view v: -(J'WJ)^-1 J_v' W_v
        for j in range(3):
            for c in range(2):
                for k in range(3):
                    to_point[j, c] = to_point[j, c] - inverse[j, k] * weighed[v, c, k]
                target_gain[v, j, c] = -to_point[j, c] * depth[v]
            for k in range(3):
                intrinsics[v, j, k] = to_point[j, 0] * assumed[v, 0, k] + to_point[j, 1] * assumed[v, 1, k]
        for i in range(count):
            h0 = projections[v, 0, 3]
            h1 = projections[v, 1, 3]
            h2 = projections[v, 2, 3]
            for k in range(3):
                h0 = h0 + projections[v, 0, k] * points[i, k]
                h1 = h1 + projections[v, 1, k] * points[i, k]
                h2 = h2 + projections[v, 2, k] * points[i, k]
            per = 1.0 / h2
            h0 = h0 * per
            h1 = h1 * per
            for j in range(3):
                for c in range(2):
                    fiducial[v, i, j, c] = to_point[j, 0] * residual[v, i, 0, c] + to_point[j, 1] * residual[v, i, 1, c]
            for k in range(3):
                du = (projections[v, 0, k] - h0 * projections[v, 2, k]) * per
                dv = (projections[v, 1, k] - h1 * projections[v, 2, k]) * per
                for j in range(3):
                    manufacturing[v, i, j, k] = fiducial[v, i, j, 0] * du + fiducial[v, i, j, 1] * dv


# --- the columns of a linear model ------------------------------------------------------------------------


class Imaging(NamedTuple):
    """V views of N fiducials, and what the estimator makes of them."""

    projections: ArrayLike  # (V, 3, 4) mm -> px, |p3| = 1: the effective ones
    points: ArrayLike  # (N, 3) mm, as the estimator assumes them
    estimation: ArrayLike  # ``Estimation``
    per_error: ArrayLike  # (3, 3) from a manufacturing error to a displacement of those
    manufactured: bool  # whether fiducials have manufacturing errors, which the views share
    believed: ArrayLike  # (3, B) direction of every source of an error of believed intrinsics
    views_of: ArrayLike  # (B,) the view of each
    assumed: ArrayLike  # (V, 3) what is known of the error of the intrinsics that each view believes


@register_jitable
def count_columns(imaging: ArrayLike, views: int) -> int:
    """M: how many sources act through single images, or are of believed intrinsics."""
    count = imaging.points.shape[0]
    size: int = views * (2 * count + 2) + 3 * count * imaging.manufactured + imaging.views_of.shape[0]
    return size


@register_jitable
def assemble(
    imaging: ArrayLike,
    weights: ArrayLike,
    aim: ArrayLike,
    shifts: ArrayLike,
    columns: ArrayLike,
    row_weights: ArrayLike,
) -> None:
    """Gains on the reconstructed point, mm per native unit, in the frame of ``imaging.points``.

    weights (V, N): 1 where a view's estimate uses a fiducial, otherwise 0; aim (3,) mm: the point without noise;
    shifts (V, 2 N + 2, C) px: what moves all images of a view together, u and v of each fiducial, then of the target.
    Fills columns (3, M + C + V), side by side

    - M of sources that act through single images, and of believed intrinsics: for each view u and v of each fiducial's
      noise, then of the target's, or of the independent noise of which ``Estimation.factors`` make it; where fiducials
      are manufactured, x, y and z of each one's error; then each source of an error of believed intrinsics;
    - C of the shifts;
    - V of what is known of the intrinsics that each view believes;

    and row_weights (V, 2, 2): the weight of each view's rows in triangulation.
    """
    eliminated = room_for(weights.shape[0], imaging.points)
    eliminate_for(imaging.estimation, imaging.projections, imaging.points, weights, eliminated)
    assemble_after(eliminated, imaging, weights, aim, shifts, columns, row_weights)


@register_jitable
def assemble_after(
    eliminated: ArrayLike,
    imaging: ArrayLike,
    weights: ArrayLike,
    aim: ArrayLike,
    shifts: ArrayLike,
    columns: ArrayLike,
    row_weights: ArrayLike,
) -> None:
    """:func:`assemble`, which see, with what ``eliminate_for`` filled: it is the same for all targets."""
    views, count = weights.shape[0], imaging.points.shape[0]
    gains = room_for_gains(imaging.points, row_weights)
    gains_after(eliminated, imaging.projections, imaging.points, weights, imaging.estimation, aim, gains)
    fiducial, target, manufacturing, intrinsics, _ = gains
    per_error, width = imaging.per_error, 2 * count + 2
    for k in range(3):
        n = 0
        for v in range(views):
            for i in range(count):
                columns[k, n] = fiducial[v, i, k, 0]
                columns[k, n + 1] = fiducial[v, i, k, 1]
                n += 2
            columns[k, n] = target[v, k, 0]
            columns[k, n + 1] = target[v, k, 1]
            n += 2
        if imaging.manufactured:
            for i in range(count):
                for c in range(3):
                    total = manufacturing[0, i, k, 0] * per_error[0, c]
                    for m in range(1, 3):
                        total = total + manufacturing[0, i, k, m] * per_error[m, c]
                    for v in range(1, views):
                        for m in range(3):
                            total = total + manufacturing[v, i, k, m] * per_error[m, c]
                    columns[k, n] = total
                    n += 1
        for b in range(imaging.views_of.shape[0]):
            v = imaging.views_of[b]
            total = intrinsics[v, k, 0] * imaging.believed[0, b]
            for m in range(1, 3):
                total = total + intrinsics[v, k, m] * imaging.believed[m, b]
            columns[k, n] = total
            n += 1
        for c in range(shifts.shape[2]):
            total = columns[k, 0] * shifts[0, 0, c]
            for j in range(1, views * width):
                total = total + columns[k, j] * shifts[j // width, j % width, c]
            columns[k, n] = total
            n += 1
        for v in range(views):
            total = intrinsics[v, k, 0] * imaging.assumed[v, 0]
            for m in range(1, 3):
                total = total + intrinsics[v, k, m] * imaging.assumed[v, m]
            columns[k, n] = total
            n += 1
        for v in range(imaging.estimation.factors.shape[0]):  # noise of u and v is what independent noise is mixed to
            for i in range(count + 1):
                f, n = imaging.estimation.factors[v, i // count], v * width + 2 * i
                along_u, along_v = columns[k, n], columns[k, n + 1]
                columns[k, n] = along_u * f[0, 0] + along_v * f[1, 0]
                columns[k, n + 1] = along_u * f[0, 1] + along_v * f[1, 1]


# Division by zero gives inf, which linearise refuses with the reason; an exception would have none.
assemble_jit = kernel(nogil=True)(assemble)


def gains_of_images(
    imaging: Imaging, weights: ArrayLike, aim: ArrayLike, shifts: ArrayLike
) -> tuple[ArrayLike, ArrayLike]:
    """Columns (3, M + C + V) and row weights (V, 2, 2): see :func:`assemble`.

    Compiled for floats; the source itself runs on complex numbers and symbols.
    """
    kind, views = imaging.points.dtype, len(weights)
    size = count_columns(imaging, views) + shifts.shape[2] + views
    columns, row_weights = np.zeros((3, size), kind), np.zeros((views, 2, 2), kind)
    fill = assemble_jit if kind == np.float64 else assemble
    fill(imaging, weights, aim, shifts, columns, row_weights)
    return columns, row_weights


# --- without some fiducials -------------------------------------------------------------------------------


class LossGains(NamedTuple):
    """The S ways to lose so many fiducials, and what is left of the gains of the images at P places: at each target in
    mm, con, then of each measure that joins several in its own unit and frame.
    """

    kept: Array  # (S, N) 0 of what is lost, otherwise 1
    imaged: Array  # (P, S, 3, 3) mm^2: covariance of what acts through single images, and of believed intrinsics
    moved: Array  # (P, S, 3, K + G) mm: by each source that moves images together, then by all that is known


@kernel(nogil=True)
def lose(
    imaging: Imaging,
    aims: Array,
    joints: Array,
    apart: NDArray[np.bool_],
    shifts: Array,
    std: Array,
    weights: Array,
    gains: tuple[Array, Array],
) -> None:
    """Fill the arrays of ``LossGains``.

    aims (T, 3) mm: the targets, reconstructed without noise; joints (P - T, T, 3, 3): what a displacement of each does
    to the measures that join several; apart (M,): which sources each target has of its own; shifts (T, V, 2 N + 2, C)
    px as ``assemble`` takes them; std (M,) of the sources of its columns; weights (S, V, N): 1 where a view's
    estimate uses a fiducial; gains: imaged and moved.
    """
    imaged, moved = gains
    targets = aims.shape[0]
    each, row_weights = np.zeros((targets, 3, std.size + moved.shape[3])), np.zeros((weights.shape[1], 2, 2))
    joined = np.zeros((targets + 1, 3, std.size + moved.shape[3]))  # what is common, then what each target has
    eliminated = room_for(weights.shape[1], imaging.points)
    for s in range(weights.shape[0]):
        eliminate_for(imaging.estimation, imaging.projections, imaging.points, weights[s], eliminated)
        for t in range(targets):
            assemble_after(eliminated, imaging, weights[s], aims[t], shifts[t], each[t], row_weights)
            _sum_columns(each[t : t + 1], std, imaged[t, s], moved[t, s])
        for j in range(joints.shape[0]):
            joined[:] = 0.0
            for t in range(targets):
                for k in range(each.shape[2] if joints[j, t].any() else 0):
                    at = t + 1 if k < std.size and apart[k] else 0
                    for a in range(3):
                        for b in range(3):
                            joined[at, a, k] += joints[j, t, a, b] * each[t, b, k]
            _sum_columns(joined, std, imaged[targets + j, s], moved[targets + j, s])


@kernel()
def _sum_columns(columns: Array, std: Array, imaged: Array, moved: Array) -> None:
    """Fill imaged (3, 3) and moved (3, K + G); columns (J, 3, M + K + G): those of the first alone move together."""
    for a in range(3):
        for k in range(moved.shape[1]):
            moved[a, k] = columns[0, a, std.size + k]
        for b in range(a + 1):
            total = 0.0
            for j in range(columns.shape[0]):
                for n in range(std.size):
                    total += columns[j, a, n] * std[n] * (columns[j, b, n] * std[n])
            imaged[a, b] = total
            imaged[b, a] = total
