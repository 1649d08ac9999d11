"""matplotlib with one style, drawn as SVG that a page's content security policy lets count.

The policy of a report names one style sheet by its hash, so an element's look has to stand in its attributes; several
pictures share a page, so no identifier may occur twice; text stays text, set in the reader's own fonts.  matplotlib's
own SVG backend gives ``style`` attributes, references and fixed identifiers, hence the renderer below.  It takes the
width of a text from the number of its characters: the same record gives the same bytes whatever fonts are installed.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import GraphicsContextBase, RendererBase
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.transforms import Transform

from tailstack.geometry.arrays import Array
from tailstack.results.look import MUTED, STYLE

from ..rendering.text import columns
from .svg import CHARACTER, picture, text, trim

_drawing = Lock()  # matplotlib's settings are one for the whole process


@contextmanager
def style() -> Iterator[None]:
    """Our settings and no other's, whatever file of settings matplotlib found on this machine."""
    with _drawing, matplotlib.rc_context(), warnings.catch_warnings():
        # Letters that DejaVu lacks are set in whatever font the reader's machine has.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


class Chart:
    """A page on which charts are drawn; its lengths are units of the page, down from its upper left corner."""

    def __init__(self, name: str, width: float, height: float) -> None:
        self.name, self.width, self.height = name, width, height
        self.figure = Figure(figsize=(width / 72, height / 72), dpi=72, facecolor="none")

    def axes(
        self, left: float, top: float, right: float, bottom: float, x: str = "", y: str = "", grid: str = "both"
    ) -> Axes:
        """A pair of axes in a rectangle of the page, with their titles and round ticks.  ``grid``: both, x or y."""
        place = (left / self.width, 1 - bottom / self.height, (right - left) / self.width, (bottom - top) / self.height)
        axes = self.figure.add_axes(place)
        axes.xaxis.set_major_locator(MaxNLocator(max(int((right - left) / 55), 1), steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_locator(MaxNLocator(max(int((bottom - top) / 32), 1), steps=[1, 2, 5, 10]))
        for axis in (axes.xaxis, axes.yaxis):  # no digits that say nothing, and a minus sign that is one
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value, 12) + 0.0:g}".replace("-", "−")))
        if x:
            axes.set_xlabel(x)
        if y:
            self.say(left - 6, top - 8, y, color=MUTED)
        if grid == "x":
            axes.yaxis.set_visible(False)
        elif grid == "y":
            axes.xaxis.grid(False)
        return axes

    def say(self, x: float, y: float, words: str, **look: Any) -> None:
        """One line of text whose baseline begins, ends (``ha="right"``) or has its middle at a place of the page."""
        self.figure.text(x / self.width, 1 - y / self.height, words, **look)

    def explain(self, x: float, y: float, marks: Sequence[tuple[Artist, str]], **look: Any) -> None:
        """What marks and lines mean, from a place of the page on, in one row."""
        place = (x / self.width, 1 - y / self.height)
        handles, labels = zip(*marks, strict=True)
        look = {"ncols": len(labels)} | look
        self.figure.legend(handles, labels, loc="upper left", bbox_to_anchor=place, **look)

    @staticmethod
    def sample(**look: Any) -> Line2D:
        """A line or mark as it is drawn, to be explained."""
        return Line2D([], [], **look)

    @staticmethod
    def patch(**look: Any) -> Patch:
        """A field as it is drawn, to be explained."""
        return Patch(**look)

    def svg(self, title: str, words: str) -> str:
        """The page as SVG that says in words what it shows."""
        renderer = SvgRenderer(self.name, self.width, self.height)
        self.figure.draw(renderer)
        by = f"matplotlib {matplotlib.__version__}"
        return picture(self.name, title, words, self.height, renderer.parts, self.width, by)


class SvgRenderer(RendererBase):
    """What matplotlib draws, as SVG elements with presentation attributes; one unit is one point, y goes down."""

    def __init__(self, name: str, width: float, height: float) -> None:
        super().__init__()
        self.name, self.width, self.height = name, width, height
        self.parts: list[str] = []
        self._clips: dict[tuple[float, ...], str] = {}

    def get_canvas_width_height(self) -> tuple[float, float]:
        return self.width, self.height

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        size = prop.get_size_in_points()
        wide = 1.08 if prop.get_weight() == "bold" else 1.0
        return wide * CHARACTER * size * columns(s), 0.95 * size, 0.22 * size

    def draw_path(self, gc: GraphicsContextBase, path: Path, transform: Transform, rgbFace: Any = None) -> None:
        """A path, circle or rectangle."""
        flipped = transform + matplotlib.transforms.Affine2D().scale(1, -1).translate(0, self.height)
        outline = path.cleaned(transform=flipped, remove_nans=True, curves=True)
        codes, points = np.asarray(outline.codes)[:-1], np.asarray(outline.vertices)[:-1]  # the last is STOP
        fill, stroke = _fill(gc, rgbFace) if len(points) > 2 else NONE, _stroke(gc)
        if len(points) < 2 or (fill == NONE and not stroke):
            return
        look = " ".join(filter(None, (fill, stroke, self._clip(gc, points[codes != Path.CLOSEPOLY]))))
        self.parts.append(_element(codes, points, look))

    def draw_text(
        self, gc: GraphicsContextBase, x: float, y: float, s: str, prop: FontProperties, angle: float,
        ismath: Any = False, mtext: Text | None = None,
    ) -> None:  # fmt: skip
        """One line; where it is anchored it stays anchored, whatever font it is set in."""
        width, _, _ = self.get_text_width_height_descent(s, prop, ismath)
        align = "left" if mtext is None else mtext.get_horizontalalignment()
        anchor, part = {"left": ("start", 0.0), "center": ("middle", 0.5), "right": ("end", 1.0)}[align]
        colour, size = to_hex(gc.get_rgb()), prop.get_size_in_points()
        weight = "bold" if prop.get_weight() == "bold" else "normal"
        self.parts.append(text(x + part * width, y, s, anchor=anchor, colour=colour, size=size, weight=weight))

    def _clip(self, gc: GraphicsContextBase, points: Array) -> str:
        """The attribute that keeps a path in its axes, where it would leave them."""
        box = gc.get_clip_rectangle()
        if box is None:
            return ""
        low, high = np.array([box.x0, self.height - box.y1]), np.array([box.x1, self.height - box.y0])
        if (points >= low - 0.5).all() and (points <= high + 0.5).all():
            return ""
        corners = (*low, *(high - low))
        if corners not in self._clips:
            self._clips[corners] = f"{self.name}-clip-{len(self._clips) + 1}"
            x, y, width, height = map(trim, corners)
            self.parts.append(
                f'<clipPath id="{self._clips[corners]}"><rect x="{x}" y="{y}" width="{width}" height="{height}"/>'
                "</clipPath>"
            )
        return f'clip-path="url(#{self._clips[corners]})"'


NONE = 'fill="none"'


def _fill(gc: GraphicsContextBase, face: Any) -> str:
    if face is None:
        return NONE
    alpha = gc.get_alpha() if gc.get_forced_alpha() else face[3] if len(face) > 3 else 1.0
    if alpha == 0:
        return NONE
    return f'fill="{to_hex(face)}"' + (f' fill-opacity="{alpha:g}"' if alpha < 1 else "")


def _stroke(gc: GraphicsContextBase) -> str:
    colour, width = gc.get_rgb(), gc.get_linewidth()
    if width == 0 or colour[3] == 0:
        return ""
    dashes: Any = gc.get_dashes()[1]
    look = f'stroke="{to_hex(colour)}" stroke-width="{width:g}"'
    return look + (f' stroke-dasharray="{" ".join(f"{dash:g}" for dash in dashes)}"' if dashes is not None else "")


def _element(codes: Array, points: Array, look: str) -> str:
    """A circle is closed and all curves, a rectangle closed with four corners; whatever else is a path."""
    corners = points[codes != Path.CLOSEPOLY]
    low, high = corners.min(axis=0), corners.max(axis=0)
    closed = codes[-1] == Path.CLOSEPOLY
    if closed and (codes[1:-1] == Path.CURVE4).all():
        x, y = (low + high) / 2
        return f'<circle cx="{trim(x)}" cy="{trim(y)}" r="{trim((high[0] - low[0]) / 2)}" {look}/>'
    if closed and len(corners) == 4 and ((corners == low) | (corners == high)).all():
        x, y, width, height = map(trim, (*low, *(high - low)))
        return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {look}/>'
    words = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE4: " "}
    path = "".join(
        "Z" if code == Path.CLOSEPOLY else f"{words[code]}{trim(x)} {trim(y)}"
        for code, (x, y) in zip(codes, points, strict=True)
    )
    return f'<path d="{path}" {look}/>'
