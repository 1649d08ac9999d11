"""Connections shared among processes that listen on one socket: whoever has fewest takes the next.

A computation occupies the event loop of its process.  Were connections taken as fast as they come, the first process
that wakes, or the only one that is not computing just then, would have them all for as long as they stay open.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable

log = logging.getLogger("tailstack.service")
WAIT_SECONDS, LONGEST_WAIT = 0.0003, 0.005  # before a connection is taken: for each that is open; at most
FULL = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
FULL_SECONDS = 1.0  # until it is tried again when the process can open nothing more


class Taking:
    """Takes connections of ``bound`` until it is closed; stands where uvicorn keeps its asyncio servers."""

    def __init__(
        self, bound: socket.socket, protocol: Callable[[], asyncio.Protocol], count: Callable[[], int]
    ) -> None:
        self._bound, self._protocol, self._count = bound, protocol, count
        self._loop = asyncio.get_running_loop()
        self._opening: set[asyncio.Task[object]] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._closed = False
        bound.setblocking(False)
        self._listen()

    def _listen(self) -> None:
        self._timer = None
        self._loop.add_reader(self._bound, self._wait)

    def _wait(self) -> None:
        """Somebody is there: give way to processes with fewer connections."""
        seconds = min(WAIT_SECONDS * self._count(), LONGEST_WAIT)
        if seconds > 0:
            self._loop.remove_reader(self._bound)
            self._timer = self._loop.call_later(seconds, self._take_and_listen)
        else:
            self._take()

    def _take_and_listen(self) -> None:
        self._listen()
        self._take()

    def _take(self) -> None:
        try:
            connection, _ = self._bound.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return  # another process was quicker, or the client has gone
        except OSError as error:
            if error.errno not in FULL:
                raise
            log.error("no connection can be taken: %s", error.strerror, extra={"action": "accept-failed"})
            self._loop.remove_reader(self._bound)
            self._timer = self._loop.call_later(FULL_SECONDS, self._listen)
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        task: asyncio.Task[object] = self._loop.create_task(
            self._loop.connect_accepted_socket(self._protocol, connection)
        )
        self._opening.add(task)
        task.add_done_callback(self._opening.discard)

    def close(self) -> None:
        """Take no more."""
        if self._closed:
            return
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        self._loop.remove_reader(self._bound)

    async def wait_closed(self) -> None:
        """Return when what was taken has become a connection."""
        if self._opening:
            await asyncio.wait(self._opening)
