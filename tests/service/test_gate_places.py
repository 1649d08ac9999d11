"""Findings stand at the offending value, however the document is written and whatever the file is called."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from gate_scenes import BAD, GOOD, STRICT, read_gate_record
from service_scenes import limited
from test_gate_formats import GITLAB, SARIF, XSD
from xsd import problems

from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.gate.records import GateFinding

VALUE = "0.3"  # the limit that is missed


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policy.yaml").write_text(data_to_yaml(STRICT), encoding="utf-8")
    return tmp_path


def found(*arguments: str, code: int = 1) -> list[GateFinding]:
    assert main(["gate", *arguments, "--policy", "policy.yaml", "--mode", "analytic", "--format=json=out.json"]) == code
    return list(read_gate_record(Path("out.json")).findings)


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


def crlf(text: str) -> bytes:
    return text.replace("\n", "\r\n").encode()


def indented_json(_: str) -> bytes:
    return json.dumps(BAD, indent=1).encode()


def one_line_json(_: str) -> bytes:
    return json.dumps(BAD, ensure_ascii=False).encode()


def anchored(text: str) -> bytes:
    """The limit is an alias; the value stands at its anchor."""
    marked = changed(text, "fiducial_noise_px: 0.3", "fiducial_noise_px: &limit 0.3")
    return changed(marked, "limit_mm: 0.3", "limit_mm: *limit").encode()


def wide(text: str) -> bytes:
    """Characters of two, three and four bytes before the value count as one column each."""
    return changed(text, "- name: tip-accuracy\n  limit_mm: 0.3", "- {name: 'é€𝄞', limit_mm: 0.3}").encode()


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("plain.yaml", lambda text: text.encode()),
        ("crlf.yaml", crlf),
        ("bom.yaml", lambda text: b"\xef\xbb\xbf" + text.encode()),
        ("utf16.yaml", lambda text: text.encode("utf-16")),
        ("bom-crlf.json", lambda text: b"\xef\xbb\xbf" + crlf(json.dumps(BAD, indent=2))),
        ("indented.json", indented_json),
        ("line.json", one_line_json),
        ("anchored.yaml", anchored),
        ("wide.yaml", wide),
        ("started.yaml", lambda text: b"# a comment\n---\n" + text.encode()),
        ("flow.yaml", lambda text: ("{" + json.dumps(BAD)[1:]).encode()),
    ],
)
def test_the_place_is_that_of_the_value(folder: Path, name: str, write: Callable[[str], bytes]) -> None:
    content = write(data_to_yaml(BAD))
    (folder / name).write_bytes(content)
    (finding,) = found(name)
    text = content.decode("utf-16" if name.startswith("utf16") else "utf-8-sig")
    line = text.splitlines()[(finding.line or 0) - 1]
    column = (finding.column or 0) - 1
    assert line[column:].startswith(f"&limit {VALUE}" if name == "anchored.yaml" else VALUE), (line, column)
    assert ("limit_mm" in line) != (name == "anchored.yaml")
    assert (finding.rule, finding.pointer) == ("p95", "/requirements/0/limit_mm")


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        (b"schema: tailstack/design/1\n---\nschema: tailstack/design/1\n", 3, "more than one YAML document"),
        (b"schema: tailstack/design/1\r\nname: [1,\r\n", 3, "this is not YAML"),
        (b"schema: tailstack/design/1\nname: caf\xe9\n", None, "not valid UTF-8"),
        (b"\x00\x01\x02", None, "NUL"),
        (b"", None, "empty"),
        (b"- a\n- b\n", 1, "a mapping of fields"),
        (b"schema: tailstack/design/1\nname: !!python/object:os.system x\n", 2, "tags are not accepted"),
        (b"a: &a [x]\nb: [*c]\n", 2, "no finished value is called"),
        (b"schema: tailstack/design/1\nschema: tailstack/design/1\n", 2, "given twice"),
        (b"\tschema: 1\n", 1, "this is not YAML"),
        (b'{"schema": "tailstack/design/1",\n "name": }', 2, "expected a text"),
        (b'{"schema": "tailstack/design/1",\n "name": "x"', 3, "this is not"),
    ],
)
def test_rubbish_is_refused_at_its_line(folder: Path, content: bytes, line: int | None, words: str) -> None:
    (folder / "rubbish.yaml").write_bytes(content)
    finding = found("rubbish.yaml", code=2)[0]
    assert (finding.rule, finding.file, finding.severity) == ("invalid-design", "rubbish.yaml", "error")
    assert words in finding.message
    assert finding.line == line


NAMES = ("a b.yaml", "100%.yaml", "x:1.yaml", "é, ü.yaml", "[1]*.yaml", "a;b&c'd\"e.yaml", "-dash.yaml", "#1?.yaml")


def test_names_of_files_come_through_in_every_format(folder: Path) -> None:
    for name in NAMES:
        (folder / name).write_text(data_to_yaml(BAD), encoding="utf-8")
    ways = [f"./{name}" if name.startswith("-") else name for name in NAMES]
    formats = ["sarif=o.sarif", "junit=o.xml", "github=o.github", "gitlab=o.gitlab", "markdown=o.md", "text=o.txt"]
    findings = found(*ways, *[f"--format={entry}" for entry in formats])
    assert [finding.file for finding in findings] == list(NAMES)
    log = json.loads((folder / "o.sarif").read_text(encoding="utf-8"))
    SARIF.validate(log)
    uris = [
        result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for result in log["runs"][0]["results"]
    ]

    assert [unquote(urlsplit(uri).path) for uri in uris] == list(NAMES)
    assert not any(urlsplit(uri).scheme or urlsplit(uri).fragment or urlsplit(uri).query for uri in uris)
    GITLAB.validate(report := json.loads((folder / "o.gitlab").read_text(encoding="utf-8")))
    assert [entry["location"]["path"] for entry in report] == list(NAMES)
    assert problems(XSD, (folder / "o.xml").read_bytes(), "testsuites") == []
    commands = (folder / "o.github").read_text(encoding="utf-8").splitlines()
    files = [command.split("file=", 1)[1].split(",line=")[0] for command in commands[:-1]]
    undone = [file.replace("%3A", ":").replace("%2C", ",").replace("%25", "%") for file in files]
    assert undone == list(NAMES)
    for name in NAMES:
        assert f"{name}:59:" in (folder / "o.txt").read_text(encoding="utf-8")


def test_names_that_cannot_be_shown_are_shown_as_far_as_they_can(folder: Path) -> None:
    raw = os.fsencode(str(folder)) + b"/caf\xe9.yaml"
    with open(raw, "wb") as stream:
        stream.write(data_to_yaml(BAD).encode())
    (folder / "line\nbreak\x1b.yaml").write_text(data_to_yaml(BAD), encoding="utf-8")
    assert [finding.file for finding in found("*.yaml", "--format=text=o.txt", code=2)][:2] == [
        "caf\ufffd.yaml", "line\ufffdbreak\ufffd.yaml",
    ]  # fmt: skip


def test_files_are_called_from_the_working_directory_and_each_is_judged_once(folder: Path) -> None:
    (folder / "sub").mkdir()
    (folder / "sub" / "d.yaml").write_text(data_to_yaml(BAD), encoding="utf-8")
    absolute = str(folder / "sub" / "d.yaml")
    assert [finding.file for finding in found("sub/d.yaml", "./sub//d.yaml", absolute, "**/d.yaml")] == ["sub/d.yaml"]


def test_what_is_wrong_in_a_fiducial_file_stands_there(folder: Path) -> None:
    filed: dict[str, Any] = limited(1.4)
    filed["fiducials"] = {"file": "beads.csv"}
    (folder / "sub").mkdir()
    (folder / "sub" / "d.yaml").write_text(data_to_yaml(filed), encoding="utf-8")
    (finding,) = found("sub/d.yaml", code=2)
    assert (finding.file, finding.rule, finding.pointer) == ("sub/d.yaml", "invalid-design", "/fiducials/file")
    assert data_to_yaml(filed).splitlines()[(finding.line or 0) - 1].endswith("file: beads.csv")
    (folder / "sub" / "beads.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,3\nB,1,x,3\n", encoding="utf-8")
    finding = found("sub/d.yaml", "--format=junit=o.xml", code=2)[0]
    assert (finding.file, finding.line, finding.rule) == ("sub/beads.csv", 3, "invalid-design")
    assert '<testsuite name="sub/d.yaml" tests="1" failures="0" errors="1"' in (folder / "o.xml").read_text()


def test_whatever_a_file_is_called_a_refusal_of_it_can_be_written(folder: Path) -> None:
    """Bytes that are no UTF-8, and a way that is absolute: for designs, policies, waivers and baselines."""
    raw = os.fsdecode(os.fsencode(str(folder)) + b"/caf\xe9.yaml")
    Path(raw).write_bytes(b"schema: tailstack/design/1\nname: x\n")
    finding = found(raw, code=2)[0]
    assert (finding.file, finding.line) == ("caf\ufffd.yaml", 1)
    (folder / "d.yaml").write_text(data_to_yaml(BAD), encoding="utf-8")
    for option in ("--waivers", "--baseline", "--policy"):
        arguments = ["gate", "d.yaml", "--mode", "analytic", option, raw, "--format=json=out.json"]
        assert main(arguments) == 2
        findings = read_gate_record(folder / "out.json").findings
        assert {entry.file for entry in findings} == {"caf\ufffd.yaml"}


def test_several_rules_each_at_its_own_value(folder: Path) -> None:
    policy = {
        "schema": "tailstack/policy/1",
        "rules": {
            "overlap": {"severity": "off"},
            "fiducial-spacing": {"min_mm": 80.0},
            "visibility": {"min_margin_px": 900.0},
            "process-capability": {
                "processes": [
                    {"name": "seat", "tolerances": ["structure_connector.rz", "A?"], "min_half_width_deg": 0.2}
                ]
            },
        },
    }
    (folder / "policy.yaml").write_text(data_to_yaml(policy), encoding="utf-8")
    (folder / "d.yaml").write_text(data_to_yaml(GOOD), encoding="utf-8")
    lines = data_to_yaml(GOOD).splitlines()
    places = {
        finding.rule: lines[(finding.line or 0) - 1][(finding.column or 0) - 1 :]
        for finding in found("d.yaml")
        if finding.file == "d.yaml"
    }
    assert places["process-capability"].startswith("0.15")
    (unused,) = (finding for finding in found("d.yaml") if finding.rule == "process-unused")
    at = (folder / "policy.yaml").read_text(encoding="utf-8").splitlines()[(unused.line or 0) - 1]
    assert unused.file == "policy.yaml"
    assert at[(unused.column or 0) - 1 :].startswith(('"A?"', "'A?'", "A?"))
    assert places["fiducial-spacing"].startswith("[")
    assert places["visibility"].startswith("name: ")
