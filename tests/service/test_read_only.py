"""What only reads a database changes nothing: no byte of the file, no file beside it; it needs no leave to write."""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from containers import contain, surroundings
from sqlalchemy.exc import OperationalError

from family import run_process
from tailstack_service.cli.main import main
from tailstack_service.jobs.store.database import Database, _find_closed, connect, find_reading_mode, reading
from tailstack_service.jobs.store.keys import create_key
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.problems import StoreError


def url_of(path: Path) -> str:
    return f"sqlite:///{path}"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A database that nobody has open, in a folder of its own."""
    (tmp_path / "kept").mkdir()
    path = tmp_path / "kept" / "jobs.sqlite3"
    migrate_database(url_of(path))
    db = open_database(url_of(path))
    create_key(db, tenant="acme", name="ci", scopes=("read",), days=30)
    db.close()
    return path


def journal_mode(path: Path) -> str:
    with closing(sqlite3.connect(f"{path.as_uri()}?immutable=1", uri=True)) as connection:
        return str(connection.execute("PRAGMA journal_mode").fetchone()[0])


@pytest.mark.parametrize("arguments", [["db", "check"], ["keys", "list"], ["keys", "log"]])
@pytest.mark.parametrize("backup", [False, True])
def test_nothing_is_changed(file: Path, arguments: list[str], backup: bool, tmp_path: Path) -> None:
    if backup:  # which has another journal mode
        (tmp_path / "copies").mkdir()
        with closing(sqlite3.connect(file)) as connection:
            connection.execute(f"VACUUM INTO '{tmp_path / 'copies' / 'b'}'")
        file = tmp_path / "copies" / "b"
    before, status = file.read_bytes(), file.stat()
    assert main([*arguments, "--database", url_of(file)]) == 0
    assert file.read_bytes() == before
    assert file.stat().st_mtime_ns == status.st_mtime_ns
    assert [entry.name for entry in file.parent.iterdir()] == [file.name]


def test_what_a_running_service_has_written_is_seen(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with closing(open_database(url_of(file))) as db:
        create_key(db, tenant="later", name="n", scopes=("read",), days=30)  # is in the log as yet
        assert Path(f"{file}-wal").stat().st_size
        assert find_reading_mode(file) == "mode=ro"
        assert main(["keys", "list", "--database", url_of(file)]) == 0
        assert "later" in capsys.readouterr().out
        assert main(["db", "check", "--database", url_of(file)]) == 0
        create_key(db, tenant="last", name="n", scopes=("read",), days=30)


def test_nothing_can_be_written_through_it(file: Path) -> None:
    for db in (connect(url_of(file), read_only=True), open_database(url_of(file), read_only=True)):
        with pytest.raises(StoreError):
            create_key(db, tenant="acme", name="n", scopes=("read",), days=30)
        db.close()


def test_a_copy_on_a_disk_that_cannot_be_written(file: Path) -> None:
    """As root may write everywhere, the folder is mounted read-only for a user of no name."""
    mounted = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && exec "$@"'
    folder = str(file.parent)
    command = contain("-m", "tailstack_service.cli.main", "db", "check", "--database", url_of(file))
    done = run_process("unshare", "--mount", "sh", "-c", mounted, folder, *command, env=surroundings(), cwd="/")
    assert done.returncode == 0, done.stderr
    assert "sound" in done.stdout


def test_a_log_that_cannot_be_read_is_no_reason_to_try_again(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "copy").mkdir()
    copy = tmp_path / "copy" / file.name
    db = open_database(url_of(file))
    create_key(db, tenant="later", name="n", scopes=("read",), days=30)
    for ending in ("", "-wal"):  # of a killed service
        shutil.copy(f"{file}{ending}", f"{copy}{ending}")
    db.close()
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert main(["db", "check", "--database", url_of(copy)]) == 3
    said = capsys.readouterr().err
    assert f"{copy}-wal holds what is not in the file yet" in said
    assert "copy both to a folder that can be written" in said
    assert "again in a moment" not in said


def test_a_file_that_this_user_may_not_open_is_no_reason_to_try_again(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    db = connect(url_of(file))
    cause = sqlite3.OperationalError("unable to open database file")
    cause.sqlite_errorcode = sqlite3.SQLITE_CANTOPEN
    error = OperationalError("BEGIN", None, cause)
    assert _find_closed(db, error) is None, "of root: it may come back"
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert _find_closed(db, error) == file.parent
    with pytest.raises(StoreError, match="must be allowed to write"), reading(db):
        raise error
    db.close()


def test_of_postgresql_nothing_is_written_either(postgres_url: str) -> None:
    migrate_database(postgres_url)
    db: Database = connect(postgres_url, read_only=True)
    with reading(db) as connection:
        assert connection.exec_driver_sql("SHOW transaction_read_only").scalar_one() == "on"
    db.close()
