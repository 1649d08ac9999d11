"""Answers under the SHA-256 of their bytes, and what happens where something stored has no longer its hash.

An answer is stored once and read by the tenants that own a job with it.  Requests, parts and answers are hashed
whenever they are read.  Whatever changed one (a disk, a hand, a restored half), nothing is made of changed bytes: the
job fails, and says so.  Its Idempotency-Key is free again, so that the same request, sent again, makes a fresh job; and
where that comes to the same answer, it is stored anew.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import Problem

from ...problems import DamagedStore
from . import tables
from .database import AnyRow, Database, insert, now, reading, writing
from .events import end_job, render_problem

log = logging.getLogger("tailstack.store")

_JOB = tables.jobs.c
_RESULT = tables.results.c
_DAMAGE = tables.damages.c

ANSWER, REQUEST, PART = "answer", "request", "part"  # of a job
_HINT = "send the request again: it makes a new job; the operator's tailstack db check says what else is damaged"


def digest(content: bytes) -> str:
    """The SHA-256 under which something is stored."""
    return hashlib.sha256(content).hexdigest()


def damage_error(what: str, sha256: str) -> DamagedStore:
    """The refusal of what is no longer stored under its hash."""
    detail = f"the stored {what} with the SHA-256 {sha256} was changed or lost after it was recorded"
    return DamagedStore(Problem("", f"damaged-{what}", detail, _HINT))


def fail_job(connection: Connection, job: AnyRow, at: float, what: str, sha256: str) -> None:
    """End a job because of what is damaged; the caller holds its row (``id``, ``last_event``, ``finished_at``)."""
    finished_at = at if job.finished_at is None else job.finished_at
    problem = render_problem(damage_error(what, sha256))
    end_job(connection, job, at, "failed", problem=problem, finished_at=finished_at, idempotency_key=None)
    connection.execute(tables.damages.insert(), {"job_id": job.id, "what": what, "sha256": sha256, "found_at": at})
    log.error("the stored %s is damaged: %s", what, sha256, extra={"action": "damaged", "job": job.id})


def condemn(db: Database, sha256: str) -> int:
    """Fail every job whose answer is stored under this hash and is no longer it, and delete the bytes.

    Returns how many jobs that were: none if the bytes turn out to be right, since somebody stored them anew, say.
    """
    with writing(db) as connection:
        body = connection.execute(sa.select(_RESULT.body).where(_RESULT.sha256 == sha256).with_for_update()).scalar()
        if body is not None and digest(body) == sha256:
            return 0
        columns = sa.select(_JOB.id, _JOB.last_event, _JOB.finished_at).order_by(_JOB.id).with_for_update()
        jobs = connection.execute(columns.where(_JOB.result_sha256 == sha256)).all()
        at = now(db, connection)
        for job in jobs:
            fail_job(connection, job, at, ANSWER, sha256)
        connection.execute(sa.delete(tables.results).where(_RESULT.sha256 == sha256))
    return len(jobs)


def was_condemned(connection: Connection, tenant: str, sha256: str) -> bool:
    """Whether one of the tenant's jobs came to this answer, and the answer was found damaged."""
    query = sa.exists().where(
        _DAMAGE.sha256 == sha256, _DAMAGE.what == ANSWER, _DAMAGE.job_id == _JOB.id, _JOB.tenant == tenant
    )
    return bool(connection.execute(sa.select(query)).scalar_one())


def count_damaged(connection: Connection) -> int:
    """Jobs that failed because of what was found damaged, among those that are still kept."""
    return int(connection.execute(sa.select(sa.func.count()).select_from(tables.damages)).scalar_one())


def find_changed_results(connection: Connection) -> Iterator[str]:
    """The names of results that do not hash to them."""
    r = tables.results
    for name in connection.execute(sa.select(r.c.sha256).order_by(r.c.sha256)).scalars().all():
        if digest(connection.execute(sa.select(r.c.body).where(r.c.sha256 == name)).scalar_one()) != name:
            yield name


def find_changed_requests(connection: Connection) -> Iterator[str]:
    """The ids of jobs whose request does not have the hash that it came with."""
    query = sa.select(_JOB.id, _JOB.request_sha256, tables.requests.c.body).join(tables.requests)
    return _find_differing(connection.execute(query.execution_options(yield_per=20)))


def find_changed_parts(connection: Connection) -> Iterator[str]:
    """The ids of unfinished jobs with a recorded unit whose result does not have the hash that it was recorded with."""
    u = tables.units.c
    query = sa.select(u.job_id, u.result_sha256, u.result).where(u.result.is_not(None), u.result_sha256.is_not(None))
    return _find_differing(connection.execute(query.execution_options(yield_per=20)))


def _find_differing(rows: Iterable[AnyRow]) -> Iterator[str]:
    return (name for name, sha256, content in rows if digest(content) != sha256)


_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class StoredResult:
    """An immutable document."""

    sha256: str
    schema_name: str
    body: bytes  # JSON, as published
    created_at: float


def store_result(db: Database, connection: Connection, schema_name: str, body: bytes, at: float) -> str:
    """Store an answer, once.  Returns its name."""
    sha256 = digest(body)
    values = {"sha256": sha256, "schema_name": schema_name, "body": body, "created_at": at}
    statement = insert(db.dialect, tables.results).values(values)
    # Writing the row that is there holds it against a purge, until the job that now refers to it is committed; and
    # heals it, should its bytes have been changed
    healed = {"schema_name": statement.excluded.schema_name, "body": statement.excluded.body}
    connection.execute(statement.on_conflict_do_update(index_elements=["sha256"], set_=healed))
    return sha256


def read_result(db: Database, tenant: str, sha256: str) -> StoredResult | None:
    """A result that one of the tenant's jobs came to; None for any other.

    Its bytes are hashed at each read.  Raises DamagedStore if they do not have the hash, after every job that came to
    the result has been failed.
    """
    if not _SHA256.fullmatch(sha256):
        return None
    result, known = _read_row(db, tenant, sha256)
    if known and (result is None or digest(result.body) != sha256):
        if condemn(db, sha256):
            raise damage_error(ANSWER, sha256)
        result, known = _read_row(
            db, tenant, sha256
        )  # stored anew meanwhile, or not damaged at all: a reader's own fault
        if known and (result is None or digest(result.body) != sha256):
            raise damage_error(ANSWER, sha256)
    return result


def _read_row(db: Database, tenant: str, sha256: str) -> tuple[StoredResult | None, bool]:
    """What is stored, and whether a job of the tenant came to it; what was condemned is no longer stored."""
    r, j = tables.results.c, tables.jobs.c
    owned = sa.exists().where(j.result_sha256 == sha256, j.tenant == tenant)
    query = sa.select(r.sha256, r.schema_name, r.body, r.created_at).where(r.sha256 == sha256, owned)
    with reading(db) as connection:
        row = connection.execute(query).first()
        if row is not None:
            return StoredResult(*row), True
        if connection.execute(sa.select(owned)).scalar_one():
            return None, True
        if was_condemned(connection, tenant, sha256):
            raise damage_error(ANSWER, sha256)
    return None, False
