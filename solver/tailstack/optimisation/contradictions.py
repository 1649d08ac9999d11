"""Requests that no design can meet, found before anything is solved, with the field at fault."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ..errors import DesignError, Problem
from ..geometry.naming import direction_name
from .problem import MOST_FIDUCIALS, PlacementProblem, for_people, in_words, label_of, present_choice
from .regions import bounding_box, corners
from .room import refuse_regions
from .terms import estimator_of

FLAT = 1e-6  # thickness over width of a region that is a plane
ROUNDING_MM = 1e-3  # fixed positions may have been rounded by who wrote them


def refuse_contradictions(problem: PlacementProblem) -> None:
    """Raise DesignError with every contradiction that can be shown without solving."""
    found = _bounds(problem) + _mechanics(problem)
    if not found:
        found = _objective(problem)
    count = len(problem.system.fiducial_labels)
    if problem.places and count > MOST_FIDUCIALS:
        detail = (
            f"{count} fiducials; a layout of at most {MOST_FIDUCIALS} is optimised (memory and time go as the square)"
        )
        found.append(Problem(problem.places[0].pointer, "too-many", detail, "use fewer, or fix the layout"))
    elif problem.places:
        found += _flat(problem)
        estimator = estimator_of(problem.system)
        found += refuse_regions(problem, estimator)
        if not estimator.fiducial_px.any() and not estimator.manufacturing_std_mm.any():
            found.append(
                Problem(
                    problem.places[0].pointer,
                    "no-influence",
                    "fiducial noise and manufacturing errors are zero, and a rigid installation error acts the same "
                    "way whatever the layout: moving fiducials changes nothing",
                    "state the noise of the fiducials in the views, or remove the region",
                )
            )
    elif not (problem.half_widths or problem.pivots or problem.spacings):
        found.append(
            Problem(
                "/optimise",
                "nothing-free",
                "no fiducial, tolerance, pivot or locator spacing is free to change",
                "add a box or rotation_bounds",
            )
        )
    found += _fixed_pairs(problem)
    if found:
        raise DesignError(found)


def _flat(problem: PlacementProblem) -> list[Problem]:
    """Regions that leave all fiducials but one in a plane: no resection has an answer there."""
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
            return [
                Problem(
                    place.pointer,
                    "flat-region",
                    f"all fiducials but {off} would lie in one plane with normal {direction_name(axes[2])}: no view "
                    "can tell its depth from its focal length",
                    "give the region some thickness, or fix two or more fiducials off that plane",
                )
            ]
    return []


def _bounds(problem: PlacementProblem) -> list[Problem]:
    found = []
    for k, free in enumerate(problem.half_widths):
        if not 0 < free.minimum <= free.maximum:
            (low, unit), (high, _) = for_people(problem, k, free.minimum), for_people(problem, k, free.maximum)
            found.append(
                Problem(
                    free.pointer,
                    "bounds-crossed",
                    f"the smallest half-width of {in_words(problem, k)} must be above zero and not above the largest; "
                    f"got {low:.6g} and {high:.6g} {unit}",
                    "give a smallest half-width above zero and below the largest",
                )
            )
    return found


def _mechanics(problem: PlacementProblem) -> list[Problem]:
    """Bounds of pivots and locator spacings."""
    found = []
    for pivot in problem.pivots:
        name = label_of(problem, pivot.contributor)
        for k, axis in enumerate("xyz"):
            low, high = float(pivot.low_mm[k]), float(pivot.high_mm[k])
            if low > high:
                detail = f"the box of the pivot of {name} is empty along {axis}: {low:g} > {high:g} mm"
                found.append(Problem(pivot.pointer, "empty-box", detail, "swap the two numbers"))
    for spacing in problem.spacings:
        if not 0 < spacing.minimum <= spacing.maximum:
            found.append(
                Problem(
                    spacing.pointer,
                    "bounds-crossed",
                    f"the smallest factor on the locator spacing of {label_of(problem, spacing.contributor)} must be "
                    f"above zero and not above the largest; got {spacing.minimum:g} and {spacing.maximum:g}",
                    "give a smallest factor above zero and below the largest",
                )
            )
    return found


def _objective(problem: PlacementProblem) -> list[Problem]:
    """Whether the bounds of the half-widths, which are in order, leave the objective anything to do."""
    if problem.objective == "scaling":
        return _scaling(problem)
    if problem.objective != "quantile" or not problem.half_widths:
        return []
    least = problem.cost(problem.upper)
    if problem.cost_limit is None:
        return [
            Problem(
                "/optimise/cost_limit",
                "missing-field",
                "the smallest quantile with free half-widths and no limit on their cost has every one at its smallest",
                f"give a cost_limit; with every free half-width at its largest the cost is {least:.6g}",
            )
        ]
    if problem.cost_limit < least * (1 - 1e-9):
        return [
            Problem(
                "/optimise/cost_limit",
                "cost-out-of-reach",
                f"with every free half-width at its largest the cost is {least:.6g}, the least possible; cost_limit is "
                f"{problem.cost_limit:.6g}",
                f"raise cost_limit to {least:.6g} or more, or allow larger half-widths",
            )
        ]
    return []


def _scaling(problem: PlacementProblem) -> list[Problem]:
    """One factor on all half-widths as they are must exist between their bounds."""
    now = present_choice(problem).half_width
    zero = [k for k, value in enumerate(now) if not value > 0]
    if zero or not len(now):
        return [
            Problem(
                problem.half_widths[k].pointer,
                "zero-half-width",
                f"{in_words(problem, k)} has half-width 0 today: no factor changes that",
                "give the half-width it is made to now, or do not free it",
            )
            for k in zero
        ]
    smallest, largest = problem.lower / now, problem.upper / now
    tight, loose = int(np.argmax(smallest)), int(np.argmin(largest))
    if smallest[tight] <= largest[loose] * (1 + 1e-9):
        return []
    return [
        Problem(
            problem.half_widths[tight].pointer,
            "no-common-factor",
            f"one factor on all half-widths must be at least {smallest[tight]:.4g} for {in_words(problem, tight)} to "
            f"reach its smallest and at most {largest[loose]:.4g} for {in_words(problem, loose)} to stay within its "
            "largest",
            "widen the bounds of one of the two, or set one of them free alone with objective: cost",
        )
    ]


def _fixed_pairs(problem: PlacementProblem) -> list[Problem]:
    """Fiducials that stay must keep the spacing among themselves."""
    free = set(problem.free_fiducials)
    if not free or problem.min_spacing_mm <= 0:
        return []
    points, labels = problem.system.fiducials_mm, problem.system.fiducial_labels
    found = []
    for i, j in combinations([k for k in range(len(labels)) if k not in free], 2):
        apart = float(np.linalg.norm(points[i] - points[j]))
        if apart < problem.min_spacing_mm - ROUNDING_MM:
            found.append(
                Problem(
                    "/optimise/fixed",
                    "spacing-of-fixed",
                    f"{labels[i]} and {labels[j]} stay, and are {apart:.4g} mm apart, less than min_spacing_mm "
                    f"{problem.min_spacing_mm:g}",
                    "free one of them, or reduce min_spacing_mm",
                )
            )
    return found[:5]
