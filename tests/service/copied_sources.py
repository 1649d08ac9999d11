"""A copy of a package's sources that somebody adds something to, and one process that runs commands on it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from service_scenes import ROOT

from family import run_python, started
from waiting import LIMIT_SECONDS

COMMANDS = """
import contextlib, io, json, os, sys
from tailstack_service.cli.main import main
answers = os.fdopen(os.dup(1), "w")
for line in sys.stdin:
    folder, arguments = json.loads(line)
    os.chdir(folder)
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(arguments)
    out.flush()
    print(json.dumps([code, out.buffer.getvalue().decode(), err.getvalue()]), file=answers, flush=True)
"""

MATRIX = """
import {matrix} as matrix
for name in matrix.CONSUMERS:
    print(name, flush=True)
    matrix.meet({subject!r}, name)
"""


def copy_sources(root: Path, package: str = "solver/tailstack") -> Path:
    """The folder in which the copy of a package is."""
    shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__"))
    return (root / package).parent


def edit(file: Path, *changes: tuple[str, str]) -> None:
    """Put texts in the place of others, each of which stands once in a source."""
    text = file.read_text(encoding="utf-8")
    for before, after in changes:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    file.write_text(text, encoding="utf-8")


def path_of(source: Path) -> str:
    """PYTHONPATH of the copy, with the other package as it is."""
    return os.pathsep.join(map(str, (source, ROOT / "solver", ROOT / "service")))


def commands_on(variables: Mapping[str, str]) -> AbstractContextManager[subprocess.Popen[str]]:
    """A process that has the copy of the sources loaded and runs one command after the other."""
    return started(sys.executable, "-c", COMMANDS, stdin=subprocess.PIPE, stderr=None, env=variables)


@pytest.fixture(scope="module")
def copy(variables: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Commands on the copy whose environment a file of tests gives as ``variables``."""
    with commands_on(variables) as process:
        yield process


def tailstack(copy: subprocess.Popen[str], folder: Path, *arguments: str, codes: tuple[int, ...] = (0, 1)) -> str:
    """What a command prints."""
    code, out, err = _run(copy, folder, arguments)
    assert code in codes, err
    return out


def refusal(copy: subprocess.Popen[str], folder: Path, *arguments: str) -> str:
    """Why a command refuses what it was given, in one line."""
    code, _, err = _run(copy, folder, arguments)
    assert code == 2
    return " ".join(err.split())


def meet_matrix(variables: Mapping[str, str], folder: Path, matrix: str, subject: str) -> None:
    """Every consumer of a matrix of the tests has to meet what the copy has more."""
    places = (variables["PYTHONPATH"], str(ROOT / "tests"), str(ROOT / "tests" / "unit"))
    program = MATRIX.format(matrix=matrix, subject=subject)
    told = {**variables, "PYTHONPATH": os.pathsep.join(places)}
    done = run_python("-c", program, env=told, timeout=5 * LIMIT_SECONDS, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr


def _run(copy: subprocess.Popen[str], folder: Path, arguments: tuple[str, ...]) -> tuple[int, str, str]:
    assert copy.stdin is not None
    assert copy.stdout is not None
    copy.stdin.write(json.dumps([str(folder), arguments]) + "\n")
    copy.stdin.flush()
    code, out, err = json.loads(copy.stdout.readline())
    return code, out, err
