"""Slow clients, real ones, before the proxy of docker/nginx.conf: they end there, and the service never sees them."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from postgres import required
from service_scenes import ROOT, check_problem, client_of, client_with, read_answer, small_design

from family import die_with_parent, ended
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

NGINX = shutil.which("nginx") or "/usr/sbin/nginx"
pytestmark = pytest.mark.skipif(
    not Path(NGINX).exists() and not required("nginx"), reason="NOT TESTED: nginx is not installed"
)
Places = tuple["Proxy", httpx.Client]  # the proxy, and a client of the service behind it
SLOW_HEAD = "client timed out .* while (waiting for|reading client) request"
SLOW_BODY = '"POST /v1/scores HTTP/1.1" 408 '
SLOW_READER = "client timed out .* while sending"
HEAD = b"POST /v1/scores HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


def quick(conf: str, folder: Path, listen: int, api: int) -> str:
    """The file with its times in tenths, on this machine's ports, its files in a folder, and a log of whom it ends."""
    conf = re.sub(r"(client_header_timeout|client_body_timeout|send_timeout) (\d+)0s;", r"\1 \2s;", conf)
    conf = conf.replace("listen 8080;", f"listen 127.0.0.1:{listen};")
    for name, port in (("api-1:8321", api), ("api-2:8321", 9)):
        conf = conf.replace(f"server {name}", f"server 127.0.0.1:{port}")
    conf = conf.replace("error_log stderr warn;", "error_log /tmp/error.log info;")
    conf = re.sub("access_log off;.*", "access_log /tmp/access.log;", conf)
    return conf.replace("/tmp/", f"{folder}/")


@dataclass(frozen=True, slots=True)
class Proxy:
    """A proxy that runs: its port, and the folder in which it says whom it ended."""

    port: int
    folder: Path

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=LIMIT_SECONDS)

    def log(self) -> str:
        return "".join(path.read_text() for path in sorted(self.folder.glob("*.log")))

    def ended(self, words: str) -> int:
        """How often it has ended a client that was slow, by its own words."""
        return len(re.findall(words, self.log()))


@contextmanager
def before(api: int, folder: Path) -> Iterator[Proxy]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (folder / "nginx.conf").write_text(quick((ROOT / "docker" / "nginx.conf").read_text(), folder, port, api))
    command = [NGINX, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]
    command += ["-g", "daemon off; master_process off;"]
    proxy = Proxy(port, folder)
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=die_with_parent
    )

    def answers() -> bool:
        assert process.poll() is None, proxy.log()
        with suppress(OSError), proxy.connect():
            return True
        return False

    with ended(process):
        until(answers, says=proxy.log)
        yield proxy


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Places]:
    folder = tmp_path_factory.mktemp("nginx")
    with client_with(Settings()) as service, before(service.base_url.port or 0, folder) as proxy:
        yield proxy, service


def closed(connection: socket.socket, drip: bytes = b"") -> bool:
    """Whether the other end has closed; what drips is sent once more, and what was answered is thrown away."""
    connection.settimeout(0.01)
    try:
        if drip:
            connection.sendall(drip)
        return not connection.recv(65536)
    except TimeoutError:
        return False
    except OSError:
        return True


def connections_to(service: httpx.Client) -> int:
    """That the service has open; the proxy keeps idle ones for a while, at most one for each request under way."""
    port = service.base_url.port
    every = psutil.Process().net_connections("tcp")
    return sum(c.laddr.port == port and c.status == psutil.CONN_ESTABLISHED for c in every)


@pytest.mark.parametrize(
    ("begun", "drip"), [(b"", b""), (b"G", b""), (b"GET /health/live HTTP/1.1\r\n", b"x-a: b\r\n")]
)
def test_a_head_that_never_ends_is_ended(places: Places, begun: bytes, drip: bytes) -> None:
    proxy, _ = places
    ended_before = proxy.ended(SLOW_HEAD)
    with proxy.connect() as connection:
        connection.sendall(begun)
        until(lambda: closed(connection, drip), says=proxy.log)
    until(lambda: proxy.ended(SLOW_HEAD) == ended_before + 1, says=proxy.log)


def test_a_body_that_stops_coming_is_ended(places: Places) -> None:
    proxy, _ = places
    ended_before = proxy.ended(SLOW_BODY)
    with proxy.connect() as connection:
        connection.sendall(HEAD + b"Content-Length: 1000\r\n\r\n{")
        until(lambda: closed(connection), says=proxy.log)
    until(lambda: proxy.ended(SLOW_BODY) == ended_before + 1, says=proxy.log)


@pytest.mark.long
def test_a_body_that_drips_never_reaches_the_service(places: Places) -> None:
    proxy, service = places
    with ExitStack() as stack:
        opened = [stack.enter_context(proxy.connect()) for _ in range(20)]
        for connection in opened:
            connection.sendall(HEAD + b"Content-Length: 1000\r\n\r\n{")
        for _ in range(3):
            for connection in opened:
                with suppress(OSError):  # ended meanwhile, on a busy machine
                    connection.sendall(b" ")
            # refused by the proxy itself, which reads in the order in which it is sent to: it has read the drops
            with proxy.connect() as last:
                last.sendall(HEAD + b"Content-Length: 9000000\r\n\r\n")
                assert read_answer(last)[0].startswith(b"HTTP/1.1 413 ")
        until(lambda: connections_to(service) <= 1, says=lambda: connections_to(service))  # that of the test itself
        assert service.get("/health/live").status_code == 200


@pytest.mark.long
def test_an_answer_that_nobody_takes_leaves_the_service_at_once(places: Places) -> None:
    """Large answers are asked for, and none is read."""
    proxy, service = places
    assert len(service.get("/openapi.json").content) > 150_000
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(LIMIT_SECONDS)
        connection.connect(("127.0.0.1", proxy.port))
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 100)
        until(lambda: connections_to(service) <= 3)
        until(lambda: proxy.ended(SLOW_READER), says=proxy.log)
        received = 0
        try:
            while more := connection.recv(65536):
                received += len(more)
        except OSError:
            pass
    assert received < 100 * 150_000, "send_timeout ends who takes nothing"


def test_event_streams_come_as_they_happen_and_refusals_as_they_are(places: Places) -> None:
    proxy, _ = places
    with client_of(f"http://127.0.0.1:{proxy.port}") as client:
        job = client.post("/v1/verifications", json={"design": small_design(), "trials": 1000}).json()
        with client.stream("GET", job["links"]["events"]) as stream:
            lines = stream.iter_lines()
            assert next(lines) == "retry: 1000"
            while not next(lines).startswith("event: state"):
                pass
        refused = client.post("/v1/scores", content=b" " * 2_000_000, headers={"Content-Type": "application/json"})
        check_problem(refused, 413, "limit-exceeded")
