"""The OpenAPI 3.1 document: FastAPI's own, of the routes as they are declared, with one overlay.

Bodies are read by our own strict reader, so their schemas are given by the routes; the overlay adds the published
schemas, what every answer has (a request id, the problems that can come) and examples of requests.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from tailstack import __version__
from tailstack.results.json_text import write_json

from ..console.flags import list_options
from ..documents import record_json_schema
from ..operations.example import EXAMPLE_DESIGN
from ..operations.operation import Operation
from ..operations.patches import NAMED, PATCH
from ..operations.registry import OPERATIONS
from ..operations.rendering import MEDIA_TYPES
from ..problems import CATALOGUE
from ..schemas import json_schema
from .dependencies import Needs
from .problems import PROBLEM

JSON, YAML = "application/json", "application/yaml"
RETRIED = frozenset({409, 429, 503})
EXAMPLE_ID = "01k4z8t5r2w7x3y9v6n1m0q8pc"
EXAMPLE_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


def reference(kind: str, name: str) -> dict[str, str]:
    """A reference to a component."""
    return {"$ref": f"#/components/{kind}/{name}"}


# --- parameters and headers -------------------------------------------------------------------------

WHOLE = {"type": "integer", "minimum": 0}

PARAMETERS: dict[str, Any] = {
    "Prefer": {
        "name": "Prefer", "in": "header", "required": False, "schema": {"type": "string"}, "example": "wait=10",
        "description": "RFC 7240. wait=N: answer 200 with the result if it is there within N seconds, otherwise 202. "
        "The service may wait for less (TAILSTACK_MAX_WAIT_SECONDS).",
    },
    "IdempotencyKey": {
        "name": "Idempotency-Key", "in": "header", "required": False,
        "schema": {"type": "string", "minLength": 1, "maxLength": 255, "pattern": "^[!-~]+$"},
        "description": "One key stands for one request: sent again with the same body it gives the same job.",
    },
    "IfNoneMatch": {
        "name": "If-None-Match", "in": "header", "required": False, "schema": {"type": "string"},
        "description": "The ETag of what the client has: 304 if it is still that.",
    },
    "LastEventID": {
        "name": "Last-Event-ID", "in": "header", "required": False,
        "schema": {"type": "string", "pattern": "^[0-9]{0,15}$"},
        "description": "Id of the last event that was read; the stream goes on after it. Empty: none was.",
    },
    "JobId": {
        "name": "id", "in": "path", "required": True, "schema": {"type": "string", "pattern": "^[0-9a-z]{26}$"},
        "description": "Id of a job.", "example": EXAMPLE_ID,
    },
    "Sha256": {
        "name": "sha256", "in": "path", "required": True, "schema": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "description": "SHA-256 of the result, hexadecimal.", "example": EXAMPLE_SHA256,
    },
}  # fmt: skip


def header(description: str, schema: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    return {"description": description, "schema": schema or {"type": "string"}, **more}


# ``required``: wherever it is documented it is sent
HEADERS: dict[str, Any] = {
    "RequestId": header("Id of the request, in the log too.", {"type": "string", "maxLength": 64}, required=True),
    "ETag": header("Strong validator of the body.", required=True),
    "CacheControl": header("How long the answer may be used without asking.", required=True),
    "Vary": header("A cache keeps answers to different credentials apart.", required=True),
    "VaryAccept": header("A cache keeps the page and the document apart.", required=True),
    "Location": header("Path of the job.", {"type": "string", "format": "uri-reference"}, required=True),
    "PageLocation": header("Path of the page.", {"type": "string", "format": "uri-reference"}, required=True),
    "ResultLocation": header("Path of the result.", {"type": "string", "format": "uri-reference"}, required=True),
    "RetryAfter": header("Seconds after which it is worth asking again; absent once it is not.", WHOLE),
    "ComeBack": header("Seconds after which it is worth asking again.", WHOLE, required=True),
    "PreferenceApplied": header("The wait that was granted; absent when none was asked for."),
    "IdempotencyReplayed": header(
        "true: the key had made this job before; otherwise absent.", {"type": "string", "const": "true"}
    ),
    "Link": header('The next page, as <path>; rel="next"; absent on the last.'),
    "Challenge": header("RFC 6750 challenge.", required=True),
    "WWWAuthenticate": header("RFC 6750 challenge; absent where there is no authentication."),
    "ContentDisposition": header("A file name for the report.", required=True),
    "ContentSecurityPolicy": header("What HTML may do in a browser: run what it came with. Only with html."),
    "ContentTypeOptions": header("nosniff.", {"type": "string", "const": "nosniff"}, required=True),
    "Unbuffered": header("no: proxies pass events on as they come.", {"type": "string", "const": "no"}, required=True),
}


# --- what routes declare ----------------------------------------------------------------------------------


def headers_of(**named: str) -> dict[str, Any]:
    """Header components by header name, underscores for hyphens."""
    return {name.replace("_", "-"): reference("headers", component) for name, component in named.items()}


def only_with(words: str, headers: Mapping[str, Any]) -> dict[str, Any]:
    """The same headers, which come only under a condition."""
    made = {}
    for name, header in headers.items():
        known = HEADERS[header["$ref"].rpartition("/")[2]]
        made[name] = {**known, "description": f"{known['description']} Only {words}.", "required": False}
    return made


def media_types(media: str, schema: dict[str, Any], example: str | None = None) -> dict[str, Any]:
    """Content of one media type, perhaps with an example."""
    entry: dict[str, Any] = {"schema": schema}
    if example is not None:
        entry["examples"] = {"example": reference("examples", example)}
    return {media: entry}


def response_of(description: str, content: Mapping[str, Any] | None = None, **headers: str) -> dict[str, Any]:
    """A response object; headers by component, underscores for hyphens."""
    response: dict[str, Any] = {"description": description}
    if headers:
        response["headers"] = headers_of(**headers)
    if content is not None:
        response["content"] = content
    return response


def parameter(name: str) -> dict[str, str]:
    """A parameter of the components."""
    return reference("parameters", name)


def query_parameter(name: str, schema: dict[str, Any], description: str) -> dict[str, Any]:
    """An optional parameter of the query."""
    return {"name": name, "in": "query", "required": False, "description": description, "schema": schema}


def job_links() -> dict[str, Any]:
    """From a job to what can be asked of it."""
    return {
        operation_id: {"operationId": operation_id, "parameters": {"id": "$response.body#/id"}}
        for operation_id in ("get_job", "get_job_events", "get_job_result", "cancel_job")
    }


def result_links() -> dict[str, Any]:
    """From a job that has succeeded to its result."""
    return {
        operation_id: {"operationId": operation_id, "parameters": {"sha256": "$response.body#/result_sha256"}}
        for operation_id in ("get_result", "get_report")
    }


def extra(
    *parameters: Mapping[str, Any], body: Mapping[str, Any] | None = None, problems: Sequence[int] = ()
) -> dict[str, Any]:
    """The part of a route's description that FastAPI cannot see: parameters, the body, statuses of problems."""
    described: dict[str, Any] = {PROBLEMS: tuple(problems)}
    if parameters:
        described["parameters"] = list(parameters)
    if body is not None:
        described["requestBody"] = {"required": True, "content": body}
    return described


PROBLEMS = "x-problems"  # statuses, until the overlay has made responses of them


# --- the routes of operations -----------------------------------------------------------------------------

BODY_PROBLEMS = (400, 408, 413, 415, 422, 501, 503)
BECOMES_A_JOB = (
    " Becomes a job. With Prefer: wait=N the answer is the result itself (200), or the problem that it came to, if "
    "that is known within N seconds."
)


def describe(operation: Operation) -> dict[str, Any]:
    """The arguments of a route that say what an operation takes and gives."""
    answers = _answers_at_once(operation) if operation.immediate else _job_answers(operation)
    own = () if operation.immediate else (parameter("Prefer"), parameter("IdempotencyKey"))
    problems = {*BODY_PROBLEMS, *(() if operation.immediate else (429,)), *((404,) if _takes_parts(operation) else ())}
    return {
        "summary": operation.summary,
        "description": operation.description + ("" if operation.immediate or _at_once(operation) else BECOMES_A_JOB),
        "responses": answers,
        "openapi_extra": extra(*own, *_query_parameters(operation), body=_body(operation), problems=sorted(problems)),
    }


def _takes_parts(operation: Operation) -> bool:
    """Whether the design may be named by its hash, and patched."""
    return tuple(operation.designs) == ("design",)


def _at_once(operation: Operation) -> str:
    """When it is answered at once, although it can become a job."""
    return "" if operation.body is None else operation.body.at_once


def component(name: str) -> str:
    """What a published schema is called in the document, and so by generated clients: study-views is StudyViews."""
    return "JobPage" if name == "jobs" else "".join(word.capitalize() for word in name.split("-"))


def request_name(operation: Operation) -> str:
    """What the request of an operation is called: /v1/scores is asked with a ScoreRequest."""
    word = operation.path.rpartition("/")[2]
    return component(operation.name if "/studies/" in operation.path else word.removesuffix("s")) + "Request"


def _body(operation: Operation) -> dict[str, Any]:
    name = request_name(operation)
    content = media_types(JSON, reference("schemas", name), name)
    if operation.yaml:
        content |= media_types(YAML, reference("schemas", "Design"), "DesignAsYaml")
    for media in operation.body.media if operation.body is not None else ():
        sample = operation.body.samples.get(media) if operation.body is not None else None
        content |= _file(media, TABLES.get(media) if sample is None else sample.name)
    return content


TABLES = {"text/csv": "Variants", "application/x-ndjson": "VariantLines"}  # examples by media type


def _file(media: str, example: str | None) -> dict[str, Any]:
    """A file as a body: text, or bytes."""
    text = media.startswith("text/") or media in TABLES or example is not None
    bytewise = {"format": "binary", "contentMediaType": media}
    return media_types(media, {"type": "string", **({} if text else bytewise)}, example)


REPORT = {  # headers of one
    "Content_Disposition": "ContentDisposition",
    "Content_Security_Policy": "ContentSecurityPolicy",
    "X_Content_Type_Options": "ContentTypeOptions",
}
REPORT_FORMS: dict[str, Any] = {  # JSON first: programs that generate clients take what comes first
    JSON: {"schema": {"type": "object"}},
    MEDIA_TYPES["html"]: {"schema": {"type": "string"}},
    # bytes: contentMediaType is how 3.1 says it, format what generators of clients look at
    **{
        media: {"schema": {"type": "string", "format": "binary", "contentMediaType": media}}
        for media in (MEDIA_TYPES["pdf"], MEDIA_TYPES["xlsx"])
    },
}


def _answers_at_once(operation: Operation) -> dict[int | str, Any]:
    record = media_types(JSON, reference("schemas", component(operation.name)))
    if operation.document is None:
        return {200: response_of(f"{operation.summary}.", record)}
    done = response_of(f"{operation.summary}; as a report, where Accept asks for one.", REPORT_FORMS | record, **REPORT)
    return {200: {**done, "headers": only_with("when it is a report", done["headers"])}}


def _job_answers(operation: Operation) -> dict[int | str, Any]:
    at_once = _at_once(operation)
    in_time = f"{at_once}, or with Prefer: wait in time" if at_once else "with Prefer: wait, in time"
    done = response_of(
        f"{operation.summary}: {in_time}.", media_types(JSON, reference("schemas", component(operation.name))),
        ETag="ETag", Cache_Control="CacheControl", Vary="Vary", Location="Location", Content_Location="ResultLocation",
        Preference_Applied="PreferenceApplied", Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    if operation.answers:
        for media in operation.answers:
            done["content"] |= _file(media, None)
    if at_once:
        done["headers"] = only_with("when it was a job", done["headers"])
    accepted = response_of(
        "Accepted: the job.", media_types(JSON, reference("schemas", "Job"), "Job"), Location="Location",
        Retry_After="RetryAfter", Cache_Control="CacheControl", Preference_Applied="PreferenceApplied",
        Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    return {200: done, 202: {**accepted, "links": job_links()}}


def _query_parameters(operation: Operation) -> list[dict[str, Any]]:
    """What a body that is no JSON takes from the query."""
    if operation.body is not None:
        when = "Not with a JSON body." if operation.body.media else "Only with a YAML body."
        return [_query_parameter(name, schema, when) for name, schema in operation.body.query().items()]
    if not operation.yaml:
        return []
    described = operation.options.model_json_schema().get("properties", {})
    made = []
    for option in list_options(operation.options):
        if option.listed:
            words = f"Only with a YAML body. {described[option.name].get('description', '')}".strip()
            made.append(query_parameter(option.query_name, {"type": "array", "items": option.text_schema()}, words))
        else:
            made.append(_query_parameter(option.name, described[option.name]))
    return made


def _query_parameter(name: str, described: Mapping[str, Any], when: str = "Only with a YAML body.") -> dict[str, Any]:
    """A parameter of the query; absence is how a query says null."""
    words = f"{when} {described.get('description', '')}".strip()
    schema = {key: value for key, value in described.items() if key not in ("title", "description")}
    if "anyOf" in schema:
        schema = next(entry for entry in schema["anyOf"] if entry.get("type") != "null")
    return query_parameter(name, schema, words)


# --- the document -----------------------------------------------------------------------------------------

DESCRIPTION = (
    "Where does the tool end up, how bad is the worst 5 %, which tolerance is to blame, and what is the cheapest "
    "design that stays under the limit? Lengths in mm, angles in degrees, images in px; frames as in "
    "docs/conventions.md. Scores, validations and conversions are answered at once; what takes longer becomes a job "
    "that survives restarts. Every refusal is application/problem+json (RFC 9457) whose errors point into the document "
    "that was sent. A harmless X-Request-ID (letters, digits, . _ : -, at most 64) is echoed, otherwise one is made. "
    "Sizes are bounded; a refusal names the limit and the TAILSTACK_ variable that sets it. Unknown fields, NaN and "
    "infinities are refused. Without authentication the service answers on loopback only, and needs no credential."
)
TAGS = [
    {"name": "computations", "description": "Scores and the like at once; checks, optimisations and sweeps as jobs."},
    {"name": "jobs", "description": "What was accepted: state, progress, events, cancelling."},
    {"name": "results", "description": "Answers of jobs, named by their SHA-256."},
    {"name": "information", "description": "Health, version, metrics, schemas, classes of problems."},
]
BEARER = {
    "type": "http",
    "scheme": "bearer",
    "description": "An API key (tsk_...) or a JSON Web Token, where the service requires it. Scopes: compute, read, "
    "metrics.",
}


def document(routers: Sequence[APIRouter], records: Sequence[type]) -> dict[str, Any]:
    """The document as plain data.  ``records``: what routes answer with besides the published records."""
    every = [route for router in routers for route in router.routes if isinstance(route, APIRoute)]
    routes = [route for route in every if route.include_in_schema]
    made = get_openapi(
        title="tailstack",
        version=__version__,
        openapi_version="3.1.0",
        summary="Tolerance stack-up of X-ray reference structures, judged by its tail.",
        description=DESCRIPTION,
        routes=routes,
        tags=TAGS,
        servers=[{"url": "http://127.0.0.1:8321", "description": "tailstack serve"}],
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    for route in routes:
        for method in route.methods or ():
            _complete(made["paths"][route.path][method.lower()], route, method)
    made["components"] = {
        "schemas": _schemas(records),
        "parameters": PARAMETERS,
        "headers": HEADERS,
        "responses": _problem_responses(),
        "examples": _examples(),
        "securitySchemes": {"bearer": BEARER},
    }
    return made


def openapi_json(app: FastAPI) -> bytes:
    """The document as it is printed."""
    return (write_json(app.openapi(), indent=1) + "\n").encode()


def _complete(described: dict[str, Any], route: APIRoute, method: str) -> None:
    """What every route has: the problems that can come, the id of the request, the scope."""
    scope = next(
        (depends.dependency.scope for depends in route.dependencies if isinstance(depends.dependency, Needs)), None
    )
    statuses = {421, 500, *described.pop(PROBLEMS, ()), *((401, 403) if scope else ())}
    if method == "POST":
        statuses.add(403)  # a page of another site, where there is no authentication
    responses = described["responses"]
    for response in responses.values():
        response["headers"] = {"X-Request-ID": reference("headers", "RequestId"), **response.get("headers", {})}
    for status in sorted(statuses):
        responses[str(status)] = reference("responses", f"Problem{status}")
    described["responses"] = dict(sorted(responses.items()))
    described["security"] = [{"bearer": [scope]}] if scope else []


# --- its components ---------------------------------------------------------------------------------------


PUBLISHED = {"JobDocument": "Job", "ProblemDocument": "Problem"}  # records whose own names say it twice


class _Schemas:
    """Schemas by component name.  Equal definitions are shared, different ones of one name are kept apart."""

    def __init__(self) -> None:
        self.found: dict[str, Any] = {}

    def add(self, name: str, schema: dict[str, Any]) -> None:
        definitions = schema.pop("$defs", {})
        body = {key: value for key, value in schema.items() if key not in ("$schema", "$id")}
        names = {
            key: key if key != name and self._free(key, definitions[key]) else f"{name}{key}" for key in definitions
        } | {key: PUBLISHED[key] for key in definitions if key in PUBLISHED}
        for key, definition in definitions.items():
            self.found[names[key]] = _rename_references(definition, names)
        self.found[name] = _rename_references(body, names)

    def _free(self, key: str, definition: Any) -> bool:
        return key not in self.found or self.found[key] == _rename_references(definition, {})


def _rename_references(node: Any, names: dict[str, str]) -> Any:
    """The same schema with its references led to the components."""
    if isinstance(node, list):
        return [_rename_references(item, names) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: "#/components/schemas/" + names.get(value[8:], value[8:])
        if key == "$ref" and isinstance(value, str) and value.startswith("#/$defs/")
        else _rename_references(value, names)
        for key, value in node.items()
    }


def _schemas(records: Sequence[type]) -> dict[str, Any]:
    """Every schema that a route speaks of."""
    made = _Schemas()
    for name in ("design", *OPERATIONS, "job", "jobs", "problem"):
        made.add(component(name), json_schema(name))
    for operation in OPERATIONS.values():
        made.add(request_name(operation), _request_schema(operation))
    made.add("DesignPatch", dict(PATCH_SCHEMA))
    made.add("JobEvent", _job_event())
    for record in records:
        made.add(record.__name__, record_json_schema(record))
    return dict(sorted(made.found.items()))


PATCH_SCHEMA = {
    "type": "object",
    "additionalProperties": True,
    "description": "What differs from a design: a JSON merge patch (RFC 7396). Objects are merged, null removes a "
    "field, lists are replaced whole.",
}
PARTS = {
    NAMED: {
        "type": "string",
        "pattern": "^[0-9a-f]{64}$",
        "description": "Instead of `design`: the SHA-256 of one that was sent whole before (`design_sha256` of its "
        "answer). 404 `unknown-design` where it is no longer kept.",
    },
    PATCH: {**reference("schemas", "DesignPatch"), "description": "What is changed in that design first."},
}


def _request_schema(operation: Operation) -> dict[str, Any]:
    """The schema of a request: designs, each with what it is, beside the options, unless it has a model of its own."""
    if operation.body is not None and operation.body.request is not None:
        own: dict[str, Any] = operation.body.request.model_json_schema(by_alias=True)
        return own
    schema = operation.options.model_json_schema()
    designs = {
        field: {**reference("schemas", "Design"), "description": words} for field, words in operation.designs.items()
    }
    in_parts = _takes_parts(operation)
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [*(() if in_parts else designs), *schema.get("required", ())],
        "properties": {**designs, **(PARTS if in_parts else {}), **schema.get("properties", {})},
        "$defs": schema.get("$defs", {}),
    }


def _job_event() -> dict[str, Any]:
    words = (
        "job (its id) and at (RFC 3339); with state: state, and result_sha256 or problem; with progress: units_done, "
    )
    words += "units_expected, note, eta_seconds; with recomputed, where another code took the job over: from and to."
    data = {"type": "string", "contentMediaType": "application/json", "description": words}
    properties: dict[str, Any] = {
        "id": {"type": "string", "pattern": "^[0-9]+$", "description": "Counts the events of a job from 1."},
        "event": {
            "type": "string",
            "enum": ["state", "progress", "recomputed"],
            "description": "What `data` tells of.",
        },
        "data": data,
    }
    return {"type": "object", "additionalProperties": False, "required": list(properties), "properties": properties}


def _problem_responses() -> dict[str, Any]:
    """One response per status, with the classes of problems that come with it."""
    slugs: dict[int, list[str]] = {413: ["limit-exceeded"]}
    for entry in CATALOGUE.values():
        slugs.setdefault(entry.status, []).append(entry.slug)
    made = {}
    for status in sorted(slugs.keys() - {405}):  # of a path, not of an operation: nothing could refer to it
        headers = {"X-Request-ID": reference("headers", "RequestId")}
        if status in RETRIED:
            headers["Retry-After"] = reference("headers", "RetryAfter" if status == 409 else "ComeBack")
        if status in (401, 403):
            headers["WWW-Authenticate"] = reference("headers", "Challenge" if status == 401 else "WWWAuthenticate")
        made[f"Problem{status}"] = {
            "description": "Problem: " + ", ".join(slugs[status]) + ".",
            "headers": headers,
            "content": {PROBLEM: {"schema": reference("schemas", "Problem")}},
        }
    return made


# --- its examples -----------------------------------------------------------------------------------------

_JOB: dict[str, Any] = {
    "schema": "tailstack/job/1",
    "id": EXAMPLE_ID,
    "kind": "verification",
    "state": "running",
    "design_name": "eight beads, two seats",
    "created_at": "2026-01-31T12:00:00.000Z",
    "started_at": "2026-01-31T12:00:00.120Z",
    "finished_at": None,
    "solver_version": "0.4.0+5d1f0c9be2a7",
    "recomputed": None,
    "cpu_seconds": 0.31,
    "progress": {
        "fraction": 0.4, "units_done": 4, "units_expected": 10, "note": "524288 trials", "eta_seconds": 1.5,
    },
    "problem": None,
    "result_sha256": None,
    "links": {
        "self": f"/v1/jobs/{EXAMPLE_ID}",
        "events": f"/v1/jobs/{EXAMPLE_ID}/events",
        "cancel": f"/v1/jobs/{EXAMPLE_ID}/cancel",
        "result": None,
        "report": None,
    },
}  # fmt: skip
_JOB_EVENT = {
    "id": "3",
    "event": "progress",
    "data": f'{{"job": "{EXAMPLE_ID}", "at": "2026-01-31T12:00:01.000Z", "units_done": 4, "units_expected": 10, '
    '"note": "524288 trials", "eta_seconds": 1.5}',
}


def _examples() -> dict[str, Any]:
    """A request for every operation, and a job; openapi/answers.py adds what operations answer."""
    made: dict[str, Any] = {}
    for operation in OPERATIONS.values():
        design = {"design": EXAMPLE_DESIGN} if tuple(operation.designs) == ("design",) else {}
        value = {**design, **operation.example}
        made[request_name(operation)] = {"summary": operation.example_title, "value": value}
    made["Variants"] = {"summary": "Two designs", "value": "variant,views.AP.fiducial_noise_px\nA,0.1\nB,0.2\n"}
    made["VariantLines"] = {
        "summary": "Two designs, a line each",
        "value": '{"/views/0/fiducial_noise_px": 0.1}\n{"/views/0/fiducial_noise_px": 0.2}\n',
    }
    bodies = [operation.body for operation in OPERATIONS.values() if operation.body is not None]
    for sample in (sample for body in bodies for sample in body.samples.values()):
        made[sample.name] = {"summary": sample.summary, "value": sample.text}
    made["DesignAsYaml"] = {"summary": "The design itself", "value": EXAMPLE_DESIGN}
    made["Job"] = {"summary": "A job that runs", "value": _JOB}
    page = {"schema": "tailstack/jobs/1", "jobs": [_JOB], "next": None}
    made["JobPage"] = {"summary": "A page of one", "value": page}
    made["JobEvent"] = {"summary": "A job gets on", "value": _JOB_EVENT}
    return made
