"""What a design is asked for, by itself and by the policy, and what of it was not judged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from tailstack.design import Design
from tailstack.system import System

from .case import Case, Remark
from .policy_document import Rules
from .records import GateNumber, GateRequirement, Unjudged

CVAR_QUANTILE = 0.95
MOST_NAMES = 3


def requirements_of(design: Design, system: System, rules: Rules) -> tuple[GateRequirement, ...]:
    """Every requirement of the design, then every limit of the policy, whether its rule is off or not."""
    every = tuple(target.name for target in system.targets)
    own = {requirement.name for requirement in design.document.requirements}
    stated = []
    for requirement in system.requirements:
        if requirement.name not in own:  # a limit of the policy, which follows below
            continue
        rule: Literal["p95", "per-unit-yield"] = "per-unit-yield" if requirement.risk == "per_unit" else "p95"
        severity = (rules.per_unit_yield if requirement.risk == "per_unit" else rules.p95).severity
        stated.append(
            GateRequirement(
                name=requirement.name,
                origin="design",
                rule=rule,
                severity=severity,
                error="tcp" if requirement.error == "tcp" else "localisation",
                quantile=requirement.quantile,
                limit_mm=requirement.limit_mm,
                min_yield=requirement.min_yield,
                confidence=requirement.confidence,
                targets=requirement.targets,
            )
        )
    return (*stated, *_limits_of(rules, every))


def _limits_of(rules: Rules, targets: tuple[str, ...]) -> list[GateRequirement]:
    """Limits of the policy, each on the error at the tool of every target."""
    p95, cvar, beyond, units = rules.p95, rules.cvar, rules.exceedance, rules.per_unit_yield
    found = [
        ("p95", p95.severity, 0.95, p95.limit_mm, None, p95.confidence),
        ("cvar", cvar.severity, CVAR_QUANTILE, cvar.limit_mm, None, cvar.confidence),
        ("exceedance", beyond.severity, 1 - (beyond.max_probability or 0.0), beyond.limit_mm, None, beyond.confidence),
        ("per-unit-yield", units.severity, 0.95, units.limit_mm, units.min_yield, units.confidence),
    ]
    return [
        GateRequirement(rule, "policy", rule, severity, "tcp", quantile, limit, required, confidence, targets)
        for rule, severity, quantile, limit, required, confidence in found
        if limit is not None
    ]


def unjudged(
    requirements: Sequence[GateRequirement],
    numbers: Sequence[GateNumber],
    targets: Sequence[str],
    design_class: str | None,
) -> tuple[Unjudged, ...]:
    """Each requirement at each target that there is no number of, and each target that no requirement is about."""
    judged = {(number.requirement, number.target) for number in numbers}
    found = []
    for entry in requirements:
        if entry.severity == "off":
            where = "in the policy" if design_class is None else f"for class {design_class} of the policy"
            reason = f"rule {entry.rule} is off {where}"
        else:
            reason = "it has no number"
        found += [
            Unjudged(entry.name, target, entry.rule, reason)
            for target in entry.targets
            if entry.severity == "off" or (entry.name, target) not in judged
        ]
    asked = {target for entry in requirements for target in entry.targets}
    return (
        *found,
        *(
            Unjudged(None, target, None, "no requirement of the design and no limit of the policy is about it")
            for target in targets
            if target not in asked
        ),
    )


def requirements_not_judged(case: Case) -> list[Remark]:
    """not-judged"""
    remarks = []
    for entry in case.requirements:
        left = [one for one in case.not_judged if (one.requirement, one.rule) == (entry.name, entry.rule)]
        if entry.origin == "design" and left:
            message = (
                f"{entry.name} ({in_words(entry)}) was not judged {at(one.target for one in left)}: {left[0].reason}"
            )
            remarks.append(Remark(pointer_of(case.design, entry), message))
    bare = [one for one in case.not_judged if one.requirement is None]
    if bare and case.requirements:  # otherwise nothing was judged at all, which not-evaluated says
        message = f"nothing was held against the error {at(one.target for one in bare)}: {bare[0].reason}"
        remarks.append(Remark("/targets", message, note=True))
    return remarks


def names_that_match(case: Case) -> list[Remark]:
    """class-by-name"""
    if case.class_of_name is None:
        return []
    found = case.class_of_name
    judged = "the policy's rules" if case.design_class is None else f"those of class {case.design_class}"
    message = (
        f"the name of this design matches {found.pattern!r} of class {found.name}, which does not say by_name: true: "
        f"it was judged by {judged}; give the class patterns of files, or by_name: true if authors may choose"
    )
    return [Remark("/name", message)]


def in_words(entry: GateRequirement) -> str:
    """What is asked, in one phrase."""
    if entry.rule == "cvar":
        return f"CVaR95 of the {entry.error} error within {entry.limit_mm:g} mm"
    what = f"P{100 * entry.quantile:g} of the {entry.error} error within {entry.limit_mm:g} mm"
    return what if entry.min_yield is None else f"{what} for {100 * entry.min_yield:g} % of installed units"


def at(targets: Iterable[str]) -> str:
    """``at target a, b, c and 2 more``."""
    names = list(targets)
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"at target{'s' if len(names) > 1 else ''} {', '.join(names[:MOST_NAMES])}{more}"


def pointer_of(design: Design, entry: GateRequirement, field: str = "") -> str:
    """Where a requirement, or a field that it states, stands in the design document."""
    for index, requirement in enumerate(design.document.requirements):
        if entry.origin == "design" and requirement.name == entry.name:
            return f"/requirements/{index}" + (f"/{field}" if field in requirement.model_fields_set else "")
    return "/requirements" if design.document.requirements else ""
