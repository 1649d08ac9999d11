"""The OpenAPI document: valid, committed as generated, true to the routes, and its examples work.

It keeps the rules that make it readable.
"""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import node
import pytest
import rules
import yaml
from answers import committed_answers, text_with_answers
from fastapi.routing import iter_route_contexts
from jsonschema import Draft202012Validator
from openapi_scenes import DOCUMENT, OPENAPI, changed_document, needs_node, operations, parameters
from openapi_spec_validator import OpenAPIV31SpecValidator
from rules import violations, without_words
from service_scenes import ROOT, client_with, small_design

from tailstack import load_design
from tailstack.results.json_text import write_json
from tailstack_service.http.app import create_app
from tailstack_service.http.openapi import openapi_json, request_name
from tailstack_service.operations.registry import OPERATIONS as REGISTRY
from tailstack_service.schemas import TITLES, json_schema
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS

OPERATIONS = [(path, method) for path, methods in DOCUMENT["paths"].items() for method in methods]
# What a body that is not JSON cannot say
QUERY = {
    ("/v1/sweeps", "application/yaml"): "?set=/views/0/fiducial_noise_px=0.1,0.2",
    ("/v1/conversions", "text/plain"): "?from=csv",
    **{("/v1/scores/batch", media): f"?design_sha256={load_design(small_design()).sha256}"
       for media in ("text/csv", "application/x-ndjson")},
}  # fmt: skip
OF_HTTP = {"content-length", "content-type", "transfer-encoding", "connection", "date"}
QUICK = {"design": small_design(), "trials": 1000}
WAIT_SECONDS = min(600, round(LIMIT_SECONDS))  # for a job; 600 are the most that a service may be told to wait


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with(Settings(worker_processes=1, max_wait_seconds=WAIT_SECONDS), worker=True) as client:
        client.timeout = httpx.Timeout(2 * WAIT_SECONDS)
        yield client


@pytest.fixture(scope="module")
def names(client: httpx.Client) -> dict[str, str]:
    """Path parameters that lead to something: a job that has succeeded, and its result."""
    response = client.post("/v1/verifications", json=QUICK, headers={"Prefer": f"wait={WAIT_SECONDS}"})
    assert response.status_code == 200, response.text
    return {
        "id": response.headers["location"].rpartition("/")[2],
        "sha256": response.headers["content-location"].rpartition("/")[2],
    }


def test_the_document_is_the_same_committed_generated_and_served(client: httpx.Client) -> None:
    committed = (ROOT / "openapi" / "openapi.json").read_bytes()
    generated = openapi_json(create_app(warm_up=False))
    fresh = text_with_answers(json.loads(generated))
    assert committed == fresh.encode(), "repeat: python openapi/answers.py"
    assert create_app(warm_up=False).openapi() == json.loads(generated)
    assert client.get("/openapi.json").json() == json.loads(generated)


def resolved(node: Any) -> Any:
    """A node with its reference into the components followed."""
    return rules.resolved(DOCUMENT, node)


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
        if content["schema"].get("format") == "binary":
            continue
        assert content["examples"]
        for example in content["examples"].values():
            yield media, resolved(example)["value"]


def address_of(path: str, method: str, names: dict[str, str]) -> str:
    """The path with its parameters filled in: with ``names``, otherwise with their examples."""
    for parameter in parameters(path, DOCUMENT["paths"][path][method], "path"):
        path = path.replace("{" + parameter["name"] + "}", names.get(parameter["name"], parameter.get("example")))
    return path


def check_documented(operation: dict[str, Any], response: httpx.Response) -> None:
    """Status, headers, media type and body are what the document says."""
    described = resolved(operation["responses"][str(response.status_code)])
    headers = {name.lower(): resolved(header) for name, header in described["headers"].items()}
    for name, header in headers.items():
        assert name in response.headers or not header.get("required"), f"{name} is missing"
        if name in response.headers:
            value = response.headers[name]
            typed = int(value) if header["schema"].get("type") == "integer" else value
            component_validator(header["schema"]).validate(typed)
    assert set(response.headers) - OF_HTTP <= set(headers), "sent, and not documented"
    if "content" not in described:
        assert response.content == b""
        return
    media = response.headers["content-type"]
    assert media in described["content"], media
    if media.endswith(("/json", "+json")):
        component_validator(described["content"][media]["schema"]).validate(response.json())


@pytest.mark.long(
    "/v1/scores-post",
    "/v1/optimisations-post",
    "/v1/studies/linearity-post",
    "/v1/studies/coupling-post",
    "/v1/studies/views-post",
    "/v1/studies/placement-post",
    "/v1/reports-post",
    "/v1/comparisons-post",
)
@pytest.mark.parametrize(("path", "method"), OPERATIONS)
def test_every_example_is_answered_as_documented(
    client: httpx.Client, names: dict[str, str], path: str, method: str
) -> None:
    operation = DOCUMENT["paths"][path][method]
    waits = any(parameter["name"] == "Prefer" for parameter in parameters(path, operation, "header"))
    wished = {"Prefer": f"wait={WAIT_SECONDS}"} if waits else {}
    for media, value in examples_of(path, method):
        content = value if value is None or isinstance(value, str) else json.dumps(value)  # JSON is YAML too
        if media.endswith(("/json", "+json")):
            component_validator(operation["requestBody"]["content"][media]["schema"]).validate(value)
        at_once = not wished or '"analytic"' in str(content) or path == "/v1/scores/batch"
        sent = {"Content-Type": media} if media else {}
        address = address_of(path, method, names) + QUERY.get((path, media), "")
        for headers in (sent, {**sent, **wished})[: 2 if wished else 1]:
            response = client.request(method, address, content=content, headers=headers)
            assert response.status_code in (409, 303) if "cancel" in path or "{id}/result" in path else (200, 202), (
                response.text
            )
            if headers == sent and not at_once:
                assert response.status_code == 202
                assert client.post(response.json()["links"]["cancel"]).status_code in (202, 409)
            elif wished:
                assert response.status_code == 200, response.text
            check_documented(operation, response)


@pytest.mark.parametrize(("path", "method"), [entry for entry in OPERATIONS if "{" in entry[0]])
def test_names_that_lead_nowhere_are_answered_as_documented(client: httpx.Client, path: str, method: str) -> None:
    nowhere = {"name": "nothing", "slug": "nothing"}
    response = client.request(method, address_of(path, method, nowhere))
    assert response.status_code == 404
    check_documented(DOCUMENT["paths"][path][method], response)


def test_every_operation_says_who_may_ask_and_how_it_refuses() -> None:
    """Its words, and that of its refusals each is a problem, are among the rules of the document."""
    for path, method in OPERATIONS:
        operation = DOCUMENT["paths"][path][method]
        needed = {"421", "500"}
        needed |= {"400", "413", "415", "422", "503"} if "requestBody" in operation else set()
        needed |= {"401", "403"} if operation["security"] else set()
        assert needed <= set(operation["responses"]), (method, path)


FILES_OF_PAGES = {("/docs", "get"), ("/docs/{name}", "get"), ("/assets/{name}", "get"), ("/manual/{name:path}", "get")}


def test_every_route_but_those_of_pages_is_in_the_document() -> None:
    routed = {
        (route.path, method.lower()) for route in iter_route_contexts(create_app(warm_up=False).routes)
        for method in route.methods or ()
    }  # fmt: skip
    routed -= {(path, "head") for path in ("/health/live", "/health/ready")}  # what monitors ask, as they ask GET
    assert set(OPERATIONS) == routed - FILES_OF_PAGES
    assert routed >= FILES_OF_PAGES


def test_examples_of_answers_are_valid_and_the_service_shows_jobs_alone(client: httpx.Client) -> None:
    """What operations answered stands in the committed document, not in the one that is served."""
    checked = set()
    for _, _, operation in operations():
        for response in operation["responses"].values():
            for media, content in resolved(response).get("content", {}).items():
                for example in content.get("examples", {}).values():
                    if media.endswith(("/json", "+json")):
                        value = resolved(example)["value"]
                        component_validator(content["schema"]).validate(value)
                        checked.add(write_json(value))
    assert checked > {write_json(answered) for answered in committed_answers().values()}
    asked = {f"{request_name(operation)}{part}" for operation in REGISTRY.values() for part in ("", "Design")}
    tables = {"Variants", "VariantLines", "Csv", "Step", "DesignAsYaml"}
    served = client.get("/openapi.json").json()
    assert served["components"]["examples"].keys() - asked - tables == {"Job", "JobPage", "JobEvent"}


@pytest.mark.parametrize("name", TITLES)
def test_published_schemas_are_valid_and_served(client: httpx.Client, name: str) -> None:
    schema = json_schema(name)
    Draft202012Validator.check_schema(schema)
    response = client.get(f"/v1/schemas/{name}")
    assert response.headers["content-type"] == "application/schema+json"
    assert response.json() == schema


def test_list_of_schemas_leads_to_each(client: httpx.Client) -> None:
    entries = client.get("/v1/schemas").json()["schemas"]
    assert [(entry["name"], entry["url"]) for entry in entries] == [(name, f"/v1/schemas/{name}") for name in TITLES]


# --- rules of the document ------------------------------------------------------------------------


RULES = yaml.safe_load((ROOT / "tests" / "data" / "openapi_rules.yaml").read_text(encoding="utf-8"))


def test_document_keeps_the_rules_and_each_rule_finds_what_it_is_for() -> None:
    assert violations(DOCUMENT) == []
    assert violations(RULES["good"]) == []
    for where, patch, sentence in RULES["broken"].values():
        assert violations(changed_document(RULES["good"], where, patch)) == [sentence]


@pytest.mark.long
def test_document_is_valid_openapi_3_1() -> None:
    OpenAPIV31SpecValidator(DOCUMENT).validate()


@pytest.mark.parametrize("name", TITLES)
def test_every_property_of_a_published_schema_is_described(name: str) -> None:
    """Also of the documents that are not spoken of over HTTP: studies, policies, waivers."""
    assert list(without_words(json_schema(name))) == []


@pytest.mark.long
@needs_node
def test_redocly_finds_nothing() -> None:
    done = node.run("redocly", "lint", "openapi.json", "--config", "redocly.yaml", cwd=OPENAPI)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
@needs_node
def test_redocly_would_find_something(tmp_path: Path) -> None:
    """A reference that leads nowhere, and an example that does not fit its schema."""
    document = copy.deepcopy(DOCUMENT)
    document["components"]["responses"].pop("Problem422")
    document["components"]["examples"]["ScoreRequest"]["value"] = {"x": 1}
    (tmp_path / "openapi.json").write_text(json.dumps(document), encoding="utf-8")
    shutil.copy(OPENAPI / "redocly.yaml", tmp_path)
    done = node.run("redocly", "lint", "openapi.json", "--config", "redocly.yaml", cwd=tmp_path)
    assert done.returncode != 0
    for rule in ("no-unresolved-refs", "no-invalid-media-type-examples"):
        assert rule in done.stdout + done.stderr
