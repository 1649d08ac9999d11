"""Pictures of the layout study that are not line charts: layouts in their box, and what placement is worth."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10, sqrt
from typing import Any

import numpy as np
from line_charts import WIDTH, begin, mark
from numpy.typing import NDArray
from study_scenes import TARGET_MM, Costs, Layouts

from tailstack.geometry.arrays import Array
from tailstack.results.look import BLUE, FAINT, INK, MUTED, VERMILION
from tailstack_service.report.scene import RIGHT, UP
from tailstack_service.report.svg import box, line, text, trim

ON = 1.0  # mm: that near a face is on it
NEAR, FAR, ELSEWHERE = "face towards the target", "far face", "elsewhere"
LOOK = {NEAR: ("circle", BLUE), FAR: ("square", VERMILION), ELSEWHERE: ("diamond", INK)}


def by_place(layout_mm: Array, box_mm: Any) -> dict[str, NDArray[np.bool_]]:
    """Which fiducials are on the face towards the target (largest z), on the far face, and elsewhere."""
    z, (low, high) = layout_mm[:, 2], box_mm
    near, far = z > high[2] - ON, z < low[2] + ON
    return {NEAR: near, FAR: far, ELSEWHERE: ~near & ~far}


def split(layout_mm: Array, box_mm: Any) -> str:
    """Counts as the table has them."""
    return ", ".join(str(int(which.sum())) for which in by_place(layout_mm, box_mm).values())


def gallery(found: dict[int, Layouts], box_mm: Any) -> str:
    """A row for each count: from the target, obliquely, and the distinct optima."""
    height = 60 + 322 * len(found) + 20
    parts = begin(
        "Optimal layouts in a 100 mm box, smallest P95 at 0.05°",
        "For 8 and 12 fiducials: the layout seen from the target, the layout obliquely with the target above the box, "
        "and a scatter of the distinct optima that 32 starts reached, P95 above the best over distance from the best.",
        height,
    )
    for row, (count, item) in enumerate(found.items()):
        top = 60 + 322 * row
        parts += _from_target(16, top, count, item, box_mm)
        parts += _obliquely(292, top, item, box_mm)
        parts += _optima(610, top, item)
    y, x = height - 14.0, 26.0
    for name, (shape, colour) in LOOK.items():
        parts += [mark(shape, x, y - 4, colour), text(x + 11, y, name, size=13)]  # type: ignore[arg-type]
        x += 40 + 7 * len(name)
    parts += [_cross(x, y - 4), text(x + 11, y, "target, 60 mm above the near face", size=13)]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _cross(x: float, y: float) -> str:
    return line(x - 5, y - 5, x + 5, y + 5, "#a84600", 2) + line(x - 5, y + 5, x + 5, y - 5, "#a84600", 2)


def _marks(layout_mm: Array, box_mm: Any, at: Any, grow: dict[str, float]) -> list[str]:
    parts = []
    for name in (FAR, ELSEWHERE, NEAR):
        shape, colour = LOOK[name]
        for point in layout_mm[by_place(layout_mm, box_mm)[name]]:
            x, y = at(point)
            parts.append(mark(shape, x, y, colour, grow[name]))  # type: ignore[arg-type]
    return parts


def _from_target(left: float, top: float, count: int, item: Layouts, box_mm: Any) -> list[str]:
    """x to the right, y up, looking along -z; far marks are larger, so that near ones do not hide them."""
    (low, high), side = box_mm, 220.0
    scale, x0, y0 = side / (high[0] - low[0]), left + 22, top + 28

    def at(point: Array) -> tuple[float, float]:
        return x0 + (point[0] - low[0]) * scale, y0 + side - (point[1] - low[1]) * scale

    return [
        text(left, top + 8, f"{count} fiducials: P95 {item.best_mm:.3f} mm", size=13, weight="bold"),
        box(x0, y0, x0 + side, y0 + side, f'fill="#f6f6f6" stroke="{FAINT}"'),
        *_marks(item.layout_mm, box_mm, at, {NEAR: 5, FAR: 8.5, ELSEWHERE: 6}),
        _cross(*at(np.array(TARGET_MM))),
        text(x0, y0 + side + 26, "seen from the target: x right, y up", size=12, colour=MUTED),
    ]


def _obliquely(left: float, top: float, item: Layouts, box_mm: Any) -> list[str]:
    """Orthographic, with the edges of the box."""
    low, high = np.array(box_mm)
    scale, middle, bottom = 1.33, left + 140, top + 262.0
    centre = (low + high) / 2

    def at(point: Array) -> tuple[float, float]:
        return middle + float(RIGHT @ (point - centre)) * scale, bottom - 88 - float(UP @ (point - centre)) * scale

    parts = []
    for axis in range(3):
        for k in range(4):
            ends = np.array([low, low])
            others = [a for a in range(3) if a != axis]
            for bit, other in enumerate(others):
                ends[:, other] = (low, high)[k >> bit & 1][other]
            ends[1, axis] = high[axis]
            parts.append(line(*at(ends[0]), *at(ends[1]), FAINT, 0.9))
    near = np.array([0.0, 0.0, high[2]])
    parts.append(line(*at(np.array(TARGET_MM)), *at(near), FAINT, 0.9, "2 3"))
    parts += _marks(item.layout_mm, box_mm, at, {NEAR: 5, FAR: 5, ELSEWHERE: 5})
    parts += [_cross(*at(np.array(TARGET_MM)))]
    origin = (left + 8.0, bottom - 2)
    for name, direction in zip("xyz", np.eye(3), strict=True):
        across, down = 26 * float(RIGHT @ direction), -26 * float(UP @ direction)
        parts.append(line(*origin, origin[0] + across, origin[1] + down, INK, 1.2))
        parts.append(text(origin[0] + 1.4 * across, origin[1] + 1.4 * down + 4, name, anchor="middle", size=12))
    return parts


def _optima(left: float, top: float, item: Layouts) -> list[str]:
    """P95 above the best (%) over distance from the best layout (mm); the area of a circle: starts that ended there."""
    x0, y0, width, height = left + 42, top + 28, 220.0, 220.0
    inset, most_x, most_y = 14.0, 80.0, 1.5
    parts = [text(left, top + 8, "distinct optima of 32 starts", size=13, weight="bold")]

    def at(distance_mm: float, percent: float) -> tuple[float, float]:
        across, down = (width - inset) * distance_mm / most_x, (height - inset) * (1 - percent / most_y)
        return x0 + inset + across, y0 + down

    for value in (0, 0.5, 1, 1.5):
        _, y = at(0, value)
        parts.append(line(x0, y, x0 + width, y, "#dcdcdc", 0.8))
        parts.append(text(x0 - 7, y + 4.5, f"{value:g}", anchor="end", size=12, colour=MUTED))
    for value in (0, 20, 40, 60, 80):
        x, _ = at(value, 0)
        parts.append(text(x, y0 + height + 17, f"{value}", anchor="middle", size=12, colour=MUTED))
    parts.append(line(x0, y0 + height, x0 + width, y0 + height, INK))
    best = item.optima[0].objective
    for optimum in item.optima:
        x, y = at(optimum.rms_distance_mm, 100 * (optimum.objective / best - 1))
        parts.append(
            f'<circle cx="{trim(x)}" cy="{trim(y)}" r="{trim(3.4 * sqrt(optimum.starts))}" fill="{BLUE}" '
            'fill-opacity="0.45" stroke="#0072b2"/>'
        )
    parts.append(text(x0 + width / 2, y0 + height + 36, "distance from the best, mm rms", anchor="middle", size=12))
    upright = text(0, 0, "P95 above the best, %", anchor="middle", size=12)
    parts.append(f'<g transform="translate({trim(left + 6)} {trim(y0 + height / 2)}) rotate(-90)">{upright}</g>')
    return parts


def worth_chart(rows: Sequence[tuple[str, Costs]], careless: int) -> str:
    """For each problem the cost above the optimum, in per cent: textbook, median and worst of the careless."""
    top, step, left, right = 74, 50, 190.0, WIDTH - 196.0
    low, high = 0.1, 1000.0
    height = top + step * len(rows) + 76
    parts = begin(
        "What the optimal placement is worth, half-widths optimised alike",
        "A row for each problem, cost above the optimum in per cent on a logarithmic axis: vermilion squares for the "
        "corners (and edges) of the box, grey diamonds for the median and worst of the random layouts that can meet "
        "the limit; at the right how many of 30 cannot. Numbers are in the table beside the figure.",
        height,
    )

    def x(percent: float) -> float:
        return left + (right - left) * log10(max(percent, low) / low) / log10(high / low)

    bottom = top + step * len(rows)
    for value in (0.1, 1, 10, 100, 1000):
        parts.append(line(x(value), top - 16, x(value), bottom, "#dcdcdc", 0.8))
        parts.append(text(x(value), bottom + 18, f"{value:g} %", anchor="middle", size=13, colour=MUTED))
    parts.append(
        text((left + right) / 2, bottom + 40, "cost above the optimum (logarithmic)", anchor="middle", size=13)
    )
    parts.append(text(right + 14, top - 22, "careless layouts that", size=12, colour=MUTED))
    parts.append(text(right + 14, top - 8, "cannot meet the limit", size=12, colour=MUTED))
    for k, (name, costs) in enumerate(rows):
        y = top + step * (k + 0.5)
        assert costs.best is not None
        parts.append(text(16, y + 4.5, name, size=13))
        parts.append(text(right + 14, y + 4.5, f"{costs.careless_infeasible} of {careless}", size=13))
        if costs.careless_median is not None and costs.careless_worst is not None:
            middle, worst = (100 * (v / costs.best - 1) for v in (costs.careless_median, costs.careless_worst))
            parts.append(line(x(middle), y, x(worst), y, FAINT, 1.4))
            parts.append(mark("diamond", x(middle), y, MUTED, 5))
            if worst > middle:
                parts.append(line(x(worst), y - 6, x(worst), y + 6, FAINT, 1.8))
            parts.append(
                text(
                    x(middle),
                    y - 10,
                    f"{middle:.0f} %" if middle > 10 else f"{middle:.1f} %",
                    anchor="middle",
                    size=12,
                    colour=MUTED,
                )
            )
        if costs.textbook is not None:
            above = 100 * (costs.textbook / costs.best - 1)
            parts.append(mark("square", x(above), y, VERMILION, 5))
            star = "*" if costs.textbook_breaks_rule else ""
            parts.append(text(x(above), y - 10, f"{above:.1f} %{star}", anchor="middle", size=12, colour="#a84600"))
    y = height - 12.0
    parts += [
        mark("square", 26, y - 4, VERMILION, 5),
        text(38, y, "corners, then edges of the box (* breaks a rule)", size=13),
        mark("diamond", 352, y - 4, MUTED, 5),
        text(364, y, "median of the careless layouts that can; bar: the worst", size=13),
    ]
    return "\n".join([*parts, "</svg>"]) + "\n"
