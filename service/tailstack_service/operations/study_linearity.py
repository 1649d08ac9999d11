"""How far the estimate of a score can be trusted: it is held against a simulation over a grid.

Varied are noise, rotation, spread and the number of fiducials; the estimated P95 is within 1, 5 or 20 %, or beyond.
Every axis takes V1,V2,... in place of its default values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from tailstack.measures import PointError

from ..console.answer import exit_code_of_points
from ..console.flags import Flag
from .operation import Call, Csv, Demand, FigureFile, LateImport, Operation
from .options import Options, Seed, refuse_unknown_target, within

if TYPE_CHECKING:
    from tailstack.studies.linearity import StudyLinearity

    from ..settings import Settings
    from .request import Request

LEAST_TRIALS, MOST_TRIALS = 8192, 2**22  # of each point


Numbers = Annotated[list[float], Field(min_length=1, max_length=50)]
Counts = Annotated[list[int], Field(min_length=1, max_length=50)]


class LinearityOptions(Options):
    """The grid, and how each of its points is sampled."""

    noises_px: Annotated[
        Numbers | None,
        Flag("of every image coordinate (0.3,1,3,10)", name="noise", metavar="PX,..."),
    ] = Field(
        None, description="Noise of every image coordinate, px; absent: 0.3, 1, 3, 10.", examples=[[0.3, 1.0, 3.0]]
    )
    rotations_deg: Annotated[
        Numbers | None,
        Flag(
            "standard deviation of each rotation of the structure's mount, normal (0,1,5)",
            name="rotation",
            metavar="DEG,...",
        ),
    ] = Field(
        None,
        description="Standard deviation of each rotation of the structure's mount, deg, normal; absent: 0, 1, 5.",
        examples=[[0.0, 1.0, 5.0]],
    )
    spreads: Annotated[
        Numbers | None,
        Flag("factor on the layout about its centroid (1,0.5,0.2)", name="spread", metavar="F,..."),
    ] = Field(None, description="Factors on the layout about its centroid; absent: 1, 0.5, 0.2.", examples=[[1.0, 0.5]])
    counts: Annotated[
        Counts | None,
        Flag("fiducials kept, far apart (all, two thirds, 7)", name="count", metavar="N,..."),
    ] = Field(None, description="Numbers of fiducials kept, far apart; absent: all, two thirds, 7.", examples=[[12, 8]])
    target: Annotated[str | None, Flag("target (default: the one with the largest P95)")] = Field(
        None, description="Name of the target; absent: the one with the largest P95."
    )
    error: PointError = Field("tcp", description="Which error.")
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] = Field(2**14, description="Trials of each point.")
    seed: Annotated[Seed, Flag("seed")] = Field(0, description="Seed of every point.")


def _study(call: Call) -> StudyLinearity:
    from dataclasses import fields

    from tailstack.studies.linearity import Grid, study_linearity

    options: dict[str, Any] = call.options.model_dump(exclude_none=True)
    grid = Grid(**{name: options.pop(name) for name in [each.name for each in fields(Grid)] if name in options})
    return study_linearity(call.design, grid, **options, threads=call.threads, progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, and a target that it has.  Raises RefusedAt, RequestError, LimitError."""
    from tailstack.design import check_design

    within(request.options.trials, "max_trials", settings, "/trials")
    system, _, _ = request.refuse_by(check_design)
    refuse_unknown_target(request.options.target, [target.name for target in system.targets], "/target")


OPERATION = Operation(
    name="study-linearity",
    verb="study linearity",
    path="/v1/studies/linearity",
    summary="How far the estimate can be trusted: a map over noise, rotation, spread and count",
    description="First order, second order and Monte Carlo over a grid of noise, rotation, spread and count: where the "
    "first-order P95 is within 1, 5 and 20 %, where it is optimistic, and whether the validity number nu knew.",
    title="answer of study linearity: first order over Monte Carlo, point by point of a grid",
    options=LinearityOptions,
    example={"noises_px": [0.3, 3.0], "rotations_deg": [0.0, 1.0], "spreads": [1.0], "trials": 8192},
    record=LateImport("tailstack.studies.linearity", "StudyLinearity").load,
    run=_study,
    check=_check,
    document=LateImport("..report.studies.linearity", "linearity_document"),
    demand=lambda record: Demand.of_cases(record.trials, len(record.points), "Monte Carlo at every point"),
    exit_code=exit_code_of_points,
    threads=True,
    figure=FigureFile("the map", LateImport("..report.studies.linearity", "draw_linearity")),
    csv=Csv("point", LateImport("..report.studies.linearity", "linearity_csv")),
)
