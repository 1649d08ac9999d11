"""Workers of the tests: in a thread of this process, or as processes; and the short ways to give them jobs."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import strange_units
from store_scenes import VERSION, find
from store_scenes import submit as submit  # for who has another ``submit`` as well

import family
from tailstack_service.clock import SYSTEM_CLOCK, Clock
from tailstack_service.jobs.engines.pool import PoolEngine
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.jobs.worker import Worker
from tailstack_service.processes.birth import make_environment
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

TENANT = "acme"
QUICK: dict[str, Any] = {"lease_seconds": 600.0, "poll_seconds": 0.01, "worker_processes": 2}

PROGRAM = """
import logging
import os
from tailstack_service.logs import log_to_stderr
from tailstack_service.settings import load_settings
from tailstack_service.jobs.worker import run_worker
log_to_stderr(level=logging.DEBUG)
run_worker(load_settings(), function=os.environ["FUNCTION"], solver_version=os.environ["VERSION"])
"""


def finished(db: Database, submitted: Job) -> Job:
    """The job once it has ended."""
    until(lambda: find(db, submitted).is_over, lambda: find(db, submitted))
    return find(db, submitted)


@contextmanager
def prepared_database(url: str, clock: Clock = SYSTEM_CLOCK) -> Iterator[Database]:
    """The database with its tables, as an operator makes it."""
    migrate_database(url)
    with closing(open_database(url, clock=clock)) as db:
        yield db


@contextmanager
def working(
    db: Database, *, solver_version: str | None = VERSION, expected: type[Exception] | None = None, **changes: Any
) -> Iterator[tuple[Worker, PoolEngine]]:  # fmt: skip
    """A worker in a thread of this process; ``expected`` is what its ``run`` has to raise in the end.

    It goes by the clock of the database.
    """
    settings = Settings(**(QUICK | changes))
    engine = PoolEngine(settings.worker_processes, function=strange_units.FUNCTION, clock=db.clock)
    worker = Worker(db, engine, settings, solver_version=solver_version, clock=db.clock)
    raised: list[BaseException] = []

    def run() -> None:
        try:
            worker.run()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield worker, engine
    finally:
        worker.stop()
        thread.join(LIMIT_SECONDS)
        assert not thread.is_alive()
        if raised and type(raised[0]) is not expected:  # also where the test waited for what it ended before
            raise raised[0]
    assert bool(raised) == (expected is not None)


@contextmanager
def worker_process(url: str, log: Path) -> Iterator[subprocess.Popen[str]]:
    """A worker as a process of its own, with the strange units; ``log`` gets its stderr."""
    told = {"TAILSTACK_LEASE_SECONDS": "1", "TAILSTACK_POLL_SECONDS": "0.01", "TAILSTACK_WORKER_PROCESSES": "2"}
    told |= {"FUNCTION": strange_units.FUNCTION, "VERSION": VERSION}
    with started([sys.executable, "-c", PROGRAM], url, log, told) as process:
        yield process


@contextmanager
def started(command: list[str], url: str, log: Path, told: Mapping[str, str]) -> Iterator[subprocess.Popen[str]]:
    """A process with these variables; whatever happens, nothing of it is left."""
    kept = {name: value for name, value in make_environment().items() if not name.startswith("TAILSTACK_")}
    own = {**kept, "TAILSTACK_DATABASE": url, **told}
    with (
        log.open("ab") as errors,
        family.started(*command, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, env=own) as process,
    ):
        yield process
