"""Whether the geometry determines the answer: what is refused, what is remarked, what each view sees.

Everything is looked at without noise, at the biased geometry.  A refusal names the direction in which the
data say nothing: the plane or line of the fiducials, the way a source may slide without changing an image
of a fiducial, the ray along which a target may lie.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import asin, degrees
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import IllPosedError, Problem
from ..geometry.arrays import Array, frozen
from ..geometry.camera import OVERLAP_PX, ROUNDING_PX, camera_centre, needed_gap, sines_between_rays
from ..geometry.rotation import displacement, turn_by
from ..results import Finding, ViewCheck
from ..results.digits import at_least, at_most
from ..system import Reading, System, View, Weighing
from .least_squares import SplitProjection, images_of, resect_pose, split
from .resection import (
    COLLINEAR,
    COPLANAR,
    NO_PARALLAX,
    SINGULAR,
    THICK,
    TOUCHING_MM,
    design_matrix,
    hartley_similarity,
    homogeneous,
    project,
)

WEAK = 5e-3  # the same, for a warning: a 100 mm cube has 0.3, two plates 5 mm apart 0.02, 1 mm apart 0.004
FLAT = 0.15  # thickness over width, for a warning: the gain of noise grows as its inverse
SMALL_PARALLAX_DEG = 30.0


def check_geometry(system: System) -> tuple[Finding, ...]:
    """Refuse what has no answer (IllPosedError with every reason of its kind), remark what is doubtful.

    Checked: number, distinctness and spread of the fiducials; depth and field of view of fiducials and
    targets; rank of the DLT in each view; angle between the rays to each target.
    """
    return examine(system)[0]


def examine(system: System) -> tuple[tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """:func:`check_geometry` and :func:`check_views` at once."""
    seen, sights, fewest = shares(system), look(system), system.estimator.traits.fewest_fiducials
    check = _check_few if system.estimator.believes_intrinsics else _check_fiducials
    findings = check(Share("/fiducials", "", system.fiducial_labels, system.fiducials_mm), fewest)
    for share, each in zip(seen, sights, strict=True):
        if each.view.sees is not None:
            findings += check(share, fewest)
    views = _check_views(system, seen, sights)
    findings += _check_visibility(system, seen, views, sights)
    if system.estimator.believes_intrinsics:
        _check_poses(system, seen)
    else:
        findings += _check_resection(seen, sights)
    _check_noise(system)
    return (*findings, *_check_triangulation(system)), views


class Share(NamedTuple):
    """The fiducials that a view sees, or all of them."""

    pointer: str  # what lists them in the document
    view: str  # "view NAME: ", or nothing for all of them
    labels: tuple[str, ...]
    points: Array  # (n, 3) mm, nominal


def shares(system: System) -> tuple[Share, ...]:
    """What each view sees."""
    entries = []
    for index, (view, weights) in enumerate(zip(system.views, system.sees, strict=True)):
        if view.sees is None:
            entries.append(Share("/fiducials", "", system.fiducial_labels, system.fiducials_mm))
        else:
            labels = tuple(label for label, seen in zip(system.fiducial_labels, weights, strict=True) if seen)
            who = f"view {view.name}: "
            entries.append(Share(f"/views/{index}/sees", who, labels, system.fiducials_mm[weights > 0]))
    return tuple(entries)


def imaged_fiducials(system: System) -> Array:
    """Where the fiducials stand when they are imaged: (N, 3) mm, con (conventions, *two readings*)."""
    if system.reading is Reading.EQ18:
        return system.fiducials_mm
    mount = system.structure_connector
    at = displacement(mount.known, mount.pivot_mm, system.rotation_form)
    return np.asarray(system.fiducials_mm @ at.rotation.T + at.shift_mm)


def check_views(system: System) -> tuple[ViewCheck, ...]:
    """Depths, margins and closest pair of images of the fiducials in each view, noise-free.

    A margin is the distance of an image from the nearest edge of the image, negative outside; a point at
    or behind the source counts as outside.
    """
    return _check_views(system, shares(system), look(system))


def _check_views(system: System, seen: Sequence[Share], sights: Sequence[Sight]) -> tuple[ViewCheck, ...]:
    radius = system.fiducial_radius_mm
    return tuple(_check_view(share, each, radius) for share, each in zip(seen, sights, strict=True))


def needed_gaps(view: View, radius_mm: float | None, depth: Array) -> Array:
    """(N, N) px that the images of any two fiducials at these depths (N,), mm, need to be told apart."""
    return np.asarray(needed_gap(view.projection, radius_mm, depth[:, None], depth), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """The N fiducials that a view sees, as they stand when they are imaged, and behind them the T targets."""

    view: View
    depth: Array  # (N + T,) mm
    images: Array  # (N + T, 2) px; NaN where not in front
    margin: Array  # (N + T,) px; NaN where not in front, or where the size of the image is not stated

    @property
    def clear(self) -> bool:
        """Everything is in front of the source and, where its size is stated, inside the image."""
        return bool((self.depth > 0).all()) and not (self.margin < 0).any()


def sight(view: View, points: Array) -> Sight:
    """Where points (N, 3) mm are seen.

    A margin is the distance of an image from the nearest edge of the image, negative outside: pixel centres are
    integers, the image spans -0.5 ... size - 0.5.
    """
    projected = homogeneous(points) @ view.projection.T
    depth = projected[:, 2]
    with np.errstate(over="ignore"):  # a point almost in the plane of the source is imaged beyond any edge
        images = projected[:, :2] / np.where(depth > 0, depth, np.nan)[:, None]
    size = np.array(view.image_size_px or (np.nan, np.nan), dtype=np.float64)
    return Sight(view, depth, images, np.minimum(images + 0.5, size - 0.5 - images).min(axis=1))


def closest_two(points: Array) -> tuple[int, int, float]:
    """Indices, ascending, and distance of the two closest of points (N, d); (0, 0, inf) when there are fewer than two.

    Points that are not finite are close to nothing.
    """
    apart = _distances(points)
    first, second = divmod(int(apart.argmin()), len(points))
    return first, second, float(apart[first, second])


def _distances(points: Array) -> Array:
    """(N, N) between each of points (N, d) and those after it; inf elsewhere, and to points that are not finite."""
    apart = np.sqrt(((points[:, None] - points) ** 2).sum(axis=2))
    return np.where(_later(len(points)) & (apart >= 0), apart, np.inf)


@lru_cache(maxsize=64)
def _later(count: int) -> NDArray[np.bool_]:
    """(N, N) True where the second of two comes after the first."""
    return frozen(np.triu(np.ones((count, count), dtype=np.bool_), 1), np.bool_)


def look(system: System) -> list[Sight]:
    points, targets = imaged_fiducials(system), [target.position_mm for target in system.targets]
    each = zip(system.views, system.sees, strict=True)
    return [sight(view, np.concatenate([points[weights > 0], targets])) for view, weights in each]


def _check_view(share: Share, sight: Sight, radius_mm: float | None) -> ViewCheck:
    labels, view = share.labels, sight.view
    depth, margin = sight.depth[: len(labels)], sight.margin[: len(labels)]
    outside = ~(depth > 0) | (margin < 0)
    images = sight.images[: len(labels)]
    apart = _distances(images)
    first, second = divmod(int(apart.argmin()), len(images))
    distance = float(apart[first, second])
    needed = needed_gaps(view, radius_mm, np.where(depth > 0, depth, np.nan))
    if radius_mm is not None and first < second:
        needed -= ROUNDING_PX
        to_spare = apart - needed
        first, second = divmod(int(np.where(np.isnan(to_spare), np.inf, to_spare).argmin()), len(images))
        distance = float(apart[first, second])
    return ViewCheck(
        view=view.name,
        checked=view.image_size_px is not None,
        depth_range_mm=(float(depth.min()), float(depth.max())),
        outside=tuple(labels[i] for i in np.flatnonzero(outside).tolist()),
        smallest_margin_px=None if np.isnan(margin).all() else float(np.nanmin(margin)),
        closest_pair=(labels[first], labels[second]) if first < second else ("", ""),
        closest_pair_px=distance,
        closest_pair_needs_px=float(needed[first, second]) if first < second else OVERLAP_PX,
    )


# --- fiducials --------------------------------------------------------------------------------------


def _refuse(pointer: str, code: str, detail: str, hint: str) -> IllPosedError:
    return IllPosedError(Problem(pointer, code, detail, hint))


def _spread(share: Share, fewest: int, unknowns: str) -> tuple[Array, Array, Array]:
    """Singular values of the centred fiducials, axes (rows), and extents along these.  Raises IllPosedError for too few
    of them, two in one place, and all on a line."""
    pointer, who, labels, points = share
    if len(points) < fewest:
        detail = f"{who}{unknowns}; {len(points)} fiducials arrived"
        raise _refuse(pointer, "too-few-fiducials", detail, f"use at least {fewest}; 8 or more give a margin")
    first, second, distance = closest_two(points)
    if distance < TOUCHING_MM:
        detail = f"{who}{labels[first]} and {labels[second]} are at the same place ({distance:.2g} mm apart)"
        raise _refuse(pointer, "duplicate-fiducials", detail, "move or remove one of them")
    centred = points - points.mean(axis=0)
    _, values, axes = np.linalg.svd(centred, full_matrices=False)
    if values[1] < COLLINEAR * values[0]:
        detail = (
            f"{who}the fiducials lie on one line along {direction_name(axes[0])}: nothing is known about turning "
            "about it, nor across it"
        )
        raise _refuse(pointer, "collinear-fiducials", detail, "spread them in three dimensions")
    return values, axes, np.ptp(centred @ axes.T, axis=0)


def _check_few(share: Share, fewest: int) -> list[Finding]:
    """What a pose takes: it may be estimated from fiducials in one plane."""
    _spread(share, fewest, "a pose has 6 unknowns, and three fiducials leave up to four of them")
    return []


def _check_poses(system: System, seen: Sequence[Share]) -> None:
    """Refuse a view whose images two poses explain."""
    for share, view in zip(seen, system.views, strict=True):
        rival = find_rival(share.points, view)
        if rival is not None:
            detail = (
                f"view {view.name} sees the flat structure {degrees(rival.tilt_rad):.0f} degrees off its normal, "
                f"and two poses explain its images: with the normal along {direction_name(rival.normal)} and along "
                f"{direction_name(rival.rival_normal)}, {rival.apart:.1f} standard deviations of the noise apart"
            )
            hint = "lift fiducials off the plane, turn the view by some ten degrees, or make the structure larger"
            raise _refuse(share.pointer, "ambiguous-pose", detail, hint)


def _check_noise(system: System) -> None:
    """Weights are inverses of what the noise does."""
    for index, view in enumerate(system.views):
        quiet = not (view.fiducial_noise_px or view.target_noise_px)
        if quiet and system.triangulation.traits.weighing is Weighing.BY_NOISE:
            detail = f"the weighted triangulation divides by the noise of each view, and view {view.name} states none"
            raise _refuse(f"/views/{index}", "no-noise", detail, "state the noise of the images")


def _check_fiducials(share: Share, fewest: int) -> list[Finding]:
    pointer, who = share.pointer, share.view
    unknowns = "a projection has 11 unknowns and a fiducial gives 2 equations"
    values, axes, (_, width, thickness) = _spread(share, fewest, unknowns)
    if values[2] < COPLANAR * values[0]:
        raise _refuse(
            pointer,
            "coplanar-fiducials",
            f"{who}the fiducials lie in one plane with normal {direction_name(axes[2])} (thickness "
            f"{thickness:.2g} mm): no view can tell depth along {direction_name(axes[2])} from its focal length",
            f"lift at least two fiducials off the plane, along {direction_name(axes[2])}; the more the better; "
            "where the intrinsics are known, model.estimator: pose takes a flat structure",
        )
    if thickness < FLAT * width:
        message = (
            f"{who}the structure is flat: {thickness:.3g} mm thick along {direction_name(axes[2])}, {width:.3g} mm "
            "wide; image noise is amplified about in the inverse ratio"
        )
        return [Finding("flat-structure", "warning", message, pointer, thickness, FLAT * width)]
    return []


# --- what each view sees ----------------------------------------------------------------------------


def _check_visibility(
    system: System, seen: Sequence[Share], checks: tuple[ViewCheck, ...], sights: Sequence[Sight]
) -> list[Finding]:
    problems: list[Problem] = []
    findings: list[Finding] = []
    for index, (each, check) in enumerate(zip(sights, checks, strict=True)):
        pointer = f"/views/{index}"
        view, depth = each.view, each.depth
        labels = seen[index].labels
        behind = [] if each.clear else [_name_of(system, labels, k) for k in np.flatnonzero(depth <= 0).tolist()]
        if behind:
            listed = ", ".join(behind[:6]) + (f" and {len(behind) - 6} more" if len(behind) > 6 else "")
            detail = (
                f"the source of view {view.name} cannot image what lies behind it, by up to "
                f"{-float(depth.min()):.4g} mm: {listed}"
            )
            hint = "check where the view looks, and the frame of the coordinates"
            problems.append(Problem(pointer, "behind-source", detail, hint))
        if view.image_size_px is None:
            text = f"the image size of view {view.name} is not stated: the field of view was not checked"
            findings.append(Finding("field-of-view-not-checked", "note", text, pointer))
        elif not (behind or each.clear):
            problems += _outside(system, labels, each, view.image_size_px, pointer)
        apart, needed = check.closest_pair_px, check.closest_pair_needs_px
        if apart < needed:
            size = "" if system.fiducial_radius_mm is None else f", {at_least(needed, 3)} px are needed by their size"
            message = (
                f"the images of {check.closest_pair[0]} and {check.closest_pair[1]} in view {view.name} are "
                f"{at_most(apart, 3)} px apart{size}: they may not be told apart"
            )
            findings.append(Finding("projected-overlap", "warning", message, pointer, apart, needed))
    if problems:
        raise IllPosedError(problems[:20])
    return findings


def _name_of(system: System, labels: tuple[str, ...], index: int) -> str:
    """Of the point of this index where targets follow the fiducials with these labels."""
    if index < len(labels):
        return f"fiducial {labels[index]}"
    return f"target {system.targets[index - len(labels)].name}"


def _outside(
    system: System, labels: tuple[str, ...], sight: Sight, size: tuple[int, int], pointer: str
) -> list[Problem]:
    view, images, margin = sight.view, sight.images, sight.margin
    return [
        Problem(
            pointer,
            "outside-view",
            f"{_name_of(system, labels, index)} is imaged at ({images[index, 0]:.0f}, {images[index, 1]:.0f}) px, "
            f"{-margin[index]:.0f} px outside view {view.name} ({size[0]} x {size[1]} px)",
            "move it, or the view",
        )
        for index in np.flatnonzero(margin < 0).tolist()
    ]


# --- resection --------------------------------------------------------------------------------------


def _check_resection(seen: Sequence[Share], sights: Sequence[Sight]) -> Iterator[Finding]:
    for share, each in zip(seen, sights, strict=True):
        nominal = share.points
        view, images = each.view, each.images[: len(nominal)]
        object_frame = hartley_similarity(nominal)
        points = homogeneous(nominal) @ object_frame.T
        image_frame = hartley_similarity(images)
        rows = design_matrix(points, (homogeneous(images) @ image_frame.T)[:, :2])
        singular = np.linalg.svd(rows, compute_uv=False)
        strength = float(singular[10] / singular[0])
        if strength > WEAK:
            continue
        _, _, right = np.linalg.svd(rows, full_matrices=False)
        estimate = np.linalg.solve(image_frame, right[11].reshape(3, 4) @ object_frame)
        change = np.linalg.solve(image_frame, right[10].reshape(3, 4) @ object_frame)
        motion = f"the source of view {view.name} may slide along {_slide(estimate, change)}"
        if strength < SINGULAR:
            raise _refuse(
                share.pointer,
                "singular-resection",
                f"{_why(share)}: {motion}, its focal length and principal point following, without changing "
                "the image of any fiducial",
                "move two or more fiducials off the plane of the others, or add fiducials"
                if _odd_one_out(nominal) is not None
                else "move or add a fiducial off the curve",
            )
        message = f"view {view.name} is barely determined: {motion} almost without changing an image of a fiducial"
        yield Finding("weak-resection", "warning", message, share.pointer, strength, WEAK)


def _slide(estimate: Array, change: Array) -> str:
    """How the centre c of P moves when P changes by D: from P (c, 1) = 0, P[:, :3] dc = -D (c, 1)."""
    centre = camera_centre(estimate)
    step = np.linalg.solve(estimate[:, :3], -change @ np.append(centre, 1.0))
    return direction_name(step)


def _why(share: Share) -> str:
    odd = _odd_one_out(share.points)
    if odd is None:
        return "the source and all fiducials lie on one twisted cubic curve"
    label, normal = share.labels[odd[0]], direction_name(odd[1])
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


def _check_triangulation(system: System) -> Iterator[Finding]:
    projections = system.projections
    places = np.array([target.position_mm for target in system.targets])
    names = ", ".join(view.name for view in system.views)
    for target, sine in zip(system.targets, sines_between_rays(projections, places).tolist(), strict=True):
        angle = degrees(asin(min(sine, 1.0)))
        if angle >= SMALL_PARALLAX_DEG:
            continue
        centres = np.array([camera_centre(projection) for projection in projections])
        rays = target.position_mm - centres
        reach = np.sqrt((rays**2).sum(axis=1))
        rays = rays / reach[:, None]
        if sine < NO_PARALLAX:
            spread = float(np.linalg.norm(centres - centres[0], axis=1).max())
            to_structure = float(np.linalg.norm(centres - system.fiducials_mm.mean(axis=0), axis=1).min())
            along = direction_name(rays[0])
            if spread < NO_PARALLAX * to_structure:
                detail = (
                    f"the sources of views {names} coincide: nothing is known of target {target.name} along "
                    f"{along}, the ray to it"
                )
                hint = "take a second view from another side; 60 to 120 degrees between views is best"
                raise _refuse("/views", "same-source", detail, hint)
            near = reach.min() < 10 * spread
            reason = "lies on the line through the sources" if near else "is so far that the rays to it are parallel"
            raise _refuse(
                "/targets",
                "target-on-baseline" if near else "target-too-far",
                f"target {target.name} {reason} (views {names}): nothing is known of it along {along}",
                "turn one view out of that line" if near else "bring the target nearer or the views apart",
            )
        message = (
            f"the rays to target {target.name} meet at {angle:.1f} degrees at most: depth along "
            f"{direction_name(rays.sum(axis=0))} is poorly known"
        )
        yield Finding("small-parallax", "warning", message, "/views", angle, SMALL_PARALLAX_DEG)


# --- another pose that the images allow: the known trouble of flat structures -----------------------------
# From far away a plane and its mirror image about the line of sight are imaged alike (the Necker reversal); only
# perspective tells them apart (Oberkampf, DeMenthon and Davis 1996).  So the other pose is looked for from the mirrored
# one, and held against the noise of the images.  Seen head-on both are one, and the tilt is known as badly as
# foreshortening, which begins with its square, is below the noise.

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
    turned = (turn_by(s * step * axis) @ camera.rotation for s in (1.0, -1.0))
    sides = [images_of(camera.intrinsics, points - centre, turn, place, np.zeros(3)).images for turn in turned]
    bent = np.linalg.norm((sides[0] + sides[1]) / 2 - image.images)
    if bent <= view.fiducial_noise_px:
        return None
    normals = [camera.rotation.T @ turn_by(s * step * axis) @ camera.rotation @ axes[2] for s in (1.0, -1.0)]
    return Rival(normals[0], normals[1], 2.0, tilt)


# --- directions and points in the words of a message ------------------------------------------------------


def direction_name(vector: Array) -> str:
    """x, y or z where (3,) is along one of them, otherwise the unit vector; its sign is made positive."""
    unit = vector / np.linalg.norm(vector)
    largest = int(np.argmax(np.abs(unit)))
    unit = unit * (1.0 if unit[largest] > 0 else -1.0)
    if 1 - unit[largest] < 1e-6:
        return "xyz"[largest]
    return "(" + ", ".join(f"{value + 0.0:.3f}" for value in np.round(unit, 3)) + ")"


def point_name(point_mm: Array) -> str:
    """(3,) in mm, four digits."""
    tidy = np.where(np.abs(point_mm) < 1e-6, 0.0, point_mm)
    return "(" + ", ".join(f"{value:.4g}" for value in tidy) + ") mm"
