"""Processes that the tests start: they can be interrupted, and none outlives its test or the process of the tests."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import psutil

from waiting import LIMIT_SECONDS

ROOT = Path(__file__).resolve().parents[1]
SOURCES = os.pathsep.join((str(ROOT / "solver"), str(ROOT / "service")))
COMMAND = ("-m", "tailstack_service.cli.main")  # of a Python
TAILSTACK = (sys.executable, *COMMAND)
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


P = TypeVar("P", bound="subprocess.Popen[str] | subprocess.Popen[bytes]")


def die_with_parent(sign: int = signal.SIGKILL) -> None:
    """For ``preexec_fn``: Linux sends the signal when the thread ends that started the process.

    SIGINT does what it does in a terminal: that it is ignored, as where tests run in the background, is inherited.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, sign)


def run_process(*command: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """A whole process and what it said, with the options of subprocess.run; without ``env`` it finds the sources of
    this checkout."""
    kept = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "check": False, "timeout": LIMIT_SECONDS}
    return subprocess.run(command, text=True, **{"env": {**os.environ, "PYTHONPATH": SOURCES}, **kept, **options})


def run_python(
    *arguments: str | Path, said: Mapping[str, str] | None = None, **options: Any
) -> subprocess.CompletedProcess[str]:
    """The same of a Python, with what ``said`` adds to its environment."""
    environment = {**os.environ, "PYTHONPATH": SOURCES, **(said or {})}
    return run_process(sys.executable, *arguments, **{"env": environment, **options})


@contextmanager
def ended(process: P) -> Iterator[P]:
    """A process that ends with the block, and whatever it started with it, also where the test fails."""
    try:
        yield process
    finally:
        with suppress(psutil.NoSuchProcess):
            for member in psutil.Process(process.pid).children(recursive=True):
                with suppress(psutil.NoSuchProcess):
                    member.kill()
        process.kill()
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream is not None:
                stream.close()
        process.wait(LIMIT_SECONDS)


@contextmanager
def started(*command: str | Path, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that ends with the block; without ``env`` it finds the sources of this checkout."""
    kept = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": {**os.environ, "PYTHONPATH": SOURCES}}
    process = subprocess.Popen[str](command, text=True, preexec_fn=die_with_parent, **{**kept, **options})
    with ended(process):
        yield process


def read_until(words: str, stream: IO[str] | None) -> str:
    """The next line of a process's stream that holds these words."""
    while words not in (line := stream.readline()):
        assert line, f"the process ended before it said {words!r}"
    return line


def forked_of(pid: int) -> list[psutil.Process]:
    """The computing processes of a process, which are forked from one beside it; none where it has ended."""
    found: list[psutil.Process] = []
    with suppress(psutil.NoSuchProcess):
        for child in psutil.Process(pid).children():
            with suppress(psutil.NoSuchProcess):
                if "tailstack_service.processes.nursery" in child.cmdline():
                    found += child.children()
    return found
