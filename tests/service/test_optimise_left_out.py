"""A new design is judged by all of its requirements: what ``optimise.requirement`` left out counts, too."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from service_scenes import write_json
from work_driver import run_job

from optimise_documents import document, moving
from tailstack import load_design, verify
from tailstack_service.cli.main import main


def leaving_out(limit_mm: float, **more: Any) -> dict[str, Any]:
    """Two seats to be budgeted for 1 mm at the tip; of a second target nothing is asked of the optimiser."""
    data = document(**moving(box=None, starts=1, requirement="accuracy"))
    data["targets"].append({"name": "entry", "position_mm": [0.0, 0.0, 40.0]})
    data["requirements"][0]["targets"] = ["tip"]
    data["requirements"].append({"name": "display", "limit_mm": limit_mm, "targets": ["entry"], **more})
    return data


def call(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(list(arguments))
    return code, capsys.readouterr().out


@pytest.mark.long("fails on units", "open")
@pytest.mark.parametrize(
    ("limit_mm", "more", "status", "code"),
    [
        (0.3, {}, "fail", 1),
        (0.5, {"risk": "per_unit", "min_yield": 0.9}, "fail", 1),
        (3.0, {}, "pass", 0),
        (50.0, {"risk": "per_unit", "min_yield": 0.999}, "inconclusive", 4),  # so few units cannot show it
    ],
    ids=["fails", "fails on units", "passes", "open"],
)
def test_what_was_not_asked_for_decides_as_well(
    limit_mm: float, more: dict[str, Any], status: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """independent: ``verify`` of the new design, with another seed."""
    file = write_json(tmp_path / "design.json", leaving_out(limit_mm, **more))
    new = tmp_path / "new.json"
    left, text = call(capsys, "optimise", str(file), "-o", str(new))
    assert left == code
    assert f"verdict: {status}" in text
    assert f"Not asked for, and judged all the same: display ({status})." in " ".join(text.split())
    checked = verify(load_design(new), trials=200_000, seed=77).verdict
    assert checked.status == status
    assert {check.requirement: check.status for check in checked.checks} == {"accuracy": "pass", "display": status}


def test_result_and_report_say_what_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcome, _ = run_job("optimisation", {"design": leaving_out(0.3)}, twice=False)
    result = json.loads(outcome.answer or b"")
    assert (result["verdict_status"], result["not_asked"]) == ("fail", ["display"])
    verdict = result["certificate"]["verification"]["verdict"]
    assert verdict["status"] == "fail"
    assert {c["requirement"]: c["status"] for c in verdict["checks"]} == {"accuracy": "pass", "display": "fail"}
    record = tmp_path / "result.json"
    record.write_bytes(outcome.answer or b"")
    code, _ = call(capsys, "report", str(record), "--format", "html", "-o", str(tmp_path / "out"))
    assert code == 1
    page = next((tmp_path / "out").glob("*.html")).read_text(encoding="utf-8")
    first = page[page.index("<main") : page.index("<nav")]
    assert '<div class="verdict fail"><p class="badge">fail</p>' in first
    assert "verified" not in first
    assert "Not asked for, and judged all the same: display (fail)." in first
    rows = re.findall(r'<th scope="row">(\w+)</th>.*?<span class="status (\w+)">', first, re.DOTALL)
    assert rows == [("display", "fail"), ("accuracy", "pass")]
    # P95 of what was asked for stands in large type, not that of the other target
    tip = next(t for t in result["certificate"]["verification"]["targets"] if t["name"] == "tip")
    # with four decimals, which are what half the interval of 'display', 0.14 % of its limit of 0.3 mm, leaves
    assert f"{tip['p95_mm']:.4f} mm" in first


@pytest.mark.long
def test_a_report_with_an_optimisation_does_not_praise_a_design_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_json(tmp_path / "design.json", leaving_out(0.3))
    call(capsys, "report", str(file), "--parts", "score,optimisation", "--format", "html", "-o", str(tmp_path / "out"))
    page = next((tmp_path / "out").glob("*.html")).read_text(encoding="utf-8")
    assert "does not keep display, which it was not asked to" in page
