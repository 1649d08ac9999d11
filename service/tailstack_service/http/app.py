"""The application: routes, who may use them, and every refusal as a problem document."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import cache
from typing import Any

from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route as Plain

from tailstack.errors import Problem, TailstackError

from ..problems import TransportError
from ..settings import Settings, settings_from
from ..store.errors import StoreError, StoreUnavailable
from .access import Access
from .answers import problem_response
from .asked import refuse_query
from .bodies import BodyTooLarge, Placed
from .computing import Lane
from .metrics import Metrics
from .middleware import RequestLog
from .routes import ROUTES, Route
from .service import Service
from .storage import Storage
from .warmth import Warming

log = logging.getLogger("tailstack.service")
REPORT_WORKERS = 1  # rendering holds the GIL, and scores are computed in the same process
STORE_RETRY_SECONDS = 2
SETTLED_SECONDS = 1.5  # after which a service that has just become ready loads what is asked for less often


def create_app(settings: Settings | None = None, *, warm_up: bool = True) -> FastAPI:
    """The application with these settings, by default those of the environment (``TAILSTACK_*``).

    ``warm_up`` compiles the kernels in the background when the application starts; readiness tells when that is
    done.  The database is opened when it is first needed.  ``app.state.service.stopping`` ends every computation,
    wait and stream.  Raises RequestError for settings of authentication that cannot work.
    """
    settings = settings_from(os.environ) if settings is None else settings
    app = FastAPI(
        title="tailstack", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False, lifespan=_lifespan
    )
    storage = Storage(settings.database_url)

    async def find_key(presented: str) -> Any:
        from ..store.keys import find_key as found

        return await storage.run(found, presented)

    service = Service(
        settings=settings,
        stopping=threading.Event(),
        storage=storage,
        access=Access(settings, find_key),
        metrics=Metrics(),
        short=Lane("short", settings.short_workers, settings.max_waiting),
        reports=Lane("report", REPORT_WORKERS, settings.max_waiting),
        warmth="warming up" if warm_up else "ready",
        second_order="not asked for" if warm_up else "ready",
        settled=not warm_up,
    )
    app.state.service = service
    app.router.routes.extend(map(_routed, ROUTES))
    app.openapi = _description  # type: ignore[method-assign]
    for kind, handler in ((TailstackError, _refused), (Placed, _refused), (HTTPException, _not_routed)):
        app.add_exception_handler(kind, handler)  # type: ignore[arg-type]
    app.add_middleware(RequestLog, service=service)
    return app


@cache
def _description() -> dict[str, Any]:
    from .openapi import document

    return document()


def _routed(route: Route) -> Plain:
    """The route in the router: one that reads its request itself needs nothing of what FastAPI does for its own."""
    routed = Plain(route.path, _admitting(route), methods=[route.method], name=route.operation_id)
    routed.methods = {route.method}  # a GET does not answer to HEAD
    return routed


def _admitting(route: Route) -> Callable[[Request], Awaitable[Response]]:
    """The endpoint behind the question who asks and whether the query means anything."""

    async def endpoint(request: Request) -> Response:
        request.scope["route"] = route
        if route.scope is not None:
            request.state.caller = await request.app.state.service.access.admit(request, route.scope)
        if route.query is not None:
            refuse_query(request, route.query)
        return await route.endpoint(request)

    return endpoint


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    service: Service = app.state.service
    warming = Warming(lambda: _warm(service)) if service.warmth == "warming up" else None
    if warming is not None:
        warming.start()
    try:
        yield
    finally:
        service.stopping.set()
        for close in (service.short.close, service.reports.close, service.storage.close):
            await asyncio.to_thread(close)
        if warming is not None:
            await asyncio.to_thread(warming.end)


def _warm(service: Service) -> None:
    """Compile what requests will run, so that the first one does not wait for it."""
    from tailstack.design import load_design
    from tailstack.scoring import score

    from .example import EXAMPLE_DESIGN, variants

    try:
        design = load_design(EXAMPLE_DESIGN)
        score(design)
        _keep_for_good()
        service.warmth = "ready"
        if service.stopping.wait(SETTLED_SECONDS):
            return
        # what is asked for less often; nobody has to wait for it to be ready
        for variant in map(load_design, variants()):
            if service.stopping.is_set():
                return
            score(variant)
        service.settled = True
        from tailstack.optimisation import influence

        influence(design)
    except Exception:
        log.exception("", extra={"action": "warm-up-failed"})
        if service.warmth != "ready":
            service.warmth = "failed"


def _keep_for_good() -> None:
    """What stands after the start stays until the end: the garbage collector need not look at it at every request."""
    gc.collect()
    gc.freeze()


async def _refused(request: Request, error: Exception) -> Response:
    refusal, prefix = (error.error, error.prefix) if isinstance(error, Placed) else (error, "")
    assert isinstance(refusal, TailstackError)
    if isinstance(refusal, StoreUnavailable | StoreError):
        refusal = _without_its_address(request, refusal)
    status = 413 if isinstance(refusal, BodyTooLarge) else None
    response = problem_response(
        refusal, instance=request.url.path, request_id=request.state.request_id, status=status, prefix=prefix
    )
    if response.status_code in (429, 503):
        response.headers.setdefault("Retry-After", str(STORE_RETRY_SECONDS))
    return response


def _without_its_address(request: Request, error: TailstackError) -> TransportError:
    """What a driver says may name hosts, files and users: that is for the log, not for a client."""
    log.warning("%s", error, extra={"action": error.slug, "request": request.state.request_id})
    detail = "the database does not answer" if error.slug == "store-unavailable" else "the database cannot be used"
    return TransportError(error.slug, Problem("", error.slug, detail, "the log says why, under the id of the request"))


async def _not_routed(request: Request, error: HTTPException) -> Response:
    """404 and 405 of the router."""
    slug = {404: "not-found", 405: "method-not-allowed"}.get(error.status_code, "invalid-request")
    headers = dict(error.headers or {})
    path = request.url.path[:120]
    if slug == "not-found":
        problem = Problem("", slug, f"there is nothing at {path}", "GET /openapi.json lists every path")
    else:
        headers["Allow"] = ", ".join(sorted({route.method for route in ROUTES if route.matches(request.url.path)}))
        problem = Problem("", slug, f"{path} does not answer to {request.method}", f"use {headers['Allow']}")
    refusal = TransportError(slug, problem, headers)
    return problem_response(
        refusal, instance=request.url.path, request_id=request.state.request_id, status=error.status_code
    )
