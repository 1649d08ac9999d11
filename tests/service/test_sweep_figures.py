"""Figures of ``tailstack sweep``, and a running service that computes it: the answer of the sweep here."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from service_scenes import client_with, small_design, write_json

from tailstack_service.cli.main import main
from tailstack_service.settings import Settings

NOISE = "views.*.fiducial_noise_px"
RZ = "interfaces.structure_connector.tolerances.rx.half_width_deg"


@pytest.fixture
def design(tmp_path: Path) -> Path:
    """The small design with its fiducials in a file of their own."""
    document = small_design()
    points = [point["position_mm"] for point in document["fiducials"].pop("points")]
    rows = "".join(f"P{k},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(points))
    (tmp_path / "beads.csv").write_text("label,x_mm,y_mm,z_mm\n" + rows, encoding="utf-8")
    document["fiducials"]["file"] = "beads.csv"
    return write_json(tmp_path / "design.json", document)


def asked(design: Path, *more: str) -> list[str]:
    return ["sweep", str(design), "--set", f"{NOISE}=0.1:0.7:4", "--set", f"{RZ}=0.05,0.2,-1", *more]


@pytest.mark.long
def test_a_service_gives_the_bytes_of_the_sweep_here(design: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check = ("--check", "verification", "--trials", "3000", "--seed", "5", "--json")
    assert main(asked(design, *check)) == 0
    here = capsys.readouterr().out
    assert len(json.loads(here)["points"]) == 12
    with client_with(Settings(worker_processes=1), worker=True) as client:
        assert main(asked(design, *check, "--remote", str(client.base_url))) == 0
    assert capsys.readouterr().out == here


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (["--remote", "ftp://nowhere"], 2, "is not the URL of a service"),
        (["--remote", "http://127.0.0.1:9"], 3, "no answer from"),
        (["--figure", "out.png"], 2, "no known ending"),
    ],
)
def test_what_cannot_be_had_is_said(
    design: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    code: int,
    said: str,
) -> None:
    assert main(asked(design, *more)) == code
    output = capsys.readouterr()
    assert output.out == ""
    assert said in output.err


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
    held = figure(design, tmp_path, f"{NOISE}=0.1:0.9:5", f"{RZ}=0.3")  # an axis of one value names no curve
    assert held.count("<circle") == svg.count("<circle")
    assert ">0.3 deg<" not in held


@pytest.mark.long
def test_a_figure_over_two_axes_has_a_curve_each_or_is_a_map(design: Path, tmp_path: Path) -> None:
    svg = figure(design, tmp_path, f"{NOISE}=0.1:0.9:9", f"{RZ}=0.05,0.1,0.4")
    assert all(f">{value} deg<" in svg for value in (0.05, 0.1, 0.4))
    many = figure(design, tmp_path, f"{NOISE}=0.1:0.9:8", f"{RZ}=0.05:0.4:7")
    assert many.count("<rect") >= 56
    assert "up: views.*.fiducial_noise_px, px" in many


def test_a_figure_says_what_it_leaves_out(tmp_path: Path) -> None:
    """Fifteen targets, six curves; one point of three that no design can be."""
    markups = Path(__file__).parents[2] / "examples" / "slicer_markups.yaml"
    said = " ".join(figure(markups, tmp_path, f"{NOISE}=0.2,0.4,-1").split())
    assert "the 6 of 15 targets with the largest P95" in said
    assert "1 of 3 points were refused and are not drawn" in said


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ([f"{NOISE}=0.2"], "one or two axes of several different values; this sweep has 0"),
        ([f"{NOISE}=0.2,0.3", f"{RZ}=0.1,0.2", "views.0.target_noise_px=0.1,0.2"], "this sweep has 3"),
        ([f"{NOISE}=-1,-2"], "every point was refused"),
        ([f"{NOISE}=0.1:0.9:50", f"{RZ}=0.1:0.2:7"], "at most 40 values"),
    ],
)
def test_what_no_figure_can_show_is_refused(
    design: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], axes: list[str], said: str
) -> None:
    sets = [word for axis in axes for word in ("--set", axis)]
    assert main(["sweep", str(design), *sets, "--figure", str(tmp_path / "no.svg")]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "no.svg").exists()
