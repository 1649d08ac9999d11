"""What was spent on a tenant's jobs, by the minute, and the figures of the whole service."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import tables
from .database import Database, insert, now, reading
from .workers import count_live

KEPT_SECONDS = 86_400.0


@dataclass(frozen=True, slots=True)
class Figures:
    """All tenants together."""

    jobs: dict[str, int]  # by state
    ready_units: int
    leased_units: int
    oldest_ready_seconds: float  # for how long the unit has waited that waits longest; 0: none waits
    recorded_units: int  # since the database was made
    cpu_seconds: float  # of those
    live_workers: int


def count_unit(db: Database, connection: Connection, tenant: str, at: float, cpu_seconds: float) -> None:
    """Count one recorded unit to the minute of ``at``."""
    values = {"tenant": tenant, "minute": int(at // 60), "units": 1, "cpu_seconds": cpu_seconds}
    connection.execute(_build_addition(db.dialect), values)


@cache
def _build_addition(dialect: str) -> Any:
    """INSERT of a row, or its addition to the one that is there."""
    statement, u = insert(dialect, tables.usage), tables.usage.c
    sums = {"units": u.units + statement.excluded.units, "cpu_seconds": u.cpu_seconds + statement.excluded.cpu_seconds}
    return statement.on_conflict_do_update(index_elements=["tenant", "minute"], set_=sums)


def sum_cpu_seconds(db: Database, tenant: str, since: float) -> float:
    """CPU seconds of units recorded since then (epoch seconds), whole minutes, the first one included.

    Minutes are told apart for the last day; what is older is one sum.  What was recorded in the future, while the clock
    was ahead, does not count.
    """
    u = tables.usage.c
    query = sa.select(sa.func.coalesce(sa.func.sum(u.cpu_seconds), 0.0))
    with reading(db) as connection:
        minutes = u.minute.between(int(since // 60), int(now(db, connection) // 60) + 1)
        return float(connection.execute(query.where(u.tenant == tenant, minutes)).scalar_one())


def fold_minutes(db: Database, connection: Connection, at: float) -> int:
    """Turn minutes older than a day into one row per tenant.  Returns how many rows that saved."""
    u = tables.usage.c
    old = sa.and_(u.minute > 0, u.minute < int((at - KEPT_SECONDS) // 60))
    sums = sa.select(u.tenant, sa.func.sum(u.units), sa.func.sum(u.cpu_seconds)).where(old).group_by(u.tenant)
    for tenant, units, cpu_seconds in connection.execute(sums.order_by(u.tenant)).all():
        values = {"tenant": tenant, "minute": 0, "units": units, "cpu_seconds": cpu_seconds}
        connection.execute(_build_addition(db.dialect), values)
    return connection.execute(sa.delete(tables.usage).where(old)).rowcount


def read_figures(db: Database, *, fresh_seconds: float = 60.0) -> Figures:
    """The service at a glance; a worker is alive if it was seen within the last ``fresh_seconds``."""
    u, s = tables.units.c, tables.usage.c
    with reading(db) as connection:
        at = now(db, connection)
        by_state = {row[0]: row[1] for row in connection.execute(_COUNTS)}
        ready = sa.select(sa.func.count(), sa.func.min(u.ready_at)).where(tables.ready)
        ready_units, oldest = connection.execute(ready).one()
        leased = sa.select(sa.func.count()).where(tables.leased)
        spent = sa.select(sa.func.coalesce(sa.func.sum(s.units), 0), sa.func.coalesce(sa.func.sum(s.cpu_seconds), 0.0))
        recorded, cpu_seconds = connection.execute(spent).one()
        return Figures(
            jobs={state: by_state.get(state, 0) for state in tables.STATES},
            ready_units=ready_units,
            leased_units=connection.execute(leased).scalar_one(),
            oldest_ready_seconds=0.0 if oldest is None else max(0.0, at - oldest),
            recorded_units=int(recorded),
            cpu_seconds=float(cpu_seconds),
            live_workers=count_live(connection, at, fresh_seconds),
        )


_COUNTS = sa.select(tables.jobs.c.state, sa.func.count()).group_by(tables.jobs.c.state)
