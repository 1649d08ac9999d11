"""``POST /v1/gates``: designs held to a policy; first order at once, Monte Carlo as a job."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from tailstack.errors import TailstackError

from ..settings import Settings
from ..work.requests import canonical
from .answers import record_response
from .asked import from_text, refuse_query
from .auditing import note_policy
from .bodies import content_kind, limits_of, parse_json, read_body
from .jobs import single
from .operations import in_short_lane
from .posting import Posted, submitted
from .preferences import idempotency_key
from .service import service_of

IN_QUERY = ("mode", "seed", "fail_level", "on_inconclusive")  # what a single design as YAML can be asked with
YAML_NAME = "design.yaml"  # what findings call such a design
IN_REQUEST = "/designs/0/text"  # where it stands in the request that the body and the query make


async def create_gate(request: Request) -> Response:
    """200 with the record in mode analytic, otherwise a job.  Raises what ``admitted`` raises."""
    settings = service_of(request).settings
    kind = content_kind(request, yaml=True)
    body = await read_body(request, settings)
    if kind == "json":
        refuse_query(request, (), "options go into the body, beside the designs")
        data = parse_json(body, settings)
    else:
        refuse_query(request, IN_QUERY)
        data = _of_one(request, body)
    key = idempotency_key(request)
    try:
        terms, answer = await in_short_lane(request, lambda: _answer(data, settings))
    except TailstackError as error:
        if kind == "yaml":  # the design is the body: pointers start inside it
            error.problems = tuple(replace(p, pointer=p.pointer.removeprefix(IN_REQUEST)) for p in error.problems)
        raise
    await note_policy(request, terms)
    if isinstance(answer, Posted):
        return await submitted(request, answer, key)
    return record_response(answer)


def _of_one(request: Request, body: bytes) -> dict[str, Any]:
    """The request that a YAML body and the query stand for."""
    from ..gate.request import GateRequest

    data: dict[str, Any] = {"designs": [{"file": YAML_NAME, "text": body.decode("utf-8", "surrogateescape")}]}
    properties = GateRequest.model_json_schema()["properties"]
    for name in IN_QUERY:
        value = single(request, name)
        if value is not None:
            data[name] = from_text(value, properties[name])
    return data


def _answer(data: dict[str, Any], settings: Settings) -> tuple[dict[str, Any], Any]:
    """The terms of a gate, and the record of an analytic one, or what becomes a job."""
    from ..gate.request import admitted, evaluate, terms_of

    today = datetime.now(UTC).date()
    complete = admitted(
        data,
        today=today,
        limits=limits_of(settings),
        max_designs=settings.max_gate_designs,
        max_trials=settings.max_trials,
    )
    if complete["mode"] == "analytic":
        return terms_of(complete), evaluate(complete)
    count = len(complete["designs"])
    name = complete["designs"][0]["file"] + (f" and {count - 1} more" if count > 1 else "")
    return terms_of(complete), Posted("gate", canonical(complete), name)
