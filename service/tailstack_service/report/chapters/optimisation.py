"""The chapters of an optimisation."""

from __future__ import annotations

from tailstack.results import Optimisation
from tailstack.results.digits import decimals_of
from tailstack.results.optimisation import (
    aims_table,
    changes_table,
    limits_table,
    moved_table,
    offer_table,
    pivots_table,
    spacings_table,
)
from tailstack.results.verdicts import decided_by, requirements_table

from ..blocks import Block, Bullets, Document, Facts, KeyNumber, Listing, Paragraph, Section, tone_of
from .layout import layout_blocks, score_if_determined
from .tables import not_included, provenance_facts
from .verification import sampling_blocks, verification_blocks

MOST_BINDING = 3  # said on the first page

REPRODUCTION = (
    "design.yaml is the design that it started from, the field design_before of this record and the last section of "
    "this report. The same version of tailstack gives the same digits, whatever the number of threads, workers or "
    "machines."
)


def optimise_command(found: Optimisation) -> str:
    """The command that gives this optimisation again."""
    return f"tailstack optimise design.yaml --seed {found.certificate.seed} --starts {found.certificate.starts} --json"


def optimisation_document(found: Optimisation, sha256: str) -> Document:
    """An optimisation by itself: what it found, what changed, and what the optimum rests on."""
    check = found.certificate.verification
    more = len(found.binding) - MOST_BINDING
    listed = "; ".join(found.binding[:MOST_BINDING]) + (f"; and {more} more" if more > 0 else "")
    binding = f"What keeps it from being better: {listed}." if found.binding else "Nothing keeps it from being better."
    return Document(
        kind="Optimised design",
        title=found.provenance.design_name,
        tone=tone_of(found.verdict_status),
        status=found.status if found.verdict_status == "pass" else found.verdict_status,
        sentence=optimised_sentence(found),
        numbers=optimisation_numbers(found),
        requirements=requirements_table(check.verdict),
        matters=(
            *others_sentences(found),
            *(() if found.view_offer is None else (found.view_offer.sentence,)),
            binding,
            *(sentence_of(price.sentence) for price in found.shadow_prices[:2]),
        ),
        sections=(
            Section("What changed", (*optimised_layout(found), *change_blocks(found))),
            Section("Check of the new design", (*verification_blocks(check), *sampling_blocks(check))),
            Section("Certificate", certificate_blocks(found), reader="auditor"),
            Section("What is not included", (not_included(found.provenance),), reader="auditor"),
            Section(
                "Reproduction",
                (Listing(f"{optimise_command(found)}\ntailstack report --verify THIS_FILE"), Paragraph(REPRODUCTION)),
                reader="auditor",
            ),
            Section(
                "The new design",
                (design_listing(found.design, "The new design, as YAML"),),
                reader="auditor",
            ),
            Section(
                "The design before",
                (design_listing(found.design_before, "The design that it started from, as YAML"),),
                reader="auditor",
            ),
        ),
        provenance=provenance_facts(found.provenance, sha256, found.schema, "new design"),
    )


def optimised_sentence(found: Optimisation) -> str:
    """What was sought and what was reached."""
    worst = found.worst_target
    decimals = decimals_of(found.certificate.verification.verdict.checks)
    low, high = (f"{end:.{decimals}f}" for end in worst.p95_interval_mm)
    return (
        f"{sentence_of(found.objective)} The new design was checked by Monte Carlo with a fresh seed: P95 "
        f"{low} to {high} mm at {worst.name}." + "".join(f" {words}" for words in others_sentences(found))
    )


def others_sentences(found: Optimisation) -> tuple[str, ...]:
    """What became of the requirements that the optimiser was not asked to keep, in one sentence; nothing if none."""
    if not found.others:
        return ()
    told = [f"{worst.requirement} ({worst.status})" for worst, _ in decided_by(found.others)]
    return (f"Not asked for, and judged all the same: {', '.join(told)}.",)


def sentence_of(words: str) -> str:
    """Words that begin with a capital and end with a full stop."""
    return words[:1].upper() + words[1:].rstrip(".") + "."


def optimisation_numbers(found: Optimisation) -> tuple[KeyNumber, ...]:
    decimals = decimals_of(found.certificate.verification.verdict.checks)
    before = "not determined" if found.p95_before_mm is None else f"{found.p95_before_mm:.{decimals}f} mm before"
    numbers = [KeyNumber("P95, estimate", f"{found.p95_after_mm:.{decimals}f} mm", before)]
    worst = found.worst_target
    low, high = (f"{end:.{decimals}f}" for end in worst.p95_interval_mm)
    numbers.append(
        KeyNumber("P95, Monte Carlo", f"{worst.p95_mm:.{decimals}f} mm", f"{low} to {high} mm, {worst.name}")
    )
    if found.scaling is not None:
        numbers.append(KeyNumber("Common factor", f"× {found.scaling:.4g}", "on all free half-widths"))
    elif found.cost_after > 0:
        cost = "no price before" if found.cost_before is None else f"{found.cost_before:.4g} before"
        numbers.append(KeyNumber("Cost of what was free", f"{found.cost_after:.4g}", cost))
    proof = found.certificate
    return (*numbers, KeyNumber("Starts", f"{proof.converged_starts} of {proof.starts}", "converged"))


def optimised_layout(found: Optimisation) -> tuple[Block, ...]:
    """The new layout over the one that it started from."""
    now, before = score_if_determined(found.design), score_if_determined(found.design_before)
    if now is None:
        return ()
    title = f"{found.provenance.design_name}: the new layout"
    return layout_blocks(now, title, "layout-optimised", before, of="New design. ")


def change_blocks(found: Optimisation) -> tuple[Block, ...]:
    """Tolerances, fiducials, pivots and locators before and after; what a limit is worth."""
    tables = (
        changes_table(found) if found.tolerances else None,
        moved_table(found) if found.moved else None,
        None if found.view_offer is None else offer_table(found.view_offer),
        None if found.aimed is None else aims_table(found.aimed),
        pivots_table(found) if found.pivots else None,
        spacings_table(found) if found.spacings else None,
        limits_table(found) if found.shadow_prices else None,
    )
    blocks: list[Block] = [table for table in tables if table is not None]
    if found.binding:
        blocks.append(Bullets(tuple(f"Keeps it from being better: {entry}" for entry in found.binding)))
    return tuple(blocks)


def certificate_blocks(found: Optimisation) -> tuple[Block, ...]:
    proof = found.certificate
    pairs = [
        ("Residual of the optimality conditions", f"{proof.kkt_residual:.2g}"),
        ("Starts", f"{proof.converged_starts} of {proof.starts} converged, seed {proof.seed}"),
        ("Distinct optima", f"{_optima_words(found)}: " + ", ".join(f"{value:.5g}" for value in proof.best_costs[:8])),
        ("Lower bound", proof.relaxation.statement),
        ("Ending", proof.stopped),
        ("Rounds of tightening", str(proof.tightening_rounds)),
    ]
    remarks = tuple(entry.message for entry in found.influence)
    worth = () if found.placement_value is None else (found.placement_value.sentence,)
    listed = remarks + worth
    return (Facts("Certificate", tuple(pairs)), *((Bullets(listed),) if listed else ()))


def _optima_words(found: Optimisation) -> str:
    """What the values of distinct optima are."""
    if found.scaling is not None:
        return "common factor, by the closed form that ranks them"
    if found.cost_closed_form is None:
        return "largest quantile over its limit, by the closed form that ranks them"
    return "cost, by the closed form that ranks them"


def design_listing(design: dict[str, object], caption: str) -> Listing:
    """A design as text that loads as the same design."""
    from tailstack.design.write import data_to_yaml

    return Listing(data_to_yaml(design).rstrip("\n"), caption)
