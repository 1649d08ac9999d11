"""Who did what to keys and policies, and when: for an auditor, without a secret, for a bounded time.

What an operator does is written in the transaction that does it.  What comes over HTTP is bounded: the first use of a
key from an address in an hour, and a policy where it differs from the one before; of each tenant and action no more
than ``MOST_AN_HOUR`` entries an hour, then one that says that there were more.
"""

from __future__ import annotations

import json
import os
import socket
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.results.json_text import write_json

from . import tables
from .database import Database, insert, now, reading, writing
from .tables import new_job_id, storable, storable_json

CREATED, REVOKED, USED, POLICY = "key-created", "key-revoked", "key-used", "policy-changed"
MOST_AN_HOUR = 100
SECONDS_PER_HOUR = 3_600.0
LONGEST_TEXT = 200  # characters of what came from outside

_AUDIT = tables.audit.c


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry.  ``at``: epoch seconds.  ``subject``: the id of the key, or the SHA-256 of the policy."""

    id: str
    at: float
    actor: str
    action: str
    tenant: str
    subject: str
    detail: dict[str, Any]


def name_operator() -> str:
    """The user of this process: who acts where a command is typed."""
    try:
        import pwd

        name = pwd.getpwuid(os.getuid()).pw_name
    except (ImportError, KeyError):
        name = str(getattr(os, "getuid", lambda: "unknown")())
    behind = os.environ.get("SUDO_USER")
    return f"{name}@{socket.gethostname()}" + (f" (sudo by {behind})" if behind else "")


def write_entry(
    db: Database, connection: Connection, at: float, *, actor: str, action: str, tenant: str, subject: str,
    detail: dict[str, Any], once: str | None = None,
) -> None:  # fmt: skip
    """One entry, in the caller's transaction; nothing if there is one with the same ``once``."""
    values = {
        "id": new_job_id(at),
        "at": at,
        "actor": _shorten(actor),
        "action": action,
        "tenant": tenant,
        "subject": _shorten(subject),
        "detail": storable_json(write_json(detail)),
        "once": once,
    }
    connection.execute(insert(db.dialect, tables.audit).values(values).on_conflict_do_nothing())


def write_operation(
    db: Database, connection: Connection, at: float, action: str, tenant: str, subject: str, detail: dict[str, Any]
) -> None:
    """What the user of this process does, in the transaction that does it."""
    write_entry(db, connection, at, actor=name_operator(), action=action, tenant=tenant, subject=subject, detail=detail)


def _shorten(text: str) -> str:
    return storable(text)[:LONGEST_TEXT]


def note_use(db: Database, key_id: str, tenant: str, address: str) -> None:
    """Note that a key was used: once an hour for each address."""
    with reading(db) as connection:
        once = f"{USED} {key_id} {_shorten(address)} {_find_hour(now(db, connection))}"
        if connection.execute(sa.select(sa.exists().where(_AUDIT.once == once))).scalar_one():
            return
    with writing(db) as connection:
        entry = {"actor": f"key {key_id}", "subject": key_id, "detail": {"address": _shorten(address)}}
        _write_bounded(db, connection, USED, tenant, entry, once)


def note_policy(db: Database, actor: str, tenant: str, terms: dict[str, Any]) -> None:
    """Note by what a tenant's gates are judged, where that differs from the last time.

    terms: plain data with ``policy_sha256``, the subject of the entry.
    """
    with reading(db) as connection:
        if _read_last_terms(connection, tenant) == terms:
            return
    with writing(db) as connection:
        before = _read_last_terms(connection, tenant)
        if before != terms:
            changed = [] if before is None else sorted(k for k in terms if before.get(k) != terms[k])
            detail = {"terms": terms, "changed": changed, "before": before}
            entry = {"actor": actor, "subject": str(terms["policy_sha256"]), "detail": detail}
            _write_bounded(db, connection, POLICY, tenant, entry, None)


def _read_last_terms(connection: Connection, tenant: str) -> dict[str, Any] | None:
    query = sa.select(_AUDIT.detail).where(_AUDIT.tenant == tenant, _AUDIT.action == POLICY, _AUDIT.subject != "")
    detail = connection.execute(query.order_by(_AUDIT.id.desc()).limit(1)).scalar_one_or_none()
    return None if detail is None else json.loads(detail)["terms"]


def _write_bounded(
    db: Database, connection: Connection, action: str, tenant: str, entry: dict[str, Any], once: str | None
) -> None:
    at = now(db, connection)
    since = _find_hour(at) * SECONDS_PER_HOUR
    of_hour = sa.select(sa.func.count()).where(_AUDIT.tenant == tenant, _AUDIT.action == action, _AUDIT.at >= since)
    if connection.execute(of_hour).scalar_one() >= MOST_AN_HOUR:
        entry = {"actor": "tailstack", "subject": "", "detail": {"omitted": f"more than {MOST_AN_HOUR} in this hour"}}
        once = f"{action} of {tenant} {_find_hour(at)}"
    write_entry(db, connection, at, action=action, tenant=tenant, once=once, **entry)


def _find_hour(at: float) -> int:
    return int(at // SECONDS_PER_HOUR)


def list_entries(
    db: Database, *, tenant: str | None = None, action: str | None = None, since: float = 0.0, limit: int
) -> list[Entry]:
    """The last ``limit`` entries since then (epoch seconds), the oldest of them first."""
    query = sa.select(*(_AUDIT[name] for name in Entry.__dataclass_fields__)).where(_AUDIT.at >= since)
    if tenant is not None:
        query = query.where(_AUDIT.tenant == tenant)
    if action is not None:
        query = query.where(_AUDIT.action == action)
    with reading(db) as connection:
        rows = connection.execute(query.order_by(_AUDIT.id.desc()).limit(limit)).all()
    return [Entry(**{**row._mapping, "detail": json.loads(row.detail)}) for row in reversed(rows)]
