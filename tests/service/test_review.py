"""What a review leaves in a design: no number and no hash knows of it; reports list it; versions are compared."""

from __future__ import annotations

import io
import json
import re
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
import yaml

from plain_data import DEMO, problems_of
from tailstack import load_design, score
from tailstack.design import design_to_data, design_to_json, design_to_yaml
from tailstack.design.write import Revision, revise_design
from tailstack_service.audit import audit
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report

HOSTILE = ["=HYPERLINK(1)", "<script>alert(1)</script>", "a\n\nb: - c", "{{ x }} & y", "'\"`]]>", "|\n  x", " \t\n"]
OLD = deepcopy(DEMO)
OLD["views"][0]["fiducial_noise_px"] = 0.5


def reviewed(**sections: Any) -> dict[str, Any]:
    return {**DEMO, "review": sections}


FULL = reviewed(
    versions=[
        {"name": "A", "note": "noisy", "date": "2026-11-28T10:00Z", "text": yaml.safe_dump(OLD)},
        {"name": "gone", "text": "no design"},
    ],
    comments=[
        {"bead": "F3", "text": "too near", "resolved": True},
        {"contributor": "structure_connector", "component": "rx", "text": HOSTILE[1], "author": "=A1"},
        {"bead": "not there", "text": HOSTILE[0]},
        {"text": HOSTILE[2]},
    ],
)  # fmt: skip


@pytest.fixture(scope="module")
def body() -> bytes:
    return to_json(compute_report(load_design(FULL), ReportContents(parts=("score",))))


def test_neither_hash_nor_score_knows_of_it_and_whatever_is_said_is_kept() -> None:
    plain = load_design(DEMO)
    full = reviewed(
        versions=[
            {"name": f"v{k}", "note": text, "text": f"{text}\n{yaml.safe_dump(OLD)}"} for k, text in enumerate(HOSTILE)
        ],
        comments=[{"text": text} for text in HOSTILE],
    )  # fmt: skip
    design = load_design(full)
    assert design.sha256 == plain.sha256
    assert to_json(score(design)) == to_json(score(plain))
    for text in (design_to_yaml(design), design_to_json(design)):
        assert design_to_data(load_design(text.encode()))["review"] == full["review"]
    fewer = Revision(labels=design.fiducials.labels[1:], fiducials_mm=np.array(design.fiducials.positions_mm)[1:])
    moved = revise_design(design, fewer)
    assert moved.document.review == design.document.review  # the optimiser keeps it, and what it dropped too


@pytest.mark.parametrize(
    ("section", "pointer"),
    [
        ({"comments": [{"text": ""}]}, "/review/comments/0/text"),
        ({"comments": [{"text": "x" * 2001}]}, "/review/comments/0/text"),
        ({"comments": [{"bead": "F1", "contributor": "a", "text": "x"}]}, "/review/comments/0/contributor"),
        ({"comments": [{"component": "rx", "text": "x"}]}, "/review/comments/0/component"),
        ({"comments": [{"text": "x", "date": "tomorrow"}]}, "/review/comments/0/date"),
        ({"comments": [{"text": "x", "on": "F1"}]}, "/review/comments/0/on"),
        ({"comments": [{"text": "x"}] * 501}, "/review/comments"),
        ({"versions": [{"name": "A", "text": "x"}] * 2}, "/review/versions/1/name"),
        ({"versions": [{"name": "A"}]}, "/review/versions/0/text"),
        ({"versions": {}}, "/review/versions"),
        ([], "/review"),
    ],
)
def test_rubbish_is_refused_where_it_stands(section: Any, pointer: str) -> None:
    assert problems_of(load_design, {**DEMO, "review": section})[0].pointer == pointer


def test_reports_list_it_as_text_and_an_audit_computes_them_again(body: bytes) -> None:
    html = render("report", body, "html")
    page = html.decode().rpartition('<script type="application/json" id=')[0]
    assert "3 of them open" in page
    assert "&lt;script&gt;alert(1)" in page
    assert "<script>alert" not in html.decode()
    assert "structure_connector rx" in page.replace("<wbr>", "")
    assert "bead not there" in page
    sheet = openpyxl.load_workbook(io.BytesIO(render("report", body, "xlsx")))["Comments"]
    cells = [cell for row in sheet.iter_rows() for cell in row if cell.value == HOSTILE[0]]
    assert [cell.data_type for cell in cells] == ["s"]
    assert all(cell.quotePrefix for cell in cells)
    assert audit(html, "x", fast=True).verdict == "verified"
    none = compute_report(load_design(DEMO), ReportContents(parts=("score",)))
    assert b">Review<" not in render("report", to_json(none), "html")


def test_a_design_is_compared_with_a_version_of_it_by_name(call: Any, refused: Any, tmp_path: Path) -> None:
    """The same as two files, but called by name."""
    design, old, out = tmp_path / "new.yaml", tmp_path / "old.yaml", tmp_path / "out.json"
    design.write_text(design_to_yaml(load_design(FULL)), "utf-8")
    old.write_text(yaml.safe_dump(OLD), "utf-8")
    code, _, _ = call("report", design, "--against", "A", "--parts", "score", "-o", out)
    named = json.loads(out.read_bytes())
    assert (code, named["schema"]) == (1, "tailstack/comparison/1")
    assert [change["pointer"] for change in named["changes"]] == ["/views/0/fiducial_noise_px"]
    file = tmp_path / "pair" / "old-new.report.json"
    code, said, _ = call("report", old, design, "--parts", "score", "--format", "json", "-o", tmp_path / "pair")
    assert (code, said) == (1, f"{file}\n")  # the verdict on the second
    plain = json.loads(file.read_bytes())
    assert (named["names"], plain["names"]) == (["A", "now"], None)
    assert {key for key in named if named[key] != plain[key]} == {"names", "title", "headline"}
    assert named["title"].endswith(": A against now")
    told = " ".join([named["headline"]["sentence"], *named["headline"]["matters"]])
    assert " with now" in told
    assert " in A and " in told
    html = render("comparison", to_json(named), "html")
    assert re.search(rb"(first|second) design\b(?!s)", html, re.IGNORECASE) is None
    assert audit(html, "x", fast=True).verdict == "verified"
    strange = render("comparison", json.dumps({**named, "names": HOSTILE[:2]}).encode(), "html")
    assert b"<script>alert" not in strange
    assert "it keeps A, gone" in refused("report", design, "--against", "B")
    assert "it keeps none" in refused("report", old, "--against", "B")
    assert "is no design" in refused("report", design, "--against", "gone")
    assert "of one design" in refused("report", design, old, "--against", "A")
    assert call("report", old, design, old)[0] == 2
    assert "--against" in refused("report", "--verify", out, "--against", "A")
