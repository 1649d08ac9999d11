"""Half-widths at a given layout: a small programme with the image covariances as parameters, for many layouts.

The same moments and closed form as the large programme, of the half-widths (or their common factor) and the slack
alone.  Some half-widths may be held, and each quantile may carry an offset that stands for its exact law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..system import Array
from .moments import moments, squared_quantile
from .prices import smooth_cost
from .problem import Choice
from .program import QUIET, SOLVED, Program
from .promise import Promise
from .symbols import elements
from .terms import Mechanics, mechanics_of


@dataclass(frozen=True, slots=True, eq=False)
class Budgets:
    """The small programme of a large one."""

    program: Program
    solver: Any
    lower: Array  # (U + 1,) of the variables: logarithms, and the slack last
    upper: Array


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Half-widths at a layout, and the programme's objective there."""

    half_width: Array  # (K,) native units
    objective: float  # log of the cost, or of the squared largest ratio


def budgets_of(program: Program) -> Budgets:
    """Build it once; :func:`best_budget` solves it at a layout."""
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
        given = ca.SX.sym("given", 13 + len(term.bounded))
        noise, made = np.zeros((3, 3), object), np.zeros((3, 3), object)
        for position, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
            noise[i, j] = noise[j, i] = given[position]
            made[i, j] = made[j, i] = given[6 + position]
        law = moments(term, noise, made, half_width, mechanics, elements(given)[13:])
        limit = 2 * float(np.log(term.demand.requirement.limit_mm))
        rows.append(ca.log(squared_quantile(term.demand, law, ca.sqrt)) + given[12] - limit - s)
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
    return Budgets(
        program,
        ca.nlpsol("budgets", "ipopt", nlp, QUIET | {"ipopt.tol": 1e-7}),
        np.concatenate([lower[at], lower[-1:]]),
        np.concatenate([upper[at], upper[-1:]]),
    )


def best_budget(
    budgets: Budgets, choice: Choice, held: list[Promise], start: Array, *,
    fixed: Mapping[int, float] | None = None, offsets: Array | None = None,
) -> Budget | None:  # fmt: skip
    """The optimum at a choice's layout and mechanics, or None where the limits are out of reach.

    ``held``: promises there, one for each of the programme's terms; ``start`` (U,) logarithms; ``fixed``: native
    values of half-widths that are not free here; ``offsets`` (T,) added to the log of each squared quantile.
    """
    program = budgets.program
    lower, upper = budgets.lower.copy(), budgets.upper.copy()
    for k, value in (fixed or {}).items():
        lower[k] = upper[k] = np.log(value)
    triangle = np.triu_indices(3)
    mechanics = mechanics_of(program.problem, choice)
    given = np.zeros(len(held)) if offsets is None else offsets
    parameters = np.concatenate([
        *(
            np.concatenate([item.noise[triangle], item.made[triangle], [offset], item.signs])
            for item, offset in zip(held, given, strict=True)
        ),
        mechanics.pivot_shift, mechanics.inverse_shift,
    ])  # fmt: skip
    x0 = np.clip(np.concatenate([start, [0.0]]), lower, upper)
    result = budgets.solver(x0=x0, p=parameters, lbx=lower, ubx=upper, lbg=-np.inf, ubg=0.0)
    if budgets.solver.stats()["return_status"] not in SOLVED:
        return None
    widths = np.exp(result["x"].full().ravel()[:-1])
    if program.problem.objective == "scaling":
        widths = program.present_width * widths[0]
    return Budget(widths, float(result["f"]))
