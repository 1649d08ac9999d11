"""Two designs in one picture: their budgets side by side, their errors over one another, the difference of each P95."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from tailstack.results import TargetScore

from ...rendering.score import single_lines, source_name
from ...rendering.tables import fixed
from ..records import Difference, ErrorDistribution
from ..svg import FAINT, INK, MUTED, box, line, printable, rounded, text
from .frame import BAR, LIMIT_COLOUR, ROW, VALUE_COLOUR, WIDTH, Scale, density_axis, picture

FIRST, SECOND = "#6b7780", VALUE_COLOUR  # lines and words
FIRST_BAR = "#b4bcc3"
LABELS, TOP = 218, 34
MOST = 12
Called = tuple[str, str]  # what the two designs are called


def budgets_svg(
    first: TargetScore, second: TargetScore, called: Called = ("before", "after"), name: str = "budgets"
) -> str:
    """Standard deviation that each source adds at a target, in both designs; what only one of them has is there too."""
    both = [_spreads(target) for target in (first, second)]
    keys = sorted({**both[0], **both[1]}, key=lambda key: -max(each.get(key, 0.0) for each in both))
    labels = {(e.name, e.component): source_name(e) for target in (first, second) for e in target.contributors}
    rows: list[tuple[str, float | None, float | None]] = [
        (labels[key], both[0].get(key), both[1].get(key)) for key in keys[:MOST]
    ]
    if len(keys) > MOST:
        rest = [sqrt(sum(each.get(key, 0.0) ** 2 for key in keys[MOST:])) for each in both]
        rows.append((f"{len(keys) - MOST} more together", rest[0], rest[1]))
    whole = [sqrt(sum(value**2 for value in each.values())) for each in both]
    rows.append(("all together", whole[0], whole[1]))
    widest = max(max(before or 0.0, after or 0.0) for _, before, after in rows)
    scale = Scale(0.0, 1.04 * max(widest, 1e-9), LABELS, WIDTH - 66)
    height, gap = ROW + 8, 8
    bottom = TOP + height * len(rows) + gap
    parts = scale.axis(bottom, "standard deviation of the error at the tool, mm; the parts add as squares", top=TOP)
    parts += _legend(called)
    for k, (label, *values) in enumerate(rows):
        y = TOP + height * k + (gap if k == len(rows) - 1 else 0)
        if k == len(rows) - 1:
            parts.append(line(8, y - 3, WIDTH - 8, y - 3, FAINT, 0.8))
        parts.append(text(LABELS - 10, y + 18, printable(label, 34), anchor="end"))
        for value, place, colour in ((values[0], 3, FIRST_BAR), (values[1], 14, BAR)):
            words = "not there" if value is None else fixed(value, 3)
            x = scale.at(value or 0.0)
            if value:
                parts.append(box(scale.at(0), y + place, max(x, scale.at(0) + 0.8), y + place + 10, f'fill="{colour}"'))
            parts.append(text(x + 5, y + place + 9, words, size=10, colour=MUTED if value is None else INK))
    listed = "; ".join(f"{label} {_said(before)} and {_said(after)}" for label, before, after in rows)
    words = f"Standard deviations in mm, {called[0]} and {called[1]}: {listed}."
    return picture(name, f"Budgets at target {second.name}, {called[0]} and {called[1]}", words, bottom + 44, parts)


def _spreads(target: TargetScore) -> dict[tuple[str, str], float]:
    """mm by contributor and component; those without spread are left out."""
    total = sum(target.covariance_mm2[k][k] for k in range(3))
    found = {
        (entry.name, entry.component): sqrt(max(entry.variance_share * total, 0.0))
        for entry in single_lines(target.contributors)
    }
    return {key: value for key, value in found.items() if value > 0}


def _said(value: float | None) -> str:
    return "not there" if value is None else fixed(value, 3)


def _legend(called: Called) -> list[str]:
    parts, x = [], 12.0
    for words, colour in zip(called, (FIRST_BAR, BAR), strict=True):
        said = printable(words, 50)
        parts += [box(x, 8, x + 16, 18, f'fill="{colour}"'), text(x + 22, 17, said)]
        x += 44 + 6.1 * len(said)
    return parts


def distributions_svg(
    first: ErrorDistribution, second: ErrorDistribution, p95_mm: tuple[float, float], limit_mm: float | None,
    called: Called = ("before", "after"), name: str = "distributions",
) -> str:  # fmt: skip
    """Both errors over one another: sampled shares as outlines where trials were drawn, else the first-order law."""
    left, right, top, height = 62, WIDTH - 22, 62, 200
    bottom = top + height
    shown = [entry.sampled or entry.first_order for entry in (first, second)]
    sampled = all(entry.sampled is not None for entry in (first, second))
    if not sampled:
        shown = [entry.first_order for entry in (first, second)]
    edges = [entry.edges_mm for entry in (first, second)]
    scale = Scale(0.0, max(edges[0][-1], edges[1][-1], 1.1 * (limit_mm or 0.0)), float(left), float(right))
    densities = [
        [share / (ends[k + 1] - ends[k]) for k, share in enumerate(shares)]
        for shares, ends in zip(shown, edges, strict=True)
    ]
    highest = 1.06 * max(max(values) for values in densities)

    def up(density: float) -> float:
        return bottom - height * density / highest

    parts = scale.axis(bottom, f"error at the tool, target {printable(second.target, 40)}, mm", top=top)
    parts += density_axis(highest, left, right, top, bottom, top - 8)
    areas, outlines = [], []
    for values, ends, colour, dashes, fill in (
        (densities[0], edges[0], FIRST, ' stroke-dasharray="5 3"', "none"),
        (densities[1], edges[1], SECOND, "", "#c9dceb"),
    ):
        corners = [(scale.at(ends[0]), float(bottom))]
        for k, value in enumerate(values):
            corners += [(scale.at(ends[k]), up(value)), (scale.at(ends[k + 1]), up(value))]
        corners.append((scale.at(ends[len(values)]), bottom))
        path = "M" + "L".join(f"{rounded(x)} {rounded(y)}" for x, y in corners)
        areas.append(f'<path d="{path}" fill="{fill}" fill-opacity="0.6"/>')
        outlines.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5"{dashes}/>')
    parts += [*areas, *outlines]
    marks: list[tuple[float, str, str]] = [(p95_mm[0], FIRST, "5 3"), (p95_mm[1], SECOND, "")]
    marks += [(limit_mm, LIMIT_COLOUR, "2 2")] if limit_mm is not None else []
    parts += [line(scale.at(value), top - 4, scale.at(value), bottom, colour, 1.6, d) for value, colour, d in marks]
    x = 12.0
    for words, value, colour, dashes in (
        (called[0], p95_mm[0], FIRST, "5 3"), (called[1], p95_mm[1], SECOND, ""),
    ):  # fmt: skip
        said = f"{printable(words, 34)}, P95 {value:.3f} mm"
        parts += [line(x, 14, x + 20, 14, colour, 1.8, dashes), text(x + 26, 18, said, colour=colour, weight="bold")]
        x += 48 + 6.6 * len(said)
    if limit_mm is not None:
        parts += [line(x, 14, x + 20, 14, LIMIT_COLOUR, 1.6, "2 2")]
        parts.append(text(x + 26, 18, f"limit {limit_mm:g} mm", colour=LIMIT_COLOUR, weight="bold"))
    drawn = f"Monte Carlo in bins, {first.trials:,} and {second.trials:,} trials" if sampled else "first-order law"
    lines_are = "P95" if limit_mm is None else "P95 and limit"
    parts.append(text(12, 38, f"{drawn}; upright lines: {lines_are}", colour=MUTED))
    words = f"P95 is {p95_mm[0]:.3f} mm {called[0]} and {p95_mm[1]:.3f} mm {called[1]}; {drawn}."
    words += "" if limit_mm is None else f" The limit is {limit_mm:g} mm."
    return picture(name, f"Errors at target {second.target}, {called[0]} and {called[1]}", words, bottom + 42, parts)


def differences_svg(found: Sequence[Difference], name: str = "differences") -> str:
    """Second minus first of each target's P95, with its interval where trials were drawn; left of zero is smaller."""
    shown = list(found[:MOST])
    ends = [0.0]
    for entry in shown:
        ends += [entry.difference_mm, *(entry.interval_mm or ())]
    reach = max(max(ends) - min(ends), 1e-9)
    scale = Scale(min(ends) - 0.08 * reach, max(ends) + 0.08 * reach, LABELS, WIDTH - 24)
    bottom = 26 + 26 * len(shown)
    title = "P95 of the error at the tool, second minus first design, mm"
    parts = scale.axis(bottom, title, top=12)
    parts.append(line(scale.at(0.0), 8, scale.at(0.0), bottom, INK, 1.3))
    for k, entry in enumerate(shown):
        y = 28 + 26 * k
        parts.append(text(LABELS - 10, y + 4, printable(entry.target, 32), anchor="end"))
        colour = {"smaller": "#176332", "larger": LIMIT_COLOUR}.get(entry.conclusion, INK)
        if entry.interval_mm is not None:
            low, high = (scale.at(value) for value in entry.interval_mm)
            parts.append(line(low, y, high, y, colour, 2.4))
            parts += [line(x, y - 5, x, y + 5, colour, 1.6) for x in (low, high)]
        x = scale.at(entry.difference_mm)
        parts.append(f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="4" fill="{colour}"/>')
        inner = x > (LABELS + WIDTH) / 2
        words = f"{entry.difference_mm:+.4f} mm".replace("-", "−")
        parts.append(text(x - 2 if inner else x + 2, y - 7, words, anchor="end" if inner else "start", size=10))
    left_out = f" {len(found) - MOST} more targets are in the table." if len(found) > MOST else ""
    listed = "; ".join(f"{entry.target} {entry.difference_mm:+.4f} mm" for entry in shown)
    return picture(name, title, f"{listed}.{left_out}", bottom + 42, parts)
