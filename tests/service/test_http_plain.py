"""Requests that are read at a glance: h11 would take each of them and find the same; all others go to h11."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from dataclasses import replace

import h11
import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from service_scenes import client_with, read_answer

from tailstack_service.http import connections
from tailstack_service.http.plain import read_plain
from tailstack_service.settings import Settings

GET = b"GET /health/live HTTP/1.1\r\nHost: localhost\r\n"
POST = b"POST /v1/scores HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


def by_h11(data: bytes) -> tuple[bytes, bytes, list[tuple[bytes, bytes]], bytes, bytes] | None:
    """Method, target, headers, body and what follows, as h11 reads one whole request; None: it refuses, or waits."""
    connection = h11.Connection(h11.SERVER)
    connection.receive_data(data)
    try:
        request = connection.next_event()
        if not isinstance(request, h11.Request) or request.http_version != b"1.1":
            return None
        body = b""
        while isinstance(event := connection.next_event(), h11.Data):
            body += bytes(event.data)
    except h11.RemoteProtocolError:
        return None
    if not isinstance(event, h11.EndOfMessage) or connection.their_state is not h11.DONE:
        return None
    return request.method, request.target, list(request.headers), body, connection.trailing_data[0]


def check_alike(data: bytes) -> bool:
    """Whether the request is plain; then h11 has read the same."""
    plain = read_plain(data)
    if plain is None:
        return False
    end = plain.head_bytes + plain.body_bytes
    filled = data + b"b" * max(0, end - len(data))
    read = plain.method, plain.target, plain.headers, filled[plain.head_bytes : end], filled[end:]
    assert read == by_h11(filled), data
    return True


PLAIN = [
    GET + b"\r\n",
    GET + b"Connection: keep-alive\r\nAccept: */*\r\n\r\n",
    GET + b"CONNECTION:Keep-Alive\r\n\r\n" + GET,
    GET + b"X-Empty:\r\nX-Spaces:   a  b   \r\n\r\n",
    GET + b"Authorization: Bearer a.b.c\r\nPrefer: wait=3\r\n\r\n",
    b"GET /?a=b&c=%20#d HTTP/1.1\r\nHost: a\r\n\r\n",
    b"GET http://localhost/version HTTP/1.1\r\nhost:\r\n\r\n",
    POST + b"Content-Length: 2\r\n\r\n{}",
    POST + b"Content-Length: 002\r\n\r\n{} and more",
    POST + b"Content-Length: 20\r\n\r\n{",
    POST + b"\r\n",
]
FOR_H11 = [
    b"",
    b"G",
    GET,  # the head has not ended
    b"\r\n" + GET + b"\r\n",
    GET.replace(b"GET", b"get") + b"\r\n",
    GET.replace(b"GET", b"HEAD") + b"\r\n",
    GET.replace(b"1.1", b"1.0") + b"\r\n",
    GET.replace(b"1.1", b"2.0") + b"\r\n",
    GET.replace(b" HTTP", b"  HTTP") + b"\r\n",
    GET.replace(b"/health", b"/he alth") + b"\r\n",
    GET.replace(b"/health", b"/he\xffalth") + b"\r\n",
    GET.replace(b"\r\n", b"\n") + b"\n",
    GET.replace(b"Host: localhost\r\n", b"") + b"\r\n",
    GET.replace(b"Host: localhost", b"X: y") + b"\r\n",
    GET + b"Host: localhost\r\n\r\n",
    GET + b"Accept: a\r\nAccept: b\r\n\r\n",
    GET + b"Connection: close\r\n\r\n",
    GET + b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\n\r\n",
    GET + b"Upgrade: websocket\r\n\r\n",
    GET + b"X : y\r\n\r\n",
    GET + b" X: y\r\n\r\n",
    GET + b": y\r\n\r\n",
    GET + b"X\r\n\r\n",
    GET + b"X: y\r\n folded\r\n\r\n",
    GET + b"X: a\tb\r\n\r\n",
    GET + b"X: a\0b\r\n\r\n",
    GET + b"X: a\rb\r\n\r\n",
    GET + b"X: a\nb\r\n\r\n",
    GET + b"X: \xc3\xa4\r\n\r\n",
    GET + b"X(: y\r\n\r\n",
    POST + b"Expect: 100-continue\r\nContent-Length: 2\r\n\r\n",
    POST + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    POST + b"Transfer-Encoding: gzip\r\n\r\n",
    POST + b"Transfer-Encoding: chunked\r\nContent-Length: 2\r\n\r\n{}",
    *(POST + b"Content-Length: " + length + b"\r\n\r\n{}"
      for length in (b"", b"-2", b"+2", b"2, 2", b"2 2", b"0x2", b"1_0", b"many", b"9" * 10, b"9" * 30)),
    POST + b"Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}",
    POST + b"Content-Length: 2\r\nContent-Length: 3\r\n\r\n{}",
]  # fmt: skip


@pytest.mark.parametrize("data", PLAIN)
def test_what_is_plain_h11_reads_alike(data: bytes) -> None:
    assert check_alike(data)


@pytest.mark.parametrize("data", FOR_H11)
def test_what_is_not_is_left_to_h11(data: bytes) -> None:
    assert read_plain(data) is None


PIECES = sorted({piece for data in PLAIN + FOR_H11 for piece in re.findall(rb"[A-Za-z0-9/.-]+|.", data, re.DOTALL)})


@settings(max_examples=1500, deadline=None)
@given(st.sampled_from(PLAIN), st.lists(st.tuples(st.integers(0, 200), st.integers(0, 3), st.sampled_from(PIECES))))
def test_a_plain_request_with_anything_put_into_it_is_left_to_h11_or_read_alike(
    data: bytes, changes: list[tuple[int, int, bytes]]
) -> None:
    for at, removed, put in changes:
        data = data[:at] + put + data[at + removed :]
    check_alike(data)


def test_a_head_that_nearly_matches_costs_time_in_proportion() -> None:
    """No pattern goes back and forth: eight times the length is not sixty-four times the time."""
    seconds = []
    for size in (25_000, 200_000):
        data = GET + b"X: y z\r\n" * (size // 8) + b"X: " + b" " * size + b"\0\r\n\r\n"
        began = time.process_time()
        for _ in range(5):
            assert read_plain(data) is None
        seconds.append(time.process_time() - began)
    assert seconds[1] < 30 * seconds[0] + 0.05


# --- the same conversation with and without --------------------------------------------------------


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with(replace(Settings(), body_seconds=0.5)) as client:
        yield client


def said(client: httpx.Client, pieces: list[bytes]) -> bytes:
    """Everything that is answered to these pieces, each sent a little after the one before, but ids and dates."""
    with socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=20) as connection:
        for piece in pieces:
            connection.sendall(piece)
            time.sleep(0.03)
        connection.shutdown(socket.SHUT_WR)
        received = b""
        while more := connection.recv(65536):
            received += more
    received = re.sub(rb"(?i)(x-request-id: |\"request_id\":\")[0-9a-f]{32}", rb"\1ID", received)
    return re.sub(rb"(?i)date: [^\r]*", b"date: NOW", received)


NO_SCORE = POST + b"Content-Length: 2\r\n\r\n{}"
LAST = GET + b"Connection: close\r\n\r\n"


@pytest.mark.parametrize(
    ("pieces", "answers"),
    [
        ([GET + b"\r\n", NO_SCORE, LAST], 3),
        ([GET + b"\r\n" + NO_SCORE + GET + b"\r\n" + LAST], 4),
        ([NO_SCORE[:-1], NO_SCORE[-1:] + NO_SCORE[:-2], NO_SCORE[-2:] + LAST], 3),
        ([NO_SCORE + GET[:20], GET[20:] + b"\r\n" + LAST], 3),
        ([POST.replace(b"/v1/scores", b"/nowhere") + b"Content-Length: 9\r\n\r\n", b"what ", b"ever" + LAST], 2),
        ([GET.replace(b"GET", b"HEAD") + b"\r\n" + GET + b"\r\n", LAST], 3),
        ([POST + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n", NO_SCORE, LAST], 3),
        ([NO_SCORE, POST + b"Expect: 100-continue\r\nContent-Length: 2\r\n\r\n", b"{}", LAST], 4),
        ([POST + b"Content-Type: text/plain\r\nContent-Length: 2\r\n\r\n{}" + LAST], 2),
    ],
)
def test_a_conversation_is_the_same_as_with_h11_alone(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, pieces: list[bytes], answers: int
) -> None:
    here = said(client, pieces)
    assert here.count(b"HTTP/1.1 ") == answers
    monkeypatch.setattr(connections, "read_plain", lambda data: None)
    assert here == said(client, pieces)


def test_nonsense_after_plain_requests_ends_the_connection(client: httpx.Client) -> None:
    received = said(client, [GET + b"\r\n", NO_SCORE + b"NONSENSE\r\n\r\n" + GET + b"\r\n"])
    assert re.findall(rb"HTTP/1\.1 (\d+)", received) == [b"200", b"422", b"400"]
    assert b"connection: close" in received.lower()


def test_an_answer_that_ends_the_connection_comes_before_the_body(client: httpx.Client) -> None:
    """One that is written at once, and one that is h11's while half of the body is still to come."""
    host = (client.base_url.host, client.base_url.port or 80)
    with socket.create_connection(host, timeout=20) as connection:
        connection.sendall(GET + b"\r\n")
        assert read_answer(connection)[0] == b"HTTP/1.1 200 OK"
        connection.sendall(POST + b"Content-Length: 2\r\n\r\n{")
        status, rest = read_answer(connection)
        assert status == b"HTTP/1.1 408 Request Timeout"
        assert b"connection: close" in rest.lower()
        assert connection.recv(1) == b""
