"""What connections do that no well-behaved client library would: stall, break off, announce and not send."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from dataclasses import replace

import httpx
import pytest
from service_scenes import check_problem, client_with, read_answer, small_design

from tailstack_service.settings import Settings

HEAD = b"POST %b HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
QUICK = replace(Settings(), body_seconds=0.3, max_body_bytes=50_000, max_trials=1_000_000_000)


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with(QUICK) as client:
        yield client


def connect(client: httpx.Client) -> socket.socket:
    return socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=20)


def test_a_body_that_never_comes_is_408_and_the_connection_is_closed(client: httpx.Client) -> None:
    with connect(client) as connection:
        connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 1000\r\n\r\n{")
        status, rest = read_answer(connection)
    assert status == b"HTTP/1.1 408 Request Timeout"
    assert b"1 bytes arrived" in rest
    assert b"connection: close" in rest.lower()


def test_a_body_that_breaks_off_hurts_nobody(client: httpx.Client) -> None:
    with connect(client) as connection:
        connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 1000\r\n\r\n{")
    assert client.get("/health/live").status_code == 200


@pytest.mark.parametrize(
    "head",
    [
        b"NONSENSE\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        HEAD % b"/v1/scores" + b"Content-Length: -5\r\n\r\n",
        HEAD % b"/v1/scores" + b"Content-Length: many\r\n\r\n",
        HEAD % b"/v1/scores" + b"Transfer-Encoding: chunked\r\n\r\nZZ\r\n",
        b"GET /" + b"x" * 100_000 + b" HTTP/1.1\r\n\r\n",
    ],
)
def test_what_is_not_http_is_refused(client: httpx.Client, head: bytes) -> None:
    with connect(client) as connection:
        connection.sendall(head)
        status, _ = read_answer(connection)
    assert status.startswith(b"HTTP/1.1 4"), status
    assert client.get("/health/live").status_code == 200


def test_a_long_body_is_read_off_so_that_its_refusal_arrives(client: httpx.Client) -> None:
    body = b" " * 5_000_000
    response = client.post("/v1/scores", content=body, headers={"Content-Type": "application/json"})
    check_problem(response, 413, "limit-exceeded")


def test_a_client_that_leaves_frees_its_place() -> None:
    settings = replace(QUICK, long_workers=1, max_waiting=0, max_seconds=600.0)
    with client_with(settings) as client:
        warm = {"design": small_design(), "trials": 100}
        assert client.post("/v1/verifications", json=warm).status_code == 200
        content = json.dumps({"design": small_design(), "trials": 1_000_000_000}).encode()
        with connect(client) as connection:
            connection.sendall(HEAD % b"/v1/verifications" + b"Content-Length: %d\r\n\r\n" % len(content) + content)
            time.sleep(0.5)  # the only request there is: it has the place by now
            check_problem(client.post("/v1/verifications", json=warm), 503, "busy")
        deadline = time.monotonic() + 20
        while client.post("/v1/verifications", json=warm).status_code != 200:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_an_optimisation_over_the_limit_on_seconds_is_ended() -> None:
    with client_with(replace(QUICK, max_seconds=0.1)) as client:
        response = client.post("/v1/optimisations", json={"design": small_design(), "starts": 32})
        entry = check_problem(response, 422, "limit-exceeded")["errors"][0]
    assert entry["code"] == "too-long"
    assert "TAILSTACK_MAX_SECONDS" in entry["hint"]
