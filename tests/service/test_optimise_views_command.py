"""Views that the optimiser aims: the command, the job and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from service_scenes import write_json
from work_driver import run_job

from optimise_documents import document, moving, optimised
from tailstack import load_design, optimise
from tailstack.design import design_to_data
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json


def near_views() -> dict[str, Any]:
    """LAT only 25 deg from AP; it may turn by 30 deg, and come nearer."""
    free = {"view": "LAT", "cone_deg": 30.0, "source_isocentre_mm": [650.0, 700.0]}
    data = document(limit_mm=0.6, **moving(box=None, starts=1, views=[free]))
    data["views"][1].pop("orientation")
    data["views"][1]["beam_direction"] = [0.42261826, 0.90630779, 0.0]
    return data


@pytest.mark.long
def test_the_command_writes_the_aimed_view_and_says_what_that_rests_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, new = write_json(tmp_path / "design.json", near_views()), tmp_path / "new.json"
    assert main(["optimise", str(file), "-o", str(new)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "views: LAT is turned by" in text
    assert "it is not proven that there is no better one" in text
    expected = optimised(near_views())
    assert load_design(new).sha256 == expected.provenance.design_sha256
    assert json.loads(new.read_text())["views"][1]["beam_direction"] == expected.design["views"][1]["beam_direction"]  # type: ignore[index]


@pytest.mark.long
def test_a_job_is_one_unit_with_the_bytes_of_the_library() -> None:
    outcome, units = run_job("optimisation", {"design": near_views()}, twice=False)
    assert len(units) == 1
    assert outcome.answer == to_json(optimised(near_views()))


def test_the_report_lists_how_views_are_aimed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = tmp_path / "result.json"
    result.write_bytes(to_json(optimised(near_views())))
    assert main(["report", str(result), "--format", "html", "-o", str(tmp_path / "report")]) == 0
    capsys.readouterr()
    page = next((tmp_path / "report").glob("*.html")).read_text(encoding="utf-8")
    assert "Views that could be aimed" in page
    assert "not proven" in page


AUTHORS_TEXT = """\
# my guide
schema: tailstack/design/1
name: my guide
views:
  - name: AP     # from the front
    preset: siemens-cios-fusion
    source_isocentre_mm: 700
    orientation: AP
    fiducial_noise_px: 0.3
    target_noise_px: 0.3
  - name: LAT    # the table is in the way
    preset: siemens-cios-fusion
    source_isocentre_mm: 700
    beam_direction: [0.5, 0.87, 0]
    fiducial_noise_px: 0.3
    target_noise_px: 0.3
fiducials:
  points:
    - position_mm: [-42, -40, -80]
    - position_mm: [42, -41, -76]
    - position_mm: [-40, 42, -78]
    - position_mm: [41, 40, 8]
    - position_mm: [-41, -39, 11]
    - position_mm: [39, -12, 4]
interfaces:
  structure_connector:
    pivot_mm: [0, 0, -95]
    tolerances:
      rx: { half_width_deg: 0.1, distribution: uniform }
      ry: { half_width_deg: 0.1, distribution: uniform }
targets:
  - { name: tip, position_mm: [0, 0, 70] }
requirements:
  - { name: accuracy, limit_mm: 0.6 }
optimise:
  rotation_bounds: { min_deg: 0.01, max_deg: 0.5 }
  starts: 1
  views:
    - { view: LAT, cone_deg: 10 }
    - { add: OBL, like: AP, cone_deg: 60, price: 30 }    # what a third shot costs
"""


def write_authors_text(folder: Path, price: float = 30) -> Path:
    file = folder / "guide.yaml"
    file.write_text(AUTHORS_TEXT.replace("price: 30", f"price: {price:g}"))
    return file


@pytest.mark.long
def test_a_view_that_pays_comes_into_the_authors_own_text_and_is_accounted_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, new = write_authors_text(tmp_path), tmp_path / "new.yaml"
    assert main(["optimise", str(file), "-o", str(new)]) == 0
    captured = capsys.readouterr()
    text = " ".join(captured.out.split())
    assert "a view more: OBL is added: with it the design costs" in text
    assert "+ 30.00 (view OBL) =" in text
    assert "OBL is" in text
    assert "without its comments" not in captured.err
    written = new.read_text()
    for comment in ("# my guide", "# from the front", "# the table is in the way", "# what a third shot costs"):
        assert comment in written
    found = optimise(load_design(file))
    assert load_design(new).sha256 == found.provenance.design_sha256
    assert [view.name for view in load_design(new).document.views] == ["AP", "LAT", "OBL"]
    assert main(["verify", str(new), "--trials", "4096"]) in (0, 4)


@pytest.mark.long
def test_a_view_that_does_not_pay_leaves_its_entry_for_another_price(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, new = write_authors_text(tmp_path, price=5000), tmp_path / "new.yaml"
    assert main(["optimise", str(file), "-o", str(new)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "a view more: OBL is left out: with it the design costs" in text
    assert "(view OBL)" not in text
    assert "{ add: OBL, like: AP, cone_deg: 60, price: 5000 }    # what a third shot costs" in new.read_text()
    assert [view.name for view in load_design(new).document.views] == ["AP", "LAT"]


@pytest.mark.long
def test_a_job_and_a_report_with_a_view_more_say_what_the_library_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design = load_design(write_authors_text(tmp_path))
    expected = optimise(design)
    outcome, units = run_job("optimisation", {"design": design_to_data(design)}, twice=False)
    assert len(units) == 1
    assert outcome.answer == to_json(expected)
    result = tmp_path / "result.json"
    result.write_bytes(to_json(expected))
    assert main(["report", str(result), "--format", "html", "-o", str(tmp_path / "report")]) == 0
    page = next((tmp_path / "report").glob("*.html"))
    content = page.read_text(encoding="utf-8")
    assert "The view that could be added" in content
    assert "OBL is added: with it the design costs" in content
    assert "OBL" in content.partition("<svg")[2].partition("</svg>")[0]
    assert main(["report", "--verify", str(page)]) == 0
    assert "verified" in capsys.readouterr().out
