"""Behind a proxy that gives the service a part of an address, what it says of its paths leads back to it.

Pages of other origins are answered where they are listed, and nobody else is."""

from __future__ import annotations

import functools
import http.server
import json
import re
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from browsing import browser, look
from postgres import go_without
from service_scenes import ROOT, check_problem, client_of, client_with, read_answer, small_design

from family import die_with_parent, ended
from plain_data import places_of, value_at
from tailstack_service.console.remote import RemoteService
from tailstack_service.http.origins import read_origins
from tailstack_service.http.prefix import Prefix, read_root_path
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

MOUNTED = "/tools/tailstack"

BODY = {"design": small_design(), "trials": 1000}

DOCS = Path(__file__).parents[2] / "service" / "tailstack_service" / "docs_page"


def list_paths(record: Any) -> list[str]:
    """Every text of a record that is a path of the service."""
    found = (value_at(record, place) for place in places_of(record))
    return [value for value in found if isinstance(value, str) and re.match(r"/(?!/)\S*$", value)]


@pytest.mark.long("cut off")
@pytest.mark.parametrize("cut", [True, False], ids=["cut off", "left"])
def test_every_path_that_is_said_begins_with_it(cut: bool) -> None:
    with client_with(Settings(root_path=MOUNTED, worker_processes=1)) as client:
        lead = "" if cut else MOUNTED

        def ask(method: str, path: str, **more: Any) -> httpx.Response:
            return client.request(method, lead + path, **more)

        for path in ("/", "/v1/schemas", "/v1/examples"):
            found = list_paths(ask("GET", path).json())
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


@pytest.mark.long
def test_from_a_job_to_its_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TAILSTACK_KEY", raising=False)
    with client_with(Settings(root_path=MOUNTED, worker_processes=1), worker=True) as client:
        job = client.post("/v1/verifications", json=BODY).json()
        place = job["links"]["self"]
        until(lambda: client.get(place).json()["state"] == "succeeded", lambda: client.get(place).json())
        seen = client.get(f"{place}/result")
        assert seen.status_code == 303
        assert seen.headers["location"].startswith(f"{MOUNTED}/v1/results/")
        assert client.get(seen.headers["location"]).status_code == 200
        waited = client.post("/v1/verifications", json=BODY, headers={"Prefer": "wait=50"})
        assert waited.headers["content-location"].startswith(f"{MOUNTED}/v1/results/")
        for url in (client.base_url, client.base_url.join(MOUNTED)):
            answer = RemoteService(str(url)).ask("GET", f"/v1/jobs/{job['id']}/result")
            assert answer.json()["schema"] == "tailstack/verification/1"


def test_without_it_nothing_changes_and_what_cannot_be_is_refused() -> None:
    with client_with() as client:
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
    await Prefix(app, Settings(root_path=MOUNTED))(scope, receive, send)
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


def test_health_answers_head() -> None:
    with client_with() as client:
        for path in ("/health/live", "/health/ready"):
            got, looked = client.get(path), client.head(path)
            assert looked.status_code == got.status_code
            assert looked.content == b""
            assert looked.headers["content-type"] == got.headers["content-type"]
        refused = client.head("/v1/presets")
        assert (refused.status_code, refused.headers["allow"]) == (405, "GET")


# --- pages of other origins -----------------------------------------------------------------------


__all__ = ["browser"]

PLUGIN = "https://plugin.example.org"

STRANGERS = [
    "https://elsewhere.example.org",
    "http://plugin.example.org",
    f"{PLUGIN}:8443",
    f"{PLUGIN}.evil.org",
    "null",
]

ASKED = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "content-type,authorization,prefer"}

SCORED = {"design": small_design()}


@pytest.fixture(scope="module")
def listed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('origins') / 'jobs.sqlite3'}"
    with client_with(Settings(allowed_origins=f"{PLUGIN}, http://localhost:8888", database=database)) as listed:
        yield listed


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('guarded') / 'jobs.sqlite3'}"
    with client_with(Settings(allowed_origins=PLUGIN, auth="required", database=database)) as listed:
        yield listed


def from_page(origin: str) -> dict[str, str]:
    """What a browser sends with a request of a page of another site."""
    return {"Origin": origin, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"}


def seen(response: httpx.Response) -> set[str]:
    return {name.strip().lower() for name in response.headers["access-control-expose-headers"].split(",")}


@pytest.mark.long("https://plugin.example.org")
@pytest.mark.parametrize("origin", [PLUGIN, "http://localhost:8888"])
def test_a_listed_origin_gets_its_preflight_and_its_answer(listed: httpx.Client, origin: str) -> None:
    allowed = listed.options("/v1/scores", headers={**from_page(origin), **ASKED})
    assert allowed.status_code == 200
    assert allowed.headers["access-control-allow-origin"] == origin
    assert {"GET", "POST"} == set(allowed.headers["access-control-allow-methods"].split(", "))
    named = {name.strip().lower() for name in allowed.headers["access-control-allow-headers"].split(",")}
    assert {"authorization", "content-type", "idempotency-key", "last-event-id", "prefer"} <= named
    assert "access-control-allow-credentials" not in allowed.headers
    assert allowed.headers["x-request-id"]

    answer = listed.post("/v1/scores", json=SCORED, headers=from_page(origin))
    assert answer.status_code == 200, answer.text
    assert answer.headers["access-control-allow-origin"] == origin
    assert "origin" in answer.headers["vary"].lower()
    assert {"etag", "location", "content-location", "retry-after", "link", "x-request-id"} <= seen(answer)


def test_a_preflight_to_a_service_on_loopback_is_let_through(listed: httpx.Client) -> None:
    headers = {**from_page(PLUGIN), **ASKED, "Access-Control-Request-Private-Network": "true"}
    answer = listed.options("/v1/scores", headers=headers)
    assert (answer.status_code, answer.headers["access-control-allow-private-network"]) == (200, "true")


@pytest.mark.parametrize("origin", STRANGERS)
def test_no_other_origin_gets_either(listed: httpx.Client, origin: str) -> None:
    refused = listed.options("/v1/scores", headers={**from_page(origin), **ASKED})
    check_problem(refused, 405, "method-not-allowed")
    assert "access-control-allow-origin" not in refused.headers
    check_problem(listed.post("/v1/scores", json=SCORED, headers=from_page(origin)), 403, "forbidden")
    read = listed.get("/v1/jobs", headers=from_page(origin))
    assert "access-control-allow-origin" not in read.headers


def test_refusals_can_be_read_by_the_page_that_caused_them(listed: httpx.Client, guarded: httpx.Client) -> None:
    headers = from_page(PLUGIN)
    cases = [
        (listed.post("/v1/scores", json={}, headers=headers), 422, "invalid-request"),
        (
            listed.post("/v1/scores", content=b"{", headers={**headers, "Content-Type": "text/css"}),
            415,
            "unsupported-media-type",
        ),
        (listed.get("/v1/nothing", headers=headers), 404, "not-found"),
        (listed.get("/v1/scores", headers=headers), 405, "method-not-allowed"),
        (listed.get("/version", headers={**headers, "Host": "elsewhere.example.org"}), 421, "wrong-host"),
        (guarded.post("/v1/scores", json=SCORED, headers=headers), 401, "unauthenticated"),
    ]
    for response, status, slug in cases:
        check_problem(response, status, slug)
        assert response.headers["access-control-allow-origin"] == PLUGIN, slug
    assert "www-authenticate" in seen(cases[-1][0])


def test_a_preflight_needs_no_credential(guarded: httpx.Client) -> None:
    answer = guarded.options("/v1/scores", headers={**from_page(PLUGIN), **ASKED})
    assert answer.status_code == 200
    check_problem(
        guarded.options("/v1/scores", headers={**from_page(STRANGERS[0]), **ASKED}), 405, "method-not-allowed"
    )


def test_by_default_no_origin_is_listed() -> None:
    with client_with() as listed:
        check_problem(listed.options("/v1/scores", headers={**from_page(PLUGIN), **ASKED}), 405, "method-not-allowed")
        answer = listed.get("/version", headers=from_page(PLUGIN))
        assert not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize(
    "text",
    ["*", "null", "plugin.example.org", "https://plugin.example.org/page", "ftp://a", "https://", "https://a b", "https://*.org",
     "https://user@plugin.example.org", "https://a:port"],
)  # fmt: skip
def test_what_is_no_single_origin_is_refused_at_the_start(text: str) -> None:
    with pytest.raises(SettingsError, match="TAILSTACK_ALLOWED_ORIGINS"):
        read_origins(Settings(allowed_origins=f"{PLUGIN},{text}"))


def test_origins_are_read_as_browsers_send_them() -> None:
    origins = read_origins(Settings(allowed_origins="HTTPS://Plugin.Example.org:443 ,http://[::1]:8888,, http://a:80"))
    assert origins == {PLUGIN, "http://[::1]:8888", "http://a"}


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@pytest.mark.long
def test_chromium_lets_a_listed_page_read_a_score_and_no_other(browser: Any, tmp_path: Path) -> None:
    """A page that is served on one port asks a service on another: for the browser, two origins."""
    (tmp_path / "index.html").write_text('<!doctype html><title>plug-in</title><link rel="icon" href="data:,">')
    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        own = f"http://127.0.0.1:{server.server_port}"
        ask = (
            "fetch(URL, {method: 'POST', headers: {'Content-Type': 'application/json', Prefer: 'wait=1'}, body: BODY})"
            ".then((r) => r.status + ' ' + r.headers.get('x-request-id')?.length, (error) => 'refused')"
        ).replace("BODY", json.dumps(json.dumps(SCORED)))
        answers = []
        for origins in (own, PLUGIN):
            settings = Settings(allowed_origins=origins, database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
            with client_with(settings) as listed:
                url = json.dumps(f"{listed.base_url}/v1/validations".replace("//v1", "/v1"))
                [found] = look([{"url": own, "ask": [ask.replace("URL", url)]}])
                answers.append(found["answers"][0])
        server.shutdown()
    assert answers == ["200 32", "refused"]


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
    if not Path(NGINX).exists():
        go_without("nginx", "nginx is not installed")
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
