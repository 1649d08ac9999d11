"""Requests that no design can meet, found before anything is solved, with the field at fault.

Among them are regions that have no room for their fiducials, shown without solving: each test refuses only what is
impossible."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations, islice
from math import log, pi, sqrt

import numpy as np
from scipy.optimize import linprog

from ..errors import DesignError, Problem
from ..geometry.arrays import Array
from ..geometry.camera import image_of
from ..geometry.naming import direction_name
from ..measures import MEASURE
from ..results.digits import at_least, at_most
from ..system import View
from .problem import (
    MOST_FIDUCIALS,
    FreeFiducial,
    PlacementProblem,
    count_ends,
    for_people,
    in_words,
    present_choice,
)
from .regions import (
    Ball,
    BoxRegion,
    Cylinder,
    Shape,
    bounding_box,
    clear_of,
    corners,
    diameter_mm,
    distinct,
)
from .surface import NearSurface

ROOM = 1e-3  # relative: above the least possible cost, for a search to have an inside
LEAST_COST = 1e-290  # of a half-width: less loses its digits
FLAT = 1e-6  # thickness over width of a region that is a plane
MOST_ENDS = 6  # bounded sources that move images together: 64 vertices for each quantile
ROUNDING_MM = 1e-3  # fixed positions may have been rounded by who wrote them
INSIDE_MM = 1e-6  # positions this far outside count as inside
DENSEST_SPHERES = pi / sqrt(18)  # Kepler: no packing of equal spheres fills more (Hales 2005)
DENSEST_DISCS = pi / sqrt(12)  # Thue (Fejes Toth 1940)


def refuse_contradictions(problem: PlacementProblem) -> None:
    """Raise DesignError with every contradiction that can be shown without solving."""
    problems = [*_statistics(problem)] or [*_curves(problem)] or [*_objective(problem)]
    count = len(problem.system.fiducial_labels)
    if problem.places and count > MOST_FIDUCIALS:
        detail = (
            f"{count} fiducials; a layout of at most {MOST_FIDUCIALS} is optimised (memory and time go as the square)"
        )
        problems.append(Problem(problem.places[0].pointer, "too-many", detail, "use fewer, or fix the layout"))
    elif problem.places:
        problems += [*_flat(problem), *refuse_regions(problem)]
        believed = (error.sources.std for error in problem.system.believed_errors if error is not None)
        imaging, made = problem.estimation.imaging, problem.system.manufacturing_std_mm
        varies = imaging.estimation.noise[:, 0].any() or made.any() or any(std.any() for std in believed)
        if not (varies or imaging.assumed.any() or problem.system.shared_image_errors):
            problems.append(
                Problem(
                    problem.places[0].pointer,
                    "no-influence",
                    "fiducial noise and manufacturing errors are zero, and a rigid installation error acts the same "
                    "way whatever the layout: moving fiducials changes nothing",
                    "state the noise of the fiducials in the views, or remove the region",
                )
            )
    elif not (problem.half_widths or problem.pivots):
        hint = "add a box or rotation_bounds"
        problems.append(Problem("/optimise", "nothing-free", "no fiducial, tolerance or pivot is free to change", hint))
    problems += [*_fixed_pairs(problem), *_ends(problem)]
    if problems:
        raise DesignError(problems)


def _statistics(problem: PlacementProblem) -> Iterator[Problem]:
    """Requirements on what is no mean of quantiles."""
    yield from (
        Problem(
            f"/requirements/{index}/statistic",
            "not-optimised",
            f"{item.name} limits the {item.statistic} of {MEASURE[item.error].words}: the search keeps limits of "
            "quantiles and of means of them" + (", the latter of a single vector" if item.mixture else ""),
            "name others in optimise.requirement; the check of what is found judges this one too",
        )
        for index, item in enumerate(problem.system.requirements)
        if item.name in [asked.name for asked in problem.requirements]
        and (not item.mixture or (MEASURE[item.error].paired and not item.row.by_quantile))
    )


def _flat(problem: PlacementProblem) -> Iterator[Problem]:
    """Regions that leave all fiducials but one in a plane: no resection has an answer there, unless it believes
    intrinsics."""
    if problem.system.estimator.believes_intrinsics:
        return
    boxes = {i: corners(bounding_box(place.region)) for place in problem.places for i in place.fiducials}
    reach = [boxes.get(i, point[None]) for i, point in enumerate(problem.system.fiducials_mm)]
    for place in problem.places:
        own = boxes[place.fiducials[0]]
        middle = own.mean(axis=0)
        _, values, axes = np.linalg.svd(own - middle)
        if values[2] > FLAT * max(values[0], 1.0):
            continue
        off = sum(bool((np.abs((points - middle) @ axes[2]) > FLAT * max(values[0], 1.0)).any()) for points in reach)
        if off < 2:
            yield Problem(
                place.pointer,
                "flat-region",
                f"all fiducials{' but one' * off} would lie in one plane with normal {direction_name(axes[2])}: no "
                "view can tell its depth from its focal length",
                "give the region some thickness, or fix two or more fiducials off that plane",
            )
            return


def _ends(problem: PlacementProblem) -> Iterator[Problem]:
    """Bounded sources whose effect changes with the layout: the programme holds every vertex of theirs."""
    count = count_ends(problem.system)
    if count <= MOST_ENDS or not problem.moves:
        return
    yield Problem(
        problem.system.shared_image_errors[0].pointer,
        "not-optimised",
        f"positions or pivots are free, and {count} bounded quantities move the images of all fiducials together: "
        f"which of their 2^{count} combinations is worst changes with the layout, and {MOST_ENDS} quantities are "
        "followed at most",
        "give them a law (uniform, normal) for the search, then score the result with them bounded",
    )


def _curves(problem: PlacementProblem) -> list[Problem]:
    """Exponential costs that are too small for a number before their half-width is at its largest."""
    problems: dict[str, Problem] = {}
    for k, free in enumerate(problem.half_widths):
        if free.price.curve != "exponential":
            continue
        least = free.maximum / (log(free.price.weight) - log(LEAST_COST))
        if free.price.scale >= least * (1 - 1e-9):
            continue
        (scale, unit), (least, _), (high, _) = (
            for_people(problem, k, value) for value in (free.price.scale, least, free.maximum)
        )
        field = f"{free.pointer}/cost/scale_{unit}"
        problems[field] = Problem(
            field,
            "curve-underflows",
            f"with scale_{unit} {scale:g} the cost of {in_words(problem, k)} at its largest half-width, {high:g} "
            f"{unit}, is its weight times e^-{high / scale:.0f}: too small a number to compare by",
            f"scale_{unit}: {at_least(least, 3)} or more, or a smaller largest half-width",
        )
    return list(problems.values())


def _objective(problem: PlacementProblem) -> Iterator[Problem]:
    """Whether the bounds of the half-widths leave the objective anything to do."""
    if problem.objective == "scaling":
        yield from _scaling(problem)
    if problem.objective != "quantile" or not problem.half_widths:
        return
    least = problem.cost(problem.upper)
    enough = at_least(least * (1 + ROOM), 6)
    if problem.cost_limit is not None and problem.cost_limit < least * (1 + ROOM):
        yield Problem(
            "/optimise/cost_limit",
            "cost-out-of-reach",
            f"with every free half-width at its largest the cost is {at_least(least, 6)}, the least possible; "
            f"cost_limit is {at_most(problem.cost_limit, 6)}, which leaves nothing to choose",
            f"raise cost_limit to {enough} or more, or allow larger half-widths",
        )


def _scaling(problem: PlacementProblem) -> Iterator[Problem]:
    """One factor on all half-widths as they are must exist between their bounds."""
    now = present_choice(problem).half_width
    zero = [k for k, value in enumerate(now) if not value > 0]
    if zero or not len(now):
        yield from (
            Problem(
                problem.half_widths[k].pointer,
                "zero-half-width",
                f"{in_words(problem, k)} has half-width 0 today: no factor changes that",
                "give the half-width it is made to now, or do not free it",
            )
            for k in zero
        )
        return
    smallest, largest = problem.lower / now, problem.upper / now
    tight, loose = int(np.argmax(smallest)), int(np.argmin(largest))
    if smallest[tight] <= largest[loose] * (1 + 1e-9):
        return
    yield Problem(
        problem.half_widths[tight].pointer,
        "no-common-factor",
        f"one factor on all half-widths must be at least {smallest[tight]:.4g} for {in_words(problem, tight)} to "
        f"reach its smallest and at most {largest[loose]:.4g} for {in_words(problem, loose)} to stay within its "
        "largest",
        "widen the bounds of one of the two, or set one of them free alone with objective: cost",
    )


def _fixed_pairs(problem: PlacementProblem) -> list[Problem]:
    """Fiducials that stay must keep the spacing among themselves."""
    free = set(problem.free_fiducials)
    if not free or problem.min_spacing_mm <= 0:
        return []
    points, labels = problem.system.fiducials_mm, problem.system.fiducial_labels
    problems = []
    for i, j in combinations([k for k in range(len(labels)) if k not in free], 2):
        apart = float(np.linalg.norm(points[i] - points[j]))
        if apart < problem.min_spacing_mm - ROUNDING_MM:
            detail = (
                f"{labels[i]} and {labels[j]} stay, and are {apart:.4g} mm apart, less than min_spacing_mm "
                f"{problem.min_spacing_mm:g}"
            )
            hint = "free one of them, or reduce min_spacing_mm"
            problems.append(Problem("/optimise/fixed", "spacing-of-fixed", detail, hint))
    return problems[:5]


def refuse_regions(problem: PlacementProblem) -> Iterator[Problem]:
    """The first contradiction of each different region."""
    regions, which = distinct(place.region for place in problem.places)
    for k in range(len(regions)):
        place = problem.places[which.index(k)]
        yield from islice(chain.from_iterable(check(problem, place) for check in _OF_REGIONS), 1)


def _word(region: Shape) -> str:
    return {BoxRegion: "box", Cylinder: "cylinder", Ball: "ball", NearSurface: "layer"}[type(region)]


def _behind(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Whether the bounding box, in which the programme moves the fiducials, reaches behind a source."""
    reach = problem.estimation.assume(corners(bounding_box(place.region)))
    for view, projection in zip(problem.system.views, problem.estimation.projections, strict=True):
        depth = float((reach @ projection[2, :3] + projection[2, 3]).min())
        if depth <= 0:
            detail = (
                f"the bounding box of the {_word(place.region)} reaches {-depth:.4g} mm behind the source of view "
                f"{view.name}"
            )
            yield Problem(place.pointer, "behind-source", detail, "make it smaller, or move the source back")


def _image_rows(problem: PlacementProblem, view: View, v: int) -> tuple[Array, Array]:
    """``a x <= b`` for a position x to lie inside the image of one view: linear, as the depth is positive."""
    assert view.image_size_px is not None
    rows, limits = [], []
    projection = problem.estimation.projections[v]
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        edge = problem.image_margin_px if sign > 0 else view.image_size_px[axis] - 1 - problem.image_margin_px
        row = -sign * (projection[axis] - edge * projection[2])
        rows.append(row[:3] @ problem.estimation.assumed_turn)
        limits.append(-(row[:3] @ problem.estimation.assumed_shift_mm + row[3]))
    scale = np.linalg.norm(rows, axis=1)
    return np.array(rows) / scale[:, None], np.array(limits) / scale


def _field(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Whether any point of the bounding box lies in every image; the views one by one first."""
    sized = [(v, view) for v, view in enumerate(problem.system.views) if view.image_size_px is not None]
    parts = [_image_rows(problem, view, v) for v, view in sized]
    for (_, view), (rows, limits) in zip(sized, parts, strict=True):
        if not _meets(place.region, rows, limits):
            yield _outside(problem, place, f"the image of view {view.name}")
    if parts and not _meets(place.region, np.vstack([a for a, _ in parts]), np.concatenate([b for _, b in parts])):
        yield _outside(problem, place, "the images of all views at once")


def _meets(region: Shape, rows: Array, limits: Array) -> bool:
    """Whether a point of the region's bounding box meets ``rows @ x <= limits``, by linear programming."""
    answer = linprog(np.zeros(3), A_ub=rows, b_ub=limits, bounds=bounding_box(region).T, method="highs")
    return bool(answer.status != 2)


def _outside(problem: PlacementProblem, place: FreeFiducial, where: str) -> Problem:
    word = _word(place.region)
    detail = f"no point of the {word} is inside {where} with a margin of {problem.image_margin_px:g} px"
    return Problem(place.pointer, "outside-view", detail, f"move the {word}, or reduce image_margin_px")


def _refuse_kept_out(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Whether no corner of the bounding box is clear of a zone, which then holds all of it: it is convex, or not asked
    about."""
    for zone in problem.keep_out:
        hollow = not isinstance(zone.shape, BoxRegion) and zone.shape.inner_radius_mm > zone.clearance_mm
        if not hollow and not clear_of(zone, corners(bounding_box(place.region))).any():
            gap = f" and the {zone.clearance_mm:g} mm around it" if zone.clearance_mm else ""
            detail = f"the whole {_word(place.region)} lies inside the keep-out zone {zone.name!r}{gap}"
            hint = f"make the zone ({zone.pointer}) smaller, or the region larger"
            yield Problem(place.pointer, "kept-out", detail, hint)


def _asymmetric(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Whether any point of the bounding box has all its copies there too."""
    if not problem.symmetry:
        return
    low, high = bounding_box(place.region)
    rows = np.vstack([sign * isometry.rotation for isometry in problem.symmetry for sign in (1, -1)])
    limits = np.concatenate(
        [
            bound
            for isometry in problem.symmetry
            for bound in (high - isometry.shift_mm + INSIDE_MM, isometry.shift_mm - low + INSIDE_MM)
        ]
    )
    if _meets(place.region, rows, limits):
        return
    word = _word(place.region)
    detail = f"no point of the {word} has its copies under the symmetry in the {word} too"
    hint = f"make the {word} symmetric itself, or move the plane or axis of the symmetry (/optimise/symmetry)"
    yield Problem(place.pointer, "outside-symmetry", detail, hint)


def _packing(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Balls of diameter d about the fiducials lie in the bounding box grown by d/2 and cannot fill more than Kepler's
    share of it (copies of a box tile space); likewise discs in the rectangle about the box's image."""
    region, word = place.region, _word(place.region)
    _, which = distinct(other.region for other in (place, *problem.places))
    count = sum(len(other.fiducials) for other, k in zip(problem.places, which[1:], strict=True) if k == 0)
    if count < 2:
        return
    d = problem.min_spacing_mm
    box = bounding_box(region)
    if d > diameter_mm(region) + 1e-9 or _too_many(count, d, box[1] - box[0]):
        yield _refuse_crowd("/optimise/min_spacing_mm", count, f"{d:g} mm", f"the {word}", word)
    assumed = problem.estimation.assume(corners(box))
    d = problem.min_projected_spacing_px
    for view, projection in zip(problem.system.views, problem.estimation.projections, strict=True):
        image = assumed @ projection[:, :3].T + projection[:, 3]
        if image[:, 2].min() <= 0:
            continue
        image = image_of(image)
        low, high = image.min(axis=0), image.max(axis=0)
        if view.image_size_px is not None:
            low = np.maximum(low, problem.image_margin_px)
            high = np.minimum(high, np.array(view.image_size_px) - 1 - problem.image_margin_px)
        size = np.maximum(high - low, 0.0)
        if d > float(np.linalg.norm(size)) + 1e-6 or _too_many(count, d, size):
            where = f"what view {view.name} sees of the {word} ({size[0]:.0f} x {size[1]:.0f} px)"
            yield _refuse_crowd("/optimise/min_projected_spacing_px", count, f"{d:g} px", where, word)


def _too_many(count: int, apart: float, sides: Array) -> bool:
    """Whether points this far apart in a box or rectangle would be balls or discs denser than any packing."""
    ball, densest = (pi / 6, DENSEST_SPHERES) if len(sides) == 3 else (pi / 4, DENSEST_DISCS)
    return bool(count * ball * apart ** len(sides) > densest * float(np.prod(sides + apart)))


def _refuse_crowd(pointer: str, count: int, apart: str, where: str, word: str) -> Problem:
    detail = f"{count} free fiducials cannot be {apart} apart in {where}: no packing is that dense"
    hint = f"reduce the spacing, the number of free fiducials, or enlarge the {word}"
    return Problem(pointer, "does-not-fit", detail, hint)


_OF_REGIONS = (_behind, _field, _refuse_kept_out, _asymmetric, _packing)
