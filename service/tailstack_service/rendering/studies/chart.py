"""A line chart as a part of a figure: axes with round ticks, lines, marks, bars of uncertainty, names beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ...report.svg import BLUE, FAINT, GREEN, INK, PURPLE, VERMILION, line, printable, rounded, text
from .page import Scale, around, bottom_axis, left_axis

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, "#8a6d00", "#5b9bc8")
Mark = Literal["disc", "ring", "square", "frame", "none"]
NAME_GAP = 14.0  # least distance of two names, one above the other
LEGIBLE = {VERMILION: "#b34700", FAINT: INK}  # names: a colour too pale for letters
SAMPLE = 26.0  # length of a line before its name, where lines differ by their dashes


@dataclass(frozen=True, slots=True)
class Curve:
    """One line or a row of marks; ``errors`` are half-lengths of the bars, None for none.

    A frame is a square that lets what lies below it be seen.
    """

    name: str  # at its right end; "" for none
    points: Sequence[tuple[float, float]]
    colour: str
    joined: bool = True
    mark: Mark = "disc"
    dashes: str = ""
    errors: Sequence[float] | None = None


@dataclass(frozen=True, slots=True)
class Axes:
    """A pair of scales on the page."""

    x: Scale
    y: Scale


def fitted(curves: Sequence[Curve], left: float, right: float, top: float, bottom: float) -> Axes:
    """Axes in a rectangle of the page that hold all curves; y begins at zero."""
    across = [x for curve in curves for x, _ in curve.points]
    upward = [
        y + (curve.errors[k] if curve.errors is not None else 0.0)
        for curve in curves
        for k, (_, y) in enumerate(curve.points)
    ]
    return Axes(around(across, left, right), around([0.0, *upward], bottom, top, zero=True))


def drawn(axes: Axes, curves: Sequence[Curve], heading: str, x_title: str, y_title: str) -> list[str]:
    """SVG elements of a chart; the heading stands above the title of y."""
    left, right, top, bottom = axes.x.begin, axes.x.end, axes.y.end, axes.y.begin
    parts = [text(left - 6, top - 28, printable(heading, 90), weight="bold")]
    parts += bottom_axis(axes.x, top, bottom, x_title) + left_axis(axes.y, left, right, y_title)
    for curve in curves:
        parts += _curve(axes, curve)
    return parts + _names(axes, curves)


def _curve(axes: Axes, curve: Curve) -> list[str]:
    at = [(axes.x.at(x), axes.y.at(y)) for x, y in curve.points]
    parts = []
    if curve.joined and len(at) > 1:
        path = "M" + "L".join(f"{rounded(x)} {rounded(y)}" for x, y in at)
        look = f' stroke-dasharray="{curve.dashes}"' if curve.dashes else ""
        parts.append(f'<path d="{path}" fill="none" stroke="{curve.colour}" stroke-width="1.8"{look}/>')
    for k, (x, y) in enumerate(at):
        if curve.errors is not None:
            reach = curve.errors[k]
            value = curve.points[k][1]
            low, high = axes.y.at(max(value - reach, axes.y.low)), axes.y.at(value + reach)
            parts += [line(x, low, x, high, curve.colour, 1.2)]
            parts += [line(x - 3, end, x + 3, end, curve.colour, 1.2) for end in (low, high)]
        parts.append(mark(curve.mark, x, y, curve.colour))
    return [part for part in parts if part]


def mark(shape: Mark, x: float, y: float, colour: str) -> str:
    """A mark centred on (x, y)."""
    if shape == "none":
        return ""
    if shape in ("square", "frame"):
        look = f'fill="{"none" if shape == "frame" else "#ffffff"}" stroke="{colour}" stroke-width="1.5"'
        return f'<rect x="{rounded(x - 3.4)}" y="{rounded(y - 3.4)}" width="6.8" height="6.8" {look}/>'
    look = f'fill="{colour}"' if shape == "disc" else f'fill="#ffffff" stroke="{colour}" stroke-width="1.5"'
    return f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="3.2" {look}/>'


def _names(axes: Axes, curves: Sequence[Curve]) -> list[str]:
    """Names at the right ends, pushed apart where they would touch."""
    named = sorted((c for c in curves if c.name), key=lambda curve: axes.y.at(curve.points[-1][1]))
    places = [axes.y.at(curve.points[-1][1]) + 4 for curve in named]
    for k in range(1, len(places)):
        places[k] = max(places[k], places[k - 1] + NAME_GAP)
    over = max(places[-1] - axes.y.begin, 0.0) if places else 0.0
    for k in range(len(places) - 1, -1, -1):
        highest = places[k + 1] - NAME_GAP if k + 1 < len(places) else places[k] - over
        places[k] = min(places[k], highest)
    sampled = SAMPLE + 5 if any(curve.dashes for curve in named) else 0.0
    x = axes.x.end + 10
    parts = []
    for y, curve in zip(places, named, strict=True):
        if sampled:
            parts.append(line(x, y - 4, x + SAMPLE, y - 4, curve.colour, 1.8, curve.dashes))
        colour = LEGIBLE.get(curve.colour, curve.colour)
        parts.append(text(x + sampled, y, printable(curve.name, 40), colour=colour))
    return parts
