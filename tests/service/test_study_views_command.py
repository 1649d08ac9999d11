"""``tailstack study views``: text, JSON, picture, report, computed again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import pytest
from service_scenes import EXAMPLES
from test_report_figures import check_picture

from optimise_documents import document, moving
from tailstack import load_design
from tailstack.studies.views import study_views
from tailstack_service.cli.main import main
from tailstack_service.report.studies.views import draw_views
from tailstack_service.schemas import json_schema, record_of

DEMO = str(EXAMPLES / "demo.yaml")
COARSE = ["--step-deg", "30"]


@pytest.mark.long
def test_it_prints_a_line_for_each_map_and_what_they_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "views", DEMO, *COARSE, "--error", "localisation"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    for name in ("AP, turned", "LAT, turned", "one more like AP"):
        assert f"\n{name} " in text
    assert "* A third view like AP, with beam_direction" in text
    assert "P95 of the error of the located target" in " ".join(text.split())


@pytest.mark.long
def test_its_record_keeps_its_schema_is_drawn_and_is_computed_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "views", DEMO, *COARSE, "--json"]) == 0
    printed = capsys.readouterr().out
    record = json.loads(printed)
    jsonschema.Draft202012Validator(json_schema("study-views")).validate(record)
    picture = draw_views(record_of("study-views", record))
    check_picture(picture)
    assert [picture.count(f">{name}: P95, mm<") for name in ("AP, turned", "LAT, turned", "one more like AP")] == [
        1,
        1,
        1,
    ]
    (tmp_path / "study.json").write_text(printed, encoding="utf-8")
    assert main(["report", "--verify", str(tmp_path / "study.json"), DEMO]) == 0
    assert capsys.readouterr().out.endswith("verified\n")


def test_a_design_without_an_aimed_view_still_has_text_and_pages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design = str(EXAMPLES / "locators_321.yaml")
    assert main(["study", "views", design]) == 0
    assert "frontal is left as it is" in capsys.readouterr().out
    assert main(["study", "views", design, "--json"]) == 0
    (tmp_path / "study.json").write_text(capsys.readouterr().out, encoding="utf-8")
    assert main(["report", str(tmp_path / "study.json"), "--format", "html", "-o", str(tmp_path / "pages")]) == 0


def test_steps_too_fine_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "views", DEMO, "--step-deg", "1"]) == 2
    assert "step_deg 2 or more" in capsys.readouterr().err


def test_a_step_larger_than_the_cone_is_refused_instead_of_called_worth_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["study", "views", DEMO, "--cone-deg", "3"]) == 2
    refused = capsys.readouterr().err
    assert "a step of 10 deg leaves no direction within 3 deg but the present one" in refused
    assert "step_deg 1" in refused


@pytest.mark.long
def test_a_map_with_a_direction_where_two_views_are_one_still_shows_the_others() -> None:
    """AP turned by 24 deg looks nearly along LAT, and P95 is many times what it is elsewhere."""
    data = document(**moving())
    data["views"][1].pop("orientation")
    data["views"][1]["beam_direction"] = [0.4226, 0.9063, 0.0]
    study = study_views(load_design(data), step_deg=8, cone_deg=24)
    picture = draw_views(study)
    check_picture(picture)
    shades = [float(number) for number in re.findall(r">(\d+\.\d{3})<", picture)]
    assert max(each.p95_mm or 0.0 for each in study.views[0].directions) > 5 * study.p95_mm
    assert len(shades) == 3 * 6
    assert max(shades) < 2 * study.p95_mm
