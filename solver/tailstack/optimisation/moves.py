"""What moving fiducials buys beyond leaving them where they are, and how few of the moves keep most of it.

What is left, and the fewest moves, are found by optima of their own, by the closed form: all or some fiducials are held
in their places, the others and all that is free besides are solved for again.  The moves are taken in the order of what
each buys alone, until they keep ``SHARE`` of what all buy, and those that turn out not to be needed are given up again.
Not every subset is tried: a smaller one may do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from ..errors import IllPosedError
from ..geometry.arrays import Array
from ..results import MovesValue, MoveValue
from ..results.digits import percent_change
from .present import bring_inside, broken_rules
from .problem import Choice, present_choice
from .program import EXACT_HESSIAN, solve
from .search import Control, Search, objective_for_people, start_at
from .terms import is_singular

SHARE = 0.9  # of what all moves buy
OUTSIDE_MM = 0.1  # of its region: a place that is further outside is none that a fiducial could be left at
NOTHING = 1e-3  # relative: objectives by the closed form are compared to that
EACH = 3  # optima for each fiducial, at most: alone, among those taken so far, and without it


def value_moves(
    search: Search, goal: Choice, labels: Sequence[str], *, fewest: bool, control: Control
) -> MovesValue | None:
    """What the moves of a search's best design buy, ``labels`` (N,) being those of the places of ``goal``; and, where
    that is asked for and there are at most ``EXACT_HESSIAN`` to move, which few of them keep most of it.

    None where nothing was placed.  There are as many fiducials as there were.
    """
    problem, moved = search.program.problem, search.best_objective
    own, places = problem.system.fiducial_labels, problem.places
    if not places:
        return None
    here = present_choice(problem)
    home_mm = bring_inside(problem, here).fiducials_mm
    outside = np.abs(home_mm - here.fiducials_mm).max() > OUTSIDE_MM or any(
        broken_rules(problem, search.terms, home_mm)
    )
    left = inf if outside else _solve_for(search, (), home_mm, home_mm)
    if left == inf:
        words = "moving buys everything: where the fiducials stand, limits and rules of the layout cannot be kept."
        return MovesValue(None, moved, (), (), None, 0, words)
    what = "the largest part of a limit" if problem.objective == "quantile" else "the cost"
    words = (
        f"with everything else optimised alike, {what} is, as the search approximates it before its check, "
        f"{left:.4g} where the fiducials stand and {moved:.4g} where they are moved to ({percent_change(left, moved)})"
    )
    if left - moved <= NOTHING * left:
        return MovesValue(left, moved, (), (), None, 0, f"{words}: moving buys next to nothing.")
    if not fewest or len(places) > EXACT_HESSIAN or control.stops():
        ask = "" if fewest else "; fewest_moves: true in the section optimise says which few keep most of that"
        return MovesValue(left, moved, (), (), None, 0, f"{words}{ask}.")
    placed_mm = goal.fiducials_mm[[list(labels).index(label) for label in own]]
    count = 0

    def solve_for(free: Sequence[int]) -> float:
        nonlocal count
        count += 1
        control.report("move", count, EACH * len(places), None)
        return _solve_for(search, free, home_mm, placed_mm)

    alone = [solve_for((g,)) for g in range(len(places))]
    enough = left - SHARE * (left - moved)
    needed, reached = _take_fewest(alone, enough, solve_for, control)
    names = [" ".join(own[i] for i in place.fiducials) for place in places]
    values = tuple(MoveValue(name, None if value == inf else value) for name, value in zip(names, alone, strict=True))
    if reached > enough:
        return MovesValue(left, moved, values, (), None, count, f"{words}; which few keep most of that was not found.")
    chosen, share = tuple(names[g] for g in needed), min((left - reached) / (left - moved), 1.0)
    words += (
        f". Moving {len(chosen)} of {len(places)} ({', '.join(chosen)}) keeps {100 * share:.0f} % of that: the fewest "
        f"found by {count} optima, the moves taken in the order of what each buys alone; fewer may do."
    )
    return MovesValue(left, moved, values, chosen, share, count, words)


def _solve_for(search: Search, free: Sequence[int], home_mm: Array, placed_mm: Array) -> float:
    """The least objective with these groups free, from where they are moved to, and the others held where they stand;
    inf where there is none within limits and rules."""
    program = search.program
    own = [i for g in free for i in program.problem.places[g].fiducials]
    layout = home_mm.copy()
    layout[own] = placed_mm[own]
    if is_singular(program.problem.system, layout):
        return inf
    if not free:  # places keep the rules of the layout, but for rounding
        rows = (
            row if row.kind in ("quantile", "cost") else replace(row, lower=-inf, upper=inf) for row in program.rows
        )
        program = replace(program, rows=tuple(rows))
    try:
        start = start_at(program, layout)
    except IllPosedError:
        return inf
    held = (g for g in range(len(program.problem.places)) if g not in free)
    fixed = {3 * g + k: float(start.x[3 * g + k]) for g in held for k in range(3)}
    point = solve(replace(program, held=fixed), start.x, start.parameters)
    return objective_for_people(program, point.objective) if point.solved else inf


def _take_fewest(
    alone: Sequence[float], enough: float, solve_for: Callable[[Sequence[int]], float], control: Control
) -> tuple[list[int], float]:
    """Groups whose moves bring the objective to what is enough, ascending, and what they bring it to."""
    order = np.argsort(alone, kind="stable").tolist()
    taken, reached = order[:1], alone[order[0]]
    for g in order[1:]:
        if reached <= enough or control.stops():
            break
        taken = [*taken, g]
        reached = min(reached, solve_for(taken))
    for g in taken[-2::-1]:
        fewer = [each for each in taken if each != g]
        if not control.stops() and (value := solve_for(fewer)) <= enough:
            taken, reached = fewer, value
    return sorted(taken), reached
