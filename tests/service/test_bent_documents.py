"""Documents bent at random: decimal commas at the command, requests to the gate.

What comes is judged or refused at its place, and never a defect."""

from __future__ import annotations

import contextlib
import copy
import io
import json
import random
from collections import Counter
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service_scenes import EXAMPLES, small_design

from plain_data import places_of, value_at
from tailstack.errors import TailstackError
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json
from tailstack_service.gate.judge import judge
from tailstack_service.gate.records import GateRecord
from tailstack_service.gate.request import admit_gate
from tailstack_service.schemas import record_of

pytestmark = pytest.mark.hostile

SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]


@settings(max_examples=100, deadline=None, suppress_health_check=SLOW)
@given(st.sampled_from(sorted(EXAMPLES.glob("*.yaml"))), st.integers(0, 10_000), st.integers(1, 40))
def test_decimal_commas_in_the_text_have_a_line(tmp_path: Path, example: Path, first: int, count: int) -> None:
    """Points of numbers become commas, from one of them on: what is refused stands at a line of the file."""
    text = example.read_text()
    points = [k for k in range(1, len(text) - 1) if text[k] == "." and text[k - 1].isdigit() and text[k + 1].isdigit()]
    chosen = set(points[first % len(points) :][:count])
    path = tmp_path / "design.yaml"
    path.write_text("".join("," if k in chosen else letter for k, letter in enumerate(text)), encoding="utf-8")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["validate", str(path)])
    told = err.getvalue()
    assert code in (0, 2, 3)
    assert "internal error" not in told
    assert "Traceback" not in told
    if code:
        refused = [line for line in told.splitlines() if line.startswith((str(path), "fiducials/"))]
        assert refused
        for line in refused:
            assert f"{path}:" in line or ".csv:" in line or ".mrk.json:" in line
            # a pointer, (document) at a line, or how many are left after the last that is listed
            after = line.removeprefix(str(path))
            assert ": /" in after or after.split(":")[1].isdigit() or (line == refused[-1] and "not listed: " in after)


# --- requests to the gate -------------------------------------------------------------------------


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


def bent(request: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """One value replaced, removed, or given an unknown neighbour; seldom inside the design, which has its own tests."""
    request = copy.deepcopy(request)
    outside = [
        path for path in places_of(request) if path and (path[0] != "designs" or len(path) < 4 or chance.random() < 0.1)
    ]
    path = chance.choice(outside)
    owner = value_at(request, path[:-1])
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
