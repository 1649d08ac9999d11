"""tailstack gate and tailstack report on the command line: files, patterns, formats, exit codes, refusals."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from service_scenes import ROOT, coplanar_design, limited, write_json

from tailstack import load_design, score
from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.cli.report import _stem
from tailstack_service.documents import to_json
from tailstack_service.gate.rules import RULES
from tailstack_service.gate.text import render_markdown
from tailstack_service.schemas import record_of
from waiting import LIMIT_SECONDS

PASSING, FAILING = 1.4, 0.3  # limits in mm; P95 of the small design is about 0.65 mm


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A design repository: two designs that pass, one that fails, a policy."""
    monkeypatch.chdir(tmp_path)
    for name, limit in (("one", PASSING), ("two", PASSING), ("bad", FAILING)):
        (tmp_path / f"{name}.yaml").write_text(data_to_yaml(limited(limit)), encoding="utf-8")
    (tmp_path / "policy.yaml").write_text(
        "schema: tailstack/policy/1\nname: guides\nrules:\n  overlap: {severity: 'off'}\n", encoding="utf-8"
    )
    return tmp_path


def waivers_file(folder: Path, days: int, **changes: Any) -> Path:
    expires = (datetime.now(UTC).date() + timedelta(days=days)).isoformat()
    entry = {"rule": "p95", "owner": "J. Doe", "reason": "rework", "max_value": 1.0, "expires": expires, **changes}
    return write_json(folder / "waivers.json", {"schema": "tailstack/waivers/1", "waivers": [entry]})


def gate(*arguments: str) -> int:
    return main(["gate", *arguments, "--policy", "policy.yaml", "--mode", "analytic"])


def test_designs_by_name_and_by_pattern(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gate("one.yaml", "t*.yaml", "one.yaml") == 0
    text = capsys.readouterr().out
    assert [text.count(f"{name}.yaml") for name in ("one", "two", "bad")] == [1, 1, 0]
    assert text.splitlines()[-1].startswith("verdict: pass (exit code 0")


def test_a_failure_is_told_at_its_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gate("[bo]*.yaml") == 1
    text = capsys.readouterr().out
    lines = (folder / "bad.yaml").read_text().splitlines()
    line = next(k for k, words in enumerate(lines, 1) if "limit_mm" in words)
    assert f"bad.yaml:{line}:" in text


def test_several_formats_in_one_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gate("bad.yaml", "--format", "json=gate.json", "--format", "markdown=gate.md", "--format", "text") == 1
    record = record_of("gate", json.loads((folder / "gate.json").read_text()))
    assert (record.verdict, record.exit_code) == ("fail", 1)
    assert "| error | p95 | bad.yaml:" in (folder / "gate.md").read_text()
    assert "verdict: fail" in capsys.readouterr().out


def test_json_on_stdout_is_nothing_but_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gate("one.yaml", "--format", "json") == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "tailstack/gate/1"


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
    line = next(k for k, words in enumerate((folder / "bad.yaml").read_text().splitlines(), 1) if "limit_mm" in words)
    assert said[:2] == ["tailstack gate: bad.yaml: fail", "tailstack gate: one.yaml: pass"]
    assert said[2].startswith(f"tailstack gate: bad.yaml:{line}:")
    assert said[2].endswith("[p95]")
    assert said[3:] == ["tailstack gate: verdict: fail (exit code 1)"]


def test_the_reason_in_the_log_is_short(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k in range(15):
        limit = FAILING if k % 4 == 0 else PASSING
        (folder / f"d{k:02}.yaml").write_text(data_to_yaml(limited(limit)), encoding="utf-8")
    waivers_file(folder, 30, designs=["d00.yaml"])
    assert gate("d*.yaml", "--waivers", "waivers.json", "--format", "json=g.json") == 1
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
    (folder / "one.yaml").write_text(data_to_yaml(noisy), encoding="utf-8")
    assert gate("one.yaml", "--baseline", "base.json") == 1
    assert "[regression]" in capsys.readouterr().out
    assert gate("one.yaml", "--baseline", "base.json", "--max-regression", "500") == 0


def test_waivers_in_force_and_expired(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    waivers_file(folder, 30)
    assert gate("bad.yaml", "--waivers", "waivers.json") == 0
    assert "accepted by waivers.json:1, J. Doe" in capsys.readouterr().out
    waivers_file(folder, -1)
    assert gate("one.yaml", "--waivers", "waivers.json") == 1
    assert "expired on" in capsys.readouterr().out


def test_one_bad_document_does_not_hide_the_others(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "broken.yaml").write_text("schema: tailstack/design/1\nname: x\n", encoding="utf-8")
    write_json(folder / "flat.json", coplanar_design())
    assert gate("flat.json", "one.yaml") == 3
    assert gate("broken.yaml", "flat.json", "bad.yaml", "absent.yaml") == 2
    text = capsys.readouterr().out
    assert "[invalid-design]" in text
    assert "[not-evaluated]" in text
    assert "[p95]" in text
    assert "no such file: absent.yaml" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing*.yaml"], "no file matches"),
        ([], "no design was given"),
        (["one.yaml", "--format", "text", "--format", "json"], "two formats would be written to stdout"),
        (["one.yaml", "--format", "json=missing/gate.json"], "cannot write"),
        (["one.yaml", "--format", "xml"], "expected text, json, baseline, sarif, junit, github, gitlab, markdown"),
        (["one.yaml", "--max-regression", "-1"], "0 or more per cent"),
        (["one.yaml", "--waivers", "policy.yaml"], "tailstack/waivers/1"),
        (["one.yaml", "--baseline", "one.yaml"], "tailstack/gate/1"),
        (["--explain", "p59"], "did you mean p95?"),
    ],
)
def test_usage_is_refused_with_2_and_the_reason(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert gate(*arguments) == 2
    shown = capsys.readouterr()
    assert words in shown.err
    assert shown.out == ""


def test_a_policy_is_refused_at_its_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "policy.yaml").write_text("schema: tailstack/policy/1\nrules:\n  p95: {limit: 2.0}\n", encoding="utf-8")
    assert gate("one.yaml") == 2
    assert "policy.yaml:3:9: /rules/p95/limit: unknown field" in capsys.readouterr().err


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_can_be_explained(rule: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gate", "--explain", rule]) == 0
    assert capsys.readouterr().out.startswith(f"{rule}: ")


def test_markdown_shows_names_as_they_stand(folder: Path) -> None:
    hostile = limited(FAILING, name="x")
    hostile["requirements"][0]["name"] = "<img src=x>|`a`[l](http://h)@team"
    (folder / "h.yaml").write_text(data_to_yaml(hostile), encoding="utf-8")
    gate("h.yaml", "--format", "json=h.json")
    text = render_markdown(record_of("gate", json.loads((folder / "h.json").read_text())))
    row = next(line for line in text.splitlines() if line.startswith("| error | p95"))
    assert "\\<img src=x\\>\\|\\`a\\`\\[l\\]\\(http://h\\)\\@team" in row


def test_sarif_has_every_finding_at_its_place_and_waived_ones_suppressed(folder: Path) -> None:
    """published: OASIS SARIF 2.1.0, sections 3.14, 3.19, 3.27, 3.28, 3.35."""
    waivers_file(folder, 30, designs=["bad.yaml"])
    (folder / "bad ü.yaml").write_text((folder / "bad.yaml").read_text(), encoding="utf-8")
    assert (
        gate(
            "bad.yaml",
            "bad ü.yaml",
            "--waivers",
            "waivers.json",
            "--format",
            "sarif=g.sarif",
            "--format",
            "json=g.json",
        )
        == 1
    )
    log = json.loads((folder / "g.sarif").read_text(encoding="utf-8"))
    record = record_of("gate", json.loads((folder / "g.json").read_text(encoding="utf-8")))
    (run,) = log["runs"]
    rules = run["tool"]["driver"]["rules"]
    assert log["version"] == "2.1.0"
    assert [rule["id"] for rule in rules] == list(RULES)
    assert {rule["defaultConfiguration"]["level"] for rule in rules} <= {"error", "warning", "note"}
    assert run["invocations"] == [{"executionSuccessful": True, "exitCode": 1}]
    assert len(run["results"]) == len(record.findings) == 4  # and that the waiver accepts a lot, twice
    for result, finding in zip(run["results"], record.findings, strict=True):
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"] == finding.rule
        assert result["level"] == finding.severity
        place = result["locations"][0]["physicalLocation"]
        assert place["region"] == {"startLine": finding.line, "startColumn": finding.column}
        assert ("suppressions" in result) == (finding.suppressed_by is not None)
    uris = [result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for result in run["results"]]
    assert uris == ["bad.yaml", "bad%20%C3%BC.yaml", "waivers.json", "waivers.json"]
    assert [suppression["kind"] for suppression in run["results"][0]["suppressions"]] == ["external"]
    prints = [result["partialFingerprints"]["tailstackFinding/v1"] for result in run["results"]]
    assert len(set(prints)) == 4


def test_a_fingerprint_survives_a_change_of_value_and_line(folder: Path) -> None:
    def prints() -> list[str]:
        gate("bad.yaml", "--format", "sarif=g.sarif")
        results = json.loads((folder / "g.sarif").read_text())["runs"][0]["results"]
        return [result["partialFingerprints"]["tailstackFinding/v1"] for result in results]

    before = prints()
    text = (folder / "bad.yaml").read_text()
    (folder / "bad.yaml").write_text(
        "# a line more\n" + text.replace("fiducial_noise_px: 0.3", "fiducial_noise_px: 0.4")
    )
    assert prints() == before


@pytest.mark.long
def test_mode_analytic_loads_nothing_heavy(folder: Path) -> None:
    """What would cost a commit hook its seconds: the optimisers, the web, templates, tables, statistics."""
    code = (
        "import sys\n"
        "from tailstack_service.cli.main import main\n"
        "code = main(sys.argv[1:])\n"
        "heavy = {'casadi', 'cvxpy', 'fastapi', 'starlette', 'jinja2', 'sqlalchemy', 'weasyprint', 'xlsxwriter',\n"
        "         'scipy.stats', 'distributed', 'httpx', 'jsonschema'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
        "sys.exit(code)\n"
    )
    formats = [f"--format={name}=out.{name}" for name in ("json", "sarif", "junit", "github", "gitlab", "markdown")]
    ran = subprocess.run(
        [sys.executable, "-c", code, "gate", "one.yaml", "--policy", "policy.yaml", "--mode", "analytic", *formats,
         "--format=text=out.txt"],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'solver'}:{ROOT / 'service'}"},
        cwd=folder, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False,
    )  # fmt: skip
    assert (ran.returncode, ran.stdout) == (0, "[]\n"), ran.stderr


# --- report ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_report_of_a_design_and_of_its_record(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "bad.yaml", "--format", "json,html,xlsx", "-o", "out", "--trials", "4000"]) == 1
    written = capsys.readouterr().out.split()
    assert written == [str(Path("out") / name) for name in ("bad.report.json", "bad.html", "bad.xlsx")]
    assert main(["report", "out/bad.report.json", "--format", "html", "-o", "again"]) == 1
    assert (folder / "again" / "bad.html").read_bytes() == (folder / "out" / "bad.html").read_bytes()


def test_reports_of_two_revisions_stay_apart() -> None:
    names = ("guide.v1.yaml", "guide.v2.yml", "guide.report.json", "guide.json", "guide", "guide.html", ".yaml")
    assert [_stem(name) for name in names] == ["guide.v1", "guide.v2", "guide", "guide", "guide", "guide", ".yaml"]


def test_a_report_of_what_another_verb_wrote(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", "one.yaml", "--json"]) == 0
    (folder / "score.json").write_text(capsys.readouterr().out, encoding="utf-8")
    assert main(["report", "score.json", "-o", "."]) == 0
    assert '<p class="kind">Estimated error</p>' in (folder / "score.html").read_text()


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
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    write_json(folder / "half.json", {"schema": "tailstack/score/1", "targets": []})
    write_json(folder / "other.json", {"schema": "tailstack/validation/1"})
    (folder / "whole.json").write_bytes(to_json(score(load_design(limited(PASSING)))))
    assert main(["report", *arguments]) == 2
    assert words in capsys.readouterr().err
