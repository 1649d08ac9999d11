"""Where the arm may go: the share of poses at which the limit holds, and maps of it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from tailstack.results.tables import LONG_TABLE, PAPER, Column, Table, tabulate
from tailstack.studies.workspace import PLANES, StudyWorkspace, WorkspaceField

from ...rendering.document import Document, KeyNumber, Paragraph, Section, compose_study
from ..charts import shade
from ..page import titled_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SQUARE, SHADES = 330, ("above 80 %", "to 80 %", "to 60 %", "to 40 %", "to 20 %")


def workspace_document(study: StudyWorkspace, sha256: str) -> Document:
    """The share, the maps, and every field of them as a row."""
    low, high = (f"{100 * each:.1f}" for each in study.share_interval)
    about = Paragraph(
        f"{study.poses} poses, every joint uniform within {study.reach_deg:g} deg (a slide: mm) of the pose of the "
        "shots, the tool at work there, to first order under the declared laws. Whether the arm reaches a pose, and "
        "what it would hit, is not asked."
    )
    return compose_study(
        study,
        sha256,
        "where the arm may go",
        question=f"Where may the arm go: P95 of the error at the tool at {study.target} within {study.limit_mm:g} mm.",
        method="by first order",
        sentences=study.conclusions,
        numbers=(
            KeyNumber("Share of the poses", f"{100 * study.share:.1f} %", f"between {low} and {high} %"),
            KeyNumber("Half of the poses", f"{study.median_p95_mm:.3f} mm", "P95"),
            KeyNumber("The worst pose", f"{study.largest_p95_mm:.3f} mm", "P95"),
        ),
        figure=("workspace", partial(draw_workspace, study), "Where the target is, in the robot's base."),
        sections=(Section("Every field of the maps", (fields_table(study),), on=PAPER),),
        command=f"tailstack study workspace design.yaml --poses {study.poses} --reach-deg {study.reach_deg:g} "
        f"--limit-mm {study.limit_mm:g} --target {study.target} --seed {study.seed} --json",
        about=(about,),
    )


def fields_table(study: StudyWorkspace) -> Table:
    """Every field of both maps that has a pose."""
    columns = (
        Column("Map", of=lambda row: row.plane),
        Column("x", "mm", "fixed", 0, of=lambda row: row.x_mm),
        Column("y or z", "mm", "fixed", 0, of=lambda row: row.beside_mm),
        Column("Poses", of=lambda row: row.poses),
        Column("Within the limit", of=lambda row: row.within),
    )
    return tabulate("Fields", "Poses by where the target is", columns, study.fields, most=LONG_TABLE)


def draw_workspace(study: StudyWorkspace) -> str:
    """Two maps, from above and from the side: the share of the poses there at which the limit holds, in shades."""
    title = f"Where the arm may go: {study.provenance.design_name}"
    with titled_page("study-workspace", title, study.conclusions[0], SQUARE + 150, 840) as (page, top):
        marks = [(page.patch(color=shade(k / len(SHADES))), words) for k, words in enumerate(SHADES)]
        page.explain(15, top + 6, marks, columnspacing=0.9, handlelength=0.9, handletextpad=0.4)
        for left, (plane, axis) in zip((75, 475), PLANES, strict=True):
            page.say(left - 45, top + 50, f"{plane}: share of the poses within the limit", weight="bold")
            names = "x of the robot's base, mm", f"{'xyz'[axis]}, mm"
            axes = page.axes(left, top + 80, left + SQUARE, top + 80 + SQUARE, *names)
            _draw_map(axes, [each for each in study.fields if each.plane == plane], study.field_mm)
        return page.svg(title, " ".join(study.conclusions))


def _draw_map(axes: Axes, fields: list[WorkspaceField], side: float) -> None:
    """Fields side by side, as high as they are wide; the fewer poses keep the limit, the darker."""
    ends = [(min(each), max(each)) for each in ([f.x_mm for f in fields], [f.beside_mm for f in fields])]
    reach = max(high - low for low, high in ends) / 2 + side
    x, beside = ((low + high) / 2 for low, high in ends)
    axes.set(xlim=(x - reach, x + reach), ylim=(beside - reach, beside + reach))
    axes.grid(False)
    for each in fields:
        place = min(int(len(SHADES) * (1 - each.within / each.poses)), len(SHADES) - 1)
        axes.bar(each.x_mm, side, side, bottom=each.beside_mm - side / 2, color=shade(place / len(SHADES)))
