"""The application: routes, lanes, and every refusal as a problem document."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from tailstack.errors import Problem, TailstackError

from ..problems import TransportError
from ..settings import Settings, settings_from
from . import information
from .answers import problem_response
from .bodies import BodyTooLarge, Placed
from .computing import Lane
from .openapi import describe, description_of
from .operations import OPERATIONS, Operation, answer

log = logging.getLogger("tailstack.service")


def create_app(settings: Settings | None = None, *, warm_up: bool = True) -> FastAPI:
    """The application with these settings, by default those of the environment (``TAILSTACK_*``).

    ``warm_up`` compiles the kernels in the background when the application starts; readiness tells when
    that is done.  ``app.state.stopping`` is the event that ends every computation.
    """
    settings = settings_from(os.environ) if settings is None else settings
    app = FastAPI(
        title="tailstack", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False, lifespan=_lifespan
    )
    app.state.settings = settings
    app.state.stopping = threading.Event()
    app.state.warmth = "warming up" if warm_up else "ready"
    app.state.lanes = {
        "score": Lane("score", settings.short_workers, settings.max_waiting),
    }
    for operation in OPERATIONS:
        app.add_api_route(
            operation.path,
            _endpoint(operation),
            methods=["POST"],
            response_class=Response,
            **description_of(operation.path),
        )
    for path, endpoint in {**INFORMATION, "/openapi.json": _openapi}.items():
        app.add_api_route(path, endpoint, methods=["GET"], response_class=Response, **description_of(path))
    describe(app)
    for kind, handler in ((TailstackError, _refused), (Placed, _refused), (HTTPException, _not_routed)):
        app.add_exception_handler(kind, handler)  # type: ignore[arg-type]
    from .middleware import RequestLog

    app.add_middleware(RequestLog)
    return app


INFORMATION: dict[str, Callable[[Request], Awaitable[Response]]] = {
    "/v1/schemas": information.schemas,
    "/v1/schemas/{name}": information.schema,
    "/v1/problems/{slug}": information.problem_type,
    "/health/live": information.live,
    "/health/ready": information.ready,
    "/version": information.version,
}


def _endpoint(operation: Operation) -> Callable[[Request], Awaitable[Response]]:
    async def endpoint(request: Request) -> Response:
        return await answer(operation, request)

    return endpoint


async def _openapi(request: Request) -> Response:
    return JSONResponse(request.app.openapi())


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    warming: asyncio.Future[Any] | None = None
    if app.state.warmth == "warming up":
        warming = asyncio.get_running_loop().run_in_executor(None, _warm, app)
    try:
        yield
    finally:
        app.state.stopping.set()
        for lane in app.state.lanes.values():
            await asyncio.to_thread(lane.close)
        if warming is not None:
            await warming


def _warm(app: FastAPI) -> None:
    """Compile what requests will run, so that the first one does not wait for it."""
    from tailstack.design import load_design
    from tailstack.scoring import score

    from .example import EXAMPLE_DESIGN

    try:
        score(load_design(EXAMPLE_DESIGN))
        app.state.warmth = "ready"
    except Exception:
        log.exception("action=warm-up-failed")
        app.state.warmth = "failed"


async def _refused(request: Request, error: Exception) -> Response:
    refusal, prefix = (error.error, error.prefix) if isinstance(error, Placed) else (error, "")
    assert isinstance(refusal, TailstackError)
    status = 413 if isinstance(refusal, BodyTooLarge) else None
    return problem_response(
        refusal, instance=request.url.path, request_id=request.state.request_id, status=status, prefix=prefix
    )


async def _not_routed(request: Request, error: HTTPException) -> Response:
    """404 and 405 of the router."""
    slug = {404: "not-found", 405: "method-not-allowed"}.get(error.status_code, "invalid-request")
    if slug == "not-found":
        problem = Problem(
            "", slug, f"there is nothing at {request.url.path[:120]}", "GET /openapi.json lists every path"
        )
    else:
        allowed = (error.headers or {}).get("Allow", "")
        problem = Problem("", slug, f"{request.url.path[:120]} does not answer to {request.method}", f"use {allowed}")
    refusal = TransportError(slug, problem, dict(error.headers or {}))
    return problem_response(
        refusal, instance=request.url.path, request_id=request.state.request_id, status=error.status_code
    )
