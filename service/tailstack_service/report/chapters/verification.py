"""The chapters of a Monte Carlo check."""

from __future__ import annotations

from tailstack.montecarlo import MAX_TRIALS
from tailstack.results import Verification
from tailstack.results.digits import RESOLUTION_MM, in_percent, length, number, percent
from tailstack.results.tables import IN_DETAIL, PAPER, On
from tailstack.results.verdicts import requirements_table
from tailstack.results.verification import estimates_table

from ...rendering.document import (
    Block,
    Bullets,
    Document,
    Facts,
    KeyNumber,
    Paragraph,
    Section,
    compose_document,
    group,
    say,
    tone_of,
    verdict_blocks,
)
from ...rendering.sentences import LOCATED, decision_sentence, ending_of
from ..records import checked_headline
from .score import headline_figure, key_numbers, measures_blocks


def verification_document(check: Verification, sha256: str) -> Document:
    """A check by itself."""
    headline, decimals = checked_headline(check), check.decimals
    found = (
        group(estimates_table(check), group(Paragraph(LOCATED), on=On.PLAIN)),
        *measures_blocks(check),
        group(*verdict_blocks(check.verdict), on=PAPER),
        group(say("how sure", _precision_sentence(check)), say("in the images", _images_sentence(check))),
    )
    return compose_document(
        check,
        sha256,
        (
            Section("Error and requirements", found),
            Section("Method", sampling_blocks(check), on=IN_DETAIL, reader="auditor"),
        ),
        f"tailstack verify design.yaml {drawn_by(check)} --json",
        kind="Monte Carlo check",
        tone=tone_of(check.verdict.status),
        status=check.verdict.status,
        sentence=headline.sentence,
        numbers=(
            *key_numbers(headline, decimals),
            KeyNumber("Trials", f"{check.trials:,}", f"seed {check.seed}"),
            KeyNumber("Estimate / simulation", f"{check.first_order_ratio:.4f}", "ratio of the two P95"),
        ),
        figures=(headline_figure(headline, check.targets, decimals),),
        requirements=requirements_table(check.verdict),
        question=f"Monte Carlo simulation of {check.trials:,} shots, each with its own installation and image noise.",
        method=check.method,
        opening=(decision_sentence(check.verdict) or headline.sentence,),
        findings=check.verdict.findings,
        ending=ending_of(check.verdict, check.provenance),
    )


def _precision_sentence(check: Verification) -> str:
    """How precise the simulation is, the worst that it met, and how far the estimate of a score is from it."""
    reached, wanted = check.precision_reached, check.precision_requested
    worst = max((target.worst_mm for target in check.targets), default=0.0)
    largest = f"the largest error of all shots is {length(worst, check.decimals)} mm"
    seed = f"The same seed ({check.seed}) gives the same digits."
    if max((target.p95_mm for target in check.targets), default=1.0) < RESOLUTION_MM:
        return f"Nothing varies that moves the tool: {largest}, and so is the estimate of `tailstack score`. {seed}"
    known = percent(check.precision_of_p95, 2)
    precise = f"P95 is known to ± {known} %"
    if percent(reached, 2) != known:
        precise += f", what requirements ask for to ± {percent(reached, 2)} % or better"
    if wanted is not None and reached > wanted:
        precise += (
            f", not to the ± {percent(wanted, 2)} % that was wanted: {check.max_trials or 0:,} shots were the "
            "most allowed (--max-trials allows more)"
        )
    gap = check.first_order_ratio - 1
    side = "below" if gap < 0 else "above"
    estimate = "`tailstack score`" if check.losses is None else "such shots, with and without fiducials missed,"
    return f"{precise}; {largest}. The estimate of {estimate} is {percent(abs(gap), 1)} % {side} this P95. {seed}"


def _images_sentence(check: Verification) -> str:
    shots = check.reprojection
    return (
        f"what is left at the fiducials after each view is fitted, to compare with real images: mean "
        f"{number(shots.mean_px, 3)} px, P95 {number(shots.p95_px, 3)} px."
    )


def drawn_by(check: Verification) -> str:
    """The options that draw the same trials."""
    radial = "--method radial " if check.method == "radial" else ""
    if check.precision_requested is None:
        return f"{radial}--trials {check.trials} --seed {check.seed}"
    most = "" if radial or check.max_trials in (None, MAX_TRIALS) else f" --max-trials {check.max_trials}"
    return f"{radial}--precision {check.precision_requested:g} --seed {check.seed}{most}"


def sampling_blocks(check: Verification) -> tuple[Block, ...]:
    """How the trials were drawn, why drawing ended, and what else was seen."""
    flagged = max((target.flagged_trials for target in check.targets), default=0)
    shots = check.reprojection
    losses: tuple[tuple[str, str], ...] = ()
    if check.losses is not None:
        some, none = check.losses.trials_with_losses, check.losses.trials_without_answer
        losses = (("Trials with a fiducial missed", f"{some:,}, of which {none:,} without an answer"),)
    pairs = (
        ("Trials", f"{check.trials:,}"),
        ("Seed", str(check.seed)),
        ("Method", check.method),
        ("Engine", check.engine),
        ("Precision reached", f"{in_percent(check.precision_reached, 2)} of P95 and each required quantile"),
        ("Trials redone", f"{flagged:,}"),
        *losses,
        ("Ending", check.stopping),
        ("Reprojection error", f"mean {shots.mean_px:.3g} px, P95 {shots.p95_px:.3g} px, {shots.trials:,} trials"),
    )
    sentences = (
        "Each trial draws every tolerance and every image noise, runs the estimator itself (resection, triangulation, "
        "chain to the tool) and measures the error; nothing is linearised.",
        "Intervals are order-statistic intervals that assume no law; looks at the running sample are corrected for.",
        *check.provenance.notes,
    )
    return Facts("Sampling", pairs), group(Bullets(sentences), on=PAPER)
