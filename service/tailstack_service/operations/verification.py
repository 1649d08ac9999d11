"""A simulation of many shots: P95 with its interval, how many miss the limit, and the verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from tailstack.results import Verification

from ..console.answer import exit_code_of
from .operation import Again, Call, Demand, LateImport, Operation, Repetition
from .options import CheckOptions, check_trials


class VerificationOptions(CheckOptions):
    """How a check samples, and by which estimator."""

    method: Literal["plain", "radial"] = Field(
        "plain", description="plain: order statistics of the trials. radial: conditional on the direction."
    )


def _verify(call: Call) -> Verification:
    from tailstack.verification import MAX_TRIALS, verify

    options = call.options
    return verify(
        call.design,
        trials=options.trials,
        precision=options.precision,
        seed=options.seed,
        method=options.method,
        max_trials=call.limits.get("max_trials", MAX_TRIALS),
        threads=call.threads,
        progress=call.progress,
    )


def _demand(record: Verification) -> Demand:
    from tailstack.verification import MAX_TRIALS

    if record.precision_requested is None or record.method == "radial":
        return Demand(trials=record.trials, trials_at="/trials")
    return Demand(trials=record.max_trials or MAX_TRIALS, trials_at="/max_trials")


def _repeat(again: Repetition) -> Again:
    from tailstack.verification import MAX_TRIALS, prepare

    record: Verification = again.record
    design = again.designs[0]
    if again.fast:
        first = prepare(design, sampled=False).first_order_mm
        targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in record.targets)
        return Again(replace(record, targets=targets), "the Monte Carlo check")
    fixed = record.precision_requested is None
    options = VerificationOptions(
        trials=record.trials if fixed else None,
        precision=record.precision_requested,
        seed=record.seed,
        method=record.method,
    )
    limits = {"max_trials": record.max_trials or MAX_TRIALS}
    return Again(_verify(Call(again.designs, options, limits, progress=again.progress)))


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
    run=_verify,
    limits=("max_trials",),
    cut=True,
    check=check_trials,
    text=LateImport("..rendering.verification", "verification_text"),
    document=LateImport("..report.chapters.verification", "verification_document"),
    exit_code=lambda record: exit_code_of(record.verdict),
    demand=_demand,
    repeat=_repeat,
    threads=True,
)
