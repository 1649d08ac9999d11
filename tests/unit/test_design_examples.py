"""Every example loads, compiles, passes its own geometry checks, validates against the schema, round-trips."""

from __future__ import annotations

import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

from scenes import effect_named
from tailstack import score, verify
from tailstack.design import (
    Revision,
    check_design,
    compile_design,
    design_json_schema,
    design_to_json,
    design_to_yaml,
    load_design,
    revise_design,
)
from tailstack.system import Law

EXAMPLES = Path(__file__).parents[2] / "examples"
DESIGNS = sorted(EXAMPLES.glob("*.yaml"))


def test_there_are_at_least_four_designs():
    assert len(DESIGNS) >= 4


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
    jsonschema.Draft202012Validator(design_json_schema()).validate(yaml.safe_load(path.read_text()))


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_writing_and_reading_back_keeps_the_content(path):
    design = load_design(path)
    for text in (design_to_yaml(design), design_to_json(design)):
        again = load_design(text, allow_files=False)
        assert again.sha256 == design.sha256
        assert np.array_equal(compile_design(again).fiducials_mm, compile_design(design).fiducials_mm)


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


def test_the_field_of_the_theatre_is_as_large_as_its_comment_says():
    """closed form: mean square of x**i y**j over a square image, whose sides are 1/sqrt(2) half diagonals away."""
    system = compile_design(load_design(EXAMPLES / "gallery" / "operating_theatre.yaml"))
    field = effect_named(system, "image_field:AP")
    half = np.sqrt(0.5)
    square = [half ** (2 * (i + j)) / ((2 * i + 1) * (2 * j + 1)) for i, j in field.powers]
    assert np.sqrt((field.sources.std**2 * square).sum()) == pytest.approx(0.20, abs=0.005)


def test_a_design_can_be_revised():
    design = load_design(EXAMPLES / "demo.yaml")
    moved = compile_design(design).fiducials_mm + 1.5
    new = revise_design(design, Revision(fiducials_mm=moved, half_width={("connector_flange", "rz"): np.deg2rad(0.4)}))
    system = compile_design(new)
    np.testing.assert_array_equal(system.fiducials_mm, moved)
    np.testing.assert_allclose(system.connector_flange.sources.half_width[2], np.deg2rad(0.4), rtol=1e-14)
    assert new.sha256 != design.sha256


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
    assert load_design(path).sha256 != before
    path.write_text(path.read_text() + "\n# a comment is not content\n")
    assert load_design(path).sha256 == load_design(path).sha256 != before
