"""Which view buys most: every aimed view turned within a cone, and a view more from anywhere.

P95 of every direction is an estimate by first order, as that of a score.  A direction that hides a fiducial or a
target is not allowed.  --json prints the maps; the report of that record draws them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tailstack.measures import PointError

from .operation import Call, LateImport, Operation
from .options import Options

if TYPE_CHECKING:
    from tailstack.studies.views import StudyViews

    from ..settings import Settings
    from .request import Request


class ViewOptions(Options):
    """How far views turn, and which error counts."""

    cone_deg: Annotated[float, Field(ge=1, le=90)] = Field(
        30.0, description="How far each view turns from where it is designed, deg."
    )
    step_deg: Annotated[float, Field(ge=0.1, le=90)] = Field(
        10.0, description="Step of the maps, deg; at most 15 of them from the middle to the edge."
    )
    error: PointError = Field("tcp", description="Which error.")


def _study(call: Call) -> StudyViews:
    from tailstack.studies.views import study_views

    return study_views(call.design, **call.options.model_dump(), progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, and maps of a size that can be.  Raises RefusedAt, StudyError."""
    from tailstack.design import check_design
    from tailstack.studies.views import refuse_steps

    refuse_steps(request.options.cone_deg, request.options.step_deg)
    request.refuse_by(check_design)


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
    document=LateImport("..report.studies.views", "views_document"),
)
