"""Calibration cages of XMALab by the command and over HTTP; what the files hold is in test_calibration_cages.py."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from service_scenes import EXAMPLES, check_problem, client_with

from tailstack import load_design
from tailstack_service.cli.main import main
from tailstack_service.settings import Settings

CUBE = EXAMPLES / "integrations" / "xmalab"
FRAME = "x,y,z\n0,0,0\n6.4,0,0,corner\n"


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with(Settings()) as client:
        yield client


def test_the_lego_cube_comes_in_with_its_marked_beads_and_goes_out_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending in ("csv", "ref"):
        (tmp_path / f"cube.{ending}").write_bytes((CUBE / f"lego_cube.{ending}").read_bytes())
    first, design, second = tmp_path / "cube.csv", tmp_path / "cube.yaml", tmp_path / "again.csv"
    base = str(CUBE / "lego_cube.yaml")
    assert main(("convert", str(first), "--xmalab", "cm", "--base", base, "-o", str(design))) == 0
    labels = load_design(design).fiducials.labels
    assert [labels[bead - 1] for bead in (1, 4, 13, 64)] == ["circle", "square", "triangle", "cross"]
    marked = "circle,square,triangle,cross"
    assert main(("convert", str(design), "--xmalab", "cm", "--references", marked, "-o", str(second))) == 0
    assert (tmp_path / "again.ref").read_text() == (tmp_path / "cube.ref").read_text()
    rows = [[line.split(",")[:3] for line in file.read_text().splitlines()[1:]] for file in (first, second)]
    assert [[float(cell) for cell in row] for row in rows[0]] == [[float(cell) for cell in row] for row in rows[1]]
    assert f"wrote {tmp_path / 'again.ref'}" in capsys.readouterr().err


def test_a_broken_reference_file_is_named_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cube.csv").write_text(FRAME)
    (tmp_path / "cube.ref").write_text("1 circle\n2,square\n")
    out = tmp_path / "cube.yaml"
    assert main(("convert", str(tmp_path / "cube.csv"), "--xmalab", "mm", "-o", str(out))) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "cube.ref:2" in said
    assert "write it like: 1 circle" in said
    assert not out.exists()


def test_a_cage_without_its_unit_is_refused_with_the_option(tmp_path: Path, refused: Any) -> None:
    (tmp_path / "cube.csv").write_text(FRAME)
    assert "convert --xmalab" in refused("convert", str(tmp_path / "cube.csv"), "-o", str(tmp_path / "cube.yaml"))


@pytest.mark.parametrize(
    "arguments",
    [
        ("--references", "F1,F2,F3,F4", "-o", "beads.csv"),
        ("--xmalab", "mm", "--references", "F1,F2,F3", "-o", "beads.csv"),
        ("--xmalab", "mm", "-o", "beads.fcsv"),
    ],
)
def test_nothing_is_written_of_a_wish_that_cannot_be_met(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(("convert", str(EXAMPLES / "first_carrier.yaml"), *arguments)) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_cages_over_http(client: httpx.Client) -> None:
    body = {"format": "csv", "content": FRAME, "xmalab": "cm", "to": "yaml"}
    answer = client.post("/v1/conversions", json=body).json()
    points = [{"label": "F1", "position_mm": [0.0, 0.0, 0.0]}, {"label": "corner", "position_mm": [64.0, 0.0, 0.0]}]
    assert answer["fiducials"] == points
    assert yaml.safe_load(answer["content"])["fiducials"]["origin"]["coordinate_unit"] == "cm"
    plain = {"Content-Type": "text/csv"}
    assert client.post("/v1/conversions?xmalab=cm", content=FRAME, headers=plain).json() == answer
    design = (EXAMPLES / "first_carrier.yaml").read_text()
    back = client.post("/v1/conversions?to=csv&xmalab=cm", content=design, headers={"Content-Type": "application/yaml"})
    assert back.json()["content"].splitlines()[:2] == ["x_cm,y_cm,z_cm,label", "-2.5,-2.8,-7.0,F1"]
    wrong = client.post("/v1/conversions", json={**body, "format": "fcsv"})
    assert check_problem(wrong, 422, "invalid-request")["errors"][0]["pointer"] == "/xmalab"
