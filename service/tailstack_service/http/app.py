"""The application: what it is made of, its start and its end, and the layers around every answer."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from types import FrameType
from typing import Any

import h11
from fastapi import FastAPI
from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import TailstackError

from ..clock import SYSTEM_CLOCK, Clock
from ..jobs.store import audit, keys, results
from ..problems import TransportError
from ..settings import Settings, load_settings
from . import information, jobs, pages, posting
from .access import Access
from .answers import read_root_path, seen_below
from .compute_pool import ComputePool, stopping_error
from .metrics import NO_ROUTE, Metrics
from .openapi import document
from .problems import CLIENT_LEFT, HANDLERS, defect_error, refusal_response
from .service import KeptDesigns, Service, Storage

log = logging.getLogger("tailstack.service")
SIGNALS = (signal.SIGTERM, signal.SIGINT)
HARMLESS_ID = re.compile(rb"[A-Za-z0-9._:-]{1,64}\Z")
LONGEST_METHOD, LONGEST_PATH = 20, 200  # characters that are logged: a stranger may send 60,000
ROUTERS = (posting.router, jobs.router, jobs.result_router, information.router, pages.router)


def create_app(settings: Settings | None = None, *, warm_up: bool = True, clock: Clock = SYSTEM_CLOCK) -> FastAPI:
    """The application with these settings, by default those of the environment (``TAILSTACK_*``).

    ``warm_up`` starts the computing processes, and compiles the kernels, when the application starts; readiness tells
    when that is done.  The database is opened when it is first needed.  ``app.state.service.stopping`` ends every
    computation, wait and stream.  Raises RequestError for settings of authentication, or a path, that cannot work.
    """
    settings = load_settings() if settings is None else settings
    app = _Application(
        title="tailstack", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False, lifespan=_lifespan,
        exception_handlers=HANDLERS,
    )  # fmt: skip
    for router in ROUTERS:
        app.include_router(router)
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    app.state.addresses = tuple((route.path, tuple(sorted(route.methods or ()))) for route in routes)
    storage = Storage(settings.database_url, clock)

    stopping = threading.Event()
    pool = ComputePool(
        settings.short_workers, settings.max_waiting, settings.max_seconds, stopping, warm=warm_up,
        most_bytes=settings.max_process_bytes, hang_seconds=settings.hang_seconds, clock=clock,
    )  # fmt: skip
    app.state.service = Service(
        settings=settings,
        stopping=stopping,
        storage=storage,
        access=Access(
            settings,
            lambda secret: storage.run(keys.find_key, secret),
            lambda key_id, tenant, address: storage.write(audit.note_use, key_id, tenant, address),
            clock,
        ),
        metrics=Metrics(),
        kept_designs=KeptDesigns(
            lambda tenant, sha256: storage.run(results.read_design, tenant, sha256),
            lambda entries: storage.write(results.keep_designs, entries, settings.max_kept_designs),
            off=settings.max_kept_designs == 0,
            clock=clock,
        ),
        pool=pool,
        clock=clock,
    )
    app.add_middleware(Answering, service=app.state.service)
    app.add_middleware(Prefix, root=read_root_path(settings))
    return app


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The document of these routes, with what the overlay adds."""
        if self.openapi_schema is None:
            self.openapi_schema = document(ROUTERS, (*information.DESCRIBED, pages.Index))
        return self.openapi_schema


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    service: Service = app.state.service
    with listen(service.stopping):
        service.pool.begin()
        try:
            yield
        finally:
            await service.pool.close()
            await service.kept_designs.close()
            await asyncio.to_thread(service.storage.close)


@contextmanager
def listen(stopping: threading.Event) -> Iterator[None]:
    """Set ``stopping`` as soon as a signal tells the server to stop, not when it has stopped.

    uvicorn tells an application only when every connection is closed, and those that wait or stream would wait for
    just that.  Its own handler is called next.  One of several API processes also ends when its parent has gone.
    """
    asyncio.get_running_loop().set_exception_handler(_log_briefly)
    if threading.current_thread() is not threading.main_thread():  # nobody can signal it: ``server.running_service``
        yield
        return
    previous = {number: signal.getsignal(number) for number in SIGNALS}

    def stop(number: int, frame: FrameType | None) -> None:
        if not stopping.is_set():  # an Event could be locked by the very thread that a signal interrupts
            stopping.set()
        handler = previous[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)

    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), name="tailstack-parent", daemon=True).start()
    for number in SIGNALS:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _end_after(parent: Any) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)


def _log_briefly(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """What a client does wrong after its answer has left cannot be answered, and is no defect of the service."""
    error = context.get("exception")
    if isinstance(error, h11.ProtocolError):
        log.warning("a client sent something that is not HTTP: %s", error, extra={"action": "not-http"})
    else:
        loop.default_exception_handler(context)


class Unsendable(Exception):
    """The server cannot send to this client any more: what came after the head was not HTTP."""


class Answering:
    """The layer around every answer.

    Gives each request an id (its own X-Request-ID if that is harmless) and echoes it, answers what no route answers
    (addresses that are refused, stops, defects), logs and counts the outcome.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self.app = app
        self.service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request, headers = Request(scope, receive), dict(reversed(scope["headers"]))  # of two of a name the first
        own_id = headers.get(b"x-request-id", b"")
        request_id = own_id.decode() if HARMLESS_ID.match(own_id) else os.urandom(16).hex()
        request.state.request_id = request_id
        started, status = self.service.clock.monotonic(), 0  # of the answer that was begun

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"x-request-id", request_id.encode())]
                status = message["status"]
            try:
                await send(message)
            except Exception as error:
                status = CLIENT_LEFT
                raise Unsendable from error

        try:
            refusal = await self._ask(request, headers, receive, send_with_id)
            if refusal is not None and not status:
                await refusal_response(request, refusal)(scope, receive, send_with_id)
        except Unsendable:
            while (await receive())["type"] != "http.disconnect":
                pass
        self._note(request, status, self.service.clock.monotonic() - started)

    async def _ask(
        self, request: Request, headers: dict[bytes, bytes], receive: Receive, send: Send
    ) -> TailstackError | None:
        """Have the request answered; what is to be said instead, if nothing has been said yet."""
        try:
            if b"transfer-encoding" in headers and b"content-length" in headers:
                # Where a request ends must not be a matter of opinion between a proxy and this service (RFC 9112, 6.1)
                detail = "the request says its length twice: Content-Length and Transfer-Encoding"
                close = {"Connection": "close"}
                raise TransportError("malformed-document", detail, "send one of them", close, code="two-lengths")
            self.service.access.check_address(request.method, headers, request.scope.get("scheme", "http"))
            await self.app(request.scope, receive, send)
        except TailstackError as error:
            return error
        except asyncio.CancelledError:  # the time that a stop grants to whoever is still waiting is over
            return stopping_error()
        except Unsendable:
            raise
        except Exception:
            path = request.scope["path"][:LONGEST_PATH]
            defect = {"action": "failed", "request": request.state.request_id, "path": path}
            log.exception("a defect of the service ended this request", extra=defect)
            return defect_error()
        return None

    def _note(self, request: Request, status: int, seconds: float) -> None:
        scope = request.scope
        known = status != 405 and "route" in scope  # a stranger's methods and paths are without end
        method, route = (scope["method"], scope["route"].path) if known else (NO_ROUTE, NO_ROUTE)
        self.service.metrics.count_answer(method, route, status, seconds)
        caller = getattr(request.state, "caller", None)
        fields = {
            "action": "answered",
            "request": request.state.request_id,
            "method": scope["method"][:LONGEST_METHOD],
            "path": scope["path"][:LONGEST_PATH],
            "status": status,
            "ms": 1e3 * seconds,
            "tenant": None if caller is None else caller.tenant,
        }
        log.info("answered a request for %s", route if known else "what is not there", extra=fields)


_LEAD = (b"location", b"content-location")


class Prefix:
    """Tells routes and answers below which path the client sees them; "": below none."""

    def __init__(self, app: ASGIApp, root: str) -> None:
        self._app, self._root = app, root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        root = self._root
        if not root or scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        path = scope["path"]
        whole = path if path.startswith(f"{root}/") else root + ("/" if path == root else path)
        lead = root.encode()

        async def send_below(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [(name, _begin_with(lead, name, value)) for name, value in message["headers"]]
            await send(message)

        with seen_below(root):
            await self._app({**scope, "path": whole, "root_path": root}, receive, send_below)


def _begin_with(lead: bytes, name: bytes, value: bytes) -> bytes:
    """The value of a header with the paths in it below ``lead``."""
    name = name.lower()
    if name in _LEAD and value.startswith(b"/"):
        return lead + value
    return value.replace(b"</", b"<" + lead + b"/") if name == b"link" else value
