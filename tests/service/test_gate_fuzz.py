"""Requests bent at random: each is judged or refused at its place, never anything else.  Seed 7."""

from __future__ import annotations

import copy
import json
import random
from collections import Counter
from collections.abc import Iterator
from datetime import date
from typing import Any

import pytest
from service_scenes import small_design

from tailstack.errors import TailstackError
from tailstack_service.documents import to_json
from tailstack_service.gate.judge import judge
from tailstack_service.gate.records import GateRecord
from tailstack_service.gate.request import admit_gate
from tailstack_service.schemas import record_of

TODAY = date(2026, 11, 21)
SEED, CASES = 7, 250
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1e300, -0.0, 0.5, 10**30, 1e-320, "", "x" * 500, "\x00", "é\u202e", "p95", "error", "2026-11-21",
    [], {}, [[]], {"a": 1},
)  # fmt: skip


def whole_request() -> dict[str, Any]:
    """A request with every section, and a baseline."""
    request: dict[str, Any] = {
        "designs": [{"file": "a", "design": small_design(), "class": "p"}],
        "policy": {
            "schema": "tailstack/policy/1",
            "rules": {
                "p95": {"severity": "error", "limit_mm": 1.0, "confidence": 0.95},
                "cvar": {"limit_mm": 2.0},
                "exceedance": {"limit_mm": 1.0, "max_probability": 0.01},
                "process-capability": {
                    "processes": [
                        {"name": "m", "tolerances": ["*"], "min_half_width_deg": 0.1, "min_half_width_mm": 0.1}
                    ]
                },
                "inconclusive": {"severity": "warning"},
            },
            "classes": [{"name": "p", "files": ["a*"], "rules": {"visibility": {"min_margin_px": 30.0}}}],
            "verification": {"precision": 0.1, "max_trials": 2000, "seed": 1},
        },
        "waivers": {
            "schema": "tailstack/waivers/1",
            "waivers": [{"rule": "p95", "owner": "o", "reason": "r", "max_value": 2.0, "expires": "2026-12-01"}],
        },
        "mode": "analytic",
        "seed": 1,
        "today": "2026-11-21",
        "fail_level": "error",
        "on_inconclusive": "warn",
        "max_regression_percent": 1.0,
    }
    return {**request, "baseline": json.loads(to_json(judge(admit_gate(request, today=TODAY).gate)))}


def paths(node: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if path:
        yield path
    steps = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    for step in steps:
        yield from paths(node[step], (*path, step))


def bent(request: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """One value replaced, removed, or given an unknown neighbour; seldom inside the design, which has its own tests."""
    request = copy.deepcopy(request)
    outside = [path for path in paths(request) if path[0] != "designs" or len(path) < 4 or chance.random() < 0.1]
    path = chance.choice(outside)
    owner: Any = request
    for step in path[:-1]:
        owner = owner[step]
    act = chance.random()
    if isinstance(owner, dict) and act < 0.25:
        del owner[path[-1]]
    elif isinstance(owner, dict) and act < 0.35:
        owner["unheard_of"] = 1
    else:
        owner[path[-1]] = chance.choice(VALUES)
    return request


def outcome(request: dict[str, Any]) -> GateRecord | TailstackError:
    try:
        return judge(admit_gate(request, today=TODAY).gate)
    except TailstackError as error:
        return error


@pytest.mark.long
@pytest.mark.hostile
def test_whatever_arrives_is_judged_or_refused(run_seed: int) -> None:
    chance, request, met = random.Random(SEED + run_seed), whole_request(), Counter[str]()
    for _ in range(CASES):
        found = outcome(bent(request, chance))
        met[type(found).__name__] += 1
        if isinstance(found, TailstackError):
            assert found.exit_code == 2
            assert all(problem.pointer.startswith("/") or problem.pointer == "" for problem in found.problems)
        else:
            assert found.exit_code in (0, 1, 2, 3, 4)
            assert record_of("gate", json.loads(to_json(found))) == found
    assert met["GateRecord"] > CASES / 20, met
    assert met["GateError"] > CASES / 4, met
