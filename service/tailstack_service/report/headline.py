"""The first page in words: verdict, limit, P95 with its interval, and what matters most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tailstack.results import Check, Contributor, Finding, Optimisation, Score, TargetScore, Verdict, Verification
from tailstack.results import headline_of as words
from tailstack.scoring import P95

from ..rendering.score import shares_of, source_name
from ..rendering.verdict import urgency
from .records import Headline

STATED = ("requirement-failed", "requirement-inconclusive")  # findings that repeat the verdict


def headline_of(score: Score, verification: Verification | None, optimisation: Optimisation | None = None) -> Headline:
    """What the report opens with; Monte Carlo speaks where it was drawn."""
    found = _decide(score.verdict, _first_order(score)) if verification is None else checked_headline(verification)
    decisive = decisive_check((score if verification is None else verification).verdict.checks)
    return replace(found, matters=tuple(what_matters(score, verification, optimisation, found.target, decisive)))


def checked_headline(verification: Verification) -> Headline:
    """What a check by itself opens with."""
    worst = max(verification.targets, key=lambda target: target.p95_mm)
    return _decide(verification.verdict, (worst.name, worst.p95_mm, worst.p95_interval_mm))


def _decide(verdict: Verdict, largest: tuple[str, float, tuple[float, float | None]]) -> Headline:
    """The check that decides; without a requirement the ``largest`` P95: target, value, interval."""
    decisive = decisive_check(verdict.checks)
    if decisive is None:
        target, value, interval = largest
        sentence = f"No requirement is stated. P95 of the TCP error at {target} is {value:.3f} mm {_ends(interval)}."
        return Headline(verdict.status, verdict.basis, sentence, None, target, P95, value, interval, None, ())
    return Headline(
        status=verdict.status,
        basis=verdict.basis,
        sentence=verdict_sentence(decisive),
        requirement=decisive.requirement,
        target=decisive.target,
        quantile=decisive.quantile,
        value_mm=decisive.value_mm,
        interval_mm=decisive.interval_mm,
        limit_mm=decisive.limit_mm,
        matters=(),
        error=decisive.error,
        min_yield=decisive.min_yield,
    )


def decisive_check(checks: Sequence[Check]) -> Check | None:
    """The check that the verdict rests on: the worst status, then the largest value over its limit."""
    return min(checks, key=urgency, default=None)


def tightest_check(checks: Sequence[Check], target: str) -> Check | None:
    """The pooled requirement at a target that is nearest to its limit, or furthest beyond it."""
    judged = [check for check in checks if check.target == target and check.risk == "pooled"]
    return max(judged, key=lambda check: check.value_mm / check.limit_mm, default=None)


def verdict_sentence(check: Check, who: str = "The design") -> str:
    """A check as a sentence with its numbers."""
    error = check.error.replace("tcp", "TCP")
    what = words(check.quantile, check.min_yield, f"the {error} error at {check.target}")
    number = f"{check.value_mm:.3f} mm {_ends(check.interval_mm)}"
    units = "" if check.yield_fraction is None else f"; {check.yield_fraction:.1%} of units meet it"
    if check.status == "pass":
        kept = f"within the limit of {check.limit_mm:g} mm{units}"
        return f"{who} keeps {check.requirement}: {what} is {number}, {kept}."
    if check.status == "fail":
        beyond = f"above the limit of {check.limit_mm:g} mm{units}"
        return f"{who} misses {check.requirement}: {what} is {number}, {beyond}."
    open_end = f"the interval holds the limit of {check.limit_mm:g} mm{units}"
    return f"Undecided for {check.requirement}: {what} is {number}; {open_end}."


def _ends(interval: tuple[float, float | None]) -> str:
    low, high = interval
    return f"({low:.3f} to {'an unknown end' if high is None else f'{high:.3f} mm'})"


def _first_order(score: Score) -> tuple[str, float, tuple[float, float | None]]:
    """Target, value and interval of the largest P95."""
    first = max(score.targets, key=lambda target: target.p95_mm)
    percent = score.validity.expected_error_percent
    if percent is None:
        return first.name, first.p95_mm, (0.0, None)
    return first.name, first.p95_mm, (first.p95_mm / (1 + percent / 100), first.p95_mm * (1 + percent / 100))


def what_matters(
    score: Score,
    verification: Verification | None,
    optimisation: Optimisation | None,
    target: str,
    decisive: Check | None,
) -> list[str]:
    """At most three sentences: what dominates, what the margin is worth, what to be careful about."""
    found = next((entry for entry in score.targets if entry.name == target), score.targets[0])
    sentences = []
    error = "tcp" if decisive is None else decisive.error
    shares = shares_of(found, error)
    if shares and shares[0][1] > 0:
        sentences.append(_dominant(*shares[0], found, error))
    if decisive is not None:
        sentences.append(_margin(decisive, [line for line, _ in shares]))
    if optimisation is not None:
        sentences.append(_describe_optimum(optimisation))
    sentences.append(_caution(score, verification))
    return sentences[:3]


def _dominant(line: Contributor, share: float, target: TargetScore, error: str) -> str:
    if error != "tcp":
        return (
            f"The largest contributor to the error of localisation at {target.name} is {budget_line(line)}, with "
            f"{share:.0%} of its variance (first order); what acts behind it (connector_flange, hand-eye, execution) "
            "does not count."
        )
    return (
        f"The largest contributor is {budget_line(line)}, with {line.variance_share:.0%} of the variance; were it "
        f"perfect, P95 at {target.name} would be {line.p95_without_mm:.3f} mm instead of {target.p95_mm:.3f} mm (first "
        "order)."
    )


def _margin(check: Check, lines: Sequence[Contributor]) -> str:
    what, spare = check.headline, check.margin_mm
    if spare is None:
        return f"How far {what} is from its limit is not known: first order does not hold here."
    if spare >= 0:
        first = f"{spare:.3f} mm ({spare / check.limit_mm:.0%} of the limit) is left above the interval of {what}"
    else:
        first = (
            f"{what} has to come down by {-spare:.3f} mm ({-spare / check.value_mm:.0%}) to be within, interval and all"
        )
    if check.error != "tcp":  # the budget's slopes are of the error at the tool
        return first + "."
    steps = [
        (line.dp95_per_unit * line.half_width / 10, line)
        for line in lines
        if line.dp95_per_unit is not None and line.half_width
    ]
    if not steps:
        return first + "."
    gain, line = max(steps, key=lambda step: step[0])
    pooled = "" if check.min_yield is None else " over all units"
    return f"{first}; a tenth less of {budget_line(line)} is worth {gain:.3f} mm of P95{pooled}."


def _describe_optimum(found: Optimisation) -> str:
    cost = (
        "" if found.cost_before is None else f" at a cost of {found.cost_after:.4g} instead of {found.cost_before:.4g}"
    )
    missed = list(dict.fromkeys(check.requirement for check in found.others if check.status != "pass"))
    but = f", and does not keep {', '.join(missed)}, which it was not asked to" if missed else ""
    return f"The optimised design has a P95 of {found.p95_after_mm:.3f} mm{cost}{but}; it is described below."


def _caution(score: Score, verification: Verification | None) -> str:
    verdict = score.verdict if verification is None else verification.verdict
    notable = [finding for finding in verdict.findings if finding.rule not in STATED and finding.severity != "note"]
    if notable:
        first: Finding = sorted(notable, key=lambda finding: finding.severity != "error")[0]
        more = f" ({len(notable) - 1} more remark{'s' if len(notable) > 2 else ''} below)" if len(notable) > 1 else ""
        return f"Remark: {first.message}{more}."
    if verification is None:
        return f"Only first order was computed: {score.validity.statement}."
    gap = verification.first_order_ratio - 1
    return (
        f"First order and Monte Carlo agree: the first-order P95 is {abs(gap):.1%} {'below' if gap < 0 else 'above'} "
        "the verified one, so the budget's sensitivities can be trusted."
    )


def budget_line(line: Contributor) -> str:
    """A line of the budget in words, with its half-width."""
    sign = "σ" if line.unit == "px" else "±"  # image noise has a standard deviation, no half-width
    width = "" if line.half_width is None else f" ({sign} {line.half_width:.3g} {line.unit})"
    return source_name(line) + width
