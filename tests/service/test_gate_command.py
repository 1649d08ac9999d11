"""tailstack gate and tailstack report on the command line: files, patterns, formats, exit codes, refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from gate_scenes import BAD, GOOD, PASSING, STRICT, waivers_of_today, write_documents
from service_scenes import ROOT, limited, write_json

from tailstack import load_design, score
from tailstack_service.cli.main import main
from tailstack_service.cli.report import _stem
from tailstack_service.documents import to_json
from tailstack_service.gate.rules import RULES


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A design repository: a design that passes, one that fails, a policy."""
    monkeypatch.chdir(tmp_path)
    write_documents(tmp_path, {"one.yaml": GOOD, "bad.yaml": BAD, "policy.yaml": STRICT})
    return tmp_path


def gate(*arguments: str) -> int:
    return main(["gate", *arguments, "--policy", "policy.yaml", "--mode", "analytic"])


@pytest.mark.parametrize(
    ("formats", "told"),
    [
        ([], False), (["text"], False), (["github"], False), (["markdown"], False),
        (["json=g.json"], True), (["json"], True), (["sarif"], True), (["text=g.txt", "junit=g.xml"], True),
    ],
)  # fmt: skip
def test_the_reason_is_in_the_log_whatever_the_formats(
    folder: Path, capsys: pytest.CaptureFixture[str], formats: list[str], told: bool
) -> None:
    assert gate("one.yaml", "bad.yaml", *[f"--format={name}" for name in formats]) == 1
    shown = capsys.readouterr()
    said = [line for line in shown.err.splitlines() if line.startswith("tailstack gate: ")]
    if not told:
        assert said == []
        assert "0.3 mm" in shown.out
        return
    assert formats != ["json"] or json.loads(shown.out)["schema"] == "tailstack/gate/1"
    line = next(k for k, words in enumerate((folder / "bad.yaml").read_text().splitlines(), 1) if "limit_mm" in words)
    assert said[:2] == ["tailstack gate: bad.yaml: fail", "tailstack gate: one.yaml: pass"]
    assert said[2].startswith(f"tailstack gate: bad.yaml:{line}:")
    assert said[2].endswith("[p95]")
    assert said[3:] == ["tailstack gate: verdict: fail (exit code 1)"]


def test_the_reason_in_the_log_is_short(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_documents(folder, {f"d{k:02}.yaml": GOOD if k % 4 else BAD for k in range(15)})
    write_documents(folder, {"waivers.yaml": waivers_of_today("d00.yaml")})
    assert gate("d*.yaml", "--waivers", "waivers.yaml", "--format", "json=g.json") == 1
    lines = capsys.readouterr().err.splitlines()
    said = [line for line in lines if line.startswith(("wrote ", "tailstack gate: "))]  # progress, where it takes long
    assert said[:5] == ["wrote g.json", *[f"tailstack gate: d{k:02}.yaml: fail" for k in (4, 8, 12)],
                        "tailstack gate: d00.yaml: pass"]  # fmt: skip
    assert said[11] == "tailstack gate: ... and 5 more designs, which pass"
    assert [line.split(":")[1] for line in said[12:15]] == [f" d{k:02}.yaml" for k in (4, 8, 12)]
    assert said[15:] == ["tailstack gate: verdict: fail (exit code 1, 1 accepted by waivers)"]


def test_a_baseline_written_by_one_run_is_read_by_the_next(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gate("one.yaml", "--format", "json=base.json") == 0
    noisy = limited(PASSING)
    for view in noisy["views"]:
        view["fiducial_noise_px"] *= 2
        view["target_noise_px"] *= 2
    write_documents(folder, {"one.yaml": noisy})
    assert gate("one.yaml", "--baseline", "base.json") == 1
    assert "[regression]" in capsys.readouterr().out
    assert gate("one.yaml", "--baseline", "base.json", "--max-regression", "500") == 0


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_has_a_page(rule: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gate", "--explain", rule]) == 0
    page = capsys.readouterr().out
    known = RULES[rule]
    assert page.startswith(f"{rule}: {known.title}")
    assert len(page) > 150
    head = f"## {rule}\n\n**{known.title}.** Default: {known.severity}.\n\n{known.page[:80]}"
    assert head in (ROOT / "docs" / "rules.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--format", "xml"], "expected text, json, baseline, sarif, junit, github, gitlab, markdown"),
        (["--max-regression", "-1"], "0 or more per cent"),
        (["--explain", "p59"], "did you mean p95?"),
    ],
)
def test_what_is_no_option_is_refused_with_2(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert gate("one.yaml", *arguments) == 2
    shown = capsys.readouterr()
    assert (words in shown.err, shown.out) == (True, "")


# --- report ---------------------------------------------------------------------------------------


def test_reports_of_two_revisions_stay_apart() -> None:
    names = ("guide.v1.yaml", "guide.v2.yml", "guide.report.json", "guide.json", "guide", "guide.html", ".yaml")
    assert [_stem(name) for name in names] == ["guide.v1", "guide.v2", "guide", "guide", "guide", "guide", ".yaml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["one.yaml", "--format", "docx"], "expected html, pdf, xlsx, json"),
        (["one.yaml", "-o", "one.yaml"], "is not a directory"),
        (["one.yaml", "-o", "new.docx"], "reports are not written as .docx"),
        (["absent.yaml"], "no such file"),
        (["half.json"], "not a whole tailstack/score/1"),
        (["other.json"], "other.json:1:12: /schema: no report is made of"),
        (["whole.json", "--seed", "3"], "a result is rendered as it is"),
    ],
)
def test_what_cannot_be_reported_is_refused_with_2(
    folder: Path, refused: Any, arguments: list[str], words: str
) -> None:
    write_json(folder / "half.json", {"schema": "tailstack/score/1", "targets": []})
    write_json(folder / "other.json", {"schema": "tailstack/validation/1"})
    (folder / "whole.json").write_bytes(to_json(score(load_design(limited(PASSING)))))
    assert words in refused("report", *arguments)
