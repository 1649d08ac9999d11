"""An interface has one name in every answer, the one of the design document, and its author's label beside it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tailstack.design import load_design
from tailstack.scoring import score
from tailstack_service.audit import audit
from tailstack_service.audit.verify import values
from tailstack_service.documents import plain, to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import compute_report, options_of
from tailstack_service.schemas import record_of

ROOT = Path(__file__).resolve().parents[2]
OLDER = ROOT / "tests" / "data" / "older" / "report.json"  # as written when interfaces were numbered
SEAT, FLANGE = "structure_connector", "connector_flange"
LABEL = {SEAT: "carrier on connector, two dowel pins", FLANGE: "connector on flange, spigot and four bolts"}


def texts(data: Any) -> Iterator[str]:
    """Every text in plain data, keys apart."""
    if isinstance(data, dict):
        for value in data.values():
            yield from texts(value)
    elif isinstance(data, list):
        for value in data:
            yield from texts(value)
    elif isinstance(data, str):
        yield data


@pytest.fixture(scope="module")
def demo() -> dict[str, Any]:
    """A report of the demo, whose interfaces have labels, as plain data."""
    design = load_design(ROOT / "examples" / "demo.yaml")
    found: dict[str, Any] = json.loads(to_json(compute_report(design, options_of({"parts": ["score"]}))))
    return found


def test_budget_and_allowances_name_interfaces_as_the_design_does(demo: dict[str, Any]) -> None:
    lines = demo["score"]["targets"][0]["contributors"]
    assert {line["name"]: line["label"] for line in lines if line["name"] in LABEL} == LABEL
    assert {
        entry["contributor"]: entry["label"] for entry in demo["allowances"] if entry["contributor"] in LABEL
    } == LABEL
    assert "fiducial noise, AP" in {line["label"] for line in lines if line["name"] == "fiducial_noise:AP"}
    assert not [text for text in texts(demo) if re.search(r"\binterface_?[12]\b", text)]


def test_an_interface_without_a_label_is_called_by_its_name() -> None:
    data = load_design(ROOT / "examples" / "demo.yaml").document.model_dump(
        mode="json", by_alias=True, exclude_unset=True
    )
    for interface in data["interfaces"].values():
        del interface["label"]
    lines = score(load_design(data)).targets[0].contributors
    assert {line.label for line in lines if line.name == SEAT} == {SEAT}


def test_people_read_the_name_of_the_design_and_the_label() -> None:
    text = " ".join(OPERATIONS["score"].write(score(load_design(ROOT / "examples" / "demo.yaml"))).split())
    assert f"{FLANGE}: " in text
    for word in " ".join(LABEL.values()).split():
        assert word in text


@pytest.mark.long
def test_a_report_of_an_older_version_is_read_rendered_and_verified() -> None:
    """recorded: the example of POST /v1/reports as a service answered it when budgets said interface_1."""
    content = OLDER.read_bytes()
    assert content.count(b"interface_1") >= 7
    record = record_of("report", json.loads(content))
    names = {line.name for target in record.score.targets for line in target.contributors}
    assert {SEAT, FLANGE} < names
    assert not {"interface_1", "interface_2"} & names
    page = render("report", content, "html").decode()
    assert page.count("interface_1") == content.count(b"interface_1")  # in the record that the page holds, nowhere else
    assert f"{SEAT} rx" in page
    found = audit(content, "report.json", fast=True)
    assert found.questions[0].what == "record"
    # Names are understood: what differs from today's score are numbers, each by as much as CHANGELOG.md says.
    apart = [pair for pair in values(plain(record.score), plain(score(load_design(record.design)))) if not pair.close]
    for pair in apart:
        if (
            "/provenance/" in pair.pointer
            or "/losses" in pair.pointer
            or pair.pointer == "/validity/statement"  # words, which say today what they promise
            or pair.pointer
            in ("/validity/nu_turns", "/validity/nu_bias", "/validity/nu_range")  # which that record does not hold
            or pair.pointer.endswith(("law_error_mm", "standard_error_mm", "position_tcp_mm"))
        ):
            continue
        by = 0.01 if "/per_unit/" in pair.pointer else 1e-4
        assert pair.computed == pytest.approx(pair.recorded, rel=by), pair.words


def test_worst_ends_of_an_older_version_are_named_as_today() -> None:
    """A user's own words are left as they are, also where they look like an old name."""
    record = plain(score(load_design(ROOT / "examples" / "demo.yaml")))
    target = json.loads(json.dumps(record["targets"][0]))
    target["name"] = "interface_1"
    target["worst_vertex"] = ["interface_1.rz=+0.1 deg", "interface_2.tx=-0.05 mm"]
    found = record_of("score", {**record, "targets": [target]}).targets[0]
    assert found.name == "interface_1"
    assert found.worst_vertex == (f"{SEAT}.rz=+0.1 deg", f"{FLANGE}.tx=-0.05 mm")
