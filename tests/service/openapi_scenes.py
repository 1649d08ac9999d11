"""The OpenAPI document as tests read it, and what needs Node."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import node
import pytest
from postgres import required
from service_scenes import ROOT

OPENAPI = ROOT / "openapi"
DOCUMENT: dict[str, Any] = json.loads((OPENAPI / "openapi.json").read_text(encoding="utf-8"))
METHODS = ("get", "put", "post", "delete", "patch")


def operations(document: dict[str, Any] = DOCUMENT) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(path, method, operation) of everything in the document."""
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                yield path, method, item[method]


@pytest.fixture(scope="session")
def node_tools() -> None:
    """The pinned npm tools are installed, or the test is skipped and says so."""
    try:
        node.tools()
    except node.NodeMissing as missing:
        if required("node"):
            pytest.fail(f"{missing}; TAILSTACK_TESTS_REQUIRE lists node")
        pytest.skip(f"NOT TESTED: {missing}")


needs_node = pytest.mark.usefixtures("node_tools")
