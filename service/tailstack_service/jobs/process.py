"""The worker as a process: its signals, its start, its end with the process that started it; and its hourly purge."""

from __future__ import annotations

import logging
import os
import random
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing, suppress
from dataclasses import asdict
from types import FrameType
from typing import IO, Any

from tailstack.errors import TailstackError

from ..clock import SYSTEM_CLOCK, Clock
from ..problems import StoreError, StoreUnavailable
from ..processes.birth import make_command, make_environment, share_nursery
from ..processes.task import PERFORM
from ..settings import Settings, child_environment
from .engines.engine import start_engine
from .store.database import Database, now, parse_url, reading
from .store.schema import open_database
from .store.upkeep import purge
from .store.workers import WorkerEntry, list_workers
from .worker import Worker

log = logging.getLogger("tailstack.worker")

SAME_STOP_SECONDS = 1.0  # a stop of a whole group of processes arrives more than once
ENDING_SECONDS = 10.0  # for a worker whose parent has gone
HEARING_SECONDS = 0.2  # at most, until a signal is acted on
CONNECTING_SECONDS = 3.0  # for a database to answer
AGAIN_SECONDS = 0.5  # between attempts to reach one that is not up yet
SILENCE_SECONDS = 10.0  # at least, after which a worker counts as dead; with longer leases, workers speak less often
PURGE_SECONDS = 3600.0  # between two purges
PURGE_ENDING_SECONDS = 1.0


def run_worker(
    settings: Settings, *, with_parent: bool = False, function: str = PERFORM, solver_version: str | None = None,
    clock: Clock = SYSTEM_CLOCK,
) -> int:  # fmt: skip
    """Work until SIGTERM or SIGINT; the number of the signal that ended it, 0 if the parent's end did.

    A second signal ends the process at once.  ``with_parent``: end when stdin ends, and leave Ctrl-C to the parent.
    Raises StoreError (the database cannot be used), RequestError (the engine cannot be had).  For the main thread.
    """
    stop = _Stop(with_parent, clock)
    with stop, closing(_await_database(settings, stop, with_parent=with_parent, clock=clock)) as db:
        if stop.requested:
            return stop.signal
        engine = start_engine(settings, function=function, clock=clock)
        worker = Worker(db, engine, settings, solver_version=solver_version, clock=clock)
        stop.call(worker.stop)
        url = parse_url(settings.database_url)
        where = url.set(drivername=url.get_backend_name()).render_as_string(hide_password=True)
        means = f"{settings.worker_processes} processes" if engine.name == "pool" else settings.dask_scheduler
        print(f"worker {worker.id}: {means} on {where}", file=sys.stderr, flush=True)
        purge_thread = HourlyPurge(db, settings.keep_days, settings.audit_days, clock=clock)
        # Not in this thread: it would not hear a signal while it waits inside a driver of the database
        with closing(purge_thread), ThreadPoolExecutor(1, "tailstack-worker") as thread:
            work = thread.submit(worker.run)
            # A signal that comes just before a wait without end would not be acted on before that end
            while not wait([work], timeout=HEARING_SECONDS).done:
                pass
            work.result()
    return stop.signal


def start_worker_process(settings: Settings, log: IO[bytes] | None = None) -> subprocess.Popen[bytes]:
    """``tailstack worker`` with these settings, as a child that ends when this process ends, whatever ends it.

    It notices by its stdin, which this process holds open: keep the Popen, and close ``stdin`` or send SIGTERM to
    stop the worker.  Its log lines go to ``log``, by default to this process's stderr.  Its computing processes are
    forked from the nursery of this process.
    """
    nursery = share_nursery()
    shared = () if nursery is None else ("--nursery", str(nursery))
    return subprocess.Popen(
        make_command("tailstack_service.cli.main", "worker", "--with-parent", *shared),
        pass_fds=() if nursery is None else (nursery.wishes.fileno(),),
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=log,
        env=child_environment(settings, make_environment()),
    )


def _await_database(settings: Settings, stop: _Stop, *, with_parent: bool, clock: Clock) -> Database:
    """The database, as soon as it answers.

    The worker of a service makes none: the service has, and where its file was deleted a new one would be in the way.
    """
    while True:
        try:
            return open_database(
                settings.database_url, migrate=not with_parent, seconds=CONNECTING_SECONDS, clock=clock
            )
        except (StoreUnavailable, StoreError) as error:
            if stop.requested or (isinstance(error, StoreError) and not with_parent):
                raise
            print(f"worker: waiting for the database: {error.problems[0].detail}", file=sys.stderr, flush=True)
            clock.sleep(AGAIN_SECONDS)


class _Stop:
    """Signals, and the end of the parent, as one event."""

    def __init__(self, with_parent: bool, clock: Clock) -> None:
        self.requested = False  # an Event could be locked by the very thread that a signal interrupts
        self.signal = 0
        self._at = 0.0
        self._then: Callable[[], None] = lambda: None
        self._with_parent, self._clock = with_parent, clock
        self._previous: dict[signal.Signals, Any] = {}

    def call(self, then: Callable[[], None]) -> None:
        """Call ``then`` with the stop, at once if that was before."""
        self._then = then
        if self.requested:
            then()

    def __enter__(self) -> _Stop:
        for number in (signal.SIGTERM, signal.SIGINT):
            ignored = self._with_parent and number == signal.SIGINT
            self._previous[number] = signal.signal(number, signal.SIG_IGN if ignored else self._on_signal)
        if self._with_parent:
            threading.Thread(target=self._await_parent, name="tailstack-parent", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if not self.requested:
            self.signal, self._at = number, self._clock.monotonic()
            self._request()
        elif self._clock.monotonic() - self._at > SAME_STOP_SECONDS:
            os._exit(128 + number)  # computing processes end with this one, leases run out

    def _await_parent(self) -> None:
        with suppress(OSError):
            while os.read(0, 4096):
                pass
        self._request()
        self._clock.sleep(ENDING_SECONDS)
        os._exit(1)

    def _request(self) -> None:
        self.requested = True
        self._then()


def find_live_worker(settings: Settings) -> WorkerEntry | None:
    """The worker of this host that spoke last, if that was recently.  Raises StoreError, StoreUnavailable."""
    db = open_database(settings.database_url, read_only=True)
    try:
        with reading(db) as connection:
            at = now(db, connection)
        silence = max(SILENCE_SECONDS, settings.lease_seconds)
        here = [worker for worker in list_workers(db) if worker.host == socket.gethostname()]
        return max((w for w in here if w.seen_at > at - silence), key=lambda w: w.seen_at, default=None)
    finally:
        db.close()


class HourlyPurge:
    """A thread that deletes what is old once an hour, the first time within the first hour.

    It is a thread of its own, for deleting may take longer than a lease.
    """

    def __init__(self, db: Database, keep_days: float, audit_days: float, *, clock: Clock = SYSTEM_CLOCK) -> None:
        self._clock = clock
        self._db, self._keep_days, self._audit_days = db.endable(), keep_days, audit_days
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tailstack-purge", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait for what is being deleted, which happens a few hundred rows at a time."""
        self._ending.set()
        self._db.end_within(PURGE_ENDING_SECONDS)
        self._thread.join(timeout=2 * PURGE_ENDING_SECONDS)

    def _run(self) -> None:
        # Several workers that were started together need not purge at the same moment
        pause = PURGE_SECONDS * random.random()
        while not self._clock.wait(self._ending, pause):
            pause = PURGE_SECONDS
            try:
                counts = asdict(purge(self._db, self._keep_days, self._audit_days))
            except TailstackError as error:
                log.warning("nothing old was deleted: %s", error, extra={"action": "purge-failed"})
            except Exception:  # the next hour is another attempt, and jobs go on meanwhile
                log.exception("nothing old was deleted, because of a defect", extra={"action": "purge-failed"})
            else:
                words = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
                level = logging.INFO if any(counts.values()) else logging.DEBUG
                log.log(level, "deleted what is old: %s", words, extra={"action": "purged"})
