"""The chapters of a first-order score."""

from __future__ import annotations

from tailstack.results import Score, TargetScore

from ...rendering.score import worst_target
from ..blocks import Block, Bullets, Document, Facts, Figure, KeyNumber, Paragraph, Section, tone_of
from ..figures.budget import waterfall_svg, without_svg
from ..figures.errors import scale_svg
from ..headline import headline_of
from ..records import Headline
from .tables import (
    budget_table,
    checks_table,
    findings_table,
    not_included,
    provenance_facts,
    targets_table,
    views_table,
)

DETAILED = 3  # targets whose budget has pictures and a table of its own, largest P95 first


def score_document(score: Score, sha256: str) -> Document:
    """A score by itself: no picture of the layout, which is not in its record."""
    headline = headline_of(score, None)
    command = "tailstack score design.yaml --json"
    return Document(
        kind="First-order score",
        title=score.provenance.design_name,
        tone=tone_of(headline.status),
        status=headline.status,
        sentence=headline.sentence,
        numbers=key_numbers(headline),
        matters=headline.matters,
        figures=(headline_figure(headline, score),),
        sections=(
            Section("Error and requirements", error_blocks(score)),
            Section("Budget", budget_blocks(score)),
            Section("Method and assumptions", method_blocks(score)),
            Section("What is not included", (not_included(score.provenance),)),
            Section("Reproduction", (Paragraph(f"With the design of the hash named below: {command}"),)),
        ),
        provenance=provenance_facts(score.provenance, sha256, score.schema),
    )


def key_numbers(headline: Headline) -> tuple[KeyNumber, ...]:
    """Quantile, limit and margin, in large type."""
    quantile = f"P{100 * headline.quantile:g}"
    low, high = headline.interval_mm
    ends = f"{low:.3f} to {'unknown' if high is None else f'{high:.3f}'} mm, {headline.basis}"
    numbers = [KeyNumber(f"{quantile} of the error", f"{headline.value_mm:.3f} mm", ends)]
    if headline.limit_mm is None:
        return (*numbers, KeyNumber("Limit", "none", "no requirement is stated"))
    margin = headline.limit_mm - headline.value_mm
    numbers.append(KeyNumber("Limit", f"{headline.limit_mm:g} mm", f"{headline.requirement}, target {headline.target}"))
    word = "of the limit is left" if margin >= 0 else "beyond the limit"
    value = f"{margin:+.3f} mm".replace("-", "−")
    numbers.append(KeyNumber("Margin", value, f"{abs(margin) / headline.limit_mm:.0%} {word}"))
    return tuple(numbers)


def headline_figure(headline: Headline, score: Score) -> Figure:
    """The quantile, its interval and the limit on one scale."""
    found = next((target for target in score.targets if target.name == headline.target), None)
    others = (("mean", found.mean_norm_mm), ("CVaR95", found.cvar95_mm)) if found is not None else ()
    svg = scale_svg(
        headline.target, headline.value_mm, headline.interval_mm, headline.limit_mm, others, "headline",
        f"P{100 * headline.quantile:g}",
    )  # fmt: skip
    caption = f"Norm of the error at target {headline.target}, {headline.basis}: the bar is the interval."
    return Figure("headline", svg, caption)


def error_blocks(score: Score) -> tuple[Block, ...]:
    blocks: list[Block] = [targets_table(score)]
    if score.verdict.checks:
        blocks.append(checks_table(score.verdict))
    if score.verdict.findings:
        blocks.append(findings_table(score.verdict.findings))
    if score.views:
        blocks.append(views_table(score.views))
    return tuple(blocks)


def largest_targets(score: Score) -> list[TargetScore]:
    return sorted(score.targets, key=lambda target: target.p95_mm, reverse=True)[:DETAILED]


def budget_blocks(score: Score) -> tuple[Block, ...]:
    """Pictures and table of the budget of the targets with the largest P95."""
    blocks: list[Block] = []
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
                waterfall_svg(target.contributors, target.name, f"waterfall{suffix}"),
                f"Target {target.name}: share of the variance of each contributor, each bar beginning where the one "
                "above ends.",
            ),
            Figure(
                f"without{suffix}",
                without_svg(target.contributors, target.name, target.p95_mm, limit, f"without{suffix}"),
                f"Target {target.name}: first-order P95 were one contributor perfect and all others as they are.",
            ),
            budget_table(target, "Budget" if k == 0 else f"Budget {k + 1}"),
        ]
        if target.worst_vertex:
            blocks.append(Paragraph(f"Bounded components stand at their worst ends: {', '.join(target.worst_vertex)}."))
    return tuple(blocks)


def method_blocks(score: Score) -> tuple[Block, ...]:
    """How first order was computed, how far it holds, and what was assumed."""
    worst = worst_target(score)
    bounds, unit = worst.bounds_mm, worst.per_unit
    sentences = [
        f"Law: {worst.law}. With the same mean and covariance, P95 at {worst.name} is {bounds.gaussian:.3f} mm if "
        f"Gaussian, at most {bounds.unimodal:.3f} mm for any symmetric unimodal law and {bounds.moments:.3f} mm for "
        "any law.",
        f"Per unit: 95 % of installed units have a P95 over their own shots below {unit.p95_of_units_mm:.3f} mm.",
        f"Linearisation: {score.validity.status}. {score.validity.statement}.",
        "Sensitivities are evaluated at the biased geometry: known displacements are in the mean, tolerances and noise "
        "in the covariance. A tolerance is a half-width with the law named in the budget.",
        *score.provenance.notes,
    ]
    if unit.yield_fraction is not None and unit.limit_mm is not None:
        sentences[1] += f" {unit.yield_fraction:.2%} of units meet {unit.limit_mm:g} mm."
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
