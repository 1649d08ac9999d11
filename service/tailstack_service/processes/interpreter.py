"""Python processes of our own: the same interpreter, the same modules, one thread each in heavy loops."""

from __future__ import annotations

import os
import signal
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from tailstack.version import __file__ as _file_of_solver
from tailstack.version import __version__

if TYPE_CHECKING:
    from tailstack.kernels.sources import SourceFile

# Processes are the unit of parallelism here, and the libraries' own threads would fight with them.
SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
# Arrow's own allocator takes a gigabyte of address space that a limit on memory would count, and its thread would be on
# one side of a fork only
ALLOCATORS = {"ARROW_DEFAULT_MEMORY_POOL": "system", "JE_ARROW_MALLOC_CONF": "background_thread:false"}


def make_command(module: str, *arguments: str) -> list[str]:
    """Run a module, as ``python -m``; what lies in the working directory is not imported."""
    return [sys.executable, "-P", "-m", module, *arguments]


def refuse_unusable_kernels() -> None:
    """Raises KernelError where numba's settings in the environment rule out what is about to be started here.

    Before it serves, so that nobody waits for an answer that cannot come; without such settings it costs nothing.
    """
    values = {name: os.environ.get(f"NUMBA_{name}") for name in ("DISABLE_JIT", "CPU_NAME", "CPU_FEATURES")}
    if any(value is not None for value in values.values()):
        from tailstack.kernels.processor import refuse_unusable

        disabled = values["DISABLE_JIT"] not in (None, "", "0")
        refuse_unusable(disabled=disabled, name=values["CPU_NAME"], features=values["CPU_FEATURES"])


@cache
def digest_code() -> str:
    """Of all sources of this version, as this process first found them: the name of the code that it runs."""
    from tailstack.kernels import sources

    return _digest(sources.SOURCES)


def digest_files() -> str:
    """The same of the files as they are now."""
    from tailstack.kernels import sources

    return _digest(sources.read_sources(sources.ROOT))


def _digest(solver: dict[str, SourceFile]) -> str:
    from tailstack.kernels.sources import digest_of_all, read_sources

    here = digest_of_all(read_sources(Path(__file__).resolve().parents[1]))
    return sha256(f"{digest_of_all(solver)} {here}".encode()).hexdigest()


def running_code() -> str:
    """Version and sources of this process, ``0.1.0+4f1d0c9be2a7``: parts of one answer are computed by one code."""
    return f"{__version__}+{digest_code()[:12]}"


def make_environment() -> dict[str, str]:
    """The environment of this process, with its module path, but for what is on that because it is the working
    directory (``python -m`` puts it first, as an absolute path): a child takes no modules from there."""
    first = sys.path[:1] if _is_working_directory(*sys.path[:1]) else []
    path = os.pathsep.join(dict.fromkeys(entry for entry in sys.path[len(first) :] if entry))
    return {**os.environ, **SINGLE_THREADED, **ALLOCATORS, "PYTHONPATH": path}


def _is_working_directory(entry: str = "") -> bool:
    try:
        here = os.path.realpath(os.getcwd())
    except OSError:  # it was deleted
        return False
    ours = {os.path.realpath(Path(file).parents[1]) for file in (_file_of_solver, Path(__file__).parent)}
    return not sys.flags.safe_path and here not in ours and os.path.realpath(entry) == here


# What a signal says to whoever reads it in the problem of a job
REASONS = {
    "SIGILL": "illegal instruction: kernels built for another processor",
    "SIGKILL": "killed from outside, as where memory runs out",
}


def describe_ending(code: int) -> str:
    """What ended a process, from its return code: its exit code, or the signal by name and what that signal means."""
    if code >= 0:
        return f"exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:  # a real-time signal
        return f"signal {-code}"
    return f"{name} ({REASONS.get(name) or (signal.strsignal(-code) or 'signal').lower()})"
