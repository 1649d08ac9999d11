"""What else could be had: the front of cost and limit, the least cost at a row of limits, every point verified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Literal

import numpy as np

from ..errors import InfeasibleError, NotConvergedError
from ..results import FrontPoint
from ..scoring import vector3
from .exact_law import evaluate_demand
from .margin import trials_for
from .present import merit_of
from .problem import PlacementProblem, for_people
from .request import OptimiseRequest, in_order
from .search import Control, Search, evaluate_demands, least_quantile, start_at, worst_ratio
from .task import OptimisationTask
from .tightening import CheckSettings, VerifiedOptimum, check_present, tighten

LEAST_TRIALS = 2**18  # of the check of a point: P95 within 0.3 %
ABOVE_LEAST = 1.02  # the tightest limit, as a multiple of the smallest quantile attainable
LOOSEST = 2.0  # the loosest, as a multiple of the requirement's


def trace_front(task: OptimisationTask, search: Search, control: Control) -> tuple[FrontPoint, ...]:
    """One point for each limit, ascending; those without a design say why."""
    factors = front_factors(task.request, search)
    points: list[FrontPoint] = []
    for number, factor in enumerate(factors):
        if control.stops():
            points.append(_empty(search.program.problem, factor, "not tried", "stopped on request"))
            continue
        points.append(front_point(task, search, number, factor, replace(control, progress=None)))
        control.report("front", number + 1, len(factors), points[-1].cost)
    return mark_dominated(points)


def front_point(task: OptimisationTask, search: Search, number: int, factor: float, control: Control) -> FrontPoint:
    """The least cost at ``factor`` times the limit, solved from each of the search's best layouts, or that of the
    design as it stands."""
    problem = search.program.problem
    settings = CheckSettings(
        seed=task.seed + 1 + number,
        stage="front check",
        trials=max(trials_for(len(problem.targets)) // 4, LEAST_TRIALS // 4),
        limits=factor,
        others=False,
    )
    best, reason = None, ""
    for item in search.iterates:
        try:
            verified = tighten(task.request, replace(search, iterates=(item,)), settings, control)
        except (InfeasibleError, NotConvergedError) as error:
            reason = reason or error.problems[0].detail
            continue
        if best is None or verified.optimum.cost < best.optimum.cost:
            best = verified
    if search.fiducials == len(task.request.problem.system.fiducial_labels):
        least = inf if best is None else merit_of(task.request, problem, best.optimum.choice, best.optimum.ratios)
        best = check_present(task.request, search, settings, least, control) or best
    if best is None:
        return _empty(problem, factor, "out of reach", reason)
    return _point(task.request, search, best, factor)


def mark_dominated(points: Sequence[FrontPoint]) -> tuple[FrontPoint, ...]:
    """Points by ascending limit, each that costs no less than one before it marked as dominated.

    A design that keeps a tighter limit keeps a looser one too, so such a point is none of the front.
    """
    marked: list[FrontPoint] = []
    cheapest = inf
    for point in points:
        if point.status == "verified" and point.cost is not None:
            if point.cost >= cheapest:
                note = f"a tighter limit is kept for {cheapest:.5g}"
                marked.append(replace(point, status="dominated", note=note))
                continue
            cheapest = point.cost
        marked.append(point)
    return tuple(marked)


def _empty(
    problem: PlacementProblem, factor: float, status: Literal["out of reach", "not tried"], note: str
) -> FrontPoint:
    limit = problem.in_mm[0].requirement.limit * factor
    return FrontPoint(factor, limit, status, note, None, None, None, (), (), ())


def front_factors(request: OptimiseRequest, search: Search) -> tuple[float, ...]:
    """Multiples of the requirement's limit, evenly spaced in logarithm."""
    limit = search.program.problem.in_mm[0].requirement.limit
    front = request.section.front
    low = front.min_limit_mm / limit if front is not None and front.min_limit_mm is not None else None
    high = front.max_limit_mm / limit if front is not None and front.max_limit_mm is not None else LOOSEST
    if low is None:
        low = min(ABOVE_LEAST * _least_ratio(search), 0.99 * high)
    return tuple(float(factor) for factor in np.geomspace(low, high, front.points if front is not None else 9))


def _least_ratio(search: Search) -> float:
    """The smallest worst ratio attainable, from the best layouts found."""
    program, ratios = search.program, []
    for item in search.iterates:
        start = start_at(program, program.split(item.point.x).fiducials_mm)
        point = least_quantile(program, [start]).point
        ratios.append(worst_ratio(evaluate_demands(program, point)))
    return min(ratios)


def _point(request: OptimiseRequest, search: Search, verified: VerifiedOptimum, factor: float) -> FrontPoint:
    choice, problem = verified.optimum.choice, search.program.problem
    order = in_order(request, verified.optimum.problem.system.fiducial_labels)
    first = problem.in_mm[0].requirement
    own = [term for term in search.terms if term.demand.requirement.name == first.name]
    checks = [check for check in verified.verification.verdict.checks if check.requirement == first.name]
    return FrontPoint(
        factor=factor,
        limit_mm=first.limit * factor,
        status="verified",
        note="",
        cost=verified.optimum.cost,
        quantile_mm=max(evaluate_demand(problem, term, choice).exact_mm for term in own),
        verified_upper_mm=max(check.upper for check in checks),
        half_widths=tuple(for_people(problem, k, float(value))[0] for k, value in enumerate(choice.half_width)),
        pivots_mm=tuple(vector3(pivot) for pivot in choice.pivots_mm),
        fiducials_mm=tuple(vector3(point) for point in choice.fiducials_mm[order]),
    )
