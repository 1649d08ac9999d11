"""Which view buys most: every aimed view turned within a cone, and a view more from anywhere.

P95 of every direction is an estimate by first order, as that of a score.  A direction that hides a fiducial or a
target is not allowed.  --json prints the maps; the report of that record draws them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tailstack.measures import PointError

from .operation import Options
from .study import refuse_undetermined, study_operation

if TYPE_CHECKING:
    from .request import Request


class ViewOptions(Options):
    """How far views turn, and which error counts."""

    cone_deg: Annotated[float, Field(ge=1, le=90)] = 30.0
    """How far each view turns from where it is designed, deg."""
    step_deg: Annotated[float, Field(ge=0.1, le=90)] = 10.0
    """Step of the maps, deg; at most 15 of them from the middle to the edge."""
    error: PointError = "tcp"
    """Which error."""


def _check(request: Request) -> None:
    """Maps of a size that can be, first.  Raises StudyError."""
    from tailstack.studies.views import refuse_steps

    refuse_steps(request.options.cone_deg, request.options.step_deg)
    refuse_undetermined(request)


OPERATION = study_operation(
    "views",
    summary="Which view buys most, turned or added?",
    description="P95 by first order over the direction of each aimed view's beam within a cone, and over that of a "
    "view more; what a direction hides, the best one, its angles to the other views, and what it buys.",
    title="answer of study views: P95 over the directions of the views, and of one more",
    options=ViewOptions,
    example={"step_deg": 15.0},
    check=_check,
    threads=False,
)
