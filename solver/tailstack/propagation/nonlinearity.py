"""What first order leaves out, measured against what it keeps: five numbers, whose largest is nu, and three of turns.

First order takes five things of the images for small.  Each is the standard deviation of a relative error.

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
views disagree.  To second order, whatever moves rho (the first number sees it) and ``J' dJ x1`` (the last) apart,

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

**Range.**  What is left of the equation, ``x2 = -(J'J)^-1 J' dJ x1``, is the point's own motion: its rows have their
slopes where noise has led it, not where the target is.  An image error dt changes them by ``dt p3``, and ``p3 x1`` is
how much deeper the point has come to lie: of rays that are nearly parallel, whose point moves along them, x2 is x1
times ``p3 x1 / w``, the relative error of the distance along the ray.  Errors of the matrices change the slopes, too,
and move the point by the same stroke, so that the two add up where the fiducials are far; crossing sees the slopes
alone.  The number is ``sqrt(E|x2|^2 / (3 E|x1|^2))``, by the formula above; the 3 is that of ``E z^4`` of a normal
variable: of a point that moves along one line, ``x = x1 / (1 + z)``, the number is the standard deviation of z, and at
0.02, 0.08 and 0.15 P95 is 0.1, 2.5 and 12 % beyond that of x1.  The gauge of the matrices is the depth of the
centroid, which is what they tell best.

All of it is a function of the covariance of the estimated matrices, which no target changes: it is computed once.

Where mounts turn, and beside a known error, three more are held against the whole error.

A mount that is turned by small angles a beyond its bias moves a point whose lever (from the pivot, as it stands at the
bias) is l by ``K_i l a_i`` to first order, and to second order by ``1/2 sum_ij K_i K_j l a_i a_j``, ``i <= j`` in the
order of ``Rx Ry Rz``; K_i is the cross product with the axis of angle i as it stands at the bias.  A rotation that is
undone (the structure's, in the physical reading) has the factors the other way round.  A turn also turns the errors of
all that comes before it.  So the second order ``x2 = 1/2 z'Hz`` of the mounts is known in closed form, with z their
torsors and the error of localisation by the images, and the levers hold every known error of what comes before.

**Size**: ``sqrt(E|x2|^2 / E|e|^2)``, e the whole error to first order, its known part included.  Without a known error
P95 errs in proportion to its square.  A structure that its mount turns is seen from elsewhere, so that the gains of
images are others; the second moment of their change times the noise is part of it, counted twice, for P95 errs by up to
twice its square and by some 0.7 of the rest.

**Along the bias**: a known error b that lies along the lever is shortened by every turn, whatever its sign, and P95
errs in proportion to the turn itself: with b = L s u (L the lever, s the turn about each of two axes) by b L s^2 u^2
and so on.  With ``c1 = E|e|^2`` and ``2 c2`` the variance of ``|e|^2``, x2 changes them, S = J C J' the covariance of
the error and ``T_k = (J C) H_k (J C)'``, by

    dc1 = 2 b.m,    dc2 = 2 (2 b'S m + 2 sum_k (T_k b)_k + sum_k b_k tr T_k),    m = E x2,

for normal z, and ``P95^2 = c1 + kappa sqrt(c2)``, where kappa is that of the chi-squared law with the same third
cumulant (Pearson's form).  The number is the relative change of P95, both terms taken to have the same sign.

**Images beside the bias**: what images do has a second order too, and nu is its standard deviation over the first.
Without a known error P95 errs in proportion to the square of nu.  A known error lies on one side, where the error is
longer, or shorter, by the factor ``1 + nu z``, and P95 errs in proportion to nu.  Which z that is nu does not tell: the
number is the same change of P95 for ``x2 = nu z x1`` with z along the longest axis of the error by the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..geometry.camera import image_of
from ..geometry.rotation import Displacement
from ..kernels.store import kernel
from .noise import Estimation, eliminate, room_for

if TYPE_CHECKING:
    from ..system import DirectEffect


class Nonlinearity(NamedTuple):
    """Standard deviations of relative errors that first order takes for small (see the module)."""

    depth: float
    crossing: float
    disagreement: float
    gap: float
    range: float
    known: float = 0.0  # what known shifts of images do of all but the gap: P95 errs in proportion to it

    @property
    def divisor(self) -> float:
        """Of what first order divides by: beyond 0.2 the error has no standard deviation."""
        return max(self.depth, self.crossing)

    @property
    def nu(self) -> float:
        """The validity number."""
        return max(self.depth, self.crossing, self.disagreement, self.gap, self.range)


@kernel(nogil=True)
def matrix_gains(projection: Array, points: Array, weights: Array) -> Array:
    """(12, N, 2) change of a resected matrix per px of each fiducial's noise (its u and v).

    The matrix, row by row, is the one of ``eliminate``: origins at the centroid of what the view sees and at its image.
    Its gauge holds the depth of the centroid, so the last row is zero.  projection (3, 4) with |p3| = 1, points (N, 3)
    mm, weights (N,): 1 of a fiducial that the view sees, otherwise 0.
    """
    count = points.shape[0]
    total = weights.sum()
    of_view = room_for(1, points)
    eliminate(projection, points, weights, of_view, 0)
    image, local, d_inv = of_view.image[0], of_view.local[0], of_view.d_inv[0]
    du, dv, s_inv = of_view.du[0], of_view.dv[0], of_view.s_inv[0]
    out = np.zeros((12, count, 2))
    y = np.empty((3, 4))
    selected = np.zeros((3, 4))
    for entry in range(11):
        selected[entry // 4, entry % 4] = 1.0
        y[:] = 0.0  # (M'M)^+ selected, by the elimination of p1 and p2
        for j in range(3):
            for m in range(3):
                right = selected[2, m]
                for k in range(4):
                    right += du[k, m] * selected[0, k] + dv[k, m] * selected[1, k]
                y[2, j] += s_inv[j, m] * right
        for j in range(4):
            for m in range(3):
                y[0, j] += du[j, m] * y[2, m]
                y[1, j] += dv[j, m] * y[2, m]
                if j < 3:
                    y[0, j] += d_inv[j, m] * selected[0, m]
                    y[1, j] += d_inv[j, m] * selected[1, m]
        y[0, 3] += selected[0, 3] / total
        y[1, 3] += selected[1, 3] / total
        selected[entry // 4, entry % 4] = 0.0
        for i in range(count):
            of_row = np.zeros(3)
            for k in range(4):
                for r in range(3):
                    of_row[r] += local[i, k] * y[r, k]
            for c in range(2):
                out[entry, i, c] = weights[i] * image[i, 2] * (of_row[c] - image[i, c] * of_row[2])
    return out


def motion_of_images(projection: Array, points: Array) -> Array:
    """(N, 2, 3) px per mm: how the images of points (N, 3) mm move with them.  projection (3, 4) with |p3| = 1."""
    projected = points @ projection[:, :3].T + projection[:, 3]
    images, depths = image_of(projected), projected[:, 2]
    return np.asarray((projection[:2, :3] - images[:, :, None] * projection[2, :3]) / depths[:, None, None])


class MatrixGains(NamedTuple):
    """What a view's estimated matrix does, entries as in ``matrix_gains``."""

    by_noise: Array  # (12, N, 2) per px of each fiducial's noise
    by_intrinsics: Array  # (12, 3) per unit of error of the assumed intrinsics


def least_squares_matrix_gains(
    projection: Array, points: Array, weights: Array, unknowns: int, precision: Array
) -> MatrixGains:
    """``matrix_gains`` of the estimators by least squares of the images (``noise.least_squares_residual_gains``)."""
    centre = weights @ points / weights.sum()
    head = projection.copy()
    head[:, 3] += projection[:, :3] @ centre
    origin = head[:2, 3] / head[2, 3]
    head[:2] -= origin[:, None] * head[2]
    by_unknown = np.zeros((unknowns if unknowns == 11 else 9, 3, 4))
    if unknowns == 11:
        by_unknown.reshape(11, 12)[range(11), range(11)] = 1.0
    else:
        for k, axis in enumerate(np.eye(3)):
            by_unknown[k, :, :3] = np.cross(head[:, :3], axis)
            by_unknown[3 + k, :, 3] = head[:, k]
        by_unknown[6, :2] = head[:2] + (origin - projection[:2, :3] @ projection[2, :3])[:, None] * head[2]
        by_unknown[7, 0] = by_unknown[8, 1] = head[2]
    by_unknown -= (by_unknown[:, 2, 3] / head[2, 3])[:, None, None] * head  # the depth of the centre is held
    local = np.column_stack([points - centre, np.ones(len(points))])
    seen = local @ head.T
    moved = np.einsum("akj,nj->nka", by_unknown, local)
    slopes = (moved[:, :2] - image_of(seen)[:, :, None] * moved[:, 2:]) / seen[:, 2, None, None]
    rows = slopes[..., :unknowns].reshape(-1, unknowns)
    seen_rows = rows * np.repeat(weights, 2)[:, None]
    information = seen_rows.T @ rows
    if unknowns < 11:
        sought = range(6, unknowns)
        information[sought, sought] += precision[: len(sought)]
    flat = by_unknown.reshape(len(by_unknown), 12).T
    by_noise = flat[:, :unknowns] @ np.linalg.solve(information, seen_rows.T)
    by_intrinsics = np.zeros((12, 3))
    if unknowns < 11:
        by_intrinsics = flat[:, 6:] - by_noise @ slopes[..., 6:].reshape(-1, 3)
    return MatrixGains(by_noise.reshape(12, len(points), 2), by_intrinsics)


def view_matrix_gains(
    projections: Array, points: Array, weights: Array, estimation: Estimation
) -> tuple[MatrixGains, ...]:
    """Of each view; projections (V, 3, 4) with |p3| = 1, points (N, 3) mm; weights (V, N): 1 where a view sees one."""
    if estimation.unknowns == 0:
        return tuple(
            MatrixGains(matrix_gains(projection, points, weights[v]), np.zeros((12, 3)))
            for v, projection in enumerate(projections)
        )
    return tuple(
        least_squares_matrix_gains(projection, points, weights[v], estimation.unknowns, estimation.precision[v])
        for v, projection in enumerate(projections)
    )


def matrix_covariance(
    gains: Sequence[MatrixGains],
    projections: Array,
    points: Array,
    estimation: Estimation,
    per_error: Array,
    std: Array,
    intrinsics: Sequence[DirectEffect | None],
) -> Array:
    """(12 V, 12 V) covariance of the resected matrices by what moves each fiducial's image by itself.

    gains: of each view, entries as in ``matrix_gains``; projections (V, 3, 4) with |p3| = 1, points (N, 3) mm;
    estimation: the noise of the images; per_error (3, 3): what a manufacturing error does to the points; std (N, 3) mm
    of it; intrinsics: the errors that each view believes.  One view knows of another only through the manufacturing
    errors that they share.
    """
    out = np.zeros((12 * len(gains), 12 * len(gains)))
    shared = []
    for v, (gain, projection, error) in enumerate(zip(gains, projections, intrinsics, strict=True)):
        flat = (gain.by_noise @ estimation.noise_of(0)[v]).reshape(12, -1)
        if error is not None:
            flat = np.hstack([flat, gain.by_intrinsics @ (error.sources.direction * error.sources.spread)])
        out[12 * v : 12 * v + 12, 12 * v : 12 * v + 12] = flat @ flat.T
        motion = motion_of_images(projection, points) @ per_error * std[:, None, :]
        shared.append(np.einsum("anc,nck->ank", gain.by_noise, motion).reshape(12, -1))
    through = np.concatenate(shared)
    return np.asarray(out + through @ through.T)


class Common(NamedTuple):
    """What moves all images of a view together, at one target: K columns, each one standard deviation of a source."""

    of_matrices: Array  # (V, 12, K) of the resected matrices, entries as in ``matrix_gains``
    of_target: Array  # (V, 2, K) px, of the target's image
    known: int  # the last so many columns are no random sources: they are known

    def part(self, columns: slice) -> Common:
        return Common(self.of_matrices[:, :, columns], self.of_target[:, :, columns], 0)

    @property
    def random(self) -> Common:
        """Without what is known."""
        return self.part(slice(0, self.of_target.shape[2] - self.known))

    @property
    def steady(self) -> Common:
        """What is known alone."""
        return self.part(slice(self.of_target.shape[2] - self.known, None))

    @property
    def flat(self) -> Array:
        """(12 V, K) of all matrices."""
        return self.of_matrices.reshape(-1, self.of_matrices.shape[2])


class TargetImages(NamedTuple):
    """What V views see of a target, each in coordinates about the centroid of its fiducials and the image of that, and
    what goes wrong there: each fiducial by itself (``covariance``), and all of a view together (``common``)."""

    heads: Array  # (V, 3, 4) matrices
    place: Array  # (V, 4) the target, mm
    images: Array  # (V, 2) its images, px
    depths: Array  # (V,) mm
    rows: Array  # (V, 2, 3) of J, px
    covariance: Array  # (12 V, 12 V) of the matrices: ``matrix_covariance``
    common: Common

    def functionals(self, left: Array, by_image: Array | None = None) -> Array:
        """(V k, V k) second moments of linear functionals, each of its own view's: left (V, k, 12) of its matrix,
        by_image (V, k, 2) of the image of the target by what is common."""
        views, size, _ = left.shape
        every = np.zeros((views, size, views, 12))
        for v in range(views):
            every[v, :, v] = left[v]
        flat = every.reshape(views * size, 12 * views)
        out = flat @ self.covariance @ flat.T
        if self.common.of_target.shape[2]:
            together = left @ self.common.of_matrices
            if by_image is not None:
                together = together + by_image @ self.common.of_target
            together = together.reshape(views * size, -1)
            out += together @ together.T
        return np.asarray(out)


def aim_at(projections: Array, centres: Array, target: Array, covariance: Array, common: Common) -> TargetImages:
    """A target (3,) mm; projections (V, 3, 4) with |p3| = 1, centres (V, 3) mm of the fiducials that each view sees."""
    heads = projections.copy()
    heads[:, :, 3] += (projections[:, :, :3] @ centres[:, :, None])[:, :, 0]
    heads[:, :2] -= (heads[:, :2, 3] / heads[:, 2:, 3])[:, :, None] * heads[:, 2:]
    place = np.column_stack([target - centres, np.ones(len(centres))])
    projected = (heads @ place[:, :, None])[:, :, 0]
    images = image_of(projected)
    rows = heads[:, :2, :3] - images[:, :, None] * heads[:, 2:, :3]
    return TargetImages(heads, place, images, projected[:, 2], rows, covariance, common)


def _depth(aim: TargetImages) -> float:
    """The first number, squared."""
    largest = 0.0
    for v, depth in enumerate(aim.depths.tolist()):
        block = aim.covariance[12 * v + 8 : 12 * v + 11, 12 * v + 8 : 12 * v + 11]
        away = aim.place[v, :3]
        together = away @ aim.common.of_matrices[v, 8:11]
        largest = max(largest, float(away @ block @ away + together @ together) / depth**2)
    return largest


def _crossing(aim: TargetImages) -> float:
    """The second number, squared."""
    views = len(aim.depths)
    moved = aim.rows / aim.depths[:, None, None]  # px per mm along x, y, z
    flat = moved.reshape(2 * views, 3)
    squares, axes = np.linalg.eigh(flat.T @ flat)  # the images move along the three axes at right angles
    weakest = axes[:, 0]
    slopes = np.zeros((views, 2, 12))  # by the matrices: d(image)/d(point) along the weakest direction
    towards = aim.heads[:, 2, :3] @ weakest / aim.depths
    for c in range(2):
        own = slopes[:, c, 4 * c : 4 * c + 4]
        own[:, :3] += weakest / aim.depths[:, None]
        own -= (towards / aim.depths)[:, None] * aim.place
        slopes[:, c, 8:11] -= (aim.images[:, c] / aim.depths)[:, None] * weakest
        slopes[:, c, 8:] += ((towards * aim.images[:, c] - moved[:, c] @ weakest) / aim.depths)[:, None] * aim.place
    errors = aim.functionals(slopes)
    across = flat @ axes[:, 1:]  # what the images do across the weakest direction counts nothing
    variance = np.trace(errors) - ((across * (errors @ across)).sum(axis=0) / squares[1:]).sum()
    return float(max(variance, 0.0) / squares[0])


def row_errors(aim: TargetImages, target_noise: Array, *, unit: bool) -> Array:
    """(4, 4, 2 V, 2 V) second moments of the errors of each row: of J (3) and of rho.

    unit: with the gauge |p3| = 1 in J, otherwise with that of ``matrix_gains``.
    """
    views = len(aim.depths)
    left = np.zeros((views, 8, 12))
    by_noise = np.zeros((views, 8, 8))
    by_image = np.zeros((views, 8, 2))
    for c in range(2):
        image = aim.images[:, c, None]
        for k in range(3):
            left[:, 4 * c + k, 4 * c + k] += 1.0
            left[:, 4 * c + k, 8 + k] -= image[:, 0]
            if unit:
                left[:, 4 * c + k, 8:11] -= aim.rows[:, c, k, None] * aim.heads[:, 2, :3]
        left[:, 4 * c + 3, 4 * c : 4 * c + 4] += aim.place
        left[:, 4 * c + 3, 8:] -= image * aim.place
        own = np.column_stack([aim.heads[:, 2, :3], aim.depths])
        by_image[:, 4 * c : 4 * c + 4, c] = -own
        for e, k in np.ndindex(c + 1, 2):
            part = (target_noise[:, c, None, k] * own)[:, :, None] * (target_noise[:, e, None, k] * own)[:, None]
            by_noise[:, 4 * c : 4 * c + 4, 4 * e : 4 * e + 4] += part
            if e < c:
                by_noise[:, 4 * e : 4 * e + 4, 4 * c : 4 * c + 4] += part
    errors = aim.functionals(left, by_image)
    for v in range(views):
        errors[8 * v : 8 * v + 8, 8 * v : 8 * v + 8] += by_noise[v]
    return np.asarray(errors.reshape(2 * views, 4, 2 * views, 4).transpose(1, 3, 0, 2))


def _range(aim: TargetImages, target_noise: Array, factor: Array) -> float:
    """The fifth number, squared; factor (2 V, 2 V) of the rows."""
    errors = row_errors(aim, target_noise, unit=False)
    to_point = np.linalg.pinv(factor @ aim.rows.reshape(-1, 3)) @ factor  # the point moves by it times -rho
    rho = errors[3, 3]
    point = to_point @ rho @ to_point.T  # E[x1 x1']
    across = errors[:3, 3] @ to_point.T  # -E[dJ_a x1']
    mean = across.trace(axis1=0, axis2=2)
    moment = np.outer(mean, mean) + np.einsum("jkab,jk->ab", errors[:3, :3], point)
    moment += np.einsum("jak,kbj->ab", across, across)
    first = float(np.trace(point))
    return max(float(np.trace(to_point @ moment @ to_point.T)) / (3.0 * first), 0.0) if first > 0.0 else 0.0


def _factor(row_weights: Array) -> Array:
    """(2 V, 2 V) by which rows are multiplied so that their least squares are those with weights (V, 2, 2)."""
    size = 2 * len(row_weights)
    factor = np.eye(size)
    if (row_weights != np.eye(2)).any():
        scale = np.linalg.norm(row_weights, axis=(1, 2)).mean()  # only ratios matter; that of rows to unit vector stays
        for v, weight in enumerate(row_weights):
            factor[2 * v : 2 * v + 2, 2 * v : 2 * v + 2] = np.linalg.cholesky(weight / scale).T
    return factor


def _disagreement(
    aim: TargetImages, target_noise: Array, factor: Array, away: Array, unit: float
) -> tuple[float, float]:
    """The third number and the fourth, squared.

    factor (2 V, 2 V) of the rows; away (3,), from the origin to the target, and unit: mm, of the frame of the unit
    vector.
    """
    errors = factor @ row_errors(aim, target_noise, unit=True) @ factor.T
    rows = factor @ aim.rows.reshape(-1, 3)
    inverse = np.linalg.inv(rows.T @ rows)
    to_point = inverse @ rows.T
    left = np.eye(len(rows)) - rows @ to_point
    rho = errors[3, 3]
    residual = left @ rho @ left  # E[r_a r_b]
    square = unit * unit + float(away @ away)
    pull = away / square
    before = errors[:3, 3] @ left  # E[dJ_a r_b]
    after = before - pull[:, None, None] * residual  # E[g_a r_b]
    both = (  # E[g_a g_b']
        errors[:3, :3]
        - pull[:, None, None] * before[:, None]
        - pull[:, None, None, None] * before.transpose(0, 2, 1)
        + np.outer(pull, pull)[:, :, None, None] * residual
    )
    mean = after.trace(axis1=1, axis2=2)
    moment = np.outer(mean, mean) + (both * residual).sum(axis=(2, 3)) + np.einsum("jab,kba->jk", after, after)
    second, first = np.trace(inverse @ moment @ inverse), np.trace(to_point @ rho @ to_point.T)
    singular = np.trace(residual) / square  # of the rows: the mean square that noise makes of the zero
    gap = max(float(singular), 0.0) * sqrt(float((inverse**2).sum()))
    return max(float(second / first), 0.0) if first > 0.0 else 0.0, gap


def nonlinearity(
    projections: Array,
    points: Array,
    weights: Array,
    target: Array,
    covariance: Array,
    common: Common,
    target_noise: Array,
    row_weights: Array,
    *,
    published: bool,
) -> Nonlinearity:
    """The numbers at one target.

    projections (V, 3, 4) with |p3| = 1, points (N, 3) and target (3,) mm as the estimator meets them; weights (V, N):
    1 where a view sees a fiducial; covariance: see ``matrix_covariance``; common: what moves all images of a view;
    target_noise (V, 2, 2) px: by which independent noise is multiplied to that of the target's images; row_weights
    (V, 2, 2) of the triangulation, published: its form.
    """
    centre = points.mean(axis=0)
    away, unit = target - centre, sqrt(float(((points - centre) ** 2).sum()) / len(points) / 3.0)
    if published:
        away, unit = target, 1.0
    aim = aim_at(projections, weights @ points / weights.sum(axis=1)[:, None], target, covariance, common)

    factor = _factor(row_weights)
    depth, crossing = _depth(aim), _crossing(aim)
    apart, gap = _disagreement(aim, target_noise, factor, away, unit)
    along = _range(aim, target_noise, factor)
    known = 0.0
    if common.known:
        steady = aim._replace(covariance=np.zeros_like(covariance), common=common.steady)
        random = aim._replace(common=common.random)
        without, _ = _disagreement(random, target_noise, factor, away, unit)
        shifted = along - _range(random, target_noise, factor)
        known = sqrt(max(_depth(steady), _crossing(steady), apart - without, shifted))
    return Nonlinearity(sqrt(depth), sqrt(crossing), sqrt(apart), sqrt(gap), sqrt(along), known)


# --- mounts that turn, and what is known -----------------------------------------------------------------

NORMAL_95 = 1.6448536269514722
ANGLES_1, SHIFTS_1, IMAGES = slice(0, 3), slice(3, 6), slice(6, 9)
ANGLES_2, SHIFTS_2, ANGLES_3, SHIFTS_3 = slice(9, 12), slice(12, 15), slice(15, 18), slice(18, 21)
SIZE = 21


class Turns(NamedTuple):
    """What first order leaves out where mounts turn, and beside a known error (see the module)."""

    size: float = 0.0
    along_bias: float = 0.0
    images_beside_bias: float = 0.0

    def larger(self, other: Turns) -> Turns:
        return Turns(*map(max, self, other))


NO_TURNS = Turns()
UPPER = np.triu(np.ones((3, 3)))
STRICTLY_UPPER = np.triu(np.ones((3, 3)), 1)


def _axes(act: Displacement) -> Array:
    """(3, 3, 3): of each angle the cross product with its axis, at the bias."""
    return np.asarray(act.by_angle @ act.rotation.T)


def _bent(axes: Array, lever: Array, undone: bool = False) -> Array:
    """(3, 3, 3) second derivative of a turned lever by two angles; first index: the component."""
    twice = (axes @ (axes @ lever).T).transpose(1, 0, 2)
    if undone:
        twice = twice.transpose(0, 2, 1)
    return np.asarray(UPPER * twice + (STRICTLY_UPPER * twice).transpose(0, 2, 1))


def _along(turn: Array, second: Array) -> Array:
    """A second derivative (3, n, n) turned (3, 3)."""
    return np.asarray((turn @ second.reshape(3, -1)).reshape(second.shape))


def second_order(
    acts: Sequence[Displacement],
    mounts: Sequence[DirectEffect],
    to_tool: Array,
    points: Sequence[Array],
    physical: bool,
) -> tuple[Array, Array, Array, Array]:
    """Derivatives of the error of localisation, con, and at the tool, tcp, by z: (3, SIZE) and (3, SIZE, SIZE) each.

    z: torsor of the first mount, error of localisation by the images (con), torsors of the second and of hand-eye.
    acts, mounts: of these three; to_tool (3, 3) the rotation con -> tcp; points: (3,) mm that the three displace, the
    first in con as it is reconstructed, whether the first is undone (physical) or not.
    """
    first, second, third = acts
    axes = [_axes(act) for act in acts]
    levers = [act.rotation @ (point - mount.pivot_mm) for act, point, mount in zip(acts, points, mounts, strict=True)]
    jacobian, bent = np.zeros((3, SIZE)), np.zeros((3, SIZE, SIZE))
    jacobian[:, IMAGES] = np.eye(3)
    back = first.rotation.T if physical else np.eye(3)
    sign = -1.0 if physical else 1.0
    jacobian[:, ANGLES_1] = sign * back @ (axes[0] @ levers[0]).T
    jacobian[:, SHIFTS_1] = sign * back
    bent[:, ANGLES_1, ANGLES_1] = _along(back, _bent(axes[0], levers[0], physical))
    if physical:  # what is undone is the shifted point
        mixed = (back @ axes[0]).transpose(1, 0, 2)
        bent[:, ANGLES_1, SHIFTS_1] = mixed
        bent[:, SHIFTS_1, ANGLES_1] = mixed.transpose(0, 2, 1)
    local = jacobian, bent
    for act, own, lever, angles, shifts, turn in (
        (second, axes[1], levers[1], ANGLES_2, SHIFTS_2, np.eye(3)),
        (third, axes[2], levers[2], ANGLES_3, SHIFTS_3, to_tool),
    ):
        onward = act.rotation @ turn
        before = onward @ jacobian
        bent = _along(onward, bent)
        turned = (own @ before).transpose(1, 0, 2)  # (3, angle, SIZE)
        bent[:, angles] += turned
        bent[:, :, angles] += turned.transpose(0, 2, 1)
        bent[:, angles, angles] += _bent(own, lever)
        jacobian = before
        jacobian[:, angles] += (own @ lever).T
        jacobian[:, shifts] += np.eye(3)
    return *local, jacobian, bent


def images_beside_bias(nu: float, covariance: Array, to_error: Array, total: Array, bias: Array) -> float:
    """The third number of one error.

    covariance (3, 3) mm^2 of localisation by the images; to_error (3, 3) from that to this error; total (3, 3) mm^2,
    covariance of the whole error, and its bias (3,) mm.
    """
    squares, axes = np.linalg.eigh(covariance)
    if squares[2] <= 0.0 or not bias.any():
        return 0.0
    per_mm = nu / sqrt(squares[2]) * axes[:, 2]  # nu z, by mm of the error
    once = np.eye(3)[:, :, None] * per_mm
    second = once + once.transpose(0, 2, 1)
    return turns_of(to_error, _along(to_error, second), covariance, total, bias).along_bias


def turns_of(
    jacobian: Array, second: Array, covariance: Array, total: Array, bias: Array, gains_moved: float = 0.0
) -> Turns:
    """The first two numbers of one error.

    jacobian (3, SIZE) and second (3, SIZE, SIZE): its derivatives by z; covariance (SIZE, SIZE) of z; total (3, 3)
    mm^2, covariance of the whole error, and its bias (3,) mm; gains_moved mm^2: see the module.
    """
    c1 = float(total.trace() + bias @ bias)
    through = second @ covariance
    mean = 0.5 * through.trace(axis1=1, axis2=2)
    square = float(mean @ mean) + 0.5 * float((through * through.transpose(0, 2, 1)).sum()) + 2.0 * gains_moved
    if square <= 0.0 or c1 <= 0.0:
        return NO_TURNS
    size, pulled = sqrt(square / c1), total @ bias
    c2 = float((total * total).sum() + 2.0 * bias @ pulled)
    c3 = float(((total @ total) * total).sum() + 3.0 * pulled @ pulled)
    if c2 <= 0.0 or c3 <= 0.0:  # nothing random, or so little that its powers are no numbers any more
        return Turns(size, 0.0)
    bent = (jacobian @ covariance) @ through @ jacobian.T
    wide = c2 * (c2 / c3) ** 2
    kappa = sqrt(wide) * ((1.0 - 2.0 / (9.0 * wide) + NORMAL_95 * sqrt(2.0 / (9.0 * wide))) ** 3 - 1.0)
    of_mean = 2.0 * float(bias @ mean)
    by_spread = float(2.0 * pulled @ mean + 2.0 * (bent @ bias).trace() + bias @ bent.trace(axis1=1, axis2=2))
    change = abs(of_mean) + abs(by_spread) * kappa / sqrt(c2)
    return Turns(size, change / (2.0 * (c1 + kappa * sqrt(c2))))
