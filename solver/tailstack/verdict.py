"""From intervals and limits to a verdict: pass, fail or inconclusive, and the findings behind it."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from typing import Literal

from .results import Check, Finding, Interval, Verdict
from .system import Requirement

Status = Literal["pass", "fail", "inconclusive"]


def decide(interval_mm: Interval, limit_mm: float) -> Status:
    """``pass`` only if the upper end is within the limit, ``fail`` only if the lower end is above it."""
    low, high = interval_mm
    if high <= limit_mm:
        return "pass"
    return "fail" if low > limit_mm else "inconclusive"


def decide_yield(interval: Interval, required: float) -> Status:
    """The same for a yield, which must be *at least* what is required."""
    low, high = interval
    if low >= required:
        return "pass"
    return "fail" if high < required else "inconclusive"


def check_pooled(requirement: Requirement, target: str, value_mm: float, interval_mm: Interval) -> Check:
    low, high = interval_mm
    return Check(
        requirement=requirement.name,
        target=target,
        error=requirement.error,
        risk="pooled",
        quantile=requirement.quantile,
        value_mm=value_mm,
        interval_mm=(low, high if isfinite(high) else None),
        limit_mm=requirement.limit_mm,
        yield_fraction=None,
        min_yield=None,
        status=decide(interval_mm, requirement.limit_mm),
    )


def check_per_unit(
    requirement: Requirement, target: str, value_mm: float, interval_mm: Interval, fraction: float, interval: Interval
) -> Check:
    """Per-unit risk: ``fraction`` of installed units meets the limit; without ``min_yield`` the quantile's share of
    units must (95 % of units for a P95)."""
    required = requirement.quantile if requirement.min_yield is None else requirement.min_yield
    return replace(
        check_pooled(requirement, target, value_mm, interval_mm),
        risk="per_unit",
        yield_fraction=fraction,
        min_yield=required,
        status=decide_yield(interval, required),
    )


def conclude(checks: tuple[Check, ...], findings: tuple[Finding, ...], basis: str) -> Verdict:
    """Overall status: one failure fails, one open question leaves it open."""
    stated = tuple(_finding(check, basis) for check in checks if check.status != "pass")
    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    if not checks:
        status = "no requirement"
    elif any(check.status == "fail" for check in checks):
        status = "fail"
    elif any(check.status == "inconclusive" for check in checks):
        status = "inconclusive"
    else:
        status = "pass"
    return Verdict(status=status, basis=basis, checks=checks, findings=stated + findings)


def _finding(check: Check, basis: str) -> Finding:
    if check.risk == "per_unit":
        what = (
            f"{check.yield_fraction:.2%} of installed units meet {check.limit_mm:g} mm, {check.min_yield:.2%} required"
        )
    else:
        low, high = check.interval_mm
        ends = f"[{low:.4g}, {high:.4g}]" if high is not None else "(no upper end is known)"
        what = (
            f"P{100 * check.quantile:g} of the {check.error} error is {check.value_mm:.4g} mm "
            f"{ends}, limit {check.limit_mm:g} mm"
        )
    if check.status == "fail":
        closing = ""
    elif basis == "first order":
        closing = ": first order cannot decide; run `tailstack verify`"
    else:
        closing = ": the interval holds the limit; ask for more trials or a tighter `--precision`"
    return Finding(
        rule="requirement-failed" if check.status == "fail" else "requirement-inconclusive",
        severity="error" if check.status == "fail" else "warning",
        message=f"{check.requirement}, target {check.target}: {what}{closing}",
        pointer="/requirements",
        value=check.yield_fraction if check.risk == "per_unit" else check.value_mm,
        limit=check.min_yield if check.risk == "per_unit" else check.limit_mm,
    )
