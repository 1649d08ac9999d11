"""Computing processes that are fed, killed and replaced, for one event loop; what the API and the worker compute with.

A process that hangs is known by its processor time, as the system counts it (Linux).  A process that computes uses
processor time, also inside compiled code that holds the interpreter's lock for minutes, where a thread of its own could
not say that it is alive, and it uses no more of it when the machine is busy.  One that has a task and uses none at all
is stopped or waits for something that does not come.  An endless loop is not seen here: that is for the limits of time.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import Any

from ..clock import SYSTEM_CLOCK, Clock
from .birth import (
    BEGUN,
    OTHER_CODE,
    describe_ending,
    pack,
    read_processor_time,
    receive_async,
    start_child,
    waits_for_system,
)
from .task import Defect, Died, NotBegun, OutOfDate, PutBack

LOOK_SECONDS = 0.25  # between two looks at what a process does


class Pulse:
    """What a process has used of the processor since this was made, and for how many looks in a row nothing.

    Looks are counted and not time: who was stopped together with the process (a container that is paused, say) would
    otherwise take its own absence for the process's.
    """

    def __init__(self, pid: int, clock: Clock) -> None:
        self._pid, self._clock, self._begun = pid, clock, clock.monotonic()
        self._last = self._first = read_processor_time(pid)
        self.silent_looks = 0

    def look(self) -> float:
        """Seconds that all its threads have used; those that have passed where the system does not say."""
        reading = read_processor_time(self._pid)
        silent = reading is not None and reading == self._last and not waits_for_system(self._pid)
        self.silent_looks = self.silent_looks + 1 if silent else 0
        self._last = self._last if reading is None else reading
        if self._first is None or self._last is None:
            return self._clock.monotonic() - self._begun
        return self._last - self._first


class ComputingProcess:
    """A computing process, which does one call at a time (``processes.child``)."""

    def __init__(self, function: str, most_bytes: int, clock: Clock) -> None:
        self._clock = clock
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = start_child(function, theirs.fileno(), most_bytes)
        self.pid: int | None = None  # None: it is not there yet, or never was
        self.spent = False  # it has ended, or is to be replaced
        self.killed = False
        self.seconds = 0.0  # of CPU, of the last call
        self._begun = False  # the call, by the process
        self._pulse: Pulse | None = None  # since it has, and before from the first look
        self._writer: asyncio.StreamWriter | None = None
        self._ending: asyncio.Future[int] | None = None
        self._opening = asyncio.get_running_loop().create_task(self._open())
        self._opening.add_done_callback(lambda opening: opening.cancelled() or opening.exception())

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    async def wait_for_birth(self) -> None:
        await asyncio.wait({self._opening})

    async def compute(
        self, call: Any, *, may_go_on: Callable[[float], bool] = lambda seconds: True,
        look: Callable[[float], None] = lambda seconds: None, hang_seconds: float = inf,
    ) -> Any:  # fmt: skip
        """What the function returns for a call.

        may_go_on: asked with the seconds that what was read is expected to take.  look: called again and again with the
        seconds of CPU taken; a TimeoutError of it ends the process.  hang_seconds: without any, which do so too.
        Raises Died, NotBegun, Defect, OutOfDate, PutBack.  Whatever ends the wait but an outcome ends the process.
        """
        self.seconds, self._begun, why, self._pulse = 0.0, False, "", None
        try:
            await self._opening
            exchange = asyncio.ensure_future(self._exchange(call, may_go_on))
            try:
                while not await self._clock.wait_async(exchange, LOOK_SECONDS):
                    self._pulse = self._pulse or self._make_pulse()
                    taken = self._pulse.look()
                    if self._begun:
                        look(taken)
                    silent = self._pulse.silent_looks * LOOK_SECONDS
                    if silent >= hang_seconds:
                        why = f"no sign of life: it used no processor time for {silent:.0f} s"
                        why += " (stopped, or waiting for what does not come) and was killed"
                        raise EOFError
                return exchange.result()
            finally:
                exchange.cancel()
        except (EOFError, ConnectionError):  # not every OSError: a TimeoutError is one
            self.kill()
            code = await self._wait()
            if code == OTHER_CODE:
                raise OutOfDate("the files of tailstack were replaced since this process was started") from None
            kind = Died if self._begun else NotBegun
            raise kind(f"the computing process ended with {why or describe_ending(code)}") from None
        except (Defect, PutBack):
            raise
        except BaseException:
            self.kill()
            raise

    async def _open(self) -> asyncio.StreamReader:
        reader, self._writer = await asyncio.open_connection(sock=self._socket)
        self.pid = await receive_async(reader)
        return reader

    def _make_pulse(self) -> Pulse:
        assert self.pid is not None
        return Pulse(self.pid, self._clock)

    async def _wait(self) -> int:
        """Its code, when it has ended."""
        self._ending = self._ending or asyncio.ensure_future(asyncio.to_thread(self._process.wait))
        return await asyncio.shield(self._ending)

    async def _exchange(self, call: Any, may_go_on: Callable[[float], bool]) -> Any:
        reader, writer = self._opening.result(), self._writer
        assert writer is not None
        writer.write(pack(call))
        await writer.drain()
        self._begun = await receive_async(reader) == BEGUN
        self._pulse = self._make_pulse()  # what it took to load the call is no part of it
        put_back: PutBack | None = None
        while isinstance(message := await receive_async(reader), float):
            if not may_go_on(message):
                put_back = PutBack(message)
            writer.write(pack(put_back is None))
        outcome, raised, tired, self.seconds = message
        self.spent = self.spent or tired
        if raised is not None:
            raise Defect(raised)
        if put_back is not None:
            raise put_back
        return outcome

    def kill(self) -> None:
        self.spent = self.killed = True
        self._process.kill()

    async def close(self) -> None:
        """Return when the process is gone."""
        with self._process:
            self._process.kill()
            self._opening.cancel()
            await self.wait_for_birth()
            if self._writer is None:
                self._socket.close()
            else:
                self._writer.close()
            await self._wait()


class Processes:
    """Computing processes: started when they are wanted, kept for the next call, replaced when they are spent.

    function: what computes a call, as "package.module:function"; the processes import it.  most_bytes: of memory of
    each; 0: any.
    """

    def __init__(self, function: str, most_bytes: int = 0, clock: Clock = SYSTEM_CLOCK) -> None:
        self._function, self._most_bytes, self._clock = function, most_bytes, clock
        self.idle: list[ComputingProcess] = []
        self._all: set[ComputingProcess] = set()
        self._endings: set[asyncio.Task[None]] = set()
        self._closing = False

    def start(self, count: int) -> None:
        """Have so many idle ones more, before they are needed.  Raises OSError."""
        self.idle += [self._new() for _ in range(count)]

    def take(self) -> ComputingProcess:
        """One that waits, or a new one; those that have ended meanwhile are nobody's loss.  Raises OSError."""
        while self.idle:
            process = self.idle.pop()
            if not process.has_ended:
                return process
            self._discard(process)
        return self._new()

    def give_back(self, process: ComputingProcess) -> None:
        if not process.spent:
            self.idle.append(process)
            return
        self._discard(process)
        if not self._closing:
            with suppress(OSError):  # who takes the next tries again, and says so
                self.start(1)

    def renew(self, count: int) -> None:
        """Replace all, those that compute when they have; have so many.  Raises OSError."""
        for process in self._all:
            process.spent = True
        while self.idle:
            self._discard(self.idle.pop())
        self.start(count - len(self._all))

    def pids(self) -> list[int]:
        """Of those that there are already."""
        return [process.pid for process in self._all if process.pid is not None]

    async def wait_for_births(self) -> None:
        for process in tuple(self._all):
            await process.wait_for_birth()

    async def close(self) -> None:
        """Kill all, and return when they are gone."""
        self._closing = True
        for process in self._all:
            process.kill()
        self.idle.clear()
        for process in tuple(self._all):
            self._discard(process)
        await asyncio.gather(*self._endings, return_exceptions=True)

    def _new(self) -> ComputingProcess:
        process = ComputingProcess(self._function, self._most_bytes, self._clock)
        self._all.add(process)
        return process

    def _discard(self, process: ComputingProcess) -> None:
        if process not in self._all:
            return
        self._all.remove(process)
        ending = asyncio.get_running_loop().create_task(process.close())
        self._endings.add(ending)
        ending.add_done_callback(self._endings.discard)
