"""What everything that acts through the images does to the reconstructed point: the one assembly of its gains.

Written as ``noise.py`` is, without branches on values: the same text runs on floats, on complex numbers
(``DesignFunction``) and on CasADi scalars (the optimiser).  The assembly, in scalar steps, is compiled for the score
(``assemble_jit``), and into the kernels of a batch and of losses.
"""

from __future__ import annotations

from typing import NamedTuple, assert_never

import numpy as np
from numba.extending import register_jitable

from ..estimation.resection import project
from ..geometry.kinematics import carry, move_at, undo
from ..geometry.rotation import Displacement, displacement
from ..kernels.store import kernel
from ..system import Act, ArrayLike, Place, Reading, System, Target
from .noise import eliminate_for, gains_after, room_for, room_for_gains
from .nonlinearity import motion_of_images


class Imaging(NamedTuple):
    """V views of N fiducials, and what the estimator makes of them."""

    projections: ArrayLike  # (V, 3, 4) mm -> px, |p3| = 1: the effective ones
    points: ArrayLike  # (N, 3) mm, as the estimator assumes them
    estimation: ArrayLike  # ``noise.Estimation``
    per_error: ArrayLike  # (3, 3) from a manufacturing error to a displacement of those
    manufactured: bool  # whether fiducials have manufacturing errors, which the views share
    believed: ArrayLike  # (3, B) direction of every source of an error of believed intrinsics
    views_of: ArrayLike  # (B,) the view of each
    assumed: ArrayLike  # (V, 3) what is known of the error of the intrinsics that each view believes


@register_jitable
def count_columns(imaging: ArrayLike, views: int) -> int:
    """M: how many sources act through single images, or are of believed intrinsics."""
    count = imaging.points.shape[0]
    size: int = views * (2 * count + 2) + 3 * count * imaging.manufactured + imaging.views_of.shape[0]
    return size


@register_jitable
def assemble(
    imaging: ArrayLike,
    weights: ArrayLike,
    aim: ArrayLike,
    shifts: ArrayLike,
    columns: ArrayLike,
    row_weights: ArrayLike,
) -> None:
    """Gains on the reconstructed point, mm per native unit, in the frame of ``imaging.points``.

    weights (V, N): 1 where a view's estimate uses a fiducial, otherwise 0; aim (3,) mm: the point without noise;
    shifts (V, 2 N + 2, C) px: what moves all images of a view together, u and v of each fiducial, then of the target.
    Fills columns (3, M + C + V), side by side

    - M of sources that act through single images, and of believed intrinsics: for each view u and v of each fiducial's
      noise, then of the target's, or of the independent noise of which ``Estimation.factors`` make it; where fiducials
      are manufactured, x, y and z of each one's error; then each source of an error of believed intrinsics;
    - C of the shifts;
    - V of what is known of the intrinsics that each view believes;

    and row_weights (V, 2, 2): the weight of each view's rows in triangulation.
    """
    eliminated = room_for(weights.shape[0], imaging.points)
    eliminate_for(imaging.estimation, imaging.projections, imaging.points, weights, eliminated)
    assemble_after(eliminated, imaging, weights, aim, shifts, columns, row_weights)


@register_jitable
def assemble_after(
    eliminated: ArrayLike,
    imaging: ArrayLike,
    weights: ArrayLike,
    aim: ArrayLike,
    shifts: ArrayLike,
    columns: ArrayLike,
    row_weights: ArrayLike,
) -> None:
    """:func:`assemble`, which see, with what ``noise.eliminate_for`` filled: it is the same for all targets."""
    views, count = weights.shape[0], imaging.points.shape[0]
    gains = room_for_gains(imaging.points, row_weights)
    gains_after(eliminated, imaging.projections, imaging.points, weights, imaging.estimation, aim, gains)
    fiducial, target, manufacturing, intrinsics, _ = gains
    per_error, width = imaging.per_error, 2 * count + 2
    for k in range(3):
        n = 0
        for v in range(views):
            for i in range(count):
                columns[k, n] = fiducial[v, i, k, 0]
                columns[k, n + 1] = fiducial[v, i, k, 1]
                n += 2
            columns[k, n] = target[v, k, 0]
            columns[k, n + 1] = target[v, k, 1]
            n += 2
        if imaging.manufactured:
            for i in range(count):
                for c in range(3):
                    total = manufacturing[0, i, k, 0] * per_error[0, c]
                    for m in range(1, 3):
                        total = total + manufacturing[0, i, k, m] * per_error[m, c]
                    for v in range(1, views):
                        for m in range(3):
                            total = total + manufacturing[v, i, k, m] * per_error[m, c]
                    columns[k, n] = total
                    n += 1
        for b in range(imaging.views_of.shape[0]):
            v = imaging.views_of[b]
            total = intrinsics[v, k, 0] * imaging.believed[0, b]
            for m in range(1, 3):
                total = total + intrinsics[v, k, m] * imaging.believed[m, b]
            columns[k, n] = total
            n += 1
        for c in range(shifts.shape[2]):
            total = columns[k, 0] * shifts[0, 0, c]
            for j in range(1, views * width):
                total = total + columns[k, j] * shifts[j // width, j % width, c]
            columns[k, n] = total
            n += 1
        for v in range(views):
            total = intrinsics[v, k, 0] * imaging.assumed[v, 0]
            for m in range(1, 3):
                total = total + intrinsics[v, k, m] * imaging.assumed[v, m]
            columns[k, n] = total
            n += 1
        for v in range(imaging.estimation.factors.shape[0]):  # noise of u and v is what independent noise is mixed to
            for i in range(count + 1):
                f, n = imaging.estimation.factors[v, i // count], v * width + 2 * i
                along_u, along_v = columns[k, n], columns[k, n + 1]
                columns[k, n] = along_u * f[0, 0] + along_v * f[1, 0]
                columns[k, n + 1] = along_u * f[0, 1] + along_v * f[1, 1]


# Division by zero gives inf, which linearise refuses with the reason; an exception would have none.
assemble_jit = kernel(nogil=True)(assemble)


def gains_of_images(
    imaging: Imaging, weights: ArrayLike, aim: ArrayLike, shifts: ArrayLike
) -> tuple[ArrayLike, ArrayLike]:
    """Columns (3, M + C + V) and row weights (V, 2, 2): see :func:`assemble`.

    Compiled for floats; the source itself runs on complex numbers and symbols.
    """
    kind, views = imaging.points.dtype, len(weights)
    size = count_columns(imaging, views) + shifts.shape[2] + views
    columns, row_weights = np.zeros((3, size), kind), np.zeros((views, 2, 2), kind)
    fill = assemble_jit if kind == np.float64 else assemble
    fill(imaging, weights, aim, shifts, columns, row_weights)
    return columns, row_weights


# --- shifts of all images of a view together ------------------------------------------------------------
# The estimator knows nothing of them, so the gain of each on the reconstructed point is the sum of the gains of image
# noise, each times the shift of its image: no derivative of its own is needed, whatever the estimator.


def shift_together(system: System, first: Displacement, target: Target) -> tuple[ArrayLike, ArrayLike]:
    """What ``system.shared_image_errors`` do side by side: to the images (V, 2 N + 2, C + E) px, u and v of each
    fiducial, then of the target, and, behind the reconstructed point, at the flange (3, C + E + V) mm, con.

    Per native unit of each of their C sources; then what is known of each of the E effects; last, so that the columns
    are those of :func:`assemble`, nothing for each view.  first: the displacement of the structure by its
    installation at the bias.
    """
    scene, to_con = system.scene(target.position_mm[None], project), undo(system.T_flange_con)
    views, rows, kind = len(system.views), 2 * len(system.fiducials_mm) + 2, system.fiducials_mm.dtype
    moved, turned = system.fiducials_mm, np.eye(3)
    if system.reading is Reading.PHYSICAL:
        moved, turned = moved @ first.rotation.T + first.shift_mm, first.rotation

    def see(v: int, steps: ArrayLike) -> ArrayLike:
        """(2 N, q) px: how the fiducials' images in a view move when they move by steps (N, 3, q) mm."""
        slopes = motion_of_images(system.views[v].projection, moved)
        return np.asarray((slopes @ steps).reshape(rows - 2, -1))

    def shift(act: Act, v: int, parameters: ArrayLike) -> ArrayLike:
        """(2 N or 2 N + 2, q) px: how images in a view move by parameters (m, q), the last of which are known."""
        each = act.by(parameters)
        match act.place:
            case Place.IMAGES:
                return each
            case Place.BEADS:
                steps = each.reshape(-1, 3, each.shape[1])
                return see(v, np.swapaxes(np.swapaxes(steps, 1, 2) @ turned.T, 1, 2))
            case Place.SHOT:
                at = displacement(each[:, -1], act.pivot_mm, system.rotation_form)
                shifts = see(v, at.by_torsor(moved) @ each)
                there = moved @ at.rotation.T + at.shift_mm
                images = (project(system.views[v].projection, points) for points in (there, moved))
                shifts[:, -1] = np.subtract(*images).ravel()
                return shifts
            case Place.CONNECTOR | Place.ARM:
                return np.zeros((0, each.shape[1]))
            case Place.INTRINSICS | Place.SEAT | Place.FLANGE | Place.HAND_EYE | Place.TOOL:
                raise AssertionError(act.place)  # what acts there acts nowhere else: a DirectEffect, no shared one
            case _:
                assert_never(act.place)

    images, flange = [], []
    for effect in system.shared_image_errors:
        parameters = np.column_stack([effect.sources.direction, effect.known])
        shifts, behind = np.zeros((views, rows, parameters.shape[1]), kind), np.zeros((3, parameters.shape[1]))
        for act in effect.act(scene):
            if act.place is Place.CONNECTOR:
                behind = behind + act.by(parameters)
            elif act.place is Place.ARM:
                behind = behind + move_at(carry(to_con, act.twists), target.position_mm).T @ act.by(parameters)
            for v, view in enumerate(system.views):
                if act.view in (None, view.name):
                    of_images = shift(act, v, parameters)
                    shifts[v, : len(of_images)] += of_images
        images.append(shifts)
        flange.append(behind)
    nothing = np.zeros((views, rows, 0), kind)
    each = [nothing, *(part[..., :-1] for part in images), *(part[..., -1:] for part in images)]
    own = [*(part[:, :-1] for part in flange), *(part[:, -1:] for part in flange), np.zeros((3, views))]
    return np.concatenate(each, axis=2), np.concatenate(own, axis=1)
