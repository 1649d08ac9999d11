"""Outcomes that no computing process gave: the job fails with a problem that says why.

What a worker has in its hands: claims and their computations, shared by the threads of the worker.

The second thread of a worker: it keeps the leases alive and stops what is no longer wanted.

It neither computes nor records, so that nothing which takes long stands between two heartbeats.

Claim, compute, record, until told to stop.

The database decides what counts.  A unit that this worker lost while it was frozen, or while the database was away,
is computed in vain: the record is refused.  So nothing here has to be certain, only quick.
"""

from __future__ import annotations

import logging
import math
import os
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from queue import Empty, SimpleQueue

from tailstack.errors import LimitError, Problem, SourcesChangedError
from tailstack.version import __version__

from ..problems import TransportError
from ..processes.frames import Died, GivenBack, OutOfDate
from ..settings import Settings
from ..task import Outcome, Task
from .engines.engine import Engine
from .store import queue, workers
from .store.database import Database
from .store.errors import StoreError, StoreUnavailable
from .store.events import render_problem
from .store.queue import Claim


def defect() -> Outcome:
    """A unit raised what is not a refusal; its traceback belongs into the log."""
    hint = "report it with the job's id: the log of the worker holds the cause under it"
    error = TransportError("internal-error", Problem("", "internal-error", "the job met a defect of the service", hint))
    return Outcome(0.0, problem=render_problem(error))


def too_long(seconds: float, limit: float) -> Outcome:
    """A unit that was still being computed after ``limit`` seconds; it took ``seconds``."""
    detail = f"one part of the job was still being computed after {limit:g} s and was stopped"
    hint = "ask for less (trials, starts, points); the operator's setting is TAILSTACK_MAX_JOB_SECONDS"
    return Outcome(seconds, problem=render_problem(LimitError(Problem("", "job-too-long", detail, hint))))


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A claim and its computation."""

    claim: Claim
    future: Future[Outcome]


def key_of(claim: Claim) -> str:
    """Unique among all claims there ever were."""
    return f"{claim.job_id}-{claim.index}-{claim.generation}-{claim.token}"


class Hands:
    """The claims held, by key."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, Held] = {}

    def __len__(self) -> int:
        return len(self._held)

    def take(self, held: Held) -> None:
        with self._lock:
            self._held[key_of(held.claim)] = held

    def drop(self, claim: Claim) -> Held | None:
        """Let go of a claim; None if it was not held any more."""
        with self._lock:
            return self._held.pop(key_of(claim), None)

    def holds(self, claim: Claim) -> bool:
        return key_of(claim) in self._held

    def all(self) -> list[Held]:
        with self._lock:
            return list(self._held.values())


log = logging.getLogger("tailstack.worker")

BEATS_PER_LEASE = 3
RETRY_SECONDS = 0.25  # while the database does not answer; never longer than between two beats
LEAST_SECONDS = 2.0  # for the database to answer a beat; with long leases it has the time until the next


class Keeper:
    """``begin`` says that the worker is there; then a thread renews every third of a lease until ``end``.

    on_too_long: told of a computation that was stopped because it took longer than a job may, s.
    on_failure: told if the thread ends by a defect; the worker must not go on without it.
    """

    def __init__(
        self,
        db: Database,
        engine: Engine,
        settings: Settings,
        hands: Hands,
        *,
        worker_id: str,
        solver_version: str,
        on_too_long: Callable[[Held, float], None],
        on_failure: Callable[[BaseException], None],
    ) -> None:
        self._engine, self._settings, self._hands = engine, settings, hands
        self._seconds = settings.lease_seconds / BEATS_PER_LEASE  # between two beats
        self._db = db.within(max(self._seconds, LEAST_SECONDS))
        self._heard_at = self._steady_since = -math.inf  # monotonic: the last beat, and the first without a gap
        self._worker_id, self._version = worker_id, solver_version
        self._on_too_long, self._on_failure = on_too_long, on_failure
        self._unwanted: list[Future[Outcome]] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tailstack-keeper", daemon=True)
        self._silent = False

    def begin(self) -> None:
        """Raises StoreUnavailable, StoreError."""
        self._say_alive()
        self._heard_at = time.monotonic()
        self._thread.start()

    def steady(self) -> bool:
        """Whether the database has answered beat after beat for as long as a lease.

        While it stands still nobody can prolong a lease.  When it wakes they have all run out, and those who hold them
        are about to prolong them: whoever took them over now would compute a second time what is being computed.
        """
        now = time.monotonic()
        return now - self._heard_at <= self._gap and now - self._steady_since >= self._settings.lease_seconds

    @property
    def _gap(self) -> float:
        """The longest time between two beats of a database that answers, s."""
        return max(1.5 * self._seconds, LEAST_SECONDS)

    def end(self) -> None:
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        pause = self._seconds
        try:
            while not self._ending.wait(pause):
                try:
                    self._beat()
                    now = time.monotonic()
                    if now - self._heard_at > self._gap:
                        self._steady_since = now
                    self._heard_at = now
                    self._silent, pause = False, self._seconds
                except (StoreUnavailable, StoreError) as error:
                    pause = min(self._seconds, RETRY_SECONDS)
                    if not self._silent:
                        log.warning("%s", error, extra={"action": error.slug, "worker": self._worker_id})
                    self._silent = True
        except BaseException as error:
            self._on_failure(error)

    def _beat(self) -> None:
        self._stop_what_takes_too_long()
        held = self._hands.all()
        lost = queue.renew(self._db, self._worker_id, [h.claim for h in held], self._settings.lease_seconds)
        for one in lost:
            dropped = self._hands.drop(one)
            if dropped is not None:
                log.info("no longer ours, stopped", extra={"action": "lost", **told(dropped)})
                self._unwanted.append(dropped.future)
        self._stop_unwanted()
        self._say_alive()

    def _say_alive(self) -> None:
        workers.report_alive(
            self._db, self._worker_id, socket.gethostname(), os.getpid(), self._version, self._engine.name,
            self._engine.capacity,
        )  # fmt: skip

    def _stop_what_takes_too_long(self) -> None:
        for held in self._hands.all():
            seconds = self._engine.seconds(held.future)
            if seconds > self._settings.max_job_seconds:
                self._unwanted.append(held.future)
                self._on_too_long(held, seconds)
        self._stop_unwanted()

    def _stop_unwanted(self) -> None:
        """Again at each beat until it has ended: a task can be on its way between two processes."""
        self._unwanted = [future for future in self._unwanted if not future.done()]
        for future in self._unwanted:
            self._engine.kill(future)


def told(held: Held) -> dict[str, object]:
    """What a log line says of a claim."""
    return {"job": held.claim.job_id, "unit": held.claim.index, "request": held.claim.request_id}


log = logging.getLogger("tailstack.worker")

# Units are taken ahead only as far as they are short: one that waits here could be computed by another worker.
AHEAD_SECONDS = 0.1  # of computing, for each place of the engine
AHEAD_UNITS = 3  # at most, for each place of the engine: the next ones may be long
FIRST_PAUSE, LONGEST_PAUSE = 0.05, 2.0  # s, between attempts while the database does not answer
TRANSACTION_SECONDS = 30.0  # claims and records may be large; nobody waits for an answer
STOPPING_SECONDS = 3.0  # for the database to take units back; otherwise their leases run out
FIRST_REST, LONGEST_REST = 0.2, 10.0  # s, without new claims after the engine gave units back


@dataclass(frozen=True, slots=True)
class _Ending:
    """What a claim came to, to be written by ``write``."""

    held: Held
    action: str  # for the log
    write: Callable[[], bool]


class Worker:
    """One worker.  ``run`` works until ``stop``, which any thread or signal handler may call.

    The engine is closed by ``run``; the database is the caller's.
    """

    def __init__(self, db: Database, engine: Engine, settings: Settings, *, solver_version: str = __version__) -> None:
        self.id = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._db = db.endable().within(TRANSACTION_SECONDS)
        self._engine, self._settings, self._version = engine, settings, solver_version
        self._hands = Hands()
        self._arrived: SimpleQueue[Held | _Ending | None] = SimpleQueue()
        self._endings: deque[_Ending] = deque()
        self._stopping = False  # an Event could be locked by the very thread that a signal interrupts
        self._failure: BaseException | None = None
        self._usual_seconds = 1.0  # of computing a unit, lately
        self._rest_until, self._rest = 0.0, FIRST_REST
        self._keeper = Keeper(
            self._db, engine, settings, self._hands, worker_id=self.id, solver_version=solver_version,
            on_too_long=self._too_long, on_failure=self._failed,
        )  # fmt: skip

    def stop(self) -> None:
        """Finish nothing, give everything back, leave ``run``."""
        self._stopping = True
        self._db.end_within(STOPPING_SECONDS)
        self._arrived.put(None)

    def run(self) -> None:
        """Work until told to stop.  Raises what is a defect of the worker itself."""
        try:
            self._insist(self._keeper.begin)
            log.info(
                "engine %s", self._engine.name,
                extra={"action": "worker-started", "worker": self.id, "pid": os.getpid()},
            )  # fmt: skip
            while not self._stopping:
                self._insist(self._write_endings)
                self._insist(self._claim_more)
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
                log.warning("%s", error, extra={"action": error.slug, "worker": self.id, "seconds": pause})
            until = time.monotonic() + pause
            while not self._stopping and time.monotonic() < until:
                time.sleep(FIRST_PAUSE)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _claim_more(self) -> None:
        if time.monotonic() < self._rest_until:
            return
        capacity = self._engine.capacity
        ahead = min(AHEAD_UNITS, int(AHEAD_SECONDS / max(self._usual_seconds, 1e-6)))
        places = capacity * (1 + ahead) - len(self._hands)
        if places <= 0:
            return
        claims = queue.claim(
            self._db, worker_id=self.id, solver_version=self._version, lease_seconds=self._settings.lease_seconds,
            limit=places, max_attempts=self._settings.max_unit_attempts, max_deaths=self._settings.max_unit_deaths,
            may_take_over=self._keeper.steady,
        )  # fmt: skip
        for one in claims:
            self._begin(one)

    def _begin(self, claim: Claim) -> None:
        task = Task(claim.kind, claim.request, claim.spec, claim.results)
        held = Held(claim, self._engine.submit(task, key_of(claim)))
        self._hands.take(held)
        log.debug("", extra={"action": "begun", **told(held)})
        held.future.add_done_callback(lambda _: self._arrived.put(held))

    def _wait(self) -> None:
        """Until something arrives, or until it is time to look for work again."""
        arrived = self._next(self._settings.poll_seconds)
        while arrived is not None:
            ending = self._ending_of(arrived) if isinstance(arrived, Held) else arrived
            if ending is not None:
                self._endings.append(ending)
            arrived = self._next(0.0)

    def _next(self, seconds: float) -> Held | _Ending | None:
        try:
            return self._arrived.get(timeout=seconds) if seconds else self._arrived.get_nowait()
        except Empty:
            return None

    # --- endings ----------------------------------------------------------------------------------

    def _ending_of(self, held: Held) -> _Ending | None:
        """What to write of a computation that has ended."""
        if not self._hands.holds(held.claim):
            return None  # lost, or stopped
        raised = None if held.future.cancelled() else held.future.exception()
        if held.future.cancelled() or isinstance(raised, GivenBack | Died):
            died = isinstance(raised, Died)
            log.warning("%s", raised, extra={"action": "died" if died else "given-back", **told(held)})
            if isinstance(raised, OutOfDate):
                self._failed(SourcesChangedError(Problem("", "sources-changed", str(raised), "start the worker again")))
            if not died:
                self._rest_until = time.monotonic() + self._rest
                self._rest = min(2 * self._rest, LONGEST_REST)
            return _Ending(held, "released", lambda: self._release(held, died=died, why=str(raised or "")))
        if raised is not None:
            log.error("%s", raised, extra={"action": "defect", **told(held)})
            return self._to_record(held, defect())
        outcome = held.future.result()
        self._rest = FIRST_REST
        self._usual_seconds += 0.1 * (outcome.cpu_seconds - self._usual_seconds)
        return self._to_record(held, outcome)

    def _to_record(self, held: Held, outcome: Outcome) -> _Ending:
        action = "job-ended" if outcome.answer is not None or outcome.problem is not None else "recorded"
        return _Ending(held, action, lambda: self._record(held, outcome))

    def _record(self, held: Held, outcome: Outcome) -> bool:
        try:
            return queue.record(self._db, held.claim, outcome, max_job_seconds=self._settings.max_job_seconds)
        except ValueError as error:
            log.error("%s", error, extra={"action": "defect", **told(held)})
            return queue.record(self._db, held.claim, defect(), max_job_seconds=self._settings.max_job_seconds)

    def _release(self, held: Held, *, died: bool, why: str) -> bool:
        queue.release(self._db, held.claim, died=died, why=why)
        return True

    def _write_endings(self) -> None:
        while self._endings:
            ending = self._endings[0]
            written = ending.write()
            self._endings.popleft()
            self._hands.drop(ending.held.claim)
            level = logging.INFO if ending.action == "job-ended" or not written else logging.DEBUG
            log.log(level, "", extra={"action": ending.action if written else "late", **told(ending.held)})

    # --- called by other threads ------------------------------------------------------------------

    def _too_long(self, held: Held, seconds: float) -> None:
        dropped = self._hands.drop(held.claim)  # so that its computation's end is not looked at
        if dropped is not None:
            log.warning("stopped", extra={"action": "too-long", "seconds": seconds, **told(held)})
            self._arrived.put(self._to_record(held, too_long(seconds, self._settings.max_job_seconds)))

    def _failed(self, error: BaseException) -> None:
        self._failure = error
        self.stop()

    # --- the end ----------------------------------------------------------------------------------

    def _leave(self) -> None:
        self._keeper.end()
        held = self._hands.all()
        try:
            for one in held:
                queue.release(self._db, one.claim, died=False)
            workers.remove_worker(self._db, self.id)
        except (StoreUnavailable, StoreError) as error:  # then the leases run out by themselves
            log.warning("%s", error, extra={"action": error.slug, "worker": self.id})
        finally:
            self._engine.close()
        log.info("%d units given back", len(held), extra={"action": "worker-stopped", "worker": self.id})
