"""Bodies as lines in space: boxes, cylinders, balls, frames and ellipsoids, in con, mm."""

from __future__ import annotations

from itertools import product
from math import sqrt

import numpy as np

from tailstack.arrays import Array
from tailstack.design.optimise_document import SearchBox, SearchCylinder, Shaped
from tailstack.geometry.rotation import cross, unit

CIRCLE = 36  # pieces of a circle
P95_GAUSSIAN = sqrt(7.814727903251179)  # radius of the ball that holds 95 % of a standard Gaussian in three dimensions

Lines = list[Array]  # each (n, 3), mm


def box_lines(low: Array, high: Array) -> Lines:
    """The twelve edges of an axis-parallel box between two corners (3,)."""
    corners = {signs: np.where(signs, high, low) for signs in product((0, 1), repeat=3)}
    return [
        np.array([corners[a], corners[b]])
        for a in corners
        for b in corners
        if a < b and sum(x != y for x, y in zip(a, b, strict=True)) == 1
    ]


def circle(centre: Array, normal: Array, radius_mm: float) -> Array:
    """(CIRCLE + 1, 3) a closed circle about ``centre`` across ``normal``."""
    first, second = across(normal)
    angles = np.linspace(0.0, 2 * np.pi, CIRCLE + 1)[:, None]
    return np.asarray(centre + radius_mm * (np.cos(angles) * first + np.sin(angles) * second))


def across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors across a direction (3,) and each other."""
    along = unit(np.asarray(direction, dtype=float))
    first = unit(cross(along, np.eye(3)[int(np.argmin(np.abs(along)))]))
    return first, cross(along, first)


def cylinder_lines(base: Array, axis: Array, height_mm: float, radius_mm: float) -> Lines:
    """Both rims and four lines along the wall."""
    along = height_mm * unit(np.asarray(axis, dtype=float))
    rim = circle(base, axis, radius_mm)
    walls = [np.array([rim[k], rim[k] + along]) for k in range(0, CIRCLE, CIRCLE // 4)]
    return [rim, rim + along, *walls]


def ball_lines(centre: Array, radius_mm: float) -> Lines:
    """Three great circles."""
    return [circle(centre, axis, radius_mm) for axis in np.eye(3)]


def region_lines(region: Shaped) -> Lines:
    """A search region or a keep-out zone of the design document; a tube or shell has its inner surface too."""
    shape = region.shape
    if isinstance(shape, SearchBox):
        return box_lines(np.array(shape.min_mm), np.array(shape.max_mm))
    radii = [radius for radius in (shape.radius_mm, shape.inner_radius_mm) if radius > 0]
    if len(set(radii)) == 1:
        radii = radii[:1]
    if isinstance(shape, SearchCylinder):
        base, axis = np.array(shape.base_mm), np.array(shape.axis)
        return [line for radius in radii for line in cylinder_lines(base, axis, shape.height_mm, radius)]
    return [line for radius in radii for line in ball_lines(np.array(shape.centre_mm), radius)]


def semi_axes(covariance_mm2: Array) -> Array:
    """(3, 3) one semi-axis per row, longest first: the ellipsoid that holds 95 % of a Gaussian, mm."""
    values, vectors = np.linalg.eigh(covariance_mm2)
    rows = (vectors * np.sqrt(np.maximum(values, 0.0))).T[::-1] * P95_GAUSSIAN
    # The sign of an eigenvector is free: the same picture on every machine needs one.
    leading = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    return np.asarray(np.where(leading < 0, -rows, rows))
