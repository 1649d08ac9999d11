"""Installation error and noise together against the parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from tailstack.results import ERRORS
from tailstack.results.digits import count_decimals, percent
from tailstack.results.look import BLUE, INK, MUTED, VERMILION
from tailstack.results.tables import EVERYWHERE, IN_DETAIL, LONG_TABLE, PAPER, Column, On, Table, fill
from tailstack.studies.coupling import CouplingCase, Ratio, StudyCoupling

from ...rendering.document import Document, Facts, KeyNumber, Paragraph, Section, compose_study
from ..page import beside, titled_page
from ..svg import broken

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIMULATED = 0.003  # a quarter of a million trials know P95 so well
READINGS = {
    "physical": "the structure really moves, and its images with it",
    "eq18": "the coordinates that are assumed move, the images do not",
}
MOVED = {"physical": "the structure", "eq18": "coordinates alone"}
Which = Callable[[CouplingCase], Ratio | None]  # None: of what there is none
COMPARISONS: tuple[tuple[str, str, Which], ...] = (
    ("noise gain", "biased over nominal geometry", lambda case: case.gain),
    ("P95 over quadrature", "root of the sum of squares of the parts", lambda case: case.against_quadrature),
    ("P95 over plain sum", "sum of both P95", lambda case: case.against_sum),
    ("P95 over vector sum", "parts added as vectors, trial by trial", lambda case: case.against_vector_sum),
    ("P95 over first order", "law of |bias + noise|", lambda case: case.against_first_order),
)


def coupling_document(study: StudyCoupling, sha256: str, target: str | None = None) -> Document:
    """P95 of the parts and together, and every ratio with its interval.

    target: whose cases a terminal shows; by default the one with the largest P95 as designed.
    """
    shown = cases_of(study, target)
    designed = next(case for case in shown if case.rotation_deg is None)
    levels = dict.fromkeys(
        (case.rotation_deg, case.translation_mm) for case in study.cases if case.rotation_deg is not None
    )
    options = " ".join(f"--level {rotation:g},{translation:g}" for rotation, translation in levels)
    others = len({case.target for case in study.cases}) - 1
    more = f" (and {others} more targets, with --json or in a report)" if others else ""
    return compose_study(
        study,
        sha256,
        "installation error and noise together",
        question="Do installation error and image noise together make more error than each by itself lets expect?",
        method=f"installation error and noise together against the parts · {study.trials:,} trials of each case, seed "
        f"{study.seed} · both readings",
        sentences=study.conclusions,
        numbers=(
            KeyNumber("Together", f"{designed.p95_together_mm:.3f} mm", f"P95 at {designed.target}, as designed"),
            KeyNumber("Installation alone", f"{designed.p95_installation_mm:.3f} mm", "P95"),
            KeyNumber("Noise alone", f"{designed.p95_noise_mm:.3f} mm", "P95"),
        ),
        figure=("coupling", partial(draw_coupling, study), "P95 of both together against the parts, with intervals."),
        sections=(
            Section("Parts", (Facts("Parts", (("installation", study.installation), ("noise", study.noise))),)),
            Section("Readings", (Facts("Readings", tuple(READINGS.items())),), on=IN_DETAIL),
            Section("P95 of the parts and together", (parts_table(study, shown, more),)),
            Section("Ratios", (ratios_table(study, shown),), on=On.DETAIL | PAPER),
        ),
        command=f"tailstack study coupling design.yaml {options} --error {study.error} --trials {study.trials} --seed "
        f"{study.seed} --json",
        about=(Paragraph(f"Intervals: {study.interval_method}. First order: {study.validity.statement}."),),
    )


def cases_of(study: StudyCoupling, target: str | None) -> tuple[CouplingCase, ...]:
    """Those at a target; by default the one with the largest P95 as designed."""
    if target is None:
        designed = [case for case in study.cases if case.rotation_deg is None]
        target = max(designed, key=lambda case: case.p95_together_mm).target
    return tuple(case for case in study.cases if case.target == target)


def parts_table(study: StudyCoupling, shown: Sequence[CouplingCase], more: str) -> Table:
    """P95 of the parts, of both, and the noise's root mean square; a terminal has the cases of one target."""
    decimals = count_decimals(min(case.p95_together_mm for case in study.cases), SIMULATED)

    def column(title: str, brief: str, of: Callable[[CouplingCase], float | None], on: On = EVERYWHERE) -> Column:
        return Column(title, "mm", "fixed", decimals, on, brief, of=of)

    columns = (
        Column("Target", on=PAPER, of=lambda case: case.target),
        Column("Installation error", brief="installation\nerror", of=lambda case: case.installation),
        Column("What moves", on=On.PLAIN, brief="what moves", of=lambda case: MOVED[case.reading]),
        Column("Reading", on=IN_DETAIL, of=lambda case: case.reading),
        column("Alone", "installation\nalone, mm", lambda case: case.p95_installation_mm),
        column("Noise alone", "noise\nalone, mm", lambda case: case.p95_noise_mm),
        column("Together", "both\ntogether, mm", lambda case: case.p95_together_mm),
        column("Added as vectors", "added shot\nby shot, mm", lambda case: case.p95_vector_sum_mm),
        column("Estimate", "first\norder, mm", lambda case: case.p95_first_order_mm, IN_DETAIL),
        column("Noise rms nominal", "noise rms\nnominal, mm", lambda case: case.noise_rms_nominal_mm, IN_DETAIL),
        column("Noise rms biased", "noise rms\nbiased, mm", lambda case: case.noise_rms_biased_mm, IN_DETAIL),
    )
    rows = tuple(fill(columns, case, on=EVERYWHERE if case in shown else PAPER) for case in study.cases)
    caption = f"P95 of {ERRORS[study.error]} at {shown[0].target}{more}, and the noise's root mean square"
    return Table("Parts", caption, columns, rows, most=LONG_TABLE)


class _Compared(NamedTuple):
    case: CouplingCase
    name: str
    ratio: Ratio


def ratios_table(study: StudyCoupling, shown: Sequence[CouplingCase]) -> Table:
    """Every ratio with its interval; a terminal has the cases of one target."""
    columns = (
        Column("Target", on=PAPER, of=lambda row: row.case.target),
        Column("Installation error", of=lambda row: row.case.installation),
        Column("Reading", of=lambda row: row.case.reading),
        Column("Ratio of", brief="ratio of\n", of=lambda row: row.name),
        Column("Value", kind="fixed", digits=4, of=lambda row: row.ratio.value),
        Column("From", kind="fixed", digits=4, of=lambda row: row.ratio.interval[0]),
        Column("To", kind="fixed", digits=4, of=lambda row: row.ratio.interval[1]),
        Column("Estimate", kind="fixed", digits=4, of=lambda row: row.ratio.first_order),
    )
    rows = tuple(
        fill(columns, _Compared(case, name, ratio), on=EVERYWHERE if case in shown else PAPER)
        for case in study.cases
        for name, _, which in COMPARISONS
        if (ratio := which(case)) is not None
    )
    caption = f"Ratios, each with its {100 * study.confidence:g} % interval by itself"
    return Table("Ratios", caption, columns, rows, most=LONG_TABLE)


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
        return page.svg(title, " ".join(study.conclusions))


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
