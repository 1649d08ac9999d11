"""From a request to its answer: the route, who may ask, whether the query means anything, the endpoint."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Match, Router
from starlette.routing import Route as Plain

from tailstack.errors import Problem

from ..problems import TransportError
from .answers import path_of
from .asked import refuse_query
from .routes import ROUTES, Route
from .service import service_of

LONGEST_TOLD = 120  # characters of a path that is unknown


def plain_routes() -> list[Plain]:
    """Every route as a router matches it; they read their requests themselves, and need nothing that FastAPI does."""
    found = []
    for route in ROUTES:
        plain = Plain(route.path, _admitting(route), methods=[route.method], name=route.operation_id)
        plain.methods = {route.method}  # a GET does not answer to HEAD
        found.append(plain)
    return found


def _admitting(route: Route) -> Callable[[Request], Awaitable[Response]]:
    async def endpoint(request: Request) -> Response:
        request.scope["route"] = route
        if route.scope is not None:
            request.state.caller = await service_of(request).access.admit(request, route.scope)
        if route.query is not None:
            refuse_query(request, route.query)
        return await route.endpoint(request)

    return endpoint


async def answered(request: Request, router: Router) -> Response:
    """The answer of the endpoint.  Raises what it raises, and TransportError (not-found, method-not-allowed)."""
    methods: set[str] = set()
    for route in router.routes:
        match, said = route.matches(request.scope)
        if match is Match.FULL:
            request.scope.update(said)
            response: Response = await said["endpoint"](request)
            return response
        if match is Match.PARTIAL and isinstance(route, Plain):
            methods |= route.methods or set()
    told = path_of(request)[:LONGEST_TOLD]
    if not methods:
        problem = Problem("", "not-found", f"there is nothing at {told}", "GET /openapi.json lists every path")
        raise TransportError("not-found", problem)
    allowed = ", ".join(sorted(methods))
    problem = Problem("", "method-not-allowed", f"{told} does not answer to {request.method}", f"use {allowed}")
    raise TransportError("method-not-allowed", problem, {"Allow": allowed})
