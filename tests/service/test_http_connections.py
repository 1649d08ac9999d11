"""What connections do that no well-behaved client library would: stall, break off, announce and not send."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from dataclasses import replace

import httpx
import pytest
from service_scenes import check_problem, client_with, read_answer

from tailstack_service.settings import Settings

HEAD = b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
QUICK = replace(Settings(), body_seconds=0.3, max_body_bytes=50_000)


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
