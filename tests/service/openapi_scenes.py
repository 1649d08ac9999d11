"""The OpenAPI document as tests read it, and what needs Node."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import node
import pytest
from postgres import go_without
from rules import resolved
from service_scenes import ROOT

from waiting import until

OPENAPI = ROOT / "openapi"
DOCUMENT: dict[str, Any] = json.loads((OPENAPI / "openapi.json").read_text(encoding="utf-8"))
MOST_LIGHT_TRIALS = 40_000  # the fewest that studies take; their examples ask for no more
METHODS = ("get", "put", "post", "delete", "patch")


def operations(document: dict[str, Any] = DOCUMENT) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(path, method, operation) of everything in the document."""
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                yield path, method, item[method]


def pinned_tools(home: Path = node.HERE) -> Path:
    """Where the commands are that the files in ``home`` pin; without Node the test is left out and says so."""
    try:
        return node.tools(home)
    except node.NodeMissing as missing:
        go_without("node", missing)


@pytest.fixture(scope="session")
def node_tools() -> None:
    pinned_tools()


needs_node = pytest.mark.usefixtures("node_tools")


def json_examples(operation: dict[str, Any], document: dict[str, Any] = DOCUMENT) -> dict[str, Any]:
    """Examples of the JSON request body by name; empty for an operation without one."""
    content = resolved(document, operation.get("requestBody", {})).get("content", {}).get("application/json", {})
    return {name: resolved(document, entry)["value"] for name, entry in content.get("examples", {}).items()}


def light(body: dict[str, Any]) -> dict[str, Any]:
    """The same request as a job (a gate can be answered at once), for as little computing as there can be."""
    body = copy.deepcopy(body)
    if "mode" in body:
        body["mode"] = "verify"
        body["policy"] = {"schema": "tailstack/policy/1", "verification": {"max_trials": 2000, "precision": 0.2}}
    if body.pop("precision", None) is not None or body.get("trials", 0) > MOST_LIGHT_TRIALS:
        body["trials"] = 1000
    if "starts" in body:
        body["starts"] = 1
    return body


def parameters(path: str, operation: dict[str, Any], place: str, document: dict[str, Any] = DOCUMENT) -> list[Any]:
    """Parameters of an operation that stand in a place: path, query or header."""
    listed = [*document["paths"][path].get("parameters", ()), *operation.get("parameters", ())]
    return [found for found in (resolved(document, entry) for entry in listed) if found["in"] == place]


def is_secured(operation: dict[str, Any], document: dict[str, Any] = DOCUMENT) -> bool:
    """Whether an operation asks who is calling."""
    ways = operation.get("security", document.get("security", []))
    return bool(ways) and {} not in ways


def ended_job(client: httpx.Client, path: str, **headers: str) -> dict[str, Any]:
    """A job once it has ended."""
    seen: list[dict[str, Any]] = []

    def ended() -> bool:
        seen.append(client.get(path, headers=headers).json())
        return seen[-1]["state"] not in ("queued", "running")

    until(ended, says=lambda: seen[-1])
    return seen[-1]


def changed_document(document: Any, where: str, patch: Any) -> Any:
    """With a merge patch at SCHEMA, SCHEMA.FIELD or METHOD PATH; at the whole where nothing is named."""
    first, _, second = where.partition(" " if " " in where else ".")
    operation = {"paths": {second: {first: patch}}}
    schema = {"components": {"schemas": {first: {"properties": {second: patch}} if second else patch}}}
    return _merged(document, operation if " " in where else schema if where else patch)


def _merged(node: Any, patch: Any) -> Any:
    """By RFC 7396: what is null goes."""
    if not isinstance(patch, dict):
        return patch
    old = node if isinstance(node, dict) else {}
    new = {key: _merged(old.get(key), value) for key, value in patch.items() if value is not None}
    return {key: value for key, value in old.items() if key not in patch} | new
