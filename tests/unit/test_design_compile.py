"""Compiling: every way to give a geometry leads to the same arrays; units; targets; refusals."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from tailstack.design import compile_design, load_design
from tailstack.errors import IllPosedError
from tailstack.geometry.rotation import RotationForm
from tailstack.system import Estimator, Law, Reading, Triangulation

ROOT = Path(__file__).parents[2]
DEMO = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text())
ORACLE = np.array(json.loads((ROOT / "tests" / "data" / "oracles" / "noise_covariance_cube8.json").read_text())["P"])
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
    x, y, z, w = Rotation.from_matrix(rows).as_quat()
    return [w, x, y, z]


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


def test_rounding_of_a_rotation_is_taken_out_and_noted():
    rows = np.round(Rotation.from_euler("XYZ", [10, 20, 30], degrees=True).as_matrix(), 5)
    matrix = [[*row, 0.0] for row in rows.tolist()] + [[0, 0, 0, 1]]
    system = system_with(transforms={"T_flange_con": matrix})
    rotation = system.T_flange_con[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    assert any("nearest rotation" in note for note in system.notes)


def test_laws_and_coverage_factors():
    seat = copy.deepcopy(DEMO["interfaces"]["structure_connector"])
    seat["tolerances"] = {
        "rx": {"half_width_deg": 0.3, "distribution": "normal", "coverage_factor": 3},
        "rz": {"half_width_deg": 0.2, "distribution": "normal"},
        "ty": {"half_width_mm": 0.6, "distribution": "triangular"},
        "tz": {"half_width_mm": 0.6, "distribution": "bounded"},
    }
    data = {key: value for key, value in DEMO.items() if key != "optimise"}
    sources = compile_design(
        load_design({**data, "interfaces": {"structure_connector": seat}})
    ).structure_connector.sources
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
    assert system.execution.sources.names == (
        "repeatability.x",
        "repeatability.y",
        "repeatability.z",
        "load.x",
        "load.z",
    )
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


def test_a_projection_without_a_source_is_refused():
    flat = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    with pytest.raises(IllPosedError) as caught:
        system_with(views=views({"projection": flat}, {**PRESET, "orientation": "LAT"}))
    assert caught.value.problems[0].pointer == "/views/0/projection"


def test_behind_the_detector_is_refused():
    far = {**PRESET, "orientation": "AP", "isocentre_mm": [0, -400, 0]}
    with pytest.raises(IllPosedError) as caught:
        system_with(views=views(far, {**PRESET, "orientation": "LAT"}))
    assert caught.value.problems[0].code == "behind-detector"
