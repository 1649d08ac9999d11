"""A clock that stands still until a test turns it: what waits by it waits for the test, and not for the machine.

It stands for the clock of a service, a worker, a database in this process.  Threads and event loops may wait by the
same one.  A test turns it when it knows that somebody waits, ``until_waits``: what is turned before is passed already.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from tailstack_service.clock import Clock
from waiting import until, until_async

BEGINNING = 1000.0  # of ``monotonic``
HAIR = 1e-9  # s more at each turn: 0.05 and 0.15 s are no less than 0.2 s, whatever they are as binary fractions
LOOK_SECONDS = 0.005  # real ones, between two looks of who waits for something else as well


class TurnedClock(Clock):
    """``jumping``: every wait passes at once, and takes the clock along."""

    def __init__(self, now: float = 1_800_000_000.0, *, jumping: bool = False) -> None:
        self.now, self._monotonic, self._jumping = now, BEGINNING, jumping
        self._turned = threading.Condition()
        self._waiting: list[tuple[float, float]] = []  # for how long and until when, s
        self.waits: list[float] = []  # for how long anybody ever waited, s

    # --- the test's side --------------------------------------------------------------------------

    @property
    def passed(self) -> float:
        """Seconds since the clock was made."""
        return round(self._monotonic - BEGINNING, 6)

    def turn(self, seconds: float) -> None:
        """Let time pass: whoever waited for a moment until then goes on."""
        with self._turned:
            self._monotonic += seconds + HAIR if seconds > 0 else 0.0
            self.now += seconds
            self._turned.notify_all()

    def turn_to(self, seconds: float) -> None:
        """The same, to so many seconds after the clock was made."""
        self.turn(seconds - self.passed)

    def until_waits(self, seconds: float) -> None:
        """Until somebody waits for just so many seconds."""
        until(self._waits_for(seconds), self._say)

    async def until_waits_async(self, seconds: float) -> None:
        """The same inside of an event loop."""
        await until_async(self._waits_for(seconds), self._say)

    def _waits_for(self, seconds: float) -> Callable[[], bool]:
        return lambda: any(one == seconds and ends > self._monotonic for one, ends in list(self._waiting))

    def _say(self) -> str:
        return f"who waits, waits for {[seconds for seconds, _ in self._waiting]} s"

    # --- the side of who is given the clock -------------------------------------------------------

    def time(self) -> float:
        return self.now

    def monotonic(self) -> float:
        return self._monotonic

    def sleep(self, seconds: float) -> None:
        with self._wait(seconds) as ends, self._turned:
            self._turned.wait_for(lambda: self._monotonic >= ends)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        with self._wait(seconds) as ends:
            while not event.is_set() and self._monotonic < ends:
                event.wait(LOOK_SECONDS)
        return event.is_set()

    async def sleep_async(self, seconds: float) -> None:
        with self._wait(seconds) as ends:
            await asyncio.sleep(0)
            while self._monotonic < ends:
                await asyncio.sleep(LOOK_SECONDS)

    async def wait_async(self, future: asyncio.Future[Any], seconds: float) -> bool:
        with self._wait(seconds) as ends:
            await asyncio.sleep(0)
            while not future.done() and self._monotonic < ends:
                await asyncio.wait({future}, timeout=LOOK_SECONDS)
        return future.done()

    @asynccontextmanager
    async def timeout(self, seconds: float) -> AsyncIterator[None]:
        async with asyncio.timeout(None) as limit:

            async def end() -> None:
                await self.sleep_async(seconds)
                limit.reschedule(asyncio.get_running_loop().time())

            ending = asyncio.create_task(end())
            try:
                yield
            finally:
                ending.cancel()

    @contextmanager
    def _wait(self, seconds: float) -> Iterator[float]:
        """One more who waits; until when."""
        with self._turned:
            one = seconds, self._monotonic + seconds
            self.waits.append(seconds)
            self._waiting.append(one)
        if self._jumping:
            self.turn(max(seconds, 0.0))
        try:
            yield one[1]
        finally:
            with self._turned:
                self._waiting.remove(one)
