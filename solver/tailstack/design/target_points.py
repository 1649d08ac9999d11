"""The points that a target stands for: itself, or samples of its region."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..geometry.arrays import Array, frozen
from ..system import Target
from .consistency import axis_counts, sample_count
from .document import Region, TargetDocument


def expand_target(target: TargetDocument) -> tuple[Target, ...]:
    """The named points of a target; a region's are called name[0], name[1], ..."""
    if target.region is None:
        direction = None if target.direction is None else np.array(target.direction)
        unit = None if direction is None else frozen(direction / np.linalg.norm(direction))
        return (Target(target.name, frozen(target.position_mm), direction=unit),)
    points = _box_points(target.region) if target.region.box is not None else _sphere_points(target.region)
    assert len(points) == sample_count(target)
    return tuple([Target(f"{target.name}[{k}]", frozen(point), target.name) for k, point in enumerate(points)])


def _box_points(region: Region) -> list[Array]:
    box = region.box
    assert box is not None
    axes = [
        centre + (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)) * size
        for centre, size, count in zip(box.centre_mm, box.size_mm, axis_counts(box), strict=True)
    ]
    return [np.array(point) for point in product(*axes)]


def _sphere_points(region: Region) -> list[Array]:
    """Centre, 6 axis points, 8 diagonals: the 14 surface points are a spherical design of degree 5."""
    sphere = region.sphere
    assert sphere is not None
    centre = np.array(sphere.centre_mm)
    axial = [sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    diagonal = [np.array(signs) / np.sqrt(3) for signs in product((-1.0, 1.0), repeat=3)]
    return [centre, *(centre + sphere.radius_mm * direction for direction in axial + diagonal)]
