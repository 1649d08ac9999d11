"""Gains of image noise and of manufacturing errors on the triangulated point.  The one first-order model.

Every function here is written in scalar steps on arrays, without square roots or branches on values, so
that the same source runs three ways: as Python, compiled by numba (``noise_gains_jit``), and on numpy
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
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ..kernels import kernel

# The arrays are numpy arrays of floats or of CasADi SX scalars; static typing cannot say both.
Duck = Any


@register_jitable
def inverse3(m: Duck) -> Duck:
    """Inverse of a 3x3 by cofactors: no pivoting, so that it also runs on symbols."""
    out = np.zeros((3, 3), m.dtype)
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    det = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] = out[i, j] / det
    return out


@register_jitable
def sum_of(weights: Duck) -> Duck:
    """Sum of weights (N,): how many fiducials an estimate uses."""
    total = 0.0
    for i in range(weights.shape[0]):
        total = total + weights[i]
    return total


@register_jitable
def mean_rows(points: Duck, weights: Duck) -> Duck:
    """Centroid of (N, 3) with weights (N,)."""
    total = sum_of(weights)
    out = np.zeros(3, points.dtype)
    for i in range(points.shape[0]):
        for k in range(3):
            out[k] = out[k] + points[i, k] * weights[i] / total
    return out


@register_jitable
def eliminate(projection: Duck, points: Duck, weights: Duck) -> Duck:
    """The normal equations of one view's resection with p1 and p2 eliminated: what every gain of the view takes.

    projection (3, 4) with |p3| = 1; points (N, 3) in mm; weights (N,): 1 of a fiducial that the estimate uses, 0 of
    one that the view does not see.  Returns, in coordinates whose origin is the weighted centroid and whose image
    origin is the image (u0, v0) of that: the projection's rows (3, 4); the images (N, 3), u, v and depth; the points
    (N, 4); D^-1 (3, 3); D^-1 Gu and D^-1 Gv (4, 4); S^-1 (3, 3); (u0, v0) (2,); the centroid (3,).
    """
    count = points.shape[0]
    total = sum_of(weights)
    centre = mean_rows(points, weights)
    head = np.zeros((3, 4), points.dtype)  # rows p1, p2, p3 in coordinates centred on the fiducials
    for r in range(3):
        head[r, 3] = projection[r, 3]
        for k in range(3):
            head[r, k] = projection[r, k]
            head[r, 3] = head[r, 3] + projection[r, k] * centre[k]
    # Image origin at the image of the centroid: without it Gw - Gu D^-1 Gu loses six digits to cancellation.
    origin = np.zeros(2, points.dtype)
    origin[0] = origin[0] + head[0, 3] / head[2, 3]
    origin[1] = origin[1] + head[1, 3] / head[2, 3]
    for k in range(4):
        head[0, k] = head[0, k] - origin[0] * head[2, k]
        head[1, k] = head[1, k] - origin[1] * head[2, k]

    image = np.zeros((count, 3), points.dtype)  # u, v, depth of each fiducial
    local = np.zeros((count, 4), points.dtype)
    scatter = np.zeros((3, 3), points.dtype)
    gu = np.zeros((4, 4), points.dtype)
    gv = np.zeros((4, 4), points.dtype)
    s = np.zeros((3, 3), points.dtype)
    for i in range(count):
        for k in range(3):
            local[i, k] = points[i, k] - centre[k]
        local[i, 3] = local[i, 3] + 1.0
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
        for j in range(4):
            for k in range(4):
                yy = local[i, j] * local[i, k] * weights[i]
                gu[j, k] = gu[j, k] + u * yy
                gv[j, k] = gv[j, k] + v * yy
                if j < 3 and k < 3:
                    scatter[j, k] = scatter[j, k] + yy
                    s[j, k] = s[j, k] + (u * u + v * v) * yy
    d_inv = inverse3(scatter)

    # D^-1 Gu and D^-1 Gv: (4, 4), last row divided by N because D is block diagonal.
    du = np.zeros((4, 4), points.dtype)
    dv = np.zeros((4, 4), points.dtype)
    for k in range(4):
        for j in range(3):
            for m in range(3):
                du[j, k] = du[j, k] + d_inv[j, m] * gu[m, k]
                dv[j, k] = dv[j, k] + d_inv[j, m] * gv[m, k]
        du[3, k] = gu[3, k] / total
        dv[3, k] = gv[3, k] / total
    for j in range(3):
        for k in range(3):
            for m in range(4):
                s[j, k] = s[j, k] - gu[j, m] * du[m, k] - gv[j, m] * dv[m, k]
    return head, image, local, d_inv, du, dv, inverse3(s), origin, centre


@register_jitable
def view_residual_gains(
    projection: Duck, points: Duck, weights: Duck, target: Duck, gains: Duck, perspective: Duck
) -> Duck:
    """One view: gains of the target's residual by the fiducials' image noise.

    projection (3, 4) with |p3| = 1; points (N, 3), target (3,) in mm; weights (N,): see ``eliminate``.  Fills
    ``gains`` (N, 2, 2): residual (rows u, v) per px of noise (columns u, v), zero of what the view does not see; and
    ``perspective`` (N, 2): gauge-free relative perspective error at the target, ``dw(q)/w(q) - dw(c)/w(c)``, per px.
    Returns (target image u, v relative to the centroid's image; the centroid's image u, v; target depth) as a (5,)
    array.
    """
    count = points.shape[0]
    total = sum_of(weights)
    head, image, local, d_inv, du, dv, s_inv, origin, centre = eliminate(projection, points, weights)
    tq = np.zeros(4, points.dtype)
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

    # y = (M'M)^+ h for the u row, the v row and the perspective functional (columns 0, 1, 2).
    y = np.zeros((3, 4, 3), points.dtype)  # [p1|p2|p3, coordinate, column]
    for c in range(3):
        rhs = np.zeros(3, points.dtype)
        for j in range(3):
            if c == 0:
                rhs[j] = rhs[j] - tu * tq[j]
                for m in range(4):
                    rhs[j] = rhs[j] + du[m, j] * tq[m]  # (Gu D^-1 q)_j, both symmetric
            elif c == 1:
                rhs[j] = rhs[j] - tv * tq[j]
                for m in range(4):
                    rhs[j] = rhs[j] + dv[m, j] * tq[m]
            else:
                rhs[j] = rhs[j] + tq[j] / t2
        for j in range(3):
            for m in range(3):
                y[2, j, c] = y[2, j, c] + s_inv[j, m] * rhs[m]
        for j in range(4):
            for m in range(3):
                y[0, j, c] = y[0, j, c] + du[j, m] * y[2, m, c]
                y[1, j, c] = y[1, j, c] + dv[j, m] * y[2, m, c]
        if c < 2:  # D^-1 q on the row that carries the target
            for j in range(3):
                for m in range(3):
                    y[c, j, c] = y[c, j, c] + d_inv[j, m] * tq[m]
            y[c, 3, c] = y[c, 3, c] + tq[3] / total
    for i in range(count):
        w = image[i, 2] * weights[i]
        for c in range(3):
            e1 = y[0, 3, c]
            e2 = y[1, 3, c]
            e3 = y[2, 3, c]
            for k in range(3):
                e1 = e1 + local[i, k] * y[0, k, c]
                e2 = e2 + local[i, k] * y[1, k, c]
                e3 = e3 + local[i, k] * y[2, k, c]
            gain_u = w * (e1 - image[i, 0] * e3)
            gain_v = w * (e2 - image[i, 1] * e3)
            if c < 2:
                gains[i, c, 0] = gain_u
                gains[i, c, 1] = gain_v
            else:
                perspective[i, 0] = gain_u
                perspective[i, 1] = gain_v
    out = np.zeros(5, points.dtype)
    out[0] = tu
    out[1] = tv
    out[2] = origin[0]
    out[3] = origin[1]
    out[4] = t2
    return out


@register_jitable
def noise_gains(
    projections: Duck,
    points: Duck,
    weights: Duck,
    target: Duck,
    fiducial: Duck,
    target_gain: Duck,
    manufacturing: Duck,
    perspective: Duck,
) -> None:
    """Gains of the triangulated point, in the frame of ``points``, by every random image-side input.

    projections (V, 3, 4) mm -> px with |p3| = 1: the *effective* ones, ``P_v T_err1`` in the physical reading;
    points (N, 3) nominal fiducials, mm; weights (V, N): 1 where a view's estimate uses a fiducial, 0 where it does
    not; target (3,) the noise-free reconstructed point, mm.  Fills

    - fiducial (V, N, 3, 2): mm per px of image noise of fiducial i in view v;
    - target_gain (V, 3, 2): mm per px of the target's image noise;
    - manufacturing (V, N, 3, 3): mm per mm of m_i *through view v*.  The error is one and shared, so
      the gain of m_i is the sum over v; adding the squares per view instead is the block-diagonal
      covariance of Eq 16, which drops Cov(A_1, A_2);
    - perspective (V, N, 2): relative perspective error per px (for the validity number).
    """
    views = projections.shape[0]
    count = points.shape[0]
    residual = np.zeros((views, count, 2, 2), points.dtype)
    rows = np.zeros((views, 2, 3), points.dtype)
    depth = np.zeros(views, points.dtype)
    normal = np.zeros((3, 3), points.dtype)
    for v in range(views):
        image = view_residual_gains(projections[v], points, weights[v], target, residual[v], perspective[v])
        depth[v] = image[4]
        for c in range(2):
            for k in range(3):
                rows[v, c, k] = projections[v, c, k] - (image[c] + image[2 + c]) * projections[v, 2, k]
        for j in range(3):
            for k in range(3):
                normal[j, k] = normal[j, k] + rows[v, 0, j] * rows[v, 0, k] + rows[v, 1, j] * rows[v, 1, k]
    inverse = inverse3(normal)
    for v in range(views):
        to_point = np.zeros((3, 2), points.dtype)  # dq per unit residual of view v: -(J'J)^-1 J_v'
        for j in range(3):
            for c in range(2):
                for k in range(3):
                    to_point[j, c] = to_point[j, c] - inverse[j, k] * rows[v, c, k]
                target_gain[v, j, c] = -to_point[j, c] * depth[v]
        for i in range(count):
            h = np.zeros(3, points.dtype)
            for r in range(3):
                h[r] = h[r] + projections[v, r, 3]
                for k in range(3):
                    h[r] = h[r] + projections[v, r, k] * points[i, k]
            for j in range(3):
                for c in range(2):
                    fiducial[v, i, j, c] = to_point[j, 0] * residual[v, i, 0, c] + to_point[j, 1] * residual[v, i, 1, c]
            for k in range(3):
                du = (projections[v, 0, k] - h[0] / h[2] * projections[v, 2, k]) / h[2]
                dv = (projections[v, 1, k] - h[1] / h[2] * projections[v, 2, k]) / h[2]
                for j in range(3):
                    manufacturing[v, i, j, k] = fiducial[v, i, j, 0] * du + fiducial[v, i, j, 1] * dv


# Division by zero gives inf, which linearise refuses with the reason; an exception would have none.
noise_gains_jit = kernel(nogil=True)(noise_gains)
