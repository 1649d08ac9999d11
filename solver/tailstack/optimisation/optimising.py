"""From a design document to a better one that keeps its limits, verified by Monte Carlo before it is called that."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ..design import Design
from ..design.refusals import place
from ..errors import InfeasibleError, NotConvergedError, TailstackError
from ..results import CountTried, Finding, FrontPoint, Optimisation
from .alternatives import front_of, placement_value
from .contradictions import refuse_contradictions
from .explain import influence_of, refuse_incurable
from .placement import PlacementSolution, settle
from .problem import PlacementProblem
from .reporting import Outcome, report
from .request import Request, list_counts, read_request, with_count
from .search import Progress, Search, Stop, objective_for_people, search
from .verified import VerifiedOptimum, tighten

TIE = 1e-4  # relative: a count must be better by that to be preferred to a smaller one


def optimise(
    design: Design,
    *,
    seed: int | None = None,
    starts: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Optimisation:
    """Move what is free in a design to what its ``optimise`` section asks for, under the design's own limits.

    ``seed`` and ``starts`` default to the document's, ``threads`` to every core; the answer does not depend on it.
    ``progress(stage, done, total, least objective so far)`` is called after every start, count, check and point of a
    front; what it raises ends the work.  ``stop()`` is polled; once it is true the best found so far is settled,
    verified and returned, ``certificate.stopped`` says so.  The design returned is verified: the upper confidence
    limit of every quantile, from a fresh seed, is within its limit.

    Raises DesignError (contradictions, nothing that is free acts), InfeasibleError (with the smallest quantile
    attainable and what would cure it), IllPosedError, NotConvergedError (also when stopped before anything
    converged).
    """
    asked = ask(design, seed=seed, starts=starts)

    def searched(position: int) -> Search:
        watch = _offset(progress, position, len(asked.counts))
        return search(
            asked.problems[position], starts=asked.starts, seed=asked.seed, threads=threads, progress=watch, stop=stop
        )

    return finish(asked, searched, threads=threads, progress=progress, stop=stop)


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """What a document asks for, refused already where no search is needed to refuse it."""

    request: Request
    seed: int
    starts: int
    counts: tuple[int, ...]  # numbers of fiducials to be tried
    problems: tuple[PlacementProblem, ...]  # one for each
    remarks: tuple[Finding, ...]


def ask(design: Design, *, seed: int | None = None, starts: int | None = None) -> Asked:
    """Read the ``optimise`` section of a design.  Raises DesignError, InfeasibleError."""
    with _locating_refusals(design):
        request = read_request(design)
        counts = list_counts(request)
        problems = tuple(with_count(request, count) for count in counts)
        for problem in problems:
            refuse_contradictions(problem)
        refuse_incurable(request.problem)
        return Asked(
            request,
            request.wanted.seed if seed is None else seed,
            request.wanted.starts if starts is None else starts,
            counts,
            problems,
            influence_of(request.problem),
        )


def finish(
    asked: Asked, searched: Callable[[int], Search], *, threads: int | None = None, progress: Progress | None = None,
    stop: Stop | None = None, fronted: Callable[[int, Search], tuple[FrontPoint, ...]] | None = None,
) -> Optimisation:  # fmt: skip
    """From the searches at every number of fiducials to the answer.

    ``searched(position)`` gives one, or raises what ``search`` raises; ``fronted(position, search)`` gives the front
    that starts at the chosen one, where it is not to be computed here.
    Raises InfeasibleError, IllPosedError, NotConvergedError.
    """
    request, seed = asked.request, asked.seed
    with _locating_refusals(request.design):
        searches, tried = _search_counts(asked, searched, stop)
        found, exact, result = _take_first_verified(request, searches, seed, threads, progress, stop)
        chosen = len(found.program.problem.system.fiducial_labels)
        tried = tuple(
            replace(item, note=f"{item.note}; chosen") if item.fiducials == chosen else item for item in tried
        )
        front: tuple[FrontPoint, ...] = ()
        if request.wanted.wanted == "pareto" and fronted is not None:
            front = fronted(asked.counts.index(chosen), found)
        elif request.wanted.wanted == "pareto":
            front = front_of(request, found, seed=seed, threads=threads, progress=progress, stop=stop)
        best = objective_for_people(found.program, found.found[0].point.objective)
        value = None
        if not request.graded:
            value = placement_value(found, best, seed, stop)
        return report(Outcome(request, found, exact, result, asked.remarks, value, tried, front, seed))


@contextmanager
def _locating_refusals(design: Design) -> Iterator[None]:
    """Refusals with their place in the user's document."""
    try:
        yield
    except TailstackError as error:
        raise type(error)([place(problem, design.source) for problem in error.problems]) from None


def influence(design: Design) -> tuple[Finding, ...]:
    """What the free variables of a design can and cannot do, in milliseconds.  Raises DesignError."""
    with _locating_refusals(design):
        request = read_request(design)
        refuse_contradictions(request.problem)
        refuse_incurable(request.problem)
        return influence_of(request.problem)


def _take_first_verified(
    request: Request, searches: list[Search], seed: int, threads: int | None, progress: Progress | None,
    stop: Stop | None,
) -> tuple[Search, PlacementSolution | None, VerifiedOptimum]:  # fmt: skip
    """The best of the optima that verifies, its search, and its optimum by the exact law at the limits themselves.

    Where first order does not hold at the best one (a nearly flat layout of few fiducials), another may do; where a
    number of fiducials cannot keep the limit with the check's margin, another may.
    """
    refused: TailstackError | None = None
    for found in searches:
        for item in found.found:
            one = replace(found, found=(item, *(other for other in found.found if other is not item)))
            try:
                exact = None
                if found.program.problem.objective != "quantile" and not request.graded:
                    exact = settle(one, np.ones(len(one.terms)))
                return (
                    found,
                    exact,
                    tighten(request, one, seed=seed, start=exact, threads=threads, progress=progress, stop=stop),
                )
            except NotConvergedError as error:
                refused = refused or error
            except InfeasibleError as error:
                refused = refused or error
                break  # the other optima are no better
    assert refused is not None  # a search has at least one point
    raise refused


def _search_counts(
    asked: Asked, searched: Callable[[int], Search], stop: Stop | None
) -> tuple[list[Search], tuple[CountTried, ...]]:
    """Searches at every number of fiducials, best objective first (a tie goes to fewer), and what each reached."""
    request, counts = asked.request, asked.counts
    each = request.wanted.count.cost_per_fiducial if request.wanted.count is not None else 0.0
    searches: list[tuple[float, Search]] = []
    tried: list[CountTried] = []
    missed = 0
    refused: TailstackError | None = None
    for position, (count, problem) in enumerate(zip(counts, asked.problems, strict=True)):
        if stop is not None and stop() and searches:
            tried.append(CountTried(count, None, None, "not tried: stopped on request"))
            missed += 1
            continue
        try:
            found = searched(position)
        except (InfeasibleError, NotConvergedError) as error:
            refused = refused or error
            tried.append(CountTried(count, None, None, error.problems[0].detail))
            continue
        objective = objective_for_people(found.program, found.found[0].point.objective)
        priced = problem.objective != "quantile"
        total = objective + each * count if priced else objective
        note = f"{found.converged} of {found.starts} starts converged"
        tried.append(CountTried(count, total if priced else None, None if priced else objective, note))
        searches.append((total, found))
    if not searches:
        assert refused is not None  # there is at least one count
        raise refused
    least = min(total for total, _ in searches)
    ranked = [item[1] for item in sorted(searches, key=lambda item: 0.0 if item[0] <= least * (1 + TIE) else item[0])]
    if missed:
        stopped = f"stopped on request: {missed} of {len(counts)} numbers of fiducials were not tried"
        ranked = [replace(found, stopped=stopped) for found in ranked]
    return ranked, tuple(tried) if request.wanted.count is not None else ()


def _offset(progress: Progress | None, position: int, searches: int) -> Progress | None:
    """Progress of one search as part of several."""
    if progress is None:
        return None

    def report_start(stage: str, done: int, total: int, least: float | None) -> None:
        progress(stage, position * total + done, searches * total, least)

    return report_start
