"""A repository of designs may hold anything: no module, folder or setting in it is taken for one of ours, and what
keeps a gate from beginning is no verdict.

Modules called like those that a gate imports lie in the checkout; who takes one of them leaves with 77.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from pipeline_scenes import (
    EXAMPLE,
    call,
    environment,
    git,
    inputs,
    interpolated,
    python_with_libraries,
    repository,
    run_job,
    run_step,
    shipped,
)
from service_scenes import ROOT

from family import run_python
from tailstack.kernels import process
from tailstack_service.processes.birth import make_command, make_environment

TAKEN = 77
OURS = ("tailstack", "tailstack_service", "tailstack_kernels")
OTHERS = ("pip", "venv", "ensurepip", "sitecustomize", "usercustomize", "conftest", "hatchling", "editables", "uv")
LIST = """
import sys
from tailstack_service.cli.main import main
main(["gate", *sys.argv[1:], "--mode", "verify", "--format=text=" + __import__("os").devnull])
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""


@cache
def list_imported() -> tuple[str, ...]:
    """Every module that a gate which draws has imported, by its first name, and those of the installation."""
    done = run_python("-P", "-c", LIST, str(EXAMPLE / "pass.yaml"), env=environment(), check=True)
    found = {name for name in done.stdout.splitlines()[-1].split() if name.isidentifier() and name != "__main__"}
    return (*sorted(found | {*OURS, *OTHERS, "json", "http", "numbers", "platform", "runpy"}),)


def plant(folder: Path) -> int:
    """What a merge request may add: as many modules as are imported, half of them folders, and settings of tools."""
    text = f"import posix\nposix._exit({TAKEN})\n"
    for number, name in enumerate(list_imported()):
        if number % 2 or name in OURS:
            (folder / name / "cli").mkdir(parents=True)
            for place in ("", "cli", "__main__.py", "cli/main.py"):
                file = folder / name / place
                (file if file.suffix else file / "__init__.py").write_text(text, encoding="utf-8")
        else:
            (folder / f"{name}.py").write_text(text, encoding="utf-8")
    kernels = folder / "kernels"
    kernels.mkdir()
    (folder / process.SETTINGS_OF_FOLDER).write_text(f"cache_dir: {kernels}\ndisable_jit: 1\n", encoding="utf-8")
    for name, body in {
        "uv.toml": "[pip]\nno-index = true\ntarget = 'elsewhere'\n",
        "pyproject.toml": "[tool.uv.pip]\nno-index = true\ntarget = 'elsewhere'\n",
        "pip.conf": "[global]\nno-index = true\ntarget = elsewhere\n",
        "setup.cfg": "[install]\nprefix = elsewhere\n",
        "pyvenv.cfg": "home = /nowhere\n",
        ".venv/pyvenv.cfg": "home = /nowhere\n",
        "evil.pth": f"import posix; posix._exit({TAKEN})\n",
        "startup.py": text,
    }.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(body, encoding="utf-8")
    return len(list_imported())


# What a job's variables may say of Python, from a project's own habits
HABITS = {"PYTHONPATH": ".", "PYTHONSTARTUP": "startup.py", "VIRTUAL_ENV": ".venv"}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The worked example with everything planted in it, and committed."""
    folder = repository(tmp_path / "guides")
    assert plant(folder) >= 40
    git(folder, "add", "--all", "--force")
    git(folder, "-c", "user.name=t", "-c", "user.email=t@example.com", "commit", "-q", "-m", "a merge request")
    return folder


OPTIONS = ("--policy=policy.yaml", "--waivers=waivers.yaml")


@pytest.mark.long
def test_the_command_takes_nothing_from_the_checkout(checkout: Path) -> None:
    """As pages write it; by the script that is installed; and what the hook of pre-commit calls."""
    script = str(Path(sys.executable).with_name("tailstack"))
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))
    program, *words = shlex.split(hook["entry"])
    for command, name, habits in (
        ((sys.executable, "-I", "-m", "tailstack", "gate", "--mode=verify"), "fail", HABITS),
        ((sys.executable, "-I", "-m", "tailstack_service", "gate", "--mode=analytic"), "pass", HABITS),
        ((script, "gate", "--mode=analytic"), "waived", {"PYTHONPATH": ""}),
        ((str(ROOT / program), *words), "fail", HABITS),
    ):
        done = call(checkout, *command, *OPTIONS, f"{name}.yaml", **habits)
        assert done.code == (name == "fail"), (command, name, done.said)
    assert not list((checkout / "kernels").iterdir())


def test_a_gate_is_the_same_in_a_checkout_that_shadows_everything(checkout: Path) -> None:
    done = call(checkout, str(ROOT / "run"), "gate", "--mode=analytic", *OPTIONS, "fail.yaml", **HABITS)
    assert done.code == 1, done.said


@pytest.mark.long
def test_the_action_takes_nothing_from_the_checkout(checkout: Path, tmp_path: Path, monkeypatch: Any) -> None:
    for name, value in HABITS.items():
        monkeypatch.setenv(name, value)
    room = tmp_path / "runner"
    python = python_with_libraries(room / "python")
    monkeypatch.setattr("pipeline_scenes.SOURCES", ".")
    done = run_step("install", inputs(designs="-", python=str(python)), checkout, room)
    assert done.code == 0, done.said
    given = {"policy": "policy.yaml", "waivers": "waivers.yaml", "mode": "analytic"}
    for name, code in (("pass", 0), ("fail", 1)):
        known = {**inputs(designs=f"{name}.yaml", **given), "steps.install.outputs.bin": done.outputs["bin"]}
        gated = run_step("gate", known, checkout, room)
        assert gated.code == code, gated.said
        assert gated.outputs["verdict"] == name


@pytest.mark.long
def test_the_template_takes_nothing_from_the_checkout(checkout: Path, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr("pipeline_scenes.SOURCES", ".")
    python = python_with_libraries(tmp_path / "python").parent
    source, commit = shipped(tmp_path / "shipped")
    given = {"source": source, "commit": commit, "policy": "policy.yaml", "waivers": "waivers.yaml", "mode": "analytic"}
    for name, code in (("pass", 0), ("fail", 1)):
        job = interpolated(**given, designs=f"{name}.yaml")["tailstack-gate"]
        job["variables"] |= {name: value for name, value in HABITS.items() if name != "PYTHONPATH"}
        done = run_job(job, checkout, ["bash", "-eo", "pipefail"], python)
        assert done.code == code, done.said


def test_health_checks_take_nothing_from_the_folder_of_the_data(checkout: Path) -> None:
    """Where nothing listens they say so with 1: ``http`` is the standard library's."""
    dockerfile = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
    compose = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
    tests = [json.loads(re.findall(r"^  CMD (\[.*\])$", dockerfile, re.M)[0])]
    tests += [service.get("healthcheck", {}).get("test", [])[1:] for service in compose["services"].values()]
    checks = {tuple(test) for test in tests if test[:1] == ["python"]}
    assert len(checks) == 2
    for _, *arguments, program in checks:
        done = call(checkout, sys.executable, *arguments, re.sub(r"\b8\d{3}\b", "9", program))
        assert done.code == 1
        assert "ConnectionRefusedError" in done.said


# --- processes that a process of ours starts ------------------------------------------------------------------------

PARENT = """
import os, subprocess, sys
from tailstack_service.processes.birth import make_command, make_environment
os.chdir(sys.argv[1])
sys.path[0] = {first}  # as python -m and an interactive Python have it, here after our own are loaded
command = make_command("tailstack_service", "gate", "fail.yaml", "--mode=analytic")
raise SystemExit(subprocess.run(command, env=make_environment()).returncode)
"""


@pytest.mark.parametrize("first", ["''", "os.getcwd()"])
def test_a_child_takes_no_modules_from_the_working_directory(checkout: Path, first: str) -> None:
    done = call(EXAMPLE, sys.executable, "-c", PARENT.format(first=first), str(checkout))
    assert done.code == 1, done.said


def test_the_path_of_a_child_is_that_of_its_parent_without_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = make_environment()["PYTHONPATH"].split(os.pathsep)
    monkeypatch.setattr(sys, "path", [str(tmp_path), "", *sys.path])
    assert make_environment()["PYTHONPATH"].split(os.pathsep) == before
    monkeypatch.chdir(ROOT / "solver")
    monkeypatch.setattr(sys, "path", [str(ROOT / "solver"), *sys.path[2:]])
    assert str(ROOT / "solver") in make_environment()["PYTHONPATH"].split(os.pathsep)  # where we are, we are found
    assert make_command("x")[1] == "-P"


# --- what keeps a gate from beginning is no verdict -----------------------------------------------------------------

BROKEN = {
    "a library is missing": ("yaml", "raise ImportError('gone')"),
    "a library is damaged": ("pydantic", "def ("),
    "a library is another one": ("numpy", "version = 1"),
    "a library that is loaded late": ("scipy", "raise OSError('lib.so: cannot open')"),
    "our own": ("tailstack_service/cli/main", "raise AttributeError('half an update')"),
}


@pytest.mark.long("a library is another one", "a library that is loaded late", "a library is damaged")
@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_installation_leaves_with_3(tmp_path: Path, what: str) -> None:
    name, text = BROKEN[what]
    path = [str(tmp_path), str(ROOT / "solver"), str(ROOT / "service")]
    if "/" in name:
        shutil.copytree(ROOT / "service" / "tailstack_service", tmp_path / "tailstack_service")
    (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    begun = [sys.executable, "-P", "-m", "tailstack_service"]
    done = call(EXAMPLE, *begun, "gate", "fail.yaml", "--mode=verify", PYTHONPATH=os.pathsep.join(path))
    assert done.code == 3, done.said


@pytest.mark.parametrize("code", [0, 1])
@pytest.mark.parametrize("pipeline", ["template", "action"])
def test_an_end_without_a_record_is_no_verdict(tmp_path: Path, pipeline: str, code: int) -> None:
    """A Python that cannot find the package leaves with 1, and one that is none with 0."""
    project = repository(tmp_path / "guides")
    folder = project / ".tailstack" / "bin"
    folder.mkdir(parents=True)
    (folder / "python").write_text(f"#!/bin/sh\nexit {code}\n", encoding="utf-8")
    (folder / "python").chmod(0o755)
    if pipeline == "action":
        known = {**inputs(designs="pass.yaml"), "steps.install.outputs.bin": str(folder)}
        done = run_step("gate", known, project, tmp_path)
        assert done.outputs == {"exit-code": "3", "verdict": "not evaluated"}
    else:
        job = interpolated(source="/nowhere", commit="c" * 40)["tailstack-gate"]
        version = "Python " + ".".join(map(str, sys.version_info[:3]))
        (project / ".tailstack" / "installed").write_text(f"{version} {project} {'c' * 40}", encoding="utf-8")
        done = run_job(job, project, ["sh", "-e"], python_with_libraries(tmp_path / "python").parent)
    assert done.code == 3, done.said
    assert "nothing was judged" in done.said


def test_an_environment_that_the_repository_brings_is_not_used(tmp_path: Path) -> None:
    """A merge request could hold one that passes everything, with the stamp of the one that is wanted."""
    project = repository(tmp_path / "guides")
    (project / ".tailstack" / "bin").mkdir(parents=True)
    (project / ".tailstack" / "bin" / "python").write_text("#!/bin/sh\nexit 0\n", encoding="utf-8")
    git(project, "add", "--all", "--force")
    job = interpolated(source="/nowhere", commit="c" * 40)["tailstack-gate"]
    done = run_job(job, project, ["sh", "-e"], python_with_libraries(tmp_path / "python").parent)
    assert done.code == 3
    assert "the repository holds .tailstack/" in done.said


# --- every call of Python in what ships for pipelines ---------------------------------------------------------------

PIPELINES = (
    "run", "action.yml", "templates/gate.yml", ".pre-commit-hooks.yaml", "docker/Dockerfile", "docker/compose.yaml",
    "docs/pipelines.md", "docs/tutorials/gate_in_ci.md", "examples/ci-gate/.github/workflows/gate.yml",
    "examples/ci-gate/.gitlab-ci.yml", "examples/ci-gate/.pre-commit-config.yaml", "examples/ci-gate/README.md",
)  # fmt: skip
CALLED = re.compile(
    r"""(?:\bpython3?|\$PYTHON|\bPYTHON|sys\.executable|\bfound)"?,?[ \n"-]+(?=-|m\b|PROGRAM|os\.path\.join\(HERE)"""
)
OWN = ("tests", "benchmarks", "docs", ".ci")  # what ./run calls of this project's own, where no repository of others is


def test_every_call_of_python_in_a_pipeline_is_isolated() -> None:
    found = 0
    for name in PIPELINES:
        text = (ROOT / name).read_text(encoding="utf-8")
        for match in CALLED.finditer(text):
            line = text[match.start() : match.end() + 70].replace("\n", " ")
            if any(f'HERE, "{folder}"' in line for folder in OWN):
                continue
            found += 1
            assert re.search(r"""(?:"|- |\s)-[IP]\b""", line[:50]), f"{name}: {line}"
    assert found >= 18
