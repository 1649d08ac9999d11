"""One ASGI layer around everything: request ids, one log line per request, and the last resort."""

from __future__ import annotations

import logging
import re
import time
import uuid

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import Problem

from ..problems import TransportError
from .answers import problem_response
from .computing import Stopped

log = logging.getLogger("tailstack.service")
_ID = re.compile(r"[A-Za-z0-9._:-]{1,64}\Z")


class RequestLog:
    """Gives each request an id (its own X-Request-ID if that is harmless), echoes it, logs the outcome."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        offered = next((value for name, value in scope["headers"] if name == b"x-request-id"), b"").decode("latin-1")
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
            await self.app(scope, receive, send_with_id)
        except Stopped:  # the client left; nobody reads an answer
            status = 499
        except Exception:
            log.exception("request=%s action=failed path=%r", request_id, scope["path"])
            if status == 0:
                await _internal_error(scope, request_id)(scope, receive, send_with_id)
        took_ms = 1e3 * (time.perf_counter() - started)
        log.info(
            "request=%s action=answered method=%s path=%r status=%d ms=%.1f",
            request_id, scope["method"], scope["path"], status, took_ms,
        )  # fmt: skip


def _internal_error(scope: Scope, request_id: str) -> Response:
    problem = Problem("", "internal-error", "the request met a defect of the service", "report it with the request id")
    return problem_response(TransportError("internal-error", problem), instance=scope["path"], request_id=request_id)
