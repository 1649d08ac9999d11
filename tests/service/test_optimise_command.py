"""``tailstack optimise``: what it says on the way, how it is stopped, and what it leaves on the disk."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from optimisation_scenes import full_result, verification
from served import environment
from service_scenes import EXAMPLES

from family import TAILSTACK, read_until, started
from tailstack.design import design_to_data, load_design
from tailstack.errors import NotConvergedError, Problem
from tailstack.results import Finding, Optimisation
from tailstack_service.cli.main import main
from tailstack_service.console.progress import Progress
from tailstack_service.operations.optimisation import STOPPING, reporter
from waiting import LIMIT_SECONDS

DEMO = EXAMPLES / "demo.yaml"
SCHEMA = "tailstack-design.schema.json"
NEW_DESIGN = design_to_data(load_design(DEMO.read_text(encoding="utf-8").replace("[-30, -29, -72]", "[-40, -41, -72]")))
RESULT = full_result(design=NEW_DESIGN)
Captured = tuple[int, str, str]
Optimise = Callable[..., Optimisation]


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run the command with an optimiser of the test's own; (exit code, stdout, stderr)."""

    def run(optimiser: Optimise, *arguments: str) -> Captured:
        found = Finding("floor", "note", "moving fiducials cannot bring P95 below 0.98 mm")
        monkeypatch.setattr("tailstack.optimise", optimiser, raising=False)
        monkeypatch.setattr("tailstack.optimisation.influence", lambda _design: (found,), raising=False)
        handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
        code = main(["optimise", str(DEMO), *arguments])
        assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return run


def answers(result: Optimisation = RESULT) -> Optimise:
    return lambda _design, **_options: result


def interrupted(number: int, outcome: Callable[[], Optimisation]) -> Optimise:
    """An optimiser that gets a signal on the way and looks whether it is to stop."""

    def optimise(_design: Any, *, stop: Callable[[], bool], **_options: Any) -> Optimisation:
        assert not stop()
        os.kill(os.getpid(), number)
        assert stop()
        return outcome()

    return optimise


def refused(code: str) -> Callable[[], Optimisation]:
    def outcome() -> Optimisation:
        raise NotConvergedError(Problem("/optimise", code, "nothing had converged", "let it run longer"))

    return outcome


# --- what it says ---------------------------------------------------------------------------------


def test_the_answer_ends_with_the_verdict_and_what_to_type_next(call: Any, tmp_path: Path) -> None:
    new = tmp_path / "new.yaml"
    code, out, err = call(answers(), "-o", str(new))
    assert code == 0
    assert out.splitlines()[-2:] == ["verdict: pass (Monte Carlo)", f"next: tailstack verify {new}"]
    assert err.splitlines() == [
        "note: [floor] moving fiducials cannot bring P95 below 0.98 mm",
        f"wrote {tmp_path / SCHEMA}, with which editors complete and check YAML (docs/editors.md)",
        f"wrote {new}",
    ]
    assert new.read_text(encoding="utf-8").startswith(f"# yaml-language-server: $schema={SCHEMA}\n")
    assert yaml.safe_load(new.read_text(encoding="utf-8")) == NEW_DESIGN
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.yaml", SCHEMA]


def test_without_a_file_it_says_how_to_write_the_design_that_was_found(call: Any) -> None:
    _, out, _ = call(answers())
    assert out.splitlines()[-1].endswith(" -o NEW.yaml   (writes the new design)")


def test_json_holds_the_document_alone(call: Any, tmp_path: Path) -> None:
    new = tmp_path / "new.json"
    code, out, err = call(answers(), "-o", str(new), "--json")
    assert code == 0
    assert json.loads(out)["design"] == json.loads(new.read_text(encoding="utf-8")) == NEW_DESIGN
    assert err.splitlines()[-1] == f"next: tailstack verify {new}"


@pytest.mark.parametrize(("status", "code"), [("pass", 0), ("inconclusive", 4)])
def test_the_verdict_is_the_exit_code(call: Any, status: str, code: int) -> None:
    checked = replace(RESULT.certificate, verification=verification(status))
    assert call(answers(replace(RESULT, certificate=checked)))[0] == code


def test_the_options_reach_the_optimiser(call: Any) -> None:
    seen: dict[str, Any] = {}

    def optimise(design: Any, **options: Any) -> Optimisation:
        seen.update(options, name=design.name)
        return RESULT

    assert call(optimise, "--seed", "5", "--starts", "3", "--gap", "1%")[0] == 0
    assert (seen["seed"], seen["starts"], seen["gap"], seen["name"]) == (5, 3, 0.01, NEW_DESIGN["name"])


# --- files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["missing/new.yaml", "new.txt", "folder.yaml"])
def test_files_that_cannot_be_written_are_refused_before_the_work(refused: Any, tmp_path: Path, name: str) -> None:
    def never(*_: Any, **__: Any) -> Optimisation:
        raise AssertionError("the work was begun")

    (tmp_path / "folder.yaml").mkdir()
    assert "next: tailstack optimise --help" in refused(never, "-o", str(tmp_path / name))


def test_a_write_that_fails_leaves_what_was_there(call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new = tmp_path / "new.yaml"
    new.write_text("precious", encoding="utf-8")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    code, out, err = call(answers(), "-o", str(new), "--force")
    assert (code, out) == (3, "")
    assert "No space left" in err
    assert new.read_text(encoding="utf-8") == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["new.yaml"]


# --- signals, in process --------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_keeps_what_was_found(call: Any, tmp_path: Path, number: int) -> None:
    new = tmp_path / "new.yaml"
    code, out, err = call(interrupted(number, lambda: RESULT), "-o", str(new))
    assert code == 130
    assert "verdict: pass (Monte Carlo)" in out
    assert err.count(STOPPING) == 1
    assert yaml.safe_load(new.read_text(encoding="utf-8")) == NEW_DESIGN


@pytest.mark.parametrize(("reason", "code"), [("stopped", 130), ("not-verified", 3)])
def test_a_signal_before_anything_converged_is_130_with_the_reason_and_another_failure_keeps_its_own_code(
    call: Any, tmp_path: Path, reason: str, code: int
) -> None:
    new = tmp_path / "new.yaml"
    left, out, err = call(interrupted(signal.SIGINT, refused(reason)), "-o", str(new))
    assert (left, out) == (code, "")
    assert "nothing had converged" in err
    assert not new.exists()


def test_the_second_signal_leaves_at_once(call: Any, tmp_path: Path) -> None:
    def second() -> Optimisation:
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("the second signal was ignored")

    new = tmp_path / "new.yaml"
    code, out, err = call(interrupted(signal.SIGTERM, second), "-o", str(new))
    assert (code, out) == (130, "")
    assert err.splitlines()[-2:] == [STOPPING, "tailstack: interrupted"]
    assert not new.exists()


# --- progress -------------------------------------------------------------------------------------


def test_the_incumbent_is_named_for_what_it_is() -> None:
    progress = Progress("optimise")
    reporter(progress, "quantile")("start", 2, 8, 0.98765432)
    assert progress.detail == "start 2 of 8, least quantile over limit so far 0.98765"


def test_the_incumbent_never_gets_worse() -> None:
    """Each number of fiducials has a search of its own; the line tells the best of them all."""
    progress = Progress("optimise")
    report = reporter(progress, "cost")
    for done, least in enumerate((1600.0, 1595.5, 1610.0), start=1):
        report("start", done, 4, least)
    assert progress.detail == "start 3 of 4, least cost so far 1595.5"
    report("start", 4, 4, None)
    assert progress.detail == "start 4 of 4"


# --- real processes -------------------------------------------------------------------------------


@pytest.mark.long
def test_an_interrupted_search_is_checked_and_written(tmp_path: Path) -> None:
    """A long search, as far as a progress line that says something."""
    command = (*TAILSTACK, "optimise", DEMO, "--starts", "256", "-o", tmp_path / "new.yaml")
    with started(*command, env=environment(tmp_path)) as process:
        read_until(", least cost so far ", process.stderr)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=LIMIT_SECONDS)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert STOPPING in err
    assert "verdict: pass (Monte Carlo)" in out
    assert re.search(r"stopped\s+on\s+request\s+after\s+\d+\s+of\s+256\s+starts", out)
    new = load_design(tmp_path / "new.yaml")
    assert new.document.optimise is not None
    assert main(["score", str(tmp_path / "new.yaml")]) in (0, 4)
