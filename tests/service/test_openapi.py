"""The OpenAPI document: valid, committed as generated, true to the routes, and its examples work."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import OpenAPIV31SpecValidator
from service_scenes import ROOT, client_with

from tailstack_service.documents import json_schema, schema_names
from tailstack_service.http.openapi import openapi_json

DOCUMENT = json.loads(openapi_json())
OPERATIONS = [(path, method) for path, methods in DOCUMENT["paths"].items() for method in methods]


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with() as client:
        yield client


def test_committed_document_is_the_generated_one() -> None:
    committed = (ROOT / "openapi" / "openapi.json").read_bytes()
    assert committed == openapi_json(), "repeat: tailstack openapi > openapi/openapi.json"


def test_document_is_valid_openapi_3_1() -> None:
    assert DOCUMENT["openapi"].startswith("3.1")
    OpenAPIV31SpecValidator(DOCUMENT).validate()


def test_served_document_is_the_same(client: httpx.Client) -> None:
    assert client.get("/openapi.json").json() == DOCUMENT


def resolved(node: Any) -> Any:
    """A node with its reference into the components followed."""
    while "$ref" in node:
        place: Any = DOCUMENT
        for step in node["$ref"].removeprefix("#/").split("/"):
            place = place[step]
        node = place
    return node


def component_validator(schema: dict[str, Any]) -> Draft202012Validator:
    """Validator of a schema of the document, references into the components included."""
    return Draft202012Validator({**schema, "components": DOCUMENT["components"]})


def examples_of(path: str, method: str) -> Iterator[tuple[str, Any]]:
    """(media type, value) of the request examples; ("", None) for an operation without a body."""
    body = DOCUMENT["paths"][path][method].get("requestBody")
    if body is None:
        yield "", None
        return
    for media, content in body["content"].items():
        assert content["examples"]
        for example in content["examples"].values():
            yield media, resolved(example)["value"]


def address_of(path: str, method: str) -> str:
    """The path with the examples of its parameters filled in."""
    for parameter in DOCUMENT["paths"][path][method].get("parameters", ()):
        if parameter["in"] == "path":
            path = path.replace("{" + parameter["name"] + "}", parameter["example"])
    return path


@pytest.mark.parametrize(("path", "method"), OPERATIONS)
def test_every_example_is_answered_as_documented(client: httpx.Client, path: str, method: str) -> None:
    operation = DOCUMENT["paths"][path][method]
    for media, value in examples_of(path, method):
        content = value if value is None or isinstance(value, str) else json.dumps(value)
        if media.endswith("json"):
            component_validator(operation["requestBody"]["content"][media]["schema"]).validate(value)
        headers = {"Content-Type": media} if media else {}
        response = client.request(method, address_of(path, method), content=content, headers=headers)
        assert response.status_code == 200, response.text
        described = operation["responses"]["200"]["content"]
        assert list(described) == [response.headers["content-type"]]
        component_validator(next(iter(described.values()))["schema"]).validate(response.json())


@pytest.mark.parametrize(("path", "method"), OPERATIONS)
def test_every_operation_is_described(path: str, method: str) -> None:
    operation = DOCUMENT["paths"][path][method]
    assert operation["summary"]
    assert operation["operationId"]
    if method == "post":
        assert {"400", "413", "415", "422", "500", "503"} <= set(operation["responses"])
        for status in ("400", "422", "503"):
            assert list(resolved(operation["responses"][status])["content"]) == ["application/problem+json"]


def test_operation_ids_are_unique() -> None:
    ids = [DOCUMENT["paths"][path][method]["operationId"] for path, method in OPERATIONS]
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("name", schema_names())
def test_published_schemas_are_valid_and_served(client: httpx.Client, name: str) -> None:
    schema = json_schema(name)
    Draft202012Validator.check_schema(schema)
    response = client.get(f"/v1/schemas/{name}")
    assert response.headers["content-type"] == "application/schema+json"
    assert response.json() == schema


def test_list_of_schemas_leads_to_each(client: httpx.Client) -> None:
    entries = client.get("/v1/schemas").json()["schemas"]
    assert [entry["name"] for entry in entries] == list(schema_names())
    for entry in entries:
        assert client.get(entry["url"]).status_code == 200
