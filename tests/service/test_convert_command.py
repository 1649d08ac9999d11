"""``tailstack convert`` of STEP files: what it prints, writes, keeps of a base and refuses.

Calibration cages of XMALab by the command and over HTTP.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from service_scenes import EXAMPLES, check_problem

from plain_data import read_cases
from tailstack import load_design, score
from tailstack_service.cli.main import main

CARRIER = str(EXAMPLES / "integrations" / "step" / "carrier.step")
TAKE = ["--sphere-diameter", "3±0.1", "--frame", "Carrier"]


def test_a_carrier_becomes_a_design_that_scores(tmp_path: Path, call: Any) -> None:
    target = tmp_path / "design.yaml"
    code, out, err = call("convert", CARRIER, *TAKE, "--seats", "REST*", "--pins", "PIN*", "-o", target)
    assert (code, "8 balls became fiducials" in out, "half-width 0.02 mm" in err) == (0, True, True), out + err
    assert max(map(len, out.splitlines())) <= 80
    design = load_design(target)
    assert score(design).targets[0].p95_mm < 1.0
    # published: the drawing of the example (tests/data/step/scenes.py), in the frame of the carrier
    assert dict(zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True))["BEAD5"] == pytest.approx(
        (-38.0, -40.0, 4.0), abs=1e-3
    )
    seat = design.document.interfaces.structure_connector
    assert [locator.name for locator in seat.locators or ()][:3] == ["REST1", "REST2", "REST3"]
    assert "# half-widths of what may differ" in target.read_text(encoding="utf-8")


def test_a_base_keeps_its_comments_and_numbers(tmp_path: Path) -> None:
    base, target = tmp_path / "base.yaml", tmp_path / "new.yaml"
    text = (EXAMPLES / "first_carrier.yaml").read_text(encoding="utf-8")
    base.write_text(text, encoding="utf-8")
    assert main(["convert", CARRIER, *TAKE, "--base", str(base), "-o", str(target)]) == 0
    made = target.read_text(encoding="utf-8")
    before, after = load_design(base), load_design(target)
    comments = [line.split("#", 1)[1] for line in text.splitlines() if "#" in line and "label" not in line]
    assert comments
    assert all(comment in made for comment in comments)
    assert after.document.targets == before.document.targets
    assert after.document.views == before.document.views
    assert after.fiducials.labels == tuple(f"BEAD{k}" for k in range(1, 9))


def test_other_beads_keep_what_a_base_says_of_beads(tmp_path: Path) -> None:
    """How large they are, what is located of them, how well they are made and how often each is missed."""
    base = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
    more = {"diameter_mm": 3, "image_point": "shadow", "loss_probability": 0.01}
    base["fiducials"] |= more
    base["fiducials"]["points"][1]["loss_probability"] = 0.05
    (tmp_path / "base.yaml").write_text(yaml.safe_dump(base, sort_keys=False), encoding="utf-8")
    rows = [(point["label"], *point["position_mm"]) for point in base["fiducials"]["points"][1:]]
    beads = "label,x_mm,y_mm,z_mm\nnew,3,1,-9\n" + "".join(f"{label},{x},{y},{z + 1}\n" for label, x, y, z in rows)
    (tmp_path / "beads.csv").write_text(beads, encoding="utf-8")
    target = tmp_path / "again.yaml"
    assert main(["convert", str(tmp_path / "beads.csv"), "--base", str(tmp_path / "base.yaml"), "-o", str(target)]) == 0
    made = yaml.safe_load(target.read_text(encoding="utf-8"))["fiducials"]
    assert {name: made[name] for name in more} == more
    assert made["manufacturing"] == base["fiducials"]["manufacturing"]
    assert [point.get("loss_probability") for point in made["points"][:3]] == [None, 0.05, None]
    assert made["points"][1]["position_mm"] == [30, -25, -69]


@pytest.mark.parametrize("ending", ["csv", "fcsv", "mrk.json"])
def test_balls_become_a_fiducial_file(tmp_path: Path, ending: str) -> None:
    target, again = tmp_path / f"beads.{ending}", tmp_path / "again.yaml"
    assert main(["convert", CARRIER, *TAKE, "-o", str(target)]) == 0
    assert main(["convert", str(target), "--base", str(EXAMPLES / "demo.yaml"), "-o", str(again)]) == 0
    assert load_design(again).fiducials.labels == tuple(f"BEAD{k}" for k in range(1, 9))


@pytest.mark.parametrize(("arguments", "words"), read_cases("commands", "converted"))
def test_what_is_not_in_the_file_is_said_with_what_is(
    tmp_path: Path, refused: Any, arguments: list[str], words: str
) -> None:
    target = tmp_path / "design.yaml"
    assert words in refused("convert", CARRIER, *arguments, "-o", str(target))
    assert not target.exists()


def test_flags_of_step_files_are_refused_for_others(tmp_path: Path, refused: Any) -> None:
    beads = tmp_path / "beads.csv"
    beads.write_text("label,x_in,y_in,z_in\nA,1,2,3\n", encoding="utf-8")
    assert "frame is for STEP files" in refused("convert", str(beads), "--frame", "CON", "-o", str(tmp_path / "d.yaml"))
    assert "would overwrite a file that is read" in refused("convert", str(beads), "-o", str(beads))
    assert main(["convert", str(beads), "-o", str(tmp_path / "d.csv")]) == 0
    assert (tmp_path / "d.csv").read_text(encoding="utf-8").splitlines()[1] == "A,25.4,50.8,76.2"


def test_the_drawing_of_a_seat_goes_into_a_design_with_its_comments(tmp_path: Path, call: Any, refused: Any) -> None:
    """A file without balls; what a design named as its drawing stays named until it is written out."""
    source, target = EXAMPLES / "first_carrier.yaml", tmp_path / "new.yaml"
    drawing = EXAMPLES / "gallery" / "seat_from_cad_carrier.step"
    code, _, err = call("convert", drawing, "--pin-class", "g6", "--base", source, "-o", target)
    assert (code, "the seat is flatness 0.02; diameter 6 H7" in err) == (0, True), err
    before, after = load_design(source), load_design(target)
    assert after.fiducials.positions_mm == before.fiducials.positions_mm
    seat = after.document.interfaces.structure_connector
    assert [feature.name for feature in seat.features or ()] == ["face", "pin 1", "pin 2"]
    assert "#" in target.read_text(encoding="utf-8").partition("fiducials:")[2]
    unknown = refused("convert", drawing, "--pin-class", "k6", "--base", source, "-o", tmp_path / "other.yaml")
    assert "the letter k is not known here" in unknown


# --- calibration cages ----------------------------------------------------------------------------


CUBE = EXAMPLES / "integrations" / "xmalab"
FRAME = "x,y,z\n0,0,0\n6.4,0,0,corner\n"


def test_the_lego_cube_comes_in_with_its_marked_beads_and_goes_out_as_it_was(tmp_path: Path, call: Any) -> None:
    for ending in ("csv", "ref"):
        (tmp_path / f"cube.{ending}").write_bytes((CUBE / f"lego_cube.{ending}").read_bytes())
    first, design, second = tmp_path / "cube.csv", tmp_path / "cube.yaml", tmp_path / "again.csv"
    assert call("convert", first, "--xmalab", "cm", "--base", CUBE / "lego_cube.yaml", "-o", design)[0] == 0
    labels = load_design(design).fiducials.labels
    assert [labels[bead - 1] for bead in (1, 4, 13, 64)] == ["circle", "square", "triangle", "cross"]
    marked = "circle,square,triangle,cross"
    code, _, err = call("convert", design, "--xmalab", "cm", "--references", marked, "-o", second)
    assert (code, f"wrote {tmp_path / 'again.ref'}" in err) == (0, True), err
    assert (tmp_path / "again.ref").read_text() == (tmp_path / "cube.ref").read_text()
    rows = [[line.split(",")[:3] for line in file.read_text().splitlines()[1:]] for file in (first, second)]
    assert [[float(cell) for cell in row] for row in rows[0]] == [[float(cell) for cell in row] for row in rows[1]]


def test_a_broken_reference_file_is_named_with_its_line(tmp_path: Path, refused: Any) -> None:
    (tmp_path / "cube.csv").write_text(FRAME)
    (tmp_path / "cube.ref").write_text("1 circle\n2,square\n")
    said = refused("convert", tmp_path / "cube.csv", "--xmalab", "mm", "-o", tmp_path / "cube.yaml")
    assert "cube.ref:2" in said
    assert "write it like: 1 circle" in said
    assert not (tmp_path / "cube.yaml").exists()


def test_a_cage_without_its_unit_is_refused_with_the_option(tmp_path: Path, refused: Any) -> None:
    (tmp_path / "cube.csv").write_text(FRAME)
    assert "convert --xmalab" in refused("convert", str(tmp_path / "cube.csv"), "-o", str(tmp_path / "cube.yaml"))


@pytest.mark.parametrize("arguments", read_cases("commands", "unwritten"))
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
