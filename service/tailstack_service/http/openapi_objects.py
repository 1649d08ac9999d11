"""Objects of OpenAPI that descriptions of operations are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .openapi_components import HEADERS, reference

JSON, YAML = "application/json", "application/yaml"


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
