"""The page at /docs: the API as it is served, on which every operation can be tried, from this service alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import docs_page
import httpx
import node
import pytest
from browsing import awaited, browser, look
from postgres import required
from service_scenes import ROOT, check_problem, client_with

from tailstack_service.settings import Settings

__all__ = ["browser"]

SCORE = "document.querySelector('#operations-computations-create_score')"
STATUS = f"{SCORE}?.querySelector('.live-responses-table tbody .response-col_status')"
PRESSED = [f"{SCORE}?.querySelector('{button}')" for button in ("button", ".try-out__btn", "button.execute")]
TRY = [
    *(step for button in PRESSED for step in (awaited(button), f"{button}.click()")),
    awaited(STATUS),
    f"{STATUS}.textContent.trim() + ' ' + {SCORE}.querySelector('.request-url pre').textContent.trim()",
]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('docs') / 'jobs.sqlite3'}"
    with client_with(Settings(database=database)) as client:
        yield client


@pytest.mark.long
def test_every_operation_is_shown_and_a_score_can_be_tried(client: httpx.Client, browser: Any) -> None:
    """oracle: Chromium, which tells of everything that the policy of the page forbids."""
    operations = "[...document.querySelectorAll('.opblock')].map((part) => part.id)"
    [found] = look([{"url": f"{client.base_url}".rstrip("/") + "/docs", "ask": [*TRY, operations]}])
    assert found["answers"][-2] == f"200 {str(client.base_url).rstrip('/')}/v1/scores"
    document = client.get("/openapi.json").json()
    every = {operation["operationId"] for item in document["paths"].values() for operation in item.values()}
    assert {name.rpartition("-")[2] for name in found["answers"][-1]} == every
    assert found["messages"] == []
    assert found["failed"] == []
    assert [url for url in found["requests"] if not url.startswith((str(client.base_url), "data:", "blob:"))] == []


def test_the_page_may_do_nothing_but_run_its_own_files(client: httpx.Client) -> None:
    page = client.get("/docs")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert page.headers["content-security-policy"].startswith(
        "default-src 'none'; script-src 'self'; style-src 'self';"
    )
    assert "unsafe" not in page.headers["content-security-policy"]
    for path in re.findall(r'(?:src|href)="(/docs/[^"]*)"', page.text):
        answer = client.get(path)
        assert (answer.status_code, answer.headers["x-content-type-options"]) == (200, "nosniff"), path
        again = client.get(path, headers={"If-None-Match": answer.headers["etag"]})
        assert again.status_code == 304
    check_problem(client.get("/docs/package.json"), 404, "not-found")


def test_the_page_needs_no_key(tmp_path: Path) -> None:
    with client_with(Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")) as client:
        assert client.get("/docs").status_code == 200
        assert client.get("/docs/swagger-ui.css").status_code == 200


def test_its_files_are_those_that_were_published() -> None:
    try:
        package = docs_page.published()
    except node.NodeMissing as missing:
        if required("node"):
            pytest.fail(f"{missing}; TAILSTACK_TESTS_REQUIRE lists node")
        pytest.skip(f"NOT TESTED: {missing}")
    for name in docs_page.FILES:
        ours = ROOT / "service" / "tailstack_service" / "docs_page" / name
        assert ours.read_bytes() == (package / name).read_bytes(), name
