"""The full nonlinear chain, eight trials at a time: draw, image, resect, triangulate, on to the tool.

Resection: ``lane_resection``.

**Triangulation.**  Rows ``(u_t p3 - p1) / |a|`` (Eq 5), normal matrix ``[[M, b], [b', c]]``; (M - lam) y = -b with
lam the Rayleigh quotient of (y, 1), fixed factor of M.  ``lam < 4 det M / tr(M)^2 <= lambda_min(M)`` proves
the smallest.

A lane that fails a proof, does not converge or is not finite is flagged; the caller redoes it by SVD.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lane_algebra import dot3, factor3, solve3
from .lane_motion import image_fiducials, move_error, place_points, write_mount
from .lane_resection import resect, squared_reprojection
from .lanes import absolute, any_lane, fma, lane_entry, lane_jit, load, select, splat, square_root, store
from .streams import fill_deviates

STEP = 1e-12  # last step of the triangulation, relative
MAX_STEPS = 6
RESULTS = 6  # per target: tcp (3), localisation (3)


@lane_jit
def scratch_size(counts):
    """Doubles of scratch: deviates, points, images of one view, a and p1, p2 per view, rotations, results."""
    n, v, t, d = counts[0], counts[1], counts[2], counts[6]
    return 8 * (d + 3 * n + 2 * n + 12 * v + 2 * v + 36 + RESULTS * t + 8)


@lane_jit
def triangulate(tables, target, estimates, z):
    """Target in the object frame from all views: (y0, y1, y2, mask of proven lanes)."""
    n, views = tables.counts[0], tables.counts[1]
    one, zero = splat(1.0), splat(0.0)
    m00, m01, m02, m11, m12, m22, b0, b1, b2, c = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for view in range(views):
        at = 112 * view
        start = 16 * view * (n + tables.counts[2]) + 16 * (n + target)
        sigma = splat(tables.noise[view, 1])
        a0, a1, a2 = load(estimates, at), load(estimates, at + 8), load(estimates, at + 16)
        weight = load(estimates, at + 88)
        for row in range(2):
            image = fma(sigma, load(z, start + 8 * row), splat(tables.target_images[target, view, row]))
            t = image - load(estimates, at + 96 + 8 * row)
            p = at + 24 + 32 * row
            r0, r1 = fma(t, a0, -load(estimates, p)), fma(t, a1, -load(estimates, p + 8))
            r2, r3 = fma(t, a2, -load(estimates, p + 16)), t - load(estimates, p + 24)
            h0, h1, h2, h3 = weight * r0, weight * r1, weight * r2, weight * r3
            m00, m01, m02, b0 = fma(h0, r0, m00), fma(h0, r1, m01), fma(h0, r2, m02), fma(h0, r3, b0)
            m11, m12, b1 = fma(h1, r1, m11), fma(h1, r2, m12), fma(h1, r3, b1)
            m22, b2, c = fma(h2, r2, m22), fma(h2, r3, b2), fma(h3, r3, c)
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
def chain_errors(tables, target, pose, z, y0, y1, y2, results):
    """Localisation error (con) and TCP error (tcp) of one target into ``results`` (6 vectors)."""
    active = tables.counts[7]
    nominal = tables.targets_frame[target]
    y0, y1, y2 = y0 - splat(nominal[0]), y1 - splat(nominal[1]), y2 - splat(nominal[2])
    e = tables.out_of_frame
    e0 = dot3(splat(e[0]), splat(e[1]), splat(e[2]), y0, y1, y2)
    e1 = dot3(splat(e[3]), splat(e[4]), splat(e[5]), y0, y1, y2)
    e2 = dot3(splat(e[6]), splat(e[7]), splat(e[8]), y0, y1, y2)
    if tables.counts[4] != 0 and (active & 1) != 0:
        # Eq 18: the estimator is equivariant to the rigid motion of its coordinates, so q_hat = T_err1 q_hat_0
        e0, e1, e2 = move_error(tables, 0, pose, 0, tables.targets[target], e0, e1, e2)
    store(results, 24, e0)
    store(results, 32, e1)
    store(results, 40, e2)
    if (active & 2) != 0:
        e0, e1, e2 = move_error(tables, 1, pose, 96, tables.targets[target], e0, e1, e2)
    r = tables.to_tcp
    t0 = dot3(splat(r[0]), splat(r[1]), splat(r[2]), e0, e1, e2)
    t1 = dot3(splat(r[3]), splat(r[4]), splat(r[5]), e0, e1, e2)
    t2 = dot3(splat(r[6]), splat(r[7]), splat(r[8]), e0, e1, e2)
    if (active & 4) != 0:
        t0, t1, t2 = move_error(tables, 2, pose, 192, tables.targets_tcp[target], t0, t1, t2)
    t0 = t0 + splat(tables.execution_bias[0])
    t1 = t1 + splat(tables.execution_bias[1])
    t2 = t2 + splat(tables.execution_bias[2])
    offset, k = tables.gain_starts[3, 0], tables.gain_starts[3, 1]
    for j in range(k):
        xi = load(z, 8 * (tables.starts[4] + j))
        t0 = fma(splat(tables.gains[offset + j]), xi, t0)
        t1 = fma(splat(tables.gains[offset + k + j]), xi, t1)
        t2 = fma(splat(tables.gains[offset + 2 * k + j]), xi, t2)
    store(results, 0, t0)
    store(results, 8, t1)
    store(results, 16, t2)


@lane_jit
def run_chain(tables, z, points, images, estimates, pose, results, want_reprojection):
    """One group of eight trials from its deviates ``z`` to ``results``; then flag and reprojection RMS."""
    n, views, targets, active = tables.counts[0], tables.counts[1], tables.counts[2], tables.counts[7]
    for mount in range(3):
        if (active >> mount) & 1:
            write_mount(tables, mount, z, pose, 96 * mount)
    if tables.counts[3] != 0:
        place_points(tables, z, points)
    good = splat(1.0) > splat(0.0)
    squares = splat(0.0)
    for view in range(views):
        gu, gv = image_fiducials(tables, view, points, pose, images, z)
        estimate = estimates[112 * view : 112 * view + 112]
        good = good & resect(tables, images, gu, gv, estimate)
        if want_reprojection:
            squares = squares + squared_reprojection(tables, images, estimate)
    for target in range(targets):
        y0, y1, y2, proven = triangulate(tables, target, estimates, z)
        good = good & proven
        chain_errors(tables, target, pose, z, y0, y1, y2, results[48 * target : 48 * target + 48])
    at = 48 * targets
    store(results, at, select(good, splat(0.0), splat(1.0)))
    store(results, at + 8, square_root(squares / splat(1.0 * views * n)))


@lane_entry
def run_trials(tables, keys, units, trials, given, errors, flags, reprojection, want_reprojection, scratch):
    """Run trials in groups of eight.

    trials, units: (n,) int64 indices, n a multiple of 8.  ``given``: (d, n) deviates, or (0, 0) to draw them from
    ``keys``.  Fills errors (flat 6 T n: target, metric, axis, trial), flags (n,), not 0 where a trial has to be
    redone, and, when wanted, reprojection (n,) px.
    """
    n, views, targets, d = tables.counts[0], tables.counts[1], tables.counts[2], tables.counts[6]
    at = 0
    z = scratch[at : at + 8 * d]
    at += 8 * d
    points = scratch[at : at + 24 * n]
    at += 24 * n
    images = scratch[at : at + 16 * n]
    at += 16 * n
    estimates = scratch[at : at + 112 * views]
    at += 112 * views
    pose = scratch[at : at + 288]
    at += 288
    results = scratch[at : at + 48 * targets + 16]
    for i in range(n):
        for c in range(3):
            store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]))
    rows = 6 * targets
    for group in range(0, trials.size, 8):
        if given.shape[0] > 0:
            for k in range(d):
                for lane in range(8):
                    z[8 * k + lane] = given[k, group + lane]
        else:
            fill_deviates(tables.segments, 0, keys[0], load(units, group), z)
            fill_deviates(tables.segments, 1, keys[1], load(trials, group), z)
        run_chain(tables, z, points, images, estimates, pose, results, want_reprojection)
        for row in range(rows):
            store(errors, row * trials.size + group, load(results, 8 * row))
        store(flags, group, load(results, 8 * rows))
        if want_reprojection:
            store(reprojection, group, load(results, 8 * rows + 8))
