"""Slow clients, real ones, before the proxy of docker/nginx.conf: they end there, and the service never sees them."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
import psutil
import pytest
from postgres import required
from service_scenes import ROOT, check_problem, client_with, small_design

from family import die_with_parent
from tailstack_service.settings import Settings
from waiting import until

NGINX = shutil.which("nginx") or "/usr/sbin/nginx"
pytestmark = pytest.mark.skipif(
    not Path(NGINX).exists() and not required("nginx"), reason="NOT TESTED: nginx is not installed"
)
HEAD = b"POST /v1/scores HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


def quick(conf: str, folder: Path, listen: int, api: int) -> str:
    """The file with its times in tenths, on this machine's ports, and its files in a folder."""
    conf = re.sub(r"(client_header_timeout|client_body_timeout|send_timeout) (\d+)0s;", r"\1 \2s;", conf)
    conf = conf.replace("listen 8080;", f"listen 127.0.0.1:{listen};")
    for name, port in (("api-1:8321", api), ("api-2:8321", 9)):
        conf = conf.replace(f"server {name}", f"server 127.0.0.1:{port}")
    return conf.replace("/tmp/", f"{folder}/")


@contextmanager
def before(api: int, folder: Path) -> Iterator[int]:
    """The proxy's port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (folder / "nginx.conf").write_text(quick((ROOT / "docker" / "nginx.conf").read_text(), folder, port, api))
    command = [NGINX, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]
    command += ["-g", "daemon off; master_process off;"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, preexec_fn=die_with_parent)
    try:
        deadline = time.monotonic() + 300
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=5).close()
                break
            except OSError:
                assert process.poll() is None, process.communicate()[1]
                assert time.monotonic() < deadline
                time.sleep(0.05)
        yield port
    finally:
        process.terminate()
        process.communicate(timeout=300)


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, httpx.Client]]:
    """The proxy's port, and a client of the service behind it."""
    folder = tmp_path_factory.mktemp("nginx")
    with client_with(Settings()) as service, before(service.base_url.port or 0, folder) as port:
        yield port, service


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=300)


def seconds_until_closed(connection: socket.socket, drip: bytes = b"") -> float:
    connection.settimeout(0.2)
    begun = time.monotonic()
    while True:
        assert time.monotonic() - begun < 300
        try:
            if drip:
                connection.sendall(drip)
            if not connection.recv(65536):
                break
        except TimeoutError:
            continue
        except OSError:
            break
    return time.monotonic() - begun


def connections_to(service: httpx.Client) -> int:
    """That the service has open; the proxy keeps idle ones for a while, at most one for each request under way."""
    port = service.base_url.port
    every = psutil.Process().net_connections("tcp")
    return sum(c.laddr.port == port and c.status == psutil.CONN_ESTABLISHED for c in every)


@pytest.mark.parametrize(
    ("begun", "drip"), [(b"", b""), (b"G", b""), (b"GET /health/live HTTP/1.1\r\n", b"x-a: b\r\n")]
)
def test_a_head_that_never_ends_is_ended(places: tuple[int, httpx.Client], begun: bytes, drip: bytes) -> None:
    with connect(places[0]) as connection:
        connection.sendall(begun)
        assert seconds_until_closed(connection, drip) > 0.5


def test_a_body_that_stops_coming_is_ended(places: tuple[int, httpx.Client]) -> None:
    with connect(places[0]) as connection:
        connection.sendall(HEAD + b"Content-Length: 1000\r\n\r\n{")
        assert seconds_until_closed(connection) > 1.0


@pytest.mark.long
def test_a_body_that_drips_never_reaches_the_service(places: tuple[int, httpx.Client]) -> None:
    port, service = places
    until(lambda: connections_to(service) <= 1)  # what the proxy kept open is closed
    opened = []
    try:
        for _ in range(20):
            opened.append(connect(port))
            opened[-1].sendall(HEAD + b"Content-Length: 1000\r\n\r\n{")
        for _ in range(3):
            time.sleep(0.3)
            for connection in opened:
                with suppress(OSError):  # ended meanwhile, on a busy machine
                    connection.sendall(b" ")
        assert connections_to(service) <= 1  # that of the test itself
        assert service.get("/health/live").status_code == 200
    finally:
        for connection in opened:
            connection.close()


@pytest.mark.long
def test_an_answer_that_nobody_takes_leaves_the_service_at_once(places: tuple[int, httpx.Client]) -> None:
    """Large answers are asked for, and none is read."""
    port, service = places
    assert len(service.get("/openapi.json").content) > 150_000
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(20)
        connection.connect(("127.0.0.1", port))
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 100)
        until(lambda: connections_to(service) <= 3)
        time.sleep(8)
        connection.settimeout(0.5)
        received = 0
        try:
            while more := connection.recv(65536):
                received += len(more)
        except OSError:
            pass
    assert received < 100 * 150_000, "send_timeout ends who takes nothing"


@pytest.mark.long
def test_event_streams_come_as_they_happen_and_refusals_as_they_are(places: tuple[int, httpx.Client]) -> None:
    port, _ = places
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=300, trust_env=False) as client:
        job = client.post("/v1/verifications", json={"design": small_design(), "trials": 1000}).json()
        with client.stream("GET", job["links"]["events"]) as stream:
            lines = stream.iter_lines()
            assert next(lines) == "retry: 1000"
            while not next(lines).startswith("event: state"):
                pass
        refused = client.post("/v1/scores", content=b" " * 2_000_000, headers={"Content-Type": "application/json"})
        check_problem(refused, 413, "limit-exceeded")
