"""The score as text: the error at each target, where it comes from, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tailstack.results import Contributor, Score, TargetScore, ViewCheck
from tailstack.results.digits import decimal, percent
from tailstack.results.score import budget_table, group, single_lines, targets_table, tenth_of, views_table, width_of
from tailstack.results.verdicts import decisive_check

from .page import current
from .sentences import ErrorSource, largest_sentence, losses_sentence, margin_sentence, trust_sentence, units_sentence
from .tables import draw_table, paint, visible, wrap, write_table
from .verdict import decision_text, heading, join_blocks, provenance_text, requirements_text, verdict_text


def score_text(score: Score, *, target: str | None = None) -> str:
    """The whole score.  ``target`` names the target whose budget is shown; default the one with the largest P95."""
    chosen = score.worst_target if target is None else next(t for t in score.targets if t.name == target)
    details, decimals = current().details, score.decimals
    return join_blocks(
        heading(score.provenance, "Estimate of the error; `tailstack verify` checks it by simulation.", "first order"),
        _opening(score),
        requirements_text(score.verdict),
        write_table(targets_table(score)) + ("" if details else "\n" + wrap(located_sentence())),
        write_table(views_table(score.views)) if details and score.views else views_sentence(score.views),
        budget_text(chosen, len(score.targets), decimals),
        law_text(chosen, decimals) if details else "",
        wrap(units_sentence(chosen, decimals), first="unit by unit: ", indent="  "),
        losses_text(score),
        reliability_text(score),
        second_order_text(chosen, decimals),
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
    sources = sources_of(found, decisive.error)
    return decision_text(score.verdict) + "\n" + wrap(margin_sentence(decisive, sources, score.decimals))


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
        (visible(item.fiducial), visible(item.view), decimal(item.slip_px, 2),
         decimal(item.effect_mm, score.decimals),
         visible(item.target))
        for item in shown
    ]  # fmt: skip
    header = ("fiducial\nthat slips", "in view\n", "noticed\nfrom, px", "does up\nto, mm", "at target\n")
    said = (
        "Noticed by a test of the residuals at a level of 0.1 %, in 80 % of cases; a smaller slip does up to as much, "
        "unseen. - stands for a slip that never is noticed."
    )
    return draw_table(header, rows, left=2) + "\n" + wrap(said)


def _trust_text(score: Score) -> str:
    if not current().details:
        return wrap(trust_sentence(score.validity) + ".", first="how good it is: ", indent="  ")
    return wrap(score.validity.statement, first=f"linearisation: {score.validity.status}. ", indent="  ")


def located_sentence() -> str:
    return (
        "as located: the error of the target found in the X-ray images, before flange, hand-eye and robot add theirs; "
        "P95: 95 % of shots are within it"
    )


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
        tight = min(views, key=lambda view: view.closest_pair_px - view.closest_pair_needs_px)
        pair = " and ".join(tight.closest_pair)
        merged = tight.closest_pair_px < tight.closest_pair_needs_px
        needs = f"; to be told apart they need {tight.closest_pair_needs_px:.0f} px" if merged else ""
        parts.append(f"closest images: {pair} in {visible(tight.view)}, {tight.closest_pair_px:.0f} px apart{needs}")
    return wrap("; ".join(parts) + ".", first="fiducials in the images: ", indent="  ") if parts else ""


def budget_text(target: TargetScore, targets: int = 1, decimals: int = 3) -> str:
    """The budget of one target, largest share of the variance first, components below their contributor."""
    note = f" (of {targets} targets; --target NAME shows another)" if targets > 1 else ""
    named = f"Where the error at target {visible(target.name)} comes from"
    title = wrap(f"{named}, P95 {target.p95_mm:.{decimals}f} mm{note}").replace(named, paint(named, "bold"))
    parts = [title + "\n" + write_table(budget_table(target, decimals))]
    if target.worst_vertex:
        parts.append(wrap(", ".join(target.worst_vertex), first="without a law, at their worst ends: ", indent="  "))
    return "\n".join(parts)


def shares_of(target: TargetScore, error: str) -> list[tuple[Contributor, float]]:
    """Single lines with their shares of the variance of ``error`` (tcp or localisation), largest share first; of the
    localisation error those that act on it.
    """
    lines = single_lines(target.contributors)
    if error == "tcp":
        return [(line, line.variance_share) for line in lines]
    shares = [(line, line.localisation_share) for line in lines if line.localisation_share > 0]
    return sorted(shares, key=lambda pair: pair[1], reverse=True)


def sources_of(target: TargetScore, error: str) -> list[ErrorSource]:
    """Whole sources with their shares of the variance of ``error`` (tcp or localisation), largest share first."""
    shares: dict[tuple[str, bool], float] = {}
    for line, share in shares_of(target, error):
        key = (line.name, line.law == "known")
        shares[key] = shares.get(key, 0.0) + share
    found = []
    for total, components in group(target.contributors):
        if (key := (total.name, total.law == "known")) in shares:
            width, unit = width_of(total, components)
            whole = replace(total, half_width=width, unit=unit)
            share = total.variance_share if error == "tcp" else shares[key]
            found.append(ErrorSource(whole, share, tenth_of(components or (total,))))
    return sorted(found, key=lambda source: source.share, reverse=True)


def law_text(target: TargetScore, decimals: int) -> str:
    """The law that the quantile rests on, and what it would be under others."""
    bounds = target.bounds_mm
    lines = [
        wrap(
            f"{target.law}. The same mean and covariance allow a P95 of {bounds.gaussian:.{decimals}f} mm if Gaussian, "
            f"at most {bounds.unimodal:.{decimals}f} mm for any symmetric unimodal law, "
            f"{bounds.moments:.{decimals}f} mm for any law.",
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


def second_order_text(target: TargetScore, decimals: int) -> str:
    second = target.second_order
    if second.status == "not requested":
        return ""
    if second.status == "refused":
        return wrap(second.reason, first="second order: refused. ", indent="  ")
    return wrap(f"P95 {decimal(second.p95_mm, decimals)} mm. {second.reason}", first="second order: ", indent="  ")
