"""What a larger structure, one more bead, another angle between views or known intrinsics buy at best.

Of each change by itself the best layout that a search finds, and what no layout undercuts, proven to first order.
Half-widths and pivots stay as designed, the layout is free as the section optimise says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tailstack.measures import PointError

from .operation import Csv, Demand, LateImport, Options, Seed
from .study import study_operation

if TYPE_CHECKING:
    from .request import Request


class PlacementOptions(Options):
    """Which error counts, and where each search begins."""

    error: PointError = "tcp"
    """Which error."""
    starts: Annotated[int, Field(ge=1, le=64)] = 4
    """Layouts that each search begins with."""
    seed: Seed = 0
    """Seed of these layouts."""


def _check(request: Request) -> None:
    """A design that leaves its layout free.  Raises RefusedAt."""
    from tailstack.optimisation.changes import layout_problem

    request.refuse_by(lambda design: layout_problem(design, request.options.error))


OPERATION = study_operation(
    "placement",
    summary="What do a larger structure, one more fiducial or known intrinsics buy at best?",
    description="P95 by first order of the best layout found, and what no layout undercuts, against the number of "
    "fiducials, the width of the envelope, the angle between two views and the estimator: one changed at a time.",
    title="answer of study placement: the best layout found and what none undercuts, with one thing changed",
    options=PlacementOptions,
    example={"starts": 1},
    check=_check,
    figure="the best layouts found and what none undercuts",
    csv=Csv("case", LateImport("..report.studies.placement", "placement_csv")),
    demand=lambda record: Demand(starts=record.starts * len(record.cases), starts_at="/starts", checks=0),
)
