"""What runs on a Dask worker: hand the task to a computing process beside it.

A process of its own can be killed when its job is cancelled, is the only victim of a crash, and is the only thread in
solvers that keep their state in globals, however many threads the Dask worker has.
"""

from __future__ import annotations

import threading
from concurrent.futures import CancelledError, Future

from ...processes.birth import running_code
from ...processes.task import GivenBack, Outcome, OutOfDate, Task
from .pool import PoolEngine

MOST_PROCESSES = 1_000  # no limit: there are as many as the Dask worker has threads
_lock = threading.Lock()
_engines: dict[str, PoolEngine] = {}  # by function: one Dask worker serves every client that knows it
_computed: dict[str, tuple[PoolEngine, Future[Outcome]]] = {}  # by key, at this moment


def compute(task: Task, key: str, function: str, version: str, hang_seconds: float, most_bytes: int) -> Outcome:
    """Compute in a process of its own.  Raises Died, Defect, GivenBack."""
    if version != running_code():
        raise GivenBack(f"this Dask worker has tailstack {running_code()}, the job was claimed by {version}")
    with _lock:
        if function not in _engines:
            _engines[function] = PoolEngine(
                MOST_PROCESSES, function=function, hang_seconds=hang_seconds, most_bytes=most_bytes, ahead=0
            )
        engine = _engines[function]
        future = engine.submit(task, key)
        _computed[key] = engine, future
    try:
        return future.result()
    except CancelledError:
        raise GivenBack("its process was stopped") from None
    except OutOfDate as error:  # this Dask worker is, and not the worker that asks it
        raise GivenBack(f"a Dask worker is to be started again: {error}") from None
    finally:
        del _computed[key]


def seconds() -> dict[str, float]:
    """For how long each task has been computed on this Dask worker, s, by key."""
    return {key: engine.seconds(future) for key, (engine, future) in list(_computed.items())}


def kill(keys: list[str]) -> None:
    """Kill the processes that compute these; called on every Dask worker."""
    for key in keys:
        if key in _computed:
            engine, future = _computed[key]
            engine.kill(future)


def close() -> None:
    """The Dask worker is leaving: what is computed here would keep it until it is done, and then be lost."""
    with _lock:
        engines = list(_engines.values())
        _engines.clear()
    for engine in engines:
        engine.close()
