"""The same design under each estimator, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field

from .operation import Call, Demand, LateImport, Operation
from .options import Options, Seed, within

if TYPE_CHECKING:
    from tailstack.studies.estimators import StudyEstimators

    from ..settings import Settings
    from .request import Request

LEAST_TRIALS, MOST_TRIALS = 1024, 2**22  # of each estimator


class EstimatorOptions(Options):
    """How well intrinsics are known where a view does not say, and how much is simulated."""

    focal_rel_sd: Annotated[float, Field(ge=1e-6, le=1)] = Field(
        0.01, description="Standard deviation of the assumed focal length, as a part of it."
    )
    principal_point_px_sd: Annotated[float, Field(ge=1e-3, le=1e4)] = Field(
        10.0, description="Standard deviation of each coordinate of the assumed principal point, px."
    )
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] | None = Field(
        None, description="Trials of a simulation under each estimator; absent: first order alone."
    )
    seed: Seed = Field(0, description="Seed of the simulations.")

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        return super().of_record(record, trials=record.trials or None)


def _study(call: Call) -> StudyEstimators:
    from tailstack.studies.estimators import study_estimators

    options = call.options
    return study_estimators(
        call.design,
        focal_rel_sd=options.focal_rel_sd,
        principal_point_px_sd=options.principal_point_px_sd,
        trials=options.trials or 0,
        seed=options.seed,
        threads=call.threads,
        progress=call.progress,
    )


def _check(request: Request, settings: Settings) -> None:
    """A design that can be compiled, trials within the limit.  Raises RefusedAt, LimitError."""
    from tailstack.design import compile_design

    within(request.options.trials, "max_trials", settings, "/trials")
    request.refuse_by(compile_design)


OPERATION = Operation(
    name="study-estimators",
    verb="study estimators",
    path="/v1/studies/estimators",
    summary="What is knowing the intrinsics of each view worth?",
    description="P95 of the same design under each estimator: eleven unknowns of a view by linear equations or by "
    "least squares, its pose with a prior of its intrinsics, its pose alone; what each needs to know, and what being "
    "wrong costs.",
    title="answer of study estimators: P95 under each estimator, what it needs, and what being wrong costs",
    options=EstimatorOptions,
    example={"trials": 1024},
    record=LateImport("tailstack.studies.estimators", "StudyEstimators").load,
    run=_study,
    check=_check,
    document=LateImport("..report.studies.estimators", "estimators_document"),
    demand=lambda record: Demand.of_cases(record.trials, len(record.cases), "Monte Carlo of every estimator"),
    threads=True,
)
