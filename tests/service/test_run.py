"""./run on a machine that has nothing yet: what it says, what installs, and what is shown when that fails.

The installers here are scripts that note how they were called; nothing is installed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from service_scenes import ROOT

from family import run_python

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


def stages(stderr: str) -> list[str]:
    """The lines of ./run, without the seconds at their end."""
    return [line.rpartition(" ... ")[0] or line for line in stderr.splitlines()]


def test_each_stage_is_one_line_and_the_installer_is_silent(tmp_path: Path) -> None:
    clone = Clone(tmp_path)
    done = clone.run("demo")
    assert done.stdout == "the demo\n"
    assert stages(done.stderr) == [
        "run: creating the environment (uv)",
        "run: installing 1 packages (uv)",
        "run: installing 2 packages (uv)",
        "run: installing tailstack",
        "run: compiling the last kernels",
    ]
    locks = [call for call in clone.calls() if "requirements-" in call]
    assert len(locks) == 2
    assert all("--require-hashes" in call for call in locks)


def test_kernels_of_the_demo_are_compiled_while_the_rest_is_installed(tmp_path: Path) -> None:
    clone = Clone(tmp_path)
    clone.run("demo")
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
