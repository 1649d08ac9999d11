"""``tailstack worker`` as a process: signals, kills, freezes, its parent's end, a database that restarts."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from postgres import Server
from store_scenes import find, submit
from strange_units import FUNCTION, request
from worker_scenes import PROGRAM, TENANT, VERSION, prepared_database, started, worker_process

import family
from family import forked_of
from tailstack_service.jobs.store import jobs, workers
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.worker import PURGE_SECONDS, HourlyPurge
from tailstack_service.processes.birth import make_command, make_environment
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS, until

COMMAND = make_command("tailstack_service.cli.main", "worker")


def at_work(db: Database) -> bool:
    return len(workers.list_workers(db)) == 1


@pytest.mark.long(but=["sqlite-15-0"])
@pytest.mark.parametrize(("sign", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_a_stop_is_clean_and_leaves_no_process(
    database_url: str, tmp_path: Path, sign: signal.Signals, code: int
) -> None:
    log = tmp_path / "log"
    with (
        prepared_database(database_url) as db,
        started([*COMMAND, "--processes", "3"], database_url, log, {}) as worker,
    ):
        until(lambda: at_work(db))
        until(lambda: len(forked_of(worker.pid)) == 3)
        beside = forked_of(worker.pid)
        worker.send_signal(sign)
        assert worker.wait(LIMIT_SECONDS) == code
        assert workers.list_workers(db) == []
        assert psutil.wait_procs(beside, timeout=LIMIT_SECONDS)[1] == []
    told = log.read_text()
    assert f"{socket.gethostname()}-{worker.pid}-" in told
    assert ": 3 processes on " in told
    password = urlsplit(database_url).password
    assert password is None or password not in told
    assert "Traceback" not in told


PATIENT = """
from tailstack_service.jobs import worker
worker.STOPPING_SECONDS = 3600.0  # for the database to take units back: a stop that waits for it waits for ever
worker.SAME_STOP_SECONDS = 0.0  # a signal more is another stop, however soon it comes
"""


@pytest.mark.long
def test_a_second_signal_ends_it_at_once(tmp_path: Path) -> None:
    """The first cannot be acted on: another process holds the only write lock of the file."""
    url = f"sqlite:///{tmp_path / 'held.sqlite3'}"
    told = {"FUNCTION": FUNCTION, "VERSION": VERSION, "TAILSTACK_WORKER_PROCESSES": "2"}
    with (
        prepared_database(url) as db,
        started([sys.executable, "-c", PATIENT + PROGRAM], url, tmp_path / "log", told) as worker,
    ):
        submit(db, request("burn"))
        until(lambda: at_work(db))
        until(lambda: len(forked_of(worker.pid)) == 2)
        beside = forked_of(worker.pid)
        raw = db.engine.raw_connection()
        try:
            raw.cursor().execute("BEGIN IMMEDIATE")

            def gone_after_another_signal() -> bool:
                worker.terminate()
                return worker.poll() is not None

            until(gone_after_another_signal)
            assert worker.returncode == 128 + signal.SIGTERM
        finally:
            raw.cursor().execute("ROLLBACK")
            raw.close()
        assert psutil.wait_procs(beside, timeout=LIMIT_SECONDS)[1] == []


@pytest.mark.long
def test_a_database_that_is_not_up_yet_is_waited_for(
    postgres_server: Server, postgres_url: str, tmp_path: Path
) -> None:
    with prepared_database(postgres_url) as db:
        postgres_server.stop()
        try:
            with started(COMMAND, postgres_url, tmp_path / "log", {}) as worker:
                until(lambda: "waiting for the database" in (tmp_path / "log").read_text())
                postgres_server.start()
                until(lambda: at_work(db))
                worker.terminate()
                assert worker.wait(LIMIT_SECONDS) == 0
        finally:
            if not postgres_server.running:
                postgres_server.start()


def test_a_database_without_tables_is_refused(postgres_url: str, tmp_path: Path) -> None:
    with started(COMMAND, postgres_url, tmp_path / "log", {}) as worker:
        assert worker.wait(LIMIT_SECONDS) == 3
    assert "tailstack db migrate" in (tmp_path / "log").read_text()


def test_the_health_check_sees_a_worker_of_this_host(
    database_url: str, tmp_path: Path, call: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TAILSTACK_DATABASE", database_url)
    with prepared_database(database_url) as db:
        assert call("worker", "--check")[:2] == (3, "no worker of this host is alive\n")
        workers.report_alive(db, "elsewhere", "another-host", 1, "1.0", "pool", 2)
        assert call("worker", "--check")[0] == 3
        with worker_process(database_url, tmp_path / "log") as worker:
            until(lambda: len(workers.list_workers(db)) == 2)
            code, said, _ = call("worker", "--check")
            assert code == 0
            assert f"-{worker.pid}-" in said


PARENT = """
import threading
from tailstack_service.settings import load_settings
from tailstack_service.jobs.worker import start_worker_process
child = start_worker_process(load_settings())
print(child.pid, flush=True)
threading.Event().wait()
"""


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM])
def test_a_worker_ends_with_the_process_that_started_it(tmp_path: Path, sign: signal.Signals) -> None:
    url = f"sqlite:///{tmp_path / 'x.sqlite3'}"
    told = {**make_environment(), "TAILSTACK_DATABASE": url, "TAILSTACK_WORKER_PROCESSES": "1"}
    with (
        prepared_database(url) as db,
        family.started(sys.executable, "-c", PARENT, stderr=subprocess.DEVNULL, env=told) as parent,
    ):
        assert parent.stdout is not None
        worker = psutil.Process(int(parent.stdout.readline()))
        until(lambda: at_work(db))
        # The worker, a computing process of its, and what that was forked from
        until(lambda: len(psutil.Process(parent.pid).children(recursive=True)) == 3)
        members = psutil.Process(parent.pid).children(recursive=True)
        assert worker in members
        os.kill(worker.pid, signal.SIGINT)  # a Ctrl-C in the terminal is for the parent to act on
        after = submit(db, b"{}")
        until(lambda: find(db, after).state != "queued")  # it still takes what there is to do
        assert worker.is_running()
        parent.send_signal(sign)
        assert psutil.wait_procs(members, timeout=LIMIT_SECONDS)[1] == []
        assert workers.list_workers(db) == []  # it had time to give back what it had


def test_old_jobs_are_deleted_in_the_background(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url, clock = f"sqlite:///{tmp_path / 'x.sqlite3'}", TurnedClock()
    monkeypatch.setattr("random.random", lambda: 1.0)
    with prepared_database(url, clock) as db:
        submitted = submit(db, request())
        jobs.cancel_job(db, TENANT, submitted.id)
        kept = submit(db, request())
        with closing(HourlyPurge(db, 1.0, 365.0, clock=clock)):
            clock.until_waits(PURGE_SECONDS)
            clock.turn(PURGE_SECONDS)  # the first time within the first hour, and the job is kept for a day
            clock.until_waits(PURGE_SECONDS)
            assert jobs.find_job(db, TENANT, submitted.id) is not None
            clock.turn(86_400.0)
            until(lambda: jobs.find_job(db, TENANT, submitted.id) is None)
        assert jobs.find_job(db, TENANT, kept.id) is not None
