"""The same search for a layout with one thing changed: how many fiducials, how large an envelope, which angle between
views, which estimator.

Half-widths and pivots stay as designed and P95 of one error is made least: what is left is the layout alone.  Neither
a price of moving, nor what must hold when fiducials are lost, is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import acos, cos, degrees, radians
from typing import Literal, NamedTuple

import numpy as np

from ..contributors import declared_law
from ..design import Design
from ..design.document import DistanceView, PresetView
from ..design.write import turn_entry
from ..errors import DesignError, Problem, TailstackError
from ..geometry.arrays import Array
from ..geometry.camera import principal_ray
from ..geometry.rotation import unit
from ..measures import PointError
from ..propagation.linear import chain_of
from ..results import GlobalBound
from ..results.verdicts import P95
from ..system import ESTIMATORS, Requirement, Way
from ..tail.declared import law_quantile
from .global_bound import certify_layout, information_of, target_slopes
from .problem import MOST_FIDUCIALS, PlacementProblem, present_choice
from .regions import bounding_box, enlarge
from .request import read_request, with_count
from .search import search
from .surface import NearSurface
from .terms import every_terms, linearise_demand

Kind = Literal["nothing", "fiducials", "envelope", "angle", "estimator"]
COUNTS = (-4, -2, -1, 1, 2, 4)  # fiducials more, or groups of them
SIZES = (0.5, 0.75, 1.25, 1.5, 2.0)  # of the envelope as designed
ANGLES_DEG = (30.0, 45.0, 60.0, 75.0, 90.0)  # between the lines of two beams
SAME_DEG = 1.0  # an angle as near as that to the designed one is the designed one


@dataclass(frozen=True, slots=True)
class Alternative:
    """One thing that is otherwise than designed, or nothing."""

    kind: Kind
    words: str
    value: float | None  # on the axis of its kind; None of an estimator, and of nothing
    make: Callable[[], PlacementProblem]  # raises TailstackError


def list_changes(design: Design, error: PointError) -> tuple[Alternative, ...]:
    """Nothing changed, then each change; those that a design does not allow are left out.  Raises DesignError."""
    problem = layout_problem(design, error)
    kinds = (_counts(design, error), _sizes(problem), _angles(design, problem, error), _estimators(design, error))
    return (Alternative("nothing", "as designed", None, lambda: problem), *(each for kind in kinds for each in kind))


def layout_problem(design: Design, error: PointError) -> PlacementProblem:
    """Only the layout is free, and P95 of an error at the worst target is made least.

    Raises DesignError, also where no fiducial is free.
    """
    problem = _layout_alone(read_request(design).problem, error)
    if not problem.places:
        detail = "no fiducial is free: there is one layout alone"
        hint = "give optimise a box, or regions in which fiducials may be"
        raise DesignError(Problem("/optimise", "nothing-free", detail, hint))
    return problem


def _layout_alone(problem: PlacementProblem, error: PointError) -> PlacementProblem:
    names = tuple(target.name for target in problem.system.targets)
    requirement = Requirement(f"P95 of {error}", error, P95, 1.0, P95, names)
    return replace(problem.layout_alone((requirement,)), stay=None)


def _counts(design: Design, error: PointError) -> Iterator[Alternative]:
    """More and fewer fiducials in the one region, whole groups of them where it is symmetric."""
    request = read_request(design)
    system, size = request.problem.system, 1 + len(request.problem.symmetry)
    fewest = max(system.estimator.traits.fewest_fiducials, len(request.section.fixed) + size)
    if request.section.regions is not None:  # each names the fiducials that are its own
        return

    def put(count: int) -> PlacementProblem:
        return _layout_alone(with_count(request, count), error)

    for count in (len(system.fiducial_labels) + size * more for more in COUNTS):
        if fewest <= count <= MOST_FIDUCIALS:
            yield Alternative("fiducials", f"{count} fiducials", count, partial(put, count))


def _sizes(problem: PlacementProblem) -> Iterator[Alternative]:
    """All regions wider about the middle of the box around them."""
    regions = [place.region for place in problem.places if not isinstance(place.region, NearSurface)]
    if len(regions) < len(problem.places):
        return
    boxes = np.array([bounding_box(region) for region in regions])
    middle = (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2

    def widen(factor: float) -> PlacementProblem:
        wider = (enlarge(region, middle, factor) for region in regions)
        places = (replace(place, region=region) for place, region in zip(problem.places, wider, strict=True))
        return replace(problem, places=tuple(places))

    for factor in SIZES:
        yield Alternative("envelope", f"envelope {factor:g} times as wide", factor, partial(widen, factor))


def _angles(design: Design, problem: PlacementProblem, error: PointError) -> Iterator[Alternative]:
    """A view turned in the plane of its beam and that of another, image and detector with it."""
    pair = find_pair(design, problem)
    if pair is None:
        return
    view, place = pair.view, pair.place
    beam, fixed = (unit(principal_ray(problem.system.views[k].projection)) for k in (place, pair.other))
    across = unit(cos(radians(pair.angle_deg)) * beam - fixed)  # away from the other beam
    right = unit(np.cross(beam, np.array(view.up_direction)))
    to_right, to_top = float(across @ right), float(across @ np.cross(right, beam))
    written = design.source.data["views"][place]

    def turn(by_deg: float) -> PlacementProblem:
        entry = turn_entry(written, view, by_deg * to_right, by_deg * to_top)
        return layout_problem(design.with_value(f"/views/{place}", entry), error)

    for line_deg in ANGLES_DEG:
        by_deg = (line_deg if pair.angle_deg <= 90 else 180 - line_deg) - pair.angle_deg
        if abs(by_deg) >= SAME_DEG:
            yield Alternative("angle", f"{line_deg:g} deg between {pair.words}", line_deg, partial(turn, by_deg))


class BeamPair(NamedTuple):
    """A view that may turn, and one beside it."""

    place: int
    other: int
    view: PresetView | DistanceView  # the one that turns
    angle_deg: float  # between their beams, 0 to 180
    words: str


def find_pair(design: Design, problem: PlacementProblem) -> BeamPair | None:
    """The last aimed view and the first other one; None where none is aimed, or both beams run along one line."""
    views = list(enumerate(design.document.views))
    aimed = [(k, view) for k, view in views if isinstance(view, PresetView | DistanceView)]
    if not aimed or len(views) == 1:
        return None
    place, view = aimed[-1]
    other, beside = next((k, each) for k, each in views if k != place)
    rays = [unit(principal_ray(problem.system.views[k].projection)) for k in (place, other)]
    angle_deg = degrees(acos(np.clip(rays[0] @ rays[1], -1.0, 1.0)))
    if not SAME_DEG < angle_deg < 180 - SAME_DEG:
        return None
    return BeamPair(place, other, view, angle_deg, f"{beside.name} and {view.name}")


def _estimators(design: Design, error: PointError) -> Iterator[Alternative]:
    """The others; those that weigh how well intrinsics are known where every view says it."""
    system = read_request(design).problem.system
    known = all(view.intrinsics_prior is not None for view in system.views)

    def take(name: str) -> PlacementProblem:
        return layout_problem(design.with_value("/model/estimator", name), error)

    for estimator, traits in ESTIMATORS.items():
        if estimator is not system.estimator and (known or not traits.takes_prior):
            yield Alternative("estimator", str(estimator), None, partial(take, str(estimator)))


@dataclass(frozen=True, slots=True, eq=False)
class BestLayout:
    """The best layout that was found, and what none undercuts."""

    bound: GlobalBound  # its quantile is that of the layout found
    fiducials_mm: Array  # (N, 3); as designed where none was found
    reason: str  # why none was found; empty where one was


def find_best(problem: PlacementProblem, *, starts: int, seed: int, threads: int | None) -> BestLayout:
    """Search for the best layout, and prove how far from it any could be."""
    reason, choice = "", present_choice(problem)
    try:
        found = search(problem, starts=starts, seed=seed, threads=threads)
        choice = found.program.split(found.iterates[0].point.x)
    except TailstackError as refusal:
        reason = refusal.problems[0].detail
    return BestLayout(certify_layout(problem, every_terms(problem), choice), choice.fiducials_mm, reason)


def floor_of(problem: PlacementProblem, target: str) -> float:
    """What no structure undercuts, however large and of however many fiducials, mm: the quantile at a target if the
    views were known exactly, and nothing of what is known beforehand moved the error.

    Of a problem that has a bound.
    """
    term = next(term for term in every_terms(problem) if term.demand.site.name == target)
    information = information_of(problem, term)
    slopes = target_slopes(information).moved[0]
    model, _ = linearise_demand(chain_of(problem.system), term.demand)
    behind = tuple(block for block in model.blocks if block.effect.way is Way.LINK)
    law = declared_law(replace(model, blocks=behind), term.demand.requirement.error, np.zeros(3))
    images = term.to_error @ np.linalg.inv(slopes.T @ slopes) @ term.to_error.T
    found = law_quantile(replace(law, covariance=law.covariance + images), term.demand.requirement.quantile)
    return found.quantile_mm - found.error_mm
