"""A report as a job: check and optimisation are those of their own kinds, side by side; then it is put together."""

from __future__ import annotations

import json
from typing import Any

from tailstack.results import Optimisation, Verification

from ...documents import from_json, to_json
from ...problems import RequestError
from ...task import UnitResult
from ..content import Refused, canonical, design_of
from ..operation import Done, More, Step
from . import optimisation, verification

UNITS: dict[str, Any] = {"verification": verification, "optimisation": optimisation}
RECORDS = {"verification": Verification, "optimisation": Optimisation}


def plan(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Step:
    """More units for the parts that are not finished, or the report."""
    from ...report.assembling import assemble, options_of

    try:
        options = options_of(request)
    except RequestError as error:
        raise Refused(error) from None
    found: dict[str, Any] = {}
    specs: list[bytes] = []
    remaining, notes = 0, []
    for part in options.parts:
        if part == "score":
            continue
        own = tuple(
            UnitResult(result.index, canonical(json.loads(result.spec)["spec"]), result.result)
            for result in results
            if json.loads(result.spec)["of"] == part
        )
        step = UNITS[part].plan(_part_request(request, part), own)
        if isinstance(step, More):
            specs += [canonical({"of": part, "spec": json.loads(spec)}) for spec in step.specs]
            remaining += step.remaining
            notes.append(f"{part}: {step.note}")
        else:
            found[part] = from_json(RECORDS[part], step.answer)
    if specs:
        return More(tuple(specs), remaining, "; ".join(notes))
    report = assemble(design_of(request), options, found.get("verification"), found.get("optimisation"))
    return Done(to_json(report))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One unit of one part."""
    part = spec["of"]
    result: bytes = UNITS[part].compute(_part_request(request, part), spec["spec"])
    return result


def _part_request(request: dict[str, Any], part: str) -> dict[str, Any]:
    if part == "optimisation":
        return {"design": request["design"], "seed": None, "starts": request.get("starts")}
    own = {name: request[name] for name in ("trials", "precision", "max_trials") if request.get(name) is not None}
    return {"design": request["design"], "seed": request.get("seed", 0), "method": "plain", **own}
