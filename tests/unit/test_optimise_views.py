"""Views whose direction and distance the optimiser may choose.

Expected values are plain optimisations of documents in which a view is turned by hand, with SciPy's rotations.
"""

from __future__ import annotations

import copy
from math import hypot, inf, radians
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optimise_documents import document, moving, optimised
from tailstack.design import load_design
from tailstack.errors import DesignError, InfeasibleError

BEAM, UP = np.array([0.42261826, 0.90630779, 0.0]), np.array([0.0, 0.0, 1.0])  # LAT, only 25 deg from AP


def poor(limit_mm: float = 0.6, **changes: Any) -> dict[str, Any]:
    """Six fixed fiducials, rotations to be budgeted, and two views that see nearly the same."""
    data = document(limit_mm=limit_mm, **moving(box=None, starts=1, **changes))
    data["views"][1].pop("orientation")
    return turned(data, 0.0, 0.0)


def turned(data: dict[str, Any], right_deg: float, up_deg: float) -> dict[str, Any]:
    """The second view turned about its isocentre, its image with it."""
    data = copy.deepcopy(data)
    right = np.cross(BEAM, UP)
    turn = Rotation.from_rotvec(radians(right_deg) * np.cross(BEAM, right) + radians(up_deg) * np.cross(BEAM, UP))
    data["views"][1] |= {"beam_direction": turn.apply(BEAM).tolist(), "up_direction": turn.apply(UP).tolist()}
    return data


def plain_cost(data: dict[str, Any]) -> float:
    try:
        return optimised(data).cost_after
    except InfeasibleError:
        return inf


def with_views(data: dict[str, Any], *views: dict[str, Any]) -> dict[str, Any]:
    return data | {"optimise": data["optimise"] | {"views": list(views)}}


def test_turning_a_view_is_worth_what_the_plain_optimiser_finds_in_every_direction() -> None:
    """independent: 13 directions on a grid of 15 deg, each written by hand and optimised with its views fixed."""
    base = poor()
    grid = [(a, b) for a in (-30.0, -15.0, 0.0, 15.0, 30.0) for b in (-30.0, -15.0, 0.0, 15.0, 30.0)]
    costs = {at: plain_cost(turned(base, *at)) for at in grid if hypot(*at) <= 30}
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 30.0}))
    assert found.aimed is not None
    assert found.cost_after <= min(costs.values()) * (1 + 5e-4)
    assert found.cost_after < 0.81 * costs[0.0, 0.0]
    (view,) = found.aimed.views
    beam = np.array(found.design["views"][1]["beam_direction"])  # type: ignore[index]
    assert view.turn_deg == pytest.approx(np.degrees(np.arccos(beam @ BEAM)), abs=1e-3)
    assert view.turn_deg <= 30 + 1e-3
    assert found.aimed.solved <= 25
    assert f"best of {found.aimed.solved} ways" in found.aimed.sentence
    assert "not proven" in found.aimed.sentence
    assert found.p95_before_mm == pytest.approx(optimised(base).p95_before_mm, rel=1e-12)
    assert found.design_before["views"][1]["beam_direction"] == list(BEAM)  # type: ignore[index]


def test_the_new_design_is_that_of_the_plain_optimiser_with_the_views_written_in() -> None:
    """independent: the views of the answer in the first document, no view free."""
    base = poor()
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 20.0, "source_isocentre_mm": [650.0, 800.0]}))
    written = optimised(base | {"views": found.design["views"]})
    assert found.aimed is not None
    assert found.cost_after == written.cost_after
    assert found.tolerances == written.tolerances
    assert 650 <= found.aimed.views[0].source_isocentre_mm <= 800
    assert found.aimed.objective_as_aimed == pytest.approx(optimised(base).cost_closed_form, rel=1e-6)


def test_a_limit_out_of_reach_as_the_views_are_aimed_is_kept_by_turning_one() -> None:
    """independent: the plain optimiser refuses the limit where the view stands."""
    base = poor(limit_mm=0.42)
    with pytest.raises(InfeasibleError):
        optimised(base)
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 30.0}))
    assert found.verdict_status == "pass"
    assert found.aimed is not None
    assert found.aimed.objective_as_aimed is None


def test_a_limit_out_of_reach_wherever_a_view_looks_is_refused_as_without_free_views() -> None:
    base = poor(limit_mm=0.01)
    with pytest.raises(InfeasibleError) as plain:
        optimised(base)
    with pytest.raises(InfeasibleError) as free:
        optimised(with_views(base, {"view": "LAT", "cone_deg": 30.0}))
    assert free.value.problems[0].detail == plain.value.problems[0].detail


MATRIX = {
    "name": "AP", "fiducial_noise_px": 0.3, "target_noise_px": 0.3,
    "intrinsics": {"focal_px": [5000.0, 5000.0], "principal_point_px": [500.0, 500.0]},
    "pose": {"rotation_deg": [90.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 700.0]},
}  # fmt: skip


@pytest.mark.parametrize(
    ("free", "pointer", "says"),
    [
        ({"view": "LTA", "cone_deg": 30.0}, "/optimise/views/0/view", "LAT"),
        ({"view": "AP", "cone_deg": 30.0}, "/optimise/views/0/view", "intrinsics and a pose"),
        ({"view": "LAT"}, "/optimise/views/0", "cone_deg"),
        ({"view": "LAT", "source_isocentre_mm": [800.0, 600.0]}, "/optimise/views/0/source_isocentre_mm", "800"),
        ({"view": "LAT", "source_isocentre_mm": [600.0, 5000.0]}, "/optimise/views/0/source_isocentre_mm/1", "5000"),
    ],
    ids=["unknown", "not aimed", "nothing free", "order", "behind the detector"],
)
def test_views_that_cannot_be_aimed_are_refused_where_they_stand(free: dict[str, Any], pointer: str, says: str) -> None:
    data = with_views(poor(), free)
    data["views"][0] = MATRIX
    with pytest.raises(DesignError) as refused:
        load_design(data)
    (problem,) = refused.value.problems
    assert problem.pointer == pointer
    assert says in problem.detail + problem.hint


def test_views_are_not_aimed_along_a_front() -> None:
    with pytest.raises(DesignError, match="front is not traced with views"):
        load_design(with_views(poor(objective="pareto"), {"view": "LAT", "cone_deg": 30.0}))
