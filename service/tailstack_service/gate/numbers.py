"""The numbers of a design that stand against limits: the design's own requirements and the policy's.

A limit of the policy on a quantile is added to the design as a requirement of its own, so that the score and the
Monte Carlo check decide it with their intervals like every other; an exceedance of probability p beyond a limit is the
quantile 1 - p at that limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tailstack.design import Design
from tailstack.design.loading import design_to_data
from tailstack.propagation.validity import error_percent
from tailstack.results import Check, Score, Verification
from tailstack.verdict import decide

from .policy_document import Rules
from .records import GateNumber

CVAR_LIKE = 0.99  # first order errs in the mean of the worst 5 % as in this quantile (docs/method.md, section 4)
UNITS = 2048  # installed units that a check draws for a per-unit requirement (tailstack.verifying)


def with_policy(design: Design, rules: Rules) -> tuple[dict[str, Any], dict[str, str]]:
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


def numbers_of(
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
    rate = _error_rate(held, verification)
    numbers = [_number(check, added, rate(check)) for check in checks]
    return (
        *(number for number in numbers if severity[number.rule] != "off"),
        *_cvar_numbers(score, verification, rules, looks),
    )


def _error_rate(held: Design, verification: Verification | None) -> Callable[[Check], float | None]:
    """Of each check: quantiles share the run's confidence, the largest that is asked for; a yield has its own."""
    confidence = {entry.name: entry.confidence for entry in held.document.requirements}
    largest = max(confidence.values(), default=0.95)

    def rate(check: Check) -> float | None:
        if verification is None:
            return None
        own = confidence[check.requirement] if check.risk == "per_unit" else largest
        return round((1 - own) / 2, 12)

    return rate


def _number(check: Check, added: Mapping[str, str], rate: float | None) -> GateNumber:
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


def _cvar_numbers(score: Score, verification: Verification | None, rules: Rules, looks: int) -> list[GateNumber]:
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
        from tailstack.montecarlo.sequential import cvar_interval

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


def near_a_limit(
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


def yield_floor(fraction: float) -> float:
    """Lower Clopper-Pearson limit (97.5 %) of a yield met by ``fraction`` of the units that a check draws."""
    from scipy.special import betaincinv

    met = min(round(fraction * UNITS), UNITS)
    return float(betaincinv(met, UNITS - met + 1, 0.025)) if met > 0 else 0.0
