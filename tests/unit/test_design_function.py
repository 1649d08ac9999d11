"""A design as a function of its numbers: P95 as the score has it, and its derivative against differences of scores.

The derivative is `independent` of what it is compared with: central differences of fourth order of ``score()``, which
knows no derivative.  The numerical error of P95 over the step bounds what they can see.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from laws import linear_law
from plain_data import EXAMPLES
from tailstack import DesignError, OutOfRangeError, load_design, score
from tailstack.design_function import DesignFunction
from tailstack.tail.declared import column_gradient, law_gradient, law_quantile

DEMO = load_design(EXAMPLES / "demo.yaml")
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
    first = score(design).targets[0]
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


@pytest.mark.parametrize(
    ("path", "moves"),
    [
        ("views.AP.isocentre_mm.0", "the gains of"),
        ("interfaces.connector_flange.pivot_mm.2", "the gains of connector on flange"),
        ("execution.compliance.load_n.2", "the bias"),
        ("interfaces.connector_flange.tolerances.rx.coverage_factor", "otherwise than in proportion"),
        ("targets.tip.position_mm.2", "a target"),
    ],
)
def test_a_number_without_a_known_derivative_is_refused_by_name_and_can_be_evaluated(path: str, moves: str) -> None:
    function = DesignFunction(DEMO, [path])
    with pytest.raises(OutOfRangeError, match=moves) as refused:
        function.p95_gradient(function.present)
    assert refused.value.problems[0].pointer == function.pointers[0]
    assert function.score(function.present).targets[0].p95_mm == score(DEMO).targets[0].p95_mm


def test_a_target_that_is_not_the_first_may_not_move_unseen() -> None:
    targets = [{"name": "tip", "position_mm": [0, 0, 70]}, {"name": "far", "position_mm": [0, 5, 90]}]
    function = DesignFunction(DEMO.with_value("targets", targets), ["targets.far.position_mm.2"])
    with pytest.raises(OutOfRangeError, match="a target"):
        function.p95_gradient(function.present, target="far")


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
    assert slopes is not None
    np.testing.assert_allclose((slopes * columns).sum(axis=0), law_gradient(law, total).by_log_column, atol=1e-7)
    for axis in range(3):
        for j in range(4):
            step = np.zeros((3, 4))
            step[axis, j] = 1e-3
            high, low = (
                law_quantile(linear_law(law.mean, law.covariance, columns + s * step, kinds), 0.95) for s in (1, -1)
            )
            assert slopes[axis, j] == pytest.approx((high.quantile_mm - low.quantile_mm) / 2e-3, abs=3e-6)


def test_a_law_that_is_sampled_has_no_derivative_by_its_columns() -> None:
    flat = linear_law([0.1, 0, 0], np.zeros((3, 3)), np.eye(3)[:, :2] * 0.3, [0, 0])
    assert column_gradient(flat, law_quantile(flat, 0.95)) is None
