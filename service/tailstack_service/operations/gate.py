"""Designs held to a policy: findings, exit code, and what changed since a baseline."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from tailstack.errors import TailstackError

from ..clock import SYSTEM_CLOCK
from ..gate.asked import GateRequest
from ..processes.task import Estimated
from .content import canonical
from .effort import score_seconds, size_of, text_reading_seconds
from .example import EXAMPLE_DESIGN
from .operation import Body, Call, JobRequest, LateImport, Operation, Reception
from .options import Options

if TYPE_CHECKING:
    from ..gate.judge import Gate
    from ..gate.records import GateRecord
    from ..processes.task import Query, RawRequest
    from ..settings import Settings

QUERY = ("mode", "seed", "fail_level", "on_inconclusive")  # what a single design as YAML can be asked with
FILE = "design.yaml"  # what findings call such a design
TEXT = "/designs/0/text"  # where it stands in the request that the body and the query make


def _receive(sent: RawRequest, settings: Settings) -> Reception | Estimated:
    """An analytic gate that was read, or a job.  Raises what ``gate.request.admit_gate`` raises."""
    from .request import parse_json, refuse_query

    if sent.form == "json":
        return _admit(parse_json(sent.body, settings), settings)
    refuse_query(sent.query, QUERY)
    try:
        return _admit(_request_of_one(sent.body, sent.query), settings)
    except TailstackError as error:  # the design is the body: pointers start inside it
        error.problems = tuple(replace(p, pointer=p.pointer.removeprefix(TEXT)) for p in error.problems)
        raise


def _request_of_one(body: bytes, query: Query) -> dict[str, Any]:
    """The request that a YAML body and the query stand for."""
    from .request import from_text, single

    data: dict[str, Any] = {"designs": [{"file": FILE, "text": body.decode("utf-8", "surrogateescape")}]}
    properties = GateRequest.model_json_schema()["properties"]
    for name in QUERY:
        value = single(query, name)
        if value is not None:
            data[name] = from_text(value, properties[name])
    return data


def _admit(data: dict[str, Any], settings: Settings) -> Reception | Estimated:
    from ..gate.judge import judges_losses, rules_of
    from ..gate.request import admit_gate
    from .request import limits_of

    admitted = admit_gate(
        data,
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
    from ..documents import to_json
    from ..gate.judge import judge

    return Reception(answer=to_json(judge(gate)), terms=terms)


def _judge(call: Call) -> GateRecord:
    raise NotImplementedError("a gate is received with its policy, not as a design")


def _query() -> dict[str, Any]:
    properties = GateRequest.model_json_schema()["properties"]
    return {name: properties[name] for name in QUERY}


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
    run=_judge,
    cut=True,
    body=Body(
        receive=_receive,
        query=_query,
        request=GateRequest,
        at_once="mode analytic",
        reading_seconds=text_reading_seconds,
    ),
    example_title="One design under a policy, first order, with one finding accepted for now",
    document=LateImport("..report.chapters.gate", "gate_document"),
    exit_code=lambda record: int(record.exit_code),
)
