"""Two elevations of the beads with ordinate dimensions from the datum, beads numbered as in the table beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import isotonic_regression

from tailstack.geometry.arrays import Array
from tailstack.results.look import BLUE, FAINT, INK, MUTED

from .svg import WIDTH, Kind, MarkedPoint, label_places, line, picture, shape, text, trim

VIEWS = (("Front", 0), ("Side", 1))  # each with z up: what it is called, and which axis runs across
HALF = WIDTH / 2  # of the page, for one view
LEFT, RIGHT, TOP, BOTTOM = 84.0, 16.0, 40.0, 78.0  # about what is drawn: room for numbers and the name of the view
HIGH = 320.0  # at most, of what is drawn
GAP, NEAR = 12.0, 26.0  # between two numbers; from what is drawn to the foot of the leaders
LEAST = 2.5  # radius of a bead, so that it is seen
PIVOTS: tuple[Kind, ...] = ("pivot 1", "pivot 2")


def draw_dimensions(
    beads_mm: Array, pivots: Sequence[tuple[float, float, float]], diameter_mm: float | None, title: str, name: str
) -> str:
    """SVG.  beads_mm: (N, 3) in con; pivots: of the seats, mm, at most two; name: kebab-case, unique on the page."""
    shown = np.vstack([np.zeros(3), beads_mm, *([list(pivots)] if pivots else [])])
    low, high = shown.min(axis=0), shown.max(axis=0)
    spans = np.maximum(high - low, 1e-3)
    scale = min((HALF - LEFT - RIGHT) / spans[:2].max(), HIGH / spans[2])
    height = TOP + scale * spans[2] + BOTTOM
    parts: list[str] = []
    for k, (view, axis) in enumerate(VIEWS):
        left = k * HALF + LEFT + (HALF - LEFT - RIGHT - scale * spans[axis]) / 2
        parts += _elevation(view, axis, beads_mm, pivots, diameter_mm, (left, TOP), scale, low, high)
    words = f"{len(beads_mm)} beads from the front and from the side, dimensioned in mm from the origin of con"
    return picture(name, title, words, height, parts)


def _elevation(
    view: str, axis: int, beads_mm: Array, pivots: Sequence[tuple[float, float, float]], diameter_mm: float | None,
    corner: tuple[float, float], scale: float, low: Array, high: Array,
) -> list[str]:  # fmt: skip
    """One view; ``corner``: where the least coordinate across and the greatest up stand on the page."""

    def place(point: Array | tuple[float, float, float]) -> tuple[float, float]:
        return corner[0] + scale * (point[axis] - low[axis]), corner[1] + scale * (high[2] - point[2])

    right, foot = corner[0] + scale * (high[axis] - low[axis]), corner[1] + scale * (high[2] - low[2])
    x0, y0 = place((0.0, 0.0, 0.0))
    parts = [
        text((corner[0] + right) / 2, 14, f"{view}: {'xy'[axis]} across, z up", anchor="middle", weight="bold"),
        line(x0, corner[1] - 10, x0, foot + NEAR, MUTED, 0.8, "10 3 2 3"),
        line(corner[0] - NEAR, y0, right + 10, y0, MUTED, 0.8, "10 3 2 3"),
        f'<circle cx="{trim(x0)}" cy="{trim(y0)}" r="5" fill="none" stroke="{INK}"/>',
    ]
    measured = np.round(np.vstack([np.zeros(3), beads_mm, *([list(pivots)] if pivots else [])]), 2)
    across, up = measured[:, axis], measured[:, 2]
    for value, at, aside in _ordinates(across, corner[0] - scale * low[axis], scale, HALF - LEFT):
        begin, end = foot + NEAR, foot + NEAR + 12
        lowest = corner[1] + scale * (high[2] - up[across == value].min())
        parts += [line(at, lowest, at, begin, FAINT, 0.5), line(at, begin, aside, end, FAINT, 0.5)]
        parts.append(_vertical_number(aside, end + 3, value))
    for value, at, aside in _ordinates(up, corner[1] + scale * high[2], -scale, foot - corner[1] + TOP):
        begin, end = corner[0] - NEAR, corner[0] - NEAR - 12
        leftmost = corner[0] + scale * (across[up == value].min() - low[axis])
        parts += [line(leftmost, at, begin, at, FAINT, 0.5), line(begin, at, end, aside, FAINT, 0.5)]
        parts.append(text(end - 3, aside + 4, _number(value), anchor="end", size=10))
    heaps: dict[tuple[float, float], list[str]] = {}
    for number, point in enumerate(beads_mm, 1):
        heaps.setdefault(tuple(round(c, 1) for c in place(point)), []).append(str(number))  # type: ignore[arg-type]
    radius = max(LEAST, scale * (diameter_mm or 0.0) / 2)
    parts += [f'<circle cx="{x}" cy="{y}" r="{trim(radius)}" fill="#ffffff" stroke="{BLUE}"/>' for x, y in heaps]
    parts += [shape(kind, *place(pivot)) for kind, pivot in zip(PIVOTS, pivots, strict=False)]
    marked = [MarkedPoint(x, y, ", ".join(numbers)) for (x, y), numbers in heaps.items()]
    frame = (corner[0] - 8, corner[1] - 12, right + 12, foot + 12)
    starts = label_places(marked, [], frame, 10)
    return parts + [text(x, y, each.text, size=10, colour=BLUE) for (x, y), each in zip(starts, marked, strict=True)]


def _ordinates(values: Array, zero: float, scale: float, room: float) -> list[tuple[float, float, float]]:
    """Each value once, its place on the page, and that of its number: as near as the others leave room.

    Where they are more than the room holds, the outermost and the datum alone.
    """
    distinct = np.unique(values + 0.0)
    if len(distinct) * GAP > room:
        distinct = np.unique([distinct[0], 0.0, distinct[-1]])
    at = zero + scale * distinct
    steps = np.sign(scale) * GAP * np.arange(len(at))
    apart = isotonic_regression(at - steps, increasing=scale > 0).x + steps
    return [(float(v), float(a), float(s)) for v, a, s in zip(distinct, at, apart, strict=True)]


def _number(value: float) -> str:
    return f"{value + 0.0:g}".replace("-", "−")


def _vertical_number(x: float, y: float, value: float) -> str:
    """A number below its leader, read from the right."""
    return (
        f'<text x="{trim(x + 3)}" y="{trim(y)}" font-size="10" text-anchor="end" '
        f'transform="rotate(-90 {trim(x + 3)} {trim(y)})">{_number(value)}</text>'
    )
