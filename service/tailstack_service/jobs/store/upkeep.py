"""What an operator does to a database: look whether it is sound, delete what is old, copy it into one file."""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from tailstack.errors import Problem

from . import tables, usage
from .database import Database, connect, find_reading_mode, insert, now, parse_url, reading, writing
from .errors import StoreError, StoreUnavailable
from .results import find_changed_parts, find_changed_requests, find_changed_results, find_missing_results
from .schema import HEAD, read_version

JOBS_AT_A_TIME = 20  # so that nobody waits long for the write lock
SECONDS_PER_DAY = 86_400.0
WORKERS_KEPT_SECONDS = 86_400.0
AUDIT_DAYS = 365.0
LEAP_SECONDS = 7_200.0  # by which the clock is off what was lived through; purges are an hour apart
CHECKING_SECONDS = 3_600.0  # for everything to be read
DUMP_SECONDS = 3_600.0  # for everything to be copied
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
        checks = [_check_schema(connection)]
        if not checks[0].ok:
            return checks
        if db.dialect == "sqlite":
            checks += [_check_pragma(connection, "integrity_check"), _check_pragma(connection, "foreign_key_check")]
        checks += [_check_none(name, find(connection)) for name, find in _HASHES.items()]
        checks += [_check_none(name, connection.execute(query.limit(4)).scalars()) for name, query in _RULES.items()]
    return checks


def _check_schema(connection: Connection) -> DatabaseCheck:
    version = read_version(connection)
    return DatabaseCheck("schema version", version == HEAD, f"{version or 'none'}, this tailstack knows {HEAD}")


def _check_pragma(connection: Connection, name: str) -> DatabaseCheck:
    rows = [" ".join(str(value) for value in row) for row in connection.exec_driver_sql(f"PRAGMA {name}")]
    wrong = [row for row in rows if row != "ok"]
    return DatabaseCheck(name.replace("_", " "), not wrong, "; ".join(wrong[:5]) or "ok")


def _check_none(name: str, wrong: Iterable[str]) -> DatabaseCheck:
    """That nothing breaks a rule; the first that do are named."""
    names = list(wrong)
    return DatabaseCheck(
        name, not names, f"not so: {', '.join(names[:3])}{' ...' if len(names) > 3 else ''}" if names else "ok"
    )


_HASHES = {
    "results hash to their names": find_changed_results,
    "requests have the hash they came with": find_changed_requests,
    "recorded units have the hash they were recorded with": find_changed_parts,
}
_J, _U, _L = tables.jobs.c, tables.units.c, tables.lifetime.c
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


def back_up(url: str, target: Path) -> str:
    """Copy the database into ``target``, which must not exist.  Returns how it is restored.

    SQLite: the file itself, by the online backup API, its integrity checked.  PostgreSQL: ``pg_dump`` in its custom
    format, its table of contents read back.  The file appears under its name only when it is complete and on the disk.
    Raises StoreError, also where a stored answer is damaged: the earlier backups, which may hold it as it was, must not
    make room for one that does not.
    """
    parsed = parse_url(url)
    if target.exists():
        raise _backup_error("backup-exists", f"{target} exists already", "give another name: nothing is overwritten")
    if not target.parent.is_dir():
        raise _backup_error("no-directory", f"there is no directory {target.parent}", f"mkdir -p {target.parent}")
    _require_undamaged(url)
    with tempfile.TemporaryDirectory(prefix=".tailstack-backup-", dir=target.parent) as directory:
        partial = Path(directory) / "backup"
        if parsed.get_backend_name() == "sqlite":
            _copy_file(Path(str(parsed.database)), partial)
            file = str(parsed.database)
            stale = " ".join(quote(file + ending) for ending in ("-wal", "-shm"))
            restored = f"stop the service, then rm -f {stale} && cp {quote(str(target))} {quote(file)}"
        else:
            _dump(parsed, partial)
            restored = f"createdb NEW, then pg_restore --no-owner --dbname=NEW {quote(str(target))}"
        _sync(partial)
        try:
            os.link(partial, target)  # unlike a rename it fails if somebody else made the target meanwhile
        except FileExistsError:
            raise _backup_error("backup-exists", f"{target} exists already", "give another name") from None
    _sync(target.parent)
    return restored


def _require_undamaged(url: str) -> None:
    db = connect(url, read_only=True)
    try:
        with reading(db.within(DUMP_SECONDS)) as connection:
            damaged = []
            if sa.inspect(connection).has_table("results"):
                damaged = [*find_changed_results(connection), *find_missing_results(connection)]
    except StoreUnavailable as error:
        raise _backup_error("backup-failed", error.problems[0].detail, error.problems[0].hint) from None
    finally:
        db.close()
    if damaged:
        names = ", ".join(damaged[:3]) + (" ..." if len(damaged) > 3 else "")
        detail = f"{len(damaged)} of the stored answers are damaged and would be in the backup: {names}"
        hint = (
            "keep the earlier backups; tailstack db mend fails the jobs of these and deletes them, then back up again"
        )
        raise _backup_error("backup-damaged", detail, hint)


def _backup_error(code: str, detail: str, hint: str) -> StoreError:
    return StoreError(Problem("", code, detail, hint))


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _copy_file(source: Path, target: Path) -> None:
    if not source.exists():
        raise _backup_error(
            "no-database", f"there is no database at {source}", "TAILSTACK_DATABASE says which one is meant"
        )
    os.close(os.open(target, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    try:
        address = f"{source.absolute().as_uri()}?{find_reading_mode(source)}"
        with closing(sqlite3.connect(address, timeout=30, uri=True)) as from_, closing(sqlite3.connect(target)) as to:
            from_.backup(to)
            to.execute("PRAGMA journal_mode=DELETE").fetchone()  # one file, without a -wal beside it
            complaints = [row[0] for row in to.execute("PRAGMA integrity_check")]
            complaints += ["a row refers to one that is missing" for _ in to.execute("PRAGMA foreign_key_check")]
    except sqlite3.Error as error:
        raise _backup_error("backup-failed", f"{source}: {error}", "tailstack db check") from None
    if complaints != ["ok"]:
        raise _backup_error(
            "backup-failed", f"the copy is not sound: {'; '.join(complaints[:3])}", "tailstack db check"
        )


def _dump(url: URL, target: Path) -> None:
    program = find_program("pg_dump")
    if program is None:
        detail = "pg_dump is needed to back up PostgreSQL, and it is neither on PATH nor beside pg_config"
        raise _backup_error("no-pg-dump", detail, "install it: apt-get install postgresql-client")
    os.close(os.open(target, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    # Nothing secret in the arguments: every user of the host can read them
    public = URL.create("postgresql", url.username, None, url.host, url.port, url.database, url.query)
    address = public.render_as_string(hide_password=False)
    environment = dict(os.environ)
    if url.password is not None:
        environment["PGPASSWORD"] = str(url.password)
    _run_program([program, "--format=custom", "--no-password", f"--file={target}", f"--dbname={address}"], environment)
    restore = find_program("pg_restore")
    if restore is not None:
        _run_program([restore, "--list", str(target)], environment)


def _run_program(command: list[str], environment: dict[str, str]) -> None:
    try:
        done = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=DUMP_SECONDS
        )
    except subprocess.TimeoutExpired:
        detail = f"{Path(command[0]).name} took more than {DUMP_SECONDS:g} s"
        raise _backup_error("backup-failed", detail, "run pg_dump --format=custom by hand") from None
    if done.returncode != 0:
        reason = (done.stderr.strip() or f"exit code {done.returncode}").partition("\n")[0]
        hint = "pg_dump must not be older than the server; TAILSTACK_DATABASE says which database is meant"
        raise _backup_error("backup-failed", f"{Path(command[0]).name}: {reason}", hint)


def find_program(name: str) -> str | None:
    """A program of PostgreSQL: on PATH, or where ``pg_config`` says, or where Debian keeps it."""
    path = shutil.which(name)
    if path:
        return path
    configured = shutil.which("pg_config")
    if configured:
        done = subprocess.run([configured, "--bindir"], capture_output=True, text=True, timeout=30)
        beside = Path(done.stdout.strip()) / name
        if done.returncode == 0 and beside.exists():
            return str(beside)
    debian = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: path.parts[4].zfill(8))
    return str(debian[-1]) if debian else None
