"""Records as HTTP responses."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import Response

from tailstack.errors import TailstackError

from ..documents import to_json
from ..problems import ProblemDocument, TransportError, problem_document
from .preferences import matches

JSON = "application/json"
PROBLEM = "application/problem+json"


def path_of(request: Request) -> str:
    """The path that was asked for, as a URI reference says it, whatever Host says."""
    return quote(request.scope["path"], safe="/:@!$&'()*+,;=", errors="replace")


def record_response(record: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """A record as JSON."""
    return Response(to_json(record), status, headers, JSON)


def tagged_response(
    request: Request, body: bytes, media_type: str, headers: Mapping[str, str], tag: str | None = None
) -> Response:
    """200 with a strong entity tag, or 304 for a client that has these very bytes.  ``tag`` is their hash, if known."""
    tag = tag or hashlib.sha256(body).hexdigest()[:32]
    named = {**headers, "ETag": f'"{tag}"'}
    if matches(request, tag):
        return Response(b"", 304, named)
    return Response(body, 200, named, media_type)


def problem_response(
    error: TailstackError, *, instance: str, request_id: str, status: int | None = None, prefix: str = ""
) -> Response:
    """A refusal as application/problem+json."""
    document = problem_document(error, instance=instance, request_id=request_id, status=status, prefix=prefix)
    headers = error.headers if isinstance(error, TransportError) else None
    return stated_problem(document, headers)


def stated_problem(document: ProblemDocument, headers: Mapping[str, str] | None = None) -> Response:
    """A problem document with its own status."""
    return Response(to_json(document), document.status, headers, PROBLEM)
