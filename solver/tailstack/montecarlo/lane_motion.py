"""What moves before the shutter: mounts, manufacturing errors, and the images that result (conventions, chain 1-2).

Arguments: ``tables``, ``z``, ``points``, ``images`` and ``pose`` as in ``kernel``; ``slot``, of a mount or of the
motion before a shot; ``view`` and ``row``, numbers from 0; points and errors (x, y, z), three lanes each, mm.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import (
    add,
    cross,
    dot,
    fma,
    join,
    lane_jit,
    load,
    loads,
    multiply,
    splat,
    splats,
    store,
    subtract,
    times,
    times_from_left,
)
from .streams import sine_cosine
from .tables import (
    EQ18,
    FIDUCIALS,
    GROWING,
    MANUFACTURED,
    SCREWS,
    SEAT,
    SHIFTING,
    SMALL_ANGLE,
    TARGETS,
    VIEWS,
    arm_slot,
    beads_slot,
    images_slot,
    moves,
    pose_at,
    shot_slot,
)


@lane_jit
def act(tables, slot, row, z, fixed):
    """What is fixed in the rows of a slot from ``row`` on, a tuple of lanes, and what its random sources add."""
    offset, k = tables.gain_starts[slot, 0], tables.gain_starts[slot, 1]
    for j in range(k):
        gains = splats(tables.gains[offset + row * k + j :: k], fixed)
        fixed = fma(gains, load(z, 8 * (tables.starts[1 + slot] + j)), fixed)
    return fixed


@lane_jit
def write_mount(tables, slot, z, pose):
    """Rotation (9, Rx Ry Rz or I + [w]x: Eqs 12, 13) and translation (3) of a mount into ``pose``."""
    rx, ry, rz, tx, ty, tz = act(tables, slot, 0, z, splats(tables.torsors[slot], 6))
    one = splat(1.0)
    if tables.counts[SMALL_ANGLE] != 0:
        rotation = one, -rz, ry, rz, one, -rx, -ry, rx, one
    else:
        sa, ca = sine_cosine(rx)
        sb, cb = sine_cosine(ry)
        sc, cc = sine_cosine(rz)
        sasb, casb = sa * sb, ca * sb
        rotation = (
            cb * cc, -(cb * sc), sb,
            fma(sasb, cc, ca * sc), fma(-sasb, sc, ca * cc), -(sa * cb),
            fma(-casb, cc, sa * sc), fma(casb, sc, sa * cc), ca * cb,
        )  # fmt: skip
    store(pose, pose_at(slot), join(rotation, (tx, ty, tz)))


@lane_jit
def rotate(pose, slot, x):
    return times(loads(pose, pose_at(slot), 9), x)


@lane_jit
def move_error(tables, slot, pose, nominal, e):
    """Error of ``nominal + e`` after the mount: ``R e + (R - 1)(nominal - p) + t``; no large numbers cancel."""
    pivot = tables.pivots[slot]
    x = splat(nominal[0] - pivot[0]), splat(nominal[1] - pivot[1]), splat(nominal[2] - pivot[2])
    shift = add(subtract(rotate(pose, slot, x), x), loads(pose, pose_at(slot) + 72, 3))
    return add(rotate(pose, slot, e), shift)


@lane_jit
def place_points(tables, z, points):
    """Fiducials with their manufacturing errors and grown by heat, object frame."""
    start = 8 * tables.starts[0]
    for i in range(tables.counts[FIDUCIALS]):
        point = splats(tables.nominal[i], 3)
        if tables.counts[MANUFACTURED] != 0:
            made = multiply(splats(tables.spread[i], 3), loads(z, start + 24 * i, 3))
            point = add(point, times(splats(tables.into_frame, 9), made))
        if tables.counts[GROWING] != 0:
            point = add(point, growth(tables, z, i))
        store(points, 24 * i, point)


@lane_jit
def growth(tables, z, i):
    """What heat does to fiducial i, object frame; with i = N, to con at the flange, mm."""
    return act(tables, beads_slot(tables.counts[VIEWS]), 3 * i, z, splats(tables.growth[i], 3))


@lane_jit
def carry_on(tables, z, nominal, e):
    """Error of ``nominal + e``, con, after the screws of the arm, one after another: by exact turns."""
    x = splats(nominal, 3)
    for s in range(tables.counts[SCREWS]):
        w, v = splats(tables.twists[s], 3), splats(tables.twists[s, 3:], 3)
        (amount,) = act(tables, arm_slot(tables.counts[VIEWS]), s, z, splats(tables.screwed[s:], 1))
        moved = add(cross(w, add(x, e)), v)
        if tables.twists[s, 0] != 0 or tables.twists[s, 1] != 0 or tables.twists[s, 2] != 0:
            sine, cosine = sine_cosine(amount)
            e = add(e, add(multiply(moved, sine), multiply(cross(w, moved), splat(1.0) - cosine)))
        else:
            e = add(e, multiply(moved, amount))
    return e


@lane_jit
def image_shift(tables, view, i, z):
    """Shift (u, v) of image i of a view, px: the ball's, and the field's; targets follow fiducials."""
    slot = images_slot(tables.counts[VIEWS], view)
    return act(tables, slot, 2 * i, z, splats(tables.image_shifts[view, i], 2))


@lane_jit
def moved_row(tables, slot, pose, a, b):
    """Row ``(A, b)`` of a projection whose points a mount moves first: ``X -> R (X - p) + p + t``.

    It comes as ``A R`` and what it is at a point x, ``A R (x - p) + A (p + t) + b``, less the first term: (3 lanes, 1).
    """
    at = pose_at(slot)
    moved = add(loads(pose, at + 72, 3), splats(tables.pivots[slot], 3))
    return times_from_left(a, loads(pose, at, 9)), dot(a, moved) + b


@lane_jit
def camera_row(tables, view, row, pose):
    """Row of the projection of the object frame, ``X = E y + c``, when interface 1 or a motion moves the structure."""
    whole = splats(tables.cameras[view, 4 * row :], 4)
    a, b = whole[0:3], whole[3]
    shot = shot_slot(tables.counts[VIEWS], view)
    if moves(tables.counts, shot):
        a, b = moved_row(tables, shot, pose, a, b)
        b = b - dot(a, splats(tables.pivots[shot], 3))
    x = splats(tables.centre, 3)
    if moves(tables.counts, SEAT) and tables.counts[EQ18] == 0:
        a, b = moved_row(tables, SEAT, pose, a, b)
        c, p = tables.centre, tables.pivots[SEAT]
        x = splat(c[0] - p[0]), splat(c[1] - p[1]), splat(c[2] - p[2])
    return join(times_from_left(a, splats(tables.out_of_frame, 9)), dot(a, x) + b)


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
    fixed = tables.fixed_images[view]
    return splats(fixed, 4), splats(fixed[4:], 4), splats(fixed[8:], 4)


@lane_jit
def image_fiducials(tables, view, points, projection, images, z):
    """Noisy images of all fiducials, by the rows of :func:`true_projection`, into ``images``."""
    n, one = tables.counts[FIDUCIALS], splat(1.0)
    start = 16 * view * (n + tables.counts[TARGETS])
    for i in range(n):
        x = join(loads(points, 24 * i, 3), one)
        inverse = one / dot(projection[2], x)
        image = multiply((dot(projection[0], x), dot(projection[1], x)), inverse)
        if tables.counts[SHIFTING] != 0:
            image = add(image, image_shift(tables, view, i, z))
        store(images, 16 * i, add_noise(tables, view, 0, loads(z, start + 16 * i, 2), image))


@lane_jit
def add_noise(tables, view, kind, deviates, image):
    """Image (u, v) with the noise that two deviates make of a fiducial (kind 0) or a target (1)."""
    u, mixed, v = splats(tables.noise[view, kind], 3)
    image = fma((u, v), deviates, image)
    return image[0], image[1] + mixed * deviates[0]
