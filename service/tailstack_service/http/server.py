"""Serving: a listening socket, API processes behind it, a worker beside them, and a stop that leaves nobody behind."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, cast

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.supervisors.multiprocess import SIGNALS, Multiprocess

from tailstack.errors import Problem

from ..clock import SYSTEM_CLOCK, Clock
from ..environment import COUNTERS, temporary_directory, variable
from ..jobs.store.schema import open_database
from ..logs import log_to_stderr
from ..problems import RequestError
from ..processes.birth import Nursery, join_nursery, share_nursery
from ..settings import Settings
from .access import is_loopback, read_token_settings
from .answers import read_root_path

if TYPE_CHECKING:
    from fastapi import FastAPI

log = logging.getLogger("tailstack.service")
DEFAULT_PORT = 8321
BACKLOG = 1024
ANSWER_SECONDS = 8  # for an API process to say that it lives; one that has just been started is busy importing
GRACE_SECONDS = 6  # for answers that are being written when the service is told to stop; in all it takes 10
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 10.0  # seconds before a process that ended is started again
IDLE_SECONDS = 30  # of a connection that may be used again; clients keep one for 4 or 5 s, and must not lose the race
LAST_SECONDS = 2.0  # for what a client still sends that has its last answer
GOOD_SECONDS = 30.0  # a process that lived so long did not fail at its start
START_LOOK_SECONDS = 0.02  # between looks whether an embedded service has started
STOP_SECONDS = 9.0  # for a process to end by itself when told to


def bind(host: str, port: int, settings: Settings) -> socket.socket:
    """A listening socket.  Raises RequestError for a public address without authentication."""
    if settings.auth != "required" and not is_loopback(host):
        detail = f"{host} can be reached from other machines, and {variable('auth')} is none"
        hint = f"serve on 127.0.0.1, or make a key (tailstack keys create) and set {variable('auth')}=required"
        raise RequestError(Problem("", "not-loopback", detail, hint))
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            bound.listen(BACKLOG)  # what connects before the service is up waits instead of being refused
        except OSError:
            bound.close()
            raise
    except OSError as error:
        detail = f"cannot listen on {host} port {port}: {error.strerror or error}"
        hint = "choose another port, or --port 0 for any free one"
        raise RequestError(Problem("", "cannot-listen", detail, hint)) from None
    bound.set_inheritable(False)
    return bound


def address_of(bound: socket.socket) -> str:
    """URL of a listening socket."""
    host, port = bound.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def serve(
    bound: socket.socket, settings: Settings, *, worker: bool = True, announce: Callable[[], None] | None = None
) -> None:
    """Serve until SIGTERM (returns) or SIGINT (raises KeyboardInterrupt); no process is left behind.

    A SQLite database is created or brought up to date first; then ``announce`` is called.  Raises StoreError for a
    database that cannot be used, RequestError for settings of authentication that cannot work.
    """
    read_token_settings(settings)
    read_root_path(settings)
    open_database(settings.database_url, migrate=True).close()
    family = _Family(settings, worker)
    run = _serve_with_several if settings.api_processes > 1 else _serve_here
    try:
        run(bound, settings, family, announce or (lambda: None))
    finally:
        family.stop()


def _config(app: Callable[[], FastAPI], settings: Settings) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        factory=True,
        http=_PatientProtocol,
        ws="none",
        lifespan="on",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,  # nothing here depends on who the client is, or how he came
        timeout_graceful_shutdown=GRACE_SECONDS,
        timeout_keep_alive=IDLE_SECONDS,
        backlog=BACKLOG,
        timeout_worker_healthcheck=ANSWER_SECONDS,
        workers=settings.api_processes,
    )


class _PatientTransport:
    """A connection that is closed so that its last answer is read.

    Closed beside bytes that nobody took it is reset, and a reset may overtake the answer.  So while the other side is
    still sending, only this side ends at once; what comes is read off for a moment.
    """

    def __init__(self, transport: asyncio.Transport, connection: h11.Connection) -> None:
        self._transport, self._connection, self._left = transport, connection, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def is_closing(self) -> bool:
        return self._left or self._transport.is_closing()

    def close(self) -> None:
        if self.is_closing() or self._connection.their_state not in (h11.SEND_BODY, h11.ERROR):
            self._transport.close()
            return
        self._left = True
        self._transport.write_eof()
        self._transport.resume_reading()
        asyncio.get_running_loop().call_later(LAST_SECONDS, self._transport.close)


class _PatientProtocol(H11Protocol):
    """HTTP by h11: strict; httptools takes two Host headers and endless heads, and loses a body beside an upgrade."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(cast(asyncio.Transport, _PatientTransport(transport, self.conn)))

    def data_received(self, data: bytes) -> None:
        if not self.transport.is_closing():
            super().data_received(data)


class _Family:
    """The child processes of a service."""

    def __init__(self, settings: Settings, worker: bool, log: IO[bytes] | None = None) -> None:
        self.children: list[RestartedProcess] = []
        if worker:
            from ..jobs.worker import start_worker_process

            self.children.append(RestartedProcess("worker", lambda: start_worker_process(settings, log)))

    def stop_with(self, stopping: threading.Event) -> None:
        """Tell them to end as soon as the event is set, while this process is still busy ending itself."""

        def wait() -> None:
            stopping.wait()
            self.terminate()

        threading.Thread(target=wait, name="tailstack-family", daemon=True).start()

    def terminate(self) -> None:
        for child in self.children:
            child.terminate()

    def stop(self) -> None:
        self.terminate()
        for child in self.children:
            child.stop()


def _serve_here(bound: socket.socket, settings: Settings, family: _Family, announce: Callable[[], None]) -> None:
    stopped: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        """Before uvicorn listens to signals, which is seconds later; and once more when it has stopped, for nothing."""
        stopped.append(number)

    previous = signal.signal(signal.SIGTERM, on_signal)
    try:
        announce()  # whoever reads it may send a signal at once
        from .app import create_app  # the web framework takes a second: the worker starts meanwhile

        app = create_app(settings)
        family.stop_with(app.state.service.stopping)
        server = uvicorn.Server(_config(lambda: app, settings))
        if not stopped:
            server.run(sockets=[bound])
    finally:
        signal.signal(signal.SIGTERM, previous)


def _serve_with_several(
    bound: socket.socket, settings: Settings, family: _Family, announce: Callable[[], None]
) -> None:
    stopped: list[int] = []  # not an Event: a signal could interrupt this thread while it holds its lock
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _frame: stopped.append(number))
    try:
        announce()
        with tempfile.TemporaryDirectory(prefix="tailstack-counters-", dir=temporary_directory()) as counters:
            os.environ[COUNTERS] = counters
            supervisor = _Supervisor(_config(partial(_app_of_child, settings, share_nursery()), settings), [bound])
            supervisor.signal_queue += stopped
            family.stop_with(supervisor.should_exit)
            supervisor.run()
    finally:
        os.environ.pop(COUNTERS, None)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if supervisor.end_signal == signal.SIGINT:
        raise KeyboardInterrupt
    if supervisor.end_signal is None:
        raise RequestError(Problem("", "cannot-serve", "an API process did not start", "stderr says why"))


class _Supervisor(Multiprocess):
    """uvicorn's own, which says which signal ended it."""

    end_signal: signal.Signals | None = None

    def handle_int(self) -> None:
        self.end_signal = signal.SIGINT
        super().handle_int()

    def handle_term(self) -> None:
        self.end_signal = self.end_signal or signal.SIGTERM
        super().handle_term()


def _app_of_child(settings: Settings, nursery: Nursery | None) -> FastAPI:
    """The application of one of several API processes, in that process; nursery: the parent's."""
    if nursery is not None:
        join_nursery(nursery)
    log_to_stderr(settings.log_format)
    from .app import create_app

    return create_app(settings)


@contextmanager
def running_service(
    settings: Settings | None = None, *, warm_up: bool = True, worker: bool = False, worker_log: Path | None = None,
    clock: Clock = SYSTEM_CLOCK,
) -> Iterator[tuple[str, int]]:  # fmt: skip
    """The service in a thread of this process; yields its loopback host and (free) port once it answers.

    Without a database in the settings it has one of its own, which goes with it.  ``worker`` adds a worker process,
    whose log lines go to the file ``worker_log``, by default to stderr.
    Neither can outlive this process, and both stop when the block is left, whatever way.
    """
    with ExitStack() as stack:
        settings = settings or Settings()
        if not settings.database:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tailstack-"))
            settings = settings.model_copy(update={"database": f"sqlite:///{Path(folder) / 'jobs.sqlite3'}"})
        open_database(settings.database_url, migrate=True).close()
        log = None if worker_log is None else stack.enter_context(worker_log.open("wb"))
        family = _Family(settings, worker, log)
        stack.callback(family.stop)
        bound = bind("127.0.0.1", 0, settings)
        from .app import create_app

        app = create_app(settings, warm_up=warm_up, clock=clock)
        server = uvicorn.Server(_config(lambda: app, settings.model_copy(update={"api_processes": 1})))
        thread = threading.Thread(target=server.run, args=([bound],), name="tailstack-service", daemon=True)
        thread.start()
        stack.callback(thread.join)

        def stop() -> None:
            family.terminate()
            app.state.service.stopping.set()
            server.should_exit = True

        stack.callback(stop)
        while not server.started:
            if not thread.is_alive():
                raise RequestError(Problem("", "cannot-serve", "the embedded service did not start"))
            thread.join(START_LOOK_SECONDS)
        yield bound.getsockname()[:2]


class RestartedProcess:
    """A child process that is started again, more and more slowly, whenever it ends.  ``start`` makes the Popen.

    The child holds the other end of its stdin and ends with it, so that it never outlives this process.
    """

    def __init__(self, name: str, start: Callable[[], subprocess.Popen[bytes]], *, clock: Clock = SYSTEM_CLOCK) -> None:
        self.name, self._clock = name, clock
        self._start = start
        self._changing = threading.Lock()
        self._stopping = threading.Event()
        self._process = start()
        self._stopped_at: float | None = None
        self._thread = threading.Thread(target=self._respawn, name=f"tailstack-keep-{name}", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def _respawn(self) -> None:
        pause, begun = FIRST_PAUSE, self._clock.monotonic()
        while True:
            code = self._process.wait()
            if self._stopping.is_set():
                return
            pause = FIRST_PAUSE if self._clock.monotonic() - begun > GOOD_SECONDS else pause
            fields = {"action": "child-ended", "kind": self.name, "pid": self.pid, "status": code, "seconds": pause}
            log.warning("the %s process ended; it is started again in %g s", self.name, pause, extra=fields)
            if self._clock.wait(self._stopping, pause):
                return
            pause = min(2 * pause, LONGEST_PAUSE)
            with self._changing:
                if self._stopping.is_set():
                    return
                begun = self._clock.monotonic()
                try:
                    started = self._start()
                except OSError:  # no memory or no process to be had just now: the old one is waited for again
                    failure = {"action": "child-not-started", "kind": self.name}
                    log.exception("the %s process could not be started; it is tried again", self.name, extra=failure)
                    continue
                _close(self._process)
                self._process = started

    def terminate(self) -> None:
        """Ask the process to end, and start no other.  Returns at once; may be called more than once."""
        self._stopping.set()
        self._stopped_at = self._stopped_at or self._clock.monotonic()
        with self._changing:
            if self._process.poll() is None:
                self._process.terminate()

    def stop(self) -> None:
        """Return when the process has ended, killed if it takes too long."""
        self.terminate()
        assert self._stopped_at is not None
        try:
            self._process.wait(max(self._stopped_at + STOP_SECONDS - self._clock.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            late = {"action": "child-killed", "kind": self.name, "pid": self.pid}
            log.warning("the %s process did not end when told to, and is killed", self.name, extra=late)
            self._process.kill()
            self._process.wait()
        self._thread.join()
        _close(self._process)


def _close(process: subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        process.stdin.close()
