"""Kernels that are missing: compiled in processes beside, counted aloud, kept where that is possible."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from family import die_with_parent, ended
from tailstack import ahead
from tailstack_service.console.compilation import CompilationProgress
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS

# Three that take a moment, as if a verb needed no others
PROGRAM = """
import json, sys
import numpy as np
from tailstack_service.console import compilation, progress
from tailstack import ahead, kernels
from tailstack.preparation import prepare_with
progress.QUIET_SECONDS = 0.01
few = ("tail.lattice.balls", "tail.spectrum._law_fault", "tail.declared.column_slopes")
ahead.calls_for = lambda _: tuple(call for call in ahead.EVERY if call.kernel in few)
prepare_with(lambda: compilation.compile_for(["score"]))
from tailstack.tail.lattice import balls
from tailstack.tail.spectrum import _law_fault
balls(1.0, np.array([0.5])); _law_fault(np.zeros(3), np.eye(3))
print(json.dumps([kernels.TRAFFIC.compiled, kernels.TRAFFIC.loaded]))
"""


@contextmanager
def running(place: Path, **variables: str) -> Iterator[subprocess.Popen[str]]:
    """The program; it ends with the block."""
    given = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    given |= {"HOME": str(place), "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **variables}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=die_with_parent,
    )  # fmt: skip
    with ended(process):
        yield process


def run(place: Path, **variables: str) -> tuple[str, str]:
    with running(place, **variables) as process:
        return process.communicate(timeout=LIMIT_SECONDS)


def stored(place: Path) -> set[str]:
    return {path.name.rpartition("-")[0] for path in place.glob("*.kernel")}


@pytest.mark.long
def test_what_a_command_needs_is_compiled_once_and_counted(tmp_path: Path) -> None:
    out, err = run(tmp_path)
    assert json.loads(out) == [0, 2], err  # none here: other processes did it
    assert re.fullmatch(r"(compiling kernels, once on this machine: [0-3] of 3(, about \d+ s)?\n)+", err), err
    assert stored(tmp_path / ".cache" / "tailstack" / "kernels") >= {"tail.lattice.balls", "tail.spectrum._law_fault"}
    out, err = run(tmp_path)
    assert (json.loads(out), err) == ([0, 2], "")


@pytest.mark.long
def test_two_first_commands_at_once_leave_whole_files(tmp_path: Path) -> None:
    cache = str(tmp_path / "cache")
    with running(tmp_path, XDG_CACHE_HOME=cache) as one, running(tmp_path, XDG_CACHE_HOME=cache) as other:
        said = [process.communicate(timeout=LIMIT_SECONDS)[0] for process in (one, other)]
    assert [json.loads(out) for out in said] == [[0, 2], [0, 2]]
    place = tmp_path / "cache" / "tailstack" / "kernels"
    assert not list(place.glob(".*"))
    assert stored(place) >= {"tail.lattice.balls", "tail.spectrum._law_fault", "tail.declared.column_slopes"}


@pytest.mark.long
def test_without_a_place_to_keep_them_they_are_compiled_beside_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "home").touch()  # no folder can be made in it
    out, err = run(tmp_path / "home", TMPDIR=str(tmp_path))
    assert json.loads(out) == [0, 2], err
    assert err.count("cannot be written") == 1
    assert "set NUMBA_CACHE_DIR" in err
    assert [path.name for path in tmp_path.iterdir()] == ["home"]  # what was lent is gone


def test_an_eta_is_given_from_the_first_moment() -> None:
    """closed_form: shares of the table's seconds; before the first kernel is done they are the only guide."""
    calls = ahead.calls_for(("optimise",))
    clock = TurnedClock()
    reason = "those installed were built from other sources"
    progress = CompilationProgress(calls, 2, reason, io.StringIO(), clock=clock)
    total = sum(call.seconds for call in calls)
    head = "compiling kernels, once on this machine:"
    assert progress.line() == f"{head} 0 of 3, about {total / 2:.0f} s"
    for call in calls[:2]:
        progress.begin(call)
    clock.turn(100.0)  # a slow machine: how long the rest takes is not known before something is done
    assert progress.line() == f"{head} 0 of 3"
    progress.note(calls[1])
    done = calls[1].seconds + 0.5 * calls[0].seconds
    assert progress.line() == f"{head} 1 of 3, about {100.0 * (total / done - 1.0):.0f} s"
    progress.note(calls[0])
    progress.begin(calls[2])
    progress.note(calls[2])
    assert progress.line() == "compiling kernels, once on this machine: 3 of 3"


def test_the_time_left_never_rises_while_one_waits() -> None:
    """Kernels that take 4 s each by the table, two at once, on a machine that takes twenty times as long."""
    call = ahead.EVERY[0]
    calls = [replace(call, seconds=4.0) for _ in range(6)]
    clock = TurnedClock()
    progress = CompilationProgress(calls, 2, "", io.StringIO(), clock=clock)

    for done in range(5):
        progress.begin(calls[done])
        said = []
        for _ in range(80):
            if found := re.search(r"about (\d+) s", progress.line()):
                said.append(int(found[1]))
            clock.turn(1.0)
        assert said == sorted(said, reverse=True)
        assert len(said) > 1
        progress.note(calls[done])


def test_an_unknown_verb_is_refused_with_those_that_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    from tailstack_service.cli.main import main

    assert main(["warm-up", "--for", "scre"]) == 2
    assert "there is no verb 'scre'" in capsys.readouterr().err
