"""The record of an optimisation: what changed, what it costs, what binds, what it rests on."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from ..design import Design, compile_design, design_to_data
from ..errors import IllPosedError
from ..estimation.checks import check_geometry
from ..geometry.arrays import Array
from ..results import (
    ERRORS,
    Certificate,
    ChangedTolerance,
    CountTried,
    FrontPoint,
    MovedFiducial,
    MovedPivot,
    MovesValue,
    Optimisation,
    Relaxation,
    ShadowPrice,
    ViewSearch,
)
from ..results.digits import at_least, percent_change
from ..scoring import vector3
from ..system import System
from .certificate import bound_cost, name_binding
from .cost_bound import bound_any_layout, cells_for, take_smallest
from .exact_law import p95_of
from .explain import influence_of, remark_levers
from .global_bound import Looks, certify_layout
from .half_widths import list_changes
from .present import present_design, price_as_written, say_outside
from .problem import Choice, PlacementProblem, label_of, name_held, present_choice
from .request import OptimiseRequest, read_request
from .shadow_prices import price_bounds
from .task import OptimisationTask
from .terms import DemandTerms, every_terms, pivot_shift_of, terms_of
from .tightening import VerifiedOptimum

NEAR = 0.01  # a design that is kept has the shadow prices of an optimum that costs about as much


def report(
    task: OptimisationTask,
    verified: VerifiedOptimum,
    counts: tuple[CountTried, ...],
    front: tuple[FrontPoint, ...],
    moves: MovesValue | None,
    looks: Looks,
) -> Optimisation:
    """Costs and P95 are recomputed from the new document as written; looks: which way its views might look."""
    request, optimum = task.request, verified.optimum
    solution = optimum.solution
    problem = optimum.problem
    after = read_request(verified.design).problem
    before_system, after_system = request.problem.system, after.system
    before, now = present_choice(request.problem), present_choice(after)
    search = verified.search
    count_price = request.section.count.cost_per_fiducial if request.section.count is not None else 0.0
    cost_before = request.problem.cost(before.half_width) + count_price * len(before_system.fiducial_labels)
    fiducials_cost = count_price * len(after_system.fiducial_labels)
    cost_of_moves = price_as_written(request, verified.design)
    cost_after = problem.cost(now.half_width) + fiducials_cost + cost_of_moves
    minimised = problem.objective != "quantile"
    p95_before_mm, p95_after_mm = find_p95_mm(request.design), max(p95_of(compile_design(verified.design), after.in_mm))
    made_least: tuple[float | None, float] = (cost_before, cost_after) if minimised else (p95_before_mm, p95_after_mm)
    certified, written = solution or verified.exact, replace(optimum.choice, half_width=now.half_width)
    return Optimisation(
        schema="tailstack/optimisation/1",
        status="verified",
        objective=_in_a_sentence(request, problem),
        cost_before=cost_before if np.isfinite(cost_before) else None,
        cost_after=cost_after,
        cost_closed_form=search.best_objective if minimised else None,
        cost_exact_law=None if verified.exact is None else verified.exact.cost + fiducials_cost,
        p95_before_mm=p95_before_mm,
        p95_after_mm=p95_after_mm,
        moved=_list_moves(before_system, after_system, problem),
        tolerances=_tolerances(verified, before, now),
        pivots=tuple(
            MovedPivot(free.contributor, label_of(problem, free.contributor), vector3(was), vector3(at))
            for free, was, at in zip(problem.pivots, before.pivots_mm, now.pivots_mm, strict=True)
        ),
        scaling=float(np.min(now.half_width / before.half_width)) if problem.objective == "scaling" else None,
        certificate=Certificate(
            kkt_residual=0.0 if certified is None else certified.kkt_residual,
            starts=search.starts,
            converged_starts=search.converged,
            best_costs=tuple(item.objective for item in search.optima),
            optima=search.optima,
            relaxation=bound_cost(search, optimum, verified.exact),
            seed=task.seed,
            tightening_rounds=verified.rounds,
            stopped=search.stopped,
            gap=task.gap,
            verification=verified.verification,
            global_bound=certify_layout(problem, search.terms, written, looks),
            cheapest=_bound_cost(task, verified, now.half_width, (cost_after, fiducials_cost), looks),
        ),
        shadow_prices=_shadow_prices(verified),
        binding=()
        if solution is None
        else name_binding(
            solution.program, solution.iterate.point, solution.iterate.parameters, after_system.fiducial_labels
        ),
        influence=(
            *remark_levers(request.problem, now),
            *(remark for remark in task.remarks if remark.rule != "no-lever"),
        ),
        counts=tuple(
            replace(item, note=f"{item.note}; chosen") if item.fiducials == search.fiducials else item
            for item in counts
        ),
        front=front,
        design_before=design_to_data(request.design),
        design=design_to_data(verified.design),
        survived=verified.survived,
        not_asked=tuple(
            item.name
            for item in before_system.requirements
            if item.name not in {asked.name for asked in problem.requirements}
        ),
        provenance=verified.verification.provenance,
        moves=moves,
        cost_of_moves=cost_of_moves,
        as_it_stood=_say_as_it_stood(task, verified, made_least),
    )


def _bound_cost(
    task: OptimisationTask, verified: VerifiedOptimum, half_width: Array, costs: tuple[float, float], looks: Looks
) -> Relaxation | None:
    """What no layout of any number of fiducials that was to be tried undercuts, compared with the cost; costs: that and
    what its fiducials cost."""
    search, problem = verified.search, verified.optimum.problem
    most = cells_for(problem, search.starts)
    if len(task.counts) == 1 or problem.objective != "cost":
        return bound_any_layout(problem, search.terms, half_width, *costs, most, looks)
    each = costs[1] / len(problem.system.fiducial_labels)
    kinds = {
        f"of {number} fiducials": bound_any_layout(own, every_terms(own), half_width, inf, each * number, most, looks)
        for number, own in zip(task.counts, task.problems, strict=True)
    }
    if None in kinds.values():
        return None
    return take_smallest(kinds, costs[0], f"of {task.counts[0]} to {task.counts[-1]} fiducials")


def _say_as_it_stood(task: OptimisationTask, verified: VerifiedOptimum, made_least: tuple[float | None, float]) -> str:
    """Where the design as it stood is not inside of what was asked for, or costs less and is no answer, or is the
    answer; empty where there is nothing of it to say."""
    request, (before, after) = task.request, made_least
    here = present_design(request.problem)
    outside = [*here.outside]
    number, count = len(here.choice.fiducials_mm), request.section.count
    if number not in task.counts and count is not None:
        outside.insert(0, f"it has {number} fiducials, count asks for {count.min} to {count.max}")
    priced = request.problem.objective != "quantile"
    change = f"it costs {after:.4g}, and had no price before"
    if before is not None and np.isfinite(before) and before > 0 and max(before, after) > 0:
        what, unit = ("cost", "") if priced else ("P95", " mm")
        change = f"{what} goes from {before:.4g} to {after:.4g}{unit} ({percent_change(before, after)})"
    if verified.kept:
        kept = f"{say_outside(outside)}; brought inside," if outside else "The design as it stands is kept:"
        return f"{kept} nothing better was found."
    if outside:
        return f"{say_outside(outside)}. Within it, {change}."
    if before is None or not after > before * (1 + 1e-9):
        return ""
    reason = "its check by simulation does not pass"
    if not here.ratios:
        reason = "its layout has no answer"
    elif priced and max(here.ratios) > 1:
        reason = f"by estimate it is at {at_least(max(here.ratios))} times its limit"
    return f"The design as it stands does not keep what is asked for ({reason}): {change}."


def add_aims(optimisation: Optimisation, design: Design, search: ViewSearch) -> Optimisation:
    """An optimisation with views aimed beforehand as one of the design whose views were free."""
    problem = read_request(design).problem
    return replace(
        optimisation,
        p95_before_mm=find_p95_mm(design),
        influence=(
            *(remark for remark in optimisation.influence if remark.rule == "no-lever"),
            *(remark for remark in influence_of(problem) if remark.rule != "no-lever"),
        ),
        design_before=design_to_data(design),
        aimed=search,
    )


def find_p95_mm(design: Design) -> float | None:
    """Largest first-order P95 of what is limited in a design as it stands; None where its layout determines none."""
    system = compile_design(design)
    try:
        check_geometry(system)
        return max(p95_of(system, read_request(design).problem.in_mm))
    except IllPosedError:  # the layout as it stands has no answer; the new one has
        return None


def _in_a_sentence(request: OptimiseRequest, problem: PlacementProblem) -> str:
    limits = ", ".join(
        item.name_value(ERRORS[item.error])
        + (f" of each of {100 * item.min_yield:g} % of {item.level.plural}" if item.level and item.min_yield else "")
        + f" within {item.limit_text}"
        for item in problem.requirements
    )
    if problem.survival is not None:
        lost, item = problem.survival.lost, problem.survival.requirement
        limits += f", and P95 of {ERRORS[item.error]} within {item.limit:g} mm when any {lost} fiducial"
        limits += f"{'s are' if lost > 1 else ' is'} lost"
    count = len(problem.half_widths)
    if problem.objective == "scaling":
        return f"largest common factor on {count} free half-widths with {limits}"
    if problem.objective == "quantile":
        spent = "" if problem.cost_limit is None else f" at a cost of at most {problem.cost_limit:g}"
        wanted = ", ".join(name_held(item, ERRORS[item.error]) for item in problem.requirements)
        return f"least {wanted}{spent}"
    curves = {free.price.curve for free in problem.half_widths}
    if curves == {"grades"}:
        return f"least price of {count} process grades with {limits}"
    plain = curves == {"power"} and {free.price.exponent for free in problem.half_widths} == {1.0}
    made_of = "sum of cost_weight / half-width, in rad or mm," if plain else "sum of the cost curves"
    fiducials = ", fiducials included" if request.section.count and request.section.count.cost_per_fiducial else ""
    moving = ""
    if problem.stay is not None and problem.stay.cost_per_mm:
        moving = f", and {problem.stay.cost_per_mm:g} for each mm that a fiducial moves"
    return f"least cost ({made_of} over {count} free tolerances{fiducials}{moving}) with {limits}"


def _shadow_prices(verified: VerifiedOptimum) -> tuple[ShadowPrice, ...]:
    """At the limits themselves where there is an optimum there: what a check's margin below them costs is not smooth
    in them, and for a per-unit quantile the margin is some per cent."""
    optimum, exact = verified.optimum, verified.exact
    if exact is not None and (not verified.kept or exact.cost <= optimum.cost * (1 + NEAR)):
        return price_bounds(exact.program, exact.iterate.point, exact.cost)
    if optimum.solution is None:
        return ()
    program, point = optimum.solution.program, optimum.solution.iterate.point
    if optimum.problem.objective == "quantile":
        return price_bounds(program, point, _largest(verified))
    return price_bounds(program, point, optimum.solution.cost, optimum.cost)


def _largest(verified: VerifiedOptimum) -> float:
    """The largest quantile in the unit of the one that is the largest part of its limit."""
    sized = [*zip(verified.optimum.ratios, (term.demand for term in verified.search.terms), strict=True)]
    unit = max(sized, key=lambda each: each[0])[1].measure.unit
    return max(ratio * demand.requirement.limit for ratio, demand in sized if demand.measure.unit == unit)


def _list_moves(before: System, after: System, problem: PlacementProblem) -> tuple[MovedFiducial, ...]:
    """Free fiducials in the order of the new design, then those left out."""
    free = {problem.system.fiducial_labels[i] for i in problem.free_fiducials}
    old = {label: vector3(at) for label, at in zip(before.fiducial_labels, before.fiducials_mm, strict=True)}
    new = {label: vector3(at) for label, at in zip(after.fiducial_labels, after.fiducials_mm, strict=True)}
    entries = [MovedFiducial(label, old.get(label), new[label]) for label in new if label in free]
    return (*entries, *(MovedFiducial(label, old[label], None) for label in old if label not in new))


def _tolerances(verified: VerifiedOptimum, before: Choice, now: Choice) -> tuple[ChangedTolerance, ...]:
    """Lever by the linear model at the demand in mm with the largest quantile over its limit."""
    optimum = verified.optimum
    problem = optimum.problem
    sized = [each for each in zip(optimum.ratios, verified.search.terms, strict=True) if each[1].demand.is_point]
    worst = max(sized, key=lambda each: each[0])[1] if sized else terms_of(problem, problem.in_mm[0])
    levers = [_lever(worst, problem, choice) for choice in (before, optimum.choice)]
    grades = [None] * len(problem.half_widths) if optimum.purchase is None else optimum.purchase.names
    return tuple(list_changes(problem, levers, (before.half_width, now.half_width), grades))


def _lever(terms: DemandTerms, problem: PlacementProblem, choice: Choice) -> Array:
    """(K,) mm at the target per native unit of each free half-width, at the pivots of a choice."""
    lever = np.zeros(len(problem.half_widths))
    for source, gain in zip(terms.sources, terms.gains.at(pivot_shift_of(problem, choice)), strict=True):
        if source.free is not None:
            lever[source.free] = float(np.hypot(lever[source.free], source.ratio * np.linalg.norm(gain)))
    return lever
