"""What moves before the shutter: mounts, manufacturing errors, and the images that result (conventions, chain 1-2).

Arguments: ``tables``, ``z``, ``points``, ``images`` and ``pose`` as in ``kernel``; ``slot``, of a mount or of the
motion before a shot; ``view`` and ``row``, numbers from 0; points and errors (x, y, z), three lanes each, mm.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import dot3, fma, lane_jit, load, splat, store
from .streams import sine_cosine
from .tables import (
    EQ18,
    FIDUCIALS,
    GROWING,
    MANUFACTURED,
    SEAT,
    SHIFTING,
    SMALL_ANGLE,
    TARGETS,
    VIEWS,
    beads_slot,
    images_slot,
    moves,
    pose_at,
    shot_slot,
)


@lane_jit
def mount_torsor(tables, slot, z):
    """The six components of one mount's torsor."""
    gains = tables.gains
    offset, k = tables.gain_starts[slot, 0], tables.gain_starts[slot, 1]
    start = 8 * tables.starts[1 + slot]
    t0, t1, t2 = splat(tables.torsors[slot, 0]), splat(tables.torsors[slot, 1]), splat(tables.torsors[slot, 2])
    t3, t4, t5 = splat(tables.torsors[slot, 3]), splat(tables.torsors[slot, 4]), splat(tables.torsors[slot, 5])
    for j in range(k):
        xi = load(z, start + 8 * j)
        at = offset + j
        t0 = fma(splat(gains[at]), xi, t0)
        t1 = fma(splat(gains[at + k]), xi, t1)
        t2 = fma(splat(gains[at + 2 * k]), xi, t2)
        t3 = fma(splat(gains[at + 3 * k]), xi, t3)
        t4 = fma(splat(gains[at + 4 * k]), xi, t4)
        t5 = fma(splat(gains[at + 5 * k]), xi, t5)
    return t0, t1, t2, t3, t4, t5


@lane_jit
def write_mount(tables, slot, z, pose):
    """Rotation (9, Rx Ry Rz or I + [w]x: Eqs 12, 13) and translation (3) of a mount into ``pose``."""
    rx, ry, rz, tx, ty, tz = mount_torsor(tables, slot, z)
    at = pose_at(slot)
    one = splat(1.0)
    if tables.counts[SMALL_ANGLE] != 0:
        store(pose, at, one)
        store(pose, at + 8, -rz)
        store(pose, at + 16, ry)
        store(pose, at + 24, rz)
        store(pose, at + 32, one)
        store(pose, at + 40, -rx)
        store(pose, at + 48, -ry)
        store(pose, at + 56, rx)
        store(pose, at + 64, one)
    else:
        sa, ca = sine_cosine(rx)
        sb, cb = sine_cosine(ry)
        sc, cc = sine_cosine(rz)
        sasb, casb = sa * sb, ca * sb
        store(pose, at, cb * cc)
        store(pose, at + 8, -(cb * sc))
        store(pose, at + 16, sb)
        store(pose, at + 24, fma(sasb, cc, ca * sc))
        store(pose, at + 32, fma(-sasb, sc, ca * cc))
        store(pose, at + 40, -(sa * cb))
        store(pose, at + 48, fma(-casb, cc, sa * sc))
        store(pose, at + 56, fma(casb, sc, sa * cc))
        store(pose, at + 64, ca * cb)
    store(pose, at + 72, tx)
    store(pose, at + 80, ty)
    store(pose, at + 88, tz)


@lane_jit
def rotate(pose, slot, x, y, z):
    at = pose_at(slot)
    return (
        dot3(load(pose, at), load(pose, at + 8), load(pose, at + 16), x, y, z),
        dot3(load(pose, at + 24), load(pose, at + 32), load(pose, at + 40), x, y, z),
        dot3(load(pose, at + 48), load(pose, at + 56), load(pose, at + 64), x, y, z),
    )


@lane_jit
def move_error(tables, slot, pose, nominal, e0, e1, e2):
    """Error of ``nominal + e`` after the mount: ``R e + (R - 1)(nominal - p) + t``; no large numbers cancel."""
    x = splat(nominal[0] - tables.pivots[slot, 0])
    y = splat(nominal[1] - tables.pivots[slot, 1])
    z = splat(nominal[2] - tables.pivots[slot, 2])
    r0, r1, r2 = rotate(pose, slot, x, y, z)
    f0, f1, f2 = rotate(pose, slot, e0, e1, e2)
    at = pose_at(slot)
    return (
        f0 + ((r0 - x) + load(pose, at + 72)),
        f1 + ((r1 - y) + load(pose, at + 80)),
        f2 + ((r2 - z) + load(pose, at + 88)),
    )


@lane_jit
def place_points(tables, z, points):
    """Fiducials with their manufacturing errors and grown by heat, object frame."""
    n = tables.counts[FIDUCIALS]
    into, spread, start = tables.into_frame, tables.spread, 8 * tables.starts[0]
    for i in range(n):
        for c in range(3):
            store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]))
        if tables.counts[MANUFACTURED] != 0:
            m0 = splat(spread[i, 0]) * load(z, start + 24 * i)
            m1 = splat(spread[i, 1]) * load(z, start + 24 * i + 8)
            m2 = splat(spread[i, 2]) * load(z, start + 24 * i + 16)
            for c in range(3):
                moved = dot3(splat(into[3 * c]), splat(into[3 * c + 1]), splat(into[3 * c + 2]), m0, m1, m2)
                store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]) + moved)
        if tables.counts[GROWING] != 0:
            for c in range(3):
                at = 24 * i + 8 * c
                store(points, at, load(points, at) + growth(tables, z, i, c))


@lane_jit
def growth(tables, z, i, c):
    """What heat does to coordinate c of fiducial i, object frame; with i = N, to con at the flange, mm."""
    slot = beads_slot(tables.counts[VIEWS])
    offset, k = tables.gain_starts[slot, 0], tables.gain_starts[slot, 1]
    grown = splat(tables.growth[i, c])
    for j in range(k):
        grown = fma(
            splat(tables.gains[offset + (3 * i + c) * k + j]), load(z, 8 * (tables.starts[1 + slot] + j)), grown
        )
    return grown


@lane_jit
def image_shift(tables, view, i, c, z):
    """Shift of image i of a view along u (c = 0) or v, px: the ball's, and the field's; targets follow fiducials."""
    slot = images_slot(tables.counts[VIEWS], view)
    offset, k = tables.gain_starts[slot, 0], tables.gain_starts[slot, 1]
    shift = splat(tables.image_shifts[view, i, c])
    for j in range(k):
        shift = fma(
            splat(tables.gains[offset + (2 * i + c) * k + j]), load(z, 8 * (tables.starts[1 + slot] + j)), shift
        )
    return shift


@lane_jit
def moved_row(tables, slot, pose, a0, a1, a2, b):
    """Row ``(A, b)`` of a projection whose points a mount moves first: ``X -> R (X - p) + p + t``.

    It comes as ``A R`` and what it is at a point x, ``A R (x - p) + A (p + t) + b``, less the first term: (3 lanes, 1).
    """
    at = pose_at(slot)
    g0 = dot3(a0, a1, a2, load(pose, at), load(pose, at + 24), load(pose, at + 48))
    g1 = dot3(a0, a1, a2, load(pose, at + 8), load(pose, at + 32), load(pose, at + 56))
    g2 = dot3(a0, a1, a2, load(pose, at + 16), load(pose, at + 40), load(pose, at + 64))
    s0 = load(pose, at + 72) + splat(tables.pivots[slot, 0])
    s1 = load(pose, at + 80) + splat(tables.pivots[slot, 1])
    s2 = load(pose, at + 88) + splat(tables.pivots[slot, 2])
    return g0, g1, g2, dot3(a0, a1, a2, s0, s1, s2) + b


@lane_jit
def camera_row(tables, view, row, pose):
    """Row of the projection of the object frame, ``X = E y + c``, when interface 1 or a motion moves the structure."""
    k = 4 * row
    a0, a1, a2 = splat(tables.cameras[view, k]), splat(tables.cameras[view, k + 1]), splat(tables.cameras[view, k + 2])
    b = splat(tables.cameras[view, k + 3])
    shot = shot_slot(tables.counts[VIEWS], view)
    if moves(tables.counts, shot):
        a0, a1, a2, b = moved_row(tables, shot, pose, a0, a1, a2, b)
        p = tables.pivots[shot]
        b = b - dot3(a0, a1, a2, splat(p[0]), splat(p[1]), splat(p[2]))
    x0, x1, x2 = splat(tables.centre[0]), splat(tables.centre[1]), splat(tables.centre[2])
    if moves(tables.counts, SEAT) and tables.counts[EQ18] == 0:
        a0, a1, a2, b = moved_row(tables, SEAT, pose, a0, a1, a2, b)
        x0 = splat(tables.centre[0] - tables.pivots[SEAT, 0])
        x1 = splat(tables.centre[1] - tables.pivots[SEAT, 1])
        x2 = splat(tables.centre[2] - tables.pivots[SEAT, 2])
    e = tables.out_of_frame
    return (
        dot3(a0, a1, a2, splat(e[0]), splat(e[3]), splat(e[6])),
        dot3(a0, a1, a2, splat(e[1]), splat(e[4]), splat(e[7])),
        dot3(a0, a1, a2, splat(e[2]), splat(e[5]), splat(e[8])),
        dot3(a0, a1, a2, x0, x1, x2) + b,
    )


@lane_jit
def fixed_row(tables, view, row):
    k = 4 * row
    m = tables.fixed_images
    return splat(m[view, k]), splat(m[view, k + 1]), splat(m[view, k + 2]), splat(m[view, k + 3])


@lane_jit
def true_projection(tables, view, pose):
    """The three rows (4 lanes each) by which a view images the object frame in these trials."""
    shot = shot_slot(tables.counts[VIEWS], view)
    if (moves(tables.counts, SEAT) and tables.counts[EQ18] == 0) or moves(tables.counts, shot):
        return (
            camera_row(tables, view, 0, pose),
            camera_row(tables, view, 1, pose),
            camera_row(tables, view, 2, pose),
        )
    return fixed_row(tables, view, 0), fixed_row(tables, view, 1), fixed_row(tables, view, 2)


@lane_jit
def image_fiducials(tables, view, points, projection, images, z):
    """Noisy images of all fiducials, by the rows of :func:`true_projection`, into ``images``."""
    n = tables.counts[FIDUCIALS]
    (m00, m01, m02, m03), (m10, m11, m12, m13), (m20, m21, m22, m23) = projection
    noise = splat(tables.noise[view, 0])
    start = 16 * view * (n + tables.counts[TARGETS])
    one = splat(1.0)
    for i in range(n):
        x0, x1, x2 = load(points, 24 * i), load(points, 24 * i + 8), load(points, 24 * i + 16)
        inverse = one / fma(m20, x0, fma(m21, x1, fma(m22, x2, m23)))
        u = fma(m00, x0, fma(m01, x1, fma(m02, x2, m03))) * inverse
        v = fma(m10, x0, fma(m11, x1, fma(m12, x2, m13))) * inverse
        if tables.counts[SHIFTING] != 0:
            u, v = u + image_shift(tables, view, i, 0, z), v + image_shift(tables, view, i, 1, z)
        store(images, 16 * i, fma(noise, load(z, start + 16 * i), u))
        store(images, 16 * i + 8, fma(noise, load(z, start + 16 * i + 8), v))
