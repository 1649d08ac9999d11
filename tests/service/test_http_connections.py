"""What connections do that no well-behaved client library would: stall, break off, announce and not send."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import httpx
import pytest
from jsonschema import Draft202012Validator
from service_scenes import check_problem, client_with, read_answer

from tailstack_service.documents import json_schema
from tailstack_service.http.connections import GRACE_SECONDS, Gathering
from tailstack_service.settings import Settings

HEAD = b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
ANSWER = b"HTTP/1.1 200 OK\r\ncontent-length: 4\r\n\r\n"
QUICK = replace(Settings(), head_seconds=0.4, body_seconds=0.3, answer_seconds=0.5, max_body_bytes=50_000)


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


def seconds_until_closed(connection: socket.socket, drip: bytes = b"") -> tuple[float, bytes]:
    """How long the other side keeps the connection, and what it said; ``drip`` is sent again and again meanwhile."""
    connection.settimeout(0.1)
    began, received = time.monotonic(), b""
    while time.monotonic() - began < 15:
        try:
            if drip:
                connection.sendall(drip)
            more = connection.recv(65536)
        except TimeoutError:
            continue
        except OSError:  # what was sent after the end is answered with a reset
            break
        if not more:
            break
        received += more
    return time.monotonic() - began, received


@pytest.mark.parametrize(
    ("begun", "drip"),
    [
        (b"G", b""),
        (b"GET /health/live HT", b""),
        (b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n", b""),
        (b"GET /health/live HTTP/1.1\r\n", b"x-a: b\r\n"),
    ],
)
def test_a_head_that_never_ends_is_408(client: httpx.Client, begun: bytes, drip: bytes) -> None:
    with connect(client) as connection:
        connection.sendall(begun)
        took, received = seconds_until_closed(connection, drip)
    assert 0.3 < took < 3
    head, _, body = received.rpartition(b"\r\n\r\n")
    assert b"HTTP/1.1 408 Request Timeout" in head
    assert b"connection: close" in head.lower()
    document = json.loads(body)
    Draft202012Validator(json_schema("problem")).validate(document)
    assert document["type"] == "/v1/problems/head-timeout"
    assert "TAILSTACK_HEAD_SECONDS" in document["errors"][0]["hint"]
    assert f"x-request-id: {document['request_id']}".encode() in head.lower()


def test_a_connection_that_says_nothing_is_closed_without_a_word(client: httpx.Client) -> None:
    with connect(client) as connection:
        took, received = seconds_until_closed(connection)
    assert (0.3 < took < 3, received) == (True, b"")


@pytest.mark.parametrize("path", [b"/v1/scores", b"/health/live", b"/nowhere"])
def test_a_body_that_drips_for_ever_is_cut_off_even_where_none_is_read(client: httpx.Client, path: bytes) -> None:
    with connect(client) as connection:
        connection.sendall(HEAD % path + b"Content-Length: 100000\r\n\r\n")
        took, received = seconds_until_closed(connection, b" ")
    assert took < 0.3 + GRACE_SECONDS + 2
    assert received.startswith(b"HTTP/1.1 4")


def test_an_answer_that_nobody_takes_is_cut_off(client: httpx.Client) -> None:
    """Many large answers asked for at once, none of them read: more than what fits on the way."""
    ask = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(20)
        connection.connect((client.base_url.host, client.base_url.port or 80))
        connection.sendall(ask * 100)
        time.sleep(3)
        _, received = seconds_until_closed(connection)
    assert received.count(b"HTTP/1.1 200 OK") < 100
    assert client.get("/health/live").status_code == 200


def test_a_kept_connection_serves_one_request_after_another(client: httpx.Client) -> None:
    """Longer in all than a head may take, and a body in two pieces."""
    with connect(client) as connection:
        for _ in range(4):
            connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 2\r\n\r\n{")
            time.sleep(0.15)
            connection.sendall(b"}")
            status, _ = read_answer(connection)
            assert status == b"HTTP/1.1 422 Unprocessable Entity"


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


def test_a_request_with_two_lengths_ends_its_connection(client: httpx.Client) -> None:
    """What a proxy would take for the next request is not answered as one."""
    for path in (b"/v1/scores", b"/nowhere"):
        with connect(client) as connection:
            head = HEAD % path + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
            connection.sendall(head + b"0\r\n\r\nGET /version HTTP/1.1\r\nHost: localhost\r\n\r\n")
            _, received = seconds_until_closed(connection)
        assert received.count(b"HTTP/1.1 ") == 1
        assert received.startswith(b"HTTP/1.1 400 Bad Request")
        assert b'"two-lengths"' in received
        assert b"connection: close" in received.lower()


def test_a_long_body_is_read_off_so_that_its_refusal_arrives(client: httpx.Client) -> None:
    body = b" " * 5_000_000
    response = client.post("/v1/scores", content=body, headers={"Content-Type": "application/json"})
    check_problem(response, 413, "limit-exceeded")


class Wire:
    """Stands for a transport; keeps what was written, packet by packet."""

    def __init__(self) -> None:
        self.packets: list[bytes] = []
        self.closed_after = -1

    def write(self, data: bytes) -> None:
        if data:
            self.packets.append(data)

    def close(self) -> None:
        self.closed_after = len(self.packets)

    def is_closing(self) -> bool:
        return self.closed_after >= 0


def test_the_head_of_an_answer_waits_for_its_body_but_not_for_long() -> None:
    async def story() -> None:
        wire = Wire()
        gathering = Gathering(cast(asyncio.Transport, wire), asyncio.get_running_loop())
        gathering.write(ANSWER)
        gathering.write(b"body")
        gathering.write(b"")
        assert wire.packets == [ANSWER + b"body"]
        gathering.write(ANSWER)
        assert len(wire.packets) == 1
        await asyncio.sleep(0)
        assert wire.packets[1:] == [ANSWER]
        gathering.write(b"event")
        assert wire.packets[2:] == [b"event"]
        gathering.write(ANSWER)
        gathering.close()
        assert wire.packets[3:] == [ANSWER]
        assert wire.closed_after == 4
        assert gathering.is_closing()
        await asyncio.sleep(0)
        assert len(wire.packets) == 4

    asyncio.run(story())
