"""How far each tolerance could go by itself, and what it costs: against scores of designs with that very tolerance."""

from __future__ import annotations

from math import radians
from typing import Any

import pytest
import yaml
from service_scenes import EXAMPLES, limited, small_design

from plain_data import replaced
from tailstack import load_design, score, verify
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.records import Allowance, Report

SEAT = "structure_connector"


def reported(design: dict[str, Any]) -> Report:
    return compute_report(load_design(design), ReportContents(parts=("score",)))


def of(report: Report, contributor: str, component: str) -> Allowance:
    return next(
        entry for entry in report.allowances if (entry.contributor, entry.component) == (contributor, component)
    )


def with_width(design: dict[str, Any], component: str, half_width_deg: float) -> dict[str, Any]:
    return replaced(design, ("interfaces", SEAT, "tolerances", component, "half_width_deg"), half_width_deg)


@pytest.mark.parametrize(
    ("name", "contributor", "component", "path"),
    [
        ("demo", "connector_flange", "ry", "interfaces.connector_flange.tolerances.ry.half_width_deg"),
        ("demo", "fiducial_noise:LAT", "all", "views.LAT.fiducial_noise_px"),
        ("demo", "fiducial_manufacturing", "all", "fiducials.manufacturing.half_width_mm"),
        ("missed", "connector_flange", "rx", "interfaces.connector_flange.tolerances.rx.half_width_deg"),
        ("bounded", SEAT, "rx", "interfaces.structure_connector.tolerances.rx.half_width_deg"),
        ("locators_321", SEAT, "A3", "interfaces.structure_connector.locators.A3.half_width_mm"),
    ],
)
def test_at_its_limit_any_source_of_any_design_gives_the_limit(
    name: str, contributor: str, component: str, path: str
) -> None:
    """independent: the document with that number in it is scored; of what is bounded counts its worst end, which moves
    the mean; without missed beads in it the value would be 2 % above."""
    design = load_design(EXAMPLES / f"{'demo' if name in ('bounded', 'missed') else name}.yaml")
    if name == "bounded":
        design = design.with_value("interfaces.structure_connector.tolerances.rx.distribution", "bounded")
    if name == "missed":
        design = design.with_value("fiducials.loss_probability", 0.03)
    if name != "locators_321":
        design = design.with_value("requirements.tip-accuracy.limit_mm", 1.25)
    found = of(compute_report(design, ReportContents(parts=("score",))), contributor, component)
    assert found.status == "spare"
    assert found.at_limit is not None
    assert found.slack == pytest.approx(found.at_limit - found.half_width, rel=1e-9)
    checks = score(design.with_value(path, found.at_limit), losses=False).verdict.checks
    (check,) = [check for check in checks if (check.requirement, check.target) == (found.requirement, found.target)]
    # What missed beads add hardly depends on a half-width
    assert check.value == pytest.approx(check.limit, rel=2e-3 if name == "missed" else 1e-6)


def test_what_cannot_help_or_has_no_requirement_has_no_room() -> None:
    design = limited(0.1)
    found = of(reported(design), "structure_connector", "rx")
    assert (found.status, found.at_limit, found.slack) == ("zero is not enough", None, None)
    assert score(load_design(with_width(design, "rx", 0.0)), losses=False).targets[0].p95_mm > 0.1
    design = small_design(requirements=None, optimise=None)
    assert {entry.status for entry in reported(design).allowances} == {"no requirement"}


def test_costs_and_bounds_are_those_of_the_optimise_section() -> None:
    """closed_form: weight / half-width in radians, weight 1."""
    found = of(reported(limited(0.9)), "structure_connector", "rx")
    assert found.cost == pytest.approx(1 / radians(0.1), rel=1e-12)
    assert (found.smallest, found.largest) == (pytest.approx(0.01), pytest.approx(0.5))
    assert of(reported(limited(0.9)), "fiducial_manufacturing", "all").cost is None


def test_another_quantile_and_error_are_judged_by_their_own_requirement() -> None:
    design = limited(0.9)
    own = {"name": "deep", "limit_mm": 0.5, "error": "localisation", "quantile": 0.99}
    design["requirements"] = [own]
    found = of(reported(design), "structure_connector", "rx")
    assert found.requirement == "deep"
    assert found.at_limit is not None
    checks = score(load_design(with_width(design, "rx", found.at_limit)), losses=False).verdict.checks
    assert checks[0].value == pytest.approx(0.5, rel=1e-6)


# --- of the requirement that decides --------------------------------------------------------------


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
    (estimate,) = [check for check in score(tried, losses=False).verdict.checks if check.requirement == "every-unit"]
    assert estimate.value == pytest.approx(0.6, rel=1e-6)
    (drawn,) = [check for check in verify(tried, trials=2**17).verdict.checks if check.requirement == "every-unit"]
    low, high = drawn.interval
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
