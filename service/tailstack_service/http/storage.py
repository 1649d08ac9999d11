"""Calls of the store, in threads of their own: the event loop never waits for a disk or a socket.

Readers and writers have theirs apart: SQLite has one writer, and while it is held up, what is there can still be read.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Concatenate, ParamSpec, TypeVar

from ..store.database import Database, open_database

P = ParamSpec("P")
T = TypeVar("T")
THREADS = 8  # of each kind; more would only wait for one another


class Storage:
    """A database that is opened on first use, and again after it could not be."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._database: Database | None = None
        self._opening = threading.Lock()
        self._readers = ThreadPoolExecutor(THREADS, thread_name_prefix="tailstack-store")
        self._writers = ThreadPoolExecutor(THREADS, thread_name_prefix="tailstack-store-write")

    async def run(self, function: Callable[Concatenate[Database, P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """``function(database, ...)``, which only reads, in a thread.

        Raises what it raises, and StoreError if nothing can be opened.
        """
        return await self._run(self._readers, lambda database: function(database, *args, **kwargs))

    async def write(self, function: Callable[Concatenate[Database, P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """The same for what writes."""
        return await self._run(self._writers, lambda database: function(database, *args, **kwargs))

    async def _run(self, pool: ThreadPoolExecutor, call: Callable[[Database], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(pool, lambda: call(self.database()))

    def database(self) -> Database:
        """The open database, for a caller that is in a thread already.  Raises StoreError."""
        with self._opening:
            if self._database is None:
                self._database = open_database(self.url)
            return self._database

    def close(self) -> None:
        """Wait for calls under way and close every connection."""
        for pool in (self._readers, self._writers):
            pool.shutdown(wait=True, cancel_futures=True)
        with self._opening:
            database, self._database = self._database, None
        if database is not None:
            database.close()
