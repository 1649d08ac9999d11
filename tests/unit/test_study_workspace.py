"""Where the arm may go: every pose is the score of a design that anybody can write down."""

from __future__ import annotations

from typing import Any

import pytest
from test_robot import EVERYTHING, stated

from plain_data import DEMO, EXAMPLES, problems_of, replaced
from tailstack import Design, load_design, score
from tailstack.errors import StudyError
from tailstack.studies.workspace import study_workspace

ARM = EXAMPLES / "gallery" / "robot_arm.yaml"
DEMONSTRATION = replaced(DEMO, ("execution", "robot"), stated(**EVERYTHING))


def p95_at(design: Design, joints: Any) -> float:
    return score(design.with_value("execution.robot.joints_executing_deg", list(joints))).targets[0].p95_mm


BOUNDED = {"half_width_deg": 0.2, "distribution": "bounded"}
ON_FLANGE = replaced(DEMONSTRATION, ("interfaces", "connector_flange", "tolerances", "rx"), BOUNDED)


@pytest.mark.parametrize(
    "design",
    [
        DEMONSTRATION,
        replaced(DEMO, ("execution", "robot"), stated("joints", True, **EVERYTHING)),
        ARM,
        replaced(ON_FLANGE, ("interfaces", "structure_connector", "tolerances", "rz"), BOUNDED),
    ],
)
def test_p95_of_a_pose_is_that_of_a_score_with_the_tool_there(design: Any) -> None:
    """independent: the document with that pose; scatter, links and the sag of the payload among what it has."""
    loaded = load_design(design)
    study = study_workspace(loaded, poses=100, seed=4, limit_mm=1.0)
    assert study.largest_p95_mm == pytest.approx(p95_at(loaded, study.largest_at_deg), rel=1e-9)
    shots: Any = getattr(loaded.document.execution, "robot")  # noqa: B009
    assert study.p95_at_shots_mm == pytest.approx(p95_at(loaded, shots.joints_imaging_deg), rel=1e-9)


def test_the_share_is_that_of_the_poses_and_the_maps_hold_each_of_them_once() -> None:
    """closed form: at the median it is a half, whose interval by Clopper and Pearson for 300 is 0.442 to 0.558."""
    middle = study_workspace(load_design(ARM), poses=300).median_p95_mm
    study = study_workspace(load_design(ARM), poses=300, limit_mm=middle)
    assert study.share == 0.5
    assert study.share_interval == pytest.approx((0.442, 0.558), abs=1e-3)
    for plane in ("from above", "from the side"):
        fields = [each for each in study.fields if each.plane == plane]
        assert [sum(each.poses for each in fields), sum(each.within for each in fields)] == [300, 150]


REFUSED = [
    (DEMO, "missing-field"),
    (replaced(DEMONSTRATION, ("requirements", 0, "error"), "localisation"), "missing-field"),
    (replaced(DEMONSTRATION, ("fiducials", "loss_probability"), 0.02), "not-studied"),
]


@pytest.mark.parametrize(("design", "code"), REFUSED)
def test_what_cannot_be_studied_is_refused(design: Any, code: str) -> None:
    assert problems_of(lambda: study_workspace(load_design(design)), error=StudyError)[0].code == code
    with pytest.raises(StudyError, match="no target is called 'nose'"):
        study_workspace(load_design(DEMONSTRATION), target="nose")
