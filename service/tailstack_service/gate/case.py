"""One design before the gate: what it is asked for, the numbers held against that, and what was not judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from tailstack.design import Design
from tailstack.design.write import design_to_data
from tailstack.propagation.validity import error_percent
from tailstack.results import Check, Score, Verification
from tailstack.system import System
from tailstack.verdict import decide

from .policy import ClassOfName, Rules
from .records import GatedDesign, GateNumber, GateRequirement, GateTarget, Unjudged


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A design that could be computed."""

    file: str
    design: Design
    rules: Rules
    score: Score
    verification: Verification | None
    numbers: tuple[GateNumber, ...]  # what was held against limits
    added: Mapping[str, str]  # requirements that the policy added: name -> rule
    targets: tuple[GateTarget, ...]
    requirements: tuple[GateRequirement, ...]  # of the design and of the policy, judged or not
    not_judged: tuple[Unjudged, ...]
    design_class: str | None
    class_of_name: ClassOfName | None
    compared: bool  # there is a baseline
    baseline: GatedDesign | None  # what it says of this design
    max_regression_percent: float


@dataclass(frozen=True, slots=True)
class Remark:
    """What a rule says about a design."""

    pointer: str  # into the design document
    message: str
    value: float | None = None
    limit: float | None = None
    target: str | None = None
    bound: float | None = None  # the end of the value's interval that a waiver must cover; None: the value itself
    about: str | None = None  # the rule whose waivers cover it, where that is another one
    unbounded: bool = False  # no end of the interval is known: no waiver covers it
    note: bool = False  # said for information, whatever the rule's severity


CVAR_QUANTILE = 0.95
MOST_NAMES = 3


def list_requirements(design: Design, system: System, rules: Rules) -> tuple[GateRequirement, ...]:
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
    return (*stated, *_list_policy_limits(rules, every))


def _list_policy_limits(rules: Rules, targets: tuple[str, ...]) -> list[GateRequirement]:
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


def list_unjudged(
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


def find_unjudged(case: Case) -> list[Remark]:
    """not-judged"""
    remarks = []
    for entry in case.requirements:
        left = [one for one in case.not_judged if (one.requirement, one.rule) == (entry.name, entry.rule)]
        if entry.origin == "design" and left:
            where = name_targets(one.target for one in left)
            message = f"{entry.name} ({describe_requirement(entry)}) was not judged {where}: {left[0].reason}"
            remarks.append(Remark(point_at_requirement(case.design, entry), message))
    bare = [one for one in case.not_judged if one.requirement is None]
    if bare and case.requirements:  # otherwise nothing was judged at all, which not-evaluated says
        message = f"nothing was held against the error {name_targets(one.target for one in bare)}: {bare[0].reason}"
        remarks.append(Remark("/targets", message, note=True))
    return remarks


def find_class_names(case: Case) -> list[Remark]:
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


def describe_requirement(entry: GateRequirement) -> str:
    """What is asked, in one phrase."""
    if entry.rule == "cvar":
        return f"CVaR95 of the {entry.error} error within {entry.limit_mm:g} mm"
    what = f"P{100 * entry.quantile:g} of the {entry.error} error within {entry.limit_mm:g} mm"
    return what if entry.min_yield is None else f"{what} for {100 * entry.min_yield:g} % of installed units"


def name_targets(targets: Iterable[str]) -> str:
    """``at target a, b, c and 2 more``."""
    names = list(targets)
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"at target{'s' if len(names) > 1 else ''} {', '.join(names[:MOST_NAMES])}{more}"


def point_at_requirement(design: Design, entry: GateRequirement, field: str = "") -> str:
    """Where a requirement, or a field that it states, stands in the design document."""
    for index, requirement in enumerate(design.document.requirements):
        if entry.origin == "design" and requirement.name == entry.name:
            return f"/requirements/{index}" + (f"/{field}" if field in requirement.model_fields_set else "")
    return "/requirements" if design.document.requirements else ""


CVAR_LIKE = 0.99  # first order errs in the mean of the worst 5 % as in this quantile (docs/method.md, section 4)
UNITS = 2048  # installed units that a check draws for a per-unit requirement (tailstack.verification)


def add_policy_limits(design: Design, rules: Rules) -> tuple[dict[str, Any], dict[str, str]]:
    """The design's document with the policy's limits among its requirements, and which rule each of these is of."""
    wanted: list[tuple[str, dict[str, Any]]] = []
    p95, beyond, units = rules.p95, rules.exceedance, rules.per_unit_yield
    if p95.limit_mm is not None and p95.severity != "off":
        wanted.append(("p95", {"limit_mm": p95.limit_mm, "confidence": p95.confidence}))
    if beyond.limit_mm is not None and beyond.max_probability is not None and beyond.severity != "off":
        quantile = 1 - beyond.max_probability
        wanted.append(
            ("exceedance", {"limit_mm": beyond.limit_mm, "quantile": quantile, "confidence": beyond.confidence})
        )
    if units.limit_mm is not None and units.min_yield is not None and units.severity != "off":
        entry = {"limit_mm": units.limit_mm, "min_yield": units.min_yield, "confidence": units.confidence}
        wanted.append(("per-unit-yield", {**entry, "risk": "per_unit"}))
    data = design_to_data(design, inline=True)
    taken = {requirement.name for requirement in design.document.requirements}
    added = {}
    for rule, entry in wanted:
        name = f"policy {rule}"
        while name in taken:
            name += "'"
        taken.add(name)
        added[name] = rule
        data.setdefault("requirements", []).append({"name": name, **entry})
    return data, added


def collect_numbers(
    score: Score,
    verification: Verification | None,
    rules: Rules,
    added: Mapping[str, str],
    held: Design,
    looks: int = 1,
) -> tuple[GateNumber, ...]:
    """Every number with its limit and status; Monte Carlo where it was drawn.  Rules that are off judge nothing.

    held: the design with the policy's limits among its requirements.  looks: that the check was planned with.
    """
    severity = {
        "p95": rules.p95.severity,
        "exceedance": rules.exceedance.severity,
        "per-unit-yield": rules.per_unit_yield.severity,
    }
    checks = (score if verification is None else verification).verdict.checks
    rate = _error_rates(held, verification)
    numbers = [_make_number(check, added, rate(check)) for check in checks]
    return (
        *(number for number in numbers if severity[number.rule] != "off"),
        *_make_cvar_numbers(score, verification, rules, looks),
    )


def _error_rates(held: Design, verification: Verification | None) -> Callable[[Check], float | None]:
    """Of each check: quantiles share the run's confidence, the largest that is asked for; a yield has its own."""
    confidence = {entry.name: entry.confidence for entry in held.document.requirements}
    largest = max(confidence.values(), default=0.95)

    def rate(check: Check) -> float | None:
        if verification is None:
            return None
        own = confidence[check.requirement] if check.risk == "per_unit" else largest
        return round((1 - own) / 2, 12)

    return rate


def _make_number(check: Check, added: Mapping[str, str], rate: float | None) -> GateNumber:
    rule = added.get(check.requirement)
    name = check.requirement if rule is None else rule
    interval = check.interval_mm
    if check.yield_fraction is not None and check.min_yield is not None:
        return GateNumber(
            "per-unit-yield", name, check.target, "fraction", check.yield_fraction, None, check.min_yield, check.status,
            rate, check.headline, check.value_mm, interval, check.limit_mm,
        )  # fmt: skip
    return GateNumber(
        rule or "p95", name, check.target, "mm", check.value_mm, interval, check.limit_mm, check.status, rate,
        check.headline,
    )  # fmt: skip


def _make_cvar_numbers(score: Score, verification: Verification | None, rules: Rules, looks: int) -> list[GateNumber]:
    limit = rules.cvar.limit_mm
    if limit is None or rules.cvar.severity == "off":
        return []
    found: list[tuple[str, float, tuple[float, float]]] = []
    if verification is None:
        for target in score.targets:
            value = target.cvar95_mm
            ratio = 1 + error_percent(score.validity, CVAR_LIKE) / 100
            found.append((target.name, value, (value / ratio, value * ratio)))
    else:
        from tailstack.montecarlo.estimators import cvar_interval

        for estimate in verification.targets:
            ends = cvar_interval(
                estimate.p95_mm,
                estimate.cvar95_mm,
                estimate.worst_mm,
                verification.trials,
                rules.cvar.confidence,
                looks,
            )
            found.append((estimate.name, estimate.cvar95_mm, ends))
    rate = None if verification is None else round((1 - rules.cvar.confidence) / 2, 12)
    return [
        GateNumber(
            "cvar", "cvar", name, "mm", value, (low, high if high != float("inf") else None), limit,
            decide((low, high), limit), rate, "CVaR95",
        )
        for name, value, (low, high) in found
    ]  # fmt: skip


def is_near_limit(
    numbers: tuple[GateNumber, ...],
    guard_band_percent: float,
    accepted: Callable[[GateNumber], Sequence[float]],
) -> bool:
    """Whether first order is too close to a limit to be believed, or cannot decide by itself.

    accepted: up to where waivers accept a number that fails; such a value is a limit like any other.
    """
    band = guard_band_percent / 100
    for number in numbers:
        if number.status == "inconclusive":
            return True
        waived = accepted(number) if number.status == "fail" else ()
        if waived and number.unit == "fraction":
            return True  # to first order no waiver covers a yield
        if number.value_mm is None or number.limit_mm is None:
            continue  # of a yield that an earlier version judged by itself
        if any(abs(number.value_mm - limit) <= band * limit for limit in (number.limit_mm, *waived)):
            return True
    return False


def bound_yield(fraction: float) -> float:
    """Lower Clopper-Pearson limit (97.5 %) of a yield met by ``fraction`` of the units that a check draws."""
    from scipy.special import betaincinv

    met = min(round(fraction * UNITS), UNITS)
    return float(betaincinv(met, UNITS - met + 1, 0.025)) if met > 0 else 0.0
