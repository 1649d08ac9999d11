"""Views that the optimiser aims: the command, the job and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from service_scenes import write_json
from work_driver import run_job

from optimise_documents import document, moving, optimised
from tailstack import load_design
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json


def near_views() -> dict[str, Any]:
    """LAT only 25 deg from AP; it may turn by 30 deg, and come nearer."""
    free = {"view": "LAT", "cone_deg": 30.0, "source_isocentre_mm": [650.0, 700.0]}
    data = document(limit_mm=0.6, **moving(box=None, starts=1, views=[free]))
    data["views"][1].pop("orientation")
    data["views"][1]["beam_direction"] = [0.42261826, 0.90630779, 0.0]
    return data


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
