"""A comparison as a job: the check of each design is that of its own kind, side by side; then both are compared."""

from __future__ import annotations

import json
from typing import Any

from tailstack.errors import TailstackError

from ..documents import read_record, to_json
from ..problems import RequestError
from .kinds import KINDS, Done, More, Step
from .requests import Refused, canonical, design_of
from .task import UnitResult

SIDES = ("first", "second")


def advance(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Step:
    """More units for the checks that are not finished, or the comparison."""
    from ..reports.assembling import assemble, options_of
    from ..reports.comparing import check_parts, compare

    try:
        options = options_of(request)
        check_parts(options)
    except RequestError as error:
        raise Refused(error) from None
    found: dict[str, Any] = {}
    specs: list[bytes] = []
    remaining, notes = 0, []
    for side in SIDES if "verification" in options.parts else ():
        own = tuple(
            UnitResult(result.index, canonical(json.loads(result.spec)["spec"]), result.result)
            for result in results
            if json.loads(result.spec)["of"] == side
        )
        try:
            step = KINDS["verification"].advance(_check_request(request, side), own)
        except TailstackError as error:
            raise Refused(error, f"/{side}") from None
        if isinstance(step, More):
            specs += [canonical({"of": side, "spec": json.loads(spec)}) for spec in step.specs]
            remaining += step.remaining
            notes.append(f"{side}: {step.note}")
        else:
            found[side] = read_record("verification", step.answer)
    if specs:
        return More(tuple(specs), remaining, "; ".join(notes))
    reports = []
    for side in SIDES:
        try:
            reports.append(assemble(design_of({"design": request[side]}), options, found.get(side), None))
        except TailstackError as error:
            raise Refused(error, f"/{side}") from None
    try:
        return Done(to_json(compare(reports[0], reports[1], options)))
    except RequestError as error:
        raise Refused(error, "/second") from None


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One unit of one check."""
    return KINDS["verification"].compute(_check_request(request, spec["of"]), spec["spec"])


def _check_request(request: dict[str, Any], side: str) -> dict[str, Any]:
    own = {name: request[name] for name in ("trials", "precision", "max_trials") if request.get(name) is not None}
    return {"design": request[side], "seed": request.get("seed", 0), "method": "plain", **own}
