"""``tailstack study coupling``: text, JSON, figure, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import pytest

from tailstack.studies.coupling import choose_decimals
from tailstack_service.cli.main import main
from tailstack_service.rendering.document import document_text
from tailstack_service.rendering.page import Page, write_on
from tailstack_service.report.studies.coupling import COMPARISONS, coupling_document, draw_coupling
from tailstack_service.schemas import json_schema, record_of

EXAMPLES = Path(__file__).parents[2] / "examples"
DEMO = str(EXAMPLES / "demo.yaml")
QUICK = ["--trials", "8192", "--level", "2,5"]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What --json prints for the demo, and the figure beside it."""
    figure = tmp_path_factory.mktemp("figure") / "coupling.svg"
    capture = pytest.MonkeyPatch()
    out: list[bytes] = []
    capture.setattr("tailstack_service.cli.main._write", out.append)
    try:
        assert main(["study", "coupling", DEMO, *QUICK, "--json", "--figure", str(figure)]) == 0
    finally:
        capture.undo()
    return {"study": json.loads(out[0]), "figure": figure.read_text()}


def test_json_is_the_published_record(document: dict) -> None:
    study = document["study"]
    jsonschema.Draft202012Validator(json_schema("study-coupling")).validate(study)
    assert [(case["reading"], case["installation"]) for case in study["cases"]] == [
        ("physical", "as designed"), ("physical", "2 deg + 5 mm"), ("eq18", "as designed"), ("eq18", "2 deg + 5 mm"),
    ]  # fmt: skip
    assert study["trials"] == 8192
    assert study["cases"][3]["gain"]["value"] == pytest.approx(1, abs=1e-9)


def test_first_order_says_what_is_seen_against_the_vector_sum(document: dict) -> None:
    """Monte Carlo against the law: at 2 deg + 5 mm the moved noise is smaller along the bias in one reading, and turned
    in the other.  The sums share their deviates with what they are held against: a tenth of a per cent is seen."""
    ratios = {
        case["reading"]: case["against_vector_sum"] for case in document["study"]["cases"] if case["rotation_deg"]
    }
    for ratio in ratios.values():
        assert ratio["interval"][1] - ratio["interval"][0] < 1e-3
        assert ratio["first_order"] == pytest.approx(ratio["value"], abs=3e-4)
    assert ratios["physical"]["first_order"] < 1 - 9e-4
    assert ratios["eq18"]["first_order"] > 1 + 4e-4


def test_text_fits_the_page_and_holds_every_ratio(document: dict) -> None:
    study = record_of("study-coupling", document["study"])
    with write_on(Page(100, details=True)):
        text = document_text(coupling_document(study, ""))
    assert max(map(len, text.splitlines())) <= 100
    for case in study.cases:
        assert f"{case.p95_together_mm:.4g}" in text
        for _, _, which in COMPARISONS:
            decimals = min(choose_decimals(which(case)), 3)
            assert f"{round(100 * (which(case).value - 1), decimals) + 0.0:+.{decimals}f}" in text
    unwrapped = " ".join(text.split())
    assert all(case.sentence in unwrapped for case in study.cases)
    assert all(said in unwrapped for said in study.conclusions)
    assert "Student's t with 31 degrees of freedom" in unwrapped


def test_what_there_is_none_of_is_told(document: dict) -> None:
    study = record_of("study-coupling", document["study"])
    long = "a target with a long name, " * 3
    cases = tuple(replace(case, target=long, gain=None, noise_rms_biased_mm=None) for case in study.cases)
    bare = replace(study, cases=cases)
    with write_on(Page(100, details=True)):
        text = document_text(coupling_document(bare, ""))
    assert max(map(len, text.splitlines())) <= 100
    assert text.count("  none  ") == len(cases)  # gains
    assert sum(line.endswith("  -") for line in text.splitlines()) == len(cases)  # root mean squares
    figure = draw_coupling(bare)
    assert figure.count("no standard deviation") == len(cases)
    assert figure.count("<circle") == (len(COMPARISONS) - 1) * len(cases)


def test_the_figure_is_drawn_from_the_record(document: dict) -> None:
    study = record_of("study-coupling", document["study"])
    assert document["figure"] == draw_coupling(study)
    root = ElementTree.fromstring(document["figure"])
    marks = [node for node in root.iter() if node.tag.endswith("circle")]
    assert len(marks) == len(COMPARISONS) * len(study.cases)
    width, height = float(root.get("width", 0)), float(root.get("height", 0))
    assert all(0 < float(mark.get("cx", -1)) < width and 0 < float(mark.get("cy", -1)) < height for mark in marks)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--trials", "100"], "8192"),
        (["--level", "1"], "DEG,MM"),
        (["--level", "90,0"], "at most 45 deg"),
        (["--level", "nan,0"], "at most 45 deg"),
        (["--figure", "coupling.png"], "no known ending"),
        (["--figure", "/nowhere/coupling.svg"], "cannot write"),
        (["--target", "elsewhere"], "no target is called"),
        (["--error", "angle"], "invalid choice"),
    ],
)
def test_what_is_not_asked_for_rightly_is_bad_input(
    capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["study", "coupling", DEMO, *arguments]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert said in output.err
