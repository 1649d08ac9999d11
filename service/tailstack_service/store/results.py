"""Answers, named by the SHA-256 of their bytes; kept once, read by the tenants that own a job with them."""

from __future__ import annotations

import re
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import tables
from .damage import ANSWER, condemn, damaged, digest, was_condemned
from .database import Database, insert, reading

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class Result:
    """An immutable document."""

    sha256: str
    schema_name: str
    body: bytes  # JSON, as published
    created_at: float


def keep(db: Database, connection: Connection, schema_name: str, body: bytes, at: float) -> str:
    """Store an answer, once.  Returns its name."""
    sha256 = digest(body)
    values = {"sha256": sha256, "schema_name": schema_name, "body": body, "created_at": at}
    statement = insert(db.dialect, tables.results).values(values)
    # Writing the row that is there holds it against a purge, until the job that now refers to it is committed; and
    # heals it, should its bytes have been changed
    healed = {"schema_name": statement.excluded.schema_name, "body": statement.excluded.body}
    connection.execute(statement.on_conflict_do_update(index_elements=["sha256"], set_=healed))
    return sha256


def get(db: Database, tenant: str, sha256: str) -> Result | None:
    """A result that one of the tenant's jobs came to; None for any other.

    Its bytes are hashed at each read.  Raises DamagedStore if they do not have the hash, after every job that came to
    the result has been failed.
    """
    if not _SHA256.fullmatch(sha256):
        return None
    result, known = _read(db, tenant, sha256)
    if known and (result is None or digest(result.body) != sha256):
        if condemn(db, sha256):
            raise damaged(ANSWER, sha256)
        result, known = _read(db, tenant, sha256)  # stored anew meanwhile, or not damaged at all: a reader's own fault
        if known and (result is None or digest(result.body) != sha256):
            raise damaged(ANSWER, sha256)
    return result


def _read(db: Database, tenant: str, sha256: str) -> tuple[Result | None, bool]:
    """What is stored, and whether a job of the tenant came to it; what was condemned is no longer stored."""
    r, j = tables.results.c, tables.jobs.c
    owned = sa.exists().where(j.result_sha256 == sha256, j.tenant == tenant)
    query = sa.select(r.sha256, r.schema_name, r.body, r.created_at).where(r.sha256 == sha256, owned)
    with reading(db) as connection:
        row = connection.execute(query).first()
        if row is not None:
            return Result(*row), True
        if connection.execute(sa.select(owned)).scalar_one():
            return None, True
        if was_condemned(connection, tenant, sha256):
            raise damaged(ANSWER, sha256)
    return None, False
