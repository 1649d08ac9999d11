"""Draw docs/images/overview.svg, what tailstack is about: no arguments, or ``--check``.

A sketch, not to scale, on a page of its own colour so that it reads on light and dark ones.  Everything stands in the
connector frame: z along the tool towards the patient, y up to the detector of the first shot, x towards the reader.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from html import escape
from math import cos, radians, sin
from pathlib import Path

from pictures import write_picture

WIDTH, HEIGHT = 960, 600
INK, MUTED, PAPER = "#1b1f24", "#57606a", "#ffffff"
BEAM, SECOND, METAL, SEAT, TARGET = "#2b6cb0", "#7b5ea7", "#8a929b", "#c05621", "#c0392b"
FACE, SIDE, TOP = "#dfe5ec", "#b9c3cf", "#eef2f6"  # of solid parts
ORIGIN = (545.0, 285.0)  # where the connector frame's origin stands on the page
Point = tuple[float, float, float]  # x, y, z


def place(point: Point) -> tuple[float, float]:
    """A point on the page, seen from the front, a little from above and from the left."""
    x, y, z = point
    return ORIGIN[0] - 1.5 * z - 0.5 * x, ORIGIN[1] - 1.3 * y + 0.38 * x


def path(points: Sequence[Point], fill: str = "none", stroke: str = INK, width: float = 1.4, extra: str = "") -> str:
    """A polygon, or with no fill an open line."""
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(place, points)) + ("" if fill == "none" else "Z")
    return f'<path d="{d}" fill="{fill}" stroke="{stroke}" stroke-width="{width}" stroke-linejoin="round" {extra}/>'


def words(
    x: float, y: float, text: str, size: int = 15, colour: str = INK, anchor: str = "start", bold: bool = False
) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}" text-anchor="{anchor}"{weight}>'
        f"{escape(text)}</text>"
    )


def block(low: Point, high: Point, fills: Sequence[str] = (TOP, SIDE, FACE), extra: str = "") -> list[str]:
    """A box with its three faces that can be seen: top, end, front."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return [
        path([(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)], fills[0], extra=extra),
        path([(x1, y0, z1), (x1, y1, z1), (x0, y1, z1), (x0, y0, z1)], fills[1], extra=extra),
        path([(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)], fills[2], extra=extra),
    ]


def tube(radius: float, z0: float, z1: float, fill: str, steps: int = 40) -> list[str]:
    """A cylinder about the z axis, with the end that can be seen."""
    ring = [(radius * cos(radians(k * 360 / steps)), radius * sin(radians(k * 360 / steps))) for k in range(steps)]
    ends = [[(x, y, z) for x, y in ring] for z in (z0, z1)]
    outline = hull([place(point) for end in ends for point in end])
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in outline) + "Z"
    return [f'<path d="{d}" fill="{fill}" stroke="{INK}" stroke-width="1.4"/>', path(ends[1], TOP)]


def hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The convex outline of points on the page."""
    ordered = sorted(set(points))
    halves: list[list[tuple[float, float]]] = []
    for run in (ordered, ordered[::-1]):
        half: list[tuple[float, float]] = []
        for x, y in run:
            while len(half) > 1 and (half[-1][0] - half[-2][0]) * (y - half[-2][1]) <= (half[-1][1] - half[-2][1]) * (
                x - half[-2][0]
            ):
                half.pop()
            half.append((x, y))
        halves.append(half[:-1])
    return halves[0] + halves[1]


def shot(source: Point, corners: Sequence[Point], colour: str) -> list[str]:
    """A detector, the beam that reaches it, and the source."""
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in hull([place(p) for p in (source, *corners)])) + "Z"
    x, y = place(source)
    return [
        f'<path d="{d}" fill="{colour}" fill-opacity="0.08" stroke="{colour}" stroke-opacity="0.5" stroke-width="1"/>',
        path(corners, colour, colour, 1.4, 'fill-opacity="0.22"'),
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="9" fill="{colour}"/>',
    ]


def leader(x: float, y: float, to: Point, colour: str = MUTED) -> str:
    """A thin line from a label to what it names."""
    u, v = place(to)
    return (
        f'<path d="M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" stroke="{colour}" stroke-width="1" fill="none"/>'
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="2.2" fill="{colour}"/>'
    )


BEADS = [
    (-24, -24, 14), (24, -20, -2), (-20, 24, 4), (22, 22, -6), (-22, -22, 44),
    (24, -24, 40), (-24, 20, 46), (22, 26, 42), (2, 0, 20),
]  # fmt: skip
TIP: Point = (0, 0, 116)
TARGET_AT: Point = (0, -7, 123)
STEPS = (
    "Two shots show the beads of the structure, and so tell",
    "where each of them was taken from.",
    "The target is found from its two images.",
    "The robot sends the tool there, over two seats that are",
    "never quite where the drawing has them.",
)
TITLE = "A robot's reference structure between two X-ray shots, from the C-arm to the tip of the tool"
FONT = "Helvetica, Arial, DejaVu Sans, sans-serif"
QUESTION = "How far from the target does the tip end up?"


def mark(point: Point) -> str:
    """A bead."""
    x, y = place(point)
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5.5" fill="{INK}" stroke="{PAPER}"/>'


def draw_carm() -> list[str]:
    """The arc with detector, beam and source of both shots; for the second it is turned by a right angle."""
    arc = [(0.0, 172 * cos(radians(a)), 75 + 118 * sin(radians(a))) for a in range(0, 181, 4)]
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(place, arc))
    first = [(x, 160.0, z) for x, z in ((-70, 0), (70, 0), (70, 150), (-70, 150))]
    second = [(-205.0, y, z) for y, z in ((-72, 8), (-72, 146), (72, 146), (72, 8))]
    return [
        *shot((270, 0, 75), second, SECOND),
        f'<path d="{d}" fill="none" stroke="{METAL}" stroke-width="14" stroke-linecap="round"/>',
        f'<path d="{d}" fill="none" stroke="{TOP}" stroke-width="11" stroke-linecap="round"/>',
        *shot((0, -164, 75), first, BEAM),
    ]


def draw_chain() -> list[str]:
    """Arm, flange, connector, structure with its beads, and tool, from the robot on; the seats in their colour."""
    corners = [(x, y, z) for x in (-32.0, 32.0) for y in (-32.0, 32.0) for z in (-12.0, 54.0)]
    d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in hull([place(corner) for corner in corners])) + "Z"
    hidden: list[tuple[Point, Point]] = [
        ((-32, -32, -12), end) for end in ((32, -32, -12), (-32, 32, -12), (-32, -32, 54))
    ]
    parts = [
        f'<path d="{d}" fill="{TOP}" fill-opacity="0.85"/>',
        *(path(edge, stroke=METAL, width=1, extra='stroke-dasharray="3 3"') for edge in hidden),
        *(mark(bead) for bead in BEADS),
        *tube(28, -200, -92, SIDE),
        *tube(40, -92, -72, FACE),
        *block((-29, -29, -72), (29, 29, -65), (SEAT,) * 3),
        *block((-26, -26, -65), (26, 26, -20)),
        *block((-29, -29, -20), (29, 29, -12), (SEAT,) * 3),
        *block((-32, -32, -12), (32, 32, 54), extra='fill-opacity="0.25"'),
    ]
    parts += tube(5, 54, TIP[2], SIDE)
    x, y = place(TARGET_AT)
    parts.append(f'<path d="M{x - 9:.1f} {y:.1f}h18M{x:.1f} {y - 9:.1f}v18" stroke="{TARGET}" stroke-width="3"/>')
    return parts


def draw_labels() -> list[str]:
    """Names with thin lines to what they name, and the question below."""
    parts = [
        words(28, 40, "C-arm, first shot", 16, BEAM, bold=True),
        words(28, 62, "detector", colour=BEAM), leader(102, 58, (20, 160, 140), BEAM),
        words(28, 553, "X-ray source", colour=BEAM), leader(134, 548, (2, -163, 80), BEAM),
        words(28, 458, "second shot,", 16, SECOND, bold=True), leader(120, 440, (266, 0, 79), SECOND),
        words(28, 479, "from the side", 16, SECOND, bold=True),
        words(28, 172, "tool, with its tip", bold=True), leader(172, 172, (0, 5, 84)),
        words(28, 240, "target", 15, TARGET, bold=True), leader(92, 238, TARGET_AT, TARGET),
        words(28, 261, "in the patient"),
        words(672, 42, "reference structure", bold=True), leader(666, 38, (-20, 32, 20)),
        words(672, 64, "with beads that show in the image"), leader(666, 60, BEADS[7]),
        words(716, 118, "connector", bold=True), leader(710, 114, (0, 26, -42)),
        words(806, 164, "flange", bold=True), leader(824, 172, (-14, 38, -80)),
        words(930, 232, "robot arm", anchor="end"),
        words(622, 376, "T_err2", 16, SEAT, bold=True), leader(640, 358, (29, -20, -68), SEAT),
        words(684, 376, "how the connector sits on the flange", 14, SEAT),
        words(530, 408, "T_err1", 16, SEAT, bold=True), leader(552, 390, (29, -20, -16), SEAT),
        words(592, 408, "how the structure sits on the connector", 14, SEAT),
    ]  # fmt: skip
    for number, text in enumerate(STEPS):
        parts.append(words(500, 458 + 21 * number, text, 15, MUTED))
    parts.append(words(500, 458 + 21 * len(STEPS) + 10, QUESTION, 17, INK, bold=True))
    return parts


def draw() -> str:
    """The whole picture."""
    x, y = place((0, -6, 140))
    parts = [
        f"<title>{escape(TITLE)}</title>",
        f"<desc>{escape(' '.join((*STEPS, QUESTION)))}</desc>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" fill="{PAPER}"/>',
        f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="56" ry="44" fill="#f6e7d8" stroke="{METAL}" stroke-dasharray="4 3"/>',
        *draw_carm(),
        *draw_chain(),
        *draw_labels(),
    ]
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" role="img" font-family="{FONT}" fill="none"'
    return "\n".join((f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', *parts, "</svg>\n"))


if __name__ == "__main__":
    sys.exit(write_picture(Path(__file__).with_name("overview.svg"), draw()))
