"""Serving: a socket on loopback, graceful stop, and the same application embedded in another program."""

from __future__ import annotations

import ipaddress
import logging
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn

from tailstack.errors import Problem

from ..problems import RequestError
from ..settings import Settings
from .app import create_app

DEFAULT_PORT = 8321
GRACE_SECONDS = 10  # for answers that are being written when the service is told to stop


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def bind(host: str, port: int, *, allow_remote: bool = False) -> socket.socket:
    """A listening socket.  Raises RequestError for an address others can reach, or that cannot be had."""
    if not allow_remote and not is_loopback(host):
        raise RequestError(
            Problem(
                "",
                "not-loopback",
                f"{host} can be reached from other machines, and the service has no authentication yet",
                "serve on 127.0.0.1, or add --allow-remote if something in front of it lets only the right people in",
            )
        )
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
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


class _Server(uvicorn.Server):
    """Tells running computations to stop as soon as the signal comes, not when they are done."""

    def __init__(self, config: uvicorn.Config, stopping: threading.Event) -> None:
        super().__init__(config)
        self.stopping = stopping

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.stopping.set()
        super().handle_exit(sig, frame)


def _server(settings: Settings | None, warm_up: bool = True) -> _Server:
    app = create_app(settings, warm_up=warm_up)
    config = uvicorn.Config(
        app, log_config=None, access_log=False, lifespan="on", timeout_graceful_shutdown=GRACE_SECONDS,
        server_header=False, ws="none",
    )  # fmt: skip
    return _Server(config, app.state.stopping)


def log_to_stderr(level: int = logging.INFO) -> None:
    """Log lines of the service and of uvicorn on stderr; stdout carries answers only."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s %(message)s"))
    for name in ("tailstack", "uvicorn"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(level if name == "tailstack" else logging.WARNING)


def serve(bound: socket.socket, settings: Settings | None = None) -> None:
    """Serve until SIGTERM (returns) or SIGINT (raises KeyboardInterrupt).  Running computations are told to stop."""
    # uvicorn raises the signal again once it has stopped; a service manager's stop is not a crash
    previous = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        _server(settings).run(sockets=[bound])
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextmanager
def running_service(settings: Settings | None = None, *, warm_up: bool = True) -> Iterator[tuple[str, int]]:
    """The service in a thread of this process; yields its loopback host and (free) port once it answers.

    It cannot outlive the process, and stops (computations included) when the block is left, whatever way.
    """
    bound = bind("127.0.0.1", 0)
    server = _server(settings, warm_up)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, name="tailstack-service", daemon=True)
    thread.start()
    try:
        while not server.started:
            if not thread.is_alive():
                raise RequestError(Problem("", "cannot-serve", "the embedded service did not start"))
            time.sleep(0.02)
        yield bound.getsockname()[:2]
    finally:
        server.stopping.set()
        server.should_exit = True
        thread.join()
