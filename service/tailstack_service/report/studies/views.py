"""Which view buys most: maps of P95 over the directions of the views, and of one more."""

from __future__ import annotations

from functools import partial
from math import nan
from statistics import median
from typing import TYPE_CHECKING

from tailstack.results import ERRORS
from tailstack.results.look import MUTED, VERMILION
from tailstack.results.tables import LONG_TABLE, PAPER, TERMINAL, Column, On, Table, tabulate
from tailstack.studies.views import StudyViews, ViewMap, maps_of

from ...rendering.document import Document, KeyNumber, Paragraph, Section, compose_study
from ...rendering.text import shorten
from ..charts import shade
from ..page import titled_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def views_document(study: StudyViews, sha256: str) -> Document:
    """The maps, what they come to, and every direction as a row."""
    maps = maps_of(study)
    best = [(name, view_map.best.p95_mm) for name, view_map in maps if view_map.best is not None]
    found = [KeyNumber(name, f"{p95_mm:.3f} mm", "P95 of the best direction") for name, p95_mm in best]
    caption = "P95 over the directions of each view's beam: what it costs or buys to turn it, and to add one."
    about = Paragraph(
        "Every direction is scored to first order under the declared laws, everything else as designed, one view at a "
        "time. Whether the C-arm reaches a direction, and what of the patient or the table lies in its beam, is not "
        "asked."
    )
    return compose_study(
        study,
        sha256,
        "which view buys most",
        question=f"Which view buys most: P95 of {ERRORS[study.error]}.",
        method="by first order",
        sentences=study.conclusions,
        numbers=(KeyNumber("As designed", f"{study.p95_mm:.3f} mm", f"P95 at {study.target}"), *found),
        figure=("views", partial(draw_views, study), caption) if maps else None,
        sections=(
            Section("The best directions", (maps_table(study),), on=TERMINAL | On.PAGE | On.SHEET),
            Section("Angles", (angles_table(study),), on=PAPER),
            Section("Every direction", (directions_table(study),), on=PAPER),
        ),
        command=f"tailstack study views design.yaml --cone-deg {study.cone_deg:g} --step-deg {study.step_deg:g} "
        f"--error {study.error} --json",
        about=(about,),
    )


BEAM_BRIEF = "its beam_direction\nin con"


def maps_table(study: StudyViews) -> Table:
    def write_allowed(view_map: ViewMap) -> str:
        return f"{sum(each.p95_mm is not None for each in view_map.directions)} of {len(view_map.directions)}"

    def write_beam(view_map: ViewMap) -> str:
        return "-" if view_map.best is None else "  ".join(f"{value:+.3f}" for value in view_map.best.beam_direction)

    columns = (
        Column("View", brief="view\n", of=lambda row: row[0]),
        Column("Best P95", "mm", "fixed", brief="best P95\nmm", of=lambda row: row[1].best and row[1].best.p95_mm),
        Column("Allowed", kind="fixed", brief="allowed\n", of=lambda row: write_allowed(row[1])),
        Column("Turned by", "deg", "fixed", 0, brief="turned by\ndeg", of=lambda row: row[1].turn_deg),
        Column("Its beam_direction in con", kind="fixed", brief=BEAM_BRIEF, of=lambda row: write_beam(row[1])),
    )
    return tabulate("Best", "The best direction of each view", columns, maps_of(study))


def angles_table(study: StudyViews) -> Table:
    columns = (
        Column("View", of=lambda row: row[0]),
        Column("To", of=lambda row: row[1].view),
        Column("Angle", "deg", "fixed", 1, of=lambda row: row[1].angle_deg),
    )
    angles = [(name, each) for name, view_map in maps_of(study) for each in view_map.angles]
    return tabulate("Angles", "Between the best beam of each map and those of the other views", columns, angles)


def directions_table(study: StudyViews) -> Table:
    """Every direction of every map."""
    columns = (
        Column("View", of=lambda row: row[0]),
        Column("To the right", "deg", "given", of=lambda row: row[1].right_deg),
        Column("Up", "deg", "given", of=lambda row: row[1].up_deg),
        Column("P95", "mm", "fixed", of=lambda row: row[1].p95_mm),
        Column("At", on=On.SHEET, of=lambda row: row[1].target),
        Column("Beam direction in con", of=lambda row: ", ".join(f"{value:g}" for value in row[1].beam_direction)),
        Column("Not allowed because", of=lambda row: row[1].reason),
    )
    directions = [(name, each) for name, view_map in maps_of(study) for each in view_map.directions]
    caption = f"P95 of the {study.error} error, at the target where it is largest"
    return tabulate("Directions", caption, columns, directions, most=LONG_TABLE)


SQUARE, SHADES = 300, 6


def draw_views(study: StudyViews) -> str:
    """A map for each view that turns and for one more: contours of P95 over the turn to the right and up."""
    maps = maps_of(study)
    rows = -(-len(maps) // 2)
    title = f"P95 over the directions of views: {study.provenance.design_name}"
    designed = f"as designed {study.p95_mm:.3f} mm at {study.target}"
    about = f"{study.error} error, at the target where it is largest; {designed}"
    with titled_page("study-views", title, about, 48 + rows * (SQUARE + 130), 800) as (page, top):
        best = page.sample(marker="*", linestyle="", color=VERMILION, markersize=13)
        hidden = page.sample(marker="x", linestyle="", color=MUTED)
        page.explain(15, top + 6, [(best, "smallest P95"), (hidden, "not allowed: it hides something, mostly")])
        for number, (name, view_map) in enumerate(maps):
            left, upper = 70 + 390 * (number % 2), top + 106 + (SQUARE + 130) * (number // 2)
            page.say(left - 40, upper - 44, f"{shorten(name, 40)}: P95, mm", weight="bold")
            names = "turned to the right of the image, deg", "up, deg"
            axes = page.axes(left, upper, left + SQUARE, upper + SQUARE, *names)
            levels = _draw_view_map(axes, view_map)
            marks = [(page.patch(color=shade(k / SHADES)), f"{level:.3f}") for k, level in enumerate(levels)]
            if marks:
                page.explain(left - 48, upper - 38, marks, columnspacing=0.7, handlelength=0.9, handletextpad=0.3)
        return page.svg(title, " ".join(study.conclusions))


def _draw_view_map(axes: Axes, view_map: ViewMap) -> list[float]:
    """Contours where a direction and its neighbours are allowed; returns where each shade begins, mm."""
    reach = 1.06 * view_map.cone_deg
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.grid(False)
    steps = sorted({each.right_deg for each in view_map.directions})
    values = {(each.right_deg, each.up_deg): each.p95_mm for each in view_map.directions if each.p95_mm is not None}
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
    for each in view_map.directions:
        mark, size = ("x", 5) if each.p95_mm is None else (".", 2)
        axes.plot(each.right_deg, each.up_deg, linestyle="", color=MUTED, marker=mark, markersize=size)
    if view_map.best is not None:
        axes.plot(view_map.best.right_deg, view_map.best.up_deg, "*", color=VERMILION, markersize=13, clip_on=False)
    return levels
