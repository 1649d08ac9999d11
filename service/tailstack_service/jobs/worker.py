"""The worker: it claims units, has them computed and records what they came to, until it is told to stop.

The database decides what counts.  A unit that this worker lost while it was frozen, or while the database was away,
is computed in vain: its record is refused.  So nothing here has to be certain, only quick.

And the worker as a process of its own, which once an hour deletes what is old.
"""

from __future__ import annotations

import logging
import math
import os
import random
import secrets
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from queue import Empty, SimpleQueue
from types import FrameType
from typing import IO, Any

from tailstack.errors import LimitError, Problem, SourcesChangedError, TailstackError

from ..clock import SYSTEM_CLOCK, Clock
from ..problems import StoreError, StoreUnavailable, TransportError
from ..processes.birth import make_command, make_environment, running_code, share_nursery
from ..processes.task import PERFORM, Died, GivenBack, Outcome, OutOfDate, Task
from ..settings import Settings, child_environment
from .engines.engine import Engine, start_engine
from .store import queue, workers
from .store.database import Database, now, parse_url, reading
from .store.events import render_problem
from .store.queue import Claim
from .store.schema import open_database
from .store.upkeep import purge
from .store.workers import WorkerEntry, list_workers

log = logging.getLogger("tailstack.worker")

BEATS_PER_LEASE = 3
RETRY_SECONDS = 0.25  # while the database does not answer; never longer than between two beats
LEAST_SECONDS = 2.0  # for the database to answer a beat; with long leases it has the time until the next
# Units are taken ahead only as far as they are short: one that waits here could be computed by another worker.
AHEAD_SECONDS = 0.1  # of computing, for each place of the engine
AHEAD_UNITS = 3  # at most, for each place of the engine: the next ones may be long
FIRST_PAUSE, LONGEST_PAUSE = 0.05, 2.0  # s, between attempts while the database does not answer
TRANSACTION_SECONDS = 30.0  # claims and records may be large; nobody waits for an answer
STOPPING_SECONDS = 3.0  # for the database to take units back; otherwise their leases run out
FIRST_REST, LONGEST_REST = 0.2, 10.0  # s, without new claims after the engine gave units back


@dataclass(frozen=True, slots=True, eq=False)
class Computation:
    """A claimed unit while the engine computes it."""

    claim: Claim
    future: Future[Outcome]


@dataclass(frozen=True, slots=True)
class Ending:
    """What a claim came to, to be written."""

    claim: Claim
    action: str  # for the log, and what happened to the unit in words
    words: str
    outcome: Outcome | None = None  # None: it is given back
    died: bool = False  # a process died of it
    why: str = ""


def log_unit(level: int, action: str, claim: Claim, words: str, **fields: Any) -> None:
    """Log ``unit 3 of job 01j...`` and what happens to it."""
    fields |= {"action": action, "job": claim.job_id, "unit": claim.index, "request": claim.request_id}
    log.log(level, "unit %d of job %s %s", claim.index, claim.job_id, words, extra=fields)


def report_defect(claim: Claim, error: BaseException) -> Outcome:
    """The outcome of a unit that raised what is not a refusal, with its traceback in the log."""
    log_unit(logging.ERROR, "defect", claim, f"met a defect of the service\n{error}")
    hint = "report it with the job's id: the log of the worker holds the cause under it"
    refusal = TransportError("internal-error", "the job met a defect of the service", hint)
    return Outcome(problem=render_problem(refusal))


class Heartbeat:
    """Calls ``beat`` three times in the time of a lease, in a thread of its own, from ``begin`` to ``end``.

    A beat neither computes nor records, so that nothing which takes long stands between two of them.  ``on_failure`` is
    called with a defect of a beat: the worker must not go on without it.
    """

    def __init__(
        self, db: Database, worker_id: str, lease_seconds: float, beat: Callable[[Database], None],
        on_failure: Callable[[BaseException], None], clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self._clock = clock
        self._worker_id, self._beat, self._on_failure = worker_id, beat, on_failure
        self._lease_seconds, self._pause_seconds = lease_seconds, lease_seconds / BEATS_PER_LEASE
        self._gap_seconds = max(1.5 * self._pause_seconds, LEAST_SECONDS)  # at most, while the database answers
        self._db = db.within(max(self._pause_seconds, LEAST_SECONDS))
        self._heard_at = self._steady_since = -math.inf  # monotonic: the last beat, and the first without a gap
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tailstack-heartbeat", daemon=True)

    def begin(self) -> None:
        """Raises StoreUnavailable, StoreError."""
        self._beat(self._db)
        self._heard_at = self._clock.monotonic()
        self._thread.start()

    def is_steady(self) -> bool:
        """Whether the database has answered beat after beat for as long as a lease.

        While it stands still nobody can prolong a lease.  When it wakes they have all run out, and those who hold them
        are about to prolong them: whoever took them over now would compute a second time what is being computed.
        """
        now = self._clock.monotonic()
        return now - self._heard_at <= self._gap_seconds and now - self._steady_since >= self._lease_seconds

    def end(self) -> None:
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        pause, answers = self._pause_seconds, True
        try:
            while not self._clock.wait(self._ending, pause):
                try:
                    self._beat(self._db)
                except (StoreUnavailable, StoreError) as error:
                    if answers:
                        words = "leases are not prolonged until the database answers: %s"
                        log.warning(words, error, extra={"action": error.slug, "worker": self._worker_id})
                    pause, answers = min(self._pause_seconds, RETRY_SECONDS), False
                    continue
                now = self._clock.monotonic()
                if now - self._heard_at > self._gap_seconds:
                    self._steady_since = now
                self._heard_at, pause, answers = now, self._pause_seconds, True
        except BaseException as error:
            self._on_failure(error)


class Worker:
    """One worker.  ``run`` works until ``stop``, which any thread or signal handler may call.

    The engine is closed by ``run``; the database is the caller's.
    """

    def __init__(
        self, db: Database, engine: Engine, settings: Settings, *, solver_version: str | None = None,
        clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self.id = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._db = db.endable().within(TRANSACTION_SECONDS)
        self._clock = clock
        self._engine, self._settings, self._version = engine, settings, solver_version or running_code()
        self._computations: dict[str, Computation] = {}  # by key of the claim; each access is atomic
        self._arrivals: SimpleQueue[Computation | Ending | None] = SimpleQueue()
        self._endings: deque[Ending] = deque()
        self._unwanted: list[Future[Outcome]] = []
        self._stopping = False  # an Event could be locked by the very thread that a signal interrupts
        self._failure: BaseException | None = None
        self._usual_seconds = 1.0  # of computing a unit, lately
        self._rest_until, self._rest_seconds = 0.0, FIRST_REST
        self._heartbeat = Heartbeat(self._db, self.id, settings.lease_seconds, self._beat, self._fail, clock)

    def stop(self) -> None:
        """Finish nothing, give everything back, leave ``run``."""
        self._stopping = True
        self._db.end_within(STOPPING_SECONDS)
        self._arrivals.put(None)

    def run(self) -> None:
        """Work until told to stop.  Raises what is a defect of the worker itself."""
        try:
            self._insist(self._heartbeat.begin)
            fields = {"action": "worker-started", "worker": self.id, "pid": os.getpid()}
            log.info("the worker takes units for the engine %s", self._engine.name, extra=fields)
            while not self._stopping:
                self._insist(self._write_endings)
                self._insist(self._claim_units)
                self._wait()
            if self._failure is not None:
                raise self._failure
        finally:
            self._leave()

    # --- one round --------------------------------------------------------------------------------

    def _insist(self, call: Callable[[], None]) -> None:
        """Call until the database answers and can be used.  What is being computed goes on meanwhile."""
        pause = FIRST_PAUSE
        while not self._stopping:
            try:
                call()
                return
            except (StoreUnavailable, StoreError) as error:
                fields = {"action": error.slug, "worker": self.id, "seconds": pause}
                log.warning("the worker asks the database again soon: %s", error, extra=fields)
            until = self._clock.monotonic() + pause
            while not self._stopping and self._clock.monotonic() < until:
                self._clock.sleep(FIRST_PAUSE)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _claim_units(self) -> None:
        if self._clock.monotonic() < self._rest_until:
            return
        ahead = min(AHEAD_UNITS, int(AHEAD_SECONDS / max(self._usual_seconds, 1e-6)))
        limit = self._engine.capacity * (1 + ahead) - len(self._computations)
        if limit <= 0:
            return
        claims = queue.claim(
            self._db, worker_id=self.id, solver_version=self._version, lease_seconds=self._settings.lease_seconds,
            limit=limit, max_attempts=self._settings.max_unit_attempts, max_deaths=self._settings.max_unit_deaths,
            may_take_over=self._heartbeat.is_steady,
        )  # fmt: skip
        for claim in claims:
            task = Task(claim.kind, claim.request, claim.spec, claim.results)
            computation = Computation(claim, self._engine.submit(task, claim.key))
            self._computations[claim.key] = computation
            log_unit(logging.DEBUG, "begun", claim, "is claimed and handed to the engine")
            self._announce(computation)

    def _announce(self, computation: Computation) -> None:
        computation.future.add_done_callback(lambda _: self._arrivals.put(computation))

    def _wait(self) -> None:
        """Until something arrives, or until it is time to look for work again."""
        arrival = self._take_arrival(self._settings.poll_seconds)
        while arrival is not None:
            ending = self._conclude(arrival) if isinstance(arrival, Computation) else arrival
            if ending is not None:
                self._endings.append(ending)
            arrival = self._take_arrival(0.0)

    def _take_arrival(self, seconds: float) -> Computation | Ending | None:
        try:
            return self._arrivals.get(timeout=seconds) if seconds else self._arrivals.get_nowait()
        except Empty:
            return None

    # --- endings ----------------------------------------------------------------------------------

    def _conclude(self, computation: Computation) -> Ending | None:
        """What to write of a computation that has ended; None if it was lost or stopped before."""
        claim, future = computation.claim, computation.future
        if claim.key not in self._computations:
            return None
        error = None if future.cancelled() else future.exception()
        if future.cancelled() or isinstance(error, GivenBack | Died):
            return self._conclude_without_outcome(claim, error)
        if error is not None:
            return self._conclude_with(claim, report_defect(claim, error))
        outcome = future.result()
        self._rest_seconds = FIRST_REST
        self._usual_seconds += 0.1 * (outcome.cpu_seconds - self._usual_seconds)
        return self._conclude_with(claim, outcome)

    def _conclude_without_outcome(self, claim: Claim, error: BaseException | None) -> Ending:
        died, why = isinstance(error, Died), str(error or "the engine was stopped")
        words = f"was not computed to its end: {why}"
        log_unit(logging.WARNING, "died" if died else "given-back", claim, words)
        if isinstance(error, OutOfDate):
            self._fail(SourcesChangedError(Problem("", "sources-changed", why, "start the worker again")))
        if not died:
            self._rest_until = self._clock.monotonic() + self._rest_seconds
            self._rest_seconds = min(2 * self._rest_seconds, LONGEST_REST)

        return Ending(claim, "released", "is given back, for any worker to claim", None, died, why if error else "")

    def _conclude_with(self, claim: Claim, outcome: Outcome) -> Ending:
        try:
            queue.require_fitting(claim, outcome)
        except ValueError as error:
            outcome = report_defect(claim, error)
        if outcome.answer is not None or outcome.problem is not None:
            return Ending(claim, "job-ended", "is recorded, and the job has ended with it", outcome)
        return Ending(claim, "recorded", "is recorded", outcome)

    def _write_endings(self) -> None:
        while self._endings:
            first = self._endings[0]
            if first.outcome is None:
                queue.release(self._db, first.claim, died=first.died, why=first.why)
                written = [True]
            else:
                outcomes = []  # and what else has ended of the same job: some are written nearly as quickly as one
                for each in self._endings:
                    if each.outcome is None or each.claim.job_id != first.claim.job_id:
                        break
                    outcomes.append((each.claim, each.outcome))
                written = queue.record(self._db, outcomes, max_job_seconds=self._settings.max_job_seconds)
            for was_ours in written:
                self._leave_claim(self._endings.popleft(), was_ours)

    def _leave_claim(self, ending: Ending, was_ours: bool) -> None:
        self._computations.pop(ending.claim.key, None)
        if not was_ours:
            log_unit(logging.INFO, "late", ending.claim, "is no longer this worker's; nothing is written")
        else:
            level = logging.INFO if ending.action == "job-ended" else logging.DEBUG
            log_unit(level, ending.action, ending.claim, ending.words)

    # --- in the thread of the heartbeat -----------------------------------------------------------

    def _beat(self, db: Database) -> None:
        """Stop what takes too long, prolong leases, stop what another worker has by now, say that this one lives."""
        for computation in list(self._computations.values()):
            seconds = self._engine.seconds(computation.future)
            if seconds > self._settings.max_job_seconds:
                self._stop_long(computation, seconds)
        self._kill_unwanted()
        claims = [computation.claim for computation in list(self._computations.values())]
        for claim in queue.renew(db, self.id, claims, self._settings.lease_seconds):
            lost = self._computations.pop(claim.key, None)
            if lost is not None:
                log_unit(logging.INFO, "lost", claim, "is no longer this worker's, its computation is stopped")
                self._unwanted.append(lost.future)
        self._kill_unwanted()
        workers.report_alive(
            db, self.id, socket.gethostname(), os.getpid(), self._version, self._engine.name, self._engine.capacity
        )

    def _stop_long(self, computation: Computation, seconds: float) -> None:
        claim = computation.claim
        self._unwanted.append(computation.future)
        if self._computations.pop(claim.key, None) is not None:  # so that its computation's end is not looked at
            log_unit(logging.WARNING, "too-long", claim, "takes longer than a job may and is stopped", seconds=seconds)
            limit_seconds = self._settings.max_job_seconds
            detail = f"one part of the job was still being computed after {limit_seconds:g} s and was stopped"
            hint = "ask for less (trials, starts, points); the operator's setting is TAILSTACK_MAX_JOB_SECONDS"
            problem = render_problem(LimitError(Problem("", "job-too-long", detail, hint)))
            self._arrivals.put(self._conclude_with(claim, Outcome(seconds, problem=problem)))

    def _kill_unwanted(self) -> None:
        """Again at each beat until it has ended: a task can be on its way between two processes."""
        self._unwanted = [future for future in self._unwanted if not future.done()]
        for future in self._unwanted:
            self._engine.kill(future)

    def _fail(self, error: BaseException) -> None:
        self._failure = error
        self.stop()

    # --- the end ----------------------------------------------------------------------------------

    def _leave(self) -> None:
        self._heartbeat.end()
        claims = [computation.claim for computation in list(self._computations.values())]
        try:
            for claim in claims:
                queue.release(self._db, claim, died=False)
            workers.remove_worker(self._db, self.id)
        except (StoreUnavailable, StoreError) as error:
            words = "units were not given back, their leases will run out: %s"
            log.warning(words, error, extra={"action": error.slug, "worker": self.id})
        finally:
            self._engine.close()
        fields = {"action": "worker-stopped", "worker": self.id}
        log.info("the worker has stopped and gave %d units back", len(claims), extra=fields)


# --- the worker as a process: its signals, its start, its end with the process that started it -------------

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
    with closing(open_database(settings.database_url, read_only=True)) as db:
        with reading(db) as connection:
            at = now(db, connection)
        silence = max(SILENCE_SECONDS, settings.lease_seconds)
        here = [worker for worker in list_workers(db) if worker.host == socket.gethostname()]
        return max((w for w in here if w.seen_at > at - silence), key=lambda w: w.seen_at, default=None)


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
