"""What compiled code reads of a system, and where in it each slot of random sources stands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from ..geometry.arrays import Array

INSTALLATION, SHOT = 0, 1  # streams that deviates are drawn from
# Slots, in their order: of the mounts and the execution, then of each view's motion before its shot, of each view's
# images, of the beads, of the intrinsics that each view is believed to have, and of the arm
SEAT, FLANGE, HAND_EYE, EXECUTION = 0, 1, 2, 3
MOUNTS = (SEAT, FLANGE, HAND_EYE)


@register_jitable
def shot_slot(views: int, view: int) -> int:
    """Of what moves the structure before the shot of a view; views: how many there are."""
    return EXECUTION + 1 + view


@register_jitable
def images_slot(views: int, view: int) -> int:
    """Of what moves the images of a view."""
    return EXECUTION + 1 + views + view


@register_jitable
def beads_slot(views: int) -> int:
    """Of what moves the fiducials, and con at the flange."""
    return EXECUTION + 1 + 2 * views


@register_jitable
def arm_slot(views: int) -> int:
    """Of what turns the screws of an arm."""
    return EXECUTION + 2 + 3 * views


@register_jitable
def intrinsics_slot(views: int, view: int) -> int:
    """Of what a view's estimate believes of its intrinsics."""
    return EXECUTION + 2 + 2 * views + view


# Places in ``Tables.counts``.  A named tuple in its place would be copied at every call of compiled code: a trial took
# 7 % more time
FIDUCIALS, VIEWS, TARGETS = 0, 1, 2  # how many there are
DEVIATES = 3  # of a trial
UNKNOWNS = 4  # of a view by least squares; 0: by DLT
MOVING = 5  # bits by slot: the mounts, and the motions before shots, that ever move anything
# ... and what of the chain a system makes use of, 0 or 1
MANUFACTURED = 6  # fiducials have manufacturing errors
GROWING = 7  # something moves the fiducials, or con at the flange
SHIFTING = 8  # something moves images
HIDDEN = 9  # a view does not see all fiducials
EQ18 = 10  # the reading of Eq 18
SMALL_ANGLE = 11  # rotations in their small-angle form
PUBLISHED = 12  # triangulation in plain millimetres
BY_IMAGES = 13  # triangulation by the target's images
SCREWS = 14  # how many an arm has


@register_jitable
def moves(counts: NDArray[np.int64], slot: int) -> bool:
    """Whether a mount, or the motion before a shot, ever moves anything."""
    return bool((counts[MOVING] >> slot) & 1 != 0)


@register_jitable
def pose_at(slot: int) -> int:
    """Where what a mount or a motion does begins in ``kernel``'s ``pose``: rotation (9), translation (3), of lanes."""
    return 96 * (slot if slot < EXECUTION else slot - 1)


class Tables(NamedTuple):
    """What the compiled code reads.  C-contiguous float64 unless said; object frame: see ChainPlan."""

    segments: NDArray[np.int64]  # (n, 4): first column, end column, law code, stream
    counts: NDArray[np.int64]  # (15,) by ``FIDUCIALS`` ... ``SCREWS``
    starts: NDArray[np.int64]  # (7 + 3 V,): first column of manufacturing, then of every slot
    nominal: Array  # (N, 3) fiducials in the object frame
    products: Array  # (V, N, 10) upper triangle of y~ y~^T, row by row, in the frame of each view; 0 where not seen
    diagonal: Array  # (V, 8) D, then 1 / D, of each view
    view_frames: Array  # (V, 12) object frame -> frame of the view: linear part, then shift
    spread: Array  # (N, 3) scale of one manufacturing deviate, mm
    into_frame: Array  # (9,) con mm -> object frame, linear part
    out_of_frame: Array  # (9,) object frame -> con mm, linear part
    object_scale: Array  # (2,) length in the object frame over mm, and its square's inverse
    cameras: Array  # (V, 12) projection of con mm, pixels counted from the fiducials' nominal mean image
    fixed_images: Array  # (V, 12) projection of the object frame (where images do not move)
    # (V, 11) focal lengths and skew (u, skew, v), principal point from the same origin, px; then by how much the
    # assumed ones are off with the bounded sources at their vertex: focal length (relative), principal point; and the
    # precision of each of these three as a prior has it, px^2 (``System.prior_precisions``)
    intrinsics: Array
    target_images: Array  # (T, V, 2) px from the same origin
    row_factors: Array  # (T, V, 3) L' of the weight L L' of a view's rows in triangulation: l00, l10, l11
    noise: Array  # (V, 2, 3) px, of fiducials, targets: u by its deviate, v by that of u and by its own
    gains: Array  # scaled directions one after another: mounts' (6, k), execution's (3, k), motions' (6, k), fields'
    # (2 (N + T), k), px by image, of one deviate of temperature: of the fiducials, object frame, and at the flange;
    # of the assumed intrinsics (3, k); of the arm, screw by screw
    gain_starts: NDArray[np.int64]  # (6 + 3 V, 2) of every slot: offset into gains, k
    torsors: Array  # (4 + V, 6) bias of mounts and motions with the bounded sources at their vertex; row 3: not read
    image_shifts: Array  # (V, N + T, 2) px: balls, and fields with the bounded coefficients at their vertex
    growth: Array  # (N + 1, 3) known: of the fiducials, object frame, and what moves con at the flange, mm
    centre: Array  # (3,) centroid of the fiducials, con
    pivots: Array  # (4 + V, 3) pivots: con, con, tcp, none, con
    targets: Array  # (T, 3) con
    targets_frame: Array  # (T, 3) object frame
    targets_tcp: Array  # (T, 3) tcp
    to_tcp: Array  # (9,) rotation of T_tcp_con
    execution_bias: Array  # (3,) tcp
    twists: Array  # (S, 6) con: the screws of an arm, the first acts first
    screwed: Array  # (S,) rad, mm: known of each
