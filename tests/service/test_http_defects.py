"""Defects of the service itself, put in by these tests, and paths that are odd: what a client and an operator see.

A refusal is placed once, where what was sent has it.
"""

from __future__ import annotations

import asyncio
import json
import logging
import pickle
from collections.abc import Callable
from datetime import date
from typing import Any

import httpx
import pytest
from service_scenes import check_problem, client_with, small_design
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from tailstack.errors import DesignError, IllPosedError, Problem
from tailstack_service.gate.request import admit_gate, read_gate
from tailstack_service.http import computations
from tailstack_service.http.app import create_app
from tailstack_service.operations.content import canonical
from tailstack_service.operations.request import DesignReferenceUnresolved
from tailstack_service.problems import RefusedAt
from tailstack_service.processes.task import RawRequest
from tailstack_service.settings import Settings


class Broken(Response):
    """Fails before its first byte."""

    async def __call__(self, *_: Any) -> None:
        raise RuntimeError("before the head")


async def raising(_request: Request) -> Response:
    raise RuntimeError("in the endpoint")


async def unsendable(_request: Request) -> Response:
    return Broken()


async def torn(_request: Request) -> Response:
    """Fails after its head has left."""

    class Torn(Response):
        async def __call__(self, _scope: Any, _receive: Any, send: Callable[[Any], Any]) -> None:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            raise RuntimeError("after the head")

    return Torn()


def asked(endpoint: Callable[[Request], Any]) -> httpx.Response:
    """The answer of this endpoint, put at /added."""
    app = create_app(Settings(), warm_up=False)
    app.router.routes.append(Route("/added", endpoint))

    async def run() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get("/added", headers={"X-Request-ID": "from-a-test"})

    return asyncio.run(run())


@pytest.mark.parametrize("endpoint", [raising, unsendable])
def test_a_defect_is_a_problem_with_the_id_of_its_log_line(
    endpoint: Callable[[Request], Any], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "tailstack.service"):
        answer = asked(endpoint)
    document = check_problem(answer, 500, "internal-error")
    assert document["request_id"] == answer.headers["x-request-id"] == "from-a-test"
    assert "RuntimeError" not in answer.text
    failed, answered = [vars(record) for record in caplog.records if record.name == "tailstack.service"]
    assert (failed["action"], failed["request"], failed["exc_info"][0]) == ("failed", "from-a-test", RuntimeError)
    assert (answered["action"], answered["status"]) == ("answered", 500)


def test_a_defect_after_the_head_is_logged_and_nothing_is_sent_behind_it(caplog: pytest.LogCaptureFixture) -> None:
    app = create_app(Settings(), warm_up=False)
    app.router.routes.append(Route("/added", torn))
    scope = {
        "type": "http", "method": "GET", "path": "/added", "query_string": b"", "headers": [(b"host", b"localhost")],
    }  # fmt: skip
    sent: list[str] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b""}

    async def send(message: Any) -> None:
        sent.append(message["type"])

    with caplog.at_level(logging.INFO, "tailstack.service"):
        asyncio.run(app(scope, receive, send))
    assert sent == ["http.response.start"]  # uvicorn closes the connection
    assert [vars(record)["action"] for record in caplog.records if record.name == "tailstack.service"] == [
        "failed",
        "answered",
    ]


def test_an_added_route_answers() -> None:
    """The harness itself."""

    async def fine(_request: Request) -> Response:
        return PlainTextResponse("fine")

    assert asked(fine).text == "fine"


@pytest.mark.parametrize(
    ("path", "instance"),
    [
        ("/x%3Fy", "/x%3Fy"),
        ("/x%23y", "/x%23y"),
        ("/x%0Ay", "/x%0Ay"),
        ("/x%5Cy", "/x%5Cy"),
        ("/%C3%A9%20%41", "/%C3%A9%20A"),
        ("/v1/jobs/a;b=c:d@e", "/v1/jobs/a;b=c:d@e"),
    ],
)
def test_instance_is_the_path_as_a_uri_reference(path: str, instance: str) -> None:
    with client_with() as client:
        answer = client.get(path, headers={"Host": "localhost"})
    document = check_problem(answer, 404, "not-found")
    assert document["instance"] == instance


# --- refusals at their place ----------------------------------------------------------------------


NOWHERE = "0" * 64


def test_a_refusal_is_placed_once_and_keeps_what_it_is() -> None:
    error = IllPosedError([Problem("/fiducials", "coplanar", "all in one plane", "move one"), Problem("", "x", "y")])
    placed = RefusedAt.place(error, "/second")
    assert [problem.pointer for problem in placed.problems] == ["/second/fiducials", "/second"]
    assert (placed.slug, placed.title, placed.exit_code) == ("ill-posed-geometry", error.title, 3)
    assert RefusedAt.place(placed, "/design") is placed
    assert [problem.pointer for problem in error.problems] == ["/fiducials", ""], "the error itself stays as it was"


def test_a_refusal_crosses_a_pipe_whole() -> None:
    placed = RefusedAt.place(DesignError(Problem("/views/0", "wrong-type", "a mapping", "", "d.yaml", 3, 1)), "/design")
    there = pickle.loads(pickle.dumps(placed))
    assert isinstance(there, RefusedAt)
    assert (there.problems, there.slug, there.title, there.exit_code, str(there)) == (
        placed.problems, placed.slug, placed.title, placed.exit_code, str(placed),
    )  # fmt: skip


@pytest.mark.parametrize("operation", ["score", "verification", "batch"])
def test_a_design_that_is_named_is_asked_for_whatever_reads_it(operation: str) -> None:
    body = {
        "design_sha256": NOWHERE,
        **({"table": {"/views/0/fiducial_noise_px": [0.1]}} if operation == "batch" else {}),
    }
    sent = RawRequest("json", canonical(body))
    found = computations.perform(lambda: computations.receive(operation, sent, Settings()))
    assert isinstance(found, DesignReferenceUnresolved)
    assert pickle.loads(pickle.dumps(found)).sha256 == NOWHERE


def test_a_patched_design_is_refused_where_the_design_stands_with_the_place_in_the_patch() -> None:
    body = {"design": small_design(), "patch": {"views": 3}}
    found = computations.perform(lambda: computations.receive("score", RawRequest("json", canonical(body)), Settings()))
    assert isinstance(found, RefusedAt)
    (problem,) = found.problems
    assert problem.pointer == "/design/views"
    assert problem.detail.count("/patch/views") == 1


def test_an_admitted_gate_is_the_one_that_its_content_describes() -> None:
    """What is judged at once and what a job would read are one gate."""
    design = {"file": "a.yaml", "text": json.dumps(small_design())}
    admitted = admit_gate({"designs": [design], "mode": "analytic"}, today=date(2026, 11, 21))
    again = read_gate(admitted.content)
    assert (again.seed, again.mode, again.today) == (admitted.gate.seed, admitted.gate.mode, admitted.gate.today)
    assert [entry.design.sha256 for entry in again.designs if entry.design] == [
        entry.design.sha256 for entry in admitted.gate.designs if entry.design
    ]
    assert admitted.terms["policy_sha256"] == again.policy.sha256
