"""From a design document to a cheaper one that keeps its limit, verified by Monte Carlo before it is called that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import degrees, floor, radians, sqrt
from statistics import NormalDist

import numpy as np

from ..design import Design, compile_design, design_to_data, free_rotations, revise_design
from ..design.refusals import place
from ..errors import DesignError, IllPosedError, InfeasibleError, NotConvergedError, Problem, TailstackError
from ..estimation.checks import check_geometry
from ..results import Certificate, ChangedTolerance, MovedFiducial, Optimisation, Verification
from ..system import Array, Requirement, System
from ..verifying import verify
from .certificate import binding, shadow_prices
from .contradictions import refuse_contradictions
from .placement import PlacementSolution, settle
from .problem import FreeHalfWidth, PlacementProblem, half_widths_of
from .promise import promise
from .search import Progress, Search, promised, search
from .terms import TargetTerms, terms_of

# Trials of a check: 2^20 hold P95 within 0.13 %, and every bit of that interval is paid for in tolerance.  Fewer
# for many targets, whose samples are all kept.
MOST_TRIALS, FEWEST_TRIALS, TARGET_TRIALS = 2**20, 2**16, 2**23
MAX_TIGHTENING = 6
MARGIN = 1.5  # half-widths of the check's interval between the aim and the limit
POSITION_DECIMALS = (3, 6)  # mm: a micrometre, unless that breaks the spacing
WIDTH_DECIMALS = 6  # degrees, rounded down


def optimise(
    design: Design,
    *,
    seed: int | None = None,
    starts: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Optimisation:
    """Move the free fiducials and set the free half-widths of a design at least cost under its own limit.

    ``seed`` and ``starts`` default to the document's, ``threads`` to every core; the answer does not depend on it.
    ``progress(stage, done, total, least cost so far)`` is called after every start and every check; what it raises
    ends the work.  The design returned is verified: the upper confidence limit of its quantile, from a fresh seed,
    is within the limit.  Raises DesignError (contradictions), InfeasibleError (with the smallest quantile
    attainable), IllPosedError, NotConvergedError.
    """
    try:
        return _optimise(design, seed, starts, threads, progress)
    except TailstackError as error:
        raise type(error)([place(problem, design.source) for problem in error.problems]) from None


def problem_of(design: Design, system: System | None = None) -> PlacementProblem:
    """The freedom that the document's ``optimise`` section gives, on the compiled design.  Raises DesignError."""
    wanted = design.document.optimise
    if wanted is None:
        raise DesignError(
            Problem(
                "",
                "missing-field",
                "the design has no optimise section: nothing is free to change",
                "add optimise with a box, rotation_bounds or tolerances",
            )
        )
    system = compile_design(design) if system is None else system
    box = wanted.box
    return PlacementProblem(
        system=system,
        requirement=_requirement(system, wanted.requirement),
        free_fiducials=()
        if box is None
        else tuple(i for i, label in enumerate(system.fiducial_labels) if label not in wanted.fixed),
        box_mm=np.zeros((2, 3)) if box is None else np.array([box.min_mm, box.max_mm]),
        half_widths=tuple(
            FreeHalfWidth(free.contributor, free.component, free.min_rad, free.max_rad, free.cost_weight, free.pointer)
            for free in free_rotations(design)
        ),
        min_spacing_mm=wanted.min_spacing_mm,
        min_projected_spacing_px=wanted.min_projected_spacing_px,
        image_margin_px=wanted.image_margin_px,
    )


def _requirement(system: System, name: str | None) -> Requirement:
    """The named one; loading has made sure that a name is given unless there is only one."""
    return next(item for item in system.requirements if name is None or item.name == name)


def _optimise(
    design: Design, seed: int | None, starts: int | None, threads: int | None, progress: Progress | None
) -> Optimisation:
    problem = problem_of(design)
    wanted = design.document.optimise
    assert wanted is not None
    seed = wanted.seed if seed is None else seed
    starts = wanted.starts if starts is None else starts
    refuse_contradictions(problem)
    found = search(problem, starts=starts, seed=seed, threads=threads, progress=progress)

    trials = min(max(TARGET_TRIALS // len(problem.targets), FEWEST_TRIALS), MOST_TRIALS)

    def check(system: System, attempt: int) -> Verification:
        fresh = int(np.random.SeedSequence([seed, attempt, 0x7A11]).generate_state(1)[0])
        return verify(system, seed=fresh, trials=trials, threads=threads)

    solution, revised, verification, rounds = _verified(design, found, first_aim(found, trials), check, progress)
    return _report(design, found, solution, revised, verification, rounds, seed)


def first_aim(found: Search, trials: int) -> float:
    """Where below the limit the exact quantile must be for a check of so many trials to pass most of the time.

    If first order is right, the estimate of the quantile scatters by ``sqrt(p (1 - p) / n) / density`` and the upper
    limit lies z times that above it; half as much again lets 5 of 6 checks pass.
    """
    requirement = found.program.problem.requirement
    if not found.program.problem.half_widths:
        return requirement.limit_mm
    worst = max(promised(found.program, found.points[0]), key=lambda item: item.exact_mm)
    if worst.density <= 0:
        return requirement.limit_mm
    p, z = requirement.quantile, NormalDist().inv_cdf((1 + requirement.confidence) / 2)
    return requirement.limit_mm * (1 - MARGIN * z * sqrt(p * (1 - p) / trials) / (worst.density * worst.exact_mm))


def _verified(
    design: Design, found: Search, aim: float, check: Callable[[System, int], Verification], progress: Progress | None
) -> tuple[PlacementSolution, Design, Verification, int]:
    """Solve, check by Monte Carlo, tighten by the measured ratio, until the check's upper limit is within the limit."""
    problem = found.program.problem
    limit = problem.requirement.limit_mm
    solution: PlacementSolution | None = None
    for attempt in range(MAX_TIGHTENING):
        solution = settle(found, aim, solution)
        revised = revise(design, solution)
        system = replace(compile_design(revised), requirements=(problem.requirement,), targets=problem.targets)
        verification = check(system, attempt)
        upper = max(item.interval_mm[1] for item in verification.verdict.checks)
        if progress is not None:
            progress("check", attempt + 1, MAX_TIGHTENING, solution.cost if problem.half_widths else None)
        if verification.verdict.status == "pass" and upper <= limit:
            return solution, revised, verification, attempt
        if not problem.half_widths:
            raise InfeasibleError(
                Problem(
                    "/optimise",
                    "limit-out-of-reach",
                    f"the best layout's quantile is {solution.worst_mm:.4g} mm to first order, and at most "
                    f"{upper:.4g} mm by Monte Carlo, which is not within the limit of {limit:g} mm",
                    f"raise the limit above {upper:.4g} mm, or free tolerances",
                )
            )
        spread = max(item.interval_mm[1] / item.value_mm - 1 for item in verification.verdict.checks)
        # A fresh seed moves the estimate within its interval.
        aim = min(aim, solution.worst_mm) * (limit / upper) * (1 - (MARGIN - 1) * spread)
    raise NotConvergedError(
        Problem(
            "/optimise",
            "not-verified",
            f"after {MAX_TIGHTENING} rounds of tightening the Monte Carlo check still reaches {upper:.5g} mm, limit "
            f"{limit:g} mm",
            "first order does not hold on this geometry: spread the fiducials or reduce the noise",
        )
    )


def revise(design: Design, solution: PlacementSolution) -> Design:
    """The design with the solution written into it: positions rounded to a micrometre, half-widths rounded down."""
    problem = solution.problem
    free = list(problem.free_fiducials)
    for decimals in POSITION_DECIMALS:
        fiducials = problem.system.fiducials_mm.copy()
        fiducials[free] = np.clip(np.round(solution.fiducials_mm[free], decimals), *problem.box_mm)
        if _smallest_gap(fiducials, free) >= problem.min_spacing_mm:
            break
    widths = {
        (free.contributor, free.component): rounded_down(float(value), free)
        for free, value in zip(problem.half_widths, solution.half_width, strict=True)
    }
    return revise_design(design, fiducials_mm=fiducials if free else None, half_width_rad=widths)


def _smallest_gap(points: Array, free: list[int]) -> float:
    """Distance of the closest pair with a free fiducial in it, mm; inf when there is none."""
    gaps = [float(np.linalg.norm(points[i] - points[j])) for i in free for j in range(len(points)) if i != j]
    return min(gaps, default=np.inf)


def rounded_down(half_width: float, free: FreeHalfWidth) -> float:
    """A half-width, rad, on the grid of the document, never looser; at a bound it is the bound."""
    for bound in (free.minimum, free.maximum):
        if abs(half_width - bound) <= 1e-6 * bound:
            return bound
    return max(free.minimum, radians(floor(degrees(half_width) * 10**WIDTH_DECIMALS) / 10**WIDTH_DECIMALS))


def _p95(problem: PlacementProblem, terms: tuple[TargetTerms, ...], fiducials: Array, half_width: Array) -> Array:
    """(T,) P95 at each required target, whatever quantile the requirement limits."""
    problem = replace(problem, requirement=replace(problem.requirement, quantile=0.95))
    return np.array([promise(problem, term, fiducials, half_width).exact_mm for term in terms])


def _report(
    design: Design, found: Search, solution: PlacementSolution, revised: Design, verification: Verification,
    rounds: int, seed: int,
) -> Optimisation:  # fmt: skip
    problem, system = solution.problem, solution.problem.system
    after = problem_of(revised)
    before_width, after_width = half_widths_of(problem), half_widths_of(after)
    terms = tuple(terms_of(after, target) for target in after.targets)
    values = _p95(after, terms, after.system.fiducials_mm, after_width)
    lever = terms[int(np.argmax(values))].free_gain
    p95_before: float | None = None
    try:
        check_geometry(system)
        p95_before = float(_p95(problem, found.terms, system.fiducials_mm, before_width).max())
    except IllPosedError:  # the layout as it stands has no answer; the new one has
        pass
    quantile = f"P{100 * problem.requirement.quantile:g} of the {problem.requirement.error} error"
    objective = f"least {quantile}"
    if problem.half_widths:
        objective = (
            f"least cost (sum of cost_weight / half-width in rad over {len(problem.half_widths)} free rotational "
            f"tolerances) with {quantile} within {problem.requirement.limit_mm:g} mm"
        )
    return Optimisation(
        schema="tailstack/optimisation/1",
        status="verified",
        objective=objective,
        cost_before=problem.cost(before_width) if problem.half_widths else 0.0,
        cost_after=problem.cost(after_width) if problem.half_widths else 0.0,
        p95_before_mm=p95_before,
        p95_after_mm=float(values.max()),
        moved=tuple(
            MovedFiducial(
                system.fiducial_labels[i], _vector(system.fiducials_mm[i]), _vector(after.system.fiducials_mm[i])
            )
            for i in problem.free_fiducials
        ),
        tolerances=tuple(
            ChangedTolerance(
                contributor=free.contributor,
                component=free.component,
                unit="deg",
                before_half_width=degrees(before_width[k]),
                after_half_width=degrees(after_width[k]),
                at_target_mm=float(np.linalg.norm(lever[:, k]) * after_width[k]),
                cost_before=float(free.cost_weight / before_width[k]),
                cost_after=float(free.cost_weight / after_width[k]),
            )
            for k, free in enumerate(problem.half_widths)
        ),
        certificate=Certificate(
            kkt_residual=solution.kkt_residual,
            starts=found.starts,
            converged_starts=found.converged,
            best_costs=found.best_costs,
            seed=seed,
            tightening_rounds=rounds,
            verification=verification,
        ),
        shadow_prices=shadow_prices(solution.program, solution.point, solution.cost),
        binding=binding(solution.program, solution.point, solution.parameters),
        design=design_to_data(revised),
        provenance=verification.provenance,
    )


def _vector(point: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
