"""Tables that several kinds of results share."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import (
    ERRORS,
    Check,
    Contributor,
    Finding,
    MetricEstimate,
    MetricScore,
    Provenance,
    Score,
    TargetEstimate,
    TargetScore,
    Verdict,
    Verification,
    ViewCheck,
)
from tailstack.results import headline_of as words
from tailstack.results.verdicts import urgency

from ...rendering.score import group, heading_of
from ...rendering.sentences import name_basis
from ...rendering.verdict import decided_by
from ..blocks import Bullets, Cell, Column, Facts, Row, Table
from ..records import Allowance

BUDGET_NOTE = (
    "Half-width, standard deviation and sensitivity are per component in the unit named (image noise: one standard "
    "deviation); dP95/dh is what one unit of it changes P95 by. A line of a whole contributor sums up the components "
    "below it."
)
SLACK_NOTE = (
    " Half-width at limit: the one at which the tightest requirement on all units together is just met, by "
    "estimate, if nothing else changes; slack is what is left to it, negative where it has to shrink, empty where not "
    "even zero is enough. Slack can be spent once: two tolerances cannot both use it up."
)
COST_NOTE = " Cost: by the prices of the design's optimise section; a half-width without a price has none."


def targets_table(score: Score) -> Table:
    """First order: error at the tool, and as localised before the second interface; largest P95 first."""
    rows = []
    for target in sorted(score.targets, key=lambda entry: entry.p95_mm, reverse=True):
        rows.append(_target_row(target.name, target))
        rows.append(_target_row("as located", target.localisation, 1))
    return Table(
        name="Targets",
        caption="Estimate: the error at each target, in the frame named",
        columns=(
            Column("Target"), Column("Frame"), *_axes("Bias"), *_axes("Std"), Column("Mean |e|", "mm", "fixed"),
            Column("P95", "mm", "fixed", 4), Column("CVaR95", "mm", "fixed"), Column("Limit", "mm", "significant", 4),
            Column("Beyond limit", "%", "percent", 2),
        ),
        rows=tuple(rows),
        note="Bias and standard deviation by axis of the frame; P95 and CVaR95 (the mean of the worst 5 %) of the "
        "error's size, bias included. As located: the target as found in the images, before flange and robot.",
    )  # fmt: skip


def _axes(word: str) -> tuple[Column, Column, Column]:
    x, y, z = (Column(f"{word} {axis}", "mm", "fixed") for axis in "xyz")
    return x, y, z


def _target_row(name: str, metric: TargetScore | MetricScore, depth: int = 0) -> Row:
    return Row(
        (
            name, metric.frame, *metric.bias_mm, *metric.std_mm, metric.mean_norm_mm, metric.p95_mm, metric.cvar95_mm,
            metric.limit_mm, metric.exceedance_probability,
        ),
        depth,
    )  # fmt: skip


def estimates_table(check: Verification, of: str = "") -> Table:
    """Monte Carlo: the same with intervals, and first order over it."""
    rows = []
    for target in sorted(check.targets, key=lambda entry: entry.p95_mm, reverse=True):
        rows.append(_estimate_row(target.name, target))
        rows.append(_estimate_row("as located", target.localisation, 1))
    confidence = f"{100 * check.targets[0].confidence:g} %" if check.targets else ""
    return Table(
        name="Monte Carlo",
        caption=f"Simulation (Monte Carlo){of}: the error at each target; intervals of {confidence} confidence",
        columns=(
            Column("Target"), *_axes("Bias"), *_axes("Std"), Column("Mean |e|", "mm", "fixed"),
            Column("P95", "mm", "fixed", 4), Column("P95 from", "mm", "fixed", 4), Column("P95 to", "mm", "fixed", 4),
            Column("CVaR95", "mm", "fixed"), Column("Worst met", "mm", "fixed"),
            Column("Beyond limit", "%", "percent", 2), Column("Estimate / simulated", "", "fixed", 4),
        ),
        rows=tuple(rows),
    )  # fmt: skip


def _estimate_row(name: str, metric: TargetEstimate | MetricEstimate, depth: int = 0) -> Row:
    return Row(
        (
            name, *metric.bias_mm, *metric.std_mm, metric.mean_norm_mm, metric.p95_mm, *metric.p95_interval_mm,
            metric.cvar95_mm, metric.worst_mm, metric.exceedance.probability if metric.exceedance else None,
            metric.first_order_ratio,
        ),
        depth,
    )  # fmt: skip


def requirements_table(verdict: Verdict) -> Table | None:
    """Each requirement once, at the target that decides it; what fails and what is nearest to its limit first."""
    rows = [Row(requirement_cells(check, count)) for check, count in decided_by(verdict.checks)]
    if not rows:
        return None
    caption = f"Requirements, by {name_basis(verdict.basis)}"
    return Table("Requirements", caption, REQUIREMENT_COLUMNS, tuple(rows), MARGIN_NOTE)


DECIDED = (
    Column("Value", "mm", "fixed", 4), Column("From", "mm", "fixed", 4), Column("To", "mm", "fixed", 4),
    Column("Limit", "mm", "significant", 4), Column("Margin", "mm", "signed", 4), Column("Status", kind="status"),
)  # fmt: skip
REQUIREMENT_COLUMNS = (Column("Requirement"), Column("Target"), Column("What is limited"), *DECIDED)
MARGIN_NOTE = "Margin: the limit less the upper end of the interval. A requirement passes where it is not negative."


def requirement_cells(check: Check, count: int) -> tuple[Cell, ...]:
    """In the order of REQUIREMENT_COLUMNS; ``count`` targets are checked, of which this one decides."""
    target = check.target + (f" (worst of {count})" if count > 1 else "")
    return (
        check.requirement, target, what_is_limited(check), check.value_mm, *check.interval_mm, check.limit_mm,
        check.margin_mm, check.status,
    )  # fmt: skip


def what_is_limited(check: Check) -> str:
    return words(check.quantile, check.min_yield, ERRORS[check.error])


def checks_table(*verdicts: Verdict, name: str = "Checks", of: str = "") -> Table:
    """Each requirement at each target, by each way it was judged; what fails and what is nearest to its limit first."""
    judged = [(verdict.basis, check) for verdict in verdicts for check in verdict.checks]
    rows = [
        Row((
            check.requirement, check.target, what_is_limited(check), name_basis(basis), check.yield_fraction,
            check.min_yield, check.value_mm, *check.interval_mm, check.limit_mm, check.margin_mm, check.status,
        ))
        for basis, check in sorted(judged, key=lambda entry: urgency(entry[1]))
    ]  # fmt: skip
    return Table(
        name=name,
        caption=f"Requirements{of}",
        columns=(
            Column("Requirement"), Column("Target"), Column("What is limited"), Column("By"),
            Column("Yield", "%", "percent", 2), Column("Required", "%", "percent", 2), *DECIDED,
        ),
        rows=tuple(rows),
        note="A requirement passes only if the upper end of the interval is within the limit, and fails only if the "
        f"lower end is beyond it. {MARGIN_NOTE} Estimate: the interval is how far a simulation may "
        "be from it.",
    )  # fmt: skip


def budget_table(target: TargetScore, name: str = "Budget", allowances: Sequence[Allowance] = ()) -> Table:
    """Every contributor and component: tolerance, sensitivity, share, marginal P95, P95 without; slack and cost."""
    rows = []
    known = {(entry.contributor, entry.component): entry for entry in allowances if entry.target == target.name}
    for total, components in group(target.contributors):
        for depth, entry in ((0, total), *((1, part) for part in components)):
            label = heading_of(entry) if depth == 0 else entry.component
            own = known.get((entry.name, entry.component))
            rows.append(Row(
                (
                    label, entry.law, entry.half_width, entry.unit, entry.std, entry.sensitivity_mm_per_unit,
                    entry.variance_share, entry.dp95_per_unit, entry.p95_without_mm,
                    *(_allowance_cells(own, [part for part in components if (part.name, part.component) in known])),
                ),
                depth,
            ))  # fmt: skip
    with_cost = any(entry.cost is not None for entry in known.values())
    kept = 9 if not known else 13 if with_cost else 12
    return Table(
        name=name,
        caption=f"Budget at target {target.name} (estimate, P95 {target.p95_mm:.4f} mm)",
        columns=(
            Column("Contributor"), Column("Law"), Column("Half-width", "unit", "significant"), Column("Unit"),
            Column("Std", "unit", "significant", on_page=not known),
            Column("Sensitivity", "mm/unit", "significant"),
            Column("Share of variance", "%", "percent", 1), Column("dP95/dh", "mm/unit", "significant"),
            Column("P95 without", "mm", "fixed", 4), Column("Half-width at limit", "unit", "significant"),
            Column("Slack", "unit", "significant"), Column("Slack in words", on_page=False),
            Column("Cost", "", "significant", 4),
        )[:kept],
        rows=tuple(Row(row.cells[:kept], row.depth) for row in rows),
        note=BUDGET_NOTE + (SLACK_NOTE if known else "") + (COST_NOTE if with_cost else ""),
    )  # fmt: skip


def _allowance_cells(own: Allowance | None, parts: Sequence[Contributor]) -> tuple[Cell, Cell, Cell, Cell]:
    """Half-width at the limit, slack, slack in words, cost."""
    if own is None:
        return (None, None, "see its components" if parts else "", None)
    return (own.at_limit, own.slack, own.status, own.cost)


def views_table(views: Sequence[ViewCheck]) -> Table:
    """What each view sees of the fiducials."""
    rows = [
        Row((
            view.view,
            (", ".join(view.outside) if view.outside else "none") if view.checked else "image size not stated",
            view.smallest_margin_px, " – ".join(view.closest_pair), view.closest_pair_px, *view.depth_range_mm,
        ))
        for view in views
    ]  # fmt: skip
    return Table(
        name="Views",
        caption="What each view sees of the fiducials, at the biased geometry without noise",
        columns=(
            Column("View"), Column("Outside"), Column("Margin to border", "px", "fixed", 1), Column("Closest pair"),
            Column("Their distance", "px", "fixed", 1), Column("Depth from", "mm", "fixed", 1),
            Column("Depth to", "mm", "fixed", 1),
        ),
        rows=tuple(rows),
    )  # fmt: skip


def findings_table(findings: Sequence[Finding], *, name: str = "Findings", of: str = "") -> Table:
    """Remarks on the design."""
    rows = [Row((entry.severity, entry.rule, entry.message, entry.pointer)) for entry in findings]
    return Table(
        name=name,
        caption=f"Findings{of}",
        columns=(Column("Severity", kind="status"), Column("Rule"), Column("Finding"), Column("At")),
        rows=tuple(rows),
    )


def provenance_facts(provenance: Provenance, sha256: str, schema: str, which: str = "design") -> Facts:
    """What the numbers come from; ``which`` design they are of."""
    return Facts(
        "Provenance",
        (
            ("Design", provenance.design_name),
            (f"SHA-256 of the {which}", provenance.design_sha256 or "not known"),
            ("SHA-256 of this record", sha256),
            ("Record", schema),
            ("Computed by", f"tailstack {provenance.tailstack_version}"),
            (
                "Installation error",
                f"{provenance.reading} reading, {provenance.rotation_form.replace('_', ' ')} rotation",
            ),
            ("Estimator of a view", provenance.estimator.replace("_", " ")),
            ("Triangulation", provenance.triangulation),
        ),
    )


def not_included(provenance: Provenance) -> Bullets:
    return Bullets(provenance.not_included)
