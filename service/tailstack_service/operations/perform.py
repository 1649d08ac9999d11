"""One unit, start to end: what a computing process is asked for and what it answers."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from importlib import import_module
from typing import Any

from tailstack.errors import TailstackError
from tailstack.extras import name_missing_extra

from ..documents import to_json
from ..problems import RefusedAt, memory_error, problem_document
from ..processes.task import ADVANCE, Outcome, Task, UnitResult
from .content import canonical
from .example import EXAMPLE_DESIGN
from .registry import OPERATIONS
from .units.parts import compute_whole, plan_whole


def plan(kind: str, request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """More units, or the record, by what is recorded so far.

    A pure function: it is asked again after every round, and after a kill, and says the same each time.  Raises
    TailstackError for a request that is refused, ``RefusedAt`` where that is not about ``/design``.
    """
    if not OPERATIONS[kind].cut:
        return plan_whole(results)
    outcome: Outcome = _units(kind).plan(request, results)
    return outcome


def compute(kind: str, request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """The result of a unit that ``plan`` asked for; a pure function, which raises what ``plan`` raises."""
    if not OPERATIONS[kind].cut:
        return compute_whole(OPERATIONS[kind], request)
    result: bytes = _units(kind).compute(request, spec)
    return result


def _units(kind: str) -> Any:
    """The module that cuts an operation into units."""
    return import_module(f"{__package__}.units.{kind}")


def perform(task: Task) -> Outcome:
    """Compute a unit, or look at what a job has recorded and say what comes next.

    A refusal of the request is an outcome.  Anything else that is raised is a defect, and goes to the caller.
    """
    begun = time.process_time()
    try:
        with name_missing_extra():
            request = json.loads(task.request)
            if task.spec == ADVANCE:
                outcome = plan(task.kind, request, task.results)
            else:
                outcome = Outcome(result=compute(task.kind, request, json.loads(task.spec)))
    except TailstackError as error:
        outcome = _refusal(RefusedAt.place(error, "/design"))
    except MemoryError:
        outcome = _refusal(memory_error())
    return replace(outcome, cpu_seconds=time.process_time() - begun)


def _refusal(error: TailstackError) -> Outcome:
    return Outcome(problem=to_json(problem_document(error, instance="")))


def check_once() -> None:
    """The smallest Monte Carlo check there is, as a job would do it: what it loads and compiles is there for others."""
    options = {"trials": 1_000, "precision": None, "seed": 0, "method": "plain", "max_trials": 1_000}
    request = canonical({"design": EXAMPLE_DESIGN, **options})
    units: tuple[UnitResult, ...] = ()
    while more := perform(Task("verification", request, ADVANCE, units)).more:
        results = [(spec, perform(Task("verification", request, spec)).result or b"") for spec in more]
        units += tuple(UnitResult(len(units) + k, *pair) for k, pair in enumerate(results))
