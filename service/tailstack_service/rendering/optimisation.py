"""An optimised design as text: before and after, what moved, what binds, what the certificate says."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Optimisation, SurvivedLoss, Vector3
from tailstack.results.verdicts import STATED

from .page import current
from .tables import decimal, number, percent, spell_count, table, visible, wrap
from .verdict import (
    checks_table,
    decided_by,
    decision_text,
    findings_text,
    heading,
    join_blocks,
    more_text,
    provenance_text,
    verdict_line,
)

MOST_OPTIMA = 5
LEAST_GAP = 0.05  # per cent: less is none


def optimisation_text(result: Optimisation) -> str:
    """The whole result; the verdict at the end is that of the Monte Carlo check with a fresh seed."""
    check = result.certificate.verification
    return join_blocks(
        heading(result.provenance, f"Optimised: {result.objective}.", "first order with the exact law"),
        decision_text(check.verdict),
        findings_text(result.influence),
        before_after_text(result),
        moved_text(result),
        mounts_text(result),
        tolerances_text(result),
        prices_text(result),
        counts_text(result),
        front_text(result),
        certificate_text(result) if current().details else confidence_text(result),
        provenance_text(result.provenance),
        checks_table(check.verdict.checks),
        others_text(result),
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
    """P95 and cost, before and after, and what the cost is made of."""
    worst = result.worst_target
    low, high = worst.p95_interval_mm
    rows = [
        ("P95, estimate", "mm", decimal(result.p95_before_mm, 4), decimal(result.p95_after_mm, 4),
         _change(result.p95_before_mm, result.p95_after_mm)),
        ("P95, simulated", "mm", "-", f"{worst.p95_mm:.4f}", f"{low:.3f} .. {high:.3f}"),
    ]  # fmt: skip
    if result.cost_before or result.cost_after:
        before, after = number(result.cost_before), number(result.cost_after)
        rows.append(("cost", "", before, after, _change(result.cost_before, result.cost_after)))
    lines = [table(("", "unit", "before", "after", "change"), rows, left=2), ""]
    if made_of := _cost_in_words(result):
        lines.append(wrap(made_of, first="cost: ", indent="  "))
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


def survived_sentence(worst: SurvivedLoss) -> str:
    """What the new design comes to without the fiducials whose loss is worst."""
    low, high = worst.interval_mm
    ends = f"{low:.3f} to {'unknown' if high is None else f'{high:.3f}'}"
    lost = " and ".join(map(visible, worst.lost))
    return (
        f"without {lost}, the worst to lose, P95 at {visible(worst.target)} is {worst.estimate_mm:.4f} mm by estimate "
        f"and {worst.p95_mm:.4f} mm ({ends}) simulated, within the limit of {worst.limit_mm:g} mm."
    )


def _change(before: float | None, after: float) -> str:
    return f"{100 * (after / before - 1):+.1f} %" if before else "-"


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


def moved_text(result: Optimisation) -> str:
    """Fiducials that moved, are new or were left out."""
    changed = [(e.label, e.before_mm, e.after_mm) for e in result.moved if e.before_mm != e.after_mm]
    return _positions("fiducial,\nin con", changed)


def mounts_text(result: Optimisation) -> str:
    """Pivots that moved, and locators that were spread."""
    changed = [(e.label, e.before_mm, e.after_mm) for e in result.pivots if e.before_mm != e.after_mm]
    lines = [_positions("pivot,\nin con", changed)]
    for entry in result.spacings:
        spread = f"{entry.label}, locators {number(entry.scale)} times as far from their centre"
        lines.append(wrap(spread, first="spacing: ", indent="  "))
    return "\n".join(line for line in lines if line)


def _positions(what: str, rows: Sequence[tuple[str, Vector3 | None, Vector3 | None]]) -> str:
    if not rows:
        return ""
    header = (what, "before\nx, mm", "\ny, mm", "\nz, mm", "after\nx, mm", "\ny, mm", "\nz, mm", "moved\nmm")
    body = [(label, *_coordinates(before), *_coordinates(after), _way(before, after)) for label, before, after in rows]
    return table(header, body)


def _coordinates(position: Vector3 | None) -> tuple[str, str, str]:
    if position is None:
        return "-", "-", "-"
    x, y, z = (f"{value:.2f}" for value in position)
    return x, y, z


def _way(before: Vector3 | None, after: Vector3 | None) -> str:
    if before is None:
        return "new"
    if after is None:
        return "left out"
    return decimal(sum((a - b) ** 2 for a, b in zip(after, before, strict=True)) ** 0.5, 2)


def tolerances_text(result: Optimisation) -> str:
    """Half-widths that were free, what they move the target by, and what they cost."""
    if not result.tolerances:
        return ""
    rows = [
        (
            entry.label,
            entry.grade or "-",
            entry.unit,
            number(entry.before_half_width, 3),
            number(entry.after_half_width, 3),
            number(entry.at_target_before_mm, 3),
            number(entry.at_target_mm, 3),
            number(entry.cost_before),
            number(entry.cost_after),
        )
        for entry in result.tolerances
    ]
    header = (
        "tolerance\n", "grade\n", "unit\n", "±\nbefore", "±\nafter", "moves the tool\nbefore, mm",
        "moves the tool\nafter, mm", "cost\nbefore", "cost\nafter",
    )  # fmt: skip
    graded = any(entry.grade is not None for entry in result.tolerances)
    kept = [k for k in range(len(header)) if (k != 1 or graded) and (k != 5 or current().details)]
    return table([header[k] for k in kept], [[row[k] for k in kept] for row in rows], left=2 + graded)


def prices_text(result: Optimisation) -> str:
    """What binds, and what giving way there would save."""
    lines = (
        [wrap("; ".join(result.binding), first="what keeps it from being better: ", indent="  ")]
        if result.binding
        else []
    )
    lines += [wrap(price.sentence, first="trade-off: ", indent="  ") for price in result.shadow_prices]
    return "\n".join(lines)


def counts_text(result: Optimisation) -> str:
    """The best design with each number of fiducials that was tried."""
    if not result.counts:
        return ""
    rows = [
        (str(entry.fiducials), entry.note, number(entry.cost), number(entry.worst_ratio)) for entry in result.counts
    ]
    header = ("fiducials", "", "cost", "error over\nlimit")
    kept = [k for k in range(4) if k < 2 or any(row[k] != "-" for row in rows)]
    return table([header[k] for k in kept], [[row[k] for k in kept] for row in rows], left=2)


def front_text(result: Optimisation) -> str:
    """Least cost at a row of limits."""
    if not result.front:
        return ""
    rows = [
        (
            number(point.limit_mm), number(point.cost), decimal(point.quantile_mm, 4),
            decimal(point.verified_upper_mm, 4), point.status,
        )
        for point in result.front
    ]  # fmt: skip
    header = ("limit\nmm", "cost", "estimate\nmm", "simulated, at\nmost, mm", "")
    checks = result.certificate.verification.verdict.checks
    first = next(check.requirement for check in checks if check.requirement not in result.not_asked)
    note = (
        f"limit, estimate and simulation are of {first}; every other limit is scaled by the same factor. What "
        "each point's design is stands in the JSON answer (--json)"
    )
    if result.not_asked:
        note += f"; its points are not judged by what was not asked for ({', '.join(result.not_asked)})"
    refused = [f"{number(point.limit_mm)} mm: {point.note}" for point in result.front if point.note]
    lines = [table(header, rows, left=0), wrap(note, first="front: ", indent="  ")]
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
        checked += (
            f" The half-widths cost {number(result.cost_closed_form, 5)} by the smooth closed form, "
            + ("" if result.cost_exact_law is None else f"{number(result.cost_exact_law, 5)} by the exact law, ")
            + f"{number(sum(entry.cost_after for entry in result.tolerances), 5)} with the margin of the check"
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
    rows = [
        (
            number(optimum.objective, 5),
            str(optimum.starts),
            str(optimum.first_start),
            decimal(optimum.rms_distance_mm, 2),
        )
        for optimum in result.certificate.optima[:MOST_OPTIMA]
    ]
    header = ("objective", "starts", "first\nstart", "fiducials from\nthe best, rms mm")
    text = table(header, rows, left=0)
    return "\n".join("  " + line for line in text.split("\n"))
