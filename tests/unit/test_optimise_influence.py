"""What is said before solving: what the free variables can and cannot do, and what does nothing at all."""

from __future__ import annotations

import copy
import re
from typing import Any

import pytest

from optimise_documents import BOX, document, free, moving, normal, optimised
from tailstack.design import load_design
from tailstack.errors import DesignError
from tailstack.optimisation import influence, optimise
from tailstack.results import Finding
from tailstack.scoring import score

SEAT, FLANGE = "structure_connector", "connector_flange"
DEG = {"min_deg": 0.01, "max_deg": 0.5}


def findings(data: dict[str, Any], rule: str) -> list[Finding]:
    return [finding for finding in influence(load_design(data)) if finding.rule == rule]


def without_noise(data: dict[str, Any]) -> dict[str, Any]:
    """Perfect fiducials, and perfect images of them (to a thousandth of a thousandth of a pixel)."""
    data = copy.deepcopy(data)
    for view in data["views"]:
        view["fiducial_noise_px"] = 1e-6
    del data["fiducials"]["manufacturing"]
    return data


@pytest.mark.long
def test_no_layout_gets_below_what_the_mechanics_leave() -> None:
    """independent: the score of the same design with images and fiducials made perfect."""
    data = document(limit_mm=0.8, **moving())
    (finding,) = findings(data, "layout-influence")
    floor = score(load_design(without_noise(data))).targets[0].p95_mm
    assert finding.value == pytest.approx(floor, rel=1e-5)
    assert (finding.severity, finding.limit, finding.pointer) == ("note", 0.8, "/optimise/box")
    now = score(load_design(data)).targets[0].p95_mm
    assert f"{now:.4g} mm" in finding.message
    assert f"({100 * (floor / now - 1):+.1f} %)" in finding.message
    # and the best layout of all, tolerances as they are, is above it
    assert optimised(document(box=BOX)).p95_after_mm > floor


def test_a_layout_that_hardly_matters_is_a_warning() -> None:
    """closed form: seats a hundred times worse than the images leave the layout less than 0.5 %."""
    data = document(limit_mm=20.0, **moving())
    for axis in ("rx", "ry"):
        data["interfaces"][FLANGE]["tolerances"][axis] = normal("deg", 4.0)
    (finding,) = findings(data, "layout-influence")
    assert finding.severity == "warning"
    floor = score(load_design(without_noise(data))).targets[0].p95_mm
    assert floor / score(load_design(data)).targets[0].p95_mm > 0.995
    assert finding.value == pytest.approx(floor, rel=1e-5)


def test_the_findings_are_part_of_the_record() -> None:
    data = document(**moving())
    assert optimised(data).influence == influence(load_design(data))


def test_a_half_width_without_lever_goes_to_its_loosest() -> None:
    """closed form: a rotation about the axis through pivot and target does not move the target."""
    data = document(rotation_bounds=DEG)
    data["interfaces"][FLANGE]["tolerances"]["rz"] = normal("deg", 0.1)
    (finding,) = findings(data, "no-lever")
    assert finding.message.startswith("flange rz does not matter for any limit")
    assert (finding.severity, finding.pointer) == ("note", "/optimise/rotation_bounds")
    result = optimised(data)
    (item,) = [item for item in result.tolerances if item.component == "rz"]
    assert (item.after_half_width, item.at_target_mm) == (0.5, pytest.approx(0, abs=1e-9))


def test_the_flange_does_not_act_on_localisation() -> None:
    """Interface 2 comes after localisation: free alone it is refused, beside others it is loosest."""
    alone = document(tolerances=[free(FLANGE, axis, **DEG) for axis in ("rx", "ry")])
    alone["requirements"][0]["error"] = "localisation"
    for call in (influence, optimise):
        with pytest.raises(DesignError) as refused:
            call(load_design(alone))
        (problem,) = refused.value.problems
        assert (problem.pointer, problem.code) == ("/optimise", "no-influence")
        assert "flange rx" in problem.detail
        assert "tcp" in problem.hint
    both = document(rotation_bounds=DEG)
    both["requirements"][0]["error"] = "localisation"
    assert {re.match(r"flange r[xy]", finding.message) is not None for finding in findings(both, "no-lever")} == {True}
    result = optimised(both)
    assert {item.after_half_width for item in result.tolerances if item.contributor == "connector_flange"} == {0.5}


def test_an_idle_pivot_is_said_and_alone_refused() -> None:
    """Nothing turns about the pivot of a seat that only slides."""
    pivot = {"interface": SEAT, "box": {"min_mm": [0, 0, -95], "max_mm": [0, 0, -60]}}
    data = document(pivots=[pivot], tolerances=[free(FLANGE, axis, **DEG) for axis in ("rx", "ry")])
    data["interfaces"][SEAT]["tolerances"] = {"tx": normal("mm", 0.03)}
    (finding,) = findings(data, "no-lever")
    assert (finding.severity, finding.pointer) == ("warning", "/optimise/pivots/0")
    assert "the pivot of seat" in finding.message
    del data["optimise"]["tolerances"]
    with pytest.raises(DesignError, match="nothing that is free acts"):
        influence(load_design(data))


def test_a_free_thing_that_acts_is_not_remarked_on() -> None:
    pivot = {"interface": FLANGE, "box": {"min_mm": [0, 0, -145], "max_mm": [0, 0, -60]}}
    assert influence(load_design(document(pivots=[pivot], rotation_bounds=DEG))) == ()


def test_an_undetermined_layout_has_no_influence_to_compare() -> None:
    """All fiducials in one plane: there is no quantile before, and the rest is still said."""
    data = document(**moving())
    for point in data["fiducials"]["points"]:
        point["position_mm"][2] = -40.0
    assert findings(data, "layout-influence") == []
