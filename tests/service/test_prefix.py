"""Behind a proxy that gives the service a part of an address, what it says of its paths leads back to it.

Pages of other origins are answered where they are listed, and nobody else is.
"""

from __future__ import annotations

import functools
import http.server
import json
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from browsing import browser, look
from service_scenes import check_problem, client_with, small_design

from plain_data import places_of, value_at
from tailstack_service.console.remote import RemoteService
from tailstack_service.http.origins import read_origins
from tailstack_service.http.prefix import Prefix, read_root_path
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings
from waiting import until

ROOT = "/tools/tailstack"
BODY = {"design": small_design(), "trials": 1000}
DOCS = Path(__file__).parents[2] / "service" / "tailstack_service" / "docs_page"


def list_paths(record: Any) -> list[str]:
    """Every text of a record that is a path of the service."""
    found = (value_at(record, place) for place in places_of(record))
    return [value for value in found if isinstance(value, str) and re.match(r"/(?!/)\S*$", value)]


@pytest.mark.long("cut off")
@pytest.mark.parametrize("cut", [True, False], ids=["cut off", "left"])
def test_every_path_that_is_said_begins_with_it(cut: bool) -> None:
    with client_with(Settings(root_path=ROOT, worker_processes=1)) as client:
        lead = "" if cut else ROOT

        def ask(method: str, path: str, **more: Any) -> httpx.Response:
            return client.request(method, lead + path, **more)

        for path in ("/", "/v1/schemas", "/v1/examples"):
            found = list_paths(ask("GET", path).json())
            assert found, path
            assert all(each.startswith(f"{ROOT}/") for each in found), (path, found)
        assert ask("GET", "/openapi.json").json()["servers"] == [{"url": ROOT, "description": "this service"}]
        missing = ask("GET", "/v1/scorse").json()
        assert (missing["type"], missing["instance"]) == (f"{ROOT}/v1/problems/not-found", f"{ROOT}/v1/scorse")
        assert "did you mean POST /v1/scores?" in missing["errors"][0]["hint"]
        accepted = ask("POST", "/v1/verifications", json=BODY)
        assert accepted.status_code == 202
        job = accepted.json()
        assert accepted.headers["location"] == job["links"]["self"] == f"{ROOT}/v1/jobs/{job['id']}"
        assert ask("GET", f"/v1/jobs/{job['id']}").json()["links"]["events"] == f"{ROOT}/v1/jobs/{job['id']}/events"
        assert ask("POST", "/v1/verifications", json=BODY).status_code == 202
        page = ask("GET", "/v1/jobs?limit=1")
        assert page.json()["next"].startswith(f"{ROOT}/v1/jobs?")
        assert page.headers["link"].startswith(f"<{ROOT}/v1/jobs?")
        assert client.get(ROOT).status_code == 200, "without a slash at its end"
        if not cut:
            browser = client.get(ROOT, headers={"Accept": "text/html"}, follow_redirects=False)
            assert (browser.status_code, browser.headers["location"]) == (307, f"{ROOT}/"), (
                "the page asks beside itself"
            )


@pytest.mark.long
def test_from_a_job_to_its_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TAILSTACK_KEY", raising=False)
    with client_with(Settings(root_path=ROOT, worker_processes=1), worker=True) as client:
        job = client.post("/v1/verifications", json=BODY).json()
        place = job["links"]["self"]
        until(lambda: client.get(place).json()["state"] == "succeeded", lambda: client.get(place).json())
        seen = client.get(f"{place}/result")
        assert seen.status_code == 303
        assert seen.headers["location"].startswith(f"{ROOT}/v1/results/")
        assert client.get(seen.headers["location"]).status_code == 200
        waited = client.post("/v1/verifications", json=BODY, headers={"Prefer": "wait=50"})
        assert waited.headers["content-location"].startswith(f"{ROOT}/v1/results/")
        for url in (client.base_url, client.base_url.join(ROOT)):
            answer = RemoteService(str(url)).ask("GET", f"/v1/jobs/{job['id']}/result")
            assert answer.json()["schema"] == "tailstack/verification/1"


def test_without_it_nothing_changes() -> None:
    with client_with() as client:
        assert client.get("/v1/schemas").json()["schemas"][0]["url"] == "/v1/schemas/design"
        assert client.get("/openapi.json").json()["servers"][0]["url"] == "http://127.0.0.1:8321"


def test_settings_that_cannot_be() -> None:
    for root in ("tailstack", "https://host/tailstack", "/a b", "//host"):
        with pytest.raises(SettingsError, match="TAILSTACK_ROOT_PATH must be a path such as /tailstack"):
            read_root_path(Settings(root_path=root))
    assert read_root_path(Settings(root_path="/tailstack/")) == "/tailstack"
    assert read_root_path(Settings(root_path="/")) == ""


def test_headers_of_any_answer() -> None:
    import asyncio

    async def app(scope: Any, receive: Any, send: Any) -> None:
        assert (scope["path"], scope["root_path"]) == (f"{ROOT}/x", ROOT)
        lines = [(b"location", b"/v1/a"), (b"Content-Location", b"/v1/b"), (b"link", b'</v1/c>; rel="next"')]
        await send({"type": "http.response.start", "status": 303, "headers": [*lines, (b"etag", b'"/v1"')]})

    async def collect() -> list[Any]:
        sent: list[Any] = []

        async def send(message: Any) -> None:
            sent.append(message)

        async def nothing() -> Any:
            return {"type": "http.disconnect"}

        scope = {"type": "http", "path": "/x", "headers": [], "client": ("127.0.0.1", 1)}
        await Prefix(app, Settings(root_path=ROOT))(scope, nothing, send)
        return sent

    (start,) = asyncio.run(collect())
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
