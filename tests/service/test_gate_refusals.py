"""Policies, waivers and baselines that cannot be used: exit code 2, the line, the reason, and what to type instead."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from gate_scenes import GOOD, STRICT, TODAY, read_gate_record, waivers, write_documents

from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main

POLICY = "schema: tailstack/policy/1\nrules:\n"
WAIVERS = "schema: tailstack/waivers/1\nwaivers:\n"
WHOLE = "- {rule: p95, owner: J. Doe, reason: rework, max_value: 1.0, expires: 2026-12-01"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tailstack_service.cli.gate.today", lambda: TODAY)
    write_documents(tmp_path, {"good.yaml": GOOD, "strict.yaml": STRICT})
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], option: str, line: int | None, words: str) -> None:
    """The gate with this option is refused on stderr, and its record says the same at the same place."""
    assert main(["gate", "good.yaml", "--mode", "analytic", option, "given", "--format=json=out.json"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert words in said
    assert (f"given:{line}:" if line else "given: ") in said
    record = read_gate_record(Path("out.json"))
    assert (record.verdict, record.exit_code, record.provenance.policy_sha256) == ("not evaluated", 2, None)
    first = record.findings[0]
    assert (first.rule, first.file, first.line) == ("invalid-input", "given", line)
    assert words in " ".join(first.message.split())


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("", None, "the document is empty"),
        ("rules: {}\n", 1, "got no schema"),
        ("schema: tailstack/policy/2\n", 1, "tailstack/policy/1"),
        ("schema: tailstack/waivers/1\nwaivers: []\n", 1, "read as tailstack/policy/1"),
        ("- p95\n", 1, "a mapping of fields"),
        (POLICY + "  p59: {}\n", 3, "did you mean p95?"),
        (POLICY + "  p95: {limit: 2}\n", 3, "did you mean limit_mm?"),
        (POLICY + "  p95: {limit_mm: two}\n", 3, "expected a number"),
        (POLICY + "  p95: {limit_mm: -2}\n", 3, "must be at least 1e-06"),
        (POLICY + "  p95: {limit_mm: .nan}\n", 3, "nan"),
        (POLICY + "  p95: {limit_mm: .inf}\n", 3, "inf"),
        (POLICY + "  p95: {severity: fatal}\n", 3, "fatal"),
        (POLICY + "  p95: {confidence: 95}\n", 3, "95 % is 0.95"),
        (POLICY + "  p95: {severity: warn}\n", 3, "did you mean warning?"),
        (POLICY + "  plausability: {severity: error}\n", 3, "did you mean plausibility?"),
        (POLICY + "  plausibility: {remarks: [noise]}\n", 3, "must be"),
        ("schema: tailstack/policy/1\nguard_band_percent: '5 %'\n", 2, "the field is in per cent: write 5"),
        (POLICY + "  p95: {severity: off}\n  p95: {}\n", 4, "given twice"),
        (POLICY + "  exceedance: {limit_mm: 2}\n", 3, "max_probability is missing"),
        (POLICY + "  inconclusive: {severity: note}\n", 3, "note"),
        (POLICY + "  waiver-expired: {severity: warning}\n", 3, "warning"),
        (POLICY + "  invalid-design: {severity: note}\n", 3, "unknown field"),
        (POLICY + "  process-capability: {processes: [{name: x, tolerances: [a]}]}\n", 3, "min_half_width_deg"),
        ("schema: tailstack/policy/1\nguard_band_percent: -1\n", 2, "0"),
        ("schema: tailstack/policy/1\nverification: {max_trials: 10}\n", 2, "1000"),
        ("schema: tailstack/policy/1\nverification: {precision: 0}\n", 2, "0.0001"),
        ("schema: tailstack/policy/1\nclasses:\n- {name: a}\n- {name: a}\n", 4, "two classes are called"),
        ("schema: tailstack/policy/1\nname: 'a\nb: c\n", 4, "not YAML"),
        ("schema: tailstack/policy/1\nname: !x y\n", 2, "tags are not accepted"),
        ("schema: tailstack/policy/1\nclasses:\n- {name: a, files: ['" + 11 * "*a" + "']}\n", 3, "more than ten *"),
    ],
)
def test_a_policy_that_is_none(
    folder: Path, capsys: pytest.CaptureFixture[str], content: str, line: int | None, words: str
) -> None:
    (folder / "given").write_text(content, encoding="utf-8")
    refused(capsys, "--policy", line, words)


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
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
        (WAIVERS + WHOLE + ", until: 2026}\n", 3, "unknown field 'until'"),
        (WAIVERS + WHOLE + "}\n- 3\n", 4, "a mapping of fields"),
    ],
)
def test_waivers_that_are_none(
    folder: Path, capsys: pytest.CaptureFixture[str], content: str, line: int, words: str
) -> None:
    (folder / "given").write_text(content, encoding="utf-8")
    refused(capsys, "--waivers", line, words)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('"schema": "tailstack/gate/1"', '"schema": "tailstack/score/1"', 2, "read as tailstack/gate/1"),
        ('  "verdict": "pass",\n', "", 1, "'verdict' is required"),
        ('"verdict": "pass"', '"verdict": "fine"', 3, "fine"),
        ('"exit_code": 0', '"exit_code": "zero"', 4, "a whole number"),
        ('"seed": 0', '"seed": -1', 6, "a seed is a whole number"),
        ('"seed": 0', '"seed": 0, "seed": 1', 6, "given twice"),
        ('"findings": []', '"findings": {}', 10, "a list"),
        ('"first_order_p95_mm": 0', '"first_order_p95_mm": 1e999, "x": 0', None, "x"),
        ('"first_order_p95_mm": 0', '"first_order_p95_mm": "9", "x": 0', None, "expected a number of 0 or more"),
        ('"first_order_p95_mm": 0', '"first_order_p95_mm": -1, "x": 0', None, "expected a number of 0 or more"),
        ("{\n", "", None, "this is not"),
        ('"mode": "analytic",', '"mode": "analytic"', 6, "this is not"),
    ],
)
def test_baselines_that_are_none(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, line: int | None, words: str
) -> None:
    assert main(["gate", "good.yaml", "--mode", "analytic", "--policy", "strict.yaml", "--format=json=base"]) == 0
    text = json.dumps(json.loads((folder / "base").read_text(encoding="utf-8")), indent=2)  # with lines to name
    assert old in text
    (folder / "given").write_text(text.replace(old, new, 1), encoding="utf-8")
    capsys.readouterr()
    if line is None:
        assert main(["gate", "good.yaml", "--mode", "analytic", "--baseline", "given"]) == 2
        said = capsys.readouterr().err
        assert "given:" in said
        assert words in said
    else:
        refused(capsys, "--baseline", line, words)


@pytest.mark.parametrize("option", ["--policy", "--waivers", "--baseline"])
@pytest.mark.parametrize("content", [b"\xff\xfe\x00\xd8", b"schema: caf\xe9\n", b"\x00", b"[" * 5000, b"a: &a [*a]\n"])
def test_what_is_no_document_at_all(
    folder: Path, capsys: pytest.CaptureFixture[str], option: str, content: bytes
) -> None:
    (folder / "given").write_bytes(content)
    assert main(["gate", "good.yaml", "--mode", "analytic", option, "given"]) == 2
    shown = capsys.readouterr()
    assert "given" in shown.err
    assert "Traceback" not in shown.err
    assert shown.out == ""


def test_a_waiver_that_is_in_order_is_taken(folder: Path) -> None:
    """The table above refuses for the reason that it names, and not because of what all its rows share."""
    (folder / "given").write_text(WAIVERS + WHOLE + "}\n", encoding="utf-8")
    assert main(["gate", "good.yaml", "--mode", "analytic", "--waivers", "given"]) == 0
    (folder / "given").write_text(data_to_yaml(waivers(180)), encoding="utf-8")
    assert main(["gate", "good.yaml", "--mode", "analytic", "--waivers", "given"]) == 0
