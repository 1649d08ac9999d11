"""Whether a database can be used at this moment, asked by whoever decides where requests are sent."""

from __future__ import annotations

import sqlalchemy as sa

from tailstack.errors import Problem

from .database import Database, now, reading
from .errors import StoreUnavailable
from .workers import count_live


def look(db: Database, *, fresh_seconds: float) -> int:
    """How many workers were seen within the last ``fresh_seconds``, on whatever host.

    Raises StoreUnavailable for a database that does not answer, is read-only (a standby server) or whose disk is full,
    StoreError for one that is not to be used as it is.
    """
    with reading(db) as connection:
        if db.dialect == "postgresql" and connection.execute(_READ_ONLY).scalar_one() == "on":
            hint = "TAILSTACK_DATABASE must name the primary server"
            raise StoreUnavailable(Problem("", "read-only", "the database server accepts no writes", hint))
        live = count_live(connection, now(db, connection), fresh_seconds)
        if db.file is not None:
            db.file.require_same(and_log=True)
    if db.file is not None:
        db.file.require_room()
    return live


_READ_ONLY = sa.text("SELECT current_setting('transaction_read_only')")
