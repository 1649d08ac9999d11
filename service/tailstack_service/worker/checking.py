"""Is a worker of this host alive?"""

from __future__ import annotations

import socket

from ..settings import Settings
from ..store.database import now, open_database, reading
from ..store.workers import Worker, workers

SILENCE_SECONDS = 10.0  # at least; with longer leases, workers speak less often


def live_worker(settings: Settings) -> Worker | None:
    """The worker of this host that spoke last, if that was recently.  Raises StoreError, StoreUnavailable."""
    db = open_database(settings.database_url)
    try:
        with reading(db) as connection:
            at = now(db, connection)
        silence = max(SILENCE_SECONDS, settings.lease_seconds)
        here = [worker for worker in workers(db) if worker.host == socket.gethostname()]
        return max((w for w in here if w.seen_at > at - silence), key=lambda w: w.seen_at, default=None)
    finally:
        db.close()
