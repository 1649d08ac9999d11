"""A comparison as a job: the check of each design is that of its own kind, side by side; then both are compared."""

from __future__ import annotations

from functools import partial
from typing import Any

from tailstack.errors import TailstackError
from tailstack.results import Verification
from tailstack.verification import PreparedDesign, Sampling

from ...documents import from_json, to_json
from ...problems import RefusedAt, RequestError
from ...processes.task import Outcome, UnitResult
from ..content import canonical, design_of
from . import verification
from .parts import Parts

SIDES = ("first", "second")


def plan(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """More units for the checks that are not finished, or the comparison."""
    from ...report.assembling import assemble, options_of
    from ...report.comparing import check_parts, compare, verify_alike

    try:
        options = options_of(request)
        check_parts(options)
    except RequestError as error:
        raise RefusedAt.place(error) from None
    checks: tuple[Verification | None, Verification | None] = (None, None)
    if "verification" in options.parts:
        ready = (_ready(request, "first"), _ready(request, "second"))
        try:
            checks = verify_alike(ready, options, partial(_check_both, request, results))
        except _NotYet as missing:
            return missing.step
    reports = []
    for side, check in zip(SIDES, checks, strict=True):
        try:
            reports.append(assemble(design_of({"design": request[side]}), options, check, None))
        except TailstackError as error:
            raise RefusedAt.place(error, f"/{side}") from None
    try:
        return Outcome(answer=to_json(compare(reports[0], reports[1], options)))
    except RequestError as error:
        raise RefusedAt.place(error, "/second") from None


def _ready(request: dict[str, Any], side: str) -> PreparedDesign:
    try:
        return verification.prepare_model(canonical(request[side]))
    except TailstackError as error:
        raise RefusedAt.place(error, f"/{side}") from None


class _NotYet(Exception):
    """Parts of the checks are not recorded."""

    def __init__(self, step: Outcome) -> None:
        super().__init__(step.note)
        self.step = step


def _check_both(
    request: dict[str, Any], results: tuple[UnitResult, ...], sampling: Sampling
) -> tuple[Verification, Verification]:
    """Both checks from what is recorded.  Raises _NotYet with the parts that both need, RefusedAt."""
    checks: list[Verification] = []
    parts = Parts(results)
    for side in SIDES:
        try:
            step = verification.plan_check(request[side], sampling, parts.results_of(side))
        except TailstackError as error:
            raise RefusedAt.place(error, f"/{side}") from None
        if (answer := parts.answer_of(side, step)) is not None:
            checks.append(from_json(Verification, answer))
    if more := parts.more():
        raise _NotYet(more)
    return checks[0], checks[1]


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One unit of one check."""
    return verification.compute(verification.check_request(request, request[spec["of"]]), spec["spec"])
