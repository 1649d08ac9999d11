"""The study of estimators: its numbers are the scores', and its sentences say what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenes import cube_fiducials, system_of, with_noise
from tailstack.errors import OutOfRangeError
from tailstack.scoring import score
from tailstack.studies.estimators import study_estimators
from tailstack.system import Estimator


def test_the_published_figures_stand_side_by_side():
    """published: P95 of the cube of eight at 20 mm under DLT, least squares, prior of 1 % and 10 px, and the pose."""
    study = study_estimators(system_of(cube_fiducials(20), views=with_noise(0.5)), trials=8192)
    found = {case.estimator: case for case in study.cases}
    assert [round(found[name].p95_mm or 0, 4) for name in ("dlt", "reprojection", "pose_with_prior")] == [
        1.0, 0.9984, 0.3003,
    ]  # fmt: skip
    assert round(found["pose"].p95_exact_mm or 0, 4) == 0.2985
    for case in study.cases:
        assert case.simulated_interval_mm is not None
        low, high = case.simulated_interval_mm
        assert low * 0.99 < (case.p95_mm or 0) < high * 1.03
    assert "from 1.000 to 0.300 mm (-70 %)" in study.conclusions[0]


def test_a_structure_of_the_size_it_names_does_as_well():
    """independent: the score of the shrunk structure under the prior, against DLT's of the whole one."""
    system = system_of(cube_fiducials(20), views=with_noise(0.5))
    study = study_estimators(system)
    case = next(case for case in study.cases if case.estimator == "pose_with_prior")
    assert case.same_size_mm is not None
    assert study.extent_mm == pytest.approx(40 * np.sqrt(3))
    scale = case.same_size_mm / study.extent_mm
    centre = system.fiducials_mm.mean(axis=0)
    known = study_estimators(replace(system, fiducials_mm=centre + scale * (system.fiducials_mm - centre)))
    shrunk = next(case for case in known.cases if case.estimator == "pose_with_prior")
    assert shrunk.p95_mm == pytest.approx(score(system).targets[0].p95_mm, rel=0.02)
    assert f"A structure of {case.same_size_mm:.0f} mm with known intrinsics" in study.conclusions[1]


def test_an_estimator_without_an_answer_says_why():
    four = system_of(cube_fiducials(50)[[0, 3, 5, 6]], views=with_noise(0.5))
    study = study_estimators(four)
    answered = {case.estimator: case.p95_mm is not None for case in study.cases}
    assert answered == {"dlt": False, "reprojection": False, "pose_with_prior": True, "pose": True}
    assert "4 fiducials arrived" in study.cases[0].reason
    assert study.conclusions[0].startswith("Without known intrinsics this design has no answer")
    two = system_of(cube_fiducials(50)[:2], views=with_noise(0.5), estimator=Estimator.POSE)
    with pytest.raises(OutOfRangeError, match="no estimator has an answer"):
        study_estimators(two)


def test_intrinsics_that_the_study_takes_for_wrong_are_not_listed_as_taken_for_exact():
    system = system_of(cube_fiducials(20), views=with_noise(0.5), estimator=Estimator.POSE)
    assert any("focal length" in line for line in score(system).provenance.not_included)
    assert not any("focal length and" in line for line in study_estimators(system).provenance.not_included)
