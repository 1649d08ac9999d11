"""Python processes of our own: the same interpreter, the same modules, one thread each in heavy loops."""

from __future__ import annotations

import os
import sys

# Processes are the unit of parallelism here, and the libraries' own threads would fight with them.
SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}


def command(module: str, *arguments: str) -> list[str]:
    """Run a module, as ``python -m``; what lies in the working directory is not imported."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment() -> dict[str, str]:
    """The environment of this process, with its module path."""
    path = os.pathsep.join(entry for entry in sys.path if entry)
    return {**os.environ, **SINGLE_THREADED, "PYTHONPATH": path}
