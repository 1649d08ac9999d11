"""The front of cost and limit: the least cost at a row of limits, every point verified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Literal

import numpy as np

from ..errors import InfeasibleError, NotConvergedError
from ..results import FrontPoint
from ..scoring import vector3
from .begin import begin
from .problem import PlacementProblem, for_people
from .program import Program
from .promise import promise
from .request import Request
from .search import Progress, Search, Stop, least_quantile, promised, worst_ratio
from .verified import Verified, trials_for, verified

LEAST_TRIALS = 2**18  # of the check of a point: P95 within 0.3 %
ABOVE_LEAST = 1.02  # the tightest limit, as a multiple of the smallest quantile attainable
LOOSEST = 2.0  # the loosest, as a multiple of the requirement's


def front_of(
    request: Request, search: Search, *, seed: int, threads: int | None, progress: Progress | None, stop: Stop | None
) -> tuple[FrontPoint, ...]:
    """One point for each limit, ascending; those without a design say why."""
    factors = front_factors(request, search)
    points: list[FrontPoint] = []
    for number, factor in enumerate(factors):
        if stop is not None and stop():
            points.append(_empty(search.program.problem, factor, "not tried", "stopped on request"))
            continue
        points.append(front_point(request, search, number, factor, seed=seed, threads=threads, stop=stop))
        if progress is not None:
            progress("front", number + 1, len(factors), points[-1].cost)
    return without_dominated(points)


def front_point(
    request: Request, search: Search, number: int, factor: float, *, seed: int, threads: int | None = None,
    stop: Stop | None = None,
) -> FrontPoint:  # fmt: skip
    """The least cost at ``factor`` times the limit, solved from each of the search's best layouts."""
    problem = search.program.problem
    trials = max(trials_for(len(problem.targets)) // 4, LEAST_TRIALS // 4)
    best, reason = None, ""
    for item in search.found:
        try:
            found = verified(
                request, replace(search, found=(item,)), seed=seed + 1 + number, stage="front check", trials=trials,
                limits=factor, threads=threads, stop=stop, others=False,
            )  # fmt: skip
        except (InfeasibleError, NotConvergedError) as error:
            reason = reason or error.problems[0].detail
            continue
        if best is None or found.settled.cost < best.settled.cost:
            best = found
    if best is None:
        return _empty(problem, factor, "out of reach", reason)
    return _point(problem, search, best, factor)


def without_dominated(points: Sequence[FrontPoint]) -> tuple[FrontPoint, ...]:
    """Points by ascending limit, each that costs no less than one before it marked as dominated.

    A design that keeps a tighter limit keeps a looser one too, so such a point is none of the front.
    """
    kept: list[FrontPoint] = []
    cheapest = inf
    for point in points:
        if point.status == "verified" and point.cost is not None:
            if point.cost >= cheapest:
                note = f"a tighter limit is kept for {cheapest:.5g}"
                kept.append(replace(point, status="dominated", note=note))
                continue
            cheapest = point.cost
        kept.append(point)
    return tuple(kept)


def _empty(
    problem: PlacementProblem, factor: float, status: Literal["out of reach", "not tried"], note: str
) -> FrontPoint:
    limit = problem.requirements[0].limit_mm * factor
    return FrontPoint(factor, limit, status, note, None, None, None, (), (), (), ())


def front_factors(request: Request, search: Search) -> tuple[float, ...]:
    """Multiples of the requirement's limit, evenly spaced in logarithm."""
    limit = search.program.problem.requirements[0].limit_mm
    front = request.wanted.front
    low = front.min_limit_mm / limit if front is not None and front.min_limit_mm is not None else None
    high = front.max_limit_mm / limit if front is not None and front.max_limit_mm is not None else LOOSEST
    if low is None:
        low = min(ABOVE_LEAST * _least_ratio(search.program, search), 0.99 * high)
    return tuple(float(factor) for factor in np.geomspace(low, high, front.points if front is not None else 9))


def _least_ratio(program: Program, search: Search) -> float:
    """The smallest worst ratio attainable, from the best layouts found."""
    starts = [begin(program, program.split(item.point.x).fiducials_mm) for item in search.found]
    ratios = []
    for start in starts:
        point = least_quantile(program, [start]).point
        ratios.append(worst_ratio(promised(program, point)))
    return min(ratios)


def _point(problem: PlacementProblem, search: Search, found: Verified, factor: float) -> FrontPoint:
    choice = found.settled.choice
    first = problem.requirements[0]
    own = [term for term in search.terms if term.demand.requirement.name == first.name]
    checks = [check for check in found.verification.verdict.checks if check.requirement == first.name]
    return FrontPoint(
        factor=factor,
        limit_mm=first.limit_mm * factor,
        status="verified",
        note="",
        cost=found.settled.cost,
        quantile_mm=max(promise(problem, term, choice).exact_mm for term in own),
        verified_upper_mm=max(check.upper_mm for check in checks),
        half_widths=tuple(for_people(problem, k, float(value))[0] for k, value in enumerate(choice.half_width)),
        pivots_mm=tuple(vector3(pivot) for pivot in choice.pivots_mm),
        locator_scales=tuple(float(scale) for scale in choice.spacing),
        fiducials_mm=tuple(vector3(point) for point in choice.fiducials_mm),
    )
