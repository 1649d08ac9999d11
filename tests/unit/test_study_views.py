"""Which view buys most: every number is the score of a design that anybody can write down.

Where the expected values come from is said at each test.
"""

from __future__ import annotations

from math import hypot
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_data import EVERY, EXAMPLES, read_cases
from tailstack.design import load_design
from tailstack.errors import StudyError
from tailstack.scoring import score
from tailstack.studies.views import BeamDirection, StudyViews, refuse_steps, study_views

LAT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # right, top and beam of its image, in con
PLATE = EVERY["flat_plate"]


def aimed(view: dict[str, Any], at: BeamDirection) -> dict[str, Any]:
    rest = {field: value for field, value in view.items() if field != "orientation"}
    return {**rest, "beam_direction": list(at.beam_direction), "up_direction": list(at.up_direction)}


def largest_p95(data: dict[str, Any]) -> float:
    return max(target.p95_mm for target in score(load_design(data), losses=False).targets)


@pytest.fixture(scope="module")
def plate() -> StudyViews:
    return study_views(load_design(EXAMPLES / "flat_plate.yaml"))


@pytest.mark.long
def test_the_p95_of_a_direction_is_the_score_of_the_design_with_that_direction(plate: StudyViews) -> None:
    """independent: the document is written by hand, a view turned or one appended, and scored."""
    assert plate.p95_mm == pytest.approx(largest_p95(PLATE), rel=1e-12)
    for place in (0, 1):
        allowed = [one for one in plate.views[place].directions if one.p95_mm is not None]
        for one in (allowed[0], allowed[7], allowed[-1], plate.views[place].best):
            turned = [aimed(view, one) if k == place else view for k, view in enumerate(PLATE["views"])]
            assert one.p95_mm == pytest.approx(largest_p95(PLATE | {"views": turned}), rel=1e-9)
    for one in (plate.further.directions[0], plate.further.best):
        more = aimed(PLATE["views"][0], one) | {"name": "of my own"}
        assert one.p95_mm == pytest.approx(largest_p95(PLATE | {"views": [*PLATE["views"], more]}), rel=1e-12)
    for drawn in (*plate.views, plate.further):
        assert drawn.best.p95_mm == min(each.p95_mm for each in drawn.directions if each.p95_mm is not None)


def test_a_view_turns_about_the_axis_across_its_beam_and_its_image_turns_with_it(plate: StudyViews) -> None:
    """independent: SciPy's rotation vectors; LAT runs along -x, its image has y to the right and z up."""
    right, top, beam = LAT
    for one in plate.views[1].directions:
        axis = np.cross(beam, one.right_deg * right + one.up_deg * top)
        turn = Rotation.from_rotvec(axis, degrees=True)
        np.testing.assert_allclose(one.beam_direction, turn.apply(beam), atol=1e-6)
        np.testing.assert_allclose(one.up_direction, turn.apply(top), atol=1e-6)
    lateral = plate.views[1]
    for other in lateral.angles:
        assert other.view == "AP"
        assert other.angle_deg == pytest.approx(np.degrees(np.arccos(abs(lateral.best.beam_direction[1]))), abs=1e-4)


def test_exactly_the_directions_that_hide_something_are_not_allowed(plate: StudyViews) -> None:
    """closed_form: a pinhole over the detector, written out; 29 directions on a grid of 10 deg within 30 deg."""
    view = PLATE["views"][1]
    design = load_design(PLATE)
    points = np.array([*design.fiducials.positions_mm, *(target.position_mm for target in design.document.targets)])
    iso = np.array(view.get("isocentre_mm", (0, 0, 0)))
    directions = plate.views[1].directions
    assert len(directions) == 29
    assert all(hypot(one.right_deg, one.up_deg) <= 30 for one in directions)
    hidden = []
    for one in directions:
        beam, top = np.array(one.beam_direction), np.array(one.up_direction)
        from_source = points - (iso - view["source_isocentre_mm"] * beam)
        on_detector = view["source_detector_mm"] * np.column_stack(
            [from_source @ np.cross(beam, top), from_source @ top]
        )
        hidden.append(bool((abs(on_detector / (from_source @ beam)[:, None]) > 1024 / 2 * view["pixel_mm"]).any()))
    assert [one.p95_mm is None for one in directions] == hidden
    assert 0 < sum(hidden) < 29
    assert all(
        ("outside view LAT" in (one.reason or "")) == hides for one, hides in zip(directions, hidden, strict=True)
    )
    assert f"{sum(hidden)} of 29 directions are not allowed" in plate.views[1].sentence


def test_what_buys_most_is_said_first(plate: StudyViews) -> None:
    first, second, third, last = plate.conclusions
    assert first.startswith("A third view like AP")
    assert "lowers P95 from 2.031 to 1.773 mm" in first
    assert second.startswith("Turning LAT by 10 deg towards -z")
    assert third.startswith("Turning AP buys next to nothing")
    assert last.startswith("As designed, P95 of the error at the tool is 2.031 mm at end")


def test_views_given_by_matrices_are_left_as_they_are_and_that_is_said() -> None:
    study = study_views(load_design(EXAMPLES / "locators_321.yaml"))
    assert study.further is None
    assert [one.directions for one in study.views] == [(), ()]
    assert all("is left as it is: it is given by a matrix or by intrinsics" in one.sentence for one in study.views)


@pytest.mark.parametrize(("cone_deg", "step_deg", "refused", "hint"), read_cases("studies", "maps"))
def test_a_map_has_a_direction_and_an_end(cone_deg: float, step_deg: float, refused: str, hint: str) -> None:
    """closed_form: at most 15 steps, at least one; what a hint asks for is taken."""
    if not refused:
        refuse_steps(cone_deg, step_deg)
        return
    with pytest.raises(StudyError, match=refused) as found:
        study_views(load_design(EXAMPLES / "demo.yaml"), cone_deg=cone_deg, step_deg=step_deg)
    (problem,) = found.value.problems
    assert (problem.pointer, problem.hint) == ("/step_deg", hint)
    refuse_steps(cone_deg, float(hint.split()[1]))
