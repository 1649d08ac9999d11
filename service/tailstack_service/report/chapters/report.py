"""The chapters of a tolerance-budget report: for the project lead, the designer, the auditor, in this order."""

from __future__ import annotations

from typing import Any

from tailstack.design.review import Comment, Review
from tailstack.results.digits import decimals_of
from tailstack.results.score import targets_table, views_table
from tailstack.results.tables import LONG_TABLE, Column, tabulate
from tailstack.results.verdicts import requirements_table
from tailstack.results.verification import estimates_table

from ...rendering.document import (
    Block,
    Bullets,
    Document,
    Facts,
    Figure,
    Listing,
    Paragraph,
    Section,
    closing_sections,
    provenance_facts,
    tone_of,
    verdict_blocks,
)
from ...rendering.sentences import units_sentence
from ..charts import draw_distribution
from ..records import Report
from .layout import beads_table, layout_blocks, score_if_determined
from .optimisation import (
    certificate_blocks,
    change_blocks,
    design_listing,
    optimisation_numbers,
    optimised_layout,
    optimised_sentence,
)
from .radiostereometry import radiostereometry_blocks
from .score import (
    budget_blocks,
    dots_blocks,
    headline_figure,
    key_numbers,
    levers_blocks,
    losses_listed,
    measures_blocks,
    method_blocks,
    units_number,
)
from .verification import sampling_blocks


def report_document(report: Report, sha256: str) -> Document:
    """The whole report."""
    headline, drawn = report.headline, (report.design, report.score)
    sections = [
        Section("The budget", (*budget_blocks(report.score, report.allowances), *levers_blocks(report.score))),
        Section("The error", error_chapter(report)),
        Section("The layout", (*layout_blocks(drawn, report.title), beads_table(report.design))),
        Section("Requirements and findings", judged_blocks(report)),
        review_section(report.design),
    ]
    if report.radiostereometry is not None:
        sections.insert(0, Section("Radiostereometry", radiostereometry_blocks(report.radiostereometry)))
    if report.optimisation is not None:
        optimisation = report.optimisation
        numbers = "; ".join(f"{n.label} {n.value} ({n.detail})" for n in optimisation_numbers(optimisation)[:2])
        scored = score_if_determined(optimisation.design), score_if_determined(optimisation.design_before)
        summary = Paragraph(f"{optimised_sentence(optimisation)} {numbers}.")
        blocks = (summary, *optimised_layout(*scored), *change_blocks(optimisation, *scored))
        sections.append(Section("The optimised design", blocks))
        check = estimates_table(optimisation.certificate.verification, " of the new design")
        proof = (check, *certificate_blocks(optimisation))
        sections.append(Section("Certificate of the optimum", proof, reader="auditor"))
    sections += [
        Section("Method and assumptions", method_chapter(report), reader="auditor"),
        *closing_sections(report.provenance, *reproduction_blocks(report), design=report.design),
        Section("The design", (design_listing(report.design, "The design document, as YAML"),), reader="auditor"),
    ]
    judged = report.verification or report.score
    decimals = decimals_of(judged.verdict.checks, headline.value)
    return Document(
        kind="Tolerance-budget report",
        title=report.title,
        tone=tone_of(headline.status),
        status=headline.status,
        sentence=headline.sentence,
        numbers=(*key_numbers(headline, decimals), units_number(report.score, headline.target)),
        matters=headline.matters,
        figures=(headline_figure(headline, judged.targets, decimals),),
        requirements=requirements_table(judged.verdict),
        sections=tuple(sections),
        provenance=provenance_facts(report.provenance, sha256, report.schema),
        made=report.provenance,
    )


def error_chapter(report: Report) -> tuple[Block, ...]:
    """Distributions, then the numbers of every target."""
    blocks: list[Block] = [*dots_blocks(report.score)]
    first = {target.name: target for target in report.score.targets}
    check = report.verification
    drawn = {} if check is None else {target.name: target for target in check.targets}
    decimals = report.score.decimals if check is None else check.decimals
    for k, shown in enumerate(report.distributions):
        target, sampled = first[shown.target], drawn.get(shown.target)
        p95 = target.p95_mm if sampled is None else sampled.p95_mm
        interval = None if sampled is None else sampled.p95_interval_mm
        name = f"distribution-{k + 1}"
        how = "as estimated" if sampled is None else "as estimated and as simulated"
        svg = draw_distribution(shown, p95, interval, target.limit_mm, name, decimals)
        blocks.append(Figure(name, svg, f"Target {shown.target}: size of the error at the tool, {how}."))
    if report.verification is not None:
        blocks.append(estimates_table(report.verification))
    units = units_sentence(report.score.worst_target, report.score.decimals)
    measures = measures_blocks(report.verification or report.score)
    return (*blocks, targets_table(report.score), *measures, Paragraph(units))


def judged_blocks(report: Report) -> tuple[Block, ...]:
    """Requirements by Monte Carlo and to first order, findings, what the views see."""
    verdicts = [] if report.verification is None else [report.verification.verdict]
    verdicts.append(report.score.verdict)
    blocks: list[Block] = [*verdict_blocks(*verdicts), views_table(report.score.views)]
    if any(line.mixture for line in report.score.losses):
        blocks.append(losses_listed(report.score))
    return tuple(blocks)


def method_chapter(report: Report) -> tuple[Block, ...]:
    """First order, and sampling."""
    check = report.verification
    return (*method_blocks(report.score), *(() if check is None else sampling_blocks(check)))


def reproduction_blocks(report: Report) -> tuple[Block, ...]:
    """The commands that give the same numbers again."""
    made = report.reproduction
    seed = () if made.seed is None else (("Seed", str(made.seed)),)
    most = () if made.max_trials is None else (("Trials at most", f"{made.max_trials:,}"),)
    facts = Facts("Reproduction", (*seed, *most, ("Version", f"tailstack {report.provenance.tailstack_version}")))
    return (Listing("\n".join(made.commands), "Commands"), facts, Bullets((made.statement,)))


def review_section(design: dict[str, Any]) -> Section:
    """The chapter of a design document; not shown where nobody has commented or kept a version."""
    review = Review.model_validate(design.get("review") or {})
    listed = sorted(review.comments, key=lambda comment: comment.resolved)
    count = sum(not comment.resolved for comment in listed)
    columns = (
        Column("On", of=_pin), Column("Comment", of=lambda comment: comment.text),
        Column("By", of=lambda comment: comment.author), Column("When", of=lambda comment: comment.date or ""),
        Column("State", of=lambda comment: "resolved" if comment.resolved else "open"),
    )  # fmt: skip
    kept = (
        Column("Version", of=lambda version: version.name), Column("Note", of=lambda version: version.note),
        Column("Kept", of=lambda version: version.date or ""),
    )  # fmt: skip
    comments = tabulate("Comments", f"Comments, {count} of them open", columns, listed, most=LONG_TABLE)
    versions = tabulate("Versions", "Versions kept in the design document", kept, review.versions)
    return Section("Review", (comments, versions))


def _pin(comment: Comment) -> str:
    if comment.bead is not None:
        return f"bead {comment.bead}"
    return " ".join(filter(None, (comment.contributor, comment.component))) or "the design"
