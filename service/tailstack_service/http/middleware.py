"""The one layer around every answer: request ids, who may call at all, refusals, counting, one log line."""

from __future__ import annotations

import logging
import os
import re
import time

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Router
from starlette.types import Message, Receive, Scope, Send

from tailstack.errors import Problem, TailstackError

from ..problems import TransportError
from .bodies import Placed
from .computing import Stopped
from .metrics import NO_ROUTE
from .refusals import defect, refused
from .routing import answered
from .service import Service

log = logging.getLogger("tailstack.service")
_ID = re.compile(rb"[A-Za-z0-9._:-]{1,64}\Z")
CLIENT_LEFT = 499
LONGEST_METHOD, LONGEST_PATH = 20, 200  # characters that are logged: a stranger may send 60,000


class RequestLog:
    """Gives each request an id (its own X-Request-ID if that is harmless), echoes it, logs and counts the outcome.

    What is no request, the start and the end of the service, is the router's own.
    """

    def __init__(self, router: Router, service: Service) -> None:
        self.router = router
        self.service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.router(scope, receive, send)
            return
        headers = dict(reversed(scope["headers"]))  # of those that came twice, the first
        offered = headers.get(b"x-request-id", b"")
        request_id = offered.decode() if _ID.match(offered) else os.urandom(16).hex()
        state = scope.setdefault("state", {})
        state["request_id"] = request_id
        request = Request(scope, receive, send)
        started, status = time.perf_counter(), 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"x-request-id", request_id.encode())]
                status = message["status"]
            await send(message)

        try:
            response = await self._response(request, headers)
            await response(scope, receive, send_with_id)
        except Stopped:  # the client left; nobody reads an answer
            status = CLIENT_LEFT
        except Exception:
            _log_defect(request)
            if status == 0:
                await refused(request, defect())(scope, receive, send_with_id)
        took = time.perf_counter() - started
        route = getattr(scope.get("route"), "path", NO_ROUTE)
        method = scope["method"] if route != NO_ROUTE else NO_ROUTE  # a stranger's methods are without end
        self.service.metrics.answered(method, route, status, took)
        caller = state.get("caller")
        log.info(
            "",
            extra={
                "action": "answered", "request": request_id, "method": scope["method"][:LONGEST_METHOD],
                "path": scope["path"][:LONGEST_PATH],
                "status": status, "ms": 1e3 * took, "tenant": None if caller is None else caller.tenant,
            },
        )  # fmt: skip

    async def _response(self, request: Request, headers: dict[bytes, bytes]) -> Response:
        try:
            if b"transfer-encoding" in headers and b"content-length" in headers:
                raise _two_lengths()
            self.service.access.check_address(request.method, headers.get(b"host"), headers.get(b"origin"))
            return await answered(request, self.router)
        except (TailstackError, Placed) as error:
            return refused(request, error)


def _log_defect(request: Request) -> None:
    told = {"request": request.state.request_id, "path": request.scope["path"][:LONGEST_PATH]}
    log.exception("", extra={"action": "failed", **told})


def _two_lengths() -> TransportError:
    """Where a request ends must not be a matter of opinion between a proxy and this service (RFC 9112, 6.1)."""
    detail = "the request says its length twice: Content-Length and Transfer-Encoding"
    problem = Problem("", "two-lengths", detail, "send one of them")
    return TransportError("malformed-document", problem, {"Connection": "close"})
