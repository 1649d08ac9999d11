"""From intervals and limits to a verdict: pass, fail or inconclusive, and the findings behind it."""

from __future__ import annotations

from math import isfinite
from typing import Literal

from .laws import level_of
from .results import ERRORS, Check, Finding, Interval, Verdict
from .results.digits import decimals_of, in_percent, length
from .results.verdicts import UNBOUNDED, decisive_check, name_all, name_basis
from .system import Requirement

Status = Literal["pass", "fail", "inconclusive"]


def decide(interval: Interval, limit: float) -> Status:
    """``pass`` only if the upper end is within the limit, ``fail`` only if the lower end is above it."""
    low, high = interval
    if high <= limit:
        return "pass"
    return "fail" if low > limit else "inconclusive"


def judge(
    requirement: Requirement,
    target: str,
    value: float,
    interval: Interval,
    yield_fraction: float | None = None,
    *,
    missed: bool = False,
    open_because: str = "",
) -> Check:
    """A requirement held against the interval of the value that it limits.

    Pooled, the value is the quantile over everything.  Per unit, it is what the required fraction of installed units
    keep their own quantile within; ``yield_fraction`` of units keep the limit.
    """
    low, high = interval
    allowed = requirement.limit_probability  # of errors beyond the limit
    limit = requirement.limit if allowed is None else allowed
    return Check(
        requirement=requirement.name,
        target=target,
        error=requirement.error,
        risk=requirement.risk,
        quantile=requirement.quantile,
        value=value,
        interval=(low, high if isfinite(high) else None),
        limit=limit,
        yield_fraction=yield_fraction,
        min_yield=requirement.units_fraction,
        status=decide(interval, limit),
        missed=missed,
        open_because=open_because,
        statistic=requirement.statistic,
        n=requirement.n,
        beyond=None if allowed is None else requirement.limit,
        ids=requirement.ids,
    )


def say_why_open(check: Check) -> str:
    """Why an estimate leaves a limit open."""
    close = check.interval[1] is not None
    far = "how far this estimate is from a simulation is not known"
    return check.open_because or ("too close to say by estimate" if close else far)


def conclude(checks: tuple[Check, ...], findings: tuple[Finding, ...], basis: str) -> Verdict:
    """Overall status: one failure fails, one open question leaves it open."""
    stated = tuple(_finding(check, basis) for check in checks if check.status != "pass")
    worst = decisive_check(checks)
    return Verdict("no requirement" if worst is None else worst.status, basis, checks, stated + findings)


def _finding(check: Check, basis: str) -> Finding:
    low, high = check.interval
    decimals = decimals_of((check,))
    ends = "no upper end is known" if high is None else f"between {length(low, decimals)} and {length(high, decimals)}"
    value = check.name_value(ERRORS[check.error])
    what = (
        f"{value} is {length(check.value, decimals)} {check.unit} by {name_basis(basis)} ({ends}), "
        f"limit {check.limit:g} {check.unit}"
    )
    if check.yield_fraction is not None:
        what += f" ({in_percent(check.yield_fraction, 2)} of {name_all(check.risk)} meet it)"
    estimated = basis.startswith("first order")
    if check.status == "fail":
        closing = ""
    elif check.open_because and (not estimated or check.open_because == UNBOUNDED):
        closing = f": {check.open_because}"
    elif estimated:
        closing = f": {say_why_open(check)}; run `tailstack verify`"
    elif (level := level_of(check.risk)) is not None:
        closing = f": too close to say, and the number of {level.plural} drawn is fixed; change the limit or the design"
    else:
        closing = ": too close to say; ask for more trials or a tighter `--precision`"
    return Finding(
        rule="requirement-failed" if check.status == "fail" else "requirement-inconclusive",
        severity="error" if check.status == "fail" else "warning",
        message=f"{check.requirement}, target {check.target}: {what}{closing}",
        pointer="/requirements",
        value=check.value,
        limit=check.limit,
    )
