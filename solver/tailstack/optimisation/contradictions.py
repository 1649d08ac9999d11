"""Requests that no design can meet, found before anything is solved, with the field at fault."""

from __future__ import annotations

from itertools import combinations
from math import pi, sqrt

import numpy as np
from scipy.optimize import linprog

from ..errors import DesignError, Problem
from ..system import Array, View
from .problem import PlacementProblem, half_widths_of, in_words
from .program import box_corners
from .terms import Estimator, estimator_of

ROUNDING_MM = 1e-3  # fixed positions may have been rounded by who wrote them
DENSEST_SPHERES = pi / sqrt(18)  # Kepler: no packing of equal spheres fills more (Hales 2005)
DENSEST_DISCS = pi / sqrt(12)  # Thue (Fejes Toth 1940)


def refuse_contradictions(problem: PlacementProblem) -> None:
    """Raise DesignError with every contradiction that can be shown without solving."""
    found = _bounds(problem)
    if problem.free_fiducials:
        estimator = estimator_of(problem.system)
        found += _box(problem, estimator) or _field(problem, estimator) or _packing(problem, estimator)
        if not estimator.fiducial_px.any() and not estimator.manufacturing_std_mm.any():
            found.append(
                Problem(
                    "/optimise/box",
                    "no-influence",
                    "fiducial noise and manufacturing errors are zero, and a rigid installation error acts the same "
                    "way whatever the layout: moving fiducials changes nothing",
                    "state the noise of the fiducials in the views, or remove the box",
                )
            )
    elif not problem.half_widths:
        found.append(Problem("/optimise", "nothing-free", "no fiducial and no tolerance is free to change"))
    if problem.requirement.risk != "pooled":
        found.append(
            Problem(
                "/optimise/requirement",
                "unsupported-risk",
                f"the optimiser holds a quantile over units and shots together; {problem.requirement.name!r} asks for "
                f"risk {problem.requirement.risk!r}",
                "name a requirement with risk: pooled",
            )
        )
    found += _fixed_pairs(problem)
    if found:
        raise DesignError(found)


def _bounds(problem: PlacementProblem) -> list[Problem]:
    found = []
    for k, (free, now) in enumerate(zip(problem.half_widths, half_widths_of(problem), strict=True)):
        name = in_words(problem, k)
        if not 0 < free.minimum <= free.maximum:
            found.append(
                Problem(
                    free.pointer,
                    "bounds-crossed",
                    f"the smallest half-width of {name} must be above zero and not above the largest; got "
                    f"{np.degrees(free.minimum):.6g} and {np.degrees(free.maximum):.6g} deg",
                )
            )
        if not now > 0:
            found.append(
                Problem(
                    free.pointer,
                    "zero-half-width",
                    f"{name} has half-width 0 today: its cost weight / half-width is infinite",
                    "give the half-width it is made to now",
                )
            )
    return found


def _box(problem: PlacementProblem, estimator: Estimator) -> list[Problem]:
    low, high = problem.box_mm
    if (low > high).any():
        axis = int(np.argmax(low > high))
        detail = f"the lowest corner is above the highest along {'xyz'[axis]}: {low[axis]:g} > {high[axis]:g} mm"
        return [Problem("/optimise/box", "empty-box", detail)]
    corners = box_corners(problem.box_mm) @ estimator.told.T + estimator.told_shift_mm
    for view, projection in zip(problem.system.views, estimator.projections, strict=True):
        depth = float((corners @ projection[2, :3] + projection[2, 3]).min())
        if depth <= 0:
            return [
                Problem(
                    "/optimise/box",
                    "behind-source",
                    f"the box reaches {-depth:.4g} mm behind the source of view {view.name}",
                    "make it smaller, or move the source back",
                )
            ]
    return []


def _inside_rows(problem: PlacementProblem, estimator: Estimator, view: View, v: int) -> tuple[Array, Array]:
    """``a x <= b`` for a position x to lie inside the image of one view: linear, as the depth is positive."""
    assert view.image_size_px is not None
    rows, limits = [], []
    projection = estimator.projections[v]
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        edge = problem.image_margin_px if sign > 0 else view.image_size_px[axis] - 1 - problem.image_margin_px
        row = -sign * (projection[axis] - edge * projection[2])
        rows.append(row[:3] @ estimator.told)
        limits.append(-(row[:3] @ estimator.told_shift_mm + row[3]))
    scale = np.linalg.norm(rows, axis=1)
    return np.array(rows) / scale[:, None], np.array(limits) / scale


def _field(problem: PlacementProblem, estimator: Estimator) -> list[Problem]:
    """Whether any point of the box lies in every image, by linear programming; the views one by one first."""
    sized = [(v, view) for v, view in enumerate(problem.system.views) if view.image_size_px is not None]
    parts = [_inside_rows(problem, estimator, view, v) for v, view in sized]
    for (_, view), (rows, limits) in zip(sized, parts, strict=True):
        if not _meets_box(problem, rows, limits):
            return [_outside(problem, f"no point of the box is inside the image of view {view.name}")]
    if parts and not _meets_box(problem, np.vstack([a for a, _ in parts]), np.concatenate([b for _, b in parts])):
        return [_outside(problem, "no point of the box is inside the images of all views at once")]
    return []


def _meets_box(problem: PlacementProblem, rows: Array, limits: Array) -> bool:
    answer = linprog(np.zeros(3), A_ub=rows, b_ub=limits, bounds=problem.box_mm.T, method="highs")
    return bool(answer.status != 2)


def _outside(problem: PlacementProblem, detail: str) -> Problem:
    return Problem(
        "/optimise/box",
        "outside-view",
        f"{detail} with a margin of {problem.image_margin_px:g} px",
        "move the box, or reduce image_margin_px",
    )


def _packing(problem: PlacementProblem, estimator: Estimator) -> list[Problem]:
    """Balls of diameter d about the fiducials lie in the box grown by d/2 and cannot fill more than Kepler's share of
    it; likewise discs in the rectangle about the box's image."""
    count, d = len(problem.free_fiducials), problem.min_spacing_mm
    sides = problem.box_mm[1] - problem.box_mm[0]
    if count > 1 and count * pi / 6 * d**3 > DENSEST_SPHERES * float(np.prod(sides + d)):
        return [_crowded("/optimise/min_spacing_mm", count, f"{d:g} mm apart", "the box")]
    if count > 1 and d > float(np.linalg.norm(sides)) + 1e-9:
        return [_crowded("/optimise/min_spacing_mm", count, f"{d:g} mm apart", "the box")]
    corners = box_corners(problem.box_mm) @ estimator.told.T + estimator.told_shift_mm
    d = problem.min_projected_spacing_px
    for view, projection in zip(problem.system.views, estimator.projections, strict=True):
        image = corners @ projection[:, :3].T + projection[:, 3]
        image = image[:, :2] / image[:, 2:]
        low, high = image.min(axis=0), image.max(axis=0)
        if view.image_size_px is not None:
            low = np.maximum(low, problem.image_margin_px)
            high = np.minimum(high, np.array(view.image_size_px) - 1 - problem.image_margin_px)
        size = np.maximum(high - low, 0.0)
        if count > 1 and (
            count * pi / 4 * d**2 > DENSEST_DISCS * float(np.prod(size + d)) or d > float(np.linalg.norm(size)) + 1e-6
        ):
            where = f"what view {view.name} sees of the box ({size[0]:.0f} x {size[1]:.0f} px)"
            return [_crowded("/optimise/min_projected_spacing_px", count, f"{d:g} px apart", where)]
    return []


def _crowded(pointer: str, count: int, apart: str, where: str) -> Problem:
    return Problem(
        pointer,
        "does-not-fit",
        f"{count} free fiducials cannot be {apart} in {where}: no packing is that dense",
        "reduce the spacing, the number of free fiducials, or enlarge the box",
    )


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
