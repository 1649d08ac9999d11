"""One ASGI layer around everything: request ids, who may call at all, counting, one log line, the last resort."""

from __future__ import annotations

import logging
import re
import time
import uuid

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import Problem

from ..problems import TransportError
from .answers import problem_response
from .computing import Stopped
from .metrics import NO_ROUTE
from .service import Service

log = logging.getLogger("tailstack.service")
_ID = re.compile(r"[A-Za-z0-9._:-]{1,64}\Z")
CLIENT_LEFT = 499
LONGEST_METHOD, LONGEST_PATH = 20, 200  # characters that are logged: a stranger may send 60,000


class RequestLog:
    """Gives each request an id (its own X-Request-ID if that is harmless), echoes it, logs and counts the outcome."""

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self.app = app
        self.service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        offered = headers.get("x-request-id", "")
        request_id = offered if _ID.match(offered) else uuid.uuid4().hex
        scope.setdefault("state", {})["request_id"] = request_id
        started, status = time.perf_counter(), 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message["headers"], (b"x-request-id", request_id.encode())]
            await send(message)

        try:
            if "transfer-encoding" in headers and "content-length" in headers:
                raise _two_lengths()
            self.service.access.check_address(scope["method"], headers)
            await self.app(scope, receive, send_with_id)
        except Stopped:  # the client left; nobody reads an answer
            status = CLIENT_LEFT
        except TransportError as refused:
            await _refusal(refused, scope, request_id)(scope, receive, send_with_id)
        except Exception:
            log.exception("", extra={"action": "failed", "request": request_id, "path": scope["path"][:LONGEST_PATH]})
            if status == 0:
                defect = Problem(
                    "", "internal-error", "the request met a defect of the service", "report it with the id"
                )
                error = TransportError("internal-error", defect)
                await _refusal(error, scope, request_id)(scope, receive, send_with_id)
        took = time.perf_counter() - started
        route = getattr(scope.get("route"), "path", NO_ROUTE)
        method = scope["method"] if route != NO_ROUTE else NO_ROUTE  # a stranger's methods are without end
        self.service.metrics.answered(method, route, status, took)
        caller = scope["state"].get("caller")
        log.info(
            "",
            extra={
                "action": "answered", "request": request_id, "method": scope["method"][:LONGEST_METHOD],
                "path": scope["path"][:LONGEST_PATH],
                "status": status, "ms": 1e3 * took, "tenant": None if caller is None else caller.tenant,
            },
        )  # fmt: skip


def _two_lengths() -> TransportError:
    """Where a request ends must not be a matter of opinion between a proxy and this service (RFC 9112, 6.1)."""
    detail = "the request says its length twice: Content-Length and Transfer-Encoding"
    problem = Problem("", "two-lengths", detail, "send one of them")
    return TransportError("malformed-document", problem, {"Connection": "close"})


def _refusal(error: TransportError, scope: Scope, request_id: str) -> Response:
    return problem_response(error, instance=scope["path"], request_id=request_id)
