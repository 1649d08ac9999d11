"""How a database is opened: which version its tables have, and how they are brought to the one that this code knows."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from threading import Lock

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import Problem

from ...clock import SYSTEM_CLOCK, Clock
from ...problems import StoreError
from .database import Database, connect, parse_url, reading, writing
from .tables import metadata

BASELINE = "0004"  # the oldest of migrations/versions, and so the oldest version that is brought up to date
HEAD = BASELINE  # the newest of them
MIGRATING_SECONDS = 3_600.0  # for a server to change large tables, or for another who does it to be done
MIGRATIONS = Path(__file__).parent / "migrations"
_ONE_AT_A_TIME = Lock()  # Alembic hands its context around in global variables
_LOCK = 1413564242  # of pg_advisory_xact_lock: any number that nothing else here uses


def schema_version(db: Database) -> str | None:
    """``read_version`` in a transaction of its own."""
    with reading(db) as connection:
        return read_version(connection)


def read_version(connection: Connection) -> str | None:
    """The version of the tables, None for a database without them.  Versions sort as texts."""
    if not sa.inspect(connection).has_table("alembic_version"):
        return None
    version: str | None = connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar_one_or_none()
    return version


def require_current(db: Database) -> None:
    """Raise StoreError, with the next command, unless the tables are of the version that this code knows."""
    version = schema_version(db)
    if version is None:
        raise StoreError(Problem("", "no-schema", "the database holds no tables of tailstack", "tailstack db migrate"))
    _refuse_strange(version)
    if version < HEAD:
        detail = f"the database has schema version {version}, this tailstack needs {HEAD}"
        raise StoreError(Problem("", "old-schema", detail, "back it up (docs/deploy.md), then tailstack db migrate"))


def _refuse_strange(version: str | None) -> None:
    """Raise StoreError for what can neither be used nor brought up to date."""
    if version is None:
        return
    if version > HEAD:
        detail = f"the database has schema version {version}, this tailstack knows {HEAD} at most"
        hint = "a newer tailstack has changed it: use that one, or restore the backup made before"
        raise StoreError(Problem("", "newer-schema", detail, hint))
    if version < BASELINE:
        detail = f"the database has schema version {version}, of a tailstack before 0.2, which this one cannot read"
        hint = "move it away, or name another with TAILSTACK_DATABASE; jobs are sent and keys are made anew"
        raise StoreError(Problem("", "ancient-schema", detail, hint))


def migrate_database(url: str) -> tuple[str | None, str]:
    """Create the tables or bring them up to date; a SQLite file is made if there is none.

    All or nothing, and safe when several do it at once: one does, the others find it done.  Returns the version before
    and after.  Raises StoreError (a version of before 0.2 or a newer one, a bad URL), StoreUnavailable.
    """
    with closing(connect(url, create=True)) as db:
        with writing(db.within(MIGRATING_SECONDS) if db.dialect == "postgresql" else db) as connection:
            if db.dialect == "postgresql":
                connection.execute(sa.text("SET LOCAL statement_timeout = 0; SET LOCAL lock_timeout = 0"))
                connection.execute(sa.text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
            before = read_version(connection)
            _refuse_strange(before)
            if before != HEAD:
                _upgrade(connection, before)
        return before, HEAD


def _upgrade(connection: Connection, before: str | None) -> None:
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    with _ONE_AT_A_TIME:
        if before is None:
            metadata.create_all(connection)
            command.stamp(config, HEAD)
        else:
            command.upgrade(config, HEAD)


def open_database(
    url: str, *, migrate: bool = False, clock: Clock = SYSTEM_CLOCK, seconds: float | None = None,
    read_only: bool = False,
) -> Database:  # fmt: skip
    """A database whose schema is the one that this version knows.

    ``migrate`` creates a SQLite file or brings it up to date; PostgreSQL is only ever changed by ``tailstack db
    migrate``, so that hosts of a cluster do not change it under one another.  ``seconds``: for it to answer now; its
    later transactions have their own.  ``read_only``: as :func:`connect` says.

    Raises StoreError with the next command, StoreUnavailable if the server cannot be reached.
    """
    if parse_url(url).get_backend_name() == "sqlite" and migrate:
        migrate_database(url)
    db = connect(url, clock=clock, read_only=read_only)
    try:
        require_current(db if seconds is None else db.within(seconds))
    except BaseException:
        db.close()
        raise
    return db
