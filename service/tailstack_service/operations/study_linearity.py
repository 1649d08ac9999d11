"""How far the estimate of a score can be trusted: it is held against a simulation over a grid.

Varied are noise, rotation, spread and the number of fiducials; the estimated P95 is within 1, 5 or 20 %, or beyond.
Every axis takes V1,V2,... in place of its default values.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tailstack.measures import PointError

from ..console.command_line import exit_code_of_points
from ..console.flags import Flag
from .operation import Csv, Demand, LateImport, Options, Seed
from .study import study_operation

LEAST_TRIALS, MOST_TRIALS = 8192, 2**22  # of each point

Numbers = Annotated[list[float], Field(min_length=1, max_length=50)]
Counts = Annotated[list[int], Field(min_length=1, max_length=50)]
NOISES = Flag("of every image coordinate (0.3,1,3,10)", name="noise", metavar="PX,...")
ROTATIONS = Flag(
    "standard deviation of each rotation of the structure's mount, normal (0,1,5)", name="rotation", metavar="DEG,..."
)
SPREADS = Flag("factor on the layout about its centroid (1,0.5,0.2)", name="spread", metavar="F,...")
COUNTS = Flag("fiducials kept, far apart (all, two thirds, 7)", name="count", metavar="N,...")


class LinearityOptions(Options):
    """The grid, and how each of its points is sampled."""

    noises_px: Annotated[Numbers | None, NOISES] = Field(None, examples=[[0.3, 1.0, 3.0]])
    """Noise of every image coordinate, px; absent: 0.3, 1, 3, 10."""
    rotations_deg: Annotated[Numbers | None, ROTATIONS] = Field(None, examples=[[0.0, 1.0, 5.0]])
    """Standard deviation of each rotation of the structure's mount, deg, normal; absent: 0, 1, 5."""
    spreads: Annotated[Numbers | None, SPREADS] = Field(None, examples=[[1.0, 0.5]])
    """Factors on the layout about its centroid; absent: 1, 0.5, 0.2."""
    counts: Annotated[Counts | None, COUNTS] = Field(None, examples=[[12, 8]])
    """Numbers of fiducials kept, far apart; absent: all, two thirds, 7."""
    target: Annotated[str | None, Flag("target (default: the one with the largest P95)")] = None
    """Name of the target; absent: the one with the largest P95."""
    error: PointError = "tcp"
    """Which error."""
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] = 2**14
    """Trials of each point."""
    seed: Annotated[Seed, Flag("seed")] = 0
    """Seed of every point."""


OPERATION = study_operation(
    "linearity",
    summary="How far the estimate can be trusted: a map over noise, rotation, spread and count",
    description="First order and Monte Carlo over a grid of noise, rotation, spread and count: where the "
    "first-order P95 is within 1, 5 and 20 %, where it is optimistic, and whether the validity number nu knew.",
    title="answer of study linearity: first order over Monte Carlo, point by point of a grid",
    options=LinearityOptions,
    example={"noises_px": [0.3, 3.0], "rotations_deg": [0.0, 1.0], "spreads": [1.0], "trials": 8192},
    demand=lambda record: Demand.of_cases(record.trials, len(record.points), "Monte Carlo at every point"),
    exit_code=exit_code_of_points,
    figure="the map",
    csv=Csv("point", LateImport("..report.studies.linearity", "linearity_csv")),
)
