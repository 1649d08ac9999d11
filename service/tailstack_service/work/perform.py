"""One unit, start to end: what a computing process is asked for and what it answers."""

from __future__ import annotations

import json
import time
from dataclasses import replace

from tailstack.errors import TailstackError

from .kinds import KINDS, More
from .requests import Refused
from .task import ADVANCE, Outcome, Task


def perform(task: Task) -> Outcome:
    """Compute a unit, or look at what a job has recorded and say what comes next.

    A refusal of the request is an outcome.  Anything else that is raised is a defect, and goes to the caller.
    """
    begun = time.process_time()
    try:
        outcome = _performed(task)
    except Refused as refused:
        outcome = _refusal(refused.error, refused.prefix)
    except TailstackError as error:
        outcome = _refusal(error, "/design")
    return replace(outcome, cpu_seconds=time.process_time() - begun)


def _performed(task: Task) -> Outcome:
    kind, request = KINDS[task.kind], json.loads(task.request)
    if task.spec != ADVANCE:
        return Outcome(0.0, result=kind.compute(request, json.loads(task.spec)))
    step = kind.advance(request, task.results)
    if isinstance(step, More):
        return Outcome(0.0, more=step.specs, remaining=step.remaining, note=step.note)
    return Outcome(0.0, answer=step.answer)


def _refusal(error: TailstackError, prefix: str) -> Outcome:
    from ..documents import to_json
    from ..problems import problem_document

    return Outcome(0.0, problem=to_json(problem_document(error, instance="", prefix=prefix)))
