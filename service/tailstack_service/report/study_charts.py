"""The charts of studies: the bench, linearity, coupling, views, the paper's tables.  Each SVG stands by itself."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from statistics import median
from typing import TYPE_CHECKING, Any

from tailstack.results.look import BLUE, COLOURS, FAINT, INK, MUTED, VERMILION
from tailstack.studies.bench.compare import StudyComparison
from tailstack.studies.bench.levels import LevelCompared
from tailstack.studies.coupling import Ratio, StudyCoupling
from tailstack.studies.linearity import LinearityPoint, StudyLinearity, Within
from tailstack.studies.paper.reproduce import Geometry, PaperCell, StudyPaper
from tailstack.studies.views import StudyViews, ViewMap, maps_of

from ..rendering.studies.coupling import COMPARISONS, cases_of
from ..rendering.studies.linearity import deviation, points_by_place
from ..rendering.tables import percent, shorten
from .charts import shade
from .page import DASHED, DOTTED, beside, draw_cells, name_at_right, titled_page
from .svg import broken

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .matplotlib_svg import Chart

RING: dict[str, Any] = {"markerfacecolor": "#ffffff", "markersize": 6.4}

# --- bench measurements ---------------------------------------------------------------------------

SIDE, GAP = 300, 84  # of a panel; between two
MOST_PANELS = 6
BAND = "#dbe8f3"


def draw_bench(study: StudyComparison) -> str:
    """Mean error by level beside what such benches would give; ordered errors against simulated ones."""
    every = [level for level in study.levels if level.quantiles]
    with_tail = every[:MOST_PANELS]
    columns = min(1 + len(with_tail), 4)
    rows = -(-(1 + len(with_tail)) // columns)
    left_out = f"; tails of the first {MOST_PANELS} of {len(every)} levels" if len(every) > MOST_PANELS else ""
    about = f"{study.provenance.design_name}; {study.file.name}; {study.error} error{left_out}"
    width = max(100 + columns * (SIDE + GAP) - GAP, 720)
    title = "Bench measurements against prediction"
    with titled_page("study", title, about, rows * (SIDE + 100) + 40, width) as (page, top):

        def panel(number: int, heading: str, x: str, y: str) -> Axes:
            row, column = divmod(number, columns)
            left, upper = 70 + column * (SIDE + GAP), top + 46 + row * (SIDE + 100)
            page.say(left, upper - 26, heading, weight="bold")
            axes = page.axes(left, upper, left + SIDE, upper + SIDE, x, y, grid="y" if number == 0 else "both")
            axes.spines["left"].set_visible(True)
            return axes

        _draw_means(panel(0, "mean error by level", "", "mm"), study.levels)
        for number, level in enumerate(with_tail, 1):
            heading = f"{level.level}, {level.target}: ordered errors, n = {level.trials}"
            axes = panel(number, heading, "predicted (median of simulated benches), mm", "measured, mm")
            _draw_quantiles(axes, level)
        words = " ".join([f"Measurements and prediction: {study.verdict}.", *study.conclusions])
        return page.svg(title, words)


def _draw_means(axes: Axes, levels: Sequence[LevelCompared]) -> None:
    alone = len({level.target for level in levels}) == 1
    letters = max(int(SIDE / max(len(levels), 1) / 7), 3)
    for k, level in enumerate(levels):
        norm, at = level.norm, k + 0.5
        low, high = norm.predicted_range_mm
        half = 16 / SIDE * len(levels)
        axes.bar(at, high - low, 2 * half, bottom=low, color=BAND)
        axes.plot([at - half, at + half], [norm.predicted_mm] * 2, color=VERMILION, linewidth=2)
        if norm.interval_mm is not None:
            axes.plot([at, at], norm.interval_mm, color=BLUE, linewidth=2.2)
            axes.plot([at, at], norm.interval_mm, "_", color=BLUE, markersize=10, markeredgewidth=1)
        axes.plot(at, norm.measured_mm, "o", color=BLUE, markersize=8, markeredgewidth=0)
        for line, words in enumerate(broken(level.level if alone else f"{level.level}, {level.target}", letters)):
            beside(axes, (at, 0.0), words, (0, -16 - 13 * line), of="x", ha="center", color=MUTED)
    axes.set(xlim=(0, max(len(levels), 1)), ylim=(0, 1.06 * axes.dataLim.y1))
    axes.set_xticks([])
    below = max(len(broken(level.level, letters)) for level in levels) if levels else 1
    for line, words in enumerate(
        ("dot and bar: measured, 95 %; line and band: predicted,", "95 % of benches run like this one")
    ):
        beside(axes, (0.0, 0.0), words, (0, -28 - 12 * below - 14 * line), of="axes", ha="left", color=MUTED)


def _draw_quantiles(axes: Axes, level: LevelCompared) -> None:
    points = level.quantiles
    across = [point.predicted_mm for point in points]
    axes.fill_between(
        across, [point.envelope_mm[0] for point in points], [point.envelope_mm[1] for point in points], color=BAND
    )
    for outside in (False, True):
        these = [point for point in points if point.outside == outside]
        look = RING if outside else {}
        x, y = [point.predicted_mm for point in these], [point.measured_mm for point in these]
        axes.plot(x, y, "o", color=BLUE, clip_on=False, **look)
    axes.margins(0.05)
    axes.autoscale_view()
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    ends = max(left, low), min(right, high)
    if ends[0] < ends[1]:
        axes.plot(ends, ends, color=VERMILION, linewidth=1.5, scalex=False, scaley=False)
    words = "band: 95 % of benches at each place; hollow: outside it"
    beside(axes, (0.0, 0.0), words, (0, -54), of="axes", ha="left", color=MUTED)


# --- linearity ------------------------------------------------------------------------------------

# From pale to dark, so that a print in grey keeps the order; text on it stays readable.
FILL: dict[Within, tuple[str, str]] = {
    "1 %": ("#e4f1e8", INK), "5 %": ("#efcf6d", INK), "20 %": ("#e08f4c", INK), "beyond": ("#a5301f", "#ffffff"),
}  # fmt: skip
CELL = (62, 26)  # width and height


def draw_linearity(study: StudyLinearity) -> str:
    """Panels: spread from left to right, count from top to bottom; in each, noise upwards and rotation to the right."""
    across, down = CELL[0] * len(study.rotations_deg), CELL[1] * len(study.noises_px)
    width = max(130 + (across + 22) * len(study.spreads), 800)
    points = points_by_place(study)
    title = f"Estimate over simulation: {study.provenance.design_name}"
    with titled_page("study", title, "", (down + 44) * len(study.counts) + 100, width) as (page, top):
        marks = [
            (
                page.patch(facecolor=fill, edgecolor=FAINT, linewidth=0.5),
                "further off" if w == "beyond" else f"within {w}",
            )
            for w, (fill, _) in FILL.items()
        ]
        page.explain(15, top + 8, marks)
        page.say(470, top + 18, "− optimistic, + pessimistic; ?: the interval leaves it open", color=MUTED)
        for row, count in enumerate(study.counts):
            upper = top + 62 + row * (down + 44)
            page.say(15, upper - 8, f"{count} fiducials", weight="bold")
            for column, spread in enumerate(study.spreads):
                left = 118 + column * (across + 22)
                page.say(left + across / 2, upper - 8, f"spread {spread:g}", ha="center", color=MUTED)
                axes = page.axes(left, upper, left + across, upper + down)
                axes.set(xlim=(0, len(study.rotations_deg)), ylim=(0, len(study.noises_px)))
                axes.grid(False)
                axes.spines["bottom"].set_visible(False)
                axes.set_xticks(
                    [k + 0.5 for k in range(len(study.rotations_deg))], _with_unit(study.rotations_deg, "deg")
                )
                axes.set_yticks([k + 0.5 for k in range(len(study.noises_px))], _with_unit(study.noises_px, "px"))
                axes.tick_params(length=0, labelbottom=row == len(study.counts) - 1, labelleft=column == 0)
                places = [(k, j, points[noise, rotation, spread, count]) for j, noise in enumerate(study.noises_px)
                          for k, rotation in enumerate(study.rotations_deg)]  # fmt: skip
                draw_cells(axes, [(k, j, *_field(point)) for k, j, point in places])
        axis = "standard deviation of the rotations of the structure; up the page: noise of each image coordinate"
        page.say(118, page.height - 14, f"to the right: {axis}", color=MUTED)
        said = " ".join(study.sentences)
        return page.svg(title, f"P95 at target {study.target}, deviation in per cent. {said}")


def _with_unit(values: Sequence[float], unit: str) -> list[str]:
    return [f"{value:g} {unit}" for value in values]


def _field(point: LinearityPoint) -> tuple[str, str, str]:
    """Colour, words and their colour."""
    if point.within is None:
        return "", "refused", MUTED
    fill, ink = FILL[point.within]
    return fill, f"{deviation(point).replace('-', '−')} %{'' if point.sure else ' ?'}", ink


# --- coupling -------------------------------------------------------------------------------------

NAMES, PANEL, ROW = 178, 186, 26


def draw_coupling(study: StudyCoupling, target: str | None = None) -> str:
    """Each ratio with its interval, a row for each installation error and reading; diamonds are first order's own."""
    shown = cases_of(study, target)
    names = [broken(f"{case.installation}, {case.reading}", 25) for case in shown]
    row = max(ROW, 14 * max(map(len, names)) + 6)
    width = NAMES + len(COMPARISONS) * (PANEL + 16) + 10
    title = "Installation error and noise: together against the parts"
    about = f"{study.provenance.design_name}; {study.error} error at {shown[0].target}"
    with titled_page("study", title, about, row * len(shown) + 114, width) as (page, top):
        upper = top + 44
        rows = page.axes(10, upper, width - 10, upper + row * len(shown))
        rows.set_axis_off()
        rows.set(xlim=(0, 1), ylim=(len(shown), 0))
        rows.barh([k + 0.5 for k in range(0, len(shown), 2)], 1, height=1, color="#f6f6f6")
        for k, lines in enumerate(names):
            for line, words in enumerate(lines):
                beside(rows, (0.0, k + 0.5), words, (5, -4 - 14 * (line - (len(lines) - 1) / 2)))
        for column, (name, under, which) in enumerate(COMPARISONS):
            left = NAMES + column * (PANEL + 16)
            page.say(left, upper - 24, name, weight="bold")
            page.say(left, upper - 10, under, color=MUTED, size=10)
            axes = page.axes(left, upper, left + PANEL, upper + row * len(shown), "%", grid="x")
            axes.set_ylim(len(shown), 0)
            axes.spines["top"].set_visible(True)
            _draw_ratios(axes, [which(case) for case in shown])
        note = f"dot and bar: measured, {percent(study.confidence, 0)} % interval, each by itself; diamond: estimate"
        page.say(15, page.height - 14, f"{note}; {study.trials:,} trials each, seed {study.seed}", color=MUTED)
        return page.svg(title, " ".join(case.sentence for case in shown))


def _draw_ratios(axes: Axes, ratios: Sequence[Ratio | None]) -> None:
    """Per cent above or below one."""
    known = [ratio for ratio in ratios if ratio is not None]
    ends = [100 * (end - 1) for ratio in known for end in (*ratio.interval, ratio.first_order or ratio.value)]
    reach = max([0.01, *(abs(end) for end in ends)])
    low, high = min([*ends, -0.05 * reach]), max([*ends, 0.05 * reach])
    axes.set_xlim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    axes.axvline(0, color=INK, linewidth=1.2)
    for row, ratio in enumerate(ratios):
        y = row + 0.5
        if ratio is None:
            beside(axes, (0.5, y), "no standard deviation", (0, -4), of="y", ha="center", color=MUTED, size=10)
            continue
        at, interval = 100 * (ratio.value - 1), [100 * (end - 1) for end in ratio.interval]
        if ratio.first_order is not None:
            first = 100 * (ratio.first_order - 1)
            axes.plot(first, y, "D", markersize=9, color=VERMILION, markerfacecolor="#ffffff", clip_on=False)
        axes.plot(interval, [y, y], color=BLUE, linewidth=2.2)
        axes.plot(interval, [y, y], "|", color=BLUE, markersize=8, markeredgewidth=1.4)
        axes.plot(at, y, "o", color=BLUE, markersize=6.8, markeredgewidth=0)


# --- views ----------------------------------------------------------------------------------------

SQUARE, SHADES = 300, 6


def draw_views(study: StudyViews) -> str:
    """A map for each view that turns and for one more: contours of P95 over the turn to the right and up."""
    maps = maps_of(study)
    rows = -(-len(maps) // 2)
    title = f"P95 over the directions of views: {study.provenance.design_name}"
    about = (
        f"{study.error} error, at the target where it is largest; as designed {study.p95_mm:.3f} mm at {study.target}"
    )
    with titled_page("study-views", title, about, 48 + rows * (SQUARE + 130), 800) as (page, top):
        best = page.sample(marker="*", linestyle="", color=VERMILION, markersize=13)
        hidden = page.sample(marker="x", linestyle="", color=MUTED)
        page.explain(15, top + 6, [(best, "smallest P95"), (hidden, "not allowed: it hides something, mostly")])
        for number, (name, one) in enumerate(maps):
            left, upper = 70 + 390 * (number % 2), top + 106 + (SQUARE + 130) * (number // 2)
            page.say(left - 40, upper - 44, f"{shorten(name, 40)}: P95, mm", weight="bold")
            axes = page.axes(
                left, upper, left + SQUARE, upper + SQUARE, "turned to the right of the image, deg", "up, deg"
            )
            levels = _draw_view_map(axes, one)
            marks = [(page.patch(color=shade(k / SHADES)), f"{level:.3f}") for k, level in enumerate(levels)]
            if marks:
                page.explain(left - 48, upper - 38, marks, columnspacing=0.7, handlelength=0.9, handletextpad=0.3)
        return page.svg(title, " ".join(study.conclusions))


def _draw_view_map(axes: Axes, one: ViewMap) -> list[float]:
    """Contours where a direction and its neighbours are allowed; returns where each shade begins, mm."""
    reach = 1.06 * one.cone_deg
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.grid(False)
    steps = sorted({each.right_deg for each in one.directions})
    values = {(each.right_deg, each.up_deg): each.p95_mm for each in one.directions if each.p95_mm is not None}
    levels: list[float] = []
    if len(steps) > 1 and values:
        low, high = min(values.values()), max(values.values())
        # Where a view comes to look the same way as another, P95 is huge: the last shade takes all of that
        end = min(high, 2 * median(values.values()))
        width = max(end - low, 1e-3 * end) / SHADES
        levels = [low + k * width for k in range(SHADES)]
        field = [[values.get((x, y), nan) for x in steps] for y in steps]
        colours = [shade(k / SHADES) for k in range(SHADES)]
        axes.contourf(steps, steps, field, [*levels, 1.001 * high], colors=colours)
    for each in one.directions:
        look: dict[str, Any] = (
            {"marker": "x", "markersize": 5} if each.p95_mm is None else {"marker": ".", "markersize": 2}
        )
        axes.plot(each.right_deg, each.up_deg, linestyle="", color=MUTED, **look)
    if one.best is not None:
        axes.plot(one.best.right_deg, one.best.up_deg, "*", color=VERMILION, markersize=13, clip_on=False)
    return levels


# --- the paper ------------------------------------------------------------------------------------

SHIFT = 0.1  # px, of one level against the next: their marks would lie on one another
DASHES = ("-", DASHED, DOTTED)
NOT_DRAWN = ("without view", "matrices alone")
FRAME: dict[str, Any] = {
    "marker": "s",
    "linestyle": "",
    "markerfacecolor": "none",
    "markersize": 7.6,
}  # what lies below can be seen


def draw_paper(study: StudyPaper) -> dict[str, str]:
    """File name and SVG of every figure: three for each geometry."""
    files = {}
    for letter, geometry in zip("abcdefgh", study.geometries, strict=False):
        files[f"{letter}_sweeps.svg"] = draw_paper_sweeps(geometry, study)
        files[f"{letter}_levels.svg"] = draw_paper_levels(geometry, study)
        files[f"{letter}_factor.svg"] = draw_paper_factor(geometry)
    return files


def draw_paper_sweeps(geometry: Geometry, study: StudyPaper) -> str:
    """S1: mean and P95 over rotation and over translation."""
    cells = [cell for cell in geometry.cells if cell.table == "S1"]
    title = f"S1: {geometry.name}"
    with titled_page("study", title, "", 364) as (page, top):
        _explain_paper(page, geometry, study, top)
        for place, (along, x) in enumerate(
            (("rotation_deg", "rotation about each axis, deg"), ("translation_mm", "translation, mm"))
        ):
            start = "rotation" if along == "rotation_deg" else "translation"
            left = 62 + 445 * place
            page.say(left - 6, top + 60, f"{start}, 1 px of noise", weight="bold")
            axes = page.axes(left, top + 86, left + 338, top + 312, x, "3-D error, mm")
            ends = []
            for colour, (quantity, name) in zip(COLOURS, (("mean", "mean"), ("p95", "P95")), strict=False):
                these = [cell for cell in cells if cell.row.startswith(start) and cell.quantity == quantity]
                ends.append((name, _draw_series(axes, these, along, name, colour), colour))
            _fit(axes)
            name_at_right(axes, ends, 12)
        words = "; ".join(f"{cell.row}, {cell.quantity}: {cell.value_mm:.4g} mm" for cell in cells)
        return page.svg(title, f"{_words(geometry)}. {words}.")


def draw_paper_levels(geometry: Geometry, study: StudyPaper) -> str:
    """S2: P95 over noise, a line for each level."""
    cells = [cell for cell in geometry.cells if cell.table == "S2"]
    levels = list(dict.fromkeys(cell.row.partition(",")[0] for cell in cells))
    title = f"S2: {geometry.name}"
    with titled_page("study", title, "", 364) as (page, top):
        _explain_paper(page, geometry, study, top)
        page.say(56, top + 60, "levels, moved aside a little", weight="bold")
        axes = page.axes(62, top + 86, 680, top + 312, "noise of each image coordinate, px", "P95, mm")
        for k, level in enumerate(levels):
            these = [cell for cell in cells if cell.row.startswith(level)]
            shift, dashes = SHIFT * (k - (len(levels) - 1) / 2), DASHES[k % len(DASHES)]
            name = f"{level}: {these[0].rotation_deg:g} deg, {these[0].translation_mm:g} mm"
            _draw_series(axes, these, "noise_px", name, COLOURS[k], shift, dashes)
        _fit(axes)
        page.explain(694, top + 100, list(zip(*axes.get_legend_handles_labels(), strict=True)), ncols=1)
        words = "; ".join(f"{cell.row}: {cell.value_mm:.4g} mm" for cell in cells)
        return page.svg(title, f"{_words(geometry)}. {words}.")


def draw_paper_factor(geometry: Geometry) -> str:
    """S3: standard deviations per axis, every way of propagating beside Monte Carlo and the printed columns."""
    factor = geometry.factor
    ways = [one for one in factor.propagations if not one.name.startswith(NOT_DRAWN)]
    bars = [("Monte Carlo", factor.monte_carlo_mm), *((one.name, one.std_mm) for one in ways)]
    printed = []
    if factor.printed_monte_carlo_mm is not None and factor.printed_analytic_mm is not None:
        same = next((one.name for one in factor.propagations if one.reproduces_printed), "full")
        printed = [("printed, Monte Carlo", "s", factor.printed_monte_carlo_mm, "Monte Carlo"),
                   ("printed, analytic", "o", factor.printed_analytic_mm, same)]  # fmt: skip
    title = f"S3 at {factor.noise_px:g} px: {geometry.name}"
    with titled_page("study", title, "", 362) as (page, top):
        axes = page.axes(
            62, top + 44, 690, top + 310, "axis of the connector frame", "standard deviation, mm", grid="y"
        )
        wide = 1 / (len(bars) + 1.6)
        marks: list[tuple[Any, str]] = []
        for k, (name, values) in enumerate(bars):
            places = [axis + (0.8 + k + 0.5) * wide for axis in range(3)]
            colour = COLOURS[0] if k == 0 else COLOURS[1 + (k - 1) % 5]
            axes.bar(places, values, 0.94 * wide, color=colour, alpha=0.8)
            marks.append((page.patch(color=colour, alpha=0.8), name))
            for _, shape, theirs, belongs in printed:
                if belongs == name:
                    axes.plot(places, theirs, shape, color=INK, clip_on=False, **RING)
        marks += [(page.sample(marker=shape, linestyle="", color=INK, **RING), name) for name, shape, *_ in printed]
        axes.set(xlim=(0, 3), ylim=(0, 1.06 * axes.dataLim.y1))
        axes.set_xticks([axis + (0.8 + len(bars) / 2) * wide for axis in range(3)], ["x", "y", "z"])
        axes.tick_params(length=0)
        page.explain(712, top + 44, marks, ncols=1, labelspacing=0.7)
        words = "; ".join(f"{name}: {' / '.join(f'{v:.3g}' for v in values)} mm" for name, values in bars)
        return page.svg(title, f"{words}. {factor.sentence}")


def _draw_series(
    axes: Axes, cells: Sequence[PaperCell], along: str, name: str, colour: str, shift: float = 0.0, dashes: Any = "-"
) -> float:
    """Ours as a line, printed values as frames with the half-width of their bands, moved aside; returns the last."""
    places = [float(getattr(cell, along)) + shift for cell in cells]
    axes.plot(
        places,
        [cell.value_mm for cell in cells],
        marker="o",
        markeredgewidth=0,
        linestyle=dashes,
        color=colour,
        label=name,
    )
    printed = [(x, cell) for x, cell in zip(places, cells, strict=True) if cell.printed_mm is not None]
    if printed:
        x, values = [x for x, _ in printed], [cell.printed_mm or 0.0 for _, cell in printed]
        bands = [(cell.band_mm[1] - cell.band_mm[0]) / 2 for _, cell in printed]
        axes.errorbar(x, values, bands, fmt="none", ecolor=colour, elinewidth=1.2, capsize=3, capthick=1.2)
        axes.plot(x, values, color=colour, **FRAME)
    return cells[-1].value_mm


def _fit(axes: Axes) -> None:
    """Some room to the sides; y begins at zero."""
    low, high = axes.dataLim.intervalx
    axes.set(xlim=(low - 0.06 * (high - low), high + 0.06 * (high - low)), ylim=(0, 1.06 * axes.dataLim.y1))
    axes.spines["left"].set_visible(True)


def _words(geometry: Geometry) -> str:
    return "fitted to the printed tables" if geometry.compared else "not compared with the printed tables"


def _explain_paper(page: Chart, geometry: Geometry, study: StudyPaper, top: float) -> None:
    ours = page.sample(marker="o", linestyle="", color=INK)
    marks = [(ours, f"tailstack, Monte Carlo, {study.trials:,} trials")]
    if geometry.compared:
        band = f"{100 * study.band:g} % band of {study.published_trials:,} trials and rounding"
        marks.append((page.sample(color=INK, **FRAME), f"printed, read as metres; bars: {band}"))
    page.explain(52, top + 10, marks)
