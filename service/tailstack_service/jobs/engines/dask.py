"""The engine of a cluster: an existing Dask cluster, reached over TLS, whose workers hand each task to a process.

Nothing is kept there: a result is fetched and its future released as soon as it is done, and whatever the cluster
loses is given back and computed again.
"""

# mypy: disable-error-code="no-untyped-call"
# (distributed annotates only part of what it offers)

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from distributed import Client, Security, Worker, WorkerPlugin
from distributed import Future as RemoteFuture
from distributed.scheduler import KilledWorker

from tailstack.errors import Problem
from tailstack.version import __version__

from ...clock import SYSTEM_CLOCK, Clock
from ...environment import variable
from ...problems import RequestError
from ...processes.birth import running_code
from ...processes.task import PERFORM, Defect, Died, GivenBack, Outcome, OutOfDate, Task
from ...settings import Settings
from .pool import PoolEngine

log = logging.getLogger("tailstack.worker")

PLUGIN = f"tailstack-{__version__}"
ANSWER_SECONDS = 10.0  # for the cluster to answer a question, or to hand over a result
CLOSING_SECONDS = 3.0  # to have what is under way killed
LOOK_SECONDS = 1.0  # between looks at how many threads the cluster has
LONG_SECONDS = 30.0  # how long a task may be away before the cluster is asked since when it has been computed
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0  # s between attempts to reach the scheduler


@dataclass(slots=True)
class _RemoteTask:
    key: str
    remote: RemoteFuture[Outcome]
    submitted: float
    begun: float | None = None  # monotonic, as far as the cluster has been asked


class ChildrenPlugin(WorkerPlugin):
    """Ends the computing processes beside a Dask worker when that leaves, say because its scheduler is gone."""

    idempotent = True  # the first client's stays: being replaced would end what other clients have computed

    def teardown(self, worker: Worker) -> None:
        close_beside()


@contextmanager
def _only_critical(name: str) -> Iterator[None]:
    """Meanwhile this logger leaves out what is not critical: engines begin and end it in any order."""

    def is_critical(record: logging.LogRecord) -> bool:
        return record.levelno >= logging.CRITICAL

    logger = logging.getLogger(name)
    logger.addFilter(is_critical)
    try:
        yield
    finally:
        logger.removeFilter(is_critical)


class DaskEngine:
    """A client of the Dask cluster at ``settings.dask_scheduler``.

    The scheduler need not be up: until it is, the capacity is 0.  Raises RequestError for an address without TLS or a
    file that cannot be read.
    """

    name = "dask"

    def __init__(self, settings: Settings, *, function: str = PERFORM, clock: Clock = SYSTEM_CLOCK) -> None:
        self._clock = clock
        self._address, self._security = _require_tls(settings), _make_security(settings)
        self._function, self._hang_seconds = function, settings.hang_seconds
        self._most_bytes = settings.max_process_bytes
        self._lock = threading.Lock()
        self._away: dict[Future[Outcome], _RemoteTask] = {}
        self._client: Client | None = None
        self._threads = 0
        self._kills: SimpleQueue[str] = SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tailstack-dask", daemon=True)
        self._thread.start()

    @property
    def capacity(self) -> int:
        """Threads of the whole cluster."""
        return self._threads if (self._client is not None and self._client.status == "running") else 0

    def submit(self, task: Task, key: str) -> Future[Outcome]:
        local: Future[Outcome] = Future()
        client = self._client
        try:
            if client is None:
                raise GivenBack("there is no connection to the Dask scheduler")
            sent = client.submit(
                compute_beside, task, key, self._function, running_code(), self._hang_seconds, self._most_bytes,
                key=f"tailstack-{key}", pure=False, retries=0,
            )  # fmt: skip
            with self._lock:
                self._away[local] = _RemoteTask(key, sent, self._clock.monotonic())
            sent.add_done_callback(lambda done: self._receive(done, local))
        except GivenBack as error:
            local.set_exception(error)
        except Exception as error:  # whatever a client says whose connection goes away under it
            self._finish(local, GivenBack(f"{type(error).__name__}: {error}"))
        return local

    def seconds(self, future: Future[Outcome]) -> float:
        away = self._away.get(future)
        return 0.0 if away is None or away.begun is None else self._clock.monotonic() - away.begun

    def kill(self, future: Future[Outcome]) -> None:
        with self._lock:
            away = self._away.get(future)
        if away is not None:
            with suppress(Exception):  # without a connection the scheduler drops the task by itself
                away.remote.cancel(reason="tailstack", msg="no longer wanted")
            self._kills.put(away.key)
            self._finish(future, GivenBack("killed"))

    def close(self) -> None:
        with self._lock:
            away = list(self._away)
        for future in away:
            self.kill(future)
        self._closing.set()
        self._thread.join(timeout=CLOSING_SECONDS)

    # --- results ----------------------------------------------------------------------------------

    def _receive(self, done: RemoteFuture[Outcome], local: Future[Outcome]) -> None:
        """In Dask's thread for such calls: fetch the result, release it, hand it over."""
        answer: Outcome | Exception
        try:
            answer = done.result(timeout=ANSWER_SECONDS)
        except (Died, Defect, GivenBack) as error:
            answer = error
        except KilledWorker as error:
            answer = Died(str(error))
        except (Exception, asyncio.CancelledError) as error:  # the cluster's own: scheduler gone, worker lost, ...
            answer = GivenBack(f"{type(error).__name__}: {error}")
        with suppress(Exception):
            done.release()
        self._finish(local, answer)

    def _finish(self, local: Future[Outcome], answer: Outcome | Exception) -> None:
        with self._lock:
            self._away.pop(local, None)
            if local.done():
                return
            done = local.set_running_or_notify_cancel()
        if not done:
            return
        if isinstance(answer, Exception):
            local.set_exception(answer)
        else:
            local.set_result(answer)

    # --- the connection ---------------------------------------------------------------------------

    @_only_critical("distributed.client")  # its tracebacks are of what is said here in a line
    def _run(self) -> None:
        """Connect, again and again; count the threads; kill what is to be killed."""
        pause = FIRST_PAUSE
        while not self._closing.is_set():
            try:
                if self._client is None:
                    self._client = Client(
                        self._address, security=self._security, timeout=ANSWER_SECONDS, set_as_default=False
                    )
                    log.info("connected to the Dask scheduler %s", self._address, extra={"action": "dask-connected"})
                self._serve(self._client)
                pause = FIRST_PAUSE
            except Exception as error:
                lost, self._client, self._threads = self._client, None, 0
                # One that has lost its scheduler takes seconds to close, and the next need not wait for that
                threading.Thread(target=_close, args=(lost,), name="tailstack-dask-closing", daemon=True).start()
                self._give_everything_back()
                if not self._closing.is_set():
                    words = "the connection to the Dask scheduler is lost, what was away is given back: %s: %s"
                    log.warning(words, type(error).__name__, error, extra={"action": "dask-lost", "seconds": pause})
                self._clock.wait(self._closing, pause)
                pause = min(2 * pause, LONGEST_PAUSE)
        with suppress(Exception):
            if self._client is not None:
                self._kill_ordered(self._client, wait=0.0)
        _close(self._client)
        self._client = None

    def _serve(self, client: Client) -> None:
        """One look at the cluster.  Raises whatever the client raises when the connection is lost."""
        if client.status not in ("running", "connecting"):
            raise GivenBack(f"the client is {client.status}")
        if client.status == "running":
            threads = sum(client.nthreads(callback_timeout=ANSWER_SECONDS).values())
            if threads != self._threads:
                log.info("the Dask cluster has %d threads", threads, extra={"action": "dask-capacity"})
            self._threads = threads
            self._ask_when_begun(client)
            # Again and again: the scheduler may be another one by now
            client.register_plugin(ChildrenPlugin(), name=PLUGIN)
        self._kill_ordered(client, wait=LOOK_SECONDS)

    def _ask_when_begun(self, client: Client) -> None:
        now = self._clock.monotonic()
        with self._lock:
            long = {a.key: a for a in self._away.values() if a.begun is None and now - a.submitted > LONG_SECONDS}
        if long:
            for seconds in client.run(list_seconds, on_error="ignore", callback_timeout=ANSWER_SECONDS).values():
                for key in seconds.keys() & long.keys():
                    long[key].begun = now - seconds[key]

    def _kill_ordered(self, client: Client, wait: float) -> None:
        keys = []
        with suppress(Empty):
            keys.append(self._kills.get(timeout=wait) if wait else self._kills.get_nowait())
            while True:
                keys.append(self._kills.get_nowait())
        if keys:
            client.run(kill_beside, keys, on_error="ignore", callback_timeout=ANSWER_SECONDS)

    def _give_everything_back(self) -> None:
        with self._lock:
            away = list(self._away)
        for future in away:
            self._finish(future, GivenBack("the connection to the Dask scheduler was lost"))


def _close(client: Client | None) -> None:
    if client is not None:
        with suppress(Exception):
            client.close(timeout=CLOSING_SECONDS)


def _require_tls(settings: Settings) -> str:
    if settings.dask_scheduler.startswith("tls://"):
        return settings.dask_scheduler
    detail = "must be tls://HOST:PORT: who can reach a Dask cluster without TLS can run code on it"
    raise _setting_error("dask_scheduler", detail)


def _make_security(settings: Settings) -> Any:
    names = {"tls_ca_file": "dask_ca_file", "tls_client_cert": "dask_cert_file", "tls_client_key": "dask_key_file"}
    files = {option: getattr(settings, name) for option, name in names.items()}
    for option, path in files.items():
        if not path or not Path(path).is_file():
            raise _setting_error(names[option], f"must name a file; got {path!r}")
    return Security(require_encryption=True, **files)


def _setting_error(name: str, detail: str) -> RequestError:
    return RequestError(Problem("", "bad-setting", f"{variable(name)} {detail}", "docs/settings.md lists them all"))


# --- on a Dask worker --------------------------------------------------------------------------------------

# A task is handed to a computing process beside the Dask worker: that can be killed when its job is cancelled, is the
# only victim of a crash, and is the only thread in solvers that keep their state in globals, however many threads the
# Dask worker has.
MOST_PROCESSES = 1_000  # no limit: there are as many as the Dask worker has threads
_lock = threading.Lock()
_engines: dict[str, PoolEngine] = {}  # by function: one Dask worker serves every client that knows it
_computed: dict[str, tuple[PoolEngine, Future[Outcome]]] = {}  # by key, at this moment


def compute_beside(task: Task, key: str, function: str, version: str, hang_seconds: float, most_bytes: int) -> Outcome:
    """Compute in a process of its own.  Raises Died, Defect, GivenBack."""
    if version != running_code():
        raise GivenBack(f"this Dask worker has tailstack {running_code()}, the job was claimed by {version}")
    with _lock:
        if function not in _engines:
            _engines[function] = PoolEngine(
                MOST_PROCESSES, function=function, hang_seconds=hang_seconds, most_bytes=most_bytes, ahead=0
            )
        engine = _engines[function]
        future = engine.submit(task, key)
        _computed[key] = engine, future
    try:
        return future.result()
    except CancelledError:
        raise GivenBack("its process was stopped") from None
    except OutOfDate as error:  # this Dask worker is, and not the worker that asks it
        raise GivenBack(f"a Dask worker is to be started again: {error}") from None
    finally:
        del _computed[key]


def list_seconds() -> dict[str, float]:
    """For how long each task has been computed on this Dask worker, s, by key."""
    return {key: engine.seconds(future) for key, (engine, future) in list(_computed.items())}


def kill_beside(keys: list[str]) -> None:
    """Kill the processes that compute these; called on every Dask worker."""
    for key in keys:
        if key in _computed:
            engine, future = _computed[key]
            engine.kill(future)


def close_beside() -> None:
    """The Dask worker is leaving: what is computed here would keep it until it is done, and then be lost."""
    with _lock:
        engines = list(_engines.values())
        _engines.clear()
    for engine in engines:
        engine.close()
