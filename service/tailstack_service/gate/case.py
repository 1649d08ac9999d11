"""One design before the gate: what it is asked for, the numbers held against that, and what was not judged.

A limit of the policy on a quantile is added to the design as a requirement of its own, so that the score and the
Monte Carlo check decide it with their intervals like every other; an exceedance of probability p beyond a limit is the
quantile 1 - p at that limit.  Only CVaR is held against its limit here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import inf

from tailstack.design import Design, design_to_data, load_design
from tailstack.propagation.validity import error_percent
from tailstack.results import ERRORS, Check, Score, Verification
from tailstack.results.verdicts import UNBOUNDED, is_of_all_shots, name_all
from tailstack.statistic import STATISTIC, write_text
from tailstack.verdict import decide

from .policy import Rules
from .reading import Remark
from .records import GatedDesign, GateNumber, GateRequirement, GateTarget, Unjudged

CVAR_LIKE = 0.99  # first order errs in the mean of the worst 5 % as in this quantile (docs/method.md, section 4)
CVAR_MISSED = "how far the estimate of it is from a simulation is not known where fiducials are missed"
MOST_NAMES = 3


@dataclass(frozen=True, slots=True)
class LimitComparison:
    """A requirement at one target, and the number that was held against it."""

    requirement: GateRequirement
    number: GateNumber


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A design that could be computed."""

    file: str
    names: tuple[str, ...]  # of the file, that patterns see
    earlier: tuple[str, ...]  # of the file, that the baseline may have for it
    design: Design
    rules: Rules
    score: Score
    verification: Verification | None
    comparisons: tuple[LimitComparison, ...]
    targets: tuple[GateTarget, ...]
    requirements: tuple[GateRequirement, ...]  # of the design and of the policy, judged or not
    not_judged: tuple[Unjudged, ...]
    design_class: str | None
    compared: bool  # there is a baseline
    baseline: GatedDesign | None  # what it says of this design
    max_regression_percent: float


# --- what a design is asked for ---------------------------------------------------------------------


def list_policy_limits(design: Design, rules: Rules) -> dict[str, GateRequirement]:
    """Limits of the policy on the error at the tool, by names that no requirement of the design has.

    Their targets are known when the design was scored: all of them.
    """
    p95, cvar, beyond, units = rules.p95, rules.cvar, rules.exceedance, rules.per_unit_yield
    limits = {}
    for rule, entry, quantile, min_yield in (
        ("p95", p95, 0.95, None),
        ("cvar", cvar, 0.95, None),
        ("exceedance", beyond, 1 - (beyond.max_probability or 0.0), None),
        ("per-unit-yield", units, 0.95, units.min_yield),
    ):
        if entry.limit_mm is not None:
            name = f"policy {rule}"
            while any(requirement.name == name for requirement in design.document.requirements):
                name += "'"
            limits[name] = GateRequirement(
                rule, "policy", rule, entry.severity, "tcp", quantile, entry.limit_mm, min_yield, entry.confidence, ()
            )
    return limits


def add_policy_limits(design: Design, limits: Mapping[str, GateRequirement]) -> Design:
    """The design with the policy's limits among its requirements, those that are off and CVaR left out.

    Raises DesignError, LimitError.
    """
    data = design_to_data(design, inline=True)
    for name, limit in limits.items():
        if limit.rule != "cvar" and limit.severity != "off":
            entry = {"name": name, "quantile": limit.quantile, "limit_mm": limit.limit}
            units = {} if limit.min_yield is None else {"risk": "per_unit", "min_yield": limit.min_yield}
            data.setdefault("requirements", []).append({**entry, **units, "confidence": limit.confidence})
    return load_design(data)


def list_requirements(
    design: Design, rules: Rules, limits: Mapping[str, GateRequirement], score: Score
) -> dict[str, GateRequirement]:
    """Every requirement of the design, then every limit of the policy, whether its rule is off or not.

    They go by their names in the design with the policy's limits, which was scored.
    """
    stated = {}
    for entry in design.document.requirements:
        units, row = entry.risk != "pooled", STATISTIC[entry.statistic]
        rule = "per-unit-yield" if units else "p95" if row.of_law is None else "statistic"
        stated[entry.name] = GateRequirement(
            name=entry.name,
            origin="design",
            rule=rule,
            severity=getattr(rules, rule.replace("-", "_")).severity,
            error=entry.error,
            quantile=entry.pooled_quantile,
            limit=entry.limit,
            min_yield=entry.min_yield,
            **({"risk": entry.risk} if units else {}),
            confidence=entry.confidence,
            targets=tuple(check.target for check in score.verdict.checks if check.requirement == entry.name),
            statistic=entry.statistic,
            n=entry.n,
            ids=tuple(entry.ids),
        )
    every = tuple(target.name for target in score.targets)
    return {**stated, **{name: replace(limit, targets=every) for name, limit in limits.items()}}


# --- the numbers held against that -------------------------------------------------------------------


def compare_numbers(
    score: Score, verification: Verification | None, requirements: Mapping[str, GateRequirement], looks: int = 1
) -> tuple[LimitComparison, ...]:
    """Every number with its limit and status; Monte Carlo where it was drawn.  Rules that are off judge nothing.

    requirements: of :func:`list_requirements`.  looks: that the check was planned with.
    """
    checks = (score if verification is None else verification).verdict.checks
    stated = [(requirements[check.requirement], check) for check in checks]
    # Quantiles share the run's confidence, the largest that is asked for; a yield has its own.
    largest = max((requirement.confidence for requirement, _ in stated), default=0.95)
    comparisons = []
    for requirement, check in stated:
        if requirement.severity != "off":
            own = requirement.confidence if check.risk != "pooled" else largest
            rate = None if verification is None else _error_rate(own)
            known = {field.name: getattr(check, field.name) for field in fields(Check)}
            number = GateNumber(**(known | {"requirement": requirement.name}), rule=requirement.rule, error_rate=rate)
            comparisons.append(LimitComparison(requirement, number))
    for requirement in requirements.values():
        if requirement.rule == "cvar" and requirement.severity != "off":
            comparisons += _compare_cvar(score, verification, requirement, looks)
    return tuple(comparisons)


def _error_rate(confidence: float) -> float:
    return round((1 - confidence) / 2, 12)


def _compare_cvar(
    score: Score, verification: Verification | None, requirement: GateRequirement, looks: int
) -> list[LimitComparison]:
    estimates: list[tuple[str, float, tuple[float, float]]] = []
    confidence, limit = requirement.confidence, requirement.limit
    if verification is None:
        why = CVAR_MISSED if is_of_all_shots(score.verdict) else ""
        ratio = inf if why else 1 + error_percent(score.validity, CVAR_LIKE) / 100
        for target in score.targets:
            mean = target.cvar95_mm
            estimates.append((target.name, mean, (0.0, inf) if ratio == inf else (mean / ratio, mean * ratio)))
    else:
        from tailstack.montecarlo.estimators import cvar_interval

        is_open = verification.losses is not None and verification.losses.has_open_means
        why = UNBOUNDED if is_open else ""
        for drawn in verification.targets:
            values = (drawn.p95_mm, drawn.cvar95_mm, drawn.worst_mm)
            ends = cvar_interval(*values, verification.trials, confidence, looks, is_open)
            estimates.append((drawn.name, drawn.cvar95_mm, ends))
    rate = None if verification is None else _error_rate(confidence)
    comparisons = []
    for name, value, (low, high) in estimates:
        interval = (low, high if high != inf else None)
        status = decide((low, high), limit)
        number = GateNumber(
            "cvar", name, "tcp", "pooled", requirement.quantile, value, interval, limit, None, None, status,
            open_because=why, rule="cvar", error_rate=rate,
        )  # fmt: skip
        comparisons.append(LimitComparison(requirement, number))
    return comparisons


def is_near_limit(
    numbers: Iterable[GateNumber], guard_band_percent: float, waived_up_to: Callable[[GateNumber], Sequence[float]]
) -> bool:
    """Whether first order is too close to a limit to be believed, or cannot decide by itself.

    waived_up_to: values up to which waivers accept a number that fails; each is a limit like any other.
    """
    band = guard_band_percent / 100
    for number in numbers:
        if number.status == "inconclusive":
            return True
        waived = waived_up_to(number) if number.status == "fail" else ()
        if waived and number.min_yield is not None:
            return True  # to first order no waiver covers a yield
        if any(abs(number.value - limit) <= band * limit for limit in (number.limit, *waived)):
            return True
    return False


def bound_yield(fraction: float) -> float:
    """Lower Clopper-Pearson limit (97.5 %) of a yield met by ``fraction`` of the units that a check draws."""
    from tailstack.montecarlo.estimators import bound_share
    from tailstack.verification import UNITS

    return bound_share(min(round(fraction * UNITS), UNITS), UNITS, 0.025)[0]


# --- what was not judged -----------------------------------------------------------------------------


def list_unjudged(
    requirements: Iterable[GateRequirement],
    comparisons: Iterable[LimitComparison],
    targets: Sequence[str],
    design_class: str | None,
) -> tuple[Unjudged, ...]:
    """Each requirement at each target that there is no number of, and each target that no requirement is about."""
    judged = {(comparison.requirement, comparison.number.target) for comparison in comparisons}
    where = "in the policy" if design_class is None else f"for class {design_class} of the policy"
    unjudged: list[Unjudged] = []
    covered: set[str] = set()
    for entry in requirements:
        covered.update(entry.targets)
        reason = f"rule {entry.rule} is off {where}" if entry.severity == "off" else "it has no number"
        unjudged += [
            Unjudged(entry.name, target, entry.rule, reason)
            for target in entry.targets
            if (entry, target) not in judged
        ]
    reason = "no requirement of the design and no limit of the policy is about it"
    return (*unjudged, *(Unjudged(None, target, None, reason) for target in targets if target not in covered))


def find_unjudged(case: Case) -> Iterator[Remark]:
    """Rule not-judged: requirements of the design, and targets, that nothing was held against."""
    for entry in case.requirements:
        left = [
            unjudged
            for unjudged in case.not_judged
            if (unjudged.requirement, unjudged.rule) == (entry.name, entry.rule)
        ]
        if entry.origin == "design" and left:
            where = name_targets(unjudged.target for unjudged in left)
            message = f"{entry.name} ({describe_requirement(entry)}) was not judged {where}: {left[0].reason}"
            yield Remark(point_at_requirement(case.design, entry), message)
    bare = [unjudged for unjudged in case.not_judged if unjudged.requirement is None]
    if bare and case.requirements:  # otherwise nothing was judged at all, which not-evaluated says
        where = name_targets(unjudged.target for unjudged in bare)
        yield Remark("/targets", f"nothing was held against the error {where}: {bare[0].reason}", note=True)


# --- in words, and at their places -------------------------------------------------------------------


def describe_requirement(entry: GateRequirement) -> str:
    """What is asked, in one phrase."""
    if entry.rule == "cvar":
        return f"the mean of the worst 5 % (CVaR95) of {ERRORS[entry.error]} within {entry.limit:g} mm"
    row, limit = STATISTIC[entry.statistic], f"{entry.limit:g} {entry.unit}"
    name = write_text(row.headline, entry.quantile, entry.n, limit, error=ERRORS[entry.error])
    what = f"{name} within " + (f"{1 - entry.quantile:.6g}" if row.unit else limit)
    return what if entry.min_yield is None else f"{what} for {100 * entry.min_yield:g} % of {name_all(entry.risk)}"


def name_targets(targets: Iterable[str]) -> str:
    """``at target a, b, c and 2 more``."""
    names = list(targets)
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"at target{'s' if len(names) > 1 else ''} {', '.join(names[:MOST_NAMES])}{more}"


def point_at_requirement(design: Design, entry: GateRequirement | None, field: str = "") -> str:
    """Where a requirement, or a field that it states, stands in the design document; None: where it should."""
    for index, requirement in enumerate(design.document.requirements):
        if entry is not None and entry.origin == "design" and requirement.name == entry.name:
            return f"/requirements/{index}" + (f"/{field}" if field in requirement.model_fields_set else "")
    return "/requirements" if design.document.requirements else ""
