"""The engine of one host: computing processes with one task each, so that the death of one is that task's alone.

A process that hangs is known by its processor time, as the system counts it (Linux).  A process that computes uses
processor time, also inside compiled code that holds the interpreter's lock for minutes, where a thread of its own could
not say that it is alive.  One that has a task and uses none at all is stopped or waits for something that does not
come.  An endless loop is not seen here: that is for the limits of time.
"""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from ...processes.frames import BEGUN, OTHER_CODE, PERFORM, Defect, Died, GivenBack, OutOfDate, receive, send
from ...processes.interpreter import describe_ending, start_child
from ...task import Outcome, Task

CLOSED = "the processes were stopped"
HANG_SECONDS = 30.0  # without any use of the processor, after which a process with a task counts as hung
FRUITLESS = 3  # processes in a row that end before they begin a task
WAITS_FOR_SYSTEM = {"R", "D"}  # states of a thread that waits for a processor or a disk, which is no fault of its own
LOOK_SECONDS = 1.0
# Linux ends a computing process with the *thread* that started it (PR_SET_PDEATHSIG): this one lives as long as the
# process, and pools of threads come and go
_STARTER = ThreadPoolExecutor(1, "tailstack-starter")


class Child:
    """One computing process.  ``compute`` is for one thread at a time; ``kill`` for any."""

    def __init__(self, function: str = PERFORM) -> None:
        self._process = _STARTER.submit(start_child, function, subprocess.PIPE, subprocess.PIPE).result()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._tasks, self._outcomes = self._process.stdin, self._process.stdout
        self.pid = self._process.pid
        self.spent = False  # it has ended, or asks to be replaced
        self.ending = ""  # how it ended under a task
        self._killed_because = ""

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def compute(self, task: Task) -> Outcome | None:
        """The outcome, or None if the process ended before it began.  Raises Died, Defect, OutOfDate."""
        begun = False
        try:
            send(self._tasks, task)
            begun = receive(self._outcomes) == BEGUN
            outcome, traceback, tired = receive(self._outcomes)
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
    """

    def __init__(self, function: str = PERFORM, hang_seconds: float = HANG_SECONDS) -> None:
        self._function, self._hang_seconds = function, hang_seconds
        self._lock = threading.Lock()
        self._idle: deque[Child] = deque()
        self._busy: dict[str, tuple[Child, float]] = {}  # by key, and since when
        self._watch: threading.Thread | None = None
        self._closing = threading.Event()

    def start(self, count: int) -> None:
        """Have processes before they are needed."""
        for _ in range(count):
            self._put_back(Child(self._function))

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
        """Of the processes that there are."""
        with self._lock:
            return [child.pid for child in self._idle] + [child.pid for child, _ in self._busy.values()]

    def seconds(self) -> dict[str, float]:
        """For how long each task has been computed, s, by key."""
        now = time.monotonic()
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
        child = child or Child(self._function)
        with self._lock:
            if not self._closing.is_set():
                self._busy[key] = child, time.monotonic()
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
                self._put_back(Child(self._function))

    def _put_back(self, child: Child) -> None:
        with self._lock:
            if not self._closing.is_set():
                self._idle.append(child)
                return
        child.close()

    def _kill_hung(self) -> None:
        pulses: dict[int, Pulse] = {}
        before = time.monotonic()
        while not self._closing.wait(LOOK_SECONDS):
            now = time.monotonic()
            with self._lock:
                busy = [child for child, _ in self._busy.values()]
                pulses = {child.pid: pulses.get(child.pid) or Pulse(child.pid) for child in busy}
                for child in busy:
                    pulse = pulses[child.pid]
                    pulse.look(now - before)
                    if pulse.silent_seconds >= self._hang_seconds:
                        detail = f"no sign of life: it used no processor time for {pulse.silent_seconds:.0f} s"
                        child.kill(f"{detail} (stopped, or waiting for what does not come) and was killed")
            before = now


class Pulse:
    """How long a process has used no processor time; ``look`` is called about every ``LOOK_SECONDS``."""

    def __init__(self, pid: int) -> None:
        self._tasks = Path(f"/proc/{pid}/task")
        self._ticks = -1
        self.silent_seconds = 0.0

    def look(self, seconds: float) -> None:
        """``seconds`` have passed since the last look.

        Of a long time no more than two looks' worth counts: who was stopped together with the process (a container that
        is paused, say) would otherwise take its own absence for the process's.
        """
        ticks, waits = self._read()
        if ticks != self._ticks or waits:
            self._ticks, self.silent_seconds = ticks, 0.0
        else:
            self.silent_seconds += min(seconds, 2 * LOOK_SECONDS)

    def _read(self) -> tuple[int, bool]:
        """Clock ticks used by all threads, and whether one waits for the system (as if, where nothing can be read)."""
        ticks, waits = 0, False
        try:
            for thread in os.listdir(self._tasks):
                # The name in parentheses may hold anything; state, then 10 fields, then ticks in user and kernel mode
                fields = (self._tasks / thread / "stat").read_text().rpartition(")")[2].split()
                waits |= fields[0] in WAITS_FOR_SYSTEM
                ticks += int(fields[11]) + int(fields[12])
        except (OSError, IndexError, ValueError):  # it, or one of its threads, has just ended; or this is not Linux
            return self._ticks, True
        return ticks, waits


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
