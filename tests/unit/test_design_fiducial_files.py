"""Fiducial files: units, coordinate systems, what is skipped, what is refused and where."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tailstack.design import convert, convert_file, load_design
from tailstack.design.fiducial_files import FORMATS, FiducialList, read_fiducials, write_fiducials
from tailstack.design.reading import DEFAULT_LIMITS, Limits
from tailstack.errors import DesignError, LimitError

EXAMPLES = Path(__file__).parents[2] / "examples"


def read(text, name):
    return read_fiducials(text.encode(), name, DEFAULT_LIMITS)


def refused(text, name):
    with pytest.raises(DesignError) as caught:
        read(text, name)
    assert caught.value.problems[0].file == name
    return caught.value.problems[0]


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


@pytest.mark.parametrize(
    ("text", "labels", "first_mm"),
    [
        ("label,x_mm,y_mm,z_mm\nA;left,1,2,-3.5\nB;left,4,5,6\n", ("A;left", "B;left"), (1.0, 2.0, -3.5)),
        ("label,x_mm,y_mm,z_mm\nA;1,1,2,-3.5\nB;2,4,5,6\n", ("A;1", "B;2"), (1.0, 2.0, -3.5)),
        (
            "Report, 3 May\nlabel;x_mm;y_mm;z_mm\nA, left;1;2;-3.5\nB, left;4;5;6\n",
            ("A, left", "B, left"),
            (1, 2, -3.5),
        ),
    ],
)
def test_what_labels_hold_separates_no_cells(text, labels, first_mm):
    found = read(text, "b.csv")
    assert (found.labels, found.positions_mm[0]) == (labels, first_mm)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("um", 0.001)])
def test_csv_units_are_in_the_header(unit, factor):
    found = read(f"label,x_{unit},y_{unit},z_{unit}\nA,1,2,-3\n", "b.csv")
    assert found.positions_mm == ((factor, 2 * factor, -3 * factor),)
    assert bool(found.notes) == (factor != 1.0)


def test_csv_variants():
    assert read("x_mm;y_mm;z_mm\n1;2;3\n", "b.csv").labels == ("F1",)
    assert read("# CoordinateSystem = RAS\nname\tx_mm\ty_mm\tz_mm\nA\t1\t2\t3\n", "b.csv").positions_mm == (
        (-1, -2, 3),
    )
    assert read('label,x_mm,y_mm,z_mm\n"A, left",1,2,3\r\n', "B.CSV").labels == ("A, left",)


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("1,2,3\n4,5,6\n", "csv-header", 1),
        ("label,x,y,z\nA,1,2,3\n", "csv-header", 1),
        ("label,x_mm,y_mm,z_inch\nA,1,2,3\n", "csv-header", 1),
        ("label,x_mm,y_cm,z_mm\nA,1,2,3\n", "csv-header", 1),
        ("label,colour,x_mm,y_mm,z_mm\nA,1,2,3,4\n", "csv-header", 1),
        ("label,x_mm,y_mm,z_mm\nA,1,2\n", "csv-row", 2),
        ("label,x_mm,y_mm,z_mm\nA, left,1,2,3\n", "csv-row", 2),
        ("label,x_mm,y_mm,z_mm\nA,1,2,x\n", "wrong-type", 2),
        ("label,x_mm,y_mm,z_mm\nA,1,2,nan\n", "wrong-type", 2),
        ("label,x_mm,y_mm,z_mm\nA,1,2,1e9\n", "out-of-range", None),
        ("x_mm;y_mm;z_mm\n1,5;2.5;3\n", "mixed-decimals", 2),
        ("label,x_mm,y_mm,z_mm\n", "empty-document", None),
        ("# CoordinateSystem = IJK\nlabel,x_mm,y_mm,z_mm\nA,1,2,3\n", "unknown-value", 1),
    ],
)
def test_csv_refusals(text, code, line):
    problem = refused(text, "b.csv")
    assert (problem.code, problem.line) == (code, line)


ROWS = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\nn1,1,2,3,0,0,0,1,1,1,0,A,,\n"


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("", (-1.0, -2.0, 3.0)),  # old files are RAS
        ("# CoordinateSystem = 0\n", (-1.0, -2.0, 3.0)),
        ("# CoordinateSystem = RAS\n", (-1.0, -2.0, 3.0)),
        ("# CoordinateSystem = 1\n", (1.0, 2.0, 3.0)),
        ("# CoordinateSystem = LPS\n", (1.0, 2.0, 3.0)),
    ],
)
def test_fcsv_coordinate_systems(header, expected):
    found = read("# Markups fiducial file version = 4.11\n" + header + ROWS, "b.fcsv")
    assert (found.labels, found.positions_mm) == (("A",), (expected,))
    assert any("RAS" in note for note in found.notes) == (expected[0] < 0)


def test_fcsv_of_slicer_3_names_its_columns():
    assert read("# columns = label,x,y,z,sel,vis\nA,1,2,3,1,1\n", "b.fcsv").labels == ("A",)


def test_a_row_with_a_cell_too_many_is_told_of_the_two_commas_that_make_one():
    with pytest.raises(DesignError) as caught:
        read("label,x_mm,y_mm,z_mm\narm, long,1,2,3\n", "b.csv")
    hint = caught.value.problems[0].hint
    assert hint == "write decimals with a point; a label that holds a comma stands in double quotes"
    assert read('label,x_mm,y_mm,z_mm\n"arm, long",1,2,3\n', "b.csv").labels == ("arm, long",)


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


@pytest.mark.parametrize(
    ("changes", "first"),
    [
        ({"coordinateSystem": "RAS"}, (-1, -2, 3)),
        ({"coordinateUnits": "cm"}, (10, 20, 30)),
        ({"coordinateUnits": ["mm", "UCUM", "millimeter"]}, (1, 2, 3)),
        ({"coordinateSystem": "RAS", "coordinateUnits": "m"}, (-1000, -2000, 3000)),
    ],
)
def test_markups_systems_and_units(changes, first):
    assert read(json.dumps(markups(**changes)), "b.mrk.json").positions_mm[0] == first


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
    with pytest.raises(DesignError) as caught:
        load_design(tmp_path / "d.yaml")
    problem = caught.value.problems[0]
    assert (problem.pointer, problem.file, problem.line) == ("/fiducials/file", "fiducials/marker8.csv", 2)


def test_the_same_beads_in_three_formats():
    legacy = convert((EXAMPLES / "fiducials" / "phantom.fcsv").read_bytes(), "phantom.fcsv", "a.csv")
    modern = convert((EXAMPLES / "fiducials" / "phantom.mrk.json").read_bytes(), "phantom.mrk.json", "a.csv")
    assert legacy.text == modern.text
    assert legacy.notes
    back = convert(legacy.text.encode(), "a.csv", "b.mrk.json")
    assert convert(back.text.encode(), "b.mrk.json", "a.csv").text == legacy.text
    assert back.notes == ()


def test_designs_convert_and_stand_alone(tmp_path):
    source = EXAMPLES / "slicer_markups.yaml"
    conversion = convert_file(source, tmp_path / "d.json")
    design = load_design(tmp_path / "d.json", allow_files=False)
    assert design.sha256 == load_design(source).sha256
    assert any("RAS" in note for note in conversion.notes)
    convert_file(tmp_path / "d.json", tmp_path / "beads.fcsv")
    beads = read((tmp_path / "beads.fcsv").read_text(), "beads.fcsv")
    assert beads.positions_mm == design.fiducials.positions_mm
    section = convert((tmp_path / "beads.fcsv").read_bytes(), "beads.fcsv", "section.yaml").text
    assert section.startswith("fiducials:\n  points:\n")


@pytest.mark.parametrize("names", [("a.doc", "b.csv"), ("a.csv", "b.txt"), ("a", "b")])
def test_unknown_endings_are_refused(names):
    with pytest.raises(DesignError, match="known"):
        convert(b"x", *names)
    with pytest.raises(DesignError):
        convert_file(Path("/nowhere/a.csv"), Path("/nowhere/b.csv"))


@pytest.mark.parametrize(("name", "content", "cure"), [
    ("beads.xlsx", b"", "save the sheet with the table as CSV UTF-8"),
    ("beads.TXT", b"1,2,3", "name it .csv"),
    ("beads.csv", b"1,2,3\n4,5,6\n", "put x_mm,y_mm,z_mm above it"),
    ("beads.csv", b"A;1;2;3\nB;4;5;6\n", "put label;x_mm;y_mm;z_mm above it"),
    ("beads.csv", b"x_ft,y_ft,z_ft\n1,2,3\n", "1 ft is 304.8 mm: multiply by that, and call the columns x_mm"),
    ("beads.csv", b"x [mil],y [mil],z [mil]\n1,2,3\n", "1 mil is 0.0254 mm"),
])  # fmt: skip
def test_a_list_in_another_form_is_told_what_to_do_with_it(name, content, cure):
    """found by use, 2026-11: the page had no cure, as the answer had none."""
    with pytest.raises(DesignError) as caught:
        read_fiducials(content, name, DEFAULT_LIMITS)
    assert cure in caught.value.problems[0].hint
