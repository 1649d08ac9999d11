"""Jobs as their tenant sees them: submitted, looked at, listed, cancelled."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import Problem

from ...problems import IdempotencyConflict, QueueFull
from ...processes.task import ADVANCE
from . import tables
from .database import AnyRow, Database, now, reading, writing
from .events import end_job, write_event
from .queue import make_unit
from .results import digest
from .tables import is_job_id, new_job_id, storable


@dataclass(frozen=True, slots=True)
class Job:
    """One job.  Times are epoch seconds of the database's clock."""

    id: str
    tenant: str
    kind: str
    request_sha256: str
    design_name: str
    solver_version: str
    request_id: str
    created_at: float
    state: str = "queued"  # running, succeeded, failed, cancelled
    started_at: float | None = None
    finished_at: float | None = None
    units_done: int = 0
    units_expected: int = 1
    note: str = ""
    result_sha256: str | None = None
    problem: dict[str, Any] | None = None
    generation: int = 1  # 1 more after each time that another solver version began it anew
    cpu_seconds: float = 0.0
    last_event: int = 1

    @property
    def is_over(self) -> bool:
        return self.state not in tables.UNFINISHED


@dataclass(frozen=True, slots=True)
class JobsPage:
    """Jobs, newest first; ``next`` is the cursor of those that follow, None at the end."""

    jobs: tuple[Job, ...]
    next: str | None
    at: float  # when they were so, by the database's clock, as their own times are


_JOB = tables.jobs.c
_COLUMNS = [_JOB[name] for name in Job.__dataclass_fields__]


def _make_job(row: AnyRow) -> Job:
    return Job(**{**row._mapping, "problem": json.loads(row.problem) if row.problem else None})


def submit_job(
    db: Database, *, tenant: str, kind: str, request: bytes, design_name: str, solver_version: str, request_id: str,
    idempotency_key: str | None = None, max_queued: int,
) -> tuple[Job, bool]:  # fmt: skip
    """The new job and True, or the job that this ``idempotency_key`` made before and False.

    Keys live as long as their job.  Raises IdempotencyConflict (the key came with another request), QueueFull.
    """
    sha256 = digest(request)
    with writing(db) as connection:
        _lock_tenant(db, connection, tenant)
        if idempotency_key is not None:
            earlier = _select_job(connection, _JOB.tenant == tenant, _JOB.idempotency_key == idempotency_key)
            if earlier is not None:
                if (earlier.kind, earlier.request_sha256) != (kind, sha256):
                    detail = f"this key made job {earlier.id} ({earlier.kind}) from a request with another content"
                    hint = "send a new key with a new request"
                    raise IdempotencyConflict(Problem("", "idempotency-conflict", detail, hint))
                return earlier, False
        unfinished = sa.select(sa.func.count()).where(_JOB.tenant == tenant, _JOB.state.in_(tables.UNFINISHED))
        if connection.execute(unfinished).scalar_one() >= max_queued:
            hint = "wait until some have finished or cancel them; the operator's setting is TAILSTACK_MAX_QUEUED_JOBS"
            raise QueueFull(Problem("", "queue-full", f"at most {max_queued} unfinished jobs at a time", hint))
        at = now(db, connection)
        last = connection.execute(sa.select(sa.func.max(tables.jobs.c.id))).scalar_one()
        job = Job(
            id=new_job_id(at, last), tenant=tenant, kind=kind, request_sha256=sha256, design_name=storable(design_name),
            solver_version=solver_version, request_id=request_id, created_at=at,
        )  # fmt: skip
        connection.execute(tables.jobs.insert(), asdict(job) | {"idempotency_key": idempotency_key})
        connection.execute(tables.requests.insert(), {"job_id": job.id, "body": request})
        connection.execute(tables.units.insert(), make_unit(job.id, 0, ADVANCE, at))
        write_event(connection, job.id, 1, at, "state", {"state": "queued"})
    return job, True


def _lock_tenant(db: Database, connection: Connection, tenant: str) -> None:
    """Submissions of one tenant queue up: two equal ones make one job, and the limit holds exactly."""
    if db.dialect == "postgresql":
        connection.execute(sa.text("SELECT pg_advisory_xact_lock(1413564243, hashtext(:tenant))"), {"tenant": tenant})


def find_job(db: Database, tenant: str, job_id: str) -> Job | None:
    """A tenant's job; None for one that does not exist or is another's."""
    if not is_job_id(job_id):
        return None
    with reading(db) as connection:
        return _select_job(connection, _JOB.id == job_id, _JOB.tenant == tenant)


def _select_job(connection: Connection, *conditions: sa.ColumnElement[bool], lock: bool = False) -> Job | None:
    query = sa.select(*_COLUMNS).where(*conditions)
    row = connection.execute(query.with_for_update() if lock else query).first()
    return _make_job(row) if row else None


def list_page(
    db: Database, tenant: str, *, state: str | None = None, kind: str | None = None, after: str | None = None,
    limit: int,
) -> JobsPage:  # fmt: skip
    """A tenant's jobs, newest first.  ``after`` is the ``next`` of the page before; ValueError for any other."""
    query = sa.select(*_COLUMNS).where(_JOB.tenant == tenant).order_by(_JOB.id.desc()).limit(limit + 1)
    if state is not None:
        query = query.where(_JOB.state == state)
    if kind is not None:
        query = query.where(_JOB.kind == kind)
    if after is not None:
        query = query.where(_JOB.id < _read_cursor(after))
    with reading(db) as connection:
        jobs, at = [_make_job(row) for row in connection.execute(query)], now(db, connection)
    shown = tuple(jobs[:limit])
    cursor = base64.urlsafe_b64encode(shown[-1].id.encode()).decode().rstrip("=") if len(jobs) > limit else None
    return JobsPage(shown, cursor, at)


def _read_cursor(cursor: str) -> str:
    try:
        job_id = base64.b64decode(cursor.encode("ascii") + b"=" * (-len(cursor) % 4), b"-_", validate=True).decode()
    except ValueError:
        job_id = ""
    if not is_job_id(job_id):
        raise ValueError("not a cursor of this list")
    return job_id


def cancel_job(db: Database, tenant: str, job_id: str) -> Job | None:
    """Cancel at once and give the job as it then is: what is still being computed can no longer be recorded.

    A job that has already finished stays as it is.  None for one that does not exist or is another's.
    """
    if not is_job_id(job_id):
        return None
    mine = _JOB.id == job_id, _JOB.tenant == tenant
    with writing(db) as connection:
        job = _select_job(connection, *mine, lock=True)
        if job is None or job.is_over:
            return job
        end_job(connection, job, now(db, connection), "cancelled")
        return _select_job(connection, *mine)
