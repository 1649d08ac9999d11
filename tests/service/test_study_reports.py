"""Reports of studies: every study has pages, and they hold what its record says.

docs/paper.md and docs/studies.md name commands that there are.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from service_scenes import ROOT, write_json
from test_report_figures import check_picture

from plain_data import problems_of
from tailstack import load_design
from tailstack.optimisation import changes
from tailstack.results.tables import Table
from tailstack_service.audit import audit
from tailstack_service.cli.main import build_parser
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.rendering import render
from tailstack_service.operations.units.parts import compute_whole
from tailstack_service.rendering.document import Paragraph, document_text
from tailstack_service.rendering.text import Page, write_on
from tailstack_service.schemas import json_schema, record_of

EXAMPLE = load_design(EXAMPLE_DESIGN)
STUDIES = [name for name in OPERATIONS if name.startswith("study-")]


@pytest.fixture(autouse=True)
def few_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The study of placement tries one change of each kind here."""
    for name, tried in (("COUNTS", (1,)), ("SIZES", (2.0,)), ("ANGLES_DEG", (60.0,))):
        monkeypatch.setattr(changes, name, tried)


@cache
def body(name: str) -> bytes:
    """The record of the request that the API's document shows."""
    return compute_whole(OPERATIONS[name], {"design": EXAMPLE_DESIGN, **OPERATIONS[name].example})


# What several pictures of one study are called
DRAWN = {
    "study-placement": ("number of fiducials", "angle between both beams, deg", "pose"),
    "study-views": [f"{name}: P95, mm" for name in ("AP, turned", "LAT, turned", "one more like AP")],
}


@pytest.mark.long("html-study-views")
@pytest.mark.parametrize("name", STUDIES)
@pytest.mark.parametrize("form", ["html", "xlsx"])
def test_every_study_has_pages_and_the_same_record_gives_the_same_bytes(name: str, form: str) -> None:
    content = render(name, body(name), form)
    if form == "html":  # its charts are its own; the writer of XLSX is that of all records
        assert content == render(name, body(name), form)
        pictures = re.findall(r"<svg.*?</svg>", content.decode().partition('id="tailstack-record"')[0], re.DOTALL)
        assert (pictures != []) == (name != "study-estimators")  # whose numbers are a table
        for picture in pictures:
            check_picture(picture)
        assert [words for words in DRAWN.get(name, ()) if f">{words}<" not in "".join(pictures)] == []


@pytest.mark.parametrize("name", STUDIES)
def test_no_row_of_a_study_is_left_out(name: str) -> None:
    """Counted in the record itself: points, cases, levels."""
    record = json.loads(body(name))
    document = OPERATIONS[name].document(record_of(name, record), "0" * 64)
    blocks = [block for section in document.sections for block in section.blocks]
    tables = {block.name: block for block in blocks if isinstance(block, Table)}
    with write_on(Page(details=True)):
        text = document_text(document)
    assert max(map(len, text.splitlines())) <= 80
    assert all(said in " ".join(text.split()) for said in record.get("conclusions", record.get("sentences", ())))
    if name == "study-linearity":
        assert [row.cells[7] for row in tables["Points"].rows] == [point["ratio"] for point in record["points"]]
    elif name == "study-coupling":
        assert [row.cells[6] for row in tables["Parts"].rows] == [case["p95_together_mm"] for case in record["cases"]]
    elif name == "study-estimators":
        assert [row.cells[1] for row in tables["Estimators"].rows] == [case["p95_mm"] for case in record["cases"]]
        assumed = f"otherwise by {100 * record['focal_rel_sd']:g} % of the focal length"
        assert any(assumed in block.text for block in blocks if isinstance(block, Paragraph))
    elif name == "study-views":
        maps = [*record["views"], record["further"]]
        every = [direction["p95_mm"] for one in maps for direction in one["directions"]]
        assert [row.cells[3] for row in tables["Directions"].rows] == every
    elif name == "study-placement":
        assert [row.cells[1] for row in tables["Cases"].rows] == [case["best_found_mm"] for case in record["cases"]]
        assert [row.cells[2] for row in tables["Cases"].rows] == [case["lower_bound_mm"] for case in record["cases"]]
    elif name == "study-workspace":
        assert [row.cells[3] for row in tables["Fields"].rows] == [field["poses"] for field in record["fields"]]
    else:
        assert len(tables["Levels"].rows) == len(record["levels"])
        assert len(tables["Tests"].rows) == sum(len(level["tests"]) for level in record["levels"])


@pytest.mark.parametrize("name", STUDIES)
def test_a_record_keeps_its_schema_and_is_computed_again_from_its_design(name: str) -> None:
    record = json.loads(body(name))
    Draft202012Validator(json_schema(name)).validate(record)
    if name == "study-comparison":  # which is of measurements as well
        (problem,) = problems_of(audit, body(name), "study.json", EXAMPLE)
        assert "by tailstack study compare" in problem.detail
    else:
        design = load_design(OPERATIONS[name].example.get("design", EXAMPLE_DESIGN))
        assert audit(body(name), "study.json", design).verdict == "verified"


def test_a_number_of_a_study_that_was_changed_is_told(tmp_path: Path, call: Any) -> None:
    forged = json.loads(body("study-coupling"))
    forged["cases"][0]["p95_together_mm"] *= 1.01
    path = write_json(tmp_path / "study.json", forged)
    code, out, _ = call("report", "--verify", path, write_json(tmp_path / "design.json", EXAMPLE_DESIGN))
    assert code == 1
    assert "/cases/0/p95_together_mm: recorded" in out


# --- their pages in docs/ -------------------------------------------------------------------------


PAPER = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
STUDIES_PAGE = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
PAGES = PAPER + STUDIES_PAGE
FENCED = re.findall(r"^```(\w*)\n(.*?)^```$", PAGES, flags=re.MULTILINE | re.DOTALL)
BLOCKS = [block for kind, block in FENCED if not kind]
COMMANDS = [
    one.partition("|")[0].partition(" > ")[0].partition("#")[0].strip(" )")
    for block in BLOCKS
    for one in re.findall(r"\btailstack \w.*", block)
]


def test_no_block_names_a_python_of_nobody_knows_which_packages() -> None:
    assert not re.search(r"^python ", "\n".join(BLOCKS), flags=re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_is_one_and_its_files_are_there(command: str) -> None:
    words = shlex.split(command)[1:]
    assert isinstance(build_parser().parse_args(words), argparse.Namespace)
    for word in words:
        if word.startswith("examples/"):
            assert (ROOT / word).is_file()


def test_the_equations_are_all_there() -> None:
    """published: the paper numbers its equations from 1 to 18."""
    heads = " ".join(re.findall(r"^\*\*(Eqs? .*?)\*\*", PAPER, flags=re.MULTILINE))
    numbers: set[int] = set()
    for part in re.findall(r"\d+–\d+|\d+", heads):
        first, _, last = part.partition("–")
        numbers |= set(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, 19))
