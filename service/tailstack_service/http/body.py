"""The body of a request: of a kind that the operation reads, bounded in size and in time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from shlex import quote

from starlette.requests import Request

from tailstack.errors import LimitError, Problem, TailstackError

from ..environment import variable
from ..operations.request import refuse_query
from ..problems import MalformedError, TransportError
from ..processes.task import RawRequest
from .service import service_of

JSON = "application/json"
YAML = ("application/yaml", "application/x-yaml", "text/yaml", "text/x-yaml")
FORM = "application/x-www-form-urlencoded"
DRAINED = 8_000_000  # bytes of an over-long body that are read and dropped, so that the refusal reaches its sender


def strict_body(
    *, yaml: bool = True, raw: tuple[str, ...] = (), hint: str = "options go into the body, beside the design"
) -> Callable[[Request], Awaitable[RawRequest]]:
    """The dependency of an operation that reads a body: JSON, and YAML or ``raw`` where it takes them.

    ``hint``: what to do about a query parameter beside a JSON body, where there are none.
    """

    async def sent(request: Request) -> RawRequest:
        form = _form(request, yaml=yaml, raw=raw)
        body = await read_body(request, "max_step_bytes" if form in raw else "max_body_bytes")
        query = tuple(request.query_params.multi_items())
        if form == "json":
            refuse_query(query, (), hint)
        return RawRequest(form, body, query)

    return sent


def _form(request: Request, *, yaml: bool, raw: tuple[str, ...]) -> str:
    """``json``, ``yaml`` or one of ``raw`` by the content type.  Raises TransportError 415."""
    header = ", ".join(request.headers.getlist("content-type"))  # of two, neither counts
    kind, _, parameters = header.partition(";")
    kind = kind.strip().lower()
    encodings = [coding.strip().lower() for coding in ",".join(request.headers.getlist("content-encoding")).split(",")]
    encoding = ", ".join(coding for coding in encodings if coding not in ("", "identity"))
    named = [part.partition("=")[2] for part in parameters.split(";") if part.strip().lower().startswith("charset=")]
    charset = named[0].strip(" \"'").lower() if named else "utf-8"
    cure = ""
    if encoding:
        cure = "send it as it is"
        refused = f"the body is sent with Content-Encoding: {encoding[:40]}"
    elif charset not in ("utf-8", "utf8", "us-ascii"):
        refused = f"the body is sent as charset={charset[:40]}"
        cure = f"send the text as UTF-8, without charset: iconv -f {quote(charset[:40])} -t UTF-8 FILE makes it so"
    elif kind == JSON or (kind.startswith("application/") and kind.endswith("+json")):
        return "json"
    elif yaml and kind in YAML:
        return "yaml"
    elif kind in raw:
        return kind
    else:
        refused = f"Content-Type: {header[:80]}" if header else "no Content-Type"
    taken = [*(YAML[:1] if yaml else ()), *raw, JSON]
    if not cure:
        cure = f"send Content-Type: {' or '.join(taken)}, whichever the body is"
    if kind == FORM:
        cure += (
            f"; curl -d says {FORM} by itself and drops line ends: add -H 'Content-Type: {taken[0]}', and send "
            "--data-binary @FILE"
        )
    detail = f"this operation reads {', '.join([JSON, *taken[:-1]])}; UTF-8, not compressed; got {refused}"
    raise TransportError("unsupported-media-type", detail, cure, code="content-type")


async def read_body(request: Request, setting: str = "max_body_bytes") -> bytes:
    """The body, as long as a setting allows.

    Raises LimitError (too long), TransportError 408 (too slow), MalformedError (empty).
    """
    service = service_of(request)
    settings = service.settings
    limit: int = getattr(settings, setting)
    announced = request.headers.get("content-length", "")
    if announced.isdigit() and len(announced) < 19 and int(announced) > DRAINED + limit:
        raise _too_long(f"{int(announced)} bytes were announced", setting, limit)
    chunks: list[bytes] = []
    size, more = 0, True
    try:
        async with service.clock.timeout(settings.body_seconds):
            while more:
                message = await request.receive()
                if message["type"] == "http.disconnect":
                    detail = f"the body broke off after {size} bytes"
                    raise MalformedError(Problem("", "incomplete-body", detail))
                chunk, more = message.get("body", b""), message.get("more_body", False)
                size += len(chunk)
                if size <= limit:
                    chunks.append(chunk)
                elif size > DRAINED + limit:
                    raise _too_long(f"more than {size} bytes arrived", setting, limit)
    except TimeoutError:
        detail = f"the body was not complete after {settings.body_seconds:g} s; {size} bytes arrived"
        hint = f"send it faster, or start the service with a higher {variable('body_seconds')}"
        raise TransportError("body-timeout", detail, hint, {"Connection": "close"}, code="too-slow") from None
    if size > limit:
        raise _too_long(f"{size} bytes arrived", setting, limit)
    return b"".join(chunks)


def _too_long(arrived: str, setting: str, limit: int) -> TailstackError:
    hint = f"send less, or start the service with a higher {variable(setting)}"
    error = LimitError(Problem("", "too-large", f"a request body may hold {limit} bytes; {arrived}", hint))
    return BodyTooLarge(error.problems)


class BodyTooLarge(LimitError):
    """The body itself is over the limit: 413 rather than 422."""
