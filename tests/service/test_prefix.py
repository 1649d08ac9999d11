"""Behind a proxy that gives the service a part of an address, what it says of its paths leads back to it."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from postgres import free_ports, go_without
from service_scenes import ROOT, check_problem, client_of, client_with, small_design

from family import started
from plain_data import places_of, value_at
from tailstack_service.console.remote import RemoteService
from tailstack_service.http.answers import read_root_path
from tailstack_service.http.app import Prefix
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

MOUNTED = "/tools/tailstack"
BODY = {"design": small_design(), "trials": 1000}
DOCS = ROOT / "service" / "tailstack_service" / "docs_page"


@pytest.mark.long("cut off")
@pytest.mark.parametrize("cut", [True, False], ids=["cut off", "left"])
def test_every_path_that_is_said_begins_with_it(cut: bool) -> None:
    with client_with(Settings(root_path=MOUNTED, worker_processes=1)) as client:
        lead = "" if cut else MOUNTED

        def ask(method: str, path: str, **more: Any) -> httpx.Response:
            return client.request(method, lead + path, **more)

        for path in ("/", "/v1/schemas", "/v1/examples"):
            record = ask("GET", path).json()
            texts = [value for place in places_of(record) if isinstance(value := value_at(record, place), str)]
            found = [text for text in texts if re.match(r"/(?!/)\S*$", text)]
            assert found, path
            assert all(each.startswith(f"{MOUNTED}/") for each in found), (path, found)
        assert ask("GET", "/openapi.json").json()["servers"] == [{"url": MOUNTED, "description": "this service"}]
        missing = ask("GET", "/v1/scorse").json()
        assert (missing["type"], missing["instance"]) == (f"{MOUNTED}/v1/problems/not-found", f"{MOUNTED}/v1/scorse")
        assert "did you mean POST /v1/scores?" in missing["errors"][0]["hint"]
        accepted = ask("POST", "/v1/verifications", json=BODY)
        assert accepted.status_code == 202
        job = accepted.json()
        assert accepted.headers["location"] == job["links"]["self"] == f"{MOUNTED}/v1/jobs/{job['id']}"
        assert ask("GET", f"/v1/jobs/{job['id']}").json()["links"]["events"] == f"{MOUNTED}/v1/jobs/{job['id']}/events"
        for url in (client.base_url, client.base_url.join(MOUNTED)):
            assert RemoteService(str(url), key="").ask("GET", f"/v1/jobs/{job['id']}").json()["id"] == job["id"]
        assert ask("POST", "/v1/verifications", json=BODY).status_code == 202
        page = ask("GET", "/v1/jobs?limit=1")
        assert page.json()["next"].startswith(f"{MOUNTED}/v1/jobs?")
        assert page.headers["link"].startswith(f"<{MOUNTED}/v1/jobs?")
        assert client.get(MOUNTED).status_code == 200, "without a slash at its end"
        if not cut:
            browser = client.get(MOUNTED, headers={"Accept": "text/html"}, follow_redirects=False)
            assert (browser.status_code, browser.headers["location"]) == (307, f"{MOUNTED}/"), (
                "the page asks beside itself"
            )


def test_without_it_nothing_changes_and_what_cannot_be_is_refused(client: httpx.Client) -> None:
    assert client.get("/v1/schemas").json()["schemas"][0]["url"] == "/v1/schemas/design"
    assert client.get("/openapi.json").json()["servers"][0]["url"] == "http://127.0.0.1:8321"
    for root in ("tailstack", "https://host/tailstack", "/a b", "//host"):
        with pytest.raises(SettingsError, match="TAILSTACK_ROOT_PATH must be a path such as /tailstack"):
            read_root_path(Settings(root_path=root))
    assert read_root_path(Settings(root_path="/tailstack/")) == "/tailstack"
    assert read_root_path(Settings(root_path="/")) == ""


async def test_headers_of_any_answer() -> None:
    sent: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        assert (scope["path"], scope["root_path"]) == (f"{MOUNTED}/x", MOUNTED)
        lines = [(b"location", b"/v1/a"), (b"Content-Location", b"/v1/b"), (b"link", b'</v1/c>; rel="next"')]
        await send({"type": "http.response.start", "status": 303, "headers": [*lines, (b"etag", b'"/v1"')]})

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    scope = {"type": "http", "path": "/x", "headers": [], "client": ("127.0.0.1", 1)}
    await Prefix(app, read_root_path(Settings(root_path=MOUNTED)))(scope, receive, send)
    (start,) = sent
    assert dict(start["headers"]) == {
        b"location": b"/tools/tailstack/v1/a",
        b"Content-Location": b"/tools/tailstack/v1/b",
        b"link": b'</tools/tailstack/v1/c>; rel="next"',
        b"etag": b'"/v1"',
    }


def test_the_page_of_the_api_names_nothing_from_the_root() -> None:
    page, script = (DOCS / "index.html").read_text(), (DOCS / "page.js").read_text()
    assert re.findall(r"(?:href|src)=\"(/[^\"]*)", page) == []
    assert re.findall(r"[\"'`](/(?:openapi|docs|v1)[^\"'`]*)", script) == []


def test_health_answers_head(client: httpx.Client) -> None:
    for path in ("/health/live", "/health/ready"):
        got, looked = client.get(path), client.head(path)
        assert looked.status_code == got.status_code
        assert looked.content == b""
        assert looked.headers["content-type"] == got.headers["content-type"]
    refused = client.head("/v1/presets")
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET")


# --- slow clients, real ones, before docker/nginx.conf: they end there --------------------------------


NGINX = shutil.which("nginx") or "/usr/sbin/nginx"
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
def proxying(folder: Path, configure: Callable[[int], str]) -> Iterator[Proxy]:
    """nginx with a file that is made for the port on which it is to listen."""
    port = next(free_ports())
    (folder / "nginx.conf").write_text(configure(port), encoding="utf-8")
    options = ("-c", folder / "nginx.conf", "-e", folder / "error.log", "-g", "daemon off; master_process off;")
    proxy = Proxy(port, folder)
    with started(NGINX, *options, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:

        def answers() -> bool:
            assert process.poll() is None, proxy.log()
            with suppress(OSError), proxy.connect():
                return True
            return False

        until(answers, says=proxy.log)
        yield proxy


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Places]:
    if not Path(NGINX).exists():
        go_without("nginx", "nginx is not installed")
    folder = tmp_path_factory.mktemp("nginx")
    shipped = (ROOT / "docker" / "nginx.conf").read_text(encoding="utf-8")
    with client_with(Settings()) as service:
        api = service.base_url.port or 0
        with proxying(folder, lambda port: quick(shipped, folder, port, api)) as proxy:
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
    ("begun", "drip", "said"),
    [
        (b"", b"", SLOW_HEAD),
        (b"G", b"", SLOW_HEAD),
        (b"GET /health/live HTTP/1.1\r\n", b"x-a: b\r\n", SLOW_HEAD),
        (HEAD + b"Content-Length: 1000\r\n\r\n{", b"", SLOW_BODY),
    ],
)
def test_a_head_that_never_ends_and_a_body_that_stops_coming_are_ended(
    places: Places, begun: bytes, drip: bytes, said: str
) -> None:
    proxy, _ = places
    ended_before = proxy.ended(said)
    with proxy.connect() as connection:
        connection.sendall(begun)
        until(lambda: closed(connection, drip), says=proxy.log)
    until(lambda: proxy.ended(said) == ended_before + 1, says=proxy.log)


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
        with suppress(OSError):
            while more := connection.recv(65536):
                received += len(more)
    assert received < 100 * 150_000, "send_timeout ends who takes nothing"


def test_event_streams_come_as_they_happen_and_refusals_as_they_are(places: Places) -> None:
    proxy, _ = places
    with client_of(f"http://127.0.0.1:{proxy.port}") as client:
        job = client.post("/v1/verifications", json=BODY).json()
        with client.stream("GET", job["links"]["events"]) as stream:
            lines = stream.iter_lines()
            assert next(lines) == "retry: 1000"
            while not next(lines).startswith("event: state"):
                pass
        refused = client.post("/v1/scores", content=b" " * 2_000_000, headers={"Content-Type": "application/json"})
        check_problem(refused, 413, "limit-exceeded")
