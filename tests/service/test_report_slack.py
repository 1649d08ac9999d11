"""How far each half-width may go by itself, of the requirement that decides."""

from __future__ import annotations

import pytest
import yaml
from service_scenes import EXAMPLES

from tailstack import load_design, score, verify
from tailstack_service.report.assembling import ReportContents, compute_report

UNITS = EXAMPLES / "gallery" / "per_unit_limit.yaml"


def test_slack_is_to_the_requirement_that_decides() -> None:
    """The half-width at the limit, tried: the estimate is the limit, and the full chain's interval holds it."""
    allowances = compute_report(load_design(UNITS), ReportContents(parts=("score",))).allowances
    assert {entry.requirement for entry in allowances} == {"every-unit"}
    assert {entry.status for entry in allowances} == {"too wide", "zero is not enough"}
    (rx,) = [e for e in allowances if (e.contributor, e.component) == ("connector_flange", "rx")]
    data = yaml.safe_load(UNITS.read_text(encoding="utf-8"))
    data["interfaces"]["connector_flange"]["tolerances"]["rx"]["half_width_deg"] = rx.at_limit
    tried = load_design(data)
    (estimate,) = [check for check in score(tried).verdict.checks if check.requirement == "every-unit"]
    assert estimate.value_mm == pytest.approx(0.6, rel=1e-6)
    (drawn,) = [check for check in verify(tried, trials=2**17).verdict.checks if check.requirement == "every-unit"]
    low, high = drawn.interval_mm
    assert high is not None
    assert low / 1.01 <= 0.6 <= high * 1.01  # an estimate is within 1 % of a simulation


def test_the_target_that_decides_has_its_slack_even_where_others_have_a_larger_error() -> None:
    """Five targets along the axis; the smallest error has the smallest limit."""
    data = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
    data["targets"] = [{"name": f"t{k}", "position_mm": [0, 0, 40 + 10 * k]} for k in range(5)]
    limit = {**data["requirements"][0], "targets": ["t0"], "limit_mm": 0.9}
    data["requirements"] = [limit, {**limit, "name": "elsewhere", "targets": ["t1", "t2", "t3", "t4"], "limit_mm": 9.0}]
    del data["optimise"]
    allowances = compute_report(load_design(data), ReportContents(parts=("score",))).allowances
    named = {(entry.target, entry.requirement) for entry in allowances}
    assert named == {("t4", "elsewhere"), ("t3", "elsewhere"), ("t2", "elsewhere"), ("t0", "tip-accuracy")}
    assert not any(entry.status == "spare" for entry in allowances if entry.target == "t0")
