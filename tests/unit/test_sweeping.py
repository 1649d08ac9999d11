"""Sweeps: each point against the design written by hand, the grid's order, what is refused."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tailstack import load_design, score, verify
from tailstack.design.pointers import pointer_of
from tailstack.results.outline import Curves
from tailstack.sweeping import PointCheck, SweepError, count_points, read_axes, sweep, sweep_points

DEMO = load_design(Path(__file__).parents[2] / "examples" / "demo.yaml")
SEATED = load_design(Path(__file__).parents[1] / "data" / "designs" / "tibial_plate.yaml")
NOISE = "/views/0/fiducial_noise_px"
RZ = "/interfaces/structure_connector/tolerances/rz/half_width_deg"


def with_numbers(noise_px: float, rz_deg: float) -> dict[str, Any]:
    """The demo with two numbers replaced, independently of the code under test."""
    data = copy.deepcopy(DEMO.source.data)
    data["views"][0]["fiducial_noise_px"] = noise_px
    data["interfaces"]["structure_connector"]["tolerances"]["rz"]["half_width_deg"] = rz_deg
    return data


def test_points_are_the_scores_of_their_designs_in_row_major_order() -> None:
    axes = read_axes(
        DEMO, [{"pointer": NOISE, "values": [0.2, 0.8]}, {"pointer": RZ, "start": 0.1, "stop": 0.3, "count": 3}]
    )
    found = sweep(DEMO, axes)
    assert [point.values for point in found.points] == [
        (0.2, 0.1), (0.2, 0.2), (0.2, 0.3), (0.8, 0.1), (0.8, 0.2), (0.8, 0.3),
    ]  # fmt: skip
    for point in found.points:
        expected = score(load_design(with_numbers(*point.values)))
        target = expected.targets[0]
        assert point.status == "ok"
        assert point.verdict == expected.verdict.status
        assert point.targets[0].p95_mm == target.p95_mm
        assert point.targets[0].p95_interval_mm is None
        assert point.targets[0].mean_norm_mm == target.mean_norm_mm
        assert point.targets[0].localisation_p95_mm == target.localisation.p95_mm
        assert point.targets[0].bias_norm_mm == pytest.approx(np.linalg.norm(target.bias_mm), rel=1e-15)
    assert [(axis.unit, axis.base) for axis in found.axes] == [("px", 0.3), ("deg", 0.15)]
    assert (found.seed, found.trials) == (None, None)
    assert found.provenance.design_sha256 == DEMO.sha256


def test_points_of_a_verification_are_checks_with_one_seed() -> None:
    axes = read_axes(DEMO, [{"pointer": RZ, "values": [0.1, 0.4]}])
    found = sweep(DEMO, axes, check="verification", trials=20_000, seed=6, threads=1)
    for point in found.points:
        expected = verify(load_design(with_numbers(0.3, point.values[0])), trials=20_000, seed=6)
        assert point.targets[0].p95_interval_mm == expected.targets[0].p95_interval_mm
        assert point.verdict == expected.verdict.status
    assert (found.seed, found.trials) == (6, 20_000)


def test_a_refused_point_is_a_row_and_the_others_are_as_they_were() -> None:
    """Not valid (a negative half-width) and, seven fiducials on one plane and the eighth moved into it, ill-posed."""
    axes = read_axes(DEMO, [{"pointer": RZ, "values": [0.1, -0.1, 0.2]}])
    found = sweep(DEMO, axes).points
    assert [point.status for point in found] == ["ok", "refused", "ok"]
    assert found[1].targets == ()
    assert found[1].verdict is None
    assert "at least 0" in (found[1].reason or "")
    flat = copy.deepcopy(DEMO.source.data)
    corners = [(x, y, 0.0) for x in (-30.0, 0.0, 30.0) for y in (-30.0, 5.0, 30.0)]
    flat["fiducials"]["points"] = [{"label": f"F{k}", "position_mm": list(c)} for k, c in enumerate(corners)]
    flat["fiducials"]["points"][0]["position_mm"][2] = 40.0
    flat["fiducials"]["points"][1]["position_mm"][2] = -25.0
    design = load_design(flat)
    axes = read_axes(
        design, [{"pointer": f"/fiducials/points/{k}/position_mm/2", "values": [20.0, 0.0]} for k in (0, 1)]
    )
    statuses = [point.status for point in sweep(design, axes).points]
    assert statuses[0] == "ok"
    assert statuses[-1] == "refused"


def test_every_element_takes_the_value_of_a_star() -> None:
    axes = read_axes(DEMO, [{"pointer": "/views/*/fiducial_noise_px", "values": [0.9]}])
    data = copy.deepcopy(DEMO.source.data)
    for view in data["views"]:
        view["fiducial_noise_px"] = 0.9
    found = sweep(DEMO, axes)
    assert found.points[0].targets[0].p95_mm == score(load_design(data)).targets[0].p95_mm
    assert found.axes[0].base == 0.3
    assert DEMO.source.data["views"][0]["fiducial_noise_px"] == 0.3


def test_the_design_itself_is_left_as_it_was() -> None:
    before = copy.deepcopy(DEMO.source.data)
    sweep(DEMO, read_axes(DEMO, [{"pointer": NOISE, "values": [0.5]}, {"pointer": RZ, "values": [0.5]}]))
    assert DEMO.source.data == before


def test_ranges_are_even_and_end_where_they_say() -> None:
    def values(**given: Any) -> tuple[float, ...]:
        return read_axes(DEMO, [{"pointer": NOISE, **given}])[0].values

    assert values(start=0.1, stop=0.5, count=5) == (0.1, 0.2, 0.3, 0.4, 0.5)
    assert values(start=1, stop=-1, count=3) == (1.0, 0.0, -1.0)
    assert values(start=0.25, stop=9.0, count=1) == (0.25,)
    assert values(values=[3, 1, 2]) == (3.0, 1.0, 2.0)


def test_whole_numbers_stay_whole() -> None:
    """A field that counts takes no 4.0 and no 4.5."""
    data = copy.deepcopy(DEMO.source.data)
    data["optimise"]["starts"] = 8
    design = load_design(data)
    axes = read_axes(design, [{"pointer": "/optimise/starts", "values": [4.0, 4.5]}])
    assert [point.status for point in sweep(design, axes).points] == ["ok", "refused"]


def test_parts_of_the_grid_are_the_grid() -> None:
    axes = read_axes(DEMO, [{"pointer": NOISE, "values": [0.2, 0.4]}, {"pointer": RZ, "values": [0.1, 0.2, 0.3]}])
    assert count_points(axes) == 6
    whole = sweep(DEMO, axes).points
    parts = [sweep_points(DEMO, axes, numbers, PointCheck()) for numbers in (range(4), range(4, len(whole)))]
    assert (*parts[0], *parts[1]) == whole


@pytest.mark.parametrize(
    ("path", "pointer"),
    [
        ("interfaces.structure_connector.tolerances.rz.half_width_deg", RZ),
        ("views.AP.fiducial_noise_px", NOISE),
        ("views.0.fiducial_noise_px", NOISE),
        ("views.*.fiducial_noise_px", "/views/*/fiducial_noise_px"),
        ("fiducials.points.F3.position_mm.2", "/fiducials/points/2/position_mm/2"),
        (NOISE, NOISE),
        ("nothing.like/this", "/nothing/like~1this"),
    ],
)
def test_paths_as_people_write_them(path: str, pointer: str) -> None:
    assert pointer_of(DEMO.source.data, path) == pointer


@pytest.mark.parametrize(
    ("axes", "pointer", "code"),
    [
        ([], "/axes", "axes"),
        ([{"pointer": f"/views/0/{k}", "values": [1.0]} for k in range(7)], "/axes", "axes"),
        ([{"values": [1.0]}], "/axes/0/pointer", "missing-field"),
        ([{"pointer": "/views/0/noise", "values": [1.0]}], "/axes/0/pointer", "not-found"),
        ([{"pointer": "views/0/fiducial_noise_px", "values": [1.0]}], "/axes/0/pointer", "not-found"),
        ([{"pointer": "/views/7/fiducial_noise_px", "values": [1.0]}], "/axes/0/pointer", "not-found"),
        ([{"pointer": "/views/0/name", "values": [1.0]}], "/axes/0/pointer", "not-a-number"),
        ([{"pointer": "/views/0", "values": [1.0]}], "/axes/0/pointer", "not-a-number"),
        ([{"pointer": "", "values": [1.0]}], "/axes/0/pointer", "not-found"),
        ([{"pointer": NOISE}], "/axes/0", "one-of"),
        ([{"pointer": NOISE, "values": [1.0], "count": 2}], "/axes/0", "one-of"),
        ([{"pointer": NOISE, "start": 1.0, "stop": 2.0}], "/axes/0", "one-of"),
        ([{"pointer": NOISE, "values": []}], "/axes/0/values", "wrong-type"),
        ([{"pointer": NOISE, "values": [1.0, float("nan")]}], "/axes/0/values/1", "wrong-type"),
        ([{"pointer": NOISE, "values": [True]}], "/axes/0/values/0", "wrong-type"),
        ([{"pointer": NOISE, "start": 0.0, "stop": 1.0, "count": 0}], "/axes/0/count", "out-of-range"),
        ([{"pointer": NOISE, "start": 0.0, "stop": 1.0, "count": 2.0}], "/axes/0/count", "out-of-range"),
        ([{"pointer": NOISE, "start": -1.7e308, "stop": 1.7e308, "count": 3}], "/axes/0", "wrong-type"),
        ([{"pointer": NOISE, "values": [1.0], "step": 2}], "/axes/0/step", "unknown-field"),
        (
            [{"pointer": NOISE, "values": [1.0]}, {"pointer": "/views/*/fiducial_noise_px", "values": [1.0]}],
            "/axes/1/pointer",
            "given-twice",
        ),
        (
            [{"pointer": p, "start": 0.0, "stop": 1.0, "count": 2000} for p in (NOISE, RZ)],
            "/axes",
            "too-many",
        ),
    ],
)
def test_axes_that_are_refused(axes: list[dict[str, Any]], pointer: str, code: str) -> None:
    with pytest.raises(SweepError) as refused:
        read_axes(DEMO, axes)
    assert (refused.value.problems[0].pointer, refused.value.problems[0].code) == (pointer, code)


def test_a_refusal_says_what_may_have_been_meant() -> None:
    with pytest.raises(SweepError) as refused:
        read_axes(DEMO, [{"pointer": "/views/0/fiducial_noise", "values": [1.0]}])
    assert "did you mean views.AP.fiducial_noise_px?" in refused.value.problems[0].hint


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("interfaces.structure_connector.locators.A33.half_width_mm",
         "did you mean interfaces.structure_connector.locators.A3.half_width_mm?"),
        ("interfaces.structure_connector.locators.A3", "interfaces.structure_connector.locators.A3.half_width_mm"),
        ("interfaces.nope", "in interfaces there is structure_connector, connector_flange."),
        ("interfaces.structur_connector.pivot_mm.0", "did you mean interfaces.structure_connector.pivot_mm.0?"),
    ],
)  # fmt: skip
def test_what_was_perhaps_meant_is_said_by_names(path: str, hint: str) -> None:
    with pytest.raises(SweepError) as refused:
        sweep(SEATED, {path: [1.0]})
    assert hint in refused.value.problems[0].hint
    assert "locators/3" not in refused.value.problems[0].hint


def test_an_interface_goes_by_its_label_too() -> None:
    typed = "interfaces.kinematic connector (3-2-1).locators.A3.half_width_mm"
    assert pointer_of(SEATED.source.data, typed) == "/interfaces/structure_connector/locators/2/half_width_mm"


def test_a_record_names_its_axes_as_people_do_and_holds_the_limits() -> None:
    found = sweep(SEATED, {"/interfaces/structure_connector/locators/2/half_width_mm": [0.01, 0.05]})
    (axis,) = found.axes
    assert axis.name == "interfaces.structure_connector.locators.A3.half_width_mm"
    assert axis.short == "structure_connector.A3.half_width_mm"
    assert found.limits() == [(0.6, "limit of entry"), (0.8, "limit of exit")]  # of its file
    chart = found.outline().chart
    assert isinstance(chart, Curves)
    assert chart.across == f"{axis.name}, mm"
    assert chart.limits == tuple(found.limits())
