"""Why nothing meets the limits: the smallest quantile attainable, what stands in the way, what would cure it.

What the free variables can and cannot do is known before anything is solved: the layout acts through image noise and
manufacturing alone (a rigid installation error is absorbed exactly), a half-width through its lever, a pivot through
the rotations about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, log10
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from tailstack.fields import INTERFACES

from ..errors import DesignError, IllPosedError, InfeasibleError, NotConvergedError, Problem
from ..estimation.checks import check_geometry
from ..geometry.arrays import Array
from ..laws import Drawn
from ..propagation.linear import ErrorModel, chain_of, effects_of_images, with_perfect_fiducials
from ..results import Finding
from ..results.digits import at_least, at_most, number
from ..system import Requirement, System, Way
from ..verification import UNITS
from .exact_law import Evaluation, evaluate_demand, exact_quantile, is_noise
from .half_widths import share_out
from .margin import aim_of, trials_for
from .problem import (
    Choice,
    PlacementProblem,
    QuantileConstraint,
    apply_choice,
    for_people,
    in_words,
    label_of,
    least_half_widths,
    present_choice,
)
from .program import QUIET, ConstraintRow, Parameters, Point, Program
from .shadow_prices import list_rules
from .solver import make_solver
from .terms import blind_half_widths, every_terms, is_singular, linearise_demand, scatter

LEADING = 3  # contributors named
NOISE = ("fiducial_noise:", "target_noise:")
SATISFIED = 1e-4  # slack of a rule, in scaled units, that is rounding
FAR_OFF = 1.25  # times the estimate: a check that finds more is not met by a limit that the estimate suggests
INTERIOR = 1e-3  # of a limit, beyond the least that can be kept: a search needs room
RELIEF = 0.1  # per cent of the quantile for 1 mm or 1 px: less is no cure


def explain_infeasible(program: Program, point: Point, parameters: Parameters | None = None) -> InfeasibleError:
    """The answer "there is none": at the choice of the smallest quantile, every free half-width at its smallest."""
    problem = program.problem
    choice = replace(program.split(point.x), half_width=least_half_widths(problem, program.present_width))
    evaluations = [evaluate_demand(problem, term, choice) for term in program.terms]
    k = int(np.argmax([item.exact_mm / item.limit for item in evaluations]))
    worst, term = evaluations[k], program.terms[k]
    requirement = term.demand.requirement
    tight = ", every free half-width at its smallest" if problem.half_widths else ""
    unit, aim = term.demand.measure.unit, f"the limit of {term.demand.limit_text}"
    if parameters is not None and parameters.log_limits[k] < np.log(requirement.limit * (1 - 1e-4)):
        margin = f"{at_most(float(np.exp(parameters.log_limits[k])))} {unit}"
        aim += f" (with the margin the Monte Carlo check needs: {margin})"
    shares = _shares(worst, requirement.error)
    own = aim_of(worst, term.demand, trials_for(len(problem.targets)))
    left = own if parameters is None else min(own, float(np.exp(parameters.log_limits[k])) / requirement.limit)
    enough = at_least(worst.exact_mm / left * (1 + INTERIOR))
    which = "the limit" if not term.demand.lost else "limit_mm of survive"
    raised = f"raise {which} to {enough} {unit} or more, which leaves the check its margin"
    if left * FAR_OFF < own:
        raised = f"the check finds {at_least(own / left, 2)} times what the estimate that guides the search says: "
        raised += "spread the fiducials or reduce the noise"
    cures = _cures(problem, term.demand, worst.model, requirement.limit * left)
    rules = sorted(list_rules(program, point, 1 / 2), key=lambda rule: -abs(rule.per_unit))  # that stand in the way
    cures += [rule.say_step(1.0, "it") for rule in rules[:2] if 100 * abs(rule.per_unit) > RELIEF]
    detail = (
        f"the smallest {term.demand.text.replace(' at target', ' found within the given freedom, at target')}, is "
        f"{worst.exact_mm:.4g} {unit}{tight}; {aim} lies below it. Share of the mean square there: {shares}"
    )
    hint = raised + "".join(f"; or {cure}" for cure in cures)
    return InfeasibleError(Problem("/optimise", "limit-out-of-reach", detail, hint))


def _shares(worst: Evaluation, error: str) -> str:
    """What makes up the mean square, largest first."""
    shares = share_out(worst.model, worst.mean_mm, error)
    whole = sum(shares.values())
    leading = sorted(shares.items(), key=lambda item: -item[1])[:LEADING]
    return ", ".join(f"{name} {100 * value / whole:.0f} %" for name, value in leading if value > 0.01 * whole)


def _cures(problem: PlacementProblem, demand: QuantileConstraint, model: ErrorModel, limit: float) -> list[str]:
    """By how much one contributor at a time would have to shrink; all of them together where none is enough."""
    own = [block.contributor for block in model.blocks]
    names = {name: "the image noise" if name.startswith(NOISE) else name for name in own}
    weight: dict[str, float] = {}
    for block in model.blocks:
        size = float(((block.gain(demand.requirement.error) * block.half_width) ** 2).sum())
        weight[names[block.contributor]] = weight.get(names[block.contributor], 0.0) + size
    cures = []
    for name in sorted(weight, key=lambda name: -weight[name])[:LEADING]:
        factor = _factor(model, demand, {block for block, group in names.items() if group == name}, limit)
        if factor is not None:
            words = f"every tolerance of {label_of(problem, name)} ({name})" if name in INTERFACES else name
            cures.append(f"bring {words} to {factor:.2g} of what it is there")
    if not cures:
        factor = _factor(model, demand, set(names), limit)
        if factor is None:
            cures.append("remove the known bias: it alone is over the limit")
        else:
            cures.append(f"bring every random contributor to {factor:.2g} of what it is there: none alone is enough")
    return cures


def _factor(model: ErrorModel, demand: QuantileConstraint, contributors: set[str], limit_mm: float) -> float | None:
    """Largest factor on these contributors with which the quantile is within the limit, rounded down; or None."""

    def quantile(factor: float) -> float:
        blocks = tuple(
            block.with_half_widths(block.half_width * factor) if block.contributor in contributors else block
            for block in model.blocks
        )
        return exact_quantile(replace(model, blocks=blocks), demand).value_mm

    if quantile(0.01) > limit_mm:
        return None
    largest = 0.999 if quantile(1.0) <= limit_mm else brentq(lambda x: quantile(x) - limit_mm, 0.01, 1.0, xtol=1e-4)
    digits = 2 - ceil(log10(largest))
    return float(np.floor(largest * 10**digits) / 10**digits)


def refuse_geometry(program: Program, relaxed: RelaxedRules) -> InfeasibleError | NotConvergedError:
    """Not even the rules of the layout could be met: which would have to give way."""
    if relaxed.are_kept:
        detail = "the rules of the layout can be met, but no start converged: no answer could be found"
        return NotConvergedError(Problem("/optimise", "none-converged", detail, "try more starts or another seed"))
    most = max(relaxed.slack, key=relaxed.slack.__getitem__)
    pointer = "/".join(("/optimise", *program.problem.distances.get(most, ())[:1]))
    named = []
    for kind, slack in relaxed.slack.items():
        if slack > SATISFIED:
            worst = max((value, row.text) for value, row in relaxed.violated if row.kind == kind)[1]
            named.append(f"{_in_its_unit(program.problem, kind, slack)} (worst: {worst})")
    detail = "no start met all rules of the layout at once; the smallest relaxation found: " + "; ".join(named)
    hint = "relax it as said, give the fiducials more room, or use fewer"
    return InfeasibleError(Problem(pointer, "layout-out-of-reach", detail, hint))


@dataclass(frozen=True, slots=True, eq=False)
class RelaxedRules:
    """The rules of a layout with as little slack as was found."""

    slack: dict[str, float]  # by the kind of rule, in its scaled units
    violated: list[tuple[float, ConstraintRow]]  # rows with what they lack
    x: Array  # variables there
    parameters: Parameters

    @property
    def are_kept(self) -> bool:
        return max(self.slack.values()) <= SATISFIED


def relax_rules(program: Program, points: list[tuple[Point, Parameters]]) -> RelaxedRules:
    """Elastic relaxation from some points: every rule (all rows of a kind) gets one slack >= 0, the sum of slacks is
    minimised (an exact penalty): rules that keep a slack are the ones that stand in each other's way, and its size
    says by how much."""
    nlp, rows = program.expressions, program.rows
    kinds = sorted({row.kind for row in rows} - {"quantile", "cost"})
    geometric = [k for k, row in enumerate(rows) if row.kind in kinds]
    slack = type(nlp["x"]).sym("slack", len(kinds))
    constraints: list[Any] = []
    for k in geometric:
        given = slack[kinds.index(rows[k].kind)]
        constraints += (
            [nlp["g"][k] + given] if rows[k].lower < rows[k].upper else [nlp["g"][k] + given, given - nlp["g"][k]]
        )
    count = nlp["x"].numel()
    solver = make_solver(
        "elastic",
        {"x": ca.vertcat(nlp["x"], slack), "p": nlp["p"], "f": ca.sum1(slack), "g": ca.vertcat(*constraints)},
        QUIET | {"ipopt.max_iter": 500, "ipopt.tol": 1e-6},
    )
    lower, upper = program.bounds("main")
    ends: list[tuple[float, Array, Parameters]] = []
    for point, parameters in points:
        result = solver(
            x0=np.concatenate([np.clip(point.x, lower, upper), np.ones(len(kinds))]),
            p=parameters.vector(program, "main"),
            lbx=np.concatenate([lower, np.zeros(len(kinds))]),
            ubx=np.concatenate([upper, np.full(len(kinds), np.inf)]),
            lbg=0.0,
            ubg=np.inf,
        )
        ends.append((float(result["f"]), result["x"].full().ravel(), parameters))
    _, x, parameters = min(ends, key=lambda end: end[0])  # there is always a start
    values = program.constraints(x[:count], parameters.vector(program, "main"))[1].full().ravel()
    lacking = [(float(max(rows[k].lower - values[k], values[k] - rows[k].upper)), rows[k]) for k in geometric]
    return RelaxedRules(dict(zip(kinds, map(float, x[count:]), strict=True)), lacking, x[:count], parameters)


def _in_its_unit(problem: PlacementProblem, kind: str, slack: float) -> str:
    """A rule as relaxed."""
    if kind in problem.distances:
        field, _, size = problem.distances[kind]
        return f"{field} {at_most(size * max(1 - slack, 0.0) ** 0.5 * (1 - INTERIOR))} instead of {size:g}"
    if kind == "image_gap":
        return f"shadows at {max(1 - slack, 0.0) ** 0.5:.0%} of the distance that the fiducials' diameter asks for"
    if kind == "stay" and problem.stay is not None:
        most = problem.stay.at_most_mm
        return f"at_most_mm {at_least(most * (1 + slack) ** 0.5 * (1 + INTERIOR))} instead of {most:g}"
    name = {"field": "the field of view", "region": "the regions", "keep_out": "the keep-out zones"}[kind]
    return f"{name} exceeded by {number(100 * slack, 2)} % of their size"


TARGET_CODES = ("same-source", "target-on-baseline", "target-too-far")
HARDLY = 0.005  # relative: a layout that can change the quantile by less hardly matters


def influence_of(problem: PlacementProblem) -> tuple[Finding, ...]:
    """Remarks on what can be gained.  Raises DesignError when nothing that is free acts on any limited error."""
    return *remark_levers(problem), *(_layouts(problem) if problem.places else ())


def remark_levers(problem: PlacementProblem, found: Choice | None = None) -> tuple[Finding, ...]:
    """What is free and does not matter, and where an answer put it.

    Raises DesignError when nothing that is free acts on any limited error.
    """
    terms = every_terms(problem)
    blind = blind_half_widths(problem, terms)
    acting = bool(problem.places) or not bool(blind.all())
    findings = []
    for k in np.flatnonzero(blind).tolist():
        message = f"{in_words(problem, k)} does not matter for any limit{_put(problem, k, found)}"
        findings.append(Finding("no-lever", "note", message, problem.half_widths[k].pointer))
    affine = [part.by_pivot for term in terms for part in (term.gains, term.bias, term.reconstructed)]
    for p, pivot in enumerate(problem.pivots):
        idle = not any(slopes[3 * p : 3 * p + 3].any() for slopes in affine)
        acting = acting or not idle
        if idle:
            message = f"the pivot of {label_of(problem, pivot.contributor)} does not act on any limited error"
            hint = "no rotation about it varies"
            findings.append(Finding("no-lever", "warning", f"{message}: {hint}", pivot.pointer))
    if not acting:
        detail = "nothing that is free acts on the limited error: " + "; ".join(item.message for item in findings)
        hint = "free something with a lever on the target, or limit the error at the tool"
        raise DesignError(Problem("/optimise", "no-influence", detail, hint))
    return tuple(findings)


def _put(problem: PlacementProblem, k: int, found: Choice | None) -> str:
    """Where an answer put a half-width that does not matter."""
    if found is None:
        return ""
    at = float(found.half_width[k])
    value, unit = for_people(problem, k, at)
    loosest = at >= problem.half_widths[k].maximum * (1 - 1e-9)
    return f": it is {'at its loosest, ' * loosest}{value:.4g} {unit}"


def _refuse_drawn_again(system: System, requirement: Requirement, index: int, level: Drawn) -> None:
    """Manufacture and assumed intrinsics come through the layout as one covariance, of what a unit or mounting holds.
    Raises DesignError where one of them is drawn again within the level."""
    for effect in effects_of_images(system):
        if not is_noise(effect) and not effect.drawn.is_held(level):
            detail = (
                f"{requirement.name} is read {requirement.risk.replace('_', ' ')}, and {effect.label} is drawn at each "
                f"{effect.drawn}: the optimiser takes it for what each {level} keeps"
            )
            cure = f"drawn: {level} at {effect.pointer}, or risk: pooled; score and verify take it as it is"
            raise DesignError(Problem(f"/requirements/{index}/risk", "drawn-again", detail, cure))


def refuse_incurable(problem: PlacementProblem) -> None:
    """Targets that a view does not see or the rays do not determine: no layout cures that.  A yield that the check
    could not prove: no design does.

    Raises DesignError, and IllPosedError with what :func:`~tailstack.estimation.checks.check_geometry` says of them,
    or of the whole geometry when no fiducial is free.
    """
    for index, requirement in enumerate(problem.system.requirements):
        provable = ((1 - requirement.confidence) / 2) ** (1 / UNITS)  # lower limit when every unit meets the limit
        if requirement in problem.requirements and (level := requirement.level) is not None:
            _refuse_drawn_again(problem.system, requirement, index, level)
            wanted = requirement.units_fraction or 0.0
            if wanted >= provable:
                detail = (
                    f"a yield of {100 * wanted:g} % cannot be verified: the check draws {UNITS} {level.plural}, "
                    f"and even if all of them meet the limit that proves {100 * provable:.2f} % at "
                    f"{100 * requirement.confidence:g} % confidence"
                )
                hint = f"min_yield: {np.floor(1e3 * (provable - 1e-3)) / 1e3:g} or less"
                raise DesignError(Problem(f"/requirements/{index}/min_yield", "yield-beyond-check", detail, hint))
    system = problem.system
    try:
        check_geometry(scatter(problem) if problem.places else system)
    except IllPosedError as error:
        left = [
            item
            for item in error.problems
            if not problem.places or item.code in TARGET_CODES or item.detail.startswith("target ")
        ]
        if left:
            raise IllPosedError(left) from None


def _layouts(problem: PlacementProblem) -> list[Finding]:
    """One remark for each requirement, at its worst target; requirements that limit the same share one."""
    findings: dict[str, Finding] = {}
    for requirement in problem.requirements:
        remarks = [
            remark
            for demand in problem.demands
            if demand.requirement.name == requirement.name and (remark := _layout(problem, demand)) is not None
        ]
        for worst in sorted(remarks, key=lambda remark: -(remark.value or 0.0))[:1]:
            findings.setdefault(worst.message, worst)
    return list(findings.values())


def _layout(problem: PlacementProblem, demand: QuantileConstraint) -> Finding | None:
    """How far the best imaginable layout could bring one quantile: to what perfect fiducials leave.

    The noise of the target's own images stays: it passes through the projections, which no layout changes.
    """
    choice = present_choice(problem)
    if is_singular(problem.system, problem.system.fiducials_mm):
        return None
    try:
        model, _ = linearise_demand(chain_of(apply_choice(problem, choice)), demand)
    except IllPosedError:  # as drawn, the layout has no answer: there is nothing to compare with
        return None
    now = exact_quantile(model, demand).value_mm
    floor = exact_quantile(with_perfect_fiducials(model, demand.measure.name), demand).value_mm
    gain = 1 - floor / now
    unit, what = demand.measure.unit, "the fiducials' own image noise and manufacturing errors"
    if any(block.effect.way is Way.SHARED for block in model.blocks) or model.imaged_bias_mm(demand.measure.name).any():
        what = "image noise, manufacturing errors and systematic errors of the images"
    return Finding(
        "layout-influence",
        "warning" if gain < HARDLY else "note",
        f"{demand.text} is {now:.4g} {unit}; with the tolerances as they are, placement can gain no more than what "
        f"{what} cost: down to {floor:.4g} {unit} ({-100 * gain:+.1f} %)",
        problem.places[0].pointer,
        floor,
        demand.requirement.limit,
    )
