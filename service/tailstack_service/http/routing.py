"""From a request to its answer: the route, who may ask, whether the query means anything, the endpoint."""

from __future__ import annotations

import re

from starlette.requests import Request
from starlette.responses import Response

from tailstack.errors import Problem

from ..problems import TransportError
from .asked import refuse_query
from .routes import ROUTES, Route
from .service import service_of

LONGEST_TOLD = 120  # characters of a path that is unknown
_PATTERNS = tuple((re.compile(re.sub(r"\\{(\w+)\\}", r"(?P<\1>[^/]+)", re.escape(r.path))), r) for r in ROUTES)
_PLAIN = {(route.method, route.path): route for route in ROUTES if "{" not in route.path}


async def answered(request: Request) -> Response:
    """The answer of the endpoint.  Raises what it raises, and TransportError (not-found, method-not-allowed)."""
    route = request.scope["route"] = _route_of(request)
    if route.scope is not None:
        request.state.caller = await service_of(request).access.admit(request, route.scope)
    if route.query is not None:
        refuse_query(request, route.query)
    return await route.endpoint(request)


def _route_of(request: Request) -> Route:
    """The route, after noting what its path says.  A GET does not answer to HEAD."""
    method, path = request.scope["method"], request.scope["path"]
    plain = _PLAIN.get((method, path))
    if plain is not None:
        return plain
    matching = [(found, route) for pattern, route in _PATTERNS if (found := pattern.fullmatch(path))]
    for found, route in matching:
        if route.method == method:
            request.scope["path_params"] = found.groupdict()
            return route
    told = path[:LONGEST_TOLD]
    if not matching:
        problem = Problem("", "not-found", f"there is nothing at {told}", "GET /openapi.json lists every path")
        raise TransportError("not-found", problem)
    allowed = ", ".join(sorted({route.method for _, route in matching}))
    problem = Problem("", "method-not-allowed", f"{told} does not answer to {method}", f"use {allowed}")
    raise TransportError("method-not-allowed", problem, {"Allow": allowed})
