"""Slips that everybody makes, and the cure that each refusal names, with the pointer and the line of the slip."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from plain_data import replaced
from tailstack.design import check_design, load_design
from tailstack.design.fiducial_files import read_fiducials
from tailstack.design.reading import DEFAULT_LIMITS
from tailstack.errors import DesignError, Problem

EXAMPLES = Path(__file__).parents[2] / "examples"
TEXT = (EXAMPLES / "demo.yaml").read_text()
DATA = yaml.safe_load(TEXT)
LOCATORS = yaml.safe_load((EXAMPLES / "locators_321.yaml").read_text())
UNIT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def refused(source, **options) -> Problem:
    """The only problem of a design."""
    with pytest.raises(DesignError) as caught:
        check_design(load_design(source, **options))
    (problem,) = caught.value.problems
    return problem


def line_of(text: str, part: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), 1) if part in line)


TYPED = [  # what stands in the demo, what is typed instead, the pointer, and the cure
    ("    limit_mm: 1.0", "    limit_mm: 1,0", "/requirements/0/limit_mm", "with a point: 1.0"),
    ("    limit_mm: 1.0", "    limit_mm: '1,050'", "/requirements/0/limit_mm", "write 1.05 or 1050"),
    ("rx: { half_width_deg: 0.10,", "rx: { half_width_deg: 0,10,",
     "/interfaces/structure_connector/tolerances/rx/half_width_deg", "write it with a point: 0.10"),
    ("label: F2, position_mm: [30,", "label: 2,5, position_mm: [30,", "/fiducials/points/1/label", "a point: 2.5"),
    ("rx: { half_width_deg: 0.10,", "rx: { half_width_deg: 0,05,",
     "/interfaces/structure_connector/tolerances/rx/05", "with a point, as in 0.05"),
    ("position_mm: [-30, -29, -72]", "position_mm: [-30,5, -29,2, -72]", "/fiducials/points/0/position_mm",
     "if -30,5 is one number, write it with a point, -30.5"),
    ("    quantile: 0.95", "    quantile: 95", "/requirements/0/quantile", "95 % is 0.95"),
    ("    quantile: 0.95", "    quantile: 95 %", "/requirements/0/quantile", "95 % is 0.95"),
    ("    confidence: 0.95", "    confidence: 99.5", "/requirements/0/confidence", "99.5 % is 0.995"),
    ("half_width_mm: 0.05, distribution: uniform", "half_width_mm: 0.05, distribution: gaussian",
     "/fiducials/manufacturing/distribution", "did you mean normal?"),
    ("    risk: pooled", "    risk: per unit", "/requirements/0/risk", "did you mean per_unit?"),
    ("    error: tcp", "    error: TCP", "/requirements/0/error", "did you mean tcp?"),
    ("    error: tcp", "    error: localization", "/requirements/0/error", "did you mean localisation?"),
    ("    risk: pooled", "    risc: pooled", "/requirements/0/risc", "did you mean risk?"),
    ("    risk: pooled", "    minYield: 0.9", "/requirements/0/minYield", "did you mean min_yield?"),
    ("    targets: all", "    targets: [Tip]", "/requirements/0/targets/0", "did you mean tip?"),
    ("  - name: AP\n    preset: siemens-cios-fusion", "  - name: AP\n    preset: Siemens Cios Fusion",
     "/views/0/preset", "did you mean siemens-cios-fusion?"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "pointer", "cure"), TYPED)
def test_a_slip_is_cured_at_its_line(tmp_path, old, new, pointer, cure):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    path = tmp_path / "design.yaml"
    path.write_text(text)
    problem = refused(path)
    assert problem.pointer == pointer
    assert problem.line == line_of(text, new.splitlines()[-1])
    assert cure in problem.hint


GIVEN = [  # matrices of another shape
    (DATA, ("transforms", "T_flange_con"), UNIT[:3], "/transforms/T_flange_con", "add [0, 0, 0, 1]"),
    (DATA, ("transforms", "T_flange_con"), [row[:3] for row in UNIT[:3]], "/transforms/T_flange_con",
     "goes under rotation"),
    (LOCATORS, ("views", 0, "pose"), UNIT[:3], "/views/0/pose", "add [0, 0, 0, 1]"),
    (LOCATORS, ("views", 0, "pose", "rotation"), UNIT, "/views/0/pose/rotation", "as the transform itself"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "path", "value", "pointer", "cure"), GIVEN)
def test_a_matrix_of_another_shape(document, path, value, pointer, cure):
    problem = refused(replaced(document, path, value))
    assert problem.pointer == pointer
    assert cure in problem.hint


def test_a_pose_where_a_projection_belongs():
    view = {key: LOCATORS["views"][0][key] for key in ("name", "fiducial_noise_px", "target_noise_px")}
    problem = refused(replaced(LOCATORS, ("views", 0), view | {"projection": UNIT}))
    assert problem.pointer == "/views/0/projection"
    assert "a pose goes under pose" in problem.hint


def test_a_distance_below_its_range_in_metres():
    problem = refused(replaced(DATA, ("views", 0, "source_isocentre_mm"), 0.7))
    assert (problem.pointer, problem.hint) == ("/views/0/source_isocentre_mm", "it is in mm: 0.7 m is 700 mm")


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("fiducials/marker9.csv", "did you mean fiducials/marker8.csv?"),
        ("marker8.csv", "did you mean fiducials/marker8.csv?"),
        ("fiducial/marker8.csv", "did you mean fiducials/marker8.csv?"),
        ("fiducials/phantom.csv", "did you mean fiducials/phantom."),
        ("fiducials/xyz.csv", "there is fiducials/marker8.csv, fiducials/phantom.fcsv"),
    ],
)
def test_a_missing_fiducial_file_names_line_folder_and_neighbours(tmp_path, name, cure):
    (tmp_path / "fiducials").mkdir()
    for known in ("marker8.csv", "phantom.fcsv", "phantom.mrk.json"):
        (tmp_path / "fiducials" / known).write_text("")
    text = (EXAMPLES / "small_cluster_far_target.yaml").read_text().replace("fiducials/marker8.csv", name)
    path = tmp_path / "design.yaml"
    path.write_text(text)
    problem = refused(path)
    assert (problem.pointer, problem.code) == ("/fiducials/file", "file-not-found")
    assert (problem.file, problem.line) == (str(path), line_of(text, f"file: {name}"))
    assert f"looked in {(tmp_path / name).parent}" in problem.detail
    assert cure in problem.hint


def test_a_missing_design_names_its_neighbour(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("parts").mkdir()
    Path("parts/guide.yaml").write_text(TEXT)
    for typed in ("parts/giude.yaml", "guide.yaml", "part/guide.yaml"):
        assert refused(Path(typed)).hint == "did you mean parts/guide.yaml?"
    assert refused(Path("a.yaml")).hint == "check the path"  # an ending in common is no likeness


@pytest.mark.parametrize("name", ["marker8.csv", "phantom.fcsv", "phantom.mrk.json"])
def test_a_point_list_given_as_a_design(name):
    path = EXAMPLES / "fiducials" / name
    problem = refused(path)
    assert problem.code == "point-list"
    assert problem.line == 1
    assert problem.hint == f"put it under fiducials.file of a design: fiducials: {{file: {name}}}"
    assert "fiducials.points" in refused(path.read_text()).hint  # it came without a file


def test_a_point_list_is_not_sent_in_a_circle_by_its_name(tmp_path):
    """A fiducial file has one of a few endings; what it is says its content."""
    (tmp_path / "beads.txt").write_bytes((EXAMPLES / "fiducials" / "phantom.fcsv").read_bytes())
    hint = refused(tmp_path / "beads.txt").hint
    assert hint == "name it so and put it under fiducials.file of a design: fiducials: {file: beads.csv}"
    (tmp_path / "beads.txt").rename(tmp_path / "beads.csv")
    data = {key: value for key, value in DATA.items() if key != "optimise"} | {"fiducials": {"file": "beads.csv"}}
    assert load_design(data, base_directory=tmp_path).fiducials.labels


@pytest.mark.parametrize("data", ["- [1, 2, 3]\n- [4, 5, 6]\n", "- position_mm: [1, 2, 3]\n", "points:\n- [1, 2, 3]\n"])
def test_points_that_somebody_wrote(data):
    assert refused(data).code == "point-list"


def test_yaml_in_a_file_called_json(tmp_path):
    path = tmp_path / "design.json"
    path.write_text(TEXT)
    problem = refused(path)
    assert (problem.code, problem.line) == ("json-syntax", 1)
    assert "looks like YAML" in problem.hint
    path.write_text("[1, 2")
    assert refused(path).hint == ""


HEADERS = [
    "label,X [mm],Y [mm],Z [mm]\nA,1,2,3\n",
    "Label,X(mm),Y(mm),Z(mm)\nA,1,2,3\n",
    "label,x,y,z\n,mm,mm,mm\nA,1,2,3\n",
    "label;x;y;z\n-;[mm];[mm];[mm]\nA;1;2;3\n",
    "name\tx/mm\ty/mm\tz/mm\nA\t1\t2\t3\n",
    "label,x mm,y mm,z mm\nA,1,2,3\n",
    "label,x_mm,y_mm,z_mm\nA,1,2,3\n",
    "label,z [cm],y [cm],x [cm]\nA,.3,.2,.1\n",
    "label,x [\N{GREEK SMALL LETTER MU}m],y [\N{MICRO SIGN}m],z [um]\nA,1000,2000,3000\n".replace("[um]", "[µm]"),
]


@pytest.mark.parametrize("text", HEADERS)
def test_headers_of_csv_as_people_write_them(text):
    found = read_fiducials(text.encode(), "b.csv", DEFAULT_LIMITS)
    assert found.labels == ("A",)
    assert found.positions_mm[0] == pytest.approx((1, 2, 3))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("label,x,y,z\nA,1,2,3\n", 1),  # no unit anywhere
        ("label,x [inch],y [inch],z [inch]\nA,1,2,3\n", 1),
        ("label,x [mm,y [mm,z [mm\nA,1,2,3\n", 1),
        ("label,x,y,z\n,mm,cm,mm\nA,1,2,3\n", 2),
        ("label,x_mm,y,z\n,cm,mm,mm\nA,1,2,3\n", 2),  # header and row contradict each other
        ("label,x,x [mm],y_mm,z_mm\nA,1,1,2,3\n", 1),
    ],
)
def test_headers_that_leave_a_unit_open_are_refused(text, line):
    with pytest.raises(DesignError) as caught:
        read_fiducials(text.encode(), "b.csv", DEFAULT_LIMITS)
    problem = caught.value.problems[0]
    assert (problem.code, problem.line) == ("csv-header", line)


@pytest.mark.parametrize(
    ("schema", "cure"),
    [
        ("tailstack/policy/1", "tailstack gate DESIGN --policy FILE"),
        ("tailstack/waivers/1", "tailstack gate DESIGN --waivers FILE"),
        ("tailstack/score/1", "tailstack report FILE"),
        ("tailstack/design/2", "schema: tailstack/design/1"),
        ("design", "schema: tailstack/design/1"),
    ],
)
def test_another_document_than_a_design(schema, cure):
    problem = refused(f"name: x\nschema: {schema}\n")
    assert (problem.pointer, problem.code, problem.line) == ("/schema", "unsupported-schema", 2)
    assert cure in problem.hint
