"""The chapters of an optimisation."""

from __future__ import annotations

from tailstack.results import Optimisation

from ...rendering.verdict import decided_by
from ..blocks import (
    Block,
    Bullets,
    Column,
    Document,
    Facts,
    KeyNumber,
    Listing,
    Paragraph,
    Row,
    Section,
    Table,
    tone_of,
)
from .layout import layout_blocks, score_if_determined
from .tables import not_included, provenance_facts, requirements_table
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
            Section("What changed", (*optimised_layout(found), *change_blocks(found)), page=True),
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
    low, high = worst.p95_interval_mm
    return (
        f"{sentence_of(found.objective)} The new design was checked by Monte Carlo with a fresh seed: P95 "
        f"{low:.3f} to {high:.3f} mm at {worst.name}." + "".join(f" {words}" for words in others_sentences(found))
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
    before = "not determined" if found.p95_before_mm is None else f"{found.p95_before_mm:.3f} mm before"
    numbers = [KeyNumber("P95, estimate", f"{found.p95_after_mm:.3f} mm", before)]
    worst = found.worst_target
    low, high = worst.p95_interval_mm
    numbers.append(KeyNumber("P95, Monte Carlo", f"{worst.p95_mm:.3f} mm", f"{low:.3f} to {high:.3f} mm, {worst.name}"))
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
    blocks: list[Block] = []
    if found.tolerances:
        rows = [
            Row((
                entry.label, entry.unit, entry.before_half_width, entry.after_half_width, entry.at_target_before_mm,
                entry.at_target_mm, entry.cost_before, entry.cost_after, entry.grade or "",
            ))
            for entry in found.tolerances
        ]  # fmt: skip
        blocks.append(Table(
            "Tolerances", "Tolerances that were free, as half-widths",
            (
                Column("Tolerance"), Column("Unit"), Column("Before", "unit", "significant"),
                Column("After", "unit", "significant"), Column("At target, before", "mm", "fixed"),
                Column("At target, after", "mm", "fixed"), Column("Cost before", "", "significant", 4),
                Column("Cost after", "", "significant", 4), Column("Grade"),
            ),
            tuple(rows),
        ))  # fmt: skip
    if found.moved:
        nowhere = (None, None, None)
        moved = [Row((e.label, *(e.before_mm or nowhere), *(e.after_mm or nowhere))) for e in found.moved]
        axes = [Column(f"{when} {axis}", "mm", "fixed", 2) for when in ("Before", "After") for axis in "xyz"]
        blocks.append(
            Table("Fiducials", "Fiducials that could move, frame con", (Column("Fiducial"), *axes), tuple(moved),
                  "Before empty: new; after empty: left out.")
        )  # fmt: skip
    if found.view_offer is not None:
        offer = found.view_offer
        either = [
            Row((what, cost, price, None if cost is None else cost + price, p95_mm))
            for what, cost, price, p95_mm in (
                (f"without {offer.view}", offer.cost_without, 0.0, offer.p95_without_mm),
                (f"with {offer.view}", offer.cost_with, offer.price, offer.p95_with_mm),
            )
        ]
        headings = (
            Column("Design"), Column("Cost", "", "significant", 4), Column("Price of the view", "", "significant", 4),
            Column("In all", "", "significant", 4), Column("P95 as it stood", "mm", "fixed"),
        )  # fmt: skip
        blocks.append(Table("A view more", "The view that could be added", headings, tuple(either), offer.sentence))
    if found.aimed is not None:
        aims = [
            Row((e.view, e.turn_deg, *e.beam_direction, e.source_isocentre_before_mm, e.source_isocentre_mm))
            for e in found.aimed.views
        ]
        columns = (
            Column("View"), Column("Turned by", "deg", "fixed", 1),
            *(Column(f"Beam {axis}", "", "fixed") for axis in "xyz"),
            Column("Source to isocentre, before", "mm", "fixed", 1), Column("After", "mm", "fixed", 1),
        )  # fmt: skip
        blocks.append(Table("Views", "Views that could be aimed", columns, tuple(aims), found.aimed.sentence))
    if found.pivots:
        pivots = [Row((entry.label, *entry.before_mm, *entry.after_mm)) for entry in found.pivots]
        axes = [Column(f"{when} {axis}", "mm", "fixed", 2) for when in ("Before", "After") for axis in "xyz"]
        blocks.append(Table("Pivots", "Pivots that could move, frame con", (Column("Interface"), *axes), tuple(pivots)))
    if found.spacings:
        spread = [Row((entry.label, entry.scale)) for entry in found.spacings]
        columns = (Column("Interface"), Column("Factor", "", "fixed"))
        blocks.append(Table("Locators", "Locators spread about their centre", columns, tuple(spread)))
    if found.shadow_prices:
        prices = [Row((entry.name, entry.unit, entry.cost_per_unit, entry.sentence)) for entry in found.shadow_prices]
        blocks.append(Table(
            "Shadow prices", "What one unit more of a limit or bound changes",
            (
                Column("Limit or bound"), Column("Unit"), Column("Change", "per unit", "significant", 4),
                Column("In words"),
            ),
            tuple(prices),
        ))  # fmt: skip
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
