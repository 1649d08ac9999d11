"""The chapters of a Monte Carlo check."""

from __future__ import annotations

from tailstack.precision import MAX_TRIALS
from tailstack.results import Verification
from tailstack.results.digits import in_percent
from tailstack.results.verdicts import checks_table, findings_table, requirements_table
from tailstack.results.verification import estimates_table

from ..blocks import Block, Bullets, Document, Facts, Figure, KeyNumber, Listing, Section, tone_of
from ..charts import Scaled, draw_scale
from ..headline import checked_headline
from .score import headline_figure, key_numbers
from .tables import not_included, provenance_facts


def verification_document(check: Verification, sha256: str) -> Document:
    """A check by itself."""
    headline, decimals = checked_headline(check), check.decimals
    figures = []
    for k, target in enumerate(sorted(check.targets, key=lambda entry: entry.p95_mm, reverse=True)[:3]):
        name = f"scale-{k + 1}"
        limit = target.exceedance.limit_mm if target.exceedance else None
        others = (("mean", target.mean_norm_mm), ("CVaR95", target.cvar95_mm))
        shown = Scaled(target.name, target.p95_mm, target.p95_interval_mm, limit, others, decimals=decimals)
        svg = draw_scale(shown, name)
        figures.append(Figure(name, svg, f"Error at target {target.name}: the bar is the interval of P95."))
    numbers = [
        *key_numbers(headline, decimals),
        KeyNumber("Trials", f"{check.trials:,}", f"seed {check.seed}"),
        KeyNumber("Estimate / simulation", f"{check.first_order_ratio:.4f}", "ratio of the two P95"),
    ]
    return Document(
        kind="Monte Carlo check",
        title=check.provenance.design_name,
        tone=tone_of(check.verdict.status),
        status=check.verdict.status,
        sentence=headline.sentence,
        numbers=tuple(numbers),
        matters=(),
        figures=(headline_figure(headline, check.targets, decimals),),
        requirements=requirements_table(check.verdict),
        sections=(
            Section("Error and requirements", (*verification_blocks(check), *figures)),
            Section("Method", sampling_blocks(check), reader="auditor"),
            Section("What is not included", (not_included(check.provenance),), reader="auditor"),
            Section(
                "Reproduction", (Listing(f"tailstack verify design.yaml {drawn_by(check)} --json"),), reader="auditor"
            ),
        ),
        provenance=provenance_facts(check.provenance, sha256, check.schema),
    )


def drawn_by(check: Verification) -> str:
    """The options that draw the same trials."""
    if check.method == "radial":
        size = f"--trials {check.trials}"
        if check.precision_requested is not None:
            size = f"--precision {check.precision_requested:g}"
        return f"--method radial {size} --seed {check.seed}"
    if check.precision_requested is not None:
        most = "" if check.max_trials in (None, MAX_TRIALS) else f" --max-trials {check.max_trials}"
        return f"--precision {check.precision_requested:g} --seed {check.seed}{most}"
    return f"--trials {check.trials} --seed {check.seed}"


def verification_blocks(check: Verification) -> tuple[Block, ...]:
    blocks: list[Block] = [estimates_table(check)]
    if check.verdict.checks:
        blocks.append(checks_table(check.verdict))
    if check.verdict.findings:
        blocks.append(findings_table(check.verdict.findings))
    return tuple(blocks)


def sampling_blocks(check: Verification) -> tuple[Block, ...]:
    """How the trials were drawn, why drawing ended, and what else was seen."""
    flagged = max((target.flagged_trials for target in check.targets), default=0)
    shots = check.reprojection
    losses: tuple[tuple[str, str], ...] = ()
    if check.losses is not None:
        some, none = check.losses.trials_with_losses, check.losses.trials_without_answer
        losses = (("Trials with a fiducial missed", f"{some:,}, of which {none:,} without an answer"),)
    facts = Facts(
        "Sampling",
        (
            ("Trials", f"{check.trials:,}"),
            ("Seed", str(check.seed)),
            ("Method", check.method),
            ("Engine", check.engine),
            ("Precision reached", f"{in_percent(check.precision_reached, 2)} of P95"),
            ("Trials redone", f"{flagged:,}"),
            *losses,
            ("Reprojection error", f"mean {shots.mean_px:.3g} px, P95 {shots.p95_px:.3g} px, {shots.trials:,} trials"),
        ),
    )
    sentences = (
        f"Ending: {check.stopping}",
        "Each trial draws every tolerance and every image noise, runs the estimator itself (resection, triangulation, "
        "chain to the tool) and measures the error; nothing is linearised.",
        "Intervals are order-statistic intervals that assume no law; looks at the running sample are corrected for.",
        *check.provenance.notes,
    )
    return (facts, Bullets(sentences))
