"""A copy of a database in one file, made while the service runs, and looked at before it is called a backup."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import tempfile
from contextlib import closing
from pathlib import Path
from shlex import quote

import sqlalchemy as sa
from sqlalchemy.engine import URL

from tailstack.errors import Problem

from .damage import find_changed_results, find_missing_results
from .database import connect, parse_url, reading
from .errors import StoreError, StoreUnavailable

DUMP_SECONDS = 3_600.0


def backup(url: str, target: Path) -> str:
    """Copy the database into ``target``, which must not exist.  Returns how it is restored.

    SQLite: the file itself, by the online backup API, its integrity checked.  PostgreSQL: ``pg_dump`` in its custom
    format, its table of contents read back.  The file appears under its name only when it is complete and on the disk.
    Raises StoreError, also where a stored answer is damaged: the earlier backups, which may hold it as it was, must not
    make room for one that does not.
    """
    parsed = parse_url(url)
    if target.exists():
        raise _refused("backup-exists", f"{target} exists already", "give another name: nothing is overwritten")
    if not target.parent.is_dir():
        raise _refused("no-directory", f"there is no directory {target.parent}", f"mkdir -p {target.parent}")
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
            raise _refused("backup-exists", f"{target} exists already", "give another name") from None
    _sync(target.parent)
    return restored


def _require_undamaged(url: str) -> None:
    db = connect(url)
    try:
        with reading(db.within(DUMP_SECONDS)) as connection:
            damaged = []
            if sa.inspect(connection).has_table("results"):
                damaged = [*find_changed_results(connection), *find_missing_results(connection)]
    except StoreUnavailable as error:
        raise _refused("backup-failed", error.problems[0].detail, error.problems[0].hint) from None
    finally:
        db.close()
    if damaged:
        names = ", ".join(damaged[:3]) + (" ..." if len(damaged) > 3 else "")
        detail = f"{len(damaged)} of the stored answers are damaged and would be in the backup: {names}"
        hint = (
            "keep the earlier backups; tailstack db mend fails the jobs of these and deletes them, then back up again"
        )
        raise _refused("backup-damaged", detail, hint)


def _refused(code: str, detail: str, hint: str) -> StoreError:
    return StoreError(Problem("", code, detail, hint))


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _copy_file(source: Path, target: Path) -> None:
    if not source.exists():
        raise _refused("no-database", f"there is no database at {source}", "TAILSTACK_DATABASE says which one is meant")
    os.close(os.open(target, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    try:
        with closing(sqlite3.connect(source, timeout=30)) as from_, closing(sqlite3.connect(target)) as to:
            from_.backup(to)
            to.execute("PRAGMA journal_mode=DELETE").fetchone()  # one file, without a -wal beside it
            found = [row[0] for row in to.execute("PRAGMA integrity_check")]
            found += ["a row refers to one that is missing" for _ in to.execute("PRAGMA foreign_key_check")]
    except sqlite3.Error as error:
        raise _refused("backup-failed", f"{source}: {error}", "tailstack db check") from None
    if found != ["ok"]:
        raise _refused("backup-failed", f"the copy is not sound: {'; '.join(found[:3])}", "tailstack db check")


def _dump(url: URL, target: Path) -> None:
    program = find_program("pg_dump")
    if program is None:
        detail = "pg_dump is needed to back up PostgreSQL, and it is neither on PATH nor beside pg_config"
        raise _refused("no-pg-dump", detail, "install it: apt-get install postgresql-client")
    os.close(os.open(target, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    # Nothing secret in the arguments: every user of the host can read them
    public = URL.create("postgresql", url.username, None, url.host, url.port, url.database, url.query)
    address = public.render_as_string(hide_password=False)
    environment = dict(os.environ)
    if url.password is not None:
        environment["PGPASSWORD"] = str(url.password)
    _call([program, "--format=custom", "--no-password", f"--file={target}", f"--dbname={address}"], environment)
    restore = find_program("pg_restore")
    if restore is not None:
        _call([restore, "--list", str(target)], environment)


def _call(command: list[str], environment: dict[str, str]) -> None:
    try:
        done = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=DUMP_SECONDS
        )
    except subprocess.TimeoutExpired:
        detail = f"{Path(command[0]).name} took more than {DUMP_SECONDS:g} s"
        raise _refused("backup-failed", detail, "run pg_dump --format=custom by hand") from None
    if done.returncode != 0:
        reason = (done.stderr.strip() or f"exit code {done.returncode}").partition("\n")[0]
        hint = "pg_dump must not be older than the server; TAILSTACK_DATABASE says which database is meant"
        raise _refused("backup-failed", f"{Path(command[0]).name}: {reason}", hint)


def find_program(name: str) -> str | None:
    """A program of PostgreSQL: on PATH, or where ``pg_config`` says, or where Debian keeps it."""
    found = shutil.which(name)
    if found:
        return found
    configured = shutil.which("pg_config")
    if configured:
        done = subprocess.run([configured, "--bindir"], capture_output=True, text=True, timeout=30)
        beside = Path(done.stdout.strip()) / name
        if done.returncode == 0 and beside.exists():
            return str(beside)
    debian = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: path.parts[4].zfill(8))
    return str(debian[-1]) if debian else None
