"""An optimised design as text: before and after, what moved, what binds, what the certificate says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tailstack.results import Optimisation, SurvivedLoss
from tailstack.results.digits import count_decimals, decimal, exact, number, percent
from tailstack.results.optimisation import (
    MOST_OPTIMA,
    changes_table,
    counts_table,
    front_table,
    moved_table,
    optima_table,
    pivots_table,
)
from tailstack.results.tables import On, Table
from tailstack.results.verdicts import STATED, decided_by

from .page import current
from .tables import draw_table, spell_count, visible, wrap, write_table
from .verdict import (
    decision_text,
    findings_text,
    heading,
    join_blocks,
    more_text,
    provenance_text,
    requirements_text,
    verdict_line,
)

LEAST_GAP = 0.05  # per cent: less is none


def optimisation_text(result: Optimisation) -> str:
    """The whole result; the verdict at the end is that of the Monte Carlo check with a fresh seed."""
    check = result.certificate.verification
    return join_blocks(
        heading(result.provenance, f"Optimised: {result.objective}.", "first order with the exact law"),
        decision_text(check.verdict, result.not_asked),
        requirements_text(check.verdict),
        others_text(result),
        findings_text(result.influence),
        before_after_text(result),
        _shown(moved_table(result)),
        mounts_text(result),
        _shown(changes_table(result)),
        prices_text(result),
        _shown(counts_table(result)),
        front_text(result),
        certificate_text(result) if current().details else confidence_text(result),
        provenance_text(result.provenance),
        findings_text([one for one in check.verdict.findings if current().details or one.rule not in STATED]),
        more_text(),
        verdict_line(check.verdict),
    )


def others_text(result: Optimisation) -> str:
    """Requirements that the optimiser was not asked to keep, with what became of them."""
    if not result.others:
        return ""
    listed = "; ".join(
        f"{worst.requirement}, target {worst.target}: {worst.status}" for worst, _ in decided_by(result.others)
    )
    words = f"{listed}. The design was optimised without these (optimise.requirement); the verdict is of all."
    return wrap(words, first="not asked for: ", indent="  ")


def before_after_text(result: Optimisation) -> str:
    """What each requirement limits, before and after, by estimate; cost, and what it is made of."""
    lines = [_estimates_text(result), ""]
    if result.cost_before or result.cost_after:
        before, after = number(result.cost_before), number(result.cost_after)
        change = "" if not result.cost_before else f" ({100 * (result.cost_after / result.cost_before - 1):+.0f} %)"
        made_of = _cost_in_words(result)
        words = f"{after}, before {before}{change}" + (f"; {made_of}" if made_of else "")
        lines.append(wrap(words, first="cost: ", indent="  "))
    if result.scaling is not None:
        lines.append(wrap(f"all free half-widths times {number(result.scaling)}", first="scaling: ", indent="  "))
    if result.survived is not None:
        lines.append(wrap(survived_sentence(result.survived), first="if fiducials are lost: ", indent="  "))
    if result.view_offer is not None:
        lines.append(wrap(visible(result.view_offer.sentence), first="a view more: ", indent="  "))
    if result.aimed is not None:
        lines.append(wrap(visible(result.aimed.sentence), first="views: ", indent="  "))
    if result.placement_value is not None:
        lines.append(wrap(result.placement_value.sentence, first="places of the fiducials: ", indent="  "))
    return "\n".join(lines).rstrip("\n")


def _estimates_text(result: Optimisation) -> str:
    """For each requirement its value by estimate in the design as it stood and in the new one, at one target."""
    checks = result.certificate.verification.verdict.checks
    decimals = max((count_decimals(check.limit_mm) for check in checks), default=3)  # of an estimate
    old, new = (_estimates_of(data) for data in (result.design_before, result.design))
    rows = []
    for check, _ in decided_by(checks):
        key = (check.requirement, check.target)
        rows.append((check.requirement, check.target, decimal(old.get(key), decimals), decimal(new.get(key), decimals),
                     exact(check.limit_mm, decimals)))  # fmt: skip
    header = ("by estimate,\nrequirement", "target", "before\nmm", "after\nmm", "limit\nmm")
    return draw_table(header, rows, left=2)


def _estimates_of(data: Mapping[str, object]) -> dict[tuple[str, str], float]:
    """What each requirement limits at each target, mm; nothing where the layout does not determine an answer."""
    from tailstack.design import load_design
    from tailstack.errors import TailstackError
    from tailstack.scoring import score

    try:
        found = score(load_design(data, allow_files=False), losses=False)
    except TailstackError:  # the design as it stood may not be one that can be computed
        return {}
    return {(check.requirement, check.target): check.value_mm for check in found.verdict.checks}


def survived_sentence(worst: SurvivedLoss) -> str:
    """What the new design comes to without the fiducials whose loss is worst."""
    low, high = worst.interval_mm
    decimals = count_decimals(worst.limit_mm)
    ends = f"{low:.{decimals}f} to {'unknown' if high is None else f'{high:.{decimals}f}'}"
    lost = " and ".join(map(visible, worst.lost))
    return (
        f"without {lost}, the worst to lose, P95 at {visible(worst.target)} is {worst.estimate_mm:.{decimals}f} mm by "
        f"estimate and {worst.p95_mm:.{decimals}f} mm ({ends}) simulated, within the limit of {worst.limit_mm:g} mm."
    )


def _cost_in_words(result: Optimisation) -> str:
    """Sums over each interface's half-widths; what is left of the total is the price of the fiducials."""
    if not result.tolerances:
        return ""
    widths: dict[str, list[float]] = {}
    names: dict[str, str] = {}
    for entry in result.tolerances:
        names.setdefault(entry.contributor, entry.label.removesuffix(f" {entry.component}"))
        widths.setdefault(entry.contributor, []).append(entry.cost_after)
    parts = [
        f"{number(sum(costs))} ({names[name]}, {spell_count(len(costs), 'half-width')})"
        for name, costs in widths.items()
    ]
    view = 0.0
    if result.view_offer is not None and result.view_offer.added:
        view = result.view_offer.price
        parts.append(f"{number(view)} (view {visible(result.view_offer.view)})")
    fiducials = result.cost_after - view - sum(map(sum, widths.values()))
    if abs(fiducials) > 1e-6 * abs(result.cost_after):
        parts.append(f"{number(fiducials)} (fiducials)")
    return f"{' + '.join(parts)} = {number(result.cost_after)}"


def _shown(table: Table) -> str:
    """A table that has rows on a terminal."""
    return write_table(table) if table.on(On.PLAIN).rows else ""


def mounts_text(result: Optimisation) -> str:
    """Pivots that moved, and locators that were spread."""
    lines = [_shown(pivots_table(result))]
    for entry in result.spacings:
        spread = f"{entry.label}, locators {number(entry.scale)} times as far from their centre"
        lines.append(wrap(spread, first="spacing: ", indent="  "))
    return "\n".join(line for line in lines if line)


MOST_BINDING = 4  # without details


def _list_binding(binding: Sequence[str]) -> str:
    if current().details or len(binding) <= MOST_BINDING:
        return "; ".join(binding)
    return f"{'; '.join(binding[:MOST_BINDING])}; and {len(binding) - MOST_BINDING} more (--details)"


def prices_text(result: Optimisation) -> str:
    """What binds, and what giving way there would save."""
    lines = (
        [wrap(_list_binding(result.binding), first="what keeps it from being better: ", indent="  ")]
        if result.binding
        else []
    )
    lines += [wrap(price.sentence, first="trade-off: ", indent="  ") for price in result.shadow_prices]
    return "\n".join(lines)


def front_text(result: Optimisation) -> str:
    """Least cost at a row of limits."""
    if not result.front:
        return ""
    checks = result.certificate.verification.verdict.checks
    first = next(check.requirement for check in checks if check.requirement not in result.not_asked)
    note = (
        f"limit, estimate and simulation are of {first}; every other limit is scaled by the same factor. What "
        "each point's design is stands in the JSON answer (--json)"
    )
    if result.not_asked:
        note += f"; its points are not judged by what was not asked for ({', '.join(result.not_asked)})"
    refused = [f"{number(point.limit_mm)} mm: {point.note}" for point in result.front if point.note]
    lines = [write_table(front_table(result)), wrap(note, first="front: ", indent="  ")]
    return "\n".join([*lines, *(wrap(line, first="front: ", indent="  ") for line in refused)])


def confidence_text(result: Optimisation) -> str:
    """How the best design was found, what is known of better ones, and how it was checked."""
    proof = result.certificate
    check, gap = proof.verification, proof.relaxation.gap_percent
    ended = f"{proof.converged_starts} of {proof.starts} searches from different layouts came to an end"
    optima = len(proof.optima)
    if proof.stopped.startswith("stopped"):
        ended = f"{proof.stopped}, so a longer search may find better; {ended}"
    ended += "; all found the same design." if optima == 1 else f" in {optima} different designs; this is the best."
    if gap is None:
        better = "That no other is better is likely, not proved."
    elif gap < LEAST_GAP:
        better = "It is proved that with this layout none is cheaper."
    else:
        better = f"It is proved that with this layout none is more than {gap:.2g} % cheaper."
    checked = f"Checked by a simulation of {check.trials:,} new shots, to ± {percent(check.precision_reached, 2)} %."
    return wrap(f"{ended} {better} {checked}", first="how sure: ", indent="  ")


def certificate_text(result: Optimisation) -> str:
    """Starts, distinct optima, lower bound, why the search ended, and the check."""
    certificate = result.certificate
    check = certificate.verification
    optima = len(certificate.optima)
    shown = f"the first {MOST_OPTIMA} of {optima}" if optima > MOST_OPTIMA else f"{optima}"
    starts = (
        f"{certificate.converged_starts} of {certificate.starts} starts converged, from seed {certificate.seed}; KKT "
        f"residual {certificate.kkt_residual:.1e}; distinct optima, by the closed form that ranks them ({shown}):"
    )
    checked = (
        f"{check.trials:,} fresh trials with seed {check.seed}, to {percent(check.precision_reached, 2)} %; "
        f"{certificate.tightening_rounds} round(s) of tightening."
    )
    if result.cost_closed_form is not None:
        graded = any(entry.grade is not None for entry in result.tolerances)
        own = sum(entry.cost_after for entry in result.tolerances)
        others = result.cost_after - own  # fiducials, and a view that was added
        checked += (
            f" The half-widths cost {number(result.cost_closed_form, 5)} by the smooth closed form, "
            + (
                ""
                if result.cost_exact_law is None
                else f"{number(result.cost_exact_law - others, 5)} by the exact law, "
            )
            + f"{number(own, 5)} with the margin of the check"
            + (", grades chosen." if graded else ".")
        )
    paragraphs = (
        ("certificate: ", starts),
        ("", _optima_table(result)),
        ("lower bound: ", certificate.relaxation.statement),
        ("search: ", certificate.stopped),
        ("check: ", checked),
    )
    return "\n".join(wrap(text, first=name, indent="  ") if name else text for name, text in paragraphs)


def _optima_table(result: Optimisation) -> str:
    return "\n".join("  " + line for line in write_table(optima_table(result)).split("\n"))
