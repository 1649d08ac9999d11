"""The full nonlinear chain, eight trials at a time: draw, image, resect, triangulate, on to the tool.

What a function is given, in flat float64 arrays of vectors of eight lanes (vector k begins at 8 k):

=============  =================  ============================================================================
argument       vectors            meaning
=============  =================  ============================================================================
``tables``                        the compiled system (``tables.Tables``)
``z``          d                  standardised deviates, in the order of ``plan``
``points``     3 N                fiducials with their manufacturing errors, object frame
``images``     2 N                noisy images (u, v) of the fiducials in one view, px from their nominal mean
``estimates``  14 V               of each view: a (3), p1 (4), p2 (4), 1 / |a|^2, mean u, mean v (``resect``)
``pose``       (3 + V) x 12       of each mount, and of the motion before each shot: rotation (9, by rows), translation
                                  (3, mm)
``work``       154                scratch of ``lane_least_squares``
``results``    6 T + 2            of each target: TCP error (3, tcp, mm), localisation error (3, con, mm); then the
                                  flag of lanes that are not proven, and the RMS reprojection error, px
=============  =================  ============================================================================

Resection: ``lane_resection`` by DLT, ``lane_least_squares`` by the images' residuals.

**Triangulation.**  Rows ``(u_t p3 - p1) / |a|`` (Eq 5), normal matrix ``[[M, b], [b', c]]``; (M - lam) y = -b with
lam the Rayleigh quotient of (y, 1), fixed factor of M.  ``lam < 4 det M / tr(M)^2 <= lambda_min(M)`` proves
the smallest.  The rows are the same whatever the coordinates; what is minimised is their sum of squares over the
squared homogeneous length, the rows of a view multiplied by a factor of their weight.  In plain connector millimetres
(the published form), or in Hartley's frame of coordinates that an affine map has moved, that length is a quadratic form
B of (y, 1), and ``(N - lam B) (y, 1) = 0``.  Least squares of the target's images go on from there by Gauss-Newton
steps.

A lane that fails a proof, does not converge or is not finite is flagged; the caller redoes it by the plain form.

Norms and moments of a block are summed in eight partial sums: lane k sums trials k, k + 8, ...; the lanes are then
added in order, and what does not fill eight last.  That is one fixed order of summation on every machine.
"""

# mypy: ignore-errors
from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from .lane_least_squares import WORK, resect_by_least_squares
from .lane_motion import (
    growth,
    image_fiducials,
    image_shift,
    move_error,
    place_points,
    rotate,
    true_projection,
    write_mount,
)
from .lane_resection import carry_to_object_frame, resect, squared_reprojection
from .lanes import (
    absolute,
    any_lane,
    dot3,
    factor3,
    fma,
    lane_entry,
    lane_jit,
    load,
    select,
    solve3,
    splat,
    square_root,
    store,
)
from .streams import fill_deviates
from .tables import (
    BY_IMAGES,
    DEVIATES,
    EQ18,
    EXECUTION,
    FIDUCIALS,
    FLANGE,
    GROWING,
    HAND_EYE,
    HIDDEN,
    MANUFACTURED,
    PUBLISHED,
    SEAT,
    SHIFTING,
    TARGETS,
    UNKNOWNS,
    VIEWS,
    moves,
    shot_slot,
)

STEP = 1e-12  # last step of the triangulation, relative
MAX_STEPS = 6
FIT_STEPS = 16  # of the target's images
RESULTS = 6  # per target: tcp (3), localisation (3)


@lane_jit
def scratch_size(counts):
    """Doubles of scratch: deviates, points, images of one view, a and p1, p2 per view, rotations, results, and what
    least squares take."""
    n, v, t, d = counts[FIDUCIALS], counts[VIEWS], counts[TARGETS], counts[DEVIATES]
    return 8 * (d + 3 * n + 2 * n + 12 * v + 2 * v + 12 * (3 + v) + RESULTS * t + 8 + WORK)


@lane_jit
def target_image(tables, target, view, row, z):
    """Noisy image of a target along u (row = 0) or v, px from the fiducials' nominal mean image."""
    n = tables.counts[FIDUCIALS]
    deviate = load(z, 16 * view * (n + tables.counts[TARGETS]) + 16 * (n + target) + 8 * row)
    image = fma(splat(tables.noise[view, 1]), deviate, splat(tables.target_images[target, view, row]))
    if tables.counts[SHIFTING] != 0:
        image = image + image_shift(tables, view, n + target, row, z)
    return image


@lane_jit
def target_row(estimates, at, row, image):
    """Row of Eq 5 of one view's estimate (at ``at``), for an image along u (row = 0) or v, less its scale (4)."""
    t = image - load(estimates, at + 96 + 8 * row)
    p = at + 24 + 32 * row
    return (
        fma(t, load(estimates, at), -load(estimates, p)),
        fma(t, load(estimates, at + 8), -load(estimates, p + 8)),
        fma(t, load(estimates, at + 16), -load(estimates, p + 16)),
        t - load(estimates, p + 24),
    )


@lane_jit
def normal_matrix(tables, target, estimates, z):
    """``[[M, b], [b', c]]`` of the rows of all views: (m00, m01, m02, m11, m12, m22, b0, b1, b2, c)."""
    zero = splat(0.0)
    m00, m01, m02, m11, m12, m22, b0, b1, b2, c = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for view in range(tables.counts[VIEWS]):
        at = 112 * view
        weight = load(estimates, at + 88)
        factor = tables.row_factors[target, view]
        f00, f10, f11 = splat(factor[0]), splat(factor[1]), splat(factor[2])
        u0, u1, u2, u3 = target_row(estimates, at, 0, target_image(tables, target, view, 0, z))
        v0, v1, v2, v3 = target_row(estimates, at, 1, target_image(tables, target, view, 1, z))
        u0, u1, u2, u3 = fma(f10, v0, f00 * u0), fma(f10, v1, f00 * u1), fma(f10, v2, f00 * u2), fma(f10, v3, f00 * u3)
        v0, v1, v2, v3 = f11 * v0, f11 * v1, f11 * v2, f11 * v3
        for row in range(2):
            r0, r1, r2, r3 = (u0, u1, u2, u3) if row == 0 else (v0, v1, v2, v3)
            h0, h1, h2, h3 = weight * r0, weight * r1, weight * r2, weight * r3
            m00, m01, m02, b0 = fma(h0, r0, m00), fma(h0, r1, m01), fma(h0, r2, m02), fma(h0, r3, b0)
            m11, m12, b1 = fma(h1, r1, m11), fma(h1, r2, m12), fma(h1, r3, b1)
            m22, b2, c = fma(h2, r2, m22), fma(h2, r3, b2), fma(h3, r3, c)
    return m00, m01, m02, m11, m12, m22, b0, b1, b2, c


@lane_jit
def triangulate(tables, target, estimates, z):
    """Target in the object frame from all views: (y0, y1, y2, mask of proven lanes)."""
    one, zero = splat(1.0), splat(0.0)
    m00, m01, m02, m11, m12, m22, b0, b1, b2, c = normal_matrix(tables, target, estimates, z)
    f = factor3(m00, m01, m02, m11, m12, m22)
    y0, y1, y2 = solve3(f, -b0, -b1, -b2)
    active = one > zero
    eigenvalue = zero
    for _ in range(MAX_STEPS):
        e0 = fma(m00, y0, fma(m01, y1, fma(m02, y2, b0)))
        e1 = fma(m01, y0, fma(m11, y1, fma(m12, y2, b1)))
        e2 = fma(m02, y0, fma(m12, y1, fma(m22, y2, b2)))
        e3 = fma(b0, y0, fma(b1, y1, fma(b2, y2, c)))
        norm2 = fma(y0, y0, fma(y1, y1, fma(y2, y2, one)))
        eigenvalue = fma(e0, y0, fma(e1, y1, fma(e2, y2, e3))) / norm2
        x0, x1, x2 = solve3(f, fma(-eigenvalue, y0, e0), fma(-eigenvalue, y1, e1), fma(-eigenvalue, y2, e2))
        y0, y1, y2 = select(active, y0 - x0, y0), select(active, y1 - x1, y1), select(active, y2 - x2, y2)
        step = absolute(x0) + absolute(x1) + absolute(x2)
        active = active & ~(step <= splat(STEP) * square_root(norm2))
        if not any_lane(active):
            break
    trace = m00 + m11 + m22
    proven = eigenvalue * trace * trace * (f[3] * f[4] * f[5]) < splat(4.0)
    return y0, y1, y2, f[6] & proven & ~active


@lane_jit
def triangulate_in_metric(tables, target, estimates, z, metric):
    """The same for the length ``k y'y + 2 g'y + h`` of (y, 1) instead of ``y'y + 1``; metric: k, g (3), h."""
    one, zero = splat(1.0), splat(0.0)
    m00, m01, m02, m11, m12, m22, b0, b1, b2, c = normal_matrix(tables, target, estimates, z)
    k, g0, g1, g2, h = metric
    f = factor3(m00, m01, m02, m11, m12, m22)
    y0, y1, y2 = solve3(f, -b0, -b1, -b2)
    active = one > zero
    eigenvalue, tau = zero, zero
    for step in range(MAX_STEPS + 1):
        e0 = fma(m00, y0, fma(m01, y1, fma(m02, y2, b0)))
        e1 = fma(m01, y0, fma(m11, y1, fma(m12, y2, b1)))
        e2 = fma(m02, y0, fma(m12, y1, fma(m22, y2, b2)))
        e3 = fma(b0, y0, fma(b1, y1, fma(b2, y2, c)))
        q0, q1, q2 = fma(k, y0, g0), fma(k, y1, g1), fma(k, y2, g2)
        q3 = fma(g0, y0, fma(g1, y1, fma(g2, y2, h)))
        norm2 = fma(q0, y0, fma(q1, y1, fma(q2, y2, q3)))
        eigenvalue = fma(e0, y0, fma(e1, y1, fma(e2, y2, e3))) / norm2
        if step == 0:
            # A Rayleigh quotient is not below the smallest eigenvalue; if M - tau K is positive definite no other lies
            # below tau.  Rounding makes the quotient of the last step a little larger than that of the first.
            tau = eigenvalue + splat(1e-9) * (m00 + m11 + m22) / (k + k + k)
            f = factor3(fma(-tau, k, m00), m01, m02, fma(-tau, k, m11), m12, fma(-tau, k, m22))
        x0, x1, x2 = solve3(f, fma(-eigenvalue, q0, e0), fma(-eigenvalue, q1, e1), fma(-eigenvalue, q2, e2))
        y0, y1, y2 = select(active, y0 - x0, y0), select(active, y1 - x1, y1), select(active, y2 - x2, y2)
        size = absolute(x0) + absolute(x1) + absolute(x2)
        active = active & ~(size <= splat(STEP) * (one + absolute(y0) + absolute(y1) + absolute(y2)))
        if not any_lane(active):
            break
    return y0, y1, y2, f[6] & (eigenvalue <= tau) & ~active


@lane_jit
def fit_images(tables, target, estimates, z, y0, y1, y2):
    """The target whose images are off least, by steps from a point: (y0, y1, y2, mask of lanes that are at rest)."""
    one, zero = splat(1.0), splat(0.0)
    active = one > zero
    for _ in range(FIT_STEPS):
        h00, h01, h02, h11, h12, h22, g0, g1, g2 = zero, zero, zero, zero, zero, zero, zero, zero, zero
        for view in range(tables.counts[VIEWS]):
            at = 112 * view
            a0, a1, a2 = load(estimates, at), load(estimates, at + 8), load(estimates, at + 16)
            inverse = one / fma(a0, y0, fma(a1, y1, fma(a2, y2, one)))
            for row in range(2):
                image = target_image(tables, target, view, row, z)
                r0, r1, r2, r3 = target_row(estimates, at, row, image)
                left = inverse * fma(r0, y0, fma(r1, y1, fma(r2, y2, r3)))
                # a row of Eq 5 at the image where the point is imaged, (t - left) p3 - p, is its slope but for -depth
                r0, r1, r2 = inverse * fma(left, a0, -r0), inverse * fma(left, a1, -r1), inverse * fma(left, a2, -r2)
                h00, h01, h02, g0 = fma(r0, r0, h00), fma(r0, r1, h01), fma(r0, r2, h02), fma(r0, left, g0)
                h11, h12, g1 = fma(r1, r1, h11), fma(r1, r2, h12), fma(r1, left, g1)
                h22, g2 = fma(r2, r2, h22), fma(r2, left, g2)
        f = factor3(h00, h01, h02, h11, h12, h22)
        x0, x1, x2 = solve3(f, g0, g1, g2)
        y0, y1, y2 = select(active, y0 + x0, y0), select(active, y1 + x1, y1), select(active, y2 + x2, y2)
        size = absolute(x0) + absolute(x1) + absolute(x2)
        active = active & ~(size <= splat(STEP) * (one + absolute(y0) + absolute(y1) + absolute(y2)))
        if not any_lane(active):
            break
    return y0, y1, y2, ~active


@lane_jit
def point_metric(tables, pose):
    """Metric of :func:`triangulate_in_metric`, of con mm.

    A point is ``X = R (E y + c - p) + p + t``, the second and third with Eq 18 only, and its homogeneous length
    ``|X|^2 + 1``: k the square of the unit of y, ``g = E'R'c'``, ``h = c'c' + 1``, c' the centroid as it is assumed.
    """
    one = splat(1.0)
    c0, c1, c2 = splat(tables.centre[0]), splat(tables.centre[1]), splat(tables.centre[2])
    if tables.counts[EQ18] != 0 and moves(tables.counts, SEAT):
        p0, p1, p2 = splat(tables.pivots[SEAT, 0]), splat(tables.pivots[SEAT, 1]), splat(tables.pivots[SEAT, 2])
        m0, m1, m2 = rotate(pose, SEAT, c0 - p0, c1 - p1, c2 - p2)
        m0, m1, m2 = m0 + p0 + load(pose, 72), m1 + p1 + load(pose, 80), m2 + p2 + load(pose, 88)
        h = fma(m0, m0, fma(m1, m1, fma(m2, m2, one)))
        c0 = dot3(load(pose, 0), load(pose, 24), load(pose, 48), m0, m1, m2)
        c1 = dot3(load(pose, 8), load(pose, 32), load(pose, 56), m0, m1, m2)
        c2 = dot3(load(pose, 16), load(pose, 40), load(pose, 64), m0, m1, m2)
    else:
        h = fma(c0, c0, fma(c1, c1, fma(c2, c2, one)))
    e = tables.out_of_frame
    g0 = dot3(splat(e[0]), splat(e[3]), splat(e[6]), c0, c1, c2)
    g1 = dot3(splat(e[1]), splat(e[4]), splat(e[7]), c0, c1, c2)
    g2 = dot3(splat(e[2]), splat(e[5]), splat(e[8]), c0, c1, c2)
    return splat(tables.object_scale[1]), g0, g1, g2, h


@lane_jit
def chain_errors(tables, target, pose, z, y0, y1, y2, results):
    """Localisation error (con) and TCP error (tcp) of one target into ``results`` (6 vectors)."""
    nominal = tables.targets_frame[target]
    y0, y1, y2 = y0 - splat(nominal[0]), y1 - splat(nominal[1]), y2 - splat(nominal[2])
    e = tables.out_of_frame
    e0 = dot3(splat(e[0]), splat(e[1]), splat(e[2]), y0, y1, y2)
    e1 = dot3(splat(e[3]), splat(e[4]), splat(e[5]), y0, y1, y2)
    e2 = dot3(splat(e[6]), splat(e[7]), splat(e[8]), y0, y1, y2)
    if tables.counts[EQ18] != 0 and moves(tables.counts, SEAT):
        # Eq 18: the estimate stands in the coordinates that were assumed, X = T_err1 (E y + c)
        e0, e1, e2 = move_error(tables, SEAT, pose, tables.targets[target], e0, e1, e2)
    store(results, 24, e0)
    store(results, 32, e1)
    store(results, 40, e2)
    if moves(tables.counts, FLANGE):
        e0, e1, e2 = move_error(tables, FLANGE, pose, tables.targets[target], e0, e1, e2)
    if tables.counts[GROWING] != 0:
        n = tables.counts[FIDUCIALS]
        e0, e1, e2 = e0 + growth(tables, z, n, 0), e1 + growth(tables, z, n, 1), e2 + growth(tables, z, n, 2)
    r = tables.to_tcp
    t0 = dot3(splat(r[0]), splat(r[1]), splat(r[2]), e0, e1, e2)
    t1 = dot3(splat(r[3]), splat(r[4]), splat(r[5]), e0, e1, e2)
    t2 = dot3(splat(r[6]), splat(r[7]), splat(r[8]), e0, e1, e2)
    if moves(tables.counts, HAND_EYE):
        t0, t1, t2 = move_error(tables, HAND_EYE, pose, tables.targets_tcp[target], t0, t1, t2)
    t0 = t0 + splat(tables.execution_bias[0])
    t1 = t1 + splat(tables.execution_bias[1])
    t2 = t2 + splat(tables.execution_bias[2])
    offset, k = tables.gain_starts[EXECUTION, 0], tables.gain_starts[EXECUTION, 1]
    for j in range(k):
        xi = load(z, 8 * (tables.starts[1 + EXECUTION] + j))
        t0 = fma(splat(tables.gains[offset + j]), xi, t0)
        t1 = fma(splat(tables.gains[offset + k + j]), xi, t1)
        t2 = fma(splat(tables.gains[offset + 2 * k + j]), xi, t2)
    store(results, 0, t0)
    store(results, 8, t1)
    store(results, 16, t2)


@lane_jit
def run_chain(tables, z, points, images, estimates, pose, results, work, want_reprojection):
    """One group of eight trials from its deviates ``z`` to ``results``; then flag and reprojection RMS."""
    views, targets = tables.counts[VIEWS], tables.counts[TARGETS]
    for slot in range(shot_slot(views, views)):
        if moves(tables.counts, slot):
            write_mount(tables, slot, z, pose)
    if tables.counts[MANUFACTURED] != 0 or tables.counts[GROWING] != 0:
        place_points(tables, z, points)
    good = splat(1.0) > splat(0.0)
    squares, images_used = splat(0.0), 0.0
    for view in range(views):
        projection = true_projection(tables, view, pose)
        image_fiducials(tables, view, points, projection, images, z)
        estimate = estimates[112 * view : 112 * view + 112]
        if tables.counts[UNKNOWNS] != 0:
            good = good & resect_by_least_squares(tables, view, images, projection, z, estimate, work)
        else:
            good = good & resect(tables, view, images, estimate)
            if tables.counts[HIDDEN] != 0:
                carry_to_object_frame(tables, view, estimate)
        images_used += tables.diagonal[view, 3]
        if want_reprojection:
            squares = squares + squared_reprojection(tables, view, images, estimate)
    for target in range(targets):
        if tables.counts[PUBLISHED] != 0:
            y0, y1, y2, proven = triangulate_in_metric(tables, target, estimates, z, point_metric(tables, pose))
        else:
            y0, y1, y2, proven = triangulate(tables, target, estimates, z)
        good = good & proven
        if tables.counts[BY_IMAGES] != 0:
            y0, y1, y2, at_rest = fit_images(tables, target, estimates, z, y0, y1, y2)
            good = good & at_rest
        chain_errors(tables, target, pose, z, y0, y1, y2, results[48 * target : 48 * target + 48])
    at = 48 * targets
    store(results, at, select(good, splat(0.0), splat(1.0)))
    store(results, at + 8, square_root(squares / splat(images_used)))


class Draws(NamedTuple):
    """Which trials to run, n of them, a multiple of 8."""

    keys: NDArray[np.uint64]  # (2,) of the streams of installation and shot
    units: NDArray[np.int64]  # (n,) index of the installed unit of each trial
    trials: NDArray[np.int64]  # (n,) index of each trial
    given: Array  # (d, n) standardised deviates; (0, 0): they are drawn from the keys


class Results(NamedTuple):
    """Where the results of n trials go."""

    errors: Array  # (6 T n,) mm: target, metric (TCP, localisation), axis, trial
    flags: Array  # (n,) not 0 where a trial has to be redone
    reprojection: Array  # (n,) px RMS; (0,): not wanted


@lane_entry
def run_trials(tables, draws, results_of, scratch):
    """Run trials in groups of eight.

    tables: ``tables.Tables``; draws: ``Draws``; results_of: ``Results``, filled; scratch: as many float64 as
    ``scratch_size`` says, 64-byte aligned.
    """
    trials = draws.trials
    want_reprojection = results_of.reprojection.size > 0
    counts = tables.counts
    n, views, targets, d = counts[FIDUCIALS], counts[VIEWS], counts[TARGETS], counts[DEVIATES]
    at = 0
    z = scratch[at : at + 8 * d]
    at += 8 * d
    points = scratch[at : at + 24 * n]
    at += 24 * n
    images = scratch[at : at + 16 * n]
    at += 16 * n
    estimates = scratch[at : at + 112 * views]
    at += 112 * views
    pose = scratch[at : at + 96 * (3 + views)]
    at += 96 * (3 + views)
    results = scratch[at : at + 48 * targets + 16]
    at += 48 * targets + 16
    work = scratch[at : at + 8 * WORK]
    for i in range(n):
        for c in range(3):
            store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]))
    rows = 6 * targets
    for group in range(0, trials.size, 8):
        if draws.given.shape[0] > 0:
            for k in range(d):
                for lane in range(8):
                    z[8 * k + lane] = draws.given[k, group + lane]
        else:
            fill_deviates(tables.segments, 0, draws.keys[0], load(draws.units, group), z)
            fill_deviates(tables.segments, 1, draws.keys[1], load(trials, group), z)
        run_chain(tables, z, points, images, estimates, pose, results, work, want_reprojection)
        for row in range(rows):
            store(results_of.errors, row * trials.size + group, load(results, 8 * row))
        store(results_of.flags, group, load(results, 8 * rows))
        if want_reprojection:
            store(results_of.reprojection, group, load(results, 8 * rows + 8))


@lane_jit
def lane_sum(lanes, row):
    """Sum of the eight numbers of vector ``row``, in order."""
    total = 0.0
    for k in range(8):
        total += lanes[8 * row + k]
    return total


@lane_entry
def reduce_block(errors, n, norms, mean, scatter, norm_mean, lanes):
    """Norms and moments of m error metrics over n trials.

    errors: (3 m n,) mm, metric by metric and axis by axis; n: trials.  Filled: norms (m n,) mm, mean (m, 3) mm, scatter
    about it (m, 3, 3) mm^2, norm_mean (m,) mm.  lanes: scratch of 48.  The norm is written without fused operations so
    that the last, incomplete eight have the digits they would have in a longer run.
    """
    zero = splat(0.0)
    whole = n - n % 8
    for m in range(norm_mean.size):
        at = 3 * m * n
        sx, sy, sz, sn = zero, zero, zero, zero
        for i in range(0, whole, 8):
            x, y, z = load(errors, at + i), load(errors, at + n + i), load(errors, at + 2 * n + i)
            norm = square_root(x * x + y * y + z * z)
            store(norms, m * n + i, norm)
            sx, sy, sz, sn = sx + x, sy + y, sz + z, sn + norm
        store(lanes, 0, sx)
        store(lanes, 8, sy)
        store(lanes, 16, sz)
        store(lanes, 24, sn)
        tx, ty, tz, tn = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2), lane_sum(lanes, 3)
        for i in range(whole, n):
            x, y, z = errors[at + i], errors[at + n + i], errors[at + 2 * n + i]
            norms[m * n + i] = sqrt(x * x + y * y + z * z)
            tx, ty, tz, tn = tx + x, ty + y, tz + z, tn + norms[m * n + i]
        ax, ay, az = tx / n, ty / n, tz / n
        mean[m, 0], mean[m, 1], mean[m, 2], norm_mean[m] = ax, ay, az, tn / n

        xx, xy, xz, yy, yz, zz = zero, zero, zero, zero, zero, zero
        for i in range(0, whole, 8):
            x = load(errors, at + i) - splat(ax)
            y = load(errors, at + n + i) - splat(ay)
            z = load(errors, at + 2 * n + i) - splat(az)
            xx, xy, xz = fma(x, x, xx), fma(x, y, xy), fma(x, z, xz)
            yy, yz, zz = fma(y, y, yy), fma(y, z, yz), fma(z, z, zz)
        store(lanes, 0, xx)
        store(lanes, 8, xy)
        store(lanes, 16, xz)
        store(lanes, 24, yy)
        store(lanes, 32, yz)
        store(lanes, 40, zz)
        cxx, cxy, cxz = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2)
        cyy, cyz, czz = lane_sum(lanes, 3), lane_sum(lanes, 4), lane_sum(lanes, 5)
        for i in range(whole, n):
            x, y, z = errors[at + i] - ax, errors[at + n + i] - ay, errors[at + 2 * n + i] - az
            cxx, cxy, cxz = cxx + x * x, cxy + x * y, cxz + x * z
            cyy, cyz, czz = cyy + y * y, cyz + y * z, czz + z * z
        scatter[m, 0, 0], scatter[m, 1, 1], scatter[m, 2, 2] = cxx, cyy, czz
        scatter[m, 0, 1] = scatter[m, 1, 0] = cxy
        scatter[m, 0, 2] = scatter[m, 2, 0] = cxz
        scatter[m, 1, 2] = scatter[m, 2, 1] = cyz
