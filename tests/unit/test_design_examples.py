"""Every example loads, compiles and follows the schema; the hash is of all that a design says, and of no other; and the
schema alone is enough to write a design, and refuses what the reader refuses."""

from __future__ import annotations

import hashlib
import json
import shutil
from math import copysign

import jsonschema
import numpy as np
import pytest
import yaml
from test_design_refusals import CASES

from plain_data import DEMO, EXAMPLES, REMOVED, problems_of, replaced
from scenes import effect_named
from tailstack import score, verify
from tailstack.design import check_design, compile_design, design_json_schema, load_design
from tailstack.effects.robot import dh_joint, place_errors
from tailstack.errors import DesignError
from tailstack.system import Law

DESIGNS = sorted(EXAMPLES.glob("*.yaml"))


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_example_compiles_and_its_geometry_holds(path):
    system, findings, views = check_design(load_design(path))
    assert len(system.views) >= 2
    assert all(check.outside == () for check in views)
    assert {finding.severity for finding in findings} <= {"warning", "note"}
    expected = {"flat-structure"} if path.stem == "flat_plate" else set()
    assert {finding.rule for finding in findings} == expected
    for array in (system.fiducials_mm, system.views[0].projection, system.structure_connector.sources.direction):
        assert not array.flags.writeable


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_example_follows_the_published_schema(path):
    VALIDATOR.validate(yaml.safe_load(path.read_text()))


def test_demo_is_what_its_comments_say():
    system = compile_design(load_design(EXAMPLES / "demo.yaml"))
    assert len(system.fiducial_labels) == 12
    np.testing.assert_allclose(system.T_tcp_con @ [0, 0, 70, 1], [0, 0, 0, 1], atol=1e-12)
    assert system.connector_flange.sources.laws[:3] == (Law.NORMAL,) * 3
    np.testing.assert_allclose(system.connector_flange.sources.std[0], np.deg2rad(0.1), rtol=1e-14)
    np.testing.assert_allclose(system.structure_connector.known, [0, 0, np.deg2rad(0.05), 0, 0, 0.03], rtol=1e-14)
    np.testing.assert_allclose(system.execution.known, [0, 0.008, -0.008], rtol=1e-14)
    assert system.execution.sources.names == (*(f"repeatability.{a}" for a in "xyz"), *(f"load.{a}" for a in "xyz"))
    np.testing.assert_allclose(system.manufacturing_std_mm, 0.05 / np.sqrt(3), rtol=1e-14)


@pytest.mark.long
def test_a_compact_carrier_is_within_its_limit_by_what_is_known_of_the_c_arm_whatever_the_theatre_does():
    design = load_design(EXAMPLES / "gallery" / "operating_theatre.yaml")
    knowing, free = score(design), score(design.with_value("model.estimator", "dlt"))
    assert [knowing.verdict.status, free.verdict.status] == ["pass", "fail"]
    page = (EXAMPLES.parent / "docs" / "gallery.md").read_text(encoding="utf-8")
    stated = " ".join(page.split()).partition("by far (")[2]
    assert float(stated.split(" mm")[0]) == pytest.approx(free.targets[0].p95_mm, abs=5e-4)
    (losses,) = knowing.losses
    assert 1 / (1 - losses.mixture.probability_of_none) == pytest.approx(16, abs=0.5)
    known = {"temperature", "ball_images"}
    of_views = {f"{name}:{view}" for name in ("assumed_intrinsics", "image_field") for view in ("AP", "LAT")}
    assert known | of_views | {"motion:LAT"} <= {line.name for line in knowing.targets[0].contributors}
    simulated = verify(design, trials=2**14, seed=1).targets[0]
    assert simulated.p95_interval_mm[0] < knowing.targets[0].p95_mm < simulated.p95_interval_mm[1]  # 95 %, one seed


def test_the_arm_of_the_gallery_is_that_of_its_published_parameters():
    """published: Universal Robots, DH parameters of the UR5e; the same forward kinematics in each convention."""
    robot = getattr(load_design(EXAMPLES / "gallery" / "robot_arm.yaml").document.execution, "robot")  # noqa: B009
    table = [(0, 162.5, 90), (-425, 0, 0), (-392.2, 0, 0), (0, 133.3, 90), (0, 99.7, -90), (0, 99.6, 0)]
    arm = [dh_joint("", (a, d), (np.deg2rad(alpha), 0.0), True, False) for a, d, alpha in table]
    for values in (robot.joints_imaging_deg, robot.joints_executing_deg):
        (_, flange), (_, expected) = (place_errors(each, np.deg2rad(values)) for each in (robot.arm, arm))
        np.testing.assert_allclose(flange, expected, atol=1e-9)


def test_the_hand_eye_calibration_is_known_best_where_its_plate_lay():
    """closed form: t + w x r of a point at r, and what of it is left without the terms beside the diagonal."""
    sources = compile_design(load_design(EXAMPLES / "hand_eye_report.yaml")).hand_eye.sources
    spread = sources.direction * sources.std
    covariance, arm = spread @ spread.T, np.array([0, 0, 250.0])
    at_plate = np.hstack([np.cross(np.eye(3), arm).T, np.eye(3)])  # w x r, column by column
    np.testing.assert_allclose(np.sqrt(np.diag(at_plate @ covariance @ at_plate.T)), 0.105, rtol=2e-3)
    alone = np.sqrt(np.diag(at_plate @ np.diag(np.diag(covariance)) @ at_plate.T))
    assert alone[0] == pytest.approx(0.326, abs=5e-4)
    std = np.sqrt(np.diag(covariance))
    assert std[3] == pytest.approx(0.242, abs=5e-4)
    coefficients = covariance / np.outer(std, std)
    assert (coefficients[0, 4], coefficients[1, 3]) == pytest.approx((0.9, -0.9), abs=2e-3)


def test_a_clip_that_is_mounted_anew_is_in_the_tail_of_a_unit_and_not_in_that_of_a_mounting():
    """closed form: how often something is drawn changes no pooled number, and a mounting that is drawn with the unit is
    the unit; the comment's numbers."""
    design = load_design(EXAMPLES / "clip_on.yaml")
    found = score(design)
    plain = score(design.with_value("interfaces.structure_connector.drawn", "unit"))
    assert found.targets[0].p95_mm == pytest.approx(plain.targets[0].p95_mm, rel=1e-12)
    assert {each.status for each in found.verdict.checks} == {"pass"}
    values = [each.value for each in found.verdict.checks[1:]]
    assert values == pytest.approx([0.93, 0.90], abs=5e-3)
    assert [each.value for each in plain.verdict.checks[1:]] == pytest.approx([values[1]] * 2, rel=1e-9)


def test_a_shell_from_slicer_stands_in_con_with_what_its_printing_left():
    """independent: the positions that were drawn up for it, by noise of 0.12 mm along each axis."""
    design = load_design(EXAMPLES / "forearm_shell.yaml")
    drawn = np.array([each.position_mm for each in design.document.fiducials.registered_to])
    left = np.linalg.norm(np.array(design.fiducials.positions_mm) - drawn, axis=1)
    notes = " ".join(score(design).provenance.notes)
    assert f"{np.sqrt((left**2).mean()):.3g} mm are left" in notes
    assert 0.05 < np.sqrt((left**2).mean()) < 0.3
    ends = {each.name: each.position_mm for each in design.document.targets}
    np.testing.assert_allclose([ends["radius entry"], ends["radius"]], [[14, 18, 30], [3, 2, 62]], atol=0.3)


def test_beads_of_the_half_shell_are_in_its_wall_and_on_what_is_left_of_its_collar():
    """closed form: ten flat facets between 45 and 49 mm about z, each bead a millimetre or more from either face."""
    design = load_design(EXAMPLES / "half_shell.yaml")
    places = dict(zip(design.fiducials.labels, np.array(design.fiducials.positions_mm), strict=True))
    step = np.pi / 10
    for label, (x, y, z) in places.items():
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        if label.startswith("C"):
            assert 35 <= radius <= 39
            assert abs(np.rad2deg(angle) - 90) <= 60
            assert -95 <= z <= -83
        else:
            across = radius * np.cos(angle % step - step / 2) / np.cos(step / 2)
            assert 45 + 1 / np.cos(step / 2) <= across <= 49 - 1 / np.cos(step / 2)
            assert -79 <= z <= 9


def test_the_field_of_the_theatre_is_as_large_as_its_comment_says():
    """closed form: mean square of x**i y**j over a square image, whose sides are 1/sqrt(2) half diagonals away."""
    system = compile_design(load_design(EXAMPLES / "gallery" / "operating_theatre.yaml"))
    field = effect_named(system, "image_field:AP")
    half = np.sqrt(0.5)
    square = [half ** (2 * (i + j)) / ((2 * i + 1) * (2 * j + 1)) for i, j in field.powers]
    assert np.sqrt((field.sources.std**2 * square).sum()) == pytest.approx(0.20, abs=0.005)


def test_slicer_file_is_converted_once_and_said_so():
    system = compile_design(load_design(EXAMPLES / "slicer_markups.yaml"))
    np.testing.assert_array_equal(system.fiducials_mm[0], [-42.5, -40.2, -58.1])
    assert any("RAS" in note and "LPS" in note for note in system.notes)
    assert any("P10" in note for note in system.notes)
    assert len(system.targets) == 15
    assert {target.region for target in system.targets} == {"lesion"}


def test_hash_sees_the_fiducial_file(tmp_path):
    shutil.copytree(EXAMPLES, tmp_path / "copy")
    path = tmp_path / "copy" / "small_cluster_far_target.yaml"
    before = load_design(path).sha256
    assert before == load_design(EXAMPLES / path.name).sha256
    beads = tmp_path / "copy" / "fiducials" / "marker8.csv"
    beads.write_text(beads.read_text().replace("M8,5.4", "M8,5.5"))
    changed = load_design(path).sha256
    path.write_text(path.read_text() + "\n# a comment is not content\n")
    assert load_design(path).sha256 == changed != before


ALL_DESIGNS = sorted(path for path in EXAMPLES.rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text())


@pytest.mark.parametrize("written", [yaml.safe_dump, json.dumps, lambda data: data], ids=["yaml", "json", "mapping"])
@pytest.mark.parametrize("order", [(0.0, -0.0), (-0.0, 0.0)])
def test_a_zero_has_no_sign_in_whatever_form_it_arrives(order, written):
    """JavaScript writes -0.0 as 0: the same design from a page and from a file has one hash, and one system."""
    path = ("interfaces", "structure_connector", "pivot_mm")
    systems = [compile_design(load_design(written(replaced(DEMO, path, [zero, 1.0, -95.0])))) for zero in order]
    assert [copysign(1, system.structure_connector.pivot_mm[0]) for system in systems] == [1, 1]
    assert systems[0].design_sha256 == systems[1].design_sha256


def test_rounding_is_taken_out_and_noted_each_time():
    matrix = [[1, 1e-7, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    data = DEMO | {"transforms": {"T_flange_con": matrix, "T_tcp_flange": matrix}}
    for _ in range(2):
        system = compile_design(load_design(data))
        assert [note.split(":")[0] for note in system.notes] == ["/transforms/T_flange_con", "/transforms/T_tcp_flange"]
        assert "nearest rotation" in system.notes[0]
        rotation = system.T_flange_con[:3, :3]
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)


def hash_of_all(design):
    """independent: Python's json of the whole document, and of the points and files of surfaces."""
    elsewhere = {"fiducials": {"points", "file", "T_con_file", "registered_to"}, "target_origins": True}
    elsewhere["interfaces"] = {"structure_connector": {"origin"}, "connector_flange": {"origin"}}
    elsewhere["execution"] = {"hand_eye": {"origin"}}
    data = json.loads(design.document.model_dump_json(by_alias=True, exclude_none=True, exclude=elsewhere))
    points = [design.fiducials.labels, design.fiducials.positions_mm]
    for region in (data.get("optimise") or {}).get("regions", ()):
        if "surface" in region:
            region["surface"].pop("content")
            points.append(hashlib.sha256((EXAMPLES / region["surface"].pop("file")).read_bytes()).hexdigest())
    content = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    told = json.dumps(points, ensure_ascii=False)
    return hashlib.sha256(f"{content}\n{told}".encode()).hexdigest()


@pytest.mark.parametrize("path", ALL_DESIGNS, ids=lambda path: path.name)
def test_the_hash_is_of_the_whole_document(path):
    for _ in range(2):
        design = load_design(path)
        assert design.sha256 == hash_of_all(design)


@pytest.mark.parametrize("size", [1e-300, 1e-7, 1e-5, 9.9999999e-5, 1e-4, 1.00001e-4, 0.1, 30.00001, 99999.99999999999])
def test_the_hash_does_not_depend_on_who_writes_the_numbers(size):
    data = replaced(DEMO, ("fiducials", "points", 0, "position_mm"), [size, -size, -0.0])
    data["fiducials"]["points"][1]["label"] = 'a, "é" e'
    design = load_design(data)
    assert design.sha256 == hash_of_all(design)


def test_sections_that_are_left_out_are_those_that_hold_nothing():
    bare = {key: DEMO[key] for key in ("schema", "name", "views", "fiducials", "targets", "requirements")}
    written = load_design({**bare, "interfaces": {}, "transforms": {}, "execution": {}, "model": {}})
    left_out = load_design(bare)
    assert left_out.document == written.document
    assert left_out.sha256 == written.sha256 == hash_of_all(left_out)


SCHEMA = design_json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
RECORDS = [pair for pair in (("design", SCHEMA), *SCHEMA["$defs"].items()) if "properties" in pair[1]]


def test_schema_is_a_schema_without_null():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert "null" not in str(SCHEMA)


@pytest.mark.parametrize(("name", "record"), RECORDS)
def test_every_field_is_described_and_every_plain_one_has_an_example(name, record):
    assert record["additionalProperties"] is False
    assert record.get("description")
    for field, spec in record["properties"].items():
        assert spec.get("description"), f"{name}.{field} has no description"
        plain = spec.get("type") in ("number", "integer", "string") or "prefixItems" in spec
        assert not plain or spec.get("examples"), f"{name}.{field} has no example"


@pytest.mark.parametrize(("name", "record"), RECORDS)
def test_examples_in_the_schema_are_valid(name, record):
    for field, spec in record["properties"].items():
        for example in spec.get("examples", ()):
            validator = VALIDATOR.evolve(schema={**spec, "$defs": SCHEMA["$defs"]})
            assert validator.is_valid(example), f"{name}.{field}: {example!r}"


# A design written from the schema alone: each required field with its own first example.
def minimal(record):
    return {field: record["properties"][field].get("examples", [None])[0] for field in record.get("required", ())}


def test_a_design_made_from_the_schema_alone():
    definitions = SCHEMA["$defs"]
    preset = {**minimal(definitions["PresetView"]), "source_isocentre_mm": 700.0}
    points = [[x, y, z] for x in (-40, 40) for y in (-38, 42) for z in (-80, 0)]
    design = {
        **minimal(SCHEMA),
        "views": [{**preset, "orientation": "AP"}, {**preset, "name": "LAT", "orientation": "LAT"}],
        "fiducials": {"points": [{"position_mm": point} for point in points]},
        "targets": [{**minimal(definitions["TargetDocument"]), "position_mm": [0.0, 0.0, 70.0]}],
        "requirements": [{**minimal(definitions["RequirementDocument"]), "limit_mm": 2.0}],
    }
    VALIDATOR.validate(design)
    system, _, _ = check_design(load_design(design))
    assert system.requirements[0].limit == 2.0


# What the reader refuses by structure alone is refused by the schema; what it refuses by its meaning may be valid there
STRUCTURE = {
    "unknown-field", "wrong-type", "unknown-value", "one-of", "view-geometry", "too-short", "too-long",
    "unsupported-schema",
}  # fmt: skip
BOTH_REFUSE = [(path, value) for path, value, _, code, *_ in CASES if code in STRUCTURE] + [
    (("views", 0, "fiducial_noise_px"), -0.3),
    (("views", 0, "preset"), "none"),
    (("views", 0, "projection"), [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
    (("targets",), []),
    (("interfaces", "structure_connector", "tolerances", "rx", "distribution"), REMOVED),
]


@pytest.mark.parametrize(("path", "value"), BOTH_REFUSE)
def test_schema_and_reader_refuse_the_same(path, value):
    data = replaced(DEMO, path, value)
    assert VALIDATOR.is_valid(DEMO)
    assert not VALIDATOR.is_valid(data)
    problems_of(load_design, data, error=DesignError)
