"""The engine of one host: computing processes with one task each, so that the death of one is that task's alone."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from ...clock import SYSTEM_CLOCK, Clock
from ...processes.pool import Processes
from ...processes.task import PERFORM, GivenBack, NotBegun, Outcome, Task

HANG_SECONDS = 30.0  # without any use of the processor, after which a process with a task counts as hung
FRUITLESS = 3  # processes in a row that end before they begin a task
T = TypeVar("T")


class PoolEngine:
    """At most ``capacity`` computing processes of this host, and a thread with an event loop that feeds them.

    function: what computes a task, as "package.module:function"; the processes import it.  hang_seconds: without any
    use of the processor, after which one with a task is killed.  most_bytes: of memory of each; 0: any.  ahead: so many
    are started before they are needed; None: all.
    """

    name = "pool"

    def __init__(
        self, processes: int, *, function: str = PERFORM, hang_seconds: float = HANG_SECONDS, most_bytes: int = 0,
        ahead: int | None = None, clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self.capacity = processes
        self._hang_seconds, self._clock = hang_seconds, clock
        self._keys: WeakKeyDictionary[Future[Outcome], str] = WeakKeyDictionary()
        self._begun: dict[str, float] = {}  # by key, what is being computed; monotonic s
        self._processes = Processes(function, most_bytes, clock)
        self._tasks: set[asyncio.Task[Any]] = set()
        self._places = asyncio.Semaphore(processes)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="tailstack-pool", daemon=True)
        self._thread.start()
        self._in_loop(self._start(processes if ahead is None else ahead)).result()

    def submit(self, task: Task, key: str) -> Future[Outcome]:
        future = self._in_loop(self._compute(task, key))
        self._keys[future] = key
        return future

    def seconds(self, future: Future[Outcome]) -> float:
        begun = self._begun.get(self._keys[future])
        return 0.0 if begun is None else self._clock.monotonic() - begun

    def kill(self, future: Future[Outcome]) -> None:
        future.cancel()

    def pids(self) -> list[int]:
        """Of the computing processes; waits for those that are being started."""
        self._in_loop(self._processes.wait_for_births()).result()
        return self._processes.pids()

    def close(self) -> None:
        self._in_loop(self._end()).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _in_loop(self, work: Coroutine[Any, Any, T]) -> Future[T]:
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    async def _start(self, count: int) -> None:
        self._processes.start(count)

    async def _compute(self, task: Task, key: str) -> Outcome:
        """Raises Died, Defect, GivenBack, OutOfDate; whatever else ends it ends the process."""
        current = asyncio.current_task()
        assert current is not None
        self._tasks.add(current)
        current.add_done_callback(self._tasks.discard)
        async with self._places:
            self._begun[key] = self._clock.monotonic()
            try:
                for _ in range(FRUITLESS):
                    process = self._processes.take()
                    try:
                        outcome: Outcome = await process.compute(task, hang_seconds=self._hang_seconds)
                        return outcome
                    except NotBegun as error:
                        ending = error
                    finally:
                        self._processes.give_back(process)
                raise GivenBack(f"{FRUITLESS} times in a row {ending} before it began; stderr may say why")
            finally:
                del self._begun[key]

    async def _end(self) -> None:
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await self._processes.close()
        await asyncio.gather(*tasks, return_exceptions=True)
