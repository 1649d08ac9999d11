"""The reach of first order: maps of where the estimate holds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import get_args

from tailstack.results import ERRORS
from tailstack.results.digits import percent
from tailstack.results.look import FAINT, INK, MUTED
from tailstack.results.tables import IN_DETAIL, LONG_TABLE, PAPER, TERMINAL, Cell, Column, On, Row, Table, tabulate
from tailstack.studies.linearity import LinearityPoint, StudyLinearity, Within, is_beyond

from ...rendering.document import Document, KeyNumber, Paragraph, Section, compose_study, say
from ...rendering.text import csv_text, list_reasons, visible
from ..page import draw_cells, titled_page

MARK: dict[Within, str] = {"1 %": " ", "5 %": "~", "20 %": "+", "beyond": "#"}
MOST_REASONS = 8


def linearity_document(study: StudyLinearity, sha256: str) -> Document:
    """A map for each count of fiducials, and every point as a row."""
    evaluated = [point for point in study.points if point.status == "ok"]
    within = [point for point in evaluated if point.within == "1 %" and point.sure]
    promised = [(point, point.promised_percent) for point in evaluated if point.promised_percent is not None]
    broken = [point for point, percents in promised if is_beyond(point, percents / 100)]
    axes = {"noise": study.noises_px, "rotation": study.rotations_deg, "spread": study.spreads, "count": study.counts}
    options = " ".join(f"--{name} {','.join(f'{value:g}' for value in values)}" for name, values in axes.items())
    legend = (
        "By how many % the estimate is off: no mark within 1 %, ~ within 5 %, + within 20 %, # beyond; ? open, as the "
        f"{percent(study.confidence, 0)} % interval reaches across; - refused."
    )
    maps = [map_table(study, count) for count in study.counts]
    caption = "Estimated P95 over the simulated one: where it is within 1, 5 and 20 %."
    refused = list_reasons([point.reason for point in study.points], MOST_REASONS)
    return compose_study(
        study,
        sha256,
        "where the estimate holds",
        question=f"How far the estimate of `tailstack score` can be trusted: P95 of {ERRORS[study.error]} at "
        f"{visible(study.target)}, estimated and simulated.",
        method=f"first order against Monte Carlo, up to {study.trials:,} trials a point, seed {study.seed}",
        sentences=study.sentences or ("No point could be evaluated.",),
        numbers=(
            KeyNumber("Points", f"{len(study.points):,}", f"{len(study.points) - len(evaluated):,} refused"),
            KeyNumber("Within 1 %", f"{len(within):,}", f"of {len(evaluated):,}, by the whole interval"),
            KeyNumber("Promises broken", f"{len(broken):,}", "by the whole interval"),
        ),
        figure=("linearity", partial(draw_linearity, study), caption),
        sections=(
            Section("Maps", (Paragraph(study.varied), Paragraph(legend), *maps), on=TERMINAL | On.PAGE),
            Section("Refused", (say("refused", *refused, on=TERMINAL | On.PAGE),) if refused else ()),
            Section("Every point", (points_table(study),), on=PAPER),
        ),
        command=f"tailstack study linearity design.yaml {options} --error {study.error} --trials {study.trials} --seed "
        f"{study.seed} --json",
        about=(Paragraph(f"Intervals: {study.interval_method}."),),
    )


def points_by_place(study: StudyLinearity) -> dict[tuple[float, float, float, int], LinearityPoint]:
    """By noise, rotation, spread and count."""
    return {(point.noise_px, point.rotation_deg, point.spread, point.fiducials): point for point in study.points}


def write_deviation(point: LinearityPoint) -> str:
    """The deviation in per cent, as many decimals as its interval allows."""
    if point.ratio is None or point.ratio_interval is None:
        return "-"
    half = 50 * (point.ratio_interval[1] - point.ratio_interval[0])
    text = f"{100 * (point.ratio - 1):+.{2 if half < 0.05 else 1 if half < 2 else 0}f}"
    return text if float(text) else text[1:]


def map_table(study: StudyLinearity, count: int) -> Table:
    """Deviations by spread and noise, a column for each rotation."""
    points, rows = points_by_place(study), []
    for spread in study.spreads:
        for noise in study.noises_px:
            here = [points[noise, rotation, spread, count] for rotation in study.rotations_deg]
            cells: list[Cell] = [f"{spread:g}", f"{noise:g}", next((p.nu for p in here if p.nu is not None), None)]
            for point in here:
                mark = " " if point.within is None else MARK[point.within]
                cells.append(f"{write_deviation(point)} {mark}{' ' if point.sure or point.within is None else '?'}")
            rows.append(Row(tuple(cells)))
    columns = (
        Column("Spread", brief=f"{count} fiducials,\nspread"),
        Column("Noise, px", brief="noise\npx"),
        Column("nu", kind="significant", digits=2, brief="nu\n", on=IN_DETAIL),
        *(Column(f"{r:g} deg", "%", "fixed", brief=f"{r:g} deg\n%  ") for r in study.rotations_deg),
    )
    return Table(f"{count} fiducials", f"{count} fiducials: deviation of the estimate", columns, tuple(rows))


def points_table(study: StudyLinearity) -> Table:
    def tell(point: LinearityPoint) -> str:
        return point.status if point.within is None else f"{point.within}{'' if point.sure else ', open'}"

    columns = (
        Column("Fiducials", kind="whole", of=lambda point: point.fiducials),
        Column("Spread", kind="given", of=lambda point: point.spread),
        Column("Noise", "px", "given", of=lambda point: point.noise_px),
        Column("Rotation", "deg", "given", of=lambda point: point.rotation_deg),
        Column("nu", kind="significant", digits=2, of=lambda point: point.nu),
        Column("Estimate", "mm", "significant", 4, of=lambda point: point.first_order_p95_mm),
        Column("Monte Carlo", "mm", "significant", 4, of=lambda point: point.monte_carlo_p95_mm),
        Column("Ratio", kind="fixed", digits=4, of=lambda point: point.ratio),
        Column("Ratio from", kind="fixed", digits=4, of=lambda point: point.ratio_interval and point.ratio_interval[0]),
        Column("Ratio to", kind="fixed", digits=4, of=lambda point: point.ratio_interval and point.ratio_interval[1]),
        Column("Within", of=tell),
    )
    return tabulate("Points", "Every point of the grid", columns, study.points, most=LONG_TABLE)


def linearity_csv(study: StudyLinearity) -> str:
    """One line for each point."""
    names = [name for name in LinearityPoint.__dataclass_fields__ if name != "ratio_interval"]
    rows = (
        [*(getattr(point, name) for name in names), *(point.ratio_interval or (None, None))] for point in study.points
    )
    return csv_text([*names, "ratio_low", "ratio_high"], rows)


# From pale to dark, so that a print in grey keeps the order; text on it stays readable.
_FILLS = (("#e4f1e8", INK), ("#efcf6d", INK), ("#e08f4c", INK), ("#a5301f", "#ffffff"))
FILL: dict[Within, tuple[str, str]] = dict(zip(get_args(Within), _FILLS, strict=True))
CELL = (62, 26)  # width and height


def draw_linearity(study: StudyLinearity) -> str:
    """Panels: spread from left to right, count from top to bottom; in each, noise upwards and rotation to the right."""
    across, down = CELL[0] * len(study.rotations_deg), CELL[1] * len(study.noises_px)
    width = max(130 + (across + 22) * len(study.spreads), 800)
    points = points_by_place(study)
    title = f"Estimate over simulation: {study.provenance.design_name}"
    with titled_page("study", title, "", (down + 44) * len(study.counts) + 100, width) as (page, top):
        patches = [page.patch(facecolor=fill, edgecolor=FAINT, linewidth=0.5) for fill, _ in FILL.values()]
        words = ["further off" if within == "beyond" else f"within {within}" for within in FILL]
        page.explain(15, top + 8, list(zip(patches, words, strict=True)))
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
                axes.set_xticks(*_ticks_of(study.rotations_deg, "deg"))
                axes.set_yticks(*_ticks_of(study.noises_px, "px"))
                axes.tick_params(length=0, labelbottom=row == len(study.counts) - 1, labelleft=column == 0)
                grid = product(enumerate(study.noises_px), enumerate(study.rotations_deg))
                places = [(k, j, points[noise, rotation, spread, count]) for (j, noise), (k, rotation) in grid]
                draw_cells(axes, [(k, j, *_field(point)) for k, j, point in places])
        axis = "standard deviation of the rotations of the structure; up the page: noise of each image coordinate"
        page.say(118, page.height - 14, f"to the right: {axis}", color=MUTED)
        summary = " ".join(study.sentences)
        return page.svg(title, f"P95 at target {study.target}, deviation in per cent. {summary}")


def _ticks_of(values: Sequence[float], unit: str) -> tuple[list[float], list[str]]:
    return [k + 0.5 for k in range(len(values))], [f"{value:g} {unit}" for value in values]


def _field(point: LinearityPoint) -> tuple[str, str, str]:
    """Colour, words and their colour."""
    if point.within is None:
        return "", "refused", MUTED
    fill, ink = FILL[point.within]
    return fill, f"{write_deviation(point).replace('-', '−')} %{'' if point.sure else ' ?'}", ink
