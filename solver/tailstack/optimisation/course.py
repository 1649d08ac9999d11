"""The optimiser's course on one page: from a design document to a better one, verified before it is called that.

====================  =========================================================================================
views                 where they are free: which way they look, a search around all that follows (``views``); where
                      one may be added: all of it with and without (``offer``)
problem               what may change and what must hold (``request``, ``problem``); what no search could meet is
                      refused at once (``task``, ``contradictions``, ``explain``)
starts                layouts to start from (``starts``)
programme             the first-order quantiles in symbols, one expression (``terms``, ``program``)
search                IPOPT from every start, the best polished (``search``)
exact law             the closed form corrected until the declared law itself is at its limit (``exact_law``,
                      ``placement``)
grades                what is bought from a table, and everything else around it (``grades``)
check                 Monte Carlo with a fresh seed, the aim tightened until it passes; the design as it stands, where
                      that is better and passes too (``tightening``, ``present``)
front, moves          the same at other limits, where the fiducials stand, and with fewer moves (``front``,
                      ``moves``)
record, certificate   what changed; what binds, the bound of the convex allocation, shadow prices (``reporting``,
                      ``certificate``, ``allocation``, ``shadow_prices``)
====================  =========================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Protocol

import numpy as np

from ..design import Design, load_design
from ..design.loading import locate_refusals
from ..design.optimise_document import AddedView
from ..errors import InfeasibleError, NotConvergedError, TailstackError
from ..results import CountTried, FrontPoint, Optimisation
from .aimed_bound import read_looks
from .cost_bound import enough_for
from .front import trace_front
from .global_bound import AS_THEY_LOOK, Looks
from .moves import value_moves
from .offer import weigh_offer
from .placement import settle
from .present import merit_as_written, merit_of, present_design, price_as_written
from .reporting import add_aims, report
from .request import read_request
from .search import Control, Progress, Search, Stop, hold_unmoved, search
from .task import OptimisationTask, read_task
from .tightening import CheckSettings, VerifiedOptimum, check_present, tighten
from .views import aim_views, leave_views

TIE = 1e-4  # relative: a count must be better by that to be preferred to a smaller one


def optimise(
    design: Design,
    *,
    seed: int | None = None,
    starts: int | None = None,
    gap: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Optimisation:
    """Move what is free in a design to what its ``optimise`` section asks for, under the design's own limits.

    ``seed`` and ``starts`` default to the document's, ``threads`` to every core; the answer does not depend on it.
    With a ``gap`` (0.01: 1 %) no more starts are solved once the best is that near to what no layout undercuts.
    ``progress(stage, done, total, least objective so far)`` is called after every aim of views, programme, start,
    polished optimum, settled optimum, check, point of a front and layout with fewer moves; what it raises ends the
    work.  ``stop()`` is polled; once it is true the best found so far is settled, verified and returned,
    ``certificate.stopped`` says so.  The design returned is verified: the upper confidence limit of every quantile,
    from a fresh seed, is within its limit.

    Raises DesignError (contradictions, nothing that is free acts), InfeasibleError (with the smallest quantile
    attainable and what would cure it), IllPosedError, NotConvergedError (also when stopped before anything
    converged).
    """
    control = Control(threads, progress, stop)

    def optimise_aimed(each: Design, follow: Control, free: Design) -> Optimisation:
        """With its views as they are; what it is compared with may aim them as a design leaves them free."""
        task = read_task(each, seed=seed, starts=starts, gap=gap)
        return optimise_task(task, LocalSearcher(task, follow), follow, read_looks(free, task.starts))

    def optimise_views(each: Design, aims: Control, rest: Control, added: AddedView | None = None) -> Optimisation:
        """With its views aimed first, where some are free."""
        if not (each.document.optimise and each.document.optimise.free_views):
            return optimise_aimed(each, rest, each)
        silent = replace(control, progress=None)
        with locate_refusals(design):
            aimed, record = aim_views(
                each,
                lambda candidate: least_objective(read_task(candidate, seed=seed, starts=starts), silent),
                aims,
                added,
            )
        found = add_aims(optimise_aimed(aimed, rest, each), design, record)
        if record.objective_as_aimed is None or not _undercuts(each, found):
            return found
        stayed = optimise_aimed(each, rest, each)  # by the closed form, before the check's margin, that was no better
        same = _undercuts(load_design(found.design), stayed)
        return found if same else add_aims(stayed, design, leave_views(record))

    added = None if design.document.optimise is None else design.document.optimise.added_view
    if added is None:
        return optimise_views(design, control, control)
    with locate_refusals(design):
        return weigh_offer(design, added, optimise_views, control)


def least_objective(task: OptimisationTask, control: Control) -> float:
    """The objective by the closed form, over all numbers of fiducials.  Raises what refuses a search."""
    searches, counts = search_counts(task, LocalSearcher(task, control), control)
    reached = [count.cost if count.worst_ratio is None else count.worst_ratio for count in counts]
    return min((value for value in reached if value is not None), default=searches[0].best_objective)


def optimise_task(
    task: OptimisationTask, searcher: Searcher, control: Control, looks: Looks = AS_THEY_LOOK
) -> Optimisation:
    """:func:`optimise` of what was read, with searches and fronts from a searcher: made here, or recorded elsewhere.

    looks: which way the views of what it is compared with may look.

    Raises InfeasibleError, IllPosedError, NotConvergedError, and what the searcher raises.
    """
    with locate_refusals(task.request.design):
        searches, counts = search_counts(task, searcher, control)
        optimum = take_best_verified(task, searches, control)
        front: tuple[FrontPoint, ...] = ()
        if task.request.section.goal == "pareto":
            front = searcher.trace_front(task.counts.index(optimum.search.fiducials), optimum.search)
        moves = None
        as_many = optimum.search.fiducials == len(task.request.problem.system.fiducial_labels)
        if as_many and not (task.request.graded or optimum.kept):
            found = optimum.optimum
            wanted = task.request.section.fewest_moves or task.request.section.stay is not None
            labels = found.problem.system.fiducial_labels
            moves = value_moves(optimum.search, found.choice, labels, fewest=wanted, control=control)
        return report(task, optimum, counts, front, moves, looks)


class Searcher(Protocol):
    """What takes long and can be done in parts."""

    def search(self, position: int) -> Search: ...  # at one of the numbers of fiducials; raises what ``search`` does
    def trace_front(self, position: int, search: Search) -> tuple[FrontPoint, ...]: ...


@dataclass(frozen=True, slots=True)
class LocalSearcher:
    """Everything solved here and now."""

    task: OptimisationTask
    control: Control

    def search(self, position: int) -> Search:
        task, control = self.task, self.control
        own = control.for_part(position, len(task.counts))
        return search(
            task.problems[position],
            starts=task.starts,
            seed=task.seed,
            threads=control.threads,
            progress=own.progress,
            stop=control.stop,
            enough=enough_for(task.problems[position], task.gap),
        )

    def trace_front(self, position: int, search: Search) -> tuple[FrontPoint, ...]:
        return trace_front(self.task, search, self.control)


def search_counts(
    task: OptimisationTask, searcher: Searcher, control: Control
) -> tuple[list[Search], tuple[CountTried, ...]]:
    """Searches at every number of fiducials, best objective first (a tie goes to fewer), and what each reached.

    Raises what the search at the first number raises if none found anything.
    """
    count = task.request.section.count
    each = 0.0 if count is None else count.cost_per_fiducial
    searches: list[tuple[float, Search]] = []
    tried: list[CountTried] = []
    missed = 0
    refused: TailstackError | None = None
    for position, (number, problem) in enumerate(zip(task.counts, task.problems, strict=True)):
        if control.stops() and searches:
            tried.append(CountTried(number, None, None, "not tried: stopped on request"))
            missed += 1
            continue
        try:
            result = searcher.search(position)
        except (InfeasibleError, NotConvergedError) as error:
            refused = refused or error
            tried.append(CountTried(number, None, None, error.problems[0].detail))
            continue
        priced = problem.objective != "quantile"
        total = result.best_objective + each * number if priced else result.best_objective
        note = f"{result.converged} of {result.starts} starts converged"
        tried.append(CountTried(number, total if priced else None, None if priced else total, note))
        searches.append((total, result))
    if not searches:
        assert refused is not None  # there is at least one count
        raise refused
    least = min(total for total, _ in searches)
    ranked = [item[1] for item in sorted(searches, key=lambda item: 0.0 if item[0] <= least * (1 + TIE) else item[0])]
    if missed:
        stopped = f"stopped on request: {missed} of {len(task.counts)} numbers of fiducials were not tried"
        ranked = [replace(result, stopped=stopped) for result in ranked]
    return ranked, () if count is None else tuple(tried)


def take_best_verified(task: OptimisationTask, searches: list[Search], control: Control) -> VerifiedOptimum:
    """The best of the optima that verifies, or the design as it stands where that is better.

    Raises what refuses the optima where there is neither.
    """
    found: VerifiedOptimum | TailstackError
    try:
        found = take_first_verified(task, searches, control)
    except (NotConvergedError, InfeasibleError) as error:
        found = error
    best = inf if isinstance(found, TailstackError) else merit_as_written(read_request(found.design))
    best += 0.0 if isinstance(found, TailstackError) else price_as_written(task.request, found.design)
    number = len(task.request.problem.system.fiducial_labels)
    own = next((candidate for candidate in searches if candidate.fiducials == number), None)
    if own is not None:
        kept = check_present(task.request, own, CheckSettings(task.seed), best, control)
        if kept is not None:
            return kept if isinstance(found, TailstackError) else replace(kept, exact=found.exact)
    if isinstance(found, TailstackError):
        raise found
    return found


def _undercuts(design: Design, found: Optimisation) -> bool:
    """Whether a design keeps what is asked for with less of what is made least than what was found."""
    request = read_request(design)
    here = present_design(request.problem)
    if here.moved or not here.may_keep():
        return False
    new = load_design(found.design, base_directory=design.source.directory)
    written = merit_as_written(read_request(new)) + price_as_written(request, new)
    return merit_of(request, request.problem, here.choice, here.ratios) < written


def take_first_verified(task: OptimisationTask, searches: list[Search], control: Control) -> VerifiedOptimum:
    """The best of the optima that verifies.

    Where first order does not hold at the best one (a nearly flat layout of few fiducials), another may do; where a
    number of fiducials cannot keep the limit with the check's margin, another may.
    """
    refused: TailstackError | None = None
    for candidate in searches:
        for item in candidate.iterates:
            others = (other for other in candidate.iterates if other is not item)
            first = hold_unmoved(replace(candidate, iterates=(item, *others)))
            try:
                exact = None
                if candidate.program.problem.objective != "quantile" and not task.request.graded:
                    exact = settle(first, np.ones(len(first.terms)))
                    control.report("settle", 1, 1, exact.cost)
                optimum = tighten(task.request, first, CheckSettings(task.seed), control, start=exact)
                return replace(optimum, search=candidate, exact=exact)
            except (NotConvergedError, InfeasibleError) as error:
                refused = refused or error
                if isinstance(error, InfeasibleError):
                    break  # the other optima are no better
    assert refused is not None  # a search has at least one point
    raise refused
