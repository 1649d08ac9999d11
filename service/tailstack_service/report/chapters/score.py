"""The chapters of a first-order score."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import ERRORS, Score, TargetEstimate, TargetScore
from tailstack.results import headline_of as headline_words
from tailstack.results.digits import in_percent, signed_decimal
from tailstack.results.score import source_name, targets_table, views_table
from tailstack.results.verdicts import checks_table, findings_table, name_basis, requirements_table
from tailstack.scoring import P95

from ...rendering.sentences import losses_sentence, units_sentence
from ..blocks import Block, Bullets, Document, Facts, Figure, KeyNumber, Listing, Paragraph, Section, tone_of
from ..charts import PHONE, Scaled, draw_scale, draw_shares, draw_without
from ..headline import headline_of
from ..records import Allowance, Headline
from .tables import budget_with_slack, not_included, provenance_facts

LISTED = 4  # tolerances in a sentence
AT_BOUND = 1e-6  # relative: a half-width that near its bound is at it
DETAILED = 3  # targets whose budget has pictures and a table of its own, largest P95 first


def score_document(score: Score, sha256: str) -> Document:
    """A score by itself: no picture of the layout, which is not in its record."""
    headline = headline_of(score, None)
    command = "tailstack score design.yaml --json"
    return Document(
        kind="Estimated error",
        title=score.provenance.design_name,
        tone=tone_of(headline.status),
        status=headline.status,
        sentence=headline.sentence,
        numbers=key_numbers(headline, score.decimals),
        matters=headline.matters,
        figures=(headline_figure(headline, score.targets, score.decimals),),
        requirements=requirements_table(score.verdict),
        sections=(
            Section("Error and requirements", error_blocks(score)),
            Section("Budget", budget_blocks(score)),
            Section("Method and assumptions", method_blocks(score), reader="auditor"),
            Section("What is not included", (not_included(score.provenance),), reader="auditor"),
            Section(
                "Reproduction",
                (Listing(command), Paragraph("With the design of the hash named above.")),
                reader="auditor",
            ),
        ),
        provenance=provenance_facts(score.provenance, sha256, score.schema),
    )


def key_numbers(headline: Headline, decimals: int) -> tuple[KeyNumber, ...]:
    """What decides, its limit and the margin, in large type."""
    low, high = headline.interval_mm
    end = "unknown" if high is None else f"{high:.{decimals}f}"
    ends = f"{low:.{decimals}f} to {end} mm, {name_basis(headline.basis)}"
    error = "the error" if headline.error == "tcp" else ERRORS[headline.error]
    label = f"{headline.headline} of {error}" if headline.min_yield is None else headline.headline
    numbers = [KeyNumber(label, f"{headline.value_mm:.{decimals}f} mm", ends)]
    if headline.limit_mm is None:
        return (*numbers, KeyNumber("Limit", "none", "no requirement is stated"))
    numbers.append(KeyNumber("Limit", f"{headline.limit_mm:g} mm", f"{headline.requirement}, target {headline.target}"))
    margin = headline.margin_mm
    if margin is None:
        return (*numbers, KeyNumber("Margin", "not known", "the interval has no upper end"))
    share = in_percent(abs(margin) / headline.limit_mm)
    detail = f"{share} of the limit is left above the interval" if margin >= 0 else f"the interval ends {share} beyond"
    return (*numbers, KeyNumber("Margin", f"{signed_decimal(margin, decimals)} mm".replace("-", "−"), detail))


def headline_figure(headline: Headline, targets: Sequence[TargetScore | TargetEstimate], decimals: int) -> Figure:
    """What decides, its interval and the limit on one scale.

    targets: what the headline was found with, first order or Monte Carlo; mean and CVaR beside the value are those of
    its own distribution.  What units keep has another, of which these are not known.
    """
    shown = Scaled(
        headline.target, headline.value_mm, headline.interval_mm, headline.limit_mm, _beside(headline, targets),
        headline.headline, headline.error, decimals,
    )  # fmt: skip
    size = f"Size of {ERRORS[headline.error]}, target {headline.target}"
    caption = f"{size}, by {name_basis(headline.basis)}: the bar is the interval."
    return Figure("headline", draw_scale(shown, "headline"), caption, draw_scale(shown, "headline-narrow", PHONE))


def _beside(headline: Headline, targets: Sequence[TargetScore | TargetEstimate]) -> tuple[tuple[str, float], ...]:
    found = next((target for target in targets if target.name == headline.target), None)
    if found is None or headline.min_yield is not None:
        return ()
    metric = found if headline.error == "tcp" else found.localisation
    mean = ("mean", metric.mean_norm_mm)
    return (mean, ("CVaR95", metric.cvar95_mm)) if headline.quantile == P95 else (mean,)


def error_blocks(score: Score) -> tuple[Block, ...]:
    blocks: list[Block] = [targets_table(score)]
    if score.verdict.checks:
        blocks.append(checks_table(score.verdict))
    if score.verdict.findings:
        blocks.append(findings_table(score.verdict.findings))
    if score.views:
        blocks.append(views_table(score.views))
    if score.losses:
        blocks.append(losses_listed(score))
    return tuple(blocks)


def losses_listed(score: Score) -> Bullets:
    checks = score.verdict.checks
    return Bullets(tuple(f"If fiducials are lost: {losses_sentence(line, checks)}" for line in score.losses))


def largest_targets(score: Score) -> list[TargetScore]:
    return sorted(score.targets, key=lambda target: target.p95_mm, reverse=True)[:DETAILED]


def budget_blocks(score: Score, allowances: Sequence[Allowance] = ()) -> tuple[Block, ...]:
    """What binds, then pictures and table of the budget of the targets with the largest P95."""
    blocks: list[Block] = [Bullets(lines)] if (lines := what_binds(score, allowances)) else []
    if len(score.targets) > DETAILED:
        blocks.append(
            Paragraph(
                f"Shown are the {DETAILED} targets with the largest P95 of {len(score.targets)}; the record has all."
            )
        )
    for k, target in enumerate(largest_targets(score)):
        suffix = "" if k == 0 else f"-{k + 1}"
        limit = target.limit_mm
        blocks += [
            Figure(
                f"waterfall{suffix}",
                draw_shares(target.contributors, target.name, f"waterfall{suffix}"),
                f"Target {target.name}: share of the variance of each contributor, each bar beginning where the one "
                "above ends.",
            ),
            Figure(
                f"without{suffix}",
                draw_without(
                    target.contributors, target.name, target.p95_mm, limit, f"without{suffix}", score.decimals
                ),
                f"Target {target.name}: the estimated P95 if one contributor were perfect and all others as they are.",
            ),
            budget_with_slack(target, "Budget" if k == 0 else f"Budget {k + 1}", allowances, score.decimals),
        ]
        if target.worst_vertex:
            blocks.append(Paragraph(f"Bounded components stand at their worst ends: {', '.join(target.worst_vertex)}."))
    return tuple(blocks)


def what_binds(score: Score, allowances: Sequence[Allowance]) -> tuple[str, ...]:
    """The requirement nearest to its limit, the tolerances that it leaves no room, those at their bounds."""
    said, decimals = [], score.decimals
    tightest = max(score.verdict.checks, key=lambda check: check.value_mm / check.limit_mm, default=None)
    if tightest is not None:
        error = f"{ERRORS[tightest.error]} at {tightest.target}"
        what = headline_words(tightest.quantile, tightest.min_yield, error)
        said.append(
            f"Nearest to its limit is {tightest.requirement}: {what}, an estimated {tightest.value_mm:.{decimals}f} mm "
            f"against {tightest.limit_mm:g} mm."
        )
        named = {entry.target: None for entry in allowances if entry.status != "no requirement"}
        target = tightest.target if tightest.target in named else next(iter(named), "")
        of_target = [entry for entry in allowances if entry.target == target and entry.half_width > 0]
        alone = [entry for entry in of_target if entry.status == "too wide"]
        if alone:
            listed = "; ".join(
                f"{allowance_name(entry)} to ± {entry.at_limit:.3g} {entry.unit}" for entry in alone[:LISTED]
            )
            said.append(
                f"Any one of these alone brings {of_target[0].requirement} to its limit: {listed}{_more(alone)}."
            )
        elif of_target and all(entry.status == "zero is not enough" for entry in of_target):
            said.append(
                f"No tolerance alone brings {of_target[0].requirement} to its limit, not even at zero: several have to "
                "shrink."
            )
        spare = [entry for entry in of_target if entry.status == "spare" and entry.slack is not None]
        spare.sort(key=lambda entry: (entry.slack or 0.0) / entry.half_width)
        if spare:
            listed = "; ".join(
                f"{allowance_name(entry)} from ± {entry.half_width:.3g} to {entry.at_limit:.3g} {entry.unit}"
                for entry in spare[:LISTED]
            )
            asked = spare[0].requirement
            said.append(f"Least room that {asked} leaves at {target}, one at a time: {listed}{_more(spare)}.")
    bounds = [words for entry in allowances if (words := _at_bound(entry))]
    if bounds:
        said.append(f"At a bound of the optimise section: {'; '.join(dict.fromkeys(bounds))}.")
    return tuple(said)


def _more(entries: Sequence[Allowance]) -> str:
    return f"; and {len(entries) - LISTED} more" if len(entries) > LISTED else ""


def _at_bound(entry: Allowance) -> str:
    for word, bound in (("smallest", entry.smallest), ("largest", entry.largest)):
        if bound is not None and abs(entry.half_width - bound) <= AT_BOUND * bound:
            return f"{allowance_name(entry)} at its {word}, {bound:g} {entry.unit}"
    return ""


def allowance_name(entry: Allowance) -> str:
    """A half-width as the budget calls it."""
    return source_name(entry)


def method_blocks(score: Score) -> tuple[Block, ...]:
    """How first order was computed, how far it holds, and what was assumed."""
    worst, decimals = score.worst_target, score.decimals
    gaussian, unimodal, moments = (
        f"{bound:.{decimals}f} mm"
        for bound in (worst.bounds_mm.gaussian, worst.bounds_mm.unimodal, worst.bounds_mm.moments)
    )
    sentences = [
        f"Law: {worst.law}. With the same mean and covariance, P95 at {worst.name} is {gaussian} if Gaussian, at most "
        f"{unimodal} for any symmetric unimodal law and {moments} for any law.",
        f"Per unit: {units_sentence(worst, decimals)}",
        f"Linearisation: {score.validity.status}. {score.validity.statement}.",
        "Sensitivities are evaluated at the biased geometry: known displacements are in the mean, tolerances and noise "
        "in the covariance. A tolerance is a half-width with the law named in the budget.",
        *score.provenance.notes,
    ]
    return (
        Facts(
            "Method",
            (
                ("First order", "implicit differentiation of resection, triangulation and the chain to the tool"),
                ("Validity number", f"nu = {score.validity.nu:.3g}, {score.validity.status}"),
            ),
        ),
        Bullets(tuple(sentences)),
    )
