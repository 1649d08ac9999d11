"""Designs held to a policy: findings, exit code, and what changed since a baseline."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from ..clock import SYSTEM_CLOCK
from ..documents import to_json
from ..gate.asked import GateRequest
from ..processes.task import Estimated, RawRequest
from .content import canonical
from .example import EXAMPLE_DESIGN
from .operation import (
    Body,
    JobRequest,
    LateImport,
    Operation,
    Options,
    Reception,
    score_seconds,
    size_of,
    text_reading_seconds,
)

if TYPE_CHECKING:
    from ..gate.judge import Gate
    from ..settings import Settings


def _receive(sent: RawRequest, settings: Settings) -> Reception | Estimated:
    """An analytic gate that was read, or a job.  Raises what ``gate.request.admit_gate`` raises."""
    from ..gate.judge import judges_losses, rules_of
    from ..gate.request import admit_gate
    from .request import limits_of, parse_json

    admitted = admit_gate(
        parse_json(sent.body, settings, yaml=False),
        today=SYSTEM_CLOCK.today(),
        limits=limits_of(settings),
        max_designs=settings.max_gate_designs,
        max_trials=settings.max_trials,
    )
    complete, gate, terms = admitted.content, admitted.gate, admitted.terms
    if gate.mode == "analytic":
        seconds = sum(
            score_seconds([size_of(entry.design)], losses=judges_losses(rules_of(gate, entry)[1]))
            for entry in gate.designs
            if entry.design is not None
        )
        return Estimated(1.5 * seconds, partial(_answer, gate, terms))
    count = len(complete["designs"])
    name = complete["designs"][0]["file"] + (f" and {count - 1} more" if count > 1 else "")
    return Reception(job=JobRequest("gate", canonical(complete), name), terms=terms)


def _answer(gate: Gate, terms: dict[str, Any]) -> Reception:
    from ..gate.judge import judge

    return Reception(answer=to_json(judge(gate)), terms=terms)


OPERATION = Operation(
    name="gate",
    verb="gate",
    path="/v1/gates",
    summary="Policy and designs to a verdict",
    description="Mode analytic is answered at once; verify and auto become a job.",
    title="answer of gate: verdict, exit code, findings at their places",
    options=Options,
    designs={},
    example={
        "designs": [{"file": "designs/guide.yaml", "design": EXAMPLE_DESIGN}],
        "policy": {
            "schema": "tailstack/policy/1",
            "name": "drill guides",
            "rules": {"p95": {"limit_mm": 0.6}, "overlap": {"min_px": 5.0}},
        },
        "waivers": {
            "schema": "tailstack/waivers/1",
            "waivers": [
                {
                    "rule": "p95",
                    "owner": "J. Doe, systems",
                    "reason": "first article only",
                    "max_value": 0.7,
                    "expires": "2027-01-31",
                }
            ],
        },
        "today": "2026-11-21",
        "mode": "analytic",
    },
    record=LateImport("..gate.records", "GateRecord").load,
    cut=True,
    body=Body(receive=_receive, request=GateRequest, at_once="mode analytic", reading_seconds=text_reading_seconds),
    example_title="One design under a policy, first order, with one finding accepted for now",
    document=LateImport("..report.chapters.gate", "gate_document"),
    exit_code=lambda record: int(record.exit_code),
)
