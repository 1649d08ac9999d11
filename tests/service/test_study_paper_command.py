"""``tailstack study paper``: text, JSON, CSV, figures, refusals."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from service_scenes import EXAMPLES, ROOT, coplanar_design, write_json
from test_report_figures import check_picture

from tailstack.studies.paper.published import CELLS
from tailstack_service.cli.main import main
from tailstack_service.operations.study_paper import C_ARM, FITTED, scenario
from tailstack_service.rendering.document import document_text
from tailstack_service.rendering.page import Page, write_on
from tailstack_service.report.studies.paper import paper_csv, paper_document
from tailstack_service.schemas import json_schema, record_of

QUICK = ["--trials", "40000"]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What --json prints for the shipped geometries, and the figures beside it."""
    directory = tmp_path_factory.mktemp("figures") / "new"
    capture = pytest.MonkeyPatch()
    out: list[bytes] = []
    capture.setattr("tailstack_service.cli.main._write", out.append)
    try:
        assert main(["study", "paper", *QUICK, "--json", "--figures", str(directory)]) == 0
    finally:
        capture.undo()
    return {"study": json.loads(out[0]), "figures": sorted(directory.iterdir())}


@pytest.mark.long
def test_json_is_the_published_record(printed: dict) -> None:
    study = printed["study"]
    jsonschema.Draft202012Validator(json_schema("study-paper")).validate(study)
    assert [(one["compared"], one["reading"]) for one in study["geometries"]] == [
        (True, "eq18"), (True, "physical"), (False, "physical"),
    ]  # fmt: skip
    for one in study["geometries"]:
        assert len(one["cells"]) == 10 + 12 + 9 + 3
        assert one["compared_cells"] == (27 if one["compared"] else 0)


def test_text_holds_every_printed_cell_with_its_z(printed: dict) -> None:
    study = record_of("study-paper", printed["study"])
    with write_on(Page(120, details=True)):
        text = document_text(paper_document(study, ""))
    assert max(map(len, text.splitlines())) <= 120
    lines = text.splitlines()
    for cell in study.geometries[0].cells:
        if cell.printed_mm is not None and cell.table != "S3":
            in_table = {90.39: "90", 108.56: "108"}.get(cell.printed_mm, f"{cell.printed_mm:g}")  # as the table has it
            line = next(line for line in lines if line.startswith(f"{cell.row}, "[: len(cell.row) + 2])
                        and (", mean" if cell.quantity == "mean" else ", P95") in line)  # fmt: skip
            assert in_table in line.split()
            assert f"{cell.z:+.2f}" in line
    unwrapped = " ".join(text.split())
    assert all(statement.sentence in unwrapped for statement in study.statements)
    assert all(f"{one.outside_cells} outside the 99 % band" in unwrapped for one in study.geometries[:2])
    assert "without matrix 2" in text
    for name in "xyz":
        line = next(line for line in lines if line.startswith(f"std {name}  "))
        printed_mm, *ours = line.split()[2:]
        cells = [one for geometry in study.geometries for one in geometry.cells if one.quantity == f"std_{name}"]
        assert float(printed_mm) == cells[0].printed_mm
        assert [ours[1], ours[3]] == [f"{cell.z:+.2f}" for cell in cells[:2]]
    assert "are the same numbers in either reading" in unwrapped


def test_text_has_every_cell_of_the_tables(printed: dict) -> None:
    """published: the tables, typed once more by themselves."""
    with write_on(Page(120, details=True)):
        text = document_text(paper_document(record_of("study-paper", printed["study"]), ""))
    lines = text.splitlines()
    heads = {name: next(k for k, line in enumerate(lines) if line.startswith(start)) for name, start in (
        ("S1", "S1: "), ("S2", "S2: "), ("S3", "S3: standard"), ("means", "S3: means"), ("S4", "S4, as"),
        ("analytic", "printed, analytic"),
    )}  # fmt: skip

    def row(table: str, start: str) -> list[str]:
        return next(line for line in lines[heads[table] :] if line.startswith(start)).removeprefix(start).split()

    with (ROOT / "tests" / "data" / "paper_tables.csv").open(encoding="utf-8", newline="") as stream:
        for one in csv.DictReader(stream):
            metres = f"{1000 * float(one['printed']):g}"
            if one["table"] == "S1":
                said = row("S1", one["row"] + (", P95" if one["column"] == "e_tcp_p95" else ", mean"))
                assert said[one["column"] != "e_3d_mean"] == metres, one
            elif one["table"] == "S2":
                assert row("S2", f"{one['row']}, {one['column']}, P95")[0] == metres, one
            elif one["table"] == "S4":
                columns = ("e_3d_mean", "e_3d_std", "e_3d_p95", "e_reprojection_mean_px")
                assert row("S4", one["row"])[columns.index(one["column"])] == one["printed"], one
            elif one["column"].endswith("_mean"):
                assert row("means", one["row"])[one["column"] == "analytic_mean"] == one["printed"], one
            elif one["column"] == "mc_std":
                assert row("S3", f"std {one['row']}")[0] == metres, one
            else:
                assert row("analytic", "printed, analytic")["xyz".index(one["row"])] == metres, one


def test_geometries_of_long_similar_names_are_told_apart(printed: dict) -> None:
    """Names of 80 letters, a study's text being told by letters A, B, ... that stand beside the whole names."""
    study = record_of("study-paper", printed["study"])
    names = [f"C-arm of the left theatre, {'x' * 26}{letter}{'y' * 26}" for letter in "abcdefgh"]
    named = [replace(geometry, name=name) for geometry, name in zip(study.geometries, names, strict=False)]
    text = "".join(document_text(paper_document(replace(study, geometries=tuple(named)), "")).split())
    assert all("".join(geometry.name.split()) in text for geometry in named)


def test_csv_has_a_line_for_each_cell_and_geometry(printed: dict) -> None:
    rows = list(csv.DictReader(io.StringIO(paper_csv(record_of("study-paper", printed["study"])))))
    assert len(rows) == 3 * 34
    held = [row for row in rows if row["z"]]
    assert len(held) == 2 * len(CELLS)
    assert {row["outside"] for row in held} == {"true", "false"}
    assert all(float(row["band_low_mm"]) <= float(row["value_mm"]) <= float(row["band_high_mm"]) for row in rows)


def test_figures_are_drawn_for_every_geometry(printed: dict) -> None:
    names = [file.name for file in printed["figures"]]
    assert names == sorted(f"{letter}_{what}.svg" for letter in "abc" for what in ("sweeps", "levels", "factor"))
    for file in printed["figures"]:
        check_picture(file.read_text(encoding="utf-8"))
        compared = file.name[0] != "c"
        assert ("printed" in file.read_text().partition("</desc>")[2]) == compared


def test_bars_of_a_figure_are_the_bands_of_its_cells(printed: dict) -> None:
    """closed form: lengths on the page over lengths in mm are one number for every printed cell of a panel, those of
    means, where rounding counts, and of P95, where it does not."""
    svg = next(file for file in printed["figures"] if file.name == "a_sweeps.svg").read_text(encoding="utf-8")
    cells = [one for one in printed["study"]["geometries"][0]["cells"] if one["row"].startswith("rotation")]
    bands = [
        one["band_mm"][1] - one["band_mm"][0] for what in ("mean", "p95") for one in cells if one["quantity"] == what
    ]
    upright = re.findall(r'd="M([\d.]+) ([\d.]+)L\1 ([\d.]+)" fill="none" stroke="#\w+" stroke-width="1.2"', svg)
    lengths = [abs(float(high) - float(low)) for _, low, high in upright]
    assert len(lengths) == 10 + 6
    scales = [length / band for length, band in zip(lengths, bands, strict=False)]
    assert scales == pytest.approx([scales[5]] * 10, rel=0.04)


def test_a_design_of_ones_own_takes_the_place_of_the_c_arm(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["study", "paper", str(EXAMPLES / "demo.yaml"), "--fitted", str(scenario(FITTED[0])), *QUICK, "--json"]
    assert main(command) == 0
    study = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in study["geometries"]] == [
        "fitted to the paper in the Eq 18 reading", "drill guide, reference structure with 12 beads",
    ]  # fmt: skip


def test_the_scenarios_are_those_of_the_examples() -> None:
    for name in (*FITTED, C_ARM):
        assert scenario(name).read_bytes() == (EXAMPLES / "paper" / name).read_bytes()
    for name in FITTED:
        assert "FITTED, not published" in scenario(name).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--trials", "2000"], 2, "40000"),
        (["absent.yaml"], 2, "absent.yaml"),
        (["--fitted", "absent.yaml"], 2, "absent.yaml"),
        (["--json", "--csv"], 2, "not allowed with"),
        (["--figures", "taken"], 2, "not a directory"),
        (["--figures", ""], 2, "no directory is named"),
        (["flat.json"], 3, "plane"),
        (["--seed", "-1"], 2, "expected"),
    ],
)
def test_refusals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str],
    code: int, said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_json(tmp_path / "flat.json", coplanar_design())
    (tmp_path / "taken").write_text("a file")
    assert main(["study", "paper", *arguments]) == code
    output = capsys.readouterr()
    assert output.out == ""
    assert said in output.err
    assert "next: tailstack" in output.err


def test_the_short_text_has_the_means_of_s3_and_the_bench_of_s4(printed: dict) -> None:
    """published: S3's means of the Monte Carlo, and S4."""
    with write_on(Page(80)):
        lines = document_text(paper_document(record_of("study-paper", printed["study"]), "")).splitlines()
    assert max(map(len, lines)) <= 80
    means = next(k for k, line in enumerate(lines) if line.startswith("S3: means"))
    assert [line.split()[:2] for line in lines[means + 4 : means + 7]] == [
        ["x", "0.602"],
        ["y", "0.515"],
        ["z", "0.221"],
    ]
    bench = next(k for k, line in enumerate(lines) if line.startswith("S4, as"))
    assert lines[bench + 5].split()[:5] == ["L1", "0.551", "0.0046", "0.556", "2.0"]
    assert not any("first order" in line for line in lines)
