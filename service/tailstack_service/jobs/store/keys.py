"""API keys: made, looked up, revoked, and each of it audited.

Only the SHA-256 of a secret is kept, which is enough for 256 random bits.
"""

from __future__ import annotations

import hmac
import re
import secrets
from dataclasses import asdict, dataclass

import sqlalchemy as sa

from tailstack.errors import Problem

from ...problems import RequestError
from . import audit, tables
from .database import AnyRow, Database, now, reading, writing
from .results import digest

SCOPES = ("read", "compute", "metrics")
LONGEST_DAYS = 3650.0
SECONDS_PER_DAY = 86_400.0
_PRESENTED = re.compile(r"tsk_([0-9a-f]{12})_[A-Za-z0-9_-]{43}")
_TENANT = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")
_NAME = re.compile(r"[^\x00-\x1f\x7f]{1,100}")
_NO_DIGEST = "0" * 64


@dataclass(frozen=True, slots=True)
class Key:
    """An API key without its secret.  Times are epoch seconds."""

    id: str
    tenant: str
    name: str
    scopes: tuple[str, ...]
    created_at: float
    expires_at: float
    revoked_at: float | None

    def state(self, at: float) -> str:
        """``active``, ``expired`` or ``revoked``."""
        if self.revoked_at is not None:
            return "revoked"
        return "active" if at < self.expires_at else "expired"


_COLUMNS = [tables.keys.c[name] for name in Key.__dataclass_fields__]


def _make_key(row: AnyRow) -> Key:
    values = {name: row._mapping[name] for name in Key.__dataclass_fields__}
    return Key(**{**values, "scopes": tuple(row.scopes.split())})


def create_key(db: Database, *, tenant: str, name: str, scopes: tuple[str, ...], days: float) -> tuple[Key, str]:
    """A new key, and its secret, which is not kept.  Raises RequestError for a name, scope or time that cannot be."""
    problems = _find_problems(tenant, name, scopes, days)
    if problems:
        raise RequestError(problems)
    key_id = secrets.token_hex(6)
    secret = f"tsk_{key_id}_{secrets.token_urlsafe(32)}"
    ordered = tuple(scope for scope in SCOPES if scope in scopes)
    with writing(db) as connection:
        at = now(db, connection)
        key = Key(key_id, tenant, name, ordered, at, at + days * SECONDS_PER_DAY, None)
        values = asdict(key) | {"scopes": " ".join(ordered), "secret_sha256": digest(secret.encode())}
        connection.execute(tables.keys.insert(), values)
        detail = {"name": name, "scopes": list(ordered), "expires_at": key.expires_at}
        audit.write_operation(db, connection, at, audit.CREATED, tenant, key_id, detail)
    return key, secret


def _find_problems(tenant: str, name: str, scopes: tuple[str, ...], days: float) -> list[Problem]:
    problems = []
    if not _TENANT.fullmatch(tenant):
        detail = f"a tenant is 1 to 64 of a-z, 0-9, dot, hyphen and underscore; got {tenant[:80]!r}"
        problems.append(Problem("/tenant", "bad-tenant", detail, "for example: --tenant metrology"))
    if not _NAME.fullmatch(name) or not name.isprintable():
        detail = f"a name is 1 to 100 printable characters; got {name[:120]!r}"
        problems.append(Problem("/name", "bad-name", detail, "say who uses the key: --name 'CAD plug-in, J. Doe'"))
    unknown = [scope for scope in scopes if scope not in SCOPES]
    if unknown or not scopes:
        detail = f"scopes are {', '.join(SCOPES)}; got {', '.join(unknown) or 'none'}"
        problems.append(Problem("/scopes", "bad-scope", detail, "for example: --scope read --scope compute"))
    if not 0 < days <= LONGEST_DAYS:
        detail = f"a key is good for more than 0 and at most {LONGEST_DAYS:g} days; got {days:g}"
        problems.append(Problem("/days", "bad-days", detail, "for example: --days 365"))
    return problems


def find_key(db: Database, presented: str) -> Key | None:
    """The key with this secret, unless it is revoked or has expired.  Digests are compared in constant time."""
    match = _PRESENTED.fullmatch(presented)
    if match is None:
        return None
    columns = [*_COLUMNS, tables.keys.c.secret_sha256]
    with reading(db) as connection:
        row = connection.execute(sa.select(*columns).where(tables.keys.c.id == match[1])).first()
        at = now(db, connection)
    same = hmac.compare_digest(digest(presented.encode()), row.secret_sha256 if row else _NO_DIGEST)
    if row is None or not same:
        return None
    key = _make_key(row)
    return key if key.state(at) == "active" else None


def list_keys(db: Database, tenant: str | None = None) -> list[tuple[Key, str]]:
    """Every key, or a tenant's, with its state (``active``, ``expired``, ``revoked``); the oldest first."""
    query = sa.select(*_COLUMNS).order_by(tables.keys.c.created_at, tables.keys.c.id)
    if tenant is not None:
        query = query.where(tables.keys.c.tenant == tenant)
    with reading(db) as connection:
        at = now(db, connection)
        keys = [_make_key(row) for row in connection.execute(query)]
    return [(key, key.state(at)) for key in keys]


def revoke_key(db: Database, key_id: str) -> Key | None:
    """Refuse the key from now on; one that was revoked before stays as it is.  None for an unknown id."""
    k = tables.keys.c
    with writing(db) as connection:
        at = now(db, connection)
        change = sa.update(tables.keys).where(k.id == key_id, k.revoked_at.is_(None)).values(revoked_at=at)
        revoked = connection.execute(change).rowcount
        row = connection.execute(sa.select(*_COLUMNS).where(k.id == key_id)).first()
        if revoked and row is not None:
            audit.write_operation(db, connection, at, audit.REVOKED, row.tenant, key_id, {"name": row.name})
    return _make_key(row) if row else None


def read_key_id(text: str) -> str:
    """The id in a secret; an id stays as it is."""
    match = _PRESENTED.fullmatch(text)
    return match[1] if match else text
