"""What the placement bought: the same budgets on a textbook layout and on careless ones.

At a given layout only the half-widths are left (``budgets.py``).  All by the closed form, like the starts of the
search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import IllPosedError
from ..results import PlacementValue
from ..system import Array
from .begin import begin, worst_closed_ratio
from .budgets import best_budget, budgets_of
from .problem import PlacementProblem, present_choice
from .promise import promise
from .search import Search, Stop, farthest, for_people
from .starts import careless_layouts, textbook_layout
from .terms import is_flat

CARELESS = 30


def placement_value(search: Search, best: float, seed: int, stop: Stop | None = None) -> PlacementValue | None:
    """Compare with what the placement would have been otherwise; None without free fiducials.

    ``best``: cost (or largest ratio, or factor) of the optimum by the closed form.
    """
    problem = search.program.problem
    if not problem.places:
        return None
    value = _at_layout(search)
    steering = farthest(problem, search.terms)
    named = textbook_layout(problem, search.estimator, steering)
    textbook, textbook_value = "no textbook layout fits this region", None
    if named is not None:
        textbook, layout = named
        textbook_value = value(layout)
    found: list[float] = []
    layouts = careless_layouts(problem, search.estimator, steering, CARELESS, seed)
    tried = 0
    for layout in layouts:
        if stop is not None and stop():
            break
        tried += 1
        reached = value(layout)
        if reached is not None:
            found.append(reached)
    median, worst = (float(np.median(found)), float(np.max(found))) if found else (None, None)
    return PlacementValue(
        textbook=textbook,
        textbook_objective=textbook_value,
        careless_layouts=tried,
        careless_infeasible=tried - len(found),
        careless_median=median,
        careless_worst=worst,
        best=best,
        sentence=_sentence(problem, best, textbook if named else None, textbook_value, tried, found),
    )


def _sentence(
    problem: PlacementProblem, best: float, textbook: str | None, value: float | None, tried: int, found: list[float]
) -> str:
    """What the optimal placement is worth, in words."""
    what = "the quantile" if problem.objective == "quantile" else "the cost"
    parts = []
    if textbook is not None:
        bought = "what it cannot do at all: meet the limit" if value is None else _part(value / best, what)
        parts.append(f"against {textbook}, {bought}")
    if tried:
        failed = tried - len(found)
        line = f"against {tried} careless (random) layouts, "
        if failed:
            line += f"feasibility itself for {failed} of them"
        if found:
            median, worst = (float(value) / best for value in (np.median(found), np.max(found)))
            line += f"{' and ' if failed else ''}{_part(median, what)} (median{' of the others' if failed else ''}), "
            line += f"{_part(worst, what)} (worst)"
        parts.append(line)
    return "with budgets optimised alike, the placement bought: " + "; ".join(parts) if parts else ""


def _part(ratio: float, what: str) -> str:
    """How much of ours the other one costs more."""
    if ratio - 1 < 5e-5:
        return "nothing"
    return f"{100 * (ratio - 1):.2g} % of {what}" if ratio < 2 else f"{ratio - 1:.1f} times {what}"


def _at_layout(search: Search) -> Callable[[Array], float | None]:
    """Layout (N, 3) -> least objective with everything else optimised as it is; None where the limit is out of
    reach."""
    program = search.program
    problem = program.problem
    if problem.pivots or problem.spacings:
        # Mechanics act through the same constants whatever the layout: leave them where the optimum has them.
        choice = program.split(search.found[0].point.x)
    else:
        choice = present_choice(problem)
    small = budgets_of(program) if problem.half_widths else None

    def value(layout: Array) -> float | None:
        if is_flat(layout):
            return None
        here = replace(choice, fiducials_mm=layout)
        try:
            held = [promise(problem, term, here) for term in program.terms]
            start = begin(program, layout)
        except IllPosedError:
            return None
        if small is None:
            return worst_closed_ratio(program, held, here)
        if start.tightest_ratio > 1 and problem.objective != "quantile":
            return None
        found = best_budget(small, here, held, start.x[program.widths_at])
        return None if found is None else for_people(program, found.objective)

    return value
