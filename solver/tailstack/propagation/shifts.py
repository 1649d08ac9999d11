"""Shifts of all images of a view together, side by side.

The estimator knows nothing of them, so the gain of each on the reconstructed point is the sum of the gains of image
noise (``columns``), each times the shift of its image: no derivative of its own is needed, whatever the estimator.
"""

from __future__ import annotations

from typing import assert_never

import numpy as np

from ..estimation.resection import project
from ..geometry.kinematics import carry, move_at, undo
from ..geometry.rotation import Displacement, displacement
from ..system import Act, ArrayLike, Place, Reading, System, Target
from .nonlinearity import motion_of_images


def shift_together(system: System, first: Displacement, target: Target) -> tuple[ArrayLike, ArrayLike]:
    """What ``system.shared_image_errors`` do side by side: to the images (V, 2 N + 2, C + E) px, u and v of each
    fiducial, then of the target, and, behind the reconstructed point, at the flange (3, C + E + V) mm, con.

    Per native unit of each of their C sources; then what is known of each of the E effects; last, so that the columns
    are those of ``columns.assemble``, nothing for each view.  first: the displacement of the structure by its
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
