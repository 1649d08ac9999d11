"""What a user named is printed whole: long names that differ in one letter are told from one another everywhere."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tailstack.design import load_design
from tailstack.scoring import score
from tailstack.sweeping import read_axes, sweep
from tailstack.verification import verify
from tailstack_service.documents import to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.validation import validate, validation_text
from tailstack_service.rendering.jobs import jobs_text
from tailstack_service.rendering.page import WIDTH
from tailstack_service.report.assembling import compute_report, options_of

ROOT = Path(__file__).resolve().parents[2]


def similar(what: str, letter: str, length: int = 80) -> str:
    """A name of so many letters, some words and then one long word, with its one letter of difference in the middle."""
    begin = f"{what} of the left arm, "
    rest = length - len(begin) - 1
    return begin + "x" * (rest // 2) + letter + "y" * (rest - rest // 2)


VIEWS, TARGETS, REQUIREMENTS = ([similar(what, letter) for letter in "ab"] for what in ("view", "target", "limit"))
LABELS = [similar("seat", letter, 200) for letter in "ab"]
NAME = similar("design", "a")


@pytest.fixture(scope="module")
def named() -> dict[str, Any]:
    """The demo, called so."""
    data = load_design(ROOT / "examples" / "demo.yaml").document
    design: dict[str, Any] = data.model_dump(mode="json", by_alias=True, exclude_unset=True)
    del design["optimise"]
    design["name"] = NAME
    for view, name in zip(design["views"], VIEWS, strict=True):
        view["name"] = name
    for interface, label in zip(design["interfaces"].values(), LABELS, strict=True):
        interface["label"] = label
    target, requirement = design["targets"][0], design["requirements"][0]
    design["targets"] = [{**target, "name": name} for name in TARGETS]
    design["targets"][1]["position_mm"] = [1.0, 0.0, 61.0]
    design["requirements"] = [
        {**requirement, "name": name, "targets": [target]} for name, target in zip(REQUIREMENTS, TARGETS, strict=True)
    ]
    return design


def squeezed(text: str) -> str:
    return re.sub(r"\s", "", text)


def columns_of(text: str) -> str:
    """Every column of every table of a text, read downwards, without blanks."""
    lines, found = text.split("\n"), []
    for place, line in enumerate(lines):
        if not re.fullmatch(r"\s*─+(  ─+)*", line):
            continue
        body = lines[place + 1 :]
        body = body[: next((k for k, each in enumerate(body) if not each.strip()), len(body))]
        for span in re.finditer(r"─+", line):
            found.append(squeezed("".join(each[span.start() : span.end()] for each in body)))
    return "\n".join(found)


def missing(names: list[str], text: str) -> list[str]:
    """Names that a text does not hold whole."""
    everything = squeezed(text) + "\n" + columns_of(text)
    return [name for name in names if squeezed(name) not in everything]


def test_score(named: dict[str, Any]) -> None:
    text = OPERATIONS["score"].write(score(load_design(named)))
    assert missing([NAME, *VIEWS, *TARGETS, *REQUIREMENTS, *LABELS], text) == []
    assert max(map(len, text.split("\n"))) <= WIDTH


def test_verify(named: dict[str, Any]) -> None:
    text = OPERATIONS["verification"].write(verify(load_design(named), trials=8192))
    assert missing([NAME, *TARGETS, *REQUIREMENTS], text) == []
    assert max(map(len, text.split("\n"))) <= WIDTH


def test_sweep(named: dict[str, Any]) -> None:
    design = load_design(named)
    path = "/interfaces/structure_connector/tolerances/rz/half_width_deg"
    axes = read_axes(design, [{"pointer": path, "values": [0.05, 0.1]}])
    text = OPERATIONS["sweep"].write(sweep(design, axes))
    worst = max(score(design).targets, key=lambda target: target.p95_mm).name
    assert missing([NAME, worst], text) == []
    assert max(map(len, text.split("\n"))) <= WIDTH


def test_validate(named: dict[str, Any]) -> None:
    text = validation_text("design.yaml", validate(load_design(named)))
    assert missing([NAME, *VIEWS, *TARGETS, *REQUIREMENTS], text) == []


def test_jobs_show_ids_in_one_piece_and_names_whole() -> None:
    ids = ["job_3fa85f6457174562b3fc2c963f66afa6", "job_2c963f66afa63fa85f6457174562b3fc"]
    names = [similar("design", letter, 255) for letter in "ab"]
    jobs = [
        {
            "id": one, "kind": "verification", "state": "succeeded", "design_name": name,
            "created_at": "2026-11-22T10:00:00Z", "progress": {"fraction": 1.0},
        }
        for one, name in zip(ids, names, strict=True)
    ]  # fmt: skip
    text = jobs_text(jobs)
    assert missing(names, text) == []
    assert all(one in text.split() for one in ids)


def test_names_in_wide_letters_are_whole_too(named: dict[str, Any]) -> None:
    """A wide letter takes two columns; the page counts them."""
    names = ["固定具" * 26 + letter for letter in ("甲", "乙")]
    data = json.loads(json.dumps(named))
    for target, requirement, name in zip(data["targets"], data["requirements"], names, strict=True):
        target["name"], requirement["targets"] = name, [name]
    text = OPERATIONS["score"].write(score(load_design(data)))
    wide = [sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in line) for line in text.split("\n")]
    assert max(wide) <= WIDTH
    assert all(name[-1] in text for name in names)


# --- names of interfaces --------------------------------------------------------------------------


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
