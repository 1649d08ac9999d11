"""Records as HTTP responses."""

from __future__ import annotations

from typing import Any

from starlette.responses import Response

from tailstack.errors import TailstackError

from ..documents import to_json
from ..problems import TransportError, problem_document

PROBLEM = "application/problem+json"


def record_response(record: Any) -> Response:
    """200 with a record as JSON."""
    return Response(to_json(record), media_type="application/json")


def problem_response(
    error: TailstackError, *, instance: str, request_id: str, status: int | None = None, prefix: str = ""
) -> Response:
    """A refusal as application/problem+json."""
    document = problem_document(error, instance=instance, request_id=request_id, status=status, prefix=prefix)
    headers = error.headers if isinstance(error, TransportError) else None
    return Response(to_json(document), document.status, headers, PROBLEM)
