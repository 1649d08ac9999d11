"""Designs that callers sent, on their way into the database, where any API process finds them by their hash.

No answer waits for them: they are written together, a moment later.  Without the database a computation is answered all
the same, and whoever then names its design is told to send it whole.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress

from tailstack.errors import TailstackError

from ..clock import SYSTEM_CLOCK, Clock

log = logging.getLogger("tailstack.service")
PAUSE_SECONDS = 0.05  # between two writes; what comes meanwhile is written with the next
FRESH_SECONDS = 5.0  # a design that was written so lately is not written again
CLOSING_SECONDS = 1.0  # for the last of them, when the service stops
MOST_WAITING = 1_000  # designs; of more, those that came first are forgotten

Key = tuple[str, str]  # tenant and SHA-256
Read = Callable[[str, str], Awaitable[bytes | None]]
Write = Callable[[list[tuple[str, str, bytes]]], Awaitable[None]]  # tenant, SHA-256 and JSON of each


class KeptDesigns:
    """What an API process knows of the designs of its callers.  For one event loop.

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
