"""What each view sees: projected fiducials and targets on the detector, its edges and margin, what overlaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from tailstack.design import Design, compile_design
from tailstack.estimation.checks import imaged_fiducials, needed_gaps
from tailstack.geometry.arrays import Array
from tailstack.geometry.camera import ROUNDING_PX, depths
from tailstack.results.look import FAINT, FONT, INK, LIMIT_COLOUR, MUTED
from tailstack.system import System

from .beams import Beam, beams_of
from .svg import (
    LABEL_COLOUR,
    LONGEST,
    WIDTH,
    Box,
    MarkedPoint,
    box,
    broken,
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

CELL, LEFT, PLOT = WIDTH // 2, 44, 296  # width of a column; room for tick labels; side of a plot
HEAD = 54  # above a plot: its name, its size, the axes of con
MOST_LABELS = 60
SMALL_PART = 0.45  # of an image: layouts that take less of it are drawn once more, enlarged
MOST_PAIRS = 3  # named; the others are counted

Page = Callable[[Array], Array]  # px (N, 2) -> page (N, 2)


@dataclass(frozen=True, slots=True, eq=False)
class ViewImage:
    """What one view sees of a layout."""

    beam: Beam
    fiducials_px: Array  # (N, 2), NaN behind the source
    targets_px: Array  # (M, 2)
    depths_mm: Array  # (N,)
    close: tuple[tuple[int, int], ...]  # fiducials whose images are closer than they should be
    outside: frozenset[int]  # fiducials whose images are not on the detector
    before_px: Array | None  # (N, 2) where their images were, NaN where there was none
    margin_px: float
    spacing_px: float  # the most that one of these pairs needs
    labels: tuple[str, ...]
    unused: frozenset[int]  # fiducials that the view's estimate does not use: drawn hollow


def draw_images(design: Design, title: str, name: str = "images", before: Design | None = None) -> str:
    """One picture for all views of a design: as the structure sits with its known bias, without noise.

    ``before``: another design; lines lead from where its fiducials of the same label are imaged by the same views.
    Raises DesignError, IllPosedError for a design that does not compile.
    """
    system = compile_design(design)
    old = None if before is None else compile_design(before)
    beams = zip(beams_of(design, system), system.sees > 0, strict=True)
    views = [_view_image(design, system, old, beam, used) for beam, used in beams]
    parts: list[str] = []
    column, top, row_height = 0, 0.0, 0.0
    for view in views:
        windows = _windows(view)
        if column + len(windows) > 2:
            column, top, row_height = 0, top + row_height, 0.0
        for place, (low, high, whole) in enumerate(windows):
            named = place == len(windows) - 1
            elements, height = _panel(view, system, low, high, whole, named, (column + place) * CELL, top)
            parts += elements
            row_height = max(row_height, height)
        column += len(windows)
    bottom = top + row_height
    parts += _legend(views, bottom + 12, old is not None)
    return picture(name, title, _words(views, system), bottom + 38, parts)


def _view_image(design: Design, system: System, old: System | None, beam: Beam, used: NDArray[np.bool_]) -> ViewImage:
    """``used``: (N,) whether the view's estimate uses a fiducial."""
    points = imaged_fiducials(system)
    section = design.document.optimise
    images, depth = beam.images(points), depths(beam.view.projection, points)
    needed = needed_gaps(beam.view, system.fiducial_radius_mm, np.where(depth > 0, depth, np.nan))
    if section is not None:
        needed = np.fmax(needed, section.min_projected_spacing_px)
    apart = np.hypot(*np.moveaxis(images[:, None] - images[None], -1, 0))
    pairs = np.argwhere(np.triu((apart < needed - ROUNDING_PX) & used & used[:, None], 1)).tolist()  # NaN is not
    low, high = beam.corners_px.min(axis=0), beam.corners_px.max(axis=0)
    on = ((images >= low) & (images <= high)).all(axis=1)
    before = None
    if old is not None:
        was = dict(zip(old.fiducial_labels, beam.images(imaged_fiducials(old)), strict=True))
        before = np.array([was.get(label, np.full(2, np.nan)) for label in system.fiducial_labels])
    return ViewImage(
        beam=beam,
        fiducials_px=images,
        targets_px=beam.images(np.array([target.position_mm for target in system.targets])),
        depths_mm=depth,
        close=tuple((int(i), int(j)) for i, j in pairs),
        outside=frozenset(np.flatnonzero(~on & used).tolist()),
        before_px=before,
        margin_px=0.0 if section is None else section.image_margin_px,
        spacing_px=max((float(needed[i, j]) for i, j in pairs), default=0.0),
        labels=system.fiducial_labels,
        unused=frozenset(np.flatnonzero(~used).tolist()),
    )


def _windows(view: ViewImage) -> list[tuple[Array, Array, bool]]:
    """What is drawn of an image, as corners in px: all of it, and what is imaged once more if that is a small part."""
    points = np.vstack([view.fiducials_px, view.targets_px, *([] if view.before_px is None else [view.before_px])])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = view.beam.corners_px.min(axis=0), view.beam.corners_px.max(axis=0)
    if not len(points):
        return [(low, high, True)]
    least, most = points.min(axis=0), points.max(axis=0)
    whole = (np.minimum(low, least), np.maximum(high, most), True)
    side = 1.16 * max(float((most - least).max()), 8.0)
    if side > SMALL_PART * float((high - low).max()):
        return [whole]
    middle = (least + most) / 2
    return [whole, (middle - side / 2, middle + side / 2, False)]


def _panel(
    view: ViewImage, system: System, low: Array, high: Array, whole: bool, named: bool, left: float, top: float
) -> tuple[list[str], float]:
    """One plot with its heading, and its height on the page."""
    scale = PLOT / float((high - low).max())
    names = broken(view.beam.view.name + ("" if whole else ", enlarged"), 34)
    top += 15 * (len(names) - 1)
    origin = np.array([left + LEFT, top + HEAD])

    def page(points: Array) -> Array:
        return np.asarray(origin + scale * (points - low))

    (x0, y0), (x1, y1) = page(low), page(high)
    frame = (float(x0), float(y0), float(x1), float(y1))
    parts = [
        text(x0, top + 16 + 15 * (k + 1 - len(names)), line_of_name, size=13, weight="bold")
        for k, line_of_name in enumerate(names)
    ]
    parts += [text(x0, top + 32 + 14 * k, words, colour=MUTED) for k, words in enumerate(_size(view.beam, whole))]
    parts += [*_edges(view, page, frame, whole), *_ticks(frame, low, high, scale)]
    parts += _marks(view, system, page, frame, named)
    foot = y1 + 46
    if whole:
        parts += [*_scale_bar(view.beam, frame, scale), *_directions(view.beam, x1 - 34, top + 26)]
        for line_of_remark in (each for sentence in _remarks(view) for each in broken(sentence, 62)):
            parts.append(text(x0, foot, line_of_remark, colour=LIMIT_COLOUR))
            foot += 14
    return parts, foot - top + 8


def _size(beam: Beam, whole: bool) -> tuple[str, ...]:
    """What is drawn, in one line or two."""
    if not whole:
        return ("the part with fiducials and targets, px",)
    if beam.view.image_size_px is None:
        return ("image size not stated; px",)
    width, height = beam.view.image_size_px
    words = f"{width} × {height} px"
    if beam.pixel_mm is not None:
        words += f" = {width * beam.pixel_mm[0]:.0f} × {height * beam.pixel_mm[1]:.0f} mm"
        return words + ",", f"{beam.detector_mm:.0f} mm from the source"
    return (words,)


def _edges(view: ViewImage, page: Page, frame: Box, whole: bool) -> list[str]:
    if not whole:
        return [box(*frame, f'fill="#f7f9fa" stroke="{FAINT}" stroke-width="0.7" stroke-dasharray="3 3"')]
    low, high = view.beam.corners_px.min(axis=0), view.beam.corners_px.max(axis=0)
    (x0, y0), (x1, y1) = page(low), page(high)
    dashes = "" if view.beam.sized else ' stroke-dasharray="3 3"'
    parts = [box(x0, y0, x1, y1, f'fill="#f7f9fa" stroke="{INK}" stroke-width="1.1"{dashes}')]
    if view.margin_px > 0 and view.beam.sized:
        (x0, y0), (x1, y1) = page(low + view.margin_px), page(high - view.margin_px)
        parts.append(box(x0, y0, x1, y1, 'fill="none" stroke="#0072b2" stroke-width="0.8" stroke-dasharray="2 3"'))
    return parts


def _ticks(frame: Box, low: Array, high: Array, scale: float) -> list[str]:
    x0, y0, x1, y1 = frame
    parts = [
        text(x1, y1 + 30, "u, px →", anchor="end", colour=MUTED),
        text(x0 - 34, y1 + 30, "v, px ↓", colour=MUTED),
    ]
    step = round_step(2.5 * 52 / scale)
    for axis in (0, 1):
        for k in range(ceil(low[axis] / step), floor(high[axis] / step) + 1):
            at = float((x0, y0)[axis] + scale * (step * k - low[axis]))
            words = f"{step * k:g}"
            if axis == 0:
                parts += [line(at, y1, at, y1 + 4, FAINT), text(at, y1 + 16, words, anchor="middle", colour=MUTED)]
            else:
                parts += [line(x0 - 4, at, x0, at, FAINT), text(x0 - 6, at + 4, words, anchor="end", colour=MUTED)]
    return parts


def _marks(view: ViewImage, system: System, page: Page, frame: Box, named: bool) -> list[str]:
    parts, points, colours, paths = [], [], [], []
    at = page(view.fiducials_px)
    if view.before_px is not None:
        for was, now in zip(page(view.before_px), at, strict=True):
            ends = (float(was[0]), float(was[1]), float(now[0]), float(now[1]))
            if np.isfinite(ends).all() and np.hypot(ends[2] - ends[0], ends[3] - ends[1]) > 0.5:
                paths.append(ends)
                parts.append(line(*ends, FAINT, 0.9))
                parts.append(_ring(ends[0], ends[1], 3.0, FAINT, 1.1))
    for pair in view.close:
        (xa, ya), (xb, yb) = at[pair[0]], at[pair[1]]
        radius = float(np.hypot(xb - xa, yb - ya)) / 2 + 8
        parts.append(_ring(float(xa + xb) / 2, float(ya + yb) / 2, radius, LIMIT_COLOUR, 1.4, "none"))
    for k, (label, image, place) in enumerate(zip(view.labels, view.fiducials_px, at, strict=True)):
        if not np.isfinite(place).all():
            continue
        x, y = float(place[0]), float(place[1])
        tip = f"{printable(label, LONGEST)}: u {image[0]:.1f}, v {image[1]:.1f} px, depth {view.depths_mm[k]:.1f} mm"
        drawn = _ring(x, y, 3.2, INK, 1.2) if k in view.unused else shape("fiducial", x, y)
        parts.append(f"<g>{drawn}<title>{escape(tip)}{' (not used)' if k in view.unused else ''}</title></g>")
        if k in view.outside:
            parts.append(_ring(x, y, 7.0, LIMIT_COLOUR, 1.6, "none"))
        points.append(MarkedPoint(x, y, in_lines(label, 12) if named and len(view.labels) <= MOST_LABELS else ""))
        colours.append(LIMIT_COLOUR if k in view.outside else INK)
    regions: set[str] = set()
    for target, image, place in zip(system.targets, view.targets_px, page(view.targets_px), strict=True):
        if not np.isfinite(place).all():
            continue
        x, y = float(place[0]), float(place[1])
        tip = f"target {printable(target.name, LONGEST)}: u {image[0]:.1f}, v {image[1]:.1f} px"
        parts.append(f"<g>{shape('target', x, y)}<title>{escape(tip)}</title></g>")
        called = target.region or target.name
        points.append(MarkedPoint(x, y, "" if called in regions else in_lines(called, 16)))
        colours.append(LABEL_COLOUR["target"])
        regions.add(called)
    for point, (x, y), colour in zip(points, label_places(points, paths, frame, FONT), colours, strict=True):
        if point.text:
            parts += label_lines(x, y, point.text, colour)
    return parts


def _ring(x: float, y: float, radius: float, colour: str, width: float, fill: str = "#ffffff") -> str:
    look = f'fill="{fill}" stroke="{colour}" stroke-width="{width:g}"'
    return f'<circle cx="{trim(x)}" cy="{trim(y)}" r="{trim(radius)}" {look}/>'


def _scale_bar(beam: Beam, frame: Box, scale: float) -> list[str]:
    """A length at the detector, below the plot, where the pitch is known."""
    if beam.pixel_mm is None:
        return []
    x0, _, _, y1 = frame
    length = round_step(70 * beam.pixel_mm[0] / scale)
    begin, y = x0 + 40, y1 + 26
    end = begin + length / beam.pixel_mm[0] * scale
    bars = [line(begin, y, end, y, INK, 1.5), *(line(x, y - 3, x, y + 3, INK) for x in (begin, end))]
    return [*bars, text(end + 7, y + 4, f"{length:g} mm at the detector", colour=MUTED)]


def _directions(beam: Beam, x: float, y: float) -> list[str]:
    """How the axes of con lie in the image, as seen from the source; the beam runs into the page."""
    arm = 15.0
    parts = [
        _ring(x, y, 4.5, INK, 1.0),
        line(x - 3.2, y - 3.2, x + 3.2, y + 3.2, INK),
        line(x - 3.2, y + 3.2, x + 3.2, y - 3.2, INK),
    ]
    # Unit vectors in con of growing u and growing v, across the beam
    rows = beam.view.projection[:2, :3]
    flat = rows - np.outer(rows @ beam.direction, beam.direction)
    across, down = flat / np.linalg.norm(flat, axis=1)[:, None]
    labels: list[tuple[float, float]] = []
    for name, right, low in zip("xyz", across, down, strict=True):
        dx, dy = arm * float(right), arm * float(low)
        length = float(np.hypot(dx, dy))
        if length < 0.3 * arm:
            continue
        ux, uy = dx / length, dy / length
        parts.append(line(x + 4.5 * ux, y + 4.5 * uy, x + dx, y + dy, INK, 1.1))
        at = (x + dx + 7 * ux, y + dy + 7 * uy)
        while any(np.hypot(at[0] - other[0], at[1] - other[1]) < 9 for other in labels):
            at = (at[0] + 9 * ux, at[1] + 9 * uy)
        labels.append(at)
        parts.append(text(at[0], at[1] + 4, name, anchor="middle"))
    return parts


# --- words ----------------------------------------------------------------------------------------


def _remarks(view: ViewImage) -> list[str]:
    """What is wrong in an image, in sentences."""
    close = [f"{view.labels[i]}–{view.labels[j]}" for i, j in view.close]
    outside = [view.labels[k] for k in sorted(view.outside)]
    remarks = ((f"closer than {view.spacing_px:.3g} px", close), ("not on the detector", outside))
    return [
        f"{words}: {', '.join(names[:MOST_PAIRS])}"
        + (f" and {len(names) - MOST_PAIRS} more" if len(names) > MOST_PAIRS else "")
        for words, names in remarks
        if names
    ]


def _legend(seen: Sequence[ViewImage], y: float, compared: bool) -> list[str]:
    x = 12.0
    parts = []
    for kind in ("fiducial", "target"):
        parts += [shape(kind, x, y - 4), text(x + 11, y, kind)]
        x += 30 + 6.2 * len(kind)
    if any(view.unused for view in seen):
        parts += [_ring(x, y - 4, 3.2, INK, 1.2), text(x + 11, y, "not used by this view")]
        x += 160
    if compared:
        parts += [
            line(x, y - 4, x + 16, y - 4, FAINT, 0.9),
            _ring(x, y - 4, 3.0, FAINT, 1.1),
            text(x + 22, y, "moved from"),
        ]
        x += 112
    margins = {view.margin_px for view in seen if view.beam.sized and view.margin_px > 0}
    if margins:
        look = 'fill="none" stroke="#0072b2" stroke-width="0.8" stroke-dasharray="2 3"'
        words = f"margin that fiducials keep, {max(margins):g} px"
        parts += [box(x - 6, y - 10, x + 10, y + 1, look), text(x + 16, y, words)]
        x += 32 + 5.8 * len(words)
    if any(view.close or view.outside for view in seen):
        parts += [_ring(x, y - 4, 6.0, LIMIT_COLOUR, 1.4, "none"), text(x + 11, y, "too close, or outside")]
    note = (
        "As seen from the source, ⊗ the beam; the structure with its known bias, without noise. Lengths in mm are at "
        "the detector."
    )
    return [*parts, text(7, y + 18, note, colour=MUTED)]


def _words(seen: Sequence[ViewImage], system: System) -> str:
    sentences = []
    for view in seen:
        words = f"View {printable(view.beam.view.name, LONGEST)}: {' '.join(_size(view.beam, True))}"
        remarks = _remarks(view)
        sentences.append(words + (f"; {'; '.join(remarks)}" if remarks else ""))
    counts = f"Images of {len(system.fiducials_mm)} fiducials and {len(system.targets)} targets."
    return f"{counts} {'. '.join(sentences)}."
