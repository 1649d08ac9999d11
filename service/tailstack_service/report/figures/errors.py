"""The error as pictures: its distribution, its numbers on one scale, and how the sampled P95 settled."""

from __future__ import annotations

from math import log2

from ..records import Convergence, ErrorDistribution
from ..svg import FAINT, FONT, INK, MUTED, box, line, rounded, text
from .frame import (
    BAR,
    BAR_PALE,
    LAW_COLOUR,
    LIMIT_COLOUR,
    VALUE_COLOUR,
    WIDTH,
    Scale,
    density_axis,
    marker,
    picture,
    sides,
)

LEFT, RIGHT, TOP, HEIGHT = 62, WIDTH - 22, 44, 210


def distribution_svg(
    shown: ErrorDistribution,
    p95_mm: float,
    interval_mm: tuple[float, float | None] | None,
    limit_mm: float | None,
    name: str,
) -> str:
    """Histogram of the sampled errors and the first-order law, with P95, its interval and the limit."""
    edges = shown.edges_mm
    low, high = edges[0], max(edges[-1], 1.2 * (limit_mm or 0.0))
    scale = Scale(low, high, LEFT, RIGHT)
    width = edges[1] - edges[0]
    densities = [[share / width for share in shares] for shares in (shown.sampled, shown.first_order) if shares]
    top = max(max(values) for values in densities) * 1.08
    bottom = TOP + HEIGHT

    def up(density: float) -> float:
        return bottom - HEIGHT * density / top

    parts = scale.axis(bottom, "error at the tool, mm", top=TOP)
    parts += density_axis(top, LEFT, RIGHT, TOP, bottom, TOP - 28)
    if interval_mm is not None and interval_mm[1] is not None:
        x0, x1 = scale.at(interval_mm[0]), scale.at(interval_mm[1])
        parts.append(box(x0, TOP, max(x1, x0 + 1), bottom, 'fill="#0072b2" fill-opacity="0.18"'))
    if shown.sampled is not None:
        for k, share in enumerate(shown.sampled):
            beyond = limit_mm is not None and edges[k] >= limit_mm
            colour = "#e8aaa5" if beyond else BAR_PALE
            look = f'fill="{colour}" stroke="{BAR}" stroke-width="0.6"'
            parts.append(box(scale.at(edges[k]), up(share / width), scale.at(edges[k + 1]), bottom, look))
    middle = [(scale.at(edges[k] + width / 2), up(share / width)) for k, share in enumerate(shown.first_order)]
    path = "M" + "L".join(f"{rounded(x)} {rounded(y)}" for x, y in middle)
    parts.append(f'<path d="{path}" fill="none" stroke="{LAW_COLOUR}" stroke-width="1.8"/>')
    ours, theirs = sides(p95_mm, limit_mm)
    parts += marker(scale, p95_mm, TOP, bottom, f"P95 {p95_mm:.3f} mm", VALUE_COLOUR, ours)
    if limit_mm is not None:
        parts += marker(scale, limit_mm, TOP, bottom, f"limit {limit_mm:g} mm", LIMIT_COLOUR, theirs, "5 3")
    y = bottom + 50
    parts += [line(LEFT, y - 4, LEFT + 22, y - 4, LAW_COLOUR, 1.8), text(LEFT + 28, y, "first-order law")]
    words = f"Error at target {shown.target}: the first-order law is drawn as a line"
    if shown.sampled is not None:
        parts.append(box(LEFT + 130, y - 10, LEFT + 152, y + 1, f'fill="{BAR_PALE}" stroke="{BAR}" stroke-width="0.6"'))
        parts.append(text(LEFT + 158, y, f"Monte Carlo, {shown.trials:,} trials"))
        words += f", {shown.trials:,} Monte Carlo trials as bars"
    if interval_mm is not None and interval_mm[1] is not None:
        parts.append(box(LEFT + 322, y - 10, LEFT + 344, y + 1, 'fill="#0072b2" fill-opacity="0.18"'))
        parts.append(text(LEFT + 350, y, f"interval of P95, {interval_mm[0]:.3f} to {interval_mm[1]:.3f} mm"))
    words += f". P95 is {p95_mm:.3f} mm" + ("" if limit_mm is None else f", the limit {limit_mm:g} mm") + "."
    return picture(name, f"Distribution of the error at target {shown.target}", words, bottom + 62, parts)


def scale_svg(
    target: str,
    p95_mm: float,
    interval_mm: tuple[float, float | None],
    limit_mm: float | None,
    others: tuple[tuple[str, float], ...],
    name: str = "scale",
    quantile: str = "P95",
    reach_mm: float = 0.0,
    error: str = "tcp",
) -> str:
    """The quantile with its interval on one scale with the limit; ``others`` are further numbers, in mm.

    reach_mm: the scale goes as far at least, so that two pictures can be laid beside one another.
    """
    known = [p95_mm, interval_mm[1] or 0.0, limit_mm or 0.0, *(value for _, value in others)]
    scale = Scale(0.0, 1.3 * max(*known, reach_mm, 1e-9), 22, RIGHT)
    y, bottom = 56.0, 96.0
    parts = scale.axis(bottom, "error at the tool, mm" if error == "tcp" else f"error of {error}, mm")
    if limit_mm is not None:
        parts.append(box(scale.at(0), y - 16, scale.at(limit_mm), y + 16, 'fill="#e4f1e8"'))
        parts.append(box(scale.at(limit_mm), y - 16, RIGHT, y + 16, 'fill="#f9e4e2"'))
        side = "left" if limit_mm < p95_mm else "right"
        parts += marker(scale, limit_mm, 22, bottom, f"limit {limit_mm:g} mm", LIMIT_COLOUR, side, "5 3")
    ends = (scale.at(interval_mm[0]), scale.at(interval_mm[1]) if interval_mm[1] is not None else float(RIGHT))
    parts.append(line(*(ends[0], y, ends[1], y), VALUE_COLOUR, 4))
    parts += [line(x, y - 8, x, y + 8, VALUE_COLOUR, 2) for x in ends]
    x = scale.at(p95_mm)
    parts.append(f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="5" fill="{VALUE_COLOUR}"/>')
    after, before = max(ends[1], x + 5) + 8, min(ends[0], x - 5) - 8
    label = f"{quantile} {p95_mm:.3f} mm"
    wide = 0.6 * FONT * len(label) + 10  # in bold
    right = limit_mm is not None and limit_mm < p95_mm and after < RIGHT - wide
    anchor, at, base = ("start", after, y + 4) if right or before < wide + 22 else ("end", before, y + 4)
    if anchor == "start" and after > RIGHT - wide:
        anchor, at, base = "middle", min(max(x, 22 + wide / 2), RIGHT - wide / 2), y - 9
    parts.append(text(at, base, label, anchor=anchor, colour=VALUE_COLOUR, weight="bold"))
    for label, value in others:
        x = scale.at(value)
        parts.append(f'<path d="M{rounded(x)} 84L{rounded(x - 4)} 93L{rounded(x + 4)} 93Z" fill="{INK}"/>')
        near = limit_mm is not None and abs(x - scale.at(limit_mm)) < 0.35 * FONT * len(label)
        beside = "middle" if not near or limit_mm is None else "end" if value < limit_mm else "start"
        parts.append(text(x + {"end": 3, "start": -3}.get(beside, 0), 82, label, anchor=beside, colour=INK))
    words = f"{quantile} at target {target} is {p95_mm:.3f} mm"
    if interval_mm[1] is not None:
        words += f", between {interval_mm[0]:.3f} and {interval_mm[1]:.3f} mm"
    words += "" if limit_mm is None else f"; the limit is {limit_mm:g} mm"
    words += "".join(f"; {label} {value:.3f} mm" for label, value in others) + "."
    return picture(name, f"{quantile} and limit at target {target}", words, bottom + 40, parts)


def convergence_svg(shown: Convergence, limit_mm: float | None, name: str) -> str:
    """P95 of the first so many trials, each with the interval that it has by itself."""
    points = shown.points
    low = min(point.interval_mm[0] for point in points)
    high = max(point.interval_mm[1] for point in points)
    visible = limit_mm is not None and 2 * low - high < limit_mm < 2 * high - low
    if visible and limit_mm is not None:
        low, high = min(low, limit_mm), max(high, limit_mm)
    margin = 0.06 * max(high - low, 1e-9)
    low, high = low - margin, high + margin
    top, bottom = 22, 190
    steps = Scale(log2(points[0].trials) - 0.5, log2(points[-1].trials) + 0.5, LEFT + 10, RIGHT)

    def up(value: float) -> float:
        return bottom - (bottom - top) * (value - low) / (high - low)

    across = Scale(low, high, 0, 2.2 * (bottom - top))  # ticks some 36 units apart
    parts = []
    for value in across.ticks():
        parts.append(line(LEFT + 10, up(value), RIGHT, up(value), "#e3e3e3", 0.7))
        parts.append(text(LEFT + 4, up(value) + 4, f"{value:g}", anchor="end", colour=MUTED))
    for point in points:
        x = steps.at(log2(point.trials))
        parts.append(line(x, up(point.interval_mm[0]), x, up(point.interval_mm[1]), VALUE_COLOUR, 2))
        parts.append(f'<circle cx="{rounded(x)}" cy="{rounded(up(point.p95_mm))}" r="3.6" fill="{VALUE_COLOUR}"/>')
        parts.append(text(x, bottom + 16, f"{point.trials:,}", anchor="middle", colour=MUTED))
    if visible and limit_mm is not None:
        parts.append(line(LEFT + 10, up(limit_mm), RIGHT, up(limit_mm), LIMIT_COLOUR, 1.6, "5 3"))
        parts.append(text(RIGHT, up(limit_mm) - 5, f"limit {limit_mm:g} mm", anchor="end", colour=LIMIT_COLOUR))
    parts.append(line(LEFT + 10, bottom, RIGHT, bottom, FAINT))
    said = f"trials; bars: {100 * shown.confidence:g} % interval of P95, each by itself"
    parts.append(text((LEFT + RIGHT) / 2, bottom + 34, said, anchor="middle", colour=MUTED))
    parts.append(text(LEFT + 4, 12, "P95, mm", anchor="end", colour=MUTED))
    last = points[-1]
    words = (
        f"P95 at target {shown.target} by the number of trials: {points[0].p95_mm:.3f} mm after {points[0].trials:,}, "
        f"{last.p95_mm:.3f} mm after {last.trials:,}; bars are {100 * shown.confidence:g} % intervals, each by itself."
    )
    return picture(name, f"How P95 settled at target {shown.target}", words, bottom + 44, parts)
