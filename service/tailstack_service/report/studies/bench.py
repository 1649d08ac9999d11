"""Bench measurements against prediction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from tailstack.results import ERRORS, Interval
from tailstack.results.digits import percent
from tailstack.results.look import BLUE, MUTED, VERMILION
from tailstack.results.tables import EVERYWHERE, IN_DETAIL, PAPER, Cell, Column, On, Table, fill, tabulate
from tailstack.results.verdicts import findings_table
from tailstack.studies.bench.compare import StudyComparison
from tailstack.studies.bench.levels import LevelCompared

from ...rendering.document import Bullets, Document, Facts, KeyNumber, Paragraph, Section, Tone, compose_study, say
from ...rendering.sentences import trust_sentence
from ...rendering.text import visible
from ..charts import RING
from ..page import beside, titled_page
from ..svg import broken

if TYPE_CHECKING:
    from matplotlib.axes import Axes


TAIL_ROWS, MOST_TAILS = 6, 4  # of a terminal and a page; a spreadsheet has all
_IN_MM = partial(Column, unit="mm", kind="significant", digits=4)
TONE: dict[str, Tone] = {"agrees": "pass", "differs": "fail", "not testable": "inconclusive"}


def comparison_document(study: StudyComparison, sha256: str) -> Document:
    """Means and spreads beside the prediction, every test, and the tail."""
    tests = [test for level in study.levels for test in level.tests]
    file, benches = study.file, max((level.benches for level in study.levels), default=0)
    held = f"against {benches:,} simulated benches, seed {study.seed}" if benches else "beside the prediction"
    of = {level.spread.of for level in study.levels if level.spread is not None}
    spread = "root of the trace of the covariance" if of == {"vectors"} else "standard deviation of the error norm"
    trust = Paragraph(f"How good the prediction is: {trust_sentence(study.validity)}.")
    composed = compose_study(
        study,
        sha256,
        "measurements against prediction",
        tone=TONE[study.verdict],
        status=study.verdict,
        question=f"{visible(file.name)}, {file.rows} rows, {held}: {ERRORS[study.error]}",
        method=f"sha256 {file.sha256[:12]}, {file.form} in {file.unit} · frame {study.frame}",
        sentences=study.conclusions or (f"Measurements and prediction: {study.verdict}.",),
        numbers=(
            KeyNumber("Rows", f"{file.rows:,}", f"{file.form} in {file.unit}"),
            KeyNumber("Levels", f"{len(study.levels):,}", f"{study.error} error"),
            KeyNumber("Tests that differ", f"{sum(test.differs for test in tests):,}", f"of {len(tests):,}"),
        ),
        figure=("bench", partial(draw_comparison, study), "Mean error by level beside what such benches would give."),
        sections=(
            Section("Notes", (say("note", *file.notes),)),
            Section("Means and spreads", (levels_table(study), axes_table(study))),
            Section("Findings", (findings_table(study.findings),), on=PAPER),
            Section("Tests", (tests_table(study.levels),), on=IN_DETAIL),
            Section("The largest errors", (tails_table(study.levels),), on=IN_DETAIL),
            Section("Trust", (trust,), on=On.PLAIN),
        ),
        command=f"tailstack study compare design.yaml --measurements {file.name} --error {study.error} "
        f"--instrument-sd {study.instrument_sd_mm:g} --seed {study.seed} --json",
        about=(
            Facts("Measurements", (("File", file.name), ("SHA-256", file.sha256), ("Frame", study.frame))),
            Paragraph(f"Spread: {spread}. Intervals: {percent(study.confidence, 0)} % each."),
            Paragraph(f"First order: {study.validity.statement}."),
            *((Bullets(file.notes),) if file.notes else ()),
        ),
        ending=f"measurements and prediction: {study.verdict}",
    )
    return replace(composed, findings=study.findings)


def _end(interval: Interval | None, end: int) -> float | None:
    return None if interval is None else interval[end]


def levels_table(study: StudyComparison) -> Table:
    """Size of the error at each level: its mean, and its spread over the predicted one."""
    room = On.DETAIL | On.SHEET

    def of_spread(read: Callable[[Any], Cell]) -> Callable[[LevelCompared], Cell]:
        return lambda level: None if level.spread is None else read(level.spread)

    columns = (
        Column("Level", of=lambda level: level.level),
        Column("Target", of=lambda level: level.target),
        Column("Trials", kind="whole", brief="trials\n", of=lambda level: level.trials),
        Column("Installations", kind="whole", brief="instal-\nlations", of=lambda level: level.installations),
        _IN_MM("Mean", of=lambda level: level.norm.measured_mm),
        _IN_MM("From", on=IN_DETAIL, of=lambda level: _end(level.norm.interval_mm, 0)),
        _IN_MM("To", on=IN_DETAIL, of=lambda level: _end(level.norm.interval_mm, 1)),
        _IN_MM("Predicted", of=lambda level: level.norm.predicted_mm),
        _IN_MM("Benches from", brief="benches\nfrom, mm", of=lambda level: level.norm.predicted_range_mm[0]),
        _IN_MM("Benches to", brief="to\nmm", of=lambda level: level.norm.predicted_range_mm[1]),
        Column("Spread ratio", kind="significant", brief="spread\nratio", of=of_spread(lambda spread: spread.ratio)),
        Column("Spread from", kind="significant", on=room, of=of_spread(lambda spread: _end(spread.interval, 0))),
        Column("Spread to", kind="significant", on=room, of=of_spread(lambda spread: _end(spread.interval, 1))),
    )
    caption = (
        "Size of the error: its mean, and its spread from trial to trial over the predicted spread; benches: the range "
        "of such benches"
    )
    return tabulate("Levels", caption, columns, study.levels)


class _AxisOf(NamedTuple):
    """One axis of the mean error of a level."""

    level: LevelCompared
    axis: int

    def at(self, field: str) -> Any:
        """What a vector, or a vector of intervals, of its bias has along it."""
        return getattr(self.level.bias, field)[self.axis]


def axes_table(study: StudyComparison) -> Table:
    def says(row: _AxisOf) -> str:
        low, high = row.at("predicted_range_mm")
        return "" if low <= row.at("measured_mm") <= high else "outside"

    columns = (
        Column("Level", of=lambda row: row.level.level if row.axis == 0 else ""),
        Column("Target", of=lambda row: row.level.target if row.axis == 0 else ""),
        Column("Axis", of=lambda row: "xyz"[row.axis]),
        _IN_MM("Measured", of=lambda row: row.at("measured_mm")),
        _IN_MM("From", on=IN_DETAIL, of=lambda row: row.at("interval_mm")[0]),
        _IN_MM("To", on=IN_DETAIL, of=lambda row: row.at("interval_mm")[1]),
        _IN_MM("Predicted", of=lambda row: row.at("predicted_mm")),
        _IN_MM("Benches from", brief="benches\nfrom, mm", of=lambda row: row.at("predicted_range_mm")[0]),
        _IN_MM("Benches to", brief="to\nmm", of=lambda row: row.at("predicted_range_mm")[1]),
        Column("Remark", brief="", of=says),
    )
    known = [level for level in study.levels if level.bias is not None]
    owner = " and ".join(dict.fromkeys(level.bias.interval_of for level in known if level.bias is not None))
    caption = f"Mean error along each axis, frame {study.frame}; the interval is of the mean of {owner}"
    return tabulate("Axes", caption, columns, [_AxisOf(level, axis) for level in known for axis in range(3)])


class _PartOf(NamedTuple):
    """A test of a level, or a quantile."""

    level: LevelCompared
    part: Any


_LEVEL_OF_PART = (
    Column("Level", of=lambda row: row.level.level),
    Column("Target", of=lambda row: row.level.target),
)


_TOGETHER = attrgetter("part.p_adjusted")


def tests_table(levels: Sequence[LevelCompared]) -> Table:
    columns = (
        *_LEVEL_OF_PART,
        Column("Test", of=lambda row: row.part.test),
        Column("p", kind="significant", digits=2, of=lambda row: row.part.p_value),
        Column("p, all tests together", "", "significant", 2, brief="p, all tests\ntogether", of=_TOGETHER),
        Column("Differs", of=lambda row: "yes" if row.part.differs else "no"),
    )
    rows = [_PartOf(level, test) for level in levels for test in level.tests]
    return tabulate("Tests", "Every test, by itself and all of them together", columns, rows)


def tails_table(levels: Sequence[LevelCompared]) -> Table:
    """Ordered errors against the same places in simulated benches; a page has the largest of the first levels."""
    columns = (
        *_LEVEL_OF_PART,
        Column("Quantile", "%", "percent", 1, brief="quantile\n%", of=lambda row: row.part.probability),
        _IN_MM("Measured", of=lambda row: row.part.measured_mm),
        _IN_MM("Predicted", of=lambda row: row.part.predicted_mm),
        _IN_MM("Benches from", brief="benches\nfrom, mm", of=lambda row: row.part.envelope_mm[0]),
        _IN_MM("Benches to", brief="to\nmm", of=lambda row: row.part.envelope_mm[1]),
        Column("Remark", brief="", of=lambda row: "outside" if row.part.outside else ""),
    )
    with_tail = [level for level in levels if level.quantiles]
    rows = []
    for place, level in enumerate(with_tail):
        large = len(level.quantiles) - TAIL_ROWS if place < MOST_TAILS else len(level.quantiles)
        for k, point in enumerate(level.quantiles):
            rows.append(fill(columns, _PartOf(level, point), on=EVERYWHERE if k >= large else On.SHEET))
    more = f" ({len(with_tail) - MOST_TAILS} more with --json)" if len(with_tail) > MOST_TAILS else ""
    caption = (
        f"Largest errors against the same places in simulated benches (95 % of them){more}; neighbours move together, "
        "so the test called tail is what judges"
    )
    return Table("Tails", caption, columns, tuple(rows))


# --- its chart ----------------------------------------------------------------------------------------------

SIDE, GAP = 300, 84  # of a panel; between two
MOST_PANELS = 6
BAND = "#dbe8f3"


def draw_comparison(study: StudyComparison) -> str:
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
    legend = "dot and bar: measured, 95 %; line and band: predicted,", "95 % of benches run like this one"
    for line, words in enumerate(legend):
        beside(axes, (0.0, 0.0), words, (0, -28 - 12 * below - 14 * line), of="axes", ha="left", color=MUTED)


def _draw_quantiles(axes: Axes, level: LevelCompared) -> None:
    points = level.quantiles
    across = [point.predicted_mm for point in points]
    least, most = ([point.envelope_mm[end] for point in points] for end in (0, 1))
    axes.fill_between(across, least, most, color=BAND)
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
