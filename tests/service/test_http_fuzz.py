"""Whatever bytes arrive, the answer is a document and never a 5xx."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service_scenes import small_design

pytestmark = pytest.mark.hostile

POSTS = ("/v1/scores", "/v1/validations", "/v1/verifications", "/v1/optimisations", "/v1/sweeps", "/v1/reports",
         "/v1/gates", "/v1/conversions")  # fmt: skip
FEW = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ODD: list[Any] = [
    None, True, 0, -1, 1e308, -1e-320, 10**30, "", "x" * 3000, "\u202e", [], {}, [[[]]], {"a": {"b": []}}, ["0", 1.5],
    "tailstack/design/1", "NaN", -0.0, 2**63, [1e5, -1e5, 1e5],
]  # fmt: skip


def check_no_defect(response: httpx.Response) -> None:
    assert response.status_code < 500, response.text
    assert response.headers["content-type"] in ("application/json", "application/problem+json")
    document = response.json()
    if response.status_code not in (200, 202):
        assert document["errors"]
        assert document["status"] == response.status_code


@FEW
@given(
    path=st.sampled_from(POSTS),
    body=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
        max_leaves=20,
    ),
)
def test_json_values(client: httpx.Client, path: str, body: Any) -> None:
    content = json.dumps(body).encode()
    check_no_defect(client.post(path, content=content, headers={"Content-Type": "application/json"}))


def paths_of(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document."""
    if path:
        yield path
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in items:
        yield from paths_of(child, (*path, key))


@pytest.mark.long("0")
@pytest.mark.parametrize("seed", range(4))
def test_a_good_request_with_a_few_values_replaced_or_removed(client: httpx.Client, seed: int, run_seed: int) -> None:
    draw = random.Random(seed + 10 * run_seed)
    good = {"design": small_design(optimise=None), "seed": 1}
    places = list(paths_of(good))
    for _ in range(60):
        body = copy.deepcopy(good)
        for place in draw.sample(places, draw.randint(1, 3)):
            node: Any = body
            try:
                for step in place[:-1]:
                    node = node[step]
                if draw.random() < 0.25:
                    del node[place[-1]]
                else:
                    node[place[-1]] = copy.deepcopy(draw.choice(ODD))
            except (LookupError, TypeError):  # an earlier change took the place away
                continue
        path = draw.choice(("/v1/scores", "/v1/verifications", "/v1/validations"))
        if path == "/v1/verifications":
            body["trials"] = draw.choice([1, 2, 100, 2000])
        else:
            body.pop("seed", None)
        check_no_defect(client.post(path, json=body))
