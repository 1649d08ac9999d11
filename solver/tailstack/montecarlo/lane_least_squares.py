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

from .lane_motion import act
from .lanes import (
    add,
    any_lane,
    cross,
    dot,
    fma,
    join,
    lane_jit,
    load,
    loads,
    multiply,
    negative,
    repeat,
    select,
    splat,
    splats,
    store,
    times,
)
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
    wrong = act(tables, intrinsics_slot(tables.counts[VIEWS], view), 0, z, splats(k[5:], 3))
    nominal = splats(k, 5)
    larger = multiply(splat(1.0) + wrong[0], nominal[0:3])
    return larger + add(nominal[3:5], wrong[1:3])


@lane_jit
def pose_at_start(tables, view, projection, camera):
    """Pose in the rows of :func:`lane_motion.true_projection`, which are those of a rotation.

    The origin of the object frame is shifted to where the assumed camera images it as the true one does, and as large:
    a principal point that is wrong by 50 px would otherwise be a step of 50 px.
    """
    k = tables.intrinsics[view]
    size, skew = splat(tables.object_scale[0]), splat(k[1])
    u, v, w = multiply(size, projection[0]), multiply(size, projection[1]), multiply(size, projection[2])
    focal_u, focal_v = splat(1.0 / k[0]), splat(1.0 / k[2])
    # the principal point: the true one for the rotation, the assumed one for the shift
    point_u, point_v = splat(k[3]), splat(k[4])
    v = multiply(focal_v, fma(negative((point_v, point_v, point_v, camera[4])), w, v))
    u = multiply(focal_u, fma(-skew, v, fma(negative((point_u, point_u, point_u, camera[3])), w, u)))
    return u[0:3] + v[0:3] + w[0:3] + (u[3], v[3], camera[2] / splat(k[2]) * w[3])


@lane_jit
def image(tables, images, i, camera, pose):
    """One fiducial: M y (3), 1 / x_2, p, r, u, v from the principal point, and how far its image is off them, px."""
    focal_u, skew, focal_v, point_u, point_v = camera
    x = times(pose[0:9], splats(tables.nominal[i], 3))
    d0, d1, d2 = pose[9:12]
    inverse = splat(1.0) / (x[2] + d2)
    p, r = inverse * (x[0] + d0), inverse * (x[1] + d1)
    u, v = fma(focal_u, p, skew * r), focal_v * r
    e, f = (load(images, 16 * i) - point_u) - u, (load(images, 16 * i + 8) - point_v) - v
    return x, inverse, p, r, u, v, e, f


@lane_jit
def write_gradient(tables, view, images, unknowns, camera, pose, work):
    """g of the images: the slopes times what the images are off.

    What a fiducial's image is off pulls it by q: a shift gets q, a turn ``M y x q``, M ``q y'``.
    """
    n = len(unknowns)
    k = tables.intrinsics[view]
    focal_u, skew, focal_v, _, _ = camera
    zero = splat(0.0)
    shift, turned, grown = repeat(zero, 3), repeat(zero, 3), repeat(zero, 3)
    rows = repeat(zero, 9)
    for i in range(tables.counts[FIDUCIALS]):
        if tables.products[view, i, 9] != 0.0:  # it is seen
            x, inverse, p, r, u, v, e, f = image(tables, images, i, camera, pose)
            if 6 < n < 11:
                by_focal = fma(splat(k[0]), p, splat(k[1]) * r)
                grown = fma(e, by_focal, fma(f, splat(k[2]) * r, grown[0])), grown[1] + e, grown[2] + f
            e, f = inverse * e, inverse * f
            q = e * focal_u, fma(e, skew, f * focal_v), -fma(e, u, f * v)
            shift = add(shift, q)
            if n == 11:
                y = splats(tables.nominal[i], 3)
                rows = fma(repeat(q[0], 3) + repeat(q[1], 3) + repeat(q[2], 3), y + y + y, rows)
            else:
                back = fma(negative((x[2], x[0], x[1])), (q[1], q[2], q[0]), turned)
                turned = fma((x[1], x[2], x[0]), (q[2], q[0], q[1]), back)
    if n == 11:
        store(work, _G, shift[0:2] + rows)
    else:
        store(work, _G, shift + turned)
    if 6 < n < 11:
        store(work, _G + 48, grown)


@lane_jit
def write_slopes(tables, view, images, i, unknowns, camera, pose, work):
    """Slopes of u and v of one fiducial by the unknowns; returns how far its image is off, px."""
    n = len(unknowns)
    k = tables.intrinsics[view]
    focal_u, skew, focal_v, _, _ = camera
    x, inverse, p, r, u, v, e, f = image(tables, images, i, camera, pose)
    zero, one = splat(0.0), splat(1.0)
    a0, a1, a2 = inverse * focal_u, inverse * skew, -(inverse * u)
    b1, b2 = inverse * focal_v, -(inverse * v)
    if n == 11:
        y = splats(tables.nominal[i], 3)
        store(work, 0, join((a0, a1), multiply(a0, y) + multiply(a1, y) + multiply(a2, y)))
        store(work, _V, join((zero, b1, zero, zero, zero), multiply(b1, y) + multiply(b2, y)))
    else:
        a = a0, a1, a2
        store(work, 0, a + cross(x, a))
        store(work, _V, (zero, b1, b2, fma(x[1], b2, -(x[2] * b1)), -(x[0] * b2), x[0] * b1))
    if 6 < n < 11:
        store(work, 48, (fma(splat(k[0]), p, splat(k[1]) * r), one, zero))
        store(work, _V + 48, (splat(k[2]) * r, zero, one))
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
def turn_vector(scale, c, x):
    """A vector turned by ``1 + scale ([c]x + [c]x [c]x)``, scale = 2 / (1 + c'c): Cayley's rotation, exactly one."""
    k = cross(c, x)
    return fma(scale, add(k, cross(c, k)), x)


@lane_jit
def turn(pose, work):
    """The pose after a step: shift (3), then turn (3)."""
    c = multiply(splat(0.5), loads(work, _G + 24, 3))
    whole = join(c, splat(1.0))
    scale = splat(2.0) / dot(whole, whole)
    r00, r10, r20 = turn_vector(scale, c, (pose[0], pose[3], pose[6]))
    r01, r11, r21 = turn_vector(scale, c, (pose[1], pose[4], pose[7]))
    r02, r12, r22 = turn_vector(scale, c, (pose[2], pose[5], pose[8]))
    return join((r00, r01, r02, r10, r11, r12, r20, r21, r22), add(pose[9:12], loads(work, _G, 3)))


@lane_jit
def change(pose, work):
    """The projection after a step of eleven unknowns: the shift but for its depth (2), then M (9)."""
    return add(pose[0:9], loads(work, _G + 16, 9)) + add(pose[9:11], loads(work, _G, 2)) + pose[11:12]


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
        u, v, w = projection
        camera, pose = (one, zero, one, zero, zero), u[0:3] + v[0:3] + w[0:3] + (u[3], v[3], w[3])
    else:
        camera = assumed_camera(tables, view, z)
        pose = pose_at_start(tables, view, projection, camera)
    start, good = pose[11], one < zero
    for unknowns in literal_unroll(LENGTHS):
        if n == len(unknowns):
            camera, pose, good = refine(tables, view, images, unknowns, camera, pose, work)
    depth = pose[11]
    inverse = one / depth
    focal_u, skew, focal_v = multiply(inverse, camera[0:3])
    u, v, third = pose[0:3] + pose[9:10], pose[3:6] + pose[10:11], multiply(inverse, pose[6:9])
    rows = fma(focal_u, u, multiply(skew, v)) + multiply(focal_v, v)
    store(estimate, 0, third + rows + (one / dot(third, third),) + camera[3:5])
    # far away no image moves any more, whatever the pose: rest there is no estimate
    return good & (depth > splat(0.5) * start) & (depth < splat(2.0) * start)
