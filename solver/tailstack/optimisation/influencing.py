"""What the free variables can and cannot do, known before anything is solved.

The layout acts through image noise and manufacturing alone (a rigid installation error is absorbed exactly), a
half-width through its lever, a pivot through the rotations about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import DesignError, IllPosedError, Problem
from ..estimation.checks import check_geometry
from ..propagation.linear import LinearModel, linearise
from ..results import Finding
from ..runs import UNITS
from .problem import Demand, PlacementProblem, apply_choice, in_words, label_of, present_choice
from .promise import exact_quantile
from .terms import FIDUCIAL_BLOCKS, DemandTerms, blind_half_widths, is_flat, scattered, terms_of

TARGET_CODES = ("same-source", "target-on-baseline", "target-too-far")
HARDLY = 0.005  # relative: a layout that can change the quantile by less hardly matters


def influence_of(problem: PlacementProblem) -> tuple[Finding, ...]:
    """Remarks on what can be gained.  Raises DesignError when nothing that is free acts on any limited error."""
    terms = tuple(terms_of(problem, demand) for demand in problem.demands)
    blind = blind_half_widths(problem, terms)
    acting = bool(problem.places) or not bool(blind.all())
    findings = [
        Finding(
            "no-lever",
            "note",
            f"{in_words(problem, int(k))} does not move any limited error: it goes to its loosest value",
            problem.half_widths[int(k)].pointer,
        )
        for k in np.flatnonzero(blind)
    ]
    for pivot, idle in zip(problem.pivots, _idle_pivots(problem, terms), strict=True):
        acting = acting or not idle
        if idle:
            message = f"the pivot of {label_of(problem, pivot.contributor)} does not act on any limited error"
            hint = "no rotation about it varies"
            findings.append(Finding("no-lever", "warning", f"{message}: {hint}", pivot.pointer))
    for k, spacing in enumerate(problem.spacings):
        idle = not any(term.gains.by_spacing[k].any() for term in terms)
        acting = acting or not idle
        if idle:
            message = f"the spacing of the locators of {label_of(problem, spacing.contributor)} does not act"
            findings.append(Finding("no-lever", "warning", message, spacing.pointer))
    if not acting:
        raise DesignError(
            Problem(
                "/optimise",
                "no-influence",
                "nothing that is free acts on the limited error: " + "; ".join(item.message for item in findings),
                "free something with a lever on the target, or limit another error (tcp instead of localisation)",
            )
        )
    if problem.places:
        findings += _layouts(problem)
    return tuple(findings)


def refuse_incurable(problem: PlacementProblem) -> None:
    """Targets that a view does not see or the rays do not determine: no layout cures that.  A yield that the check
    could not prove: no design does.

    Raises DesignError, and IllPosedError with what :func:`~tailstack.estimation.checks.check_geometry` says of them,
    or of the whole geometry when no fiducial is free.
    """
    for index, requirement in enumerate(problem.system.requirements):
        provable = ((1 - requirement.confidence) / 2) ** (1 / UNITS)  # lower limit when every unit meets the limit
        if requirement in problem.requirements and requirement.risk == "per_unit":
            wanted = Demand(requirement, problem.system.targets[0]).fraction
            if wanted >= provable:
                raise DesignError(
                    Problem(
                        f"/requirements/{index}/min_yield",
                        "yield-beyond-check",
                        f"a yield of {100 * wanted:g} % cannot be verified: the check draws {UNITS} units, and even "
                        f"if all of them meet the limit that proves {100 * provable:.2f} % at "
                        f"{100 * requirement.confidence:g} % confidence",
                        f"min_yield: {np.floor(1e3 * (provable - 1e-3)) / 1e3:g} or less",
                    )
                )
    system = problem.system
    try:
        check_geometry(scattered(problem) if problem.places else system)
    except IllPosedError as error:
        left = [
            item for item in error.problems
            if not problem.places or item.code in TARGET_CODES or item.detail.startswith("target ")
        ]  # fmt: skip
        if left:
            raise IllPosedError(left) from None


def _idle_pivots(problem: PlacementProblem, terms: tuple[DemandTerms, ...]) -> list[bool]:
    return [
        not any(
            part.by_pivot[3 * p : 3 * p + 3].any()
            for term in terms
            for part in (term.gains, term.bias, term.reconstructed)
        )
        for p in range(len(problem.pivots))
    ]


def _layouts(problem: PlacementProblem) -> list[Finding]:
    """One remark for each requirement, at its worst target."""
    found = []
    for requirement in problem.requirements:
        remarks = [
            remark
            for demand in problem.demands
            if demand.requirement.name == requirement.name and (remark := _layout(problem, demand)) is not None
        ]
        found += sorted(remarks, key=lambda remark: -(remark.value or 0.0))[:1]
    return found


def _layout(problem: PlacementProblem, demand: Demand) -> Finding | None:
    """How far the best imaginable layout could bring one quantile: to what perfect fiducials leave.

    The noise of the target's own images stays: it passes through the projections, which no layout changes.
    """
    choice = present_choice(problem)
    if is_flat(problem.system.fiducials_mm):
        return None
    try:
        model = linearise(apply_choice(problem, choice), demand.target)
    except IllPosedError:  # as drawn, the layout has no answer: there is nothing to compare with
        return None
    now = exact_quantile(model, demand).value_mm
    floor = exact_quantile(with_perfect_fiducials(model), demand).value_mm
    gain = 1 - floor / now
    return Finding(
        "layout-influence",
        "warning" if gain < HARDLY else "note",
        f"{demand.text} is {now:.4g} mm; with the tolerances as they are, placement can gain no more than what the "
        f"fiducials' own image noise and manufacturing errors cost: down to {floor:.4g} mm ({-100 * gain:+.1f} %)",
        problem.places[0].pointer,
        floor,
        demand.requirement.limit_mm,
    )


def with_perfect_fiducials(model: LinearModel) -> LinearModel:
    """The linear model without image noise and manufacturing errors of the fiducials."""
    return replace(model, blocks=tuple(b for b in model.blocks if not b.contributor.startswith(FIDUCIAL_BLOCKS)))
