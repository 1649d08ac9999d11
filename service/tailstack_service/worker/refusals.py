"""Outcomes that no computing process gave: the job fails with a problem that says why."""

from __future__ import annotations

from tailstack.errors import LimitError, Problem

from ..problems import TransportError
from ..store.endings import as_problem
from ..work.task import Outcome


def defect() -> Outcome:
    """A unit raised what is not a refusal; its traceback belongs into the log."""
    hint = "report it with the job's id: the log of the worker holds the cause under it"
    error = TransportError("internal-error", Problem("", "internal-error", "the job met a defect of the service", hint))
    return Outcome(0.0, problem=as_problem(error))


def too_long(seconds: float, limit: float) -> Outcome:
    """A unit that was still being computed after ``limit`` seconds; it took ``seconds``."""
    detail = f"one part of the job was still being computed after {limit:g} s and was stopped"
    hint = "ask for less (trials, starts, points); the operator's setting is TAILSTACK_MAX_JOB_SECONDS"
    return Outcome(seconds, problem=as_problem(LimitError(Problem("", "job-too-long", detail, hint))))
