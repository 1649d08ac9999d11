"""A computing process: ``python -m tailstack_service.processes.child FUNCTION CODE MEMORY``.

Tasks come on stdin and outcomes leave on stdout, as frames, after the first, which is its pid.  The process ends with
the one that wanted it, whatever ends that, and never outlives it.  A task that has read what it computes says how long
it will take, and goes on when it is told to.

On Linux it is forked from a process that has loaded what nearly every task needs (``processes.nursery``).
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

from tailstack.kernels.process import ignore_settings_of_folder

from .birth import BEGUN, OTHER_CODE, digest_files, limit_memory, receive, resident_bytes, send
from .task import Estimated

# CasADi keeps what it built and heaps fragment: a process that has grown is replaced between two tasks.  The count is
# for leaks that do not show as memory.
RESIDENT_BYTES = 1_500_000_000
TASKS = 5_000


def main(function: str, code: str, most_bytes: int) -> None:
    """Compute until stdin ends, or until it is time for a fresh process.

    code: digest of the sources that it is to run.  most_bytes: of memory; 0: any.
    """
    # A Ctrl-C or a stop of the whole group is for the worker to act on: a unit that died of it would be blamed
    ignore_settings_of_folder()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    limit_memory(most_bytes)
    if digest_files() != code:
        sys.exit(OTHER_CODE)
    tasks, outcomes = _private_streams()
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(tasks, waiting), name="tasks", daemon=True).start()
    compute = None
    with suppress(Exception):  # the first task tries again, and says so
        compute = load_function(function)
    with suppress(OSError):  # nobody wants it any more, and so ends its stdin
        send(outcomes, os.getpid())
    for count in range(1, TASKS + 1):
        task = waiting.get()
        send(outcomes, BEGUN)
        outcome, raised, begun = None, None, time.process_time()
        try:
            compute = compute or load_function(function)
            outcome = compute(task)
            while isinstance(outcome, Estimated):
                send(outcomes, float(outcome.seconds))
                outcome = outcome.compute() if waiting.get() else None
        except Exception:
            outcome, raised = None, traceback.format_exc()
        tired = count == TASKS or resident_bytes() > RESIDENT_BYTES
        send(outcomes, (outcome, raised, tired, time.process_time() - begun))
        if tired:
            return


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


def load_function(name: str) -> Callable[..., Any]:
    """``"package.module:function"``.  Raises ImportError, AttributeError."""
    module, _, function = name.partition(":")
    loaded: Callable[..., Any] = getattr(import_module(module), function)
    return loaded


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
