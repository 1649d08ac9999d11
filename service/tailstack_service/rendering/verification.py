"""The Monte Carlo check as text."""

from __future__ import annotations

from tailstack.results import MetricEstimate, TargetEstimate, Verification

from .page import current
from .score import LOCATED, located_sentence
from .sentences import largest_sentence
from .tables import decimal, number, percent, table, wrap
from .verdict import decision_text, heading, join_blocks, provenance_text, verdict_text


def verification_text(verification: Verification) -> str:
    """The whole check: estimates with intervals, against first order, verdict."""
    what = f"Monte Carlo simulation of {verification.trials:,} shots, each with its own installation and image noise."
    return join_blocks(
        heading(verification.provenance, what, verification.method),
        _opening(verification),
        estimates_text(verification),
        sampling_text(verification) if current().details else sampling_sentence(verification),
        provenance_text(verification.provenance),
        verdict_text(verification.verdict),
    )


def _opening(verification: Verification) -> str:
    if verification.verdict.checks:
        return decision_text(verification.verdict)
    worst = max(verification.targets, key=lambda target: target.p95_mm)
    return wrap(largest_sentence(worst.name, worst.p95_mm, worst.p95_interval_mm))


def estimates_text(verification: Verification) -> str:
    """Two rows per target: error at the tool, and of the located target."""
    details = current().details
    cells = _row if details else _short_row
    rows = []
    for target in verification.targets:
        rows += [cells(target.name, target), cells(LOCATED, target.localisation)]
    confidence = f"{100 * verification.targets[0].confidence:g} %" if verification.targets else ""
    if details:
        return table(
            (
                "target", "|bias|\nmm", "std x\nmm", "std y\nmm", "std z\nmm", "mean\nmm", "P95\nmm",
                f"interval {confidence}\nmm", "CVaR95\nmm", "beyond\nlimit, %", "FO /\nMC",
            ),
            rows,
        )  # fmt: skip
    header = (
        "error at the tool,\nby target", "mean\nmm", "P95\nmm", f"between, {confidence}\nsure, mm",
        "mean of worst\n5 %, mm", "over the\nlimit, %",
    )  # fmt: skip
    return table(header, rows) + "\n" + wrap(located_sentence())


def _short_row(name: str, metric: TargetEstimate | MetricEstimate) -> tuple[str, ...]:
    low, high = metric.p95_interval_mm
    return (
        name, decimal(metric.mean_norm_mm, 3), decimal(metric.p95_mm, 4), f"{low:.3f} .. {high:.3f}",
        decimal(metric.cvar95_mm, 3), percent(metric.exceedance.probability if metric.exceedance else None, 2),
    )  # fmt: skip


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


def sampling_sentence(verification: Verification) -> str:
    """How precise the simulation is, the worst that it met, and how far the estimate of a score is from it."""
    reached, wanted = verification.precision_reached, verification.precision_requested
    worst = max((target.worst_mm for target in verification.targets), default=0.0)
    precise = f"P95 is known to ± {percent(reached, 2)} %"
    if wanted is not None and reached > wanted:
        precise += (
            f", not to the ± {percent(wanted, 2)} % that was wanted: {verification.max_trials or 0:,} shots were the "
            "most allowed (--max-trials allows more)"
        )
    gap = verification.first_order_ratio - 1
    side = "below" if gap < 0 else "above"
    shots = verification.reprojection
    estimate = "`tailstack score`" if verification.losses is None else "such shots, with and without fiducials missed,"
    return "\n".join((
        wrap(
            f"{precise}; the largest error of all shots is {worst:.3f} mm. The estimate of {estimate} is "
            f"{percent(abs(gap), 1)} % {side} this P95. The same seed ({verification.seed}) gives the same digits.",
            first="how sure: ", indent="  ",
        ),
        wrap(
            f"what is left at the fiducials after each view is fitted, to compare with real images: mean "
            f"{number(shots.mean_px, 3)} px, P95 {number(shots.p95_px, 3)} px.",
            first="in the images: ", indent="  ",
        ),
    ))  # fmt: skip


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
            f"worst error met {worst:.3f} mm; {flagged:,} trial(s) redone; reprojection error mean "
            f"{number(shots.mean_px, 3)} px, P95 {number(shots.p95_px, 3)} px over {shots.trials:,} trials; first "
            f"order over Monte Carlo P95 {verification.first_order_ratio:.4f}.",
            first="also: ",
            indent="  ",
        ),
    ]
    return "\n".join(lines)
