"""``report --profile rsa``: in the record, on every page, in the terminal, and computed again by an audit."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import openpyxl
import pytest
from pypdf import PdfReader
from service_scenes import EXAMPLES, client_with

from plain_data import DEMO, EVERY
from tailstack import load_design
from tailstack_service.audit import audit
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report

CAGE = EXAMPLES / "radiostereometry.yaml"


@pytest.fixture(scope="module")
def body() -> bytes:
    return to_json(compute_report(load_design(CAGE), ReportContents(trials=2000, seed=3, profile="rsa")))


def test_the_chapter_stands_on_every_page_and_is_computed_again(body: bytes) -> None:
    record = json.loads(body)
    implant = record["radiostereometry"]["bodies"][1]
    told = f"{implant['simulated']['mtpm_p95_mm']:.4f}"
    html = render("report", body, "html")
    text = html.decode()
    pdf = " ".join(page.extract_text() for page in PdfReader(io.BytesIO(render("report", body, "pdf"))).pages)
    for page in (text, pdf):
        assert all(words in page for words in ("Radiostereometry", "Crossing-line error", "Valstar", told))
    sheets = openpyxl.load_workbook(io.BytesIO(render("report", body, "xlsx")))
    assert {"Marker models", "Double examinations", "Crossing lines"} <= set(sheets.sheetnames)
    assert sum(1 for _ in sheets["Crossing lines"].rows) > len(record["radiostereometry"]["crossing_lines"])
    assert record["reproduction"]["profile"] == "rsa"
    assert "--profile rsa" in record["reproduction"]["commands"][1]
    found = audit(html, "x", fast=True)
    assert found.verdict == "verified", found
    record["radiostereometry"]["bodies"][0]["condition_number_per_m"] *= 1.01
    assert audit(to_json(record), "x", fast=True).verdict == "differs"


def test_a_terminal_tells_it_and_a_report_without_it_is_as_it_was(call: Any, tmp_path: Path) -> None:
    out = tmp_path / "cage.json"
    code, text, _ = call("report", CAGE, "--profile", "rsa", "--parts", "score", "-o", out)
    assert code == 4
    assert text.splitlines()[-1] == str(out)
    assert all(words in text for words in ("implant", "rotation x", "condition", "square root of 2"))
    record = json.loads(out.read_bytes())["radiostereometry"]
    assert record["pairs"] is None
    assert record["bodies"][1]["simulated"] is None
    code, text, _ = call("report", CAGE, "--parts", "score", "-o", out)
    assert text == f"{out}\n"
    plain = json.loads(out.read_bytes())
    assert plain["radiostereometry"] is None
    assert plain["reproduction"]["profile"] is None


def test_what_has_no_radiostereometry_is_refused(refused: Any) -> None:
    demo, cage = EXAMPLES / "demo.yaml", CAGE
    assert "/bodies" in refused("report", demo, "--profile", "rsa")
    assert "--profile: two designs are compared without it" in refused("report", cage, cage, "--profile", "rsa")


def test_a_service_answers_with_it_too(body: bytes) -> None:
    """The same record as here, byte for byte; what has no bodies is refused where they are missing."""
    cage = EVERY["radiostereometry"]
    with client_with(worker=True) as client:
        sent = {"design": cage, "profile": "rsa", "trials": 2000, "seed": 3}
        answer = client.post("/v1/reports", json=sent, headers={"Prefer": "wait=60"})
        assert answer.status_code == 200, answer.text
        assert answer.content == body
        for wrong, pointer in (({"design": DEMO}, "/design/bodies"), ({"design": cage, "profile": "rso"}, "/profile")):
            refusal = client.post("/v1/reports", json={"profile": "rsa", **wrong})
            assert refusal.status_code == 422
            assert refusal.json()["errors"][0]["pointer"] == pointer
