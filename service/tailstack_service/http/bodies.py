"""Request bodies: bounded, timed, strictly read, with every problem at its place in what was sent."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from starlette.requests import Request

from tailstack.design import Design, load_design
from tailstack.design.reading import DEFAULT_LIMITS, Limits, Source, decode, read_text, shown
from tailstack.design.remembering import kept
from tailstack.errors import DesignError, LimitError, Problem, TailstackError

from ..problems import MalformedError, RequestError, TransportError
from ..settings import Settings, variable

JSON = "application/json"
YAML = ("application/yaml", "application/x-yaml", "text/yaml", "text/x-yaml")
DRAINED = 8_000_000  # bytes of an over-long body that are read and dropped, so that the refusal reaches its sender

# What the reader of documents says about text that is not a document at all.
SYNTAX = frozenset(
    {
        "bad-key", "duplicate-key", "empty-document", "json-syntax", "not-text", "several-documents", "yaml-alias",
        "yaml-syntax", "yaml-tag",
    }
)  # fmt: skip
SETTING_OF = {"/views": "max_views", "/fiducials/points": "max_fiducials", "/targets": "max_targets",
              "/requirements": "max_targets"}  # fmt: skip


class Placed(Exception):
    """A refusal that belongs to the design, with the pointer to the design in the body."""

    def __init__(self, error: TailstackError, prefix: str) -> None:
        super().__init__(str(error))
        self.error, self.prefix = error, prefix


def content_kind(request: Request, *, yaml: bool, raw: tuple[str, ...] = ()) -> str:
    """``json``, ``yaml`` or one of ``raw`` by the content type.  Raises TransportError 415."""
    header = request.headers.get("content-type", "")
    kind, _, parameters = header.partition(";")
    kind = kind.strip().lower()
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    charset = next(
        (p.split("=")[1].strip(' "').lower() for p in parameters.split(";") if "charset=" in p.lower()), "utf-8"
    )
    if encoding not in ("", "identity"):
        refused = f"the body is sent with Content-Encoding: {encoding[:40]}"
    elif charset not in ("utf-8", "utf8", "us-ascii"):
        refused = f"the body is sent as charset={charset[:40]}"
    elif kind == JSON or (kind.startswith("application/") and kind.endswith("+json")):
        return "json"
    elif yaml and kind in YAML:
        return "yaml"
    elif kind in raw:
        return kind
    else:
        refused = f"Content-Type: {header[:80]}" if header else "no Content-Type"
    accepted = ", ".join([JSON, *(YAML[:1] if yaml else ()), *raw])
    problem = Problem("", "content-type", f"this operation reads {accepted}; UTF-8, not compressed; got {refused}")
    raise TransportError("unsupported-media-type", problem)


async def read_body(request: Request, settings: Settings) -> bytes:
    """The body.  Raises LimitError (too long), TransportError 408 (too slow), MalformedError (empty)."""
    announced = request.headers.get("content-length", "")
    if announced.isdigit() and len(announced) < 19 and int(announced) > DRAINED + settings.max_body_bytes:
        raise _too_long(f"{int(announced)} bytes were announced", settings)
    chunks: list[bytes] = []
    size, more = 0, True
    try:
        async with asyncio.timeout(settings.body_seconds):
            while more:
                message = await request.receive()
                if message["type"] == "http.disconnect":
                    detail = f"the body broke off after {size} bytes"
                    raise MalformedError(Problem("", "incomplete-body", detail))
                chunk, more = message.get("body", b""), message.get("more_body", False)
                size += len(chunk)
                if size <= settings.max_body_bytes:
                    chunks.append(chunk)
                elif size > DRAINED + settings.max_body_bytes:
                    raise _too_long(f"more than {size} bytes arrived", settings)
    except TimeoutError:
        raise TransportError(
            "body-timeout",
            Problem(
                "",
                "too-slow",
                f"the body was not complete after {settings.body_seconds:g} s; {size} bytes arrived",
                f"send it faster, or start the service with a higher {variable('body_seconds')}",
            ),
            {"Connection": "close"},
        ) from None
    if size > settings.max_body_bytes:
        raise _too_long(f"{size} bytes arrived", settings)
    return b"".join(chunks)


def _too_long(arrived: str, settings: Settings) -> TailstackError:
    error = LimitError(
        Problem(
            "",
            "too-large",
            f"a request body may hold {settings.max_body_bytes} bytes; {arrived}",
            f"send less, or start the service with a higher {variable('max_body_bytes')}",
        )
    )
    return BodyTooLarge(error.problems)


class BodyTooLarge(LimitError):
    """The body itself is over the limit: 413 rather than 422."""


@kept  # hashing all settings would cost more
def limits_of(settings: Settings) -> Limits:
    """Bounds for the reader of designs."""
    return replace(
        DEFAULT_LIMITS,
        document_bytes=settings.max_body_bytes,
        fiducials=settings.max_fiducials,
        targets=settings.max_targets,
        views=settings.max_views,
    )


def parse_json(body: bytes, settings: Settings) -> dict[str, Any]:
    """The body as a mapping.  Raises MalformedError, RequestError (not a mapping), LimitError (too deep)."""
    try:
        text = decode(body, None)
        data = read_text(text, limits_of(settings), file=None, directory=None, form="json").data
    except DesignError as error:
        raise MalformedError(error.problems) from None
    if not isinstance(data, dict):
        hint = 'send {"design": {...}}'
        raise RequestError(Problem("", "wrong-type", f"the body is a JSON object; got {shown(data)}", hint))
    return data


def design_of(data: dict[str, Any], settings: Settings, field: str = "design") -> Design:
    """The design in a field of a JSON body.  Raises RequestError, or Placed around DesignError and LimitError."""
    if field not in data:
        if str(data.get("schema", "")).startswith("tailstack/design/"):
            hint = f'the body looks like the design itself: send {{"{field}": <it>}}'
        else:
            hint = "the design document goes here: GET /v1/schemas/design"
        raise RequestError(Problem("", "missing-field", f"the field {field!r} is required", hint))
    if not isinstance(data[field], dict):
        problem = Problem("", "wrong-type", f"a design is a mapping of fields; got {shown(data[field])}")
        raise Placed(DesignError(problem), f"/{field}")
    return loaded(Source(data[field], None, None), settings, f"/{field}")  # read strictly with the body: plain data


def loaded(source: Source | bytes, settings: Settings, prefix: str) -> Design:
    """A checked design from what was read, or from YAML.  Raises Placed, MalformedError for what is not YAML at all."""
    form: Any = "yaml" if isinstance(source, bytes) else "auto"
    try:
        return load_design(source, form=form, allow_files=False, limits=limits_of(settings))
    except DesignError as error:
        if isinstance(source, bytes) and all(p.code in SYNTAX and not p.pointer for p in error.problems):
            raise MalformedError(error.problems) from None
        raise Placed(error, prefix) from None
    except LimitError as error:
        raise Placed(LimitError(_with_settings(error.problems)), prefix) from None


def _with_settings(problems: Sequence[Problem]) -> list[Problem]:
    """Say which setting raises a limit."""
    return [
        replace(p, hint=f"send fewer, or start the service with a higher {variable(SETTING_OF[p.pointer])}")
        if p.code == "too-many" and p.pointer in SETTING_OF
        else p
        for p in problems
    ]
