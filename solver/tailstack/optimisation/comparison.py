"""What the placement bought: the same budgets on a textbook layout and on careless ones.

At a given layout only the half-widths are left; the image covariances are numbers, so one small programme with
them as parameters serves every layout.  All by the closed form, like the starts of the search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ..errors import IllPosedError
from ..results import PlacementValue
from ..system import Array
from .begin import begin
from .moments import moments, squared_quantile
from .prices import smooth_cost
from .problem import PlacementProblem, present_choice
from .program import QUIET, SOLVED, Program
from .promise import promise
from .search import Search, Stop, farthest
from .starts import careless_layouts, textbook_layout
from .symbols import elements
from .terms import Mechanics, is_flat

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
    small = _small_program(program) if problem.half_widths else None

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
            return max(item.exact_mm / item.limit_mm for item in held)
        if start.tightest_ratio > 1 and problem.objective != "quantile":
            return None
        solver, lower, upper = small
        upper_triangle = np.triu_indices(3)
        mechanics = [(here.pivots_mm - present_choice(problem).pivots_mm).ravel(), 1 / here.spacing - 1]
        parameters = np.concatenate([
            *(np.concatenate([item.noise[upper_triangle], item.made[upper_triangle], item.signs]) for item in held),
            *mechanics,
        ])  # fmt: skip
        result = solver(
            x0=np.concatenate([np.clip(start.x[program.widths_at], lower[:-1], upper[:-1]), [0.0]]), p=parameters,
            lbx=lower, ubx=upper, lbg=-np.inf, ubg=0.0,
        )  # fmt: skip
        if solver.stats()["return_status"] not in SOLVED:
            return None
        return float(np.exp(float(result["f"]) / (2 if problem.objective == "quantile" else 1)))

    return value


def _small_program(program: Program) -> tuple[Any, Array, Array]:
    """Half-widths (or their factor) and the slack alone; image covariances, ends and mechanics are parameters."""
    problem = program.problem
    u, s = ca.SX.sym("u", program.width_variables), ca.SX.sym("s")
    logs = elements(u)
    if problem.objective == "scaling":
        logs = np.array([float(np.log(width)) + u[0] for width in program.present_width], dtype=object)
    half_width = np.array([ca.exp(value) for value in logs], dtype=object)
    pivots, spacings = ca.SX.sym("w", 3 * len(problem.pivots)), ca.SX.sym("d", len(problem.spacings))
    mechanics = Mechanics(elements(pivots), elements(spacings))
    rows, parameters = [], []
    for term in program.terms:
        given = ca.SX.sym("given", 12 + len(term.bounded))
        noise, made = np.zeros((3, 3), object), np.zeros((3, 3), object)
        for position, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
            noise[i, j] = noise[j, i] = given[position]
            made[i, j] = made[j, i] = given[6 + position]
        ends = elements(given)[12:]
        law = moments(term, noise, made, half_width, mechanics, ends)
        limit = 2 * float(np.log(term.demand.requirement.limit_mm))
        rows.append(ca.log(squared_quantile(term.demand, law, ca.sqrt)) - limit - s)
        parameters.append(given)
    cost = ca.log(
        sum(smooth_cost(free.price, value, ca.exp) for free, value in zip(problem.half_widths, logs, strict=True))
    )
    if problem.cost_limit is not None:
        rows.append(cost - float(np.log(problem.cost_limit)))
    nlp = {
        "x": ca.vertcat(u, s), "p": ca.vertcat(*parameters, pivots, spacings),
        "f": s if problem.objective == "quantile" else cost, "g": ca.vertcat(*rows),
    }  # fmt: skip
    lower, upper = program.bounds("main")
    at = program.widths_at
    return (
        ca.nlpsol("budgets", "ipopt", nlp, QUIET | {"ipopt.tol": 1e-7}),
        np.concatenate([lower[at], lower[-1:]]),
        np.concatenate([upper[at], upper[-1:]]),
    )
