"""Where the arm may go from the pose of the shots: the share of poses at which the limit holds, and maps of it.

Poses of the tool are drawn at random, every joint within --reach-deg of the pose of the shots; P95 of each is an
estimate by first order, as that of a score.  The design has a robot (execution.robot).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from .example import EXAMPLE_DESIGN
from .operation import Options, Seed
from .study import refuse_undetermined, study_operation

if TYPE_CHECKING:
    from .request import Request


class WorkspaceOptions(Options):
    """Which poses are drawn, and what they are held to."""

    poses: Annotated[int, Field(ge=100, le=1_000_000)] = 10_000
    """Poses that are drawn."""
    reach_deg: Annotated[float, Field(ge=0.1, le=360)] = 30.0
    """How far each joint is from the pose of the shots at most, deg; a slide, mm."""
    limit_mm: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """Limit of P95 of the error at the tool, mm; absent: the tightest that the design requires."""
    target: str | None = None
    """Name of the target; absent: the first."""
    seed: Seed = 0
    """Seed of the poses."""


def _check(request: Request) -> None:
    """Raises StudyError for what cannot be studied, first."""
    from tailstack.design import compile_design
    from tailstack.studies.workspace import refuse_unstudied

    refuse_undetermined(request)
    refuse_unstudied(request.design, compile_design(request.design), request.options.limit_mm, request.options.target)


ARM = {
    "dh_convention": "standard",
    "dh": [{"d_mm": 162.5, "alpha_deg": 90}, {"a_mm": -425}, {"a_mm": -392.2, "d_mm": 133.3}],
    "joints_imaging_deg": [0, -100, 110],
    "joints_executing_deg": [15, -90, 105],
    "joint_sd_deg": 0.02,
}

OPERATION = study_operation(
    "workspace",
    summary="Where may the arm go from the pose of the shots?",
    description="The share of the tool's poses about that of the shots at which P95 by first order is within its "
    "limit, with its interval, P95 in the middle and at the worst, and maps over where the target then is.",
    title="answer of study workspace: the share of poses at which the limit holds, and maps of it",
    options=WorkspaceOptions,
    example={"design": {**EXAMPLE_DESIGN, "execution": {"robot": ARM}}, "poses": 500, "limit_mm": 1.5},
    check=_check,
    threads=False,
    figure="the maps",
)
