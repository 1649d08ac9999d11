"""The rules a layout keeps, as named rows of the programme: spacing, clearance, field of view, regions of copies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ..system import Array, View
from .problem import Place, PlacementProblem
from .regions import Box, bounding_box, contains, corners, inside_rows, moved, sample
from .symbols import Duck, plain
from .terms import DemandTerms, Estimator


@dataclass(frozen=True, slots=True)
class Row:
    """One constraint ``lower <= g <= upper`` and what it is about, in the user's words."""

    kind: str  # quantile, cost, spacing, projected_spacing, target_clearance, field, region, keep_out
    text: str
    lower: float
    upper: float
    fiducials: tuple[int, ...] = ()


def geometric_rows(
    problem: PlacementProblem, estimator: Estimator, terms: tuple[DemandTerms, ...], points: Duck
) -> Iterator[tuple[Row, Any]]:
    """Row and expression, each about 1 in size; points (N, 3) mm, floats or symbols."""
    if not problem.places:
        return
    yield from _spacing(problem, points)
    told = points @ plain(estimator.told).T + plain(estimator.told_shift_mm)
    for view, projection in zip(problem.system.views, estimator.projections, strict=True):
        homogeneous = told @ plain(projection[:, :3]).T + plain(projection[:, 3])
        image = homogeneous[:, :2] / homogeneous[:, 2:]
        yield from _projected_spacing(problem, view, image)
        yield from _target_clearance(problem, terms, view, projection, image)
        yield from _field(problem, estimator, view, projection, homogeneous)
    yield from _regions(problem, points)


def _pairs(problem: PlacementProblem) -> list[tuple[int, int]]:
    free = set(problem.free_fiducials)
    count = len(problem.system.fiducial_labels)
    return [(i, j) for i, j in combinations(range(count), 2) if i in free or j in free]


def _spacing(problem: PlacementProblem, points: Duck) -> Iterator[tuple[Row, Any]]:
    """One row per distance: under a symmetry two free fiducials and their images are equally far apart."""
    if problem.min_spacing_mm <= 0:
        return
    labels = problem.system.fiducial_labels
    copy_of = {i: copy for place in problem.places for copy, i in enumerate(place.fiducials)}
    for i, j in _pairs(problem):
        if problem.symmetry and i in copy_of and j in copy_of and 0 not in (copy_of[i], copy_of[j]):
            continue
        gap = points[i] - points[j]
        text = f"spacing of {labels[i]} and {labels[j]}"
        yield Row("spacing", text, 0.0, np.inf, (i, j)), (gap @ gap) / problem.min_spacing_mm**2 - 1


def _projected_spacing(problem: PlacementProblem, view: View, image: Duck) -> Iterator[tuple[Row, Any]]:
    if problem.min_projected_spacing_px <= 0:
        return
    labels = problem.system.fiducial_labels
    for i, j in _pairs(problem):
        gap = image[i] - image[j]
        text = f"images of {labels[i]} and {labels[j]} in {view.name}"
        yield (
            Row("projected_spacing", text, 0.0, np.inf, (i, j)),
            (gap @ gap) / problem.min_projected_spacing_px**2 - 1,
        )


def _target_clearance(
    problem: PlacementProblem, terms: tuple[DemandTerms, ...], view: View, projection: Array, image: Duck
) -> Iterator[tuple[Row, Any]]:
    if problem.target_clearance_px <= 0:
        return
    named = {term.demand.target.name: term.reconstructed_mm for term in terms}
    for name, reconstructed in named.items():
        centre = projection[:, :3] @ reconstructed + projection[:, 3]
        for i in problem.free_fiducials:
            gap = image[i] - plain(centre[:2] / centre[2])
            text = f"images of {problem.system.fiducial_labels[i]} and of target {name!r} in {view.name}"
            yield (
                Row("target_clearance", text, 0.0, np.inf, (i,)),
                (gap @ gap) / problem.target_clearance_px**2 - 1,
            )


def _field(
    problem: PlacementProblem, estimator: Estimator, view: View, projection: Array, homogeneous: Duck
) -> Iterator[tuple[Row, Any]]:
    """Inside the image with its margin, multiplied by the depth: linear in the position.

    A side that the whole bounding box of a region keeps (its corners do, and the constraint is linear) gives no rows.
    """
    if view.image_size_px is None:
        return
    for place in problem.places:
        for copy, i in enumerate(place.fiducials):
            reach = corners(bounding_box(place.region))
            if copy:
                reach = moved(problem.symmetry[copy - 1], reach)
            seen = (reach @ estimator.told.T + estimator.told_shift_mm) @ projection[:, :3].T + projection[:, 3]
            scale = float(np.abs(seen[:, 2]).mean()) * max(view.image_size_px)
            for axis, sign, name in ((0, 1, "left"), (0, -1, "right"), (1, 1, "top"), (1, -1, "bottom")):
                edge = problem.image_margin_px if sign > 0 else view.image_size_px[axis] - 1 - problem.image_margin_px
                if (sign * (seen[:, axis] - edge * seen[:, 2]) >= 0).all():
                    continue
                text = f"{problem.system.fiducial_labels[i]} at the {name} edge of {view.name}"
                inside = sign * (homogeneous[i, axis] - float(edge) * homogeneous[i, 2]) / scale
                yield Row("field", text, 0.0, np.inf, (i,)), inside


def _regions(problem: PlacementProblem, points: Duck) -> Iterator[tuple[Row, Any]]:
    """A box is held by the bounds of its variables; other regions, and boxes of copies, by rows."""
    for place in problem.places:
        for copy, i in enumerate(place.fiducials):
            if _kept_anyway(problem, place, copy):
                continue
            for face, expression, equal in inside_rows(place.region, points[i]):
                text = f"{problem.system.fiducial_labels[i]} at the {face} of its region"
                yield Row("region", text, 0.0, 0.0 if equal else np.inf, (i,)), expression


def _kept_anyway(problem: PlacementProblem, place: Place, copy: int) -> bool:
    """Whether the bounds, or the rows of the first of the group, already keep this one in the region."""
    if copy == 0:
        return isinstance(place.region, Box)
    isometry = problem.symmetry[copy - 1]
    if isinstance(place.region, Box):
        reach = corners(bounding_box(place.region))
    else:
        reach = sample(place.region, np.random.default_rng(0), 400, 0.5)
    size = float(np.ptp(reach, axis=0).max())
    return bool(contains(place.region, moved(isometry, reach), 1e-9 * size).all())
