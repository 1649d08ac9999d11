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
    act,
    add_noise,
    carry_on,
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
    add,
    add_square,
    add_to_diagonal,
    any_lane,
    dot,
    factor3,
    fma,
    join,
    lane_entry,
    lane_jit,
    load,
    loads,
    multiply,
    negative,
    repeat,
    select,
    size_of,
    solve3,
    splat,
    splats,
    square_root,
    store,
    subtract,
    symmetric_times,
    times,
    times_from_left,
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
def target_image(tables, target, view, z):
    """Noisy image (u, v) of a target, px from the fiducials' nominal mean image."""
    n = tables.counts[FIDUCIALS]
    deviates = loads(z, 16 * view * (n + tables.counts[TARGETS]) + 16 * (n + target), 2)
    image = add_noise(tables, view, 1, deviates, splats(tables.target_images[target, view], 2))
    return add(image, image_shift(tables, view, n + target, z)) if tables.counts[SHIFTING] != 0 else image


@lane_jit
def target_row(estimates, at, row, image):
    """Row of Eq 5 of one view's estimate (at ``at``), for an image along u (row = 0) or v, less its scale (4)."""
    third = join(loads(estimates, at, 3), splat(1.0))
    return fma(image - load(estimates, at + 96 + 8 * row), third, negative(loads(estimates, at + 24 + 32 * row, 4)))


@lane_jit
def normal_matrix(tables, target, estimates, z):
    """``[[M, b], [b', c]]`` of the rows of all views: a symmetric 4x4."""
    g = repeat(splat(0.0), 10)
    for view in range(tables.counts[VIEWS]):
        at = 112 * view
        weight = load(estimates, at + 88)
        f00, f10, f11 = splats(tables.row_factors[target, view], 3)
        image = target_image(tables, target, view, z)
        u, v = target_row(estimates, at, 0, image[0]), target_row(estimates, at, 1, image[1])
        u = fma(f10, v, multiply(f00, u))
        v = multiply(f11, v)
        g = add_square(g, multiply(weight, u), u)
        g = add_square(g, multiply(weight, v), v)
    return g


@lane_jit
def triangulate(tables, target, estimates, z):
    """Target in the object frame from all views: (y (3), mask of proven lanes)."""
    one, zero = splat(1.0), splat(0.0)
    g = normal_matrix(tables, target, estimates, z)
    f = factor3(g)
    y = solve3(f, negative((g[3], g[6], g[8])))
    active = one > zero
    eigenvalue = zero
    for _ in range(MAX_STEPS):
        point = join(y, one)
        e = symmetric_times(g, point)
        norm2 = dot(point, point)
        eigenvalue = dot(e, point) / norm2
        step = solve3(f, fma(-eigenvalue, y, e[0:3]))
        y = select(active, subtract(y, step), y)
        active = active & ~(size_of(step) <= splat(STEP) * square_root(norm2))
        if not any_lane(active):
            break
    trace = g[0] + g[4] + g[7]
    proven = eigenvalue * trace * trace * (f[3] * f[4] * f[5]) < splat(4.0)
    return y, f[6] & proven & ~active


@lane_jit
def triangulate_in_metric(tables, target, estimates, z, metric):
    """The same for the length ``k y'y + 2 c'y + h`` of (y, 1) instead of ``y'y + 1``; metric: k, c (3), h."""
    one, zero = splat(1.0), splat(0.0)
    g = normal_matrix(tables, target, estimates, z)
    k, c, h = metric
    f = factor3(g)
    y = solve3(f, negative((g[3], g[6], g[8])))
    active = one > zero
    eigenvalue, tau = zero, zero
    for step in range(MAX_STEPS + 1):
        point = join(y, one)
        e = symmetric_times(g, point)
        q = join(fma(k, y, c), dot(join(c, h), point))
        eigenvalue = dot(e, point) / dot(q, point)
        if step == 0:
            # A Rayleigh quotient is not below the smallest eigenvalue; if M - tau K is positive definite no other lies
            # below tau.  Rounding makes the quotient of the last step a little larger than that of the first.
            tau = eigenvalue + splat(1e-9) * (g[0] + g[4] + g[7]) / (k + k + k)
            f = factor3(add_to_diagonal(g, -tau, (k, k, k, zero)))
        x = solve3(f, fma(-eigenvalue, q[0:3], e[0:3]))
        y = select(active, subtract(y, x), y)
        active = active & ~(size_of(x) <= splat(STEP) * (one + absolute(y[0]) + absolute(y[1]) + absolute(y[2])))
        if not any_lane(active):
            break
    return y, f[6] & (eigenvalue <= tau) & ~active


@lane_jit
def fit_images(tables, target, estimates, z, y):
    """The target whose images are off least, by steps from a point y (3): (y, mask of lanes that are at rest)."""
    one, zero = splat(1.0), splat(0.0)
    active = one > zero
    for _ in range(FIT_STEPS):
        g = repeat(zero, 10)
        point = join(y, one)
        for view in range(tables.counts[VIEWS]):
            at = 112 * view
            third = loads(estimates, at, 3)
            inverse = one / dot(join(third, one), point)
            image = target_image(tables, target, view, z)
            for row in range(2):
                r = target_row(estimates, at, row, image[row])
                left = inverse * dot(r, point)
                # a row of Eq 5 at the image where the point is imaged, (t - left) p3 - p, is its slope but for -depth
                slope = join(multiply(inverse, fma(left, third, negative(r[0:3]))), left)
                g = add_square(g, slope, slope)
        step = solve3(factor3(g), (g[3], g[6], g[8]))
        y = select(active, add(y, step), y)
        active = active & ~(size_of(step) <= splat(STEP) * (one + absolute(y[0]) + absolute(y[1]) + absolute(y[2])))
        if not any_lane(active):
            break
    return y, ~active


@lane_jit
def point_metric(tables, pose):
    """Metric of :func:`triangulate_in_metric`, of con mm.

    A point is ``X = R (E y + c - p) + p + t``, the second and third with Eq 18 only, and its homogeneous length
    ``|X|^2 + 1``: k the square of the unit of y, ``E'R'c'``, ``h = c'c' + 1``, c' the centroid as it is assumed.
    """
    one = splat(1.0)
    centre = splats(tables.centre, 3)
    assumed = centre
    if tables.counts[EQ18] != 0 and moves(tables.counts, SEAT):
        pivot = splats(tables.pivots[SEAT], 3)
        assumed = add(add(rotate(pose, SEAT, subtract(centre, pivot)), pivot), loads(pose, 72, 3))
        centre = times_from_left(assumed, loads(pose, 0, 9))
    g = times_from_left(centre, splats(tables.out_of_frame, 9))
    length = join(assumed, one)
    return splat(tables.object_scale[1]), g, dot(length, length)


@lane_jit
def chain_errors(tables, target, pose, z, y, results):
    """Localisation error (con) and TCP error (tcp) of one target into ``results`` (6 vectors)."""
    e = times(splats(tables.out_of_frame, 9), subtract(y, splats(tables.targets_frame[target], 3)))
    if tables.counts[EQ18] != 0 and moves(tables.counts, SEAT):
        # Eq 18: the estimate stands in the coordinates that were assumed, X = T_err1 (E y + c)
        e = move_error(tables, SEAT, pose, tables.targets[target], e)
    store(results, 24, e)
    if moves(tables.counts, FLANGE):
        e = move_error(tables, FLANGE, pose, tables.targets[target], e)
    if tables.counts[GROWING] != 0:
        e = add(e, growth(tables, z, tables.counts[FIDUCIALS]))
    e = carry_on(tables, z, tables.targets[target], e)
    t = times(splats(tables.to_tcp, 9), e)
    if moves(tables.counts, HAND_EYE):
        t = move_error(tables, HAND_EYE, pose, tables.targets_tcp[target], t)
    t = add(t, splats(tables.execution_bias, 3))
    store(results, 0, act(tables, EXECUTION, 0, z, t))


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
            y, proven = triangulate_in_metric(tables, target, estimates, z, point_metric(tables, pose))
        else:
            y, proven = triangulate(tables, target, estimates, z)
        good = good & proven
        if tables.counts[BY_IMAGES] != 0:
            y, at_rest = fit_images(tables, target, estimates, z, y)
            good = good & at_rest
        chain_errors(tables, target, pose, z, y, results[48 * target : 48 * target + 48])
    at = 48 * targets
    store(results, at, (select(good, splat(0.0), splat(1.0)), square_root(squares / splat(images_used))))


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
        store(points, 24 * i, splats(tables.nominal[i], 3))
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
    whole = n - n % 8
    for m in range(norm_mean.size):
        at = 3 * m * n
        sums = repeat(splat(0.0), 4)
        for i in range(0, whole, 8):
            x, y, z = load(errors, at + i), load(errors, at + n + i), load(errors, at + 2 * n + i)
            norm = square_root(x * x + y * y + z * z)
            store(norms, m * n + i, norm)
            sums = add(sums, (x, y, z, norm))
        store(lanes, 0, sums)
        tx, ty, tz, tn = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2), lane_sum(lanes, 3)
        for i in range(whole, n):
            x, y, z = errors[at + i], errors[at + n + i], errors[at + 2 * n + i]
            norms[m * n + i] = sqrt(x * x + y * y + z * z)
            tx, ty, tz, tn = tx + x, ty + y, tz + z, tn + norms[m * n + i]
        mean[m, 0], mean[m, 1], mean[m, 2], norm_mean[m] = tx / n, ty / n, tz / n, tn / n

        middle = splats(mean[m], 3)
        squares = repeat(splat(0.0), 6)
        for i in range(0, whole, 8):
            e = load(errors, at + i), load(errors, at + n + i), load(errors, at + 2 * n + i)
            x, y, z = subtract(e, middle)
            squares = fma((x, x, x, y, y, z), (x, y, z, y, z, z), squares)
        store(lanes, 0, squares)
        entry = 0
        for a in range(3):
            for b in range(a, 3):
                total = lane_sum(lanes, entry)
                for i in range(at + whole, at + n):
                    total += (errors[i + a * n] - mean[m, a]) * (errors[i + b * n] - mean[m, b])
                scatter[m, a, b] = scatter[m, b, a] = total
                entry += 1
