"""Where a solve starts from, at a given layout: half-widths that use up what the limits leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..system import Array
from .problem import Choice, PlacementProblem, least_half_widths, present_choice, width_bounds
from .program import Parameters, Program
from .promise import Promise, closed_form_at, no_correction, promise

BELOW = 0.98  # of the limit: from inside, an interior-point solve takes a tenth of the iterations


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    x: Array
    parameters: Parameters
    tightest_ratio: float  # largest closed form over its limit with every free half-width at its smallest


def begin(program: Program, layout: Array) -> Begun:
    """Variables and parameters at a layout (N, 3), everything mechanical as it is."""
    problem = program.problem
    least = least_half_widths(problem, program.present_width)
    choice = program.split(program.join(replace(present_choice(problem), fiducials_mm=layout, half_width=least)))
    held = [promise(problem, term, choice) for term in program.terms]

    def worst(half_width: Array) -> float:
        return worst_closed_ratio(program, held, replace(choice, half_width=half_width))

    tightest = worst(choice.half_width)
    if len(choice.half_width):
        choice = replace(choice, half_width=_half_widths(program, worst))
    parameters = Parameters(
        np.log([term.demand.requirement.limit_mm for term in program.terms]),
        np.array([item.signs for item in held]).reshape(len(held), -1),
        tuple(no_correction(problem) for _ in held),
        program.pieces_of(choice),
    )
    return Begun(program.join(choice), parameters, tightest)


def worst_closed_ratio(program: Program, held: list[Promise], choice: Choice) -> float:
    """Largest closed form over its limit, the image covariances those of ``held``."""
    return max(
        closed_form_at(program.problem, term, item, choice) / item.limit_mm
        for term, item in zip(program.terms, held, strict=True)
    )


def _half_widths(program: Program, worst: Callable[[Array], float]) -> Array:
    """(K,) in the proportions of the trace bound's optimum, scaled to meet the limits (or to spend the cost limit).

    Minimising ``sum w h^-n`` under ``sum |g|^2 h^2 <= const`` gives ``h ~ (n w / |g|^2)^(1 / (n + 2))``.
    """
    problem = program.problem
    low, high = problem.lower, problem.upper
    if problem.objective == "scaling":
        shape = program.present_width
        ends = np.exp(np.concatenate(width_bounds(problem, program.present_width)))
        low, high = shape * ends[0], shape * ends[1]
    else:
        shape = _shape(problem, program)

    def too_loose(scale: float) -> bool:
        half_width = np.clip(scale * shape, low, high)
        if problem.cost_limit is not None:
            return problem.cost(half_width) < problem.cost_limit * 1.02
        return worst(half_width) >= BELOW

    a, b = -40.0, 40.0  # log of the scale
    for _ in range(40):
        middle = (a + b) / 2
        a, b = (a, middle) if too_loose(float(np.exp(middle))) else (middle, b)
    return np.asarray(np.clip(np.exp(a) * shape, low, high))


def _shape(problem: PlacementProblem, program: Program) -> Array:
    lever = np.max([np.linalg.norm(term.free_gain, axis=0) for term in program.terms], axis=0)
    exponent = np.array([free.price.exponent for free in problem.half_widths])
    weight = np.array([free.price.weight for free in problem.half_widths])
    pull = exponent * weight / np.maximum(lever, 1e-12) ** 2
    return np.where(lever > 0, pull ** (1 / (exponent + 2)), np.inf)
