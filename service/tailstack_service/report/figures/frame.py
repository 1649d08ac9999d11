"""What every picture shares: its frame, title and description, a horizontal scale, and the colours of lines."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from math import ceil, floor

from ...rendering.panels import round_step
from ..svg import FAINT, FONT, INK, MUTED, line, printable, text

WIDTH = 720
LIMIT_COLOUR, VALUE_COLOUR = "#b3261e", "#0072b2"
BAR, BAR_PALE, LAW_COLOUR = "#5b9bc8", "#c9dceb", "#a84600"
ROW = 22


def picture(name: str, title: str, words: str, height: float, parts: list[str], width: int = WIDTH) -> str:
    """One SVG that says in words what it shows."""
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height:g}" '
        f'viewBox="0 0 {width} {height:g}" role="img" aria-labelledby="{name}-title {name}-desc" '
        f'font-family="Helvetica, Arial, DejaVu Sans, sans-serif" font-size="{FONT}" fill="{INK}">',
        f'<title id="{name}-title">{escape(printable(title, 160))}</title>',
        f'<desc id="{name}-desc">{escape(printable(words, 2000))}</desc>',
        f'<rect width="{width}" height="{height:g}" fill="#ffffff"/>',
        *parts,
        "</svg>",
    ])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Scale:
    """Numbers along the page."""

    low: float
    high: float
    left: float
    right: float

    def at(self, value: float) -> float:
        return self.left + (self.right - self.left) * (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """Round numbers some 80 units apart."""
        step = round_step(2.0 * 80 * (self.high - self.low) / (self.right - self.left))
        return [step * k for k in range(ceil(self.low / step - 1e-9), floor(self.high / step + 1e-9) + 1)]

    def axis(self, y: float, title: str, top: float | None = None) -> list[str]:
        """The scale below a picture; ``top``: draws faint lines up to there."""
        parts = []
        for value in self.ticks():
            x = self.at(value)
            if top is not None:
                parts.append(line(x, top, x, y, "#e3e3e3", 0.7))
            parts += [line(x, y, x, y + 4, FAINT), text(x, y + 16, plain(value), anchor="middle", colour=MUTED)]
        parts.append(line(self.left, y, self.right, y, FAINT))
        parts.append(text((self.left + self.right) / 2, y + 32, title, anchor="middle", colour=MUTED))
        return parts


def plain(value: float) -> str:
    """A number of an axis: no digits that say nothing, and a minus sign that is one."""
    return f"{value:g}".replace("-", "−")


def density_axis(highest: float, left: float, right: float, top: float, bottom: float, title: float) -> list[str]:
    """The upward scale of a density from 0 to ``highest``, 1/mm; ``title``: the height of its title."""
    step = round_step(2.5 * 40 * highest / (bottom - top))
    parts = [text(8, title, "density, 1/mm", colour=MUTED)]
    for k in range(floor(highest / step) + 1):
        y = bottom - (bottom - top) * step * k / highest
        parts.append(line(left, y, right, y, "#e3e3e3", 0.7))
        parts.append(text(left - 6, y + 4, plain(step * k), anchor="end", colour=MUTED))
    return parts


def sides(value: float, limit: float | None) -> tuple[str, str]:
    """On which sides of their lines a value and its limit are named, so that neither crosses the other's line."""
    return ("right", "left") if limit is not None and limit < value else ("left", "right")


def marker(
    scale: Scale, value: float, top: float, bottom: float, words: str, colour: str, side: str, dashes: str = ""
) -> list[str]:
    """A vertical line with its words on top, to the "left" or "right" of it."""
    x = scale.at(value)
    anchor, shift = ("end", -4) if side == "left" else ("start", 4)
    return [
        line(x, top - 4, x, bottom, colour, 1.6, dashes),
        text(x + shift, top - 6, words, anchor=anchor, colour=colour, weight="bold"),
    ]
