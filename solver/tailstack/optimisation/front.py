"""The front of cost and limit: the least cost at a row of limits, every point verified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import InfeasibleError, NotConvergedError
from ..results import FrontPoint
from ..system import Array
from .begin import begin
from .problem import Choice, PlacementProblem, for_people
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
    """Points of ascending limit and falling cost; a limit at which nothing verifies is left out.

    Every limit is solved from each of the search's best layouts.  A design that keeps a tighter limit keeps a
    looser one too, so a point that costs more than its tighter neighbour is not on the front and is dropped.
    """
    problem = search.program.problem
    factors = _factors(request, search)
    trials = max(trials_for(problem) // 4, LEAST_TRIALS // 4)
    points: list[FrontPoint] = []
    for k, factor in enumerate(factors):
        best: Verified | None = None
        for item in search.found:
            try:
                found = verified(
                    request, replace(search, found=(item,)), seed=seed + 1 + k, stage="front check", trials=trials,
                    limits=float(factor), threads=threads, stop=stop,
                )  # fmt: skip
            except (InfeasibleError, NotConvergedError):
                continue
            if best is None or found.settled.cost < best.settled.cost:
                best = found
        if best is not None:
            point = _point(problem, search, best, float(factor))
            if not points or point.cost < points[-1].cost:
                points.append(point)
        if progress is not None:
            progress("front", k + 1, len(factors), None if best is None else best.settled.cost)
        if stop is not None and stop():
            break
    return tuple(points)


def _factors(request: Request, search: Search) -> Array:
    """Multiples of the requirement's limit, evenly spaced in logarithm."""
    limit = search.program.problem.requirements[0].limit_mm
    front = request.wanted.front
    low = front.min_limit_mm / limit if front is not None and front.min_limit_mm is not None else None
    high = front.max_limit_mm / limit if front is not None and front.max_limit_mm is not None else LOOSEST
    if low is None:
        low = min(ABOVE_LEAST * _least_ratio(search.program, search), 0.99 * high)
    return np.geomspace(low, high, front.points if front is not None else 9)


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
    return FrontPoint(
        limit_mm=problem.requirements[0].limit_mm * factor,
        cost=found.settled.cost,
        quantile_mm=_quantile_mm(problem, search, choice),
        verified_upper_mm=found.upper_mm,
        half_widths=tuple(for_people(problem, k, float(value))[0] for k, value in enumerate(choice.half_width)),
        fiducials_mm=tuple((float(x), float(y), float(z)) for x, y, z in choice.fiducials_mm),
    )


def _quantile_mm(problem: PlacementProblem, search: Search, choice: Choice) -> float:
    return max(promise(problem, term, choice).exact_mm for term in search.terms)
