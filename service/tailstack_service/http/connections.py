"""Connections that come to an end: head, body and the taking of the answer have a bounded time each.

uvicorn bounds only the pause between two requests: half a request line would keep its connection open for ever.
h11, because it is strict: httptools takes requests with two Host headers or none.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol

from tailstack.errors import Problem

from ..problems import TransportError
from ..settings import Settings, variable
from .answers import problem_response
from .computing import LEFT

log = logging.getLogger("tailstack.service")
GRACE_SECONDS = 2.0  # whoever reads the body refuses first, and says so better


class Gathering:
    """A transport that holds the head of an answer back until the body comes: one packet, one system call.

    A head without a body, as of an event stream that has nothing to tell yet, leaves in the next turn of the loop.
    """

    def __init__(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._transport, self._loop = transport, loop
        self._head = b""

    def write(self, data: bytes) -> None:
        if self._head:
            data, self._head = self._head + data, b""
        elif data.startswith(b"HTTP/1.1 2"):
            self._head = data
            self._loop.call_soon(self._flush)
            return
        self._transport.write(data)

    def _flush(self) -> None:
        if self._head:
            self.write(b"")

    def close(self) -> None:
        self._flush()
        self._transport.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)


class Connection(H11Protocol):
    """One connection.  ``connections`` makes the class with the times of a service."""

    head_seconds: ClassVar[float]
    body_seconds: ClassVar[float]
    answer_seconds: ClassVar[float]

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._awaited: object = None  # h11.IDLE: a head; h11.SEND_BODY: a body; None: nothing
        self._late: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(Gathering(transport, self.loop))  # type: ignore[arg-type]
        self._await(h11.IDLE, self.head_seconds)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        state = self.conn.their_state
        if state is self._awaited:  # more of the same, in the same time
            return
        if state is h11.IDLE:
            self._await(state, self.head_seconds)
        elif state is h11.SEND_BODY:
            self._await(state, self.body_seconds + GRACE_SECONDS)
        else:
            self._await(None, 0)

    def _await(self, part: object, seconds: float) -> None:
        if self._late is not None:
            self._late.cancel()
        self._awaited = part
        self._late = None if part is None else self.loop.call_later(seconds, self._too_late)

    def _too_late(self) -> None:
        if self.transport.is_closing():
            return
        if self.conn.our_state is h11.IDLE and self.conn.trailing_data[0]:
            self._refuse()
        self.transport.close()

    def _refuse(self) -> None:
        """408 for whoever began a request; nobody else would read it."""
        request_id = uuid.uuid4().hex
        detail = f"the request line and the headers were not complete after {self.head_seconds:g} s"
        hint = f"send them at once, or start the service with a higher {variable('head_seconds')}"
        refusal = TransportError("head-timeout", Problem("", "too-slow", detail, hint), {"Connection": "close"})
        answer = problem_response(refusal, instance="", request_id=request_id)
        headers = [*answer.raw_headers, (b"x-request-id", request_id.encode())]
        reason = STATUS_PHRASES[answer.status_code]
        for event in (
            h11.Response(status_code=answer.status_code, headers=headers, reason=reason),
            h11.Data(data=bytes(answer.body)),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")
        log.info("", extra={"action": "head-timeout", "request": request_id, "status": answer.status_code})

    def pause_writing(self) -> None:
        super().pause_writing()
        if self._stalled is None:
            self._stalled = self.loop.call_later(self.answer_seconds, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._taken()

    def _taken(self) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None

    def connection_lost(self, exc: Exception | None) -> None:
        if self.scope is not None:
            self.scope["state"][LEFT] = True
        self._await(None, 0)
        self._taken()
        super().connection_lost(exc)


def connections(settings: Settings) -> type[Connection]:
    """The class of a service's connections."""

    class Bounded(Connection):
        head_seconds = settings.head_seconds
        body_seconds = settings.body_seconds
        answer_seconds = settings.answer_seconds

    return Bounded
