"""POST /v1/scores/batch: tables there and back, streamed or as a job; what is refused, and what ends it."""

from __future__ import annotations

import io
import json
import logging
from typing import Any

import httpx
import openpyxl
import pytest
from service_scenes import check_problem, small_design
from table_scenes import read_rows, write_table

from tailstack import load_design, score
from tailstack_service.http import posting
from tailstack_service.http.compute_pool import ComputePool
from tailstack_service.operations import rendering
from tailstack_service.operations.content import canonical
from tailstack_service.operations.perform import perform
from tailstack_service.processes.task import Task
from tailstack_service.schemas import read_record
from tailstack_service.settings import Settings
from tailstack_service.tables import MEDIA_TYPES, Format
from waiting import until

NOISE, BEAD = "/views/0/fiducial_noise_px", "/fiducials/points/2/position_mm/1"
TABLE = {NOISE: [0.3, 0.2, -1.0, 0.4], BEAD: [38.0, 37.0, 38.0, 36.0]}
PATH = "/v1/scores/batch"
CLIENT = {"settings": Settings(worker_processes=1, max_batch_rows=6_000, max_wait_seconds=600.0), "worker": True}


@pytest.fixture(scope="module")
def sha256(client: httpx.Client) -> str:
    """Of the design, which was sent before."""
    answer = client.post("/v1/validations", json={"design": small_design()})
    return str(answer.json()["design_sha256"])


def expected_p95(row: int) -> float:
    design = load_design(small_design()).with_value(NOISE, TABLE[NOISE][row]).with_value(BEAD, TABLE[BEAD][row])
    return score(design).targets[0].p95_mm


def table_as(form: Format) -> bytes:
    return write_table(form, list(TABLE), zip(*TABLE.values(), strict=True))


def p95s(form: Format, content: bytes) -> list[Any]:
    return [row["p95_mm:tip"] or None for row in read_rows(form, content)]


@pytest.mark.long("csv")
@pytest.mark.parametrize("form", list(MEDIA_TYPES))
def test_a_table_comes_back_in_its_own_format(client: httpx.Client, sha256: str, form: Format) -> None:
    """independent: other readers and writers, and the score of each row's own design."""
    answer = client.post(
        PATH, params={"design_sha256": sha256}, content=table_as(form), headers={"Content-Type": MEDIA_TYPES[form]}
    )
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith(MEDIA_TYPES[form])
    found = p95s(form, answer.content)
    assert found[2] is None
    for row in (0, 1, 3):
        assert found[row] == pytest.approx(expected_p95(row), rel=1e-9)


@pytest.mark.long
def test_the_same_bytes_at_once_and_as_a_job(client: httpx.Client) -> None:
    request = {"design": small_design(), "table": TABLE, "columns": ["p95_mm", "verdict"]}
    at_once = client.post(PATH, json=request)
    assert at_once.status_code == 200, at_once.text
    record = read_record("batch", at_once.content)
    assert (record.rows, record.refused) == (4, 1)
    assert record.columns["p95_mm:tip"][1] == pytest.approx(expected_p95(1), rel=1e-9)
    assert record.columns["verdict"][2] == ""
    assert "at least 0" in record.columns["reason"][2]
    job = client.post(PATH, json=request, headers={"Prefer": "respond-async"})
    assert job.status_code == 202, job.text
    waited = client.post(PATH, json=request, headers={"Prefer": "wait=600"})
    assert waited.status_code == 200, waited.text
    assert waited.content == at_once.content
    report = client.get(waited.headers["content-location"] + "/report?format=xlsx")
    assert report.status_code == 200
    assert openpyxl.load_workbook(io.BytesIO(report.content))["Designs"].max_row >= 5


def test_accept_asks_for_another_format(client: httpx.Client) -> None:
    answer = client.post(PATH, json={"design": small_design(), "table": TABLE}, headers={"Accept": "text/csv"})
    assert answer.text.splitlines()[0].endswith("within_limits,reason")
    assert p95s("csv", answer.content)[0] == pytest.approx(expected_p95(0), rel=1e-9)


@pytest.mark.long
def test_lines_come_as_they_are_computed(client: httpx.Client) -> None:
    """More than one unit, as a verdict takes its time: the first lines are there before the last are computed."""
    rows = 300
    request = {"design": small_design(), "table": {NOISE: [0.3] * rows}, "columns": ["verdict"]}
    with client.stream("POST", PATH, json=request, headers={"Accept": "application/x-ndjson"}) as answer:
        assert answer.status_code == 200
        pieces = [piece.count(b"\n") for piece in answer.iter_raw()]
    assert sum(pieces) == rows
    assert max(pieces) < rows


def test_a_caller_who_leaves_ends_the_work(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Of 6,000 verdicts most are not begun when the service is done with the request."""
    caplog.set_level(logging.INFO, logger="tailstack.service")
    whole: list[int] = []  # units of the table
    begun: list[object] = []
    send_pieces, run = posting._send_pieces, ComputePool.run

    async def sending(request: Any, sent: Any, pieces: Any) -> Any:
        whole.append(len(pieces.specs))
        return await send_pieces(request, sent, pieces)

    async def running(pool: ComputePool, asked: Any, call: Any, seconds: float) -> Any:
        begun.append(call)
        return await run(pool, asked, call, seconds)

    monkeypatch.setattr(posting, "_send_pieces", sending)
    monkeypatch.setattr(ComputePool, "run", running)
    request = {"design": small_design(), "table": {NOISE: [0.3] * 6_000}, "columns": ["verdict"]}
    with client.stream("POST", PATH, json=request, headers={"Accept": "text/csv"}) as answer:
        assert next(answer.iter_raw())
    until(lambda: any(vars(record).get("path") == PATH for record in caplog.records))
    assert len(begun) < whole[0] / 2


@pytest.mark.long("body0-/table-nothing at")
@pytest.mark.parametrize(
    ("body", "pointer", "said"),
    [
        ({"table": {"/views/0/noise": [1.0]}}, "/table", "nothing at"),
        ({"table": {NOISE: [1.0], BEAD: [1.0, 2.0]}}, "/table", "one length"),
        ({"table": {}}, "/table", "at least 1"),
        ({"table": {NOISE: ["0,3"]}}, f"/table/{NOISE.replace('/', '~1')}/0", "0.3"),
        ({"table": {NOISE: [1.0]}, "columns": ["p95"]}, "/columns/0", "p95_mm"),
        ({"table": {NOISE: [0.3] * 6_001}}, "/table", "TAILSTACK_MAX_BATCH_ROWS"),
        ({"table": {"/views/0/source_isocentre_mm": [700.0] * 6_000}}, "", "Prefer: respond-async"),
    ],
)
def test_tables_are_refused_before_the_first_byte(client: httpx.Client, body: Any, pointer: str, said: str) -> None:
    answer = client.post(PATH, json={"design": small_design(), **body})
    problem = check_problem(answer, 422, answer.json()["type"].rpartition("/")[2])
    assert problem["errors"][0]["pointer"] == pointer
    assert said in str(problem["errors"])


def test_a_unit_refuses_its_table_as_the_request_that_it_is_of() -> None:
    """In this process: what a body of a request is refused for has its place in that body."""
    request = {"header": ["x"], "cells": [["1"]], "places": [0], "columns": ["verdict"], "pointers": ["/views/0/noise"]}
    task = Task("batch", canonical({**request, "design": small_design()}), canonical({"first": 0, "count": 1}))
    refused = json.loads(perform(task).problem)
    assert refused["type"].endswith("/invalid-request")
    assert [error["pointer"] for error in refused["errors"]] == ["/table"]


@pytest.mark.parametrize(
    ("form", "text", "line", "said"),
    [
        ("csv", f"{NOISE}\n0.3\n0,3\n", 3, "with a point: 0.3"),
        ("csv", f"{NOISE}\n", None, "no rows"),
        ("csv", f"a,{NOISE}x,0.3y,0.4", 1, "--data-binary @FILE keeps them"),
        ("csv", f"{NOISE}0.30.4", 1, "--data-binary @FILE keeps them"),
        ("csv", f"a,{NOISE}\\nx,0.3\\n", 1, "end lines with LF, or CR LF"),
        ("ndjson", f'{{"{NOISE}": 0.3}}{{"{NOISE}": 0.4}}', 1, "--data-binary @FILE"),
        # more than its bytes: a comma is a cell of eight bytes, two brackets are a list of sixty
        (
            "csv",
            ",".join([NOISE, *map(str, range(1_900))]) + f"\n0.3{',' * 1_900}" * 1_100 + "\n",
            None,
            "2000000 cells",
        ),
        ("ndjson", f'{{"{NOISE}": 0.3, "note": [{"[]," * 100_000}[]]}}', None, "holds lists"),
    ],
    ids=lambda value: value[:20] if isinstance(value, str) else None,
)
def test_a_file_is_refused_with_its_line(
    client: httpx.Client, sha256: str, form: Format, text: str, line: Any, said: str
) -> None:
    header = {"Content-Type": MEDIA_TYPES[form]}
    answer = client.post(PATH, params={"design_sha256": sha256}, content=text.encode(), headers=header)
    problem = check_problem(answer, 422, "limit-exceeded" if "cells" in said else "invalid-request")
    assert said in problem["errors"][0]["detail"] + problem["errors"][0]["hint"]
    assert problem["errors"][0].get("line") == line


def test_a_workbook_is_not_taken(client: httpx.Client, sha256: str) -> None:
    header = {"Content-Type": rendering.MEDIA_TYPES["xlsx"]}
    answer = client.post(PATH, params={"design_sha256": sha256}, content=b"PK", headers=header)
    assert "text/csv" in check_problem(answer, 415, "unsupported-media-type")["errors"][0]["hint"]


def test_a_table_alone_says_which_design_it_is_about(client: httpx.Client) -> None:
    header = {"Content-Type": "text/csv"}
    answer = client.post(PATH, content=table_as("csv"), headers=header)
    assert check_problem(answer, 422, "invalid-request")["errors"][0]["pointer"] == "/design_sha256"
    answer = client.post(PATH, params={"design_sha256": "0" * 64}, content=table_as("csv"), headers=header)
    check_problem(answer, 404, "unknown-design")
