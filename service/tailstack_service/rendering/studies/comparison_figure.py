"""Bench measurements against prediction as a figure: means by level, and the Q-Q plot of each level."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.studies.bench.compare import StudyComparison
from tailstack.studies.bench.levels import LevelCompared

from ...report.svg import BLUE, FAINT, MUTED, VERMILION, box, line, printable, rounded, text
from .page import around, bottom_axis, left_axis, page

PANEL, GAP, LEFT, TOP = 300, 84, 70, 92
MOST_PANELS, NARROWEST = 6, 720
BAND = "#dbe8f3"


def comparison_svg(study: StudyComparison) -> str:
    """Mean error by level beside what such benches would give; ordered errors against simulated ones."""
    every = [level for level in study.levels if level.quantiles]
    with_tail = every[:MOST_PANELS]
    columns = min(1 + len(with_tail), 4)
    rows = -(-(1 + len(with_tail)) // columns)
    width = max(LEFT + columns * (PANEL + GAP) - GAP + 30, NARROWEST)
    height = TOP + rows * (PANEL + 100) + 10
    left_out = f"; tails of the first {MOST_PANELS} of {len(every)} levels" if len(every) > MOST_PANELS else ""
    about = f"{study.provenance.design_name}; {study.file.name}; {study.error} error{left_out}"
    parts = [text(15, 44, printable(about, 150))]
    parts += _means(study.levels, LEFT, TOP)
    for number, level in enumerate(with_tail, 1):
        row, column = divmod(number, columns)
        parts += _quantiles(level, LEFT + column * (PANEL + GAP), TOP + row * (PANEL + 100))
    words = " ".join([f"Measurements and prediction: {study.verdict}.", *study.conclusions])
    return page("Bench measurements against prediction", words, width, height, parts)


def _means(levels: Sequence[LevelCompared], left: float, top: float) -> list[str]:
    bottom = top + PANEL
    values = [
        value
        for level in levels
        for value in (
            level.norm.measured_mm, *(level.norm.interval_mm or ()), level.norm.predicted_mm,
            *level.norm.predicted_range_mm,
        )
    ]  # fmt: skip
    scale = around(values, bottom, top, zero=True)
    parts = [text(left, top - 26, "mean error by level", weight="bold")]
    parts += left_axis(scale, left, left + PANEL, "mm")
    step = PANEL / max(len(levels), 1)
    for k, level in enumerate(levels):
        x = left + step * (k + 0.5)
        low, high = (scale.at(end) for end in level.norm.predicted_range_mm)
        parts.append(box(x - 16, high, x + 16, low, f'fill="{BAND}"'))
        predicted = scale.at(level.norm.predicted_mm)
        parts.append(line(x - 16, predicted, x + 16, predicted, VERMILION, 2))
        if level.norm.interval_mm is not None:
            a, b = (scale.at(end) for end in level.norm.interval_mm)
            parts += [line(x, a, x, b, BLUE, 2.2), line(x - 5, a, x + 5, a, BLUE), line(x - 5, b, x + 5, b, BLUE)]
        y = scale.at(level.norm.measured_mm)
        parts.append(f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="4" fill="{BLUE}"/>')
        label = level.level if len({other.target for other in levels}) == 1 else f"{level.level}, {level.target}"
        parts.append(text(x, bottom + 16, printable(label, max(int(step / 7), 3)), anchor="middle", colour=MUTED))
    parts.append(line(left, bottom, left + PANEL, bottom, FAINT))
    parts.append(text(left, bottom + 40, "dot and bar: measured, 95 %; line and band: predicted,", colour=MUTED))
    parts.append(text(left, bottom + 54, "95 % of benches run like this one", colour=MUTED))
    return parts


def _quantiles(level: LevelCompared, left: float, top: float) -> list[str]:
    bottom, points = top + PANEL, level.quantiles
    values = [value for point in points for value in (point.measured_mm, point.predicted_mm, *point.envelope_mm)]
    across = around([point.predicted_mm for point in points], left, left + PANEL)
    up = around(values, bottom, top)
    heading = printable(f"{level.level}, {level.target}: ordered errors, n = {level.trials}", 46)
    parts = [text(left, top - 26, heading, weight="bold")]
    edge = [(point.predicted_mm, point.envelope_mm[1]) for point in points]
    edge += [(point.predicted_mm, point.envelope_mm[0]) for point in reversed(points)]
    corners = " ".join(f"{rounded(across.at(x))},{rounded(up.at(y))}" for x, y in edge)
    parts.append(f'<polygon points="{corners}" fill="{BAND}"/>')
    parts += left_axis(up, left, left + PANEL, "measured, mm")
    parts += bottom_axis(across, top, bottom, "predicted (median of simulated benches), mm")
    low, high = max(across.low, up.low), min(across.high, up.high)
    if low < high:
        ends = (across.at(low), up.at(low), across.at(high), up.at(high))
        parts.append(line(*ends, VERMILION, 1.5))
    for point in points:
        x, y = across.at(point.predicted_mm), up.at(point.measured_mm)
        look = f'fill="#ffffff" stroke="{BLUE}" stroke-width="1.5"' if point.outside else f'fill="{BLUE}"'
        parts.append(f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="3.2" {look}/>')
    parts.append(text(left, bottom + 54, "band: 95 % of benches at each place; hollow: outside it", colour=MUTED))
    return parts
