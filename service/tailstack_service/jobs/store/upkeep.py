"""What an operator does to a database: look whether it is sound, delete what is old."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from . import tables, usage
from .database import Database, insert, now, reading, writing
from .results import find_changed_parts, find_changed_requests, find_changed_results
from .schema import HEAD, read_version

JOBS_AT_A_TIME = 20  # so that nobody waits long for the write lock
SECONDS_PER_DAY = 86_400.0
WORKERS_KEPT_SECONDS = 86_400.0
AUDIT_DAYS = 365.0
LEAP_SECONDS = 7_200.0  # by which the clock is off what was lived through; purges are an hour apart
CHECKING_SECONDS = 3_600.0  # for everything to be read
_PURGE_LOCK = 1413564241

log = logging.getLogger("tailstack.store")


@dataclass(frozen=True, slots=True)
class DatabaseCheck:
    """One rule that a sound database keeps."""

    name: str
    ok: bool
    detail: str  # what was looked at, or what is wrong


@dataclass(frozen=True, slots=True)
class Deletions:
    """What a purge deleted."""

    jobs: int
    results: int
    usage_rows: int
    workers: int
    audit_entries: int
    designs: int = 0


def check_database(db: Database) -> list[DatabaseCheck]:
    """Look at everything, in one transaction that sees one moment.  Raises StoreUnavailable."""
    with reading(db.within(CHECKING_SECONDS)) as connection:
        if db.dialect == "postgresql":
            connection.execute(sa.text("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ"))
            connection.execute(sa.text("SET LOCAL statement_timeout = 0"))
        version = read_version(connection)
        known = f"{version or 'none'}, this tailstack knows {HEAD}"
        checks = [DatabaseCheck("schema version", version == HEAD, known)]
        if not checks[0].ok:
            return checks
        if db.dialect == "sqlite":
            checks += [_check_pragma(connection, "integrity_check"), _check_pragma(connection, "foreign_key_check")]
        checks += [_check_none(name, find(connection)) for name, find in _HASHES.items()]
        checks += [_check_none(name, connection.execute(query.limit(4)).scalars()) for name, query in _RULES.items()]
    return checks


def _check_pragma(connection: Connection, name: str) -> DatabaseCheck:
    rows = [" ".join(str(value) for value in row) for row in connection.exec_driver_sql(f"PRAGMA {name}")]
    wrong = [row for row in rows if row != "ok"]
    return DatabaseCheck(name.replace("_", " "), not wrong, "; ".join(wrong[:5]) or "ok")


def _check_none(name: str, wrong: Iterable[str]) -> DatabaseCheck:
    """That nothing breaks a rule; the first that do are named."""
    names = list(wrong)
    detail = f"not so: {', '.join(names[:3])}{' ...' if len(names) > 3 else ''}" if names else "ok"
    return DatabaseCheck(name, not names, detail)


def _of_job(figure: sa.ColumnElement[Any], *conditions: sa.ColumnElement[bool]) -> sa.ScalarSelect[Any]:
    return sa.select(figure).where(*conditions).correlate(tables.jobs).scalar_subquery()


_HASHES = {
    "results hash to their names": find_changed_results,
    "requests have the hash they came with": find_changed_requests,
    "recorded units have the hash they were recorded with": find_changed_parts,
}
_J, _U, _E, _L = tables.jobs.c, tables.units.c, tables.events.c, tables.lifetime.c
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
        _J.units_done != _of_job(sa.func.count(), _U.job_id == _J.id, _U.state == tables.RECORDED)
    ),
    "every job has its request": sa.select(_J.id).where(~sa.exists().where(tables.requests.c.job_id == _J.id)),
    "every succeeded job has its result": sa.select(_J.id).where(
        _J.state == "succeeded", ~sa.exists().where(tables.results.c.sha256 == _J.result_sha256)
    ),
    "events are numbered without gaps": sa.select(_J.id).where(
        sa.or_(
            _J.last_event != _of_job(sa.func.count(), _E.job_id == _J.id),
            _J.last_event != _of_job(sa.func.coalesce(sa.func.max(_E.sequence), 0), _E.job_id == _J.id),
        )
    ),
}


def purge(db: Database, keep_days: float, audit_days: float = AUDIT_DAYS) -> Deletions:
    """Delete jobs that ended more than ``keep_days`` ago, results that no job refers to, designs that were not sent for
    as long, workers silent for a day, entries of the audit log older than ``audit_days``.

    Ages are time lived through: it begins with the first purge that sees a row, and counts what the clock and the
    monotonic clocks of those who purge agree on.  A clock that leaps makes nothing older, nor does a time in which
    nobody served the database.  Works in short transactions; several at once do no harm.
    """
    with writing(db) as connection:
        at = now(db, connection)
        lived = _live_on(db, connection, at)
        for table, ready in ((tables.jobs, _J.finished_at.is_not(None)), *((each, sa.true()) for each in _SENT)):
            keys = list(table.primary_key)
            fresh = sa.select(*keys).where(table.c.aged_from.is_(None), ready).with_for_update(skip_locked=True)
            connection.execute(sa.update(table).where(sa.tuple_(*keys).in_(fresh)).values(aged_from=lived))
    old = lived - keep_days * SECONDS_PER_DAY
    jobs = _repeat(db, lambda connection: _purge_jobs(connection, old))
    results = _repeat(db, _purge_results)
    with writing(db) as connection:
        rows = usage.fold_minutes(db, connection, at) if _lock_purge(db, connection) else 0
        entries = _delete_older(connection, tables.audit, lived - audit_days * SECONDS_PER_DAY)
        unnamed = _delete_older(connection, tables.designs, old)
        silent = sa.delete(tables.workers).where(tables.workers.c.seen_at < at - WORKERS_KEPT_SECONDS)
        return Deletions(jobs, results, rows, connection.execute(silent).rowcount, entries, unnamed)


_SENT = (tables.designs, tables.audit)  # whose age begins when they are there


def _live_on(db: Database, connection: Connection, at: float) -> float:
    """Seconds for which the database was served so far, with those since somebody last wrote it down."""
    row = connection.execute(sa.select(_L.seconds, _L.at).with_for_update()).first()
    seconds, before = (0.0, at) if row is None else (row.seconds, row.at)
    moment = db.clock.monotonic()
    here, by_clock, db.life.written = moment - db.life.written, at - before, moment
    if by_clock < -LEAP_SECONDS or by_clock > here + LEAP_SECONDS:
        log.warning(
            "the last purge was %.3g h ago by the clock, and %.3g h were lived through: only these make jobs older",
            by_clock / 3600, here / 3600, extra={"action": "clock-leapt"},
        )  # fmt: skip
    values = {"seconds": seconds + min(max(by_clock, 0.0), here), "at": at}
    written = insert(db.dialect, tables.lifetime).values(id=0, **values)
    connection.execute(written.on_conflict_do_update(index_elements=["id"], set_=values))
    return values["seconds"]


def _delete_older(connection: Connection, table: sa.Table, lived: float) -> int:
    return connection.execute(sa.delete(table).where(table.c.aged_from <= lived)).rowcount


def _lock_purge(db: Database, connection: Connection) -> bool:
    if db.dialect == "sqlite":
        return True
    return bool(connection.execute(sa.text(f"SELECT pg_try_advisory_xact_lock({_PURGE_LOCK})")).scalar_one())


def _repeat(db: Database, delete_some: Callable[[Connection], int]) -> int:
    total = 0
    while True:
        with writing(db) as connection:
            count = delete_some(connection)
        total += count
        if count == 0:
            return total


def _purge_jobs(connection: Connection, lived: float) -> int:
    old = sa.select(_J.id).where(_J.aged_from <= lived).order_by(_J.aged_from).limit(JOBS_AT_A_TIME)
    ids = connection.execute(old.with_for_update(skip_locked=True)).scalars().all()
    connection.execute(sa.delete(tables.jobs).where(_J.id.in_(ids)))
    return len(ids)


def _purge_results(connection: Connection) -> int:
    r = tables.results.c
    unowned = ~sa.exists().where(_J.result_sha256 == r.sha256)
    query = sa.select(r.sha256).where(unowned).limit(JOBS_AT_A_TIME).with_for_update(skip_locked=True)
    names = connection.execute(query).scalars().all()
    # Looked at again now that the rows are held: a job may have come to one of them in between
    return connection.execute(sa.delete(tables.results).where(r.sha256.in_(names), unowned)).rowcount
