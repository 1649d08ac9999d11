"""Pages that statistical charts are drawn on, and what several of them share: rows with names, lines with words.

matplotlib is imported when the first page is made: half a second that a command without charts does not pay.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from threading import Lock
from types import ModuleType
from typing import TYPE_CHECKING, Any

from tailstack.results.look import FAINT, MUTED, VERMILION

from ..environment import temporary_directory
from .svg import WIDTH, broken

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .matplotlib_svg import Chart

LEGIBLE = {VERMILION: "#b34700", "#5b9bc8": "#35709a"}  # names of curves: a colour too pale for letters
DASHED, DOTTED, SHORT = (0, (5, 3)), (0, (2, 2)), (0, (4, 3))
ROW, LINE = 22, 13  # height of a bar with its gap; of a line of text

_loading = Lock()


def _load() -> ModuleType:
    """Our part of matplotlib, which need not say that it keeps its list of fonts in a folder that goes with it."""
    with _loading:
        logger = logging.getLogger("matplotlib")
        level = logger.level
        logger.setLevel(logging.ERROR)
        try:
            return import_module(f"{__package__}.matplotlib_svg")
        except OSError:
            temporary_directory()  # which says what to do where there is none
            raise
        finally:
            logger.setLevel(level)


@contextmanager
def open_page(name: str, height: float, width: float = WIDTH) -> Iterator[Chart]:
    """A page to draw on, in our style.  ``name``: kebab-case, unique among the pictures of a document."""
    module = _load()
    with module.style():
        yield module.Chart(name, width, height)


# --- what several charts share --------------------------------------------------------------------


def upright(axes: Axes, value: float, words: str, colour: str, side: str, dashes: Any = "-") -> None:
    """A vertical line with its words on top, to the "left" or "right" of it."""
    axes.axvline(value, ymax=1 + 4 / axes.bbox.height, color=colour, linewidth=1.6, linestyle=dashes, clip_on=False)
    beside(axes, (value, 1.0), words, (4 if side == "right" else -4, 6), color=colour, weight="bold", of="x")


def sides(value: float, limit: float | None) -> tuple[str, str]:
    """On which sides of their lines a value and its limit are named, so that neither crosses the other's line."""
    return ("right", "left") if limit is not None and limit < value else ("left", "right")


def beside(
    axes: Axes, place: tuple[float, float], words: str, shift: tuple[float, float], of: str = "both", **look: Any
) -> None:
    """Words beside a place of the axes; they run away from it.

    of: which of its two numbers are of the data: "both", "x", "y"; "axes": neither, both are parts of the axes.
    """
    look.setdefault("ha", "right" if shift[0] < 0 else "left")
    known: dict[str, Any] = {"x": axes.get_xaxis_transform(), "y": axes.get_yaxis_transform(), "axes": axes.transAxes}
    where = known.get(of, "data")
    axes.annotate(words, place, shift, xycoords=where, textcoords="offset points", annotation_clip=False, **look)


@dataclass(frozen=True, slots=True)
class BarRows:
    """Bars one below the other, each as high as its name needs; lengths of the page."""

    names: tuple[tuple[str, ...], ...]  # lines of each
    middles: tuple[float, ...]
    height: float

    @classmethod
    def of(cls, names: Sequence[str], letters: int, least: float = ROW) -> BarRows:
        lines = [broken(name, letters) for name in names]
        middles, top = [], 0.0
        for each in lines:
            height = max(least, LINE * len(each) + 9)
            middles.append(top + height / 2)
            top += height
        return cls(tuple(lines), tuple(middles), top)

    def axes(self, page: Chart, left: float, top: float, right: float, x: str) -> Axes:
        """Axes whose y is the distance from the first row on the page; names stand to their left."""
        axes = page.axes(left, top, right, top + self.height, x, grid="x")
        axes.set_ylim(self.height, 0)
        for middle, lines in zip(self.middles, self.names, strict=True):
            for k, line in enumerate(lines):
                page.say(left - 10, top + middle + 4 + LINE * (k - (len(lines) - 1) / 2), line, ha="right")
        return axes


@contextmanager
def titled_page(
    name: str, title: str, sentence: str, height: float, width: float = 900
) -> Iterator[tuple[Chart, float]]:
    """A page that stands by itself, below its title and a sentence, and where what is drawn begins on it."""
    titles = broken(title, int((width - 30) / 9.2))
    sentences = broken(sentence, int((width - 30) / 6.7)) if sentence else ()
    top = 12.0 + 19 * len(titles) + 15 * len(sentences)
    with open_page(name, top + height, width) as page:
        for k, line in enumerate(titles):
            page.say(15, 24 + 19 * k, line, size=15, weight="bold")
        for k, line in enumerate(sentences):
            page.say(15, 9 + 19 * len(titles) + 15 * (k + 1), line, color=MUTED)
        yield page, top


def name_at_right(axes: Axes, ends: Sequence[tuple[str, float, str]], letters: int) -> None:
    """Names of curves, in their colours, at the height of their right ends, pushed apart where they would touch."""
    high, height = axes.get_ylim()[1], axes.bbox.height
    per_unit = height / (high - axes.get_ylim()[0])
    ends = sorted(ends, key=lambda end: -end[1])
    names = [broken(name, letters) for name, _, _ in ends]
    places, foot = [], 0.0
    for lines, (_, y, _) in zip(names, ends, strict=True):
        places.append(max((high - y) * per_unit + 4, foot))
        foot = places[-1] + LINE * len(lines) + 1
    foot = height
    for k in reversed(range(len(places))):
        places[k] = min(places[k], foot - LINE * (len(names[k]) - 1))
        foot = places[k] - LINE - 1
    for lines, place, (_, _, colour) in zip(names, places, ends, strict=True):
        for k, line in enumerate(lines):
            beside(axes, (1.0, 1.0), line, (10, -place - LINE * k), of="axes", color=LEGIBLE.get(colour, colour))


def draw_cells(axes: Axes, cells: Sequence[tuple[int, int, str, str, str]]) -> None:
    """Fields of a map: column, row from below, colour ("" for an empty one), words and their colour."""
    wide = axes.bbox.width / (1 + max(column for column, *_ in cells))
    tall = axes.bbox.height / (1 + max(row for _, row, *_ in cells))
    for column, row, colour, words, ink in cells:
        look = {"color": colour} if colour else {"color": "#ffffff", "edgecolor": FAINT, "linewidth": 1}
        axes.bar(column, 1 - 1.5 / tall, 1 - 1.5 / wide, bottom=row + 0.75 / tall, align="edge", **look)
        if words:
            beside(axes, (column + 0.5, row + 0.5), words, (0, -4), ha="center", color=ink)
