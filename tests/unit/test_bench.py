"""What ``./run bench`` says of a measurement: the load by others, the marks of a row, the order of its table."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from family import read_until, run_process, started
from scenes import system_of
from tailstack import __version__
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from waiting import LIMIT_SECONDS

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
BURN = "import sys, time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\nsys.stdin.read()"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The module as the command runs it; nothing of it is left for other tests."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield import_module("bench")
    del sys.modules["bench"]


def test_others_are_what_the_machine_computed_and_we_did_not(bench: ModuleType) -> None:
    before = bench.Processors(elapsed=100.0, machine=50.0, ours=7.0)
    after = bench.Processors(elapsed=110.0, machine=65.0, ours=17.0)
    assert bench.foreign_share(before, after, 2) == pytest.approx(0.25)  # 5 s of 2 x 10 s
    before, after = bench.Processors(0.0, 0.0, 0.0), bench.Processors(1.0, 0.99, 1.0)
    assert bench.foreign_share(before, after, 1) == 0.0


def test_what_a_child_computes_is_ours_while_it_runs_and_after_it_has_ended(bench: ModuleType) -> None:
    before = bench.read_processors()
    with started(sys.executable, "-c", BURN, stdin=subprocess.PIPE) as child:
        read_until("\n", child.stdout)
        running = bench.read_processors()
        child.communicate(timeout=LIMIT_SECONDS)
    after = bench.read_processors()
    assert running.ours - before.ours > 0.28
    assert after.ours - running.ours > -0.03  # counted once, in ticks of a hundredth of a second
    assert after.machine > before.machine


def test_a_row_says_what_it_met_and_is_marked_when_others_took_more_than_a_twentieth(bench: ModuleType) -> None:
    target = bench.Target("something against another", 10, 20)
    assert bench.Row(target, 12.0, foreign=0.05).verdict == "must"
    assert bench.Row(target, 25.0, foreign=0.06).verdict == "aim, loaded"
    assert bench.Row(target, 9.0, foreign=0.5).verdict == "MISSED, loaded"
    assert bench.Row(target, 9.0, foreign=0.5, timed=False).verdict == "MISSED"
    assert bench.Row(target, None).verdict == "not built"
    target = bench.Target("cost above a peer's", 0.2, 0, "%", "<")
    assert [bench.Row(target, value).verdict for value in (0.3, 0.1, -0.1)] == ["MISSED", "must", "aim"]
    target = bench.Target("something against another", 10, 20)
    assert bench.must_fail([bench.Row(target, 12.0), bench.Row(target, 9.0)])
    assert not bench.must_fail([bench.Row(target, 12.0), bench.Row(target, 9.0, foreign=0.3), bench.Row(target, None)])


def test_a_line_holds_what_was_measured_the_bars_and_the_load(bench: ModuleType) -> None:
    line = bench.write_row(bench.Row(bench.Target("something against another", 10, 20), 12.345, foreign=0.031))
    assert line.split("  ")[0] == "something against another"
    assert [part.strip() for part in line[78:].split("  ") if part.strip()] == [
        "12.35 ×", ">= 10", ">= 20", "3 %", "must",
    ]  # fmt: skip
    assert bench.write_row(bench.Row(bench.Target("a million designs"), None)).endswith("not built")
    (row,) = bench.Measurement(lambda: None, (bench.Target("a thing", 100),)).rows(bench.Findings([None]))
    assert bench.write_row(row).endswith("not built")
    assert not bench.must_fail([row])


def test_what_is_saved_can_be_read_back_row_by_row(bench: ModuleType) -> None:
    target = bench.Target("something against another", 10, 20)
    rows = [("one", bench.Row(target, 12.34567, foreign=0.2)), ("two", bench.Row(target, None))]
    kept = json.loads(bench.write_history(rows))
    assert kept["version"] == __version__
    same = {"what": target.what, "must": 10, "aim": 20, "unit": "×", "better": ">"}
    assert kept["rows"] == [
        {"name": "one", "value": 12.35, "loaded": True, **same},
        {"name": "two", "value": None, "loaded": False, **same},
    ]


def test_a_round_gives_seconds_an_item_and_ratios_within_rounds(bench: ModuleType) -> None:
    calls: list[str] = []

    def job(name: str) -> int:
        calls.append(name)
        return 4

    rounds = bench.interleave({"a": lambda: job("a"), "b": lambda: job("b")}, rounds=3)
    assert calls == ["a", "b"] * 3
    assert [len(spent) for spent in (*rounds.cpu.values(), *rounds.wall.values())] == [3] * 4
    fixed = bench.Rounds({"a": [2.0, 30.0, 8.0], "b": [1.0, 10.0, 2.0]}, {}, 0.0)
    assert fixed.ratio("a", "b") == 3.0


@pytest.mark.long
def test_every_row_has_a_name_and_can_be_measured_by_the_modules_there_are() -> None:
    """``--help`` imports whatever is measured, and lists the targets in their order."""
    done = call("--help")
    assert done.returncode == 0, done.stderr
    names = [line.split()[0] for line in done.stdout.partition("rows by name:\n")[2].splitlines()]
    assert list(dict.fromkeys(names)) == [
        "trials", "pose", "pose-with-prior", "reprojection", "agreement", "threads", "precision", "first-order",
        "losses", "allocations", "designs", "workspace", "memory", "designs-memory", "people-tables", "fiducials",
        "optimiser", "post", "drag", "api-processes", "unit", "first-score", "start", "gate", "growth", "report",
    ]  # fmt: skip
    refused = call("trails")
    assert refused.returncode == 2
    assert "nothing is called trails" in refused.stderr


def test_the_operations_of_a_trial_are_counted_in_the_kernel_itself(bench: ModuleType) -> None:
    operations = import_module("operations")
    places = np.random.default_rng(4).uniform((-50, -50, -90), (50, 50, 10), (16, 3))
    few, more = (operations.count_operations(system_of(places[:count])) for count in (8, 16))
    assert set(few) == {"doubles", "divisions", "roots", "integers", "choices"}
    # per fiducial and view: 19 moments with 2 products of images; and a normal pair in each view
    assert 8 * 2 * 28 < more["doubles"] - few["doubles"] < 8 * 2 * 150
    assert more["roots"] - few["roots"] == 8 * 2  # a radius for each pair of normal deviates
    assert run_indices(compile_plan(system_of(places)), 1, 0, 8).errors.shape[-1] == 8  # and the kernel is back


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command without its environment of its own."""
    return run_process(sys.executable, BENCHMARKS / "measurements.py", *arguments, env=None)
