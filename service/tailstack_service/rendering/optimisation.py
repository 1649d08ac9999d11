"""An optimised design as text: before and after, what moved, what binds, what the certificate says."""

from __future__ import annotations

from tailstack.results import Optimisation

from .tables import fixed, number, percent, table, wrapped
from .verdict import checks_table, findings_text, heading, joined, provenance_text, verdict_line


def optimisation_text(result: Optimisation, *, colour: bool = False) -> str:
    """The whole result; the verdict at the end is that of the Monte Carlo check with a fresh seed."""
    check = result.certificate.verification
    return joined(
        heading(result.provenance, f"optimised: {result.objective}"),
        before_after_text(result),
        moved_text(result),
        tolerances_text(result),
        prices_text(result),
        certificate_text(result),
        provenance_text(result.provenance),
        checks_table(check.verdict.checks),
        findings_text(check.verdict.findings, colour),
        verdict_line(check.verdict, colour),
    )


def before_after_text(result: Optimisation) -> str:
    """Cost and P95, before and after."""
    worst = max(result.certificate.verification.targets, key=lambda target: target.p95_mm)
    low, high = worst.p95_interval_mm
    rows = (
        ("P95, first order", "mm", fixed(result.p95_before_mm, 4), fixed(result.p95_after_mm, 4),
         _change(result.p95_before_mm, result.p95_after_mm)),
        ("P95, Monte Carlo check", "mm", "-", f"{worst.p95_mm:.4f}", f"[{low:.3f}, {high:.3f}]"),
        ("cost of the tolerances", "1/rad", number(result.cost_before), number(result.cost_after),
         _change(result.cost_before, result.cost_after)),
    )  # fmt: skip
    return table(("", "unit", "before", "after", "change"), rows, left=2)


def _change(before: float | None, after: float) -> str:
    return f"{100 * (after / before - 1):+.1f} %" if before else "-"


def moved_text(result: Optimisation) -> str:
    moved = [entry for entry in result.moved if entry.before_mm != entry.after_mm]
    if not moved:
        return ""
    rows = [
        (
            entry.label,
            *(f"{value:.2f}" for value in entry.before_mm),
            *(f"{value:.2f}" for value in entry.after_mm),
            fixed(sum((a - b) ** 2 for a, b in zip(entry.after_mm, entry.before_mm, strict=True)) ** 0.5, 2),
        )
        for entry in moved
    ]
    header = (
        "fiducial\n(con frame)", "before\nx, mm", "\ny, mm", "\nz, mm", "after\nx, mm", "\ny, mm", "\nz, mm",
        "moved\nmm",
    )  # fmt: skip
    return table(header, rows)


def tolerances_text(result: Optimisation) -> str:
    if not result.tolerances:
        return ""
    rows = [
        (
            f"{entry.contributor}.{entry.component}",
            entry.unit,
            number(entry.before_half_width, 3),
            number(entry.after_half_width, 3),
            number(entry.at_target_mm, 3),
            number(entry.cost_before),
            number(entry.cost_after),
        )
        for entry in result.tolerances
    ]
    header = (
        "tolerance\n(half-width)", "unit", "before\nunit", "after\nunit", "moves the\ntarget, mm", "cost\nbefore",
        "cost\nafter",
    )  # fmt: skip
    return table(header, rows, left=2)


def prices_text(result: Optimisation) -> str:
    """What binds, and what giving way there would save."""
    lines = [wrapped("; ".join(result.binding), first="binding: ", indent="  ")] if result.binding else []
    lines += [wrapped(price.sentence, first="worth: ", indent="  ") for price in result.shadow_prices]
    return "\n".join(lines)


def certificate_text(result: Optimisation) -> str:
    certificate = result.certificate
    check = certificate.verification
    best = ", ".join(number(cost, 5) for cost in certificate.best_costs[:5])
    sentence = (
        f"{certificate.converged_starts} of {certificate.starts} starts converged, best costs {best} "
        "before the exact law and the check took their share; KKT residual "
        f"{certificate.kkt_residual:.1e}; {certificate.tightening_rounds} round(s) of tightening; starts from seed "
        f"{certificate.seed}, checked by {check.trials:,} fresh trials with seed {check.seed} to "
        f"{percent(check.precision_reached, 2)} %."
    )
    return wrapped(sentence, first="certificate: ", indent="  ")
