"""The same design under each estimator, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field

from .operation import Demand, Options, Seed
from .study import study_operation

if TYPE_CHECKING:
    from .request import Request

LEAST_TRIALS, MOST_TRIALS = 1024, 2**22  # of each estimator


class EstimatorOptions(Options):
    """How well intrinsics are known where a view does not say, and how much is simulated."""

    focal_rel_sd: Annotated[float, Field(ge=1e-6, le=1)] = 0.01
    """Standard deviation of the assumed focal length, as a part of it."""
    principal_point_px_sd: Annotated[float, Field(ge=1e-3, le=1e4)] = 10.0
    """Standard deviation of each coordinate of the assumed principal point, px."""
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] | None = None
    """Trials of a simulation under each estimator; absent: first order alone."""
    seed: Seed = 0
    """Seed of the simulations."""

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        return super().of_record(record, trials=record.trials or None)


def _check(request: Request) -> None:
    """A design that can be compiled: that it determines no answer is one.  Raises RefusedAt."""
    from tailstack.design import compile_design

    request.refuse_by(compile_design)


OPERATION = study_operation(
    "estimators",
    summary="What is knowing the intrinsics of each view worth?",
    description="P95 of the same design under each estimator: eleven unknowns of a view by linear equations or by "
    "least squares, its pose with a prior of its intrinsics, its pose alone; what each needs to know, and what being "
    "wrong costs.",
    title="answer of study estimators: P95 under each estimator, what it needs, and what being wrong costs",
    options=EstimatorOptions,
    example={"trials": 1024},
    check=_check,
    demand=lambda record: Demand.of_cases(record.trials, len(record.cases), "Monte Carlo of every estimator"),
)
