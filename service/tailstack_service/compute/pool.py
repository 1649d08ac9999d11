"""The engine of one host: a few computing processes, each with one task at a time."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor

from ..work.task import Outcome, Task
from .engine import PERFORM
from .processes import HANG_SECONDS, Children


class PoolEngine:
    """``processes`` computing processes of this host.

    function: what computes a task, as "package.module:function"; the processes import it.  hang_seconds: without any
    use of the processor, after which one with a task is killed.
    """

    name = "pool"

    def __init__(self, processes: int, *, function: str = PERFORM, hang_seconds: float = HANG_SECONDS) -> None:
        self._processes = processes
        self._children = Children(function, hang_seconds)
        self._children.start(processes)
        self._threads = ThreadPoolExecutor(processes, thread_name_prefix="tailstack-pool")
        self._lock = threading.Lock()
        self._keys: dict[Future[Outcome], str] = {}

    @property
    def capacity(self) -> int:
        return self._processes

    def submit(self, task: Task, key: str) -> Future[Outcome]:
        with self._lock:
            future = self._threads.submit(self._children.compute, task, key)
            self._keys[future] = key
        future.add_done_callback(self._forget)
        return future

    def _forget(self, future: Future[Outcome]) -> None:
        with self._lock:
            self._keys.pop(future, None)

    def seconds(self, future: Future[Outcome]) -> float:
        return self._children.seconds().get(self._keys.get(future, ""), 0.0)

    def kill(self, future: Future[Outcome]) -> None:
        key = self._keys.get(future)
        if not future.cancel() and key is not None:
            self._children.kill(key)

    def pids(self) -> list[int]:
        """Of the computing processes."""
        return self._children.pids()

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._children.close()
        self._threads.shutdown(wait=True)
