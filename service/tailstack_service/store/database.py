"""One database, SQLite or PostgreSQL: how it is opened, what a transaction is, what time it is."""

from __future__ import annotations

import os
import random
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, TypeAlias

import sqlalchemy as sa
from sqlalchemy import exc
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, Connection, Engine, Row, make_url

from tailstack.errors import Problem

from .errors import BadDatabaseUrl, StoreError, StoreUnavailable

AnyRow: TypeAlias = "Row[*tuple[Any, ...]]"

BUSY_SECONDS = 10.0
POSTGRESQL_OPTIONS = (
    "-c statement_timeout=30s -c lock_timeout=10s -c idle_in_transaction_session_timeout=60s -c synchronous_commit=on"
)
# Primary result codes of SQLite that say "not now": BUSY, LOCKED, NOMEM, INTERRUPT, IOERR, FULL, CANTOPEN, PROTOCOL
PASSING_SQLITE_CODES = {5, 6, 7, 9, 10, 13, 14, 15}
DAMAGED_SQLITE_CODES = {11, 26}  # CORRUPT, NOTADB
CLOSED_SQLITE_CODES = {3, 8, 23}  # PERM, READONLY, AUTH


@dataclass(frozen=True, slots=True)
class Database:
    """A pool of connections.  ``clock`` replaces the database's own time (epoch seconds) in tests."""

    engine: Engine
    dialect: str  # "sqlite" or "postgresql"
    clock: Callable[[], float] | None = None
    # SQLite has one writer: threads of this process queue here instead of polling its lock
    turn: Lock | None = None

    def close(self) -> None:
        """Close every connection of the pool."""
        self.engine.dispose()


def open_database(url: str, *, migrate: bool = False, clock: Callable[[], float] | None = None) -> Database:
    """A database whose schema is the one that this version knows.

    ``migrate`` creates a SQLite file or brings it up to date; PostgreSQL is only ever changed by ``tailstack db
    migrate``, so that hosts of a cluster do not change it under one another.  Raises StoreError with the next command,
    StoreUnavailable if the server cannot be reached.
    """
    from . import schema

    parsed = parse_url(url)
    if parsed.get_backend_name() == "sqlite" and migrate:
        schema.migrate(url)
    db = connect(url, clock=clock)
    try:
        schema.require_current(db)
    except BaseException:
        db.close()
        raise
    return db


def parse_url(url: str) -> URL:
    """The URL with the driver that is used.  Raises StoreError for any that is not understood."""
    try:
        parsed = make_url(url)
        backend = parsed.get_backend_name()
    except exc.ArgumentError:
        raise _bad_url("it cannot be read as a URL") from None
    if backend in ("postgresql", "postgres"):
        return parsed.set(drivername="postgresql+psycopg")
    if backend != "sqlite":
        raise _bad_url(f"{backend} is not known here")
    if not parsed.database or parsed.database == ":memory:" or parsed.query:
        raise _bad_url("jobs must outlive the process: a file is needed, without further parameters")
    return parsed.set(drivername="sqlite")


def _bad_url(why: str) -> StoreError:
    hint = "say sqlite:////absolute/path.sqlite3 or postgresql://USER:PASSWORD@HOST/NAME"
    detail = f"the database that TAILSTACK_DATABASE or --database names: {why}"
    return BadDatabaseUrl(Problem("", "bad-database-url", detail, hint))


def connect(url: str, *, create: bool = False, clock: Callable[[], float] | None = None) -> Database:
    """A database as it is, whatever its schema.  ``create`` makes a SQLite file.  Raises StoreError."""
    parsed = parse_url(url)
    if parsed.get_backend_name() == "sqlite":
        path = Path(str(parsed.database))
        _require_file(path, create)
        return Database(_sqlite_engine(parsed), "sqlite", clock, Lock())
    try:
        engine = _postgresql_engine(parsed)
    except ModuleNotFoundError as error:
        hint = "pip install 'tailstack[postgres]'"
        raise StoreError(Problem("", "no-driver", f"PostgreSQL needs the package {error.name}", hint)) from None
    return Database(engine, "postgresql", clock)


def _require_file(path: Path, create: bool) -> None:
    if path.exists():
        return
    if not create:
        hint = "tailstack serve makes it, and so does tailstack db migrate"
        raise StoreError(Problem("", "no-database", f"there is no database at {path}", hint))
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))  # SQLite gives its -wal and -shm files the same mode


def _sqlite_engine(url: URL) -> Engine:
    engine = sa.create_engine(
        url, connect_args={"timeout": BUSY_SECONDS}, pool_size=8, max_overflow=64, pool_timeout=BUSY_SECONDS
    )

    @sa.event.listens_for(engine, "connect")
    def _configure(connection: Any, record: Any) -> None:
        connection.isolation_level = None  # BEGIN is ours to say
        for pragma in (
            "journal_mode=WAL",
            "synchronous=FULL",
            "foreign_keys=ON",
            "journal_size_limit=67108864",
        ):
            connection.execute(f"PRAGMA {pragma}").close()

    @sa.event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        deadline = connection.get_execution_options().get("tailstack_writes_before")
        if deadline is not None:
            _begin_writing(connection, deadline)
        else:
            connection.exec_driver_sql("BEGIN")

    return engine


def _begin_writing(connection: Connection, deadline: float) -> None:
    """Take the write lock, by ``deadline`` (monotonic seconds), before anything is read: a transaction that reads first
    and writes later would be refused at its first write.

    SQLite's own way to wait sleeps for up to 0.1 s at a time, and a busier process comes first each time.  Asking every
    few milliseconds instead took the longest wait of two processes that only write from 1.9 s to 0.3 s.
    """
    connection.exec_driver_sql("PRAGMA busy_timeout=0")
    try:
        while True:
            try:
                connection.exec_driver_sql("BEGIN IMMEDIATE")
                return
            except exc.OperationalError as error:
                code = getattr(error.orig, "sqlite_errorcode", 0)
                if code & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                    raise
            time.sleep(random.uniform(0.0005, 0.004))
    finally:
        connection.exec_driver_sql(f"PRAGMA busy_timeout={1000 * BUSY_SECONDS:.0f}")


def _postgresql_engine(url: URL) -> Engine:
    arguments: dict[str, Any] = {"connect_timeout": 10, "application_name": "tailstack"}
    arguments |= {"keepalives_idle": 30, "keepalives_interval": 10, "keepalives_count": 3}
    arguments["options"] = POSTGRESQL_OPTIONS
    arguments = {key: value for key, value in arguments.items() if key not in url.query}
    return sa.create_engine(
        url,
        connect_args=arguments,
        isolation_level="READ COMMITTED",
        pool_pre_ping=True,
        pool_size=8,
        max_overflow=16,
        pool_timeout=BUSY_SECONDS,
    )


@contextmanager
def reading(db: Database) -> Iterator[Connection]:
    """A transaction that only reads; on SQLite it neither waits for a writer nor keeps one waiting."""
    with _passing_faults(), db.engine.connect() as connection:
        yield connection


@contextmanager
def writing(db: Database) -> Iterator[Connection]:
    """A transaction that writes: committed at the end of the block, undone if the block raises.

    On SQLite whoever cannot begin within ``BUSY_SECONDS``, behind threads of this process and other processes, is
    refused (StoreUnavailable): a writer that is stopped must not make all others wait, one after the other.
    """
    deadline = time.monotonic() + BUSY_SECONDS
    with _passing_faults(), _turn(db), db.engine.connect() as plain:
        connection = plain.execution_options(tailstack_writes_before=deadline)
        with connection.begin():
            yield connection


@contextmanager
def _turn(db: Database) -> Iterator[None]:
    if db.turn is None:
        yield
        return
    if not db.turn.acquire(timeout=BUSY_SECONDS):
        detail = f"another writer has held the database for more than {BUSY_SECONDS:g} s"
        raise StoreUnavailable(Problem("", "store-unavailable", detail, _SQLITE_PATIENCE))
    try:
        yield
    finally:
        db.turn.release()


@contextmanager
def _passing_faults() -> Iterator[None]:
    try:
        yield
    except (exc.DBAPIError, exc.TimeoutError) as error:
        reason = str(getattr(error, "orig", None) or error).strip().partition("\n")[0]
        if _passes(error):
            raise StoreUnavailable(Problem("", "store-unavailable", reason, _patience(error))) from error
        cure = _cure(error)
        if cure is not None:
            raise StoreError(Problem("", "unusable-database", reason, cure)) from error
        raise


def _passes(error: exc.DBAPIError | exc.TimeoutError) -> bool:
    if isinstance(error, exc.TimeoutError) or error.connection_invalidated:
        return True
    code = getattr(error.orig, "sqlite_errorcode", None)
    if code is not None:
        return code & 0xFF in PASSING_SQLITE_CODES
    return isinstance(error, exc.OperationalError | exc.InterfaceError)


_SQLITE_PATIENCE = "try again in a moment; no other program may hold the file, and its disk must not be full"


def _patience(error: exc.DBAPIError | exc.TimeoutError) -> str:
    if hasattr(getattr(error, "orig", None), "sqlite_errorcode"):
        return _SQLITE_PATIENCE
    return "try again in a moment; the server that TAILSTACK_DATABASE names must be running"


def _cure(error: exc.DBAPIError | exc.TimeoutError) -> str | None:
    """What an operator can do about a database that cannot be used as it is; None for a defect of ours."""
    original = getattr(error, "orig", None)
    if getattr(original, "sqlite_errorcode", 0) & 0xFF in DAMAGED_SQLITE_CODES:
        return "restore a backup, or set TAILSTACK_DATABASE to another file"
    if getattr(original, "sqlite_errorcode", 0) & 0xFF in CLOSED_SQLITE_CODES:
        return "this user must be allowed to write the file and its directory"
    if getattr(original, "sqlstate", None) == "42501":
        return "the user of TAILSTACK_DATABASE must own the database: ALTER DATABASE name OWNER TO user"
    return None


def now(db: Database, connection: Connection) -> float:
    """Epoch seconds: of the database server, so that hosts agree; of this host for a file."""
    if db.clock is not None:
        return db.clock()
    if db.dialect == "sqlite":
        return time.time()
    return float(connection.execute(_SERVER_TIME).scalar_one())


_SERVER_TIME = sa.text("SELECT extract(epoch FROM clock_timestamp())::float8")


def insert(dialect: str, table: sa.Table) -> Any:
    """An INSERT that knows ON CONFLICT."""
    return postgresql.insert(table) if dialect == "postgresql" else sqlite.insert(table)
