"""Whether a view's images allow another pose: the known trouble of flat structures.

From far away a plane and its mirror image about the line of sight are imaged alike (the Necker reversal); only
perspective tells them apart (Oberkampf, DeMenthon and Davis 1996).  So the other pose is looked for from the mirrored
one, and held against the noise of the images.  Seen head-on both are one, and the tilt is known as badly as
foreshortening, which begins with its square, is below the noise.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rotation import turn_by
from ..system import View
from .edges import THICK
from .least_squares import SplitProjection, images_of, resect_pose, split
from .resection import project

APART = 6.2  # standard deviations between the images of two poses: the wrong one is taken once in a thousand shots
SAME = 1e-3  # Frobenius distance of two rotations


class Rival(NamedTuple):
    """Another pose that a view's images allow."""

    normal: Array  # (3,) of the structure's plane, con
    rival_normal: Array  # (3,) the same in the other pose
    apart: float  # standard deviations between their images
    tilt_rad: float  # of the plane's normal from the line of sight


def find_rival(points: Array, view: View) -> Rival | None:
    """Another pose of points (n, 3), mm, assumed and imaged alike, whose images differ by less than ``APART``."""
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre, full_matrices=False)
    extent = np.ptp((points - centre) @ axes.T, axis=0)
    if extent[2] > THICK * extent[1]:
        return None
    camera = split(view.projection)
    images = project(view.projection, points)
    place = camera.rotation @ centre + camera.source_mm
    sight, normal = place / np.linalg.norm(place), camera.rotation @ axes[2]
    tilt = float(np.arccos(min(abs(sight @ normal), 1.0)))
    mirrored = (np.eye(3) - 2 * np.outer(sight, sight)) @ camera.rotation @ (np.eye(3) - 2 * np.outer(axes[2], axes[2]))
    start = camera.intrinsics @ np.column_stack([mirrored, place - mirrored @ centre])
    least = resect_pose(points, images, replace(view, projection=start))  # NaN where the way down is too flat to end
    for pose in (least, start):
        if np.isfinite(pose).all():
            other = split(pose).rotation
            apart = float(np.linalg.norm(project(pose, points) - images)) / max(view.fiducial_noise_px, 1e-300)
            if np.linalg.norm(other - camera.rotation) > SAME and apart < APART:
                return Rival(axes[2], camera.rotation.T @ other @ axes[2], apart, tilt)
    return _head_on(points, view, camera, axes, tilt)


def _head_on(points: Array, view: View, camera: SplitProjection, axes: Array, tilt: float) -> Rival | None:
    """The poses one standard deviation of tilt to either side, where foreshortening there is above the noise."""
    centre = points.mean(axis=0)
    place = camera.rotation @ centre + camera.source_mm
    image = images_of(camera.intrinsics, points - centre, camera.rotation, place, np.zeros(3))
    rows = image.slopes[..., :6].reshape(-1, 6)
    spread = view.fiducial_noise_px**2 * np.linalg.inv(rows.T @ rows)[:3, :3]
    within = camera.rotation @ axes[:2].T  # tilts about axes in the plane
    values, vectors = np.linalg.eigh(within.T @ spread @ within)
    axis = within @ vectors[:, 1]
    step = float(np.sqrt(values[1]))
    sides = [
        images_of(
            camera.intrinsics, points - centre, turn_by(s * step * axis) @ camera.rotation, place, np.zeros(3)
        ).images
        for s in (1.0, -1.0)
    ]
    bent = np.linalg.norm((sides[0] + sides[1]) / 2 - image.images)
    if bent <= view.fiducial_noise_px:
        return None
    normals = [camera.rotation.T @ turn_by(s * step * axis) @ camera.rotation @ axes[2] for s in (1.0, -1.0)]
    return Rival(normals[0], normals[1], 2.0, tilt)
