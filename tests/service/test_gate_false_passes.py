"""Designs whose first-order P95 is far too small: no score and no gate may pass them for it."""

from __future__ import annotations

import json
from typing import Any

import pytest
import yaml
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
    "far_target_8deg": (197.3, 212.4, 0.9),
    "far_target_no_remark": (37.76, 39.96, 0.13),
}


# the same of designs that move between the shots, or turn about a lever along which a known error lies: at least and at
# most what the P95 of that chain is
UNSEEN = {
    "motion_small_far_pivot": (0.592, 0.676, 0.690),
    "motion_pivot_1400mm": (6.727, 7.145, 7.268),
    "rotation_with_bias_good_to_1": (95.25, 102.7, 102.9),
    "known_error_beside_images": (26.554, 28.38, 28.78),
    "seat_turns_far_target": (10.956, 11.6, 11.75),
}
# those of which the limit in the file is missed by the chain
MISSED = (*UNSEEN, "motion_with_effects_3views", "rotation_with_bias_auto")


def document_of(name: str) -> dict[str, Any]:
    file = ROOT / "tests" / "data" / "validity" / name
    if (text := file.with_suffix(".json")).exists():
        return dict(json.loads(text.read_text("utf-8")))
    return dict(yaml.safe_load(file.with_suffix(".yaml").read_text("utf-8")))


def limited(name: str, limit_mm: float) -> dict[str, Any]:
    document = document_of(name)
    document["requirements"][0]["limit_mm"] = limit_mm
    return document


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


@pytest.mark.long("plate_two_views", "motion_with_effects_3views", "published_seven_beads", "far_target_8deg")
@pytest.mark.parametrize("name", [*CASES, *MISSED])
def test_mode_auto_fails_what_verify_fails(name: str) -> None:
    """MISSED: at the limits at which ``gate --mode auto`` passed the design and ``verify`` failed it."""
    document, trials = (limited(name, between(name)), 2**15) if name in CASES else (document_of(name), 2**17)
    quick = policy({}, verification={"max_trials": trials})
    records = {mode: gate(document, mode=mode, policy=quick) for mode in ("auto", "verify", "analytic")}
    assert records["verify"].exit_code == records["auto"].exit_code == 1
    assert records["auto"].designs[0].basis == "Monte Carlo"
    assert records["analytic"].exit_code != 0


@pytest.mark.long("far_target_8deg")
@pytest.mark.parametrize("name", CASES)
def test_mode_auto_passes_them_where_they_are_good(name: str) -> None:
    _, truth, _ = CASES[name]
    quick = policy({}, verification={"max_trials": 2**15})
    assert gate(limited(name, 1.2 * truth), mode="auto", policy=quick).exit_code == 0


@pytest.mark.parametrize("name", UNSEEN)
def test_the_interval_of_a_score_holds_what_motion_and_turns_do(name: str) -> None:
    """independent: trials of a chain that shares no code."""
    first, least, most = UNSEEN[name]
    found = score(load_design(document_of(name)))
    (check,) = found.verdict.checks
    assert check.value_mm == pytest.approx(first, rel=2e-3)
    low, high = check.interval_mm
    assert low <= most
    assert high is None or high >= least
    assert found.validity.status in ("good to 20 %", "not valid")
