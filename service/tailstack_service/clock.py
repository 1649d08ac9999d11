"""The one clock: whatever waits, or decides by time, is given it, and a test gives one that it turns itself.

The processor time of a process is no time of a clock.  Nor is a limit after which a call of the system gives up (of a
lock, a socket, the end of a process): nothing is decided by it but that somebody looks again.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import asyncio
    import threading
    from contextlib import AbstractAsyncContextManager
    from datetime import date


class Clock:
    """The time of this machine."""

    def time(self) -> float:
        """Epoch seconds, which may be set back and forth."""
        return time.time()

    def monotonic(self) -> float:
        """Seconds that only grow, for what lies between two moments."""
        return time.monotonic()

    def today(self) -> date:
        """The day, UTC."""
        from datetime import UTC, datetime

        return datetime.fromtimestamp(self.time(), UTC).date()

    def sleep(self, seconds: float) -> None:
        """Return when so many seconds have passed."""
        time.sleep(seconds)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Return when the event is set, or so many seconds have passed; whether it is set."""
        return event.wait(seconds)

    async def sleep_async(self, seconds: float) -> None:
        """The same as ``sleep`` inside an event loop, which goes on meanwhile."""
        import asyncio

        await asyncio.sleep(seconds)

    async def wait_async(self, future: asyncio.Future[Any], seconds: float) -> bool:
        """Return when the future is done, or so many seconds have passed; whether it is done.

        It is left as it is: neither cancelled, nor is its exception raised.
        """
        import asyncio

        return bool((await asyncio.wait({future}, timeout=seconds))[0])

    def timeout(self, seconds: float) -> AbstractAsyncContextManager[object]:
        """``async with``: a block that is ended by TimeoutError when so many seconds have passed."""
        import asyncio

        return asyncio.timeout(seconds)


SYSTEM_CLOCK = Clock()
