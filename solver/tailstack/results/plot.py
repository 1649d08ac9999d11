"""The chart of a result, drawn by matplotlib into axes that a user may have made, in the look of the reports."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ..extras import name_missing_extra
from .look import BAR, BAR_PALE, COLOURS, FONT, INK, LIMIT_COLOUR, MUTED, STYLE, VALUE_COLOUR
from .outline import Bar, Bars, Curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LETTERS = 36  # in a line of a label
MOST_CURVES = 12
WIDE, ROW, BESIDE_ROWS = 8.0, 0.34, 1.3  # inches: of a figure, of a bar, of what stands above and below the bars
LIMIT_LOOK: dict[str, Any] = {"color": LIMIT_COLOUR, "linewidth": 1.6, "linestyle": (0, (5, 3))}


def draw(chart: Bars | Curves, ax: Axes | None) -> Axes:
    """Draw a chart and give back its axes; without ``ax`` in a new figure of pyplot, which a notebook shows.

    Raises MissingExtraError without matplotlib, ValueError for more curves than can be told apart.
    """
    if isinstance(chart, Curves) and len(chart.curves) > MOST_CURVES:
        raise ValueError(
            f"a plot shows at most {MOST_CURVES} curves, this sweep has {len(chart.curves)}; take values out of it, or "
            "draw what you want from to_frame()"
        )
    with name_missing_extra():
        matplotlib = import_module("matplotlib")
    figure: Any = None
    if ax is None:
        # before our settings are put in place: the first figure of a notebook makes settings of its own, which stay
        high = BESIDE_ROWS + ROW * len(chart.bars) if isinstance(chart, Bars) else 4.2
        pyplot = import_module("matplotlib.pyplot")
        figure = pyplot.figure(figsize=(WIDE, high), layout="constrained", facecolor="white")
    with matplotlib.rc_context(STYLE):
        axes: Axes = figure.add_subplot() if ax is None else ax
        axes.set_title(chart.title, loc="left", fontsize=FONT + 1, fontweight="bold", color=INK, wrap=True)
        if isinstance(chart, Bars):
            _draw_bars(axes, chart)
        else:
            _draw_curves(axes, chart)
    return axes


def _draw_bars(ax: Axes, chart: Bars) -> None:
    places = range(len(chart.bars))
    for place, bar in zip(places, chart.bars, strict=True):
        if bar.before is not None:
            ax.barh(place, bar.before, height=0.72, color=BAR_PALE)
        ax.barh(place, bar.value, height=0.72 if bar.before is None else 0.4, color=BAR)
        if bar.interval is not None:
            low, high = bar.interval[0], bar.value if bar.interval[1] is None else bar.interval[1]
            ax.plot([low, high], [place, place], color=VALUE_COLOUR, linewidth=2, marker="|", markersize=9)
        if bar.limit is not None:
            ax.plot([bar.limit, bar.limit], [place - 0.46, place + 0.46], **LIMIT_LOOK)
        words = f"{bar.value:.3g}" if bar.before is None else f"{bar.before:.3g} → {bar.value:.3g}"
        ax.annotate(words, (_reach(bar), place), (6, 0), textcoords="offset points", va="center", annotation_clip=False)
    ax.set_ylim(len(chart.bars) - 0.4, -0.6)
    compared = any(bar.before is not None for bar in chart.bars)
    ax.set_xlim(0, (1.4 if compared else 1.22) * max(map(_reach, chart.bars), default=1.0) or 1.0)
    labels = ["\n".join(wrap(bar.label, LETTERS, break_long_words=False)) for bar in chart.bars]
    ax.set_yticks(places, labels, color=INK)
    ax.grid(False, axis="y")
    ax.set_xlabel(chart.axis)
    if any(bar.limit is not None for bar in chart.bars):
        ax.plot([], [], label="limit", **LIMIT_LOOK)
    if compared:
        ax.barh([0], [0], color=BAR_PALE, label="before")
        ax.barh([0], [0], color=BAR, label="after")
    _explain(ax)


def _reach(bar: Bar) -> float:
    """How far to the right anything of a bar goes."""
    high = None if bar.interval is None else bar.interval[1]
    return max(bar.value, bar.before or 0.0, bar.limit or 0.0, high or 0.0)


def _draw_curves(ax: Axes, chart: Curves) -> None:
    nan = float("nan")
    order: Sequence[int] = sorted(range(len(chart.places)), key=lambda k: chart.places[k])
    across = [chart.places[k] for k in order]
    for number, curve in enumerate(chart.curves):
        colour = COLOURS[number % len(COLOURS)]
        values = [nan if (value := curve.values[k]) is None else value for k in order]
        dashes = "-" if number < len(COLOURS) else (0, (5, 3))
        ax.plot(across, values, marker="o", color=colour, linestyle=dashes, label=curve.name)
        if any(curve.intervals):
            ends = [curve.intervals[k] or (nan, nan) for k in order]
            ax.fill_between(across, [low for low, _ in ends], [high for _, high in ends], color=colour, alpha=0.18)
    for limit, name in chart.limits:
        ax.axhline(limit, label=f"{name} {limit:g} mm", **LIMIT_LOOK)
    ax.margins(0.04, 0.12)
    ax.set_xlabel(chart.across)
    ax.set_ylabel(chart.up, color=MUTED)
    _explain(ax, len(chart.curves) + len(chart.limits) > 1)


def _explain(ax: Axes, wanted: bool = True) -> None:
    """What lines and bars mean, below the axes of a figure of ours, within those of a user."""
    marks, names = ax.get_legend_handles_labels()
    if not wanted or not names:
        return
    figure = ax.get_figure(root=True)
    if figure is not None and figure.get_layout_engine() is not None and len(figure.axes) == 1:
        columns = max(1, min(4, 90 // (8 + max(map(len, names)))))
        figure.legend(marks, names, loc="outside lower left", ncols=columns)
    else:
        ax.legend()
