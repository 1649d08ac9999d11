"""Pages of other sites in a browser: those that the operator lists may call the API, and no others."""

from __future__ import annotations

import functools
import http.server
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from browsing import browser, look
from service_scenes import check_problem, client_with, small_design

from tailstack_service.http.origins import read_origins
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings

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
BODY = {"design": small_design()}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('origins') / 'jobs.sqlite3'}"
    with client_with(Settings(allowed_origins=f"{PLUGIN}, http://localhost:8888", database=database)) as client:
        yield client


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('guarded') / 'jobs.sqlite3'}"
    with client_with(Settings(allowed_origins=PLUGIN, auth="required", database=database)) as client:
        yield client


def from_page(origin: str) -> dict[str, str]:
    """What a browser sends with a request of a page of another site."""
    return {"Origin": origin, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"}


def seen(response: httpx.Response) -> set[str]:
    return {name.strip().lower() for name in response.headers["access-control-expose-headers"].split(",")}


@pytest.mark.long("https://plugin.example.org")
@pytest.mark.parametrize("origin", [PLUGIN, "http://localhost:8888"])
def test_a_listed_origin_gets_its_preflight_and_its_answer(client: httpx.Client, origin: str) -> None:
    allowed = client.options("/v1/scores", headers={**from_page(origin), **ASKED})
    assert allowed.status_code == 200
    assert allowed.headers["access-control-allow-origin"] == origin
    assert {"GET", "POST"} == set(allowed.headers["access-control-allow-methods"].split(", "))
    named = {name.strip().lower() for name in allowed.headers["access-control-allow-headers"].split(",")}
    assert {"authorization", "content-type", "idempotency-key", "last-event-id", "prefer"} <= named
    assert "access-control-allow-credentials" not in allowed.headers
    assert allowed.headers["x-request-id"]

    answer = client.post("/v1/scores", json=BODY, headers=from_page(origin))
    assert answer.status_code == 200, answer.text
    assert answer.headers["access-control-allow-origin"] == origin
    assert "origin" in answer.headers["vary"].lower()
    assert {"etag", "location", "content-location", "retry-after", "link", "x-request-id"} <= seen(answer)


def test_a_preflight_to_a_service_on_loopback_is_let_through(client: httpx.Client) -> None:
    headers = {**from_page(PLUGIN), **ASKED, "Access-Control-Request-Private-Network": "true"}
    answer = client.options("/v1/scores", headers=headers)
    assert (answer.status_code, answer.headers["access-control-allow-private-network"]) == (200, "true")


@pytest.mark.parametrize("origin", STRANGERS)
def test_no_other_origin_gets_either(client: httpx.Client, origin: str) -> None:
    refused = client.options("/v1/scores", headers={**from_page(origin), **ASKED})
    check_problem(refused, 405, "method-not-allowed")
    assert "access-control-allow-origin" not in refused.headers
    check_problem(client.post("/v1/scores", json=BODY, headers=from_page(origin)), 403, "forbidden")
    read = client.get("/v1/jobs", headers=from_page(origin))
    assert "access-control-allow-origin" not in read.headers


def test_refusals_can_be_read_by_the_page_that_caused_them(client: httpx.Client, guarded: httpx.Client) -> None:
    headers = from_page(PLUGIN)
    cases = [
        (client.post("/v1/scores", json={}, headers=headers), 422, "invalid-request"),
        (
            client.post("/v1/scores", content=b"{", headers={**headers, "Content-Type": "text/css"}),
            415,
            "unsupported-media-type",
        ),
        (client.get("/v1/nothing", headers=headers), 404, "not-found"),
        (client.get("/v1/scores", headers=headers), 405, "method-not-allowed"),
        (client.get("/version", headers={**headers, "Host": "elsewhere.example.org"}), 421, "wrong-host"),
        (guarded.post("/v1/scores", json=BODY, headers=headers), 401, "unauthenticated"),
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
    with client_with() as client:
        check_problem(client.options("/v1/scores", headers={**from_page(PLUGIN), **ASKED}), 405, "method-not-allowed")
        answer = client.get("/version", headers=from_page(PLUGIN))
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
        ).replace("BODY", json.dumps(json.dumps(BODY)))
        answers = []
        for origins in (own, PLUGIN):
            settings = Settings(allowed_origins=origins, database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
            with client_with(settings) as client:
                url = json.dumps(f"{client.base_url}/v1/validations".replace("//v1", "/v1"))
                [found] = look([{"url": own, "ask": [ask.replace("URL", url)]}])
                answers.append(found["answers"][0])
        server.shutdown()
    assert answers == ["200 32", "refused"]
