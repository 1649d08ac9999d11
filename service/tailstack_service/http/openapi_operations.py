"""What the OpenAPI document says of each operation: summary, parameters, body, answers, the problems that can come."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ..store.tables import STATES
from ..work.kinds import KINDS
from .conversions import FORMATS, RAW
from .gates import IN_QUERY
from .jobs import LARGEST_PAGE, PAGE
from .openapi_components import COMPONENT, HEADERS, reference, request_name
from .operations import OPERATIONS, Operation
from .options import Options
from .posting import JOB_OPERATIONS, JobOperation
from .results import FORMATS as REPORT_FORMATS
from .routes import Route

JSON, YAML = "application/json", "application/yaml"
REQUEST_ID = {"X-Request-ID": reference("headers", "RequestId")}
BODY_PROBLEMS = (400, 408, 413, 415, 422, 503)
REPORT_MEDIA = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "json": JSON,
}


def operation_of(route: Route) -> dict[str, Any]:
    """The operation object of a route."""
    described = _DESCRIBED[route.operation_id]()
    statuses = {421, 500, *described.pop("problems", ()), *((401, 403) if route.scope else ())}
    if route.method == "POST":
        statuses.add(403)  # a page of another site, where there is no authentication
    responses = described["responses"]
    for status in sorted(statuses):
        responses[str(status)] = reference("responses", f"Problem{status}")
    for response in responses.values():
        if "$ref" not in response:
            response["headers"] = {**REQUEST_ID, **response.get("headers", {})}
    described["responses"] = dict(sorted(responses.items()))
    return {
        "operationId": route.operation_id,
        **described,
        "security": [{"bearer": [route.scope]}] if route.scope else [],
    }


def _headers(**named: str) -> dict[str, Any]:
    """Header components by header name, underscores for hyphens."""
    return {name.replace("_", "-"): reference("headers", component) for name, component in named.items()}


def _only_with(words: str, headers: Mapping[str, Any]) -> dict[str, Any]:
    """The same headers, which come only under a condition."""
    made = {}
    for name, header in headers.items():
        known = HEADERS[header["$ref"].rpartition("/")[2]]
        made[name] = {**known, "description": f"{known['description']} Only {words}.", "required": False}
    return made


def _content(media: str, schema: dict[str, Any], example: str | None = None) -> dict[str, Any]:
    entry: dict[str, Any] = {"schema": schema}
    if example is not None:
        entry["examples"] = {"example": reference("examples", example)}
    return {media: entry}


def _answer(description: str, content: Mapping[str, Any] | None = None, **headers: str) -> dict[str, Any]:
    response: dict[str, Any] = {"description": description}
    if headers:
        response["headers"] = _headers(**headers)
    if content is not None:
        response["content"] = content
    return response


def _parameter(name: str) -> dict[str, str]:
    return reference("parameters", name)


def _query(name: str, schema: dict[str, Any], description: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "required": False, "description": description, "schema": schema}


# --- computations -----------------------------------------------------------------------------------


def _option_parameters(options: type[Options]) -> list[dict[str, Any]]:
    schema = options.model_json_schema().get("properties", {})
    renamed = {option: name for name, option in options.in_query().items()}
    made = []
    for option, described in schema.items():
        words = f"Only with a YAML body. {described.get('description', '')}".strip()
        if option in renamed:
            made.append(_query(renamed[option], {"type": "array", "items": _ITEM[renamed[option]]}, words))
        else:
            kept = {key: value for key, value in described.items() if key not in ("title", "description")}
            made.append(_query(option, _without_null(kept), words))
    return made


_ITEM: dict[str, dict[str, Any]] = {
    "set": {"type": "string", "pattern": "^[^=]+=.+$", "examples": ["views.AP.fiducial_noise_px=0.1:0.5:5"]},
    "part": {"type": "string", "enum": ["score", "verification", "optimisation"]},
}


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Absence is how a query says null."""
    if "anyOf" not in schema:
        return schema
    return next(entry for entry in schema["anyOf"] if entry.get("type") != "null")


def _request_body(name: str, **more: Any) -> dict[str, Any]:
    content = _content(JSON, reference("schemas", name), name)
    content |= _content(YAML, reference("schemas", "Design"), "DesignAsYaml")
    return {"required": True, "content": content | more}


def _computation(operation: Operation) -> dict[str, Any]:
    answer = _content(JSON, reference("schemas", COMPONENT[operation.answer]))
    return {
        "summary": operation.summary,
        "tags": ["computations"],
        "parameters": _option_parameters(operation.options),
        "requestBody": _request_body(request_name(operation.path)),
        "responses": {"200": _answer(f"{operation.summary}.", answer)},
        "problems": BODY_PROBLEMS,
    }


def _links() -> dict[str, Any]:
    """From a job to what can be asked of it."""
    return {
        operation_id: {"operationId": operation_id, "parameters": {"id": "$response.body#/id"}}
        for operation_id in ("get_job", "get_job_events", "get_job_result", "cancel_job")
    }


def _result_links() -> dict[str, Any]:
    """From a job that has succeeded to its result."""
    return {
        operation_id: {"operationId": operation_id, "parameters": {"sha256": "$response.body#/result_sha256"}}
        for operation_id in ("get_result", "get_report")
    }


def _job_answers(summary: str, answer: str, at_once: str) -> dict[str, Any]:
    done = _answer(
        f"{summary}: {at_once}.", _content(JSON, reference("schemas", answer)), ETag="ETag",
        Cache_Control="CacheControl", Vary="Vary", Location="Location", Content_Location="ResultLocation",
        Preference_Applied="PreferenceApplied", Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    accepted = _answer(
        "Accepted: the job.", _content(JSON, reference("schemas", "Job"), "Job"), Location="Location",
        Retry_After="RetryAfter", Cache_Control="CacheControl", Preference_Applied="PreferenceApplied",
        Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    return {"200": done, "202": {**accepted, "links": _links()}}


def _job(operation: JobOperation) -> dict[str, Any]:
    return {
        "summary": operation.summary,
        "description": "Becomes a job. With Prefer: wait=N the answer is the result itself (200), or the problem that "
        "it came to, if that is known within N seconds.",
        "tags": ["computations"],
        "parameters": [
            _parameter("Prefer"), _parameter("IdempotencyKey"), *_option_parameters(operation.options),
        ],
        "requestBody": _request_body(request_name(operation.path)),
        "responses": _job_answers(operation.summary, COMPONENT[operation.kind], "with Prefer: wait, in time"),
        "problems": (*BODY_PROBLEMS, 429),
    }  # fmt: skip


def _comparison() -> dict[str, Any]:
    summary = "Two designs side by side"
    return {
        "summary": summary,
        "description": "Both are checked alike with one seed; differences have an interval. Becomes a job.",
        "tags": ["computations"],
        "parameters": [_parameter("Prefer"), _parameter("IdempotencyKey")],
        "requestBody": {
            "required": True,
            "content": _content(JSON, reference("schemas", "ComparisonRequest"), "ComparisonRequest"),
        },
        "responses": _job_answers(summary, COMPONENT["comparison"], "with Prefer: wait, in time"),
        "problems": (*BODY_PROBLEMS, 429),
    }


def _gate() -> dict[str, Any]:
    from ..gate.request import GateRequest

    properties = GateRequest.model_json_schema()["properties"]
    options = []
    for name in IN_QUERY:
        kept = {key: value for key, value in properties[name].items() if key not in ("title", "description")}
        words = f"Only with a YAML body. {properties[name].get('description', '')}"
        options.append(_query(name, _without_null(kept), words))
    answers = _job_answers("The verdict", COMPONENT["gate"], "mode analytic, or with Prefer: wait in time")
    answers["200"]["headers"] = _only_with("when it was a job", answers["200"]["headers"])
    return {
        "summary": "Policy and designs to a verdict",
        "description": "Mode analytic is answered at once; verify and auto become a job.",
        "tags": ["computations"],
        "parameters": [_parameter("Prefer"), _parameter("IdempotencyKey"), *options],
        "requestBody": _request_body("GateRequest"),
        "responses": answers,
        "problems": (*BODY_PROBLEMS, 429),
    }


def _conversion() -> dict[str, Any]:
    formats = {"type": "string", "enum": list(FORMATS)}
    body = _content(JSON, reference("schemas", "ConversionRequest"), "ConversionRequest")
    body |= _content(YAML, reference("schemas", "Design"), "DesignAsYaml")
    for media in RAW:
        body |= _content(media, {"type": "string"}, "Csv")
    return {
        "summary": "Fiducial files and designs into one another",
        "description": "In memory: no file is read, nothing is fetched. With text/plain, from says what the text is.",
        "tags": ["computations"],
        "parameters": [
            _query("from", formats, "Not with a JSON body. What the content is; text/csv and YAML say it themselves."),
            _query("to", {**formats, "default": "yaml"}, "Not with a JSON body. What to make of it."),
        ],
        "requestBody": {"required": True, "content": body},
        "responses": {"200": _answer("The converted text.", _content(JSON, reference("schemas", "Conversion")))},
        "problems": BODY_PROBLEMS,
    }


# --- jobs and results -------------------------------------------------------------------------------


def _list_jobs() -> dict[str, Any]:
    page = _answer(
        "A page, newest first.", _content(JSON, reference("schemas", "JobPage"), "JobPage"), Link="Link",
        Cache_Control="CacheControl",
    )  # fmt: skip
    first = {"operationId": "get_job", "parameters": {"id": "$response.body#/jobs/0/id"}}
    return {
        "summary": "Jobs, newest first",
        "tags": ["jobs"],
        "parameters": [
            _query(
                "limit", {"type": "integer", "minimum": 1, "maximum": LARGEST_PAGE, "default": PAGE}, "Jobs a page."
            ),
            _query("cursor", {"type": "string"}, "From the field next, or the Link header, of the page before."),
            _query("state", {"type": "string", "enum": list(STATES)}, "Only jobs in this state."),
            _query("kind", {"type": "string", "enum": list(KINDS)}, "Only jobs of this kind."),
        ],
        "responses": {"200": {**page, "links": {"get_job": first}}},
        "problems": (422, 503),
    }


def _get_job() -> dict[str, Any]:
    record = _answer(
        "The record.", _content(JSON, reference("schemas", "Job"), "Job"), ETag="ETag", Cache_Control="CacheControl",
        Retry_After="RetryAfter",
    )  # fmt: skip
    unchanged = _answer("Unchanged.", ETag="ETag", Cache_Control="CacheControl", Retry_After="RetryAfter")
    return {
        "summary": "State, progress, problem and links of a job",
        "tags": ["jobs"],
        "parameters": [_parameter("JobId"), _parameter("IfNoneMatch")],
        "responses": {"200": {**record, "links": _links() | _result_links()}, "304": unchanged},
        "problems": (404, 422, 503),
    }


def _get_job_events() -> dict[str, Any]:
    stream = _content("text/event-stream", reference("schemas", "JobEvent"), "JobEvent")  # of each event
    return {
        "summary": "What happens to a job, as server-sent events",
        "description": "The schema is that of one event. Events state, progress and recomputed; id counts them from 1, "
        "data is one JSON object. The stream begins after Last-Event-ID (or after), heartbeats are comments, and it "
        "ends after the final state.",
        "tags": ["jobs"],
        "parameters": [_parameter("JobId"), _parameter("LastEventID"), _parameter("After")],
        "responses": {
            "200": _answer("The stream.", stream, Cache_Control="CacheControl", X_Accel_Buffering="Unbuffered"),
            "204": _answer("The job has ended and the client has seen everything: stop asking."),
        },
        "problems": (404, 422, 429, 503),
    }


def _cancel_job() -> dict[str, Any]:
    job = _content(JSON, reference("schemas", "Job"), "Job")
    return {
        "summary": "Cancel a job",
        "description": "Nothing of it can be recorded from then on. Again 202 for a job that was cancelled before.",
        "tags": ["jobs"],
        "parameters": [_parameter("JobId")],
        "responses": {"202": {**_answer("Cancelled.", job, Cache_Control="CacheControl"), "links": _links()}},
        "problems": (404, 409, 422, 503),
    }


def _get_job_result() -> dict[str, Any]:
    there = _answer("The result is there.", Location="ResultLocation", Cache_Control="CacheControl")
    return {
        "summary": "From a job to its result",
        "description": "A job that failed answers with its own problem and that problem's status.",
        "tags": ["jobs"],
        "parameters": [_parameter("JobId")],
        "responses": {"303": there},
        "problems": (404, 409, 422, 503),
    }


def _get_result() -> dict[str, Any]:
    kept = {"ETag": "ETag", "Cache_Control": "CacheControl", "Vary": "Vary"}
    any_of = [reference("schemas", COMPONENT[kind]) for kind in KINDS]
    return {
        "summary": "A result, which never changes",
        "tags": ["results"],
        "parameters": [_parameter("Sha256"), _parameter("IfNoneMatch")],
        "responses": {
            "200": _answer("The result.", _content(JSON, {"oneOf": any_of}), **kept),
            "304": _answer("The client has it.", None, **kept),
        },
        "problems": (404, 422, 503),
    }


def _get_report() -> dict[str, Any]:
    formats = {"type": "string", "enum": list(REPORT_FORMATS), "default": "html"}
    sent = {
        "ETag": "ETag", "Cache_Control": "CacheControl", "Content_Disposition": "ContentDisposition",
        "Content_Security_Policy": "ContentSecurityPolicy", "X_Content_Type_Options": "ContentTypeOptions",
    }  # fmt: skip
    content: dict[str, Any] = {}
    for form in REPORT_FORMATS:
        schema = {"type": "object"} if form == "json" else {"type": "string"} if form == "html" else {}
        content |= _content(REPORT_MEDIA[form], schema)
    return {
        "summary": "A result as a report",
        "tags": ["results"],
        "parameters": [_parameter("Sha256"), _query("format", formats, "Of the report."), _parameter("IfNoneMatch")],
        "responses": {
            "200": _answer("The report.", content, **sent),
            "304": _answer("The client has it.", None, **sent),
        },
        "problems": (404, 422, 501, 503),
    }


# --- information ------------------------------------------------------------------------------------


def _information(summary: str, schema: dict[str, Any], media: str = JSON, **more: Any) -> dict[str, Any]:
    return {
        "summary": summary,
        "tags": ["information"],
        "responses": {"200": _answer(f"{summary}.", _content(media, schema))},
        **more,
    }


def _named(name: str, words: str, example: str) -> dict[str, Any]:
    return {
        "name": name, "in": "path", "required": True, "description": words, "schema": {"type": "string"},
        "example": example,
    }  # fmt: skip


def _readiness() -> dict[str, Any]:
    content = _content(JSON, reference("schemas", "Readiness"))
    return {
        "summary": "Whether requests should be sent here",
        "description": "Kernels are compiled and the database can be used. Jobs wait while workers is 0.",
        "tags": ["information"],
        "responses": {
            "200": _answer("Ready.", content, Cache_Control="CacheControl"),
            "503": _answer("Warming up, stopping, without its database, or broken; see status.", content,
                           Retry_After="ComeBack", Cache_Control="CacheControl"),
        },
    }  # fmt: skip


_DESCRIBED: dict[str, Callable[[], dict[str, Any]]] = {
    **{f"create_{entry.answer}": partial(_computation, entry) for entry in OPERATIONS},
    **{f"create_{entry.kind}": partial(_job, entry) for entry in JOB_OPERATIONS},
    "create_comparison": _comparison,
    "create_gate": _gate,
    "create_conversion": _conversion,
    "list_jobs": _list_jobs,
    "get_job": _get_job,
    "get_job_events": _get_job_events,
    "cancel_job": _cancel_job,
    "get_job_result": _get_job_result,
    "get_result": _get_result,
    "get_report": _get_report,
    "list_schemas": lambda: _information("Published schemas", reference("schemas", "SchemaList")),
    "get_schema": lambda: _information(
        "One JSON Schema (draft 2020-12)", {"type": "object"}, "application/schema+json",
        parameters=[_named("name", "Name of a published schema.", "design")], problems=(404,),
    ),
    "get_problem_type": lambda: _information(
        "What a class of problems means and what cures it", reference("schemas", "ProblemType"),
        parameters=[_named("slug", "Last part of the type of a problem.", "invalid-design")], problems=(404,),
    ),
    "get_liveness": lambda: _information("The process answers", reference("schemas", "Health")),
    "get_readiness": _readiness,
    "get_metrics": lambda: _information(
        "Figures for Prometheus", {"type": "string"}, "text/plain; version=0.0.4; charset=utf-8"
    ),
    "get_version": lambda: _information("Version and documents", reference("schemas", "Version")),
    "get_openapi": lambda: _information("This document", {"type": "object"}),
}  # fmt: skip
