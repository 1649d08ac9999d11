"""Policies, waivers and baselines that cannot be used: exit code 2, the line, the reason, and what to type instead;
and findings, which stand at the offending value however a document is written and whatever the file is called."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from gate_scenes import BAD, GOOD, STRICT, TODAY, gate_in, read_gate_record, waivers, write_document, write_documents
from service_scenes import limited

from plain_data import read_cases
from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.gate.records import GateFinding

POLICY = "schema: tailstack/policy/1\nrules:\n"
WAIVERS = "schema: tailstack/waivers/1\nwaivers:\n"
WHOLE = "- {rule: p95, owner: J. Doe, reason: rework, max_value: 1.0, expires: 2026-12-01"


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tailstack_service.cli.gate.today", lambda: TODAY)
    write_documents(tmp_path, {"good.yaml": GOOD, "policy.yaml": STRICT})
    return tmp_path


def check_refusal(refused: Any, option: str, line: int | None, words: str) -> None:
    """The gate with this option is refused on stderr, and its record says the same at the same place."""
    said = refused("gate", "good.yaml", "--mode", "analytic", option, "given", "--format=json=out.json")
    assert words in said
    assert (f"given:{line}:" if line else "given: ") in said
    record = read_gate_record(Path("out.json"))
    assert (record.verdict, record.exit_code, record.provenance.policy_sha256) == ("not evaluated", 2, None)
    first = record.findings[0]
    assert (first.rule, first.file, first.line) == ("invalid-input", "given", line)
    assert words in " ".join(first.message.split())


NO_WAIVERS = [
    ("schema: tailstack/waivers/1\n", 1, "'waivers' is required"),
    (WAIVERS + "- {rule: p95}\n", 3, "'owner' is required"),
    (WAIVERS + WHOLE.replace("J. Doe", "''") + "}\n", 3, "must not be empty"),
    (WAIVERS + WHOLE.replace("rework", "''") + "}\n", 3, "must not be empty"),
    (WAIVERS + WHOLE.replace("J. Doe", "' '") + "}\n", 3, "this is blank"),
    (WAIVERS + WHOLE.replace("rework", "' '") + "}\n", 3, "this is blank"),
    (WAIVERS + WHOLE.replace("p95", "p59") + "}\n", 3, "did you mean p95?"),
    (WAIVERS + WHOLE.replace("p95", "p99") + "}\n", 3, "rules: p95"),
    (WAIVERS + WHOLE.replace("p95", "inconclusive") + "}\n", 3, "cannot be waived"),
    (WAIVERS + WHOLE.replace("p95", "invalid-input") + "}\n", 3, "cannot be waived"),
    (WAIVERS + WHOLE.replace("max_value: 1.0", "min_value: 1.0") + "}\n", 3, "has max_value, not min_value"),
    (WAIVERS + WHOLE.replace("max_value: 1.0, ", "") + "}\n", 3, "says up to which value"),
    (WAIVERS + WHOLE.replace("2026-12-01", "2027-05-21") + "}\n", 3, "180 days at most"),
    (WAIVERS + WHOLE.replace("2026-12-01", "2026-02-30") + "}\n", 3, "no such day"),
    (WAIVERS + WHOLE.replace("2026-12-01", "next week") + "}\n", 3, "YYYY-MM-DD"),
    (WAIVERS + WHOLE.replace("1.0", "lots") + "}\n", 3, "expected a number"),
    (WAIVERS + WHOLE + ", designs: [released/]}\n", 3, "is a folder"),
    (WAIVERS + WHOLE + ", until: 2026}\n", 3, "unknown field 'until'"),
    (WAIVERS + WHOLE + "}\n- 3\n", 4, "a mapping of fields"),
]


@pytest.mark.parametrize(
    ("option", "content", "line", "words"),
    [*(("--policy", *row) for row in read_cases("gate", "policies")), *(("--waivers", *row) for row in NO_WAIVERS)],
)
def test_policies_and_waivers_that_are_none(
    room: Path, refused: Any, option: str, content: str, line: int | None, words: str
) -> None:
    (room / "given").write_text(content, encoding="utf-8")
    check_refusal(refused, option, line, words)


@pytest.mark.parametrize(("old", "new", "line", "words"), read_cases("gate", "baselines"))
def test_baselines_that_are_none(
    room: Path, call: Any, refused: Any, old: str, new: str, line: int | None, words: str
) -> None:
    call("gate", "good.yaml", "--mode", "analytic", "--policy", "policy.yaml", "--format=json=base")
    text = json.dumps(json.loads((room / "base").read_text(encoding="utf-8")), indent=2)  # with lines to name
    assert old in text
    (room / "given").write_text(text.replace(old, new, 1), encoding="utf-8")
    if line is None:
        said = refused("gate", "good.yaml", "--mode", "analytic", "--baseline", "given")
        assert ("given:" in said, words in said) == (True, True), said
    else:
        check_refusal(refused, "--baseline", line, words)


def test_a_waiver_that_is_in_order_is_taken(room: Path) -> None:
    """The table above refuses for the reason that it names, and not because of what all its rows share."""
    (room / "given").write_text(WAIVERS + WHOLE + "}\n", encoding="utf-8")
    assert main(["gate", "good.yaml", "--mode", "analytic", "--waivers", "given"]) == 0
    (room / "given").write_text(data_to_yaml(waivers(180)), encoding="utf-8")
    assert main(["gate", "good.yaml", "--mode", "analytic", "--waivers", "given"]) == 0


# --- places of findings ---------------------------------------------------------------------------


VALUE = "0.3"  # the limit that is missed
NO_UTF_8 = os.fsdecode(b"caf\xe9.yaml")


def found(*arguments: str, code: int = 1) -> list[GateFinding]:
    assert main(["gate", *arguments, "--policy", "policy.yaml", "--mode", "analytic", "--format=json=out.json"]) == code
    return list(read_gate_record(Path("out.json")).findings)


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


def crlf(text: str) -> bytes:
    return text.replace("\n", "\r\n").encode()


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
        ("indented.json", lambda _: json.dumps(BAD, indent=1).encode()),
        ("line.json", lambda _: json.dumps(BAD, ensure_ascii=False).encode()),
        ("anchored.yaml", anchored),
        ("wide.yaml", wide),
        ("started.yaml", lambda text: b"# a comment\n---\n" + text.encode()),
        ("flow.yaml", lambda text: ("{" + json.dumps(BAD)[1:]).encode()),
    ],
)
def test_the_place_is_that_of_the_value(room: Path, name: str, write: Callable[[str], bytes]) -> None:
    content = write(data_to_yaml(BAD))
    (room / name).write_bytes(content)
    (finding,) = found(name)
    text = content.decode("utf-16" if name.startswith("utf16") else "utf-8-sig")
    line = text.splitlines()[(finding.line or 0) - 1]
    column = (finding.column or 0) - 1
    assert line[column:].startswith(f"&limit {VALUE}" if name == "anchored.yaml" else VALUE), (line, column)
    assert ("limit_mm" in line) != (name == "anchored.yaml")
    assert (finding.rule, finding.pointer) == ("p95", "/requirements/0/limit_mm")


def test_names_that_cannot_be_shown_are_shown_as_far_as_they_can(room: Path) -> None:
    write_document(room / NO_UTF_8, BAD)
    (room / "line\nbreak\x1b.yaml").write_text(data_to_yaml(BAD), encoding="utf-8")
    assert [finding.file for finding in found("*.yaml", "--format=text=o.txt", code=2)][:2] == [
        "caf\ufffd.yaml", "line\ufffdbreak\ufffd.yaml",
    ]  # fmt: skip


def test_what_is_wrong_in_a_fiducial_file_stands_there(room: Path) -> None:
    filed: dict[str, Any] = limited(1.4)
    filed["fiducials"] = {"file": "beads.csv"}
    write_document(room / "sub" / "d.yaml", filed)
    (finding,) = found("sub/d.yaml", code=2)
    assert (finding.file, finding.rule, finding.pointer) == ("sub/d.yaml", "invalid-design", "/fiducials/file")
    assert data_to_yaml(filed).splitlines()[(finding.line or 0) - 1].endswith("file: beads.csv")
    (room / "sub" / "beads.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,3\nB,1,x,3\n", encoding="utf-8")
    finding = found("sub/d.yaml", "--format=junit=o.xml", code=2)[0]
    assert (finding.file, finding.line, finding.rule) == ("sub/beads.csv", 3, "invalid-design")
    assert '<testsuite name="sub/d.yaml" tests="1" failures="0" errors="1"' in (room / "o.xml").read_text()


def test_whatever_a_file_is_called_a_refusal_of_it_can_be_written(room: Path) -> None:
    """Bytes that are no UTF-8, and a way that is absolute: for designs, policies, waivers and baselines."""
    raw = str(write_document(room / NO_UTF_8, "schema: tailstack/design/1\nname: x\n"))
    finding = found(raw, code=2)[0]
    assert (finding.file, finding.line) == ("caf\ufffd.yaml", 1)
    (room / "d.yaml").write_text(data_to_yaml(BAD), encoding="utf-8")
    for option in ("--waivers", "--baseline", "--policy"):
        code, record = gate_in(room, "d.yaml", option, raw)
        assert (code, {entry.file for entry in record.findings}) == (2, {"caf\ufffd.yaml"})
