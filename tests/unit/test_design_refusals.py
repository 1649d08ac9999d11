"""What a wrong document is told: pointer, code, what arrived, a hint, and the line it stands in."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from plain_data import DEMO, EXAMPLES, REMOVED, problems_of, read_cases, replaced
from tailstack.design import DEFAULT_LIMITS, Limits, check_design, load_design
from tailstack.errors import DesignError, LimitError, TailstackError

TEXT = (EXAMPLES / "demo.yaml").read_text()
NOISE = {"fiducial_noise_px": 0.3, "target_noise_px": 0.3}
POSED = {"name": "A", "intrinsics": {"focal_px": [5200, 5200], "principal_point_px": [768, 768]}, **NOISE}
ORIGIN = {"file": "a.csv", "sha256": "0" * 64, "coordinate_system": "LPS"}


def refused(data):
    return problems_of(lambda: check_design(load_design(data)))


def case(path, value, code, words, pointer=None):
    """A row of the table: path, value, pointer, code, words."""
    steps = tuple(int(step) if step.isdigit() else step for step in path.split("/"))
    return steps, REMOVED if value == "REMOVED" else value, f"/{path}" if pointer is None else pointer, code, words


CASES = [
    *(case(*row) for row in read_cases("design", "cases")),
    case("fiducials/origin", ORIGIN | {"left_out": ["x"] * 1001}, "too-many", "1000", "/fiducials/origin/left_out"),
]


@pytest.mark.parametrize(("path", "value", "pointer", "code", "words"), CASES)
def test_refusal_names_place_rule_value_and_cure(path, value, pointer, code, words):
    problem = refused(replaced(DEMO, path, value))[0]
    assert (problem.pointer, problem.code) == (pointer, code)
    assert words in str(problem)


@pytest.mark.parametrize("name", ["image_feild", "detector_tild"])
def test_a_misspelt_name_is_no_unit(name):
    """Only a name that ends in another unit is told to convert its number."""
    (problem,) = refused(replaced(DEMO, ("views", 0, name), {}))
    assert problem.code == "unknown-field"
    assert "did you mean" in problem.hint
    assert "convert" not in problem.hint


def test_all_problems_come_at_once_and_are_capped():
    data = copy.deepcopy(DEMO)
    for point in data["fiducials"]["points"]:
        point["position_mm"] = ["a", "b", "c"]
    problems = refused(data)
    assert len(problems) == DEFAULT_LIMITS.problems + 1
    assert problems[-1].code == "and-more"
    assert problems[-1].detail == "not listed: 11 more problems"


@pytest.mark.parametrize(
    ("name", "text", "code", "at", "column"),
    [
        ("d.yaml", TEXT.replace("fiducial_noise_px: 0.3", "fiducal_noise_px: 0.3"), "unknown-field", "fiducal", 5),
        (
            "d.yaml",
            TEXT.replace("isocentre_mm: [0, 0, 0]", "isocentre_mm: [0, 2000, 0]", 1),
            "behind-source",
            "- name: AP",
            5,
        ),
        ("d.json", '{\n "schema": "tailstack/design/1",\n "name": "x",\n "nmae": 2}', "unknown-field", "nmae", 2),
    ],
)
def test_problems_stand_at_a_line_of_the_file(tmp_path, name, text, code, at, column):
    path = tmp_path / name
    path.write_text(text)
    line = next(k for k, each in enumerate(text.splitlines(), 1) if at in each)
    with pytest.raises(TailstackError) as caught:
        check_design(load_design(path))
    problem = next(problem for problem in caught.value.problems if problem.code == code)
    assert (problem.file, problem.line, problem.column) == (str(path), line, column)
    assert f"{path}:{line}:{column}: " in str(caught.value)


def test_numbers_that_yaml_reads_two_ways_are_refused():
    for text in ("010", "1:30", "1_000", "yes", "0x10"):
        problems = refused(TEXT.replace("source_isocentre_mm: 700 #", f"source_isocentre_mm: {text} #"))
        assert [problem.code for problem in problems] == ["wrong-type"]
        assert text in problems[0].detail


def test_a_whole_number_that_came_as_a_float_is_told_as_one():
    for given, hint in ((1e5, "write 100000"), (2.5, "")):
        (problem,) = refused(replaced(DEMO, ("optimise", "seed"), given))
        assert (problem.code, problem.hint) == ("wrong-type", hint)


def test_sizes_are_bounded_and_the_bound_is_stated():
    data = replaced(DEMO, ("targets",), [{"name": "r", "region": {"box": {"centre_mm": [0, 0, 60], "size_mm": [1, 1, 1],
                                                                  "points_per_axis": 6}}}])  # fmt: skip
    with pytest.raises(LimitError, match="216 targets; at most 200"):
        load_design(data)
    with pytest.raises(LimitError, match="12 fiducials; at most 11"):
        load_design(DEMO, limits=Limits(fiducials=11))
    with pytest.raises(LimitError, match="longer than 100"):
        load_design(TEXT.encode(), limits=Limits(document_bytes=100))


@pytest.mark.parametrize(("name", "code"), read_cases("files", "references"))
def test_file_references_stay_beside_the_design(tmp_path, name, code):
    (tmp_path / "secret.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,3\n")
    home = tmp_path / "home"
    (home / "directory.csv").mkdir(parents=True)
    (home / "link.csv").symlink_to(tmp_path / "secret.csv")
    (home / "beads.txt").write_text("")
    data = replaced(DEMO, ("fiducials",), {"file": name})
    problem = problems_of(load_design, data, base_directory=home, error=DesignError)[0]
    assert (problem.pointer, problem.code) == ("/fiducials/file", code)


def test_a_service_reads_no_files_and_what_is_no_file_is_none(tmp_path):
    (tmp_path / "beads.csv").write_text("label,x_mm,y_mm,z_mm\nA,1,2,3\n")
    data = replaced(DEMO, ("fiducials",), {"file": "beads.csv"})
    assert load_design(data | {"optimise": DEMO["optimise"]}, base_directory=tmp_path).fiducials.labels == ("A",)
    for directory, allowed in ((tmp_path, False), (None, True)):
        problem = problems_of(load_design, data, base_directory=directory, allow_files=allowed, error=DesignError)[0]
        assert problem.code == "file-refused"
        assert "inline" in problem.hint
    for path in (tmp_path, tmp_path / "none.yaml", Path("/dev/null"), "no-such-design", "a\0b"):
        with pytest.raises(DesignError):
            load_design(path)


PROJECTION = [[1000.5, 2.0, 300.0, 400.0], [5.0, 1100.25, 310.0, 420.0], [0.01, 0.02, 1.0, 700.0]]
FLAT = [number for row in PROJECTION for number in row]
COEFFICIENTS = [number / 700.0 for number in FLAT[:11]]


def refused_view(view):
    """What is said of it beside a view that is right."""
    right = {"name": "B", "projection": PROJECTION, **NOISE}
    (problem,) = refused(replaced(DEMO, ("views",), [view, right]))
    return problem


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (COEFFICIENTS, "eleven DLT coefficients"),
        ([[number] for number in COEFFICIENTS], "eleven DLT coefficients"),
        (FLAT, "row after row (C, NumPy)"),
        ([row[k] for k in range(4) for row in PROJECTION], "column after column (MATLAB, Fortran)"),
        ([list(column) for column in zip(*PROJECTION, strict=True)], "transposed"),
        (" ".join(map(str, COEFFICIENTS)), "eleven DLT coefficients"),
        (", ".join(map(str, FLAT)), "row after row (C, NumPy)"),
    ],
)
def test_a_projection_in_another_shape_is_refused_with_the_rows_to_write(written, words):
    """closed_form: the matrix that was written otherwise; DLT coefficients are it over its last number."""
    problem = refused_view({"name": "A", "projection": written, **NOISE})
    detail = "needs 3 entries" if isinstance(written, list) else "expected a list"
    assert (problem.pointer, problem.detail[:15]) == ("/views/0/projection", detail)
    after = problem.hint.partition(words)[2]
    told = json.loads(after[after.index("[[") : after.index("]]") + 2])
    np.testing.assert_allclose(np.array(told) / told[2][3], np.array(PROJECTION) / 700.0, rtol=1e-9)


@pytest.mark.parametrize("transposed", [False, True])
def test_a_camera_matrix_is_refused_with_its_fields(transposed):
    matrix = np.array([[5200.0, 1.5, 770.0], [0.0, 5190.0, 760.0], [0.0, 0.0, 1.0]])
    matrix = (matrix.T if transposed else matrix).tolist()
    problem = refused_view(POSED | {"intrinsics": matrix, "pose": np.eye(4).tolist()})
    told = yaml.safe_load(problem.hint[problem.hint.index("{") :])
    assert told == {"focal_px": [5200, 5190], "principal_point_px": [770, 760], "skew_px": 1.5}


POSE = np.array([[1.0, 0, 0, 4], [0, 0, -1, -7], [0, 1, 0, 690], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("written", "pointer"),
    [
        (POSE[:3].ravel(), "/views/0/pose"),
        (POSE.ravel(), "/views/0/pose"),
        (POSE.T.ravel(), "/views/0/pose"),
        (POSE.T, "/views/0/pose/3"),
    ],
    ids=["three rows in one", "rows in one", "columns in one", "for rows on its left"],
)
def test_a_pose_in_another_shape_is_refused_with_its_rows(written, pointer):
    problem = refused_view(POSED | {"pose": written.tolist()})
    assert problem.pointer == pointer
    told = json.loads(problem.hint[problem.hint.index("[[") : problem.hint.index("]]") + 2])
    np.testing.assert_array_equal(told, POSE)
