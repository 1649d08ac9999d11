"""The file of a SQLite database that is deleted, replaced, or on a full disk, under a service that runs.

Commands that only read change nothing in it.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import httpx
import psutil
import pytest
import sqlalchemy as sa
from containers import contain, surroundings
from served import Served, served
from service_scenes import client_of, small_design
from sqlalchemy.exc import OperationalError

from family import COMMAND, run_process
from tailstack_service.cli.main import main
from tailstack_service.jobs.store.database import Database, _find_closed, connect, find_reading_mode, reading, writing
from tailstack_service.jobs.store.keys import create_key
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.problems import StoreError
from waiting import LIMIT_SECONDS, until

BODY = {"design": small_design(), "trials": 1000}


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A disk of 24 MB if this user may mount one, else a directory."""
    folder = tmp_path_factory.mktemp("disk")
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", folder],
        capture_output=True,
        check=False,
        timeout=LIMIT_SECONDS,
    )
    try:
        yield folder
    finally:
        if mounted.returncode == 0:
            subprocess.run(["umount", "--lazy", folder], check=True, timeout=LIMIT_SECONDS)


@pytest.fixture(scope="module")
def service(disk: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    url = f"sqlite:///{disk / 'jobs.sqlite3'}"
    with served(tmp_path_factory.mktemp("log"), TAILSTACK_DATABASE=url, TAILSTACK_LEASE_SECONDS="1") as running:
        yield running


@pytest.fixture
def client(service: Served) -> Iterator[httpx.Client]:
    with client_of(service.url) as connected:
        until(lambda: ready(connected) == 200)
        yield connected


def ready(client: httpx.Client) -> int:
    return client.get("/health/ready").status_code


def count(client: httpx.Client) -> int:
    return len(client.get("/v1/jobs").json()["jobs"])


def accept(client: httpx.Client) -> str:
    accepted = client.post("/v1/verifications", json=BODY)
    assert accepted.status_code == 202, accepted.text
    return accepted.headers["location"]


def refuse(client: httpx.Client, slug: str, path: Path) -> None:
    """Nothing is accepted, in words that do not name the host's files, and readiness says so."""
    response = client.post("/v1/verifications", json=BODY)
    assert (response.status_code, response.json()["type"]) == (503, f"/v1/problems/{slug}"), response.text
    assert int(response.headers["retry-after"]) > 0
    assert str(path.parent) not in response.text
    until(lambda: ready(client) == 503)
    assert client.get("/health/ready").json()["status"] == "no database"


@contextmanager
def without(path: Path) -> Iterator[None]:
    """The file deleted; afterwards the very same file is there again."""
    kept = path.with_name(path.name + ".kept")
    os.link(path, kept)
    path.unlink()
    try:
        yield
    finally:
        os.replace(kept, path)


@pytest.mark.long
def test_nothing_is_written_into_a_file_that_was_deleted(service: Served, client: httpx.Client, disk: Path) -> None:
    path, before = disk / "jobs.sqlite3", count(client)
    job = accept(client)
    until(lambda: client.get(job).json()["state"] == "succeeded")
    with without(path):
        refuse(client, "store-error", path)
        assert client.get(job).status_code == 503
        # Who is started while it is away does not make a new one in its place
        worker = next(iter(workers_of(client)))
        looked = service.log.read_text().count("waiting for the database")
        worker.kill()
        until(lambda: service.log.read_text().count("waiting for the database") > looked + 1)
        assert worker.pid not in [child.pid for child in workers_of(client)]
        assert not path.exists()
    until(lambda: ready(client) == 200)
    assert count(client) == before + 1
    again = accept(client)
    until(lambda: client.get(again).json()["state"] == "succeeded")


def workers_of(client: httpx.Client) -> list[psutil.Process]:
    port = client.base_url.port
    serving = next(
        process for process in psutil.Process().children()
        if any(c.laddr.port == port and c.status == "LISTEN" for c in process.net_connections("tcp"))
    )  # fmt: skip
    running = [child for child in serving.children() if child.status() != psutil.STATUS_ZOMBIE]
    return [child for child in running if "worker" in child.cmdline()]


def test_nothing_is_written_beside_a_file_that_was_put_in_the_place_of_another(
    client: httpx.Client, disk: Path
) -> None:
    path, before = disk / "jobs.sqlite3", count(client)
    accept(client)
    with without(path):
        shutil.copy(path.with_name(path.name + ".kept"), path)
        refuse(client, "store-error", path)
    until(lambda: ready(client) == 200)
    assert count(client) == before + 1


def test_nothing_is_written_without_the_log_of_the_file(client: httpx.Client, disk: Path) -> None:
    path, before = disk / "jobs.sqlite3", count(client)
    accept(client)
    with without(path.with_name(path.name + "-wal")):
        refuse(client, "store-error", path)
    until(lambda: ready(client) == 200)
    assert count(client) == before + 1


def test_no_connection_is_opened_beside_another_log_and_used_once_the_log_is_back(
    migrated_file: Path, tmp_path: Path
) -> None:
    path = Path(shutil.copy(migrated_file, tmp_path / "jobs.sqlite3"))
    db = open_database(f"sqlite:///{path}")
    with writing(db) as connection:
        connection.exec_driver_sql("CREATE TABLE kept (x)")
    with reading(db) as connection:  # the log is copied into the file, and none of it is needed for reading any more
        connection.exec_driver_sql("COMMIT")
        connection.exec_driver_sql("PRAGMA wal_checkpoint(FULL)")
        connection.exec_driver_sql("BEGIN")
        with without(path.with_name(path.name + "-wal")), pytest.raises(StoreError, match="is another file"):
            count_kept(db)  # the connection of the pool is in use: this one opens another
        assert count_kept(db) == 0
    with writing(db) as connection:
        connection.exec_driver_sql("INSERT INTO kept VALUES (1)")
    assert count_kept(db) == 1
    db.close()
    with closing(sqlite3.connect(path)) as checked:
        assert checked.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def test_a_log_that_went_with_the_last_connection_is_made_anew(migrated_file: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(migrated_file, tmp_path / "jobs.sqlite3"))
    db, log = open_database(f"sqlite:///{path}"), path.with_name(path.name + "-wal")
    with writing(db) as connection:
        connection.exec_driver_sql("CREATE TABLE kept (x)")
    with log.open("rb") as held:  # the number of its inode is not given to another file as long as this one is open
        db.close()
        assert not log.exists()
        for number in (1, 2):
            with writing(db) as connection:
                connection.exec_driver_sql(f"INSERT INTO kept VALUES ({number})")
        assert log.stat().st_ino != os.fstat(held.fileno()).st_ino
    assert count_kept(db) == 2


def count_kept(db: Database) -> int:
    with reading(db) as connection:
        return connection.execute(sa.text("SELECT count(*) FROM kept")).scalar_one()


@pytest.mark.long
def test_a_full_disk_shows_in_readiness_until_there_is_room_again(client: httpx.Client, disk: Path) -> None:
    if not disk.is_mount():
        pytest.skip("NOT TESTED: this user may not mount a small disk")
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        while shutil.disk_usage(disk).free > 0:
            file.write(bytes(min(1 << 20, shutil.disk_usage(disk).free)))
    try:
        until(lambda: ready(client) == 503)
        assert client.get("/health/ready").json()["status"] == "no database"
        assert client.get("/v1/jobs").status_code == 200  # what is there can be read
    finally:
        filler.unlink()
    until(lambda: ready(client) == 200)
    accept(client)


# --- files that are only read ---------------------------------------------------------------------


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
    command = contain(*COMMAND, "db", "check", "--database", url_of(file))
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
