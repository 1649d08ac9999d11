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
import socket
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any, Literal

from starlette.requests import Request

from tailstack.errors import LimitError, Problem

from ..clock import SYSTEM_CLOCK, Clock
from ..environment import variable
from ..operations.request import DesignReferenceUnresolved
from ..problems import RefusedAt, TransportError
from ..processes import frames
from ..processes.frames import BEGUN, OTHER_CODE, Defect, Died, Estimate, OutOfDate
from ..processes.interpreter import describe_ending
from ..processes.nursery import prepare_children, start_child
from ..processes.pulse import Pulse

Warmth = Literal["warming up", "ready", "failed"]

log = logging.getLogger("tailstack.service")
PERFORM = "tailstack_service.http.computations:perform"
WARM_UP, WARM_UP_OF = "tailstack_service.http.computations:warm_up", ("score", "batch", "optimise")
QUICK_SECONDS = 0.05  # of CPU expected: what may use the process that is kept free, and who waits for it waits so long
OVERRUN_SECONDS = 2.0  # of CPU, after which what was expected to be quick is one of those that take long
BIRTH_SECONDS = 0.1  # of CPU, for a new process to become ready: the price of a kill
MOST_REMEMBERED = 1_000  # tenants
LOOK_SECONDS = 0.25  # between looks whether the caller is still there, and whether the service stops
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
        self.place: asyncio.Future[_Process] = asyncio.get_running_loop().create_future()
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
        self.count, self.waiting, self.seconds, self._most_bytes = count, waiting, seconds, most_bytes
        self.warmth: Warmth = "warming up" if warm else "ready"
        self.readiness: Warmth = self.warmth  # of every lane
        self.kills = 0  # of processes that computed
        self._stopping, self._warm, self._hang_seconds = stopping, warm, hang_seconds
        self._processes: set[_Process] = set()
        self._idle: list[_Process] = []
        self._under_way = 0  # computations under way
        self._long = 0  # those of them that are expected to take long
        self._quick_turns, self._long_turns = FairQueue(), FairQueue()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._warming: asyncio.Task[Any] | None = None

    def begin(self) -> None:
        """Have everything loaded that a computation may need, and then the processes."""
        if self._warm:
            self._warming = self._in_background(self._warm_all())

    async def close(self) -> None:
        """Kill every process and return when they are gone; whoever waits for one is refused by ``run``."""
        self._stopping.set()
        self._idle.clear()
        if self._warming is not None:
            self._warming.cancel()
        for process in list(self._processes):
            process.kill()
            await process.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def wait_until_warm(self, limit_seconds: float) -> None:
        """Return when the kernels are compiled, or cannot be.  Raises TransportError 503 after so many seconds.

        From a cache they are there in a second or two, which is worth waiting for; compiling them takes a minute.
        """
        deadline = self._clock.monotonic() + limit_seconds
        while self.warmth == "warming up" and not self._stopping.is_set():
            if self._clock.monotonic() >= deadline:
                raise _warm_up_error(limit_seconds)
            await self._clock.sleep_async(WARMTH_LOOK_SECONDS)

    def pids(self) -> list[int]:
        """Of the computing processes."""
        return [process.pid for process in self._processes if process.pid is not None]

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
            while not await self._clock.wait_async(task, LOOK_SECONDS):
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
            watch = _Watch(partial(self._may_go_on, computation), partial(self._watch, computation), self._hang_seconds)
            try:
                return await process.compute(computation.call, watch)
            except OutOfDate as error:
                self.warmth = self.readiness = "failed"  # a supervisor or an operator can act
                raise _out_of_date_error(error) from None
            except TimeoutError:
                if computation.taken > self.seconds:
                    raise _too_long_error(self.seconds) from None
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

    async def _has_left(self, request: Request, computation: _Computation, process: _Process) -> bool:
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

    async def _turn(self, computation: _Computation) -> _Process:
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
        last.place.set_exception(self._busy())

    def _serve(self) -> None:
        """Give processes to those whose turn it is."""
        while self._under_way < self.count and (self._idle or len(self._processes) < self.count):
            turns = self._long_turns if self._long_turns and self._long_may_begin() else self._quick_turns
            if not turns or self._stopping.is_set():
                return
            computation = turns.take()
            if computation.place.done():  # given up a moment ago
                continue
            self._under_way += 1
            self._long += not computation.quick
            computation.place.set_result(self._take_idle() or self._start())

    def _take_idle(self) -> _Process | None:
        """A process that waits; those that were killed meanwhile are nobody's loss."""
        while self._idle:
            process = self._idle.pop()
            if not process.ended:
                return process
            self._discard(process)
        return None

    def _long_may_begin(self) -> bool:
        """Whether one process besides is left for what is quick, where there is more than one."""
        return self.count - self._long >= min(2, self.count)

    def _busy(self) -> TransportError:
        detail = f"{self.count} computations are under way and {self.waiting} wait, the limit"
        hint = "send the request again in a few seconds, or start the service with a higher TAILSTACK_MAX_WAITING"
        return TransportError("busy", Problem("", "busy", detail, hint), {"Retry-After": "2"})

    # --- the processes --------------------------------------------------------------------------------

    def _start(self) -> _Process:
        process = _Process(self._most_bytes, warm=self._warm and self.warmth == "ready", clock=self._clock)
        self._processes.add(process)
        return process

    def _leave(self, computation: _Computation, process: _Process) -> None:
        """A computation has ended, and gives its process back."""
        self._under_way -= 1
        self._long -= not computation.quick
        self._give_back(process)

    def _give_back(self, process: _Process) -> None:
        if process.spent or (self._warm and self.warmth == "ready" and not process.warm):
            self._discard(process)
            if self._warm and not self._stopping.is_set():
                self._idle.append(self._start())
        else:
            self._idle.append(process)
        self._serve()

    def _discard(self, process: _Process) -> None:
        self._processes.discard(process)
        self._in_background(process.close())

    async def _warm_all(self) -> None:
        """Whatever was started before everything was loaded makes room for what is forked afterwards."""
        try:
            # where the service stops meanwhile, whoever waits is let go and nothing else
            await asyncio.shield(asyncio.wrap_future(prepare_children(WARM_UP, WARM_UP_OF)))
            self.warmth = "ready"
        except (RuntimeError, OSError) as error:
            if self._stopping.is_set():
                return
            self.warmth = "failed"
            log.error("the kernels cannot be loaded: %s", error, extra={"action": "warm-up-failed"})
        self.readiness = self.warmth
        idle, self._idle = self._idle, []
        for process in idle:
            self._give_back(process)
        while len(self._processes) < self.count and not self._stopping.is_set():
            self._idle.append(self._start())
        self._serve()

    def _in_background(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


@dataclass(frozen=True, slots=True)
class _Watch:
    """Who looks at a computation while it goes on."""

    may_go_on: Callable[[float], bool] = lambda seconds: True  # when it has read what it computes
    look: Callable[[float], None] = lambda seconds: None  # at the s of CPU taken; raises TimeoutError to end it
    hang_seconds: float = inf


class PutBack(Exception):
    """The request was read, and the rest, which will take so many seconds, was left for later."""

    def __init__(self, seconds: float) -> None:
        super().__init__(seconds)
        self.seconds = seconds


class _Process:
    """A computing process, which does one call at a time (``processes.child``)."""

    def __init__(self, most_bytes: int, *, warm: bool, clock: Clock = SYSTEM_CLOCK) -> None:
        """warm: forked when everything was loaded."""
        self._clock = clock
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = start_child(PERFORM, theirs.fileno(), theirs.fileno(), most_bytes)
        self.spent = False  # it has ended, or is to be replaced
        self.killed = False
        self.warm = warm
        self.seconds = 0.0  # of CPU, of the last call
        self._socket = ours
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    @property
    def pid(self) -> int | None:
        """None for one that is not there yet, or never was."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    async def compute(self, call: Callable[[], Any], watch: _Watch | None = None) -> Any:
        """What the call returned.

        Raises Died, Defect, OutOfDate, PutBack, TimeoutError.  Whatever ends the wait but an outcome ends the process.
        """
        self.seconds = 0.0
        try:
            if self._streams is None:
                await asyncio.to_thread(self._process.wait_for_birth)
                self._streams = await asyncio.open_connection(sock=self._socket)
                await self._exchange(bool, _Watch())  # it loads its modules, which is no part of the call
            return await self._exchange(call, watch or _Watch())
        except (EOFError, ConnectionError, ProcessLookupError):  # not every OSError: a TimeoutError is one
            self.kill()
            code = await asyncio.to_thread(self._process.wait)
            if code == OTHER_CODE:
                raise OutOfDate("the files of tailstack were replaced since this process was started") from None
            raise Died(f"the computing process ended with {describe_ending(code)}") from None
        except (Defect, PutBack):
            raise
        except BaseException:
            self.kill()
            raise

    async def _exchange(self, call: Callable[[], Any], watch: _Watch) -> Any:
        assert self._streams is not None
        reader, writer = self._streams
        writer.write(frames.pack(call))
        await writer.drain()
        assert await frames.receive_async(reader) == BEGUN
        put_back: PutBack | None = None
        while isinstance(message := await self._receive(reader, watch), Estimate):
            if not watch.may_go_on(message.seconds):
                put_back = PutBack(message.seconds)
            writer.write(frames.pack(put_back is None))
        outcome, raised, tired, self.seconds = message
        self.spent = tired
        if raised is not None:
            raise Defect(raised)
        if put_back is not None:
            raise put_back
        return outcome

    async def _receive(self, reader: asyncio.StreamReader, watch: _Watch) -> Any:
        """The next message; meanwhile the processor time of the process is looked at.  Raises TimeoutError."""
        receiving = asyncio.ensure_future(frames.receive_async(reader))
        assert self.pid is not None
        pulse, begun = Pulse(self.pid), self._clock.monotonic()
        pulse.look(0.0)
        before = pulse.used_seconds
        try:
            while not await self._clock.wait_async(receiving, LOOK_SECONDS):
                pulse.look(LOOK_SECONDS)
                used = pulse.used_seconds
                passed = self._clock.monotonic() - begun
                watch.look(passed if used is None or before is None else used - before)
                if pulse.silent_seconds >= watch.hang_seconds:
                    raise Died(f"the computing process used no processor time for {pulse.silent_seconds:.0f} s")
            return receiving.result()
        finally:
            receiving.cancel()

    def kill(self) -> None:
        self.spent = self.killed = True
        self._process.kill()

    async def close(self) -> None:
        """Return when the process is gone."""
        self._process.kill()
        if self._streams is None:
            self._socket.close()
        else:
            self._streams[1].close()
        await asyncio.to_thread(self._process.wait)


def _warm_up_error(waited_seconds: float) -> TransportError:
    setting = variable("warm_up_seconds")
    detail = f"the numerical kernels are still being compiled; waited {waited_seconds:g} s ({setting})"
    hint = "send the request again later: GET /health/ready answers 200 when they are there"
    headers = {"Retry-After": str(WARMTH_RETRY_SECONDS)}
    return TransportError("warming-up", Problem("", "warming-up", detail, hint), headers)


def _too_long_error(seconds: float) -> LimitError:
    detail = f"the computation did not finish within the limit of {seconds:g} s"
    hint = "ask for fewer trials, targets or designs, or start the service with a higher TAILSTACK_MAX_SECONDS"
    return LimitError(Problem("", "too-long", detail, hint))


def _out_of_date_error(error: OutOfDate) -> TransportError:
    problem = Problem("", "sources-changed", str(error), "the operator restarts the service")
    return TransportError("stopping", problem, {"Retry-After": "10"})


def stopping_error() -> TransportError:
    """What is said to whoever waits when the service is told to stop."""
    return TransportError(
        "stopping", Problem("", "stopping", "the service was told to stop", "try again later"), {"Retry-After": "10"}
    )
