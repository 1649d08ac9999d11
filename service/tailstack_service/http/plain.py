"""Requests that can be read at a glance, and answers that can be written in one piece: all that most clients send.

h11 is strict and slow: a tenth of a score is spent on one head, one body and one answer.  What is taken here h11 would
take too, and find the same in it, which a test holds; whatever is not as plain is h11's to judge.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, RequestResponseCycle

if TYPE_CHECKING:
    from uvicorn._types import ASGISendEvent, HTTPResponseStartEvent

_HEAD = re.compile(rb"(GET|POST) ([!-~]+) HTTP/1\.1\r\n((?:[-!#$%&'*+.^_`|~0-9A-Za-z]+:[ -~]*\r\n)+)\r\n")
_FIELD = re.compile(rb"([^:]+):([^\r]*)\r\n")
_FOR_H11 = frozenset({b"expect", b"transfer-encoding", b"upgrade"})
_KEPT = b"keep-alive"
_LONGEST_LENGTH = 9  # digits


class Plain(NamedTuple):
    """The head of a request."""

    method: bytes
    target: bytes
    headers: list[tuple[bytes, bytes]]  # names in lower case
    head_bytes: int
    body_bytes: int


def read_plain(data: bytes) -> Plain | None:
    """The request whose head is at the beginning of ``data``; None if it is not whole or not plain."""
    found = _HEAD.match(data)
    if found is None:
        return None
    method, target, fields = found.groups()
    headers = [(name.lower(), value.strip()) for name, value in _FIELD.findall(fields)]
    once = dict(headers)
    length = once.get(b"content-length", b"0")
    if (
        len(once) < len(headers)
        or b"host" not in once
        or not _FOR_H11.isdisjoint(once)
        or once.get(b"connection", _KEPT).lower() != _KEPT
        or not length.isdigit()
        or len(length) > _LONGEST_LENGTH
    ):
        return None
    return Plain(method, target, headers, found.end(), int(length))


class PlainCycle(RequestResponseCycle):
    """Answers a plain request.  An answer without a length, in pieces, or the last one of its connection is h11's:
    ``hand_over`` is called before its first message."""

    def __init__(self, hand_over: Callable[[], None], **of_uvicorn: Any) -> None:
        super().__init__(**of_uvicorn)
        self._hand_over: Callable[[], None] | None = hand_over
        self._start: HTTPResponseStartEvent | None = None  # waits for the body

    async def send(self, message: ASGISendEvent) -> None:
        if self._hand_over is None or self.response_complete:
            await super().send(message)
        elif message["type"] == "http.response.start" and _has_length(message):
            self._start = message
        elif self._start is not None and (answer := self._whole(self._start, message)):
            if self.flow.write_paused:
                await self.flow.drain()
            if self.disconnected:
                return
            self.response_started = self.response_complete = True
            self.message_event.set()
            self.transport.writelines(answer)
            self.on_response()
        else:
            self._hand_over()
            self._hand_over = None
            if self._start is not None:
                await super().send(self._start)
            await super().send(message)

    def _whole(self, start: HTTPResponseStartEvent, message: ASGISendEvent) -> tuple[bytes, bytes] | None:
        """Head and body; None if this is not all of it, or not in order."""
        headers = [*self.default_headers, *start.get("headers", ())]
        if message["type"] != "http.response.body" or message.get("more_body") or not self.keep_alive:
            return None
        body = message.get("body", b"")
        if (b"content-length", b"%d" % len(body)) not in headers:
            return None
        lines = b"".join([b"%b: %b\r\n" % header for header in headers])
        if not lines.count(b"\r") == lines.count(b"\n") == len(headers) or b"\0" in lines:  # which h11 refuses
            return None
        status = start["status"]
        return b"HTTP/1.1 %d %b\r\n%b\r\n" % (status, STATUS_PHRASES[status], lines), body


def _has_length(start: HTTPResponseStartEvent) -> bool:
    names = {name for name, _ in start.get("headers", ())}
    return b"content-length" in names and b"connection" not in names
