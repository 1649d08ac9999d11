"""Databases that fail under a service: a file that is deleted, replaced or on a full disk, a server that stands still,
and stored bytes that were changed behind the service's back.

Nobody waits longer than he may, readiness says so, nothing that was changed is served or computed with, and everything
goes on by itself afterwards."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sqlite3
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
import sqlalchemy as sa
import strange_units
from containers import contain, surroundings
from postgres import Server
from served import Served, served
from service_scenes import client_of, client_with, small_design
from sqlalchemy.exc import OperationalError
from store_scenes import Clock, claim, claim_one, find, finish, record, split, submit, url_of
from worker_scenes import prepared_database, worker_process
from worker_scenes import submit as submit_strange

from family import COMMAND, run_process
from tailstack_service.cli.main import main
from tailstack_service.http import service as http_service
from tailstack_service.jobs.store import database, jobs, results, upkeep
from tailstack_service.jobs.store.database import Database, _find_closed, connect, find_reading_mode, reading, writing
from tailstack_service.jobs.store.keys import create_key
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.problems import DamagedStore, StoreError, StoreUnavailable
from tailstack_service.settings import Settings
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS, until, until_async

BODY = {"design": small_design(), "trials": 1000}


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A disk of 24 MB if this user may mount one, else a directory."""
    folder = tmp_path_factory.mktemp("disk")
    mounted = run_process("mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", folder)
    try:
        yield folder
    finally:
        if mounted.returncode == 0:
            run_process("umount", "--lazy", folder, check=True)


@pytest.fixture(scope="module")
def service(disk: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    url = f"sqlite:///{disk / 'jobs.sqlite3'}"
    with served(tmp_path_factory.mktemp("log"), TAILSTACK_DATABASE=url, TAILSTACK_LEASE_SECONDS="1") as running:
        yield running


@pytest.fixture
def client(service: Served) -> Iterator[httpx.Client]:
    with client_of(service.url) as connected:
        until(lambda: ready(connected)[0] == 200)
        yield connected


def count(client: httpx.Client) -> int:
    return len(client.get("/v1/jobs").json()["jobs"])


def accept(client: httpx.Client) -> str:
    accepted = client.post("/v1/verifications", json=BODY)
    assert accepted.status_code == 202, accepted.text
    return accepted.headers["location"]


def refuse(client: httpx.Client, path: Path) -> None:
    """Nothing is accepted, in words that do not name the host's files, and readiness says so."""
    response = client.post("/v1/verifications", json=BODY)
    assert (response.status_code, response.json()["type"]) == (503, "/v1/problems/store-error"), response.text
    assert int(response.headers["retry-after"]) > 0
    assert str(path.parent) not in response.text
    until(lambda: ready(client)[0] == 503)
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
        refuse(client, path)
        assert client.get(job).status_code == 503
        # Who is started while it is away does not make a new one in its place
        worker = next(iter(workers_of(client)))
        looked = service.log.read_text().count("waiting for the database")
        worker.kill()
        until(lambda: service.log.read_text().count("waiting for the database") > looked + 1)
        assert worker.pid not in [child.pid for child in workers_of(client)]
        assert not path.exists()
    until(lambda: ready(client)[0] == 200)
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


@pytest.mark.parametrize("lost", ["jobs.sqlite3", "jobs.sqlite3-wal"])
def test_nothing_is_written_beside_a_file_in_the_place_of_another_nor_without_its_log(
    client: httpx.Client, disk: Path, lost: str
) -> None:
    path, before = disk / "jobs.sqlite3", count(client)
    accept(client)
    with without(disk / lost):
        if lost == path.name:
            shutil.copy(path.with_name(path.name + ".kept"), path)
        refuse(client, path)
    until(lambda: ready(client)[0] == 200)
    assert count(client) == before + 1


def test_no_connection_is_opened_beside_another_log_and_used_once_the_log_is_back(file: Path) -> None:
    db = open_database(url_at(file))
    with writing(db) as connection:
        connection.exec_driver_sql("CREATE TABLE kept (x)")
    with reading(db) as connection:  # the log is copied into the file, and none of it is needed for reading any more
        connection.exec_driver_sql("COMMIT")
        connection.exec_driver_sql("PRAGMA wal_checkpoint(FULL)")
        connection.exec_driver_sql("BEGIN")
        with without(file.with_name(file.name + "-wal")), pytest.raises(StoreError, match="is another file"):
            count_kept(db)  # the connection of the pool is in use: this one opens another
        assert count_kept(db) == 0
    with writing(db) as connection:
        connection.exec_driver_sql("INSERT INTO kept VALUES (1)")
    assert count_kept(db) == 1
    db.close()
    with closing(sqlite3.connect(file)) as checked:
        assert checked.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def test_a_log_that_went_with_the_last_connection_is_made_anew(file: Path) -> None:
    db, log = open_database(url_at(file)), file.with_name(file.name + "-wal")
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
        until(lambda: ready(client)[0] == 503)
        assert client.get("/health/ready").json()["status"] == "no database"
        assert client.get("/v1/jobs").status_code == 200  # what is there can be read
    finally:
        filler.unlink()
    until(lambda: ready(client)[0] == 200)
    accept(client)


# --- files that are only read ---------------------------------------------------------------------


def url_at(path: Path) -> str:
    return f"sqlite:///{path}"


@pytest.fixture
def file(tmp_path: Path, migrated_file: Path) -> Path:
    """A database that nobody has open, in a folder of its own."""
    (tmp_path / "kept").mkdir()
    path = Path(shutil.copy(migrated_file, tmp_path / "kept" / "jobs.sqlite3"))
    with closing(open_database(url_at(path))) as db:
        create_key(db, tenant="acme", name="ci", scopes=("read",), days=30)
    return path


@pytest.mark.parametrize("arguments", [["db", "check"], ["keys", "list"], ["keys", "log"]])
@pytest.mark.parametrize("backup", [False, True])
def test_nothing_is_changed(file: Path, arguments: list[str], backup: bool, tmp_path: Path) -> None:
    if backup:  # which has another journal mode
        (tmp_path / "copies").mkdir()
        with closing(sqlite3.connect(file)) as connection:
            connection.execute(f"VACUUM INTO '{tmp_path / 'copies' / 'b'}'")
        file = tmp_path / "copies" / "b"
    before, status = file.read_bytes(), file.stat()
    assert main([*arguments, "--database", url_at(file)]) == 0
    assert file.read_bytes() == before
    assert file.stat().st_mtime_ns == status.st_mtime_ns
    assert [entry.name for entry in file.parent.iterdir()] == [file.name]


def test_what_a_running_service_has_written_is_seen(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with closing(open_database(url_at(file))) as db:
        create_key(db, tenant="later", name="n", scopes=("read",), days=30)  # is in the log as yet
        assert Path(f"{file}-wal").stat().st_size
        assert find_reading_mode(file) == "mode=ro"
        assert main(["keys", "list", "--database", url_at(file)]) == 0
        assert "later" in capsys.readouterr().out
        assert main(["db", "check", "--database", url_at(file)]) == 0
        create_key(db, tenant="last", name="n", scopes=("read",), days=30)


def test_nothing_can_be_written_through_it(file: Path) -> None:
    for db in (connect(url_at(file), read_only=True), open_database(url_at(file), read_only=True)):
        with closing(db), pytest.raises(StoreError):
            create_key(db, tenant="acme", name="n", scopes=("read",), days=30)


def test_a_copy_on_a_disk_that_cannot_be_written(file: Path) -> None:
    """As root may write everywhere, the folder is mounted read-only for a user of no name."""
    mounted = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && exec "$@"'
    folder = str(file.parent)
    command = contain(*COMMAND, "db", "check", "--database", url_at(file))
    done = run_process("unshare", "--mount", "sh", "-c", mounted, folder, *command, env=surroundings(), cwd="/")
    assert done.returncode == 0, done.stderr
    assert "sound" in done.stdout


def test_a_log_that_cannot_be_read_is_no_reason_to_try_again(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "copy").mkdir()
    copy = tmp_path / "copy" / file.name
    with closing(open_database(url_at(file))) as db:
        create_key(db, tenant="later", name="n", scopes=("read",), days=30)
        for ending in ("", "-wal"):  # of a killed service
            shutil.copy(f"{file}{ending}", f"{copy}{ending}")
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert main(["db", "check", "--database", url_at(copy)]) == 3
    said = capsys.readouterr().err
    assert f"{copy}-wal holds what is not in the file yet" in said
    assert "copy both to a folder that can be written" in said
    assert "again in a moment" not in said


def test_a_file_that_this_user_may_not_open_is_no_reason_to_try_again(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cause = sqlite3.OperationalError("unable to open database file")
    cause.sqlite_errorcode = sqlite3.SQLITE_CANTOPEN
    error = OperationalError("BEGIN", None, cause)
    with closing(connect(url_at(file))) as db:
        assert _find_closed(db, error) is None, "of root: it may come back"
        monkeypatch.setattr(os, "access", lambda *_: False)
        assert _find_closed(db, error) == file.parent
        with pytest.raises(StoreError, match="must be allowed to write"), reading(db):
            raise error


def test_of_postgresql_nothing_is_written_either(postgres_url: str) -> None:
    migrate_database(postgres_url)
    with closing(connect(postgres_url, read_only=True)) as db, reading(db) as connection:
        assert connection.exec_driver_sql("SHOW transaction_read_only").scalar_one() == "on"


# --- a server that stands still -------------------------------------------------------------------


@pytest.mark.long
def test_a_transaction_gives_a_silent_server_up_and_the_next_one_works(
    postgres_server: Server, postgres_url: str
) -> None:
    with prepared_database(postgres_url) as db:
        job = submit(db)
        for _ in range(2):  # with a connection of the pool, and without one
            with postgres_server.frozen():
                with pytest.raises(StoreUnavailable, match="did not answer within 1 s"):
                    submit(db.within(1.0))
                ending, asked = db.endable(), threading.Event()

                def ask(ending: Database, asked: threading.Event) -> object:
                    asked.set()
                    return jobs.find_job(ending, "acme", job.id)

                with ThreadPoolExecutor(1) as pool:
                    waiting = pool.submit(ask, ending, asked)
                    assert asked.wait(LIMIT_SECONDS)
                    ending.end_within(0.3)
                    with pytest.raises(StoreUnavailable):
                        waiting.result(LIMIT_SECONDS)
            assert jobs.find_job(db, "acme", job.id) == job


def ready(client: httpx.Client) -> tuple[int, str]:
    answer = client.get("/health/ready")
    return answer.status_code, answer.json()["status"]


@pytest.mark.long
def test_readiness_waits_for_nobody_who_waits(
    postgres_server: Server, postgres_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those who read wait for as long as the server stands still, in every thread that there is for them; what needs no
    database is answered, and to look again and again leaves nothing open."""
    migrate_database(postgres_url)
    monkeypatch.setattr(database, "CONNECTING_SECONDS", LIMIT_SECONDS)
    monkeypatch.setattr(http_service, "LOOK_SECONDS", 0.3)
    listing: list[bool] = []
    list_page = jobs.list_page

    def listed(*arguments: Any, **named: Any) -> Any:
        listing.append(True)
        return list_page(*arguments, **named)

    monkeypatch.setattr(jobs, "list_page", listed)
    with client_with(Settings(database=postgres_url)) as client, ThreadPoolExecutor(16) as pool:
        assert ready(client)[0] == 200
        with postgres_server.frozen():
            waiting = [pool.submit(client.get, "/v1/jobs") for _ in range(2 * http_service.THREADS)]
            until(lambda: len(listing) == http_service.THREADS, lambda: listing)
            assert ready(client) == (503, "no database")
            threads, files = threading.active_count(), psutil.Process().num_fds()
            for _ in range(3):
                assert ready(client) == (503, "no database")
            assert threading.active_count() <= threads
            assert psutil.Process().num_fds() <= files + 2
            assert client.get("/health/live").status_code == 200
            assert client.post("/v1/scores", json={"design": small_design()}).status_code == 200
            assert not any(each.done() for each in waiting)
        assert [each.result(LIMIT_SECONDS).status_code for each in waiting] == [200] * len(waiting)
        until(lambda: ready(client)[0] == 200)


@pytest.mark.long
def test_a_worker_stops_while_its_database_stands_still(
    postgres_server: Server, postgres_url: str, tmp_path: Path
) -> None:
    with prepared_database(postgres_url) as db, worker_process(postgres_url, tmp_path / "log") as worker:
        submit_strange(db, strange_units.request("wait"))
        until(lambda: "begun" in (tmp_path / "log").read_text())
        with postgres_server.frozen():
            until(lambda: "leases are not prolonged" in (tmp_path / "log").read_text())
            worker.send_signal(signal.SIGTERM)
            assert worker.wait(LIMIT_SECONDS) == 0  # while it stands still


async def test_calls_that_cannot_be_ended_are_not_waited_for_and_do_not_pile_up(file: Path) -> None:
    """As on a disk that hangs: the thread stays where it is until the disk answers."""
    answers, begun, clock = threading.Event(), list[int](), TurnedClock()

    def hang(_: object, number: int = -1) -> int:
        begun.append(number)
        answers.wait(LIMIT_SECONDS)
        return number

    kept = http_service.Storage(url_at(file), clock)
    kept.database()
    before = threading.active_count()
    looks = [kept.look(hang) for _ in range(5)]
    calls = [kept.run(hang, number) for number in range(40)] + [kept.write(hang, number) for number in range(40)]
    waiting = [asyncio.ensure_future(each) for each in (*looks, *calls)]
    await until_async(lambda: len(begun) == 2 * http_service.THREADS + 1, lambda: begun)
    clock.turn(2 * LIMIT_SECONDS)
    told = await asyncio.gather(*waiting, return_exceptions=True)
    assert {type(each) for each in told} == {StoreUnavailable}
    assert threading.active_count() - before <= 2 * http_service.THREADS + 1
    assert len(begun) == 2 * http_service.THREADS + 1  # what nobody waits for any more is not begun
    answers.set()
    assert await kept.look(hang) == -1
    assert await kept.run(hang, 7) == 7
    kept.close()


# --- stored bytes that were changed behind the service's back -------------------------------------


FORGED = b'{"schema":"tailstack/verification/1","p95_mm":0.0}'


def change(db: Database, statement: str, value: bytes) -> None:
    with writing(db) as connection:
        mark = "?" if db.dialect == "sqlite" else "%s"
        assert connection.exec_driver_sql(statement.replace("?", mark), (value,)).rowcount == 1


def finished_job(db: Database, answer: bytes = b'{"answer":1}', **changes: Any) -> jobs.Job:
    made = split(db, 1, **changes)
    finish(db, answer)
    assert find(db, made).state == "succeeded"
    return find(db, made)


def test_a_changed_result_is_answered_with_503_until_it_is_computed_anew(
    store: Database, caplog: pytest.LogCaptureFixture
) -> None:
    with client_with(Settings(database=url_of(store))) as client:
        job = accept(client)
        finish(store)
        result = client.get(job).json()["links"]["result"]
        tag = {"If-None-Match": client.get(result).headers["etag"]}
        assert client.get(result, headers=tag).status_code == 304
        change(store, "UPDATE results SET body = ?", FORGED)
        for _ in range(2):  # and it stays so
            for address, headers in ((result, {}), (result, tag), (f"{result}/report", {}), (f"{job}/result", {})):
                refused = client.get(address, headers=headers, follow_redirects=True)
                assert (refused.status_code, refused.json()["type"]) == (503, "/v1/problems/store-error"), address
                assert "immutable" not in refused.headers.get("cache-control", "")
        assert client.get(job).json()["state"] == "succeeded"
        assert any(record.__dict__.get("action") == "damaged" for record in caplog.records)
        accept(client)
        finish(store)
        assert client.get(result, headers=tag).status_code == 304


def test_a_changed_answer_is_refused_whoever_came_to_it_until_it_is_computed_again(store: Database) -> None:
    mine, theirs = finished_job(store), finished_job(store, tenant="other")
    apart = finished_job(store, b'{"answer":2}')
    name = str(mine.result_sha256)
    change(store, "UPDATE results SET body = ? WHERE sha256 = '" + name + "'", FORGED)
    (wrong,) = [check for check in upkeep.check_database(store) if not check.ok]
    assert name in wrong.detail
    for tenant in ("acme", "other"):
        with pytest.raises(DamagedStore, match=name):
            results.read_result(store, tenant, name)
    assert results.read_result(store, "stranger", name) is None
    assert results.read_result(store, "acme", str(apart.result_sha256)) is not None
    healed = finished_job(store)
    for tenant in ("acme", "other"):
        kept = results.read_result(store, tenant, name)
        assert (healed.result_sha256, kept.body) == (name, b'{"answer":1}')
    assert all(check.ok for check in upkeep.check_database(store))
    assert find(store, theirs).state == "succeeded"


def test_an_answer_that_is_gone_is_told_apart_from_one_that_never_was(file: Path) -> None:
    with closing(open_database(url_at(file))) as db:
        job = finished_job(db)
        with closing(sqlite3.connect(file)) as other, other:  # which knows of no foreign keys
            other.execute("DELETE FROM results")
        with pytest.raises(DamagedStore):
            results.read_result(db, "acme", str(job.result_sha256))
        assert results.read_result(db, "stranger", str(job.result_sha256)) is None


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("UPDATE units SET result = ? WHERE number = 1 AND job_id = '{job}'", "damaged-part"),
        ("UPDATE requests SET body = ? WHERE job_id = '{job}'", "damaged-request"),
    ],
)
def test_nothing_is_computed_from_changed_requests_or_parts(
    store: Database, clock: Clock, statement: str, code: str
) -> None:
    job = split(store, 2, idempotency_key="k")
    for held in claim(store, limit=2):
        assert record(store, held, result=b"result of " + held.spec)
    clock.advance(1)
    sound = submit(store, request=b'{"design":{"of":"another"}}')
    change(store, statement.format(job=job.id), FORGED)
    wrong = [check.name for check in upkeep.check_database(store) if not check.ok]
    assert len(wrong) == 1
    assert "hash" in wrong[0]
    assert claim(store) == []  # the job that came first fails
    assert claim_one(store).job_id == sound.id
    failed = find(store, job)
    assert failed.state == "failed"
    assert failed.problem["errors"][0]["code"] == code
    assert submit(store, idempotency_key="k").id != job.id
