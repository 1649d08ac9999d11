"""A gate as a job: the checks that it needs are those of the verification kind, one group of units per design."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from typing import Any

from tailstack.design import design_to_data
from tailstack.errors import Problem, TailstackError
from tailstack.results import Verification

from ...documents import from_json, to_json
from ...gate.judge import Gate, ScoredDesign, conclude, limit_design, plan_check, score_designs
from ...gate.reading import GateError
from ...gate.request import read_gate
from ...problems import RefusedAt, RequestError
from ...processes.task import Outcome, UnitResult
from ...rendering.text import spell_count
from ..content import canonical
from . import verification
from .parts import Parts

# First byte of a unit's result: a design whose check is refused is a finding of the gate, not the end of the job.
FOUND, REFUSED = b"+", b"-"


def plan(request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """More units for the designs whose checks are not finished, or the record."""
    gate, scored = _score(canonical(request))
    checks: list[Verification | TailstackError | None] = []
    parts = Parts(results)
    for index, computed in enumerate(scored):
        plan = plan_check(gate, computed)
        if plan is None:
            checks.append(None)
            continue
        own = parts.results_of(index)
        refused = next((result for result in own if result.result[:1] == REFUSED), None)
        if refused is not None:
            checks.append(_refusal(refused.result[1:]))
            continue
        assert computed.limited is not None
        plain = tuple(replace(result, result=result.result[1:]) for result in own)
        try:
            step = verification.plan_check(design_to_data(computed.limited), plan, plain)
        except TailstackError as error:
            checks.append(error)
            continue
        if (answer := parts.answer_of(index, step)) is not None:
            checks.append(from_json(Verification, answer))
    if more := parts.more(f"Monte Carlo checks of {spell_count(len(scored), 'design')}"):
        return more
    return Outcome(answer=to_json(conclude(gate, scored, checks)))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One unit of one design's check."""
    gate = _gate(canonical(request))
    try:
        asked = {"design": design_to_data(limit_design(gate, spec["of"])), "seed": gate.seed}
        return FOUND + verification.compute(asked, spec["spec"])
    except TailstackError as error:
        problems = [[p.pointer, p.code, p.detail, p.hint] for p in error.problems]
        return REFUSED + canonical({"slug": error.slug, "exit_code": error.exit_code, "problems": problems})


@lru_cache(maxsize=2)
def _gate(request: bytes) -> Gate:
    """The gate of a request: the units of a job come to a process one after the other."""
    try:
        return read_gate(json.loads(request))
    except (GateError, RequestError) as error:
        raise RefusedAt.place(error) from None


@lru_cache(maxsize=2)
def _score(request: bytes) -> tuple[Gate, tuple[ScoredDesign, ...]]:
    gate = _gate(request)
    return gate, score_designs(gate)


def _refusal(content: bytes) -> TailstackError:
    data = json.loads(content)
    error = TailstackError([Problem(*entry) for entry in data["problems"]])
    error.slug, error.exit_code = data["slug"], data["exit_code"]
    return error
