"""Calls of the store, in threads of their own: the event loop never waits for a disk or a socket."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Concatenate, ParamSpec, TypeVar

from ..store.database import Database, open_database

P = ParamSpec("P")
T = TypeVar("T")
THREADS = 8  # more would only wait for one another: SQLite has one writer


class Storage:
    """A database that is opened on first use, and again after it could not be."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._database: Database | None = None
        self._opening = threading.Lock()
        self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="tailstack-store")

    async def run(self, function: Callable[Concatenate[Database, P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """``function(database, ...)`` in a thread.  Raises what it raises, and StoreError if nothing can be opened."""

        def call() -> T:
            return function(self.database(), *args, **kwargs)

        return await asyncio.get_running_loop().run_in_executor(self._pool, call)

    def database(self) -> Database:
        """The open database, for a caller that is in a thread already.  Raises StoreError."""
        with self._opening:
            if self._database is None:
                self._database = open_database(self.url)
            return self._database

    def close(self) -> None:
        """Wait for calls under way and close every connection."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        with self._opening:
            database, self._database = self._database, None
        if database is not None:
            database.close()
