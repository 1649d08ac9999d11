"""Places on the page: two rows of three panels, each a plane (u right, v down; px or mm) fitted into a square."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10

import numpy as np

from tailstack.arrays import Array

MARGIN, CELL, PLOT = 15, 390, 340  # outer margin; width of a column; side of the square that a panel is drawn in
INDENT, ROW_TOP, ROW_HEIGHT = 42, 52, 418  # room for tick labels; first row; from row to row
SMALL_PART = 0.45  # of an image: layouts that take less of it are enlarged


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A picture plane (u right, v down; px or mm) fitted into a square of the page."""

    left: float
    top: float
    low: Array  # (2,) corner of what is shown
    high: Array  # (2,)
    scale: float  # page units per px or mm
    offset: Array  # (2,)

    def page(self, plane: Array) -> tuple[float, float]:
        """Where a point (2,) of the plane is on the page."""
        x, y = self.offset + self.scale * plane
        return float(x), float(y)


def fitted(low: Array, high: Array, column: int, row: int, height: float) -> Panel:
    """The panel that shows what lies between two corners (2,), in its place on the page."""
    left, top = MARGIN + column * CELL + INDENT, ROW_TOP + row * ROW_HEIGHT + 30
    room = np.array([PLOT, height])
    scale = float((room / (high - low)).min())
    offset = np.array([left, top]) + (room - scale * (high - low)) / 2 - scale * low
    return Panel(left, top, low, high, scale, offset)


def around(points: Array) -> tuple[Array, Array]:
    """Corners around points (M, 2), with some room."""
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.07 * max(float((high - low).max()), 1e-3)
    return low - pad, high + pad


def image_corners(points: Array, border: Array | None) -> tuple[Array, Array]:
    """What is shown of an image: all of it, and all points (M, 2); a square when they lie in a small part of it."""
    low, high = around(points)
    if border is not None and not bool((points >= border[0]).all() and (points <= border[1]).all()):
        return np.minimum(low, border[0]), np.maximum(high, border[1])
    side = float((high - low).max())
    if border is not None and side > SMALL_PART * float((border[1] - border[0]).max()):
        return border[0], border[1]
    centre = (low + high) / 2
    low, high = centre - side / 2, centre + side / 2
    return (low, high) if border is None else (np.maximum(low, border[0]), np.minimum(high, border[1]))


def round_step(about: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``about``."""
    power = 10.0 ** floor(log10(about))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= about * (1 + 1e-9))
