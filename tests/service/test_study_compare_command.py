"""``tailstack study compare``: the example files, JSON, figure, refusals, exit codes."""

from __future__ import annotations

import csv
import json
import runpy
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import pytest

from tailstack_service.cli.main import main
from tailstack_service.rendering.document import document_text
from tailstack_service.report.studies.bench import bench_document, draw_bench
from tailstack_service.schemas import json_schema, record_of

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
DEMO = str(EXAMPLES / "demo.yaml")
FILES = EXAMPLES / "measurements"


def compared(capfdbinary: pytest.CaptureFixture[bytes], name: str, *options: str) -> tuple[int, dict]:
    """Exit code and the document that --json prints."""
    code = main(["study", "compare", DEMO, "--measurements", str(FILES / name), "--json", *options])
    return code, json.loads(capfdbinary.readouterr().out)


@pytest.mark.long
def test_the_tilted_flange_is_found(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    """The truth is written in the file: 0.46 deg about x at the connector on the flange."""
    figure = tmp_path / "q.svg"
    code, document = compared(capfdbinary, "bench_tilted_flange.csv", "--figure", str(figure))
    assert code == 1
    jsonschema.Draft202012Validator(json_schema("study-comparison")).validate(document)
    assert document["verdict"] == "differs"
    record = tmp_path / "study.json"
    record.write_text(json.dumps(document))
    assert main(["report", str(record), "--format", "json", "-o", str(tmp_path)]) == 1
    named = [e for e in document["explanations"] if (e["contributor"], e["component"]) == ("connector_flange", "rx")]
    assert named[0]["intervals"][0][0] < 0.46 < named[0]["intervals"][0][1]
    study = record_of("study-comparison", document)
    assert figure.read_text() == draw_bench(study)
    root = ElementTree.fromstring(figure.read_text())
    marks = [node for node in root.iter() if node.tag.endswith("circle")]
    assert len(marks) == len(study.levels) + sum(len(level.quantiles) for level in study.levels)
    eight = replace(study, levels=study.levels[:1] * 8)
    assert "tails of the first 6 of 8 levels" in draw_bench(eight)
    text = document_text(bench_document(study, ""))
    assert max(map(len, text.splitlines())) <= 100
    unwrapped = " ".join(text.split())
    assert all(said in unwrapped for said in study.conclusions)
    assert "connector on flange, spigot and four bolts rx" in unwrapped
    assert unwrapped.endswith("measurements and prediction: differs")


@pytest.mark.long
def test_the_bench_as_designed_agrees(capsys: pytest.CaptureFixture[str]) -> None:
    name = str(FILES / "bench_as_designed.csv")
    assert main(["study", "compare", DEMO, "--measurements", name]) == 0
    text = capsys.readouterr().out
    assert "measurements and prediction: agrees" in text
    assert "not equality" in text


@pytest.mark.long
def test_the_noisy_views_are_named(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """The truth is written in the file: twice the declared noise."""
    code, document = compared(capfdbinary, "bench_noisy_views.csv")
    assert code == 1
    ((low, high),) = next(e["intervals"] for e in document["explanations"] if e["contributor"] == "image_noise")
    assert low < 2 < high
    assert low > 1


@pytest.mark.long
def test_the_paper_s_summary_is_read_and_not_tested(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["study", "compare", DEMO, "--error", "localisation", "--measurements", str(FILES / "paper_s4.csv")]
    assert main(command) == 4
    text = " ".join(capsys.readouterr().out.split())
    assert "0.276 mm/px" in text
    assert "1.09 standard deviations above the mean, where a normal law has 1.645" in text
    assert "1.00 standard deviations above the mean" in text
    assert "P95 over mean does not grow with the level: 1.009, 1.008" in text
    assert "one degree of freedom" in text
    assert "its own reference, not a measurement" in text


def test_the_example_of_the_papers_bench_is_its_table_as_printed() -> None:
    """published: S4, typed once more by itself."""
    with (ROOT / "tests" / "data" / "paper_tables.csv").open(encoding="utf-8", newline="") as stream:
        typed = {(one["row"], one["column"]): one["printed"] for one in csv.DictReader(stream) if one["table"] == "S4"}
    text = (FILES / "paper_s4.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    names = {
        "mean_mm": "e_3d_mean", "sd_mm": "e_3d_std", "p95_mm": "e_3d_p95", "reprojection_px": "e_reprojection_mean_px",
    }  # fmt: skip
    assert {(row["level"], names[k]): row[k] for row in rows for k in names} == typed


def test_the_simulated_files_are_those_their_script_writes() -> None:
    """Digits of a seed are part of the contract; so are the files."""
    made = runpy.run_path(str(FILES / "make_examples.py"))["files"]()
    assert set(made) == {path.name for path in FILES.glob("bench_*.csv")}
    for name, text in made.items():
        assert (FILES / name).read_text() == text, name


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("x_mm,y_mm,z_m\n1,2,3\n", "m.csv:1:1: (document): the columns have different units"),
        ("error_mm\n1\nNaN\n3\n", "m.csv:3:1: /error_mm: error_mm is not a finite number"),
        ("error_mm\n1\n2\n", "at least 3 are needed"),
        ("colour\nred\n", "names no measured quantity"),
    ],
)
def test_rubbish_is_bad_input(capsys: pytest.CaptureFixture[str], tmp_path: Path, content: str, said: str) -> None:
    file = tmp_path / "m.csv"
    file.write_text(content)
    assert main(["study", "compare", DEMO, "--measurements", str(file)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert said in output.err
    assert "next: tailstack study compare --help" in output.err


def test_a_refusal_is_a_problem_document_with_json(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text("error_mm\n1\n-1\n3\n")
    assert main(["study", "compare", DEMO, "--measurements", str(file), "--json"]) == 2
    output = capfdbinary.readouterr()
    assert output.out == b""
    problem = json.loads(output.err)
    jsonschema.Draft202012Validator(json_schema("problem")).validate(problem)
    assert problem["errors"][0]["line"] == 3


def test_usage(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["study", "compare", DEMO]) == 2
    assert "--measurements" in capsys.readouterr().err
    assert main(["study", "compare", DEMO, "--measurements", str(tmp_path / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err
    assert main(["study", "compare", DEMO, "--measurements", DEMO, "--instrument-sd", "-1"]) == 2
    assert "at least 0 and at most 1000" in capsys.readouterr().err
