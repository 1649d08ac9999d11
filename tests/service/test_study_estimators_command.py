"""``tailstack study estimators``: text, JSON, report, computed again."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from service_scenes import ROOT

from tailstack_service.cli.main import main
from tailstack_service.schemas import json_schema

DEMO = str(ROOT / "examples" / "demo.yaml")


def test_it_prints_a_line_for_each_estimator_and_the_sentences(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "estimators", DEMO]) == 0
    text = capsys.readouterr().out
    for name in ("dlt", "reprojection", "pose_with_prior", "pose"):
        assert f"\n{name} " in text
        assert f"* {name} needs " in text
    assert "with known intrinsics does as well as this one" in " ".join(text.split())


def test_its_record_keeps_its_schema_and_is_computed_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "estimators", DEMO, "--trials", "1024", "--focal-rel-sd", "0.02", "--json"]) == 0
    printed = capsys.readouterr().out
    record = json.loads(printed)
    jsonschema.Draft202012Validator(json_schema("study-estimators")).validate(record)
    assert [case["simulated_p95_mm"] is not None for case in record["cases"]] == [True] * 4
    (tmp_path / "study.json").write_text(printed, encoding="utf-8")
    assert main(["report", "--verify", str(tmp_path / "study.json"), DEMO]) == 0
    assert capsys.readouterr().out.endswith("verified\n")
