"""Serving: a listening socket, API processes behind it, a worker beside them, and a stop that leaves nobody behind."""

from __future__ import annotations

import asyncio
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import IO

import uvicorn

from tailstack.errors import Problem

from ..compute.interpreter import command, environment
from ..problems import RequestError
from ..settings import Settings, told_to_child, variable
from ..store.database import open_database
from .accepting import Taking
from .access import check_settings, is_loopback
from .keeping import Kept

DEFAULT_PORT = 8321
BACKLOG = 1024
LOOK_SECONDS = 0.1  # between looks whether a signal came
GRACE_SECONDS = 10  # for answers that are being written when the service is told to stop
SHARED_COUNTERS = "PROMETHEUS_MULTIPROC_DIR"  # prometheus_client reads it when it is imported


def bind(host: str, port: int, settings: Settings) -> socket.socket:
    """A listening socket.  Raises RequestError for an address that others can reach while nobody is asked who he is."""
    if settings.auth != "required" and not is_loopback(host):
        raise RequestError(
            Problem(
                "",
                "not-loopback",
                f"{host} can be reached from other machines, and {variable('auth')} is none",
                f"serve on 127.0.0.1, or make a key (tailstack keys create) and set {variable('auth')}=required",
            )
        )
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
        raise RequestError(
            Problem(
                "",
                "cannot-listen",
                f"cannot listen on {host} port {port}: {error.strerror or error}",
                "choose another port, or --port 0 for any free one",
            )
        ) from None
    bound.set_inheritable(False)
    return bound


def address_of(bound: socket.socket) -> str:
    """URL of a listening socket."""
    host, port = bound.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class Server(uvicorn.Server):
    """Tells everything that waits to stop as soon as the signal comes, not when it is done."""

    def __init__(self, settings: Settings, *, warm_up: bool = True, on_stop: Callable[[], None] | None = None) -> None:
        from .app import create_app  # the web framework takes a third of a second: the worker starts meanwhile
        from .connections import connections

        app = create_app(settings, warm_up=warm_up)
        super().__init__(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="on",
                http=connections(settings),
                timeout_graceful_shutdown=GRACE_SECONDS,
                server_header=False,
                proxy_headers=False,  # nothing here depends on who the client is, or how he came
                ws="none",
                backlog=BACKLOG,
            )
        )
        self.service = app.state.service
        self._on_stop = on_stop

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        if self.service.settings.api_processes == 1 or not sockets:
            await super().startup(sockets)
            return
        await super().startup([])

        def connection() -> asyncio.Protocol:
            kind: Callable[..., asyncio.Protocol] = self.config.http_protocol_class
            return kind(config=self.config, server_state=self.server_state, app_state=self.lifespan.state)

        count = lambda: len(self.server_state.connections)  # noqa: E731
        self.servers = [Taking(bound, connection, count) for bound in sockets]  # type: ignore[misc]

    def tell(self) -> None:
        """Begin to stop: no new connections, and whatever waits ends.  From any thread, and from a signal handler."""
        if not self.service.stopping.is_set():
            self.service.stopping.set()
        self.should_exit = True
        if self._on_stop is not None:
            self._on_stop()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        super().handle_exit(sig, frame)  # first: it takes a stop that is under way for a second Ctrl-C
        self.tell()


def serve(
    bound: socket.socket, settings: Settings, *, worker: bool = True, announce: Callable[[], None] | None = None
) -> None:
    """Serve until SIGTERM (returns) or SIGINT (raises KeyboardInterrupt); no process is left behind.

    A SQLite database is created or brought up to date first; then ``announce`` is called.  Raises StoreError for a
    database that cannot be used, RequestError for settings of authentication that cannot work.
    """
    check_settings(settings)
    open_database(settings.database_url, migrate=True).close()
    kept = _Family(settings, worker)
    run = _serve_with_several if settings.api_processes > 1 else _serve_here
    try:
        run(bound, settings, kept, announce or (lambda: None))
    finally:
        kept.stop()


class _Family:
    """The child processes of a service."""

    def __init__(self, settings: Settings, worker: bool, log: IO[bytes] | None = None) -> None:
        self.children: list[Kept] = []
        if worker:
            from ..worker.process import start_worker_process

            self.children.append(Kept("worker", lambda: start_worker_process(settings, log)))

    def tell(self) -> None:
        for child in self.children:
            child.tell()

    def stop(self) -> None:
        self.tell()
        for child in self.children:
            child.stop()


def _serve_here(bound: socket.socket, settings: Settings, kept: _Family, announce: Callable[[], None]) -> None:
    stopped: list[int] = []
    servers: list[Server] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        """Before uvicorn listens to signals, which is seconds later; and once more when it has stopped, for nothing."""
        stopped.append(number)
        for server in servers:
            server.tell()

    previous = signal.signal(signal.SIGTERM, on_signal)
    try:
        announce()  # whoever reads it may send a signal at once
        servers.append(Server(settings, on_stop=kept.tell))
        if not stopped:
            servers[0].run(sockets=[bound])
    finally:
        signal.signal(signal.SIGTERM, previous)


def _serve_with_several(bound: socket.socket, settings: Settings, kept: _Family, announce: Callable[[], None]) -> None:
    stopped: list[int] = []  # not an Event: a signal could interrupt this thread while it holds its lock

    def on_signal(number: int, _frame: FrameType | None) -> None:
        stopped.append(number)

    previous = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        announce()
        with tempfile.TemporaryDirectory(prefix="tailstack-counters-") as counters:
            for number in range(settings.api_processes):
                start = lambda: _start_api_process(bound, settings, counters)  # noqa: E731
                kept.children.append(Kept(f"api-{number + 1}", start))
            while not stopped:
                time.sleep(LOOK_SECONDS)
            kept.stop()
            bound.close()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if signal.SIGINT in stopped:
        raise KeyboardInterrupt


def _start_api_process(bound: socket.socket, settings: Settings, counters: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        command("tailstack_service.http.child", str(bound.fileno())),
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        pass_fds=(bound.fileno(),),
        process_group=0,  # a Ctrl-C in a terminal is for this process to act on
        env={**told_to_child(settings, environment()), SHARED_COUNTERS: counters},
    )


@contextmanager
def running_service(
    settings: Settings | None = None, *, warm_up: bool = True, worker: bool = False, worker_log: Path | None = None
) -> Iterator[tuple[str, int]]:
    """The service in a thread of this process; yields its loopback host and (free) port once it answers.

    Without a database in the settings it has one of its own, which goes with it.  ``worker`` adds a worker process,
    whose log lines go to the file ``worker_log``, by default to stderr.
    Neither can outlive this process, and both stop when the block is left, whatever way.
    """
    with ExitStack() as stack:
        settings = settings or Settings()
        if not settings.database:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tailstack-"))
            settings = replace(settings, database=f"sqlite:///{Path(folder) / 'jobs.sqlite3'}")
        open_database(settings.database_url, migrate=True).close()
        log = None if worker_log is None else stack.enter_context(worker_log.open("wb"))
        family = _Family(settings, worker, log)
        stack.callback(family.stop)
        bound = bind("127.0.0.1", 0, settings)
        server = Server(replace(settings, api_processes=1), warm_up=warm_up, on_stop=family.tell)
        thread = threading.Thread(target=server.run, args=([bound],), name="tailstack-service", daemon=True)
        thread.start()
        stack.callback(thread.join)
        stack.callback(server.tell)
        while not server.started:
            if not thread.is_alive():
                raise RequestError(Problem("", "cannot-serve", "the embedded service did not start"))
            time.sleep(0.02)
        yield bound.getsockname()[:2]
