"""What connections do that no well-behaved client library would: stall, break off, announce and not send.

Who stays connected has places, of which a tenant has a share.
"""

from __future__ import annotations

import select
import socket
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import jwt
import pytest
from service_scenes import check_problem, client_with, read_answer, small_design
from starlette.requests import Request

from tailstack_service.http import server
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

HEAD = b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
QUICK = Settings(body_seconds=0.3, max_body_bytes=50_000)
CLIENT = {"settings": QUICK}


@pytest.fixture(scope="module")
def patient() -> Iterator[httpx.Client]:
    """For bodies that come to their end, however slow the machine is."""
    with client_with(QUICK.model_copy(update={"body_seconds": LIMIT_SECONDS})) as client:
        yield client


def connect(client: httpx.Client) -> socket.socket:
    return socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=LIMIT_SECONDS)


def something_came(connection: socket.socket) -> bool:
    """Whether the other side has said something, or closed the connection."""
    return bool(select.select([connection], [], [], 0)[0])


def said_until_closed(connection: socket.socket, drip: bytes = b"") -> bytes:
    """What the other side says until it closes the connection; ``drip`` is sent again and again until it says so."""

    def answered_a_drip() -> bool:
        with suppress(OSError):  # it is closed already: what was said before is read all the same
            connection.sendall(drip)
        return something_came(connection)

    received = b""
    if drip:
        until(answered_a_drip)
    while more := connection.recv(65536):
        received += more
    return received


@pytest.mark.parametrize("drip", [b"", b" "])
def test_a_body_that_never_comes_or_drips_is_408_and_the_connection_is_closed(
    client: httpx.Client, drip: bytes
) -> None:
    """A body of which something always comes is never complete: it would be read for ever."""
    with connect(client) as connection:
        connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 100000\r\n\r\n{")
        received = said_until_closed(connection, drip)
    assert received.startswith(b"HTTP/1.1 408 Request Timeout")
    assert b"/v1/problems/body-timeout" in received
    assert b"after %g s; " % QUICK.body_seconds in received
    assert drip or b"; 1 bytes arrived" in received
    assert b"connection: close" in received.lower()


@pytest.fixture
def pieces(monkeypatch: pytest.MonkeyPatch) -> list[bytes | None]:
    """Of the bodies of requests, as the service reads them: None when it begins to wait for one, then what came."""
    seen: list[bytes | None] = []
    receive = vars(Request)["receive"].fget

    def watched(request: Request) -> Callable[[], Awaitable[Any]]:
        inner = receive(request)

        async def reading() -> Any:
            seen.append(None)
            message = await inner()
            seen.append(message.get("body", b""))
            return message

        return reading

    monkeypatch.setattr(Request, "receive", property(watched))
    return seen


def test_a_kept_connection_serves_one_request_after_another(patient: httpx.Client, pieces: list[bytes | None]) -> None:
    """Each body in two pieces."""
    with connect(patient) as connection:
        for _ in range(4):
            pieces.clear()
            connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 2\r\n\r\n{")
            until(lambda: b"{" in pieces, lambda: pieces)
            connection.sendall(b"}")
            status, _ = read_answer(connection)
            assert status.split(b" ")[:2] == [b"HTTP/1.1", b"422"]  # Python 3.13 has another phrase


def test_a_body_that_breaks_off_hurts_nobody(client: httpx.Client) -> None:
    with connect(client) as connection:
        connection.sendall(HEAD % b"/v1/scores" + b"Content-Length: 1000\r\n\r\n{")
    assert client.get("/health/live").status_code == 200


@pytest.mark.parametrize(
    "head",
    [
        b"NONSENSE\r\n\r\n",
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


@pytest.mark.parametrize(
    ("begin", "code", "end"),
    [
        (b"GET /" + b"x" * 70_000, b"400", b"Invalid HTTP request received."),
        (HEAD % b"/v1/scores" + b"Content-Length: 49000\r\n\r\n{", b"408", b"}"),
    ],
)
def test_a_refusal_arrives_whole_while_its_sender_goes_on_sending(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, begin: bytes, code: bytes, end: bytes
) -> None:
    """A socket that is closed altogether answers with a reset, and the refusal may be lost with it."""
    monkeypatch.setattr(server, "LAST_SECONDS", LIMIT_SECONDS)
    with connect(client) as connection:
        connection.sendall(begin)
        status, rest = read_answer(connection)
        assert status.split()[1] == code
        assert rest.endswith(end)
        assert connection.recv(1) == b""  # the service has closed its side
        for _ in range(20):
            connection.sendall(b"x" * 100_000)


def test_who_never_stops_sending_after_a_refusal_is_cut_off(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "LAST_SECONDS", 0.1)
    with connect(client) as connection:
        connection.sendall(b"NONSENSE\r\n\r\n")
        assert said_until_closed(connection, b"x").startswith(b"HTTP/1.1 400 ")

        def cut_off() -> bool:
            with suppress(ConnectionError):
                return not connection.send(b"x")
            return True

        until(cut_off)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("path", [b"/v1/scores", b"/nowhere", b"/health/live"])
def test_what_stops_being_http_is_told_in_a_line_and_no_traceback(
    client: httpx.Client, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture,
    pieces: list[bytes | None], path: bytes, late: bool,
) -> None:  # fmt: skip
    """A stranger without a key could otherwise fill the disk: two kilobytes of log for seventy bytes."""
    with connect(client) as connection:
        connection.sendall(HEAD % path + b"Transfer-Encoding: chunked\r\n\r\n")
        if late:  # what is answered without the body has its answer by then
            until(lambda: something_came(connection) or pieces)
        connection.sendall(b"ZZZ\r\n\r\n")
        received = said_until_closed(connection)
    assert received.startswith(b"HTTP/1.1 ")
    assert client.get("/health/live").status_code == 200
    assert not any(record.exc_info for record in caplog.records)
    assert sum(len(record.getMessage()) for record in caplog.records) < 300
    assert "Traceback" not in capfd.readouterr().err


def test_a_request_with_two_lengths_ends_its_connection(client: httpx.Client) -> None:
    """What a proxy would take for the next request is not answered as one."""
    for path in (b"/v1/scores", b"/nowhere"):
        with connect(client) as connection:
            head = HEAD % path + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
            connection.sendall(head + b"0\r\n\r\nGET /version HTTP/1.1\r\nHost: localhost\r\n\r\n")
            received = said_until_closed(connection)
        assert received.count(b"HTTP/1.1 ") == 1
        assert received.startswith(b"HTTP/1.1 400 Bad Request")
        assert b'"two-lengths"' in received
        assert b"connection: close" in received.lower()


def test_a_long_body_is_read_off_so_that_its_refusal_arrives(patient: httpx.Client) -> None:
    body = b" " * 5_000_000
    response = patient.post("/v1/scores", content=body, headers={"Content-Type": "application/json"})
    check_problem(response, 413, "limit-exceeded")


# --- places for who stays connected ---------------------------------------------------------------


SECRET = "a shared secret of at least 32 bytes"
NEVER = 4_102_444_800  # the year 2100
LONG = {"design": small_design(), "trials": 3000}


def token(tenant: str) -> dict[str, str]:
    claims = {"iss": "tests", "aud": "tailstack", "tenant": tenant, "scope": "read compute", "exp": NEVER}
    return {"Authorization": f"Bearer {jwt.encode(claims, SECRET, algorithm='HS256')}"}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A service without a worker: jobs stay queued, and streams open."""
    secret: Path = tmp_path_factory.mktemp("keys") / "secret"
    secret.write_text(SECRET, encoding="utf-8")
    settings = Settings(
        auth="required", jwt_key_file=str(secret), jwt_algorithm="HS256", jwt_issuer="tests", max_streams=5,
        max_tenant_streams=2, max_wait_seconds=600.0,
    )  # fmt: skip
    with client_with(settings) as keyed:
        yield keyed


@contextmanager
def streams(keyed: httpx.Client, path: str, count: int, headers: dict[str, str]) -> Iterator[None]:
    with ExitStack() as stack:
        opened = [stack.enter_context(keyed.stream("GET", path, headers=headers)) for _ in range(count)]
        lines = [stream.iter_lines() for stream in opened]  # kept: one that is dropped closes its stream
        assert [next(each) for each in lines] == ["retry: 1000"] * count
        yield


def job_of(keyed: httpx.Client, headers: dict[str, str]) -> dict[str, Any]:
    return keyed.post("/v1/verifications", json={**LONG, "seed": 1}, headers=headers).json()


def test_one_tenant_cannot_take_all_places(keyed: httpx.Client) -> None:
    a, b, c = (token(name) for name in "abc")
    jobs = {name: job_of(keyed, headers) for name, headers in (("a", a), ("b", b), ("c", c))}
    paths = {name: job["links"]["events"] for name, job in jobs.items()}
    with streams(keyed, paths["a"], 2, a):
        refused = keyed.get(paths["a"], headers=a)
        document = check_problem(refused, 429, "too-many-streams")
        assert document["errors"][0]["detail"] == "2 event streams and waits of one tenant are open, the limit"
        assert "TAILSTACK_MAX_TENANT_STREAMS" in document["errors"][0]["hint"]
        assert int(refused.headers["retry-after"]) > 0
        waited = keyed.post("/v1/verifications", json={**LONG, "seed": 2}, headers={**a, "Prefer": "wait=600"})
        assert waited.status_code == 202, "a wait is a wish, and has the same places"  # longer than the keyed waits
        with streams(keyed, paths["b"], 2, b), streams(keyed, paths["c"], 1, c):
            busy = check_problem(keyed.get(paths["c"], headers=c), 503, "busy")
            assert busy["errors"][0]["detail"] == "5 event streams and waits are open, the limit"
    keyed.post(jobs["a"]["links"]["cancel"], headers=a)
    answers: list[httpx.Response] = []

    def let_in() -> bool:
        answers.append(keyed.get(paths["a"], headers=a))
        return answers[-1].status_code == 200

    until(let_in, says=lambda: answers[-1].text)  # the service notices when it next has something to say
    assert '"state":"cancelled"' in answers[-1].text


def test_who_is_alone_has_all_places() -> None:
    """Without authentication there is one tenant."""
    with client_with(Settings(max_streams=3, max_tenant_streams=1)) as keyed:
        path = job_of(keyed, {})["links"]["events"]
        with streams(keyed, path, 3, {}):
            busy = keyed.get(path)
            check_problem(busy, 503, "busy")
            assert int(busy.headers["retry-after"]) > 0
