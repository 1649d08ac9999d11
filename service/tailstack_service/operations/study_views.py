"""Which view buys most: every aimed view turned within a cone, and a view more from anywhere.

P95 of every direction is an estimate by first order, as that of a score.  A direction that hides a fiducial or a
target is not allowed.  --json prints the maps; the report of that record draws them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from .operation import Again, Call, LateImport, Operation, Repetition
from .options import Options

if TYPE_CHECKING:
    from tailstack.studies.views import StudyViews

    from ..settings import Settings
    from .sent import Request


class ViewOptions(Options):
    """How far views turn, and which error counts."""

    cone_deg: Annotated[float, Field(ge=1, le=90)] = Field(
        30.0, description="How far each view turns from where it is designed, deg."
    )
    step_deg: Annotated[float, Field(ge=0.1, le=90)] = Field(
        10.0, description="Step of the maps, deg; at most 15 of them from the middle to the edge."
    )
    error: Literal["tcp", "localisation"] = Field("tcp", description="Which error.")


def _study(call: Call) -> StudyViews:
    from tailstack.studies.views import study_views

    return study_views(call.design, **call.options.model_dump(), progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, and maps of a size that can be.  Raises Placed, StudyError."""
    from tailstack.design import check_design
    from tailstack.studies.views import refuse_steps

    refuse_steps(request.options.cone_deg, request.options.step_deg)
    request.refuse_by(check_design)


def _text(record: StudyViews) -> str:
    from tailstack.results import ERRORS
    from tailstack.studies.views import maps_of

    from ..rendering.tables import decimal, table, wrap
    from ..rendering.verdict import heading, join_blocks, more_text, provenance_text

    rows = []
    for name, one in maps_of(record):
        allowed = sum(each.p95_mm is not None for each in one.directions)
        best = None if one.best is None else one.best.p95_mm
        beam = "-" if one.best is None else "  ".join(f"{value:+.3f}" for value in one.best.beam_direction)
        counts = [f"{allowed} of {len(one.directions)}", decimal(one.turn_deg, 0)]
        rows.append([name, decimal(best, 4), *counts, beam])
    header = ("view\n", "best P95\nmm", "allowed\n", "turned by\ndeg", "its beam_direction\nin con")
    return join_blocks(
        heading(record.provenance, f"Which view buys most: P95 of {ERRORS[record.error]}.", "by first order"),
        "\n".join(wrap(said, first="* ", indent="  ") for said in record.conclusions),
        table(header, rows) if rows else "",
        provenance_text(record.provenance),
        more_text(),
    )


def _repeat(again: Repetition) -> Again:
    record: StudyViews = again.record
    options = ViewOptions(cone_deg=record.cone_deg, step_deg=record.step_deg, error=record.error)
    return Again(_study(Call(again.designs, options, progress=again.progress)))


OPERATION = Operation(
    name="study-views",
    verb="study views",
    path="/v1/studies/views",
    summary="Which view buys most, turned or added?",
    description="P95 by first order over the direction of each aimed view's beam within a cone, and over that of a "
    "view more; what a direction hides, the best one, its angles to the other views, and what it buys.",
    title="answer of study views: P95 over the directions of the views, and of one more",
    options=ViewOptions,
    example={"step_deg": 15.0},
    record=LateImport("tailstack.studies.views", "StudyViews").load,
    run=_study,
    check=_check,
    text=_text,
    document=LateImport("..report.chapters.studies", "views_document"),
    repeat=_repeat,
)
