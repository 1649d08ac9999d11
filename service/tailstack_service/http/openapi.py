"""The OpenAPI 3.1 document: paths from the routes, schemas from the published ones, an example per operation.

Bodies are read by our own strict reader, so their schemas are put in here instead of being inferred.
"""

from __future__ import annotations

import json
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from tailstack import __version__
from tailstack.design.loading import data_to_yaml

from ..documents import json_schema, schema_names
from ..problems import CATALOGUE
from .answers import PROBLEM
from .example import EXAMPLE_DESIGN
from .operations import OPERATIONS, Operation

COMPONENT = {"score": "Score", "verification": "Verification", "optimisation": "Optimisation",
             "validation": "Validation", "problem": "Problem", "design": "Design"}  # fmt: skip
EXAMPLE_OPTIONS: dict[str, dict[str, Any]] = {
    "score": {"second_order": True},
    "verification": {"precision": 0.01, "seed": 7, "method": "plain"},
    "optimisation": {"starts": 2, "seed": 1},
    "validation": {},
}
POST_PROBLEMS = (400, 408, 413, 415, 422, 500, 503)
DESCRIPTION = (
    "Where does the tool end up, how bad is the worst 5 %, which tolerance is to blame, and what is the cheapest "
    "design that stays under the limit? Lengths in mm, angles in degrees, images in px; frames as in "
    "docs/conventions.md. Every refusal is application/problem+json (RFC 9457) whose errors point into the document "
    "that was sent. A harmless X-Request-ID (letters, digits, . _ : -, at most 64) is echoed, otherwise one is made. "
    "Sizes are bounded; a refusal names the limit and the TAILSTACK_ variable that sets it. Unknown fields, NaN and "
    "infinities are refused. There is no authentication yet: the service binds to loopback."
)


def description_of(path: str) -> dict[str, Any]:
    """What :meth:`FastAPI.add_api_route` is told about a path."""
    operation = next((entry for entry in OPERATIONS if entry.path == path), None)
    if operation is not None:
        return _computation(operation)
    return _INFORMATION[path]


def _reference(kind: str, name: str) -> dict[str, str]:
    return {"$ref": f"#/components/{kind}/{name}"}


def _computation(operation: Operation) -> dict[str, Any]:
    name = operation.answer
    title = COMPONENT[name]
    content: dict[str, Any] = {
        "application/json": {
            "schema": _reference("schemas", f"{title}Request"),
            "examples": {"eight_beads": _reference("examples", f"{title}Request")},
        }
    }
    extra: dict[str, Any] = {}
    if operation.yaml:
        content["application/yaml"] = {
            "schema": _reference("schemas", "Design"),
            "examples": {"eight_beads": _reference("examples", "DesignAsYaml")},
        }
        options = operation.options.model_json_schema()["properties"] if operation.options.model_fields else {}
        extra["parameters"] = [
            {
                "name": option,
                "in": "query",
                "required": False,
                "description": f"Only with a YAML body. {schema['description']}",
                "schema": {"type": "boolean", "default": False},
            }
            for option, schema in options.items()
        ]
    return {
        "operation_id": f"create_{name}",
        "summary": operation.summary,
        "tags": ["computations"],
        "responses": {200: {"description": f"{operation.summary}.", "content": _json(_reference("schemas", title))}},
        "openapi_extra": {"requestBody": {"required": True, "content": content}, **extra},
    }


def _json(schema: dict[str, Any], media: str = "application/json") -> dict[str, Any]:
    return {media: {"schema": schema}}


def _information(
    operation_id: str,
    summary: str,
    schema: dict[str, Any],
    *,
    media: str = "application/json",
    parameter: tuple[str, str, str] | None = None,
    also: dict[int, str] | None = None,
) -> dict[str, Any]:
    described: dict[str, Any] = {
        "operation_id": operation_id,
        "summary": summary,
        "tags": ["information"],
        "responses": {200: {"description": f"{summary}.", "content": _json(schema, media)}},
    }
    for status, words in (also or {}).items():
        described["responses"][status] = {"description": words, "content": _json(schema, media)}
    if parameter is not None:
        name, words, example = parameter
        entry = {
            "name": name,
            "in": "path",
            "required": True,
            "description": words,
            "schema": {"type": "string"},
            "example": example,
        }
        described["openapi_extra"] = {"parameters": [entry]}
    return described


_INFORMATION = {
    "/v1/schemas": _information("list_schemas", "Published schemas", _reference("schemas", "SchemaList")),
    "/v1/schemas/{name}": _information(
        "get_schema", "One JSON Schema (draft 2020-12)", {"type": "object"}, media="application/schema+json",
        parameter=("name", "Name of a published schema.", "design"),
    ),
    "/v1/problems/{slug}": _information(
        "get_problem_type", "What a class of problems means and what cures it", _reference("schemas", "ProblemType"),
        parameter=("slug", "Last part of the type of a problem.", "invalid-design"),
    ),
    "/health/live": _information("get_liveness", "The process answers", _reference("schemas", "Health")),
    "/health/ready": _information(
        "get_readiness", "The kernels are compiled", _reference("schemas", "Health"),
        also={503: "Warming up, stopping, or broken; see status."},
    ),
    "/version": _information("get_version", "Version and documents", _reference("schemas", "Version")),
    "/openapi.json": _information("get_openapi", "This document", {"type": "object"}),
}  # fmt: skip


class _Components:
    """Schemas by component name.  Equal definitions are shared, different ones of one name are kept apart."""

    def __init__(self) -> None:
        self.schemas: dict[str, Any] = {}

    def add(self, name: str, schema: dict[str, Any]) -> None:
        definitions = schema.pop("$defs", {})
        body = {key: value for key, value in schema.items() if key not in ("$schema", "$id")}
        names = {
            key: key if key != name and self._free(key, definitions[key]) else f"{name}{key}" for key in definitions
        }
        for key, definition in definitions.items():
            self.schemas[names[key]] = _renamed(definition, names)
        self.schemas[name] = _renamed(body, names)

    def _free(self, key: str, definition: Any) -> bool:
        return key not in self.schemas or self.schemas[key] == _renamed(definition, {})


def _renamed(node: Any, names: dict[str, str]) -> Any:
    """The same schema with its references led to the components."""
    if isinstance(node, list):
        return [_renamed(item, names) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: "#/components/schemas/" + names.get(value[8:], value[8:])
        if key == "$ref" and isinstance(value, str) and value.startswith("#/$defs/")
        else _renamed(value, names)
        for key, value in node.items()
    }


def _schemas() -> dict[str, Any]:
    from pydantic import TypeAdapter

    from ..problems import ProblemType
    from .information import Health, SchemaList, Version

    components = _Components()
    for name in (entry for entry in schema_names() if entry in COMPONENT):
        components.add(COMPONENT[name], json_schema(name))
    for operation in OPERATIONS:
        options = operation.options.model_json_schema()
        components.add(
            f"{COMPONENT[operation.answer]}Request",
            {
                "type": "object",
                "additionalProperties": False,
                "required": ["design"],
                "properties": {"design": _reference("schemas", "Design"), **options.get("properties", {})},
            },
        )
    for record in (ProblemType, SchemaList, Health, Version):
        components.add(record.__name__, TypeAdapter(record).json_schema(mode="serialization"))
    return dict(sorted(components.schemas.items()))


def _examples() -> dict[str, Any]:
    examples = {
        f"{COMPONENT[operation.answer]}Request": {
            "summary": "Eight beads, two seats",
            "value": {"design": EXAMPLE_DESIGN, **EXAMPLE_OPTIONS[operation.answer]},
        }
        for operation in OPERATIONS
    }
    return {**examples, "DesignAsYaml": {"summary": "The design itself", "value": data_to_yaml(EXAMPLE_DESIGN)}}


def _problem_responses() -> dict[str, Any]:
    """One response per status, with the classes of problems that come with it."""
    slugs: dict[int, list[str]] = {413: ["limit-exceeded"]}
    for entry in CATALOGUE.values():
        slugs.setdefault(entry.status, []).append(entry.slug)
    return {
        f"Problem{status}": {
            "description": "Problem: " + ", ".join(slugs[status]) + ".",
            "content": _json(_reference("schemas", "Problem"), PROBLEM),
        }
        for status in sorted(slugs)
    }


def describe(app: FastAPI) -> None:
    """Let the application write this document."""

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app)
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title="tailstack",
        version=__version__,
        summary="Tolerance stack-up of X-ray reference structures, judged by its tail.",
        description=DESCRIPTION,
        routes=app.routes,
        servers=[{"url": "http://127.0.0.1:8321", "description": "tailstack serve"}],
        tags=[{"name": "computations"}, {"name": "information"}],
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            statuses = POST_PROBLEMS if method == "post" else (404,) if "{" in path else ()
            for status in statuses:
                operation["responses"][str(status)] = _reference("responses", f"Problem{status}")
    document["components"] = {
        "schemas": _schemas(),
        "responses": _problem_responses(),
        "examples": _examples(),
    }
    return document


def openapi_json() -> bytes:
    """The document as it is committed."""
    from ..settings import Settings
    from .app import create_app

    document = create_app(Settings(), warm_up=False).openapi()
    return (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode()
