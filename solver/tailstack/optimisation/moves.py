"""What moving fiducials buys beyond leaving them where they are, and how few of the moves keep most of it.

Every figure is an optimum of its own by the closed form: some fiducials are held in their places, the others and all
that is free besides are solved for again.  The moves are taken in the order of what each buys alone, until they keep
``SHARE`` of what all buy, and those that turn out not to be needed are given up again.  Not every subset is tried: a
smaller one may do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from ..geometry.arrays import Array
from ..results import MovesValue, MoveValue
from ..results.digits import percent_change
from .present import bring_inside
from .problem import Choice, present_choice
from .program import EXACT_HESSIAN, solve
from .search import Control, Search, objective_for_people, start_at
from .terms import is_singular

SHARE = 0.9  # of what all moves buy
NOTHING = 1e-3  # relative: objectives by the closed form are compared to that


@dataclass(slots=True)
class _Trials:
    """Optima with some groups free, and how many were solved for."""

    search: Search
    goal: Choice  # the optimum, each place with the fiducial that moves there
    control: Control
    most: int  # evaluations
    home_mm: Array = field(init=False)  # (N, 3)
    count: int = 0

    def __post_init__(self) -> None:
        problem = self.search.program.problem
        self.home_mm = bring_inside(problem, present_choice(problem)).fiducials_mm

    def solve(self, free: Sequence[int]) -> float | None:
        """The least objective with these groups free and the others held; None where there is none within limits."""
        program = self.search.program
        own = [i for g in free for i in program.problem.places[g].fiducials]
        layout = self.home_mm.copy()
        layout[own] = self.goal.fiducials_mm[own]
        self.count += 1
        self.control.report("move", self.count, self.most, None)
        if is_singular(program.problem.system, layout):
            return None
        start = start_at(program, layout)
        held = (g for g in range(len(program.problem.places)) if g not in free)
        fixed = {3 * g + k: float(start.x[3 * g + k]) for g in held for k in range(3)}
        point = solve(replace(program, held=fixed), start.x, start.parameters)
        return objective_for_people(program, point.objective) if point.solved else None


def value_moves(search: Search, goal: Choice, labels: Sequence[str], control: Control) -> MovesValue | None:
    """What the moves of a search's best design buy; ``labels`` (N,) of the places of ``goal``.

    None where there is nothing to compare: nothing was placed, the number of fiducials changed, there are more of them
    than ``EXACT_HESSIAN``, or it was stopped.
    """
    problem = search.program.problem
    own, places = problem.system.fiducial_labels, problem.places
    if not places or set(own) != set(labels) or len(places) > EXACT_HESSIAN or control.stops():
        return None
    placed = goal.fiducials_mm[[list(labels).index(label) for label in own]]
    trials = _Trials(search, replace(goal, fiducials_mm=placed), control, 3 * len(places))
    left, every = trials.solve(()), trials.solve(range(len(places)))
    moved = min(search.best_objective, inf if every is None else every)
    named = [" ".join(own[i] for i in place.fiducials) for place in places]
    if left is None or left - moved <= NOTHING * left:
        return MovesValue(left, moved, (), (), None, trials.count, _say_plainly(search, left, moved))
    alone = [inf if (value := trials.solve((g,))) is None else value for g in range(len(places))]
    order = [g for g in np.argsort(alone, kind="stable").tolist() if alone[g] < inf]
    enough = left - SHARE * (left - moved)
    kept, reached = order[:1], alone[order[0]] if order else inf
    for g in order[1:]:
        if reached <= enough or control.stops():
            break
        kept = [*kept, g]
        reached = min(reached, _or_inf(trials.solve(kept)))
    for g in kept[-2::-1]:
        fewer = [each for each in kept if each != g]
        if not control.stops() and reached <= enough and (value := _or_inf(trials.solve(fewer))) <= enough:
            kept, reached = fewer, value
    values = tuple(MoveValue(named[g], None if alone[g] == inf else alone[g]) for g in range(len(places)))
    needed = tuple(named[g] for g in sorted(kept)) if reached <= enough else tuple(named)
    share = (left - reached) / (left - moved) if reached <= enough else 1.0
    words = (
        f"{_compare(search, left, moved)}. Moving {len(needed)} of {len(places)} ({', '.join(needed)}) keeps "
        f"{100 * share:.0f} % of that: the fewest found by {trials.count} optima, the moves taken in the order of what "
        "each buys alone; fewer may do."
    )
    return MovesValue(left, moved, values, needed, share, trials.count, words)


def _or_inf(value: float | None) -> float:
    return inf if value is None else value


def _compare(search: Search, left: float, moved: float) -> str:
    what = "the largest part of a limit" if search.program.problem.objective == "quantile" else "the cost"
    return (
        f"with everything else optimised alike, {what} is {left:.4g} where the fiducials stand and {moved:.4g} where "
        f"they are moved to ({percent_change(left, moved)})"
    )


def _say_plainly(search: Search, left: float | None, moved: float) -> str:
    if left is None:
        return "moving buys everything: where the fiducials stand, limits and rules of the layout cannot be kept."
    return f"{_compare(search, left, moved)}: moving buys next to nothing."
