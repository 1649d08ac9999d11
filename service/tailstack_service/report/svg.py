"""SVG elements of the pictures of a layout, their shapes and colours, and where labels go beside their points.

Colours are those of ``tailstack.results.look``.  Every kind of mark has its own shape as well, so a picture can be
printed in grey.  Lengths are units of the page; one decimal is written.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from html import escape
from math import floor, log10
from typing import Literal

import numpy as np

from tailstack.geometry.arrays import Array
from tailstack.results.look import BLUE, FONT, GREEN, INK, PURPLE, VERMILION

from ..rendering.text import columns, shorten

Kind = Literal["fiducial", "new", "target", "pivot 1", "pivot 2"]

WIDTH = 720  # of a page
LONGEST = 300  # letters of a name


def picture(
    name: str, title: str, words: str, height: float, parts: list[str], width: float = WIDTH, drawn_by: str = ""
) -> str:
    """One SVG that says in words what it shows.

    name: kebab-case, unique on the page.  drawn_by: a library and its version, of which the bytes depend.
    """
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" role="img" aria-labelledby="{name}-title {name}-desc" '
        f'font-family="Helvetica, Arial, DejaVu Sans, sans-serif" font-size="{FONT}" fill="{INK}"'
        + (f' data-drawn-by="{drawn_by}">' if drawn_by else ">"),
        f'<title id="{name}-title">{escape(printable(title, 2 * LONGEST))}</title>',
        f'<desc id="{name}-desc">{escape(printable(words, 20 * LONGEST))}</desc>',
        f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
        *parts,
        "</svg>",
    ])  # fmt: skip


def printable(text: str, width: int) -> str:
    """Text that XML can hold, cut to a width."""
    return shorten("".join(c if c.isprintable() else "?" for c in text), width)


def round_step(about: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``about``."""
    power = 10.0 ** floor(log10(about))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= about * (1 + 1e-9))


def broken(words: str, letters: int) -> tuple[str, ...]:
    """A name whole, in lines of so many letters."""
    return tuple(textwrap.wrap(printable(words, LONGEST), letters, break_on_hyphens=False)) or ("",)


def in_lines(name: str, letters: int) -> str:
    """The same as one text, its lines apart."""
    return "\n".join(broken(name, letters))


def trim(value: float) -> str:
    """One decimal, and no negative zero."""
    return f"{round(value, 1) + 0.0:.1f}"


def line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float = 1.0, dashes: str = "") -> str:
    """A straight line."""
    look = f' stroke-dasharray="{dashes}"' if dashes else ""
    return f'<path d="{_segment(x0, y0, x1, y1)}" stroke="{colour}" stroke-width="{width:g}"{look} fill="none"/>'


def _segment(x0: float, y0: float, x1: float, y1: float) -> str:
    return f"M{trim(x0)} {trim(y0)}L{trim(x1)} {trim(y1)}"


def box(x0: float, y0: float, x1: float, y1: float, look: str) -> str:
    """A rectangle; ``look`` is its attributes for stroke and fill."""
    return f'<rect x="{trim(x0)}" y="{trim(y0)}" width="{trim(x1 - x0)}" height="{trim(y1 - y0)}" {look}/>'


def text(
    x: float, y: float, words: str, *, anchor: str = "start", colour: str = INK, size: float = FONT,
    weight: str = "normal",
) -> str:  # fmt: skip
    """One line of text; (x, y) is where its baseline begins, ends or has its middle."""
    look = f' font-size="{size:g}"' if size != FONT else ""
    look += f' font-weight="{weight}"' if weight != "normal" else ""
    look += f' text-anchor="{anchor}"' if anchor != "start" else ""
    look += f' fill="{colour}"' if colour != INK else ""
    return f'<text x="{trim(x)}" y="{trim(y)}"{look}>{escape(words)}</text>'


def label_lines(x: float, y: float, words: str, colour: str) -> list[str]:
    """A label of one or several lines from its first baseline on."""
    return [text(x, y + FONT * k, line, colour=colour) for k, line in enumerate(words.split("\n"))]


LABEL_COLOUR = {"fiducial": INK, "new": INK, "target": "#a84600", "pivot 1": GREEN, "pivot 2": PURPLE}


def shape(kind: Kind, x: float, y: float) -> str:
    """The mark of a kind, centred on (x, y)."""
    if kind in ("fiducial", "new"):
        look = f'fill="{BLUE}"' if kind == "fiducial" else f'fill="#ffffff" stroke="{BLUE}" stroke-width="1.6"'
        return f'<circle cx="{trim(x)}" cy="{trim(y)}" r="{3.6 if kind == "fiducial" else 3.4}" {look}/>'
    if kind == "target":
        path = _segment(x - 5, y - 5, x + 5, y + 5) + _segment(x - 5, y + 5, x + 5, y - 5)
        return f'<path d="{path}" stroke="{VERMILION}" stroke-width="2" fill="none"/>'
    tip = -1 if kind == "pivot 1" else 1
    base = y - 4.5 * tip
    corners = ((x, y + 6 * tip), (x - 5.5, base), (x + 5.5, base))
    points = " ".join(f"{trim(across)},{trim(down)}" for across, down in corners)
    return f'<polygon points="{points}" fill="{LABEL_COLOUR[kind]}"/>'


Box = tuple[float, float, float, float]  # left, top, right, bottom; y down

MARK = 4.5  # half the side of a mark
REACHES = (7.0, 13.0, 21.0)  # from the point to the near edge of its label
DIRECTIONS = ((1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (-1, -1), (1, 1), (-1, 1))
CHARACTER = 0.6  # width of a character over the size of the font
FURTHER, CROSSED, HIDDEN, OUTSIDE = 14.0, 0.4, 2.0, 4.0  # what a longer reach costs; prices of covered area


@dataclass(frozen=True, slots=True)
class MarkedPoint:
    x: float
    y: float
    text: str  # "" for a mark without a label; may have several lines


def label_places(points: list[MarkedPoint], lines: list[Box], frame: Box, font: float) -> list[tuple[float, float]]:
    """Start of the first baseline of each label; the point itself for those without one.

    Greedy: a label takes the place that covers least of marks, lines (from x, y to x, y) and earlier labels and
    lies in the frame; of equal ones the nearest, then right before left before above before below.
    """
    marks = np.array([(p.x - MARK, p.y - MARK, p.x + MARK, p.y + MARK) for p in points]).reshape(-1, 4)
    crossed = np.array([box for line in lines for box in beads(line)]).reshape(-1, 4)
    labels = np.zeros((0, 4))
    places = []
    for point in points:
        if not point.text:
            places.append((point.x, point.y))
            continue
        boxes = np.array([label_box(point, reach, way, font) for reach in REACHES for way in DIRECTIONS])
        area = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
        order = np.arange(len(boxes))
        harm = (
            HIDDEN * measure_overlap(boxes, labels) + measure_overlap(boxes, marks)
            + CROSSED * measure_overlap(boxes, crossed)
            + OUTSIDE * (area - measure_overlap(boxes, np.array([frame])))
            + FURTHER * (order // len(DIRECTIONS)) + 0.5 * order
        )  # fmt: skip
        best = boxes[int(np.argmin(harm))]
        labels = np.vstack([labels, best])
        places.append((float(best[0]), float(best[1]) + 0.78 * font))
    return places


def label_box(point: MarkedPoint, reach: float, way: tuple[int, int], font: float) -> Box:
    """The box of a label whose near edge is ``reach`` from its point, in one of eight directions."""
    lines = point.text.split("\n")
    width, height = CHARACTER * font * max(map(columns, lines)), font * len(lines)
    across, down = way
    short = 0.7 * reach if across and down else reach
    left = point.x + (across * short if across >= 0 else -short - width) - (0 if across else width / 2)
    top = point.y + (down * short if down >= 0 else -short - height) - (0 if down else height / 2)
    return left, top, left + width, top + height


def beads(line: Box) -> list[Box]:
    """Small boxes along a line."""
    x0, y0, x1, y1 = line
    count = 1 + int(max(abs(x1 - x0), abs(y1 - y0)) / 5)
    along = [(x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count) for k in range(count + 1)]
    return [(x - 1.5, y - 1.5, x + 1.5, y + 1.5) for x, y in along]


def measure_overlap(boxes: Array, others: Array) -> Array:
    """(C,) area of the others (M, 4) that each of the boxes (C, 4) hides."""
    corner = np.maximum(boxes[:, None, :2], others[None, :, :2])
    opposite = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    sides = np.maximum(opposite - corner, 0.0)
    return np.asarray((sides[..., 0] * sides[..., 1]).sum(axis=1))
