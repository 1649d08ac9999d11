"""The few SVG elements a layout picture needs, and the shapes and colours of what it shows.

Colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/), some darkened to be read as text: told apart
by colour-blind readers.  Every kind of mark has its own shape as well, so a picture can be printed in grey.
Lengths are units of the page; one decimal is written.
"""

from __future__ import annotations

from html import escape
from typing import Literal

from .tables import shortened

Kind = Literal["fiducial", "new", "target", "pivot 1", "pivot 2"]

FONT = 11
INK, MUTED, FAINT, PALE = "#222222", "#555555", "#8a8a8a", "#efefef"
BLUE, VERMILION, GREEN, PURPLE = "#0072b2", "#d55e00", "#00795a", "#a8477f"


def printable(text: str, width: int) -> str:
    """Text that XML can hold, cut to a width."""
    return shortened("".join(c if c.isprintable() else "?" for c in text), width)


def rounded(value: float) -> str:
    """One decimal, and no negative zero."""
    return f"{round(value, 1) + 0.0:.1f}"


def line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float = 1.0, dashes: str = "") -> str:
    """A straight line."""
    look = f' stroke-dasharray="{dashes}"' if dashes else ""
    return f'<path d="{_segment(x0, y0, x1, y1)}" stroke="{colour}" stroke-width="{width:g}"{look} fill="none"/>'


def _segment(x0: float, y0: float, x1: float, y1: float) -> str:
    return f"M{rounded(x0)} {rounded(y0)}L{rounded(x1)} {rounded(y1)}"


def box(x0: float, y0: float, x1: float, y1: float, look: str) -> str:
    """A rectangle; ``look`` is its attributes for stroke and fill."""
    return f'<rect x="{rounded(x0)}" y="{rounded(y0)}" width="{rounded(x1 - x0)}" height="{rounded(y1 - y0)}" {look}/>'


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    colour: str = INK,
    size: int = FONT,
    weight: str = "normal",
) -> str:
    """One line of text; (x, y) is where its baseline begins, ends or has its middle."""
    look = f'font-size="{size}"' if size != FONT else ""
    look += f' font-weight="{weight}"' if weight != "normal" else ""
    look += f' text-anchor="{anchor}"' if anchor != "start" else ""
    look += f' fill="{colour}"' if colour != INK else ""
    return f'<text x="{rounded(x)}" y="{rounded(y)}"{" " if look else ""}{look.strip()}>{escape(words)}</text>'


LABEL_COLOUR = {"fiducial": INK, "new": INK, "target": "#a84600", "pivot 1": GREEN, "pivot 2": PURPLE}


def shape(kind: Kind, x: float, y: float) -> str:
    """The mark of a kind, centred on (x, y)."""
    if kind in ("fiducial", "new"):
        look = f'fill="{BLUE}"' if kind == "fiducial" else f'fill="#ffffff" stroke="{BLUE}" stroke-width="1.6"'
        return f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="{3.6 if kind == "fiducial" else 3.4}" {look}/>'
    if kind == "target":
        path = _segment(x - 5, y - 5, x + 5, y + 5) + _segment(x - 5, y + 5, x + 5, y - 5)
        return f'<path d="{path}" stroke="{VERMILION}" stroke-width="2" fill="none"/>'
    tip = -1 if kind == "pivot 1" else 1
    base = y - 4.5 * tip
    corners = ((x, y + 6 * tip), (x - 5.5, base), (x + 5.5, base))
    points = " ".join(f"{rounded(across)},{rounded(down)}" for across, down in corners)
    return f'<polygon points="{points}" fill="{LABEL_COLOUR[kind]}"/>'
