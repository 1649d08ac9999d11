"""Designs whose first-order P95 is far too small: no score and no gate may pass them for it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from service_scenes import ROOT
from test_gate_verdicts import gate, policy

from tailstack import load_design, score
from tailstack.results import Score

# (first order, mm; an independent chain by SVD, mm; its own error, mm): see tests/data/validity/README.md
CASES = {
    "four_views": (0.3945, 0.4860, 0.0035),
    "three_views": (0.790, 0.941, 0.005),
    "eight_beads_two_views": (0.2401, 0.2555, 0.0013),
    "plate_two_views": (88.9, 219.5, 3.0),
    "published_seven_beads": (1.468, 3.58, 0.05),
    "small_parallax": (4.43, 6.33, 0.05),
}


def limited(name: str, limit_mm: float) -> dict[str, Any]:
    document = json.loads((ROOT / "tests" / "data" / "validity" / f"{name}.json").read_text("utf-8"))
    document["requirements"][0]["limit_mm"] = limit_mm
    return dict(document)


def between(name: str) -> float:
    """A limit that first order keeps by far and the chain misses."""
    low, high, _ = CASES[name]
    return (low * high) ** 0.5


def scored(name: str) -> Score:
    return score(load_design(limited(name, between(name))))


@pytest.mark.parametrize("name", CASES)
def test_the_interval_of_a_score_holds_what_an_independent_chain_found(name: str) -> None:
    """independent: trials of a chain that shares no code."""
    first, truth, error = CASES[name]
    found = scored(name)
    (check,) = found.verdict.checks
    assert check.value_mm == pytest.approx(first, rel=2e-3)
    assert check.status == "inconclusive"
    low, high = check.interval_mm
    assert low <= truth + error
    assert high is None or high >= truth - error
    assert found.validity.status in ("good to 20 %", "not valid")


@pytest.mark.long("plate_two_views")
@pytest.mark.parametrize("name", CASES)
def test_mode_auto_fails_what_verify_fails(name: str) -> None:
    document = limited(name, between(name))
    quick = policy({}, verification={"max_trials": 2**15})
    records = {mode: gate(document, mode=mode, policy=quick) for mode in ("auto", "verify", "analytic")}
    assert records["verify"].exit_code == records["auto"].exit_code == 1
    assert records["auto"].designs[0].basis == "Monte Carlo"
    assert records["analytic"].exit_code != 0


@pytest.mark.parametrize("name", CASES)
def test_mode_auto_passes_them_where_they_are_good(name: str) -> None:
    _, truth, _ = CASES[name]
    quick = policy({}, verification={"max_trials": 2**15})
    assert gate(limited(name, 1.2 * truth), mode="auto", policy=quick).exit_code == 0
