"""What the OpenAPI document says of each operation: summary, parameters, body, answers, the problems that can come."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fastapi.routing import APIRoute

from . import openapi_computations, openapi_jobs
from .dependencies import Needs
from .openapi_components import ANSWERED, reference
from .openapi_objects import JSON, media_types, response_of
from .operations import JOB_OPERATIONS, OPERATIONS

REQUEST_ID = {"X-Request-ID": reference("headers", "RequestId")}


def operation_of(route: APIRoute) -> dict[str, Any]:
    """The operation object of a route."""
    described = _DESCRIBED[str(route.operation_id)]()
    scope = next((one.dependency.scope for one in route.dependencies if isinstance(one.dependency, Needs)), None)
    statuses = {421, 500, *described.pop("problems", ()), *((401, 403) if scope else ())}
    if "POST" in (route.methods or ()):
        statuses.add(403)  # a page of another site, where there is no authentication
    responses = described["responses"]
    _show_answer(str(route.operation_id), responses.get("200", {}).get("content", {}).get(JSON))
    for status in sorted(statuses):
        responses[str(status)] = reference("responses", f"Problem{status}")
    for response in responses.values():
        if "$ref" not in response:
            response["headers"] = {**REQUEST_ID, **response.get("headers", {})}
    described["responses"] = dict(sorted(responses.items()))
    return {
        "operationId": route.operation_id,
        **described,
        "security": [{"bearer": [scope]}] if scope else [],
    }


SHOWN_BY = {"get_result": "create_verification", "get_report": "create_verification"}


def _show_answer(operation_id: str, content: dict[str, Any] | None) -> None:
    """Put an example into the content of a 200 that has none, where a service's own answer is at hand."""
    name = SHOWN_BY.get(operation_id, operation_id)
    if content is not None and name in ANSWERED:
        content.setdefault("examples", {"example": reference("examples", name)})


def _information(
    summary: str, description: str, schema: dict[str, Any], media: str = JSON, **more: Any
) -> dict[str, Any]:
    return {
        "summary": summary,
        "description": description,
        "tags": ["information"],
        "responses": {"200": response_of(f"{summary}.", media_types(media, schema))},
        **more,
    }


def _named(name: str, words: str, example: str) -> dict[str, Any]:
    return {
        "name": name, "in": "path", "required": True, "description": words, "schema": {"type": "string"},
        "example": example,
    }  # fmt: skip


def _readiness() -> dict[str, Any]:
    content = media_types(JSON, reference("schemas", "Readiness"))
    return {
        "summary": "Whether requests should be sent here",
        "description": "Kernels are compiled and the database can be used. Jobs wait while workers is 0.",
        "tags": ["information"],
        "responses": {
            "200": response_of("Ready.", content, Cache_Control="CacheControl"),
            "503": response_of("Warming up, stopping, without its database, or broken; see status.", content,
                           Retry_After="ComeBack", Cache_Control="CacheControl"),
        },
    }  # fmt: skip


_DESCRIBED: dict[str, Callable[[], dict[str, Any]]] = {
    **{f"create_{entry.answer}": partial(openapi_computations.computation, entry) for entry in OPERATIONS},
    **{f"create_{entry.kind}": partial(openapi_computations.job, entry) for entry in JOB_OPERATIONS},
    "create_comparison": openapi_computations.comparison,
    "create_gate": openapi_computations.gate,
    "create_conversion": openapi_computations.conversion,
    "list_jobs": openapi_jobs.list_jobs,
    "get_job": openapi_jobs.get_job,
    "get_job_events": openapi_jobs.get_job_events,
    "cancel_job": openapi_jobs.cancel_job,
    "get_job_result": openapi_jobs.get_job_result,
    "get_result": openapi_jobs.get_result,
    "get_report": openapi_jobs.get_report,
    "list_schemas": lambda: _information(
        "Published schemas", "Every document that is sent or answered, with the path of its JSON Schema.",
        reference("schemas", "SchemaList"),
    ),
    "get_schema": lambda: _information(
        "One JSON Schema (draft 2020-12)", "The same as tailstack schema NAME prints.",
        {"type": "object"}, "application/schema+json",
        parameters=[_named("name", "Name of a published schema.", "design")], problems=(404,),
    ),
    "get_problem_type": lambda: _information(
        "What a class of problems means and what cures it", "Where the field type of a problem leads.",
        reference("schemas", "ProblemType"),
        parameters=[_named("slug", "Last part of the type of a problem.", "invalid-design")], problems=(404,),
    ),
    "get_liveness": lambda: _information(
        "The process answers", "It looks at nothing else: /health/ready says whether requests should be sent here.",
        reference("schemas", "Health"),
    ),
    "get_readiness": _readiness,
    "get_metrics": lambda: _information(
        "Figures for Prometheus", "Counters of this process; of jobs and workers too while the database answers.",
        {"type": "string"}, "text/plain; version=0.0.4; charset=utf-8"
    ),
    "get_version": lambda: _information(
        "Version and documents", "Of the service, and which documents it reads and writes.",
        reference("schemas", "Version"),
    ),
    "get_openapi": lambda: _information(
        "This document", "OpenAPI 3.1, as tailstack openapi prints it.", {"type": "object"}
    ),
}  # fmt: skip
