"""A change of the OpenAPI document that breaks clients is found, and one that does not is left alone."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from compatibility import breaking_changes, main
from service_scenes import ROOT

Mutation = Callable[[Any], Any]

BASE: dict[str, Any] = {
    "openapi": "3.1.0",
    "info": {"title": "base", "version": "1"},
    "security": [{"key": []}, {"token": ["read", "write"]}],
    "paths": {
        "/jobs": {
            "get": {
                "operationId": "list_jobs",
                "parameters": [{"$ref": "#/components/parameters/Limit"}],
                "responses": {
                    "200": {
                        "description": "",
                        "headers": {"ETag": {"required": True, "schema": {"type": "string"}}},
                        "content": {
                            "application/json": {"schema": {"$ref": "#/components/schemas/Jobs"}},
                            "text/csv": {"schema": {"type": "string"}},
                        },
                    },
                    "404": {"$ref": "#/components/responses/Problem"},
                },
            },
            "post": {
                "operationId": "create_job",
                "parameters": [{"name": "Idempotency-Key", "in": "header", "schema": {"type": "string"}}],
                "requestBody": {
                    "required": False,
                    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Request"}}},
                },
                "responses": {"202": {"description": "", "content": {"application/json": {
                    "schema": {"$ref": "#/components/schemas/Job"}}}}},
            },
        },
        "/version": {"get": {"operationId": "get_version", "security": [], "responses": {"200": {"description": ""}}}},
    },
    "components": {
        "securitySchemes": {
            "key": {"type": "http", "scheme": "bearer"},
            "token": {"type": "oauth2", "flows": {}},
        },
        "parameters": {
            "Limit": {"name": "limit", "in": "query", "schema": {"type": "integer", "minimum": 1, "maximum": 200}}
        },
        "responses": {
            "Problem": {"description": "", "content": {"application/problem+json": {"schema": {"type": "object"}}}}
        },
        "schemas": {
            "Jobs": {
                "type": "object",
                "required": ["jobs"],
                "properties": {"jobs": {"type": "array", "items": {"$ref": "#/components/schemas/Job"}}},
            },
            "Job": {
                "type": "object",
                "additionalProperties": False,
                "required": ["id", "state", "progress", "outcome"],
                "properties": {
                    "id": {"type": "string", "format": "uuid"},
                    "state": {"enum": ["queued", "running", "done"]},
                    "progress": {"type": "number", "minimum": 0, "maximum": 1},
                    "eta_seconds": {"anyOf": [{"type": "number"}, {"type": "null"}]},
                    "parent": {"anyOf": [{"$ref": "#/components/schemas/Job"}, {"type": "null"}]},
                    "bias_mm": {"type": "array", "prefixItems": [{"type": "number"}] * 3, "minItems": 3, "maxItems": 3},
                    "outcome": {
                        "oneOf": [
                            {"type": "object", "properties": {"kind": {"const": "pass"}, "p95_mm": {"type": "number"}},
                             "required": ["kind", "p95_mm"]},
                            {"type": "object", "properties": {"kind": {"const": "fail"}}, "required": ["kind"]},
                        ]
                    },
                },
            },
            "Request": {
                "type": "object",
                "additionalProperties": False,
                "required": ["design"],
                "properties": {
                    "design": {"$ref": "#/components/schemas/Design"},
                    "trials": {"anyOf": [{"type": "integer", "minimum": 1}, {"type": "null"}], "default": None},
                    "precision": {"type": "number", "exclusiveMinimum": 0, "maximum": 0.5},
                    "method": {"type": "string", "enum": ["plain", "radial"], "default": "plain"},
                    "labels": {"type": "object", "additionalProperties": {"type": "string"}},
                },
            },
            "Design": {
                "type": "object",
                "additionalProperties": False,
                "required": ["name"],
                "properties": {
                    "name": {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[^\\n]*$"},
                    "shape": {"oneOf": [{"$ref": "#/components/schemas/Box"}, {"$ref": "#/components/schemas/Ball"}]},
                    "parts": {"type": "array", "items": {"$ref": "#/components/schemas/Design"}, "maxItems": 20},
                },
                "not": {"required": ["shape", "parts"]},
            },
            "Box": {"type": "object", "required": ["side_mm"], "properties": {"side_mm": {"type": "number"}},
                    "additionalProperties": False},
            "Ball": {"type": "object", "required": ["radius_mm"], "properties": {"radius_mm": {"type": "number"}},
                     "additionalProperties": False},
        },
    },
}  # fmt: skip


def schema(name: str, change: Callable[[Any], Any]) -> Mutation:
    return lambda document: change(document["components"]["schemas"][name])


def field(name: str, entry: str, change: Callable[[Any], Any]) -> Mutation:
    return schema(name, lambda s: change(s["properties"][entry]))


def at(path: str, method: str, change: Callable[[Any], Any]) -> Mutation:
    return lambda document: change(document["paths"][path][method])


BREAKS: dict[str, tuple[Mutation, str]] = {
    "path gone": (lambda d: d["paths"].pop("/version"), "GET /version: the operation is gone"),
    "method gone": (lambda d: d["paths"]["/jobs"].pop("get"), "GET /jobs: the operation is gone"),
    "operation renamed": (
        at("/jobs", "get", lambda o: o.update(operationId="jobs")), "GET /jobs: operationId list_jobs is now jobs"
    ),
    "status gone": (at("/jobs", "get", lambda o: o["responses"].pop("404")), "GET /jobs: response 404: is gone"),
    "response media type gone": (
        at("/jobs", "get", lambda o: o["responses"]["200"]["content"].pop("text/csv")),
        "GET /jobs: response 200/text/csv: is gone",
    ),
    "media type of a shared response renamed": (
        lambda d: d["components"]["responses"]["Problem"].update(content={"application/json": {}}),
        "GET /jobs: response 404/application/problem+json: is gone",
    ),
    "request media type gone": (
        at("/jobs", "post", lambda o: o["requestBody"].update(content={"application/yaml": {}})),
        "POST /jobs: request body/application/json: is gone",
    ),
    "body now required": (
        at("/jobs", "post", lambda o: o["requestBody"].update(required=True)),
        "POST /jobs: request body: is now required",
    ),
    "body no longer read": (
        at("/jobs", "post", lambda o: o.pop("requestBody")), "POST /jobs: request body: is no longer read"
    ),
    "header gone": (
        at("/jobs", "get", lambda o: o["responses"]["200"].pop("headers")),
        "GET /jobs: response 200/header ETag: is gone",
    ),
    "header no longer sure": (
        at("/jobs", "get", lambda o: o["responses"]["200"]["headers"]["ETag"].update(required=False)),
        "GET /jobs: response 200/header ETag: is no longer always sent",
    ),
    "parameter gone": (
        at("/jobs", "post", lambda o: o.update(parameters=[])), "POST /jobs: header parameter idempotency-key: is gone"
    ),
    "parameter now required": (
        at("/jobs", "post", lambda o: o["parameters"][0].update(required=True)),
        "POST /jobs: header parameter idempotency-key: is now required",
    ),
    "new required parameter": (
        at("/version", "get", lambda o: o.update(parameters=[{"name": "v", "in": "query", "required": True}])),
        "GET /version: query parameter v: is now required",
    ),
    "bound of a referenced parameter": (
        lambda d: d["components"]["parameters"]["Limit"]["schema"].update(maximum=100),
        "GET /jobs: query parameter limit: maximum is now 100",
    ),
    "new required request field": (
        schema("Request", lambda s: (s["properties"].update(seed={"type": "integer"}), s["required"].append("seed"))),
        "POST /jobs: request body/application/json/seed: is now required",
    ),
    "request field gone": (
        schema("Request", lambda s: s["properties"].pop("method")),
        "POST /jobs: request body/application/json/method: is gone",
    ),
    "request value gone": (
        field("Request", "method", lambda s: s["enum"].remove("radial")),
        'POST /jobs: request body/application/json/method: "radial" is gone',
    ),
    "request values listed": (
        field("Design", "name", lambda s: s.update(enum=["a"])),
        'POST /jobs: request body/application/json/design/name: is now one of ["a"]',
    ),
    "request type narrower": (
        field("Request", "precision", lambda s: s.update(type="integer")),
        "POST /jobs: request body/application/json/precision: type number is now integer",
    ),
    "request null gone": (
        field("Request", "trials", lambda s: s.update(anyOf=s["anyOf"][:1])),
        "POST /jobs: request body/application/json/trials: no longer reads null",
    ),
    "request bound in a form": (
        field("Request", "trials", lambda s: s["anyOf"][0].update(minimum=10)),
        "POST /jobs: request body/application/json/trials: minimum is now 10",
    ),
    "request bound made strict": (
        field("Request", "precision", lambda s: (s.pop("maximum"), s.update(exclusiveMaximum=0.5))),
        "POST /jobs: request body/application/json/precision: maximum is now beyond 0.5",
    ),
    "request text shorter": (
        field("Design", "name", lambda s: s.update(maxLength=100)),
        "POST /jobs: request body/application/json/design/name: maxLength 200 is now 100",
    ),
    "request list shorter": (
        field("Design", "parts", lambda s: s.update(maxItems=5)),
        "POST /jobs: request body/application/json/design/parts: maxItems 20 is now 5",
    ),
    "request pattern": (
        field("Design", "name", lambda s: s.update(pattern="^[a-z]*$")),
        'POST /jobs: request body/application/json/design/name: pattern "^[^\\\\n]*$" is now "^[a-z]*$"',
    ),
    "request exclusion": (
        schema("Design", lambda s: s.update({"not": {"required": ["shape", "name"]}})),
        'POST /jobs: request body/application/json/design: not {"required": ["shape", "parts"]} is now '
        '{"required": ["shape", "name"]}',
    ),
    "request default": (
        field("Request", "method", lambda s: s.update(default="radial")),
        'POST /jobs: request body/application/json/method: default "plain" is now "radial"',
    ),
    "request form gone": (
        field("Design", "shape", lambda s: s["oneOf"].pop()),
        "POST /jobs: request body/application/json/design/shape: no longer reads object",
    ),
    "request map values": (
        field("Request", "labels", lambda s: s.update(additionalProperties={"type": "string", "maxLength": 5})),
        "POST /jobs: request body/application/json/labels/*: maxLength none is now 5",
    ),
    "request map closed": (
        field("Request", "labels", lambda s: s.update(additionalProperties=False)),
        "POST /jobs: request body/application/json/labels: further properties are no longer read",
    ),
    "response property gone": (
        schema("Job", lambda s: (s["properties"].pop("id"), s["required"].remove("id"))),
        "GET /jobs: response 200/application/json/jobs/[]/id: is gone",
    ),
    "optional response property gone": (
        schema("Job", lambda s: s["properties"].pop("eta_seconds")),
        "POST /jobs: response 202/application/json/eta_seconds: is gone",
    ),
    "response property no longer sure": (
        schema("Job", lambda s: s["required"].remove("id")),
        "POST /jobs: response 202/application/json/id: is no longer always there",
    ),
    "response type changed": (
        field("Job", "progress", lambda s: s.update(type="string")),
        "POST /jobs: response 202/application/json/progress: type number is now string",
    ),
    "response type wider": (
        field("Job", "progress", lambda s: s.update(type=["number", "null"])),
        "POST /jobs: response 202/application/json/progress: may now be null",
    ),
    "response format": (
        field("Job", "id", lambda s: s.update(format="uri")),
        'POST /jobs: response 202/application/json/id: format "uuid" is now "uri"',
    ),
    "response value new": (
        field("Job", "state", lambda s: s["enum"].append("lost")),
        'POST /jobs: response 202/application/json/state: may now be "lost"',
    ),
    "response value gone": (
        field("Job", "state", lambda s: s["enum"].remove("done")),
        'POST /jobs: response 202/application/json/state: "done" is gone',
    ),
    "response values open": (
        field("Job", "state", lambda s: (s.pop("enum"), s.update(type="string"))),
        'POST /jobs: response 202/application/json/state: is no longer one of ["queued", "running", "done"]',
    ),
    "response vector longer": (
        field("Job", "bias_mm", lambda s: s.update(maxItems=4)),
        "POST /jobs: response 202/application/json/bias_mm: maxItems 3 is now 4",
    ),
    "response vector component": (
        field("Job", "bias_mm", lambda s: s.update(prefixItems=[{"type": "number"}] * 2 + [{"type": "string"}])),
        "POST /jobs: response 202/application/json/bias_mm/2: type number is now string",
    ),
    "response form new": (
        field("Job", "outcome", lambda s: s["oneOf"].append({"title": "Unknown", "type": "object", "properties": {
            "kind": {"const": "unknown"}}, "required": ["kind"]})),
        "POST /jobs: response 202/application/json/outcome: may now be Unknown",
    ),
    "property of a response form gone": (
        field("Job", "outcome", lambda s: (s["oneOf"][0]["properties"].pop("p95_mm"), s["oneOf"][0]["required"].pop())),
        "POST /jobs: response 202/application/json/outcome/p95_mm: is gone",
    ),
    "security of one way": (
        lambda d: d.update(security=[{"token": ["read", "write"]}]), "GET /jobs: security: key no longer gets in"
    ),
    "security scope": (
        lambda d: d.update(security=[{"key": []}, {"token": ["read", "write", "admin"]}]),
        "GET /jobs: security: token no longer gets in",
    ),
    "security where there was none": (
        at("/version", "get", lambda o: o.pop("security")),
        "GET /version: security: a request without a key no longer gets in",
    ),
    "security sent elsewhere": (
        lambda d: d["components"]["securitySchemes"].update(key={"type": "apiKey", "in": "header", "name": "X-Key"}),
        "GET /jobs: security: key is sent in another way",
    ),
}  # fmt: skip

HARMLESS: dict[str, Mutation] = {
    "nothing": lambda d: None,
    "new path": lambda d: d["paths"].update({"/sweeps": copy.deepcopy(d["paths"]["/version"])}),
    "new method": lambda d: d["paths"]["/version"].update(post={"operationId": "x", "responses": {}}),
    "new error status": at("/version", "get", lambda o: o["responses"].update({"503": {"description": ""}})),
    "new optional parameter": at(
        "/jobs", "get", lambda o: o["parameters"].append({"name": "kind", "in": "query", "schema": {"type": "string"}})
    ),
    "more request fields": schema("Request", lambda s: s["properties"].update(seed={"type": "integer"})),
    "a request field made optional": schema("Design", lambda s: s.update(required=[])),
    "a request bound looser": field("Request", "precision", lambda s: s.update(maximum=0.9, exclusiveMinimum=-1)),
    "a request bound gone": field("Request", "precision", lambda s: s.pop("maximum")),
    "a request type wider": field("Request", "trials", lambda s: s["anyOf"][0].update(type="number")),
    "a request value more": field("Request", "method", lambda s: s["enum"].append("stratified")),
    "a request pattern gone": field("Design", "name", lambda s: s.pop("pattern")),
    "a request form more": field(
        "Design", "shape", lambda s: s["oneOf"].append({"type": "object", "properties": {"cone": {"type": "number"}}})
    ),
    "request forms in another order": field("Design", "shape", lambda s: s["oneOf"].reverse()),
    "a value more of a field that says so": field(
        "Job", "state", lambda s: s.update({"enum": ["queued", "running", "done", "lost"], "x-more-values": True})
    ),
    "a response property more": schema(
        "Job", lambda s: (s["properties"].update(note={"type": "string"}), s["required"].append("note"))
    ),
    "a response property made sure": schema("Job", lambda s: s["required"].append("eta_seconds")),
    "a response type narrower": field("Job", "progress", lambda s: s.update(type="integer", maximum=0.5)),
    "a response never null": field("Job", "eta_seconds", lambda s: s.update(anyOf=s["anyOf"][:1])),
    "null written as a list of types": field(
        "Job", "eta_seconds", lambda s: (s.pop("anyOf"), s.update(type=["null", "number"]))
    ),
    "a body media type more": at(
        "/jobs", "post", lambda o: o["requestBody"]["content"].update({"application/yaml": {}})
    ),
    "words": field("Job", "id", lambda s: s.update(description="other words", title="Id", examples=["x"])),
    "a reference written out": field(
        "Jobs", "jobs", lambda s: s.update(items={"allOf": [{"$ref": "#/components/schemas/Job"}]})
    ),
    "a component renamed": lambda d: d["components"]["schemas"].update(
        Task=d["components"]["schemas"]["Job"],
        Jobs=json.loads(json.dumps(d["components"]["schemas"]["Jobs"]).replace("schemas/Job", "schemas/Task")),
    ),
    "security of one way more": lambda d: d["security"].append({"mtls": []}),
    "security gone": at("/jobs", "get", lambda o: o.update(security=[])),
    "fewer scopes": lambda d: d.update(security=[{"key": []}, {"token": ["read"]}]),
    "header in other case": at(
        "/jobs",
        "get",
        lambda o: o["responses"]["200"].update(headers={"etag": {"required": True, "schema": {"type": "string"}}}),
    ),
}  # fmt: skip


def mutated(change: Mutation) -> dict[str, Any]:
    document = copy.deepcopy(BASE)
    change(document)
    return document


@pytest.mark.parametrize("name", BREAKS)
def test_what_breaks_is_said(name: str) -> None:
    change, sentence = BREAKS[name]
    assert sentence in breaking_changes(BASE, mutated(change))


@pytest.mark.parametrize("name", HARMLESS)
def test_what_breaks_nothing_is_left_alone(name: str) -> None:
    assert breaking_changes(BASE, mutated(HARMLESS[name])) == []


def test_the_comparison_has_a_direction_and_refuses_what_nobody_decided_about() -> None:
    """The comparison has a direction: what may come may not go again."""
    for name in ("new path", "new optional parameter", "a request value more", "a response property more"):
        assert breaking_changes(mutated(HARMLESS[name]), BASE), name
    odd = mutated(field("Job", "progress", lambda s: s.update(unevaluatedProperties=False)))
    with pytest.raises(ValueError, match="unevaluatedProperties"):
        breaking_changes(BASE, odd)


def test_document_breaks_no_client_of_the_released_one() -> None:
    folder = ROOT / "openapi"
    released, now = (json.loads((folder / name).read_text("utf-8")) for name in ("released.json", "openapi.json"))
    assert breaking_changes(released, now) == [], "see openapi/README.md, 'What may change'"


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text(json.dumps(BASE))
    new.write_text(json.dumps(mutated(BREAKS["path gone"][0])))
    assert main([str(old), str(old)]) == 0
    assert main([str(old), str(new)]) == 1
    assert capsys.readouterr().out == "nothing breaks\nGET /version: the operation is gone\n"
    assert main([str(old)]) == 2
