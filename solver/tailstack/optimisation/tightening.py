"""An optimum is only returned when Monte Carlo on the full chain, with a fresh seed, keeps its upper limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from statistics import NormalDist

import numpy as np

from ..arrays import Array
from ..design import Design, compile_design
from ..errors import InfeasibleError, NotConvergedError, Problem
from ..losses import without_fiducials
from ..results import Check, SurvivedLoss, Verification
from ..system import System
from ..verdict import conclude
from ..verification import UNITS, verify
from .exact_law import Evaluation, evaluate_demand
from .grades import Optimum, settle_grades
from .placement import PlacementSolution, settle
from .problem import PlacementProblem, QuantileConstraint, Survival
from .request import OptimiseRequest, revise
from .search import Control, Search

# Trials of a check: 2^20 hold P95 within 0.13 %, and every bit of that interval is paid for in tolerance.  Fewer
# for many targets, whose samples are all kept.
MOST_TRIALS, FEWEST_TRIALS, TARGET_TRIALS = 2**20, 2**16, 2**23
MAX_TIGHTENING = 6
MARGIN = 1.5  # half-widths of the check's interval between the aim and the limit


@dataclass(frozen=True, slots=True, eq=False)
class CheckSettings:
    """How an optimum is checked."""

    seed: int
    stage: str = "check"  # what the progress calls it
    trials: int | None = None  # None: by the number of targets
    limits: float = 1.0  # factor on every limit: a front asks at several
    others: bool = True  # whether requirements that were not asked for are judged too


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedOptimum:
    """An optimum whose check passed."""

    search: Search  # that it comes from
    optimum: Optimum
    design: Design
    verification: Verification
    rounds: int  # of tightening
    exact: PlacementSolution | None = None  # by the exact law at the limits themselves
    survived: SurvivedLoss | None = None  # the worst loss, where some must be survived

    @property
    def count(self) -> int:
        """Number of fiducials."""
        return len(self.search.program.problem.system.fiducial_labels)


def tighten(
    request: OptimiseRequest,
    search: Search,
    settings: CheckSettings,
    control: Control,
    start: PlacementSolution | None = None,
) -> VerifiedOptimum:
    """Solve, check by Monte Carlo, tighten by the measured ratio, until the check's upper limit is within the limit.

    The check judges every requirement of the design; those that were not asked for do not hold the answer back, its
    verdict says what became of them.  ``start``: an earlier solution.  Raises InfeasibleError, NotConvergedError.
    """
    problem = search.program.problem
    trials = settings.trials
    if trials is None:
        trials = trials_for(len(_system_to_check(request.design, problem, settings).targets))
    aims = settings.limits * first_aims(search, trials)
    optimum: Optimum | None = None
    for attempt in range(MAX_TIGHTENING):
        if request.graded:
            optimum = settle_grades(search, aims, request.graded, control.stop)
        else:
            optimum = Optimum.of(settle(search, aims, start if optimum is None else optimum.solution))
        design = revise(request, problem, optimum.choice)
        system = _system_to_check(design, problem, settings)
        fresh = int(np.random.SeedSequence([settings.seed, attempt, 0x7A11]).generate_state(1)[0])
        verification = verify(system, seed=fresh, trials=trials, threads=control.threads)
        reached = max(optimum.ratios) if problem.objective == "quantile" else optimum.cost
        control.report(settings.stage, attempt + 1, MAX_TIGHTENING, reached)
        limited = {item.name for item in problem.requirements}
        checks: dict[tuple[str, ...], Check] = {
            (c.requirement, c.target): c for c in verification.verdict.checks if c.requirement in limited
        }
        survived: SurvivedLoss | None = None
        if problem.survival is not None:
            check, survived = _check_loss(problem.survival, search, optimum, system, fresh, trials, control)
            checks |= {term.demand.subject: check for term in search.terms if term.demand.lost}
        if all(check.status == "pass" for check in checks.values()):
            return VerifiedOptimum(search, optimum, design, verification, attempt, survived=survived)
        if problem.objective == "quantile":
            raise _explain_miss(optimum, checks, problem)
        aims = np.minimum(aims, optimum.ratios)
        aims = aims * np.array([_tightening(checks[term.demand.subject], attempt) for term in search.terms])
    failures = conclude(tuple(checks.values()), (), "Monte Carlo").findings[:2]
    raise NotConvergedError(
        Problem(
            "/optimise",
            "not-verified",
            f"after {MAX_TIGHTENING} rounds of tightening the Monte Carlo check still fails: "
            + "; ".join(finding.message for finding in failures),
            "the estimate that guides the search does not hold here: spread the fiducials or reduce the noise",
        )
    )


def _check_loss(
    survival: Survival, search: Search, optimum: Optimum, system: System, seed: int, trials: int, control: Control
) -> tuple[Check, SurvivedLoss]:
    """The design without the fiducials whose loss is worst by estimate, by Monte Carlo."""
    ratio, term = max(
        ((ratio, term) for ratio, term in zip(optimum.ratios, search.terms, strict=True) if term.demand.lost),
        key=lambda each: each[0],
    )
    lost, target = term.demand.lost, term.demand.target
    left = replace(
        without_fiducials(system, lost),
        requirements=(replace(survival.requirement, targets=(target.name,)),),
        targets=(target,),
        loss_probability=(),  # these are lost for certain
    )
    verification = verify(left, seed=seed, trials=trials, threads=control.threads)
    (check,) = verification.verdict.checks
    limit = survival.requirement.limit_mm
    survived = SurvivedLoss(
        limit, lost, target.name, ratio * limit, check.value_mm, check.interval_mm, verification.trials
    )
    return check, survived


def trials_for(targets: int) -> int:
    """Of a check at so many targets."""
    return min(max(TARGET_TRIALS // targets, FEWEST_TRIALS), MOST_TRIALS)


def _system_to_check(design: Design, problem: PlacementProblem, settings: CheckSettings) -> System:
    """A design with the requirements that its check is to judge, and their targets."""
    system: System = compile_design(design)
    if settings.others:
        requirements = system.requirements
        named = {name for item in requirements for name in item.targets}
        targets = tuple(target for target in system.targets if target.name in named)
    else:
        requirements = tuple(replace(item, limit_mm=item.limit_mm * settings.limits) for item in problem.requirements)
        targets = problem.targets
    return replace(system, requirements=requirements, targets=targets)


def first_aims(search: Search, trials: int) -> Array:
    """Where below each limit the exact quantile must be for a check of so many trials to pass most of the time.

    If first order is right, the estimate of a quantile scatters by ``sqrt(p (1 - p) / n) / density`` and the upper
    limit lies z times that above it; half as much again lets 5 of 6 checks pass.  Per unit, p is the fraction of
    units, n their number and the density that of the units' own quantiles.
    """
    program = search.program
    if program.problem.objective == "quantile":
        return np.ones(len(search.terms))
    choice = program.split(search.iterates[0].point.x)
    return np.array(
        [_aim(evaluate_demand(program.problem, term, choice), term.demand, trials) for term in search.terms]
    )


def _aim(exact: Evaluation, demand: QuantileConstraint, trials: int) -> float:
    requirement = demand.requirement
    if exact.density <= 0:
        return 1.0
    p, n = (demand.fraction, UNITS) if demand.per_unit else (requirement.quantile, trials)
    z = NormalDist().inv_cdf((1 + requirement.confidence) / 2)
    return max(1 - MARGIN * z * sqrt(p * (1 - p) / n) / (exact.density * exact.exact_mm), 0.5)


def _tightening(check: Check, attempt: int) -> float:
    """Factor on the aim of one demand, from what its check measured; the margin grows with every failure."""
    upper = check.upper_mm
    if upper <= check.limit_mm:
        return 1.0
    # A fresh seed moves the estimate within its interval.
    return (check.limit_mm / upper) * (1 - (MARGIN - 1 + attempt / 2) * (upper / check.value_mm - 1))


def _explain_miss(optimum: Optimum, checks: dict[tuple[str, ...], Check], problem: PlacementProblem) -> InfeasibleError:
    worst = max(checks.values(), key=lambda check: check.upper_mm / check.limit_mm)
    within = "" if problem.cost_limit is None else f" within the cost limit of {problem.cost_limit:g}"
    first = max(optimum.ratios) * worst.limit_mm
    return InfeasibleError(
        Problem(
            "/optimise",
            "limit-out-of-reach",
            f"the smallest error found{within} is {first:.4g} mm by estimate and at most "
            f"{worst.upper_mm:.4g} mm by Monte Carlo at target {worst.target!r}, which is not within the limit "
            f"of {worst.limit_mm:g} mm ({worst.requirement})",
            f"raise the limit above {worst.upper_mm:.4g} mm, or "
            + ("free tolerances" if not problem.half_widths else "raise the cost limit"),
        )
    )
