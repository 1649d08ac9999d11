"""Requests that no design can meet, found before anything is solved, with the field at fault.

Among them are regions that no image shows.  Whether the rules of a layout leave its fiducials room is asked of the
solver, which says by how much they do not."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations, islice
from math import log

import numpy as np
from scipy.optimize import linprog

from ..errors import DesignError, Problem
from ..estimation.checks import direction_name
from ..geometry.arrays import Array
from ..measures import MEASURE
from ..results.digits import at_least, at_most
from ..system import View
from .problem import MOST_FIDUCIALS, FreeFiducial, PlacementProblem, count_ends, for_people, in_words, present_choice
from .regions import bounding_box, corners, distinct

ROOM = 1e-3  # relative: above the least possible cost, for a search to have an inside
LEAST_COST = 1e-290  # of a half-width: less loses its digits
FLAT = 1e-6  # thickness over width of a region that is a plane
MOST_ENDS = 6  # bounded sources that move images together: 64 vertices for each quantile
ROUNDING_MM = 1e-3  # fixed positions may have been rounded by who wrote them


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
            detail = (
                "fiducial noise and manufacturing errors are zero, and a rigid installation error acts the same way "
                "whatever the layout: moving fiducials changes nothing"
            )
            hint = "state the noise of the fiducials in the views, or remove the region"
            problems.append(Problem(problem.places[0].pointer, "no-influence", detail, hint))
    elif not (problem.half_widths or problem.pivots):
        hint = "add a box or rotation_bounds"
        problems.append(Problem("/optimise", "nothing-free", "no fiducial, tolerance or pivot is free to change", hint))
    problems += [*islice(_fixed_pairs(problem), 5), *_ends(problem)]
    if problems:
        raise DesignError(problems)


def _statistics(problem: PlacementProblem) -> Iterator[Problem]:
    """Requirements on what is no mean of quantiles."""
    asked = [item.name for item in problem.requirements]
    hint = "name others in optimise.requirement; the check of what is found judges this one too"
    for index, item in enumerate(problem.system.requirements):
        measure = MEASURE[item.error]
        if item.name in asked and (not item.mixture or (measure.paired and not item.row.by_quantile)):
            detail = f"{item.name} limits the {item.statistic} of {measure.words}: the search keeps limits of "
            detail += "quantiles and of means of them" + (", the latter of a single vector" if item.mixture else "")
            yield Problem(f"/requirements/{index}/statistic", "not-optimised", detail, hint)


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
        each = (for_people(problem, k, value) for value in (free.price.scale, least, free.maximum))
        (scale, unit), (least, _), (high, _) = each
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
        for k in zero:
            detail = f"{in_words(problem, k)} has half-width 0 today: no factor changes that"
            hint = "give the half-width it is made to now, or do not free it"
            yield Problem(problem.half_widths[k].pointer, "zero-half-width", detail, hint)
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


def _fixed_pairs(problem: PlacementProblem) -> Iterator[Problem]:
    """Fiducials that stay must keep the spacing among themselves."""
    free, points, labels = problem.free_fiducials, problem.system.fiducials_mm, problem.system.fiducial_labels
    for i, j in combinations([k for k in range(len(labels)) if free and k not in free], 2):
        apart = float(np.linalg.norm(points[i] - points[j]))
        if apart < problem.min_spacing_mm - ROUNDING_MM:
            detail = (
                f"{labels[i]} and {labels[j]} stay, and are {apart:.4g} mm apart, less than min_spacing_mm "
                f"{problem.min_spacing_mm:g}"
            )
            hint = "free one of them, or reduce min_spacing_mm"
            yield Problem("/optimise/fixed", "spacing-of-fixed", detail, hint)


def refuse_regions(problem: PlacementProblem) -> Iterator[Problem]:
    """The first contradiction of each different region."""
    regions, which = distinct(place.region for place in problem.places)
    for k in range(len(regions)):
        place = problem.places[which.index(k)]
        yield from islice(chain(_behind(problem, place), _field(problem, place)), 1)


def _behind(problem: PlacementProblem, place: FreeFiducial) -> Iterator[Problem]:
    """Whether the bounding box, in which the programme moves the fiducials, reaches behind a source."""
    reach = problem.estimation.assume(corners(bounding_box(place.region)))
    for view, projection in zip(problem.system.views, problem.estimation.projections, strict=True):
        depth = float((reach @ projection[2, :3] + projection[2, 3]).min())
        if depth <= 0:
            detail = f"the bounding box of the region reaches {-depth:.4g} mm behind the source of view {view.name}"
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
    """Whether any point of the bounding box lies in every image, by linear programming; the views one by one first."""
    sized = [(v, view) for v, view in enumerate(problem.system.views) if view.image_size_px is not None]
    parts = {f"the image of view {view.name}": _image_rows(problem, view, v) for v, view in sized}
    if parts:
        every = [np.concatenate(each) for each in zip(*parts.values(), strict=True)]
        parts["the images of all views at once"] = every[0], every[1]
    for where, (rows, limits) in parts.items():
        bounds = bounding_box(place.region).T
        if linprog(np.zeros(3), A_ub=rows, b_ub=limits, bounds=bounds, method="highs").status == 2:
            detail = f"no point of the region is inside {where} with a margin of {problem.image_margin_px:g} px"
            yield Problem(place.pointer, "outside-view", detail, "move the region, or reduce image_margin_px")
