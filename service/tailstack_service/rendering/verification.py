"""The Monte Carlo check as text."""

from __future__ import annotations

from tailstack.results import MetricEstimate, TargetEstimate, Verification

from .tables import decimal, number, percent, table, wrap
from .verdict import heading, join_blocks, provenance_text, verdict_text


def verification_text(verification: Verification, *, colour: bool = False) -> str:
    """The whole check: estimates with intervals, against first order, verdict."""
    return join_blocks(
        heading(verification.provenance, f"Monte Carlo, {verification.method}"),
        estimates_text(verification),
        sampling_text(verification),
        provenance_text(verification.provenance),
        verdict_text(verification.verdict, colour),
    )


def estimates_text(verification: Verification) -> str:
    rows = []
    for target in verification.targets:
        rows.append(_row(target.name, target))
        rows.append(_row("  as localised", target.localisation))
    confidence = f"{100 * verification.targets[0].confidence:g} %" if verification.targets else ""
    header = (
        "target", "|bias|\nmm", "std x\nmm", "std y\nmm", "std z\nmm", "mean\nmm", "P95\nmm",
        f"interval {confidence}\nmm", "CVaR95\nmm", "beyond\nlimit, %", "FO /\nMC",
    )  # fmt: skip
    return table(header, rows, widest=30)


def _row(name: str, metric: TargetEstimate | MetricEstimate) -> tuple[str, ...]:
    bias = sum(component**2 for component in metric.bias_mm) ** 0.5
    low, high = metric.p95_interval_mm
    return (
        name,
        decimal(bias, 3),
        *(decimal(value, 3) for value in metric.std_mm),
        decimal(metric.mean_norm_mm, 3),
        decimal(metric.p95_mm, 4),
        f"{low:.3f} .. {high:.3f}",
        decimal(metric.cvar95_mm, 3),
        percent(metric.exceedance.probability if metric.exceedance else None, 2),
        decimal(metric.first_order_ratio, 4),
    )


def sampling_text(verification: Verification) -> str:
    """How it was sampled, in sentences."""
    flagged = max((target.flagged_trials for target in verification.targets), default=0)
    worst = max((target.worst_mm for target in verification.targets), default=0.0)
    shots = verification.reprojection
    lines = [
        wrap(
            f"{verification.trials:,} trials, seed {verification.seed}, {verification.engine}; precision reached "
            f"{percent(verification.precision_reached, 2)} %. {verification.stopping}",
            first="sampling: ",
            indent="  ",
        ),
        wrap(
            f"worst error met {worst:.3f} mm; {flagged:,} trial(s) redone by SVD; reprojection error mean "
            f"{number(shots.mean_px, 3)} px, P95 {number(shots.p95_px, 3)} px over {shots.trials:,} trials; first "
            f"order over Monte Carlo P95 {verification.first_order_ratio:.4f}.",
            first="also: ",
            indent="  ",
        ),
    ]
    return "\n".join(lines)
