"""Every exit code in every format against golden files, and every format against what its readers publish of it.

The golden files are made by ``gate_scenes.py``, which says how.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import xsd
from gate_scenes import DERIVED, FORMATS, GOLDEN, RULES, SCENES, gate_in, golden, policy, run, sarif_rules, settled
from jsonschema import Draft202012Validator
from service_scenes import ROOT, limited, sound_design

from plain_data import read_cases
from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.gate.formats import FORMATS as WRITERS
from tailstack_service.gate.formats import (
    SUMMARY_BYTES,
    cut_text,
    fingerprint_findings,
    render_github,
    render_gitlab,
    render_junit,
    render_sarif,
    render_step_summary,
)
from tailstack_service.gate.records import GateFinding, GateRecord
from tailstack_service.gate.text import render_text
from tailstack_service.schemas import json_schema, read_record

SCHEMAS = ROOT / "tests" / "data" / "schemas"
SARIF = Draft202012Validator(json.loads((SCHEMAS / "sarif-2.1.0.json").read_text(encoding="utf-8")))
GITLAB = Draft202012Validator(json.loads((SCHEMAS / "gitlab-codequality.json").read_text(encoding="utf-8")))
XSD = SCHEMAS / "junit-10.xsd"


@pytest.mark.parametrize("title", SCENES)
def test_every_exit_code_in_every_format(title: str, tmp_path: Path) -> None:
    scene = SCENES[title]
    code, contents = run(scene, tmp_path)
    assert code == scene.exit_code
    for name in FORMATS.keys() - DERIVED:
        assert settled(name, contents[name]) == golden(title, name).read_text(encoding="utf-8"), (title, name)
    assert sarif_rules(contents["sarif"]) == RULES.read_text(encoding="utf-8")
    record = json.loads(contents["json"])
    assert record["exit_code"] == code
    Draft202012Validator(json_schema("gate")).validate(record)
    SARIF.validate(json.loads(contents["sarif"]))
    GITLAB.validate(json.loads(contents["gitlab"]))
    assert xsd.problems(XSD, contents["junit"], "testsuites") == []


def test_no_golden_file_is_left_over() -> None:
    known = {golden(scene, name).name for scene in SCENES for name in FORMATS.keys() - DERIVED}
    assert {path.name for path in GOLDEN.iterdir()} == known | {RULES.name}
    assert {*FORMATS, "baseline"} == set(WRITERS)  # baseline: the record of json, see below
    assert {scene.exit_code for scene in SCENES.values()} == {0, 1, 2, 3, 4, 130}


def test_a_baseline_that_is_kept_shows_what_changed_line_by_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    design = Path("a.yaml")
    texts = []
    for limit in (5.0, 4.0):
        design.write_text(data_to_yaml(limited(limit)), encoding="utf-8")
        formats = [f"--format={name}={name}.json" for name in ("baseline", "json")]
        assert main(["gate", "a.yaml", "--mode", "analytic", *formats]) == 0
        texts.append(Path("baseline.json").read_text(encoding="utf-8"))
        assert json.loads(texts[-1]) == json.loads(Path("json.json").read_text(encoding="utf-8"))
    before, after = (text.splitlines() for text in texts)
    changes = [line.strip() for line, other in zip(after, before, strict=True) if line != other]
    assert '"limit": 4.0,' in changes
    assert len(changes) <= 6  # the limit of requirement and number, its margin, the hash of the design
    design.write_text(data_to_yaml(limited(6.0)), encoding="utf-8")
    assert main(["gate", "a.yaml", "--mode", "analytic", "--baseline", "baseline.json"]) == 1


def record_of(title: str) -> GateRecord:
    found: GateRecord = read_record("gate", golden(title, "json").read_bytes())
    return found


def finding(**changes: Any) -> GateFinding:
    return replace(record_of("fail").findings[0], **changes)


def with_findings(*findings: GateFinding, **changes: Any) -> GateRecord:
    return replace(record_of("fail"), findings=findings, **changes)


HOSTILE = finding(
    file="a b/100%,é:1/[#1]?.yaml",
    line=3,
    column=7,
    message="tip, target t: 5 %, <b>&\"'\x07\ud7ff,\r\n::error::stolen\n##[group]",
    pointer="/requirements/0/limit_mm",
)


def test_the_schemas_refuse_what_is_wrong() -> None:
    """A schema that lets everything through would prove nothing."""
    log = json.loads(render_sarif(record_of("fail")))
    log["runs"][0]["results"][0]["level"] = "fatal"
    assert list(SARIF.iter_errors(log))
    log = json.loads(render_sarif(record_of("waived")))
    (suppression,) = log["runs"][0]["results"][0]["suppressions"]
    suppression["state"] = suppression.pop("status")  # as drafts of the standard had it
    assert list(SARIF.iter_errors(log))
    log = json.loads(render_sarif(record_of("fail")))
    log["runs"][0]["results"][0]["locations"][0]["physicalLocation"]["region"]["startLine"] = 0
    assert list(SARIF.iter_errors(log))
    report = json.loads(render_gitlab(record_of("fail")))
    report[0]["location"]["path"] = "./bad.yaml"
    assert list(GITLAB.iter_errors(report))
    document = render_junit(record_of("fail"))
    for old, new in (
        (' tests="1"', ""), ("<failure ", "<broken "), ("</failure>", "</failure>text"), (' name="p95', ' id="p95'),
        ('tests="1"', 'tests="1" time="soon"'),
    ):  # fmt: skip
        changed = document.replace(old, new, 1) if "broken" not in new else document.replace("failure", "broken")
        assert changed != document
        assert xsd.problems(XSD, changed.encode(), "testsuites"), new


def test_workflow_commands_are_escaped() -> None:
    """published: actions/toolkit, packages/core/src/command.ts: % CR LF in data, and : and , in properties."""
    command, last = render_github(with_findings(HOSTILE)).splitlines()
    properties, _, data = command.removeprefix("::error ").partition("::")
    assert properties == "file=a b/100%25%2Cé%3A1/[#1]?.yaml,line=3,col=7,title=tailstack p95"
    assert data == "tip, target t: 5 %25, <b>&\"'\x07\ud7ff,%0D%0A::error::stolen%0A##[group]"
    assert last == "tailstack gate: fail (exit code 1)"


def test_annotations_stay_within_what_github_shows() -> None:
    errors = [finding(message=f"error {k}") for k in range(30)]
    warnings = [finding(message=f"warning {k}", severity="warning") for k in range(10)]
    notes = [finding(message="note", severity="note"), finding(message="waived", suppressed_by="somebody")]
    lines = render_github(with_findings(*warnings, *errors, *notes)).splitlines()
    kinds = [line.split(" ")[0] for line in lines]
    assert kinds == ["::error"] * 10 + ["::warning"] * 10 + ["::notice", "tailstack"]
    assert "21 more" in lines[9]
    assert lines[19].endswith("::warning 9")
    assert "waived" not in "".join(lines[:-1])
    assert lines[-1].endswith("(exit code 1, 1 accepted by waivers)")


@pytest.mark.long
def test_a_summary_stays_within_its_size() -> None:
    designs = tuple(replace(record_of("fail").designs[0], file=f"{k}-" + "é" * 70) for k in range(9000))
    record = replace(record_of("fail"), designs=designs)
    for taken in (0, 1000, SUMMARY_BYTES - 100, SUMMARY_BYTES - 1, SUMMARY_BYTES):
        text = render_step_summary(record, taken)
        assert taken + len(text.encode()) <= SUMMARY_BYTES
        assert not text or text.endswith("(cut here: the rest is in the record)\n")
    assert len(render_step_summary(record).encode()) > SUMMARY_BYTES - 400
    assert render_step_summary(record_of("fail")) == golden("fail", "markdown").read_text(encoding="utf-8")
    assert cut_text("whole\n", 6) == "whole\n"


def test_junit_holds_whatever_a_name_holds() -> None:
    text = render_junit(with_findings(HOSTILE, replace(HOSTILE, message="\x00\ufffe", rule="overlap")))
    assert xsd.problems(XSD, text.encode(), "testsuites") == []
    assert "�" in text
    assert "\x07" not in text


def test_junit_counts_what_it_holds() -> None:
    for title in SCENES:
        root = ElementTree.fromstring(golden(title, "junit").read_bytes())
        for suite in root:
            cases = suite.findall("testcase")
            assert cases, "a suite without a case looks like a pass"
            assert int(suite.attrib["tests"]) == len(cases)
            for kind, name in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
                assert int(suite.attrib[name]) == sum(case.find(kind) is not None for case in cases)
        red = int(root.attrib["failures"]) + int(root.attrib["errors"])
        assert (red > 0) == (SCENES[title].exit_code != 0), title


def test_every_limit_that_is_missed_is_a_case_that_failed(tmp_path: Path) -> None:
    """Of two limits of one name too: the policy's P95, and a requirement that somebody called p95."""
    own = {"name": "p95", "error": "localisation", "quantile": 0.9, "limit_mm": 0.01}
    (tmp_path / "a.yaml").write_text(data_to_yaml(sound_design(requirements=[own], optimise=None)), encoding="utf-8")
    (tmp_path / "p.yaml").write_text(data_to_yaml(policy({"p95": {"limit_mm": 0.02}})), encoding="utf-8")
    assert gate_in(tmp_path, "a.yaml", "--policy", "p.yaml", "--format=junit=j.xml")[0] == 1
    cases = ElementTree.parse(tmp_path / "j.xml").findall(".//testcase")
    assert [(case.attrib["name"], len(case.findall("failure"))) for case in cases] == [("p95: p95, target tip", 1)] * 2


def test_gitlab_has_no_fingerprint_twice_and_nothing_that_is_accepted() -> None:
    same = [finding(rule="fiducial-spacing", message=f"F1 and F{k} are too close", pointer="/f") for k in (2, 3)]
    accepted = finding(suppressed_by="waivers.yaml:3, somebody")
    report = json.loads(render_gitlab(with_findings(*same, accepted, HOSTILE)))
    GITLAB.validate(report)
    assert len({entry["fingerprint"] for entry in report}) == len(report) == 3
    assert report[2]["location"] == {"path": HOSTILE.file, "lines": {"begin": 3}}


@pytest.mark.parametrize(("changes", "level", "severity"), read_cases("gate", "severities"))
def test_gitlabs_words_of_severity(changes: dict[str, Any], level: Any, severity: str) -> None:
    report = json.loads(render_gitlab(with_findings(finding(**changes), fail_level=level)))
    assert [entry["severity"] for entry in report] == [severity]


def test_what_github_asks_of_sarif() -> None:
    """published: docs.github.com, "SARIF support for code scanning": relative URIs, a line, help, the fingerprint."""
    record = with_findings(HOSTILE, finding(line=None, column=None), finding(suppressed_by="somebody"))
    log = json.loads(render_sarif(record))
    SARIF.validate(log)
    (run_,) = log["runs"]
    for rule in run_["tool"]["driver"]["rules"]:
        assert rule["help"]["text"]
        assert rule["help"]["markdown"]
        assert rule["shortDescription"]["text"]
        assert len(rule["fullDescription"]["text"]) <= 1000
    places = [result["locations"][0]["physicalLocation"] for result in run_["results"]]
    assert places[0]["artifactLocation"]["uri"] == "a%20b/100%25%2C%C3%A9%3A1/%5B%231%5D%3F.yaml"
    assert [place["region"]["startLine"] for place in places] == [3, 1, 59]
    hashes = [result["partialFingerprints"]["primaryLocationLineHash"] for result in run_["results"]]
    assert len(set(hashes)) == 3
    assert all(print_.endswith(":1") for print_ in hashes)


def test_fingerprints_do_not_hang_on_lines_or_values() -> None:
    moved = finding(line=900, column=1, value=7.0, message=finding().message.replace("0.6497", "0.7"))
    assert fingerprint_findings([finding()]) == fingerprint_findings([moved])
    assert len(set(fingerprint_findings([finding(), finding(), finding(rule="cvar"), finding(file="other.yaml")]))) == 4


def test_text_gives_no_command_to_a_runner() -> None:
    name = "::stop-commands::x"
    hostile = finding(message=" ".join(["word " * 15, name, "word " * 17, "##[group]x"] * 4))
    for line in render_text(with_findings(hostile)).splitlines():
        assert not line.strip().startswith(("::", "##["))
