"""Where labels go beside the points they name: for each, in order, the free place nearest to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tailstack.arrays import Array

from .tables import columns

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
    text: str  # "" for a mark without a label


def label_places(points: list[MarkedPoint], lines: list[Box], frame: Box, font: float) -> list[tuple[float, float]]:
    """Start of the baseline of each label; the point itself for those without one.

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
            HIDDEN * covered(boxes, labels) + covered(boxes, marks) + CROSSED * covered(boxes, crossed)
            + OUTSIDE * (area - covered(boxes, np.array([frame])))
            + FURTHER * (order // len(DIRECTIONS)) + 0.5 * order
        )  # fmt: skip
        best = boxes[int(np.argmin(harm))]
        labels = np.vstack([labels, best])
        places.append((float(best[0]), float(best[3]) - 0.22 * font))
    return places


def label_box(point: MarkedPoint, reach: float, way: tuple[int, int], font: float) -> Box:
    """The box of a label whose near edge is ``reach`` from its point, in one of eight directions."""
    width, height = CHARACTER * font * columns(point.text), font
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


def covered(boxes: Array, others: Array) -> Array:
    """(C,) area of the others (M, 4) that each of the boxes (C, 4) hides."""
    corner = np.maximum(boxes[:, None, :2], others[None, :, :2])
    opposite = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    sides = np.maximum(opposite - corner, 0.0)
    return np.asarray((sides[..., 0] * sides[..., 1]).sum(axis=1))
