"""Line charts as SVG text for the pages of docs/: axes, units, direct labels, colours for colour-blind readers.

A figure is 900 units wide and holds one or more charts side by side.  The same input gives the same text.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import log10
from typing import Literal

from tailstack.results.look import FAINT, INK, MUTED, PALE
from tailstack_service.report.svg import box, line, text, trim

WIDTH = 900
SIZE = 13  # of all text but titles
CHART_HEIGHT = 300
TOP, BOTTOM, LEFT = 62, 62, 62  # room for the heading, for ticks and their unit, for values
LINE_GAP = 15  # least distance of two labels, one above the other

Shape = Literal["circle", "square", "triangle", "diamond", "none"]


@dataclass(frozen=True, slots=True)
class Series:
    """One line: points (x, y) in the order they are joined; a band between ``low`` and ``high`` if given."""

    name: str  # written at its right end; "" for none
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    shape: Shape = "circle"
    dashes: str = ""
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    hollow: Sequence[bool] = ()  # which marks are
    label_left: bool = False  # name to the left of the last point


@dataclass(frozen=True, slots=True)
class Chart:
    """One pair of axes; ticks are the values that are written."""

    heading: str
    x_label: str
    y_label: str
    x_ticks: Sequence[float]
    y_ticks: Sequence[float]
    series: Sequence[Series]
    log_x: bool = False
    log_y: bool = False
    label_room: int = 130  # to the right of the axes


@dataclass(frozen=True, slots=True)
class Frame:
    """The axes of a chart on the page; y runs down."""

    chart: Chart
    left: float
    right: float
    top: float
    bottom: float

    def x(self, value: float) -> float:
        return self.left + (self.right - self.left) * _share(value, self.chart.x_ticks, self.chart.log_x)

    def y(self, value: float) -> float:
        return self.bottom - (self.bottom - self.top) * _share(value, self.chart.y_ticks, self.chart.log_y)


def _share(value: float, ticks: Sequence[float], logarithmic: bool) -> float:
    low, high = ticks[0], ticks[-1]
    if not low <= value <= high:
        raise ValueError(f"{value:g} is off an axis from {low:g} to {high:g}")
    if logarithmic:
        return log10(value / low) / log10(high / low)
    return (value - low) / (high - low)


def begin(title: str, description: str, height: int) -> list[str]:
    """Opening tag, title and description for those who do not see the figure, white ground, heading."""
    return [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        f'role="img" aria-labelledby="t d" font-family="Helvetica, Arial, DejaVu Sans, sans-serif" font-size="11" '
        f'fill="{INK}">',
        f'<title id="t">{escape(title)}</title>',
        f'<desc id="d">{escape(description)}</desc>',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
        text(16, 25, title, size=16, weight="bold"),
    ]


def figure(title: str, description: str, charts: Sequence[Chart]) -> str:
    """An SVG with these charts side by side."""
    height = TOP + CHART_HEIGHT + BOTTOM
    each = WIDTH / len(charts)
    parts = begin(title, description, height)
    for column, chart in enumerate(charts):
        left = column * each + LEFT
        frame = Frame(chart, left, (column + 1) * each - chart.label_room, TOP, TOP + CHART_HEIGHT)
        parts += drawn(frame)
    return "\n".join([*parts, "</svg>"]) + "\n"


def drawn(frame: Frame) -> list[str]:
    """Axes, bands, lines, marks and labels of one chart."""
    parts = _axes(frame)
    for series in frame.chart.series:
        parts += _band(frame, series)
    for series in frame.chart.series:
        parts += _line(frame, series)
    return parts + _labels(frame)


def _axes(frame: Frame) -> list[str]:
    chart = frame.chart
    parts = [text(frame.left - 46, frame.top - 12, chart.heading, size=SIZE, weight="bold")]
    for value in chart.y_ticks:
        y = frame.y(value)
        parts.append(line(frame.left, y, frame.right, y, "#dcdcdc", 0.8))
        parts.append(text(frame.left - 7, y + 4.5, f"{value:g}", anchor="end", size=SIZE, colour=MUTED))
    for value in chart.x_ticks:
        x = frame.x(value)
        parts.append(line(x, frame.bottom, x, frame.bottom + 5, FAINT))
        parts.append(text(x, frame.bottom + 19, f"{value:g}", anchor="middle", size=SIZE, colour=MUTED))
    middle = (frame.left + frame.right) / 2
    parts.append(line(frame.left, frame.bottom, frame.right, frame.bottom, INK))
    parts.append(text(middle, frame.bottom + 41, chart.x_label, anchor="middle", size=SIZE))
    across, down = frame.left - 46, (frame.top + frame.bottom) / 2
    upright = text(0, 0, chart.y_label, anchor="middle", size=SIZE)
    parts.append(f'<g transform="translate({trim(across)} {trim(down)}) rotate(-90)">{upright}</g>')
    return parts


def _band(frame: Frame, series: Series) -> list[str]:
    if not series.low:
        return []
    edge = [*zip(series.x, series.high, strict=True), *reversed([*zip(series.x, series.low, strict=True)])]
    points = " ".join(f"{trim(frame.x(x))},{trim(frame.y(y))}" for x, y in edge)
    return [f'<polygon points="{points}" fill="{PALE}" stroke="none"/>']


def _line(frame: Frame, series: Series) -> list[str]:
    at = [(frame.x(x), frame.y(y)) for x, y in zip(series.x, series.y, strict=True)]
    hollow = series.hollow or [False] * len(at)
    parts = []
    if len(at) > 1:
        path = "M" + "L".join(f"{trim(x)} {trim(y)}" for x, y in at)
        look = f' stroke-dasharray="{series.dashes}"' if series.dashes else ""
        parts.append(f'<path d="{path}" stroke="{series.colour}" stroke-width="2" fill="none"{look}/>')
    marks = zip(at, hollow, strict=True)
    return parts + [mark(series.shape, x, y, series.colour, hollow=white) for (x, y), white in marks]


def mark(shape: Shape, x: float, y: float, colour: str, size: float = 4.0, *, hollow: bool = False) -> str:
    """A mark centred on (x, y), filled unless hollow."""
    look = f'fill="#ffffff" stroke="{colour}" stroke-width="1.4"' if hollow else f'fill="{colour}"'
    if shape == "none":
        return ""
    if shape == "circle":
        return f'<circle cx="{trim(x)}" cy="{trim(y)}" r="{size}" {look}/>'
    if shape == "square":
        return box(x - size, y - size, x + size, y + size, look)
    corners = {
        "triangle": ((x, y - 1.3 * size), (x - 1.2 * size, y + 0.9 * size), (x + 1.2 * size, y + 0.9 * size)),
        "diamond": ((x, y - 1.4 * size), (x + 1.4 * size, y), (x, y + 1.4 * size), (x - 1.4 * size, y)),
    }[shape]
    points = " ".join(f"{trim(across)},{trim(down)}" for across, down in corners)
    return f'<polygon points="{points}" {look}/>'


def _labels(frame: Frame) -> list[str]:
    """Names at the right ends, in the order of the ends, pushed apart where they would touch."""
    named = [series for series in frame.chart.series if series.name]
    ends = sorted(((frame.y(series.y[-1]), series) for series in named), key=lambda pair: pair[0])
    parts: list[str] = []
    lines = [series.name.split("\n") for _, series in ends]
    at = [y + 4.5 - LINE_GAP * (len(words) - 1) / 2 for (y, _), words in zip(ends, lines, strict=True)]
    for k in range(1, len(at)):
        at[k] = max(at[k], at[k - 1] + LINE_GAP * len(lines[k - 1]) + 2)
    over = max(at[-1] + LINE_GAP * (len(lines[-1]) - 1) - frame.bottom, 0.0) if at else 0.0
    for k in range(len(at) - 1, -1, -1):  # from the bottom up, as far as the overhang pushes
        highest = at[k + 1] - LINE_GAP * len(lines[k]) - 2 if k + 1 < len(at) else at[k] - over
        at[k] = min(at[k], highest)
    for y, (_, series), words in zip(at, ends, lines, strict=True):
        x, anchor = frame.x(series.x[-1]) + (-10 if series.label_left else 10), "end" if series.label_left else "start"
        for row, part in enumerate(words):
            parts.append(text(x, y + row * LINE_GAP, part, anchor=anchor, size=12, colour=series.colour))
    return parts
