"""The Monte Carlo check as text."""

from __future__ import annotations

from tailstack.results import Verification
from tailstack.results.digits import number, percent
from tailstack.results.verification import estimates_table

from .page import current
from .score import located_sentence
from .sentences import largest_sentence
from .tables import wrap, write_table
from .verdict import decision_text, heading, join_blocks, provenance_text, requirements_text, verdict_text


def verification_text(verification: Verification) -> str:
    """The whole check: estimates with intervals, against first order, verdict."""
    what = f"Monte Carlo simulation of {verification.trials:,} shots, each with its own installation and image noise."
    return join_blocks(
        heading(verification.provenance, what, verification.method),
        _opening(verification),
        requirements_text(verification.verdict),
        write_table(estimates_table(verification)) + ("" if current().details else "\n" + wrap(located_sentence())),
        sampling_text(verification) if current().details else sampling_sentence(verification),
        provenance_text(verification.provenance),
        verdict_text(verification.verdict),
    )


def _opening(verification: Verification) -> str:
    if verification.verdict.checks:
        return decision_text(verification.verdict)
    worst = max(verification.targets, key=lambda target: target.p95_mm)
    return wrap(largest_sentence(worst.name, worst.p95_mm, worst.p95_interval_mm))


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
    shots, decimals = verification.reprojection, verification.decimals
    estimate = "`tailstack score`" if verification.losses is None else "such shots, with and without fiducials missed,"
    return "\n".join((
        wrap(
            f"{precise}; the largest error of all shots is {worst:.{decimals}f} mm. The estimate of {estimate} "
            f"is {percent(abs(gap), 1)} % {side} this P95. The same seed ({verification.seed}) gives the same digits.",
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
    shots, decimals = verification.reprojection, verification.decimals
    lines = [
        wrap(
            f"{verification.trials:,} trials, seed {verification.seed}, {verification.engine}; precision reached "
            f"{percent(verification.precision_reached, 2)} %. {verification.stopping}",
            first="sampling: ",
            indent="  ",
        ),
        wrap(
            f"worst error met {worst:.{decimals}f} mm; {flagged:,} trial(s) redone; reprojection error mean "
            f"{number(shots.mean_px, 3)} px, P95 {number(shots.p95_px, 3)} px over {shots.trials:,} trials; first "
            f"order over Monte Carlo P95 {verification.first_order_ratio:.4f}.",
            first="also: ",
            indent="  ",
        ),
    ]
    return "\n".join(lines)
