"""Once an hour: what is older than it has to be goes."""

from __future__ import annotations

import logging
import random
import threading
from dataclasses import astuple

from tailstack.errors import TailstackError

from ..store.database import Database
from ..store.upkeep import purge

log = logging.getLogger("tailstack.worker")

SECONDS = 3600.0
ENDING_SECONDS = 1.0


class Tidying:
    """A thread of its own: deleting may take longer than a lease.  The first time is within the first hour."""

    def __init__(self, db: Database, keep_days: float, audit_days: float, *, seconds: float = SECONDS) -> None:
        self._db, self._keep_days, self._audit_days, self._seconds = db.endable(), keep_days, audit_days, seconds
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tailstack-tidying", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Waits for what is being deleted, which happens a few hundred rows at a time."""
        self._ending.set()
        self._db.end_within(ENDING_SECONDS)
        self._thread.join(timeout=2 * ENDING_SECONDS)

    def _run(self) -> None:
        # Several workers that were started together need not tidy at the same moment
        pause = self._seconds * random.random()
        while not self._ending.wait(pause):
            pause = self._seconds
            try:
                purged = purge(self._db, self._keep_days, self._audit_days)
            except TailstackError as error:
                log.warning("%s", error, extra={"action": "purge-failed"})
            except Exception:  # the next hour is another attempt, and jobs go on meanwhile
                log.exception("", extra={"action": "purge-failed"})
            else:
                level = logging.INFO if any(astuple(purged)) else logging.DEBUG
                log.log(level, "%s", purged, extra={"action": "purged"})
