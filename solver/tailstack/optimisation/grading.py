"""Process grades: tolerances that are bought from a table, together with a layout and with budgets that are not.

Alternates until neither step pays: the cheapest grades at the layout (exact over the table, ``grades.py``), then the
layout and the continuous half-widths with those grades held.  The first layout comes from the relaxation that
prices grades by the power law through them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..system import Array
from .begin import begin
from .grades import GradeChoice, choose_grades
from .placement import PlacementSolution, settle
from .problem import Choice, PlacementProblem, apply_choice, present_choice
from .program import build_program, solve
from .promise import promise
from .search import Found, Search, Stop
from .terms import terms_of

MAX_ALTERNATIONS = 4
PAYS = 1e-6  # relative: a cheaper choice than that is worth another round


@dataclass(frozen=True, slots=True, eq=False)
class Graded:
    """Grades and layout that no single step improves."""

    choice: Choice  # of the whole problem
    cost: float
    ratios: tuple[float, ...]
    grades: GradeChoice
    solution: PlacementSolution | None  # of what was left continuous; None where nothing was


def settle_grades(search: Search, aims: Array, graded: tuple[int, ...], stop: Stop | None = None) -> Graded:
    """Cheapest grades found, every exact quantile at or below its aim.

    Raises InfeasibleError when even the tightest grades do not do, NotConvergedError.
    """
    best: tuple[float, Choice, GradeChoice] | None = None
    for item in search.found:
        start = search.program.split(item.point.x)
        grades = _choose(search, aims, graded, start, stop)
        if best is None or grades.cost < best[0] * (1 - PAYS):
            best = (grades.cost, start, grades)
        if stop is not None and stop():
            break
    assert best is not None  # a search has at least one point
    return _alternate(search, aims, graded, best[1], best[2], stop)


def _alternate(
    search: Search, aims: Array, graded: tuple[int, ...], start: Choice, first: GradeChoice, stop: Stop | None
) -> Graded:
    problem = search.program.problem
    choice, kept, grades = start, None, first
    for round_ in range(MAX_ALTERNATIONS):
        if round_:
            grades = _choose(search, aims, graded, choice, stop)
        width = choice.half_width.copy()
        width[list(graded)] = grades.half_width
        candidate = _placed(search, aims, graded, replace(choice, half_width=width), grades)
        if kept is not None and candidate.cost >= kept.cost * (1 - PAYS):
            break
        kept, choice = candidate, candidate.choice
        if not problem.places and len(graded) == len(problem.half_widths):
            break
    assert kept is not None  # the loop ran
    return kept


def _choose(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, stop: Stop | None) -> GradeChoice:
    problem = search.program.problem

    def worst(half_width: Array) -> float:
        width = choice.half_width.copy()
        width[list(graded)] = half_width
        at = replace(choice, half_width=width)
        held = [promise(problem, term, at).exact_mm / term.demand.requirement.limit_mm for term in search.terms]
        return float((np.array(held) / aims).max())

    prices = [problem.half_widths[k].price for k in graded]
    return choose_grades(prices, worst, start=choice.half_width[list(graded)], stop=stop)


def _placed(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, grades: GradeChoice) -> Graded:
    """Everything else optimised with the grades held: budgets that are continuous, or the layout for more room."""
    whole = search.program.problem
    rest = held_at(whole, choice, graded)
    if not (rest.half_widths or rest.places or rest.pivots or rest.spacings):
        return Graded(choice, whole.cost(choice.half_width), _ratios(search, choice), grades, None)
    program = build_program(rest, search.estimator, tuple(terms_of(rest, demand) for demand in rest.demands))
    begun = begin(program, choice.fiducials_mm)
    point = solve(program, begun.x, begun.parameters)
    inner = replace(search, program=program, found=(Found(point, begun.parameters),), terms=program.terms)
    solution = settle(inner, aims)
    width = choice.half_width.copy()
    others = [k for k in range(len(width)) if k not in graded]
    width[others] = solution.choice.half_width
    placed = replace(solution.choice, half_width=width)
    return Graded(placed, whole.cost(width), solution.ratios, grades, solution)


def _ratios(search: Search, choice: Choice) -> tuple[float, ...]:
    problem = search.program.problem
    return tuple(promise(problem, term, choice).exact_mm / term.demand.requirement.limit_mm for term in search.terms)


def held_at(problem: PlacementProblem, choice: Choice, graded: tuple[int, ...]) -> PlacementProblem:
    """The problem with these half-widths no longer free but at their value in a choice."""
    here = present_choice(problem)
    width = here.half_width.copy()
    width[list(graded)] = choice.half_width[list(graded)]
    system = apply_choice(problem, replace(here, half_width=width))
    left = tuple(free for k, free in enumerate(problem.half_widths) if k not in graded)
    return replace(problem, system=system, half_widths=left, objective="cost" if left else "quantile")
