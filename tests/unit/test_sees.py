"""Views that see some of the fiducials: what is checked of them, and what the score makes of them."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
import yaml

from tailstack import score
from tailstack.design import check_design, load_design
from tailstack.errors import DesignError, IllPosedError

DEMO = yaml.safe_load((Path(__file__).parents[2] / "examples" / "demo.yaml").read_text())
LABELS = [point["label"] for point in DEMO["fiducials"]["points"]]


def seen(*lists):
    """The drill guide with what each of its views sees; None: everything."""
    data = copy.deepcopy(DEMO)
    for view, labels in zip(data["views"], lists, strict=True):
        if labels is not None:
            view["sees"] = labels
    return data


def test_a_fiducial_that_no_view_sees_is_as_good_as_left_out():
    """brute force: the document without it."""
    rest = [label for label in LABELS if label != "F3"]
    hidden = score(load_design(seen(rest, rest)))
    data = copy.deepcopy(DEMO)
    data["fiducials"]["points"] = [point for point in data["fiducials"]["points"] if point["label"] != "F3"]
    without = score(load_design(data))
    for one, other in zip(hidden.targets, without.targets, strict=True):
        assert one.p95_mm == pytest.approx(other.p95_mm, rel=1e-9)
    assert hidden.validity.nu == pytest.approx(without.validity.nu, rel=0.05)  # the unit of length is another
    assert hidden.validity.layout_class == without.validity.layout_class
    assert score(load_design(seen(LABELS, LABELS))).targets[0].p95_mm == score(load_design(DEMO)).targets[0].p95_mm


def test_what_one_view_does_not_see_costs_less_than_what_none_sees():
    rest = [label for label in LABELS if label != "F3"]
    whole, one, none = (score(load_design(seen(*each))).targets[0].p95_mm for each in
                        ((None, None), (rest, None), (rest, rest)))  # fmt: skip
    assert whole < one < none


def test_a_fiducial_that_is_not_seen_may_lie_outside_the_image():
    data = copy.deepcopy(DEMO)
    data["fiducials"]["points"].append({"label": "far", "position_mm": [0.0, 400.0, 150.0]})
    with pytest.raises(IllPosedError):
        check_design(load_design(data))
    for view in data["views"]:
        view["sees"] = LABELS
    _, _, views = check_design(load_design(data))
    assert all("far" not in view.outside for view in views)


def test_a_flat_share_of_the_structure_is_refused_where_it_is_listed():
    data = copy.deepcopy(DEMO)
    low = [{"label": f"P{k}", "position_mm": [10.0 * k, (k * k) % 7 * 6.0, -40.0]} for k in range(6)]
    data["fiducials"]["points"] += low
    data["views"][1]["sees"] = [point["label"] for point in low]
    with pytest.raises(IllPosedError) as caught:
        check_design(load_design(data))
    problem = caught.value.problems[0]
    assert (problem.pointer, problem.code) == ("/views/1/sees", "coplanar-fiducials")
    assert problem.detail.startswith("view LAT: ")


def test_their_number_does_not_change_under_a_view_that_lists_them():
    data = seen(LABELS, None)
    data["optimise"]["count"] = {"min": 8, "max": 10}
    with pytest.raises(DesignError) as caught:
        load_design(data)
    assert any(problem.code == "count-and-sees" for problem in caught.value.problems)
