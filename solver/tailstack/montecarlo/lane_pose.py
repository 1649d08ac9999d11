"""The pose of eight trials at a time: least squares of the images, the intrinsics as they are assumed.

Fiducials y of the object frame are at ``x = R y + d`` before a view (lengths in the unit of the object frame) and are
imaged at ``u = (f_u x_0 + s x_1) / x_2``, ``v = f_v x_1 / x_2`` from the principal point.  Unknown are a turn w of R,
about the origin of the object frame, and a shift of d: the rows of their slopes are ``a`` (by d) and ``(R y) x a`` (by
w), a the slopes of an image coordinate by x.  The estimate is equivariant to motion, so that the search starts where
the structure truly is in the trial, and what is left of it is what noise makes: a thousandth of the image.  Where the
assumed intrinsics are wrong, the start is shifted so that they image the origin where it truly is.

**Steps** solve the normal equations H step = g.  H is that of the start and held for ``RENEWAL`` steps: what a step
leaves of the last one is some thousandth of it, and g alone says where the estimate is.  ``step'H step = step.g`` is
the sum of squared moves of the images, px^2.  If the moves of two steps are m and m', what is still to come is about
``m'^2 / m``; where that is below ``LEFT_PX``, the lane is at rest.  A target's image moves by no more than that times
its standard deviation in units of the noise, wherever it lies: Cauchy and Schwarz in the metric H.

A lane that does not come to rest, whose H is not positive definite or whose depth is not between half and twice that of
its start is flagged.  There the plain form (``estimation.least_squares``) decides; it starts from the nominal pose and
solves by QR.

Arguments below, lanes unless said:

- ``camera``: assumed f_u, s, f_v and the principal point, px;
- ``pose``: R (9, by rows) and d (3);
- ``tables``, ``images``, ``estimate``: as in ``kernel``.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import any_lane, dot3, factor3, fma, lane_jit, load, select, solve3, splat, square_root, store

LEFT_PX = 1e-11
MAX_STEPS = 16
RENEWAL = 4  # steps with one H


@lane_jit
def assumed_camera(tables, view, z):
    """The intrinsics that the estimator is told."""
    k = tables.intrinsics[view]
    slot = 5 + 2 * tables.counts[1] + view
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
    """Pose in the rows of :func:`lane_motion.true_projection`; where small angles have stretched it, the rows made
    orthogonal one after another.  The origin of the object frame is shifted to where the assumed camera images it as
    the true one does, and as large: a principal point that is wrong by 50 px would otherwise be a step of 50 px."""
    k = tables.intrinsics[view]
    (u0, u1, u2, u3), (v0, v1, v2, v3), (r20, r21, r22, d2) = projection
    one, size = splat(1.0), splat(tables.object_scale[0])
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
    length = one / square_root(dot3(r20, r21, r22, r20, r21, r22))
    r20, r21, r22 = length * r20, length * r21, length * r22
    along = dot3(r10, r11, r12, r20, r21, r22)
    r10, r11, r12 = fma(-along, r20, r10), fma(-along, r21, r11), fma(-along, r22, r12)
    length = one / square_root(dot3(r10, r11, r12, r10, r11, r12))
    r10, r11, r12 = length * r10, length * r11, length * r12
    along = dot3(r00, r01, r02, r20, r21, r22)
    r00, r01, r02 = fma(-along, r20, r00), fma(-along, r21, r01), fma(-along, r22, r02)
    along = dot3(r00, r01, r02, r10, r11, r12)
    r00, r01, r02 = fma(-along, r10, r00), fma(-along, r11, r01), fma(-along, r12, r02)
    length = one / square_root(dot3(r00, r01, r02, r00, r01, r02))
    return length * r00, length * r01, length * r02, r10, r11, r12, r20, r21, r22, d0, d1, d2


@lane_jit
def slopes(tables, images, i, camera, pose):
    """One fiducial: residuals (u, v), px; slopes of u by shift (3) and turn (3); of v likewise, less the first (5)."""
    focal_u, skew, focal_v, point_u, point_v = camera
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    y0, y1, y2 = splat(tables.nominal[i, 0]), splat(tables.nominal[i, 1]), splat(tables.nominal[i, 2])
    x0, x1, x2 = dot3(r00, r01, r02, y0, y1, y2), dot3(r10, r11, r12, y0, y1, y2), dot3(r20, r21, r22, y0, y1, y2)
    inverse = splat(1.0) / (x2 + d2)
    a0, a1, b1 = focal_u * inverse, skew * inverse, focal_v * inverse
    u, v = fma(a0, x0 + d0, a1 * (x1 + d1)), b1 * (x1 + d1)
    a2, b2 = -(u * inverse), -(v * inverse)
    left_u, left_v = (load(images, 16 * i) - point_u) - u, (load(images, 16 * i + 8) - point_v) - v
    a3, a4, a5 = fma(x1, a2, -(x2 * a1)), fma(x2, a0, -(x0 * a2)), fma(x0, a1, -(x1 * a0))
    b3, b4, b5 = fma(x1, b2, -(x2 * b1)), -(x0 * b2), x0 * b1
    return left_u, left_v, a0, a1, a2, a3, a4, a5, b1, b2, b3, b4, b5


@lane_jit
def gradient(tables, view, images, camera, pose):
    """Slopes times residuals, by shift (3) and turn (3)."""
    zero = splat(0.0)
    g0, g1, g2, g3, g4, g5 = zero, zero, zero, zero, zero, zero
    for i in range(tables.counts[0]):
        if tables.products[view, i, 9] != 0.0:  # it is seen
            e, f, a0, a1, a2, a3, a4, a5, b1, b2, b3, b4, b5 = slopes(tables, images, i, camera, pose)
            g0, g1, g2 = fma(e, a0, g0), fma(e, a1, fma(f, b1, g1)), fma(e, a2, fma(f, b2, g2))
            g3, g4, g5 = fma(e, a3, fma(f, b3, g3)), fma(e, a4, fma(f, b4, g4)), fma(e, a5, fma(f, b5, g5))
    return g0, g1, g2, g3, g4, g5


@lane_jit
def normal_equations(tables, view, images, camera, pose):
    """The same, and H: by shift (6 of its upper triangle), by shift and turn (9, by rows), by turn (6)."""
    zero = splat(0.0)
    g0, g1, g2, g3, g4, g5 = zero, zero, zero, zero, zero, zero
    h00, h01, h02, h11, h12, h22 = zero, zero, zero, zero, zero, zero
    h03, h04, h05, h13, h14, h15, h23, h24, h25 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    h33, h34, h35, h44, h45, h55 = zero, zero, zero, zero, zero, zero
    for i in range(tables.counts[0]):
        if tables.products[view, i, 9] != 0.0:
            e, f, a0, a1, a2, a3, a4, a5, b1, b2, b3, b4, b5 = slopes(tables, images, i, camera, pose)
            g0, g1, g2 = fma(e, a0, g0), fma(e, a1, fma(f, b1, g1)), fma(e, a2, fma(f, b2, g2))
            g3, g4, g5 = fma(e, a3, fma(f, b3, g3)), fma(e, a4, fma(f, b4, g4)), fma(e, a5, fma(f, b5, g5))
            h00, h01, h02 = fma(a0, a0, h00), fma(a0, a1, h01), fma(a0, a2, h02)
            h03, h04, h05 = fma(a0, a3, h03), fma(a0, a4, h04), fma(a0, a5, h05)
            h11, h12 = fma(a1, a1, fma(b1, b1, h11)), fma(a1, a2, fma(b1, b2, h12))
            h13, h14 = fma(a1, a3, fma(b1, b3, h13)), fma(a1, a4, fma(b1, b4, h14))
            h15 = fma(a1, a5, fma(b1, b5, h15))
            h22, h23 = fma(a2, a2, fma(b2, b2, h22)), fma(a2, a3, fma(b2, b3, h23))
            h24, h25 = fma(a2, a4, fma(b2, b4, h24)), fma(a2, a5, fma(b2, b5, h25))
            h33, h34 = fma(a3, a3, fma(b3, b3, h33)), fma(a3, a4, fma(b3, b4, h34))
            h35, h44 = fma(a3, a5, fma(b3, b5, h35)), fma(a4, a4, fma(b4, b4, h44))
            h45, h55 = fma(a4, a5, fma(b4, b5, h45)), fma(a5, a5, fma(b5, b5, h55))
    by_shift, by_both = (h00, h01, h02, h11, h12, h22), (h03, h04, h05, h13, h14, h15, h23, h24, h25)
    return (g0, g1, g2, g3, g4, g5), by_shift, by_both, (h33, h34, h35, h44, h45, h55)


@lane_jit
def factor6(a, b, c):
    """A symmetric 6x6 of the blocks A (6), B (9) and C (6) by elimination of the first.

    Returns (factor of A, ``A^-1 B``, factor of ``C - B'A^-1 B``).
    """
    first = factor3(*a)
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = b
    w00, w10, w20 = solve3(first, b00, b10, b20)
    w01, w11, w21 = solve3(first, b01, b11, b21)
    w02, w12, w22 = solve3(first, b02, b12, b22)
    second = factor3(
        c[0] - dot3(b00, b10, b20, w00, w10, w20),
        c[1] - dot3(b00, b10, b20, w01, w11, w21),
        c[2] - dot3(b00, b10, b20, w02, w12, w22),
        c[3] - dot3(b01, b11, b21, w01, w11, w21),
        c[4] - dot3(b01, b11, b21, w02, w12, w22),
        c[5] - dot3(b02, b12, b22, w02, w12, w22),
    )
    return first, (w00, w01, w02, w10, w11, w12, w20, w21, w22), second


@lane_jit
def solve6(factor, g):
    """The six unknowns of a right-hand side of six."""
    first, (w00, w01, w02, w10, w11, w12, w20, w21, w22), second = factor
    g0, g1, g2, g3, g4, g5 = g
    x3, x4, x5 = solve3(
        second,
        g3 - dot3(w00, w10, w20, g0, g1, g2),
        g4 - dot3(w01, w11, w21, g0, g1, g2),
        g5 - dot3(w02, w12, w22, g0, g1, g2),
    )
    x0, x1, x2 = solve3(first, g0, g1, g2)
    return (
        x0 - dot3(w00, w01, w02, x3, x4, x5),
        x1 - dot3(w10, w11, w12, x3, x4, x5),
        x2 - dot3(w20, w21, w22, x3, x4, x5),
        x3, x4, x5,
    )  # fmt: skip


@lane_jit
def turned(scale, c0, c1, c2, x0, x1, x2):
    """A vector turned by ``1 + scale ([c]x + [c]x [c]x)``, scale = 2 / (1 + c'c): Cayley's rotation, exactly one."""
    k0, k1, k2 = fma(c1, x2, -(c2 * x1)), fma(c2, x0, -(c0 * x2)), fma(c0, x1, -(c1 * x0))
    return (
        fma(scale, k0 + fma(c1, k2, -(c2 * k1)), x0),
        fma(scale, k1 + fma(c2, k0, -(c0 * k2)), x1),
        fma(scale, k2 + fma(c0, k1, -(c1 * k0)), x2),
    )


@lane_jit
def move_pose(pose, step):
    """The pose after a step: shift (3), then turn (3)."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    half, one = splat(0.5), splat(1.0)
    c0, c1, c2 = half * step[3], half * step[4], half * step[5]
    scale = splat(2.0) / fma(c0, c0, fma(c1, c1, fma(c2, c2, one)))
    r00, r10, r20 = turned(scale, c0, c1, c2, r00, r10, r20)
    r01, r11, r21 = turned(scale, c0, c1, c2, r01, r11, r21)
    r02, r12, r22 = turned(scale, c0, c1, c2, r02, r12, r22)
    return r00, r01, r02, r10, r11, r12, r20, r21, r22, d0 + step[0], d1 + step[1], d2 + step[2]


@lane_jit
def refine_pose(tables, view, images, camera, pose):
    """The pose at which no image moves any more, and the mask of lanes in which it is one."""
    zero, one = splat(0.0), splat(1.0)
    active, good = one > zero, one > zero
    last = one  # px^2: a first step that is small leaves its square in units of the image, and that is many px
    for step in range(MAX_STEPS):
        if step % RENEWAL == 0:
            g, a, b, c = normal_equations(tables, view, images, camera, pose)
            factor = factor6(a, b, c)
            good = good & ((factor[0][6] & factor[2][6]) | ~active)
        else:
            g = gradient(tables, view, images, camera, pose)
        x0, x1, x2, x3, x4, x5 = solve6(factor, g)
        moved = dot3(x0, x1, x2, g[0], g[1], g[2]) + dot3(x3, x4, x5, g[3], g[4], g[5])
        # lanes at rest keep their pose: a lane's digits do not depend on its neighbours
        x0, x1, x2 = select(active, x0, zero), select(active, x1, zero), select(active, x2, zero)
        x3, x4, x5 = select(active, x3, zero), select(active, x4, zero), select(active, x5, zero)
        pose = move_pose(pose, (x0, x1, x2, x3, x4, x5))
        active = active & ~(moved * moved <= splat(LEFT_PX * LEFT_PX) * last)
        last = moved
        if not any_lane(active):
            break
    return pose, good & ~active


@lane_jit
def resect_pose(tables, view, images, projection, z, estimate):
    """Pose of one view into ``estimate``, rows and all as of ``lane_resection.resect``, in the object frame.

    projection: rows of :func:`lane_motion.true_projection`.  Images count from the assumed principal point, which
    stands where ``resect`` has the mean image.  Returns the mask of lanes that are at rest.
    """
    camera = assumed_camera(tables, view, z)
    start = pose_at_start(tables, view, projection, camera)
    pose, good = refine_pose(tables, view, images, camera, start)
    focal_u, skew, focal_v, point_u, point_v = camera
    r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2 = pose
    inverse = splat(1.0) / d2
    focal_u, skew, focal_v = inverse * focal_u, inverse * skew, inverse * focal_v
    store(estimate, 0, inverse * r20)
    store(estimate, 8, inverse * r21)
    store(estimate, 16, inverse * r22)
    store(estimate, 24, fma(focal_u, r00, skew * r10))
    store(estimate, 32, fma(focal_u, r01, skew * r11))
    store(estimate, 40, fma(focal_u, r02, skew * r12))
    store(estimate, 48, fma(focal_u, d0, skew * d1))
    store(estimate, 56, focal_v * r10)
    store(estimate, 64, focal_v * r11)
    store(estimate, 72, focal_v * r12)
    store(estimate, 80, focal_v * d1)
    store(estimate, 88, d2 * d2)
    store(estimate, 96, point_u)
    store(estimate, 104, point_v)
    # far away no image moves any more, whatever the pose: rest there is no estimate
    return good & (d2 > splat(0.5) * start[11]) & (d2 < splat(2.0) * start[11])
