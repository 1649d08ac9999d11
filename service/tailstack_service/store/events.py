"""What a job tells while it runs: numbered per job, written in the transaction that does what they tell."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.json_text import write_json

from . import tables
from .database import Database, reading
from .identifiers import is_job_id, storable_json


@dataclass(frozen=True, slots=True)
class Event:
    """One event.  Its data by name: ``state`` {state, result_sha256 or problem}, ``recomputed`` {from, to},
    ``progress`` {units_done, units_expected, note, eta_seconds}.
    """

    sequence: int  # of the job, from 1, without gaps
    at: float  # epoch seconds
    name: str
    data: dict[str, Any]


def tell(connection: Connection, job_id: str, sequence: int, at: float, name: str, data: dict[str, Any]) -> None:
    """Write one event; whoever calls holds the job's row and stores ``sequence`` there as ``last_event``."""
    text = storable_json(write_json(data))
    values = {"job_id": job_id, "sequence": sequence, "at": at, "name": name, "data": text}
    connection.execute(_TELL, values)


_TELL = tables.events.insert()


def eta_seconds(started_at: float | None, done: int, expected: int, now: float) -> float | None:
    """Seconds to the end at the pace so far; None until a second unit is recorded, because the first only plans."""
    if started_at is None or done <= 1:
        return None
    return max(0.0, round((now - started_at) / done * (expected - done), 3))


def events_after(db: Database, tenant: str, job_id: str, sequence: int, limit: int) -> list[Event]:
    """At most ``limit`` events of a tenant's job that follow ``sequence`` (0: from the first), in order."""
    if not is_job_id(job_id):
        return []
    e, j = tables.events, tables.jobs
    query = (
        sa.select(e.c.sequence, e.c.at, e.c.name, e.c.data)
        .join(j, j.c.id == e.c.job_id)
        .where(e.c.job_id == job_id, j.c.tenant == tenant, e.c.sequence > sequence)
        .order_by(e.c.sequence)
        .limit(limit)
    )
    with reading(db) as connection:
        rows = connection.execute(query).all()
    return [Event(row.sequence, row.at, row.name, json.loads(row.data)) for row in rows]
