"""The chapters of an optimisation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf

from tailstack.design.pointers import find_places, replace_value, value_at
from tailstack.design.write import data_to_yaml
from tailstack.results import Check, Optimisation, SurvivedLoss
from tailstack.results.digits import at_most, count_decimals, decimals_of, length, number, percent
from tailstack.results.optimisation import (
    MOST_OPTIMA,
    aims_table,
    alone_table,
    changes_table,
    counts_table,
    front_table,
    limits_table,
    moved_table,
    offer_table,
    optima_table,
    pivots_table,
)
from tailstack.results.tables import IN_DETAIL, PAPER, Column, On, Table, tabulate
from tailstack.results.verdicts import decided_by, requirements_table
from tailstack.results.verification import estimates_table

from ...rendering.document import (
    Block,
    BlockGroup,
    Bullets,
    Document,
    Facts,
    KeyNumber,
    Listing,
    Paragraph,
    Section,
    closing_sections,
    group,
    provenance_facts,
    say,
    tone_of,
    verdict_blocks,
)
from ...rendering.sentences import decision_sentence, ending_of
from ...rendering.text import csv_text, plain_text, spell_count
from .layout import Known, layout_blocks, score_if_determined
from .verification import sampling_blocks

MOST_BINDING = 3  # said on the first page
MOST_LISTED = 4  # said in a terminal without details
LEAST_GAP = 0.05  # per cent: less is none
DEAR_MARGIN = 0.005  # of the cost: what the check's margin costs is told from there on

REPRODUCTION = (
    "design.yaml is the design that it started from, the field design_before of this record and the last section of "
    "this report. The same version of tailstack gives the same digits, whatever the number of threads, workers or "
    "machines."
)


def optimise_command(optimisation: Optimisation) -> str:
    """The command that gives this optimisation again."""
    proof = optimisation.certificate
    return f"tailstack optimise design.yaml --seed {proof.seed} --starts {proof.starts} --json"


def optimisation_document(optimisation: Optimisation, sha256: str) -> Document:
    """An optimisation by itself: what it found, what changed, and what the optimum rests on."""
    check = optimisation.certificate.verification
    scored = score_if_determined(optimisation.design), score_if_determined(optimisation.design_before)
    more = len(optimisation.binding) - MOST_BINDING
    listed = "; ".join(optimisation.binding[:MOST_BINDING]) + (f"; and {more} more" if more > 0 else "")
    binding = f"What keeps it from being better: {listed}." if listed else "Nothing keeps it from being better."
    changed = (BlockGroup(partial(optimised_layout, *scored), PAPER), *change_blocks(optimisation, *scored))
    checked = (estimates_table(check), *verdict_blocks(check.verdict), *sampling_blocks(check))
    return Document(
        kind="Optimised design",
        title=optimisation.provenance.design_name,
        tone=tone_of(optimisation.verdict_status),
        status=optimisation.status if optimisation.verdict_status == "pass" else optimisation.verdict_status,
        sentence=optimised_sentence(optimisation),
        numbers=optimisation_numbers(optimisation),
        requirements=requirements_table(check.verdict),
        matters=(
            *others_sentences(optimisation),
            *(() if optimisation.view_offer is None else (optimisation.view_offer.sentence,)),
            binding,
            *(() if optimisation.moves is None else (sentence_of(optimisation.moves.sentence),)),
            *(sentence_of(price.sentence) for price in optimisation.shadow_prices[:2]),
        ),
        sections=(
            Section("What changed", changed),
            Section("Check of the new design", checked, on=PAPER),
            Section("Certificate", certificate_blocks(optimisation), on=IN_DETAIL, reader="auditor"),
            Section("How sure", (say("how sure", _confidence_sentence(optimisation)),), on=On.PLAIN),
            *closing_sections(
                check.provenance,
                Listing(f"{optimise_command(optimisation)}\ntailstack report --verify THIS_FILE"),
                Paragraph(REPRODUCTION),
                design=optimisation.design,
            ),
            *(
                Section(title, (BlockGroup(partial(_list_design, data, f"{what}, as YAML"), PAPER),), reader="auditor")
                for title, what, data in (
                    ("The new design", "The new design", optimisation.design),
                    ("The design before", "The design that it started from", optimisation.design_before),
                )
            ),
        ),
        provenance=provenance_facts(optimisation.provenance, sha256, optimisation.schema, "new design"),
        made=optimisation.provenance,
        question=f"{optimisation.as_it_stood} Optimised: {optimisation.objective}.".lstrip(),
        method="first order with the exact law",
        opening=(decision_sentence(check.verdict, optimisation.not_asked), *others_sentences(optimisation)),
        findings=(*optimisation.influence, *check.verdict.findings),
        ending=ending_of(check.verdict, check.provenance),
    )


def optimised_sentence(optimisation: Optimisation) -> str:
    """What was sought and what was reached."""
    worst = optimisation.worst_target
    decimals = decimals_of(optimisation.certificate.verification.verdict.checks)
    low, high = (length(end, decimals) for end in worst.p95_interval_mm)
    checked = f"The new design was checked by Monte Carlo with a fresh seed: P95 {low} to {high} mm at {worst.name}."
    told = (optimisation.as_it_stood, sentence_of(optimisation.objective), checked, *others_sentences(optimisation))
    return " ".join(filter(None, told))


def others_sentences(optimisation: Optimisation) -> tuple[str, ...]:
    """What became of the requirements that the optimiser was not asked to keep, in one sentence; nothing if none."""
    if not optimisation.others:
        return ()
    told = [f"{worst.requirement} ({worst.status})" for worst, _ in decided_by(optimisation.others)]
    return (f"Not asked for, and judged all the same: {', '.join(told)}.",)


def sentence_of(words: str) -> str:
    """Words that begin with a capital and end with a full stop."""
    return words[:1].upper() + words[1:].rstrip(".") + "."


def optimisation_numbers(optimisation: Optimisation) -> tuple[KeyNumber, ...]:
    decimals = decimals_of(optimisation.certificate.verification.verdict.checks)
    before_mm = optimisation.p95_before_mm
    before = "not determined" if before_mm is None else f"{length(before_mm, decimals)} mm before"
    numbers = [KeyNumber("P95, estimate", f"{length(optimisation.p95_after_mm, decimals)} mm", before)]
    worst = optimisation.worst_target
    low, high = (length(end, decimals) for end in worst.p95_interval_mm)
    numbers.append(
        KeyNumber("P95, Monte Carlo", f"{length(worst.p95_mm, decimals)} mm", f"{low} to {high} mm, {worst.name}")
    )
    if optimisation.scaling is not None:
        numbers.append(KeyNumber("Common factor", f"× {optimisation.scaling:.4g}", "on all free half-widths"))
    elif optimisation.cost_after > 0:
        cost = "no price before" if optimisation.cost_before is None else f"{optimisation.cost_before:.4g} before"
        numbers.append(KeyNumber("Cost of what was free", f"{optimisation.cost_after:.4g}", cost))
    proof = optimisation.certificate
    return (*numbers, KeyNumber("Starts", f"{proof.converged_starts} of {proof.starts}", "converged"))


def optimised_layout(now: Known | None, before: Known | None) -> tuple[Block, ...]:
    """The new layout over the one that it started from."""
    if now is None:
        return ()
    title = f"{now[1].provenance.design_name}: the new layout"
    return layout_blocks(now, title, "layout-optimised", before, of="New design. ")


def change_blocks(optimisation: Optimisation, now: Known | None, before: Known | None) -> tuple[Block, ...]:
    """Requirements by estimate, fiducials, pivots and tolerances before and after; what a limit is worth."""
    more = len(optimisation.binding) - MOST_LISTED
    first = f"{'; '.join(optimisation.binding[:MOST_LISTED])}; and {more} more (--details)"
    binding, better = "; ".join(optimisation.binding), "what keeps it from being better"
    on_paper = [f"Keeps it from being better: {entry}" for entry in optimisation.binding]
    if optimisation.survived is not None:
        on_paper.append(f"If fiducials are lost: {survived_sentence(optimisation.survived)}")
    return (
        _requirements_table(optimisation, now, before),
        group(*_costs(optimisation)),
        moved_table(optimisation),
        *(() if optimisation.moves is None else (group(alone_table(optimisation.moves), on=PAPER),)),
        pivots_table(optimisation),
        say("to be drawn", *_say_redrawn(optimisation)),
        changes_table(optimisation.tolerances),
        *(() if optimisation.view_offer is None else (group(offer_table(optimisation.view_offer), on=PAPER),)),
        *(() if optimisation.aimed is None else (group(aims_table(optimisation.aimed), on=PAPER),)),
        group(limits_table(optimisation), *((Bullets(tuple(on_paper)),) if on_paper else ()), on=PAPER),
        group(
            say(better, first if more > 0 else binding, on=On.PLAIN),
            say(better, binding, on=On.DETAIL),
            say("trade-off", *(price.sentence for price in optimisation.shadow_prices)),
        ),
        counts_table(optimisation),
        group(front_table(optimisation), *_front_notes(optimisation)),
    )


def _requirements_table(optimisation: Optimisation, now: Known | None, before: Known | None) -> Table:
    """What each requirement limits, by estimate in the design as it stood and in the new one, at one target."""
    checks = optimisation.certificate.verification.verdict.checks
    decimals = max((count_decimals(check.limit) for check in checks), default=3)  # of an estimate

    def look_up(known: Known | None) -> Callable[[tuple[Check, int]], float | None]:
        judged = () if known is None else known[1].verdict.checks
        of = {(check.requirement, check.target): check.value for check in judged}
        return lambda row: of.get((row[0].requirement, row[0].target))

    units = {check.unit for check in checks}
    unit = units.pop() if len(units) == 1 else ""
    columns = (
        Column("Requirement", brief="by estimate,\nrequirement", of=lambda row: row[0].requirement),
        Column("Target", of=lambda row: row[0].target),
        *(() if unit else (Column("Unit", of=lambda row: row[0].unit),)),
        Column("Before", unit, "fixed", decimals, of=look_up(before)),
        Column("After", unit, "fixed", decimals, of=look_up(now)),
        Column("Limit", unit, "stated", decimals, of=lambda row: row[0].limit),
    )
    return tabulate("Before and after", "Requirements by estimate, before and after", columns, decided_by(checks))


def _costs(optimisation: Optimisation) -> Iterator[BlockGroup]:
    """Cost and what it is made of, and what else was decided."""
    before, after = optimisation.cost_before, optimisation.cost_after
    if before or after:
        change = f" ({100 * (after / before - 1):+.0f} %)" if before else ""
        made_of = _cost_in_words(optimisation)
        words = f"{number(after)}, before {number(before)}{change}"
        yield say("cost", words + (f"; {made_of}" if made_of else ""))
    if optimisation.scaling is not None:
        yield say("scaling", f"all free half-widths times {number(optimisation.scaling)}")
    if optimisation.survived is not None:
        yield say("if fiducials are lost", survived_sentence(optimisation.survived))
    for word, decision in (
        ("a view more", optimisation.view_offer),
        ("views", optimisation.aimed),
        ("moving", optimisation.moves),
    ):
        if decision is not None:
            yield say(word, decision.sentence)


def survived_sentence(worst: SurvivedLoss) -> str:
    """What the new design comes to without the fiducials whose loss is worst."""
    low, high = worst.interval_mm
    decimals = count_decimals(worst.limit_mm)
    ends = f"{length(low, decimals)} to {'unknown' if high is None else length(high, decimals)}"
    lost = " and ".join(worst.lost)
    return (
        f"without {lost}, the worst to lose, P95 at {worst.target} is {length(worst.estimate_mm, decimals)} mm by "
        f"estimate and {length(worst.p95_mm, decimals)} mm ({ends}) simulated, within the limit of "
        f"{worst.limit_mm:g} mm."
    )


def _say_redrawn(optimisation: Optimisation) -> Iterator[str]:
    """What becomes of the values of a drawing, in a line."""
    drawn = [each for each in optimisation.tolerances if each.before_drawn is not None]
    changed = [f"{each.label} {each.before_drawn} → {each.grade}" for each in drawn if each.grade != each.before_drawn]
    kept = [f"{each.label} stays {each.grade}" for each in drawn if each.grade == each.before_drawn]
    if drawn:
        spread = "its ± is √3 standard deviations of what the play or zone gives, as if that were uniform"
        yield f"{'; '.join([*changed, *kept])}. Of each, {spread}."


def changes_csv(optimisation: Optimisation) -> str:
    """A line for each tolerance that was free: what it was and is, as drawn or as a half-width, and what it costs."""
    header = ["interface", "tolerance", "before", "after", "unit", "cost_before", "cost_after"]
    return csv_text(
        header,
        (
            (
                each.contributor,
                plain_text(each.component),
                each.before_half_width if each.before_drawn is None else plain_text(each.before_drawn),
                each.after_half_width if each.before_drawn is None else plain_text(each.grade or ""),
                each.unit,
                each.cost_before,
                each.cost_after,
            )
            for each in optimisation.tolerances
        ),
    )


def _cost_in_words(optimisation: Optimisation) -> str:
    """Sums over each interface's half-widths; what is left of the total is the price of the fiducials."""
    if not optimisation.tolerances:
        return ""
    widths: dict[str, list[float]] = {}
    names: dict[str, str] = {}
    for entry in optimisation.tolerances:
        names.setdefault(entry.contributor, entry.label.removesuffix(f" {entry.component}"))
        widths.setdefault(entry.contributor, []).append(entry.cost_after)
    parts = [
        f"{number(sum(costs))} ({names[name]}, {spell_count(len(costs), 'half-width')})"
        for name, costs in widths.items()
    ]
    view = 0.0
    if optimisation.view_offer is not None and optimisation.view_offer.added:
        view = optimisation.view_offer.price
        parts.append(f"{number(view)} (view {optimisation.view_offer.view})")
    if optimisation.cost_of_moves:
        parts.append(f"{number(optimisation.cost_of_moves)} (moving fiducials)")
    fiducials = optimisation.cost_after - view - optimisation.cost_of_moves - sum(map(sum, widths.values()))
    if abs(fiducials) > 1e-6 * abs(optimisation.cost_after):
        parts.append(f"{number(fiducials)} (fiducials)")
    return f"{' + '.join(parts)} = {number(optimisation.cost_after)}"


def _front_notes(optimisation: Optimisation) -> tuple[Block, ...]:
    """What the limits of the front are of, and why points have no design."""
    if not optimisation.front:
        return ()
    checks = optimisation.certificate.verification.verdict.checks
    first = next(check.requirement for check in checks if check.requirement not in optimisation.not_asked)
    note = (
        f"limit, estimate and simulation are of {first}; every other limit is scaled by the same factor. What "
        "each point's design is stands in the JSON answer (--json)"
    )
    if optimisation.not_asked:
        note += f"; its points are not judged by what was not asked for ({', '.join(optimisation.not_asked)})"
    refused = (f"{number(point.limit_mm)} mm: {point.note}" for point in optimisation.front if point.note)
    return (say("front", note, *refused),)


def _confidence_sentence(optimisation: Optimisation) -> str:
    """How the best design was found, what is known of better ones, and how it was checked."""
    proof = optimisation.certificate
    check, gap = proof.verification, proof.relaxation.gap_percent
    ended = f"{proof.converged_starts} of {proof.starts} searches from different layouts came to an end"
    optima = len(proof.optima)
    if proof.stopped.startswith("stopped"):
        ended = f"{proof.stopped}, so a longer search may find better; {ended}"
    elif proof.gap is not None and not proof.stopped.startswith("all"):
        ended = f"{proof.stopped} (asked for: {percent(proof.gap, 2)}); {ended}"
    ended += "; all found the same design." if optima == 1 else f" in {optima} different designs; this is the best."
    if gap is None:
        better = "That no other is better is likely, not proved."
    elif gap < LEAST_GAP:
        better = "It is proved of the estimate that with this layout none is cheaper."
    else:
        better = f"It is proved of the estimate that with this layout none is more than {gap:.2g} % cheaper."
    bound = proof.global_bound
    if bound is not None and bound.lower_bound_mm is not None and bound.quantile_mm is not None:
        least, reached = at_most(bound.lower_bound_mm), number(bound.quantile_mm)
        better += " It is proved of the estimate that at these tolerances "
        better += "" if optimisation.aimed is None else "and in any views that the certificate names "
        better += "no layout of so many fiducials brings what "
        better += f"{bound.requirement} limits below {least} mm at {bound.target}, where it is {reached} mm."
    if proof.cheapest is not None and (gap := proof.cheapest.gap_percent) is not None:
        better += " It is proved of the estimate that no layout of so many fiducials can cost less than "
        better += f"{at_most(proof.cheapest.lower_bound or 0.0, 4)}; this one costs {number(optimisation.cost_after)} "
        better += f"({percent(gap / 100, 2)} % more)."
    checked = f"Checked by a simulation of {check.trials:,} new shots, to ± {percent(check.precision_reached, 2)} %"
    margin = 1 - (optimisation.cost_exact_law or inf) / optimisation.cost_after if optimisation.cost_after else 0.0
    checked += f", a margin that costs {percent(margin, 1)} %." if margin >= DEAR_MARGIN else "."
    return f"{ended} {better} {checked}"


def certificate_blocks(optimisation: Optimisation) -> tuple[Block, ...]:
    """Starts, distinct optima, lower bound, why the search ended, and the check."""
    proof, optima = optimisation.certificate, len(optimisation.certificate.optima)
    check = proof.verification
    shown = f"the first {MOST_OPTIMA} of {optima}" if optima > MOST_OPTIMA else f"{optima}"
    pairs = [
        ("Residual of the optimality conditions", f"{proof.kkt_residual:.2g}"),
        ("Starts", f"{proof.converged_starts} of {proof.starts} converged, seed {proof.seed}"),
        ("Distinct optima", f"{_optima_words(optimisation)} ({shown})"),
        ("Lower bound", proof.relaxation.statement),
        *([("What any layout could reach", proof.global_bound.statement)] if proof.global_bound else ()),
        *([("How cheap any layout could be", proof.cheapest.statement)] if proof.cheapest else ()),
        ("Ending", proof.stopped),
        ("Check", f"{check.trials:,} fresh trials with seed {check.seed}, to {percent(check.precision_reached, 2)} %"),
        ("Rounds of tightening", str(proof.tightening_rounds)),
    ]
    if optimisation.cost_closed_form is not None:
        what = "Cost of half-widths and moves" if optimisation.cost_of_moves else "Cost of the half-widths"
        pairs.append((what, _compare_costs(optimisation, optimisation.cost_closed_form)))
    remarks = tuple(entry.message for entry in optimisation.influence)
    return (
        group(Facts("Certificate", tuple(pairs)), optima_table(optimisation)),
        group(*((Bullets(remarks),) if remarks else ()), on=PAPER),
    )


def _compare_costs(optimisation: Optimisation, closed_form: float) -> str:
    """What the half-widths cost by each of the laws that they were chosen with."""
    own = sum(entry.cost_after for entry in optimisation.tolerances) + optimisation.cost_of_moves
    others = optimisation.cost_after - own  # fiducials, and a view that was added
    by_law = optimisation.cost_exact_law
    exact = "" if by_law is None else f"{number(by_law - others, 5)} by the exact law, "
    text = f"{number(closed_form, 5)} by the smooth closed form, {exact}{number(own, 5)} with the margin of the check"
    return text + (", grades chosen" if any(entry.grade is not None for entry in optimisation.tolerances) else "")


def _optima_words(optimisation: Optimisation) -> str:
    """What the values of distinct optima are."""
    if optimisation.scaling is not None:
        return "common factor, by the closed form that ranks them"
    if optimisation.cost_closed_form is None:
        return "largest quantile over its limit, by the closed form that ranks them"
    return "cost, by the closed form that ranks them"


def _list_design(design: dict[str, object], caption: str) -> tuple[Block, ...]:
    return (design_listing(design, caption),)


def design_listing(design: dict[str, object], caption: str) -> Listing:
    """A design as text that loads as the same design, but for the bytes of surfaces."""
    for pointer in ("/optimise/region/surface/content", "/optimise/regions/*/surface/content"):
        for place in find_places(design, pointer):  # base64, by the page
            count = len(value_at(design, place))
            design = replace_value(design, place, f"{count} characters of base64, left out here")
    return Listing(data_to_yaml(design).rstrip("\n"), caption)
