"""The statistical charts of a report and of a sweep: functions of records that give SVG."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from math import ceil, floor, isclose, sqrt
from typing import TYPE_CHECKING, Any

from tailstack.errors import Problem
from tailstack.measures import MEASURE
from tailstack.results import ERRORS, Check, Contributor, Lever, TargetScore
from tailstack.results.digits import decimal, number, percent
from tailstack.results.look import BAR, BAR_PALE, COLOURS, FAINT, FONT, INK, LIMIT_COLOUR, MUTED, VALUE_COLOUR
from tailstack.results.score import FiftyShots, single_lines, source_name

from ..problems import RequestError
from ..rendering.sentences import budget_line
from ..rendering.text import columns
from .page import (
    DASHED,
    DOTTED,
    ROW,
    SHORT,
    BarRows,
    beside,
    draw_cells,
    name_at_right,
    open_page,
    sides,
    titled_page,
    upright,
)
from .svg import CHARACTER, LONGEST, WIDTH, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tailstack.results.sweep import Sweep, SweepAxis, SweepPoint, SweepTarget

    from .records import ErrorDistribution, Headline

BAR_BEYOND, LAW_COLOUR = "#e8aaa5", "#a84600"
FIRST_BAR, FIRST_LINE = "#b4bcc3", "#6b7780"  # of two designs the first
WITHIN, BEYOND = "#e4f1e8", "#f9e4e2"
MOST_BARS = 12
RING: dict[str, Any] = {"markerfacecolor": "#ffffff", "markersize": 6.4}
LEFT, RIGHT = 62, WIDTH - 22
Pair = tuple[str, str]  # what two designs are called


# --- budget ---------------------------------------------------------------------------------------

NAMES, LETTERS = 262, 41  # width of the names of a budget, on the page and in letters


def draw_shares(contributors: Sequence[Contributor], target: str, name: str = "waterfall") -> str:
    """Shares of the variance, largest first, each beginning where the one above ends; they sum to the whole."""
    lines = [entry for entry in single_lines(contributors) if entry.variance_share > 0]
    shares = [(budget_line(entry), entry.variance_share) for entry in lines[:MOST_BARS]]
    rest = sum(entry.variance_share for entry in lines[MOST_BARS:])
    if rest > 0:
        shares.append((f"{len(lines) - MOST_BARS} more", rest))
    rows = BarRows.of([label for label, _ in shares] or ["nothing is random"], LETTERS)
    with open_page(name, rows.height + 74) as page:
        axes = rows.axes(page, NAMES, 26, WIDTH - 60, "share of the variance, %, summed up")
        axes.set_xlim(0, 100)
        begin = 0.0
        for k, (_, share) in enumerate(shares):
            middle, end = rows.middles[k], min(begin + 100 * share, 100.0)
            axes.barh(middle, max(end - begin, 0.2), left=min(begin, 99.8), height=ROW - 6, color=BAR)
            if k + 1 < len(shares):
                axes.plot([end, end], [middle + 8, rows.middles[k + 1] - 8], color=MUTED, linewidth=0.7)
            at, shift = (begin, -5) if end > 87 else (end, 5)
            beside(axes, (at, middle), f"{percent(share)} %", (shift, -4))
            begin = end
        listed = "; ".join(f"{label} {percent(share)} %" for label, share in shares) or "nothing is random"
        return page.svg(f"Budget at target {target}: shares of the variance", listed + ".")


def draw_levers(levers: Sequence[Lever], check: Check, name: str = "levers", decimals: int = 3) -> str:
    """How far each lever leads a requirement by itself, from its value as it is, with the limit across."""
    what = f"{check.headline}, {check.unit}"
    rows = BarRows.of([lever.label for lever in levers], LETTERS)
    with open_page(name, rows.height + 82) as page:
        axes = rows.axes(page, NAMES, 34, WIDTH - 90, f"estimated {what}")
        axes.set_xlim(0, 1.08 * max(check.value, check.limit, 1e-9))
        for middle, lever in zip(rows.middles, levers, strict=True):
            axes.barh(middle, check.value, height=ROW - 6, color=BAR_PALE)
            axes.barh(middle, lever.value, height=ROW - 6, color=BAR)
            beside(axes, (0.0, middle), decimal(lever.value, decimals), (6, -4))
        ours, theirs = sides(check.value, check.limit)
        upright(axes, check.value, f"as it is {check.value:.{decimals}f}", VALUE_COLOUR, ours)
        upright(axes, check.limit, f"limit {check.limit:g}", LIMIT_COLOUR, theirs, DASHED)
        listed = "; ".join(f"{lever.label} {lever.value:.{decimals}f}" for lever in levers)
        return page.svg(f"{check.requirement}: how far each lever leads by itself", f"{what}: {listed}.")


# --- the error ------------------------------------------------------------------------------------


def draw_distribution(
    shown: ErrorDistribution, p95_mm: float, interval_mm: tuple[float, float | None] | None, limit_mm: float | None,
    name: str, decimals: int = 3,
) -> str:  # fmt: skip
    """Histogram of the sampled errors and the first-order law, with P95, its interval and the limit."""
    edges, wide = shown.edges_mm, shown.edges_mm[1] - shown.edges_mm[0]
    words = f"Error at target {shown.target}: the estimated distribution is drawn as a line"
    with open_page(name, 316) as page:
        axes = page.axes(LEFT, 44, RIGHT, 254, "error at the tool, mm")
        page.say(8, 16, "density, 1/mm", color=MUTED)
        axes.set_xlim(edges[0], max(edges[-1], 1.2 * (limit_mm or 0.0)))
        middles = [edge + wide / 2 for edge in edges[:-1]]
        law = axes.plot(middles, [share / wide for share in shown.first_order], color=LAW_COLOUR, clip_on=False)
        legend: list[tuple[Any, str]] = [(law[0], "estimate")]
        if shown.sampled is not None:
            beyond = [limit_mm is not None and edge >= limit_mm for edge in edges[:-1]]
            axes.bar(
                edges[:-1], [share / wide for share in shown.sampled], wide, align="edge", edgecolor=BAR, linewidth=0.6,
                color=[BAR_BEYOND if far else BAR_PALE for far in beyond],
            )  # fmt: skip
            bars = page.patch(facecolor=BAR_PALE, edgecolor=BAR, linewidth=0.6)
            legend.append((bars, f"Monte Carlo, {shown.trials:,} trials"))
            words += f", {shown.trials:,} Monte Carlo trials as bars"
        if interval_mm is not None and interval_mm[1] is not None:
            least = (axes.get_xlim()[1] - edges[0]) / (RIGHT - LEFT)
            ends = (interval_mm[0], max(interval_mm[1], interval_mm[0] + least))
            band = axes.axvspan(*ends, color=VALUE_COLOUR, alpha=0.18)
            written = " to ".join(f"{end:.{decimals}f}" for end in (interval_mm[0], interval_mm[1]))
            legend.append((band, f"interval of P95, {written} mm"))
        highest = max(share / wide for shares in (shown.sampled, shown.first_order) for share in shares or ())
        axes.set_ylim(0, 1.08 * highest)
        ours, theirs = sides(p95_mm, limit_mm)
        upright(axes, p95_mm, f"P95 {p95_mm:.{decimals}f} mm", VALUE_COLOUR, ours)
        if limit_mm is not None:
            upright(axes, limit_mm, f"limit {limit_mm:g} mm", LIMIT_COLOUR, theirs, DASHED)
        page.explain(LEFT, 294, legend)
        limit = "" if limit_mm is None else f", the limit {limit_mm:g} mm"
        words += f". P95 is {p95_mm:.{decimals}f} mm{limit}."
        return page.svg(f"Distribution of the error at target {shown.target}", words)


PHONE = 360  # width of a page for a narrow screen


def draw_scale(
    shown: Headline, others: Sequence[tuple[str, float]], name: str, width: float = WIDTH, decimals: int = 3
) -> str:
    """What decides, with its interval, on one scale with the limit, on a page so wide.

    others: further numbers in its unit, by name.  decimals: of what is written.
    """
    value, limit, (low, high), unit = shown.value, shown.limit, shown.interval, shown.unit
    end = 1.3 * max(value, high or 0.0, limit or 0.0, *(at for _, at in others), 1e-9)
    left, right_edge, y = 22, width - (WIDTH - RIGHT), 56
    with open_page(name, 136, width) as page:
        of_error = unit == MEASURE[shown.error].unit
        title = f"{ERRORS[shown.error].removeprefix('the ') if of_error else shown.headline}, {unit}"
        axes = page.axes(left, 22, right_edge, 96, title)
        axes.grid(False)
        axes.yaxis.set_visible(False)
        axes.set(xlim=(0, end), ylim=(96, 22))
        per_mm = (right_edge - left) / end
        if limit is not None:
            axes.barh(y, limit, height=32, color=WITHIN)
            axes.barh(y, end - limit, left=limit, height=32, color=BEYOND)
            upright(axes, limit, f"limit {limit:g} {unit}", LIMIT_COLOUR, "left" if limit < value else "right", DASHED)
        top = end if high is None else high
        axes.plot([low, top], [y, y], color=VALUE_COLOUR, linewidth=4)
        axes.plot([low, top], [y, y], "|", color=VALUE_COLOUR, markersize=16, markeredgewidth=2, clip_on=False)
        axes.plot(value, y, "o", color=VALUE_COLOUR, markersize=10, markeredgewidth=0)
        short = f"{value:.{decimals}f} {unit}"
        label, middle, above = _place_label(shown, short, top, end, per_mm)
        beside(axes, (middle, y), label, (0, 9 if above else -4), ha="center", color=VALUE_COLOUR, weight="bold")
        for words, at in others:
            axes.plot(at, 88.5, "^", color=INK, markersize=8, markeredgewidth=0)
            near = limit is not None and abs(at - limit) * per_mm < 0.35 * FONT * len(words)
            aside = "center" if not near or limit is None else "right" if at < limit else "left"
            beside(axes, (at, 82), words, ({"right": 3, "left": -3}.get(aside, 0), 0), ha=aside)
        words = f"{shown.headline} at target {shown.target} is {short}"
        words += "" if high is None else f", between {low:.{decimals}f} and {high:.{decimals}f} {unit}"
        words += "" if limit is None else f"; the limit is {limit:g} {unit}"
        words += "".join(f"; {other} {at:.{decimals}f} {unit}" for other, at in others) + "."
        return page.svg(f"{shown.headline} and limit at target {shown.target}", words)


def _place_label(shown: Headline, short: str, top: float, end: float, per_mm: float) -> tuple[str, float, bool]:
    """The value's label, its middle on the scale from 0 to ``end``, and whether it stands above the mark.

    It stands beside the bar and on one side of the limit's line, ``short`` where there is no room for its name.
    """
    value, limit, gap = shown.value, shown.limit, 8 / per_mm
    after, before = max(top, value + 5 / per_mm) + gap, min(shown.interval[0], value - 5 / per_mm) - gap
    edges = [0.0, *([] if limit is None else [limit]), end]
    for label in (f"{shown.headline} {short}", short):
        half = (CHARACTER * 1.08 * FONT * columns(label) + 10) / per_mm / 2
        sides = [before - half, after + half]
        for middle in reversed(sides) if limit is not None and limit < value else sides:
            if any(low <= middle - half and middle + half <= high for low, high in pairwise(edges)):
                return label, middle, False
    low, high = max(pairwise(edges), key=lambda side: (side[0] <= value <= side[1], side[1] - side[0]))
    return label, min(max(value, low + half), max(high - half, low + half)), True


DOTS_LEFT, TALLEST, LETTER = 22, 96, 6.6  # margin, height of the highest heap, width of a letter
FEWEST_COLUMNS, MOST_COLUMNS = 16, 400  # of dots


def draw_dots(rows: Sequence[tuple[str, FiftyShots]], name: str = "fifty-shots", width: float = WIDTH) -> str:
    """Fifty shots that stand for all, as dots in heaps: what a clinician reads a probability from most accurately.

    Rows of words and dots stand below one another, all of one unit, on one scale; dots that miss the limit differ in
    colour and in shape.  Fernandes et al., Uncertainty displays using quantile dotplots, CHI 2018.
    """
    wide = width - 2 * DOTS_LEFT
    known = [value for _, shots in rows for value in shots.values if value is not None]
    end = 1.02 * max([1e-9, *known, *(1.25 * shots.limit for _, shots in rows)])
    for across in range(FEWEST_COLUMNS, MOST_COLUMNS):
        heaps = [_heap(shots, end, end / across) for _, shots in rows]
        tall = max(count for heap in heaps for count in heap.values())
        if tall * wide / across <= TALLEST:
            break
    step, size = end / across, wide / across
    height = tall * size + 66
    with open_page(name, height * len(rows) + 20, width) as page:
        for k, ((words, shots), heap) in enumerate(zip(rows, heaps, strict=True)):
            top = k * height
            title = f"{shots.of.removeprefix('the ')}, {shots.unit}" if k == len(rows) - 1 else ""
            page.say(DOTS_LEFT, top + 12, printable(words, int(wide / LETTER)), weight="bold")
            axes = page.axes(DOTS_LEFT, top + 34, width - DOTS_LEFT, top + height - 32, title)
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


# --- two designs ----------------------------------------------------------------------------------

SOURCES = 218  # width of the names of sources on the page


def draw_budgets(
    first: TargetScore, second: TargetScore, called: Pair = ("before", "after"), name: str = "budgets",
    decimals: int = 3,
) -> str:  # fmt: skip
    """Standard deviation that each source adds at a target, in both designs; what only one of them has is there too."""
    both = [_spreads(target) for target in (first, second)]
    keys = sorted({**both[0], **both[1]}, key=lambda key: -max(each.get(key, 0.0) for each in both))
    labels = {(e.name, e.component): source_name(e) for target in (first, second) for e in target.contributors}
    spreads: list[tuple[str, list[float | None]]] = [
        (labels[key], [each.get(key) for each in both]) for key in keys[:MOST_BARS]
    ]

    def together(keys: Sequence[tuple[str, str]]) -> list[float | None]:
        return [sqrt(sum(each.get(key, 0.0) ** 2 for key in keys)) for each in both]

    if len(keys) > MOST_BARS:
        spreads.append((f"{len(keys) - MOST_BARS} more together", together(keys[MOST_BARS:])))
    spreads.append(("all together", together(keys)))
    rows = BarRows.of([label for label, _ in spreads], 32, ROW + 8)
    with open_page(name, rows.height + 86) as page:
        title = "standard deviation of the error at the tool, mm; the parts add as squares"
        axes = rows.axes(page, SOURCES, 34, WIDTH - 66, title)
        across = WIDTH - 66 - SOURCES
        axes.set_xlim(0, 1.04 * max(value or 0.0 for _, values in spreads for value in (*values, 1e-9)))
        least = axes.get_xlim()[1] / across
        for middle, (_, values) in zip(rows.middles, spreads, strict=True):
            for value, shift, colour in zip(values, (-5.5, 5.5), (FIRST_BAR, BAR), strict=True):
                if value:
                    axes.barh(middle + shift, max(value, least), height=10, color=colour)
                look: dict[str, Any] = {"color": MUTED if value is None else INK, "size": 10}
                beside(axes, (value or 0.0, middle + shift), _spread(value, decimals), (5, -3.5), **look)
        axes.axhline(rows.middles[-1] - ROW / 2 - 4, -210 / across, 1, color=FAINT, linewidth=0.8, clip_on=False)
        samples = [page.patch(color=colour) for colour in (FIRST_BAR, BAR)]
        page.explain(12, 6, [(sample, printable(words, 50)) for sample, words in zip(samples, called, strict=True)])
        listed = "; ".join(f"{label} {' and '.join(_spread(v, decimals) for v in values)}" for label, values in spreads)
        words = f"Standard deviations in mm, {called[0]} and {called[1]}: {listed}."
        return page.svg(f"Budgets at target {second.name}, {called[0]} and {called[1]}", words)


def _spreads(target: TargetScore) -> dict[tuple[str, str], float]:
    """mm by contributor and component; those without spread are left out."""
    total = sum(target.covariance_mm2[k][k] for k in range(3))
    spreads = {
        (entry.name, entry.component): sqrt(max(entry.variance_share * total, 0.0))
        for entry in single_lines(target.contributors)
    }
    return {key: value for key, value in spreads.items() if value > 0}


def _spread(value: float | None, decimals: int) -> str:
    return "not there" if value is None else decimal(value, decimals)


def draw_errors(
    first: ErrorDistribution, second: ErrorDistribution, p95_mm: tuple[float, float], limit_mm: float | None,
    called: Pair = ("before", "after"), name: str = "distributions", decimals: int = 3,
) -> str:  # fmt: skip
    """Both errors over one another: sampled shares as outlines where trials were drawn, else the first-order law."""
    sampled = first.sampled is not None and second.sampled is not None
    both = []
    for entry in (first, second):
        shares = (entry.sampled if sampled else None) or entry.first_order
        both.append([share / (b - a) for share, a, b in zip(shares, entry.edges_mm, entry.edges_mm[1:], strict=False)])
    with open_page(name, 304) as page:
        title = f"error at the tool, target {printable(second.target, 40)}, mm"
        axes = page.axes(LEFT, 62, RIGHT, 262, title)
        page.say(8, 54, "density, 1/mm", color=MUTED)
        axes.set_xlim(0, max(first.edges_mm[-1], second.edges_mm[-1], 1.1 * (limit_mm or 0.0)))
        axes.set_ylim(0, 1.06 * max(map(max, both)))
        axes.stairs(both[1], second.edges_mm[: len(both[1]) + 1], fill=True, color=BAR_PALE, alpha=0.6)
        marks = []
        looks = ((FIRST_LINE, DASHED), (VALUE_COLOUR, "-"))
        drawn = zip((first, second), both, p95_mm, called, looks, strict=True)
        for entry, values, p95, words, (colour, dashes) in drawn:
            edges = entry.edges_mm[: len(values) + 1]
            axes.stairs(values, edges, color=colour, linewidth=1.5, linestyle=dashes)
            axes.axvline(p95, color=colour, linewidth=1.6, linestyle=dashes)
            sample = page.sample(color=colour, linestyle=dashes)
            marks.append((sample, f"{printable(words, 34)}, P95 {p95:.{decimals}f} mm"))
        if limit_mm is not None:
            axes.axvline(limit_mm, color=LIMIT_COLOUR, linewidth=1.6, linestyle=DOTTED)
            marks.append((page.sample(color=LIMIT_COLOUR, linestyle=DOTTED), f"limit {limit_mm:g} mm"))
        page.explain(12, 7, marks, labelcolor="linecolor", prop={"weight": "bold", "size": FONT})
        how = f"Monte Carlo in bins, {first.trials:,} and {second.trials:,} trials" if sampled else "estimate"
        page.say(12, 38, f"{how}; upright lines: {'P95' if limit_mm is None else 'P95 and limit'}", color=MUTED)
        both_p95 = " and ".join(f"{p95:.{decimals}f} mm {words}" for p95, words in zip(p95_mm, called, strict=True))
        words = f"P95 is {both_p95}; {how}."
        words += "" if limit_mm is None else f" The limit is {limit_mm:g} mm."
        return page.svg(f"Errors at target {second.target}, {called[0]} and {called[1]}", words)


# --- sweeps ---------------------------------------------------------------------------------------

MOST_CURVES = 6
MOST_CELLS = 40  # of a map, along each axis
PALE, DARK = (228, 239, 248), (0, 62, 107)


def refuse_undrawable(axes: Sequence[Sequence[float]]) -> None:
    """Before the work: values of every axis of a sweep that no figure can show.  Raises RequestError."""
    wide = [values for values in axes if len(set(values)) > 1]
    if len(wide) not in (1, 2) or any(len(set(values)) < len(values) for values in axes):
        detail = f"a figure shows one or two axes of several different values; this sweep has {len(wide)}"
        raise RequestError(Problem("", "no-figure", detail, "take fewer axes, or --csv for a program that draws"))
    longest = max(map(len, wide))
    if min(map(len, wide)) > MOST_CURVES and len(wide) == 2 and longest > MOST_CELLS:
        detail = f"a map has at most {MOST_CELLS} values along an axis; this sweep has {longest}"
        raise RequestError(Problem("", "no-figure", detail, "take fewer values, or --csv for a program that draws"))


def draw_sweep(sweep: Sweep, name: str = "sweep") -> str:
    """P95 of the TCP error over one axis of several values, or two: curves, or a map where both have many.

    Raises RequestError for more axes, or for none, and where every point was refused.
    """
    refuse_undrawable([axis.values for axis in sweep.axes])
    if not any(point.targets for point in sweep.points):
        raise RequestError(Problem("", "no-figure", "every point was refused: there is nothing to draw"))
    wide = [place for place, axis in enumerate(sweep.axes) if len(axis.values) > 1]
    if len(wide) == 2 and min(len(sweep.axes[place].values) for place in wide) > MOST_CURVES:
        return _draw_map(sweep, wide[0], wide[1], name)
    return _draw_curves(sweep, wide, name)


def _axis_name(axis: SweepAxis) -> str:
    return printable(axis.label + (f", {axis.unit}" if axis.unit else ""), LONGEST)


def _how(sweep: Sweep) -> str:
    return "estimate" if sweep.check == "score" else f"Monte Carlo, seed {sweep.seed}; bars: intervals"


def _sweep_title(sweep: Sweep) -> str:
    return f"Sweep: {sweep.provenance.design_name}"


def find_worst(point: SweepPoint) -> SweepTarget:
    return max(point.targets, key=lambda target: target.p95_mm)


def _draw_curves(sweep: Sweep, wide: Sequence[int], name: str) -> str:
    """Targets are curves where one axis varies; where two do, the values of the shorter one, at the worst target."""
    along = max(wide, key=lambda place: (len(sweep.axes[place].values), place))
    other = next((place for place in wide if place != along), None)
    curves: dict[str, list[tuple[float, SweepTarget, bool]]] = {}
    for point in sorted(sweep.points, key=lambda point: point.values[along]):
        x, fails = point.values[along], point.verdict == "fail"
        if other is None:
            for target in point.targets:
                curves.setdefault(target.name, []).append((x, target, fails))
        elif point.targets:  # without targets it was refused: a gap
            unit = f" {sweep.axes[other].unit}" if sweep.axes[other].unit else ""
            curves.setdefault(f"{point.values[other]:g}{unit}", []).append((x, find_worst(point), fails))
    shown = _how(sweep)
    if other is not None:
        shown += f"; curves: {_axis_name(sweep.axes[other])}; the target with the largest P95"
    elif len(curves) > MOST_CURVES:
        shown += f"; the {MOST_CURVES} of {len(curves)} targets with the largest P95"
        largest = {label: max(target.p95_mm for _, target, _ in curve) for label, curve in curves.items()}
        curves = {label: curves[label] for label in sorted(curves, key=lambda label: -largest[label])[:MOST_CURVES]}
    refused = sum(not point.targets for point in sweep.points)
    if refused:
        shown += f"; {refused} of {len(sweep.points)} points were refused and are not drawn"
    fails = any(failing for curve in curves.values() for *_, failing in curve)
    axis = _axis_name(sweep.axes[along])
    with titled_page(name, _sweep_title(sweep), shown, 352) as (page, top):
        if fails:
            ring = page.sample(marker="o", linestyle="", color=INK, **RING)
            page.explain(15, top + 6, [(ring, "the design fails a requirement there")])
        page.say(64, top + 36, "P95 of the error at the tool", weight="bold")
        axes = page.axes(70, top + 62, 660, top + 312, axis, "P95, mm")
        ends = []
        for k, (label, curve) in enumerate(curves.items()):
            colour = COLOURS[k % len(COLOURS)]
            _draw_curve(axes, curve, colour)
            ends.append((label, curve[-1][1].p95_mm, colour))
        low, high = axes.dataLim.intervalx
        beside_ends = 0.05 * (high - low) or 1.0  # of one point, where the others were refused
        axes.set_xlim(low - beside_ends, high + beside_ends)
        limits = sweep.limits()
        axes.set_ylim(0, 1.06 * max([axes.dataLim.y1, *(limit for limit, _ in limits)]))
        for limit, words in limits:
            axes.axhline(limit, color=LIMIT_COLOUR, linewidth=1.4, linestyle=DASHED, zorder=1)
            beside(axes, (0.0, limit), f"{words} {limit:g} mm", (4, 3), of="y", color=LIMIT_COLOUR)
        name_at_right(axes, ends, 32)
        base = sweep.axes[along].base
        if base is not None and axes.get_xlim()[0] <= base <= axes.get_xlim()[1]:
            axes.axvline(base, color=FAINT, linewidth=1, linestyle=SHORT, zorder=1)
            beside(axes, (base, 0.0), "as designed", (4, 5), of="x", color=MUTED)
        words = "; ".join(
            f"{label}: {curve[0][1].p95_mm:.4g} mm at {curve[0][0]:g}, {curve[-1][1].p95_mm:.4g} mm at {curve[-1][0]:g}"
            for label, curve in curves.items()
        )
        return page.svg(_sweep_title(sweep), f"P95 over {axis}; {shown}. {words}.")


def _draw_curve(axes: Axes, curve: Sequence[tuple[float, SweepTarget, bool]], colour: str) -> None:
    x, y = [at for at, *_ in curve], [target.p95_mm for _, target, _ in curve]
    ends = [target.p95_interval_mm or (target.p95_mm, target.p95_mm) for _, target, _ in curve]
    if any(low < high for low, high in ends):
        # none to an end on the wrong side, as a record that somebody changed may have
        below = [max(0.0, at - low) for at, (low, _) in zip(y, ends, strict=True)]
        above = [max(0.0, high - at) for at, (_, high) in zip(y, ends, strict=True)]
        axes.errorbar(x, y, [below, above], fmt="none", ecolor=colour, elinewidth=1.2, capsize=3, capthick=1.2)
    axes.plot(x, y, "-o", color=colour)
    rings = [(at, target.p95_mm) for at, target, fails in curve if fails]
    if rings:
        axes.plot(*zip(*rings, strict=True), "o", color=colour, **RING)


def _draw_map(sweep: Sweep, down: int, across: int, name: str) -> str:
    """Cells coloured by P95 of the worst target."""
    columns, rows = (sorted(sweep.axes[place].values) for place in (across, down))
    values = {(p.values[across], p.values[down]): find_worst(p).p95_mm for p in sweep.points if p.targets}
    low, high = min(values.values()), max(values.values())
    wide, tall = 710 / len(columns), max(300 / len(rows), 14.0)
    cells = []
    for k, column in enumerate(columns):
        for j, row in enumerate(rows):
            value = values.get((column, row))
            share = 0.0 if value is None or isclose(high, low) else (value - low) / (high - low)
            words = number(value, 3) if value is not None and wide >= 40 else ""
            cells.append((k, j, "" if value is None else shade(share), words, "#ffffff" if share > 0.45 else INK))
    about = f"{_how(sweep)}; empty: refused"
    with titled_page(name, _sweep_title(sweep), about, 114 + tall * len(rows)) as (page, top):
        page.say(15, top + 14, "P95 of the error at the tool, mm, at the target where it is largest", weight="bold")
        marks = [(page.patch(color=shade(k / 4)), number(low + (high - low) * k / 4, 3)) for k in range(5)]
        page.explain(15, top + 24, marks)
        page.say(15, top + 56, f"up: {_axis_name(sweep.axes[down])}", color=MUTED)
        foot = top + 66 + tall * len(rows)
        axes = page.axes(70, top + 66, 780, foot, _axis_name(sweep.axes[across]))
        axes.set(xlim=(0, len(columns)), ylim=(0, len(rows)))
        axes.grid(False)
        axes.spines["bottom"].set_visible(False)
        every = max(len(columns) // 12, 1)
        places = range(0, len(columns), every)
        axes.set_xticks([k + 0.5 for k in places], [f"{columns[k]:.4g}" for k in places])
        axes.set_yticks([j + 0.5 for j in range(len(rows))], [f"{row:.4g}" for row in rows])
        axes.tick_params(length=0)
        draw_cells(axes, cells)
        over = f"{_axis_name(sweep.axes[down])} and {_axis_name(sweep.axes[across])}"
        return page.svg(_sweep_title(sweep), f"P95 from {low:.4g} to {high:.4g} mm over {over}.")


def shade(share: float) -> str:
    """From pale to dark, so that a print in grey keeps the order."""
    return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(PALE, DARK, strict=True))
