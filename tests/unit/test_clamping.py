"""What beads drilled in one clamping have in common: closed forms, and what is refused; test_correlation.py has a chain
that is drawn in NumPy."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from test_correlation import normal, pair

from plain_data import DEMO, problems_of
from tailstack import load_design, score

BESIDE = ("interfaces", "execution", "optimise")


def alone(**sections: Any) -> dict[str, Any]:
    """The demo with these of its sections, and nothing else that varies but image noise."""
    data = {name: copy.deepcopy(each) for name, each in DEMO.items() if name not in BESIDE}
    data["fiducials"].pop("manufacturing", None)
    data["fiducials"] |= sections.pop("fiducials", {})
    return data | sections


TORSOR = {name: normal(name, 0.3) for name in ("rx", "rz", "tx", "tz")} | {"correlation": [pair("rx", "tz", -0.9)]}
SEAT = [5.0, -3.0, -90.0]


def test_all_beads_in_one_clamping_that_turn_and_shift_are_a_seat_that_does():
    """closed_form: images see where beads are, whoever has put them there."""
    moved = {"pivot_mm": SEAT, "tolerances": TORSOR}
    by_drill = score(load_design(alone(fiducials={"common": [moved]}))).targets[0]
    by_seat = score(load_design(alone(interfaces={"structure_connector": moved}))).targets[0]
    np.testing.assert_allclose(by_drill.covariance_mm2, by_seat.covariance_mm2, rtol=1e-9, atol=1e-14)
    lines = [{line.component: line.variance_share for line in each.contributors} for each in (by_drill, by_seat)]
    assert lines[0] == pytest.approx(lines[1], rel=1e-9)
    assert "rx+tz" in lines[0]


@pytest.mark.parametrize("pivot", [SEAT, None])
def test_a_scale_of_all_beads_is_a_structure_that_grows(pivot):
    """closed_form: 100 um/(m K) and 10 K are a part of 0.001, about the same point."""
    scale = {"scale": {"half_width_rel": 0.001, "distribution": "uniform"}}
    middle = np.mean([each["position_mm"] for each in DEMO["fiducials"]["points"]], axis=0).tolist()
    heat = {
        "half_width_k": 10.0, "distribution": "uniform", "structure_expansion_um_per_m_k": 100.0,
        "seat_mm": pivot or middle,
    }  # fmt: skip
    common = {"common": [scale | ({} if pivot is None else {"pivot_mm": pivot})]}
    drilled, warm = (score(load_design(each)).targets[0] for each in (alone(fiducials=common), alone(temperature=heat)))
    assert drilled.p95_mm == pytest.approx(warm.p95_mm, rel=1e-9)
    assert drilled.p95_mm != pytest.approx(score(load_design(alone())).targets[0].p95_mm, rel=1e-3)


def test_a_bead_that_is_missed_was_drilled_about_the_centroid_of_all():
    """independent: the same, its pivot stated."""
    labels = [each["label"] for each in DEMO["fiducials"]["points"]]
    own = [each["position_mm"] for each in DEMO["fiducials"]["points"][:5]]
    part = {"fiducials": labels[:5], "tolerances": {name: normal(name, 0.5) for name in ("rx", "ry", "rz")}}
    stated = part | {"pivot_mm": np.mean(own, axis=0).tolist()}
    missed = {"loss_probability": 0.05}
    found = [score(load_design(alone(fiducials=missed | {"common": [each]}))) for each in (part, stated)]
    assert found[0].losses[0].single.value == pytest.approx(found[1].losses[0].single.value, rel=1e-9)
    assert found[0].targets[0].p95_mm == pytest.approx(found[1].targets[0].p95_mm, rel=1e-9)


@pytest.mark.parametrize(
    ("common", "more", "pointer", "code"),
    [
        ([{"fiducials": ["F1", "F99"]}], {}, "/fiducials/common/0/fiducials/1", "unknown-name"),
        ([{}, {"name": "C1"}], {}, "/fiducials/common/1/name", "duplicate-name"),
        ([{"tolerances": {"ry": normal("ry", 1.5)}}], {}, "/fiducials/common/0/tolerances", "out-of-range"),
        (
            [{"fiducials": ["F1"]}],
            {"optimise": {"box": {"min_mm": [-50] * 3, "max_mm": [50] * 3}, "count": {"min": 8, "max": 12}}},
            "/optimise/count",
            "count-and-sees",
        ),
    ],
)
def test_what_cannot_be_drilled_is_refused(common, more, pointer, code):
    (problem,) = problems_of(load_design, alone(fiducials={"common": common}) | more)
    assert (problem.pointer, problem.code) == (pointer, code)
    assert problem.hint
