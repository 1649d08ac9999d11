"""What an engine is.  The worker knows no more about processes and clusters than this, and asks for the
engine that the settings name.
"""

from __future__ import annotations

from concurrent.futures import Future
from typing import Protocol

from tailstack.extras import name_missing_extra

from ...clock import SYSTEM_CLOCK, Clock
from ...processes.task import PERFORM, Outcome, Task
from ...settings import Settings


class Engine(Protocol):
    """Takes tasks; knows nothing about jobs, leases or databases.  Its methods may be called from any thread."""

    name: str

    @property
    def capacity(self) -> int:
        """Tasks that can be computed side by side at this moment; 0 while there is nothing to compute with."""

    def submit(self, task: Task, key: str) -> Future[Outcome]:
        """Compute a task.  ``key`` is unique.  The future gives the outcome, or raises Died, Defect or GivenBack."""

    def seconds(self, future: Future[Outcome]) -> float:
        """How long the task has been computed so far, s; 0.0 while it waits."""

    def kill(self, future: Future[Outcome]) -> None:
        """Stop computing the task, now.  What the future says after that means nothing."""

    def close(self) -> None:
        """Stop everything and let go of every process."""


def start_engine(settings: Settings, *, function: str = PERFORM, clock: Clock = SYSTEM_CLOCK) -> Engine:
    """Raises RequestError, or MissingExtraError, if the engine cannot be had with these settings."""
    if settings.engine == "dask":
        with name_missing_extra():
            from .dask import DaskEngine
        return DaskEngine(settings, function=function, clock=clock)
    from .pool import PoolEngine

    return PoolEngine(
        settings.worker_processes, function=function, hang_seconds=settings.hang_seconds,
        most_bytes=settings.max_process_bytes, clock=clock,
    )  # fmt: skip
