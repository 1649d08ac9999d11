"""Workers that say they are alive: how many there are, and which versions of the solver are at work."""

from __future__ import annotations

from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import Problem

from ...problems import StoreUnavailable
from . import tables
from .database import Database, insert, now, reading, writing

_WORKER = tables.workers.c


@dataclass(frozen=True, slots=True)
class WorkerEntry:
    """One worker process.  Times are epoch seconds of the database's clock."""

    id: str
    host: str
    pid: int
    solver_version: str
    engine: str
    capacity: int  # units computed at once
    started_at: float
    seen_at: float


def report_alive(
    db: Database, worker_id: str, host: str, pid: int, solver_version: str, engine: str, capacity: int
) -> None:
    """Say that this worker is alive: before its first claim, then more often than its leases run out."""
    with writing(db) as connection:
        at = now(db, connection)
        values = {"host": host, "pid": pid, "solver_version": solver_version, "engine": engine, "capacity": capacity}
        values["seen_at"] = at
        statement = insert(db.dialect, tables.workers).values(id=worker_id, started_at=at, **values)
        connection.execute(statement.on_conflict_do_update(index_elements=["id"], set_=values))


def list_workers(db: Database) -> list[WorkerEntry]:
    """Every worker that has not said goodbye, also one that has fallen silent; the oldest first."""
    columns = [_WORKER[name] for name in WorkerEntry.__dataclass_fields__]
    query = sa.select(*columns).order_by(_WORKER.started_at, _WORKER.id)
    with reading(db) as connection:
        return [WorkerEntry(*row) for row in connection.execute(query)]


def remove_worker(db: Database, worker_id: str) -> None:
    """Forget a worker that ends in order: jobs of its version need not wait until it counts as dead."""
    with writing(db) as connection:
        connection.execute(sa.delete(tables.workers).where(_WORKER.id == worker_id))


def versions_at_work(connection: Connection, at: float, fresh_seconds: float) -> set[str]:
    """Solver versions of the workers that were seen within the last ``fresh_seconds``."""
    return set(connection.execute(_VERSIONS, _bound_silence(at, fresh_seconds)).scalars())


def count_live(connection: Connection, at: float, fresh_seconds: float) -> int:
    """Workers that were seen within the last ``fresh_seconds``."""
    return int(connection.execute(_LIVE, _bound_silence(at, fresh_seconds)).scalar_one())


def _bound_silence(at: float, fresh_seconds: float) -> dict[str, float]:
    return {"since": at - fresh_seconds, "until": at + fresh_seconds}


# Who was seen in the future spoke while the clock was ahead, and since then perhaps no more
_SEEN_LATELY = sa.and_(_WORKER.seen_at > sa.bindparam("since"), _WORKER.seen_at < sa.bindparam("until"))
_VERSIONS = sa.select(_WORKER.solver_version).where(_SEEN_LATELY).distinct()
_LIVE = sa.select(sa.func.count()).select_from(tables.workers).where(_SEEN_LATELY)


def check_readiness(db: Database, *, fresh_seconds: float) -> int:
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
