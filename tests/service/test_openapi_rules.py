"""The OpenAPI document keeps our rules, and each rule finds what it is for; redocly where Node is."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import node
import pytest
from openapi_scenes import DOCUMENT, OPENAPI, needs_node
from openapi_spec_validator import OpenAPIV31SpecValidator
from rules import violations, without_words

from tailstack_service.schemas import TITLES, json_schema

PROBLEM = {"$ref": "#/components/responses/Problem422"}
TEXT = {"schema": {"type": "string"}, "description": "what it says"}
GOOD: dict[str, Any] = {
    "openapi": "3.1.0",
    "info": {"title": "good", "version": "1"},
    "tags": [{"name": "jobs", "description": "Computations that take longer."}],
    "paths": {
        "/v1/jobs/{id}": {
            "post": {
                "operationId": "create_job",
                "summary": "A job",
                "description": "It is computed.",
                "tags": ["jobs"],
                "parameters": [
                    {"name": "id", "in": "path", "required": True, "description": "Which.", "example": "a",
                     "schema": {"type": "string"}},
                    {"name": "limit", "in": "query", "description": "How many.", "schema": {"type": "integer"}},
                ],
                "requestBody": {"content": {"application/json": {
                    "schema": {"$ref": "#/components/schemas/Job"}, "examples": {"one": {"value": {"p95_mm": 1.0}}}}}},
                "responses": {
                    "200": {"description": "It.", "content": {"application/json": {
                        "schema": {"$ref": "#/components/schemas/Job"}, "example": {"p95_mm": 1.0}}}},
                    "202": {"description": "Later.", "headers": {"location": TEXT, "Retry-After": TEXT}},
                    "422": PROBLEM,
                    "503": {"description": "Busy.", "headers": {"Retry-After": TEXT}, "content": {
                        "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}},
                },
            }
        }
    },
    "components": {
        "responses": {"Problem422": {"description": "Problem.", "content": {
            "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}}},
        "schemas": {
            "Problem": {"type": "object", "properties": {"status": {"type": "integer", "description": "Of HTTP."}}},
            "Job": {"type": "object", "properties": {
                "p95_mm": {"type": "number", "description": "Quantile."},
                "bias_mm": {"type": "array", "prefixItems": [{"type": "number"}] * 3, "description": "Mean, con."},
                "half_width": {"type": "number", "description": "Of a tolerance."},
                "unit": {"type": "string", "description": "Of the half-width."}}},
        },
    },
}  # fmt: skip
ONLY = "POST /v1/jobs/{id}"


def operation(document: Any) -> Any:
    return document["paths"]["/v1/jobs/{id}"]["post"]


def headers_of(document: Any, status: str) -> Any:
    return operation(document)["responses"][status]["headers"]


def twice(document: Any) -> None:
    document["paths"]["/v1/others"] = {"post": {**copy.deepcopy(operation(document)), "parameters": []}}


BROKEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "version": (lambda d: d.update(openapi="3.2.0"), "openapi: the document is not OpenAPI 3.1"),
    "itemSchema": (
        lambda d: operation(d)["responses"]["200"]["content"].update({"text/event-stream": {"itemSchema": {}}}),
        "/paths//v1/jobs/{id}/post/responses/200/content/text/event-stream: itemSchema is a keyword of OpenAPI 3.2",
    ),
    "name": (
        lambda d: operation(d).update(operationId="createJob"),
        f"{ONLY}: operationId 'createJob' is not snake_case",
    ),
    "no name": (lambda d: operation(d).pop("operationId"), f"{ONLY}: operationId '' is not snake_case"),
    "name twice": (twice, f"POST /v1/others: operationId create_job is also that of {ONLY}"),
    "summary": (lambda d: operation(d).pop("summary"), f"{ONLY}: no summary"),
    "operation without words": (lambda d: operation(d).pop("description"), f"{ONLY}: no description"),
    "property without words": (
        lambda d: d["components"]["schemas"]["Job"]["properties"]["unit"].pop("description"),
        "schema Job: the property unit has no description",
    ),
    "reference without words": (
        lambda d: d["components"]["schemas"]["Job"]["properties"].update(
            problem={"$ref": "#/components/schemas/Problem"}),
        "schema Job: the property problem has no description",
    ),
    "property of a form without words": (
        lambda d: d["components"]["schemas"]["Job"].update(anyOf=[{"items": {"properties": {"deep": {}}}}]),
        "schema Job: the property deep has no description",
    ),
    "tag": (lambda d: operation(d).pop("tags"), f"{ONLY}: needs one tag, and the document describes it"),
    "tag without words": (
        lambda d: d["tags"][0].pop("description"), f"{ONLY}: needs one tag, and the document describes it"
    ),
    "request example": (
        lambda d: operation(d)["requestBody"]["content"]["application/json"].pop("examples"),
        f"{ONLY}: request body application/json: no example",
    ),
    "answer example": (
        lambda d: operation(d)["responses"]["200"]["content"]["application/json"].pop("example"),
        f"{ONLY}: response 200: no example (python openapi/answers.py URL writes it)",
    ),
    "no success": (
        lambda d: operation(d).update(responses={"422": PROBLEM}), f"{ONLY}: no response for success"
    ),
    "error of another kind": (
        lambda d: d["components"]["responses"]["Problem422"].update(content={"application/json": {}}),
        f"{ONLY}: response 422: an error is application/problem+json and nothing else",
    ),
    "error of another schema": (
        lambda d: d["components"]["responses"]["Problem422"]["content"]["application/problem+json"].update(schema={}),
        f"{ONLY}: response 422: an error refers to the schema Problem",
    ),
    "response without words": (
        lambda d: operation(d)["responses"]["200"].pop("description"), f"{ONLY}: response 200: no description"
    ),
    "parameter without words": (
        lambda d: operation(d)["parameters"][1].pop("description"), f"{ONLY}: query parameter limit: no description"
    ),
    "path parameter without example": (
        lambda d: operation(d)["parameters"][0].pop("example"), f"{ONLY}: path parameter id: no example"
    ),
    "path parameter forgotten": (
        lambda d: operation(d)["parameters"].pop(0), f"{ONLY}: path parameter id: not described at all"
    ),
    "202 without Location": (
        lambda d: headers_of(d, "202").pop("location"), f"{ONLY}: response 202: the header Location is not documented"
    ),
    "202 without Retry-After": (
        lambda d: headers_of(d, "202").pop("Retry-After"),
        f"{ONLY}: response 202: the header Retry-After is not documented",
    ),
    "503 without Retry-After": (
        lambda d: headers_of(d, "503").clear(), f"{ONLY}: response 503: the header Retry-After is not documented"
    ),
    "number without unit": (
        lambda d: d["components"]["schemas"]["Problem"]["properties"].update(
            p95={"type": ["number", "null"], "description": "A quantile."}),
        "schema Problem: the number p95 has no unit in its name, no field `unit` beside it, and is not listed",
    ),
    "numbers without unit": (
        lambda d: d["components"]["schemas"]["Problem"].update(
            properties={"deep": {"type": "object", "description": "Deep.", "properties": {"shift": {
                "description": "A shift.", "anyOf": [
                    {"type": "array", "items": {"type": "integer"}}, {"type": "null"}]}}}}),
        "schema Problem: the number shift has no unit in its name, no field `unit` beside it, and is not listed",
    ),
}  # fmt: skip


def test_document_keeps_the_rules() -> None:
    assert violations(DOCUMENT) == []


@pytest.mark.long
def test_document_is_valid_openapi_3_1() -> None:
    OpenAPIV31SpecValidator(DOCUMENT).validate()


def test_base_of_the_table_breaks_no_rule() -> None:
    assert violations(GOOD) == []


@pytest.mark.parametrize("name", BROKEN)
def test_each_rule_finds_what_it_is_for(name: str) -> None:
    change, sentence = BROKEN[name]
    document = copy.deepcopy(GOOD)
    change(document)
    assert violations(document) == [sentence]


@pytest.mark.parametrize("name", TITLES)
def test_every_property_of_a_published_schema_is_described(name: str) -> None:
    """Also of the documents that are not spoken of over HTTP: studies, policies, waivers."""
    assert list(without_words(json_schema(name))) == []


@pytest.mark.long
@needs_node
def test_redocly_finds_nothing(tmp_path: Path) -> None:
    done = node.run("redocly", "lint", "openapi.json", "--config", "redocly.yaml", cwd=OPENAPI)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
@needs_node
def test_redocly_would_find_something(tmp_path: Path) -> None:
    """A reference that leads nowhere, and an example that does not fit its schema."""
    for place, change in (
        ("no-unresolved-refs", lambda d: d["components"]["responses"].pop("Problem422")),
        (
            "no-invalid-media-type-examples",
            lambda d: d["components"]["examples"]["ScoreRequest"].update(value={"x": 1}),
        ),
    ):
        document = copy.deepcopy(DOCUMENT)
        change(document)
        (tmp_path / "openapi.json").write_text(json.dumps(document), encoding="utf-8")
        shutil.copy(OPENAPI / "redocly.yaml", tmp_path)
        done = node.run("redocly", "lint", "openapi.json", "--config", "redocly.yaml", cwd=tmp_path)
        assert done.returncode != 0
        assert place in done.stdout + done.stderr
