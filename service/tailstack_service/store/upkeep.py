"""What an operator does to a database: bring it up to date, look whether it is sound, throw old things away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import audit, damage, tables, usage
from .backup import backup
from .damage import mend
from .database import Database, now, reading, writing
from .schema import HEAD, migrate, schema_version

__all__ = ["HEAD", "Check", "Purged", "backup", "check", "mend", "migrate", "purge", "schema_version"]

JOBS_AT_A_TIME = 20  # so that nobody waits long for the write lock
SECONDS_PER_DAY = 86_400.0
WORKERS_KEPT_SECONDS = 86_400.0
AUDIT_DAYS = 365.0
CHECKING_SECONDS = 3_600.0  # for everything to be read
_PURGE_LOCK = 1413564241


@dataclass(frozen=True, slots=True)
class Check:
    """One rule that a sound database keeps."""

    name: str
    ok: bool
    detail: str  # what was looked at, or what is wrong


@dataclass(frozen=True, slots=True)
class Purged:
    """What a purge deleted."""

    jobs: int
    results: int
    usage_rows: int
    workers: int
    audit_entries: int


def check(db: Database) -> list[Check]:
    """Look at everything, in one transaction that sees one moment.  Raises StoreUnavailable."""
    with reading(db.within(CHECKING_SECONDS)) as connection:
        if db.dialect == "postgresql":
            connection.execute(sa.text("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ"))
            connection.execute(sa.text("SET LOCAL statement_timeout = 0"))
        checks = [_schema(connection)]
        if not checks[0].ok:
            return checks
        if db.dialect == "sqlite":
            checks += [_pragma(connection, "integrity_check"), _pragma(connection, "foreign_key_check")]
        checks += _hashes(connection)
        checks += [_none(connection, name, query) for name, query in _RULES.items()]
    return checks


def _schema(connection: Connection) -> Check:
    found = "none"
    if sa.inspect(connection).has_table("alembic_version"):
        found = str(connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar_one_or_none())
    return Check("schema version", found == HEAD, f"{found}, this tailstack knows {HEAD}")


def _pragma(connection: Connection, name: str) -> Check:
    rows = [" ".join(str(value) for value in row) for row in connection.exec_driver_sql(f"PRAGMA {name}")]
    wrong = [row for row in rows if row != "ok"]
    return Check(name.replace("_", " "), not wrong, "; ".join(wrong[:5]) or "ok")


def _hashes(connection: Connection) -> list[Check]:
    checks = []
    for name, find in (
        ("results hash to their names", damage.find_changed_results),
        ("requests have the hash they came with", damage.find_changed_requests),
        ("recorded units have the hash they were recorded with", damage.find_changed_parts),
    ):
        wrong = list(find(connection))
        detail = f"not so: {', '.join(wrong[:3])}{' ...' if len(wrong) > 3 else ''}" if wrong else "ok"
        checks.append(Check(name, not wrong, detail))
    return checks


_J, _U = tables.jobs.c, tables.units.c
_OPEN_UNIT = sa.exists().where(_U.job_id == _J.id, _U.state != tables.RECORDED)
_RULES: dict[str, sa.Select[str]] = {
    "every unit belongs to a job": sa.select(_U.job_id).where(~sa.exists().where(_J.id == _U.job_id)).distinct(),
    "every unfinished job has a unit to compute": sa.select(_J.id).where(_J.state.in_(tables.UNFINISHED), ~_OPEN_UNIT),
    "no finished job has one": sa.select(_J.id).where(_J.state.not_in(tables.UNFINISHED), _OPEN_UNIT),
    "no finished job keeps payloads of units": sa.select(_J.id).where(
        _J.state.not_in(tables.UNFINISHED),
        sa.exists().where(_U.job_id == _J.id, sa.or_(_U.spec.is_not(None), _U.result.is_not(None))),
    ),
    "every recorded unit of an unfinished job has its payload": sa.select(_J.id).where(
        _J.state.in_(tables.UNFINISHED),
        sa.exists().where(_U.job_id == _J.id, _U.state == tables.RECORDED, _U.advance.is_(False), _U.result.is_(None)),
    ),
    "units are counted right": sa.select(_J.id).where(
        _J.units_done
        != sa.select(sa.func.count())
        .where(_U.job_id == _J.id, _U.state == tables.RECORDED)
        .correlate(tables.jobs)
        .scalar_subquery()
    ),
    "every job has its request": sa.select(_J.id).where(~sa.exists().where(tables.requests.c.job_id == _J.id)),
    "every succeeded job has its result": sa.select(_J.id).where(
        _J.state == "succeeded", ~sa.exists().where(tables.results.c.sha256 == _J.result_sha256)
    ),
    "events are numbered without gaps": sa.select(_J.id).where(
        sa.or_(
            *(
                _J.last_event
                != sa.select(figure).where(tables.events.c.job_id == _J.id).correlate(tables.jobs).scalar_subquery()
                for figure in (sa.func.count(), sa.func.coalesce(sa.func.max(tables.events.c.sequence), 0))
            )
        )
    ),
}


def _none(connection: Connection, name: str, query: sa.Select[str]) -> Check:
    wrong = connection.execute(query.limit(4)).scalars().all()
    return Check(
        name, not wrong, f"not so: {', '.join(wrong[:3])}{' ...' if len(wrong) > 3 else ''}" if wrong else "ok"
    )


def purge(db: Database, keep_days: float, audit_days: float = AUDIT_DAYS) -> Purged:
    """Delete jobs that ended more than ``keep_days`` ago, results that no job refers to, workers silent for a day,
    entries of the audit log older than ``audit_days``.

    Works in short transactions; several at once do no harm.
    """
    jobs = _repeated(db, lambda connection, at: _purge_jobs(connection, at - keep_days * SECONDS_PER_DAY))
    results = _repeated(db, lambda connection, at: _purge_results(connection))
    with writing(db) as connection:
        at = now(db, connection)
        rows = usage.fold(db, connection, at) if _alone(db, connection) else 0
        forgotten = audit.forget(connection, at - audit_days * SECONDS_PER_DAY)
        silent = sa.delete(tables.workers).where(tables.workers.c.seen_at < at - WORKERS_KEPT_SECONDS)
        return Purged(jobs, results, rows, connection.execute(silent).rowcount, forgotten)


def _alone(db: Database, connection: Connection) -> bool:
    if db.dialect == "sqlite":
        return True
    return bool(connection.execute(sa.text(f"SELECT pg_try_advisory_xact_lock({_PURGE_LOCK})")).scalar_one())


def _repeated(db: Database, delete_some: Callable[[Connection, float], int]) -> int:
    total = 0
    while True:
        with writing(db) as connection:
            count = delete_some(connection, now(db, connection))
        total += count
        if count == 0:
            return total


def _purge_jobs(connection: Connection, before: float) -> int:
    old = sa.select(_J.id).where(_J.finished_at < before).order_by(_J.finished_at).limit(JOBS_AT_A_TIME)
    ids = connection.execute(old.with_for_update(skip_locked=True)).scalars().all()
    connection.execute(sa.delete(tables.jobs).where(_J.id.in_(ids)))
    return len(ids)


def _purge_results(connection: Connection) -> int:
    r = tables.results.c
    unowned = ~sa.exists().where(_J.result_sha256 == r.sha256)
    found = sa.select(r.sha256).where(unowned).limit(JOBS_AT_A_TIME).with_for_update(skip_locked=True)
    names = connection.execute(found).scalars().all()
    # Looked at again now that the rows are held: a job may have come to one of them in between
    return connection.execute(sa.delete(tables.results).where(r.sha256.in_(names), unowned)).rowcount
