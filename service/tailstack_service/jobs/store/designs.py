"""Designs that a tenant sent lately: the last so many, so that requests can name one by its hash."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa

from . import tables
from .database import Database, insert, now, reading, writing
from .results import digest

ORDER_SECONDS = 1e-6  # by which designs that are kept together follow one another
_DESIGN = tables.designs.c


def keep_designs(db: Database, entries: Sequence[tuple[str, str, bytes]], most: int) -> None:
    """Keep designs (tenant, SHA-256, JSON), those that were sent last at the end; of each tenant its last ``most``."""
    with writing(db) as connection:
        at = now(db, connection)
        for tenant, sha256, body in entries:
            values: dict[str, Any] = {"tenant": tenant, "sha256": sha256, "body": body, "body_sha256": digest(body)}
            statement = insert(db.dialect, tables.designs).values(values | {"sent_at": at})
            changed = {name: statement.excluded[name] for name in ("body", "body_sha256", "sent_at")} | {
                "aged_from": None
            }
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
