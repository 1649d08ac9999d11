"""What an engine is.  The worker knows no more about processes and clusters than this."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
from typing import Protocol

from ..work.task import Outcome, Task

PERFORM = "tailstack_service.work.perform:perform"


class Died(Exception):
    """The process that was computing the task ended under it; no other task was in that process."""


class Defect(Exception):
    """The task raised what is not a refusal; the text is its traceback."""


class GivenBack(Exception):
    """The task was not computed, and not through any fault of its own."""


class OutOfDate(GivenBack):
    """Not computed, because the files of tailstack are no longer those that this process was started from."""


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


def function_named(name: str) -> Callable[[Task], Outcome]:
    """``"package.module:function"``.  Raises ImportError, AttributeError."""
    module, _, function = name.partition(":")
    found: Callable[[Task], Outcome] = getattr(import_module(module), function)
    return found
