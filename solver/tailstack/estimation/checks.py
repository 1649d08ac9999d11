"""Compiled looks at a layout: where points are imaged, which are close, how firmly a view is determined.

Whether the geometry determines the answer: what is refused, what is remarked, what each view sees.

Everything is looked at without noise, at the biased geometry.  A refusal names the direction in which the
data say nothing: the plane or line of the fiducials, the way a source may slide without changing an image
of a fiducial, the ray along which a target may lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, degrees, sqrt

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import IllPosedError, Problem
from ..geometry.camera import camera_centre
from ..geometry.naming import direction_name
from ..geometry.rotation import displacement
from ..geometry.symmetric import eigen_symmetric
from ..kernels import kernel
from ..results import Finding, ViewCheck
from ..system import Reading, System, View
from .resection import design_matrix, hartley_similarity, homogeneous


@kernel()
def closest_two(points: Array) -> tuple[int, int, float]:
    """Indices, ascending, and distance of the two closest of points (N, d); (0, 0, inf) when there are fewer than two.

    Points that are not finite are close to nothing.
    """
    first, second, least = 0, 0, np.inf
    for i in range(points.shape[0]):
        for j in range(i + 1, points.shape[0]):
            square = 0.0
            for a in range(points.shape[1]):
                square += (points[i, a] - points[j, a]) ** 2
            if square < least:
                first, second, least = i, j, square
    return first, second, sqrt(least)


@kernel()
def sight(projection: Array, points: Array, width: float, height: float) -> tuple[Array, Array, Array]:
    """(depth (N,) mm, images (N, 2) px, margin (N,) px) of points (N, 3) in one view, P (3, 4) of unit depth.

    The margin is the distance to the nearest edge, negative outside: pixel centres are integers, the image spans -0.5
    ... size - 0.5.  Images and margins of points at or behind the source are NaN, margins are where no size is known.
    """
    count = points.shape[0]
    depth, images, margin = np.empty(count), np.empty((count, 2)), np.empty(count)
    known = width == width and height == height  # a minimum passes NaN by
    seen = np.empty(3)
    for i in range(count):
        for a in range(3):
            seen[a] = projection[a, 3]
            for b in range(3):
                seen[a] += projection[a, b] * points[i, b]
        depth[i] = seen[2]
        if seen[2] > 0.0:
            u, v = seen[0] / seen[2], seen[1] / seen[2]
            images[i, 0], images[i, 1] = u, v
            margin[i] = min(min(u + 0.5, width - 0.5 - u), min(v + 0.5, height - 0.5 - v)) if known else np.nan
        else:
            images[i, 0], images[i, 1], margin[i] = np.nan, np.nan, np.nan
    return depth, images, margin


@kernel()
def _normalised(points: Array) -> Array:
    """Points (N, d) in Hartley's frame (centroid 0, RMS distance sqrt(d)), homogeneous (N, d + 1)."""
    count, dimension = points.shape
    out = np.ones((count, dimension + 1))
    total = 0.0
    for a in range(dimension):
        mean = 0.0
        for i in range(count):
            mean += points[i, a]
        mean /= count
        for i in range(count):
            out[i, a] = points[i, a] - mean
            total += out[i, a] ** 2
    scale = sqrt(dimension * count / total)
    for i in range(count):
        for a in range(dimension):
            out[i, a] *= scale
    return out


@kernel()
def design_squares(points: Array, images: Array) -> NDArray[np.float64]:
    """(12, 12) A'A of the normalised design matrix (Eq 2) of one view: points (N, 3) mm, images (N, 2) px.

    With ``A = [[x, 0, -u x], [0, x, -v x]]`` its blocks are the moments of x weighted by 1, u, v and u^2 + v^2.
    """
    x, uv = _normalised(points), _normalised(images)
    out = np.zeros((12, 12))
    for i in range(x.shape[0]):
        u, v = uv[i, 0], uv[i, 1]
        for a in range(4):
            for b in range(4):
                moment = x[i, a] * x[i, b]
                out[a, b] += moment
                out[4 + a, 4 + b] += moment
                out[a, 8 + b] -= u * moment
                out[8 + a, b] -= u * moment
                out[4 + a, 8 + b] -= v * moment
                out[8 + a, 4 + b] -= v * moment
                out[8 + a, 8 + b] += (u * u + v * v) * moment
    return out


@kernel()
def firm(points: Array, images: Array, share: float) -> bool:
    """Whether the second smallest eigenvalue of :func:`design_squares` is surely above this share of the largest.

    False says nothing.  A Cholesky factor of its first eleven rows, less share times the trace on the diagonal, proves
    it: eigenvalues interlace, and the trace is no smaller than the largest.
    """
    squares = design_squares(points, images)
    trace = 0.0
    for a in range(12):
        trace += squares[a, a]
    for a in range(11):
        for b in range(a + 1):
            rest = squares[a, b] - (share * trace if a == b else 0.0)
            for c in range(b):
                rest -= squares[a, c] * squares[b, c]
            if b < a:
                squares[a, b] = rest / squares[b, b]
            elif rest > 1e-9 * trace:
                squares[a, a] = sqrt(rest)
            else:
                return False
    return True


@kernel()
def look(
    projections: Array, points: Array, count: int, sizes: Array, share: float
) -> tuple[Array, Array, Array, Array]:
    """(depth (V, M), images (V, M, 2), margin (V, M), facts (V, 9)) of points (M, 3) in all views, as :func:`sight`.

    The first ``count`` points are the fiducials.  sizes (V, 2): width and height, NaN where not known.  Facts: nearest
    and farthest depth and smallest margin (NaN where there is none) of the fiducials; smallest depth and margin of all
    points; indices and distance of the two fiducials whose images are closest; 1 where the fiducials determine the view
    firmly (:func:`firm`).
    """
    views, every = projections.shape[0], points.shape[0]
    depth, images, margin = np.empty((views, every)), np.empty((views, every, 2)), np.empty((views, every))
    facts = np.empty((views, 9))
    fiducials = points[:count].copy()
    for v in range(views):
        depth[v], images[v], margin[v] = sight(projections[v], points, sizes[v, 0], sizes[v, 1])
        smallest, least = np.nan, np.nan
        for i in range(every):
            if depth[v, i] > 0.0:  # nothing is less than NaN, the start
                least = margin[v, i] if not margin[v, i] >= least else least
                smallest = margin[v, i] if i < count and not margin[v, i] >= smallest else smallest
        own = images[v, :count].copy()
        first, second, distance = closest_two(own)
        facts[v, 0], facts[v, 1], facts[v, 2] = depth[v, :count].min(), depth[v, :count].max(), smallest
        facts[v, 3], facts[v, 4] = depth[v].min(), least
        facts[v, 5], facts[v, 6], facts[v, 7] = first, second, distance
        facts[v, 8] = 1.0 if facts[v, 0] > 0.0 and firm(fiducials, own, share) else 0.0
    return depth, images, margin, facts


@kernel()
def spread(points: Array) -> tuple[Array, Array, Array, int, int, float]:
    """(squared singular values (3,), largest first, of the centred points (N, 3); their directions, in rows (3, 3);
    extents (3,) along those; indices and distance of the two closest)."""
    count = points.shape[0]
    centred = points.copy()
    for a in range(3):
        mean = 0.0
        for i in range(count):
            mean += points[i, a]
        mean /= count
        for i in range(count):
            centred[i, a] -= mean
    scatter = np.zeros((3, 3))
    for i in range(count):
        for a in range(3):
            for b in range(3):
                scatter[a, b] += centred[i, a] * centred[i, b]
    squares, directions, _ = eigen_symmetric(scatter)
    extents = np.empty(3)
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(count):
            along = 0.0
            for a in range(3):
                along += centred[i, a] * directions[a, k]
            low, high = min(low, along), max(high, along)
        extents[k] = high - low
    first, second, distance = closest_two(points)
    return squares, directions.T.copy(), extents, first, second, distance


@kernel()
def sines_between_rays(projections: Array, targets: Array) -> Array:
    """(T,) largest sine of the angle between two rays to each target (T, 3) from the sources of views (V, 3, 4)."""
    views = projections.shape[0]
    centres = np.zeros((views, 3))
    for v in range(views):
        volume = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                cofactor = projections[v, s, i] * projections[v, t, j] - projections[v, s, j] * projections[v, t, i]
                centres[v, k] -= cofactor * projections[v, r, 3]
                if r == 0:
                    volume += cofactor * projections[v, 0, k]
        centres[v] /= volume
    out = np.zeros(targets.shape[0])
    for q in range(targets.shape[0]):
        for v in range(1, views):
            a = targets[q] - centres[v]
            for w in range(v):
                b = targets[q] - centres[w]
                normal, first, second = 0.0, 0.0, 0.0
                for k in range(3):
                    i, j = (k + 1) % 3, (k + 2) % 3
                    normal += (a[i] * b[j] - a[j] * b[i]) ** 2
                    first += a[k] * a[k]
                    second += b[k] * b[k]
                out[q] = max(out[q], sqrt(normal / (first * second)))
    return out


FEWEST = 6  # Eq 2: two rows a fiducial for eleven unknowns
TOUCHING_MM = 1e-3  # two fiducials closer than this are one
COLLINEAR = 1e-5  # second over first singular value of the centred fiducials
COPLANAR = 1e-5  # third over first
SINGULAR = 1e-6  # second smallest over largest singular value of the normalised design matrix
WEAK = 5e-3  # the same, for a warning: a 100 mm cube has 0.3, two plates 5 mm apart 0.02, 1 mm apart 0.004
FLAT = 0.15  # thickness over width, for a warning: the gain of noise grows as its inverse
NO_PARALLAX = 1e-4  # sine of the angle between two rays
SMALL_PARALLAX_DEG = 30.0
# Remarks that the geometry hardly determines the answer: first order is not believed beside one of them.
DETERMINATION = ("flat-structure", "weak-resection", "small-parallax", "projected-overlap")
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
    seen = _look(system)
    views = tuple(_check_view(system, each) for each in seen)
    findings += _check_visibility(system, views, seen)
    findings += _check_resection(system, seen)
    return (*findings, *_check_triangulation(system)), views


def imaged_fiducials(system: System) -> Array:
    """Where the fiducials stand when they are imaged: (N, 3) mm, con (conventions, *two readings*)."""
    if system.reading is Reading.EQ18:
        return system.fiducials_mm
    mount = system.structure_connector
    at = displacement(mount.bias, mount.pivot_mm, system.rotation_form)
    return np.asarray(system.fiducials_mm @ at.rotation.T + at.shift_mm)


def check_views(system: System) -> tuple[ViewCheck, ...]:
    """Depths, margins and closest pair of images of the fiducials in each view, noise-free.

    A margin is the distance of an image from the nearest edge of the image, negative outside; a point at
    or behind the source counts as outside.
    """
    return tuple(_check_view(system, each) for each in _look(system))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The N fiducials, as they stand when they are imaged, and the T targets behind them, in one view."""

    view: View
    depth: Array  # (N + T,) mm
    images: Array  # (N + T, 2) px; NaN where not in front
    margin: Array  # (N + T,) px; NaN where not in front, or where the size of the image is not stated
    depth_range_mm: tuple[float, float]  # of the fiducials
    smallest_margin_px: float  # of those in front; NaN where there is none
    clear: bool  # everything is in front of the source and, where its size is stated, inside the image
    closest: tuple[int, int, float]  # the two fiducials whose images are, and how close, px
    firm: bool  # the resection is surely not weak


def _look(system: System) -> list[_Seen]:
    points = np.concatenate([imaged_fiducials(system), [target.position_mm for target in system.targets]])
    sizes = np.array([view.image_size_px or (np.nan, np.nan) for view in system.views], dtype=np.float64)
    # Squared singular values; twice the limit, as they are good to 1e-7 of the largest.
    depths, images, margins, facts = look(system.projections, points, len(system.fiducials_mm), sizes, (2 * WEAK) ** 2)
    seen = []
    for view, depth, image, margin, fact in zip(system.views, depths, images, margins, facts.tolist(), strict=True):
        nearest, farthest, smallest, least_depth, least_margin, first, second, distance, firm = fact
        clear = least_depth > 0 and not least_margin < 0
        closest = (int(first), int(second), distance)
        seen.append(_Seen(view, depth, image, margin, (nearest, farthest), smallest, clear, closest, firm == 1.0))
    return seen


def _check_view(system: System, seen: _Seen) -> ViewCheck:
    labels, view = system.fiducial_labels, seen.view
    outside: tuple[str, ...] = ()
    if not seen.clear:
        depth, margin = seen.depth[: len(labels)], seen.margin[: len(labels)]
        outside = tuple(labels[i] for i in np.flatnonzero(~(depth > 0) | (margin < 0)).tolist())
    first, second, distance = seen.closest
    smallest = seen.smallest_margin_px
    return ViewCheck(
        view=view.name,
        checked=view.image_size_px is not None,
        depth_range_mm=seen.depth_range_mm,
        outside=outside,
        smallest_margin_px=None if smallest != smallest else smallest,
        closest_pair=(labels[first], labels[second]) if first < second else ("", ""),
        closest_pair_px=distance,
    )


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
    squares, axes, extents, first, second, distance = spread(points)
    if distance < TOUCHING_MM:
        raise IllPosedError(
            _refuse(
                "/fiducials",
                "duplicate-fiducials",
                f"{labels[first]} and {labels[second]} are at the same place ({distance:.2g} mm apart)",
                "move or remove one of them",
            )
        )
    largest, middle, least = squares.tolist()
    if least > 1e-8 * largest:  # far from flat: the squares have digits enough
        values = [sqrt(largest), sqrt(middle), sqrt(least)]
    else:
        centred = points - points.mean(axis=0)
        _, singular, axes = np.linalg.svd(centred, full_matrices=False)
        values, extents = singular.tolist(), np.ptp(centred @ axes.T, axis=0)
    _, width, thickness = extents.tolist()
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


# --- what each view sees ----------------------------------------------------------------------------


def _check_visibility(system: System, checks: tuple[ViewCheck, ...], seen: Sequence[_Seen]) -> list[Finding]:
    problems: list[Problem] = []
    findings: list[Finding] = []
    for index, (each, check) in enumerate(zip(seen, checks, strict=True)):
        pointer = f"/views/{index}"
        view, depth = each.view, each.depth
        behind = [] if each.clear else [_name_of(system, index) for index in np.flatnonzero(depth <= 0).tolist()]
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
        elif not (behind or each.clear):
            problems += _outside(system, each, view.image_size_px, pointer)
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


def _outside(system: System, seen: _Seen, size: tuple[int, int], pointer: str) -> list[Problem]:
    view, images, margin = seen.view, seen.images, seen.margin
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


def _check_resection(system: System, seen: Sequence[_Seen]) -> list[Finding]:
    told = system.fiducials_mm
    findings = []
    for each in seen:
        if each.firm:
            continue
        view, images = each.view, each.images[: len(told)]
        object_frame = hartley_similarity(told)
        points = homogeneous(told) @ object_frame.T
        image_frame = hartley_similarity(images)
        rows = design_matrix(points, (homogeneous(images) @ image_frame.T)[:, :2])
        _, singular, right = np.linalg.svd(rows, full_matrices=False)
        strength = float(singular[10] / singular[0])
        if strength > WEAK:
            continue
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
    projections = system.projections
    places = np.array([target.position_mm for target in system.targets])
    names = ", ".join(view.name for view in system.views)
    findings = []
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
