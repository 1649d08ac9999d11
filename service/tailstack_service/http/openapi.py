"""The OpenAPI 3.1 document: FastAPI's own, of the routes as they are declared, with one overlay.

Bodies are read by our own strict reader, so their schemas are given by the routes; the overlay adds the published
schemas, what every answer has (a request id, the problems that can come) and examples of requests.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
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
from ..operations.registry import OPERATIONS
from ..operations.rendering import MEDIA_TYPES
from ..problems import CATALOGUE
from ..schemas import json_schema
from .problems import PROBLEM
from .service import Needs

JSON, YAML = "application/json", "application/yaml"
RETRIED = frozenset({409, 429, 503})
# What FastAPI does not know and no record says: parameters, headers, what requests and events look like
COMPONENTS: dict[str, Any] = json.loads(Path(__file__).with_name("components.json").read_text(encoding="utf-8"))


def reference(kind: str, name: str) -> dict[str, str]:
    return {"$ref": f"#/components/{kind}/{name}"}


# --- what routes declare ----------------------------------------------------------------------------------


def only_with(words: str, headers: Mapping[str, Any]) -> dict[str, Any]:
    """The same headers, which come only under a condition."""
    made = {}
    for name, header in headers.items():
        known = COMPONENTS["headers"][header["$ref"].rpartition("/")[2]]
        made[name] = {**known, "description": f"{known['description']} Only {words}.", "required": False}
    return made


def media_types(media: str, schema: dict[str, Any], example: str | None = None) -> dict[str, Any]:
    """Content of one media type, perhaps with an example."""
    entry: dict[str, Any] = {"schema": schema}
    if example is not None:
        entry["examples"] = {"example": reference("examples", example)}
    return {media: entry}


def json_of(schema: str, example: str | None = None) -> dict[str, Any]:
    """Content in JSON, by a schema of the components."""
    return media_types(JSON, reference("schemas", schema), example)


def response_of(description: str, content: Mapping[str, Any] | None = None, **headers: str) -> dict[str, Any]:
    """A response object; headers by component, underscores for hyphens."""
    response: dict[str, Any] = {"description": description}
    if headers:
        response["headers"] = {name.replace("_", "-"): reference("headers", each) for name, each in headers.items()}
    if content is not None:
        response["content"] = content
    return response


def parameter(name: str) -> dict[str, str]:
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


def _design_name(operation: Operation) -> str:
    """What the example of a design alone is called: one for all, but where an operation needs more of its own."""
    return f"{request_name(operation)}Design" if "design" in operation.example else "DesignAsYaml"


def _body(operation: Operation) -> dict[str, Any]:
    name = request_name(operation)
    content = json_of(name, name)
    if operation.yaml:
        content |= media_types(YAML, reference("schemas", "Design"), _design_name(operation))
    for media in operation.body.media if operation.body is not None else ():
        sample = operation.body.samples.get(media) if operation.body is not None else None
        content |= _file(media, TABLES.get(media) if sample is None else sample.name)
    return content


TABLES = {"text/csv": "Variants", "application/x-ndjson": "VariantLines"}  # examples by media type


def _file(media: str, example: str | None = None) -> dict[str, Any]:
    """A file as a body: text, or bytes."""
    text = media.startswith("text/") or media in TABLES or example is not None
    # contentMediaType is how 3.1 says it, format what generators of clients look at
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
    **_file(MEDIA_TYPES["pdf"]),
    **_file(MEDIA_TYPES["xlsx"]),
}


def _answers_at_once(operation: Operation) -> dict[int | str, Any]:
    record = json_of(component(operation.name))
    if operation.document is None:
        return {200: response_of(f"{operation.summary}.", record)}
    forms = REPORT_FORMS | record | (_file("text/csv") if operation.csv is not None else {})
    done = response_of(f"{operation.summary}; as a report, where Accept asks for one.", forms, **REPORT)
    return {200: {**done, "headers": only_with("when it is a report", done["headers"])}}


def _job_answers(operation: Operation) -> dict[int | str, Any]:
    at_once = _at_once(operation)
    in_time = f"{at_once}, or with Prefer: wait in time" if at_once else "with Prefer: wait, in time"
    done = response_of(
        f"{operation.summary}: {in_time}.", json_of(component(operation.name)), ETag="ETag",
        Cache_Control="CacheControl", Vary="Vary", Location="Location", Content_Location="ResultLocation",
        Preference_Applied="PreferenceApplied", Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    for media in operation.answers:
        done["content"] |= _file(media)
    if at_once:
        done["headers"] = only_with("when it was a job", done["headers"])
    accepted = response_of(
        "Accepted: the job.", json_of("Job", "Job"), Location="Location", Retry_After="RetryAfter",
        Cache_Control="CacheControl", Preference_Applied="PreferenceApplied",
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


def document(routers: Sequence[APIRouter], records: Sequence[type]) -> dict[str, Any]:
    """The document as plain data.  ``records``: what routes answer with besides the published records."""
    every = [route for router in routers for route in router.routes if isinstance(route, APIRoute)]
    routes = [route for route in every if route.include_in_schema]
    made = get_openapi(
        title="tailstack",
        version=__version__,
        openapi_version="3.1.0",
        summary="Tolerance stack-up of X-ray reference structures, judged by its tail.",
        description=COMPONENTS["description"],
        routes=routes,
        tags=COMPONENTS["tags"],
        servers=[{"url": "http://127.0.0.1:8321", "description": "tailstack serve"}],
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    for route in routes:
        for method in route.methods or ():
            _complete(made["paths"][route.path][method.lower()], route, method)
    made["components"] = {
        "schemas": _schemas(records),
        "parameters": COMPONENTS["parameters"],
        "headers": COMPONENTS["headers"],
        "responses": _problem_responses(),
        "examples": _examples(),
        "securitySchemes": COMPONENTS["securitySchemes"],
    }
    return made


def openapi_json(app: FastAPI) -> bytes:
    """The document as it is printed."""
    return (write_json(app.openapi(), indent=1) + "\n").encode()


def _complete(described: dict[str, Any], route: APIRoute, method: str) -> None:
    """What every route has: the problems that can come, the id of the request, the scope."""
    dependencies = (each.dependency for each in route.dependencies)
    scope = next((each.scope for each in dependencies if isinstance(each, Needs)), None)
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


def _add_schema(made: dict[str, Any], name: str, schema: dict[str, Any]) -> None:
    """Under its component's name.  Equal definitions are shared, different ones of one name are kept apart."""
    definitions = schema.pop("$defs", {})
    body = {key: value for key, value in schema.items() if key not in ("$schema", "$id")}
    names = {
        key: key
        if key != name and (key not in made or made[key] == _rename_references(definitions[key], {}))
        else f"{name}{key}"
        for key in definitions
    } | {key: PUBLISHED[key] for key in definitions if key in PUBLISHED}
    for key, definition in definitions.items():
        made[names[key]] = _rename_references(definition, names)
    made[name] = _rename_references(body, names)


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
    made: dict[str, Any] = {}
    for name in ("design", *OPERATIONS, "job", "jobs", "problem"):
        _add_schema(made, component(name), json_schema(name))
    for operation in OPERATIONS.values():
        _add_schema(made, request_name(operation), _request_schema(operation))
    for name, schema in COMPONENTS["schemas"].items():
        _add_schema(made, name, dict(schema))
    for record in records:
        _add_schema(made, record.__name__, record_json_schema(record))
    return dict(sorted(made.items()))


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
        "properties": {**designs, **(COMPONENTS["parts"] if in_parts else {}), **schema.get("properties", {})},
        "$defs": schema.get("$defs", {}),
    }


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


def _examples() -> dict[str, Any]:
    """A request for every operation, and a job; openapi/answers.py adds what operations answer."""
    made: dict[str, Any] = dict(COMPONENTS["examples"])
    for operation in OPERATIONS.values():
        design = {"design": EXAMPLE_DESIGN} if _takes_parts(operation) else {}
        value = {**design, **operation.example}
        made[request_name(operation)] = {"summary": operation.example_title, "value": value}
        if operation.yaml:
            alone = value.get("design", EXAMPLE_DESIGN)
            made[_design_name(operation)] = {"summary": "The design itself", "value": alone}
    bodies = [operation.body for operation in OPERATIONS.values() if operation.body is not None]
    for sample in (sample for body in bodies for sample in body.samples.values()):
        made[sample.name] = {"summary": sample.summary, "value": sample.text}
    return made
