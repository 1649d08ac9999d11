"""Answers and designs under their SHA-256, and what happens where something stored has no longer its hash.

An answer is stored once and read by the tenants that own a job with it.  Requests, parts and answers are hashed
whenever they are read.  Whatever changed one (a disk, a hand, a restored half), nothing is made of changed bytes: who
reads an answer is refused, and a job that was to be computed from the others fails.  The same request, sent again,
makes a fresh job; where that comes to the same answer, it is stored over the changed bytes.

Of the designs that a tenant sent the last so many are kept, so that requests can name one by its hash.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import Problem

from ...problems import DamagedStore
from . import tables
from .database import AnyRow, Database, insert, now, reading, writing

log = logging.getLogger("tailstack.store")

ORDER_SECONDS = 1e-6  # by which designs that are kept together follow one another
_JOB, _DESIGN = tables.jobs.c, tables.designs.c
ANSWER, REQUEST, PART = "answer", "request", "part"  # of a job
_HINT = "send the request again, under another Idempotency-Key; the operator's tailstack db check says what is damaged"


def digest(content: bytes) -> str:
    """The SHA-256 under which something is stored."""
    return hashlib.sha256(content).hexdigest()


def report_damage(what: str, sha256: str) -> DamagedStore:
    """The refusal of what is no longer stored under its hash, which is for the log, too."""
    log.error("the stored %s is damaged: %s", what, sha256, extra={"action": "damaged"})
    detail = f"the stored {what} with the SHA-256 {sha256} was changed or lost after it was recorded"
    return DamagedStore(Problem("", f"damaged-{what}", detail, _HINT))


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

    Its bytes are hashed at each read.  Raises DamagedStore if they do not have the hash, or are not there.
    """
    if not _SHA256.fullmatch(sha256):
        return None
    r, j = tables.results.c, tables.jobs.c
    owned = sa.exists().where(j.result_sha256 == sha256, j.tenant == tenant)
    query = sa.select(r.sha256, r.schema_name, r.body, r.created_at).where(r.sha256 == sha256, owned)
    with reading(db) as connection:
        row = connection.execute(query).first()
        if row is None and not connection.execute(sa.select(owned)).scalar_one():  # a purge deletes the job before it
            return None
    if row is None or digest(row.body) != sha256:
        raise report_damage(ANSWER, sha256)
    return StoredResult(*row)


# --- designs ------------------------------------------------------------------------------------------------


def keep_designs(db: Database, entries: Sequence[tuple[str, str, bytes]], most: int) -> None:
    """Keep designs (tenant, SHA-256, JSON), those that were sent last at the end; of each tenant its last ``most``."""
    with writing(db) as connection:
        at = now(db, connection)
        for tenant, sha256, body in entries:
            values: dict[str, Any] = {"tenant": tenant, "sha256": sha256, "body": body, "body_sha256": digest(body)}
            statement = insert(db.dialect, tables.designs).values(values | {"sent_at": at})
            changed = {name: statement.excluded[name] for name in ("body", "body_sha256", "sent_at")}
            changed["aged_from"] = None
            connection.execute(statement.on_conflict_do_update(index_elements=["tenant", "sha256"], set_=changed))
            at += ORDER_SECONDS
        for tenant in {tenant for tenant, _, _ in entries}:
            last = sa.select(_DESIGN.sent_at).where(_DESIGN.tenant == tenant).order_by(_DESIGN.sent_at.desc())
            oldest = last.limit(1).offset(most - 1).scalar_subquery()
            connection.execute(sa.delete(tables.designs).where(_DESIGN.tenant == tenant, _DESIGN.sent_at < oldest))


def read_design(db: Database, tenant: str, sha256: str) -> bytes | None:
    """The JSON of a design that the tenant sent; None if it is not kept, or is no longer what was kept."""
    query = sa.select(_DESIGN.body, _DESIGN.body_sha256).where(_DESIGN.tenant == tenant, _DESIGN.sha256 == sha256)
    with reading(db) as connection:
        row = connection.execute(query).first()
    return row.body if row is not None and digest(row.body) == row.body_sha256 else None
