"""Places to compute for callers who wait: processes that can be killed, shared among tenants who take turns.

An API process computes nothing itself.  Each request is sent to one of a few processes, which reads it, says how long
the rest will take, and computes it, under the limit of ``TAILSTACK_MAX_SECONDS`` of CPU; it is given up, and its
process killed and replaced, when it takes more, when the caller leaves, and when the service stops.

Who waits is served by tenant: next is the one that has used least.  What is expected to take long leaves one process
free for what is expected to be quick, so that nobody's small score waits for anybody's large one.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Literal

from starlette.requests import Request

from tailstack.errors import LimitError, Problem

from ..clock import SYSTEM_CLOCK, Clock
from ..environment import variable
from ..operations.request import DesignReferenceUnresolved
from ..problems import RefusedAt, TransportError
from ..processes import pool
from ..processes.birth import prepare_children
from ..processes.pool import ComputingProcess, Processes
from ..processes.task import OutOfDate, PutBack

Warmth = Literal["warming up", "ready", "failed"]

log = logging.getLogger("tailstack.service")
PERFORM = "tailstack_service.operations.perform:perform_call"
WARM_UP, WARM_UP_OF = "tailstack_service.operations.perform:warm_up", ("score", "batch", "optimise")
QUICK_SECONDS = 0.05  # of CPU expected: what may use the process that is kept free, and who waits for it waits so long
OVERRUN_SECONDS = 2.0  # of CPU, after which what was expected to be quick is one of those that take long
BIRTH_SECONDS = 0.1  # of CPU, for a new process to become ready: the price of a kill
MOST_REMEMBERED = 1_000  # tenants
WARMTH_LOOK_SECONDS, WARMTH_RETRY_SECONDS = 0.02, 5
WORTH_SECONDS = 1.0  # of CPU: what has taken less is finished for a caller who left


class CallerLeft(Exception):
    """Nobody waits for the answer any more."""


class FairQueue:
    """Who waits in a lane, by tenant.  The next is of the tenant that has used least of the processor there.

    Who comes back after a while begins where the others are: what was not used is not saved up.
    """

    def __init__(self) -> None:
        self._lines: dict[str, deque[_Computation]] = {}  # in the order of their last turn
        self._used: dict[str, float] = {}  # s, by tenant
        self._now = 0.0  # what whoever was served last had used before

    def __len__(self) -> int:
        return sum(map(len, self._lines.values()))

    def put(self, computation: _Computation) -> None:
        tenant = computation.tenant
        if tenant not in self._lines:
            self._used[tenant] = max(self._used.get(tenant, 0.0), self._now)
            self._lines[tenant] = deque()
        self._lines[tenant].append(computation)

    def take(self) -> _Computation:
        """The next one; its tenant pays what it is expected to take, and comes last among those who used as much."""
        tenant = min(self._lines, key=self._used.__getitem__)
        self._now = max(self._now, self._used[tenant])
        line = self._lines.pop(tenant)
        computation = line.popleft()
        if line:
            self._lines[tenant] = line
        self.charge(tenant, computation.expected)
        return computation

    def charge(self, tenant: str, seconds: float) -> None:
        """Let a tenant have used so many seconds more; less, where it took less than was expected."""
        self._used[tenant] = self._used.get(tenant, self._now) + seconds
        if len(self._used) > MOST_REMEMBERED:
            self._used = {name: used for name, used in self._used.items() if used > self._now or name in self._lines}

    def remove(self, computation: _Computation) -> None:
        """Take one out before its turn, if it is there."""
        line = self._lines.get(computation.tenant, deque())
        with suppress(ValueError):
            line.remove(computation)
            if not line:
                del self._lines[computation.tenant]

    def of(self, tenant: str) -> deque[_Computation]:
        return self._lines.get(tenant, deque())

    def tenants(self) -> list[str]:
        return list(self._lines)


class _Computation:
    """One call, from its wait for a place to its end."""

    def __init__(self, tenant: str, call: Callable[[], Any], expected: float) -> None:
        self.tenant, self.call, self.expected = tenant, call, expected  # s of CPU, by what is known so far
        self.quick = expected <= QUICK_SECONDS
        self.place: asyncio.Future[ComputingProcess] = asyncio.get_running_loop().create_future()
        self.taken = 0.0  # s of CPU, in the process that computes it now

    @property
    def worth_ending(self) -> bool:
        """Whether to end it for a caller who left: what is left costs more than making a new process ready.

        Also what has cost so much more than was expected that nobody knows what is left.  In seconds of CPU, which a
        busy machine does not make more: else it would be busier with every process that is killed.
        """
        if not self.place.done():
            return True
        return self.taken >= WORTH_SECONDS and abs(self.expected - self.taken) > BIRTH_SECONDS

    def put_back(self, seconds: float) -> None:
        """Let it wait for its turn among those that take long; it is expected to take so many seconds."""
        self.expected, self.quick = seconds, False
        self.place = asyncio.get_running_loop().create_future()


class ComputePool:
    """``count`` computing processes and those who wait for one of them, at most ``waiting``.

    There are two lanes.  What is read, and what is expected to be quick once it was read, may use every process; the
    rest leaves one free.  A process that has read a request says how long the rest will take: then it goes on, or the
    request waits for its turn among the long ones.

    ``warm``: :meth:`begin` has every kernel loaded where the processes are forked from; otherwise each loads what it
    needs.  ``seconds`` of CPU are given to a computation; ``hang_seconds`` without any end it.  For one event loop.
    """

    def __init__(
        self, count: int, waiting: int, seconds: float, stopping: threading.Event, *, warm: bool = False,
        most_bytes: int = 0, hang_seconds: float = 30.0, clock: Clock = SYSTEM_CLOCK,
    ) -> None:  # fmt: skip
        self._clock = clock
        self.count, self.waiting, self.seconds = count, waiting, seconds
        self.warmth: Warmth = "warming up" if warm else "ready"
        self.kills = 0  # of processes that computed
        self._stopping, self._warm, self._hang_seconds = stopping, warm, hang_seconds
        self._processes = Processes(PERFORM, most_bytes, clock)
        self._under_way = 0  # computations under way
        self._long = 0  # those of them that are expected to take long
        self._quick_turns, self._long_turns = FairQueue(), FairQueue()
        self._warming: asyncio.Task[Any] | None = None

    def begin(self) -> None:
        """Have everything loaded that a computation may need, and then the processes."""
        if self._warm:
            self._warming = asyncio.get_running_loop().create_task(self._warm_all())

    async def close(self) -> None:
        """Kill every process and return when they are gone; whoever waits for one is refused by ``run``."""
        self._stopping.set()
        if self._warming is not None:
            self._warming.cancel()
        await self._processes.close()

    async def wait_until_warm(self, limit_seconds: float) -> None:
        """Return when the kernels are compiled, or cannot be.  Raises TransportError 503 after so many seconds.

        From a cache they are there in a second or two, which is worth waiting for; compiling them takes a minute.
        """
        deadline = self._clock.monotonic() + limit_seconds
        while self.warmth == "warming up" and not self._stopping.is_set():
            if self._clock.monotonic() >= deadline:
                waited = f"waited {limit_seconds:g} s ({variable('warm_up_seconds')})"
                detail = f"the numerical kernels are still being compiled; {waited}"
                hint = "send the request again later: GET /health/ready answers 200 when they are there"
                raise TransportError("warming-up", detail, hint, {"Retry-After": str(WARMTH_RETRY_SECONDS)})
            await self._clock.sleep_async(WARMTH_LOOK_SECONDS)

    def pids(self) -> list[int]:
        return self._processes.pids()

    async def run(self, request: Request, call: Callable[[], Any], expected_seconds: float) -> Any:
        """What the call returns, which has to be a function of a module with plain arguments (``partial``).

        expected_seconds: of CPU, until it returns or says how long the rest will take (``Estimated``).
        Raises RefusedAt, DesignReferenceUnresolved, LimitError (too long), TransportError (busy, stopping),
        CallerLeft, and Died or Defect for what should not happen.
        """
        if self._stopping.is_set():
            raise stopping_error()
        computation = _Computation(request.state.caller.tenant, call, expected_seconds)
        task = asyncio.ensure_future(self._compute(computation, request))
        task.add_done_callback(lambda task: task.cancelled() or task.exception())  # nobody may be there to look
        try:
            while not await self._clock.wait_async(task, pool.LOOK_SECONDS):
                if self._stopping.is_set():
                    raise stopping_error()
                if computation.worth_ending and await request.is_disconnected():
                    raise CallerLeft
            outcome = task.result()
        finally:
            task.cancel()
            # What is raised holds this frame: if the frame held it, the body would stay until cycles are looked for
            del task
        if not isinstance(outcome, RefusedAt | DesignReferenceUnresolved):
            return outcome
        try:
            raise outcome
        finally:
            del outcome

    async def _compute(self, computation: _Computation, request: Request) -> Any:
        while True:
            process = await self._turn(computation)
            if not computation.quick and await self._has_left(request, computation, process):
                raise CallerLeft
            expected, computation.taken = computation.expected, 0.0
            may_go_on, look = partial(self._may_go_on, computation), partial(self._watch, computation)
            try:
                return await process.compute(
                    computation.call, may_go_on=may_go_on, look=look, hang_seconds=self._hang_seconds
                )
            except OutOfDate as error:
                self.warmth = "failed"  # a supervisor or an operator can act
                hint, headers = "the operator restarts the service", {"Retry-After": "10"}
                raise TransportError("stopping", str(error), hint, headers, code="sources-changed") from None
            except TimeoutError:
                if computation.taken > self.seconds:
                    detail = f"the computation did not finish within the limit of {self.seconds:g} s"
                    hint = "ask for fewer trials, targets or designs, or start the service with a higher "
                    hint += variable("max_seconds")
                    raise LimitError(Problem("", "too-long", detail, hint)) from None
                again = max(computation.expected, OVERRUN_SECONDS)
            except PutBack as later:
                again = later.seconds
            finally:
                lane = self._quick_turns if computation.quick else self._long_turns
                lane.charge(computation.tenant, (process.seconds or computation.taken) - expected)
                if process.killed:
                    self.kills += 1
                    taken = computation.taken
                    fields = {"action": "computation-killed", "pid": process.pid, "seconds": round(taken, 2)}
                    log.info("after %.1f s of CPU of a computation its process was killed", taken, extra=fields)
                    lane.charge(computation.tenant, BIRTH_SECONDS)  # of the one that takes its place
                self._leave(computation, process)
            computation.put_back(again)

    async def _has_left(self, request: Request, computation: _Computation, process: ComputingProcess) -> bool:
        """Whether the caller left while it waited for its turn, which nobody has looked at for a moment.

        Then the process goes to the next: what was begun for nobody would have to be killed.
        """
        here = False
        try:
            here = not await request.is_disconnected()
        finally:
            if not here:
                self._leave(computation, process)
        return not here

    def _may_go_on(self, computation: _Computation, seconds: float) -> bool:
        """Whether what was read is computed where it was read, now that it is known how long that will take."""
        if computation.quick and self.count > 1 and seconds > QUICK_SECONDS:
            if self._long_turns or not self._long_may_begin():
                return False
            self._make_long(computation)
        computation.expected = max(seconds, computation.expected)
        return True

    def _watch(self, computation: _Computation, taken: float) -> None:
        """Look at a computation that has taken so many seconds of CPU.  Raises TimeoutError: it is to be killed."""
        computation.taken = taken
        if taken > self.seconds:
            raise TimeoutError
        if computation.quick and self.count > 1 and taken > OVERRUN_SECONDS:
            if not self._long_may_begin():
                raise TimeoutError
            self._make_long(computation)

    def _make_long(self, computation: _Computation) -> None:
        """It goes on where it is, as one of those that take long: what it takes is theirs, and another may be quick."""
        computation.quick = False
        self._long += 1

    # --- whose turn it is ---------------------------------------------------------------------------

    async def _turn(self, computation: _Computation) -> ComputingProcess:
        """A process, when it is this one's turn.  Raises TransportError when too many wait."""
        place = computation.place
        turns = self._quick_turns if computation.quick else self._long_turns
        turns.put(computation)
        self._serve()
        if len(self._quick_turns) + len(self._long_turns) > self.waiting:
            self._refuse_one(computation)
        try:
            return await place
        except asyncio.CancelledError:
            turns.remove(computation)
            if place.done() and not place.cancelled() and not place.exception():
                self._leave(computation, place.result())
            raise

    def _refuse_one(self, newest: _Computation) -> None:
        """One has to go: the last of the tenant with the most that wait, so that nobody fills the room for all."""

        def waiting(tenant: str) -> int:
            return len(self._quick_turns.of(tenant)) + len(self._long_turns.of(tenant))

        tenants = {*self._quick_turns.tenants(), *self._long_turns.tenants()}
        most = max(map(waiting, tenants))
        last = newest
        if waiting(newest.tenant) < most:
            tenant = next(each for each in tenants if waiting(each) == most)
            last = (self._long_turns.of(tenant) or self._quick_turns.of(tenant))[-1]
        (self._quick_turns if last.quick else self._long_turns).remove(last)
        detail = f"{self.count} computations are under way and {self.waiting} wait, the limit"
        hint = "send the request again in a few seconds, or start the service with a higher TAILSTACK_MAX_WAITING"
        last.place.set_exception(TransportError("busy", detail, hint, {"Retry-After": "2"}))

    def _serve(self) -> None:
        """Give processes to those whose turn it is."""
        while self._under_way < self.count:
            turns = self._long_turns if self._long_turns and self._long_may_begin() else self._quick_turns
            if not turns or self._stopping.is_set():
                return
            computation = turns.take()
            if computation.place.done():  # given up a moment ago
                continue
            self._under_way += 1
            self._long += not computation.quick
            computation.place.set_result(self._processes.take())

    def _long_may_begin(self) -> bool:
        """Whether one process besides is left for what is quick, where there is more than one."""
        return self.count - self._long >= min(2, self.count)

    # --- the processes --------------------------------------------------------------------------------

    def _leave(self, computation: _Computation, process: ComputingProcess) -> None:
        """A computation has ended, and gives its process back."""
        self._under_way -= 1
        self._long -= not computation.quick
        self._processes.give_back(process)
        self._serve()

    async def _warm_all(self) -> None:
        """Whatever was started before everything was loaded makes room for what is forked afterwards."""
        try:
            await prepare_children(WARM_UP, WARM_UP_OF)
            self.warmth = "ready"
        except (RuntimeError, OSError) as error:
            self.warmth = "failed"
            log.error("the kernels cannot be loaded: %s", error, extra={"action": "warm-up-failed"})
        self._processes.renew(self.count)


def stopping_error() -> TransportError:
    """What is said to whoever waits when the service is told to stop."""
    return TransportError("stopping", "the service was told to stop", "try again later", {"Retry-After": "10"})
