"""Whatever was raised on the way to an answer, as the problem document that is answered instead."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from fastapi import Request, Response
from starlette.exceptions import HTTPException

from tailstack.cures import find_nearest
from tailstack.errors import LimitError, TailstackError

from ..documents import to_json
from ..problems import DamagedStore, ProblemDocument, StoreError, StoreUnavailable, TransportError, problem_document
from .answers import cut_root, path_of, place
from .compute_pool import CallerLeft

log = logging.getLogger("tailstack.service")
PROBLEM = "application/problem+json"
STORE_RETRY_SECONDS = 2
LONGEST_PATH = 120  # characters of an unknown path that the answer repeats
MOST_STEPS, LONGEST_STEP = 8, 20  # of an unknown path that is compared with the routes: ids can be long
CLIENT_LEFT = 499  # for the log: nobody reads the answer


class BodyTooLarge(LimitError):
    """The body itself is over the limit: 413 rather than 422."""


def document_response(document: ProblemDocument, headers: Mapping[str, str] | None = None) -> Response:
    """A problem document with its own status."""
    document = replace(document, type=place(document.type))
    return Response(to_json(document), document.status, headers, PROBLEM)


def refusal_response(request: Request, error: TailstackError) -> Response:
    """The answer to a request that is refused."""
    request_id = request.state.request_id
    if isinstance(error, StoreUnavailable | StoreError) and not isinstance(error, DamagedStore):
        error = _hide_address(request_id, error)
    status = 413 if isinstance(error, BodyTooLarge) else None
    document = problem_document(error, instance=path_of(request), request_id=request_id, status=status)
    response = document_response(document, error.headers if isinstance(error, TransportError) else None)
    if response.status_code in (429, 503):
        response.headers.setdefault("Retry-After", str(STORE_RETRY_SECONDS))
    return response


def defect_error() -> TransportError:
    """What a client is told of an exception that nobody expected."""
    return TransportError("internal-error", "the request met a defect of the service", "report it with the id")


def _hide_address(request_id: str, error: TailstackError) -> TransportError:
    """What a driver says may name hosts, files and users: that is for the log, not for a client."""
    log.warning("the database failed a request: %s", error, extra={"action": error.slug, "request": request_id})
    detail = "the database does not answer" if error.slug == "store-unavailable" else "the database cannot be used"
    return TransportError(error.slug, detail, "the log says why, under the id of the request")


async def _answer_refusal(request: Request, error: Any) -> Response:
    return refusal_response(request, error)


async def _answer_nobody(request: Request, error: Any) -> Response:
    return Response(b"", CLIENT_LEFT)


async def _answer_unrouted(request: Request, error: Any) -> Response:
    """What the router says: 404, or 405 with the methods that are there."""
    path = path_of(request)[:LONGEST_PATH]
    if error.status_code != 405:
        hint = f"{_name_route(request, path)} GET /openapi.json lists every path".strip()
        return refusal_response(request, TransportError("not-found", f"there is nothing at {path}", hint))
    allowed = error.headers["Allow"]
    detail = f"{path} does not answer to {request.method}"
    error = TransportError("method-not-allowed", detail, f"use {allowed}", {"Allow": allowed})
    return refusal_response(request, error)


def _name_route(request: Request, path: str) -> str:
    """The route that a path may be a slip of, as a question; empty where none is near."""
    given = [step[:LONGEST_STEP] for step in cut_root(path).split("/")[:MOST_STEPS]]
    routes: dict[str, tuple[str, str]] = {}  # the route with this path's own ids in it: method and template
    for template, methods in request.app.state.addresses:
        steps = template.split("/")
        ids = given if len(given) == len(steps) else steps
        filled = "/".join(own if step.startswith("{") else step for step, own in zip(steps, ids, strict=True))
        method = request.method if request.method in methods else methods[0]
        if filled not in routes or method == request.method:
            routes[filled] = (method, template)
    nearest = find_nearest("/".join(given), routes)
    return "did you mean {} {}?".format(*routes[nearest[0]]) if nearest else ""


HANDLERS: dict[int | type[Exception], Callable[[Request, Any], Any]] = {
    TailstackError: _answer_refusal,
    CallerLeft: _answer_nobody,
    HTTPException: _answer_unrouted,
}
