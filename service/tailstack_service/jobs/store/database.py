"""One database, SQLite or PostgreSQL: how it is reached, what a transaction is, what time it is.

Every transaction has a limit of time, whatever became of the database, and says StoreUnavailable when it is over: it
may be tried again.  StoreError says that somebody has to do something first.
"""

from __future__ import annotations

import errno
import math
import os
import random
import sqlite3
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, TypeAlias

import sqlalchemy as sa
from sqlalchemy import exc
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, Connection, Engine, Row, make_url

from tailstack.errors import Problem
from tailstack.extras import name_missing_extra

from ...clock import SYSTEM_CLOCK, Clock
from ...problems import BadDatabaseUrl, StoreError, StoreUnavailable

ROOM_BYTES = 4 << 20  # of free disk, without which a service does not call itself ready
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class DatabaseFile:
    """What ``path`` named when it was first looked at.

    A program goes on writing into a file that was deleted, or that another was put in the place of, and all of it is
    lost with the program's end.  The same holds of SQLite's write-ahead log beside it, ``path``-wal, which SQLite
    deletes with the last connection to the file and makes anew with the next.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self._log = Path(f"{self.path}-wal")
        self._file_seen: tuple[int, int] | None = None
        self._log_seen: tuple[int, int] | None = None
        self._open: set[int] = set()  # connections of this process

    def admit(self, connection: sqlite3.Connection) -> None:
        """Count a connection that was just opened.  Raises StoreError where it has another file or log open.

        SQLite makes a log where there is none.  Used once the right one is back, a connection that has such a log open
        reads what is not there, and writes what makes the file malformed for all others.
        """
        self.require_same(and_log=True)
        self._open.add(id(connection))

    def release(self, connection: sqlite3.Connection) -> None:
        """Count a connection that is being closed: with the last the log may go."""
        self._open.discard(id(connection))
        if not self._open:
            self._log_seen = None

    def require_same(self, *, and_log: bool = False) -> None:
        """Raise StoreError if the path leads to nothing, or to another file than before.

        ``and_log``: also for the log, which is there while a transaction is under way.
        """
        self._file_seen = _require_same_inode(self.path, self._file_seen)
        # A file system without shared memory has no log: then there is none to be seen, and none to be missed
        if and_log and (self._log_seen is not None or self._log.exists()):
            self._log_seen = _require_same_inode(self._log, self._log_seen)

    def require_room(self) -> None:
        """Raise StoreUnavailable unless ``ROOM_BYTES`` can be had on the disk, which are given back at once.

        They are really reserved, for a file without a name: that knows of quotas as well as of full disks.
        """
        try:
            with tempfile.TemporaryFile(dir=self.path.parent) as file:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, ROOM_BYTES)
                else:
                    file.write(bytes(ROOM_BYTES))
                    file.flush()
        except OSError as error:
            if error.errno in _NO_ROOM:
                detail = f"the disk of {self.path} is full: {ROOM_BYTES >> 20} MB could not be reserved"
                hint = "make room, or give the service another disk; it is ready again by itself"
                raise StoreUnavailable(Problem("", "disk-full", detail, hint)) from None
            detail = f"nothing can be written beside {self.path}: {error.strerror or error}"
            raise StoreError(Problem("", "unusable-database", detail, _OPEN)) from None


def _require_same_inode(path: Path, seen: tuple[int, int] | None) -> tuple[int, int]:
    try:
        status = os.stat(path)
    except FileNotFoundError:
        status = None
    except OSError as error:
        hint = "the log of the system says what became of the disk"
        raise StoreError(Problem("", "unusable-database", f"{path}: {error.strerror or error}", hint)) from None
    if status is not None and (seen is None or seen == (status.st_dev, status.st_ino)):
        return status.st_dev, status.st_ino
    what = "was deleted" if status is None else "is another file than the one that was opened"
    hint = (
        "put the very file back; docs/deploy.md says how to save what is in one that was deleted, "
        "before tailstack is stopped and started again with what is there then"
    )
    raise StoreError(Problem("", "database-gone", f"{path} {what}; nothing is written", hint))


AnyRow: TypeAlias = "Row[*tuple[Any, ...]]"

BUSY_SECONDS = 10.0  # for a transaction, from its begin to its end; ``Database.within`` says otherwise
CONNECTING_SECONDS = 5.0  # of those, for a server to take a connection
POSTGRESQL_OPTIONS = (
    "-c statement_timeout=30s -c lock_timeout=10s -c idle_in_transaction_session_timeout=60s -c synchronous_commit=on"
)
# Primary result codes of SQLite that say "not now": BUSY, LOCKED, NOMEM, INTERRUPT, IOERR, FULL, CANTOPEN, PROTOCOL
PASSING_SQLITE_CODES = {5, 6, 7, 9, 10, 13, 14, 15}
DAMAGED_SQLITE_CODES = {11, 26}  # CORRUPT, NOTADB
CLOSED_SQLITE_CODES = {3, 8, 23}  # PERM, READONLY, AUTH


@dataclass(slots=True)
class Deadline:
    """The moment (monotonic seconds) by which every call of a database has to be over, those under way included."""

    at: float = math.inf


@dataclass(slots=True)
class Lifetime:
    """Up to which moment (monotonic seconds) the time that this process lived through is written in the database."""

    written: float


@dataclass(frozen=True, slots=True)
class Database:
    """A pool of connections.  A ``clock`` other than the system's also replaces the time of the server, in tests.

    No transaction waits longer than its seconds for the database, whatever became of it: a server whose processes are
    stopped, a network that swallows packets.  Its connection is then given up, and StoreUnavailable raised.
    """

    engine: Engine
    dialect: str  # "sqlite" or "postgresql"
    life: Lifetime
    clock: Clock = SYSTEM_CLOCK
    # SQLite has one writer: threads of this process queue here instead of polling its lock
    turn: Lock | None = None
    file: DatabaseFile | None = None  # of SQLite
    seconds: float | None = None  # of one transaction; None: BUSY_SECONDS
    end: Deadline = field(default_factory=Deadline)

    def within(self, seconds: float) -> Database:
        """The same database, for transactions that may take so many seconds."""
        return replace(self, seconds=seconds)

    def endable(self) -> Database:
        """The same database, for calls that ``end_within`` ends."""
        return replace(self, end=Deadline())

    def end_within(self, seconds: float) -> None:
        """Let every call through this object end by then, also those under way.  From any thread or signal handler."""
        self.end.at = min(self.end.at, self.clock.monotonic() + seconds)

    def close(self) -> None:
        """Close every connection of the pool."""
        self.engine.dispose()


class _Limit(threading.local):
    """Until when the transaction of this thread may wait for the database."""

    at: float = math.inf  # monotonic seconds
    end: Deadline = Deadline()
    seconds: float = math.inf  # of the transaction, for the words of a refusal
    clock: Clock = SYSTEM_CLOCK

    def left(self) -> float:
        return min(self.at, self.end.at) - self.clock.monotonic()


_limit = _Limit()


@contextmanager
def _limit_transaction(db: Database) -> Iterator[None]:
    before = _limit.at, _limit.end, _limit.seconds, _limit.clock
    seconds = BUSY_SECONDS if db.seconds is None else db.seconds
    _limit.at, _limit.end, _limit.seconds = db.clock.monotonic() + seconds, db.end, seconds
    _limit.clock = db.clock
    try:
        yield
    finally:
        _limit.at, _limit.end, _limit.seconds, _limit.clock = before


def parse_url(url: str) -> URL:
    """The URL with the driver that is used.  Raises StoreError for any that is not understood."""
    try:
        parsed = make_url(url)
        backend = parsed.get_backend_name()
    except exc.ArgumentError:
        raise _url_error("it cannot be read as a URL") from None
    if backend in ("postgresql", "postgres"):
        return parsed.set(drivername="postgresql+psycopg")
    if backend != "sqlite":
        raise _url_error(f"{backend} is not known here")
    if not parsed.database or parsed.database == ":memory:" or parsed.query:
        raise _url_error("jobs must outlive the process: a file is needed, without further parameters")
    return parsed.set(drivername="sqlite")


def _url_error(why: str) -> StoreError:
    hint = "say sqlite:////absolute/path.sqlite3 or postgresql://USER:PASSWORD@HOST/NAME"
    detail = f"the database that TAILSTACK_DATABASE or --database names: {why}"
    return BadDatabaseUrl(Problem("", "bad-database-url", detail, hint))


def connect(url: str, *, create: bool = False, clock: Clock = SYSTEM_CLOCK, read_only: bool = False) -> Database:
    """A database as it is, whatever its schema.  ``create`` makes a SQLite file.

    ``read_only``: nothing can be written through it, and nothing is: not a byte of a SQLite file, nor a file beside it
    that nobody has made yet, so that a copy on a disk that cannot be written can be looked at.

    Raises StoreError; MissingExtraError where the driver of PostgreSQL is not installed.
    """
    parsed, life = parse_url(url), Lifetime(clock.monotonic())
    if parsed.get_backend_name() == "sqlite":
        path = Path(str(parsed.database))
        _require_file(path, create)
        mode, file = find_reading_mode(path) if read_only else "mode=rw", DatabaseFile(path)
        return Database(_make_sqlite_engine(parsed, mode, file), "sqlite", life, clock, Lock(), file)
    with name_missing_extra():
        engine = _make_postgresql_engine(parsed, read_only=read_only)
    return Database(engine, "postgresql", life, clock)


def _require_file(path: Path, create: bool) -> None:
    if path.exists():
        return
    if not create:
        hint = "tailstack serve makes it, and so does tailstack db migrate"
        raise StoreError(Problem("", "no-database", f"there is no database at {path}", hint))
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))  # SQLite gives its -wal and -shm files the same mode
    except OSError as error:
        detail = f"{error.filename or path} cannot be written ({error.strerror or error})"
        hint = "--database or TAILSTACK_DATABASE names another place, such as sqlite:////tmp/tailstack.sqlite3"
        raise BadDatabaseUrl(Problem("", "file-unwritable", detail, hint)) from None


def find_reading_mode(path: Path) -> str:
    """How SQLite opens a file that is only to be read, as parameters of its URI.

    With a log beside it (a service is running, or was killed) the log is read too, which takes shared memory beside
    the file.  Without one nobody has it open: SQLite is told that nobody will write, for otherwise it makes a log.
    Raises StoreError where a log is there, and that memory can neither be had nor made.
    """
    log, journal, shared = (Path(f"{path}{ending}") for ending in ("-wal", "-journal", "-shm"))
    left = [each for each in (log, journal) if each.exists() and each.stat().st_size]
    if not left and not shared.exists():
        return "immutable=1"
    if journal in left or not (shared.exists() or os.access(path.parent, os.W_OK)):
        what = f"{(left or [shared])[0]} holds what is not in the file yet"
        hint = "copy both to a folder that can be written, and name the copy with --database"
        detail = f"{what}, and nothing can be written beside it, which reading it takes"
        raise StoreError(Problem("", "unusable-database", detail, hint))
    return "mode=ro"


def _make_sqlite_engine(url: URL, mode: str, file: DatabaseFile) -> Engine:
    engine = sa.create_engine(
        url, connect_args={"timeout": BUSY_SECONDS}, pool_size=8, max_overflow=64, pool_timeout=BUSY_SECONDS
    )

    @sa.event.listens_for(engine, "do_connect")
    def _connect(_dialect: Any, _record: Any, arguments: list[Any], named: dict[str, Any]) -> None:
        # By itself SQLite makes an empty file where there is none, say in the place of one that was deleted
        arguments[0], named["uri"] = f"{Path(arguments[0]).absolute().as_uri()}?{mode}", True

    @sa.event.listens_for(engine, "connect")
    def _configure(connection: Any, record: Any) -> None:
        connection.isolation_level = None  # BEGIN is ours to say
        writes = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "journal_size_limit=67108864")
        end = _limit.clock.monotonic() + BUSY_SECONDS
        for pragma in writes if mode == "mode=rw" else ("query_only=ON",):
            # Of several that make the log at once, SQLite lets some wait and refuses others at once
            ask = partial(connection.execute, f"PRAGMA {pragma}")
            _ask_until_free(ask, lambda: min(_limit.left(), end - _limit.clock.monotonic())).close()
        if mode == "mode=rw":
            try:
                file.admit(connection)
            except StoreError:
                connection.close()
                raise

    @sa.event.listens_for(engine, "close")
    def _release(connection: Any, record: Any) -> None:
        file.release(connection)

    @sa.event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        if connection.get_execution_options().get("tailstack_writes"):
            _begin_writing(connection)
        else:
            connection.exec_driver_sql("BEGIN")

    return engine


def _begin_writing(connection: Connection) -> None:
    """Take the write lock, within the transaction's time, before anything is read: a transaction that reads first and
    writes later would be refused at its first write.

    SQLite's own way to wait sleeps for up to 0.1 s at a time, and a busier process comes first each time.  Asking every
    few milliseconds instead took the longest wait of two processes that only write from 1.9 s to 0.3 s.
    """
    connection.exec_driver_sql("PRAGMA busy_timeout=0")
    try:
        _ask_until_free(partial(connection.exec_driver_sql, "BEGIN IMMEDIATE"), _limit.left)
    finally:
        connection.exec_driver_sql(f"PRAGMA busy_timeout={1000 * BUSY_SECONDS:.0f}")


def _ask_until_free(ask: Callable[[], Any], left: Callable[[], float]) -> Any:
    """What is answered once nobody else holds the file, as long as seconds are left."""
    while True:
        try:
            return ask()
        except (exc.OperationalError, sqlite3.OperationalError) as error:
            if _sqlite_code(error) != sqlite3.SQLITE_BUSY or left() < 0:
                raise
        _limit.clock.sleep(random.uniform(0.0005, 0.004))


def _make_postgresql_engine(url: URL, *, read_only: bool = False) -> Engine:
    options = POSTGRESQL_OPTIONS + (" -c default_transaction_read_only=on" if read_only else "")
    arguments: dict[str, Any] = {"application_name": "tailstack", "options": options}
    # For connections that nobody waits on: the system gives up those whose other end is gone
    arguments |= {"keepalives_idle": 30, "keepalives_interval": 10, "keepalives_count": 3, "tcp_user_timeout": 30_000}
    arguments = {key: value for key, value in arguments.items() if key not in url.query}
    engine = sa.create_engine(
        url, connect_args=arguments, isolation_level="READ COMMITTED", pool_pre_ping=True, pool_size=8,
        max_overflow=16, pool_timeout=BUSY_SECONDS,
    )  # fmt: skip
    limited = _make_limited_connection(engine.dialect.dbapi)

    @sa.event.listens_for(engine, "do_connect")
    def _connect(_dialect: Any, _record: Any, arguments: list[Any], named: dict[str, Any]) -> Any:
        left = min(CONNECTING_SECONDS, _limit.left())
        if left <= 0:
            raise limited.silent()
        # psycopg waits for two seconds at least, for each address of the host
        return limited.connect(*arguments, **{"connect_timeout": math.ceil(left), **named})

    return engine


def _make_limited_connection(psycopg: Any) -> Any:
    """psycopg's Connection, which waits for the server for as long as the transaction of its thread may.

    The server's own limits (statement_timeout and the like) end nothing while the server itself stands still.
    """

    class LimitedConnection(psycopg.Connection):  # type: ignore[misc]
        @staticmethod
        def silent() -> Any:
            return psycopg.OperationalError(f"the database did not answer within {_limit.seconds:g} s")

        def wait(self, gen: Any, *arguments: Any, **named: Any) -> Any:
            try:
                return super().wait(self._within_limit(gen), *arguments, **named)
            except TimeoutError:
                # What was asked may still be done, or not: nobody can use this connection again
                self.pgconn.finish()
                raise self.silent() from None

        @staticmethod
        def _within_limit(gen: Any) -> Any:
            """``gen``, which waits for the socket; it is told every tenth of a second that nothing has come."""
            try:
                waits_for = next(gen)
                while True:
                    came = yield waits_for
                    if not came and _limit.left() < 0:
                        raise TimeoutError
                    waits_for = gen.send(came)
            except StopIteration as done:
                return done.value

    return LimitedConnection


@contextmanager
def reading(db: Database) -> Iterator[Connection]:
    """A transaction that only reads; on SQLite it neither waits for a writer nor keeps one waiting.

    Raises StoreUnavailable, also where it takes longer than it may, and StoreError for a file that is another by now.
    """
    with _limit_transaction(db), _translate_faults(db):
        _require_same_file(db)
        with db.engine.connect() as connection:
            yield connection


@contextmanager
def writing(db: Database) -> Iterator[Connection]:
    """A transaction that writes: committed at the end of the block, undone if the block raises.

    On SQLite whoever cannot begin in time, behind threads of this process and other processes, is refused
    (StoreUnavailable): a writer that is stopped must not make all others wait, one after the other.  Raises as
    ``reading``.
    """
    with _limit_transaction(db), _translate_faults(db), _take_turn(db):
        _require_same_file(db)
        with db.engine.connect() as plain:
            connection = plain.execution_options(tailstack_writes=True)
            with connection.begin():
                _require_same_file(db, and_log=True)
                yield connection
                _require_same_file(db, and_log=True)


def _require_same_file(db: Database, *, and_log: bool = False) -> None:
    if db.file is not None:
        db.file.require_same(and_log=and_log)


@contextmanager
def _take_turn(db: Database) -> Iterator[None]:
    if db.turn is None:
        yield
        return
    if not db.turn.acquire(timeout=max(0.0, _limit.left())):
        detail = f"another writer has held the database for more than {_limit.seconds:g} s"
        raise StoreUnavailable(Problem("", "store-unavailable", detail, _SQLITE_PATIENCE))
    try:
        yield
    finally:
        db.turn.release()


@contextmanager
def _translate_faults(db: Database) -> Iterator[None]:
    try:
        yield
    except (exc.DBAPIError, exc.TimeoutError) as error:
        reason = str(getattr(error, "orig", None) or error).strip().partition("\n")[0]
        if (closed := _find_closed(db, error)) is not None:
            detail = f"{closed} cannot be used by this user"
            raise StoreError(Problem("", "unusable-database", detail, _OPEN)) from error
        if _is_temporary(error):
            patience = _SERVER_PATIENCE if _sqlite_code(error) is None else _SQLITE_PATIENCE
            raise StoreUnavailable(Problem("", "store-unavailable", reason, patience)) from error
        cure = _find_cure(error)
        if cure is not None:
            raise StoreError(Problem("", "unusable-database", reason, cure)) from error
        raise


def _sqlite_code(error: Exception) -> int | None:
    """The primary result code of SQLite; None for what it did not say."""
    code = getattr(getattr(error, "orig", error), "sqlite_errorcode", None)
    return None if code is None else int(code) & 0xFF


def _find_closed(db: Database, error: exc.DBAPIError | exc.TimeoutError) -> Path | None:
    """What keeps SQLite from opening its file for ever: the file or its folder, which this user may not use."""
    if db.file is None or _sqlite_code(error) != sqlite3.SQLITE_CANTOPEN:
        return None
    places = (db.file.path.parent, db.file.path)
    return next((place for place in places if not os.access(place, os.R_OK | os.W_OK)), None)


def _is_temporary(error: exc.DBAPIError | exc.TimeoutError) -> bool:
    if isinstance(error, exc.TimeoutError) or error.connection_invalidated:
        return True
    code = _sqlite_code(error)
    if code is not None:
        return code in PASSING_SQLITE_CODES
    return isinstance(error, exc.OperationalError | exc.InterfaceError)


_OPEN = "this user must be allowed to write the file and its directory"
_SQLITE_PATIENCE = "try again in a moment; no other program may hold the file, and its disk must not be full"
_SERVER_PATIENCE = "try again in a moment; the server that TAILSTACK_DATABASE names must be running"


def _find_cure(error: exc.DBAPIError | exc.TimeoutError) -> str | None:
    """What an operator can do about a database that cannot be used as it is; None for a defect of ours."""
    code = _sqlite_code(error)
    if code in DAMAGED_SQLITE_CODES:
        return "restore a backup, or set TAILSTACK_DATABASE to another file"
    if code in CLOSED_SQLITE_CODES:
        return _OPEN
    if getattr(getattr(error, "orig", None), "sqlstate", None) == "42501":
        return "the user of TAILSTACK_DATABASE must own the database: ALTER DATABASE name OWNER TO user"
    return None


def now(db: Database, connection: Connection) -> float:
    """Epoch seconds: of the database server, so that hosts agree; of this host for a file."""
    if db.dialect == "sqlite" or db.clock is not SYSTEM_CLOCK:
        return db.clock.time()
    return float(connection.execute(_SERVER_TIME).scalar_one())


_SERVER_TIME = sa.text("SELECT extract(epoch FROM clock_timestamp())::float8")


def insert(dialect: str, table: sa.Table) -> Any:
    """An INSERT that knows ON CONFLICT."""
    return postgresql.insert(table) if dialect == "postgresql" else sqlite.insert(table)
