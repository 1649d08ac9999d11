"""``tailstack sweep``: table, JSON, CSV, refusals, exit codes."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import jsonschema
import pytest

from tailstack import load_design, score
from tailstack_service.cli.main import main
from tailstack_service.schemas import json_schema

EXAMPLES = Path(__file__).parents[2] / "examples"
DEMO = str(EXAMPLES / "demo.yaml")
RZ = "interfaces.structure_connector.tolerances.rz.half_width_deg"


def test_json_is_the_published_record(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["sweep", DEMO, "--set", "views.*.fiducial_noise_px=0.3,0.6", "--set", f"{RZ}=0.15:0.3:2", "--json"]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator(json_schema("sweep")).validate(found)
    assert [point["values"] for point in found["points"]] == [[0.3, 0.15], [0.3, 0.3], [0.6, 0.15], [0.6, 0.3]]
    as_it_stands = score(load_design(DEMO)).targets[0].p95_mm
    assert found["points"][0]["targets"][0]["p95_mm"] == pytest.approx(as_it_stands, rel=1e-12)


def test_csv_has_a_line_for_each_point_and_target(capsys: pytest.CaptureFixture[str]) -> None:
    """Nine samples of a region at each point; the refused point has one line and its reason."""
    design = str(EXAMPLES / "slicer_markups.yaml")
    targets = len(score(load_design(Path(design))).targets)
    assert targets > 1
    command = ["sweep", design, "--set", "views.0.fiducial_noise_px=0.3,-1", "--csv", "--check", "verification"]
    assert main([*command, "--trials", "4000", "--seed", "3"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["status"] for row in rows] == ["ok"] * targets + ["refused"]
    assert all(float(row["p95_low_mm"]) < float(row["p95_mm"]) < float(row["p95_high_mm"]) for row in rows[:-1])
    assert {row["/views/0/fiducial_noise_px"] for row in rows} == {"0.3", "-1.0"}
    assert "at least 0" in rows[-1]["reason"]
    assert rows[-1]["p95_mm"] == ""


def test_the_table_holds_every_point_and_why_some_were_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", DEMO, "--set", f"{RZ}=0.15,-1,0.3", "--set", "views.*.target_noise_px=0.1,0.3"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 100
    rows = [line.split() for line in text.splitlines() if line[:1].isdigit()]
    assert [row[:3] for row in rows] == [
        ["1", "0.15", "0.1"], ["2", "0.15", "0.3"], ["3", "-1", "0.1"], ["4", "-1", "0.3"], ["5", "0.3", "0.1"],
        ["6", "0.3", "0.3"],
    ]  # fmt: skip
    assert [row[-1] == "refused" for row in rows] == [False, False, True, True, False, False]
    unwrapped = " ".join(text.split())
    assert unwrapped.count("must be at least 0") == 1
    assert "refused: points 3, 4: " in unwrapped


def test_nothing_evaluated_is_not_a_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", DEMO, "--set", f"{RZ}=-1,-2"]) == 3
    assert "refused" in capsys.readouterr().out


def test_the_report_of_a_sweep_without_an_answer_is_no_success(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """It left with 0: the report's own list of verdicts knew no sweeps."""
    for widths, code in (("-1,-2", 3), ("-1,0.1", 0)):
        assert main(["sweep", DEMO, "--set", f"{RZ}={widths}", "--json"]) == code
        record = tmp_path / "sweep.json"
        record.write_text(capsys.readouterr().out)
        assert main(["report", str(record), "--format", "json", "-o", str(tmp_path)]) == code
        capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--set", "views.AP.fiducial_noise=0.1:0.2:2"], "did you mean views.AP.fiducial_noise_px?"),
        (["--set", "views.AP.name=1,2"], "is a text"),
        (["--set", "views.AP.fiducial_noise_px"], "PATH=START:STOP:COUNT"),
        (["--set", "views.AP.fiducial_noise_px=0.1:0.2"], "PATH=START:STOP:COUNT"),
        (["--set", "views.AP.fiducial_noise_px=0.1,x"], "PATH=START:STOP:COUNT"),
        (["--set", "views.AP.fiducial_noise_px=0.1", "--trials", "5000"], "--trials: a score draws no trials"),
        ([], "--set"),
    ],
)
def test_what_cannot_be_swept_is_bad_input(capsys: pytest.CaptureFixture[str], arguments: list[str], said: str) -> None:
    assert main(["sweep", DEMO, *arguments]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert said in output.err
    assert "next: tailstack sweep" in output.err
