"""The score as text: the error at each target, where it comes from, verdict."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Contributor, MetricScore, Score, TargetScore, ViewCheck
from tailstack.results.score import single_lines
from tailstack.results.verdicts import decisive_check
from tailstack.system import INTERFACES

from .page import current
from .sentences import largest_sentence, losses_sentence, margin_sentence, trust_sentence, units_sentence
from .tables import decimal, number, paint, percent, table, visible, wrap
from .verdict import decision_text, heading, join_blocks, provenance_text, verdict_text

SMALL_SHARES = (5e-3, 5e-4)  # of the variance: components below are summed into one line; without and with details

BEHIND_LOCALISATION = ("connector_flange", "hand_eye", "execution")  # contributors that act on the TCP error alone


def score_text(score: Score, *, target: str | None = None) -> str:
    """The whole score.  ``target`` names the target whose budget is shown; default the one with the largest P95."""
    chosen = score.worst_target if target is None else next(t for t in score.targets if t.name == target)
    details = current().details
    return join_blocks(
        heading(score.provenance, "Estimate of the error; `tailstack verify` checks it by simulation.", "first order"),
        _opening(score),
        targets_text(score.targets),
        views_text(score.views) if details else views_sentence(score.views),
        budget_text(chosen, len(score.targets)),
        law_text(chosen) if details else "",
        wrap(units_sentence(chosen), first="unit by unit: ", indent="  "),
        losses_text(score),
        reliability_text(score),
        second_order_text(chosen),
        _trust_text(score),
        provenance_text(score.provenance),
        verdict_text(score.verdict),
    )


def _opening(score: Score) -> str:
    """What decides, and what there is to do about it."""
    decisive = decisive_check(score.verdict.checks)
    if decisive is None:
        worst = score.worst_target
        return wrap(largest_sentence(worst.name, worst.p95_mm, estimate_interval(score, worst.p95_mm)))
    found = next(entry for entry in score.targets if entry.name == decisive.target)
    lines = [line for line, _ in shares_of(found, decisive.error)]
    return decision_text(score.verdict) + "\n" + wrap(margin_sentence(decisive, lines))


def estimate_interval(score: Score, p95_mm: float) -> tuple[float, float | None]:
    """Where the P95 of a simulation is to be expected."""
    error = score.validity.expected_error_percent
    return (0.0, None) if error is None else (p95_mm / (1 + error / 100), p95_mm * (1 + error / 100))


def losses_text(score: Score) -> str:
    """What the loss of fiducials does to each requirement; without details to the first three."""
    shown = score.losses if current().details else score.losses[:3]
    said = [losses_sentence(line, score.verdict.checks) for line in shown]
    return "\n".join(wrap(text, first="if fiducials are lost: ", indent="  ") for text in said)


MOST_SLIPS = 8  # without details


def reliability_text(score: Score) -> str:
    """The slips of images that do most before they are noticed."""
    if not score.reliability:
        return ""
    shown = score.reliability if current().details else score.reliability[:MOST_SLIPS]
    rows = [
        (visible(item.fiducial), visible(item.view), decimal(item.slip_px, 2), decimal(item.effect_mm, 3),
         visible(item.target))
        for item in shown
    ]  # fmt: skip
    header = ("fiducial\nthat slips", "in view\n", "noticed\nfrom, px", "does up\nto, mm", "at target\n")
    said = (
        "Noticed by a test of the residuals at a level of 0.1 %, in 80 % of cases; a smaller slip does up to as much, "
        "unseen. - stands for a slip that never is noticed."
    )
    return table(header, rows, left=2) + "\n" + wrap(said)


def _trust_text(score: Score) -> str:
    if not current().details:
        return wrap(trust_sentence(score.validity) + ".", first="how good it is: ", indent="  ")
    return wrap(score.validity.statement, first=f"linearisation: {score.validity.status}. ", indent="  ")


LOCATED = "  as located"  # the row below a target


def targets_text(targets: Sequence[TargetScore]) -> str:
    """Two rows per target: error at the tool, and of the located target before the error of connector_flange."""
    if current().details:
        return _targets_in_detail(targets)
    rows = []
    for target in targets:
        rows += [_short_row(target.name, target), _short_row(LOCATED, target.localisation)]
    header = (
        "error at the tool,\nby target",
        "mean\nmm",
        "P95\nmm",
        "mean of worst\n5 %, mm",
        "limit\nmm",
        "over the\nlimit, %",
    )
    return table(header, rows) + "\n" + wrap(located_sentence())


def located_sentence() -> str:
    return (
        "as located: the error of the target found in the X-ray images, before flange, hand-eye and robot add theirs; "
        "P95: 95 % of shots are within it"
    )


def _short_row(name: str, metric: TargetScore | MetricScore) -> tuple[str, ...]:
    return (
        name, decimal(metric.mean_norm_mm, 3), decimal(metric.p95_mm, 4), decimal(metric.cvar95_mm, 3),
        number(metric.limit_mm, 3), percent(metric.exceedance_probability, 2),
    )  # fmt: skip


def _targets_in_detail(targets: Sequence[TargetScore]) -> str:
    rows = []
    for target in targets:
        rows += [_metric_row(target.name, target), _metric_row(LOCATED, target.localisation)]
    header = (
        "target", "frame", "|bias|\nmm", "std x\nmm", "std y\nmm", "std z\nmm", "mean\nmm", "P95\nmm",
        "CVaR95\nmm", "limit\nmm", "beyond\nlimit, %",
    )  # fmt: skip
    return table(header, rows, left=2)


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


def views_sentence(views: Sequence[ViewCheck]) -> str:
    """What is wrong with what the views see, or that nothing is; the closest pair of fiducials."""
    parts = []
    for view in views:
        name = visible(view.view)
        if view.outside:
            parts.append(f"{name}: {len(view.outside)} fiducials lie outside the image ({', '.join(view.outside)})")
        elif not view.checked:
            parts.append(f"{name}: whether all are in the image is not known, its size is not stated")
    clear = [view for view in views if view.checked and not view.outside]
    if clear:
        nearest = min(clear, key=lambda view: view.smallest_margin_px or 0.0)
        which = "every view" if len(clear) == len(views) else ", ".join(visible(view.view) for view in clear)
        parts.append(
            f"{which}: all fiducials are in the image, the nearest to its border by {nearest.smallest_margin_px:.0f} px"
        )
    if views:
        tight = min(views, key=lambda view: view.closest_pair_px)
        pair = " and ".join(tight.closest_pair)
        parts.append(f"closest images: {pair} in {visible(tight.view)}, {tight.closest_pair_px:.0f} px apart")
    return wrap("; ".join(parts) + ".", first="fiducials in the images: ", indent="  ") if parts else ""


def budget_text(target: TargetScore, targets: int = 1) -> str:
    """The budget of one target, largest share of the variance first, components below their contributor."""
    note = f" (of {targets} targets; --target NAME shows another)" if targets > 1 else ""
    named = f"Where the error at target {visible(target.name)} comes from"
    title = wrap(f"{named}, P95 {target.p95_mm:.4f} mm{note}").replace(named, paint(named, "bold"))
    small = SMALL_SHARES[current().details]
    cells, header, left = (_line, DETAILED, 2) if current().details else (_short_line, SHORT, 1)
    rows: list[tuple[str, ...]] = []
    for total, components in group(target.contributors):
        rows.append(cells(total, heading_of(total, len(components) if left > 1 else 0)))
        kept = [entry for entry in components if entry.variance_share >= small or _moves(entry)]
        rows += [cells(entry, f"  {entry.component}") for entry in kept]
        dropped = len(components) - len(kept)
        if dropped:
            share = sum(entry.variance_share for entry in components) - sum(entry.variance_share for entry in kept)
            row = [""] * len(header)
            row[0], row[SHARE[left]] = f"  {dropped} more, < {100 * small:g} % each", percent(max(share, 0.0))
            rows.append(tuple(row))
    parts = [title + "\n" + table(header, rows, left=left)]
    if target.worst_vertex:
        parts.append(wrap(", ".join(target.worst_vertex), first="without a law, at their worst ends: ", indent="  "))
    return "\n".join(parts)


SHORT = (
    "source of error", "±\n", "unit\n", "share of\nvariance, %", "P95 without\nit, mm", "a tenth tighter\nsaves, mm",
)  # fmt: skip
DETAILED = (
    "contributor", "law", "half-\nwidth", "\nunit", "std\nunit", "sensitivity\nmm/unit", "share\n%",
    "dP95/dh\nmm/unit", "P95\nwithout, mm",
)  # fmt: skip
SHARE = {1: 3, 2: 6}  # place of the share, by how many columns are texts


def _short_line(entry: Contributor, label: str) -> tuple[str, ...]:
    saved = None if entry.dp95_per_unit is None or entry.half_width is None else entry.dp95_per_unit * entry.half_width
    return (
        label,
        number(entry.half_width, 3),
        entry.unit,
        percent(entry.variance_share),
        decimal(entry.p95_without_mm, 4),
        decimal(None if saved is None else saved / 10, 3),
    )


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
    names = dict.fromkeys((entry.name, entry.law == "known") for entry in contributors)  # what is known stands alone
    groups = []
    for each in names:
        lines = [entry for entry in contributors if (entry.name, entry.law == "known") == each]
        total = next((entry for entry in lines if entry.component == "all"), None)
        parts = sorted((e for e in lines if e is not total), key=lambda e: e.variance_share, reverse=True)
        if total is not None:
            groups.append((total, parts))
        else:
            groups += [(entry, []) for entry in parts]
    return sorted(groups, key=lambda group: group[0].variance_share, reverse=True)


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


def law_text(target: TargetScore) -> str:
    """The law that the quantile rests on, and what it would be under others."""
    bounds = target.bounds_mm
    lines = [
        wrap(
            f"{target.law}. The same mean and covariance allow a P95 of {bounds.gaussian:.3f} mm if Gaussian, at most "
            f"{bounds.unimodal:.3f} mm for any symmetric unimodal law, {bounds.moments:.3f} mm for any law.",
            first="law: ",
            indent="  ",
        )
    ]
    if target.per_unit.yield_standard_error is not None:
        error = f"standard error of the fraction of units {percent(target.per_unit.yield_standard_error, 2)} %"
        lines.append(wrap(error, first="per unit: ", indent="  "))
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


def second_order_text(target: TargetScore) -> str:
    second = target.second_order
    if second.status == "not requested":
        return ""
    if second.status == "refused":
        return wrap(second.reason, first="second order: refused. ", indent="  ")
    return wrap(f"P95 {decimal(second.p95_mm, 4)} mm. {second.reason}", first="second order: ", indent="  ")
