"""Every route of the service: method, path, name, who may use it, which query parameters mean something."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import cache

from starlette.requests import Request
from starlette.responses import Response

from tailstack.json_text import write_json

from . import events, information, jobs, results
from .answers import JSON
from .comparisons import create_comparison
from .conversions import create_conversion
from .gates import create_gate
from .operations import SCORES, VALIDATIONS, answering
from .posting import JOB_OPERATIONS, posting

Endpoint = Callable[[Request], Awaitable[Response]]


@dataclass(frozen=True, slots=True)
class Route:
    """One operation.  ``scope`` None: anybody may ask; ``query`` None: the endpoint looks at the query itself."""

    method: str
    path: str
    operation_id: str  # what generated clients call it
    endpoint: Endpoint
    scope: str | None = None
    query: tuple[str, ...] | None = ()


async def _openapi(_request: Request) -> Response:
    # putting it together takes seconds, which nobody else has to wait for
    return Response(await asyncio.to_thread(_document), media_type=JSON)


@cache
def _document() -> bytes:
    from .openapi import document

    return write_json(document()).encode()


ROUTES = (
    Route("POST", SCORES.path, "create_score", answering(SCORES), "compute", None),
    Route("POST", VALIDATIONS.path, "create_validation", answering(VALIDATIONS), "compute", None),
    Route("POST", "/v1/conversions", "create_conversion", create_conversion, "compute", None),
    *(
        Route("POST", operation.path, f"create_{operation.kind}", posting(operation), "compute", None)
        for operation in JOB_OPERATIONS
    ),
    Route("POST", "/v1/comparisons", "create_comparison", create_comparison, "compute", None),
    Route("POST", "/v1/gates", "create_gate", create_gate, "compute", None),
    Route("GET", "/v1/jobs", "list_jobs", jobs.list_jobs, "read", ("limit", "cursor", "state", "kind")),
    Route("GET", "/v1/jobs/{id}", "get_job", jobs.get_job, "read"),
    Route("GET", "/v1/jobs/{id}/events", "get_job_events", events.get_events, "read", ("after",)),
    Route("POST", "/v1/jobs/{id}/cancel", "cancel_job", jobs.cancel_job, "compute"),
    Route("GET", "/v1/jobs/{id}/result", "get_job_result", jobs.get_job_result, "read"),
    Route("GET", "/v1/results/{sha256}", "get_result", results.get_result, "read"),
    Route("GET", "/v1/results/{sha256}/report", "get_report", results.get_report, "read", ("format",)),
    Route("GET", "/v1/schemas", "list_schemas", information.schemas, query=None),
    Route("GET", "/v1/schemas/{name}", "get_schema", information.schema, query=None),
    Route("GET", "/v1/problems/{slug}", "get_problem_type", information.problem_type, query=None),
    Route("GET", "/health/live", "get_liveness", information.liveness, query=None),
    Route("GET", "/health/ready", "get_readiness", information.readiness, query=None),
    Route("GET", "/metrics", "get_metrics", information.metrics, "metrics", None),
    Route("GET", "/version", "get_version", information.version, query=None),
    Route("GET", "/openapi.json", "get_openapi", _openapi, query=None),
)
