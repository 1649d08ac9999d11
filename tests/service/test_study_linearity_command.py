"""``tailstack study linearity``: text, JSON, CSV, figure, refusals."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from service_scenes import coplanar_design, small_design, write_json
from test_report_figures import check_picture

from tailstack.design import compile_design, load_design
from tailstack.studies.linearity import Grid, study_linearity
from tailstack_service.cli.main import main
from tailstack_service.rendering.document import document_text
from tailstack_service.rendering.page import Page, write_on
from tailstack_service.report.studies.linearity import draw_linearity, linearity_csv, linearity_document
from tailstack_service.schemas import json_schema, record_of

AXES = ["--noise", "0.3,4", "--rotation", "0,2", "--spread", "1,0.4,6", "--count", "8,7", "--trials", "8192"]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict:
    directory = tmp_path_factory.mktemp("linearity")
    design, figure = write_json(directory / "design.json", small_design()), directory / "map.svg"
    capture = pytest.MonkeyPatch()
    out: list[bytes] = []
    capture.setattr("tailstack_service.cli.main._write", out.append)
    try:
        assert main(["study", "linearity", str(design), *AXES, "--json", "--figure", str(figure)]) == 0
    finally:
        capture.undo()
    return {"study": json.loads(out[0]), "figure": figure.read_text(encoding="utf-8")}


def test_json_is_the_published_record(printed: dict) -> None:
    study = printed["study"]
    jsonschema.Draft202012Validator(json_schema("study-linearity")).validate(study)
    assert len(study["points"]) == 2 * 2 * 3 * 2
    refused = [point for point in study["points"] if point["status"] == "refused"]
    assert {point["spread"] for point in refused} == {6.0}  # six times as wide does not fit on the detector
    good = [point for point in study["points"] if point["status"] == "ok"]
    assert all(point["ratio_interval"][0] < point["ratio"] < point["ratio_interval"][1] for point in good)


def test_text_has_every_point_and_its_class(printed: dict) -> None:
    study = record_of("study-linearity", printed["study"])
    with write_on(Page(details=True)):
        text = document_text(linearity_document(study, ""))
    assert max(map(len, text.splitlines())) <= 80
    rows = [line.split() for line in text.splitlines() if re.match(r"[\d.]+ +[\d.]+ ", line)]
    assert [row[:2] for row in rows] == [
        [f"{spread:g}", f"{noise:g}"] for _ in study.counts for spread in study.spreads for noise in study.noises_px
    ]
    unwrapped = " ".join(text.split())
    assert all(said in unwrapped for said in study.sentences)
    assert "refused: " in text
    for line in study.calibration:
        assert f"  {line.points}  " in text
        assert re.search(rf"{line.lowest_ratio:.3f} +{line.highest_ratio:.3f}$", text, re.MULTILINE)


def test_many_rotations_stand_below_one_another_on_a_page_of_80_columns(tmp_path: Path) -> None:
    design = compile_design(load_design(write_json(tmp_path / "design.json", small_design())))
    rotations = tuple(range(0, 27, 2))
    study = study_linearity(
        design, Grid(noises_px=(0.5,), rotations_deg=rotations, spreads=(1.0,), counts=(8,)), trials=2**13
    )
    text = document_text(linearity_document(study, ""))
    assert max(map(len, text.splitlines())) <= 80
    heads = [line.split()[3:] for line in text.splitlines() if line.startswith("8 fiducials,")]
    assert [float(part) for head in heads for part in head if part != "deg"] == list(rotations)
    shown = [line.split()[2:] for line in text.splitlines() if line.startswith("1    ")]
    values = [float(part) for row in shown for part in row if part[-1:].isdigit()]
    assert values == pytest.approx([100 * (point.ratio - 1) for point in study.points], abs=0.51)
    assert not any(part in ("+0.0", "-0.0", "+0.00", "-0.00", "+0", "-0") for row in shown for part in row)


def test_csv_has_a_line_for_each_point(printed: dict) -> None:
    study = record_of("study-linearity", printed["study"])
    rows = list(csv.DictReader(io.StringIO(linearity_csv(study))))
    assert len(rows) == len(study.points)
    for row, point in zip(rows, study.points, strict=True):
        assert float(row["noise_px"]) == point.noise_px
        assert row["ratio"] == ("" if point.ratio is None else repr(point.ratio))
        assert (row["ratio_low"] == "") == (point.ratio_interval is None)


def test_the_map_shows_every_cell(printed: dict) -> None:
    study = record_of("study-linearity", printed["study"])
    assert printed["figure"] == draw_linearity(study)
    check_picture(printed["figure"])
    alone = replace(study, points=study.points[:1], noises_px=(0.3,), rotations_deg=(0.0,), spreads=(1.0,), counts=(8,))
    check_picture(draw_linearity(alone))
    refused = sum(point.status == "refused" for point in study.points)
    assert printed["figure"].count(">refused<") == refused
    assert printed["figure"].count(" %<") + printed["figure"].count(" % ?<") >= len(study.points) - refused


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--noise", "0.3,wide"], 2, "expected numbers with commas"),
        (["--noise", "nan"], 2, "expected numbers with commas"),
        (["--noise", "0"], 2, "noise must lie between"),
        (["--noise", "0"], 2, "--noise 0.3,1,3,10"),
        (["--count", "6.5"], 2, "expected whole numbers"),
        (["--count", "400"], 2, "count must lie between 6 and"),
        (["--trials", "10"], 2, "expected 8192 to"),
        (["--target", "nobody"], 2, "no target is called"),
        (["--figure", "map.png"], 2, "no known ending"),
        (["--spread", "6", "--noise", "0.3", "--rotation", "0", "--count", "8", "--json"], 3, ""),
    ],
)
def test_refusals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, said: str
) -> None:
    design = write_json(tmp_path / "design.json", small_design())
    assert main(["study", "linearity", str(design), *arguments]) == code
    assert said in capsys.readouterr().err


def test_an_ill_posed_design_is_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "linearity", str(write_json(tmp_path / "flat.json", coplanar_design()))]) == 3
    assert "next: tailstack validate" in capsys.readouterr().err
