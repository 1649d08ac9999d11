"""What a process settles before it computes, without loading the compiler: processors, settings, who compiles."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader

SETTINGS_OF_FOLDER = ".numba_config.yaml"  # numba reads it from the folder in which a process starts
# Matrices are small here.  Processes and the threads of a search are the unit of parallelism; the libraries' own would
# fight with them, waiting for one another in loops.
SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
LATE = ("numpy.f2py", "numpy.testing")  # modules that nothing here uses
_preparations: list[Callable[[], None]] = []


def usable_cores() -> int:
    """Processors that this process may use: affinity counts, limits of CPU time (cgroups) do not."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def ignore_settings_of_folder() -> None:
    """Have numba take its settings from the environment alone, in a process of ours.

    A repository of designs that brings a file of settings would say which machine code is loaded by the gate that
    judges it.  To be called before numba is loaded, and before there are threads: where there is such a file, numba is
    loaded from another folder.
    """
    if not os.path.isfile(SETTINGS_OF_FOLDER):
        return
    here = os.getcwd()
    os.chdir(os.path.dirname(os.path.abspath(__file__)))
    try:
        from numba.core import config

        vars(config)["_config_fname"] = os.devnull  # no file; it is asked for again when the environment changes
    finally:
        os.chdir(here)


class _LateModules:
    """Finds them, to be executed when something of them is first asked for."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: object = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path) if name in LATE else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def load_late() -> None:
    """Have what nothing here uses of numpy loaded by whoever does, in a process of ours.

    SciPy reads every attribute of numpy when it is loaded, and so loads the writer of Fortran bindings and what tests
    arrays: a quarter of the time of ``scipy.special``.  To be called before SciPy is loaded.
    """
    if _LateModules not in sys.meta_path:
        sys.meta_path.insert(0, _LateModules)


def prepare_with(prepare: Callable[[], None] | None) -> None:
    """Call this once, before the first kernel is compiled in this process; None: nothing.

    So a command has kernels compiled in several processes at once and shows how far that is: it says so before it knows
    whether kernels are needed, and the store asks when one of them is missing.
    """
    _preparations[:] = [] if prepare is None else [prepare]


def prepare() -> bool:
    """Call the hook, once.  Whether something was done, so that it is worth looking for a kernel again."""
    if not _preparations:
        return False
    _preparations.pop()()
    return True
