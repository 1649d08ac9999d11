"""Least-cost placement and half-widths: the best of many starts, its exact quantile brought to the limit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import NotConvergedError, Problem
from ..system import Array
from .certificate import kkt_residual
from .infeasible import explain_infeasible
from .problem import PlacementProblem
from .program import Parameters, Point, Program, solve
from .promise import Promise, closed_form_mm, promise
from .search import Progress, Search, least_quantile, promised, search, with_targets

AT_LIMIT = 1e-4  # relative: how near below the aim the exact quantile is brought
AIM_BELOW = 1e-5  # relative: where in that window it is aimed
MAX_ROUNDS = 16
FREE_VERTICES = 6  # rounds in which bounded sources may change ends; two vertices may tie at the optimum


@dataclass(frozen=True, slots=True, eq=False)
class PlacementSolution:
    """A local optimum of the programme whose exact quantile is at (or below) ``aim_mm``."""

    problem: PlacementProblem
    fiducials_mm: Array  # (N, 3) all of them
    half_width: Array  # (K,) native unit
    cost: float  # 0 when no half-width is free
    quantile_mm: tuple[float, ...]  # exact, at every required target
    aim_mm: float
    kkt_residual: float
    rounds: int  # solves it took to bring the exact quantile to the aim
    program: Program
    point: Point
    parameters: Parameters

    @property
    def worst_mm(self) -> float:
        """Largest exact quantile over the required targets."""
        return max(self.quantile_mm)


def solve_placement(
    problem: PlacementProblem,
    *,
    starts: int = 8,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> PlacementSolution:
    """Best of ``starts`` local optima, its exact quantile within 1e-4 below the requirement's limit.

    Raises InfeasibleError (with the smallest quantile attainable), NotConvergedError, IllPosedError.  The
    same seed gives the same answer; start k depends on (seed, k) alone.
    """
    return settle(
        search(problem, starts=starts, seed=seed, threads=threads, progress=progress), problem.requirement.limit_mm
    )


def settle(found: Search, aim_mm: float, start: PlacementSolution | None = None) -> PlacementSolution:
    """Bring the exact quantile to ``aim_mm``, from the best point of a search or from an earlier solution.

    The closed form's limit at each target is the aim times (closed form / exact) at the last iterate; as the ratio
    hardly moves, two or three rounds do.  Bounded sources sit at the worst vertex of the last iterate.
    Targets outside the programme that turn out worse join it.  Raises InfeasibleError, NotConvergedError.
    """
    if start is not None:
        found = replace(found, program=start.program, parameters=start.parameters, points=(start.point,))
    program, parameters, point = found.program, found.parameters, found.points[0]
    least = not program.problem.half_widths
    worst = np.inf
    for rounds in range(MAX_ROUNDS):
        held = promised(program, point)
        worst = max(item.exact_mm for item in held)
        if _arrived(program, point, worst, aim_mm):
            values = _everywhere(found, point)
            if max(values) <= max(worst, aim_mm) * (1 + 1e-9):
                return _solution(program, point, parameters, values, aim_mm, rounds)
            found = with_targets(found, point, values, max(worst, aim_mm))
            program, parameters, point = found.program, found.parameters, found.points[0]
            continue
        if least and worst > aim_mm:
            raise explain_infeasible(program, point, aim_mm)
        parameters = _rescaled(program, point, held, aim_mm, parameters if rounds >= FREE_VERTICES else None)
        point = _again(program, point, parameters, aim_mm)
    raise _not_settled(aim_mm, worst)


def _arrived(program: Program, point: Point, worst_mm: float, aim_mm: float) -> bool:
    """The exact quantile is in the window below the aim, or below it because nothing is gained by using it up."""
    if worst_mm > aim_mm:
        return False
    pressed = any(multiplier > 1e-7 for multiplier in point.row_multipliers[: len(program.terms)])
    return not program.problem.half_widths or not pressed or worst_mm >= aim_mm * (1 - AT_LIMIT)


def _again(program: Program, point: Point, parameters: Parameters, aim_mm: float) -> Point:
    """Solve again for slightly different parameters, from where the last solve ended."""
    least = not program.problem.half_widths
    start = point if least else replace(point, x=_scaled(program, point.x, parameters))
    polished = solve(program, start.x, parameters, least_quantile=least, warm=start)
    if not polished.solved:
        polished = solve(program, start.x, parameters, least_quantile=least)
    if not polished.solved:
        bottom = least_quantile(program, parameters, [point.x])
        reached = max(item.exact_mm for item in promised(program, bottom))
        if reached > aim_mm:
            raise explain_infeasible(program, bottom, aim_mm)
        raise _not_settled(aim_mm, reached)
    return polished


def _scaled(program: Program, x: Array, parameters: Parameters) -> Array:
    """The same layout with all free half-widths multiplied by one factor, so that new limits are just met.

    A warm interior-point solve that starts outside the feasible set by a per cent takes 150 iterations, from just
    inside it 15.
    """
    count, rows = 3 * len(program.free), len(program.terms)
    low, high = program.bounds(False)
    vector = parameters.vector(False)

    def at(shift: float) -> Array:
        moved = x.copy()
        moved[count:-1] = np.clip(x[count:-1] + shift, low[count:-1], high[count:-1])
        return moved

    a, b = -3.0, 3.0
    for _ in range(30):
        middle = (a + b) / 2
        quantiles = program.constraints(at(middle), vector)[1].full().ravel()[:rows]
        a, b = (middle, b) if quantiles.max() <= 0 else (a, middle)
    return at(a)


def _not_settled(aim_mm: float, reached_mm: float) -> NotConvergedError:
    return NotConvergedError(
        Problem(
            "/optimise",
            "not-settled",
            f"the exact quantile could not be brought to {aim_mm:.6g} mm; the last iterate has {reached_mm:.6g} mm",
            "try another seed or more starts",
        )
    )


def _rescaled(
    program: Program, point: Point, held: list[Promise], aim_mm: float, same_ends: Parameters | None
) -> Parameters:
    """Limits for the closed form such that the exact quantile ends just below the aim; bounded sources at the worst
    ends of this iterate, or kept at those of ``same_ends`` (the ratio then carries the difference)."""
    problem = program.problem
    _, half_width, _ = program.split(point.x)
    count = len(held)
    signs = np.array([item.signs for item in held]).reshape(count, -1)
    free_signs = np.array([item.free_signs for item in held]).reshape(count, -1)
    if same_ends is not None:
        signs, free_signs = same_ends.signs, same_ends.free_signs
    ratio = [
        closed_form_mm(problem, term, item.image, half_width, signs[t], free_signs[t]) / item.exact_mm
        for t, (term, item) in enumerate(zip(program.terms, held, strict=True))
    ]
    return Parameters(np.log(aim_mm * (1 - AIM_BELOW)) + np.log(ratio), signs, free_signs)


def _everywhere(found: Search, point: Point) -> tuple[float, ...]:
    fiducials, half_width, _ = found.program.split(point.x)
    return tuple(promise(found.program.problem, term, fiducials, half_width).exact_mm for term in found.terms)


def _solution(
    program: Program, point: Point, parameters: Parameters, values: tuple[float, ...], aim_mm: float, rounds: int
) -> PlacementSolution:
    fiducials, half_width, _ = program.split(point.x)
    problem = program.problem
    return PlacementSolution(
        problem=problem,
        fiducials_mm=fiducials,
        half_width=half_width,
        cost=problem.cost(half_width) if len(half_width) else 0.0,
        quantile_mm=values,
        aim_mm=aim_mm,
        kkt_residual=kkt_residual(program, point, parameters),
        rounds=rounds,
        program=program,
        point=point,
        parameters=parameters,
    )
