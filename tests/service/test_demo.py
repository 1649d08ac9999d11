"""The demo, end to end: over HTTP on an embedded service, and interrupted in the middle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import cast

import psutil
import pytest
import yaml
from jsonschema import Draft202012Validator
from service_scenes import EXAMPLES

from family import COMMAND, SOURCES, TAILSTACK, read_until, run_python, started
from tailstack_service.cli import demo
from tailstack_service.cli.demo import demo_text
from tailstack_service.cli.main import main
from tailstack_service.console.remote import RemoteError, RemoteService
from tailstack_service.schemas import json_schema
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS


@pytest.mark.long
def test_the_demo_does_the_whole_job(tmp_path: Path, capsys: pytest.CaptureFixture[str], loggers: None) -> None:
    assert main(["demo", "--full", "-o", str(tmp_path / "out" / "demo")]) == 0
    out, err = capsys.readouterr()
    written = tmp_path / "out" / "demo"
    assert sorted(path.name for path in written.iterdir()) == [
        "optimisation.json", "optimised.yaml", "report.html", "score.json", "tailstack-design.schema.json",
        "verification.json", "worker.log",
    ]  # fmt: skip
    assert (written / "report.html").read_text(encoding="utf-8").lower().startswith("<!doctype html")
    assert "Traceback" not in (written / "worker.log").read_text()
    documents = {}
    for name in ("score", "verification", "optimisation"):
        documents[name] = json.loads((written / f"{name}.json").read_bytes())
        Draft202012Validator(json_schema(name)).validate(documents[name])
    assert yaml.safe_load((written / "optimised.yaml").read_text()) == documents["optimisation"]["design"]
    for title in ("Estimate", "Check by simulation", "Optimised: ", "Before -> after", str(written)):
        assert title in out
    assert max(len(line) for line in out.splitlines() if str(tmp_path) not in line) <= 100
    assert "verdict: pass (Monte Carlo)" in out[out.index("Before -> after") :]
    assert "stopping the service" in err
    assert documents["optimisation"]["cost_after"] < documents["optimisation"]["cost_before"]
    assert main(["score", str(written / "optimised.yaml")]) in (0, 4)


@pytest.mark.long
def test_the_demo_prints_the_lines_that_matter(tmp_path: Path) -> None:
    """Ten lines and the next command; the numbers are those of the documents that it wrote."""
    done = run_python(*COMMAND, "demo", "-o", "out", cwd=tmp_path, said={"PYTHONPATH": os.pathsep.join(sys.path)})
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) <= 11
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80
    records = {
        name: json.loads((tmp_path / "out" / f"{name}.json").read_bytes()) for name in ("verification", "optimisation")
    }
    p95 = records["verification"]["targets"][0]["p95_mm"]
    [was], [now] = ([line for line in lines if line.startswith(word)] for word in ("before:", "after:"))
    assert "fail" in was
    assert f"{p95:.3f} mm" in was
    assert "pass" in now
    assert "limit 1 mm" in now
    text = " ".join(done.stdout.split())
    for one in records["optimisation"]["tolerances"]:
        assert f"±{one['before_half_width']:.2g} -> ±{one['after_half_width']:.2g}" in text
    cost = records["optimisation"]["cost_after"] / records["optimisation"]["cost_before"] - 1
    assert f"({100 * cost:+.0f} %)" in text
    report = Path(next(line for line in lines if line.startswith("report:")).split(maxsplit=1)[1])
    assert report.read_text(encoding="utf-8").lower().startswith("<!doctype html")
    assert "POST /v1/scores\n" not in done.stderr  # steps are told in one line that is written anew, or now and then


def test_the_design_of_the_demo_is_the_example() -> None:
    assert demo_text() == (EXAMPLES / "demo.yaml").read_text(encoding="utf-8")


@pytest.mark.long
def test_an_interrupted_demo_leaves_nothing_behind(tmp_path: Path) -> None:
    variables = {**os.environ, "PYTHONPATH": SOURCES, "OMP_NUM_THREADS": "1"}
    command = (*TAILSTACK, "demo", "--full", "-o", tmp_path)
    with started(*command, stdout=subprocess.DEVNULL, env=variables, start_new_session=True) as process:
        read_until("POST /v1/optimisations", process.stderr)
        family = psutil.Process(process.pid).children(recursive=True)
        assert family  # the worker, and what computes for it
        process.send_signal(signal.SIGINT)
        _, rest = process.communicate(timeout=LIMIT_SECONDS)
        assert process.returncode == 130
        assert "Traceback" not in rest
        _, alive = psutil.wait_procs(family, timeout=LIMIT_SECONDS)
        assert not alive
        with pytest.raises(ProcessLookupError):  # nobody is left in its process group
            os.killpg(process.pid, 0)


class Compiling:
    """Stands for a service that is not ready for a while, by a clock that goes on only while one sleeps."""

    def __init__(self, seconds: float) -> None:
        self.clock, self.seconds = TurnedClock(jumping=True), seconds

    def ask(self, *_: object) -> None:
        if self.clock.passed < self.seconds:
            raise RemoteError("", "", 503, ())


def test_waiting_for_the_kernels_is_told_once_and_then_seldom() -> None:
    """By hand: a first word after 3 s, others every 20 s: at 23, 43 and 63."""

    def told_of(compiled: float, **limit: float) -> list[str]:
        told: list[str] = []
        compiling = Compiling(compiled)
        demo.wait_until_ready(cast(RemoteService, compiling), told.append, clock=compiling.clock, **limit)
        return told

    assert told_of(2.0) == []
    first, *others = told_of(80.0)
    assert first.startswith("compiling the kernels: about two minutes the first time")
    assert others == ["still compiling"] * 3
    with pytest.raises(RemoteError):
        told_of(60.0, seconds=10.0)


@pytest.mark.long
def test_a_demo_interrupted_while_it_compiles_ends_at_once(tmp_path: Path) -> None:
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(sys.path)}
    (tmp_path / "cache").mkdir()
    with started(*TAILSTACK, "demo", "--full", "-o", tmp_path / "demo", env=variables) as process:
        assert process.stderr is not None
        assert "starting the service" in process.stderr.readline()
        assert "compiling the kernels" in process.stderr.readline()
        family = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_SECONDS)
        assert process.returncode == 130, err
        assert "interrupted" in err
        assert "POST" not in err  # nothing was asked of a service that had compiled
        assert not psutil.wait_procs(family, timeout=LIMIT_SECONDS)[1]
