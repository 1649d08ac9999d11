"""Runners of other people's machines, as far as they can be had here: expressions, steps, inputs, a Python that pips.

The steps of the action and the script of the template are run as they stand, by the shells and with the variables that
GitHub and GitLab document; what they install comes from the environment of the tests, without network.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass, field, replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import yaml
from service_scenes import EXAMPLES, ROOT

from family import SOURCES, run_process

ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
EXAMPLE = EXAMPLES / "ci-gate"


@dataclass(frozen=True)
class Ran:
    """What became of a step or a job."""

    code: int
    said: str  # stdout and stderr
    outputs: dict[str, str] = field(default_factory=dict)
    summary: str = ""


def repository(folder: Path) -> Path:
    """The worked example as a git repository; its waivers hold for another month, whenever this is read."""
    shutil.copytree(EXAMPLE, folder)
    redate(folder, 30)
    git(folder, "init", "-q", "-b", "main")
    git(folder, "add", "--all")
    git(folder, "-c", "user.name=t", "-c", "user.email=t@example.com", "commit", "-q", "-m", "designs")
    return folder


def shipped(folder: Path) -> tuple[str, str]:
    """(address, commit) of a repository that holds what pipelines install of this checkout."""
    folder.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE", "requirements-core.lock"):
        shutil.copy(ROOT / name, folder / name)
    for name in ("solver", "service", "examples", "docs"):
        ignored = shutil.ignore_patterns("__pycache__", "node_modules")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    git(folder, "init", "-q")
    git(folder, "add", "--all")
    git(folder, "-c", "user.name=t", "-c", "user.email=t@example.com", "commit", "-q", "-m", "shipped")
    return str(folder), git(folder, "rev-parse", "HEAD").strip()


def redate(folder: Path, days: int) -> None:
    waivers = folder / "waivers.yaml"
    text, count = re.subn(
        r"expires: \S+", f"expires: {date.today() + timedelta(days=days)}", waivers.read_text(encoding="utf-8")
    )
    assert count == 1
    waivers.write_text(text, encoding="utf-8")


def git(folder: Path, *arguments: str) -> str:
    done = run_process("git", *arguments, cwd=folder, check=True)
    return done.stdout


def environment(**changes: str) -> dict[str, str]:
    """Without what this machine knows of pipelines, and without network for pip; tailstack is that of the checkout,
    whose kernels are compiled, and kept where a cache of a pipeline would have them."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("TAILSTACK_", "GITHUB_", "CI_", "GATE_", "PIP_", "GIT_"))
    }
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    kept.setdefault("NUMBA_CACHE_DIR", str(Path(base) / "tailstack" / "kernels"))
    return {**kept, "PYTHONPATH": SOURCES, "PIP_NO_INDEX": "1", "PIP_CONFIG_FILE": os.devnull, **changes}


def call(folder: Path, *command: str, **variables: str) -> Ran:
    """A command in a folder, with variables beside those of the environment."""
    done = run_process(
        *command, cwd=folder, env=environment(**variables), stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT,
        encoding="utf-8",
    )  # fmt: skip
    return Ran(done.returncode, done.stdout)


def python_with_libraries(folder: Path) -> Path:
    """A ``python3`` whose virtual environments see the libraries of this one, as if an index had been asked."""
    folder.mkdir(parents=True, exist_ok=True)
    command = folder / "python3"
    command.write_text(
        "#!/bin/sh\n"
        f'python="{sys.executable}"\n'
        'if [ "$1 $2 $3" = "-I -m venv" ]; then\n'
        '  "$python" -I -m venv --without-pip "$4" || exit $?\n'  # pip is among the libraries
        '  for site in "$4"/lib/python*/site-packages; do\n'
        f"    echo '{sysconfig.get_path('purelib')}' > \"$site/host.pth\"\n"
        "  done\n"
        "  exit 0\n"
        "fi\n"
        'exec "$python" "$@"\n',
        encoding="utf-8",
    )
    command.chmod(0o755)
    return command


# --- GitHub ---------------------------------------------------------------------------------------


def step(identity: str) -> dict[str, Any]:
    found: dict[str, Any] = next(step for step in ACTION["runs"]["steps"] if step["id"] == identity)
    return found


def evaluated(text: str, known: dict[str, str]) -> str:
    """The text with its ``${{ ... }}``: references only, and only to what there is."""
    return re.sub(r"\$\{\{ ([\w.-]+) \}\}", lambda found: known[found[1]], text)


def run_step(identity: str, known: dict[str, str], workspace: Path, temporary: Path) -> Ran:
    """A step of the action as a runner runs it: bash as documented, files for outputs and summary."""
    entry = step(identity)
    written = {name: temporary / f"{identity}-{name}" for name in ("output", "summary", "script")}
    for path in written.values():
        path.write_bytes(b"")
    written["script"].write_text(entry["run"], encoding="utf-8")
    assert entry["shell"] == "bash"
    ran = call(
        workspace / evaluated(entry.get("working-directory", "."), known),
        *("bash", "--noprofile", "--norc", "-eo", "pipefail", str(written["script"])),
        **{name: evaluated(value, known) for name, value in entry["env"].items()},
        GITHUB_ACTION_PATH=str(ROOT),
        GITHUB_WORKSPACE=str(workspace),
        GITHUB_OUTPUT=str(written["output"]),
        GITHUB_STEP_SUMMARY=str(written["summary"]),
        RUNNER_TEMP=str(temporary),
    )
    outputs = dict(line.split("=", 1) for line in written["output"].read_text(encoding="utf-8").splitlines())
    return replace(ran, outputs=outputs, summary=written["summary"].read_text(encoding="utf-8"))


def inputs(**given: str) -> dict[str, str]:
    """What expressions see of the action's inputs: those given, the defaults of the others."""
    names = {name.replace("_", "-"): value for name, value in given.items()}
    assert names.keys() <= ACTION["inputs"].keys()
    values = {name: entry.get("default", "") for name, entry in ACTION["inputs"].items()}
    return {f"inputs.{name}": value for name, value in {**values, **names}.items()}


# --- GitLab ---------------------------------------------------------------------------------------


def template() -> tuple[dict[str, Any], str]:
    """Header of the template, and the text below it."""
    text = (ROOT / "templates" / "gate.yml").read_text(encoding="utf-8")
    header, body = text.split("\n---\n")
    return yaml.safe_load(header)["spec"]["inputs"], body


def interpolated(**given: str) -> dict[str, Any]:
    """The jobs of the template with inputs put in, as GitLab does before it reads the YAML."""
    declared, body = template()
    assert given.keys() <= declared.keys()
    for name, value in given.items():
        assert value in declared[name].get("options", [value])
    assert {name for name, entry in declared.items() if "default" not in entry} <= given.keys()
    values = {name: given.get(name, entry.get("default")) for name, entry in declared.items()}
    text = re.sub(r"\$\[\[ inputs\.(\w+) \]\]", lambda found: values[found[1]], body)
    jobs: dict[str, Any] = yaml.safe_load(text)
    return jobs


def run_job(job: dict[str, Any], project: Path, shell: list[str], path: Path) -> Ran:
    """The script of a job in one shell, as GitLab's runner runs it; ``path``: where its ``python3`` is."""
    return call(
        project, *shell, "-c", "\n".join(job["script"]),
        **job["variables"], CI="true", GITLAB_CI="true", CI_PROJECT_DIR=str(project),
        PATH=os.pathsep.join((str(path), os.environ["PATH"])), PIP_NO_DEPS="1", PIP_NO_BUILD_ISOLATION="0",
    )  # fmt: skip
