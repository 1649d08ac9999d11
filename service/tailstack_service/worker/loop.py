"""Claim, compute, record, until told to stop.

The database decides what counts.  A unit that this worker lost while it was frozen, or while the database was away,
is computed in vain: the record is refused.  So nothing here has to be certain, only quick.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue

from tailstack.errors import Problem, SourcesChangedError
from tailstack.version import __version__

from ..compute.engine import Died, Engine, GivenBack, OutOfDate
from ..settings import Settings
from ..store import units
from ..store.claims import Claim
from ..store.database import Database
from ..store.errors import StoreError, StoreUnavailable
from ..work.task import Outcome, Task
from . import refusals
from .hands import Hands, Held, key_of
from .keeper import Keeper, told

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
        claims = units.claim(
            self._db, worker_id=self.id, solver_version=self._version, lease_seconds=self._settings.lease_seconds,
            limit=places, max_attempts=self._settings.max_unit_attempts, max_deaths=self._settings.max_unit_deaths,
            may_take_over=self._keeper.steady,
        )  # fmt: skip
        for claim in claims:
            self._begin(claim)

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
            return self._to_record(held, refusals.defect())
        outcome = held.future.result()
        self._rest = FIRST_REST
        self._usual_seconds += 0.1 * (outcome.cpu_seconds - self._usual_seconds)
        return self._to_record(held, outcome)

    def _to_record(self, held: Held, outcome: Outcome) -> _Ending:
        action = "job-ended" if outcome.answer is not None or outcome.problem is not None else "recorded"
        return _Ending(held, action, lambda: self._record(held, outcome))

    def _record(self, held: Held, outcome: Outcome) -> bool:
        try:
            return units.record(self._db, held.claim, outcome, max_job_seconds=self._settings.max_job_seconds)
        except ValueError as error:
            log.error("%s", error, extra={"action": "defect", **told(held)})
            return units.record(self._db, held.claim, refusals.defect(), max_job_seconds=self._settings.max_job_seconds)

    def _release(self, held: Held, *, died: bool, why: str) -> bool:
        units.release(self._db, held.claim, died=died, why=why)
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
            self._arrived.put(self._to_record(held, refusals.too_long(seconds, self._settings.max_job_seconds)))

    def _failed(self, error: BaseException) -> None:
        self._failure = error
        self.stop()

    # --- the end ----------------------------------------------------------------------------------

    def _leave(self) -> None:
        self._keeper.end()
        held = self._hands.all()
        try:
            for one in held:
                units.release(self._db, one.claim, died=False)
            units.goodbye(self._db, self.id)
        except (StoreUnavailable, StoreError) as error:  # then the leases run out by themselves
            log.warning("%s", error, extra={"action": error.slug, "worker": self.id})
        finally:
            self._engine.close()
        log.info("%d units given back", len(held), extra={"action": "worker-stopped", "worker": self.id})
