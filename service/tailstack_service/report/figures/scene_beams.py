"""Views as items of a scene, and the directions to look from."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, radians, sin

import numpy as np

from tailstack.arrays import Array
from tailstack.system import System

from ...rendering.svg import printable
from .beams import Beam
from .scene_items import radius_of
from .scene_records import Camera, Item, Point3, place_in_words, point, points_of

AZIMUTH, ELEVATION = radians(-62), radians(20)  # of the eye of the first camera


def beam_items(beam: Beam, system: System, crowded: bool) -> list[Item]:
    """Source, edges of the beam, detector and the images on it; ``crowded``: only the source is named, and shortly."""
    name = printable(beam.view.name, 18)
    corners = beam.on_detector(beam.corners_px)
    said = f"{beam.detector_mm:.0f} mm from the source" if beam.stated else "its distance is not stated"
    source = printable(name, 10) if crowded else f"{name} source"
    title = f"source of view {name}: {place_in_words(beam.source_mm)}"
    items = [Item("mark", "beams", "source", (point(beam.source_mm),), source, title)]
    for corner in corners:
        items.append(Item("line", "beams", "ray", points_of([beam.source_mm, corner])))
    look = "detector" if beam.stated and beam.sized else "guessed"
    label = "" if crowded else f"{name} detector"
    items.append(Item("face", "beams", look, points_of(corners), label, f"detector of view {name}, {said}"))
    middle = beam.source_mm + beam.detector_mm * beam.direction
    items.append(Item("line", "beams", "axis", points_of([beam.source_mm, middle])))
    images = beam.images(system.fiducials_mm)
    images = images[np.isfinite(images).all(axis=1)]
    items += [Item("mark", "beams", "image", (point(place),)) for place in beam.on_detector(images)]
    return items


def beam_arrow(beam: Beam, shown: Array) -> Item:
    """An arrow towards the structure, from outside it, with the name of the view."""
    centre, radius = (shown.min(axis=0) + shown.max(axis=0)) / 2, radius_of(shown)
    along = centre - beam.source_mm
    along = along / np.linalg.norm(along)
    ends = points_of([centre - 1.5 * radius * along, centre - 1.15 * radius * along])
    name = printable(beam.view.name, 18)
    return Item("arrow", "directions", "beam", ends, name, f"beam of view {name}")


def cameras(beams: Sequence[Beam]) -> tuple[Camera, ...]:
    right = np.array([-sin(AZIMUTH), cos(AZIMUTH), 0.0])
    up = np.array([-sin(ELEVATION) * cos(AZIMUTH), -sin(ELEVATION) * sin(AZIMUTH), cos(ELEVATION)])
    cameras = [Camera("iso", "Oblique", _unit(right), _unit(up))]
    for k, beam in enumerate(beams[:6]):
        label = f"From {printable(beam.view.name, 18)} source"
        cameras.append(Camera(f"view-{k + 1}", label, _unit(beam.right), _unit(beam.up)))
    return (*cameras, Camera("top", "From +z", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


def _unit(values: Array) -> Point3:
    x, y, z = (round(float(v), 6) + 0.0 for v in values)
    return (x, y, z)
