"""A simulation of many shots: P95 with its interval, how many miss the limit, and the verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Self

from tailstack.montecarlo import MAX_TRIALS
from tailstack.results import Verification

from ..console.command_line import exit_code_of
from .operation import (
    Again,
    Call,
    CheckOptions,
    Demand,
    LateImport,
    Operation,
    Repetition,
    run_function,
    within,
    within_trials,
)

if TYPE_CHECKING:
    from ..settings import Settings
    from .request import Request


class VerificationOptions(CheckOptions):
    """How a check samples, and by which estimator."""

    method: Literal["plain", "radial"] = "plain"
    """plain: order statistics of the trials. radial: conditional on the direction."""

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        asked = record.precision_requested
        trials = record.trials if asked is None else None
        return super().of_record(record, trials=trials, precision=asked, max_trials=record.max_trials or MAX_TRIALS)


def _check(request: Request, settings: Settings) -> None:
    """Trials within the limit, a design that determines an answer.  Raises RefusedAt, LimitError."""
    from tailstack.design import check_design

    if request.options.method == "plain":
        within_trials(request, settings)
    else:
        within(request.options.trials, "max_trials", settings, "/trials")
    request.refuse_by(check_design)


def _demand(record: Verification) -> Demand:
    if record.precision_requested is None or record.method == "radial":
        return Demand(trials=record.trials, trials_at="/trials")
    return Demand(trials=record.max_trials or MAX_TRIALS, trials_at="/max_trials")


def _repeat(again: Repetition) -> Again:
    from tailstack.verification import prepare

    record: Verification = again.record
    if again.fast:
        first = prepare(again.designs[0], sampled=False).first_order_mm
        targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in record.targets)
        return Again(replace(record, targets=targets), "the Monte Carlo check")
    options = VerificationOptions.of_record(record)
    return Again(OPERATION.run(Call(again.designs, options, progress=again.progress)))


OPERATION = Operation(
    name="verification",
    verb="verify",
    path="/v1/verifications",
    summary="Check by simulation of many shots (Monte Carlo)",
    description="Monte Carlo on the full nonlinear chain: quantiles with distribution-free intervals, exceedance, "
    "worst trial, the verdict. One seed, one answer.",
    title="answer of verify: Monte Carlo on the full chain",
    options=VerificationOptions,
    example={"precision": 0.01, "seed": 7, "method": "plain"},
    record=lambda: Verification,
    run=run_function(LateImport("tailstack.verification", "verify"), "threads", "progress"),
    cut=True,
    check=_check,
    document=LateImport("..report.chapters.verification", "verification_document"),
    exit_code=lambda record: exit_code_of(record.verdict),
    demand=_demand,
    repeat=_repeat,
    threads=True,
)
