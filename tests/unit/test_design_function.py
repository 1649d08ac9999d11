"""Other values of a design: one, checked anew and refused with a pointer; sweeps, each point against the design written
by hand; and a design as a function of its numbers.

The derivative is `independent` of what it is compared with: central differences of fourth order of ``score()``, which
knows no derivative.  The numerical error of P95 over the step bounds what they can see."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laws import linear_law
from plain_data import DEMO as DATA
from plain_data import EXAMPLES, problems_of, read_cases, replaced
from tailstack import DesignError, OutOfRangeError, load_design, score, verify
from tailstack.design.pointers import pointer_of
from tailstack.design_function import DesignFunction
from tailstack.results.outline import Curves
from tailstack.sweeping import PointCheck, SweepError, count_points, read_axes, sweep, sweep_points
from tailstack.tail.declared import column_gradient, law_gradient, law_quantile

DEMO = load_design(EXAMPLES / "demo.yaml")
SEATED = load_design(Path(__file__).parents[1] / "data" / "designs" / "tibial_plate.yaml")
NOISE = "/views/0/fiducial_noise_px"
RZ = "/interfaces/structure_connector/tolerances/rz/half_width_deg"


def with_numbers(noise_px: float, rz_deg: float) -> dict[str, Any]:
    """The demo with two numbers replaced, independently of the code under test."""
    data = replaced(DATA, ("views", 0, "fiducial_noise_px"), noise_px)
    return replaced(data, ("interfaces", "structure_connector", "tolerances", "rz", "half_width_deg"), rz_deg)


def test_points_are_the_scores_of_their_designs_in_row_major_order() -> None:
    axes = read_axes(
        DEMO, [{"pointer": NOISE, "values": [0.2, 0.8]}, {"pointer": RZ, "start": 0.1, "stop": 0.3, "count": 3}]
    )
    found = sweep(DEMO, axes)
    assert [point.values for point in found.points] == [
        (0.2, 0.1), (0.2, 0.2), (0.2, 0.3), (0.8, 0.1), (0.8, 0.2), (0.8, 0.3),
    ]  # fmt: skip
    for point in found.points:
        expected = score(load_design(with_numbers(*point.values)), losses=False)
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
    found = sweep(DEMO, {RZ: [0.1, 0.4]}, check="verification", trials=20_000, seed=6, threads=1)
    for point in found.points:
        expected = verify(load_design(with_numbers(0.3, point.values[0])), trials=20_000, seed=6)
        assert point.targets[0].p95_interval_mm == expected.targets[0].p95_interval_mm
        assert point.verdict == expected.verdict.status
    assert (found.seed, found.trials) == (6, 20_000)


def test_a_refused_point_is_a_row_and_the_others_are_as_they_were() -> None:
    """Not valid (a negative half-width) and, seven fiducials on one plane and the eighth moved into it, ill-posed."""
    found = sweep(DEMO, {RZ: [0.1, -0.1, 0.2]}).points
    assert [point.status for point in found] == ["ok", "refused", "ok"]
    assert found[1].targets == ()
    assert found[1].verdict is None
    assert "at least 0" in (found[1].reason or "")
    corners = product((-30.0, 0.0, 30.0), (-30.0, 5.0, 30.0))
    points = [{"label": f"F{k}", "position_mm": [x, y, 40.0 * (k < 2)]} for k, (x, y) in enumerate(corners)]
    axes = {f"/fiducials/points/{k}/position_mm/2": [20.0, 0.0] for k in (0, 1)}
    statuses = [
        point.status for point in sweep(load_design(replaced(DATA, ("fiducials", "points"), points)), axes).points
    ]
    assert statuses[0] == "ok"
    assert statuses[-1] == "refused"


def test_every_element_takes_the_value_of_a_star() -> None:
    """By a path of names, and the design itself is left as it was."""
    found = sweep(DEMO, {"views.*.fiducial_noise_px": np.array([0.9])})
    data = replaced(DATA, ("views",), [view | {"fiducial_noise_px": 0.9} for view in DATA["views"]])
    assert found.points[0].targets[0].p95_mm == score(load_design(data), losses=False).targets[0].p95_mm
    assert found.axes[0].base == 0.3
    assert DEMO.source.data == DATA


def test_ranges_are_even_and_end_where_they_say() -> None:
    def values(**given: Any) -> tuple[float, ...]:
        return read_axes(DEMO, [{"pointer": NOISE, **given}])[0].values

    assert values(start=0.1, stop=0.5, count=5) == (0.1, 0.2, 0.3, 0.4, 0.5)
    assert values(start=1, stop=-1, count=3) == (1.0, 0.0, -1.0)
    assert values(start=0.25, stop=9.0, count=1) == (0.25,)
    assert values(values=[3, 1, 2]) == (3.0, 1.0, 2.0)


def test_whole_numbers_stay_whole() -> None:
    """A field that counts takes no 4.0 and no 4.5."""
    design = load_design(replaced(DATA, ("optimise", "starts"), 8))
    assert [point.status for point in sweep(design, {"/optimise/starts": [4.0, 4.5]}).points] == ["ok", "refused"]


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


MANY = [{"pointer": f"/views/0/{k}", "values": [1.0]} for k in range(7)]


@pytest.mark.parametrize(("axes", "pointer", "code"), [*read_cases("values", "axes"), (MANY, "/axes", "axes")])
def test_axes_that_are_refused(axes: list[dict[str, Any]], pointer: str, code: str) -> None:
    problem = problems_of(read_axes, DEMO, axes, error=SweepError)[0]
    assert (problem.pointer, problem.code) == (pointer, code)


@pytest.mark.parametrize(("path", "hint"), read_cases("values", "meant"))
def test_what_was_perhaps_meant_is_said_by_names(path: str, hint: str) -> None:
    said = problems_of(sweep, SEATED, {path: [1.0]}, error=SweepError)[0].hint
    assert hint in said
    assert "locators/3" not in said


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


@pytest.mark.parametrize(
    "path", ["/views/0/fiducial_noise_px", "views.AP.fiducial_noise_px", "views.0.fiducial_noise_px"]
)
def test_a_pointer_and_a_path_of_names_change_the_same_number(path: str) -> None:
    changed = DEMO.with_value(path, 0.7)
    assert [view.fiducial_noise_px for view in changed.document.views] == [0.7, 0.3]
    assert [view.fiducial_noise_px for view in DEMO.document.views] == [0.3, 0.3]
    text = (EXAMPLES / "demo.yaml").read_text().replace("fiducial_noise_px: 0.3", "fiducial_noise_px: 0.7", 1)
    assert changed.sha256 == load_design(text).sha256 != DEMO.sha256


def test_what_is_a_list_a_default_or_a_label_can_be_set() -> None:
    moved = DEMO.with_value("fiducials.points.0.position_mm", (-41.0, 30, -60))
    assert moved.fiducials.positions_mm[0] == (-41.0, 30.0, -60.0)
    tighter = DEMO.with_value("requirements", [{"name": "tip-accuracy", "limit_mm": 0.5}])
    assert score(tighter, losses=False).verdict.checks[0].limit == 0.5
    assert "model" not in DATA
    assert DEMO.with_value("model.rotation", "small_angle").document.model.rotation == "small_angle"
    typed = "interfaces.kinematic connector (3-2-1).locators.A3.half_width_mm"
    assert pointer_of(SEATED.source.data, typed) == "/interfaces/structure_connector/locators/2/half_width_mm"


@pytest.mark.parametrize(("path", "value", "pointer", "code", "words"), read_cases("values", "values"))
def test_what_is_wrong_is_refused_with_its_pointer(
    path: str, value: object, pointer: str, code: str, words: str
) -> None:
    problem = problems_of(DEMO.with_value, path, value, error=DesignError)[0]
    assert (problem.pointer, problem.code) == (pointer, code)
    assert words in f"{problem.detail} {problem.hint}"


def test_fiducials_from_a_file_stay_and_say_where_they_are() -> None:
    design = load_design(EXAMPLES / "small_cluster_far_target.yaml")
    changed = design.with_value("views.AP.fiducial_noise_px", 0.4)
    assert changed.fiducials.positions_mm == design.fiducials.positions_mm
    with pytest.raises(DesignError, match="the points stand in a file"):
        design.with_value("fiducials.points.0.position_mm", [0, 0, 0])


# --- a design as a function of its numbers --------------------------------------------------------


P95_ERROR_MM = 2e-8  # numerical error of the score itself

INPUTS = {
    "demo.yaml": [
        "fiducials.points.F1.position_mm.0",
        "fiducials.points.F9.position_mm.2",
        "fiducials.manufacturing.half_width_mm",  # uniform: columns that turn as fiducials move
        "views.*.fiducial_noise_px",
        "views.LAT.target_noise_px",
        "interfaces.structure_connector.tolerances.rx.half_width_deg",  # uniform
        "interfaces.structure_connector.tolerances.tx.half_width_mm",  # triangular
        "interfaces.connector_flange.tolerances.ry.half_width_deg",  # normal
        "execution.repeatability.std_mm",
        "execution.compliance.load_half_width_n.1",
        "execution.hand_eye.tolerances.*.half_width_mm",
    ],
    "flat_plate.yaml": ["fiducials.points.0.position_mm.1", "fiducials.manufacturing.half_width_mm"],
    "gallery/angiography_room.yaml": ["fiducials.points.2.position_mm.2", "fiducials.manufacturing.half_width_mm"],
    "small_cluster_far_target.yaml": ["fiducials.manufacturing.half_width_mm"],  # its points stand in a file
    "paper/fitted_eq18.yaml": ["fiducials.points.1.position_mm.0", "views.*.fiducial_noise_px"],
}


def p95_mm(function: DesignFunction, values: Any, error: Any = "tcp") -> float:
    target = function.score(values, losses=False).targets[0]
    return target.p95_mm if error == "tcp" else target.localisation.p95_mm


def difference_by(function: DesignFunction, k: int, step: float, error: Any = "tcp") -> float:
    """Of fourth order, of the score, by number k."""
    values = []
    for times in (-2, -1, 1, 2):
        moved = function.present.copy()
        moved[k] += times * step
        values.append(p95_mm(function, moved, error))
    return (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)


@pytest.mark.long("tcp-demo.yaml", "localisation-demo.yaml")
@pytest.mark.parametrize("example", INPUTS)
@pytest.mark.parametrize("error", ["tcp", "localisation"])
def test_the_derivative_of_p95_is_that_of_differences(example: str, error: Any) -> None:
    design = load_design(EXAMPLES / example)
    function = DesignFunction(design, INPUTS[example])
    p95, gradient = function.p95_gradient(function.present, error=error)
    first = score(design, losses=False).targets[0]
    assert p95 == pytest.approx(first.p95_mm if error == "tcp" else first.localisation.p95_mm, abs=1e-12)
    assert np.abs(gradient).max() > 0
    for k in range(len(gradient)):
        step = 1e-2 * max(abs(function.present[k]), 0.1)
        difference = difference_by(function, k, step, error)
        assert gradient[k] == pytest.approx(difference, rel=1e-6, abs=P95_ERROR_MM / step), INPUTS[example][k]


MODELS = {
    "pose": ("pose", "normalised", {"focal": {"half_width_rel": 0.01, "distribution": "uniform", "bias_rel": 0.004}}),
    "weighted": ("pose", "weighted", {"principal_point": {"half_width_px": 8.0, "distribution": "normal"}}),
    "prior": ("pose_with_prior", "normalised", None),
    "reprojection": ("reprojection", "reprojection", None),
}


@pytest.mark.parametrize("model", MODELS)
def test_the_derivative_by_a_position_holds_for_every_estimator(model: str) -> None:
    """Through intrinsics that are believed and wrong the position of a fiducial moves the bias as well."""
    estimator, triangulation, wrong = MODELS[model]
    prior = {"focal_rel_sd": 0.02, "principal_point_px_sd": 15.0}
    design = DEMO.with_value("views.*.intrinsics_prior", prior)
    design = design if wrong is None else design.with_value("views.*.intrinsics_error", wrong)
    design = design.with_value("model", {"estimator": estimator, "triangulation": triangulation})
    function = DesignFunction(design, ["fiducials.points.F6.position_mm.2", "execution.repeatability.std_mm"])
    _, gradient = function.p95_gradient(function.present)
    for k, step in enumerate((0.2, 1e-3)):
        difference = difference_by(function, k, step)
        assert gradient[k] == pytest.approx(difference, rel=2e-6, abs=P95_ERROR_MM / step), k


def test_a_bounded_half_width_moves_p95_through_the_worst_vertex() -> None:
    pointer = "interfaces.connector_flange.tolerances.rx"
    design = DEMO.with_value(pointer, {"half_width_deg": 0.2, "distribution": "bounded"})
    function = DesignFunction(design, [f"{pointer}.half_width_deg"])
    _, (slope,) = function.p95_gradient([0.2])
    low, high = (function.score([0.2 + step]).targets[0].p95_mm for step in (-1e-4, 1e-4))
    assert slope == pytest.approx((high - low) / 2e-4, rel=1e-5)


@pytest.mark.parametrize(("path", "moves"), read_cases("values", "underived"))
def test_a_number_without_a_known_derivative_is_refused_by_name_and_can_be_evaluated(path: str, moves: str) -> None:
    function = DesignFunction(DEMO, [path])
    with pytest.raises(OutOfRangeError, match=moves) as refused:
        function.p95_gradient(function.present)
    assert refused.value.problems[0].pointer == function.pointers[0]
    assert function.score(function.present).targets[0].p95_mm == score(DEMO, losses=False).targets[0].p95_mm


def test_what_moves_unseen_or_is_sampled_has_no_derivative() -> None:
    targets = [{"name": "tip", "position_mm": [0, 0, 70]}, {"name": "far", "position_mm": [0, 5, 90]}]
    function = DesignFunction(DEMO.with_value("targets", targets), ["targets.far.position_mm.2"])
    with pytest.raises(OutOfRangeError, match="a target"):
        function.p95_gradient(function.present, target="far")
    flat = linear_law([0.1, 0, 0], np.zeros((3, 3)), np.eye(3)[:, :2] * 0.3, [0, 0])
    assert column_gradient(flat, law_quantile(flat, 0.95)) is None


def test_what_leads_to_no_number_is_refused_with_what_may_have_been_meant() -> None:
    with pytest.raises(DesignError, match="fiducial_noise_px"):
        DesignFunction(DEMO, ["/views/0/fiducial_noise"])
    with pytest.raises(DesignError, match="only numbers"):
        DesignFunction(DEMO, ["/views/0/name"])
    with pytest.raises(OutOfRangeError, match="1 numbers are varied"):
        DesignFunction(DEMO, ["/views/0/fiducial_noise_px"]).score([0.1, 0.2])


def test_the_derivative_by_a_column_is_that_of_differences_across_and_along_it() -> None:
    rng = np.random.default_rng(4)
    columns, kinds = rng.normal(size=(3, 4)) * 0.2, [0, 1, 0, 1]
    law = linear_law([0.1, -0.05, 0.2], np.diag([0.03, 0.05, 0.02]), columns, kinds)
    total = law_quantile(law, 0.95)
    slopes = column_gradient(law, total)
    np.testing.assert_allclose((slopes * columns).sum(axis=0), law_gradient(law, total).by_log_column, atol=1e-7)
    for axis in range(3):
        for j in range(4):
            step = np.zeros((3, 4))
            step[axis, j] = 1e-3
            high, low = (
                law_quantile(linear_law(law.mean, law.covariance, columns + s * step, kinds), 0.95) for s in (1, -1)
            )
            assert slopes[axis, j] == pytest.approx((high.quantile_mm - low.quantile_mm) / 2e-3, abs=3e-6)
