"""Points that came from a file go on saying so: which file, and what was done to the numbers on the way."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

from plain_data import replaced
from tailstack.design import compile_design, convert, convert_file, design_json_schema, design_to_yaml, load_design
from tailstack.design.write import Revision, revise_design
from tailstack.errors import DesignError, TailstackError

EXAMPLES = Path(__file__).parents[2] / "examples"
DESIGNS = sorted(path for path in EXAMPLES.rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text())
DEMO = yaml.safe_load((EXAMPLES / "demo.yaml").read_text())
POINTS = [(point["label"], point["position_mm"]) for point in DEMO["fiducials"]["points"]]


def markups(**changes):
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
        markups(coordinateSystem="RAS"), {"coordinate_system": "RAS", "left_out": ["lost"]}, 2,
    ),
    "cm.mrk.json": (
        markups(coordinateUnits="cm"), {"coordinate_system": "LPS", "coordinate_unit": "cm", "left_out": ["lost"]}, 2,
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


def about_the_file(path, notes):
    name = load_design(path).document.fiducials.file
    return [note for note in notes if name and note.startswith(name)]


def test_a_design_that_was_made_to_stand_alone_keeps_all_that_it_says_of_its_fiducials(tmp_path):
    said = {
        "manufacturing": {"half_width_mm": 0.05, "distribution": "uniform"},
        "diameter_mm": 2.5,
        "image_point": "shadow",
        "loss_probability": 0.01,
    }
    assert said.keys() == type(load_design(DEMO).document.fiducials).model_fields.keys() - {"file", "points", "origin"}
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


def test_a_design_that_was_made_to_stand_alone_says_where_its_points_came_from(written, tmp_path):
    path, said, count = written
    design = load_design(path)
    notes = compile_design(design).notes
    assert len(about_the_file(path, notes)) == count
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
def test_every_example_notes_the_same_when_it_stands_alone(path):
    design = load_design(path)
    alone = load_design(design_to_yaml(design), allow_files=False)
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


@pytest.mark.parametrize(
    ("section", "pointer", "code"),
    [
        ({"file": "a.csv", "origin": {}}, "/fiducials/origin", None),
        ({"file": "a.csv", "origin": {"file": "a.csv", "sha256": "0" * 64, "coordinate_system": "LPS"}},
         "/fiducials/origin", "unused-field"),
        ({"points": DEMO["fiducials"]["points"], "origin": {"file": "a", "sha256": "0", "coordinate_system": "LPS"}},
         "/fiducials/origin/sha256", None),
        ({"points": DEMO["fiducials"]["points"], "origin": {
            "file": "a", "sha256": "0" * 64, "coordinate_system": "LPS", "left_out": ["x"] * 1001}},
         "/fiducials/origin/left_out", "too-many"),
    ],
)  # fmt: skip
def test_an_origin_that_cannot_be_is_refused(section, pointer, code):
    with pytest.raises(TailstackError) as caught:  # DesignError or LimitError
        load_design(replaced(DEMO, ("fiducials",), section))
    problem = caught.value.problems[0]
    assert problem.pointer.startswith(pointer)
    assert code in (None, problem.code)


@pytest.mark.parametrize("label", ["x" * 81, "a\x07b"])
def test_a_label_that_no_design_can_hold_is_refused_where_it_stands(label, tmp_path):
    """It used to be scored, and no report could be made of it."""
    (tmp_path / "beads.csv").write_text(table("label,x_mm,y_mm,z_mm").replace(POINTS[0][0] + ",", label + ",", 1))
    (tmp_path / "d.yaml").write_text(yaml.safe_dump({**DEMO, "fiducials": {"file": "beads.csv"}}))
    with pytest.raises(DesignError) as caught:
        load_design(tmp_path / "d.yaml")
    assert (caught.value.problems[0].code, caught.value.problems[0].file) == ("bad-label", "beads.csv")
