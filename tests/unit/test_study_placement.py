"""What a change buys at best: each change is the document that one would write by hand, and no sentence says more than
the numbers.

Where the expected values come from is said at each test.
"""

from __future__ import annotations

import re
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from plain_data import DEMO, REMOVED, read_cases, replaced
from tailstack.design import compile_design, load_design
from tailstack.errors import DesignError
from tailstack.optimisation.changes import Alternative, floor_of, layout_problem, list_changes
from tailstack.optimisation.cost_bound import bound_layouts
from tailstack.optimisation.regions import BoxRegion
from tailstack.scoring import score
from tailstack.studies.placement import PlacementCase, StudyPlacement, cases_of, say_worth, study_placement


def changes_of(data: dict[str, Any], kind: str) -> dict[Any, Alternative]:
    return {each.value or each.words: each for each in list_changes(load_design(data), "tcp") if each.kind == kind}


def test_each_change_is_the_document_that_one_would_write_by_hand() -> None:
    """independent: the corners of the box worked out here, the angle by its cosine; the other view stays."""
    low, high = (np.array(DEMO["optimise"]["box"][end]) for end in ("min_mm", "max_mm"))
    for region in {place.region for place in changes_of(DEMO, "envelope")[1.5].make().places}:
        assert isinstance(region, BoxRegion)
        np.testing.assert_allclose(region.low_mm, (low + high) / 2 - 0.75 * (high - low))
        np.testing.assert_allclose(region.high_mm, (low + high) / 2 + 0.75 * (high - low))
    counts = {count: len(change.make().system.fiducials_mm) for count, change in changes_of(DEMO, "fiducials").items()}
    assert counts == {count: count for count in (8, 10, 11, 13, 14, 16)}
    assert str(changes_of(DEMO, "estimator")["pose"].make().system.estimator) == "pose"
    assert "pose_with_prior" not in changes_of(DEMO, "estimator")  # no view says how well its intrinsics are known
    fixed = compile_design(load_design(DEMO)).views[0].projection
    for angle_deg, change in changes_of(DEMO, "angle").items():
        first, second = (view.projection for view in change.make().system.views)
        assert np.degrees(np.arccos(first[2, :3] @ second[2, :3])) == pytest.approx(angle_deg, abs=1e-3)
        np.testing.assert_array_equal(first, fixed)


def test_what_a_design_does_not_let_change_is_left_out() -> None:
    """A view by its matrix does not turn, regions name their fiducials, groups grow by whole ones."""
    matrices = compile_design(load_design(DEMO)).views
    views = [
        {"name": view.name, "projection": view.projection.tolist(), "fiducial_noise_px": 0.3, "target_noise_px": 0.3}
        for view in matrices
    ]
    assert not changes_of(DEMO | {"views": views}, "angle")
    labels = [point["label"] for point in DEMO["fiducials"]["points"]]
    rest = {name: value for name, value in DEMO["optimise"].items() if name not in ("box", "fixed")}
    regions = [{"fiducials": labels, "box": DEMO["optimise"]["box"]}]
    assert not changes_of(DEMO | {"optimise": rest | {"regions": regions}}, "fiducials")
    pairs = DEMO["optimise"] | {"symmetry": {"mirror": {"point_mm": [0, 0, 0], "normal": [1, 0, 0]}}}
    assert sorted(changes_of(DEMO | {"optimise": pairs}, "fiducials")) == [8, 10, 14, 16, 20]
    with pytest.raises(DesignError, match="no fiducial is free"):
        layout_problem(load_design(DEMO | {"optimise": {"rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}}}), "tcp")


def test_what_no_structure_undercuts_is_what_exact_views_leave() -> None:
    """independent: the score of beads whose images and places are all but exact, triangulated by weights."""
    weighted = DEMO | {"model": {"triangulation": "weighted"}}
    data = replaced(weighted, ("interfaces", "structure_connector", "bias"), REMOVED)
    floor_mm = floor_of(layout_problem(load_design(data), "localisation"), "tip")
    del data["fiducials"]["manufacturing"]
    for view in data["views"]:
        view["fiducial_noise_px"] = 1e-5
    assert score(load_design(data), losses=False).targets[0].localisation.p95_mm == pytest.approx(floor_mm, rel=1e-6)


@pytest.fixture(scope="module")
def study() -> StudyPlacement:
    """Of one change of each kind."""
    place = "tailstack.optimisation.changes"
    with patch(f"{place}.COUNTS", (1,)), patch(f"{place}.SIZES", (1.5,)), patch(f"{place}.ANGLES_DEG", (60.0,)):
        return study_placement(load_design(DEMO), starts=1)


@pytest.mark.long
def test_a_bound_is_that_of_the_document_and_what_is_found_lies_above_it(study: StudyPlacement) -> None:
    """independent: ``validate --bound`` of documents written by hand."""
    box = {"min_mm": [-67.5, -67.5, -110], "max_mm": [67.5, 67.5, 40]}
    more = {"label": "F13", "position_mm": [0, 0, -40]}
    documents = {
        "as designed": DEMO,
        "13 fiducials": DEMO | {"fiducials": DEMO["fiducials"] | {"points": [*DEMO["fiducials"]["points"], more]}},
        "envelope 1.5 times as wide": DEMO | {"optimise": DEMO["optimise"] | {"box": box}},
        "pose": DEMO | {"model": {"estimator": "pose"}},
    }
    by_name = {case.case: case for case in study.cases}
    for name, document in documents.items():
        (bound,), _ = bound_layouts(load_design(document))
        assert bound.lower_bound_mm == by_name[name].lower_bound_mm
    floor_mm = study.any_structure_mm
    for case in study.cases:
        assert case.lower_bound_mm <= case.best_found_mm
        assert case.changed == "angle" or floor_mm <= case.lower_bound_mm
    assert [at for at, _ in cases_of(study, "envelope")] == [1.0, 1.5]
    assert [at for at, _ in cases_of(study, "estimator")] == ["dlt", "reprojection", "pose"]


@pytest.mark.parametrize(("least_mm", "found_mm", "words"), read_cases("studies", "proven"))
def test_a_sentence_says_what_is_proven(least_mm: float | None, found_mm: float | None, words: str) -> None:
    case = PlacementCase("fiducials", "13 fiducials", 13, "tip", found_mm, least_mm, "why")
    most_mm, sentence = say_worth(1.0, case)
    assert most_mm == pytest.approx(max(1 - least_mm, 0) if least_mm else 0)
    assert re.search(words, sentence)
