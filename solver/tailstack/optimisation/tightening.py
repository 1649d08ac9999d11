"""An optimum is only returned when Monte Carlo on the full chain, with a fresh seed, keeps its upper limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, log2

import numpy as np

from ..design import Design, compile_design
from ..errors import InfeasibleError, NotConvergedError, Problem
from ..geometry.arrays import Array
from ..losses import without_fiducials
from ..measures import MEASURE
from ..results import Check, Relaxation, SurvivedLoss, Verification
from ..results.digits import at_least
from ..system import System
from ..verdict import conclude
from ..verification import UNITS, Sampling, prepare, verify_prepared
from .exact_law import evaluate_demand
from .grades import Optimum, Purchase, settle_grades
from .margin import MARGIN, aim_of, trials_for
from .placement import PlacementSolution, settle
from .present import bring_inside, merit_of, present_design
from .prices import grade_for
from .problem import Choice, PlacementProblem, Survival, present_choice, targets_of
from .program import rename_fiducials
from .request import OptimiseRequest, label_places, revise
from .search import Control, Search
from .terms import DemandTerms

MAX_TIGHTENING = 6
MORE = 4  # times the trials for a check that leaves a limit open: half the interval decides nearly all of them
DEAR, FINER = 0.005, 8  # of the cost: a margin that costs more is narrowed by up to so many times the trials


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
    kept: bool = False  # it is the design as it stood, brought inside


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
    trials = trials_of(request, search, settings)
    aims = settings.limits * first_aims(search, trials)
    optimum: Optimum | None = None
    for attempt in range(MAX_TIGHTENING):
        if request.graded:
            optimum = settle_grades(search, aims, control.stop)
        else:
            optimum = Optimum.of(settle(search, aims, start if optimum is None else optimum.solution))
        own, named = _label(request, search, optimum)
        design = revise(request, named.problem, named.choice)
        check = _check_optimum(own, named, design, settings, attempt, trials, control)
        reached = max(optimum.ratios) if problem.objective == "quantile" else optimum.cost
        control.report(settings.stage, attempt + 1, MAX_TIGHTENING, reached)
        if check.passes:
            return VerifiedOptimum(own, named, design, check.verification, attempt, survived=check.survived)
        if problem.objective == "quantile":
            raise _explain_miss(optimum, check.checks, problem)
        steps = np.array([_tightening(check.checks[term.demand.subject], attempt) for term in own.terms])
        steep = np.array([_steepness(problem, term, optimum.choice) for term in search.terms])
        aims = next_aims(aims, np.array(optimum.ratios), steps ** (1 / steep))
    failures = conclude(tuple(check.checks.values()), (), "Monte Carlo").findings[:2]
    told = "; ".join(finding.message for finding in failures)
    detail = f"after {MAX_TIGHTENING} rounds of tightening the Monte Carlo check still fails: {told}"
    hint = "the estimate that guides the search does not hold here: spread the fiducials or reduce the noise"
    raise NotConvergedError(Problem("/optimise", "not-verified", detail, hint))


def _label(request: OptimiseRequest, search: Search, optimum: Optimum) -> tuple[Search, Optimum]:
    """The same with every label where its fiducial moves least in all; nothing else changes."""
    layout, system = optimum.choice.fiducials_mm, optimum.problem.system
    labels = label_places(request, optimum.problem, layout)
    other = dict(zip(system.fiducial_labels, labels, strict=True))

    def rename(terms: tuple[DemandTerms, ...]) -> tuple[DemandTerms, ...]:
        lost = (tuple(other[label] for label in term.demand.lost) for term in terms)
        return tuple(replace(t, demand=replace(t.demand, lost=own)) for t, own in zip(terms, lost, strict=True))

    solution, whole = optimum.solution, replace(optimum.problem, system=replace(system, fiducial_labels=labels))
    if solution is not None:
        program = rename_fiducials(solution.program, rename(solution.program.terms), labels, layout)
        solution = replace(solution, problem=program.problem, program=program)
    search = replace(search, program=replace(search.program, problem=whole), terms=rename(search.terms))
    return search, replace(optimum, problem=whole, solution=solution)


def check_present(
    request: OptimiseRequest, search: Search, settings: CheckSettings, best: float, control: Control
) -> VerifiedOptimum | None:
    """The design as it stands, brought inside, where its merit is below the ``best`` known and its check passes."""
    problem = search.program.problem
    inside = bring_inside(problem, present_choice(problem))
    if problem.objective != "quantile" and merit_of(request, problem, inside, ()) >= best:
        return None  # before anything is evaluated
    here = present_design(problem)
    cost = problem.price_of(here.choice) if problem.half_widths else 0.0
    if not here.may_keep(settings.limits) or merit_of(request, problem, here.choice, here.ratios) >= best:
        return None
    purchase = None
    if request.graded:
        bought = here.choice.half_width
        each = zip(problem.half_widths, bought.tolist(), strict=True)
        held = (grade_for(free.price, width) for free, width in each)
        names = tuple("" if grade is None else grade.name for grade in held)
        statement = "the design as it stood is kept: no bound was sought at its layout"
        purchase = Purchase(bought, names, Relaxation("none", cost, None, None, statement))
    optimum = Optimum(problem, here.choice, cost, here.ratios, None, purchase)
    design = revise(request, problem, here.choice) if here.moved else request.design
    trials = trials_of(request, search, settings)
    check = _check_optimum(search, optimum, design, settings, MAX_TIGHTENING, trials, control)
    if not check.passes:
        return None
    search = replace(search, stopped=f"{search.stopped}, and none was better than the design as it stood")
    return VerifiedOptimum(search, optimum, design, check.verification, 0, survived=check.survived, kept=True)


@dataclass(frozen=True, slots=True, eq=False)
class OptimumCheck:
    """A check of an optimum by Monte Carlo."""

    verification: Verification
    checks: dict[tuple[str, ...], Check]  # of what was asked for
    survived: SurvivedLoss | None

    @property
    def passes(self) -> bool:
        return all(check.status == "pass" for check in self.checks.values())

    @property
    def is_open(self) -> bool:
        """Whether more trials may decide what these did not."""
        return not self.passes and all(check.status != "fail" for check in self.checks.values())


def _check_optimum(
    search: Search,
    optimum: Optimum,
    design: Design,
    settings: CheckSettings,
    attempt: int,
    trials: int,
    control: Control,
) -> OptimumCheck:
    """With a fresh seed of its own; where that leaves a limit open, once more with ``MORE`` times the trials."""
    problem = search.program.problem
    system = _system_to_check(design, problem, settings)
    fresh = int(np.random.SeedSequence([settings.seed, attempt, 0x7A11]).generate_state(1)[0])
    limited = {item.name for item in problem.requirements}
    for more in (1, MORE):
        verification = verify(system, fresh, more * trials, more * UNITS, control.threads)
        judged = verification.verdict.checks
        checks: dict[tuple[str, ...], Check] = {
            (c.requirement, c.target): c for c in judged if c.requirement in limited
        }
        survived: SurvivedLoss | None = None
        if problem.survival is not None:
            check, survived = _check_loss(problem.survival, search, optimum, system, fresh, more * trials, control)
            checks |= {term.demand.subject: check for term in search.terms if term.demand.lost}
        found = OptimumCheck(verification, checks, survived)
        if not found.is_open:
            break
    return found


def verify(system: System, seed: int, trials: int, units: int, threads: int | None) -> Verification:
    """Exactly so many trials, and units where a requirement is on each of them."""
    return verify_prepared(prepare(system), Sampling(trials, seed=seed, units=units), threads=threads)


def _check_loss(
    survival: Survival, search: Search, optimum: Optimum, system: System, seed: int, trials: int, control: Control
) -> tuple[Check, SurvivedLoss]:
    """The design without the fiducials whose loss is worst by estimate, by Monte Carlo."""
    sized = zip(optimum.ratios, search.terms, strict=True)
    ratio, term = max((each for each in sized if each[1].demand.lost), key=lambda each: each[0])
    lost, (target,) = term.demand.lost, term.demand.targets
    left = replace(
        without_fiducials(system, lost),
        requirements=(replace(survival.requirement, targets=(target.name,)),),
        targets=(target,),
        loss_probability=(),  # these are lost for certain
    )
    verification = verify(left, seed, trials, UNITS, control.threads)
    (check,) = verification.verdict.checks
    limit = survival.requirement.limit
    survived = SurvivedLoss(limit, lost, target.name, ratio * limit, check.value, check.interval, verification.trials)
    return check, survived


def trials_of(request: OptimiseRequest, search: Search, settings: CheckSettings) -> int:
    """Of the check of an optimum: more where the margin that it needs is dear, as it is near the least limit."""
    if settings.trials is not None:
        return settings.trials
    program = search.program
    trials = trials_for(len(_system_to_check(request.design, program.problem, settings).targets))
    if program.problem.objective == "quantile" or request.graded:
        return trials
    margins = 1 - first_aims(replace(search, terms=program.terms), trials)
    pooled = [not term.demand.is_nested for term in program.terms]
    cost = float(2 * search.iterates[0].point.row_multipliers[: len(pooled)][pooled] @ margins[pooled])
    return trials * min(1 << ceil(2 * log2(max(cost / DEAR, 1.0))), FINER)


def _system_to_check(design: Design, problem: PlacementProblem, settings: CheckSettings) -> System:
    """A design with the requirements that its check is to judge, and their targets."""
    system: System = compile_design(design)
    requirements = system.requirements
    if not settings.others:
        requirements = tuple(replace(item, limit=item.limit * settings.limits) for item in problem.requirements)
    return replace(system, requirements=requirements, targets=targets_of(system, requirements))


def first_aims(search: Search, trials: int) -> Array:
    """Where below each limit the exact quantile must be for a check of so many trials."""
    program = search.program
    if program.problem.objective == "quantile":
        return np.ones(len(search.terms))
    choice = program.split(search.iterates[0].point.x)
    exact = (evaluate_demand(program.problem, term, choice) for term in search.terms)
    return np.array([aim_of(own, term.demand, trials) for own, term in zip(exact, search.terms, strict=True)])


def next_aims(aims: Array, ratios: Array, factors: Array) -> Array:
    """(T,) where below each limit to be next, after a check that asks for factors of it, at most 1, at these ratios.

    What it finds kept may be used up as far as before: else a limit that nothing comes near would be held where the
    value happens to be, and the optimum kept from what is better.
    """
    return np.where(factors < 1, np.minimum(aims, ratios) * factors, aims)


def _tightening(check: Check, attempt: int) -> float:
    """Factor on the aim of one demand, from what its check measured; the margin grows with every failure."""
    upper = check.upper
    if upper <= check.limit:
        return 1.0
    if check.beyond is not None:  # a share of shots, where the aim is an error: 2 % of it are some 20 % of the tail
        return 1 - 0.02 * (1 + attempt)
    # A fresh seed moves the estimate within its interval.
    return (check.limit / upper) * (1 - (MARGIN - 1 + attempt / 2) * (upper / check.value - 1))


def _steepness(problem: PlacementProblem, terms: DemandTerms, choice: Choice) -> float:
    """By what power of an error's size the value that a check judges falls: of a share beyond a limit by that of the
    law's tail there, of an error by 1."""
    requirement = terms.demand.requirement
    if not requirement.row.unit:
        return 1.0
    exact = evaluate_demand(problem, terms, choice)
    return max(exact.exact_mm * exact.density / (1 - requirement.quantile), 1.0)


def _explain_miss(optimum: Optimum, checks: dict[tuple[str, ...], Check], problem: PlacementProblem) -> InfeasibleError:
    worst = max(checks.values(), key=lambda check: check.upper / check.limit)
    within = "" if problem.cost_limit is None else f" within the cost limit of {problem.cost_limit:g}"
    upper = f"{at_least(worst.upper)} {worst.unit}"
    first = max(optimum.ratios) * (worst.limit if worst.beyond is None else worst.beyond)
    detail = (
        f"the smallest error found{within} is {first:.4g} {MEASURE[worst.error].unit} by estimate, and its "
        f"{worst.headline} at most {upper} by Monte Carlo at target {worst.target!r}, which is not within the "
        f"limit of {worst.limit:g} {worst.unit} ({worst.requirement})"
    )
    looser = "raise the cost limit" if problem.half_widths else "free tolerances"
    hint = f"raise the limit to {upper} or more, or {looser}"
    return InfeasibleError(Problem("/optimise", "limit-out-of-reach", detail, hint))
