"""XMALab: calibration cages in and out, with units, scales and references; its cameras as views.

``as_xmalab_reads`` follows the rules by which XMALab 2.2 loads the two files of a cage (first line passed over, cells
split at every comma, references as a number and a name), and shares no code with the reader here. Cameras are held
against pixels that are worked out from the numbers of the file.
"""

from __future__ import annotations

import pytest

from plain_data import EXAMPLES, problems_of, read_cases
from tailstack.design import load_design
from tailstack.design.fiducial_files import FiducialList, read_fiducials
from tailstack.design.reading import DEFAULT_LIMITS
from tailstack.errors import DesignError
from tailstack.integrations.calibration_cages import CageForm, read_cage, write_cage, write_references

REF = b"1 circle\n2 square\n3 big cross\n5 triangle\n"
BEADS = "x,y,z\n0,0,0\n6.4,0,0\n0,6.4,0\n0,0,6.4\n6.4,6.4,6.4\n"


def as_xmalab_reads(frame: str, references: str) -> tuple[list[tuple[float, float, float, str]], dict[int, str]]:
    beads = []
    for line in frame.split("\n")[1:]:
        if line:
            x, y, z, *names = line.split(",")
            beads.append((float(x), float(y), float(z), names[0] if names else ""))
    marked: dict[int, str] = {}
    for line in references.split("\n"):
        if line:
            number, _, name = line.partition(" ")
            marked[int(number) - 1] = name
    return beads, marked


def read(text: str, unit: str = "cm", references: bytes | None = REF) -> FiducialList:
    given = None if references is None else (references, "cube.ref")
    return read_cage(text.encode(), "cube.csv", CageForm(unit, given), DEFAULT_LIMITS)  # type: ignore[arg-type]


def refused(text: str, references: bytes | None = REF) -> tuple[str, str, int, str]:
    problem = problems_of(read, text, references=references, error=DesignError)[0]
    return problem.code, problem.file, problem.line, problem.hint


def test_a_cage_is_read_in_millimetres_and_its_beads_by_their_names_or_shapes() -> None:
    cage = read(BEADS)
    assert cage.labels == ("circle", "square", "big cross", "F4", "triangle")
    assert cage.positions_mm[4] == (64.0, 64.0, 64.0)
    assert cage.notes == ("cube.csv: coordinates were converted to mm (factor 10)",)
    assert (cage.origin.coordinate_unit, cage.origin.coordinate_system) == ("cm", "LPS")
    assert read(BEADS, "mm").positions_mm[4] == (6.4, 6.4, 6.4)
    assert read("white\n0,0,0,a\n1,0,0\n0,1,0,c \n0,0,1\n1,1,1,e\n").labels == ("a", "square", "c", "F4", "e")
    assert read("s2,s10,s0.5,white\n1,1,1\n", "mm", None).positions_mm == ((2.0, 10.0, 0.5),)
    assert read("s2,s10,x,white\n1,1,1\n", "mm", None).positions_mm == ((1.0, 1.0, 1.0),)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("cm", 10.0)])
def test_there_and_back_through_both_files(unit, scale):
    labels = ("circle", "F2", "square", "cross", "triangle", "F6")
    points = tuple((1.1 * k, -7.3 + k * k, 0.1 * k) for k in range(6))
    beads = FiducialList(labels, points)
    frame = write_cage(beads, unit)
    references = write_references(beads, ("square", "circle", "triangle", "cross"), "cube.ref")
    seen, marked = as_xmalab_reads(frame, references)
    assert [name for *_, name in seen] == list(labels)
    assert marked == {0: "circle", 2: "square", 4: "triangle", 3: "cross"}
    assert list(marked) == [2, 0, 4, 3]  # the pose is taken in this order
    for (x, y, z, _), point in zip(seen, points, strict=True):
        assert (scale * x, scale * y, scale * z) == pytest.approx(point, abs=1e-13)
    again = read(frame, unit, references.encode())
    assert again.labels == labels
    assert [p == pytest.approx(q, abs=1e-13) for p, q in zip(again.positions_mm, points, strict=True)] == [True] * 6
    plain = read_fiducials(frame.encode(), "cube.csv", DEFAULT_LIMITS)  # its first line states the unit
    assert (plain.labels, plain.positions_mm) == (again.labels, again.positions_mm)


@pytest.mark.parametrize(("text", "code", "line", "cure"), read_cases("tables", "cages"))
def test_what_xmalab_would_misread_is_refused_with_the_cure(text, code, line, cure):
    found = refused(text, None)
    assert found[:3] == (code, "cube.csv", line)
    assert cure in found[3]


@pytest.mark.parametrize(
    ("references", "code", "line", "cure"),
    [
        (b"1,circle\n2,square\n3,cross\n4,x\n", "reference-row", 1, "write it like: 1 circle"),
        (b"1 circle\n2;square\n", "reference-row", 2, "write it like: 1 circle"),
        (b"circle 1\n", "reference-row", 1, "write it like: 1 circle"),
        (b"1 circle\n2 a name that is longer than twenty\n", "reference-row", 2, "write it like: 1 circle"),
        (b"0 circle\n", "reference-row", 1, "the first bead has number 1"),
        (b"1 circle\n6 square\n", "reference-row", 2, "the first bead has number 1"),
        (b"1 circle\n1 square\n", "reference-row", 2, "the first bead has number 1"),
        (b"1 circle\n2 square\n3 cross\n", "too-few-references", None, "not all in one plane"),
    ],
)
def test_references_with_wrong_separators_or_beads_are_refused_with_the_cure(references, code, line, cure):
    found = refused(BEADS, references)
    assert found[:3] == (code, "cube.ref", line)
    assert cure in found[3]


@pytest.mark.parametrize(("marked", "code"), read_cases("tables", "references"))
def test_references_that_xmalab_could_not_use_are_not_written(marked, code):
    beads = FiducialList(("A", "B", "C", "D_1"), ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
    assert problems_of(write_references, beads, marked, "cube.ref", error=DesignError)[0].code == code


def test_a_label_with_a_comma_is_not_written():
    with pytest.raises(DesignError, match="splits at every comma"):
        write_cage(FiducialList(("A, left",), ((0.0, 0.0, 0.0),)), "mm")


def test_the_lego_cube_has_64_beads_64_mm_apart_four_of_them_marked():
    folder = EXAMPLES / "integrations" / "xmalab"
    frame, references = ((folder / f"lego_cube.{ending}").read_text() for ending in ("csv", "ref"))
    seen, marked = as_xmalab_reads(frame, references)
    steps = (0.0, 6.4, 12.8, 19.2)  # cm: a lattice of 4 x 4 x 4, 192 mm wide, as its makers describe it
    assert sorted((x, y, z) for x, y, z, _ in seen) == [(x, y, z) for x in steps for y in steps for z in steps]
    assert sorted(marked.values()) == ["circle", "cross", "square", "triangle"]
    design = load_design(folder / "lego_cube.yaml")
    assert len(design.fiducials.labels) == 64
    assert max(max(point) for point in design.fiducials.positions_mm) == pytest.approx(192.0)
