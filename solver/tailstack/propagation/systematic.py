"""What effects that move the images of all beads of a view together do there, to first order.

Each is a shift of the images that the estimator knows nothing of, so its gain on the reconstructed point is the sum of
the gains of image noise, each times the shift of its image: no derivative of its own is needed, whatever the estimator.

As in ``noise.py``, fiducials and pivots may be floats, complex numbers or CasADi scalars, by which the optimiser and
``DesignFunction`` differentiate this text.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, assert_never

import numpy as np

from ..estimation.resection import project
from ..geometry.rotation import Displacement, displacement
from ..system import Act, ArrayLike, Effect, Place, Reading, System, Target
from .nonlinearity import motion_of_images


class Systematic(NamedTuple):
    """One effect of this kind, at one target.  Rows: u and v of each fiducial's image, then of the target's."""

    effect: Effect
    shifts: ArrayLike  # (V, 2 N + 2, k) px per native unit of each source
    at_flange_mm: ArrayLike  # (3, k) con, mm per native unit: behind the reconstructed point
    known_shift_px: ArrayLike  # (V, 2 N + 2)
    known_at_flange_mm: ArrayLike  # (3,) con

    def localise(self, gains: Sequence[ArrayLike]) -> tuple[ArrayLike, ArrayLike]:
        """What one native unit of each source, (3, k), and what is known, (3,), do to the reconstructed point, mm.

        gains: of the images of each view, (3, 2 N + 2) mm per px in the order of ``shifts``.
        """
        by_source = sum(gain @ shift for gain, shift in zip(gains, self.shifts, strict=True))
        return by_source, sum(gain @ shift for gain, shift in zip(gains, self.known_shift_px, strict=True))


def shift_together(system: System, first: Displacement, target: Target) -> tuple[ArrayLike, ArrayLike]:
    """What all of them do side by side: to the images (V, 2 N + 2, C + 1) px and, behind the reconstructed point,
    (3, C + 1) mm; per native unit of each of the C sources, last what is known.  first: as ``systematic_errors``."""
    shared_errors = systematic_errors(system, first, target)
    known = np.zeros((len(system.views), 2 * len(system.fiducials_mm) + 2))
    known_at_flange = np.zeros(3)
    for each in shared_errors:
        known, known_at_flange = known + each.known_shift_px, known_at_flange + each.known_at_flange_mm
    shifts = np.concatenate([*(each.shifts for each in shared_errors), known[..., None]], axis=2)
    return shifts, np.column_stack([*(each.at_flange_mm for each in shared_errors), known_at_flange])


def systematic_errors(system: System, first: Displacement, target: Target) -> tuple[Systematic, ...]:
    """All of them that the system declares.

    first: the displacement of the structure by its installation at the bias.
    """
    scene = system.scene(target.position_mm[None], project)
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
            case Place.CONNECTOR:
                return np.zeros((0, each.shape[1]))
            case Place.INTRINSICS | Place.SEAT | Place.FLANGE | Place.HAND_EYE | Place.TOOL:
                raise AssertionError(act.place)  # what acts there acts nowhere else: a DirectEffect, no shared one
            case _:
                assert_never(act.place)

    shared_errors = []
    for effect in system.shared_image_errors:
        parameters = np.column_stack([effect.sources.direction, effect.known])
        count = effect.sources.count
        images, flange = np.zeros((views, rows, count + 1), kind), np.zeros((3, count + 1))
        for act in effect.act(scene):
            if act.place is Place.CONNECTOR:
                flange = flange + act.by(parameters)
            for v, view in enumerate(system.views):
                if act.view in (None, view.name):
                    shifts = shift(act, v, parameters)
                    images[v, : len(shifts)] += shifts
        shared_errors.append(Systematic(effect, images[..., :-1], flange[:, :-1], images[..., -1], flange[:, -1]))
    return tuple(shared_errors)
