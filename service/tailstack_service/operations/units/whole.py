"""An operation that is not cut: its job is one unit, which gives the whole record."""

from __future__ import annotations

from typing import Any

from tailstack.errors import TailstackError

from ...documents import to_json
from ...problems import RefusedAt
from ...processes.task import Outcome, UnitResult
from ..content import canonical, design_of
from ..operation import Call, Operation

WHOLE = canonical({"what": "whole"})


def plan(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """The one unit, then what it gave."""
    return Outcome(answer=results[0].result) if results else Outcome(more=(WHOLE,))


def compute_whole(operation: Operation, request: dict[str, Any]) -> bytes:
    """The record of an operation, computed by its ``run``."""
    designs = tuple(design_of({"design": request[field]}) for field in operation.designs if field in request)
    options = {name: request[name] for name in operation.options.model_fields if name in request}
    call = Call(designs, operation.options.model_validate(options), threads=1)
    try:
        return to_json(operation.run(call))
    except TailstackError as error:
        if error.slug == "invalid-request":  # it is about the options, not about the design
            raise RefusedAt.place(error) from None
        raise
