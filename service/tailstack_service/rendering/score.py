"""The first-order score as text: errors at each target, the budget, validity, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from tailstack.results import Contributor, MetricScore, Score, TargetScore, ViewCheck
from tailstack.system import INTERFACES

from .tables import WIDTH, decimal, number, paint, percent, table, visible, wrap
from .verdict import heading, join_blocks, provenance_text, verdict_text

SMALL_SHARE = 5e-4  # components below 0.05 % of the variance are summed into one line of the table

BEHIND_LOCALISATION = ("connector_flange", "hand_eye", "execution")  # contributors that act on the TCP error alone


class Line(Protocol):
    """What is said of one line of a budget, wherever it stands."""

    @property
    def label(self) -> str: ...
    @property
    def component(self) -> str: ...


def source_name(line: Line) -> str:
    """A line of the budget as people call it: the label of its source and the component."""
    return line.label if line.component == "all" else f"{line.label} {line.component}"


def score_text(score: Score, *, target: str | None = None, colour: bool = False) -> str:
    """The whole score.  ``target`` names the target whose budget is shown; default the one with the largest P95."""
    chosen = worst_target(score) if target is None else next(t for t in score.targets if t.name == target)
    return join_blocks(
        heading(score.provenance, "first order"),
        targets_text(score.targets),
        views_text(score.views),
        budget_text(chosen, len(score.targets), colour),
        risk_text(chosen),
        second_order_text(chosen),
        wrap(score.validity.statement, first=f"linearisation: {score.validity.status}. ", indent="  "),
        provenance_text(score.provenance),
        verdict_text(score.verdict, colour),
    )


def worst_target(score: Score) -> TargetScore:
    return max(score.targets, key=lambda entry: entry.p95_mm)


def targets_text(targets: Sequence[TargetScore]) -> str:
    """Two rows per target: error at the tool, and of the located target before the error of connector_flange."""
    rows = []
    for target in targets:
        rows.append(_metric_row(target.name, target))
        rows.append(_metric_row("  as localised", target.localisation))
    header = (
        "target", "frame", "|bias|\nmm", "std x\nmm", "std y\nmm", "std z\nmm", "mean\nmm", "P95\nmm",
        "CVaR95\nmm", "limit\nmm", "beyond\nlimit, %",
    )  # fmt: skip
    return table(header, rows, left=2, widest=30)


def _metric_row(name: str, metric: TargetScore | MetricScore) -> tuple[str, ...]:
    bias = sum(component**2 for component in metric.bias_mm) ** 0.5
    return (
        name,
        metric.frame,
        decimal(bias, 3),
        *(decimal(value, 3) for value in metric.std_mm),
        decimal(metric.mean_norm_mm, 3),
        decimal(metric.p95_mm, 4),
        decimal(metric.cvar95_mm, 3),
        number(metric.limit_mm, 3),
        percent(metric.exceedance_probability, 2),
    )


def views_text(views: Sequence[ViewCheck]) -> str:
    """What each view sees of the fiducials."""
    rows = []
    for view in views:
        near, far = view.depth_range_mm
        if view.checked:
            seen = f"{len(view.outside)} outside: {', '.join(view.outside)}" if view.outside else "all"
        else:
            seen = "image size not stated"
        pair = " - ".join(view.closest_pair)
        rows.append(
            (view.view, seen, pair, decimal(view.closest_pair_px, 1), decimal(view.smallest_margin_px, 1),
             f"{near:.0f} .. {far:.0f}")
        )  # fmt: skip
    header = (
        "view", "fiducials\nseen", "closest\npair", "distance\npx", "margin to\nborder, px", "depth\nmm",
    )  # fmt: skip
    return table(header, rows, left=3)


def budget_text(target: TargetScore, targets: int = 1, colour: bool = False) -> str:
    """The budget of one target, largest share of the variance first, components below their contributor."""
    note = f" (of {targets} targets; --target NAME shows another)" if targets > 1 else ""
    named = f"Budget at target {visible(target.name)}"
    title = wrap(f"{named}, P95 {target.p95_mm:.4f} mm{note}", indent="  ").replace(named, paint(named, "bold", colour))
    rows: list[tuple[str, ...]] = []
    for total, components in group(target.contributors):
        rows.append(_line(total, heading_of(total, len(components))))
        kept = [entry for entry in components if entry.variance_share >= SMALL_SHARE or _moves(entry)]
        rows += [_line(entry, f"  {entry.component}") for entry in kept]
        dropped = len(components) - len(kept)
        if dropped:
            share = sum(entry.variance_share for entry in components) - sum(entry.variance_share for entry in kept)
            rows.append((f"  {dropped} more, < 0.05 % each", "", "", "", "", "", percent(max(share, 0.0)), "", ""))
    header = (
        "contributor", "law", "half-\nwidth", "\nunit", "std\nunit", "sensitivity\nmm/unit", "share\n%",
        "dP95/dh\nmm/unit", "P95\nwithout, mm",
    )  # fmt: skip
    parts = [title + "\n" + table(header, rows, left=2, widest=32)]
    if target.worst_vertex:
        parts.append(wrap(", ".join(target.worst_vertex), first="bounded, at their worst: ", indent="  "))
    return "\n".join(parts)


def heading_of(total: Contributor, components: int = 0) -> str:
    """A source as people call it; an interface by its name in the design document and by its label there."""
    labelled = total.name in INTERFACES and total.label != total.name
    heading = (total.name if labelled else total.label) + (f", all {components}" if components else "")
    return f"{heading}: {total.label}" if labelled else heading


def _moves(entry: Contributor) -> bool:
    """A bounded component has no variance, but it moves the quantile."""
    return entry.law == "bounded"


def group(contributors: Sequence[Contributor]) -> list[tuple[Contributor, list[Contributor]]]:
    """(line of the whole contributor, its components), both by falling share of the variance."""
    names = list(dict.fromkeys(entry.name for entry in contributors))
    groups = []
    for name in names:
        lines = [entry for entry in contributors if entry.name == name]
        total = next((entry for entry in lines if entry.component == "all"), None)
        parts = sorted((e for e in lines if e is not total), key=lambda e: e.variance_share, reverse=True)
        if total is not None:
            groups.append((total, parts))
        else:
            groups += [(entry, []) for entry in parts]
    return sorted(groups, key=lambda group: group[0].variance_share, reverse=True)


def single_lines(contributors: Sequence[Contributor]) -> list[Contributor]:
    """Lines that do not overlap: components, and contributors without any; largest share first."""
    counts: dict[str, int] = {}
    for entry in contributors:
        counts[entry.name] = counts.get(entry.name, 0) + 1
    kept = [entry for entry in contributors if entry.component != "all" or counts[entry.name] == 1]
    return sorted(kept, key=lambda entry: entry.variance_share, reverse=True)


def shares_of(target: TargetScore, error: str) -> list[tuple[Contributor, float]]:
    """Single lines with their shares of the variance of ``error`` (tcp or localisation), largest share first.

    The budget is of the TCP error.  Only rigid motions lie between the target as localised and the tool: they keep the
    trace of a covariance, so what acts before them adds the same mm^2 to both errors, and what acts behind them
    (connector_flange, hand-eye, execution) adds nothing to the error of localisation.
    """
    lines = single_lines(target.contributors)
    if error == "tcp":
        return [(line, line.variance_share) for line in lines]
    ratio = sum(std**2 for std in target.std_mm) / (sum(std**2 for std in target.localisation.std_mm) or 1.0)
    return [(line, line.variance_share * ratio) for line in lines if line.name not in BEHIND_LOCALISATION]


def _line(entry: Contributor, label: str) -> tuple[str, ...]:
    return (
        label,
        entry.law,
        number(entry.half_width, 3),
        entry.unit,
        number(entry.std, 3),
        number(entry.sensitivity_mm_per_unit, 3),
        percent(entry.variance_share),
        number(entry.dp95_per_unit, 3),
        decimal(entry.p95_without_mm, 4),
    )


def risk_text(target: TargetScore) -> str:
    """Bounds of the quantile and the per-unit reading, in sentences."""
    bounds = target.bounds_mm
    lines = [
        wrap(
            f"{target.law}. The same mean and covariance allow a P95 of {bounds.gaussian:.3f} mm if Gaussian, at most "
            f"{bounds.unimodal:.3f} mm for any symmetric unimodal law, {bounds.moments:.3f} mm for any law.",
            first="law: ",
            indent="  ",
        )
    ]
    lines.append(wrap(units_in_words(target), first="per unit: ", indent="  "))
    whole = target.bounds_mm.gaussian
    if abs(target.block_diagonal_p95_mm / whole - 1) > 1e-4 if whole else False:
        lines.append(
            wrap(
                f"as a Gaussian law, P95 would be {target.block_diagonal_p95_mm:.4f} mm with the covariance between "
                f"views left out (Eq 16) and is {whole:.4f} mm with it.",
                first="for comparison: ",
                indent="  ",
            )
        )
    return "\n".join(lines)


def units_in_words(target: TargetScore) -> str:
    """What most units keep their own quantile within, and how many meet the limit."""
    unit = target.per_unit
    value = unit.p95_of_units_mm if unit.value_mm is None else unit.value_mm
    sentence = (
        f"{100 * unit.units_fraction:.6g} % of installed units keep a P{100 * unit.quantile:.6g} over their own shots "
        f"of {value:.3f} mm"
    )
    if unit.yield_fraction is not None and unit.limit_mm is not None:
        error = percent(unit.yield_standard_error or 0.0, 2)
        sentence += (
            f"; {percent(unit.yield_fraction, 2)} % of units (standard error {error} %) meet {unit.limit_mm:g} mm"
        )
    return sentence + "."


def second_order_text(target: TargetScore) -> str:
    second = target.second_order
    if second.status == "not requested":
        return ""
    if second.status == "refused":
        return wrap(second.reason, first="second order: refused. ", indent="  ")
    return wrap(f"P95 {decimal(second.p95_mm, 4)} mm. {second.reason}", first="second order: ", indent="  ")


__all__ = [
    "WIDTH",
    "budget_text",
    "group",
    "score_text",
    "single_lines",
    "targets_text",
    "views_text",
    "worst_target",
]
