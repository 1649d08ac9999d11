"""What everything that acts through the images does to the reconstructed point: the one assembly of its gains.

Written as ``noise.py`` is, without branches on values: the same text runs on floats, on complex numbers
(``DesignFunction``) and on CasADi scalars (the optimiser).  The assembly, in scalar steps, is compiled for the score
(``assemble_jit``), and into the kernels of a batch and of losses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ..geometry.arrays import ArrayLike
from ..kernels.store import kernel
from .noise import eliminate_for, gains_after, room_for, room_for_gains


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
