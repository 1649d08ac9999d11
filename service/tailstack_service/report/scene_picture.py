"""The scene on paper: the structure close up and the whole set-up, from the camera that the viewer begins with."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import atan2, degrees, sqrt
from typing import Any

import numpy as np

from tailstack.geometry.arrays import Array
from tailstack.results.look import FONT, INK, MUTED

from .scene import LOOKS, Item, LayoutScene, Point3, ViewDirection
from .svg import (
    LABEL_COLOUR,
    LONGEST,
    MarkedPoint,
    in_lines,
    label_lines,
    label_places,
    line,
    picture,
    printable,
    round_step,
    shape,
    text,
    trim,
)

NEAR, FAR = (8, 26.0, 436, 400), (460, 26.0, 252, 212)  # left, top, width, height of the two panels
PAD = 26
STRIP = 34  # kept at the foot of a panel for its axes and bar
ROOM = 700  # area of page for each label of a fiducial or target: with less, none of that kind is shown
AROUND = ("fiducials", "targets", "keep-out")  # with sources and detectors, what the whole set-up shows
CIRCLE = 40
COLOURS = {**LABEL_COLOUR, "keep-out": LOOKS["keep-out"]["stroke"], "old": MUTED}


@dataclass(frozen=True, slots=True, eq=False)
class FittedCamera:
    """A camera fitted to a panel: orthographic, so that one scale holds everywhere."""

    right: Array
    up: Array
    eye: Array  # towards the eye
    scale: float  # page units per mm
    offset: Array  # (2,)
    panel: tuple[float, float, float, float]
    size: float  # of marks

    def page(self, points_mm: Array) -> Array:
        """(N, 3) mm, con -> (N, 2) page."""
        flat = np.column_stack([points_mm @ self.right, -(points_mm @ self.up)])
        return np.asarray(self.offset + self.scale * flat)

    def depth(self, points_mm: Array) -> float:
        """Mean distance towards the eye, mm."""
        return float((points_mm @ self.eye).mean())


def draw_scene(scene: LayoutScene, name: str = "layout") -> str:
    """Both panels of a scene, with the layers that it shows at first.  The same scene gives the same text."""
    view = next(entry for entry in scene.cameras if entry.key == "iso")
    parts = [
        text(NEAR[0], 16, "Structure, connector frame con, mm", weight="bold"),
        text(FAR[0], 16, "Whole set-up, con, mm", weight="bold"),
    ]
    near, far = fit(view, scene.near, NEAR), fit(view, scene.far, FAR, size=0.55)
    hidden = {layer.key for layer in scene.layers if not layer.shown}
    items = [item for item in scene.items if item.layer not in hidden]
    wide = {"beams"} | (set(AROUND) - hidden)
    around = [item for item in scene.items if item.layer in wide]
    parts += _panel(near, items, f"{name}-near")
    parts += _panel(far, around, f"{name}-far")
    legend, foot = _legend(scene, [*items, *around], FAR[0] + 14, FAR[1] + FAR[3] + 20)
    parts += legend
    y = max(NEAR[1] + NEAR[3] + 18.0, foot + 10)
    notes = textwrap.wrap(scene.note, 118, break_on_hyphens=False)
    parts += [text(NEAR[0], y + 14 * k, line, colour=MUTED) for k, line in enumerate(notes)]
    return picture(name, scene.title, f"{scene.words} {scene.note}", y + 14 * len(notes) - 2, parts)


def fit(
    camera: ViewDirection, points: Sequence[Point3], panel: tuple[float, float, float, float], size: float = 1.0
) -> FittedCamera:
    """The largest scale at which all points are in the panel, with room for labels."""
    right, up = np.array(camera.right), np.array(camera.up)
    given = np.array(points)
    flat = np.column_stack([given @ right, -(given @ up)])
    low, high = flat.min(axis=0), flat.max(axis=0)
    left, top, width, height = panel
    room = np.array([width - 2 * PAD, height - 2 * PAD - STRIP])
    scale = float((room / np.maximum(high - low, 1e-3)).min())
    offset = np.array([left + PAD, top + PAD]) + (room - scale * (high - low)) / 2 - scale * low
    return FittedCamera(right, up, np.cross(right, up), scale, offset, panel, size)


def _panel(sight: FittedCamera, items: Sequence[Item], name: str) -> list[str]:
    left, top, width, height = sight.panel
    clip = f'<clipPath id="{name}-clip"><rect x="{left}" y="{top}" width="{width}" height="{height}"/></clipPath>'
    order = {"face": 0, "line": 1, "ellipsoid": 2, "arrow": 2, "mark": 2}

    def rank(item: Item) -> tuple[int, float]:
        points = np.array(item.points[:1] if item.kind == "ellipsoid" else item.points)
        return order[item.kind], -1e9 if item.layer == "floor" else sight.depth(points)

    drawn = [_draw_item(sight, item) for item in sorted(items, key=rank)]
    frame = f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#d9dee3"/>'
    return [
        clip, f'<g clip-path="url(#{name}-clip)">', *drawn, "</g>", frame,
        *_labels(sight, items), *_axes(sight),
    ]  # fmt: skip


def _draw_item(sight: FittedCamera, item: Item) -> str:
    points = np.array(item.points)
    tip = f"<title>{escape(printable(item.title, 2 * LONGEST))}</title>" if item.title else ""
    if item.kind == "mark":
        x, y = sight.page(points)[0].tolist()
        drawn, size = mark(item.look, x, y), sight.size
        if size == 1.0 or item.look == "image":
            return f"<g>{drawn}{tip}</g>"
        move = f"translate({trim((1 - size) * x)} {trim((1 - size) * y)}) scale({size:g})"
        return f'<g transform="{move}">{drawn}{tip}</g>'
    look = LOOKS[item.look]
    if item.kind == "ellipsoid":
        return f"<g>{_ellipsoid(sight, points, look)}{tip}</g>"
    page = sight.page(points)
    if item.kind == "face":
        return f'<g><path d="{_path(page)}Z" {_fill(look)} {_stroke(look)}/>{tip}</g>'
    head = _head(page, look) if item.kind == "arrow" else ""
    return f'<g><path d="{_path(page)}" fill="none" {_stroke(look)}/>{head}{tip}</g>'


def mark(look: str, x: float, y: float) -> str:
    """A mark of the scene on the page."""
    if look in ("fiducial", "new", "target", "pivot 1", "pivot 2"):
        return shape(look, x, y)  # type: ignore[arg-type]
    at = f'cx="{trim(x)}" cy="{trim(y)}"'
    if look == "old":
        return f'<circle {at} r="3.2" fill="#ffffff" stroke="#8a8a8a" stroke-width="1.2"/>'
    if look == "image":
        return f'<circle {at} r="1.1" fill="#0072b2"/>'
    return f'<circle {at} r="3.4" fill="#4b5660"/>'


def _path(page: Array) -> str:
    return "M" + "L".join(f"{trim(float(x))} {trim(float(y))}" for x, y in page)


def _stroke(look: dict[str, Any]) -> str:
    dash = f' stroke-dasharray="{" ".join(f"{d:g}" for d in look["dash"])}"' if "dash" in look else ""
    return f'stroke="{look["stroke"]}" stroke-width="{look["width"]:g}"{dash}'


def _fill(look: dict[str, Any]) -> str:
    return f'fill="{look["fill"]}" fill-opacity="{look["opacity"]:g}"'


def _head(page: Array, look: dict[str, Any]) -> str:
    """The point of an arrow; none where it is seen end on."""
    along = page[1] - page[0]
    length = float(np.hypot(*along))
    if length < 1.0:
        return ""
    size = min(3.0 + 2.4 * look["width"], 0.6 * length)
    unit = along / length
    side = np.array([-unit[1], unit[0]])
    corners = [page[1], page[1] - size * unit + 0.42 * size * side, page[1] - size * unit - 0.42 * size * side]
    points = " ".join(f"{trim(float(x))},{trim(float(y))}" for x, y in corners)
    return f'<polygon points="{points}" fill="{look["stroke"]}"/>'


def _ellipsoid(sight: FittedCamera, points: Array, look: dict[str, Any]) -> str:
    """The outline, and its three main ellipses: solid on the near side."""
    centre = sight.page(points[:1])[0]
    axes_mm = points[1:]
    flat = sight.scale * np.column_stack([axes_mm @ sight.right, -(axes_mm @ sight.up)])
    form = flat.T @ flat
    major, minor, turn = _ellipse(form)
    parts = [
        f'<ellipse cx="{trim(centre[0])}" cy="{trim(centre[1])}" rx="{trim(major)}" ry="{trim(minor)}" '
        f'transform="rotate({trim(turn)} {trim(centre[0])} {trim(centre[1])})" {_fill(look)} {_stroke(look)}/>'
    ]
    angles = np.linspace(0.0, 2 * np.pi, CIRCLE + 1)[:, None]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        ring = np.cos(angles) * axes_mm[i] + np.sin(angles) * axes_mm[j]
        towards = ring @ sight.eye
        page = centre + sight.scale * np.column_stack([ring @ sight.right, -(ring @ sight.up)])
        near = [k for k in range(CIRCLE) if towards[k] + towards[k + 1] >= 0]
        path = "".join(_path(page[k : k + 2]) for k in near)
        parts.append(f'<path d="{path}" fill="none" stroke="{look["stroke"]}" stroke-width="0.6"/>')
    return "".join(parts)


def _ellipse(form: Array) -> tuple[float, float, float]:
    """Semi-axes and turn (degrees) of ``x' form^-1 x = 1`` for a symmetric form (2, 2)."""
    a, b, c = float(form[0, 0]), float(form[0, 1]), float(form[1, 1])
    middle, swing = (a + c) / 2, sqrt(((a - c) / 2) ** 2 + b * b)
    return sqrt(max(middle + swing, 0.0)), sqrt(max(middle - swing, 0.0)), degrees(atan2(2 * b, a - c)) / 2


def _labels(sight: FittedCamera, items: Sequence[Item]) -> list[str]:
    """Names beside what they name; those of fiducials and of targets only where there is room for them."""
    left, top, width, height = sight.panel
    inside = (left + 2, top + 2, left + width - 2, top + height - 2)
    crowded = set()
    for layer in ("fiducials", "targets"):
        places = [sight.page(np.array(item.points[:1]))[0] for item in items if item.layer == layer]
        if len(places) > 1 and float(np.prod(np.ptp(np.array(places), axis=0) + 40)) < ROOM * len(places):
            crowded.add(layer)
    ends = _axis_ends(sight)
    points = [MarkedPoint(x, y - 4, "") for _, _, (x, y) in ends]  # which labels leave alone
    colours = [INK] * len(points)
    lines = [(*ends[0][1], *end) for _, end, _ in ends[1:]]
    for item in items:
        if item.look == "image" or not (item.label or item.kind == "mark" or item.look == "ray"):
            continue
        page = sight.page(np.array(item.points))
        if item.kind == "arrow" or item.look == "ray":
            lines.append((float(page[0, 0]), float(page[0, 1]), float(page[1, 0]), float(page[1, 1])))
        if item.look == "ray":
            continue
        tail = item.kind != "arrow" or item.layer == "directions"
        x, y = (page.mean(axis=0) if item.kind == "line" else page[0] if tail else page[-1]).tolist()
        if inside[0] <= x <= inside[2] and inside[1] <= y <= inside[3]:
            points.append(MarkedPoint(x, y, "" if item.layer in crowded else item.label))
            colours.append(COLOURS.get(item.look, MUTED))
    placed = zip(points, label_places(points, lines, inside, FONT), colours, strict=True)
    return [part for point, (x, y), colour in placed if point.text for part in label_lines(x, y, point.text, colour)]


def _axis_ends(sight: FittedCamera) -> list[tuple[str, tuple[float, float], tuple[float, float]]]:
    """Name, end and place of the name of each axis of con, at the foot of a panel; those seen end on have no name."""
    left, top, _, height = sight.panel
    arm = 20.0 + 10.0 * sight.size
    x, y = left + arm + 12, top + height - arm * 0.55 - 10
    ends = []
    for name, right, up, toward in zip("xyz", sight.right, sight.up, sight.eye, strict=True):
        dx, dy = arm * float(right), -arm * float(up)
        further = 1 + 9 / max(sqrt(dx * dx + dy * dy), 1.0)
        shown = name if abs(float(toward)) < 0.97 else ""
        ends.append((shown, (x + dx, y + dy), (x + further * dx, y + further * dy + 4)))
    return [("", (x, y), (x, y)), *ends]


def _axes(sight: FittedCamera) -> list[str]:
    """The directions of con and a bar in mm, at the foot of a panel."""
    left, top, width, height = sight.panel
    (_, (x, y), _), *ends = _axis_ends(sight)
    parts = [line(x, y, *end, INK, 1.2) for _, end, _ in ends]
    parts += [text(*at, name, anchor="middle") for name, _, at in ends if name]
    length = round_step(0.32 * width / sight.scale)
    end, foot = left + width - 12, top + height - 12
    begin = end - length * sight.scale
    parts += [line(begin, foot, end, foot, INK, 1.6)]
    parts += [line(at, foot - 4, at, foot + 4, INK) for at in (begin, end)]
    parts.append(text((begin + end) / 2, foot - 7, f"{length:g} mm", anchor="middle"))
    return parts


# --- legend ---------------------------------------------------------------------------------------

_WORDS = {
    "fiducial": "fiducial", "new": "new fiducial", "old": "fiducial, {before}", "target": "target",
    "source": "X-ray source", "image": "image of a fiducial",
    "pivot 1": "{name}", "pivot 2": "{name}",
    "tcp": "error at the tool", "tcp-before": "error at the tool, {before}", "bias": "bias",
    "bias-before": "bias, {before}", "localisation": "error as located", "keep-out": "keep-out zone",
    "region": "target region", "locator": "locator", "beam": "beam", "moved": "moved",
    "worthy": "where fiducials tell most",
}  # fmt: skip


MAGNIFIED = ("tcp", "tcp-before", "bias", "bias-before", "localisation")


def _legend(scene: LayoutScene, items: Sequence[Item], x: float, y: float) -> tuple[list[str], float]:
    """What the marks mean, one below the other, and where they end."""
    used = {item.look: item.title.rsplit(": ", 1)[0] for item in items}
    parts = []
    for look, words in _WORDS.items():
        if look not in used:
            continue
        caption = words.format(before=printable(scene.before, 12), name=used[look])
        if look in MAGNIFIED:
            caption += ", to scale" if scene.magnification == 1 else f", × {scene.magnification:g}"
        parts.append(_sample(look, x, y - 4) if look in LOOKS else mark(look, x, y - 4))
        lines = in_lines(caption, 34)
        parts += label_lines(x + 16, y, lines, INK)
        y += 16 + FONT * lines.count("\n")
    return parts, y


def _sample(look: str, x: float, y: float) -> str:
    style = LOOKS[look]
    if "fill" in style:
        return f'<ellipse cx="{trim(x)}" cy="{trim(y)}" rx="8" ry="5" {_fill(style)} {_stroke(style)}/>'
    ends = np.array([[x - 8, y], [x + 8, y]])
    head = _head(ends, style) if look in ("bias", "bias-before", "locator", "beam") else ""
    return f'<path d="{_path(ends)}" fill="none" {_stroke(style)}/>{head}'
