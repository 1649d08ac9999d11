"""What the OpenAPI document says of jobs and of their results."""

from __future__ import annotations

from typing import Any

from ..jobs.store.tables import STATES
from ..work.kinds import KINDS
from .jobs import FORMATS as REPORT_FORMATS
from .jobs import LARGEST_PAGE, PAGE
from .openapi_components import COMPONENT, reference
from .openapi_objects import JSON, job_links, media_types, parameter, query_parameter, response_of, result_links

REPORT_MEDIA = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "json": JSON,
}


def list_jobs() -> dict[str, Any]:
    """GET /v1/jobs"""
    page = response_of(
        "A page, newest first.", media_types(JSON, reference("schemas", "JobPage"), "JobPage"), Link="Link",
        Cache_Control="CacheControl",
    )  # fmt: skip
    first = {"operationId": "get_job", "parameters": {"id": "$response.body#/jobs/0/id"}}
    return {
        "summary": "Jobs, newest first",
        "description": "Those of the caller's tenant. The field next and the Link header lead to the next page.",
        "tags": ["jobs"],
        "parameters": [
            query_parameter(
                "limit", {"type": "integer", "minimum": 1, "maximum": LARGEST_PAGE, "default": PAGE}, "Jobs a page."
            ),
            query_parameter(
                "cursor",
                {"type": "string"},
                "From the field next, or the Link header, of the page before; empty: the first page.",
            ),
            query_parameter("state", {"type": "string", "enum": list(STATES)}, "Only jobs in this state."),
            query_parameter("kind", {"type": "string", "enum": list(KINDS)}, "Only jobs of this kind."),
        ],
        "responses": {"200": {**page, "links": {"get_job": first}}},
        "problems": (422, 503),
    }


def get_job() -> dict[str, Any]:
    """GET /v1/jobs/{id}"""
    record = response_of(
        "The record.", media_types(JSON, reference("schemas", "Job"), "Job"), ETag="ETag", Cache_Control="CacheControl",
        Retry_After="RetryAfter",
    )  # fmt: skip
    unchanged = response_of("Unchanged.", ETag="ETag", Cache_Control="CacheControl", Retry_After="RetryAfter")
    return {
        "summary": "State, progress, problem and links of a job",
        "description": "While it runs, Retry-After says when it is worth asking again; with If-None-Match the answer "
        "is 304 until something has changed.",
        "tags": ["jobs"],
        "parameters": [parameter("JobId"), parameter("IfNoneMatch")],
        "responses": {"200": {**record, "links": job_links() | result_links()}, "304": unchanged},
        "problems": (404, 422, 503),
    }


def get_job_events() -> dict[str, Any]:
    """GET /v1/jobs/{id}/events"""
    stream = media_types("text/event-stream", reference("schemas", "JobEvent"), "JobEvent")  # of each event
    return {
        "summary": "What happens to a job, as server-sent events",
        "description": "The schema is that of one event. Events state, progress and recomputed; id counts them from 1, "
        "data is one JSON object. The stream begins after Last-Event-ID (or after), heartbeats are comments, and it "
        "ends after the final state.",
        "tags": ["jobs"],
        "parameters": [parameter("JobId"), parameter("LastEventID"), parameter("After")],
        "responses": {
            "200": response_of("The stream.", stream, Cache_Control="CacheControl", X_Accel_Buffering="Unbuffered"),
            "204": response_of("The job has ended and the client has seen everything: stop asking."),
        },
        "problems": (404, 422, 429, 503),
    }


def cancel_job() -> dict[str, Any]:
    """POST /v1/jobs/{id}/cancel"""
    job = media_types(JSON, reference("schemas", "Job"), "Job")
    return {
        "summary": "Cancel a job",
        "description": "Nothing of it can be recorded from then on. Again 202 for a job that was cancelled before.",
        "tags": ["jobs"],
        "parameters": [parameter("JobId")],
        "responses": {"202": {**response_of("Cancelled.", job, Cache_Control="CacheControl"), "links": job_links()}},
        "problems": (404, 409, 422, 503),
    }


def get_job_result() -> dict[str, Any]:
    """GET /v1/jobs/{id}/result"""
    there = response_of("The result is there.", Location="ResultLocation", Cache_Control="CacheControl")
    return {
        "summary": "From a job to its result",
        "description": "A job that failed answers with its own problem and that problem's status.",
        "tags": ["jobs"],
        "parameters": [parameter("JobId")],
        "responses": {"303": there},
        "problems": (404, 409, 422, 503),
    }


def get_result() -> dict[str, Any]:
    """GET /v1/results/{sha256}"""
    kept = {"ETag": "ETag", "Cache_Control": "CacheControl", "Vary": "Vary"}
    any_of = [reference("schemas", COMPONENT[kind]) for kind in KINDS]
    return {
        "summary": "A result, which never changes",
        "description": "It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which "
        "record it is.",
        "tags": ["results"],
        "parameters": [parameter("Sha256"), parameter("IfNoneMatch")],
        "responses": {
            "200": response_of("The result.", media_types(JSON, {"oneOf": any_of}), **kept),
            "304": response_of("The client has it.", None, **kept),
        },
        "problems": (404, 422, 503),
    }


def _report_schema(form: str) -> dict[str, Any]:
    if form == "json":
        return {"type": "object"}
    if form == "html":
        return {"type": "string"}
    # bytes: contentMediaType is how 3.1 says it, format what generators of clients look at
    return {"type": "string", "format": "binary", "contentMediaType": REPORT_MEDIA[form]}


def get_report() -> dict[str, Any]:
    """GET /v1/results/{sha256}/report"""
    formats = {"type": "string", "enum": list(REPORT_FORMATS), "default": "html"}
    sent = {
        "ETag": "ETag", "Cache_Control": "CacheControl", "Content_Disposition": "ContentDisposition",
        "Content_Security_Policy": "ContentSecurityPolicy", "X_Content_Type_Options": "ContentTypeOptions",
    }  # fmt: skip
    content: dict[str, Any] = {}
    for form in REPORT_FORMATS:
        content |= media_types(REPORT_MEDIA[form], _report_schema(form))
    return {
        "summary": "A result as a report",
        "description": "Any result, rendered for people: html (one self-contained file), pdf, xlsx; or json, the "
        "record itself. Nothing is computed anew, and the record stands in every format.",
        "tags": ["results"],
        "parameters": [
            parameter("Sha256"),
            query_parameter("format", formats, "Of the report."),
            parameter("IfNoneMatch"),
        ],
        "responses": {
            "200": response_of("The report.", content, **sent),
            "304": response_of("The client has it.", None, **sent),
        },
        "problems": (404, 422, 501, 503),
    }
