"""What moves the images of all beads of a view together: motion between the shots, temperature, an image's residual
field, balls that are no points.

Each is a shift of the images that the estimator knows nothing of, so its gain on the reconstructed point is the sum of
the gains of image noise, each times the shift of its image: no derivative of its own is needed, whatever the estimator.

As in ``noise.py``, fiducials and pivots may be floats, complex numbers or CasADi scalars, by which the optimiser and
``DesignFunction`` differentiate this text.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..estimation.resection import project
from ..geometry.image_shifts import field_shifts, outline_shifts
from ..geometry.rotation import Displacement, displacement
from ..system import Reading, Sources, System, Target, no_sources
from .nonlinearity import motion_of_images

# The arrays are numpy arrays of floats, of complex numbers or of CasADi scalars; static typing cannot say that.
Duck = Any


class Systematic(NamedTuple):
    """One contributor of this kind, at one target.  Rows: u and v of each fiducial's image, then of the target's."""

    contributor: str
    label: str
    per_unit: bool  # drawn once per installed unit, or at every shot
    sources: Sources  # k of them; none where all is known
    shifts: Duck  # (V, 2 N + 2, k) px per native unit
    at_flange_mm: Duck  # (3, k) con, mm per native unit: behind the reconstructed point
    known_shift_px: Duck  # (V, 2 N + 2)
    known_at_flange_mm: Duck  # (3,) con

    def localise(self, gains: Sequence[Duck]) -> tuple[Duck, Duck]:
        """What one native unit of each source, (3, k), and what is known, (3,), do to the reconstructed point, mm.

        gains: of the images of each view, (3, 2 N + 2) mm per px in the order of ``shifts``.
        """
        by_source = sum(gain @ shift for gain, shift in zip(gains, self.shifts, strict=True))
        return by_source, sum(gain @ shift for gain, shift in zip(gains, self.known_shift_px, strict=True))


def systematic_errors(system: System, first: Displacement, target: Target) -> tuple[Systematic, ...]:
    """All that the system declares: motions, image fields, temperature, balls.

    first: the displacement of the structure by its installation at the bias.
    """
    views, rows, kind = len(system.views), 2 * len(system.fiducials_mm) + 2, system.fiducials_mm.dtype
    moved, turned = system.fiducials_mm, np.eye(3)
    if system.reading is Reading.PHYSICAL:
        moved, turned = moved @ first.rotation.T + first.shift_mm, first.rotation

    def in_views(shifts: dict[int, Duck], count: int) -> Duck:
        every = np.zeros((views, rows, count), kind)
        for v, shift in shifts.items():
            every[v, : len(shift)] = shift
        return every

    def see(v: int, steps: Duck) -> Duck:
        """(2 N, k) px: how the fiducials' images in a view move when they move by steps (N, 3, k) mm."""
        return np.asarray((motion_of_images(system.views[v].projection, moved) @ steps).reshape(rows - 2, -1))

    nothing, still = np.zeros((views, rows)), np.zeros(3)
    found = []
    for v, view in enumerate(system.views):
        if (motion := view.motion) is not None:
            act = displacement(motion.bias, motion.pivot_mm, system.rotation_form)
            steps = np.array([act.by_torsor(point) for point in moved]) @ motion.sources.direction
            count = motion.sources.count
            shifts = in_views({v: see(v, steps)}, count)
            found.append(
                Systematic(
                    motion.name, motion.title, False, motion.sources, shifts, np.zeros((3, count)), nothing, still
                )
            )
    for v, view in enumerate(system.views):
        if (field := view.image_field) is not None:
            images = project(view.projection, np.vstack([system.fiducials_mm, target.position_mm]))
            shift = field_shifts(images, field.centre_px, field.half_diagonal_px, field.axis, field.powers)
            count = field.sources.count
            shifts = in_views({v: shift.reshape(rows, count)}, count)
            name, label = f"image_field:{view.name}", f"image field, {view.name}"
            found.append(Systematic(name, label, True, field.sources, shifts, np.zeros((3, count)), nothing, still))
    if (heat := system.temperature) is not None:
        steps = heat.structure_per_k * (system.fiducials_mm - heat.seat_mm) @ turned.T
        per_k = in_views({v: see(v, steps[:, :, None]) for v in range(views)}, 1)
        away = -heat.connector_mm_per_k[:, None]
        direction, known = heat.sources.direction, heat.difference_k
        found.append(
            Systematic(
                "temperature", "temperature", False, heat.sources, per_k @ direction, away @ direction,
                per_k[:, :, 0] * known, away[:, 0] * known,
            )
        )  # fmt: skip
    if (balls := system.balls) is not None:
        each = (outline_shifts(view.projection, system.fiducials_mm, balls.radius_mm) for view in system.views)
        shifts = in_views({v: balls.share * shift.reshape(-1, 1) for v, shift in enumerate(each)}, 1)
        label = "shift of the balls' images"
        found.append(
            Systematic(
                "ball_images", label, True, no_sources(1), shifts[:, :, :0], np.zeros((3, 0)), shifts[:, :, 0], still
            )
        )
    return tuple(found)
