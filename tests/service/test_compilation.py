"""Kernels that are missing: compiled in processes beside, counted aloud, kept where that is possible."""

from __future__ import annotations

import io
import json
import os
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from family import started
from tailstack.kernels import calls
from tailstack_service.console.compilation import CAUTION, CompilationProgress
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS

# Three that take a moment, as if a verb needed no others
PROGRAM = """
import json, sys
import numpy as np
from tailstack_service.console import compilation, progress
from tailstack.kernels import calls, store
from tailstack.kernels.process import prepare_with
progress.QUIET_SECONDS = 0.01
few = ("tail.lattice.balls", "tail.spectrum._law_fault", "tail.declared.column_slopes")
calls.calls_for = lambda _: tuple(call for call in calls.EVERY if call.kernel in few)
prepare_with(lambda: compilation.compile_for(["score"]))
from tailstack.tail.lattice import balls
from tailstack.tail.spectrum import _law_fault
balls(1.0, np.array([0.5])); _law_fault(np.zeros(3), np.eye(3))
print(json.dumps([store.TRAFFIC.compiled, store.TRAFFIC.loaded]))
"""


@contextmanager
def running(place: Path, **variables: str) -> Iterator[subprocess.Popen[str]]:
    """The program; it ends with the block."""
    given = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    given |= {"HOME": str(place), "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **variables}
    with started(sys.executable, "-c", PROGRAM, env=given) as process:
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


HEAD = "compiling kernels, once on this machine:"


def test_a_time_is_named_from_the_first_moment_to_the_last_kernel() -> None:
    """closed_form: before anything is measured, the table's seconds on a machine that is taken for a slow one."""
    wanted = calls.calls_for(("optimise",))
    clock = TurnedClock()
    progress = CompilationProgress(wanted, 2, "", io.StringIO(), clock=clock)
    total = sum(call.seconds for call in wanted)
    assert progress.line() == f"{HEAD} 0 of 3, about {total / 2 / CAUTION:.0f} s"
    for call in wanted:
        progress.begin(call)
        progress.note(call)
    assert progress.line() == f"{HEAD} 3 of 3"


def waited(seed: int) -> tuple[int, list[int]]:
    """How long all kernels take on a machine that is drawn, s, and what is named at each second.

    One to four processes, each a fifth to three halves as fast as the table's, each kernel by a factor of its own
    (standard deviation 0.3 of its logarithm), and up to 6 s before a process begins.
    """
    draw = random.Random(seed)
    waiting = list(calls.calls_for(calls.COMPUTATIONS))
    processes, pace, start = draw.choice([1, 2, 2, 4]), draw.uniform(0.2, 1.5), draw.uniform(0, 6)
    clock = TurnedClock()
    progress = CompilationProgress(waiting.copy(), processes, "", io.StringIO(), clock=clock)
    running: dict[calls.KernelCall, float] = {}

    def begin(delay: float) -> None:
        call = waiting.pop(0)
        progress.begin(call)
        running[call] = clock.monotonic() + delay + call.seconds / pace * draw.lognormvariate(0, 0.3)

    for _ in range(processes):
        begin(start)
    named = []
    while running:
        found = re.search(r"about (\d+) s$", progress.line())
        assert found is not None, "a time that was named never goes"
        named.append(int(found[1]))
        clock.turn(1.0)
        for call in [call for call, end in running.items() if end <= clock.monotonic()]:
            progress.note(call)
            del running[call]
            if waiting:
                begin(0.0)
    return len(named), named


def test_the_time_left_never_rises_and_comes_true() -> None:
    """On a hundred machines; their seeds are fixed, so that the means, measured as 0.19 and 0.11, are always these."""
    off: dict[float, list[float]] = {0.5: [], 0.75: []}
    for seed in range(100):
        seconds, named = waited(seed)
        assert named == sorted(named, reverse=True)
        for part, errors in off.items():
            at = int(part * seconds)
            errors.append(abs(named[at] - (seconds - at)) / seconds)
    assert fmean(off[0.5]) < 0.2
    assert fmean(off[0.75]) < 0.12


def test_an_unknown_verb_is_refused_with_those_that_there_are(refused: Any) -> None:

    assert "there is no verb 'scre'" in refused("warm-up", "--for", "scre")
