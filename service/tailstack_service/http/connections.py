"""Connections that come to an end: head, body and the taking of the answer have a bounded time each.

uvicorn bounds only the pause between two requests: half a request line would keep its connection open for ever.
h11, because it is strict: httptools takes requests with two Host headers or none, and drops the body of a request that
offers an upgrade.  It is not asked about requests that are plain, until one comes that is not: see ``plain``.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from typing import Any, ClassVar
from urllib.parse import unquote

import h11
from uvicorn.protocols.http.flow_control import HIGH_WATER_LIMIT
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol

from tailstack.errors import Problem

from ..problems import TransportError
from ..settings import Settings, variable
from .answers import problem_response
from .computing import LEFT
from .plain import Plain, PlainCycle, read_plain

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
        self._plain = True  # so far
        self._missing = 0  # bytes of a plain request's body
        self._held = b""  # what came after a plain request that is being answered
        self._awaited: object = None  # h11.IDLE: a head; h11.SEND_BODY: a body; None: nothing
        self._late: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(Gathering(transport, self.loop))  # type: ignore[arg-type]
        self._await(h11.IDLE, self.head_seconds)

    def data_received(self, data: bytes) -> None:
        if self._plain:
            self._read_plain(data)
        else:
            super().data_received(data)
        state = self._their_state()
        if state is self._awaited:  # more of the same, in the same time
            return
        if state is h11.IDLE:
            self._await(state, self.head_seconds)
        elif state is h11.SEND_BODY:
            self._await(state, self.body_seconds + GRACE_SECONDS)
        else:
            self._await(None, 0)

    def _their_state(self) -> object:
        if not self._plain:
            return self.conn.their_state
        return h11.SEND_BODY if self._missing else h11.DONE if self._answering() else h11.IDLE

    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _read_plain(self, data: bytes) -> None:
        self._unset_keepalive_if_required()
        while data:
            if self._missing:
                part = data[: self._missing]
                self._missing -= len(part)
                data = data[len(part) :]
                self._add_to_body(part)
            elif self._answering():
                self._held += data
                self.flow.pause_reading()
                return
            elif (request := read_plain(data)) is not None:
                self._begin(request)
                data = data[request.head_bytes :]
            else:
                self._plain = False
                super().data_received(data)
                return

    def _begin(self, request: Plain) -> None:
        """As uvicorn begins what h11 has read."""
        raw_path, _, query = request.target.partition(b"?")
        self.scope = {
            "type": "http",
            "asgi": {"version": self.asgi_version, "spec_version": "2.3"},
            "http_version": "1.1",
            "server": self.server,
            "client": self.client,
            "scheme": self.scheme,  # type: ignore[typeddict-item]
            "method": request.method.decode(),
            "root_path": self.root_path,
            "path": self.root_path + unquote(raw_path.decode()),
            "raw_path": self.root_path.encode() + raw_path,
            "query_string": query,
            "headers": request.headers,
            "state": self.app_state.copy(),
        }
        self.cycle = PlainCycle(
            self._hand_over,
            scope=self.scope,
            conn=self.conn,
            transport=self.transport,
            flow=self.flow,
            logger=self.logger,
            access_logger=self.access_logger,
            access_log=self.access_log,
            default_headers=self.server_state.default_headers,
            message_event=asyncio.Event(),
            on_response=self.on_response_complete,
        )
        self._missing = request.body_bytes
        self._add_to_body(b"")
        task = self.loop.create_task(self.cycle.run_asgi(self.app))
        task.add_done_callback(self.tasks.discard)
        self.tasks.add(task)

    def _add_to_body(self, part: bytes) -> None:
        if not self._answering():  # without it
            return
        self.cycle.body += part
        self.cycle.more_body = self._missing > 0
        if len(self.cycle.body) > HIGH_WATER_LIMIT:
            self.flow.pause_reading()
        if part or not self._missing:
            self.cycle.message_event.set()

    def _hand_over(self) -> None:
        """From here on h11 writes and reads: it is told of a request that stands where the present one does."""
        self._plain = False
        self.conn.receive_data(b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n" % self._missing)
        self.conn.next_event()
        if not self._missing:
            self.conn.next_event()
            if self._held:  # an empty one would say that nothing follows
                self.conn.receive_data(self._held)
        self._missing, self._held = 0, b""

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self._held and not self.transport.is_closing():
            held, self._held = self._held, b""
            self.data_received(held)

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
