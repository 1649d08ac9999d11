"""The chapters of an allocation: half-widths before and after, and what holds the limit."""

from __future__ import annotations

from tailstack.optimisation.half_widths import Allocation
from tailstack.results.digits import at_least, at_most, percent
from tailstack.results.optimisation import changes_table

from ...rendering.document import Bullets, Document, KeyNumber, Section, compose_document


def allocation_document(allocation: Allocation, sha256: str) -> Document:
    """What it costs to keep the limit, with which half-widths, and how low the limit could be."""
    kept, unit = allocation.status == "kept", allocation.unit
    holder = allocation.held_label or allocation.held_by
    least = f"{at_least(allocation.least)} {unit}"
    held = f"with every free half-width at its least it comes to {least}, of which {holder} has "
    held += f"{percent(allocation.held_share, 0)} % of the mean square"
    aim = f"{allocation.requirement} within {allocation.limit:g} {unit}"
    sentence = f"{aim} is out of reach: {held}."
    if kept:
        before = "" if allocation.cost_before is None else f", before {allocation.cost_before:.4g}"
        moved = "" if allocation.moved_most is None else f"; counted at the tool, {allocation.moved_most} moved most"
        sentence = f"{aim} costs {allocation.cost_after:.4g}{before}: by estimate it comes to "
        sentence += f"{at_most(allocation.value)} {unit}{moved}."
    locks = "".join(f" --lock {name}" for name in allocation.locked)
    asked = f"--requirement '{allocation.requirement}' --limit {allocation.limit!r}{locks}"
    matters = (f"A lower limit can be kept down to {least}: {held}.",) if kept else ()
    return compose_document(
        allocation,
        sha256,
        (
            Section("Half-widths", (changes_table(allocation.tolerances),)),
            Section("What binds", (Bullets(allocation.binding or ("Nothing: every half-width is at its largest.",)),)),
        ),
        f"tailstack allocate design.yaml {asked} --json",
        "With the design of the hash named above.",
        kind="Allocation",
        tone="pass" if kept else "fail",
        status=allocation.status,
        sentence=sentence,
        numbers=(
            KeyNumber("Cost", f"{allocation.cost_after:.4g}"),
            KeyNumber("Comes to", f"{at_most(allocation.value) if kept else at_least(allocation.value)} {unit}"),
            KeyNumber("At the least", least, holder),
        ),
        matters=matters,
        question="The cheapest half-widths within the limits, layout and views as they are; by estimate.",
        method="first order with the exact law",
        opening=(sentence, *matters),
    )
