"""An SVG page of a study: its frame, and a scale along or up the page with round ticks."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from math import ceil, floor

from ...report.svg import FAINT, FONT, INK, MUTED, line, printable, text
from ..panels import round_step

GRID = "#e3e3e3"
LETTER = 9.0  # of a title: few names are wider


def page(title: str, words: str, width: float, height: float, parts: list[str]) -> str:
    """One SVG that says in words what it shows."""
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" role="img" aria-labelledby="study-title study-desc" '
        f'font-family="Helvetica, Arial, DejaVu Sans, sans-serif" font-size="{FONT}" fill="{INK}">',
        f'<title id="study-title">{escape(printable(title, 160))}</title>',
        f'<desc id="study-desc">{escape(printable(words, 2000))}</desc>',
        f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
        text(15, 24, printable(title, min(110, int((width - 30) / LETTER))), size=15, weight="bold"),
        *parts,
        "</svg>",
        "",
    ])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Scale:
    """Numbers along the page (``begin`` left of ``end``) or up it (``begin`` below ``end``)."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: float) -> float:
        return self.begin + (self.end - self.begin) * (value - self.low) / (self.high - self.low)

    def ticks(self, apart: float = 60) -> list[float]:
        """Round numbers at least ``apart`` units of the page from one to the next."""
        step = round_step(2.5 * apart * (self.high - self.low) / abs(self.end - self.begin))
        return [step * k + 0.0 for k in range(ceil(self.low / step - 1e-9), floor(self.high / step + 1e-9) + 1)]


def around(values: list[float], begin: float, end: float, *, zero: bool = False, room: float = 0.06) -> Scale:
    """A scale that holds these values with some room."""
    low, high = min(values), max(values)
    if zero:
        low = min(low, 0.0)
    pad = room * max(high - low, 1e-9 * max(abs(low), abs(high), 1e-3))
    return Scale(low if zero and low == 0.0 else low - pad, high + pad, begin, end)


def bottom_axis(scale: Scale, top: float, bottom: float, title: str, apart: float = 60) -> list[str]:
    """Ticks, faint lines up to ``top`` and a title below."""
    parts = []
    for value in scale.ticks(apart):
        x = scale.at(value)
        parts += [line(x, top, x, bottom, GRID, 0.7), line(x, bottom, x, bottom + 4, FAINT)]
        parts.append(text(x, bottom + 16, f"{value:g}", anchor="middle", colour=MUTED))
    parts.append(line(scale.begin, bottom, scale.end, bottom, FAINT))
    parts.append(text((scale.begin + scale.end) / 2, bottom + 33, title, anchor="middle", colour=MUTED))
    return parts


def left_axis(scale: Scale, left: float, right: float, title: str, apart: float = 40) -> list[str]:
    """Ticks, faint lines to ``right`` and a title above."""
    parts = []
    for value in scale.ticks(apart):
        y = scale.at(value)
        parts.append(line(left, y, right, y, GRID, 0.7))
        parts.append(text(left - 6, y + 4, f"{value:g}", anchor="end", colour=MUTED))
    parts.append(line(left, scale.begin, left, scale.end, FAINT))
    parts.append(text(left - 6, scale.end - 10, title, anchor="start", colour=MUTED))
    return parts
