"""The second thread of a worker: it keeps the leases alive and stops what is no longer wanted.

It neither computes nor records, so that nothing which takes long stands between two heartbeats.
"""

from __future__ import annotations

import logging
import math
import os
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future

from ..compute.engine import Engine
from ..settings import Settings
from ..store import units
from ..store.database import Database
from ..store.errors import StoreError, StoreUnavailable
from ..work.task import Outcome
from .hands import Hands, Held

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
        lost = units.renew(self._db, self._worker_id, [h.claim for h in held], self._settings.lease_seconds)
        for claim in lost:
            dropped = self._hands.drop(claim)
            if dropped is not None:
                log.info("no longer ours, stopped", extra={"action": "lost", **told(dropped)})
                self._unwanted.append(dropped.future)
        self._stop_unwanted()
        self._say_alive()

    def _say_alive(self) -> None:
        units.heartbeat(
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
