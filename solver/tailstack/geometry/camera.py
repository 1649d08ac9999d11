"""Pinhole X-ray cameras (Eq 1): projections from distances, intrinsics and pose, or a matrix.

A camera frame has its origin at the source, z along the principal ray, u along x and v along y.  A
projection P (3, 4) maps con mm to px and is kept scaled so that ``|P[2, :3]| = 1``; ``P[2] (X, 1)`` is
then the depth of X in mm, positive in front of the source.
"""

from __future__ import annotations

from itertools import combinations
from math import cos, floor, hypot, radians, sin, sqrt
from typing import Any

import numpy as np

from ..results import Vector3
from .arrays import Array
from .rotation import rigid_transform, unit

OVERLAP_PX = 10.0  # judgement: images closer than this are not told apart by every segmentation
BACKGROUND_PX = 3.0  # judgement: between two shadows, a pixel of background beside the blurred edge of each
ROUNDING_PX = 0.01  # images nearer by less than this keep their distance: beads rounded to 1 um move by less in them


def intrinsic_matrix(focal_px: tuple[float, float], principal_point_px: tuple[float, float], skew_px: float) -> Array:
    """K (3, 3): ``u = fx x/z + s y/z + cx``, ``v = fy y/z + cy``, px."""
    (fx, fy), (cx, cy) = focal_px, principal_point_px
    return np.array([[fx, skew_px, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def image_centre_px(image_size_px: tuple[int, int]) -> tuple[float, float]:
    """Centre of a (width, height) image when pixel centres are integers and the first is (0, 0)."""
    return (image_size_px[0] - 1) / 2, (image_size_px[1] - 1) / 2


def cross(first: Array, second: Array) -> Array:
    """Cross products of vectors (..., 3), of which numpy's own takes some ten times as long for one."""
    (a, b, c), (x, y, z) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack((b * z - c * y, c * x - a * z, a * y - b * x), axis=-1)


def aim(source_mm: Array, beam_direction: Array, up_direction: Array) -> Array:
    """Pose T_camera_con (4, 4) of a source at ``source_mm`` that looks along ``beam_direction``.

    z is the beam; u runs along beam x up and v downwards (along -up, made normal to the beam), so that
    AP (beam +y, up +z) has u along +x and v along -z.  All three are in con; directions need not be
    unit vectors.  The caller makes sure that beam and up are not parallel.
    """
    beam = unit(np.asarray(beam_direction, dtype=float))
    right = unit(cross(beam, np.asarray(up_direction, dtype=float)))
    rotation = np.array([right, cross(beam, right), beam])
    return rigid_transform(rotation, -rotation @ np.asarray(source_mm, dtype=float))


def intrinsics_of(camera: Array) -> Array:
    """(5,) focal length along u, skew, focal length along v, principal point (u, v), px; ``|camera[2, :3]| = 1``."""
    rows, third = camera[:2, :3], camera[2, :3]
    point = (rows * third).sum(axis=1)
    u, v = rows - point[:, None] * third
    focal_v = sqrt(float((v * v).sum()))
    skew = float((u * v).sum()) / focal_v
    rest = u - skew * v / focal_v
    return np.array([sqrt(float((rest * rest).sum())), skew, focal_v, *point])


def projection_from_pose(intrinsics: Array, T_camera_con: Array) -> Array:
    """``P = K [R | t]``, (3, 3) and (4, 4) -> (3, 4); con mm -> px.  Third row has unit length as K's last row is z."""
    return np.asarray(intrinsics @ T_camera_con[:3])


def projection_from_distances(
    source_detector_mm: float,
    source_isocentre_mm: float,
    pixel_mm: tuple[float, float],
    principal_point_px: tuple[float, float],
    isocentre_mm: Array,
    beam_direction: Array,
    up_direction: Array,
) -> Array:
    """Projection of a C-arm from the numbers on its data sheet; (3, 4), con mm -> px.

    The source sits ``source_isocentre_mm`` before the isocentre on the beam, the detector
    ``source_detector_mm`` from the source and normal to the beam: ``f = source_detector / pixel``.
    """
    beam = unit(np.asarray(beam_direction, dtype=float))
    pose = aim(np.asarray(isocentre_mm, dtype=float) - source_isocentre_mm * beam, beam, up_direction)
    focal = (source_detector_mm / pixel_mm[0], source_detector_mm / pixel_mm[1])
    return projection_from_pose(intrinsic_matrix(focal, principal_point_px, 0.0), pose)


def list_turns(cone_deg: float, step_deg: float) -> list[tuple[float, float]]:
    """Turns to the right and up, deg, on a square grid within the cone, the smallest first."""
    steps = floor(cone_deg / step_deg + 1e-9)
    grid = [(step_deg * k, step_deg * j) for k in range(-steps, steps + 1) for j in range(-steps, steps + 1)]
    return sorted((turn for turn in grid if hypot(*turn) <= cone_deg + 1e-9), key=lambda turn: (hypot(*turn), turn))


def turn_view(beam: Array, up: Array, right_deg: float, up_deg: float) -> tuple[Vector3, Vector3]:
    """Beam and image of a view (3,), turned together in the plane of the beam and the direction that is meant.

    Six decimals: what a record shows is what was scored.
    """
    ahead = unit(beam)
    right = unit(cross(ahead, up))
    top = cross(right, ahead)
    angle = radians(hypot(right_deg, up_deg))
    across = unit(right_deg * right + up_deg * top) if angle else top
    turned = cos(angle) * ahead + sin(angle) * across
    turned_top = top + (top @ across) * ((cos(angle) - 1) * across - sin(angle) * ahead)
    return _round(turned), _round(turned_top)


def _round(direction: Array) -> Vector3:
    x, y, z = (round(float(value), 6) + 0.0 for value in direction)
    return x, y, z


def camera_centre(projection: Array) -> Array:
    """Position of the source in con, (3,) mm: the null vector of a finite camera's P."""
    return np.asarray(-np.linalg.solve(projection[:, :3], projection[:, 3]))


def principal_ray(projection: Array) -> Array:
    """Unit vector of growing depth in con, (3,), for P with positive depth."""
    row = projection[2, :3]
    return np.asarray(row / np.linalg.norm(row))


def sines_between_rays(projections: Array, targets: Array) -> Array:
    """(T,) largest sine of the angle between two rays to each target (T, 3) from the sources of views (V, 3, 4)."""
    rays = targets[:, None] - np.array([camera_centre(projection) for projection in projections])
    rays /= np.sqrt((rays**2).sum(axis=2, keepdims=True))
    pairs = combinations(range(len(projections)), 2)
    return np.asarray(np.max([np.sqrt((cross(rays[:, v], rays[:, w]) ** 2).sum(axis=1)) for v, w in pairs], axis=0))


def image_of(rays: Array) -> Array:
    """(..., 2) px: images of points (..., 3) in homogeneous coordinates; floats, complex numbers or CasADi scalars."""
    return np.asarray(rays[..., :2] / rays[..., 2:])


def depths(projection: Array, points_mm: Array) -> Array:
    """Depth of points (N, 3), mm, for P scaled to ``|P[2, :3]| = 1``; (N,) mm, positive before the source."""
    return np.asarray(points_mm @ projection[2, :3] + projection[2, 3])


def scale_to_unit_depth(projection: Array, points_mm: Array) -> Array:
    """Scale P to ``|P[2, :3]| = 1`` with the sign that puts the *median* point of (N, 3) in front of the source.

    A projection matrix has no sign of its own; the median makes the outcome independent of a single
    point that really does lie behind the source (and is then reported as such).
    """
    scaled = projection / np.linalg.norm(projection[2, :3])
    return np.asarray(-scaled if np.median(depths(scaled, points_mm)) < 0 else scaled)


def needed_gap(projection: Array, radius_mm: float | None, depth: Any, other: Any) -> Any:
    """Distance, px, that the images of two fiducials at these depths, mm, need to be told apart.

    Of balls: the radius of both shadows, each by its own magnification, and some background between them.  A radius of
    None: how large the fiducials are is not known, and they need ``OVERLAP_PX``.  projection (3, 4), its last row of
    length 1; depths may be floats, arrays or symbols.
    """
    if radius_mm is None:
        return OVERLAP_PX + 0.0 * (depth + other)
    left = projection[:, :3]
    focal = max(float(np.linalg.norm(cross(row, left[2]))) for row in left[:2])
    return radius_mm * focal * (1 / depth + 1 / other) + BACKGROUND_PX
