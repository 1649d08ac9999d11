"""A computing process: ``python -m tailstack_service.processes.child FUNCTION PARENT CODE``.

Tasks come on stdin and outcomes leave on stdout, as frames.  The process ends with the one that started it, whatever
ends that, and never outlives it.  While it waits for its first task it loads what nearly every task needs, in steps
short enough that a task which comes in between does not wait for long.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import IO, Any

from ..operations.content import canonical
from ..operations.example import EXAMPLE_DESIGN
from ..task import ADVANCE, Outcome, Task, UnitResult
from .frames import BEGUN, OTHER_CODE, PERFORM, receive, send
from .interpreter import digest_code

WARM_UP_AFTER_SECONDS = 1.0  # idle: a service that has just started needs the processor for itself
# CasADi keeps what it built and heaps fragment: a process that has grown is replaced between two tasks.  The count is
# for leaks that do not show as memory.
RESIDENT_BYTES = 1_500_000_000
TASKS = 5_000
OOM_SCORE = 500  # where memory runs out, the unit that took it ends, and not the worker or the database
PR_SET_PDEATHSIG = 1


def end_with(parent: int) -> None:
    """Be killed when the process ``parent`` ends (Linux); leave at once if it already has."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
            score.write(str(OOM_SCORE))
    if hasattr(os, "getppid") and os.getppid() != parent and os.name != "nt":
        os._exit(1)


def main(function: str, parent: int, code: str) -> None:
    """Compute until stdin ends, or until it is time for a fresh process.  ``code``: digest of the parent's sources."""
    # A Ctrl-C or a stop of the whole group is for the worker to act on: a unit that died of it would be blamed
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    end_with(parent)
    if digest_code() != code:
        sys.exit(OTHER_CODE)
    tasks, outcomes = _private_streams()
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(tasks, waiting), name="tasks", daemon=True).start()
    compute, warm = None, list_warm_up_steps() if function == PERFORM else []
    for count in range(1, TASKS + 1):
        task = _next(waiting, warm)
        send(outcomes, BEGUN)
        outcome, raised = None, None
        try:
            compute = compute or load_function(function)
            outcome = compute(task)
        except Exception:
            raised = traceback.format_exc()
        tired = count == TASKS or _resident_bytes() > RESIDENT_BYTES
        send(outcomes, (outcome, raised, tired))
        if tired:
            return


def _next(waiting: queue.SimpleQueue[Any], warm: list[Callable[[], object]]) -> Any:
    """The next task; what every task needs is made ready while there is none."""
    patience = WARM_UP_AFTER_SECONDS
    while warm:
        try:
            return waiting.get(timeout=patience)
        except queue.Empty:
            patience = 0.0
            with suppress(Exception):  # the task that needs it will say so
                warm.pop(0)()
    return waiting.get()


def _private_streams() -> tuple[IO[bytes], IO[bytes]]:
    """stdin and stdout for frames alone: solvers print where they like."""
    tasks, outcomes = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return tasks, outcomes


def _read(tasks: IO[bytes], waiting: queue.SimpleQueue[Any]) -> None:
    """Its own thread, so that the end of the worker is noticed in the middle of a task on every system."""
    with suppress(EOFError, OSError):
        while True:
            waiting.put(receive(tasks))
    os._exit(0)


def _resident_bytes() -> int:
    try:
        with open("/proc/self/statm", "rb") as pages:
            return int(pages.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def list_warm_up_steps() -> list[Callable[[], object]]:
    """Modules to import, then the compiled kernels, in the order in which they are to be called."""
    optimiser = "tailstack.optimisation.course"
    modules = ("numpy", "scipy.linalg", "tailstack.design", "tailstack.verification", optimiser, "casadi")
    return [*(partial(import_module, name) for name in modules), check_once]


def check_once() -> None:
    """The smallest Monte Carlo check there is, as a job would do it."""
    from ..operations.perform import perform

    options = {"trials": 1_000, "precision": None, "seed": 0, "method": "plain", "max_trials": 1_000}
    request = canonical({"design": EXAMPLE_DESIGN, **options})
    units: tuple[UnitResult, ...] = ()
    while more := perform(Task("verification", request, ADVANCE, units)).more:
        results = [(spec, perform(Task("verification", request, spec)).result or b"") for spec in more]
        units += tuple(UnitResult(len(units) + k, *pair) for k, pair in enumerate(results))


def load_function(name: str) -> Callable[[Task], Outcome]:
    """``"package.module:function"``.  Raises ImportError, AttributeError."""
    module, _, function = name.partition(":")
    compute: Callable[[Task], Outcome] = getattr(import_module(module), function)
    return compute


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
