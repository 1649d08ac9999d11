"""Free fiducials and pivots with what moves the images of all fiducials together, and with known intrinsics errors."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.distance import pdist

from optimise_documents import document, moving, normal, optimised
from optimise_scenes import solve_placement
from plain_data import problems_of
from tailstack import load_design, score
from tailstack.contributors import error_law
from tailstack.design import compile_design
from tailstack.errors import DesignError, IllPosedError
from tailstack.geometry.arrays import Array
from tailstack.optimisation import PlacementProblem
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.problem import apply_choice, present_choice
from tailstack.optimisation.regions import BoxRegion
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import (
    estimator_affine,
    image_parts_at,
    lay,
    terms_of,
)
from tailstack.propagation.linear import linearise
from tailstack.system import System
from tailstack.tail.declared import law_quantile

MOTION = {"pivot_mm": [0, 0, -95], "tolerances": {"rx": normal("deg", 0.05), "ty": normal("mm", 0.05)}}
HEAT = {
    "difference_k": 15, "half_width_k": 10, "distribution": "triangular",
    "structure_expansion_um_per_m_k": 47, "connector_expansion_um_per_m_k": 23,
}  # fmt: skip


def field(law: str) -> dict[str, Any]:
    return {"half_widths_px": [0.1, 0.1, 0.3, 0.4], "distribution": law}


TILT = {
    "about_u": {"half_width_deg": 0.4, "distribution": "uniform"},
    "about_v": {"half_width_deg": 0.3, "distribution": "normal"},
    "bias_about_v_deg": 0.2,
}
CLAMPINGS = [
    {"fiducials": ["F1", "F2", "F3"], "tolerances": {"rx": normal("deg", 0.3), "tz": normal("mm", 0.1)}},
    {"pivot_mm": [0, 0, -80], "scale": {"half_width_rel": 0.002, "distribution": "uniform"}},
]
ROBOT = {
    "dh_convention": "standard", "dh": [{"d_mm": 300, "alpha_deg": 90}, {"a_mm": 400}, {"a_mm": 300, "alpha_deg": -90}],
    "joints_imaging_deg": [0, 40, -60], "joints_executing_deg": [30, 60, -50], "joint_sd_deg": 0.05,
    "repeatability_sd_deg": 0.01, "stiffness_nm_per_rad": [1e4, 1e4, 1e4], "payload_kg": 5,
}  # fmt: skip
EFFECTS: dict[str, Any] = {
    "motion": lambda data: data["views"][1].update(motion=MOTION),
    "image field": lambda data: data["views"][0].update(image_field=field("uniform")),
    "bounded image field": lambda data: data["views"][0].update(
        image_field={"half_widths_px": [0.0, 0.3], "distribution": "bounded"}
    ),
    "detector tilt": lambda data: data["views"][0].update(detector_tilt=TILT),
    "temperature": lambda data: data.update(temperature=HEAT),
    "balls": lambda data: data["fiducials"].update(diameter_mm=12),
    "clampings": lambda data: data["fiducials"].update(common=CLAMPINGS),
    "robot": lambda data: data.setdefault("execution", {}).update(robot=ROBOT),
    "noise that has a shape": lambda data: [
        view.update(fiducial_noise_shape=[[1.7, -0.4], [-0.4, 0.3]], target_noise_shape=[[0.6, 0.2], [0.2, 1.4]])
        for view in data["views"]
    ],
    "known intrinsics": lambda data: data["views"][0].update(
        intrinsics_error={"focal": {"bias_rel": 0.01}, "principal_point": {"bias_px": [8.0, -5.0]}}
    ),
}
ESTIMATORS = ("dlt", "pose", "pose_with_prior", "reprojection")
FREE_PIVOT = [{"interface": "structure_connector", "box": {"min_mm": [-9, -9, -99], "max_mm": [9, 9, -80]}}]


def with_effect(name: str, estimator: str = "dlt", form: str = "normalised", **section: Any) -> dict[str, Any]:
    data = document(8, **section)
    data["model"] = {"estimator": estimator, "triangulation": form}
    data["interfaces"]["structure_connector"]["bias"] = {"rz_deg": 0.5, "tx_mm": 0.3}
    for view in data["views"]:
        view["intrinsics_prior"] = {"focal_rel_sd": 0.01, "principal_point_px_sd": 5.0}
    EFFECTS[name](data)
    return data


# Each effect, each estimator and each form is met; all pairs are beside them
NEXT = {name: ESTIMATORS[k % len(ESTIMATORS)] for k, name in enumerate(EFFECTS)}


@pytest.mark.parametrize(
    ("name", "estimator", "form"),
    [
        pytest.param(name, estimator, "normalised", marks=[] if estimator == NEXT[name] else pytest.mark.long)
        for name in EFFECTS
        for estimator in ESTIMATORS
    ]
    + [("noise that has a shape", "pose", "weighted")]
    + [
        pytest.param("motion", estimator, form, marks=[] if (k, i) in ((1, 0), (2, 1)) else pytest.mark.long)
        for k, estimator in enumerate(ESTIMATORS)
        for i, form in enumerate(("weighted", "reprojection"))
    ],
)
def test_the_first_order_of_the_optimiser_is_that_of_the_score_at_any_layout(
    name: str, estimator: str, form: str
) -> None:
    """independent: the compiled linear model of the design with other positions; slopes by its differences."""
    problem = read_task(load_design(with_effect(name, estimator, form, **moving(pivots=FREE_PIVOT)))).problems[0]
    (demand,) = problem.demands
    term, imaging = terms_of(problem, demand), problem.estimation
    x = ca.SX.sym("x", 27)
    symbols = np.array([x[k] for k in range(27)], dtype=object)
    mechanics = symbols[24:] - plain(present_choice(problem).pivots_mm.ravel())
    projections, told = (part.at(mechanics) for part in estimator_affine(problem))
    laid, aim = lay(problem, symbols[:24].reshape(8, 3), mechanics), term.reconstructed.at(mechanics)
    numbers = ca.vertcat(*image_parts_at(imaging, term, laid, projections, told, aim).numbers)
    both = ca.Function("both", [x], [numbers, ca.jacobian(numbers, x)])

    def expected(at: Array) -> Array:
        choice = replace(present_choice(problem), fiducials_mm=at[:24].reshape(8, 3), pivots_mm=at[24:].reshape(1, 3))
        return image_parts(linearise(apply_choice(problem, choice), demand.targets[0]), "tcp").numbers

    rng = np.random.default_rng(5)
    for _ in range(2):
        at = np.concatenate([rng.uniform(-45, 45, 24), rng.uniform(-9, 9, 2), [-90.0]])
        found, slopes = (part.full() for part in both(at))
        numbers_there, along = expected(at), rng.normal(size=27)
        parts = np.split(numbers_there, [6, 12, 15])
        sizes = np.concatenate([np.full_like(part, np.abs(part).max(initial=0.0)) for part in parts])
        np.testing.assert_array_less(np.abs(found.ravel() - numbers_there), 1e-9 * sizes + 1e-15)
        step = 1e-4
        difference = (expected(at + step * along) - expected(at - step * along)) / (2 * step)
        np.testing.assert_allclose(slopes @ along, difference, rtol=1e-5, atol=1e-7 * sizes.max())
    through_single_images = name == "noise that has a shape"
    absorbed = name == "known intrinsics" and estimator in ("dlt", "reprojection")
    assert found[12:].any() != (absorbed or through_single_images)


def p95_mm(problem: PlacementProblem, layout: Array) -> float:
    """The score's P95 of a layout."""
    system = replace(problem.system, fiducials_mm=layout)
    return law_quantile(error_law(linearise(system, system.targets[0]), "tcp", 0.95).law, 0.95).quantile_mm


def gap_of_shadows_px(system: System, places: Array, diameter_mm: float) -> float:
    """closed form: the least distance between the shadows of balls in any view less the 3 px that are kept, a shadow's
    radius being that of the ball times the view's magnification, pixels per mm across the beam at its depth."""
    gaps = [np.inf]
    for view in system.views:
        rows = view.projection / np.linalg.norm(view.projection[2, :3])
        depth = places @ rows[2, :3] + rows[2, 3]
        images = (places @ rows[:2, :3].T + rows[:2, 3]) / depth[:, None]
        across = max(np.linalg.norm(row - (row @ rows[2, :3]) * rows[2, :3]) for row in rows[:2, :3])
        shadows = diameter_mm / 2 * across / depth
        for i, j in combinations(range(len(places)), 2):
            gaps.append(float(np.linalg.norm(images[i] - images[j]) - shadows[i] - shadows[j] - 3.0))
    return min(gaps)


def shadows_apart(problem: PlacementProblem, places: Array) -> bool:
    radius = problem.system.fiducial_radius_mm
    return radius is None or gap_of_shadows_px(problem.system, places, 2 * radius) >= 0


@pytest.mark.long
def test_shadows_of_beads_are_kept_apart() -> None:
    """The distance that is asked for between their middles is less; as points they come nearer than such beads may."""
    data = document(**moving(min_spacing_mm=15.0, min_projected_spacing_px=25.0))
    systems = []
    for beads in ({}, {"diameter_mm": 14.0}):
        data["fiducials"] |= beads
        systems.append(compile_design(load_design(optimised(data).design)))
    points, balls = (gap_of_shadows_px(system, system.fiducials_mm, 14.0) for system in systems)
    assert points < -5
    assert balls > -0.1


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "estimator"), [("motion", "dlt"), ("bounded image field", "dlt"), *((name, "pose") for name in EFFECTS)]
)
def test_no_layout_nearby_is_better_than_the_one_that_was_found(name: str, estimator: str) -> None:
    """brute force: the score of 30 layouts that keep all rules about the optimum, at distances of 0.05 to 5 mm; where
    many shadows touch, of the few among 100,000 that do."""
    section = moving(rotation_bounds=None, min_spacing_mm=10.0, min_projected_spacing_px=0.0)
    problem = read_task(load_design(with_effect(name, estimator, **section))).problems[0]
    found = solve_placement(problem, starts=2)
    layout, rng = found.choice.fiducials_mm, np.random.default_rng(1)
    here = p95_mm(problem, layout)
    assert found.worst_ratio == pytest.approx(here, rel=1e-9)  # of a limit of 1 mm
    assert here < p95_mm(problem, problem.system.fiducials_mm)
    box = problem.places[0].region
    assert isinstance(box, BoxRegion)
    kept = 0
    for _ in range(100_000):
        step = 10 ** rng.uniform(-1.3, 0.7) * rng.normal(size=layout.shape) * (rng.random((8, 1)) < rng.uniform())
        moved = np.clip(layout + step, box.low_mm, box.high_mm)
        if pdist(moved).min() > 10.0 and shadows_apart(problem, moved):
            assert p95_mm(problem, moved) > here * (1 - 1e-5), kept
            if (kept := kept + 1) == 30:
                break
    assert kept > 3


@pytest.mark.long
def test_an_optimum_with_all_effects_at_once_is_the_score_of_the_written_design_and_verified() -> None:
    """independent: the score of the document that comes back, seated where its free pivot went."""
    data = with_effect("motion", "pose", **moving(pivots=FREE_PIVOT))
    for name in ("temperature", "balls", "known intrinsics"):
        EFFECTS[name](data)
    data["views"][0]["image_field"] = field("normal")
    result = optimised(data)
    assert result.status == "verified"
    (after,) = score(load_design(result.design)).targets
    assert result.p95_after_mm == pytest.approx(after.p95_mm, rel=1e-9)
    assert 0.98 < after.p95_mm < 1.0
    fixed = {field: value for field, value in data["optimise"].items() if field not in ("box", "min_spacing_mm")}
    assert result.cost_after < 0.97 * optimised(data | {"optimise": fixed}).cost_after


def test_more_bounded_quantities_than_are_followed_are_refused_where_the_layout_is_free() -> None:
    data = with_effect("balls", **moving())
    data["views"][0]["image_field"] = field("bounded")
    (problem,) = problems_of(read_task, load_design(data), error=DesignError)
    assert (problem.pointer, problem.code) == ("/views/0/image_field", "not-optimised")
    assert "20 bounded quantities" in problem.detail
    read_task(load_design(data | {"optimise": {"rotation_bounds": data["optimise"]["rotation_bounds"]}}))


def in_a_plane(half_mm: float, limit_mm: float = 1.0, **section: Any) -> dict[str, Any]:
    """A region in a plane that AP sees head-on and LAT edge-on, the pose with known intrinsics."""
    box = {"min_mm": [-half_mm, -20, -35 - half_mm], "max_mm": [half_mm, -20, -35 + half_mm]}
    data = document(6, limit_mm, **moving(box=box, **section))
    data["model"] = {"estimator": "pose"}
    return data


@pytest.mark.long
def test_fiducials_may_be_placed_in_a_plane_where_intrinsics_are_believed() -> None:
    """Under dlt it is refused as ``flat-region`` (``test_optimise_refusals``)."""
    result = optimised(in_a_plane(45.0))
    assert result.status == "verified"
    assert {place.after_mm[1] for place in result.moved if place.after_mm is not None} == {-20.0}
    assert result.cost_after < result.cost_before


def test_a_plane_so_small_that_two_poses_explain_its_images_is_no_answer() -> None:
    data = in_a_plane(15.0, min_spacing_mm=5.0, min_projected_spacing_px=0.0, limit_mm=3.0)
    problem = problems_of(optimised, data, error=IllPosedError)[0]
    assert problem.code == "ambiguous-pose"
    assert "view AP" in problem.detail
