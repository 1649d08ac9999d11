"""The one layer around every answer: request ids, who may call at all, defects, counting, one log line."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import time

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import Problem, TailstackError

from ..problems import TransportError
from .metrics import NO_ROUTE
from .places import stopping_error
from .refusals import CLIENT_LEFT, defect, refused
from .service import Service

log = logging.getLogger("tailstack.service")
_ID = re.compile(rb"[A-Za-z0-9._:-]{1,64}\Z")
LONGEST_METHOD, LONGEST_PATH = 20, 200  # characters that are logged: a stranger may send 60,000


class Unsendable(Exception):
    """The server cannot send to this client any more: what came after the head was not HTTP."""


class RequestLog:
    """Gives each request an id (its own X-Request-ID if that is harmless), echoes it, logs and counts the outcome."""

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self.app = app
        self.service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = dict(reversed(scope["headers"]))  # of those that came twice, the first
        offered = headers.get(b"x-request-id", b"")
        request_id = offered.decode() if _ID.match(offered) else os.urandom(16).hex()
        state = scope.setdefault("state", {})
        state["request_id"] = request_id
        request = Request(scope, receive)
        started, status = time.perf_counter(), 0

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

        async def answer(error: TailstackError) -> None:
            if status == 0:
                await refused(request, error)(scope, receive, send_with_id)

        try:
            try:
                self._check(request, headers)
                await self.app(scope, receive, send_with_id)
            except TailstackError as error:
                await answer(error)
            except asyncio.CancelledError:  # the time that a stop grants to whoever is still waiting is over
                await answer(stopping_error())
            except Unsendable:
                raise
            except Exception:
                told = {"request": request_id, "path": scope["path"][:LONGEST_PATH]}
                log.exception("", extra={"action": "failed", **told})
                await answer(defect())
        except Unsendable:
            while (await receive())["type"] != "http.disconnect":
                pass
        took = time.perf_counter() - started
        known = status != 405 and "route" in scope  # a stranger's methods and paths are without end
        method, route = (scope["method"], scope["route"].path) if known else (NO_ROUTE, NO_ROUTE)
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

    def _check(self, request: Request, headers: dict[bytes, bytes]) -> None:
        if b"transfer-encoding" in headers and b"content-length" in headers:
            raise _two_lengths()
        self.service.access.check_address(request.method, headers)


def _two_lengths() -> TransportError:
    """Where a request ends must not be a matter of opinion between a proxy and this service (RFC 9112, 6.1)."""
    detail = "the request says its length twice: Content-Length and Transfer-Encoding"
    problem = Problem("", "two-lengths", detail, "send one of them")
    return TransportError("malformed-document", problem, {"Connection": "close"})
