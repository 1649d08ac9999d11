"""The tables, as a new database gets them and the newest migration leaves them, and what may be stored in them.

A job's id is 48 bits of time and 80 random bits as 26 characters, sorted by time (the layout of a ULID).
"""

from __future__ import annotations

import re
import secrets

import sqlalchemy as sa
from sqlalchemy import Boolean, CheckConstraint, Column, Double, ForeignKey, Index, Integer, LargeBinary, Text

metadata = sa.MetaData()

# Identifiers sort by their bytes, whatever the locale of the database
Identifier = Text().with_variant(Text(collation="C"), "postgresql")

UNFINISHED = ("queued", "running")
STATES = (*UNFINISHED, "succeeded", "failed", "cancelled")

# Written into the SQL instead of being bound: a partial index is used only if its condition can be read in the query
READY: sa.ColumnClause[str] = sa.literal_column("'ready'")
LEASED: sa.ColumnClause[str] = sa.literal_column("'leased'")
RECORDED: sa.ColumnClause[str] = sa.literal_column("'recorded'")

results = sa.Table(
    "results",
    metadata,
    Column("sha256", Identifier, primary_key=True),
    Column("schema_name", Text, nullable=False),
    Column("body", LargeBinary, nullable=False),
    Column("created_at", Double, nullable=False),
)

jobs = sa.Table(
    "jobs",
    metadata,
    Column("id", Identifier, primary_key=True),
    Column("tenant", Identifier, nullable=False),
    Column("kind", Text, nullable=False),
    Column("state", Text, nullable=False),
    Column("request_sha256", Text, nullable=False),
    Column("design_name", Text, nullable=False),
    Column("solver_version", Text, nullable=False),
    Column("request_id", Text, nullable=False),
    Column("idempotency_key", Text),
    Column("created_at", Double, nullable=False),
    Column("started_at", Double),
    Column("finished_at", Double),
    Column("units_done", Integer, nullable=False),
    Column("units_expected", Integer, nullable=False),
    Column("note", Text, nullable=False),
    Column("result_sha256", Identifier, ForeignKey("results.sha256")),
    Column("problem", Text),
    Column("generation", Integer, nullable=False),
    Column("cpu_seconds", Double, nullable=False),
    Column("last_event", Integer, nullable=False),
    CheckConstraint(f"state IN {STATES!r}", name="jobs_state"),
    CheckConstraint("(state = 'succeeded') = (result_sha256 IS NOT NULL)", name="jobs_result"),
    CheckConstraint("(state = 'failed') = (problem IS NOT NULL)", name="jobs_problem"),
    CheckConstraint(f"(state IN {UNFINISHED!r}) = (finished_at IS NULL)", name="jobs_finished"),
    Index("jobs_of_tenant", "tenant", "id"),
    Index("jobs_of_tenant_by_state", "tenant", "state", "id"),
    Index("jobs_of_tenant_by_kind", "tenant", "kind", "id"),
    Index("jobs_by_idempotency_key", "tenant", "idempotency_key", unique=True),
    Index("jobs_by_result", "result_sha256", "tenant"),
    Column("aged_from", Double),  # seconds of ``lifetime`` when a purge first saw it finished
    Index("jobs_by_age", "aged_from"),
)

# Apart from the jobs: SQLite writes a row anew at every change, and a request may be a megabyte
requests = sa.Table(
    "requests",
    metadata,
    Column("job_id", Identifier, ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("body", LargeBinary, nullable=False),
)


def _partial_index(name: str, *columns: str, where: str) -> Index:
    return Index(name, *columns, sqlite_where=sa.text(where), postgresql_where=sa.text(where))


units = sa.Table(
    "units",
    metadata,
    Column("job_id", Identifier, ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("advance", Boolean, nullable=False),
    Column("state", Text, nullable=False),
    Column("place", Double, nullable=False),  # in the queue of all units: epoch seconds
    Column("ready_at", Double, nullable=False),  # since when it waits, or waited
    Column("spec", LargeBinary),
    Column("token", Integer, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("deaths", Integer, nullable=False),
    Column("worker_id", Text),
    Column("lease_until", Double),
    Column("result", LargeBinary),
    Column("cpu_seconds", Double, nullable=False),
    Column("result_sha256", Text),  # of a recorded result
    CheckConstraint("state IN ('ready', 'leased', 'recorded')", name="units_state"),
    _partial_index("units_ready", "place", "job_id", "number", where="state = 'ready'"),
    _partial_index("units_leased", "lease_until", where="state = 'leased'"),
    _partial_index("units_open", "job_id", where="state <> 'recorded'"),
)

events = sa.Table(
    "events",
    metadata,
    Column("job_id", Identifier, ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("sequence", Integer, primary_key=True, autoincrement=False),
    Column("at", Double, nullable=False),
    Column("name", Text, nullable=False),
    Column("data", Text, nullable=False),
)

# Designs that later requests may name by their hash
designs = sa.Table(
    "designs",
    metadata,
    Column("tenant", Identifier, primary_key=True),
    Column("sha256", Identifier, primary_key=True),  # of the design, not of these bytes
    Column("body", LargeBinary, nullable=False),
    Column("body_sha256", Text, nullable=False),
    Column("sent_at", Double, nullable=False),
    Column("aged_from", Double),  # as that of a job; of a design that was sent again, none
    Index("designs_of_tenant", "tenant", "sent_at"),
    Index("designs_by_age", "aged_from"),
)

workers = sa.Table(
    "workers",
    metadata,
    Column("id", Identifier, primary_key=True),
    Column("host", Text, nullable=False),
    Column("pid", Integer, nullable=False),
    Column("solver_version", Text, nullable=False),
    Column("engine", Text, nullable=False),
    Column("capacity", Integer, nullable=False),
    Column("started_at", Double, nullable=False),
    Column("seen_at", Double, nullable=False),
)

keys = sa.Table(
    "keys",
    metadata,
    Column("id", Identifier, primary_key=True),
    Column("tenant", Identifier, nullable=False),
    Column("name", Text, nullable=False),
    Column("scopes", Text, nullable=False),
    Column("secret_sha256", Text, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("expires_at", Double, nullable=False),
    Column("revoked_at", Double),
)

usage = sa.Table(
    "usage",
    metadata,
    Column("tenant", Identifier, primary_key=True),
    Column("minute", Integer, primary_key=True, autoincrement=False),  # epoch seconds over 60; 0: all that is older
    Column("units", Integer, nullable=False),
    Column("cpu_seconds", Double, nullable=False),
)

audit = sa.Table(
    "audit",
    metadata,
    Column("id", Identifier, primary_key=True),  # sorts by time
    Column("at", Double, nullable=False),
    Column("actor", Text, nullable=False),  # who
    Column("action", Text, nullable=False),  # what
    Column("tenant", Identifier, nullable=False),
    Column("subject", Text, nullable=False),  # which key, which policy
    Column("detail", Text, nullable=False),  # JSON
    Column("once", Text),  # rows with the same text are written once
    Column("aged_from", Double),  # as that of a job
    Index("audit_of_tenant", "tenant", "action", "id"),
    Index("audit_by_time", "at"),
    Index("audit_by_age", "aged_from"),
    Index("audit_once", "once", unique=True),
)

# For how long somebody served this database, whatever its clock said meanwhile: one row
lifetime = sa.Table(
    "lifetime",
    metadata,
    Column("id", Integer, CheckConstraint("id = 0", name="lifetime_id"), primary_key=True, autoincrement=False),
    Column("seconds", Double, nullable=False),
    Column("at", Double, nullable=False),  # the clock when that was written
)

# The second condition is always true: for the first alone SQLite would walk the table instead of the partial index
ready = sa.and_(units.c.state == READY, units.c.place > sa.literal_column("0"))
leased = sa.and_(units.c.state == LEASED, units.c.lease_until > sa.literal_column("0"))


ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"  # Crockford's, in small letters
_JOB_ID = re.compile(f"[0-7][{ALPHABET}]{{25}}")


def new_job_id(now: float, after: str | None = None) -> str:
    """An id made at ``now`` (epoch seconds), that sorts behind ``after`` also where the clock was set back since."""
    number = (int(now * 1000) & ((1 << 48) - 1)) << 80 | secrets.randbits(80)
    if after is not None and (last := _number_of(after)) >= number:
        number = last + 1 + secrets.randbits(64)
    return "".join(ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))


def time_of_job(job_id: str) -> float:
    """Epoch seconds, to the millisecond, by which a job is in the order of all: when it came in, or later where the
    clock was set back."""
    return (_number_of(job_id) >> 80) / 1000


def _number_of(job_id: str) -> int:
    number = 0
    for sign in job_id:
        number = number << 5 | ALPHABET.index(sign)
    return number


def is_job_id(text: str) -> bool:
    """Whether a text that came from outside can be an id; the rest never reaches the database."""
    return _JOB_ID.fullmatch(text) is not None


def storable(text: str) -> str:
    """The text without what a database cannot keep: NUL (PostgreSQL) and lone surrogates (both)."""
    return text.replace("\0", "\ufffd").encode("utf-8", "replace").decode()


def storable_json(text: str) -> str:
    """The same JSON for a database: lone surrogates, which neither can keep, as the escapes that read back as them."""
    return text.encode("utf-8", "backslashreplace").decode()
