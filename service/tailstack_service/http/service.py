"""What every request shares: settings, places to compute, the database, who may ask, what is counted.

Endpoints declare in their signatures and decorators which of it they need.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, Any, Concatenate, Literal, ParamSpec, TypeVar

from fastapi import Depends
from starlette.requests import Request

from tailstack.errors import Problem, TailstackError

from ..clock import SYSTEM_CLOCK, Clock
from ..jobs.store import audit, database
from ..jobs.store.database import Database
from ..jobs.store.schema import open_database
from ..operations.request import refuse_query
from ..problems import StoreUnavailable
from ..settings import Settings
from .access import Access, Caller
from .compute_pool import ComputePool
from .metrics import Metrics

Seat = Literal["seated", "share taken", "all taken"]
log = logging.getLogger("tailstack.service")
P = ParamSpec("P")
T = TypeVar("T")
THREADS = 8  # of each kind; more would only wait for one another
LOOK_SECONDS = 2.0  # for a database to show that it can be used
LATE_SECONDS = 0.5  # that a call is waited for after it should have given itself up
ENDING_SECONDS = 2.0  # for calls under way when the service stops


class Storage:
    """A database that is opened on first use, and again after it could not be.

    It is called in threads of its own: the event loop never waits for a disk or a socket.  Readers and writers have
    theirs apart: SQLite has one writer, and while it is held up, what is there can still be read.  Nobody waits longer
    than ``BUSY_SECONDS``, whatever the database does: a transaction gives itself up in time where that is possible
    (PostgreSQL), and where it is not (a disk that does not answer) its caller stops waiting for it.  A call that was
    given up keeps its thread until it ends; there are never more of them than threads.
    """

    def __init__(self, url: str, clock: Clock = SYSTEM_CLOCK) -> None:
        self.url, self.clock = url, clock
        self._database: Database | None = None
        self._opening = threading.Lock()
        self._readers = ThreadPoolExecutor(THREADS, thread_name_prefix="tailstack-store")
        self._writers = ThreadPoolExecutor(THREADS, thread_name_prefix="tailstack-store-write")
        self._lookers = ThreadPoolExecutor(1, thread_name_prefix="tailstack-store-look")
        self._look: Future[int] | None = None

    async def run(self, function: Callable[Concatenate[Database, P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """``function(database, ...)``, which only reads, in a thread.

        Raises what it raises, StoreError if nothing can be opened, and StoreUnavailable if it takes too long.
        """
        return await self._run(self._readers, lambda database: function(database, *args, **kwargs))

    async def write(self, function: Callable[Concatenate[Database, P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """The same for what writes."""
        return await self._run(self._writers, lambda database: function(database, *args, **kwargs))

    async def _run(self, pool: ThreadPoolExecutor, call: Callable[[Database], T]) -> T:
        future = pool.submit(lambda: call(self.database()))
        try:
            return await _await(future, database.BUSY_SECONDS + LATE_SECONDS, self.clock)
        finally:
            future.cancel()  # of no effect unless it has not begun: then nobody waits for it any more

    async def look(self, function: Callable[[Database], int]) -> int:
        """``function(database)`` within ``LOOK_SECONDS``: has a thread to itself, which all who look share.

        Raises StoreUnavailable if no answer comes in that time, and what ``function`` raises.
        """
        if self._look is None or self._look.done():
            self._look = self._lookers.submit(lambda: function(self.database(LOOK_SECONDS).within(LOOK_SECONDS)))
        return await _await(self._look, LOOK_SECONDS + LATE_SECONDS, self.clock)

    def database(self, seconds: float | None = None) -> Database:
        """The open database, for a caller that is in a thread already.  Raises StoreError, StoreUnavailable."""
        limit = database.BUSY_SECONDS if seconds is None else seconds
        if not self._opening.acquire(timeout=limit):
            raise _timeout_error(limit)
        try:
            if self._database is None:
                self._database = open_database(self.url, seconds=limit, clock=self.clock)
            return self._database
        finally:
            self._opening.release()

    def close(self) -> None:
        """Let calls under way end, within ``ENDING_SECONDS`` if the database lets them, and close every connection."""
        if self._database is not None:
            self._database.end_within(ENDING_SECONDS)
        for pool in (self._readers, self._writers, self._lookers):
            pool.shutdown(wait=True, cancel_futures=True)
        closing, self._database = self._database, None
        if closing is not None:
            closing.close()


async def _await(future: Future[T], seconds: float, clock: Clock) -> T:
    """The result of a call in a thread.  Raises what it raises, StoreUnavailable after so many seconds."""
    waiting = asyncio.wrap_future(future)
    waiting.add_done_callback(lambda ended: ended.cancelled() or ended.exception())  # nobody may be there to look
    if not await clock.wait_async(waiting, seconds):
        raise _timeout_error(seconds)
    return waiting.result()


def _timeout_error(seconds: float) -> StoreUnavailable:
    detail = f"the database did not answer within {seconds:g} s"
    hint = "try again in a moment; the server, or the disk, must answer"
    return StoreUnavailable(Problem("", "store-unavailable", detail, hint))


# --- designs that later requests may name ---------------------------------------------------------------

PAUSE_SECONDS = 0.05  # between two writes; what comes meanwhile is written with the next
FRESH_SECONDS = 5.0  # a design that was written so lately is not written again
CLOSING_SECONDS = 1.0  # for the last of them, when the service stops
MOST_WAITING = 1_000  # designs; of more, those that came first are forgotten

Key = tuple[str, str]  # tenant and SHA-256
Read = Callable[[str, str], Awaitable[bytes | None]]
Write = Callable[[list[tuple[str, str, bytes]]], Awaitable[None]]  # tenant, SHA-256 and JSON of each


class KeptDesigns:
    """Designs that callers sent, on their way into the database, where any API process finds them by their hash.

    No answer waits for them: they are written together, a moment later.  Without the database a computation is answered
    all the same, and whoever then names its design is told to send it whole.  For one event loop.

    ``read`` and ``write`` are those of the database; with ``off`` nothing is kept.
    """

    def __init__(self, read: Read, write: Write, *, off: bool = False, clock: Clock = SYSTEM_CLOCK) -> None:
        self._read, self._write, self._off, self._clock = read, write, off, clock
        self._waiting: dict[Key, bytes] = {}
        self._on_the_way: dict[Key, bytes] = {}
        self._written: dict[Key, float] = {}  # when, in the order of writing
        self._writer: asyncio.Task[None] | None = None

    def keep(self, tenant: str, sent: Iterable[tuple[str, bytes]]) -> None:
        """Keep designs: SHA-256 and JSON of each."""
        if self._off:
            return
        self._forget_old()
        for sha256, body in sent:
            if (tenant, sha256) not in self._written:
                self._waiting[tenant, sha256] = body
        while len(self._waiting) > MOST_WAITING:
            del self._waiting[next(iter(self._waiting))]
        if self._waiting and (self._writer is None or self._writer.done()):
            self._writer = asyncio.get_running_loop().create_task(self._write_all(PAUSE_SECONDS))

    async def find(self, tenant: str, sha256: str) -> bytes | None:
        """The JSON of a design that the tenant sent to this or another API process.  Raises StoreUnavailable."""
        key = tenant, sha256
        body = self._waiting.get(key) or self._on_the_way.get(key)
        for pause in (0.0, 4 * PAUSE_SECONDS):  # another process may be about to write it
            if body is None:
                await self._clock.sleep_async(pause)
                body = await self._read(tenant, sha256)
        if body is None:
            self._written.pop(key, None)  # sent whole again it is written again
        return body

    async def close(self) -> None:
        """Write what has not been written yet."""
        if self._writer is not None:
            self._writer.cancel()
            await asyncio.gather(self._writer, return_exceptions=True)
        self._waiting = {**self._on_the_way, **self._waiting}
        with suppress(TimeoutError):
            async with self._clock.timeout(CLOSING_SECONDS):
                await self._write_all(0.0)

    async def _write_all(self, pause_seconds: float) -> None:
        while self._waiting:
            await self._clock.sleep_async(pause_seconds)
            self._on_the_way, self._waiting = self._waiting, {}
            entries = [(tenant, sha256, body) for (tenant, sha256), body in self._on_the_way.items()]
            try:
                await self._write(entries)
            except TailstackError as error:
                fields = {"action": "not-kept", "detail": f"{len(entries)} designs"}
                log.warning("designs that were sent cannot be named later: %s", error, extra=fields)
            else:
                self._written |= dict.fromkeys(self._on_the_way, self._clock.monotonic())
            self._on_the_way = {}

    def _forget_old(self) -> None:
        end = self._clock.monotonic() - FRESH_SECONDS
        while self._written and self._written[next(iter(self._written))] < end:
            del self._written[next(iter(self._written))]


# --- an API process -----------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class Service:
    """One API process."""

    settings: Settings
    stopping: threading.Event  # ends computations, waits and event streams
    storage: Storage
    access: Access
    metrics: Metrics
    kept_designs: KeptDesigns
    pool: ComputePool  # for what is computed while the caller waits
    clock: Clock = SYSTEM_CLOCK
    seats: Counter[str] = field(default_factory=Counter)  # taken by streams and waits, by tenant; the event loop's own

    def seat(self, tenant: str) -> Seat:
        """Take a seat, which whoever stays connected needs, if there is one.

        All may be taken, or the tenant's share of them, so that no tenant keeps the others out.
        """
        if self.access.required and self.seats[tenant] >= self.settings.max_tenant_streams:
            return "share taken"
        if self.seats.total() >= self.settings.max_streams:
            return "all taken"
        self.seats[tenant] += 1
        return "seated"

    def leave(self, tenant: str) -> None:
        """Give the seat back."""
        self.seats[tenant] -= 1
        if not self.seats[tenant]:
            del self.seats[tenant]


def service_of(request: Request) -> Service:
    service: Service = request.app.state.service
    return service


async def note_policy(request: Request, terms: dict[str, Any]) -> None:
    """Write into the audit log by what a gate of the caller was judged, if that differs from the last time.

    Without the database the gate is answered all the same, and the log of the service says what the audit log lacks:
    an analytic gate needs no database, and whoever could have it refused by stopping that could stop the gate itself.
    """
    caller = request.state.caller
    try:
        await service_of(request).storage.write(audit.note_policy, caller.name, caller.tenant, terms)
    except TailstackError as error:
        fields = {"action": "not-audited", "request": request.state.request_id, "tenant": caller.tenant}
        log.warning("by what a gate was judged is not in the audit log: %s", error, extra=fields)


# --- what endpoints declare in their signatures and decorators -------------------------------------------


class Needs:
    """Admits callers who have a scope, and remembers who it was for the log."""

    def __init__(self, scope: str) -> None:
        self.scope = scope

    async def __call__(self, request: Request) -> Caller:
        caller: Caller = await service_of(request).access.admit(request, self.scope)
        request.state.caller = caller
        return caller


def query(*known: str) -> Callable[[Request], Awaitable[None]]:
    """Refuses every query parameter but these."""

    async def check(request: Request) -> None:
        refuse_query(request.query_params.multi_items(), known)

    return check


TheService = Annotated[Service, Depends(service_of)]
