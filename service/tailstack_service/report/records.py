"""The tolerance-budget report as a record, published as ``tailstack/report/1``, and two of them side by side, published
as ``tailstack/comparison/1``; every rendering is made from them.  And their first page: what decides, and what matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from tailstack.measures import MEASURE, POINT_ERRORS, MeasureName
from tailstack.results import Check, Finding, Optimisation, Provenance, Score, Verdict, Verification
from tailstack.results.digits import ESTIMATE, count_decimals, decimals_of, in_percent, length
from tailstack.results.radiostereometry import Profile, Radiostereometry
from tailstack.results.record import Published
from tailstack.results.verdicts import P95, STATED, checks_sentence, decisive_check
from tailstack.results.verdicts import headline_of as name_headline
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


@dataclass(frozen=True, slots=True)
class Headline:
    """The first page: what a project lead needs to know."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    """The verdict."""
    basis: str
    """What it rests on: first order or Monte Carlo."""
    sentence: str
    """The verdict with its numbers, in a sentence."""
    requirement: str | None
    """Requirement of the check that decides; null without requirement."""
    target: str
    """Target of the check that decides."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    value: float
    """The value that decides."""
    interval: tuple[float, float | None]
    """Its lower and upper end; a null upper end is not known."""
    limit: float | None
    """The limit; null without requirement."""
    matters: tuple[str, ...]
    """What matters most, at most three sentences."""
    error: MeasureName = "tcp"
    """Measure that decides, as a requirement names it: tcp (the error at the tool), ..."""
    min_yield: float | None = None
    """Fraction of units, or of mountings, that must keep the limit; null: the risk is pooled."""
    headline: str = ""
    """What the value is, in words: "P95 that 90 % of units keep"."""
    margin: float | None = None
    """Limit less the upper end of the interval; null where one of them is not known."""
    unit: str = ""
    """Unit of value, interval, limit and margin: mm, unless the measure has another."""
    risk: str = "per_unit"
    """Of what `min_yield` is a fraction: per_unit, per_mounting."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.unit or MEASURE[self.error].unit)
        high = self.interval[1]
        margin = None if high is None or self.limit is None else self.limit - high
        headline = self.headline or name_headline(self.quantile, self.min_yield, risk=self.risk)
        object.__setattr__(self, "headline", headline)
        object.__setattr__(self, "margin", margin)


@dataclass(frozen=True, slots=True)
class ErrorDistribution:
    """TCP error at one target: shares of shots by bins of the error's norm, sampled and by the first-order law."""

    target: str
    """Name of the target."""
    edges_mm: tuple[float, ...]
    """Edges of n bins of the error's norm, n + 1 numbers, mm."""
    sampled: tuple[float, ...] | None
    """Share of sampled shots in each bin; what is beyond the last edge is in none. Null: nothing was drawn."""
    first_order: tuple[float, ...]
    """Share of shots in each bin by the first-order law."""
    trials: int | None
    """Sampled shots; null: nothing was drawn."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """How far one half-width could go by itself, to first order, everything else as it is; and what it costs.

    Of the requirement on a quantile that decides at this target: one that is not kept before one that is, then the one
    that is nearest to its limit, or furthest beyond it; of all units together or of each unit by itself.
    """

    target: str
    """Name of the target."""
    contributor: str
    """Source of error: structure_connector, fiducial_manufacturing, ..."""
    component: str
    """Its component; all for a line of sources that are alike."""
    unit: str
    """Unit of the half-widths: deg, mm, px or N."""
    half_width: float
    """Half-width as it is, in `unit`."""
    requirement: str | None
    """Requirement that decides at this target; null: none on a quantile names this target."""
    status: Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]
    """spare: the half-width may grow; too wide: it must shrink; zero is not enough: nor would a perfect part do; no
    influence; no requirement."""
    at_limit: float | None
    """Half-width at which the requirement's quantile is at its limit, in `unit`; null where there is none. What missed
    fiducials add to a quantile is taken to stay in proportion; of a probability, shots that miss none count alone."""
    slack: float | None
    """`at_limit` less `half_width`, in `unit`: negative where it has to shrink; null where there is no such half-width.
    """
    cost: float | None
    """Cost by the price in the design's optimise section; null: no price."""
    smallest: float | None
    """Lower bound in the optimise section, in `unit`; null: none."""
    largest: float | None
    """Upper bound in the optimise section, in `unit`; null: none."""
    label: str = ""
    """What people call the source: the label that the design gives an interface, otherwise its name or words for it."""


@dataclass(frozen=True, slots=True)
class Reproduction:
    """How to get the same numbers again."""

    commands: tuple[str, ...]
    """Commands that give the same numbers, with the design of this record saved as design.yaml."""
    parts: tuple[str, ...]
    """What was computed: score, verification, optimisation."""
    seed: int | None
    """Seed of the check; null: nothing was drawn."""
    trials: int | None
    """Trials asked for; null: as many as the precision takes."""
    precision: float | None
    """Relative half-width asked for; null: the solver's own, or a number of trials."""
    max_trials: int | None
    """At most so many trials; null: their number was asked for, or nothing was drawn."""
    starts: int | None
    """Starts of the optimiser; null: as many as the design says."""
    statement: str
    """What the commands reproduce, and how exactly."""
    profile: Profile | None = None
    """Chapter for a field of work that was asked for; null: none."""


@dataclass(frozen=True, slots=True, repr=False)
class Report(Published):
    """A design, what was found about it, and how to find it again."""

    schema: Literal["tailstack/report/1"]
    title: str
    """Title of the report: the design's name."""
    headline: Headline
    """The first page: what a project lead needs to know."""
    score: Score
    """First order: bias, covariance, tail and budget."""
    verification: Verification | None
    """Monte Carlo check; null where it was not asked for."""
    optimisation: Optimisation | None
    """The optimised design; null where it was not asked for."""
    distributions: tuple[ErrorDistribution, ...]
    """TCP error at the targets with the largest P95, by bins."""
    allowances: tuple[Allowance, ...]
    """How far each half-width could go by itself, at the targets of `distributions` and at the one that decides."""
    design: dict[str, object]
    """The design document, complete."""
    reproduction: Reproduction
    """How to get the same numbers again."""
    provenance: Provenance
    radiostereometry: Radiostereometry | None = None
    """What ISO 16087 asks for, with the profile rsa; null: it was not asked for."""


@dataclass(frozen=True, slots=True)
class Difference:
    """P95 of the TCP error at one target that both designs have: second minus first.

    Both designs are drawn with the same random numbers, so that what they share cancels.
    """

    target: str
    """Name of the target that both designs have."""
    basis: Literal["first order", "Monte Carlo"]
    """What the P95 rest on."""
    first_p95_mm: float
    """P95 of the TCP error of the first design, mm: of the check, or first order where nothing was drawn."""
    second_p95_mm: float
    """P95 of the TCP error of the second design, mm."""
    difference_mm: float
    """Second minus first, mm."""
    interval_mm: tuple[float, float] | None
    """Confidence interval of the difference, from trials that both designs share, mm; null: first order."""
    confidence: float | None
    """Confidence of that interval, 0 to 1; null: first order."""
    conclusion: Literal["smaller", "larger", "not decided", "computed"]
    """Of the second: smaller or larger where the interval says so, otherwise not decided; computed: first order."""


@dataclass(frozen=True, slots=True)
class Change:
    """One field of the design document that differs."""

    pointer: str
    """JSON pointer into the second design; into the first for what was removed."""
    name: str
    """The same with names for numbers: views AP fiducial_noise_px."""
    unit: str
    """Unit of the field; empty where it has none."""
    kind: Literal["changed", "added", "removed"]
    """changed, added or removed."""
    first: str | None
    """Value in the first design as JSON; null where it was added."""
    second: str | None
    """Value in the second design as JSON; null where it was removed."""


@dataclass(frozen=True, slots=True)
class ComparisonHeadline:
    """The first page of a comparison."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    """The verdict on the second design."""
    sentence: str
    """The comparison in a sentence."""
    matters: tuple[str, ...]
    """What matters most, at most three sentences."""


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Published):
    """Two designs computed alike, with the same seed, and what sets them apart."""

    schema: Literal["tailstack/comparison/1"]
    title: str
    """Title of the comparison: the names of both designs."""
    headline: ComparisonHeadline
    """The first page of the comparison."""
    differences: tuple[Difference, ...]
    """P95 at every target that both designs have, largest of the second first."""
    compared_trials: int | None
    """Trials of each design, with the same random numbers, that the intervals come from; null: first order."""
    sections: int | None
    """Sections that those trials are cut into; null: first order."""
    only_first: tuple[str, ...]
    """Targets that only the first design has."""
    only_second: tuple[str, ...]
    """Targets that only the second design has."""
    changes: tuple[Change, ...]
    """Fields of the design document that differ."""
    changes_left_out: int
    """Further differing fields that are not listed."""
    first: Report
    """Report of the first design."""
    second: Report
    """Report of the second design."""
    names: tuple[str, str] | None = None
    """What both are called, such as versions of one design; null: the first and the second."""


# --- the first page ---------------------------------------------------------------------------------------


def headline_of(score: Score, verification: Verification | None, optimisation: Optimisation | None = None) -> Headline:
    """What the report opens with; Monte Carlo speaks where it was drawn."""
    worst, check = score.worst_target, verification
    estimated = (worst.name, worst.p95_mm, estimate_interval(score, worst.p95_mm))
    headline = _decide(score.verdict, estimated) if check is None else checked_headline(check)
    return replace(headline, matters=tuple(_list_what_matters(score, check, optimisation, headline.target)))


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
    there = (difference for difference in differences if difference.target == second.headline.target)
    return next(there, differences[0])


def _list_what_matters(
    score: Score, verification: Verification | None, optimisation: Optimisation | None, target: str
) -> list[str]:
    """At most three sentences: what dominates, how much is to spare, what to be careful about."""
    target_score = next((entry for entry in score.targets if entry.name == target), score.targets[0])
    checks = (score if verification is None else verification).verdict.checks
    decisive = decisive_check(checks)
    error = "tcp" if decisive is None else decisive.error
    decimals = decimals_of(checks, target_score.p95_mm)
    biased = bias_sentence(target_score, error, decimals)
    refuted = "" if verification is None or holds(score, verification) else _refutation(verification)
    sentences = [sentence for sentence in (biased, refuted) if sentence]
    # with one of these, what a tolerance saves is not what matters, or not known
    sources = [] if sentences else sources_of(target_score, error)
    if sources and sources[0].share > 0:
        sentences.append(dominant_sentence(sources[0], target_score, error, decimals))
    if decisive is not None:
        sentences.append(margin_sentence(decisive, sources, decimals))
    if optimisation is not None:
        sentences.append(_describe_optimum(optimisation, decimals))
    if not refuted:
        sentences.append(_caution(score, verification))
    return sentences[:3]


def _describe_optimum(optimisation: Optimisation, decimals: int) -> str:
    was, now = optimisation.cost_before, optimisation.cost_after
    cost = "" if was is None else f" at a cost of {now:.4g} instead of {was:.4g}"
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
