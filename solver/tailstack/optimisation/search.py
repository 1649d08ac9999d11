"""The search: solve from every start, polish the best, or say what stands in the way."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np

from ..system import Array
from .infeasible import explain_infeasible, refuse_geometry
from .problem import PlacementProblem, half_widths_of
from .program import Parameters, Point, Program, build_program, solve
from .promise import Promise, closed_form_mm, image_part, leading_targets, promise
from .starts import starting_layouts
from .terms import Estimator, TargetTerms, estimator_of, is_flat, terms_of

POLISHED = 3  # best explored points that are solved to full precision
ATTEMPTS = 8  # starts asked for the smallest quantile before a limit is called out of reach
STEERING = 6  # targets whose error the starting layouts are improved for
LEADING = 0.97  # of the largest quantile: a target that near may bind
MANY_TARGETS = 3  # beyond this only the targets that bind somewhere enter the programme

Progress = Callable[[str, int, int, float | None], None]  # stage, done, total, least cost so far


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


def search(
    problem: PlacementProblem,
    *,
    starts: int = 8,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Search:
    """Solve from every start and rank the optima (by the closed form).  Raises InfeasibleError."""
    terms = tuple(terms_of(problem, target) for target in problem.targets)
    estimator = estimator_of(problem.system)
    layouts = starting_layouts(problem, estimator, farthest(problem, terms), starts, seed)
    active = terms
    if len(terms) > MANY_TARGETS:
        # At half-widths that use up the limit, not at the smallest: a lever may lead where noise does not.
        choices = [(layout, half_widths_of(problem)) for layout in layouts[:3] if not is_flat(layout)]
        leading = leading_targets(problem, terms, choices, LEADING)
        active = tuple(term for k, term in enumerate(terms) if k in leading)
    lanes = min(cores() if threads is None else threads, len(layouts))
    program = build_program(problem, estimator, active, lanes)
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
        ranked = [begun[k].x for k in np.argsort(tightest, kind="stable")[:ATTEMPTS]]
        found = least_quantile(program, parameters, ranked)
        if found.objective > 0 and promised(program, found)[0].exact_mm > limit:
            raise explain_infeasible(program, found, limit)
        points.append(solve(program, found.x, parameters))
    for k, point in enumerate(_solve_all(program, begun, least)):
        points.append(point)
        if progress is not None:
            done = [point.objective for point in points if point.solved]
            progress("start", k + 1, len(begun), None if least or not done else float(np.exp(min(done))))
    solved = sorted((point for point in points if point.solved), key=lambda point: point.objective)
    if not solved:
        ranked = [begun[k].x for k in np.argsort(tightest, kind="stable")[:ATTEMPTS]]
        raise explain_infeasible(program, least_quantile(program, parameters, ranked), limit)
    polished = [solve(program, point.x, parameters, least_quantile=least, warm=point) for point in solved[:POLISHED]]
    best = sorted((point for point in polished if point.solved), key=lambda point: point.objective) or solved
    ranked_costs = [] if least else [float(np.exp(point.objective)) for point in (*best, *solved[POLISHED:])]
    return Search(
        program, parameters, tuple(best), terms, estimator, len(layouts), min(len(solved), len(layouts)),
        distinct(ranked_costs),
    )  # fmt: skip


def _solve_all(program: Program, begun: list[_Begun], least: bool) -> Iterator[Point]:
    """The starts solved side by side, in their order: what a start ends at does not depend on the threads."""
    lanes: SimpleQueue[int] = SimpleQueue()
    for lane in range(len(program.explore)):
        lanes.put(lane)

    def one(start: _Begun) -> Point:
        lane = lanes.get()
        try:
            return solve(program, start.x, start.parameters, least_quantile=least, lane=lane)
        finally:
            lanes.put(lane)

    with ThreadPoolExecutor(len(program.explore), thread_name_prefix="tailstack-start") as pool:
        futures = [pool.submit(one, start) for start in begun]
        try:
            for future in futures:
                yield future.result()
        finally:  # a caller that stops listening does not wait for the starts that have not begun
            for future in futures:
                future.cancel()


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def farthest(problem: PlacementProblem, terms: tuple[TargetTerms, ...]) -> tuple[TargetTerms, ...]:
    """The targets farthest from where the fiducials may be: their noise is largest, they steer the starts."""
    centre = problem.box_mm.mean(axis=0)
    apart = [-float(np.linalg.norm(term.target.position_mm - centre)) for term in terms]
    return tuple(terms[k] for k in sorted(np.argsort(apart, kind="stable")[:STEERING]))


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
    """Starts at the layouts that determine the targets: the present one may not, and be optimised for that."""
    solid = [layout for layout in layouts if not is_flat(layout)]
    return [_start(program, layout, limit_mm) for layout in solid or layouts]


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
    points: list[Point] = []
    for start in starts:
        points.append(solve(program, start, parameters, least_quantile=True))
        if points[-1].solved and points[-1].objective < 0:  # within the limit: nothing is infeasible
            break
    solved = [point for point in points if point.solved]
    if not solved:
        raise refuse_geometry(program, points, parameters)
    best = min(solved, key=lambda point: point.objective)
    return solve(program, best.x, parameters, least_quantile=True, warm=best)


def promised(program: Program, point: Point) -> list[Promise]:
    """Exact quantiles of the programme's targets at a point."""
    fiducials, half_width, _ = program.split(point.x)
    return [promise(program.problem, term, fiducials, half_width) for term in program.terms]


def with_targets(found: Search, point: Point, values: tuple[float, ...], aim_mm: float) -> Search:
    """The search again with every target that is above the aim at a point, from the layouts it ended at."""
    names = {term.target.name for term in found.program.terms}
    names |= {term.target.name for term, value in zip(found.terms, values, strict=True) if value > aim_mm * LEADING}
    active = tuple(term for term in found.terms if term.target.name in names)
    program = build_program(found.program.problem, found.estimator, active, len(found.program.explore))
    layouts = [found.program.split(p.x)[0] for p in (point, *found.points[1:])]
    again = _explore(program, found.terms, found.estimator, layouts, None)
    return replace(again, starts=found.starts, converged=found.converged)
