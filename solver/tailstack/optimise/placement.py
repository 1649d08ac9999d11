"""Least-cost placement and half-widths: many starts, the best polished, the exact quantile brought to its limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import IllPosedError, NotConvergedError, Problem
from ..system import Array
from .certificate import kkt_residual
from .infeasible import explain_infeasible, refuse_geometry
from .problem import PlacementProblem, half_widths_of
from .program import Parameters, Point, Program, build_program, solve
from .promise import Promise, closed_form_mm, image_part, promise, worst_targets
from .starts import starting_layouts
from .terms import Estimator, TargetTerms, estimator_of, terms_of

POLISHED = 3  # best explored points that are solved to full precision
MANY_TARGETS = 3  # beyond this only the targets that bind somewhere enter the programme
AT_LIMIT = 1e-4  # relative: how near below the aim the exact quantile is brought
AIM_BELOW = 1e-5  # relative: where in that window it is aimed
MAX_ROUNDS = 12

Progress = Callable[[str, int, int, float | None], None]  # stage, done, total, least cost so far


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


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What the starts found: the programme, the best points first, and how the starts ended."""

    program: Program
    parameters: Parameters
    points: tuple[Point, ...]
    terms: tuple[TargetTerms, ...]  # of every required target, also those outside the programme
    estimator: Estimator
    starts: int
    converged: int
    best_costs: tuple[float, ...]  # distinct, ascending


def solve_placement(
    problem: PlacementProblem, *, starts: int = 8, seed: int = 0, progress: Progress | None = None
) -> PlacementSolution:
    """Best of ``starts`` local optima, its exact quantile within 1e-4 below the requirement's limit.

    Raises InfeasibleError (with the smallest quantile attainable), NotConvergedError, IllPosedError.  The
    same seed gives the same answer; start k depends on (seed, k) alone.
    """
    return settle(search(problem, starts=starts, seed=seed, progress=progress), problem.requirement.limit_mm)


def search(problem: PlacementProblem, *, starts: int = 8, seed: int = 0, progress: Progress | None = None) -> Search:
    """Solve from every start and rank the optima (by the closed form).  Raises InfeasibleError."""
    terms = tuple(terms_of(problem, target) for target in problem.targets)
    estimator = estimator_of(problem.system)
    layouts = starting_layouts(problem, estimator, terms, starts, seed)
    choices = [(layout, problem.lower) for layout in layouts[:4]]
    active = terms
    if len(terms) > MANY_TARGETS:
        names = {target.name for target in worst_targets(problem, terms, choices)}
        active = tuple(term for term in terms if term.target.name in names)
    program = build_program(problem, estimator, active)
    return _explore(program, terms, estimator, layouts, progress)


def _explore(
    program: Program, terms: tuple[TargetTerms, ...], estimator: Estimator, layouts: list[Array],
    progress: Progress | None,
) -> Search:  # fmt: skip
    problem = program.problem
    least = not problem.half_widths
    limit = problem.requirement.limit_mm
    begun = _starts(program, layouts, limit)
    tightest = np.array([start.tightest_mm for start in begun])
    parameters = begun[int(np.argmin(tightest))].parameters
    points: list[Point] = []
    if tightest.min() > limit and not least:
        # Is there anything to find?  Ask for the smallest quantile from the best layouts before all starts fail.
        ranked = [begun[k].x for k in np.argsort(tightest, kind="stable")[:POLISHED]]
        found = least_quantile(program, parameters, ranked)
        if found.objective > 0 and promised(program, found, parameters)[0].exact_mm > limit:
            raise explain_infeasible(program, found, parameters, limit)
        points.append(solve(program, found.x, parameters))
    for k, start in enumerate(begun):
        points.append(solve(program, start.x, start.parameters, least_quantile=least))
        if progress is not None:
            done = [point.objective for point in points if point.solved]
            progress("start", k + 1, len(begun), None if least or not done else float(np.exp(min(done))))
    solved = sorted((point for point in points if point.solved), key=lambda point: point.objective)
    if not solved:
        ranked = [begun[k].x for k in np.argsort(tightest, kind="stable")[:POLISHED]]
        raise explain_infeasible(program, least_quantile(program, parameters, ranked), parameters, limit)
    polished = [solve(program, point.x, parameters, least_quantile=least, warm=point) for point in solved[:POLISHED]]
    best = sorted((point for point in polished if point.solved), key=lambda point: point.objective) or solved
    ranked_costs = [] if least else [float(np.exp(point.objective)) for point in (*best, *solved[POLISHED:])]
    return Search(
        program, parameters, tuple(best), terms, estimator, len(layouts), min(len(solved), len(layouts)),
        distinct(ranked_costs),
    )  # fmt: skip


def distinct(costs: list[float]) -> tuple[float, ...]:
    """Ascending, those within 1e-4 of a smaller one left out: explored costs are known to about that."""
    kept: list[float] = []
    for cost in sorted(costs):
        if not kept or cost > kept[-1] * (1 + 1e-4):
            kept.append(cost)
    return tuple(kept)


@dataclass(frozen=True, slots=True, eq=False)
class _Begun:
    x: Array
    parameters: Parameters
    tightest_mm: float  # closed form with every free half-width at its smallest, worst target


def _starts(program: Program, layouts: list[Array], limit_mm: float) -> list[_Begun]:
    """Starts at the layouts that determine the targets; IllPosedError when none does."""
    begun: list[_Begun] = []
    refused: IllPosedError | None = None
    for layout in layouts:
        try:
            begun.append(_start(program, layout, limit_mm))
        except IllPosedError as error:  # the present layout may be singular: that is why it is optimised
            refused = error
    if refused is not None and not begun:
        raise refused
    return begun


def _start(program: Program, layout: Array, limit_mm: float) -> _Begun:
    """Variables at a layout: half-widths as the trace bound would allot them, scaled to meet the limit.

    Minimising ``sum w / h`` under ``sum |g|^2 h^2 <= const`` gives ``h ~ (w / |g|^2)^(1/3)``.
    """
    problem = program.problem
    low, high = problem.lower, problem.upper
    images, signs, free_signs = [], [], []
    for term in program.terms:
        held = promise(problem, term, layout, low if len(low) else half_widths_of(problem))
        images.append(image_part(held.model, problem.requirement.error))
        signs.append(held.signs)
        free_signs.append(held.free_signs)

    def worst(half_width: Array) -> float:
        values = [
            closed_form_mm(problem, term, image, half_width, *ends)
            for term, image, *ends in zip(program.terms, images, signs, free_signs, strict=True)
        ]
        return max(values)

    tightest = worst(low)
    half_width = low
    if len(low):
        lever = np.max([np.linalg.norm(term.free_gain, axis=0) for term in program.terms], axis=0)
        shape = np.where(lever > 0, (problem.weights / np.maximum(lever, 1e-12) ** 2) ** (1 / 3), np.inf)
        a, b = -40.0, 40.0  # log of the scale
        for _ in range(40):
            middle = (a + b) / 2
            half_width = np.clip(np.exp(middle) * shape, low, high)
            a, b = (middle, b) if worst(half_width) < 0.98 * limit_mm else (a, middle)
        half_width = np.clip(np.exp(a) * shape, low, high)
    parameters = Parameters(
        np.full(len(program.terms), np.log(limit_mm)), np.array(signs).reshape(len(program.terms), -1),
        np.array(free_signs).reshape(len(program.terms), -1),
    )  # fmt: skip
    return _Begun(program.join(layout, half_width), parameters, tightest)


def least_quantile(program: Program, parameters: Parameters, starts: list[Array]) -> Point:
    """The smallest quantile attainable from some starts, every free half-width at its smallest.

    Raises InfeasibleError when not even the geometric constraints can be met.
    """
    points = [solve(program, start, parameters, least_quantile=True) for start in starts]
    solved = [point for point in points if point.solved]
    if not solved:
        raise refuse_geometry(program, points, parameters)
    best = min(solved, key=lambda point: point.objective)
    return solve(program, best.x, parameters, least_quantile=True, warm=best)


def promised(program: Program, point: Point, parameters: Parameters) -> list[Promise]:
    """Exact quantiles of the programme's targets at a point."""
    fiducials, half_width, _ = program.split(point.x)
    return [promise(program.problem, term, fiducials, half_width) for term in program.terms]


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
    for rounds in range(MAX_ROUNDS):
        held = promised(program, point, parameters)
        worst = max(item.exact_mm for item in held)
        same = parameters
        parameters = _rescaled(program, point, held, aim_mm)
        unchanged = np.array_equal(same.signs, parameters.signs) and np.array_equal(
            same.free_signs, parameters.free_signs
        )
        slack = not any(multiplier > 1e-7 for multiplier in point.row_multipliers[: len(program.terms)])
        if unchanged and (least or (worst <= aim_mm and (slack or worst >= aim_mm * (1 - AT_LIMIT)))):
            if least and worst > aim_mm:
                raise explain_infeasible(program, point, same, aim_mm)
            values = _everywhere(found, point)
            if max(values) <= max(worst, aim_mm) * (1 + 1e-9):
                return _solution(program, point, same, values, aim_mm, rounds)
            found = _with_target(found, int(np.argmax(values)), point)
            program, parameters, point = found.program, found.parameters, found.points[0]
            continue
        point = point if least else replace(point, x=_scaled(program, point.x, parameters))
        polished = solve(program, point.x, parameters, least_quantile=least, warm=point)
        if not polished.solved:
            polished = solve(program, point.x, parameters, least_quantile=least)
        if not polished.solved:
            bottom = least_quantile(program, parameters, [point.x])
            if max(item.exact_mm for item in promised(program, bottom, parameters)) > aim_mm:
                raise explain_infeasible(program, bottom, parameters, aim_mm)
            raise _not_settled(aim_mm, worst)
        point = polished
    raise _not_settled(aim_mm, worst)


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


def _rescaled(program: Program, point: Point, held: list[Promise], aim_mm: float) -> Parameters:
    """Limits for the closed form such that the exact quantile ends just below the aim."""
    problem = program.problem
    _, half_width, _ = program.split(point.x)
    ratio = [
        closed_form_mm(problem, term, item.image, half_width, item.signs, item.free_signs) / item.exact_mm
        for term, item in zip(program.terms, held, strict=True)
    ]
    return Parameters(
        np.log(aim_mm * (1 - AIM_BELOW)) + np.log(ratio),
        np.array([item.signs for item in held]).reshape(len(held), -1),
        np.array([item.free_signs for item in held]).reshape(len(held), -1),
    )


def _everywhere(found: Search, point: Point) -> tuple[float, ...]:
    fiducials, half_width, _ = found.program.split(point.x)
    return tuple(promise(found.program.problem, term, fiducials, half_width).exact_mm for term in found.terms)


def _with_target(found: Search, worst: int, point: Point) -> Search:
    """The search again with one more target, from the layouts it ended at."""
    names = {term.target.name for term in found.program.terms} | {found.terms[worst].target.name}
    active = tuple(term for term in found.terms if term.target.name in names)
    program = build_program(found.program.problem, found.estimator, active)
    layouts = [found.program.split(p.x)[0] for p in (point, *found.points)]
    again = _explore(program, found.terms, found.estimator, layouts, None)
    return replace(again, starts=found.starts, converged=found.converged)


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
