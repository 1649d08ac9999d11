"""Process grades: tolerances that are bought from a table, together with a layout and with budgets that are not.

Alternates until neither step pays: the cheapest grades at the layout, then the layout and the continuous half-widths
with those grades held.  The first layout comes from the relaxation that prices grades by the power law through them.
Where every free tolerance has a table the grades are chosen exactly (``grades.py``).  Beside continuous budgets each
assignment is worth its price and the least cost of those budgets at the layout: all assignments are compared, or
where there are too many, single changes are made as long as one pays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from math import inf, log, prod

import numpy as np

from ..errors import InfeasibleError
from ..results import Relaxation
from ..system import Array
from .begin import begin
from .budgets import best_budget, budgets_of
from .grades import choose_grades
from .placement import PlacementSolution, settle
from .prices import Grade, cost_of, undominated
from .problem import Choice, PlacementProblem, apply_choice, present_choice
from .program import build_program, solve
from .promise import closed_form_at, exact_ratios, promise
from .search import Found, Search, Stop
from .terms import terms_of

MAX_ALTERNATIONS = 4
PAYS = 1e-6  # relative: a cheaper choice than that is worth another round
COMPARED = 400  # assignments that are all compared; beyond, single changes
SPARE = 3  # next best assignments, for when the exact law refuses the best


@dataclass(frozen=True, slots=True, eq=False)
class Bought:
    """Grades chosen at a layout."""

    half_width: Array  # (G,) of the graded tolerances, native units
    names: tuple[str, ...]
    bound: Relaxation


@dataclass(frozen=True, slots=True, eq=False)
class Graded:
    """Grades and layout that no single step improves."""

    choice: Choice  # of the whole problem
    cost: float
    ratios: tuple[float, ...]
    bought: Bought
    solution: PlacementSolution | None  # of what was left continuous; None where nothing was


def settle_grades(search: Search, aims: Array, graded: tuple[int, ...], stop: Stop | None = None) -> Graded:
    """Cheapest grades found, every exact quantile at or below its aim.

    Raises InfeasibleError when even the tightest grades do not do, NotConvergedError.
    """
    problem = search.program.problem
    exact = len(graded) == len(problem.half_widths)
    best: tuple[float, Choice, tuple[Bought, ...]] | None = None
    for item in search.found:
        # The relaxation at its aims: the tightest grades are no looser, so there is something to choose.
        start = settle(replace(search, found=(item,)), aims)
        bought = _choose(search, aims, graded, start.choice, stop) if exact else _compare(search, aims, graded, start)
        cost = _price(problem, graded, bought[0].half_width) if exact else float(bought[0].bound.cost or inf)
        if best is None or cost < best[0] * (1 - PAYS):
            best = (cost, start.choice, bought)
        if stop is not None and stop():
            break
    assert best is not None  # a search has at least one point
    return _alternate(search, aims, graded, best[1], best[2], stop)


def _alternate(
    search: Search, aims: Array, graded: tuple[int, ...], start: Choice, first: tuple[Bought, ...], stop: Stop | None
) -> Graded:
    problem = search.program.problem
    exact = len(graded) == len(problem.half_widths)
    choice, kept, bought = start, None, first
    for round_ in range(MAX_ALTERNATIONS):
        if round_:
            bought = _choose(search, aims, graded, choice, stop) if exact else _again(search, aims, graded, choice)
        candidate = _first_that_holds(search, aims, graded, choice, bought)
        if kept is not None and candidate.cost >= kept.cost * (1 - PAYS):
            break
        kept, choice = candidate, candidate.choice
        if not (problem.places or problem.pivots or problem.spacings) or (stop is not None and stop()):
            break
    assert kept is not None  # the loop ran
    return kept


def _first_that_holds(
    search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, bought: tuple[Bought, ...]
) -> Graded:
    """The cheapest of the proposals that the exact law accepts.  Raises InfeasibleError when it accepts none."""
    refused: InfeasibleError | None = None
    for item in bought:
        width = _with(choice.half_width, graded, item.half_width)
        try:
            return _placed(search, aims, graded, replace(choice, half_width=width), item)
        except InfeasibleError as error:
            refused = refused or error
    assert refused is not None  # there is at least one proposal
    raise refused


def _price(problem: PlacementProblem, graded: tuple[int, ...], half_width: Array) -> float:
    priced = zip((problem.half_widths[k].price for k in graded), half_width, strict=True)
    return sum((cost_of(price, float(value)) for price, value in priced), 0.0)


def _choose(
    search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, stop: Stop | None
) -> tuple[Bought, ...]:
    """The cheapest grades at this layout, by the exact law and with a bound; every free tolerance has a table."""
    problem = search.program.problem

    def worst(half_width: Array) -> float:
        at = replace(choice, half_width=_with(choice.half_width, graded, half_width))
        return float((exact_ratios(problem, search.terms, at) / aims).max())

    prices = [problem.half_widths[k].price for k in graded]
    found = choose_grades(prices, worst, start=choice.half_width[list(graded)], stop=stop)
    where = "at this layout" if problem.places else "for this layout"
    bound = Relaxation(
        "monotone cuts over grades", found.cost, found.lower_bound, found.gap_percent,
        f"{found.statement.rstrip('.')} ({where})",
    )  # fmt: skip
    return (Bought(found.half_width, found.names, bound),)


def _with(half_width: Array, graded: tuple[int, ...], values: Array) -> Array:
    changed = half_width.copy()
    changed[list(graded)] = values
    return changed


def _again(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice) -> tuple[Bought, ...]:
    """The comparison at a layout that was optimised since."""
    layout = begin(search.program, choice.fiducials_mm)
    point = solve(search.program, layout.x, layout.parameters)
    start = settle(replace(search, found=(Found(point, layout.parameters),)), aims)
    return _compare(search, aims, graded, start)


def _compare(search: Search, aims: Array, graded: tuple[int, ...], start: PlacementSolution) -> tuple[Bought, ...]:
    """The best assignments beside continuous budgets at the layout of a settled relaxation, cheapest first."""
    program, choice = start.program, start.choice
    problem = program.problem
    ladders = [undominated(problem.half_widths[k].price.grades) for k in graded]
    held = [promise(problem, term, choice) for term in program.terms]
    own = {term.demand.key: aim for term, aim in zip(search.terms, aims, strict=True)}
    offsets = np.array([
        2 * log(item.exact_mm / closed_form_at(problem, term, item, choice)) - 2 * log(own[term.demand.key])
        for term, item in zip(program.terms, held, strict=True)
    ])  # fmt: skip
    small, begun = budgets_of(program), np.log(choice.half_width)
    known: dict[tuple[int, ...], float] = {}

    def cost(levels: tuple[int, ...]) -> float:
        if levels not in known:
            fixed = {k: ladder[level].half_width for k, ladder, level in zip(graded, ladders, levels, strict=True)}
            found = best_budget(small, choice, held, begun, fixed=fixed, offsets=offsets)
            known[levels] = (
                inf
                if found is None
                else problem.cost(
                    # as they are in their tables, not as the solver rounded them
                    _with(found.half_width, graded, np.array(list(fixed.values())))
                )
            )
        return known[levels]

    if prod(map(len, ladders)) <= COMPARED:
        for levels in product(*(range(len(ladder)) for ladder in ladders)):
            cost(levels)
        how = f"all {len(known)} assignments of grades were compared at this layout"
    else:
        _descend(
            cost,
            ladders,
            tuple(_no_looser(ladder, choice.half_width[k]) for k, ladder in zip(graded, ladders, strict=True)),
        )
        how = f"{len(known)} assignments of grades were compared at this layout; no single change of grade is cheaper"
    ranked = sorted((value, levels) for levels, value in known.items() if value < inf)[: 1 + SPARE]
    if not ranked:  # the closed form refuses what the exact law may accept
        ranked = [(inf, tuple(0 for _ in ladders))]
    statement = f"{how}, the other half-widths optimised for each; no bound is known beyond that"
    return tuple(
        Bought(
            np.array([ladder[level].half_width for ladder, level in zip(ladders, levels, strict=True)]),
            tuple(ladder[level].name for ladder, level in zip(ladders, levels, strict=True)),
            Relaxation("none", value if value < inf else None, None, None, statement),
        )
        for value, levels in ranked
    )


def _no_looser(ladder: tuple[Grade, ...], half_width: float) -> int:
    """The loosest grade that holds a half-width."""
    return max([level for level, grade in enumerate(ladder) if grade.half_width <= half_width * (1 + 1e-9)], default=0)


def _descend(
    cost: Callable[[tuple[int, ...]], float], ladders: list[tuple[Grade, ...]], start: tuple[int, ...]
) -> None:
    """One grade up or down at a time, and exchanges of one up for one down, as long as one pays."""
    here = start
    while True:
        near = [_moved(here, {k: step}) for k in range(len(here)) for step in (-1, 1)]
        near += [_moved(here, {a: 1, b: -1}) for a in range(len(here)) for b in range(len(here)) if a != b]
        inside = [
            levels
            for levels in near
            if all(0 <= level < len(ladder) for level, ladder in zip(levels, ladders, strict=True))
        ]
        best = min(inside, key=cost, default=here)
        if cost(best) >= cost(here) * (1 - PAYS) or cost(best) == inf:
            return
        here = best


def _moved(levels: tuple[int, ...], steps: dict[int, int]) -> tuple[int, ...]:
    return tuple(level + steps.get(k, 0) for k, level in enumerate(levels))


def _placed(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, bought: Bought) -> Graded:
    """Everything else optimised with the grades held: budgets that are continuous, or the layout for more room."""
    whole = search.program.problem
    rest = held_at(whole, choice, graded)
    if not (rest.half_widths or rest.places or rest.pivots or rest.spacings):
        ratios = tuple(float(ratio) for ratio in exact_ratios(whole, search.terms, choice))
        return Graded(choice, whole.cost(choice.half_width), ratios, bought, None)
    program = build_program(rest, search.estimator, tuple(terms_of(rest, demand) for demand in rest.demands))
    begun = begin(program, choice.fiducials_mm)
    point = solve(program, begun.x, begun.parameters)
    inner = replace(search, program=program, found=(Found(point, begun.parameters),), terms=program.terms)
    solution = settle(inner, aims)
    others = tuple(k for k in range(len(choice.half_width)) if k not in graded)
    width = _with(choice.half_width, others, solution.choice.half_width)
    return Graded(replace(solution.choice, half_width=width), whole.cost(width), solution.ratios, bought, solution)


def held_at(problem: PlacementProblem, choice: Choice, graded: tuple[int, ...]) -> PlacementProblem:
    """The problem with these half-widths no longer free but at their value in a choice."""
    here = present_choice(problem)
    width = _with(here.half_width, graded, choice.half_width[list(graded)])
    system = apply_choice(problem, replace(here, half_width=width))
    left = tuple(free for k, free in enumerate(problem.half_widths) if k not in graded)
    return replace(problem, system=system, half_widths=left, objective="cost" if left else "quantile")
