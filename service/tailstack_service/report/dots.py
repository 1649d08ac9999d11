"""Fifty shots that stand for all, as a quantile dot plot: what a clinician reads a probability from most accurately.

Fernandes et al., Uncertainty displays using quantile dotplots, CHI 2018.  Dots that miss the limit differ in colour and
in shape.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from math import ceil, floor

from tailstack.results import Score
from tailstack.results.digits import in_percent
from tailstack.results.look import LIMIT_COLOUR, VALUE_COLOUR
from tailstack.results.score import SHOTS, FiftyShots
from tailstack.results.tables import PAPER, TERMINAL, Column, On, tabulate

from ..rendering.blocks import Block, Figure, group, say
from .charts import PHONE
from .page import DASHED, open_page, upright
from .svg import WIDTH, printable

LEFT, TALLEST, LETTER = 22, 96, 6.6  # margin, height of the highest heap, width of a letter
FEWEST, MOST = 16, 400  # columns of dots


def count_misses(shots: FiftyShots) -> int:
    """How many of the fifty are beyond the limit: fifty times the probability of that, rounded."""
    return sum(value is None or value > shots.limit for value in shots.values)


def say_misses(shots: FiftyShots) -> str:
    """How many of the fifty miss the limit."""
    misses = count_misses(shots)
    verb = "misses" if misses == 1 else "miss"
    share = in_percent(shots.exceedance_probability, 1)
    return f"{misses} of {SHOTS} shots {verb} the limit of {shots.limit:g} {shots.unit} ({share} of all)"


def dots_blocks(score: Score) -> tuple[Block, ...]:
    """Picture and sheet, in a terminal a line; nothing where they were not asked for."""
    shots = score.fifty_shots
    if shots is None:
        return ()
    told, kept = say_misses(shots), SHOTS - count_misses(shots)
    columns = (
        Column("Shot", kind="whole", of=lambda row: row[0]),
        Column("Order", "%", "percent", 0, of=lambda row: (row[0] - 0.5) / SHOTS),
        Column("Value", shots.unit, "significant", 6, of=lambda row: row[1]),
        Column("Limit", of=lambda row: "misses" if row[0] > kept else "keeps"),
    )
    drawn = ((told, shots),)
    table = tabulate("Fifty shots", f"{shots.of}, by estimate: {told}", columns, list(enumerate(shots.values, 1)))
    picture = Figure(
        "fifty-shots", partial(draw_dots, drawn), f"Fifty shots that stand for all, by estimate: {shots.of}.",
        partial(draw_dots, drawn, "fifty-shots-narrow", PHONE),
    )  # fmt: skip
    line = f"{'o' * kept}{'X' * (SHOTS - kept)}: {told}"
    return (group(picture, on=PAPER), group(table, on=On.SHEET), say("fifty shots", line, on=TERMINAL))


def draw_dots(rows: Sequence[tuple[str, FiftyShots]], name: str = "fifty-shots", width: float = WIDTH) -> str:
    """Rows of words and dots below one another, all of one unit, on one scale."""
    wide = width - 2 * LEFT
    known = [value for _, shots in rows for value in shots.values if value is not None]
    end = 1.02 * max([1e-9, *known, *(1.25 * shots.limit for _, shots in rows)])
    for columns in range(FEWEST, MOST):
        heaps = [_heap(shots, end, end / columns) for _, shots in rows]
        tall = max(count for heap in heaps for count in heap.values())
        if tall * wide / columns <= TALLEST:
            break
    step, size = end / columns, wide / columns
    height = tall * size + 66
    with open_page(name, height * len(rows) + 20, width) as page:
        for k, ((words, shots), heap) in enumerate(zip(rows, heaps, strict=True)):
            top, title = k * height, f"{shots.of.removeprefix('the ')}, {shots.unit}"
            page.say(LEFT, top + 12, printable(words, int(wide / LETTER)), weight="bold")
            axes = page.axes(LEFT, top + 34, width - LEFT, top + height - 32, title if k == len(rows) - 1 else "")
            axes.grid(False)
            axes.yaxis.set_visible(False)
            axes.set(xlim=(0, end), ylim=(0, tall))
            for column, count in heap.items():
                mark, colour = ("X", LIMIT_COLOUR) if column >= 0 else ("o", VALUE_COLOUR)
                axes.plot(
                    [shots.limit + (column + 0.5) * step] * count, [level + 0.5 for level in range(count)], mark,
                    color=colour, clip_on=False, markersize=0.9 * size, markeredgewidth=0,
                )  # fmt: skip
            upright(axes, shots.limit, f"limit {shots.limit:g} {shots.unit}", LIMIT_COLOUR, "right", DASHED)
        told = "; ".join(f"{words}, from {shots.values[0]:.4g} {shots.unit} on" for words, shots in rows)
        return page.svg("Fifty shots that stand for all, by estimate", f"{told}.")


def _heap(shots: FiftyShots, end: float, step: float) -> dict[int, int]:
    """How many dots stand in each column, counted from the limit, so that none stands on both sides of it; what has no
    answer is in the last."""
    last = floor((end - shots.limit) / step) - 1
    return Counter(last if value is None else ceil((value - shots.limit) / step) - 1 for value in shots.values)
