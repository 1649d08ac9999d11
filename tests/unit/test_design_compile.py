"""Compiling: every way to give a geometry leads to the same arrays; units; targets; presets; locators; compliances."""

from __future__ import annotations

import copy
import json
import re
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from plain_data import DEMO, EXAMPLES, problems_of, replaced
from tailstack.design import compile_design, list_presets, load_design
from tailstack.design.compile import torsor_from_locators
from tailstack.design.document import Compliance
from tailstack.errors import DesignError, IllPosedError
from tailstack.geometry.rotation import RotationForm, rotation_xyz
from tailstack.system import Estimator, Law, Reading, Triangulation

ORACLE = np.array(
    json.loads((EXAMPLES.parent / "tests" / "data" / "oracles" / "noise_covariance_cube8.json").read_text())["P"]
)
NOISE = {"fiducial_noise_px": 0.5, "target_noise_px": 0.25}


def system_with(**sections):
    return compile_design(load_design({**copy.deepcopy(DEMO), **sections}))


def views(*geometries):
    return [{"name": f"v{i}", **NOISE, **geometry} for i, geometry in enumerate(geometries)]


PRESET = {"preset": "siemens-cios-fusion", "source_isocentre_mm": 700}
DISTANCES = {"source_detector_mm": 1020, "source_isocentre_mm": 700, "pixel_mm": 0.194, "image_size_px": [1536, 1536]}
K = {"focal_px": [1020 / 0.194, 1020 / 0.194], "principal_point_px": [767.5, 767.5]}
AP_ROWS = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
LAT_ROWS = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]


def quaternion(rows):
    return Rotation.from_matrix(rows).as_quat(scalar_first=True).tolist()


def angles_deg(rows):
    return Rotation.from_matrix(rows).as_euler("XYZ", degrees=True).tolist()


def four_by_four(rows):
    return [[*row, t] for row, t in zip(rows, (0, 0, 700), strict=True)] + [[0, 0, 0, 1]]


AT = {"translation_mm": [0, 0, 700]}
GEOMETRIES = {
    "preset": [{**PRESET, "orientation": "AP"}, {**PRESET, "orientation": "LAT"}],
    "preset, directions": [{**PRESET, "beam_direction": [0, 3, 0]}, {**PRESET, "beam_direction": [-2, 0, 0]}],
    "distances": [{**DISTANCES, "orientation": "AP"}, {**DISTANCES, "orientation": "LAT", "up_direction": [9, 0, 2]}],
    "matrix pose": [{"intrinsics": K, "pose": four_by_four(rows)} for rows in (AP_ROWS, LAT_ROWS)],
    "rotation pose": [{"intrinsics": K, "pose": {"rotation": rows, **AT}} for rows in (AP_ROWS, LAT_ROWS)],
    "quaternion": [
        {"intrinsics": K, "pose": {"quaternion_wxyz": quaternion(rows), **AT}} for rows in (AP_ROWS, LAT_ROWS)
    ],
    "angles": [{"intrinsics": K, "pose": {"rotation_deg": angles_deg(rows), **AT}} for rows in (AP_ROWS, LAT_ROWS)],
    "projection": [
        {"projection": (scale * matrix).tolist()} for scale, matrix in zip((-2.0, 0.01), ORACLE, strict=True)
    ],
}


@pytest.mark.parametrize("way", GEOMETRIES)
def test_every_way_to_give_a_view_is_the_matrix_of_the_oracle(way):
    system = system_with(views=views(*GEOMETRIES[way]))
    for view, expected in zip(system.views, ORACLE, strict=True):
        np.testing.assert_allclose(view.projection, expected, rtol=1e-9, atol=2e-6)
        assert (view.fiducial_noise_px, view.target_noise_px) == (0.5, 0.25)
        assert view.image_size_px == (
            None if "intrinsics" in GEOMETRIES[way][0] or way == "projection" else (1536, 1536)
        )


def test_a_view_can_override_its_preset_and_move_its_centre():
    own = {**PRESET, "orientation": "AP", "pixel_mm": 0.388, "image_size_px": [768, 700], "isocentre_mm": [5, 6, 7],
           "principal_point_px": [380, 340]}  # fmt: skip
    view = system_with(views=views(own, {**PRESET, "orientation": "LAT"})).views[0]
    image = view.projection @ [5, 6, 7, 1]
    np.testing.assert_allclose(image / image[2], [380, 340, 1])
    assert image[2] == pytest.approx(700)
    assert view.image_size_px == (768, 700)


def test_transforms_and_defaults():
    turned = {"T_flange_con": {"rotation_deg": [10, 20, 30], "translation_mm": [1, 2, 3]}}
    system = system_with(transforms=turned)
    expected = Rotation.from_euler("XYZ", [10, 20, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(system.T_flange_con[:3, :3], expected, atol=1e-15)
    np.testing.assert_array_equal(system.T_tcp_flange, np.eye(4))
    bare = {key: DEMO[key] for key in ("schema", "name", "views", "targets")}
    bare["fiducials"] = {"points": DEMO["fiducials"]["points"]}
    system = compile_design(load_design(bare))
    assert all(link.sources.count == 0 for link in system.links)
    assert system.requirements == ()
    assert not system.manufacturing_std_mm.any()
    assert (system.reading, system.rotation_form) == (Reading.PHYSICAL, RotationForm.FULL)
    assert system.triangulation is Triangulation.NORMALISED
    assert any("no transforms" in note for note in system.notes)


def test_what_is_known_of_intrinsics_and_how_wrong_it_is():
    """Without an error of their own the assumed intrinsics are as wrong as the prior says; DLT reads neither."""
    views = copy.deepcopy(DEMO["views"])
    views[0]["intrinsics_prior"] = {"focal_rel_sd": 0.01, "principal_point_px_sd": 10}
    views[1]["intrinsics_error"] = {
        "focal": {"bias_rel": 0.02, "half_width_rel": 0.03, "distribution": "uniform"},
        "principal_point": {"bias_px": [4, 5]},
    }
    system = system_with(views=views, model={"estimator": "pose"})
    assert system.estimator is Estimator.POSE
    prior, stated = system.effects
    assert system.views[0].intrinsics_prior == (0.01, 10)
    np.testing.assert_array_equal(prior.sources.std, [0.01, 10, 10])
    np.testing.assert_array_equal(prior.sources.direction, np.eye(3))
    np.testing.assert_array_equal(stated.known, [0.02, 4, 5])
    assert stated.sources.names == ("focal",)
    assert (stated.sources.laws, stated.sources.half_width.tolist()) == ((Law.UNIFORM,), [0.03])
    assert not any("has no effect" in note for note in system.notes)
    assert any("AP, LAT has no effect" in note for note in system_with(views=views).notes)


def test_laws_and_coverage_factors():
    tolerances = {
        "rx": {"half_width_deg": 0.3, "distribution": "normal", "coverage_factor": 3},
        "rz": {"half_width_deg": 0.2, "distribution": "normal"},
        "ty": {"half_width_mm": 0.6, "distribution": "triangular"},
        "tz": {"half_width_mm": 0.6, "distribution": "bounded"},
    }
    seat = DEMO["interfaces"]["structure_connector"] | {"tolerances": tolerances}
    sources = system_with(interfaces={"structure_connector": seat}, optimise=None).structure_connector.sources
    assert sources.names == ("rx", "rz", "ty", "tz")
    assert sources.laws == (Law.NORMAL, Law.NORMAL, Law.TRIANGULAR, Law.BOUNDED)
    closed_form = [np.deg2rad(0.1), np.deg2rad(0.1), 0.6 / np.sqrt(6), 0.0]
    np.testing.assert_allclose(sources.std, closed_form, rtol=1e-14)
    np.testing.assert_array_equal(sources.direction, np.eye(6)[:, [0, 2, 4, 5]])


def test_load_and_scatter_become_execution_sources():
    execution = {
        "repeatability": {"half_width_mm": [0.1, 0.2, 0.3], "distribution": "uniform"},
        "compliance": {"matrix_mm_per_n": [[0.01, 0, 0.002], [0, 0, 0], [0.002, 0, 0.005]], "load_n": [10, 5, -4],
                       "load_half_width_n": 2, "distribution": "bounded"},
    }  # fmt: skip
    system = system_with(execution=execution)
    assert system.execution.sources.names == (*(f"repeatability.{axis}" for axis in "xyz"), "load.x", "load.z")
    assert system.execution.sources.units == ("mm", "mm", "mm", "N", "N")
    np.testing.assert_allclose(system.execution.known, [0.092, 0, 0.0], atol=1e-16)
    np.testing.assert_array_equal(system.execution.sources.direction[:, 3:], [[0.01, 0.002], [0, 0], [0.002, 0.005]])
    np.testing.assert_allclose(system.execution.sources.std[:3], np.array([0.1, 0.2, 0.3]) / np.sqrt(3))


def test_regions_are_expanded_and_named():
    targets = [
        {"name": "a", "position_mm": [0, 0, 60]},
        {"name": "box",
         "region": {"box": {"centre_mm": [1, 2, 60], "size_mm": [4, 6, 8], "points_per_axis": [2, 1, 3]}}},
        {"name": "ball", "region": {"sphere": {"centre_mm": [0, 0, 60], "radius_mm": 5}}},
    ]  # fmt: skip
    requirements = [{"name": "r", "limit_mm": 1, "targets": ["box", "a"]}]
    system = system_with(targets=targets, requirements=requirements, optimise={**DEMO["optimise"], "requirement": "r"})
    box = [target for target in system.targets if target.region == "box"]
    assert [target.name for target in box] == [f"box[{i}]" for i in range(6)]
    corners = {tuple(target.position_mm) for target in box}
    assert corners == {(x, 2.0, z) for x in (-1.0, 3.0) for z in (56.0, 60.0, 64.0)}
    assert system.requirements[0].targets == ("a", *(f"box[{i}]" for i in range(6)))
    ball = np.array([target.position_mm for target in system.targets if target.region == "ball"]) - [0, 0, 60]
    np.testing.assert_allclose(np.linalg.norm(ball, axis=1), [0] + [5] * 14, atol=1e-14)


PAGE = (EXAMPLES.parent / "docs" / "design.md").read_text()
STATED: dict[str, Any] = {"source_isocentre_mm": 700, "pixel_mm": 0.3, "image_size_px": [1024, 1024]}
PRESETS = list_presets()


def design_with(preset, **changes):
    noise = {"fiducial_noise_px": 0.3, "target_noise_px": 0.3}
    views = [{"name": side, "preset": preset, "orientation": side, **noise, **changes} for side in ("AP", "LAT")]
    return DEMO | {"views": views}


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset["name"])
def test_numbers_source_and_use(preset):
    detector, isocentre, pixel = (preset[f"{name}_mm"] for name in ("source_detector", "source_isocentre", "pixel"))
    assert preset["source"]
    needed = {name: STATED[name] for name in preset["view_must_state"]}
    view = compile_design(load_design(design_with(preset["name"], **needed))).views[0]
    assert view.projection[0, 0] == pytest.approx(detector / (pixel or STATED["pixel_mm"]))
    assert (view.projection @ [0, 0, 0, 1])[2] == pytest.approx(isocentre or STATED["source_isocentre_mm"])
    for name in needed:
        with pytest.raises(DesignError, match=name):
            load_design(design_with(preset["name"], **{key: value for key, value in needed.items() if key != name}))


def test_the_design_on_the_page_loads():
    text = PAGE.split("```yaml\n")[1].split("```")[0]
    assert compile_design(load_design(text)).name == "smallest useful design"


POSITIONS = np.array([[-40.0, -30, -80], [40, -30, -80], [0, 35, -80], [-35, -40, -70], [35, -40, -70], [-50, 0, -70]])
NORMALS = np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0]])
PIVOT = np.array([3.0, -7.0, -95.0])


def test_agrees_with_the_finite_rigid_motion_for_small_deviations():
    """independent: solve n . (R (p - c) + c + t - p) = delta for a full rotation, by a root finder."""
    delta = 1e-3 * np.array([1.0, -2.0, 0.5, 1.5, -1.0, 2.0])

    def residual(torsor):
        moved = (POSITIONS - PIVOT) @ rotation_xyz(torsor[:3]).T + PIVOT + torsor[3:] - POSITIONS
        return (NORMALS * moved).sum(axis=1) - delta

    finite = root(residual, np.zeros(6), tol=1e-14).x
    np.testing.assert_allclose(torsor_from_locators(POSITIONS, NORMALS, PIVOT) @ delta, finite, atol=1e-7)


@given(st.lists(st.floats(-60, 60), min_size=18, max_size=18), st.lists(st.floats(-1, 1), min_size=18, max_size=18))
def test_random_seats_either_hold_or_are_refused(places, directions):
    positions, normals = np.reshape(places, (6, 3)), np.reshape(directions, (6, 3))
    assume(np.linalg.norm(normals, axis=1).min() > 0.1)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.hstack([np.cross(positions - PIVOT, unit), unit])
    if np.linalg.matrix_rank(rows, tol=1e-12) < 6:
        with pytest.raises(IllPosedError, match="free"):
            torsor_from_locators(positions, normals, PIVOT)
        return
    assume(np.linalg.cond(rows) < 1e8)
    torsors = torsor_from_locators(positions, normals, PIVOT)
    np.testing.assert_allclose(rows @ torsors, np.eye(6), atol=1e-5)


# closed_form: what is left free by contacts in place of those of the seat; the normals of two pins in one line meet at
# (-35, 20)
FREE = {
    "a missing end stop": ({5: ([5, 40, -60], [0, 1, 0])}, ("1 motion of", "translation along x")),
    "pins in one line": (dict.fromkeys((4, 5), ([-50, 20, -70], [1, 0, 0])), ("rotation about z through (-35, 20, ",)),
    "three normals through a point": (
        {3: ([-35, 0, -70], [1, 0, 0]), 4: ([35, 0, -70], [-1, 0, 0]), 5: ([0, -50, -70], [0, 1, 0])},
        ("rotation about z through (0, 0, ",),
    ),
    "three contacts given twice": (
        {k + 3: (POSITIONS[k], NORMALS[k]) for k in range(3)},
        ("3 motions of", "translation along x", "translation along y", "rotation about z"),
    ),
}


@pytest.mark.parametrize("case", FREE)
def test_motions_that_are_left_free_are_named(case):
    contacts, words = FREE[case]
    positions, normals = POSITIONS.copy(), NORMALS.copy()
    for k, (position, normal) in contacts.items():
        positions[k], normals[k] = position, normal
    (problem,) = problems_of(torsor_from_locators, positions, normals, PIVOT, "/here", error=IllPosedError)
    assert (problem.pointer, problem.code) == ("/here", "free-motion")
    assert all(each in problem.detail for each in words), problem.detail


COMPLIANCE = np.array([[0.004, 0.0005, 0.0], [0.0005, 0.004, -0.0003], [0.0, -0.0003, 0.001]])


def with_compliance(matrix):
    return replaced(DEMO, ("execution", "compliance", "matrix_mm_per_n"), np.asarray(matrix).tolist())


def refused_compliance(matrix):
    (problem,) = problems_of(load_design, with_compliance(matrix), error=DesignError)
    assert problem.pointer == "/execution/compliance/matrix_mm_per_n"
    return problem


def obeyed(problem):
    """The matrix of a hint, which is accepted."""
    written = yaml.safe_load(re.search(r"matrix_mm_per_n: (\[\[.*\]\])", problem.hint)[1])
    load_design(with_compliance(written))
    return np.array(written)


def test_a_sign_that_is_wrong_is_refused_with_the_eigenvalue_and_the_matrix_to_write():
    problem = refused_compliance(-COMPLIANCE)
    assert problem.code == "not-passive"
    assert f"{np.linalg.eigvalsh(-COMPLIANCE)[0]:.4g} mm/N" in problem.detail
    np.testing.assert_allclose(obeyed(problem), COMPLIANCE)
    # closed_form: [[a, c], [c, b]] is positive semidefinite up to c^2 = a b, here 0.002.
    problem = refused_compliance([[0.004, 0, 0.003], [0, 0.004, 0], [0.003, 0, 0.001]])
    assert problem.code == "not-passive"
    assert "between x and z it is at most 0.002" in problem.hint
    for axis in range(3):
        bent = np.diag([0.004, 0.004, 0.001])
        bent[axis, axis] *= -1e-6
        assert refused_compliance(bent).code == "not-passive"


def test_an_asymmetric_one_is_refused_with_both_entries_and_their_mean():
    skew = COMPLIANCE + np.outer([0.0002, 0, 0], [0, 1, 0])
    problem = refused_compliance(skew)
    assert problem.code == "not-symmetric"
    assert "row 1, column 2 is 0.0007, row 2, column 1 0.0005" in problem.detail
    np.testing.assert_allclose(obeyed(problem), (skew + skew.T) / 2)


@pytest.mark.parametrize("half", [np.triu, np.tril])
def test_one_half_of_a_symmetric_matrix_is_completed(half):
    np.testing.assert_allclose(obeyed(refused_compliance(half(COMPLIANCE))), COMPLIANCE)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9), st.floats(-6, 1), st.integers(1, 3))
def test_every_passive_matrix_of_three_digits_is_accepted_whatever_its_rank(entries, size, rank):
    factor = np.array(entries).reshape(3, 3)[:, :rank]
    written = [[float(f"{x:.4g}") for x in row] for row in 10**size * factor @ factor.T]
    assert Compliance.model_validate({"matrix_mm_per_n": written})


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_what_is_accepted_gives_no_energy_to_any_push(entries):
    """independent of eigenvalues: f . C f of 200 pushes; a matrix that is accepted has none below rounding."""
    matrix = np.array(entries).reshape(3, 3)
    matrix = matrix + matrix.T + 1.5 * np.eye(3)  # about half of them are accepted
    try:
        Compliance.model_validate({"matrix_mm_per_n": matrix.tolist()})
    except ValueError:
        return
    pushes = np.random.default_rng(7).standard_normal((200, 3))
    energy = np.einsum("ki,ij,kj->k", pushes, matrix, pushes) / (pushes**2).sum(axis=1)
    assert energy.min() >= -3e-3 * np.abs(matrix).max()
