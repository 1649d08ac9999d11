"""Fiducial files: units, coordinate systems, what is left out, what is refused, and what a design says of its file."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from plain_data import DEMO, EXAMPLES, REMOVED, problems_of, read_cases, replaced
from tailstack.design import compile_design, design_json_schema, design_to_json, design_to_yaml, load_design
from tailstack.design.fiducial_files import FORMATS, FiducialList, read_fiducials, write_fiducials
from tailstack.design.reading import DEFAULT_LIMITS, Limits
from tailstack.design.write import Revision, revise_design
from tailstack.errors import DesignError, LimitError
from tailstack.integrations.conversion import ConvertedFile, convert, read_source_file


def read(text, name):
    return read_fiducials(text.encode(), name, DEFAULT_LIMITS)


def refused(text, name):
    problem = problems_of(read, text, name, error=DesignError)[0]
    assert problem.file == name or problem.code == "unknown-format"
    return problem


coordinate = st.floats(-1e4, 1e4, allow_nan=False).map(lambda x: x + 0.0)
label = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), min_size=1, max_size=20)


@pytest.mark.parametrize("ending", FORMATS)
@example([("a;1;2", 0.5, 1.0, 2.0), ("b;3;4", -0.5, 1.0, 2.0)])  # where a half of the cells could be a semicolon's
@given(st.lists(st.tuples(label, coordinate, coordinate, coordinate), min_size=1, max_size=9))
def test_write_and_read_keep_every_digit(ending, rows):
    labels = tuple(text.strip().lstrip("#") or f"F{i + 1}" for i, (text, *_) in enumerate(rows))
    fiducials = FiducialList(labels, tuple((x, y, z) for _, x, y, z in rows))
    again = read(write_fiducials(fiducials, "beads" + ending), "beads" + ending)
    assert (again.labels, again.positions_mm, again.notes) == (fiducials.labels, fiducials.positions_mm, ())


@pytest.mark.parametrize(("name", "text", "label", "first_mm"), read_cases("tables", "variants"))
def test_variants_are_read_and_what_labels_hold_separates_no_cells(name, text, label, first_mm):
    found = read(text, name)
    assert (found.labels[0], found.positions_mm[0]) == (label, tuple(first_mm))


@pytest.mark.parametrize(("text", "code", "line"), read_cases("tables", "csv"))
def test_csv_refusals(text, code, line):
    problem = refused(text, "b.csv")
    assert (problem.code, problem.line) == (code, line)


ROWS = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\nn1,1,2,3,0,0,0,1,1,1,0,A,,\n"


@pytest.mark.parametrize(("header", "expected"), read_cases("tables", "fcsv_systems"))
def test_fcsv_coordinate_systems(header, expected):
    found = read("# Markups fiducial file version = 4.11\n" + header + ROWS, "b.fcsv")
    assert (found.labels, found.positions_mm) == (("A",), (tuple(expected),))
    assert any("RAS" in note for note in found.notes) == (expected[0] < 0)


def markups(**changes):
    points = [
        {"label": "A", "position": [1.0, 2.0, 3.0], "positionStatus": "defined"},
        {"label": "B", "position": None, "positionStatus": "undefined"},
        {"label": "", "position": [4, 5, 6]},
    ]
    return {"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points, **changes}]}


def test_markups_take_defined_points_and_say_what_they_left():
    found = read(json.dumps(markups()), "b.mrk.json")
    assert found.labels == ("A", "F2")
    assert found.positions_mm == ((1, 2, 3), (4, 5, 6))
    assert "B" in found.notes[0]


@pytest.mark.parametrize(("changes", "first"), read_cases("tables", "markups_systems"))
def test_markups_systems_and_units(changes, first):
    assert read(json.dumps(markups(**changes)), "b.mrk.json").positions_mm[0] == tuple(first)


@pytest.mark.parametrize(
    ("document", "code"),
    [
        ([], "not-markups"),
        ({"markups": []}, "not-markups"),
        ({"markups": [3]}, "not-markups"),
        ({"markups": markups()["markups"] * 2}, "several-lists"),
        (markups(coordinateSystem="IJK"), "unknown-value"),
        (markups(coordinateSystem=None), "wrong-type"),
        (markups(coordinateUnits="inch"), "unknown-value"),
        (markups(controlPoints=[{"position": [1, 2]}]), "wrong-type"),
        (markups(controlPoints=[{"position": [1, 2, "3x"]}]), "wrong-type"),
        (markups(controlPoints=[{"position": [1, 2, True]}]), "wrong-type"),
        (markups(controlPoints=[{"position": [1, 2, 1e300]}]), "out-of-range"),
        (markups(controlPoints=[{"position": [1, 2, 3], "label": 5}]), "wrong-type"),
        (markups(controlPoints=[7]), "wrong-type"),
        (markups(controlPoints={"a": 1}), "wrong-type"),
        (markups(controlPoints=[{"position": None, "positionStatus": "undefined"}]), "empty-document"),
    ],
)
def test_markups_refusals(document, code):
    assert refused(json.dumps(document), "b.mrk.json").code == code


def test_too_many_fiducials_states_the_limit():
    text = "x_mm,y_mm,z_mm\n" + "1,2,3\n" * 20
    with pytest.raises(LimitError, match="20 fiducials; at most 10"):
        read_fiducials(text.encode(), "b.csv", Limits(fiducials=10))


def test_an_error_in_a_referenced_file_stands_in_that_file(tmp_path):
    text = (EXAMPLES / "small_cluster_far_target.yaml").read_text()
    (tmp_path / "d.yaml").write_text(text)
    (tmp_path / "fiducials").mkdir()
    (tmp_path / "fiducials" / "marker8.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,three\n")
    problem = problems_of(load_design, tmp_path / "d.yaml", error=DesignError)[0]
    assert (problem.pointer, problem.file, problem.line) == ("/fiducials/file", "fiducials/marker8.csv", 2)
    (tmp_path / "fiducials" / "marker8.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,3\n# a remark\nA,1,2,4\n")
    problem = problems_of(load_design, tmp_path / "d.yaml")[0]
    assert (problem.code, problem.file, problem.line) == ("duplicate-name", "fiducials/marker8.csv", 4)


def test_the_same_beads_in_three_formats():
    legacy = convert((EXAMPLES / "fiducials" / "phantom.fcsv").read_bytes(), "phantom.fcsv", "a.csv")
    modern = convert((EXAMPLES / "fiducials" / "phantom.mrk.json").read_bytes(), "phantom.mrk.json", "a.csv")
    assert legacy.text == modern.text
    assert legacy.notes
    back = convert(legacy.text.encode(), "a.csv", "b.mrk.json")
    assert convert(back.text.encode(), "b.mrk.json", "a.csv").text == legacy.text
    assert back.notes == ()


def convert_file(source: Path, target: Path) -> ConvertedFile:
    made = convert(read_source_file(source), source.name, target.name, directory=source.parent)
    target.write_text(made.text, encoding="utf-8")
    return made


def test_the_fiducials_of_a_design_become_a_file(tmp_path):
    design = load_design(EXAMPLES / "slicer_markups.yaml")
    convert_file(EXAMPLES / "slicer_markups.yaml", tmp_path / "d.json")
    convert_file(tmp_path / "d.json", tmp_path / "beads.fcsv")
    assert read((tmp_path / "beads.fcsv").read_text(), "beads.fcsv").positions_mm == design.fiducials.positions_mm


@pytest.mark.parametrize("names", [("a.doc", "b.csv"), ("a.csv", "b.txt"), ("a", "b")])
def test_unknown_endings_are_refused(names):
    with pytest.raises(DesignError, match="known"):
        convert(b"x", *names)
    with pytest.raises(DesignError):
        read_source_file(Path("/nowhere/a.csv"))


@pytest.mark.parametrize(("name", "content", "cure"), read_cases("tables", "other_forms"))
def test_a_list_in_another_form_is_told_what_to_do_with_it(name, content, cure):
    """found by use, 2026-11: the page had no cure, as the answer had none."""
    assert cure in refused(content, name).hint


DESIGNS = sorted(path for path in EXAMPLES.rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text())
POINTS = [(point["label"], point["position_mm"]) for point in DEMO["fiducials"]["points"]]


def demo_markups(**changes):
    points = [{"label": label, "position": position} for label, position in POINTS]
    points.append({"label": "lost", "position": [0, 0, 0], "positionStatus": "undefined"})
    return json.dumps({"markups": [{"controlPoints": points, **changes}]})


def table(header, scale=1.0, mark=","):
    rows = [mark.join([label, *(repr(scale * value) for value in position)]) for label, position in POINTS]
    return "\n".join([header, *rows]) + "\n"


# name: (content, what the origin says besides file and hash, how many notes)
FILES: dict[str, tuple[str, dict[str, Any], int]] = {
    "plain.csv": (table("label,x_mm,y_mm,z_mm"), {"coordinate_system": "LPS"}, 0),
    "ras.csv": (table("# CoordinateSystem = RAS\nlabel,x_mm,y_mm,z_mm"), {"coordinate_system": "RAS"}, 1),
    "metres.csv": (
        table("# CoordinateSystem = RAS\nlabel;x_m;y_m;z_m", 0.001, ";"),
        {"coordinate_system": "RAS", "coordinate_unit": "m"}, 2,
    ),
    "micrometres.csv": (
        table("label,x_µm,y_µm,z_µm", 1000.0), {"coordinate_system": "LPS", "coordinate_unit": "um"}, 1,
    ),
    "old.fcsv": (
        table("# columns = label,x,y,z"), {"coordinate_system": "RAS", "coordinate_system_stated": False}, 2,
    ),
    "new.fcsv": (
        table("# CoordinateSystem = LPS\n# columns = label,x,y,z"), {"coordinate_system": "LPS"}, 0,
    ),
    "slicer.mrk.json": (
        demo_markups(coordinateSystem="RAS"), {"coordinate_system": "RAS", "left_out": ["lost"]}, 2,
    ),
    "cm.mrk.json": (
        demo_markups(coordinateUnits="cm"),
        {"coordinate_system": "LPS", "coordinate_unit": "cm", "left_out": ["lost"]}, 2,
    ),
}  # fmt: skip


@pytest.fixture(params=FILES)
def written(request, tmp_path):
    """(a design beside its fiducial file, what its origin should say, how many notes)"""
    content, said, notes = FILES[request.param]
    (tmp_path / request.param).write_text(content, encoding="utf-8")
    data = {**DEMO, "fiducials": {"file": request.param}}
    data.pop("optimise", None)
    path = tmp_path / "design.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    sha256 = hashlib.sha256(content.encode()).hexdigest()
    return path, {"file": request.param, "sha256": sha256, **said}, notes


def test_a_design_that_was_made_to_stand_alone_keeps_all_that_it_says_of_its_fiducials(tmp_path):
    said = {
        "manufacturing": {"half_width_mm": 0.05, "distribution": "uniform"},
        "diameter_mm": 2.5,
        "image_point": "shadow",
        "loss_probability": 0.01,
        "common": [{"name": "printing", "scale": {"half_width_rel": 0.001, "distribution": "uniform"}}],
    }
    of_a_file = {"file", "points", "origin", "T_con_file", "registered_to"}
    assert said.keys() == type(load_design(DEMO).document.fiducials).model_fields.keys() - of_a_file
    (tmp_path / "beads.csv").write_text(FILES["plain.csv"][0], encoding="utf-8")
    path = tmp_path / "design.yaml"
    path.write_text(yaml.safe_dump({**DEMO, "fiducials": {"file": "beads.csv", **said}}), encoding="utf-8")
    design = load_design(path)
    convert_file(path, tmp_path / "alone.yaml")
    moved = revise_design(design, Revision(fiducials_mm=np.array(design.fiducials.positions_mm) + 1))
    for alone in (load_design(tmp_path / "alone.yaml", allow_files=False), moved):
        section = alone.source.data["fiducials"]
        assert {name: value for name, value in section.items() if name not in ("points", "origin")} == said
    assert load_design(tmp_path / "alone.yaml").sha256 == design.sha256


def test_a_revision_adds_no_list_of_fixed_fiducials() -> None:
    design = load_design(replaced(DEMO, ("optimise", "fixed"), REMOVED))
    moved = revise_design(design, Revision(fiducials_mm=np.array(design.fiducials.positions_mm) + 1))
    assert "fixed" not in moved.source.data["optimise"]


def test_a_design_that_was_made_to_stand_alone_says_where_its_points_came_from(written, tmp_path):
    path, said, count = written
    design = load_design(path)
    notes = compile_design(design).notes
    assert sum(note.startswith(said["file"]) for note in notes) == count
    for name in ("alone.yaml", "alone.json"):
        assert convert_file(path, tmp_path / name).notes == design.fiducials.notes
        alone = load_design(tmp_path / name, allow_files=False)
        assert alone.source.data["fiducials"]["origin"] == said
        assert compile_design(alone).notes == notes
        assert alone.sha256 == design.sha256
        jsonschema.Draft202012Validator(design_json_schema()).validate(alone.source.data)


def test_a_fiducial_file_as_a_section_says_where_its_points_came_from(written):
    path, said, _ = written
    content = (path.parent / said["file"]).read_bytes()
    made = convert(content, said["file"], "section.yaml")
    section = yaml.safe_load(made.text)["fiducials"]
    assert section["origin"] == said
    alone = load_design({**yaml.safe_load(path.read_text()), "fiducials": section}, allow_files=False)
    assert alone.fiducials.notes == made.notes == load_design(path).fiducials.notes


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_every_example_is_the_same_when_it_stands_alone(path):
    design = load_design(path)
    for text in (design_to_yaml(design), design_to_json(design)):
        alone = load_design(text, allow_files=False)
        assert (alone.sha256, alone.fiducials.positions_mm) == (design.sha256, design.fiducials.positions_mm)
        assert compile_design(alone).notes == compile_design(design).notes
    again = load_design(design_to_yaml(alone), allow_files=False)
    assert again.source.data == alone.source.data
    assert ("origin" in alone.source.data["fiducials"]) == (design.document.fiducials.file is not None)


def test_what_was_moved_is_no_longer_called_what_is_in_the_file():
    design = load_design(EXAMPLES / "slicer_markups.yaml")
    here = compile_design(design).fiducials_mm
    notes = design.fiducials.notes
    for start in (design, load_design(design_to_yaml(design), allow_files=False)):
        assert revise_design(start, Revision(fiducials_mm=here)).fiducials.notes == notes
        moved = revise_design(start, Revision(fiducials_mm=here + np.array([0.5, 0, 0])))
        fewer = revise_design(start, Revision(labels=design.fiducials.labels[1:], fiducials_mm=here[1:]))
        for changed in (moved, fewer):
            assert changed.fiducials.notes[:-1] == notes
            assert "no longer those of the file" in changed.fiducials.notes[-1]
            assert changed.source.data["fiducials"]["origin"]["changed"] is True


@pytest.mark.parametrize("label", ["x" * 81, "a\x07b"])
def test_a_label_that_no_design_can_hold_is_refused_where_it_stands(label, tmp_path):
    """It used to be scored, and no report could be made of it."""
    (tmp_path / "beads.csv").write_text(table("label,x_mm,y_mm,z_mm").replace(POINTS[0][0] + ",", label + ",", 1))
    (tmp_path / "d.yaml").write_text(yaml.safe_dump({**DEMO, "fiducials": {"file": "beads.csv"}}))
    problem = problems_of(load_design, tmp_path / "d.yaml", error=DesignError)[0]
    assert (problem.code, problem.file) == ("bad-label", "beads.csv")
