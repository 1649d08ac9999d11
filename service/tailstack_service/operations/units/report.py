"""A report as a job: check and optimisation are those of their own kinds, side by side; then it is put together."""

from __future__ import annotations

from typing import Any

from tailstack.results import Optimisation, Verification

from ...documents import from_json, to_json
from ...processes.task import Outcome, UnitResult
from ..content import design_of
from . import optimisation, verification
from .parts import Parts

UNITS: dict[str, Any] = {"verification": verification, "optimisation": optimisation}
RECORDS = {"verification": Verification, "optimisation": Optimisation}


def plan(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """More units for the parts that are not finished, or the report."""
    from ...report.assembling import assemble, options_of

    options = options_of(request)
    records: dict[str, Any] = {}
    parts = Parts(results)
    for part in options.parts:
        if part == "score":
            continue
        step = UNITS[part].plan(_part_request(request, part), parts.results_of(part))
        if (answer := parts.answer_of(part, step)) is not None:
            records[part] = from_json(RECORDS[part], answer)
    if more := parts.more():
        return more
    report = assemble(design_of(request), options, records.get("verification"), records.get("optimisation"))
    return Outcome(answer=to_json(report))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One unit of one part."""
    part = spec["of"]
    result: bytes = UNITS[part].compute(_part_request(request, part), spec["spec"])
    return result


def _part_request(request: dict[str, Any], part: str) -> dict[str, Any]:
    if part == "optimisation":
        return {"design": request["design"], "seed": None, "starts": request.get("starts")}
    return verification.check_request(request, request["design"])
