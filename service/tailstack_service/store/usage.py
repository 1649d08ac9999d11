"""CPU seconds that were spent on a tenant's jobs, by the minute."""

from __future__ import annotations

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import tables
from .database import Database, insert, reading


def add_cpu_seconds(db: Database, connection: Connection, tenant: str, at: float, cpu_seconds: float) -> None:
    """Count ``cpu_seconds`` to the minute of ``at``."""
    u = tables.usage.c
    statement = insert(db, tables.usage).values(tenant=tenant, minute=int(at // 60), cpu_seconds=cpu_seconds)
    total = {"cpu_seconds": u.cpu_seconds + cpu_seconds}
    connection.execute(statement.on_conflict_do_update(index_elements=["tenant", "minute"], set_=total))


def cpu_seconds_since(db: Database, tenant: str, since: float) -> float:
    """CPU seconds of units recorded since then (epoch seconds), whole minutes, the first one included."""
    u = tables.usage.c
    query = sa.select(sa.func.coalesce(sa.func.sum(u.cpu_seconds), 0.0)).where(
        u.tenant == tenant, u.minute >= int(since // 60)
    )
    with reading(db) as connection:
        return float(connection.execute(query).scalar_one())
