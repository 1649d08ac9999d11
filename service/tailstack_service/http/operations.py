"""The computations of one design: where they are asked for, with which options, and what is looked at beforehand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tailstack.design import Design

from ..documents import validate
from ..settings import Settings
from . import checks
from .asked import Asked
from .options import (
    OptimisationOptions,
    Options,
    ReportOptions,
    ScoreOptions,
    SweepOptions,
    ValidationOptions,
    VerificationOptions,
)


@dataclass(frozen=True, slots=True)
class Operation:
    """One computation that is answered at once."""

    path: str
    summary: str
    options: type[Options]
    answer: str  # name of the published schema of the answer
    compute: Callable[[Design, Any], Any]


@dataclass(frozen=True, slots=True)
class JobOperation:
    """One computation that becomes a job."""

    path: str
    kind: str
    summary: str
    options: type[Options]
    check: Callable[[Asked[Any], Design, Settings], None]  # raises Placed, RequestError, LimitError
    kept: Callable[[Any, Design], dict[str, Any]] = lambda options, design: options.model_dump()
    limits: tuple[str, ...] = ()  # settings that workers have to know, because they shape the answer


def _score(design: Design, options: ScoreOptions) -> Any:
    from tailstack.scoring import score

    return score(design, second_order=options.second_order)


def _validate(design: Design, options: ValidationOptions) -> Any:
    return validate(design)


SCORES = Operation("/v1/scores", "First-order score", ScoreOptions, "score", _score)
VALIDATIONS = Operation("/v1/validations", "Read and check a design", ValidationOptions, "validation", _validate)
OPERATIONS = (SCORES, VALIDATIONS)

JOB_OPERATIONS = (
    JobOperation(
        "/v1/verifications", "verification", "Monte Carlo check", VerificationOptions, checks.check_verification,
        limits=("max_trials",),
    ),
    JobOperation(
        "/v1/optimisations", "optimisation", "Optimise placement and tolerances", OptimisationOptions,
        checks.check_optimisation,
    ),
    JobOperation(
        "/v1/sweeps", "sweep", "Many designs", SweepOptions, checks.check_sweep, checks.sweep_options, ("max_trials",)
    ),
    JobOperation(
        "/v1/reports", "report", "One record of score, check and optimisation", ReportOptions, checks.check_report,
        limits=("max_trials",),
    ),
)  # fmt: skip
