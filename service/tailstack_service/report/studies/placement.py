"""What a change buys at best: the best layout found and what none undercuts, one question beside the other."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from tailstack.results import ERRORS
from tailstack.results.digits import at_most, number
from tailstack.results.look import BLUE, FAINT, MUTED, PALE, VERMILION
from tailstack.results.tables import PAPER, Column, On, Table, tabulate
from tailstack.studies.placement import PlacementCase, StudyPlacement, cases_of

from ...rendering.document import Document, KeyNumber, Paragraph, Section, compose_study
from ...rendering.text import csv_text, plain_text
from ..page import DOTTED, titled_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

QUESTIONS = {
    "fiducials": "number of fiducials",
    "envelope": "width of the envelope, times that designed",
    "angle": "angle between both beams, deg",
    "estimator": "estimator",
}


def placement_document(study: StudyPlacement, sha256: str) -> Document:
    """What each change buys at best, the cases as a chart and as rows."""
    base = study.cases[0]
    least = "-" if base.lower_bound_mm is None else f"{at_most(base.lower_bound_mm)} mm"
    left = f" Not counted, and can only add: {', '.join(study.left_out)}." if study.left_out else ""
    about = Paragraph(
        "One thing is changed at a time; half-widths, pivots and all else stay as designed, and the layout is free as "
        "the design's section optimise says. Widths are about the middle of the envelope; of two views one is turned, "
        "image and detector with it. The best layout found is the end of a search and need not be the best there is; "
        f"that none is below the bound is proven, of the first-order law alone.{left}"
    )
    return compose_study(
        study,
        sha256,
        "what a change buys at best",
        question=f"What would a larger structure, one more fiducial or known intrinsics buy at best: P95 of "
        f"{ERRORS[study.error]}.",
        method=f"to first order · {study.starts} starts of each search, seed {study.seed}",
        sentences=study.conclusions,
        numbers=(
            KeyNumber("Best layout found", f"{number(base.best_found_mm)} mm", "P95, as designed"),
            KeyNumber("No layout below", least, "P95, as designed"),
        ),
        figure=("placement", partial(draw_placement, study), "The best layouts found, and what none undercuts."),
        sections=(Section("Every change", (cases_table(study),)),),
        command=f"tailstack study placement design.yaml --error {study.error} --starts {study.starts} --seed "
        f"{study.seed} --json",
        about=(about,),
    )


def cases_table(study: StudyPlacement) -> Table:
    """A row for each case."""

    def gap(case: PlacementCase) -> float | None:
        if case.best_found_mm is None or case.lower_bound_mm is None:
            return None
        return case.best_found_mm / case.lower_bound_mm - 1

    columns = (
        Column("Changed", of=lambda case: case.case),
        Column("Best found", "mm", "fixed", 4, brief="best found\nmm", of=lambda case: case.best_found_mm),
        Column("No layout below", "mm", "fixed", 4, brief="none below\nmm", of=lambda case: case.lower_bound_mm),
        Column("Gap", "%", "percent", 1, brief="gap\n%", of=gap),
        Column("At", on=PAPER, of=lambda case: case.target),
        Column("Lacking because", on=On.DETAIL | PAPER, of=lambda case: case.reason),
    )
    caption = f"P95 of {ERRORS[study.error]}: the best layout found, and what none undercuts"
    return tabulate("Cases", caption, columns, study.cases)


def placement_csv(study: StudyPlacement) -> str:
    """One line for each case."""
    names = list(PlacementCase.__dataclass_fields__)
    rows = ([getattr(case, name) for name in names] for case in study.cases)
    return csv_text(names, ([plain_text(each) if isinstance(each, str) else each for each in row] for row in rows))


WIDE, TALL, BETWEEN = 330, 210, 84


def draw_placement(study: StudyPlacement) -> str:
    """A panel for each question: P95 of the best layout found, and below it what is proven to be out of reach."""
    asked = [kind for kind in QUESTIONS if cases_of(study, kind)]
    rows = -(-len(asked) // 2)
    title = f"What a change buys at best: {study.provenance.design_name}"
    about = f"P95 of {ERRORS[study.error]}, mm, by first order; grey: no layout is there, proven"
    values = [v for case in study.cases for v in (case.best_found_mm, case.lower_bound_mm) if v is not None]
    values += [study.any_structure_mm] if study.any_structure_mm is not None else []
    low, high = min(values, default=0.0), max(values, default=1.0)
    margin = 0.06 * (high - low) or 0.05
    with titled_page("study-placement", title, about, 60 + rows * (TALL + BETWEEN), 2 * WIDE + 150) as (page, top):
        marks = [
            (page.sample(marker="o", color=BLUE), "best layout found"),
            (page.sample(marker="_", markersize=14, linestyle="", color=MUTED), "none below"),
            (page.sample(marker="o", linestyle="", color=VERMILION), "as designed"),
            (page.sample(color=FAINT, linestyle=DOTTED), "none below, of any structure"),
        ]
        page.explain(15, top + 8, marks)
        for number_of, kind in enumerate(asked):
            left = 62 + (WIDE + 62) * (number_of % 2)
            upper = top + 62 + (TALL + BETWEEN) * (number_of // 2)
            axes = page.axes(left, upper, left + WIDE, upper + TALL, QUESTIONS[kind], "P95, mm")
            axes.set_ylim(low - margin, high + margin)
            _draw_question(axes, study, kind)
        return page.svg(title, " ".join(study.conclusions))


def _draw_question(axes: Axes, study: StudyPlacement, kind: str) -> None:
    pairs = cases_of(study, kind)
    named = kind == "estimator"
    places = [float(k) if named else float(at) for k, (at, _) in enumerate(pairs)]
    reach = (max(places) - min(places)) * 0.08 or 1.0
    axes.set_xlim(min(places) - reach, max(places) + reach)
    if named:
        axes.set_xticks(places, [str(at).replace("_", " ") for at, _ in pairs])
    bounds = [(x, case.lower_bound_mm) for x, (_, case) in zip(places, pairs, strict=True) if case.lower_bound_mm]
    founds = [(x, case.best_found_mm) for x, (_, case) in zip(places, pairs, strict=True) if case.best_found_mm]
    for x, least in bounds:  # each is proven by itself, and nothing between them
        axes.plot([x, x], [axes.get_ylim()[0], least], color=PALE, linewidth=14)
        axes.plot(x, least, marker="_", markersize=14, color=MUTED)
    if founds:
        axes.plot(*zip(*founds, strict=True), linestyle="none" if named else "-", marker="o", color=BLUE)
    if study.any_structure_mm is not None and kind != "angle":
        axes.axhline(study.any_structure_mm, color=FAINT, linestyle=DOTTED)
    for x, (_, case) in zip(places, pairs, strict=True):
        if case.changed == "nothing" and case.best_found_mm is not None:
            axes.plot(x, case.best_found_mm, "o", color=VERMILION, clip_on=False)
