"""The engine of one host: computing processes with one task each, so that the death of one is that task's alone.

A process that hangs is known by its processor time, as the system counts it (Linux).  A process that computes uses
processor time, also inside compiled code that holds the interpreter's lock for minutes, where a thread of its own could
not say that it is alive.  One that has a task and uses none at all is stopped or waits for something that does not
come.  An endless loop is not seen here: that is for the limits of time.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from ...clock import SYSTEM_CLOCK, Clock
from ...processes.frames import BEGUN, OTHER_CODE, PERFORM, Defect, Died, GivenBack, OutOfDate, receive, send
from ...processes.interpreter import describe_ending
from ...processes.nursery import start_child
from ...processes.pulse import LOOK_SECONDS, Pulse
from ...processes.task import Outcome, Task

CLOSED = "the processes were stopped"
HANG_SECONDS = 30.0  # without any use of the processor, after which a process with a task counts as hung
FRUITLESS = 3  # processes in a row that end before they begin a task
# Linux ends a computing process with the *thread* that started it (PR_SET_PDEATHSIG): this one lives as long as the
# process, and pools of threads come and go
_STARTER = ThreadPoolExecutor(1, "tailstack-starter")


class Child:
    """One computing process.  ``compute`` is for one thread at a time; ``kill`` for any."""

    def __init__(self, function: str = PERFORM, most_bytes: int = 0) -> None:
        (theirs, ours), (heard, stdout) = os.pipe(), os.pipe()
        try:
            self._process = _STARTER.submit(start_child, function, theirs, stdout, most_bytes).result()
        except BaseException:
            os.close(ours)
            os.close(heard)
            raise
        finally:
            os.close(theirs)
            os.close(stdout)
        self._tasks, self._outcomes = os.fdopen(ours, "wb"), os.fdopen(heard, "rb")
        self.spent = False  # it has ended, or asks to be replaced
        self.ending = ""  # how it ended under a task
        self._killed_because = ""

    @property
    def pid(self) -> int | None:
        """None for one that is not there yet, or never was."""
        return self._process.pid

    def wait_for_birth(self) -> None:
        with suppress(OSError):  # it ended before
            self._process.wait_for_birth()

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def compute(self, task: Task) -> Outcome | None:
        """The outcome, or None if the process ended before it began.  Raises Died, Defect, OutOfDate."""
        begun = False
        try:
            send(self._tasks, task)
            begun = receive(self._outcomes) == BEGUN
            outcome, traceback, tired, _ = receive(self._outcomes)
        except (EOFError, OSError):
            self.kill()
            code = self._process.wait()
            self.ending = self._killed_because or describe_ending(code)
            if begun:
                raise Died(f"the computing process ended with {self.ending}") from None
            if code == OTHER_CODE:
                raise OutOfDate("the files of tailstack were replaced since this process was started") from None
            return None
        self.spent = self.spent or tired
        if traceback is not None:
            raise Defect(traceback)
        result: Outcome = outcome
        return result

    def kill(self, because: str = "") -> None:
        self._killed_because = self._killed_because or because
        self.spent = True
        self._process.kill()

    def close(self) -> None:
        """Kill the process and wait until it is gone."""
        self._process.kill()
        self._process.wait()
        for stream in (self._tasks, self._outcomes):
            with suppress(OSError):  # what was not yet written to it
                stream.close()


class Children:
    """Computing processes: started when needed, kept for the next task, found by the key of what they compute.

    ``hang_seconds``: a process that has a task and for so long uses no processor time at all is killed.
    ``most_bytes``: of memory that each may take; 0: any.
    """

    def __init__(
        self, function: str = PERFORM, hang_seconds: float = HANG_SECONDS, most_bytes: int = 0,
        clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self._clock = clock
        self._function, self._hang_seconds, self._most_bytes = function, hang_seconds, most_bytes
        self._lock = threading.Lock()
        self._idle: deque[Child] = deque()
        self._busy: dict[str, tuple[Child, float]] = {}  # by key, and since when
        self._watch: threading.Thread | None = None
        self._closing = threading.Event()

    def start(self, count: int) -> None:
        """Have processes before they are needed."""
        for _ in range(count):
            self._put_back(self._new())

    def compute(self, task: Task, key: str) -> Outcome:
        """Compute in a process that does nothing else meanwhile.  Raises Died, Defect, GivenBack, OutOfDate."""
        for _ in range(FRUITLESS):
            child = self._take(key)
            try:
                outcome = child.compute(task)
            except Died:
                if self._closing.is_set():
                    raise GivenBack(CLOSED) from None
                raise
            finally:
                self._release(key, child)
            if outcome is not None:
                return outcome
        raise GivenBack(
            f"{FRUITLESS} computing processes in a row ended before they began, the last with {child.ending}; "
            f"stderr may say why"
        )

    def pids(self) -> list[int]:
        """Of the processes that there are; waits for those that are being forked."""
        with self._lock:
            children = [*self._idle, *(child for child, _ in self._busy.values())]
        for child in children:
            child.wait_for_birth()
        return [child.pid for child in children if child.pid is not None]

    def seconds(self) -> dict[str, float]:
        """For how long each task has been computed, s, by key."""
        now = self._clock.monotonic()
        with self._lock:
            return {key: now - since for key, (_, since) in self._busy.items()}

    def kill(self, key: str) -> None:
        """Kill the process that computes ``key``, if one does."""
        with self._lock:  # or it could be on its next task by the time the signal comes
            if key in self._busy:
                self._busy[key][0].kill()

    def close(self) -> None:
        """Kill every process; those that still compute are let go of by their own thread."""
        with self._lock:
            self._closing.set()
            idle = list(self._idle)
            self._idle.clear()
            for child, _ in self._busy.values():
                child.kill()
        for child in idle:
            child.close()

    def _take(self, key: str) -> Child:
        with self._lock:
            child = self._idle.popleft() if self._idle else None
        if child is not None and not child.is_alive():
            child.close()
            child = None
        child = child or self._new()
        with self._lock:
            if not self._closing.is_set():
                self._busy[key] = child, self._clock.monotonic()
                if self._watch is None:
                    self._watch = threading.Thread(target=self._kill_hung, name="tailstack-pulse", daemon=True)
                    self._watch.start()
                return child
        child.close()
        raise GivenBack(CLOSED)

    def _release(self, key: str, child: Child) -> None:
        with self._lock:
            del self._busy[key]
        if not child.spent:
            self._put_back(child)
            return
        child.close()
        if not self._closing.is_set():
            with suppress(OSError):  # the next task tries again, and says so
                self._put_back(self._new())

    def _new(self) -> Child:
        return Child(self._function, self._most_bytes)

    def _put_back(self, child: Child) -> None:
        with self._lock:
            if not self._closing.is_set():
                self._idle.append(child)
                return
        child.close()

    def _kill_hung(self) -> None:
        pulses: dict[int, Pulse] = {}
        before = self._clock.monotonic()
        while not self._clock.wait(self._closing, LOOK_SECONDS):
            now = self._clock.monotonic()
            with self._lock:
                busy = {child.pid: child for child, _ in self._busy.values() if child.pid is not None}
                pulses = {pid: pulses.get(pid) or Pulse(pid) for pid in busy}
                for pid, child in busy.items():
                    pulse = pulses[pid]
                    pulse.look(now - before)
                    if pulse.silent_seconds >= self._hang_seconds:
                        detail = f"no sign of life: it used no processor time for {pulse.silent_seconds:.0f} s"
                        child.kill(f"{detail} (stopped, or waiting for what does not come) and was killed")
            before = now


class PoolEngine:
    """``processes`` computing processes of this host.

    function: what computes a task, as "package.module:function"; the processes import it.  hang_seconds: without any
    use of the processor, after which one with a task is killed.  most_bytes: of memory of each; 0: any.
    """

    name = "pool"

    def __init__(
        self, processes: int, *, function: str = PERFORM, hang_seconds: float = HANG_SECONDS, most_bytes: int = 0,
        clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self._processes = processes
        self._children = Children(function, hang_seconds, most_bytes, clock)
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
