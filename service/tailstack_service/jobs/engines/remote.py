"""What runs on a Dask worker: hand the task to a computing process beside it.

A process of its own can be killed when its job is cancelled, is the only victim of a crash, and is the only thread in
solvers that keep their state in globals, however many threads the Dask worker has.
"""

from __future__ import annotations

from ...processes.frames import GivenBack, OutOfDate
from ...processes.interpreter import running_code
from ...processes.task import Outcome, Task
from .pool import Children

_children: dict[str, Children] = {}  # by function: one Dask worker serves every client that knows it


def compute(task: Task, key: str, function: str, version: str, hang_seconds: float, most_bytes: int) -> Outcome:
    """Compute in a process of its own.  Raises Died, Defect, GivenBack."""
    if version != running_code():
        raise GivenBack(f"this Dask worker has tailstack {running_code()}, the job was claimed by {version}")
    try:
        return _children.setdefault(function, Children(function, hang_seconds, most_bytes)).compute(task, key)
    except OutOfDate as error:  # this Dask worker is, and not the worker that asks it
        raise GivenBack(f"a Dask worker is to be started again: {error}") from None


def seconds() -> dict[str, float]:
    """For how long each task has been computed on this Dask worker, s, by key."""
    return {key: since for children in list(_children.values()) for key, since in children.seconds().items()}


def kill(keys: list[str]) -> None:
    """Kill the processes that compute these; called on every Dask worker."""
    for children in list(_children.values()):
        for key in keys:
            children.kill(key)


def close() -> None:
    """The Dask worker is leaving: what is computed here would keep it until it is done, and then be lost."""
    for children in list(_children.values()):
        children.close()
