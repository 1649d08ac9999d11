"""The gate never fails open: whatever happens, the exit code says so, and no file of the last run looks current."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from gate_scenes import BAD, FORMATS, GOOD, PASSING, STRICT, read_gate_record, waivers_of_today, write_documents
from service_scenes import ROOT, limited, write_json

from family import TAILSTACK, read_until, run_process, started
from plain_data import read_cases
from tailstack import load_design, score
from tailstack.errors import NotConvergedError, Problem
from tailstack_service.cli import gate_outputs
from tailstack_service.cli.main import main
from tailstack_service.cli.report import _stem
from tailstack_service.console.files import Staged, stage
from tailstack_service.documents import to_json
from tailstack_service.gate.records import GateRecord
from tailstack_service.gate.rules import RULES
from waiting import LIMIT_SECONDS


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_documents(tmp_path, {"good.yaml": GOOD, "bad.yaml": BAD, "policy.yaml": STRICT})
    return tmp_path


EVERY = ("--mode", "analytic", *(f"--format={name}=out.{name}" for name in FORMATS))


def gate(*arguments: str) -> int:
    return main(["gate", *EVERY, *arguments])


def record() -> GateRecord:
    return read_gate_record(Path("out.json"))


def is_no_verdict(name: str, text: str) -> bool:
    """Whether a file says in its own words that nothing was judged."""
    if name == "sarif":
        (run,) = json.loads(text)["runs"]
        return run["invocations"][0]["executionSuccessful"] is False and run["properties"]["verdict"] == "not evaluated"
    if name == "gitlab":
        return any(entry["severity"] == "blocker" for entry in json.loads(text))
    if name == "junit":
        return 'failures="0" errors="0"' not in text and "<error " in text
    return "not evaluated" in text and "pass" not in text


def judged_in_vain(name: str, text: str) -> bool:
    """Whether a file says that there is no verdict, though it holds what the designs came to."""
    if name == "json":
        return json.loads(text)["verdict"] == "not evaluated"
    if name == "markdown":
        return text.startswith("## ⛔ Gate: not evaluated\n")
    if name == "junit":
        return '<testsuites name="tailstack gate" tests="2" failures="0" errors="1">' in text
    if name in ("text", "github"):
        return "not evaluated (exit code 3" in text.splitlines()[-1]
    return is_no_verdict(name, text)


@pytest.mark.parametrize(("arguments", "code", "words"), read_cases("gate", "arguments"))
def test_a_gate_that_cannot_judge_leaves_no_old_pass(
    folder: Path, call: Any, arguments: list[str], code: int, words: str
) -> None:
    before = {name: (folder / name).read_bytes() for name in ("good.yaml", "policy.yaml")}
    assert call("gate", *EVERY, "good.yaml", "--policy", "policy.yaml")[0] == 0
    assert record().verdict == "pass"
    left, out, err = call("gate", *EVERY, *arguments)
    assert (left, words in err, out) == (code, True, "")
    assert (record().verdict, record().exit_code) == ("not evaluated", code)
    for name in FORMATS:
        assert is_no_verdict(name, (folder / f"out.{name}").read_text(encoding="utf-8")), name
    assert {name: (folder / name).read_bytes() for name in before} == before, "inputs are never written"
    assert not list(folder.glob("*.part"))


@pytest.mark.parametrize(
    ("place", "error", "code"),
    [
        ("tailstack_service.gate.judge.score", RuntimeError("singular"), 3),
        ("tailstack_service.gate.judge.score", MemoryError(), 3),
        ("tailstack_service.gate.judge.score", SystemExit(0), 3),
        ("tailstack_service.gate.policy.read_document", SystemExit("a library gives up"), 3),
        ("tailstack_service.gate.reading.read_source", OSError(5, "Input/output error"), 3),
        ("tailstack_service.cli.gate._list_files", KeyboardInterrupt(), 130),
        ("tailstack_service.gate.judge.conclude", KeyboardInterrupt(), 130),
    ],
)
def test_whatever_is_raised_is_no_pass(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any, place: str, error: Any, code: int
) -> None:
    assert call("gate", *EVERY, "good.yaml", "--policy", "policy.yaml")[0] == 0
    monkeypatch.setattr(place, Mock(side_effect=error))
    left, _, err = call("gate", *EVERY, "good.yaml", "--policy", "policy.yaml")
    assert (left, err != "") == (code, True)
    assert (record().verdict, record().exit_code) == ("not evaluated", code)


def test_a_format_on_stdout_is_whole_when_the_gate_breaks_off(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any
) -> None:
    monkeypatch.setattr("tailstack_service.gate.judge.conclude", Mock(side_effect=RuntimeError("singular")))
    code, out, err = call("gate", "good.yaml", "--format", "json")
    assert (code, json.loads(out)["exit_code"]) == (3, 3)
    assert "internal error, RuntimeError: singular" in err


def test_a_monte_carlo_check_that_is_refused_is_no_pass(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = NotConvergedError(Problem("/views", "not-converged", "no solution was proven"))
    monkeypatch.setattr("tailstack.verification.verify_prepared", Mock(side_effect=refusal))
    assert main(["gate", "good.yaml", "bad.yaml", "--mode", "verify", "--format", "json=out.json"]) == 3
    assert [design.verdict for design in record().designs] == ["not evaluated", "not evaluated"]
    assert {finding.rule for finding in record().findings} == {"not-evaluated"}


def failing(monkeypatch: pytest.MonkeyPatch, file: str) -> None:
    """Let writing a file fail as if the disk were full, from the second time on: the gate has begun then."""
    seen: list[str] = []

    def full(name: str, content: bytes) -> Staged:
        seen.append(name)
        if name == file and seen.count(file) > 1:
            raise OSError(28, "No space left on device")
        return stage(name, content)

    monkeypatch.setattr(gate_outputs, "stage", full)


@pytest.mark.parametrize("file", [f"out.{name}" for name in FORMATS])
def test_an_output_that_cannot_be_written_leaves_no_pass_anywhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any, file: str
) -> None:
    failing(monkeypatch, file)
    code, _, err = call("gate", *EVERY, "good.yaml", "--policy", "policy.yaml")
    assert code == 3
    assert f"cannot write {file}: No space left on device\n  hint: make room for it" in err
    assert err.splitlines()[-1] == "tailstack gate: verdict: not evaluated (exit code 3)"
    assert not (folder / file).exists()
    for name in {*FORMATS} - {file.removeprefix("out.")}:
        text = (folder / f"out.{name}").read_text(encoding="utf-8")
        assert f"cannot write {file}" in text, name
        assert judged_in_vain(name, text), name
    assert not list(folder.glob("*.part"))


@pytest.mark.parametrize("times", [1, 1000])
def test_a_file_that_cannot_be_put_in_its_place_takes_back_those_that_were(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any, times: int
) -> None:
    """json is written last but six: text, before it, is in its place and says pass when json fails."""
    put, seen = Staged.put, []

    def denied(self: Any) -> None:
        if self.file == "out.json":
            seen.append(self.file)
            if 1 < len(seen) <= 1 + times:
                self.drop()
                raise OSError(13, "Permission denied")
        put(self)

    monkeypatch.setattr(Staged, "put", denied)
    code, _, err = call("gate", *EVERY, "good.yaml", "--policy", "policy.yaml")
    assert (code, "cannot write out.json: Permission denied" in err) == (3, True)
    assert judged_in_vain("text", (folder / "out.text").read_text(encoding="utf-8"))
    assert (folder / "out.json").exists() == (times == 1), "the second time it may work"
    if times == 1:
        assert (record().verdict, record().exit_code, record().designs[0].verdict) == ("not evaluated", 3, "pass")
    assert not list(folder.glob("*.part"))


def test_a_text_on_stdout_does_not_say_pass_when_a_file_fails(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any
) -> None:
    failing(monkeypatch, "out.json")
    both = ("--format", "text", "--format", "json=out.json")
    code, out, err = call("gate", "good.yaml", "--policy", "policy.yaml", "--mode", "analytic", *both)
    assert code == 3
    assert out.splitlines()[-1].startswith("verdict: not evaluated (exit code 3")
    for said in (" ".join(out.split()), err):
        assert "cannot write out.json: No space left on device" in said


def test_a_refusal_stays_a_refusal_when_a_file_fails_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, "out.sarif")
    assert gate("absent.yaml") == 2
    assert record().exit_code == 2
    assert {finding.rule for finding in record().findings} == {"not-evaluated", "invalid-design"}


def test_nothing_is_computed_for_an_output_that_cannot_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any
) -> None:
    monkeypatch.setattr("tailstack_service.cli.gate._judge", Mock(side_effect=AssertionError("judged")))
    code, _, err = call("gate", "good.yaml", "--format", "sarif=/proc/gate.sarif", "--format", "json=out.json")
    assert (code, "cannot write /proc/gate.sarif" in err, record().exit_code) == (3, True, 3)


ANALYTIC = (*TAILSTACK, "gate", "good.yaml", "--policy=policy.yaml", "--mode=analytic")


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "stdout", "said"),
    [
        ("text", "/dev/full", "cannot write to standard output: No space left on device"),
        ("text=/dev/full", os.devnull, "cannot write /dev/full: No space left on device"),
        ("text", None, "cannot write to standard output: it is closed"),
    ],
    ids=["stdout", "stream", "closed"],
)
def test_a_stream_that_takes_nothing_leaves_no_pass_in_the_files(
    folder: Path, text: str, stdout: str | None, said: str
) -> None:
    command = (*ANALYTIC, "--format=json=out.json", f"--format={text}")
    closed = () if stdout else ("sh", "-c", '"$0" "$@" >&-')
    with open(stdout or os.devnull, "wb") as target:
        ran = run_process(*closed, *command, stdout=target)
    assert ran.returncode == 3
    assert said in ran.stderr
    assert "internal error" not in ran.stderr
    assert stdout is None or ran.stderr.splitlines()[-1].endswith("verdict: not evaluated (exit code 3)")
    assert (record().verdict, record().exit_code) == ("not evaluated", 3)
    assert Path("/dev/full").is_char_device(), "a device is written to, never replaced"


@pytest.mark.long
def test_a_device_that_stands_for_a_file_is_written_to_and_not_replaced(folder: Path) -> None:
    """/dev/stdout of a shell that writes to a file: a link of the system, which a rename would take away."""
    assert Path("/dev/stdout").is_symlink()
    with open(folder / "log.txt", "wb") as log:
        assert run_process(*ANALYTIC, "--format=text=/dev/stdout", stdout=log).returncode == 0
    assert Path("/dev/stdout").is_symlink()
    text = (folder / "log.txt").read_text(encoding="utf-8")
    assert text.splitlines()[-1].startswith("verdict: pass (exit code 0")
    assert "not evaluated" not in text, "what the files say while the gate runs is no answer"


def test_a_link_stays_a_link(folder: Path) -> None:
    (folder / "artifacts").mkdir()
    (folder / "out.json").symlink_to(folder / "artifacts" / "gate.json")
    assert gate("good.yaml", "--policy", "policy.yaml") == 0
    assert (folder / "out.json").is_symlink()
    assert json.loads((folder / "artifacts" / "gate.json").read_text(encoding="utf-8"))["verdict"] == "pass"


def test_a_file_that_cannot_be_replaced_does_not_stay(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert gate("good.yaml", "--policy", "policy.yaml") == 0
    monkeypatch.setattr(gate_outputs, "stage", Mock(side_effect=OSError(28, "No space left on device")))
    assert gate("good.yaml", "--policy", "policy.yaml") == 3
    assert not list(folder.glob("out.*")), "what an earlier gate wrote is no answer to this one"


def test_an_output_that_a_pattern_matches_is_neither_written_over_nor_judged(folder: Path, refused: Any) -> None:
    before = (folder / "good.yaml").read_bytes()
    assert "good.yaml would overwrite a file that is read" in refused(
        "gate", "g*.yaml", "--mode", "analytic", "--format", "json=good.yaml"
    )
    assert (folder / "good.yaml").read_bytes() == before
    assert main(["gate", "g*", "--policy", "policy.yaml", "--mode", "analytic", "--format", "json=gate.json"]) == 0
    assert [design.file for design in read_gate_record(folder / "gate.json").designs] == ["good.yaml"]


@pytest.mark.parametrize("name", ["points.csv", "points.FCSV", "points.mrk.json"])
def test_a_file_of_fiducials_is_not_written_over(folder: Path, refused: Any, name: str) -> None:
    (folder / name).write_text("label,x,y,z\n", encoding="utf-8")
    assert f"{name} would overwrite what may be a file of fiducials" in refused(
        "gate", "good.yaml", "--mode", "analytic", "--format", f"json={name}"
    )
    assert (folder / name).read_text(encoding="utf-8") == "label,x,y,z\n"


JUDGING = (
    "import sys\n"
    "from tailstack_service.cli import gate, main\n"
    "def judge(*_):\n"
    "    print('judging', flush=True)\n"
    "    while True:  # a signal that comes just before a wait for a lock would not end that wait\n"
    "        pass\n"
    "gate._judge = judge\n"
    "sys.exit(main.main(sys.argv[1:]))\n"
)


@pytest.mark.parametrize(
    ("sent", "left", "code", "words"),
    [(signal.SIGKILL, -signal.SIGKILL, 3, "it is running, or it was killed"), (signal.SIGINT, 130, 130, "interrupted")],
    ids=["killed", "interrupted"],
)
def test_a_gate_that_is_broken_off_leaves_files_that_say_so(
    folder: Path, sent: signal.Signals, left: int, code: int, words: str
) -> None:
    """The process gets the signal while it computes; what it wrote at its start stays where it is killed."""
    assert gate("good.yaml", "--policy", "policy.yaml") == 0
    command = [sys.executable, "-c", JUDGING, "gate", "good.yaml", *[f"--format={n}=out.{n}" for n in FORMATS]]
    with started(*command, cwd=folder, stderr=subprocess.DEVNULL) as child:
        read_until("judging\n", child.stdout)
        child.send_signal(sent)
        assert child.wait(LIMIT_SECONDS) == left
    assert (record().verdict, record().exit_code) == ("not evaluated", code)
    assert record().findings[0].rule == "not-evaluated"
    for name in FORMATS:
        text = (folder / f"out.{name}").read_text(encoding="utf-8")
        assert words in text, name


def test_a_baseline_without_numbers_compares_nothing_and_is_refused(folder: Path, refused: Any) -> None:
    refused("gate", *EVERY, "absent.yaml")
    os.replace("out.json", "base.json")
    assert "it has no numbers to compare with" in refused("gate", "good.yaml", "--baseline", "base.json")


def test_the_summary_of_a_step_is_appended_and_never_too_long(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Any
) -> None:
    summary = folder / "summary.md"
    summary.write_text("# before\n", encoding="utf-8")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    monkeypatch.setenv("GITHUB_WORKSPACE", str(folder.parent))
    code, out, _ = call("gate", "bad.yaml", "--mode", "analytic", "--format", "github")
    assert (code, f"::error file={folder.name}/bad.yaml,line=" in out) == (1, True)
    text = summary.read_text(encoding="utf-8")
    assert text.startswith("# before\n## ❌ Gate: fail")
    row = next(line for line in text.splitlines() if "/bad.yaml |" in line)
    assert row.startswith(f"| {folder.name.replace('_', chr(92) + '_')}/bad.yaml |")
    assert row.endswith("| ❌ fail |")
    assert main(["gate", "good.yaml", "--mode", "analytic"]) == 0
    assert summary.read_text(encoding="utf-8") == text, "only format github writes it"
    summary.write_bytes(b"x" * (2**20 - 10))
    assert main(["gate", "bad.yaml", "--mode", "analytic", "--format", "github"]) == 1
    assert summary.stat().st_size <= 2**20
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder))
    code, out, err = call("gate", "good.yaml", "--mode", "analytic", "--format", "github")
    assert (code, "cannot write GITHUB_STEP_SUMMARY" in err) == (3, True)
    assert out.splitlines()[-1] == "tailstack gate: not evaluated (exit code 3)"


# --- what it says on the way; rules; reports ------------------------------------------------------


PLAINLY = ("--policy", "policy.yaml", "--mode", "analytic")


@pytest.mark.parametrize(("formats", "told"), read_cases("gate", "logged"))
def test_the_reason_is_in_the_log_whatever_the_formats(folder: Path, call: Any, formats: list[str], told: bool) -> None:
    wanted = [f"--format={name}" for name in formats]
    code, out, err = call("gate", "good.yaml", "bad.yaml", *PLAINLY, *wanted)
    assert code == 1
    said = [line for line in err.splitlines() if line.startswith("tailstack gate: ")]
    if not told:
        assert said == []
        assert "0.3 mm" in out
        return
    assert formats != ["json"] or json.loads(out)["schema"] == "tailstack/gate/1"
    line = next(k for k, words in enumerate((folder / "bad.yaml").read_text().splitlines(), 1) if "limit_mm" in words)
    assert said[:2] == ["tailstack gate: bad.yaml: fail", "tailstack gate: good.yaml: pass"]
    assert said[2].startswith(f"tailstack gate: bad.yaml:{line}:")
    assert said[2].endswith("[p95]")
    assert said[3:] == ["tailstack gate: verdict: fail (exit code 1)"]


def test_the_reason_in_the_log_is_short(folder: Path, call: Any) -> None:
    write_documents(folder, {f"d{k:02}.yaml": GOOD if k % 4 else BAD for k in range(15)})
    write_documents(folder, {"waivers.yaml": waivers_of_today("d00.yaml")})
    code, _, err = call("gate", "d*.yaml", "--waivers", "waivers.yaml", "--format", "json=g.json", *PLAINLY)
    assert code == 1
    ours = ("wrote ", "tailstack gate: ")  # progress stands between them, where it takes long
    said = [line for line in err.splitlines() if line.startswith(ours)]
    assert said[:5] == ["wrote g.json", *[f"tailstack gate: d{k:02}.yaml: fail" for k in (4, 8, 12)],
                        "tailstack gate: d00.yaml: pass"]  # fmt: skip
    assert said[11] == "tailstack gate: ... and 5 more designs, which pass"
    assert [line.split(":")[1] for line in said[12:15]] == [f" d{k:02}.yaml" for k in (4, 8, 12)]
    assert said[15:] == ["tailstack gate: verdict: fail (exit code 1, 1 accepted by waivers)"]


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_has_a_page(rule: str, call: Any) -> None:
    code, page, _ = call("gate", "--explain", rule)
    assert code == 0
    known = RULES[rule]
    assert page.startswith(f"{rule}: {known.title}")
    assert len(page) > 150
    head = f"## {rule}\n\n**{known.title}.** Default: {known.severity}.\n\n{known.page[:80]}"
    assert head in (ROOT / "docs" / "rules.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("arguments", "words"), read_cases("gate", "options"))
def test_what_is_no_option_is_refused_with_2(folder: Path, refused: Any, arguments: list[str], words: str) -> None:
    assert words in refused("gate", "good.yaml", *arguments, "--policy", "policy.yaml", "--mode", "analytic")


# --- report ---------------------------------------------------------------------------------------


def test_reports_of_two_revisions_stay_apart() -> None:
    names = ("guide.v1.yaml", "guide.v2.yml", "guide.report.json", "guide.json", "guide", "guide.html", ".yaml")
    assert [_stem(name) for name in names] == ["guide.v1", "guide.v2", "guide", "guide", "guide", "guide", ".yaml"]


@pytest.mark.parametrize(("arguments", "words"), read_cases("gate", "reports"))
def test_what_cannot_be_reported_is_refused_with_2(
    folder: Path, refused: Any, arguments: list[str], words: str
) -> None:
    write_json(folder / "half.json", {"schema": "tailstack/score/1", "targets": []})
    write_json(folder / "other.json", {"schema": "tailstack/validation/1"})
    (folder / "whole.json").write_bytes(to_json(score(load_design(limited(PASSING)))))
    assert words in refused("report", *arguments)
