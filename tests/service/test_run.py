"""The one entry: what ./run does before and around what it is asked for, and its demo."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import cast

import psutil
import pytest
import yaml
from jsonschema import Draft202012Validator
from service_scenes import EXAMPLES, ROOT

from family import COMMAND, SOURCES, TAILSTACK, read_until, run_python, started
from tailstack_service.cli import demo
from tailstack_service.cli.demo import demo_text
from tailstack_service.cli.main import main
from tailstack_service.console.remote import RemoteError, RemoteService
from tailstack_service.schemas import json_schema
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS, until

NOISE = "Collecting everything; 17 warnings about nothing"

INSTALLER = """#!/bin/sh
echo "$(basename "$0") $*" >> "{folder}/calls"
echo "{noise}"
case "$*" in
  venv*) mkdir -p "{folder}/.venv/bin"; cp "{folder}/tools/python" "{folder}/.venv/bin/python";;
  *"{failing}"*) echo "hash mismatch"; exit 7;;
esac
"""

PYTHON = """#!/bin/sh
echo "python $*" >> "{folder}/calls"
case "$*" in
  *warm-up*) echo "compiling kernels: 3 of 9" >&2;;
  *"pip install"*) echo "{noise}";;
  *demo*) echo "the demo";;
esac
"""


class Clone:
    """A folder with ./run and lock files of two packages, and what it called."""

    def __init__(self, folder: Path, failing: str = "nothing", uv: bool = True) -> None:
        self.folder = folder
        (folder / "tools").mkdir()
        shutil.copy(ROOT / "run", folder / "run")
        (folder / "pyproject.toml").touch()
        (folder / "requirements-core.lock").write_text("numpy==1 \\\n    --hash=sha256:1\n    # via x==3\n")
        text = "numpy==1 ; python_version < '3'\nnumpy==2 \\\n    --hash=sha256:1\ncasadi==3\nrich-click==1.0\n"
        (folder / "requirements-run.lock").write_text(text)
        self._write("python", PYTHON.format(folder=folder, noise=NOISE))
        if uv:
            self._write("uv", INSTALLER.format(folder=folder, noise=NOISE, failing=failing))
        else:
            (folder / ".venv" / "bin").mkdir(parents=True)
            shutil.copy(folder / "tools" / "python", folder / ".venv" / "bin" / "python")

    def _write(self, name: str, text: str) -> None:
        file = self.folder / "tools" / name
        file.write_text(text)
        file.chmod(0o755)

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        path = f"{self.folder / 'tools'}{os.pathsep}/usr/bin{os.pathsep}/bin"
        return run_python(str(self.folder / "run"), *arguments, env={"PATH": path})

    def calls(self) -> list[str]:
        return (self.folder / "calls").read_text().splitlines()


def test_each_stage_is_one_line_the_installer_is_silent_and_kernels_are_compiled_meanwhile(tmp_path: Path) -> None:
    clone = Clone(tmp_path)
    done = clone.run("demo")
    assert done.stdout == "the demo\n"
    stages = [line.rpartition(" ... ")[0] or line for line in done.stderr.splitlines()]  # without seconds at their end
    assert stages == [
        "run: creating the environment (uv)",
        "run: installing 1 packages (uv)",
        "run: installing 2 packages (uv)",
        "run: installing tailstack",
        "run: compiling the last kernels",
    ]
    locks = [call for call in clone.calls() if "requirements-" in call]
    assert len(locks) == 2
    assert all("--require-hashes" in call for call in locks)
    calls = [call.split(str(tmp_path))[-1] if "requirements" in call else call for call in clone.calls()]
    core, compiling = calls.index("/requirements-core.lock"), [i for i, call in enumerate(calls) if "warm-up" in call]
    assert compiling
    assert core < compiling[0]
    assert "--for demo" in calls[compiling[0]]
    assert clone.calls()[-1].endswith("__main__.py demo")  # nobody starts before the kernels are there


def test_another_command_installs_and_compiles_nothing_ahead(tmp_path: Path) -> None:
    clone = Clone(tmp_path)
    assert clone.run("tailstack", "version").returncode == 0
    assert not any("warm-up" in call or "requirements-core" in call for call in clone.calls())
    before = len(clone.calls())
    assert clone.run("tailstack", "version").stderr == ""
    assert len(clone.calls()) == before + 1  # the second time there is nothing to install


def test_what_an_installer_says_is_shown_whole_when_it_fails(tmp_path: Path) -> None:
    clone = Clone(tmp_path, failing="requirements-run")
    done = clone.run("serve")
    assert done.returncode != 0
    assert NOISE in done.stderr
    assert "hash mismatch" in done.stderr
    assert "Traceback" not in done.stderr
    assert "failed with exit code 7" in done.stderr.splitlines()[-1]
    assert not list((tmp_path / ".venv").glob("installed-*"))


@pytest.mark.parametrize("command", ["demo", "serve"])
def test_without_uv_it_is_pip(tmp_path: Path, command: str) -> None:
    clone = Clone(tmp_path, uv=False)
    done = clone.run(command)
    assert "packages (pip)" in done.stderr
    assert NOISE not in done.stderr
    assert any("-m pip install" in call and "--require-hashes" in call for call in clone.calls())


# --- the demo, end to end and interrupted ---------------------------------------------------------


@pytest.mark.long
def test_the_demo_does_the_whole_job_and_prints_the_lines_that_matter(tmp_path: Path) -> None:
    """Ten lines and the next command; the numbers are those of the documents that it wrote."""
    done = run_python(*COMMAND, "demo", "-o", "out", cwd=tmp_path, said={"PYTHONPATH": os.pathsep.join(sys.path)})
    assert done.returncode == 0, done.stderr
    written = tmp_path / "out"
    assert sorted(path.name for path in written.iterdir()) == [
        "optimisation.json", "optimised.yaml", "report.html", "score.json", "tailstack-design.schema.json",
        "verification.json", "worker.log",
    ]  # fmt: skip
    assert "Traceback" not in (written / "worker.log").read_text()
    records = {}
    for name in ("score", "verification", "optimisation"):
        records[name] = json.loads((written / f"{name}.json").read_bytes())
        Draft202012Validator(json_schema(name)).validate(records[name])
    assert yaml.safe_load((written / "optimised.yaml").read_text()) == records["optimisation"]["design"]
    assert records["optimisation"]["cost_after"] < records["optimisation"]["cost_before"]
    assert main(["score", str(written / "optimised.yaml")]) in (0, 4)

    lines = done.stdout.splitlines()
    assert len(lines) <= 11
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80
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
    command = (*TAILSTACK, "demo", "-o", tmp_path)
    with started(*command, stdout=subprocess.DEVNULL, env=variables, start_new_session=True) as process:
        until((tmp_path / "verification.json").exists)  # the optimiser is next
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
    with started(*TAILSTACK, "demo", "-o", tmp_path / "demo", env=variables) as process:
        read_until("compiling the kernels", process.stderr)
        family = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_SECONDS)
        assert process.returncode == 130, err
        assert "interrupted" in err
        assert "POST" not in err  # nothing was asked of a service that had compiled
        assert not psutil.wait_procs(family, timeout=LIMIT_SECONDS)[1]
