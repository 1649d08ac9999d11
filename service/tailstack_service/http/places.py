"""Places to compute for callers who wait: processes that can be killed, shared among tenants who take turns.

An API process computes nothing itself.  Each computation is sent to one of a few processes, under the limit of
``TAILSTACK_MAX_SECONDS``; it is given up, and its process killed and replaced, when it takes longer, when the caller
leaves, and when the service stops.

Who waits is served by tenant in turn.  What is expected to take long leaves one process free for what is expected to
be quick, so that nobody's small score waits for anybody's large one.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Literal, TypeVar

from starlette.requests import Request

from tailstack.errors import LimitError, Problem, TailstackError

from ..names import variable
from ..operations.sent import Placed
from ..problems import TransportError
from ..processes import frames
from ..processes.frames import BEGUN, OTHER_CODE, Defect, Died, OutOfDate
from ..processes.interpreter import describe_ending, start_child
from .computations import Refusal, warm_up

T = TypeVar("T")
Warmth = Literal["warming up", "ready", "failed"]

log = logging.getLogger("tailstack.service")
PERFORM = "tailstack_service.http.computations:perform"
QUICK_SECONDS = 0.05  # of CPU expected: what may use the process that is kept free, and who waits for it waits so long
OVERRUN_SECONDS = 2.0  # after which something that was expected to be quick begins anew among what takes long
LOOK_SECONDS = 0.25  # between looks whether the caller is still there, and whether the service stops
WARMTH_LOOK_SECONDS, WARMTH_RETRY_SECONDS = 0.02, 5
WORTH_SECONDS = 1.0  # of computing: what has taken less is finished for a caller who left, a new process costs more


class CallerLeft(Exception):
    """Nobody waits for the answer any more."""


class RefusalError(TailstackError):
    """A refusal that a computing process came to."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.problems)
        self.slug, self.title = refusal.slug, refusal.title


class Turns:
    """Who waits, by tenant: every tenant has its turn, however many of another's are before it."""

    def __init__(self) -> None:
        self._lines: dict[str, deque[_Computation]] = {}  # in the order of their next turn

    def __len__(self) -> int:
        return sum(map(len, self._lines.values()))

    def put(self, computation: _Computation) -> None:
        self._lines.setdefault(computation.tenant, deque()).append(computation)

    def take(self) -> _Computation:
        """The next one; its tenant comes last from now on."""
        tenant = next(iter(self._lines))
        line = self._lines.pop(tenant)
        computation = line.popleft()
        if line:
            self._lines[tenant] = line
        return computation

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

    def __init__(self, tenant: str, call: Callable[[], Any], quick: bool) -> None:
        self.tenant, self.call, self.quick = tenant, call, quick
        self.place: asyncio.Future[_Process]
        self.begun: float | None = None

    def begin(self) -> None:
        """The clock starts when computing starts, not while waiting for a place or for a new process."""
        self.begun = time.monotonic()

    @property
    def worth_killing(self) -> bool:
        return self.begun is None or time.monotonic() - self.begun > WORTH_SECONDS


class Places:
    """``count`` computing processes and those who wait for one of them, at most ``waiting``.

    ``warm``: the processes are started by :meth:`begin` and load every kernel before their first computation;
    otherwise each is started when it is needed, and loads what it needs.  For one event loop.
    """

    def __init__(
        self, count: int, waiting: int, seconds: float, stopping: threading.Event, *, warm: bool = False
    ) -> None:
        self.count, self.waiting, self.seconds = count, waiting, seconds
        self.warmth: Warmth = "warming up" if warm else "ready"
        self._stopping, self._warm = stopping, warm
        self._processes: set[_Process] = set()
        self._idle: list[_Process] = []
        self._long = 0  # computations under way that are expected to take long
        self._warming = 0
        self._quick_turns, self._long_turns = Turns(), Turns()
        self._tasks: set[asyncio.Task[Any]] = set()

    def begin(self) -> None:
        """Start the processes and make them ready, one after the other."""
        if self._warm:
            self._in_background(self._warm_all())

    async def close(self) -> None:
        """Kill every process and return when they are gone; whoever waits for one is refused by ``run``."""
        self._stopping.set()
        self._idle.clear()
        for process in list(self._processes):
            process.kill()
            await process.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def wait_until_warm(self, limit_seconds: float) -> None:
        """Return when the kernels are compiled, or cannot be.  Raises TransportError 503 after so many seconds.

        From a cache they are there in a second or two, which is worth waiting for; compiling them takes a minute.
        """
        deadline = time.monotonic() + limit_seconds
        while self.warmth == "warming up" and not self._stopping.is_set():
            if time.monotonic() >= deadline:
                raise _warm_up_error(limit_seconds)
            await asyncio.sleep(WARMTH_LOOK_SECONDS)

    def pids(self) -> list[int]:
        """Of the computing processes."""
        return [process.pid for process in self._processes]

    async def run(self, request: Request, call: Callable[[], T], expected_seconds: float) -> T:
        """What the call returns, which has to be a function of a module with plain arguments (``partial``).

        Raises Placed around RefusalError for what the call refuses, LimitError (too long), TransportError (busy,
        stopping), CallerLeft, and Died or Defect for what should not happen.
        """
        if self._stopping.is_set():
            raise stopping_error()
        computation = _Computation(request.state.caller.tenant, call, expected_seconds <= QUICK_SECONDS)
        task = asyncio.ensure_future(self._compute(computation))
        task.add_done_callback(lambda task: task.cancelled() or task.exception())  # nobody may be there to look
        try:
            while not (await asyncio.wait({task}, timeout=LOOK_SECONDS))[0]:
                if self._stopping.is_set():
                    raise stopping_error()
                if computation.worth_killing and await request.is_disconnected():
                    raise CallerLeft
            outcome = task.result()
        finally:
            task.cancel()
        if isinstance(outcome, Refusal):
            raise Placed(RefusalError(outcome), outcome.prefix)
        return outcome  # type: ignore[no-any-return]

    async def _compute(self, computation: _Computation) -> Any:
        while True:
            process = await self._turn(computation)
            may_overrun = computation.quick and self.count > 1 and self.seconds > OVERRUN_SECONDS
            seconds = OVERRUN_SECONDS if may_overrun else self.seconds
            try:
                return await process.compute(computation.call, computation.begin, seconds)
            except OutOfDate as error:
                self.warmth = "failed"  # readiness says so, and a supervisor or an operator can act
                raise _out_of_date_error(error) from None
            except TimeoutError:
                late = {"action": "computation-killed", "pid": process.pid, "seconds": seconds}
                log.info("a computation took longer than %g s, and its process was killed", seconds, extra=late)
                if not may_overrun:
                    raise _too_long_error(self.seconds) from None
            finally:
                self._long -= not computation.quick
                self._give_back(process)
            computation.quick, computation.begun = False, None

    # --- whose turn it is ---------------------------------------------------------------------------

    async def _turn(self, computation: _Computation) -> _Process:
        """A process, when it is this one's turn.  Raises TransportError when too many wait."""
        computation.place = asyncio.get_running_loop().create_future()
        turns = self._quick_turns if computation.quick else self._long_turns
        turns.put(computation)
        self._serve()
        if len(self._quick_turns) + len(self._long_turns) > self.waiting:
            self._refuse_one(computation)
        try:
            return await computation.place
        except asyncio.CancelledError:
            turns.remove(computation)
            if computation.place.done() and not computation.place.cancelled():
                self._long -= not computation.quick
                self._give_back(computation.place.result())
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
        while self._idle or len(self._processes) < self.count:
            turns = self._long_turns if self._long_turns and self._long_may_begin() else self._quick_turns
            if not turns or self._stopping.is_set():
                return
            computation = turns.take()
            if computation.place.done():  # given up a moment ago
                continue
            self._long += not computation.quick
            computation.place.set_result(self._idle.pop() if self._idle else self._start())

    def _long_may_begin(self) -> bool:
        """Whether one process besides is left for what is quick, where there is more than one."""
        return self.count - self._long - self._warming >= min(2, self.count)

    def _busy(self) -> TransportError:
        detail = f"{self.count} computations are under way and {self.waiting} wait, the limit"
        hint = "send the request again in a few seconds, or start the service with a higher TAILSTACK_MAX_WAITING"
        return TransportError("busy", Problem("", "busy", detail, hint), {"Retry-After": "2"})

    # --- the processes --------------------------------------------------------------------------------

    def _start(self) -> _Process:
        process = _Process()
        self._processes.add(process)
        return process

    def _give_back(self, process: _Process) -> None:
        if process.spent:
            self._processes.discard(process)
            self._in_background(process.close())
            if self._warm and self.warmth != "warming up" and not self._stopping.is_set():
                self._in_background(self._make_warm(self._start()))
        elif self._warm and self.warmth == "ready" and not process.warm:
            self._in_background(self._make_warm(process))
        else:
            self._idle.append(process)
        self._serve()

    async def _warm_all(self) -> None:
        """The first process compiles what the others then find in the cache."""
        first = self._start()
        await self._make_warm(first)
        self.warmth = "ready" if first.warm else "failed"
        for cold in [process for process in self._idle if not process.warm]:
            self._idle.remove(cold)
            await self._make_warm(cold)
        while len(self._processes) < self.count and self.warmth == "ready" and not self._stopping.is_set():
            await self._make_warm(self._start())

    async def _make_warm(self, process: _Process) -> None:
        """Load the kernels into a process, and let it be used."""
        self._warming += 1
        try:
            await process.compute(warm_up)
            process.warm = True
        except (Defect, Died, OutOfDate) as error:
            if not self._stopping.is_set():
                log.error("a process cannot load its kernels: %s", error, extra={"action": "warm-up-failed"})
        finally:
            self._warming -= 1
            if process.spent:
                self._processes.discard(process)
                await process.close()
            else:
                self._idle.append(process)
            self._serve()

    def _in_background(self, work: Coroutine[Any, Any, Any]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class _Process:
    """A computing process, which does one call at a time (``compute.child``)."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._popen = start_child(PERFORM, theirs.fileno(), theirs.fileno())
        self.pid = self._popen.pid
        self.spent = False  # it has ended, or is to be replaced
        self.warm = False
        self._socket = ours
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def compute(
        self, call: Callable[[], Any], begin: Callable[[], None] = lambda: None, seconds: float | None = None
    ) -> Any:
        """What the call returned.  ``begin`` is called when it begins, and it may take ``seconds`` from then on.

        Raises Died, Defect, OutOfDate, TimeoutError.  Whatever ends the wait but an outcome ends the process.
        """
        try:
            if self._streams is None:
                self._streams = await asyncio.open_connection(sock=self._socket)
                await self._exchange(bool)  # it loads its modules, which is no part of the call
            return await self._exchange(call, begin, seconds)
        except (EOFError, ConnectionError):  # not every OSError: a TimeoutError is one
            self.kill()
            code = self._popen.wait()
            if code == OTHER_CODE:
                raise OutOfDate("the files of tailstack were replaced since this process was started") from None
            raise Died(f"the computing process ended with {describe_ending(code)}") from None
        except Defect:
            raise
        except BaseException:
            self.kill()
            raise

    async def _exchange(
        self, call: Callable[[], Any], begin: Callable[[], None] = lambda: None, seconds: float | None = None
    ) -> Any:
        assert self._streams is not None
        reader, writer = self._streams
        writer.write(frames.pack(call))
        await writer.drain()
        assert await frames.receive_async(reader) == BEGUN
        begin()
        async with asyncio.timeout(seconds):
            outcome, raised, tired = await frames.receive_async(reader)
        self.spent = tired
        if raised is not None:
            raise Defect(raised)
        return outcome

    def kill(self) -> None:
        self.spent = True
        self._popen.kill()

    async def close(self) -> None:
        """Return when the process is gone."""
        self._popen.kill()
        if self._streams is None:
            self._socket.close()
        else:
            self._streams[1].close()
        await asyncio.to_thread(self._popen.wait)


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
