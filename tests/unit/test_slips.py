"""Slips that everybody makes, and the cure that each refusal names, with the pointer and the line of the slip.

Every hint that can be obeyed is obeyed: it helps, or leads to the next refusal, and never back to itself.  Refusals are
collected by a walk over every field of every record of the document and every slip of its value, and from the scenes of
the suite.  A hint with a number or a line that nothing here can obey fails, so that none is left out.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import test_design_refusals
import yaml

from cure_walk import check_obeyed, refused, walk_slips
from plain_data import DEMO, EXAMPLES, problems_of, read_cases, replaced
from records import fields_of, records_below, sample_of
from tailstack.design import check_design, load_design
from tailstack.design.document import DesignDocument
from tailstack.errors import DesignError, Problem, TailstackError

TEXT = (EXAMPLES / "demo.yaml").read_text()
LOCATORS = yaml.safe_load((EXAMPLES / "locators_321.yaml").read_text())
UNIT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def problem_of(source, **options) -> Problem:
    """The only problem of a design."""
    (problem,) = problems_of(lambda: check_design(load_design(source, **options)), error=DesignError)
    return problem


def line_of(text: str, part: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), 1) if part in line)


TYPED = read_cases("design", "slips")


@pytest.mark.parametrize(("old", "new", "pointer", "cure"), TYPED)
def test_a_slip_is_cured_at_its_line(tmp_path, old, new, pointer, cure):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    path = tmp_path / "design.yaml"
    path.write_text(text)
    problem = problem_of(path)
    assert problem.pointer == pointer
    assert problem.line == line_of(text, new.splitlines()[-1])
    assert cure in problem.hint


A_VIEW = {key: LOCATORS["views"][0][key] for key in ("name", "fiducial_noise_px", "target_noise_px")}
GIVEN = [  # matrices of another shape, a pose where a projection belongs, a distance below its range in metres
    (DEMO, ("transforms", "T_flange_con"), UNIT[:3], "/transforms/T_flange_con", "add [0, 0, 0, 1]"),
    (DEMO, ("transforms", "T_flange_con"), [row[:3] for row in UNIT[:3]], "/transforms/T_flange_con",
     "goes under rotation"),
    (LOCATORS, ("views", 0, "pose"), UNIT[:3], "/views/0/pose", "add [0, 0, 0, 1]"),
    (LOCATORS, ("views", 0, "pose", "rotation"), UNIT, "/views/0/pose/rotation", "as the transform itself"),
    (LOCATORS, ("views", 0), A_VIEW | {"projection": UNIT}, "/views/0/projection", "a pose goes under pose"),
    (DEMO, ("views", 0, "source_isocentre_mm"), 0.7, "/views/0/source_isocentre_mm", "it is in mm: 0.7 m is 700 mm"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "path", "value", "pointer", "cure"), GIVEN)
def test_a_value_of_another_form_is_cured_at_its_field(document, path, value, pointer, cure):
    problem = problem_of(replaced(document, path, value))
    assert problem.pointer == pointer
    assert cure in problem.hint


@pytest.mark.parametrize(("name", "cure"), read_cases("design", "missing_files"))
def test_a_missing_fiducial_file_names_line_folder_and_neighbours(tmp_path, name, cure):
    (tmp_path / "fiducials").mkdir()
    for known in ("marker8.csv", "phantom.fcsv", "phantom.mrk.json"):
        (tmp_path / "fiducials" / known).write_text("")
    text = (EXAMPLES / "small_cluster_far_target.yaml").read_text().replace("fiducials/marker8.csv", name)
    path = tmp_path / "design.yaml"
    path.write_text(text)
    problem = problem_of(path)
    assert (problem.pointer, problem.code) == ("/fiducials/file", "file-not-found")
    assert (problem.file, problem.line) == (str(path), line_of(text, f"file: {name}"))
    assert f"looked in {(tmp_path / name).parent}" in problem.detail
    assert cure in problem.hint


def test_a_missing_design_names_its_neighbour(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("parts").mkdir()
    Path("parts/guide.yaml").write_text(TEXT)
    for typed in ("parts/giude.yaml", "guide.yaml", "part/guide.yaml", "guide.yml", "guide.json", "parts/guide"):
        assert problem_of(Path(typed)).hint == "did you mean parts/guide.yaml?"
    assert problem_of(Path("a.yaml")).hint == "check the path"  # an ending in common is no likeness


@pytest.mark.parametrize("name", ["marker8.csv", "phantom.fcsv", "phantom.mrk.json"])
def test_a_point_list_given_as_a_design(name):
    path = EXAMPLES / "fiducials" / name
    problem = problem_of(path)
    assert problem.code == "point-list"
    assert problem.line == 1
    assert problem.hint == f"put it under fiducials.file of a design: fiducials: {{file: {name}}}"
    without_file = problem_of(path.read_text()).hint  # as a service gets it, which reads no files
    assert "fiducials.points" in without_file
    assert "fiducials.file" not in without_file


def test_a_point_list_is_not_sent_in_a_circle_by_its_name(tmp_path):
    """A fiducial file has one of a few endings; what it is says its content."""
    (tmp_path / "beads.txt").write_bytes((EXAMPLES / "fiducials" / "phantom.fcsv").read_bytes())
    hint = problem_of(tmp_path / "beads.txt").hint
    assert hint == "name it so and put it under fiducials.file of a design: fiducials: {file: beads.csv}"
    (tmp_path / "beads.txt").rename(tmp_path / "beads.csv")
    data = {key: value for key, value in DEMO.items() if key != "optimise"} | {"fiducials": {"file": "beads.csv"}}
    assert load_design(data, base_directory=tmp_path).fiducials.labels


@pytest.mark.parametrize("data", ["- [1, 2, 3]\n- [4, 5, 6]\n", "- position_mm: [1, 2, 3]\n", "points:\n- [1, 2, 3]\n"])
def test_points_that_somebody_wrote(data):
    assert problem_of(data).code == "point-list"


def test_yaml_in_a_file_called_json(tmp_path):
    path = tmp_path / "design.json"
    path.write_text(TEXT)
    problem = problem_of(path)
    assert (problem.code, problem.line) == ("json-syntax", 1)
    assert "looks like YAML" in problem.hint
    path.write_text("[1, 2")
    assert problem_of(path).hint == ""


@pytest.mark.parametrize(("schema", "cure"), read_cases("design", "other_documents"))
def test_another_document_than_a_design(schema, cure):
    problem = problem_of(f"name: x\nschema: {schema}\n")
    assert (problem.pointer, problem.code, problem.line) == ("/schema", "unsupported-schema", 2)
    assert cure in problem.hint


def test_every_slip_of_every_field_has_a_cure_that_helps() -> None:
    """Each example of each field of each record, and all ways to write it wrongly."""
    obeyed, total = walk_slips(DesignDocument)
    assert obeyed > 1400, (obeyed, total)


def test_fields_that_exclude_or_need_each_other_are_told_what_helps() -> None:
    """Each record with what it needs, and with every one and every two of its other fields."""
    obeyed = total = 0
    for record in records_below(DesignDocument):
        needed = sample_of(record)
        others = {
            name: info.examples[0] if info.examples else sample_of(info.annotation)
            for name, info in fields_of(record).items() if not info.is_required()
        }  # fmt: skip
        for more in [(), *combinations(others, 1), *combinations(others, 2)]:
            data = needed | {name: others[name] for name in more}
            for problem in refused(record, data):
                if problem.hint:
                    total += 1
                    obeyed += check_obeyed(data, problem, partial(refused, record))
    assert obeyed > 50, (obeyed, total)


def judge_design(data: Any) -> tuple[Problem, ...]:
    try:
        check_design(load_design(data))
    except TailstackError as error:
        return error.problems
    return ()


SCENES = [
    *(replaced(DEMO, path, value) for path, value, *_ in test_design_refusals.CASES),
    *(replaced(document, path, value) for document, path, value, *_ in GIVEN),
    *(yaml.safe_load(TEXT.replace(old, new, 1)) for old, new, *_ in TYPED if ",05" not in new),
]


def test_the_hints_of_the_suite_s_own_scenes_are_obeyed() -> None:
    obeyed = 0
    for data in SCENES:
        for problem in judge_design(data):
            if problem.hint:
                obeyed += check_obeyed(data, problem, judge_design)
    assert obeyed >= 20, obeyed
