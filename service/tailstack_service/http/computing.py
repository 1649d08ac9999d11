"""Where what is answered at once is computed: one after the other, a bounded number of them, with a way to stop each.

Whatever takes longer is a job and runs elsewhere.  Most of a score holds the GIL: two at a time take a quarter more
CPU than one after the other.  So a computation has its lane for itself, until it turns out to be a long one.

One that comes in steps begins on the event loop: handing it to a thread costs as much as a third of a score, and more
with every connection that wakes the loop meanwhile.  The loop looks at its connections between two computations, and
what is not done within HERE_SECONDS goes on in a thread from the step it has reached.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from starlette.requests import Request

from tailstack.errors import LimitError, Problem

from ..problems import TransportError

T = TypeVar("T")
Steps = Generator[None, None, T]  # a computation that can rest between two steps, and be taken up by another thread
POLL_SECONDS = 0.5  # how soon a client that went away is noticed
LEFT = "left"  # in the state of a request whose connection is lost: to ask the server takes a turn of the loop
HERE_SECONDS = 0.01  # of the event loop for one computation: others wait for no more than this and one step
TURN_SECONDS = 0.02  # after which a computation is a long one: several times what most take


class Stopped(Exception):
    """A computation was told to stop."""


class Watch:
    """Ends a computation that is late or no longer wanted, at the points where it looks."""

    def __init__(self, seconds: float, stopping: threading.Event) -> None:
        self.seconds = seconds
        self.stopping = stopping
        self.unwanted = False
        self.deadline: float | None = None
        self.late = False

    def begin(self) -> None:
        """The clock starts when computing starts, not while waiting for a place, and once."""
        if self.deadline is None:
            self.deadline = time.monotonic() + self.seconds

    def __call__(self, *_progress: Any, **_details: Any) -> None:
        if self.unwanted or self.stopping.is_set():
            raise Stopped
        if self.deadline is not None and time.monotonic() > self.deadline:
            self.late = True
            raise LimitError(
                Problem(
                    "",
                    "too-long",
                    f"the computation did not finish within the limit of {self.seconds:g} s",
                    "ask for fewer trials, targets or starts, or start the service with a higher TAILSTACK_MAX_SECONDS",
                )
            )


class _Turn:
    """A turn that was taken and ends once."""

    def __init__(self, turns: asyncio.Semaphore) -> None:
        self._turns = turns
        self._over = False

    def over(self) -> None:
        if not self._over:
            self._over = True
            self._turns.release()


class Lane:
    """A few threads and a bounded queue in front of them."""

    def __init__(self, name: str, workers: int, waiting: int) -> None:
        self.name = name
        self.places = workers + waiting
        self.taken = 0
        self._turn = asyncio.Semaphore(1)
        self._pool = ThreadPoolExecutor(max_workers=workers, thread_name_prefix=f"tailstack-{name}")

    async def run(self, request: Request, watch: Watch, compute: Callable[[], T]) -> T:
        """Compute in a thread of the lane.

        Raises TransportError (busy, stopping), Stopped if the client left, and what ``compute`` raises.
        """
        return await self.run_steps(request, watch, _in_one(compute), here_seconds=0.0)

    async def run_steps(self, request: Request, watch: Watch, steps: Steps[T], here_seconds: float = HERE_SECONDS) -> T:
        """Compute on the event loop, and in a thread what is left after ``here_seconds``.  Raises as :meth:`run`."""
        if watch.stopping.is_set():
            raise stopping_error()
        if self.taken >= self.places:
            raise self._busy()
        self.taken += 1
        waits = self._turn.locked()
        try:
            await self._turn.acquire()
        except asyncio.CancelledError:
            self.taken -= 1
            raise
        turn = _Turn(self._turn)
        try:
            if waits and request.scope.get("state", {}).get(LEFT):
                raise Stopped
            if here_seconds > 0:
                await asyncio.sleep(0)  # connections are looked at between any two computations
                watch.begin()
                until = time.monotonic() + here_seconds
                while time.monotonic() < until:
                    watch()
                    next(steps)
        except StopIteration as done:
            self._left(turn)
            return done.value  # type: ignore[no-any-return]
        except Stopped:
            self._left(turn)
            if watch.stopping.is_set():
                raise stopping_error() from None
            raise
        except BaseException:
            self._left(turn)
            raise
        return await self._in_thread(request, watch, steps, turn)

    async def _in_thread(self, request: Request, watch: Watch, steps: Steps[T], turn: _Turn) -> T:
        def rest() -> T:
            watch.begin()
            try:
                while True:
                    watch()
                    next(steps)
            except StopIteration as done:
                return done.value  # type: ignore[no-any-return]

        future = asyncio.wrap_future(self._pool.submit(rest))
        late = asyncio.get_running_loop().call_later(TURN_SECONDS, turn.over)

        def left(_future: asyncio.Future[T]) -> None:
            late.cancel()
            self._left(turn)

        future.add_done_callback(left)
        try:
            while not (await asyncio.wait({future}, timeout=POLL_SECONDS))[0]:
                if await request.is_disconnected():
                    watch.unwanted = True
            return future.result()
        except Stopped:
            if watch.stopping.is_set():
                raise stopping_error() from None
            raise
        except asyncio.CancelledError:
            watch.unwanted = True
            raise

    def _left(self, turn: _Turn) -> None:
        turn.over()
        self.taken -= 1

    def _busy(self) -> TransportError:
        return TransportError(
            "busy",
            Problem(
                "",
                "busy",
                f"{self.places} {self.name} computations are running or waiting, the limit",
                "send the request again in a few seconds, or start the service with a higher TAILSTACK_MAX_WAITING",
            ),
            {"Retry-After": "2"},
        )

    def close(self) -> None:
        """Wait for what runs (its watch has told it to stop) and drop what waits."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def _in_one(compute: Callable[[], T]) -> Steps[T]:
    """A computation as its only step."""
    yield from ()
    return compute()


def stopping_error() -> TransportError:
    return TransportError(
        "stopping", Problem("", "stopping", "the service was told to stop", "try again later"), {"Retry-After": "10"}
    )
