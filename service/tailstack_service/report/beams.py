"""Views as beams in space: source, detector and its corners in con, and what a pixel is in mm there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tailstack.design.document import DistanceView, PresetView
from tailstack.design.presets import PRESETS
from tailstack.geometry.arrays import Array
from tailstack.geometry.camera import camera_centre, depths, principal_ray
from tailstack.geometry.rotation import unit
from tailstack.system import System, View

if TYPE_CHECKING:
    from tailstack.design import Design
BEYOND = 1.3  # a detector at an unknown distance is drawn so much farther than what it images


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """One view in space.

    ``stated``: the document says where the detector is; otherwise it is drawn behind what it images.  ``pixel_mm`` is
    the pitch at the detector, None where the detector's distance is not known.
    """

    view: View
    source_mm: Array  # (3,) con
    direction: Array  # (3,) unit, along the principal ray
    right: Array  # (3,) unit, across the ray: as the image is seen from the source
    up: Array  # (3,) unit
    detector_mm: float  # from the source, along the principal ray
    stated: bool
    pixel_mm: tuple[float, float] | None  # along u and v
    corners_px: Array  # (4, 2) of the image; of what is in it where its size is not stated
    sized: bool  # whether the document states the size of the image

    def on_detector(self, image_px: Array) -> Array:
        """Where pixels (N, 2) are on the detector; (N, 3) mm, con."""
        homogeneous = np.column_stack([image_px, np.ones(len(image_px))])
        rays = np.linalg.solve(self.view.projection[:, :3], homogeneous.T).T
        return np.asarray(self.source_mm + self.detector_mm * rays)

    def images(self, points_mm: Array) -> Array:
        """Images of points (N, 3) mm, con: (N, 2) px; NaN for a point that is not in front of the source."""
        return images(self.view, points_mm)


def images(view: View, points_mm: Array) -> Array:
    """As :meth:`Beam.images`."""
    seen = points_mm @ view.projection[:, :3].T + view.projection[:, 3]
    seen[seen[:, 2] <= 0] = np.nan
    return np.asarray(seen[:, :2] / seen[:, 2:])


def beams_of(design: Design, system: System) -> tuple[Beam, ...]:
    """Every view of a design, which ``system`` was compiled from."""
    points = np.vstack([system.fiducials_mm, [target.position_mm for target in system.targets]])
    pairs = zip(system.views, design.document.views, strict=True)
    return tuple(_beam(view, document, points) for view, document in pairs)


def _beam(view: View, document: object, points_mm: Array) -> Beam:
    projection = view.projection
    direction = principal_ray(projection)
    down = projection[1, :3] - (projection[1, :3] @ direction) * direction
    up = -unit(np.asarray(down))
    far = float(depths(projection, points_mm).max())
    stated, distance, pixel = False, BEYOND * max(far, 1.0), None
    if isinstance(document, PresetView | DistanceView):
        preset = PRESETS[document.preset] if isinstance(document, PresetView) else None
        own = document.source_detector_mm or (preset.source_detector_mm if preset else None)
        if own is not None:
            stated, distance = True, float(own)
            across_u = projection[0, :3] - (projection[0, :3] @ direction) * direction
            pixel = (distance / float(np.linalg.norm(across_u)), distance / float(np.linalg.norm(down)))
    return Beam(
        view, camera_centre(projection), direction, np.cross(up, -direction), up, distance, stated, pixel,
        _corners(view, points_mm), view.image_size_px is not None,
    )  # fmt: skip


def _corners(view: View, points_mm: Array) -> Array:
    """(4, 2) px, clockwise from the first pixel; where no size is stated, around what is imaged."""
    if view.image_size_px is None:
        seen = images(view, points_mm)
        low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
        margin = 0.08 * float((high - low).max())
        low, high = low - margin, high + margin
    else:
        low, high = np.full(2, -0.5), np.array(view.image_size_px) - 0.5
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
