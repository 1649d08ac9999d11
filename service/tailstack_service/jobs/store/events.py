"""The course of a job: numbered events, each written in the transaction that does what it says, and the job's end."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import TailstackError
from tailstack.results.json_text import write_json

from ...problems import problem_document
from . import tables
from .database import Database, reading
from .tables import is_job_id, storable_json


@dataclass(frozen=True, slots=True)
class Event:
    """One event.  Its data by name: ``state`` {state, result_sha256 or problem}, ``recomputed`` {from, to},
    ``progress`` {units_done, units_expected, note, eta_seconds}.
    """

    sequence: int  # of the job, from 1, without gaps
    at: float  # epoch seconds
    name: str
    data: dict[str, Any]


class ChangingJob(Protocol):
    """What is needed of the row of a job to change it."""

    @property
    def id(self) -> str: ...

    @property
    def last_event(self) -> int: ...


def write_event(connection: Connection, job_id: str, sequence: int, at: float, name: str, data: dict[str, Any]) -> None:
    """Write one event; whoever calls holds the job's row and stores ``sequence`` there as ``last_event``."""
    text = storable_json(write_json(data))
    connection.execute(_INSERT, {"job_id": job_id, "sequence": sequence, "at": at, "name": name, "data": text})


def change_job(
    connection: Connection, job: ChangingJob, at: float, *events: tuple[str, dict[str, Any]], **columns: Any
) -> None:
    """Change columns of a job whose row the caller holds, and write the events that say so: their names and data."""
    last_event = job.last_event + len(events)
    connection.execute(_UPDATE, {"of_job": job.id, "last_event": last_event, **columns})
    for sequence, (name, data) in enumerate(events, job.last_event + 1):
        write_event(connection, job.id, sequence, at, name, data)


# Built once: putting a statement together takes longer than running it
_INSERT = tables.events.insert()
_UPDATE = sa.update(tables.jobs).where(tables.jobs.c.id == sa.bindparam("of_job"))
_OF_JOB = tables.units.c.job_id == sa.bindparam("of_job")
_DELETE_OPEN_UNITS = sa.delete(tables.units).where(_OF_JOB, tables.units.c.state != tables.RECORDED)
_EMPTY_UNITS = sa.update(tables.units).where(_OF_JOB).values(spec=None, result=None, result_sha256=None)


def estimate_eta_seconds(started_at: float | None, done: int, expected: int, now: float) -> float | None:
    """Seconds to the end at the pace so far; None until a second unit is recorded, because the first only plans."""
    if started_at is None or done <= 1:
        return None
    return max(0.0, round((now - started_at) / done * (expected - done), 3))


def read_events(db: Database, tenant: str, job_id: str, sequence: int, limit: int) -> list[Event]:
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


def end_job(
    connection: Connection, job: ChangingJob, at: float, state: str, *, result_sha256: str | None = None,
    problem: bytes | None = None, **columns: Any,
) -> None:  # fmt: skip
    """End a job whose row the caller holds; ``columns`` change with it.

    Units that are not recorded go; of those that are, the token stays, which tells a worker that asks again whether
    its record went through.
    """
    connection.execute(_DELETE_OPEN_UNITS, {"of_job": job.id})
    connection.execute(_EMPTY_UNITS, {"of_job": job.id})
    text = None if problem is None else storable_json(write_json(json.loads(problem)))
    values = {"state": state, "finished_at": at, "note": "", "result_sha256": result_sha256, "problem": text}
    data: dict[str, Any] = {"state": state}
    if result_sha256 is not None:
        data["result_sha256"] = result_sha256
    if text is not None:
        data["problem"] = json.loads(text)
    change_job(connection, job, at, ("state", data), **values | columns)


def render_problem(error: TailstackError) -> bytes:
    """A refusal as a problem document in JSON, without instance."""
    return storable_json(write_json(asdict(problem_document(error, instance="")))).encode()
