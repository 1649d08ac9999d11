"""Whether the geometry determines the answer: what is refused, what is remarked, what each view sees.

Everything is looked at without noise, at the biased geometry.  A refusal names the direction in which the
data say nothing: the plane or line of the fiducials, the way a source may slide without changing an image
of a fiducial, the ray along which a target may lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import IllPosedError, Problem
from ..geometry.camera import camera_centre, depths
from ..geometry.naming import direction_name
from ..geometry.rotation import cross, displacement
from ..results import Finding, ViewCheck
from ..system import Array, Reading, System, View
from .resection import design_matrix, hartley_similarity, homogeneous, project

FEWEST = 6  # Eq 2: two rows a fiducial for eleven unknowns
TOUCHING_MM = 1e-3  # two fiducials closer than this are one
COLLINEAR = 1e-5  # second over first singular value of the centred fiducials
COPLANAR = 1e-5  # third over first
SINGULAR = 1e-6  # second smallest over largest singular value of the normalised design matrix
WEAK = 5e-3  # the same, for a warning: a 100 mm cube has 0.3, two plates 5 mm apart 0.02, 1 mm apart 0.004
FLAT = 0.15  # thickness over width, for a warning: the gain of noise grows as its inverse
NO_PARALLAX = 1e-4  # sine of the angle between two rays
SMALL_PARALLAX_DEG = 30.0
OVERLAP_PX = 10.0  # judgement: images closer than this are not told apart by every segmentation


def check_geometry(system: System) -> tuple[Finding, ...]:
    """Refuse what has no answer (IllPosedError with every reason of its kind), remark what is doubtful.

    Checked: number, distinctness and spread of the fiducials; depth and field of view of fiducials and
    targets; rank of the DLT in each view; angle between the rays to each target.
    """
    return examine(system)[0]


def examine(system: System) -> tuple[tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """:func:`check_geometry` and :func:`check_views` at once."""
    findings = _check_fiducials(system)
    imaged = imaged_fiducials(system)
    seen = [_see(view, imaged) for view in system.views]
    views = tuple(_check_view(system, view, each) for view, each in zip(system.views, seen, strict=True))
    findings += _check_visibility(system, views, imaged)
    findings += _check_resection(system, [each.images for each in seen])
    return (*findings, *_check_triangulation(system)), views


def imaged_fiducials(system: System) -> Array:
    """Where the fiducials stand when they are imaged: (N, 3) mm, con (conventions, *two readings*)."""
    if system.reading is Reading.EQ18:
        return system.fiducials_mm
    mount = system.interface_1
    at = displacement(mount.bias, mount.pivot_mm, system.rotation_form)
    return np.asarray(system.fiducials_mm @ at.rotation.T + at.shift_mm)


def check_views(system: System) -> tuple[ViewCheck, ...]:
    """Depths, margins and closest pair of images of the fiducials in each view, noise-free.

    A margin is the distance of an image from the nearest edge of the image, negative outside; a point at
    or behind the source counts as outside.
    """
    imaged = imaged_fiducials(system)
    return tuple(_check_view(system, view, _see(view, imaged)) for view in system.views)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The fiducials in one view."""

    depth: Array  # (N,) mm
    in_front: NDArray[np.bool_]  # (N,)
    images: Array  # (N, 2) px; NaN where not in front


def _see(view: View, points: Array) -> _Seen:
    depth = depths(view.projection, points)
    in_front = depth > 0
    if in_front.all():
        return _Seen(depth, in_front, project(view.projection, points))
    images = np.full((len(points), 2), np.nan)
    images[in_front] = project(view.projection, points[in_front])
    return _Seen(depth, in_front, images)


def _check_view(system: System, view: View, seen: _Seen) -> ViewCheck:
    in_front, images = seen.in_front, seen.images
    labels: Sequence[str] = system.fiducial_labels
    outside = ~in_front
    smallest = None
    if view.image_size_px is not None and in_front.any():
        margin = _margins(images, view.image_size_px)
        outside = outside | (margin < 0)
        smallest = float(np.nanmin(margin))
    out = tuple(labels[i] for i in np.flatnonzero(outside).tolist())
    if not in_front.all():
        images = images[in_front]
        labels = [labels[i] for i in np.flatnonzero(in_front).tolist()]
    pair, distance = closest_pair(images)
    return ViewCheck(
        view=view.name,
        checked=view.image_size_px is not None,
        depth_range_mm=(float(seen.depth.min()), float(seen.depth.max())),
        outside=out,
        smallest_margin_px=smallest,
        closest_pair=(labels[pair[0]], labels[pair[1]]) if len(labels) > 1 else ("", ""),
        closest_pair_px=distance,
    )


def _margins(images: Array, size: tuple[int, int]) -> Array:
    """Distance to the nearest edge; pixel centres are integers, so the image spans -0.5 ... size - 0.5."""
    far = np.array((size[0] - 0.5, size[1] - 0.5))
    return np.asarray(np.minimum(images + 0.5, far - images).min(axis=-1))


def closest_pair(points: Array) -> tuple[tuple[int, int], float]:
    """Indices and distance of the two closest of (N, d) points; infinity when there are fewer than two."""
    if len(points) < 2:
        return (0, 0), float("inf")
    local = points - points.mean(axis=0)
    square = (local**2).sum(axis=1)
    distance = square[:, None] + square - 2 * local @ local.T
    distance.ravel()[:: len(points) + 1] = np.inf
    first, second = divmod(int(distance.argmin()), len(points))
    apart = points[first] - points[second]
    return (min(first, second), max(first, second)), sqrt(float(apart @ apart))


# --- fiducials --------------------------------------------------------------------------------------


def _refuse(pointer: str, code: str, detail: str, hint: str) -> Problem:
    return Problem(pointer, code, detail, hint)


def _check_fiducials(system: System) -> list[Finding]:
    points, labels = system.fiducials_mm, system.fiducial_labels
    if len(points) < FEWEST:
        raise IllPosedError(
            _refuse(
                "/fiducials",
                "too-few-fiducials",
                f"a projection has 11 unknowns and a fiducial gives 2 equations; {len(points)} fiducials arrived",
                f"use at least {FEWEST}; 8 or more give a margin",
            )
        )
    (first, second), distance = closest_pair(points)
    if distance < TOUCHING_MM:
        raise IllPosedError(
            _refuse(
                "/fiducials",
                "duplicate-fiducials",
                f"{labels[first]} and {labels[second]} are at the same place ({distance:.2g} mm apart)",
                "move or remove one of them",
            )
        )
    centred = points - points.mean(axis=0)
    _, values, axes = np.linalg.svd(centred, full_matrices=False)
    if values[1] < COLLINEAR * values[0]:
        raise IllPosedError(
            _refuse(
                "/fiducials",
                "collinear-fiducials",
                f"the fiducials lie on one line along {direction_name(axes[0])}: nothing is known about turning "
                "about it, nor across it",
                "spread them in three dimensions",
            )
        )
    thickness = _extent(centred, axes[2])
    if values[2] < COPLANAR * values[0]:
        raise IllPosedError(
            _refuse(
                "/fiducials",
                "coplanar-fiducials",
                f"the fiducials lie in one plane with normal {direction_name(axes[2])} (thickness {thickness:.2g} mm): "
                f"no view can tell depth along {direction_name(axes[2])} from its focal length",
                f"lift at least two fiducials off the plane, along {direction_name(axes[2])}; the more the better",
            )
        )
    width = _extent(centred, axes[1])
    if thickness < FLAT * width:
        return [
            Finding(
                "flat-structure",
                "warning",
                f"the structure is flat: {thickness:.3g} mm thick along {direction_name(axes[2])}, {width:.3g} mm "
                "wide; image noise is amplified about in the inverse ratio",
                "/fiducials",
                thickness,
                FLAT * width,
            )
        ]
    return []


def _extent(centred: Array, direction: Array) -> float:
    """Of points (N, 3) along a unit vector."""
    along = centred @ direction
    return float(along.max() - along.min())


# --- what each view sees ----------------------------------------------------------------------------


def _check_visibility(system: System, checks: tuple[ViewCheck, ...], imaged: Array) -> list[Finding]:
    problems: list[Problem] = []
    findings: list[Finding] = []
    points = np.concatenate([imaged, [target.position_mm for target in system.targets]])
    for index, (view, check) in enumerate(zip(system.views, checks, strict=True)):
        pointer = f"/views/{index}"
        depth = depths(view.projection, points)
        behind = [_name_of(system, index) for index in np.flatnonzero(depth <= 0).tolist()]
        if behind:
            listed = ", ".join(behind[:6]) + (f" and {len(behind) - 6} more" if len(behind) > 6 else "")
            problems.append(
                _refuse(
                    pointer,
                    "behind-source",
                    f"the source of view {view.name} cannot image what lies behind it, by up to "
                    f"{-float(depth.min()):.4g} mm: {listed}",
                    "check the direction of the beam, the isocentre and the frame of the coordinates",
                )
            )
        if view.image_size_px is None:
            text = f"the image size of view {view.name} is not stated: the field of view was not checked"
            findings.append(Finding("field-of-view-not-checked", "note", text, pointer))
        elif (depth > 0).all():
            problems += _outside(system, view, view.image_size_px, points, pointer)
        if check.closest_pair_px < OVERLAP_PX:
            findings.append(
                Finding(
                    "projected-overlap",
                    "warning",
                    f"the images of {check.closest_pair[0]} and {check.closest_pair[1]} in view {view.name} are "
                    f"{check.closest_pair_px:.1f} px apart: they may not be told apart",
                    pointer,
                    check.closest_pair_px,
                    OVERLAP_PX,
                )
            )
    if problems:
        raise IllPosedError(problems[:20])
    return findings


def _name_of(system: System, index: int) -> str:
    """Of the point of this index where targets follow fiducials."""
    labels = system.fiducial_labels
    if index < len(labels):
        return f"fiducial {labels[index]}"
    return f"target {system.targets[index - len(labels)].name}"


def _outside(system: System, view: View, size: tuple[int, int], points: Array, pointer: str) -> list[Problem]:
    images = project(view.projection, points)
    margin = _margins(images, size)
    return [
        _refuse(
            pointer,
            "outside-view",
            f"{_name_of(system, index)} is imaged at ({images[index, 0]:.0f}, {images[index, 1]:.0f}) px, "
            f"{-margin[index]:.0f} px outside view {view.name} ({size[0]} x {size[1]} px)",
            "move it, the isocentre or the source; a longer source_isocentre_mm widens the field",
        )
        for index in np.flatnonzero(margin < 0).tolist()
    ]


# --- resection --------------------------------------------------------------------------------------


def _check_resection(system: System, seen: Sequence[Array]) -> list[Finding]:
    """seen: (N, 2) px of the fiducials in each view."""
    told = system.fiducials_mm
    object_frame = hartley_similarity(told)
    points = homogeneous(told) @ object_frame.T
    findings = []
    for view, images in zip(system.views, seen, strict=True):
        image_frame = hartley_similarity(images)
        rows = design_matrix(points, (homogeneous(images) @ image_frame.T)[:, :2])
        values = np.linalg.svd(rows, compute_uv=False)
        strength = float(values[10] / values[0])
        if strength > WEAK:
            continue
        right = np.linalg.svd(rows, full_matrices=False)[2]
        estimate = np.linalg.solve(image_frame, right[11].reshape(3, 4) @ object_frame)
        change = np.linalg.solve(image_frame, right[10].reshape(3, 4) @ object_frame)
        motion = f"the source of view {view.name} may slide along {_slide(estimate, change)}"
        if strength < SINGULAR:
            raise IllPosedError(
                _refuse(
                    "/fiducials",
                    "singular-resection",
                    f"{_why(system)}: {motion}, its focal length and principal point following, without changing "
                    "the image of any fiducial",
                    "move two or more fiducials off the plane of the others, or add fiducials"
                    if _odd_one_out(told) is not None
                    else "move or add a fiducial off the curve",
                )
            )
        findings.append(
            Finding(
                "weak-resection",
                "warning",
                f"view {view.name} is barely determined: {motion} almost without changing an image of a fiducial",
                "/fiducials",
                strength,
                WEAK,
            )
        )
    return findings


def _slide(estimate: Array, change: Array) -> str:
    """How the centre c of P moves when P changes by D: from P (c, 1) = 0, P[:, :3] dc = -D (c, 1)."""
    centre = camera_centre(estimate)
    step = np.linalg.solve(estimate[:, :3], -change @ np.append(centre, 1.0))
    return direction_name(step)


def _why(system: System) -> str:
    odd = _odd_one_out(system.fiducials_mm)
    if odd is None:
        return "the source and all fiducials lie on one twisted cubic curve"
    label, normal = system.fiducial_labels[odd[0]], direction_name(odd[1])
    return f"all fiducials but {label} lie in one plane with normal {normal}"


def _odd_one_out(points: Array) -> tuple[int, Array] | None:
    """The one fiducial without which the others are coplanar, and the normal of their plane."""
    for index in range(len(points)):
        rest = np.delete(points, index, axis=0)
        _, values, axes = np.linalg.svd(rest - rest.mean(axis=0), full_matrices=False)
        if values[2] < 10 * COPLANAR * values[0]:
            return index, axes[2]
    return None


# --- triangulation ----------------------------------------------------------------------------------


def _check_triangulation(system: System) -> list[Finding]:
    centres = np.array([camera_centre(view.projection) for view in system.views])
    names = ", ".join(view.name for view in system.views)
    pairs = list(combinations(range(len(centres)), 2))
    findings = []
    for target in system.targets:
        rays = target.position_mm - centres
        reach = np.sqrt((rays**2).sum(axis=1))
        rays = rays / reach[:, None]
        sine = max(sqrt(sum(x * x for x in cross(rays[a], rays[b]).tolist())) for a, b in pairs)
        if sine < NO_PARALLAX:
            spread = float(np.linalg.norm(centres - centres[0], axis=1).max())
            to_structure = float(np.linalg.norm(centres - system.fiducials_mm.mean(axis=0), axis=1).min())
            along = direction_name(rays[0])
            if spread < NO_PARALLAX * to_structure:
                raise IllPosedError(
                    _refuse(
                        "/views",
                        "same-source",
                        f"the sources of views {names} coincide: nothing is known of target {target.name} along "
                        f"{along}, the ray to it",
                        "take a second view from another side; 60 to 120 degrees between views is best",
                    )
                )
            near = reach.min() < 10 * spread
            reason = "lies on the line through the sources" if near else "is so far that the rays to it are parallel"
            raise IllPosedError(
                _refuse(
                    "/targets",
                    "target-on-baseline" if near else "target-too-far",
                    f"target {target.name} {reason} (views {names}): nothing is known of it along {along}",
                    "turn one view out of that line" if near else "bring the target nearer or the views apart",
                )
            )
        angle = float(np.degrees(np.arcsin(min(sine, 1.0))))
        if angle < SMALL_PARALLAX_DEG:
            findings.append(
                Finding(
                    "small-parallax",
                    "warning",
                    f"the rays to target {target.name} meet at {angle:.1f} degrees at most: depth along "
                    f"{direction_name(rays.sum(axis=0))} is poorly known",
                    "/views",
                    angle,
                    SMALL_PARALLAX_DEG,
                )
            )
    return findings
