"""The first page in words: verdict, limit, P95 with its interval, and what matters most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tailstack.measures import POINT_ERRORS
from tailstack.results import Check, Finding, Optimisation, Score, Verdict, Verification
from tailstack.results.digits import ESTIMATE, count_decimals, decimals_of, in_percent, length
from tailstack.results.verdicts import P95, STATED, checks_sentence, decisive_check
from tailstack.statistic import STATISTIC

from ..rendering.sentences import (
    bias_sentence,
    dominant_sentence,
    estimate_interval,
    holds,
    largest_sentence,
    margin_sentence,
    sources_of,
    trust_sentence,
)
from .records import Difference, Headline, Report


def headline_of(score: Score, verification: Verification | None, optimisation: Optimisation | None = None) -> Headline:
    """What the report opens with; Monte Carlo speaks where it was drawn."""
    headline = _decide(score.verdict, _first_order(score)) if verification is None else checked_headline(verification)
    decisive = decisive_check((score if verification is None else verification).verdict.checks)
    return replace(headline, matters=tuple(what_matters(score, verification, optimisation, headline.target, decisive)))


def checked_headline(verification: Verification) -> Headline:
    """What a check by itself opens with."""
    worst = max(verification.targets, key=lambda target: target.p95_mm)
    return _decide(verification.verdict, (worst.name, worst.p95_mm, worst.p95_interval_mm))


def _decide(verdict: Verdict, largest: tuple[str, float, tuple[float, float | None]]) -> Headline:
    """The check that decides; without a requirement the ``largest`` P95: target, value, interval."""
    decisive = decisive_check(verdict.checks)
    if decisive is None:
        target, value, interval = largest
        sentence = largest_sentence(target, value, interval)
        return Headline(verdict.status, verdict.basis, sentence, None, target, P95, value, interval, None, ())
    alike = ("requirement", "target", "quantile", "value", "interval", "limit", "error", "min_yield", "unit")
    return Headline(
        status=verdict.status,
        basis=verdict.basis,
        sentence=checks_sentence(verdict.checks),
        matters=(),
        risk="per_unit" if decisive.min_yield is None else decisive.risk,
        headline="" if decisive.statistic == "quantile" else decisive.headline,
        **{name: getattr(decisive, name) for name in alike},
    )


def tightest_check(checks: Sequence[Check], target: str) -> Check | None:
    """The requirement that decides at a target, of those on a quantile of an error that its budget is of."""
    here = [check for check in checks if check.target == target and check.error in POINT_ERRORS]
    return decisive_check([check for check in here if STATISTIC[check.statistic].by_quantile])


def decided_difference(second: Report, differences: Sequence[Difference]) -> Difference:
    """The difference at the target that decides the second design's verdict, of which the first page speaks; where the
    first design does not have it, the one at the second's largest P95."""
    return next(
        (difference for difference in differences if difference.target == second.headline.target), differences[0]
    )


def _first_order(score: Score) -> tuple[str, float, tuple[float, float | None]]:
    """Target, value and interval of the largest P95."""
    first = max(score.targets, key=lambda target: target.p95_mm)
    return first.name, first.p95_mm, estimate_interval(score, first.p95_mm)


def what_matters(
    score: Score,
    verification: Verification | None,
    optimisation: Optimisation | None,
    target: str,
    decisive: Check | None,
) -> list[str]:
    """At most three sentences: what dominates, how much is to spare, what to be careful about."""
    target_score = next((entry for entry in score.targets if entry.name == target), score.targets[0])
    sentences = []
    error = "tcp" if decisive is None else decisive.error
    sources = sources_of(target_score, error)
    checks = (score if verification is None else verification).verdict.checks
    decimals = decimals_of(checks, target_score.p95_mm)
    biased = bias_sentence(target_score, error, decimals)
    if biased:
        sentences.append(biased)
    refuted = None if verification is None or holds(score, verification) else _refutation(verification)
    if refuted is not None:
        sentences.append(refuted)
    if biased or refuted is not None:
        sources = []  # what a tolerance saves is not what matters, or not known
    if sources and sources[0].share > 0:
        sentences.append(dominant_sentence(sources[0], target_score, error, decimals))
    if decisive is not None:
        sentences.append(margin_sentence(decisive, sources, decimals))
    if optimisation is not None:
        sentences.append(_describe_optimum(optimisation, decimals))
    if refuted is None:
        sentences.append(_caution(score, verification))
    return sentences[:3]


def _describe_optimum(optimisation: Optimisation, decimals: int) -> str:
    cost = (
        ""
        if optimisation.cost_before is None
        else f" at a cost of {optimisation.cost_after:.4g} instead of {optimisation.cost_before:.4g}"
    )
    missed = list(dict.fromkeys(check.requirement for check in optimisation.others if check.status != "pass"))
    but = f", and does not keep {', '.join(missed)}, which it was not asked to" if missed else ""
    after = f"{length(optimisation.p95_after_mm, decimals)} mm"
    return f"The optimised design has an estimated P95 of {after}{cost}{but}; it is described below."


def _refutation(verification: Verification) -> str:
    """That the budget is not to be gone by."""
    gap = verification.first_order_ratio - 1
    return (
        f"The estimate does not hold here: its P95 is {in_percent(abs(gap))} {'below' if gap < 0 else 'above'} the "
        "simulated one. Budget and slack are estimates: do not go by them."
    )


def _caution(score: Score, verification: Verification | None) -> str:
    verdict = score.verdict if verification is None else verification.verdict
    notable = [finding for finding in verdict.findings if finding.rule not in STATED and finding.severity != "note"]
    if notable:
        first: Finding = sorted(notable, key=lambda finding: finding.severity != "error")[0]
        more = f" ({len(notable) - 1} more remark{'s' if len(notable) > 2 else ''} below)" if len(notable) > 1 else ""
        return f"Remark: {first.message}{more}."
    if verification is None:
        return f"This is an estimate, no simulation: {trust_sentence(score.validity)}."
    gap = verification.first_order_ratio - 1
    side = "below" if gap < 0 else "above"
    return (
        f"Estimate and simulation agree: the estimated P95 is {in_percent(abs(gap), 1)} {side} the simulated one, so "
        "what the budget says of each tolerance can be trusted."
    )


def comparison_decimals(first: Report, second: Report) -> int:
    """Decimals of the lengths of a comparison: as many as the finer of the two answers has."""
    judged = [report.verification or report.score for report in (first, second)]
    largest = max(target.p95_mm for answer in judged for target in answer.targets)
    return decimals_of([check for answer in judged for check in answer.verdict.checks], largest)


def difference_decimals(difference: Difference, decimals: int) -> int:
    """Decimals of a difference, which pairs of trials know better than either P95; never fewer than these have."""
    if difference.interval_mm is None:
        return max(decimals, count_decimals(difference.difference_mm))
    low, high = difference.interval_mm
    return max(decimals, count_decimals((high - low) / 2 / ESTIMATE))
