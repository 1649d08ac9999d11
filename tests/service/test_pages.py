"""What a browser is shown: the files of the page, and where a program is led that opens the address.

The page of the API runs its own files and nothing else.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import docs_page
import httpx
import node
import pytest
from browsing import awaited, look
from postgres import go_without
from service_scenes import ROOT, check_problem, client_of, client_with

from tailstack_service.http import pages
from tailstack_service.settings import Settings

BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"
SCRIPT = """document.title = "ran";
fetch("/version").then((answer) => answer.json()).then((version) => document.body.append(version.tailstack));
"""
INDEX = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>placeholder</title>
<link rel="icon" href="data:,"><script type="module" src="/assets/page-4f1c2a.js"></script></head><body></body></html>
"""


@pytest.fixture
def workbench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A page of one script, as the package will hold it."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text(INDEX)
    (tmp_path / "assets" / "page-4f1c2a.js").write_text(SCRIPT)
    (tmp_path / "secret.txt").write_text("not an asset")
    monkeypatch.setattr(pages, "WORKBENCH", tmp_path)
    return tmp_path


@pytest.fixture
def client(workbench: Path) -> Iterator[httpx.Client]:
    with client_with() as client:
        yield client


@pytest.mark.parametrize("accept", ["application/json", "*/*", "text/html;q=0, */*"])
def test_a_program_is_told_where_to_go(client: httpx.Client, accept: str) -> None:
    answer = client.get("/", headers={"Accept": accept})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    for link in answer.json()["links"]:
        assert client.get(link["path"]).status_code in (200, 503), link


def test_a_browser_is_shown_the_page_under_a_strict_policy(client: httpx.Client) -> None:
    answer = client.get("/", headers={"Accept": BROWSER})
    assert (answer.status_code, answer.text) == (200, INDEX)
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert answer.headers["cache-control"] == "no-cache"
    assert "accept" in answer.headers["vary"].lower()
    again = client.get("/", headers={"Accept": BROWSER, "If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_assets_are_kept_for_ever_and_sent_compressed(client: httpx.Client) -> None:
    plain = client.get("/assets/page-4f1c2a.js", headers={"Accept-Encoding": "identity"})
    assert (plain.status_code, plain.text) == (200, SCRIPT)
    assert plain.headers["content-type"] == "text/javascript; charset=utf-8"
    assert plain.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert plain.headers["x-content-type-options"] == "nosniff"
    with client.stream("GET", "/assets/page-4f1c2a.js", headers={"Accept-Encoding": "br, gzip"}) as packed:
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.headers["etag"] != plain.headers["etag"]
        assert gzip.decompress(b"".join(packed.iter_raw())).decode() == SCRIPT


@pytest.mark.parametrize("name", ["nothing.js", "%2e%2e", "..%2Fsecret.txt", "%2e%2e%2fsecret.txt", "a%00b", "."])
def test_nothing_but_an_asset_is_read(client: httpx.Client, name: str) -> None:
    with client_of(str(client.base_url)) as raw:
        request = raw.build_request("GET", "/")
        request.url = request.url.copy_with(raw_path=f"/assets/{name}".encode())
        check_problem(raw.send(request), 404, "not-found")


def test_the_page_needs_no_key_and_what_it_asks_for_does(workbench: Path, tmp_path: Path) -> None:
    settings = Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as client:
        assert client.get("/", headers={"Accept": BROWSER}).text == INDEX
        assert client.get("/assets/page-4f1c2a.js").status_code == 200
        check_problem(client.get("/v1/jobs"), 401, "unauthenticated")


def test_the_manual_is_given_to_everybody_as_it_lies_in_the_repository(tmp_path: Path) -> None:
    with client_with(Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")) as client:
        for name in ("README.md", "integrations/step.md"):
            page = client.get(f"/manual/{name}")
            assert page.headers["content-type"] == "text/markdown; charset=utf-8"
            assert page.text == (ROOT / "docs" / name).read_text(encoding="utf-8")
        for name in ("mkdocs.yml", "nothing.md", "..%2FREADME.md", "%2e%2e/README.md", ""):
            check_problem(client.get(f"/manual/{name}"), 404, "not-found")


def test_without_a_page_a_browser_is_led_to_that_of_the_api(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pages, "WORKBENCH", tmp_path / "nothing")
    with client_with() as client:
        led = client.get("/", headers={"Accept": BROWSER})
        assert (led.status_code, led.headers["location"]) == (307, "/docs")
        assert "/docs" in [link["path"] for link in client.get("/").json()["links"]]
        check_problem(client.get("/assets/page-4f1c2a.js"), 404, "not-found")


# --- the page of the API --------------------------------------------------------------------------


SCORE = "document.querySelector('#operations-computations-create_score')"
STATUS = f"{SCORE}?.querySelector('.live-responses-table tbody .response-col_status')"
PRESSED = [f"{SCORE}?.querySelector('{button}')" for button in ("button", ".try-out__btn", "button.execute")]
TRY = [
    *(step for button in PRESSED for step in (awaited(button), f"{button}.click()")),
    awaited(STATUS),
    f"{STATUS}.textContent.trim() + ' ' + {SCORE}.querySelector('.request-url pre').textContent.trim()",
]


@pytest.fixture(scope="module")
def docs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('docs') / 'jobs.sqlite3'}"
    with client_with(Settings(database=database)) as docs:
        yield docs


@pytest.mark.long
def test_every_operation_is_shown_and_a_score_can_be_tried(docs: httpx.Client, browser: Any) -> None:
    """oracle: Chromium, which tells of everything that the policy of the page forbids."""
    operations = "[...document.querySelectorAll('.opblock')].map((part) => part.id)"
    [found] = look([{"url": f"{docs.base_url}".rstrip("/") + "/docs", "ask": [*TRY, operations]}])
    assert found["answers"][-2] == f"200 {str(docs.base_url).rstrip('/')}/v1/scores"
    document = docs.get("/openapi.json").json()
    every = {operation["operationId"] for item in document["paths"].values() for operation in item.values()}
    assert {name.rpartition("-")[2] for name in found["answers"][-1]} == every
    assert found["messages"] == []
    assert found["failed"] == []
    assert [url for url in found["requests"] if not url.startswith((str(docs.base_url), "data:", "blob:"))] == []


def test_the_page_may_do_nothing_but_run_its_own_files(docs: httpx.Client) -> None:
    page = docs.get("/docs")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert page.headers["content-security-policy"].startswith(
        "default-src 'none'; script-src 'self'; style-src 'self';"
    )
    assert "unsafe" not in page.headers["content-security-policy"]
    paths = re.findall(r'(?:src|href)="(docs/[^"]*)"', page.text)
    assert len(paths) == 4
    for path in paths:
        answer = docs.get(path)
        assert (answer.status_code, answer.headers["x-content-type-options"]) == (200, "nosniff"), path
        again = docs.get(path, headers={"If-None-Match": answer.headers["etag"]})
        assert again.status_code == 304
    check_problem(docs.get("/docs/package.json"), 404, "not-found")


def test_its_files_are_those_that_were_published() -> None:
    try:
        package = docs_page.published()
    except node.NodeMissing as missing:
        go_without("node", missing)
    for name in docs_page.FILES:
        ours = ROOT / "service" / "tailstack_service" / "docs_page" / name
        assert ours.read_bytes() == (package / name).read_bytes(), name
