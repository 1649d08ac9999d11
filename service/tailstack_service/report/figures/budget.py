"""The budget as pictures: who has which share of the variance, and what P95 would be without each."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Contributor

from ...rendering.score import single_lines
from ...rendering.tables import fixed, percent
from ..headline import named
from ..svg import INK, MUTED, box, line, printable, text
from .frame import BAR, BAR_PALE, LIMIT_COLOUR, ROW, VALUE_COLOUR, WIDTH, Scale, marker, picture, sides

MOST = 12
LABELS, TOP = 262, 30


def waterfall_svg(contributors: Sequence[Contributor], target: str, name: str = "waterfall") -> str:
    """Shares of the variance, largest first, each beginning where the one above ends; they sum to the whole."""
    lines = [entry for entry in single_lines(contributors) if entry.variance_share > 0]
    rows = [(named(entry), entry.variance_share) for entry in lines[:MOST]]
    rest = sum(entry.variance_share for entry in lines[MOST:])
    if rest > 0:
        rows.append((f"{len(lines) - MOST} more", rest))
    scale = Scale(0.0, 100.0, LABELS, WIDTH - 60)
    parts, begin, bottom = [], 0.0, TOP + ROW * len(rows)
    parts += scale.axis(bottom + 4, "share of the variance, %, summed up", top=TOP - 4)
    for index, (label, share) in enumerate(rows):
        y, end = TOP + ROW * index, begin + 100 * share
        x0, x1 = scale.at(min(begin, 100)), scale.at(min(end, 100))
        parts.append(text(LABELS - 10, y + 14, printable(label, 42), anchor="end"))
        parts.append(box(x0, y + 3, max(x1, x0 + 0.8), y + ROW - 3, f'fill="{BAR}"'))
        if index + 1 < len(rows):
            parts.append(line(x1, y + 3, x1, y + ROW + 3, MUTED, 0.7))
        inside = x1 > WIDTH - 110
        words = f"{percent(share)} %"
        parts.append(text(x0 - 5 if inside else x1 + 5, y + 14, words, anchor="end" if inside else "start"))
        begin = end
    if not rows:
        bottom += ROW
        parts = [*scale.axis(bottom + 4, "share of the variance, %, summed up", top=TOP - 4), _nothing()]
    listed = "; ".join(f"{label} {percent(share)} %" for label, share in rows) or "nothing is random"
    return picture(name, f"Budget at target {target}: shares of the variance", listed + ".", bottom + 44, parts)


def without_svg(
    contributors: Sequence[Contributor], target: str, p95_mm: float, limit_mm: float | None, name: str = "without"
) -> str:
    """First-order P95 were each contributor perfect, largest gain first, with P95 as it is and the limit."""
    lines = [entry for entry in single_lines(contributors) if entry.p95_without_mm < p95_mm]
    lines = sorted(lines, key=lambda entry: entry.p95_without_mm)[:MOST]
    scale = Scale(0.0, 1.08 * max(p95_mm, limit_mm or 0.0, 1e-9), LABELS, WIDTH - 90)
    bottom = TOP + 8 + ROW * max(len(lines), 1)
    parts = scale.axis(bottom + 4, "first-order P95 at the target, mm", top=TOP + 4)
    for index, entry in enumerate(lines):
        y = TOP + 8 + ROW * index
        parts.append(text(LABELS - 10, y + 14, printable(named(entry), 42), anchor="end"))
        parts.append(box(scale.at(0), y + 3, scale.at(p95_mm), y + ROW - 3, f'fill="{BAR_PALE}"'))
        parts.append(box(scale.at(0), y + 3, scale.at(entry.p95_without_mm), y + ROW - 3, f'fill="{BAR}"'))
        parts.append(text(scale.at(0) + 6, y + 14, fixed(entry.p95_without_mm, 3), colour=INK))
    parts += [] if lines else [_nothing()]
    ours, theirs = sides(p95_mm, limit_mm)
    parts += marker(scale, p95_mm, TOP, bottom + 4, f"P95 {p95_mm:.3f} mm", VALUE_COLOUR, ours)
    if limit_mm is not None:
        parts += marker(scale, limit_mm, TOP, bottom + 4, f"limit {limit_mm:g} mm", LIMIT_COLOUR, theirs, "5 3")
    listed = "; ".join(f"without {named(entry)} {entry.p95_without_mm:.3f} mm" for entry in lines)
    words = f"P95 is {p95_mm:.3f} mm. {listed}."
    return picture(name, f"P95 at target {target} without each contributor", words, bottom + 44, parts)


def _nothing() -> str:
    return text(LABELS - 10, TOP + 22, "nothing is random", anchor="end", colour=MUTED)
