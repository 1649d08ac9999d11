"""Answers, named by the SHA-256 of their bytes; kept once, read by the tenants that own a job with them."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import tables
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
    sha256 = hashlib.sha256(body).hexdigest()
    values = {"sha256": sha256, "schema_name": schema_name, "body": body, "created_at": at}
    statement = insert(db.dialect, tables.results).values(values)
    # Touching the row that is there holds it against a purge, until the job that now refers to it is committed
    untouched = {"created_at": tables.results.c.created_at}
    connection.execute(statement.on_conflict_do_update(index_elements=["sha256"], set_=untouched))
    return sha256


def get(db: Database, tenant: str, sha256: str) -> Result | None:
    """A result that one of the tenant's jobs came to; None for any other."""
    if not _SHA256.fullmatch(sha256):
        return None
    r, j = tables.results.c, tables.jobs.c
    owned = sa.exists().where(j.result_sha256 == r.sha256, j.tenant == tenant)
    query = sa.select(r.sha256, r.schema_name, r.body, r.created_at).where(r.sha256 == sha256, owned)
    with reading(db) as connection:
        row = connection.execute(query).first()
    return Result(*row) if row else None
