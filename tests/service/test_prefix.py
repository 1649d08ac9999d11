"""Behind a proxy that gives the service a part of an address, what it says of its paths leads back to it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_scenes import client_with, small_design

from tailstack_service.console.remote import RemoteService
from tailstack_service.http.prefix import Prefix, read_proxies, read_root_path
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings
from waiting import until

ROOT = "/tools/tailstack"
BODY = {"design": small_design(), "trials": 1000}
DOCS = Path(__file__).parents[2] / "service" / "tailstack_service" / "docs_page"


def list_paths(value: Any) -> list[str]:
    """Every text of a record that is a path of the service."""
    if isinstance(value, dict):
        return [path for each in value.values() for path in list_paths(each)]
    if isinstance(value, list):
        return [path for each in value for path in list_paths(each)]
    return [value] if isinstance(value, str) and re.match(r"/(?!/)\S*$", value) else []


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
        forwarded = client.get("/v1/schemas", headers={"X-Forwarded-Prefix": ROOT})
        assert forwarded.json()["schemas"][0]["url"] == "/v1/schemas/design", "nobody trusts this client"


def test_the_word_of_a_trusted_proxy() -> None:
    with client_with(Settings(root_path="/usual", trusted_proxies="10.0.0.0/8, 127.0.0.1")) as client:

        def lead(**headers: str) -> str:
            url: str = client.get("/v1/schemas", headers=headers).json()["schemas"][0]["url"]
            return url.removesuffix("/v1/schemas/design")

        assert lead() == "/usual"
        assert lead(**{"X-Forwarded-Prefix": ROOT}) == ROOT
        assert lead(**{"X-Forwarded-Prefix": f"{ROOT}/"}) == ROOT
        assert lead(**{"X-Forwarded-Prefix": "/"}) == ""
        for hostile in (
            "//evil.example",
            "https://evil.example",
            "/a b",
            "/a\\b",
            "/a?b",
            "x" * 300,
            "/../..",
            "/a/./b",
        ):
            assert lead(**{"X-Forwarded-Prefix": hostile}) == "/usual", hostile


def test_settings_that_cannot_be() -> None:
    for root in ("tailstack", "https://host/tailstack", "/a b", "//host"):
        with pytest.raises(SettingsError, match="TAILSTACK_ROOT_PATH must be a path such as /tailstack"):
            read_root_path(Settings(root_path=root))
    assert read_root_path(Settings(root_path="/tailstack/")) == "/tailstack"
    assert read_root_path(Settings(root_path="/")) == ""
    with pytest.raises(SettingsError, match=r"TAILSTACK_TRUSTED_PROXIES: 'proxy\.local' is no address"):
        read_proxies(Settings(trusted_proxies="127.0.0.1, proxy.local"))


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
