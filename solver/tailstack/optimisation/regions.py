"""Where fiducials may and may not be: boxes, cylinders and balls in con, what is near a surface, and the isometries of
a symmetric layout.

Positions are in mm.  Functions marked ArrayLike take floats, arrays over many points, or CasADi scalars: they use
+ - * / alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from itertools import product
from math import hypot, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..system import ArrayLike
from .surface import NearSurface
from .symbols import plain

GRID_MM = 1e-3  # that positions are written to: rounding moves none by as much
ROUNDING = 1e-9  # of a scaled piece: a point on the border of a keep-out zone is clear


@dataclass(frozen=True, slots=True, eq=False)
class BoxRegion:
    """Axis-parallel box; an axis may have no extent."""

    low_mm: Array  # (3,)
    high_mm: Array  # (3,)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A tube when the inner radius is above zero, its surface when both radii agree, a disc when the height is 0."""

    base_mm: Array  # (3,) centre of the base
    axis: Array  # (3,) unit vector from base to top
    height_mm: float
    radius_mm: float  # above zero
    inner_radius_mm: float = 0.0
    towards: Array | None = None  # (3,) unit vector across the axis: the middle of a sector; None: all round
    half_angle: float = pi  # of the sector, rad

    @property
    def directions(self) -> tuple[Array, Array]:
        """Two unit vectors that make a right-handed frame with the axis: the first is the middle of the sector."""
        return across_axis(self.axis) if self.towards is None else (self.towards, np.cross(self.axis, self.towards))


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """A shell when the inner radius is above zero, a sphere when both radii agree."""

    centre_mm: Array  # (3,)
    radius_mm: float  # above zero
    inner_radius_mm: float = 0.0


Solid = BoxRegion | Cylinder | Ball
Shape = Solid | NearSurface


@dataclass(frozen=True, slots=True, eq=False)
class KeepOut:
    """Where no moved fiducial may be, with the distance to be kept from it."""

    name: str
    shape: Solid  # no sector
    clearance_mm: float
    pointer: str = "/optimise/keep_out"


@dataclass(frozen=True, slots=True, eq=False)
class Isometry:
    """``x -> rotation @ x + shift_mm``; the rotation may be a reflection."""

    rotation: Array  # (3, 3) orthogonal
    shift_mm: Array  # (3,)


def distinct(shapes: Iterable[Shape]) -> tuple[tuple[Shape, ...], tuple[int, ...]]:
    """The different regions among ``shapes``, in order of appearance, and which of them each is."""
    by_key: dict[tuple[object, ...], tuple[int, Shape]] = {}
    which = []
    for shape in shapes:
        values = (getattr(shape, entry.name) for entry in fields(shape))
        key = (type(shape), *(tuple(np.atleast_1d(value).tolist()) for value in values))
        which.append(by_key.setdefault(key, (len(by_key), shape))[0])
    return tuple(shape for _, shape in by_key.values()), tuple(which)


def corners(low_high_mm: Array) -> Array:
    """(8, 3) corners of a (2, 3) box."""
    return np.array(list(product(*low_high_mm.T)))


def bounding_box(shape: Shape) -> Array:
    """(2, 3) lowest and highest coordinates, mm, each reached (of a sector by the whole cylinder)."""
    if isinstance(shape, BoxRegion):
        return np.array([shape.low_mm, shape.high_mm])
    if isinstance(shape, NearSurface):
        return shape.box_mm
    if isinstance(shape, Ball):
        return np.array([shape.centre_mm - shape.radius_mm, shape.centre_mm + shape.radius_mm])
    ends = np.array([shape.base_mm, shape.base_mm + shape.height_mm * shape.axis])
    reach = shape.radius_mm * np.sqrt(np.maximum(1 - shape.axis**2, 0.0))
    return np.array([ends.min(axis=0) - reach, ends.max(axis=0) + reach])


def enlarge(shape: Solid, about_mm: Array, factor: float) -> Solid:
    """The region with every distance from a point (3,) multiplied, its inner radius too; a sector keeps its angle."""

    def move_out(point: Array) -> Array:
        return about_mm + factor * (point - about_mm)

    if isinstance(shape, BoxRegion):
        return BoxRegion(move_out(shape.low_mm), move_out(shape.high_mm))
    outer, inner = factor * shape.radius_mm, factor * shape.inner_radius_mm
    if isinstance(shape, Ball):
        return Ball(move_out(shape.centre_mm), outer, inner)
    base, height = move_out(shape.base_mm), factor * shape.height_mm
    return replace(shape, base_mm=base, height_mm=height, radius_mm=outer, inner_radius_mm=inner)


def diameter_mm(shape: Shape) -> float:
    """Largest distance between two points of the region, or more."""
    if isinstance(shape, BoxRegion):
        return float(np.linalg.norm(shape.high_mm - shape.low_mm))
    if isinstance(shape, NearSurface):
        return float(np.linalg.norm(np.diff(shape.box_mm, axis=0)))
    height = shape.height_mm if isinstance(shape, Cylinder) else 0.0
    return hypot(2 * shape.radius_mm, height)


def contains(shape: Shape, points: Array, tolerance_mm: float = 1e-6) -> NDArray[np.bool_]:
    """(M,) whether points (M, 3) lie in the region, or within the tolerance of it."""
    return np.asarray(np.linalg.norm(clip(shape, points) - points, axis=1) <= tolerance_mm)


def clip(shape: Shape, points: Array) -> Array:
    """(M, 3) nearest points of the region; from the axis of a tube or the centre of a shell, in a fixed direction."""
    if isinstance(shape, BoxRegion):
        return np.clip(points, shape.low_mm, shape.high_mm)
    if isinstance(shape, NearSurface):
        return shape.clip(points)
    if isinstance(shape, Ball):
        return shape.centre_mm + _between(points - shape.centre_mm, np.eye(3)[0], shape)
    offset = points - shape.base_mm
    along = offset @ shape.axis
    across = _within_sector(offset - along[:, None] * shape.axis, shape)
    return shape.base_mm + across + np.clip(along, 0, shape.height_mm)[:, None] * shape.axis


def _between(offset: Array, fallback: Array, shape: Cylinder | Ball) -> Array:
    """Offsets (M, 3) with their lengths brought between the radii; those without direction take the fallback's."""
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    direction = np.where(length > 0, offset / np.where(length > 0, length, 1.0), fallback)
    within = (length >= shape.inner_radius_mm) & (length <= shape.radius_mm)
    return np.where(within, offset, direction * np.clip(length, shape.inner_radius_mm, shape.radius_mm))


def _within_sector(across: Array, shape: Cylinder) -> Array:
    """Offsets (M, 3) from the axis brought between the radii, and to the nearest side of a sector from beside it."""
    placed = _between(across, shape.directions[0], shape)
    if shape.towards is None:
        return placed
    first, second = (across @ each for each in shape.directions)
    beside = np.abs(np.arctan2(second, first)) > shape.half_angle
    edge = np.cos(shape.half_angle) * shape.directions[0][None, :]
    edge = edge + np.where(second < 0, -1.0, 1.0)[:, None] * np.sin(shape.half_angle) * shape.directions[1]
    along = np.clip((across * edge).sum(axis=1), shape.inner_radius_mm, shape.radius_mm)
    return np.where(beside[:, None], along[:, None] * edge, placed)


def across_axis(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with a unit axis, first those two."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


def sample(shape: Shape, rng: np.random.Generator, count: int, on_surface: float) -> Array:
    """(count, 3) random points: uniform, then moved outwards with a probability.

    ``on_surface`` is the probability that a coordinate (of a box, or along the axis of a cylinder) goes to the
    nearer end, and that a radius becomes the outer one.
    """
    if isinstance(shape, BoxRegion):
        unit = rng.uniform(-1, 1, (count, 3))
        unit = np.where(rng.random(unit.shape) < on_surface, np.sign(unit), unit)
        return (shape.low_mm + shape.high_mm) / 2 + (shape.high_mm - shape.low_mm) / 2 * unit
    if isinstance(shape, NearSurface):
        return shape.sample(rng, count, on_surface)
    unit = rng.random((count, 3))
    outwards = rng.random((count, 2)) < on_surface
    angle = 2 * pi * unit[:, 1]
    inner, outer = shape.inner_radius_mm, shape.radius_mm
    power = 3 if isinstance(shape, Ball) else 2
    radius = (inner**power + unit[:, 0] * (outer**power - inner**power)) ** (1 / power)
    radius = np.where(outwards[:, 0], outer, radius)
    if isinstance(shape, Ball):
        height = 2 * unit[:, 2] - 1  # Archimedes: uniform on the sphere
        ring = np.sqrt(1 - height**2)
        direction = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
        return np.asarray(shape.centre_mm + radius[:, None] * direction)
    along = np.where(outwards[:, 1], np.round(unit[:, 2]), unit[:, 2]) * shape.height_mm
    first, second = shape.directions
    angle = shape.half_angle * (angle / pi - 1) if shape.towards is not None else angle
    across = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return np.asarray(shape.base_mm + radius[:, None] * across + along[:, None] * shape.axis)


def inside_rows(shape: Shape, point: ArrayLike) -> list[tuple[str, Any, bool]]:
    """(name, expression about 1 in size, equality) of each face: ``>= 0`` inside, ``== 0`` where equality.

    ArrayLike: point (3,).  Polynomials of the position, at most squares, and of a sector a root.  What is near a
    surface has none: its rows are those of a spline.
    """
    rows: list[tuple[str, Any, bool]] = []
    if isinstance(shape, BoxRegion):
        extent = shape.high_mm - shape.low_mm
        largest = float(extent.max()) or 1.0
        for k, axis in enumerate("xyz"):
            low, high, size = float(shape.low_mm[k]), float(shape.high_mm[k]), float(extent[k])
            if size > 0:
                rows.append((f"lower {axis} face", (point[k] - low) / size, False))
                rows.append((f"upper {axis} face", (high - point[k]) / size, False))
            else:
                rows.append((f"{axis} plane", (point[k] - low) / largest, True))
        return rows
    if isinstance(shape, NearSurface):
        return rows
    inner, outer = float(shape.inner_radius_mm), float(shape.radius_mm)
    across, along = _across_and_along(shape, point)
    if inner == outer:
        rows.append(("surface", across / outer**2 - 1, True))
    else:
        rows.append(("outer radius", 1 - across / outer**2, False))
        if inner > 0:
            rows.append(("inner radius", (across - inner**2) / outer**2, False))
    if isinstance(shape, Cylinder):
        height = float(shape.height_mm)
        rows += _sector_rows(shape, point)
        if height > 0:
            rows.append(("base", along / height, False))
            rows.append(("top", 1 - along / height, False))
        else:
            rows.append(("plane of the disc", along / outer, True))
    return rows


def _sector_rows(shape: Cylinder, point: ArrayLike) -> list[tuple[str, Any, bool]]:
    """Two planes where the sector is no more than half a turn; beyond, where it has no axis, a cosine."""
    if shape.towards is None:
        return []
    offset = [point[k] - float(shape.base_mm[k]) for k in range(3)]
    middle, turned = (_dot(each, offset) for each in shape.directions)
    sine, cosine = float(np.sin(shape.half_angle)), float(np.cos(shape.half_angle))
    if cosine < 0:
        beyond = middle - cosine * (middle**2 + turned**2) ** 0.5
        return [("side of the sector", beyond / (shape.radius_mm * (1 - cosine)), False)]
    ends = (("first", turned), ("second", -turned))
    return [(f"{name} side", (sine * middle + cosine * way) / shape.radius_mm, False) for name, way in ends]


def _across_and_along(shape: Cylinder | Ball, point: ArrayLike) -> tuple[Any, Any]:
    """Squared distance from the axis (or the centre), and the coordinate along the axis (0 for a ball)."""
    origin = shape.centre_mm if isinstance(shape, Ball) else shape.base_mm
    offset = [point[k] - float(origin[k]) for k in range(3)]
    if isinstance(shape, Ball):
        return sum(value * value for value in offset), 0.0
    first, second = across_axis(shape.axis)
    u, v = _dot(first, offset), _dot(second, offset)
    return u * u + v * v, _dot(shape.axis, offset)


def _dot(direction: Array, offset: list[Any]) -> Any:
    return sum(value * float(part) for part, value in zip(direction, offset, strict=True))


def outside_pieces(zone: KeepOut, point: ArrayLike) -> list[tuple[str, Any]]:
    """(name, expression about 1 in size) of the pieces of the outside: a point is clear iff any is ``>= 0``.

    ArrayLike: point (3,), or (3, M) for many points at once.  Each face is moved out by the clearance, which at the
    edges and corners of a box, and at the rims of a cylinder, keeps more than the clearance (conservative).
    """
    shape, gap = zone.shape, float(zone.clearance_mm)
    pieces: list[tuple[str, Any]] = []
    if isinstance(shape, BoxRegion):
        scale = float((shape.high_mm - shape.low_mm).max()) / 2 + gap or 1.0
        for k, axis in enumerate("xyz"):
            low, high = float(shape.low_mm[k]), float(shape.high_mm[k])
            pieces.append((f"lower {axis} face", (low - gap - point[k]) / scale))
            pieces.append((f"upper {axis} face", (point[k] - (high + gap)) / scale))
        return pieces
    inner, outer = float(shape.inner_radius_mm) - gap, float(shape.radius_mm) + gap
    across, along = _across_and_along(shape, point)
    pieces.append(("side" if isinstance(shape, Cylinder) else "surface", across / outer**2 - 1))
    if isinstance(shape, Cylinder):
        height = float(shape.height_mm)
        scale = max(height / 2, outer)
        pieces.append(("base", (-gap - along) / scale))
        pieces.append(("top", (along - (height + gap)) / scale))
    if inner > 0:
        pieces.append(("inner radius", (inner**2 - across) / outer**2))
    return pieces


def clear_of(zone: KeepOut, points: Array) -> NDArray[np.bool_]:
    """(M,) whether points (M, 3) keep the clearance from the zone."""
    return np.asarray(np.array([value for _, value in outside_pieces(zone, points.T)]).max(axis=0) >= -ROUNDING)


def clearest_piece(zone: KeepOut, points: Array) -> NDArray[np.int64]:
    """(M,) index into :func:`outside_pieces` of the piece that each point (M, 3) is furthest into."""
    return np.asarray(np.array([value for _, value in outside_pieces(zone, points.T)]).argmax(axis=0))


def mirror(point_mm: Array, normal: Array) -> tuple[Isometry]:
    """Reflection in the plane through a point with a normal of any length."""
    unit = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return (Isometry(np.eye(3) - 2 * np.outer(unit, unit), 2 * float(unit @ point_mm) * unit),)


def turns(point_mm: Array, axis: Array, order: int) -> tuple[Isometry, ...]:
    """The ``order - 1`` rotations by multiples of 360/order degrees about the line through a point (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    isometries = []
    for k in range(1, order):
        angle = 2 * pi * k / order
        rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        isometries.append(Isometry(rotation, np.asarray(point_mm) - rotation @ point_mm))
    return tuple(isometries)


def move(isometry: Isometry, points: ArrayLike) -> ArrayLike:
    """Points (..., 3) after the isometry.  ArrayLike."""
    if np.asarray(points).dtype == object:
        return points @ plain(isometry.rotation).T + plain(isometry.shift_mm)
    return points @ isometry.rotation.T + isometry.shift_mm
