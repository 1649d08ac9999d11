"""P95 over the values of one axis."""

from __future__ import annotations

from collections.abc import Sequence

from ..svg import FAINT, INK, MUTED, line, printable, rounded, text
from .frame import BAR, LAW_COLOUR, VALUE_COLOUR, WIDTH, Scale, picture

LEFT, RIGHT, TOP, BOTTOM = 70, WIDTH - 130, 24, 250
COLOURS = (VALUE_COLOUR, LAW_COLOUR, "#00795a", "#a8477f", BAR)

Series = tuple[str, Sequence[tuple[float, float]]]  # target, (value of the axis, P95 in mm)


def curve_svg(series: Sequence[Series], axis: str, name: str = "curve") -> str:
    """One line per target; needs at least two different values of the axis."""
    across = [x for _, points in series for x, _ in points]
    scale = Scale(min(across), max(across), LEFT, RIGHT)
    highest = 1.08 * max(y for _, points in series for _, y in points)
    upward = Scale(0.0, highest, 0.0, 1.6 * (BOTTOM - TOP))  # ticks some 50 units apart

    def up(value: float) -> float:
        return BOTTOM - (BOTTOM - TOP) * value / highest

    parts = scale.axis(BOTTOM, printable(axis, 90))
    for value in upward.ticks():
        parts.append(line(LEFT, up(value), RIGHT, up(value), "#e3e3e3", 0.7))
        parts.append(text(LEFT - 6, up(value) + 4, f"{value:g}", anchor="end", colour=MUTED))
    parts += [line(LEFT, TOP, LEFT, BOTTOM, FAINT), text(LEFT - 6, TOP - 8, "P95, mm", anchor="end", colour=MUTED)]
    taken: list[float] = []
    for k, (target, points) in enumerate(series):
        colour = COLOURS[k % len(COLOURS)]
        places = [(scale.at(x), up(y)) for x, y in points]
        path = "M" + "L".join(f"{rounded(x)} {rounded(y)}" for x, y in places)
        parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.8"/>')
        parts += [f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="3" fill="{colour}"/>' for x, y in places]
        y = places[-1][1] + 4
        while any(abs(y - other) < 13 for other in taken):
            y += 13
        taken.append(y)
        parts.append(text(RIGHT + 8, y, printable(target, 18), colour=colour if colour != BAR else INK))
    words = "; ".join(
        f"{target}: {points[0][1]:.3f} mm at {points[0][0]:g}, {points[-1][1]:.3f} mm at {points[-1][0]:g}"
        for target, points in series
    )
    return picture(name, f"P95 over {axis}", words + ".", BOTTOM + 44, parts)
