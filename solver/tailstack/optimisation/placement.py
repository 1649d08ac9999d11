"""The best of many starts, its exact quantiles brought to their aims."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import NotConvergedError, Problem
from ..geometry.arrays import Array
from .exact_law import Evaluation, correction_at, exact_ratios
from .explain import explain_infeasible
from .problem import Choice, PlacementProblem
from .program import Parameters, Point, Program, kkt_residual, list_near_surfaces, solve
from .search import (
    Iterate,
    Search,
    evaluate_demands,
    largest_within,
    least_quantile,
    start_at,
    with_demands,
    worst_ratio,
)

AT_AIM = 4e-6  # relative: how near below its aim the largest exact quantile is brought
KNOWN = 3.0  # numerical errors of the exact law that a window is wide, where that is more
SAMPLED_AT_AIM = 4e-4  # likewise for a per-unit quantile, which is sampled
MAX_ROUNDS = 20
AT_DISTANCE = 5e-6  # mm: how far from where it was solved for a fiducial near a surface may be, half of its inset
NEARLY = 1.02  # of its aim: an iterate that near is brought down, one further off has not settled
STATIONARY = 1e-6  # residual of the first-order conditions with the exact law that ends the rounds
SAMPLED_STATIONARY = 1e-4  # likewise for a per-unit quantile: its sample knows a slope to some per cent
FREE_VERTICES = 6  # rounds in which bounded sources may change ends; two vertices may tie at the optimum


@dataclass(frozen=True, slots=True, eq=False)
class PlacementSolution:
    """A local optimum of the programme with the exact law, its quantiles at (or below) their aims."""

    problem: PlacementProblem
    choice: Choice
    cost: float  # 0 when no half-width is free
    ratios: tuple[float, ...]  # exact quantile over its limit, every demand
    kkt_residual: float
    program: Program
    iterate: Iterate

    @property
    def worst_ratio(self) -> float:
        """Largest exact quantile over its limit."""
        return max(self.ratios)


def settle(search: Search, aims: Array, start: PlacementSolution | None = None) -> PlacementSolution:
    """Bring the exact quantiles to ``aims`` (of their limits), from the best point of a search or an earlier solution.

    The closed form is corrected to the exact law at the last iterate, in value and gradient; as the correction
    hardly moves, two or three rounds do.  Bounded sources sit at the worst vertex of the last iterate.  Demands
    outside the programme that turn out worse join it.  Raises InfeasibleError, NotConvergedError.
    """
    if start is not None:
        search = replace(search, program=start.program, iterates=(start.iterate,))
    here = search.iterates[0]
    for rounds in range(MAX_ROUNDS):
        program = search.program
        own = _own_aims(search, aims)
        evaluations = evaluate_demands(program, here.point)
        reached = max(item.exact_mm / item.limit / aim for item, aim in zip(evaluations, own, strict=True))
        if rounds and _has_arrived(program, here.point, evaluations, reached) and _keeps_surfaces(program, here):
            exact = _correct(program, here, evaluations, own, same_ends=True)
            residual = kkt_residual(program, here.point, exact)
            sampled = any(term.demand.is_nested for term in program.terms)
            if residual > (SAMPLED_STATIONARY if sampled else STATIONARY) and rounds < FREE_VERTICES:
                here = Iterate(_solve_again(program, here.point, exact), exact)
                continue
            ratios = _everywhere(search, here.point)
            if (ratios / aims).max() <= max(reached, 1.0) * (1 + 1e-9):
                return _solution(search, here, residual, ratios)
            search = with_demands(search, here.point, ratios / aims, max(reached, 1.0))
            here = search.iterates[0]
            continue
        parameters = _correct(program, here, evaluations, own, same_ends=rounds >= FREE_VERTICES)
        here = Iterate(_solve_again(program, here.point, parameters), parameters)
    return _shrink(search, here, aims, reached)


def _shrink(search: Search, here: Iterate, aims: Array, reached: float) -> PlacementSolution:
    """The last iterate with all half-widths brought down by one factor until every exact quantile is at its aim.

    Where bounded sources change ends from iterate to iterate the optimum sits on an edge between two vertices and no
    single one settles; what is left is a small factor, and the residual says how far from stationary it ends.
    """
    program = search.program
    widths, low = program.widths_at, program.bounds("main")[0]
    if program.problem.objective == "quantile" or widths.stop == widths.start or reached > NEARLY:
        raise _refuse_unsettled(reached)

    def at(shift: float) -> Point:
        x = here.point.x.copy()
        x[widths] = np.maximum(x[widths] - shift, low[widths])
        return replace(here.point, x=x)

    def excess(shift: float) -> float:
        return float((_everywhere(search, at(-shift)) / aims).max()) - 1

    most = 2 * float(np.log(NEARLY))
    if excess(-most) > 0:
        raise _refuse_unsettled(reached)
    end = Iterate(at(-largest_within(excess, -most, 0.0, 1e-8)), here.parameters)
    exact = _correct(program, end, evaluate_demands(program, end.point), _own_aims(search, aims), same_ends=True)
    residual = kkt_residual(program, end.point, exact)
    return _solution(search, end, residual, _everywhere(search, end.point))


def _own_aims(search: Search, aims: Array) -> Array:
    """Aims of the demands that are in the programme."""
    inside = {term.demand.key for term in search.program.terms}
    return np.array([aim for term, aim in zip(search.terms, aims, strict=True) if term.demand.key in inside])


def _has_arrived(program: Program, point: Point, evaluations: list[Evaluation], reached: float) -> bool:
    """The exact quantile is in the window below its aim, or below it because nothing is gained by using it up."""
    window = _window(program, evaluations)
    if program.problem.objective == "quantile":
        return bool(abs(2 * np.log(worst_ratio(evaluations)) - point.objective) <= 2 * window)
    if reached > 1:
        return False
    pressed = any(multiplier > 1e-7 for multiplier in point.row_multipliers[: len(program.terms)])
    return not pressed or reached >= 1 - window


def _keeps_surfaces(program: Program, here: Iterate) -> bool:
    """Whether fiducials near surfaces are at the distances that they were solved for."""
    now = program.off_surface(program.split(here.point.x))
    regions = (region for region, _ in list_near_surfaces(program.problem))
    missed = zip(regions, now, here.parameters.off_surface, strict=True)
    return all(abs(is_now - was) <= AT_DISTANCE * region.slope_mm for region, is_now, was in missed)


def _window(program: Program, evaluations: list[Evaluation]) -> float:
    """Relative width of the window below an aim: no narrower than the exact law is known."""
    if any(term.demand.is_nested for term in program.terms):
        return SAMPLED_AT_AIM
    return max(AT_AIM, KNOWN * max(item.relative_error for item in evaluations))


def _solve_again(program: Program, point: Point, parameters: Parameters) -> Point:
    """Solve again for slightly different parameters, from where the last solve ended."""
    start = replace(point, x=_scale_half_widths(program, point.x, parameters))
    polished = solve(program, start.x, parameters, warm=start)
    if not polished.solved:
        polished = solve(program, start.x, parameters)
    if polished.solved:
        return polished
    begun = start_at(program, program.split(point.x).fiducials_mm)
    bottom = least_quantile(program, [replace(begun, parameters=parameters)])
    reached = worst_ratio(evaluate_demands(program, bottom.point))
    if bottom.point.objective > 0:
        raise explain_infeasible(program, bottom.point, parameters)
    raise _refuse_unsettled(reached)


def _scale_half_widths(program: Program, x: Array, parameters: Parameters) -> Array:
    """The same layout with all free half-widths multiplied by one factor, so that new limits are just met.

    A warm interior-point solve that starts outside the feasible set by a per cent takes 150 iterations, from just
    inside it 15.
    """
    widths, rows = program.widths_at, len(program.terms)
    if program.problem.objective == "quantile" or widths.stop == widths.start:
        return x
    low, high = program.bounds("main")
    vector = parameters.vector(program, "main")

    def at(shift: float) -> Array:
        moved = x.copy()
        moved[widths] = np.clip(x[widths] + shift, low[widths], high[widths])
        return moved

    def excess(shift: float) -> float:
        return float(program.constraints(at(shift), vector)[1].full().ravel()[:rows].max())

    return at(largest_within(excess, -3.0, 3.0, 1e-8))


def _refuse_unsettled(reached: float) -> NotConvergedError:
    detail = f"the exact quantile could not be brought to its aim; the last iterate is at {reached:.6g} of it"
    return NotConvergedError(Problem("/optimise", "not-settled", detail, "try another seed or more starts"))


def _correct(
    program: Program, here: Iterate, evaluations: list[Evaluation], aims: Array, *, same_ends: bool
) -> Parameters:
    """Closed form corrected to the exact law at this iterate; bounded sources at its worst ends, or kept."""
    problem = program.problem
    choice = program.split(here.point.x)
    signs = np.array([item.signs for item in evaluations]).reshape(len(evaluations), -1)
    if same_ends:
        signs = here.parameters.signs
    corrections = tuple(
        correction_at(problem, term, choice, item, signs[t] if same_ends else None)
        for t, (term, item) in enumerate(zip(program.terms, evaluations, strict=True))
    )
    limits = np.log([item.limit for item in evaluations])
    if problem.objective != "quantile":
        limits = limits + np.log(aims * (1 - _window(program, evaluations) / 2))
    return Parameters(limits, signs, corrections, program.pieces_of(choice), program.off_surface(choice))


def _everywhere(search: Search, point: Point) -> Array:
    """Exact quantile over its limit of every demand."""
    return exact_ratios(search.program.problem, search.terms, search.program.split(point.x))


def _solution(search: Search, here: Iterate, residual: float, ratios: Array) -> PlacementSolution:
    program, problem = search.program, search.program.problem
    choice = program.split(here.point.x)
    return PlacementSolution(
        problem=problem,
        choice=choice,
        cost=problem.price_of(choice) if problem.half_widths else 0.0,
        ratios=tuple(float(ratio) for ratio in ratios),
        kkt_residual=residual,
        program=program,
        iterate=here,
    )
