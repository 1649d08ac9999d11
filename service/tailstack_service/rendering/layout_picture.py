"""Two layouts as one SVG: the detector images of two views and an oblique view of con, before above after.

Pure text from compiled systems.  Positions are nominal (con, mm; px on the detector): no bias, no tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from html import escape
from math import ceil, cos, floor, radians, sin
from typing import Literal

import numpy as np

from tailstack.arrays import Array
from tailstack.geometry.camera import depths
from tailstack.system import Mount, System, View

from ..report.svg import (
    FAINT,
    FONT,
    INK,
    LABEL_COLOUR,
    MUTED,
    PALE,
    Kind,
    MarkedPoint,
    box,
    label_places,
    line,
    printable,
    rounded,
    shape,
    text,
)
from .panels import MARGIN, PLOT, ROW_HEIGHT, ROW_TOP, Panel, around, fitted, image_corners, round_step

WIDTH, HEIGHT = 1200, 932
STRIP = 14  # kept from the oblique view for its axes and scale bar
TICKS = 45  # least distance of ticks
MOST_LABELS = {"image": 60, "oblique": 30}  # of a kind; more would hide the marks.  The tooltips have all names
AZIMUTH, ELEVATION = radians(-62), radians(20)  # of the eye that sees the oblique view
RIGHT = np.array([-sin(AZIMUTH), cos(AZIMUTH), 0.0])
UP = np.array([-sin(ELEVATION) * cos(AZIMUTH), -sin(ELEVATION) * sin(AZIMUTH), cos(ELEVATION)])


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """One thing to draw, in con."""

    kind: Kind
    name: str
    label: str  # "" where its neighbours carry the name (samples of one region)
    position_mm: Array  # (3,)
    was_mm: Array | None = None  # (3,) where it was, if it moved


def layout_svg(before: System, after: System, title: str) -> str:
    """One SVG (text), 1200 units wide: first two views and the con frame of ``before``, below them of ``after``.

    A fiducial is the same one when it has the same label; what moved has a line from where it was, what is new is
    hollow.  Both rows of a column have one scale.  The same input gives the same text.
    """
    change = change_in_words(before, after)
    rows = [(before, marks_of(before, None)), (after, marks_of(after, before))]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-labelledby="layout-title layout-desc" '
        f'font-family="Helvetica, Arial, DejaVu Sans, sans-serif" font-size="{FONT}" fill="{INK}">',
        f'<title id="layout-title">{escape(printable(title, 120))}</title>',
        f'<desc id="layout-desc">{escape(description(before, after, change))}</desc>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        text(MARGIN, 26, printable(title, 110), size=17, weight="bold"),
    ]
    for row, heading in enumerate((f"Before: {len(before.fiducials_mm)} fiducials", f"After: {change}")):
        parts.append(text(MARGIN, ROW_TOP + row * ROW_HEIGHT, heading, size=14, weight="bold"))
    for column in range(2):
        parts += _image_column(column, [(system.views[column], marks) for system, marks in rows])
    parts += _oblique_column([marks for _, marks in rows])
    return "\n".join([*parts, *_legend(after), "</svg>"]) + "\n"


def marks_of(system: System, before: System | None) -> list[Mark]:
    """What is drawn of a system; with ``before``, what is new and what moved is told from what is as it was."""
    old: dict[str, Array] = {}
    if before is not None:
        old = dict(zip(before.fiducial_labels, before.fiducials_mm, strict=True))
    marks = []
    for name, position in zip(system.fiducial_labels, system.fiducials_mm, strict=True):
        kind: Kind = "new" if before is not None and name not in old else "fiducial"
        marks.append(Mark(kind, name, name, position, _moved_from(old.get(name), position)))
    regions = set()
    for target in system.targets:
        label = target.name if target.region is None else "" if target.region in regions else target.region
        regions.add(target.region)
        marks.append(Mark("target", target.name, label, target.position_mm))
    kinds: tuple[Kind, Kind] = ("pivot 1", "pivot 2")
    for pivot, mount, previous in zip(kinds, _mounts(system), _mounts(before or system), strict=True):
        if turns(mount):
            was = _moved_from(previous.pivot_mm, mount.pivot_mm)
            marks.append(Mark(pivot, f"{pivot}, {mount.title}", pivot, mount.pivot_mm, was))
    return marks


def _mounts(system: System) -> tuple[Mount, Mount]:
    return system.structure_connector, system.connector_flange


def _moved_from(was: Array | None, now: Array) -> Array | None:
    return None if was is None or np.allclose(was, now, rtol=0, atol=1e-6) else was


def turns(mount: Mount) -> bool:
    """Whether the seat has an error at all: the pivot of a perfect one means nothing."""
    return mount.sources.count > 0 or bool(np.any(mount.bias))


def change_in_words(before: System, after: System) -> str:
    """How many fiducials there are now, and what became of them."""
    marks = [mark for mark in marks_of(after, before) if mark.kind in ("fiducial", "new")]
    counts = {
        "moved": sum(mark.was_mm is not None for mark in marks),
        "new": sum(mark.kind == "new" for mark in marks),
        "left out": len(set(before.fiducial_labels) - set(after.fiducial_labels)),
    }
    changes = [f"{count} {what}" for what, count in counts.items() if count] or ["none moved"]
    return f"{len(marks)} fiducials, " + ", ".join(changes)


def description(before: System, after: System, change: str) -> str:
    """The picture in words, for those who do not see it."""
    views = " and ".join(printable(view.name, 40) for view in after.views[:2])
    targets = ", ".join(printable(target.name, 30) for target in after.targets[:5])
    return (
        f"Above, the layout before: {len(before.fiducials_mm)} fiducials; below, after: {change}. Left and middle, "
        f"the detector images of {views} in px, u to the right, v down; right, the connector frame con in mm from an "
        f"oblique direction. Targets are crosses ({targets}), pivots of the interfaces triangles. Positions are "
        "nominal."
    )


# --- planes and scales ----------------------------------------------------------------------------


def _detector(view: View) -> Callable[[Array], Array]:
    def plane(point_mm: Array) -> Array:
        u, v, w = view.projection @ np.append(point_mm, 1.0)
        return np.array([u / w, v / w])

    return plane


def _oblique(point_mm: Array) -> Array:
    """Orthographic: mm along RIGHT and against UP."""
    return np.array([float(RIGHT @ point_mm), -float(UP @ point_mm)])


def _spread(marks: list[Mark], plane: Callable[[Array], Array]) -> Array:
    """(2k, 2) points of the plane that have to be on the page."""
    shown = [plane(mark.position_mm) for mark in marks]
    return np.array(shown + [plane(mark.was_mm) for mark in marks if mark.was_mm is not None])


def _border(view: View) -> Array | None:
    """(2, 2) corners of the image, px; pixel centres are integers."""
    if view.image_size_px is None:
        return None
    width, height = view.image_size_px
    return np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])


def _ground(points_mm: Array, floor_mm: float) -> Array:
    """(4, 3) corners of the rectangle below all fiducials (N, 3), con, mm."""
    low, high = points_mm[:, :2].min(axis=0) - 5, points_mm[:, :2].max(axis=0) + 5
    return np.array([[x, y, floor_mm] for x, y in ((low[0], low[1]), (high[0], low[1]), high, (low[0], high[1]))])


# --- panels ---------------------------------------------------------------------------------------


def _image_column(column: int, rows: list[tuple[View, list[Mark]]]) -> list[str]:
    """The image of one view, before and after, on one scale."""
    shown = [imaged(view, marks) for view, marks in rows]
    planes = [_detector(view) for view, _ in rows]
    points = np.vstack([_spread(marks, plane) for marks, plane in zip(shown, planes, strict=True)])
    parts = []
    for row, ((view, _), marks, plane) in enumerate(zip(rows, shown, planes, strict=True)):
        parts += _image_panel(fitted(*image_corners(points, _border(view)), column, row, PLOT), view, marks, plane)
    return parts


def imaged(view: View, marks: list[Mark]) -> list[Mark]:
    """What the view sees: no pivots, and nothing behind the source (of a layout that was never checked)."""

    def in_front(point_mm: Array) -> bool:
        return float(depths(view.projection, point_mm[None, :])[0]) > 0

    return [
        replace(mark, was_mm=None) if mark.was_mm is not None and not in_front(mark.was_mm) else mark
        for mark in marks
        if not mark.kind.startswith("pivot") and in_front(mark.position_mm)
    ]


def _oblique_column(rows: list[list[Mark]]) -> list[str]:
    """The con frame, before and after, on one scale."""
    fiducials = np.array([mark.position_mm for marks in rows for mark in marks if mark.kind in ("fiducial", "new")])
    floor_mm = float(fiducials[:, 2].min())
    ground = _ground(fiducials, floor_mm)
    points = np.vstack([*(_spread(marks, _oblique) for marks in rows), [_oblique(corner) for corner in ground]])
    parts = []
    for row, marks in enumerate(rows):
        parts += _oblique_panel(fitted(*around(points), 2, row, PLOT - STRIP), marks, ground, floor_mm)
    return parts


def _image_panel(panel: Panel, view: View, marks: list[Mark], plane: Callable[[Array], Array]) -> list[str]:
    border = _border(view)
    (x0, y0), (x1, y1) = panel.page(panel.low), panel.page(panel.high)
    dashed = box(x0, y0, x1, y1, f'fill="none" stroke="{FAINT}" stroke-width="0.6" stroke-dasharray="3 3"')
    if border is None or view.image_size_px is None:
        size, frame = "image size unknown", dashed
    else:
        size = "image {} × {} px".format(*view.image_size_px)
        if (panel.low > border[0]).any() or (panel.high < border[1]).any():
            size, frame = f"part of an {size}", dashed
        else:
            corners = (*panel.page(border[0]), *panel.page(border[1]))
            frame = box(*corners, f'fill="none" stroke="{INK}" stroke-width="1"')
    parts = [text(panel.left, panel.top - 9, f"{printable(view.name, 24)}, px   ({size})"), frame]
    parts += _ticks(panel)

    def say(mark: Mark) -> str:
        u, v = plane(mark.position_mm)
        return f"u {u:.1f}, v {v:.1f} px"

    return parts + _drawn(panel, marks, plane, (x0, y0, x1, y1), say, MOST_LABELS["image"])


def _ticks(panel: Panel) -> list[str]:
    """Round numbers along u below and v to the left of the image."""
    (x0, _), (x1, y1) = panel.page(panel.low), panel.page(panel.high)
    parts = [
        text(x1, y1 + 29, "u, px →", anchor="end", colour=MUTED),
        text(x0 - 14, y1 + 29, "v, px ↓", colour=MUTED),
    ]
    step = round_step(2.5 * TICKS / panel.scale)  # round numbers are at most 2.5 apart
    for axis in (0, 1):
        first, last = ceil(panel.low[axis] / step), floor(panel.high[axis] / step)
        for value in (step * k for k in range(first, last + 1)):
            at = panel.page(np.array([value, value]))[axis]
            if axis == 0:
                parts.append(line(at, y1, at, y1 + 4, FAINT))
                parts.append(text(at, y1 + 16, f"{value:g}", anchor="middle", colour=MUTED))
            else:
                parts.append(line(x0 - 4, at, x0, at, FAINT))
                parts.append(text(x0 - 6, at + 4, f"{value:g}", anchor="end", colour=MUTED))
    return parts


def _oblique_panel(panel: Panel, marks: list[Mark], ground: Array, floor_mm: float) -> list[str]:
    corners = " ".join(f"{rounded(x)},{rounded(y)}" for x, y in (panel.page(_oblique(corner)) for corner in ground))
    parts = [
        text(panel.left, panel.top - 9, "con frame, mm   (oblique view)"),
        f'<polygon points="{corners}" fill="{PALE}" stroke="#c8c8c8" stroke-width="0.6"/>',
    ]
    for mark in marks:
        if mark.kind in ("fiducial", "new"):
            foot = np.array([mark.position_mm[0], mark.position_mm[1], floor_mm])
            ends = (*panel.page(_oblique(mark.position_mm)), *panel.page(_oblique(foot)))
            parts.append(line(*ends, "#9a9a9a", 0.7, dashes="1 2.5"))
    frame = (panel.left - 20, panel.top, panel.left + PLOT + 4, panel.top + PLOT + 10)

    def say(mark: Mark) -> str:
        x, y, z = mark.position_mm
        return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm"

    return parts + _drawn(panel, marks, _oblique, frame, say, MOST_LABELS["oblique"]) + _axes(panel)


def _axes(panel: Panel) -> list[str]:
    """The directions of con and a bar in mm, in the strip below the panel."""
    x, y, arm = panel.left, panel.top + PLOT + 12, 30.0
    parts = []
    for name, direction in zip("xyz", np.eye(3), strict=True):
        across, down = arm * _oblique(direction)
        parts.append(line(x, y, x + across, y + down, INK, 1.2))
        parts.append(text(x + 1.3 * across, y + 1.3 * down + 4, name, anchor="middle"))
    length = round_step(110 / panel.scale)
    end = panel.left + PLOT
    begin = end - length * panel.scale
    parts += [
        line(begin, y, end, y, INK, 1.6),
        line(begin, y - 4, begin, y + 4, INK),
        line(end, y - 4, end, y + 4, INK),
    ]
    parts.append(text(end, y + 17, f"{length:g} mm across the line of sight", anchor="end"))
    return parts


def _drawn(
    panel: Panel,
    marks: list[Mark],
    plane: Callable[[Array], Array],
    frame: tuple[float, float, float, float],
    say: Callable[[Mark], str],
    most_labels: int,
) -> list[str]:
    """Lines from where things were, then the marks, then their labels."""
    paths = [
        (*panel.page(plane(mark.was_mm)), *panel.page(plane(mark.position_mm)))
        for mark in marks
        if mark.was_mm is not None
    ]
    parts = [line(*path, FAINT, 0.9) for path in paths]
    points = []
    labelled = [mark.kind == "target" for mark in marks if mark.label and not mark.kind.startswith("pivot")]
    crowded = {"target": sum(labelled) > most_labels, "fiducial": len(labelled) - sum(labelled) > most_labels}
    crowded["new"] = crowded["fiducial"]
    for mark in marks:
        x, y = panel.page(plane(mark.position_mm))
        tip = f"<title>{escape(printable(mark.name, 80))}: {say(mark)}</title>"
        parts.append(f'<g class="{mark.kind.replace(" ", "-")}">{shape(mark.kind, x, y)}{tip}</g>')
        points.append(MarkedPoint(x, y, "" if crowded.get(mark.kind) else printable(mark.label, 18)))
    for mark, point, (x, y) in zip(marks, points, label_places(points, paths, frame, FONT), strict=True):
        if point.text:
            parts.append(text(x, y, point.text, colour=LABEL_COLOUR[mark.kind]))
    return parts


def _legend(after: System) -> list[str]:
    """Two lines below the rows."""
    y, x = HEIGHT - 32.0, float(MARGIN) + 6
    entries: list[tuple[Kind | Literal["was"], str]] = [
        ("fiducial", "fiducial"), ("new", "new fiducial"), ("was", "from where it was"), ("target", "target"),
    ]  # fmt: skip
    parts = []
    for kind, words in entries:
        parts.append(line(x - 7, y, x + 7, y, FAINT, 0.9) if kind == "was" else shape(kind, x, y))
        parts.append(text(x + 12, y + 4, words))
        x += 34 + 6.2 * len(words)
    parts.append(
        text(x - 4, y + 4, "u right, v down on the detector; dotted: down to the height of the lowest fiducial")
    )
    x, y = float(MARGIN) + 6, y + 20
    kinds: tuple[Kind, Kind] = ("pivot 1", "pivot 2")
    for kind, mount in zip(kinds, _mounts(after), strict=True):
        if turns(mount):
            words = f"{kind}: {printable(mount.title, 60)}"
            parts += [shape(kind, x, y), text(x + 12, y + 4, words)]
            x += 40 + 6.2 * len(words)
    return parts
