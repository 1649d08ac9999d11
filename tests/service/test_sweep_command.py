"""``tailstack sweep``: table, JSON, CSV, refusals, exit codes, figures."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsonschema
import pytest
from service_scenes import EXAMPLES, small_design, write_json

from plain_data import read_cases
from tailstack import load_design, score
from tailstack_service.cli.main import main
from tailstack_service.schemas import json_schema

DEMO = str(EXAMPLES / "demo.yaml")
RZ = "interfaces.structure_connector.tolerances.rz.half_width_deg"


def test_json_is_the_published_record(call: Any) -> None:
    axes = ("--set", "views.*.fiducial_noise_px=0.3,0.6", "--set", f"{RZ}=0.15:0.3:2")
    found = json.loads(call("sweep", DEMO, *axes, "--json")[1])
    jsonschema.Draft202012Validator(json_schema("sweep")).validate(found)
    assert [point["values"] for point in found["points"]] == [[0.3, 0.15], [0.3, 0.3], [0.6, 0.15], [0.6, 0.3]]
    as_it_stands = score(load_design(DEMO)).targets[0].p95_mm
    assert found["points"][0]["targets"][0]["p95_mm"] == pytest.approx(as_it_stands, rel=1e-12)


def test_csv_has_a_line_for_each_point_and_target(call: Any) -> None:
    """Nine samples of a region at each point; the refused point has one line and its reason."""
    design = str(EXAMPLES / "slicer_markups.yaml")
    targets = len(score(load_design(Path(design))).targets)
    assert targets > 1
    command = ("sweep", design, "--set", "views.0.fiducial_noise_px=0.3,-1", "--csv", "--check", "verification")
    rows = list(csv.DictReader(io.StringIO(call(*command, "--trials", "4000", "--seed", "3")[1])))
    assert [row["status"] for row in rows] == ["ok"] * targets + ["refused"]
    assert all(float(row["p95_low_mm"]) < float(row["p95_mm"]) < float(row["p95_high_mm"]) for row in rows[:-1])
    assert {row["/views/0/fiducial_noise_px"] for row in rows} == {"0.3", "-1.0"}
    assert "at least 0" in rows[-1]["reason"]
    assert rows[-1]["p95_mm"] == ""


def test_points_that_are_open_are_told_from_those_that_miss(call: Any, tmp_path: Path) -> None:
    """At a limit within the interval of the first point's P95 that one is open, the other beyond it."""
    design = small_design()
    limit = score(load_design(design)).targets[0].p95_mm
    design["requirements"] = [{"name": "tip", "error": "tcp", "limit_mm": limit}]
    path = write_json(tmp_path / "design.json", design)
    text = " ".join(call("sweep", str(path), "--set", "views.*.fiducial_noise_px=0.3,3")[1].split())
    assert "0 of 2 points keep their requirements; 1 is open: neither kept nor missed for certain." in text


def test_the_verdict_of_a_point_stands_beside_its_p95_and_not_beside_the_last_measure(
    call: Any, tmp_path: Path
) -> None:
    design = small_design()
    design["requirements"] = [{"name": axis, "error": axis, "limit_mm": 1} for axis in "xyz"]
    path = write_json(tmp_path / "design.json", design)
    text = call("sweep", str(path), "--set", "views.*.fiducial_noise_px=0.3,3")[1]
    heads = [line for line in text.splitlines() if line.startswith("point ")]
    assert ["verdict" in line for line in heads] == [True] + [False] * (len(heads) - 1)
    assert len(heads) > 1


def test_the_table_holds_every_point_and_why_some_were_refused(call: Any) -> None:
    text = call("sweep", DEMO, "--set", f"{RZ}=0.15,-1,0.3", "--set", "views.*.target_noise_px=0.1,0.3")[1]
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


def test_the_report_of_a_sweep_without_an_answer_is_no_success(call: Any, tmp_path: Path) -> None:
    """It left with 0: the report's own list of verdicts knew no sweeps."""
    for widths, expected in (("-1,-2", 3), ("-1,0.1", 0)):
        code, out, _ = call("sweep", DEMO, "--set", f"{RZ}={widths}", "--json")
        (tmp_path / "sweep.json").write_text(out)
        again = call("report", tmp_path / "sweep.json", "--format", "json", "-o", tmp_path)
        assert (code, again[0]) == (expected, expected)


@pytest.mark.parametrize(("arguments", "said"), read_cases("studies", "swept"))
def test_what_cannot_be_swept_is_bad_input(refused: Any, arguments: list[str], said: str) -> None:
    told = refused("sweep", DEMO, *arguments)
    assert said in told
    assert "next: tailstack sweep" in told


# --- figures --------------------------------------------------------------------------------------


NOISE = "views.*.fiducial_noise_px"
RX = "interfaces.structure_connector.tolerances.rx.half_width_deg"


@pytest.fixture
def design(tmp_path: Path) -> Path:
    """The small design with its fiducials in a file of their own."""
    document = small_design()
    points = [point["position_mm"] for point in document["fiducials"].pop("points")]
    rows = "".join(f"P{k},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(points))
    (tmp_path / "beads.csv").write_text("label,x_mm,y_mm,z_mm\n" + rows, encoding="utf-8")
    document["fiducials"]["file"] = "beads.csv"
    return write_json(tmp_path / "design.json", document)


def test_a_figure_of_no_known_ending_is_refused(design: Path, refused: Any) -> None:
    assert "no known ending" in refused("sweep", design, "--set", f"{NOISE}=0.1:0.7:4", "--figure", "out.png")


def figure(design: Path, tmp_path: Path, *axes: str) -> str:
    file = tmp_path / "sweep.svg"
    sets = [word for axis in axes for word in ("--set", axis)]
    assert main(["sweep", str(design), *sets, "--figure", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    ElementTree.fromstring(text)
    return text


def test_a_figure_over_one_axis_has_a_mark_for_each_point(design: Path, tmp_path: Path) -> None:
    svg = figure(design, tmp_path, f"{NOISE}=0.1:0.9:5")
    assert svg.count("<circle") >= 5
    assert "views.*.fiducial_noise_px, px" in svg
    assert "as designed" in svg
    held = figure(design, tmp_path, f"{NOISE}=0.1:0.9:5", f"{RX}=0.3")  # an axis of one value names no curve
    assert held.count("<circle") == svg.count("<circle")
    assert ">0.3 deg<" not in held


@pytest.mark.long
def test_a_figure_over_two_axes_has_a_curve_each_or_is_a_map(design: Path, tmp_path: Path) -> None:
    svg = figure(design, tmp_path, f"{NOISE}=0.1:0.9:9", f"{RX}=0.05,0.1,0.4")
    assert all(f">{value} deg<" in svg for value in (0.05, 0.1, 0.4))
    many = figure(design, tmp_path, f"{NOISE}=0.1:0.9:8", f"{RX}=0.05:0.4:7")
    assert many.count("<rect") >= 56
    assert "up: views.*.fiducial_noise_px, px" in many


def test_a_figure_says_what_it_leaves_out(tmp_path: Path) -> None:
    """Fifteen targets, six curves; one point of three that no design can be."""
    said = " ".join(figure(EXAMPLES / "slicer_markups.yaml", tmp_path, f"{NOISE}=0.2,0.4,-1").split())
    assert "the 6 of 15 targets with the largest P95" in said
    assert "1 of 3 points were refused and are not drawn" in said


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ([f"{NOISE}=0.2"], "one or two axes of several different values; this sweep has 0"),
        ([f"{NOISE}=0.2,0.3", f"{RX}=0.1,0.2", "views.0.target_noise_px=0.1,0.2"], "this sweep has 3"),
        ([f"{NOISE}=-1,-2"], "every point was refused"),
        ([f"{NOISE}=0.1:0.9:50", f"{RX}=0.1:0.2:7"], "at most 40 values"),
    ],
)
def test_what_no_figure_can_show_is_refused(
    design: Path, tmp_path: Path, refused: Any, axes: list[str], said: str
) -> None:
    sets = [word for axis in axes for word in ("--set", axis)]
    assert said in refused("sweep", str(design), *sets, "--figure", str(tmp_path / "no.svg"))
    assert not (tmp_path / "no.svg").exists()
