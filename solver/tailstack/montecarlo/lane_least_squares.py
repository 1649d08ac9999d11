"""Least squares of a view's images, eight trials at a time: from six to eleven unknowns by one text.

Fiducials y of the object frame are at ``x = M y + d`` before a view (lengths in the unit of the object frame) and are
imaged at ``u = f_u p + s r``, ``v = f_v r`` from the principal point, ``p = x_0 / x_2``, ``r = x_1 / x_2``.  Unknown
are, in this order, with the slopes a of an image coordinate by x:

- six, *pose*: a shift of d, with slopes ``a``, and a turn w of M about the origin of the object frame, ``(M y) x a``;
- up to nine, *pose and intrinsics*: also phi, by which f_u, s and f_v grow by the nominal ones times it, and the
  principal point, or the first of these; how far they are off the assumed ones counts as an image's residual does,
  times the root of its precision, which is 0 where nothing is known beforehand;
- eleven, *reprojection*: d but for its depth, and the entries of M, with slopes ``a y'``; the camera is 1, so that
  (M, d) is any projection.

With up to nine M is a rotation.  Where the estimator assumes coordinates that an affine map has moved (Eq 18 with
small angles), S y with ``S = 1 + [t]x`` in the place of y, it is a rotation times S: a turn acts from the left, and S
stays.

Every estimate is equivariant to motion, so that the search starts where the structure truly is in the trial, and what
is left of it is what noise makes: a thousandth of the image.  Where the assumed intrinsics are wrong, the start is
shifted so that they image the origin where it truly is.

**Steps** solve the normal equations H step = g.  H is that of the start and held for ``RENEWAL`` steps: what a step
leaves of the last one is some thousandth of it, and g alone says where the estimate is.  ``step'H step = step.g`` is
the sum of squared moves of the images, px^2.  If the moves of two steps are m and m', what is still to come is about
``m'^2 / m``; where that is below ``LEFT_PX``, the lane is at rest.  A target's image moves by no more than that times
its standard deviation in units of the noise, wherever it lies: Cauchy and Schwarz in the metric H.

A lane that does not converge, whose H is not positive definite or whose depth is not between half and twice that of
its start is flagged, and so is every lane of an estimator whose number of unknowns is not in ``LENGTHS``.  There
the plain form (``estimation.least_squares``) decides; it starts from the nominal pose, or from DLT, and solves by QR.

Arguments below, lanes unless said:

- ``camera``: f_u, s, f_v and the principal point, px;
- ``pose``: M (9, by rows) and d (3);
- ``unknowns``: a tuple with an entry for each, of which the length n counts: the code is compiled for each length, as
  one text with n at run time takes half as long again;
- ``work``: scratch of ``WORK`` vectors: slopes of u and of v by the unknowns (11 each), g or the step (11), H (n x n,
  by rows, the upper triangle);
- ``tables``, ``images``, ``estimate``: as in ``kernel``.
"""

# mypy: ignore-errors
from __future__ import annotations

from numba import literal_unroll

from .lanes import any_lane, dot3, fma, lane_jit, load, select, splat, store
from .tables import FIDUCIALS, UNKNOWNS, VIEWS, intrinsics_slot

LEFT_PX = 1e-11
MAX_STEPS = 16
RENEWAL = 4  # steps with one H
LENGTHS = ((0,) * 6, (0,) * 9, (0,) * 11)  # the numbers of unknowns that are compiled, as ``unknowns``
WORK = 33 + 121
_V, _G, _H = 8 * 11, 8 * 22, 8 * 33  # where the slopes of v, g and H begin in ``work``


@lane_jit
def assumed_camera(tables, view, z):
    """The intrinsics that the estimator assumes."""
    k = tables.intrinsics[view]
    slot = intrinsics_slot(tables.counts[VIEWS], view)
    offset, sources = tables.gain_starts[slot, 0], tables.gain_starts[slot, 1]
    focal, shift_u, shift_v = splat(k[5]), splat(k[6]), splat(k[7])
    for j in range(sources):
        xi = load(z, 8 * (tables.starts[1 + slot] + j))
        focal = fma(splat(tables.gains[offset + j]), xi, focal)
        shift_u = fma(splat(tables.gains[offset + sources + j]), xi, shift_u)
        shift_v = fma(splat(tables.gains[offset + 2 * sources + j]), xi, shift_v)
    larger = splat(1.0) + focal
    return (
        larger * splat(k[0]),
        larger * splat(k[1]),
        larger * splat(k[2]),
        splat(k[3]) + shift_u,
        splat(k[4]) + shift_v,
    )


@lane_jit
def pose_at_start(tables, view, projection, camera):
    """Pose in the rows of :func:`lane_motion.true_projection`, which are those of a rotation.

    The origin of the object frame is shifted to where the assumed camera images it as the true one does, and as large:
    a principal point that is wrong by 50 px would otherwise be a step of 50 px.
    """
    k = tables.intrinsics[view]
    (u0, u1, u2, u3), (v0, v1, v2, v3), (r20, r21, r22, d2) = projection
    size = splat(tables.object_scale[0])
    r20, r21, r22, d2 = size * r20, size * r21, size * r22, size * d2
    point_u, point_v, skew = splat(k[3]), splat(k[4]), splat(k[1])
    focal_u, focal_v = splat(1.0 / k[0]), splat(1.0 / k[2])
    r10, r11 = focal_v * fma(-point_v, r20, size * v0), focal_v * fma(-point_v, r21, size * v1)
    r12, d1 = focal_v * fma(-point_v, r22, size * v2), focal_v * fma(-camera[4], d2, size * v3)
    r00 = focal_u * fma(-skew, r10, fma(-point_u, r20, size * u0))
    r01 = focal_u * fma(-skew, r11, fma(-point_u, r21, size * u1))
    r02 = focal_u * fma(-skew, r12, fma(-point_u, r22, size * u2))
    d0 = focal_u * fma(-skew, d1, fma(-camera[3], d2, size * u3))
    d2 = camera[2] / splat(k[2]) * d2
    return r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2


@lane_jit
def image(tables, images, i, camera, pose):
    """One fiducial: M y (3), 1 / x_2, p, r, u, v from the principal point, and how far its image is off them, px."""
    focal_u, skew, focal_v, point_u, point_v = camera
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    y0, y1, y2 = splat(tables.nominal[i, 0]), splat(tables.nominal[i, 1]), splat(tables.nominal[i, 2])
    x0, x1, x2 = dot3(r00, r01, r02, y0, y1, y2), dot3(r10, r11, r12, y0, y1, y2), dot3(r20, r21, r22, y0, y1, y2)
    inverse = splat(1.0) / (x2 + d2)
    p, r = inverse * (x0 + d0), inverse * (x1 + d1)
    u, v = fma(focal_u, p, skew * r), focal_v * r
    e, f = (load(images, 16 * i) - point_u) - u, (load(images, 16 * i + 8) - point_v) - v
    return x0, x1, x2, inverse, p, r, u, v, e, f


@lane_jit
def write_gradient(tables, view, images, unknowns, camera, pose, work):
    """g of the images: the slopes times what the images are off.

    What a fiducial's image is off pulls it by q: a shift gets q, a turn ``M y x q``, M ``q y'``.
    """
    n = len(unknowns)
    k = tables.intrinsics[view]
    focal_u, skew, focal_v, _, _ = camera
    zero = splat(0.0)
    g0, g1, g2, g3, g4, g5, g6, g7, g8 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    s0, s1, s2 = zero, zero, zero
    for i in range(tables.counts[FIDUCIALS]):
        if tables.products[view, i, 9] != 0.0:  # it is seen
            x0, x1, x2, inverse, p, r, u, v, e, f = image(tables, images, i, camera, pose)
            if 6 < n < 11:
                grown = fma(splat(k[0]), p, splat(k[1]) * r)
                g6, g7, g8 = fma(e, grown, fma(f, splat(k[2]) * r, g6)), g7 + e, g8 + f
            e, f = inverse * e, inverse * f
            q0, q1, q2 = e * focal_u, fma(e, skew, f * focal_v), -fma(e, u, f * v)
            s0, s1, s2 = s0 + q0, s1 + q1, s2 + q2
            if n == 11:
                y0, y1, y2 = splat(tables.nominal[i, 0]), splat(tables.nominal[i, 1]), splat(tables.nominal[i, 2])
                g0, g1, g2 = fma(q0, y0, g0), fma(q0, y1, g1), fma(q0, y2, g2)
                g3, g4, g5 = fma(q1, y0, g3), fma(q1, y1, g4), fma(q1, y2, g5)
                g6, g7, g8 = fma(q2, y0, g6), fma(q2, y1, g7), fma(q2, y2, g8)
            else:
                g3, g4, g5 = fma(x1, q2, fma(-x2, q1, g3)), fma(x2, q0, fma(-x0, q2, g4)), fma(x0, q1, fma(-x1, q0, g5))
    store(work, _G, s0)
    store(work, _G + 8, s1)
    at = _G + 16
    if n == 11:
        store(work, at, g0)
        store(work, at + 8, g1)
        store(work, at + 16, g2)
        at += 24
    else:
        store(work, at, s2)
        at += 8
    store(work, at, g3)
    store(work, at + 8, g4)
    store(work, at + 16, g5)
    if n > 6:
        store(work, at + 24, g6)
    if n > 7:
        store(work, at + 32, g7)
    if n > 8:
        store(work, at + 40, g8)


@lane_jit
def write_slopes(tables, view, images, i, unknowns, camera, pose, work):
    """Slopes of u and v of one fiducial by the unknowns; returns how far its image is off, px."""
    n = len(unknowns)
    k = tables.intrinsics[view]
    focal_u, skew, focal_v, _, _ = camera
    x0, x1, x2, inverse, p, r, u, v, e, f = image(tables, images, i, camera, pose)
    zero, one = splat(0.0), splat(1.0)
    a0, a1, a2 = inverse * focal_u, inverse * skew, -(inverse * u)
    b1, b2 = inverse * focal_v, -(inverse * v)
    store(work, 0, a0)
    store(work, 8, a1)
    store(work, _V, zero)
    store(work, _V + 8, b1)
    if n == 11:
        for c in range(3):
            y = splat(tables.nominal[i, c])
            store(work, 16 + 8 * c, a0 * y)
            store(work, 40 + 8 * c, a1 * y)
            store(work, 64 + 8 * c, a2 * y)
            store(work, _V + 16 + 8 * c, zero)
            store(work, _V + 40 + 8 * c, b1 * y)
            store(work, _V + 64 + 8 * c, b2 * y)
    else:
        store(work, 16, a2)
        store(work, 24, fma(x1, a2, -(x2 * a1)))
        store(work, 32, fma(x2, a0, -(x0 * a2)))
        store(work, 40, fma(x0, a1, -(x1 * a0)))
        store(work, _V + 16, b2)
        store(work, _V + 24, fma(x1, b2, -(x2 * b1)))
        store(work, _V + 32, -(x0 * b2))
        store(work, _V + 40, x0 * b1)
    if 6 < n < 11:
        store(work, 48, fma(splat(k[0]), p, splat(k[1]) * r))
        store(work, _V + 48, splat(k[2]) * r)
    if 7 < n < 11:
        store(work, 56, one)
        store(work, _V + 56, zero)
    if 8 < n < 11:
        store(work, 64, zero)
        store(work, _V + 64, one)
    return e, f


@lane_jit
def write_equations(tables, view, images, unknowns, camera, pose, work):
    """H of the images and of the prior, and g of the images."""
    n = len(unknowns)
    for j in range(n):
        store(work, _G + 8 * j, splat(0.0))
    for at in range(n * n):
        store(work, _H + 8 * at, splat(0.0))
    if n < 11:
        for j in range(n - 6):
            store(work, _H + 8 * (n + 1) * (6 + j), splat(tables.intrinsics[view, 8 + j]))
    for i in range(tables.counts[FIDUCIALS]):
        if tables.products[view, i, 9] != 0.0:
            e, f = write_slopes(tables, view, images, i, unknowns, camera, pose, work)
            for row in range(n):
                a, b = load(work, 8 * row), load(work, _V + 8 * row)
                store(work, _G + 8 * row, fma(a, e, fma(b, f, load(work, _G + 8 * row))))
                for k in range(n):
                    if k >= row:  # and not range(row, n): loops of a constant length are unrolled
                        at = _H + 8 * (n * row + k)
                        store(work, at, fma(a, load(work, 8 * k), fma(b, load(work, _V + 8 * k), load(work, at))))


@lane_jit
def factor(unknowns, work):
    """L D L' of H in its place: the upper triangle D L', the diagonal 1 / D.  Returns where all of D is above zero."""
    n = len(unknowns)
    one = splat(1.0)
    good = one > splat(0.0)
    for j in range(n):
        row = _H + 8 * n * j
        pivot = load(work, row + 8 * j)
        good = good & (pivot > splat(0.0))
        inverse = one / pivot
        store(work, row + 8 * j, inverse)
        for i in range(j + 1, n):
            less = -(inverse * load(work, row + 8 * i))
            for k in range(i, n):
                at = _H + 8 * (n * i + k)
                store(work, at, fma(less, load(work, row + 8 * k), load(work, at)))
    return good


@lane_jit
def solve(unknowns, work):
    """The step in the place of g, by the factor of H; returns ``step.g``."""
    n = len(unknowns)
    moved = splat(0.0)
    for j in range(n):
        row = _H + 8 * n * j
        g = load(work, _G + 8 * j)
        step = load(work, row + 8 * j) * g
        moved = fma(g, step, moved)
        store(work, _G + 8 * j, step)
        for k in range(j + 1, n):
            store(work, _G + 8 * k, fma(-step, load(work, row + 8 * k), load(work, _G + 8 * k)))
    for back in range(1, n):
        j = n - 1 - back
        row = _H + 8 * n * j
        total = splat(0.0)
        for k in range(j + 1, n):
            total = fma(load(work, row + 8 * k), load(work, _G + 8 * k), total)
        store(work, _G + 8 * j, fma(-load(work, row + 8 * j), total, load(work, _G + 8 * j)))
    return moved


@lane_jit
def turn_vector(scale, c0, c1, c2, x0, x1, x2):
    """A vector turned by ``1 + scale ([c]x + [c]x [c]x)``, scale = 2 / (1 + c'c): Cayley's rotation, exactly one."""
    k0, k1, k2 = fma(c1, x2, -(c2 * x1)), fma(c2, x0, -(c0 * x2)), fma(c0, x1, -(c1 * x0))
    return (
        fma(scale, k0 + fma(c1, k2, -(c2 * k1)), x0),
        fma(scale, k1 + fma(c2, k0, -(c0 * k2)), x1),
        fma(scale, k2 + fma(c0, k1, -(c1 * k0)), x2),
    )


@lane_jit
def turn(pose, work):
    """The pose after a step: shift (3), then turn (3)."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    half, one = splat(0.5), splat(1.0)
    c0, c1, c2 = half * load(work, _G + 24), half * load(work, _G + 32), half * load(work, _G + 40)
    scale = splat(2.0) / fma(c0, c0, fma(c1, c1, fma(c2, c2, one)))
    r00, r10, r20 = turn_vector(scale, c0, c1, c2, r00, r10, r20)
    r01, r11, r21 = turn_vector(scale, c0, c1, c2, r01, r11, r21)
    r02, r12, r22 = turn_vector(scale, c0, c1, c2, r02, r12, r22)
    d0, d1, d2 = d0 + load(work, _G), d1 + load(work, _G + 8), d2 + load(work, _G + 16)
    return r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2


@lane_jit
def change(pose, work):
    """The projection after a step of eleven unknowns: the shift but for its depth (2), then M (9)."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    d0, d1 = d0 + load(work, _G), d1 + load(work, _G + 8)
    r00, r01, r02 = r00 + load(work, _G + 16), r01 + load(work, _G + 24), r02 + load(work, _G + 32)
    r10, r11, r12 = r10 + load(work, _G + 40), r11 + load(work, _G + 48), r12 + load(work, _G + 56)
    r20, r21, r22 = r20 + load(work, _G + 64), r21 + load(work, _G + 72), r22 + load(work, _G + 80)
    return r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2


@lane_jit
def move_camera(k, unknowns, camera, work):
    """The camera after a step of a pose and intrinsics; k: the view's row of ``tables.intrinsics``."""
    n = len(unknowns)
    focal_u, skew, focal_v, point_u, point_v = camera
    if n > 6:
        grown = load(work, _G + 48)
        focal_u = fma(grown, splat(k[0]), focal_u)
        skew = fma(grown, splat(k[1]), skew)
        focal_v = fma(grown, splat(k[2]), focal_v)
    if n > 7:
        point_u = point_u + load(work, _G + 56)
    if n > 8:
        point_v = point_v + load(work, _G + 64)
    return focal_u, skew, focal_v, point_u, point_v


@lane_jit
def add_prior(k, unknowns, assumed, camera, work):
    """What the prior adds to g of a pose and intrinsics: its precisions times how far the camera is off the assumed
    one."""
    n = len(unknowns)
    if n > 6:
        store(work, _G + 48, fma(splat(k[8] / k[0]), assumed[0] - camera[0], load(work, _G + 48)))
    if n > 7:
        store(work, _G + 56, fma(splat(k[9]), assumed[3] - camera[3], load(work, _G + 56)))
    if n > 8:
        store(work, _G + 64, fma(splat(k[10]), assumed[4] - camera[4], load(work, _G + 64)))


@lane_jit
def refine(tables, view, images, unknowns, camera, pose, work):
    """Camera and pose at which no image moves any more, from the assumed camera and a pose, and the mask of lanes in
    which they are such."""
    n = len(unknowns)
    k = tables.intrinsics[view]
    zero, one = splat(0.0), splat(1.0)
    assumed = camera
    active, good = one > zero, one > zero
    last = one  # px^2: a first step that is small leaves its square in units of the image, and that is many px
    for step in range(MAX_STEPS):
        if step % RENEWAL == 0:
            write_equations(tables, view, images, unknowns, camera, pose, work)
            good = good & (factor(unknowns, work) | ~active)
        else:
            write_gradient(tables, view, images, unknowns, camera, pose, work)
        if n < 11:
            add_prior(k, unknowns, assumed, camera, work)
        moved = solve(unknowns, work)
        # lanes at rest keep their pose: a lane's digits do not depend on its neighbours
        for j in range(n):
            store(work, _G + 8 * j, select(active, load(work, _G + 8 * j), zero))
        pose = change(pose, work) if n == 11 else turn(pose, work)
        if n < 11:
            camera = move_camera(k, unknowns, camera, work)
        active = active & ~(moved * moved <= splat(LEFT_PX * LEFT_PX) * last)
        last = moved
        if not any_lane(active):
            break
    return camera, pose, good & ~active


@lane_jit
def resect_by_least_squares(tables, view, images, projection, z, estimate, work):
    """One view into ``estimate``, rows and all as of ``lane_resection.resect``, in the object frame.

    projection: rows of :func:`lane_motion.true_projection`.  Images count from the principal point, which stands where
    ``resect`` has the mean image.  Returns the mask of lanes that are at rest.
    """
    n = tables.counts[UNKNOWNS]
    zero, one = splat(0.0), splat(1.0)
    if n == 11:
        (u0, u1, u2, u3), (v0, v1, v2, v3), (w0, w1, w2, w3) = projection
        camera, pose = (one, zero, one, zero, zero), (u0, u1, u2, v0, v1, v2, w0, w1, w2, u3, v3, w3)
    else:
        camera = assumed_camera(tables, view, z)
        pose = pose_at_start(tables, view, projection, camera)
    start, good = pose[11], one < zero
    for unknowns in literal_unroll(LENGTHS):
        if n == len(unknowns):
            camera, pose, good = refine(tables, view, images, unknowns, camera, pose, work)
    focal_u, skew, focal_v, point_u, point_v = camera
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    inverse = one / d2
    focal_u, skew, focal_v = inverse * focal_u, inverse * skew, inverse * focal_v
    r20, r21, r22 = inverse * r20, inverse * r21, inverse * r22
    store(estimate, 0, r20)
    store(estimate, 8, r21)
    store(estimate, 16, r22)
    store(estimate, 24, fma(focal_u, r00, skew * r10))
    store(estimate, 32, fma(focal_u, r01, skew * r11))
    store(estimate, 40, fma(focal_u, r02, skew * r12))
    store(estimate, 48, fma(focal_u, d0, skew * d1))
    store(estimate, 56, focal_v * r10)
    store(estimate, 64, focal_v * r11)
    store(estimate, 72, focal_v * r12)
    store(estimate, 80, focal_v * d1)
    store(estimate, 88, one / dot3(r20, r21, r22, r20, r21, r22))
    store(estimate, 96, point_u)
    store(estimate, 104, point_v)
    # far away no image moves any more, whatever the pose: rest there is no estimate
    return good & (d2 > splat(0.5) * start) & (d2 < splat(2.0) * start)
