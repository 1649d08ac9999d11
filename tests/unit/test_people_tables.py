"""Tables as people have them: no row and no number goes in silence, whoever wrote the file.

What is right was worked out by hand from the files of tests/data/people_tables and the definitions of their formats.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import pytest

from plain_data import DEMO, REMOVED, problems_of, read_cases, replaced
from tailstack.cures import cure_text
from tailstack.design import check_design, load_design
from tailstack.design.fiducial_files import FiducialList, read_fiducials
from tailstack.design.reading import DEFAULT_LIMITS
from tailstack.errors import DesignError, TailstackError
from tailstack.integrations.conversion import convert
from tailstack.people_tables import read_people_table, split_heading
from tailstack.studies.bench.file import read_measurements

FILES = Path(__file__).parents[1] / "data" / "people_tables"
BEADS = (
    (-25, -28, -70), (28, -22, -64), (-22, 30, -66), (24, 26, -72),
    (-28, -24, -30), (22, -30, -22), (-30, 24, -26), (30, 22, -18),
)  # fmt: skip
LABELS = tuple(f"A{k}" for k in range(1, 9))


def read_file(name: str) -> FiducialList:
    return read_fiducials((FILES / name).read_bytes(), name, DEFAULT_LIMITS)


def read(text: str | bytes, name: str = "b.csv") -> FiducialList:
    return read_fiducials(text if isinstance(text, bytes) else text.encode(), name, DEFAULT_LIMITS)


def refused(text: str | bytes, name: str = "b.csv") -> tuple[int | None, str, str]:
    """Line, detail and hint."""
    problem = problems_of(read, text, name, error=DesignError)[0]
    return problem.line, problem.detail, problem.hint


# --- Slicer -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "left_out"), [
    ("good.fcsv", ()), ("one.fcsv", ("A9",)), ("two.fcsv", ("A9", "A10 (missing)")), ("slicer3.fcsv", ()),
    ("lps.csv", ()), ("points.json", ()), ("savetxt.csv", ()),
])  # fmt: skip
def test_the_same_eight_beads(name: str, left_out: tuple[str, ...]) -> None:
    found = read_file(name)
    assert found.positions_mm == BEADS
    assert found.labels == (LABELS if name != "savetxt.csv" else tuple(f"F{k}" for k in range(1, 9)))
    assert tuple(found.origin.left_out) == left_out
    assert all(any(label in note for note in found.notes) for label in left_out)


FCSV = "# Markups fiducial file version = 5.2\n# CoordinateSystem = LPS\n"
FCSV += "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"


@pytest.mark.parametrize(("row", "said"), read_cases("tables", "fcsv"))
def test_a_row_of_fcsv_has_the_cells_of_its_format(row: str, said: str | None) -> None:
    if said is None:
        assert read(FCSV + row, "b.fcsv").positions_mm == ((1, 2, 3),)
    else:
        line, detail, hint = refused(FCSV + row, "b.fcsv")
        assert (line, bool(hint)) == (4, True)
        assert said in detail


def test_a_name_may_stand_in_the_id_of_fcsv_and_a_remark_is_counted() -> None:
    rows = "tip,1,2,3,0,0,0,1,1,1,0,,,,2,0\nvtkMRMLMarkupsFiducialNode_1,4,5,6,0,0,0,1,1,1,0,,,,2,0\n"
    assert read(FCSV + rows, "b.fcsv").labels == ("tip", "F2")
    found = read(FCSV + "# measured anew\n1,1,2,3,0,0,0,1,1,1,0,A,,,2,0\n", "b.fcsv")
    assert any("1 row was left out" in note and "line 4" in note for note in found.notes)


@pytest.mark.parametrize(("columns", "row", "said"), [
    ("id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID,positionStatus,autoCreated",
     "1,1,2,3,0,0,0,1,1,1,0,A,,,2,0\n2,0,0,0,0,0,0,1,1,1,0,B,,,0,0", ""),
    ("label,x,y,z,sel,vis,positionStatus", "A,1,2,3,1,1,2\nB,0,0,0,1,1,0", "'positionstatus'"),
    ("label,x,y,z,x", "A,1,2,3,4", "repeated column 'x'"),
])  # fmt: skip
def test_columns_that_fcsv_names_are_known_or_refused(columns: str, row: str, said: str) -> None:
    """A column of states that was passed over made points that are not placed beads."""
    text = f"# CoordinateSystem = LPS\n# columns = {columns}\n{row}\n"
    if said:
        assert said in refused(text, "b.fcsv")[1]
        return
    found = read(text, "b.fcsv")
    assert found.labels == ("A",)
    assert any("B" in note for note in found.notes)


def test_slicer_s_table_says_its_system_and_what_is_defined() -> None:
    text = "label\tr\ta\ts\tdefined\tselected\tvisible\tlocked\tdescription\n"
    text += "A\t1\t2\t3\t1\t1\t1\t0\t\nB\t0\t0\t0\t0\t1\t1\t0\t\n"
    found = read(text, "b.tsv")
    assert (found.labels, found.positions_mm) == (("A",), ((-1, -2, 3),))
    assert any("B" in note for note in found.notes)
    assert any("RAS" in note for note in found.notes)
    assert "LPS" in refused("# CoordinateSystem = RAS\n" + "label,l,p,s\nA,1,2,3\n")[1]


def test_content_says_what_a_file_is_and_a_refusal_what_was_left_out() -> None:
    content = (FILES / "points.json").read_bytes()
    assert read(content, "points.csv").positions_mm == BEADS
    assert convert(content, "points.json", "b.csv").fiducials.positions_mm == BEADS
    assert read((FILES / "good.fcsv").read_bytes(), "good.csv").positions_mm == BEADS
    data = replaced(replaced(DEMO, ("optimise",), REMOVED), ("fiducials",), {"file": "some.mrk.json"})
    said = " ".join(map(str, problems_of(check_design, load_design(data, base_directory=FILES))))
    assert "5 points were left out" in said
    assert "A4 (preview)" in said


def test_files_of_another_kind_are_told_what_they_are() -> None:
    content = (FILES / "points.json").read_bytes().replace(b'"type": "Fiducial"', b'"type": "ClosedCurve"')
    assert any("ClosedCurve" in note for note in read(content, "points.mrk.json").notes)
    # And not that curl dropped its line ends: Slicer's files may be one line.
    markup = {"type": "Fiducial", "controlPoints": [{"label": "A", "positionStatus": "preview"}]}
    _, detail, hint = refused(json.dumps({"markups": [markup]}), "b.mrk.json")
    assert (detail[-11:], hint) == ("A (preview)", "place the points and save the file again")
    _, detail, hint = refused("".join(f"{k},{k / 3}\n" for k in range(11)))
    assert "a column for each camera as DLTdv has them" in detail
    assert hint.endswith("[[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 1]]")


# --- rows that begin with #, what is missing --------------------------------------------------------------


def test_beads_are_named_and_units_stated_in_many_ways() -> None:
    found = read_file("some_hash.csv")
    assert (len(found.labels), found.labels[-2:]) == (10, ("#9", "#10"))
    assert found.notes == ()
    assert {split_heading(cell) for cell in ("X_mm", "x [mm]", "x (mm)", "x/mm", "x mm")} == {("x", "mm")}
    assert split_heading("error_x_\N{GREEK SMALL LETTER MU}m") == ("error_x", "µm")
    assert split_heading("trial no") == ("trial no", "")
    # closed form: an inch is 25.4 mm; - and 1 are what a column without a unit has.
    rows = "label;x;y;z\n-;in;in;in\nA;1,5;2;3\n"
    assert read(rows).positions_mm == ((38.1, 50.8, 76.2),)
    measured = read_measurements(f"{rows.replace('label', 'trial')}B;1;2;3\nC;1;2;4\n".encode(), ("tip",), "b.csv")
    assert measured.groups[0].values_mm[0].tolist() == [1.5 * 25.4, 2 * 25.4, 3 * 25.4]


def test_a_row_with_the_cells_of_the_header_is_data_or_refused() -> None:
    header = "trial,error_mm\n"
    found = read_measurements(f"{header}#1,1\n#2,2\n#3,3\n# stopped here\n".encode(), ("tip",), "b.csv")
    assert found.rows == 3
    assert any("1 row was left out" in note and "line 5" in note for note in found.notes)
    for row in ("# 4,4", "#REF!,", "4,#REF!"):
        content = f"{header}1,1\n2,2\n3,3\n{row}\n".encode()
        assert problems_of(read_measurements, content, ("tip",), "b.csv")[0].line == 5


@pytest.mark.parametrize(("above", "line"), [
    ("# A9,1,2,3\nlabel,x_mm,y_mm,z_mm\n", 1), ("#A9,1,2,3\nlabel,x_mm,y_mm,z_mm\n", 1),
    ("# label,x_mm,y_mm,z_mm\n\"A9,1,2,3\n", 2), ("\"A9,1,2,3\nlabel,x_mm,y_mm,z_mm\n", 1),
])  # fmt: skip
def test_a_row_above_the_others_is_no_remark_and_no_title(above: str, line: int) -> None:
    assert refused(above + "A1,1,2,3\nA2,4,5,6\n")[0] == line


# --- spreadsheets -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "line", "cure"), read_cases("tables", "two_meanings"))
def test_what_can_be_meant_in_two_ways_is_refused(text: str, line: int, cure: str) -> None:
    found, _, hint = refused(text)
    assert found == line
    assert cure in hint


@pytest.mark.parametrize("label", ["mean", "Std. Dev.", "Mittelwert:", "TOTAL", "max"])
def test_a_row_that_sums_up_the_others_is_no_fiducial_and_no_trial(label: str) -> None:
    """It lowered P95 from 0.59 mm to 0.44, and was a trial of a bench."""
    line, _, hint = refused(f"label,x_mm,y_mm,z_mm\nA,1,2,3\nB,2,3,4\n{label},1.5,2.5,3.5\n")
    assert (line, hint) == (4, "delete the row, or call it otherwise")
    with pytest.raises(TailstackError, match="would count as one more trial"):
        read_measurements(f"trial,x_mm,y_mm,z_mm\n1,1,2,3\n{label},1,2,3\n".encode(), ("tip",), "bench.csv")
    assert read_fiducials(b"label,x_mm,y_mm,z_mm\nmean 1,1,2,3\n", "b.csv", DEFAULT_LIMITS).labels == ("mean 1",)


@pytest.mark.parametrize("text", [
    "±0.05", "± 0.05", "+/-0.05", "+/- 0.05", "+-0.05", "-/+0.05", "0.05 ±", "0.05±", "0.05 +/-", "±0.05 mm", "±0,05",
    "±.05", "0 ± 0.05", "\u22130.05",
])  # fmt: skip
def test_a_tolerance_with_its_sign_is_cured_as_it_is_then_read(text: str) -> None:
    """The number that is named is taken where the text stood; elsewhere none is named that would be taken for another
    thing."""
    at = ("fiducials", "manufacturing", "half_width_mm")
    [problem] = problems_of(load_design, replaced(DEMO, at, text), error=DesignError)
    written = re.search(r"write (\S+)$", problem.hint)
    assert written is not None, problem.hint
    obeyed = load_design(replaced(DEMO, at, float(written[1])))
    assert obeyed.document.fiducials.manufacturing.half_width_mm == 0.05
    assert "write" not in cure_text(text, "x_mm") or text.startswith("0 ")
    assert "half-width: 0.05" in cure_text(text, "x_mm")


@pytest.mark.parametrize(("text", "field", "cure"), [
    ("28.5 ± 0.05", "x_mm", "the value alone: write 28.5; ±0.05"), ("-3±0.1", "targets.tip.position_mm.0", "write -3;"),
    ("3 ± 0.05", "half_width_mm", "write 0.05"), ("±0.0123456789", "half_width_mm", "write 0.0123456789"),
    ("±0.3", "views.AP.fiducial_noise_px", "if ±0.3 is one standard deviation, write 0.3"),
    ("±1,234", "half_width_mm", "no quotes"), ("±0.05°", "half_width_mm", "no quotes"),
    ("0.05 max", "half_width_mm", "write 0.05"), ("max. 0,05 mm", "half_width_mm", "write 0.05"),
    ("≤0.05°", "half_width_deg", "write 0.05"), ("≤0.05°", "half_width_mm", "no quotes"),
    ("Ø0.05", "half_width_mm", "half-width 0.025"), ("0.05 mm", "half_width_mm", "no quotes"),
    ("±0.05°", "half_width_deg", "write 0.05"), ("+0.1234567/-0", "half_width_mm", "bias 0.06172835,"),
    ("0" + 59 * "9", "half_width_mm", 59 * "9"), ("+0.1/-0", "half_width_mm", "bias 0.05, half-width 0.05"),
    ("+0,1 / -0,3", "half_width_mm", "bias -0.1, half-width 0.2"),
    ("-0.05/+0.1", "half_width_mm", "bias 0.025, half-width 0.075"),
    ("+0.021/0", "half_width_mm", "bias 0.0105, half-width 0.0105"),
    ("0/-0.1", "half_width_mm", "bias -0.05, half-width 0.05"), ("1'234.5", "half_width_mm", "1234.5"),
    ("+0.03 +0.01", "half_width_mm", "bias 0.02, half-width 0.01"), ("1,234", "half_width_mm", "1.234 or 1234"),
    ("0,3", "half_width_mm", "0.3"), ("1e5", "trials", "write 100000"), ("2.5e-7", "x_mm", "write 2.5e-7"),
    ("1e300", "trials", "write 1e300"),
])  # fmt: skip
def test_cures_of_cells_and_of_values_with_their_tolerance(text: str, field: str, cure: str) -> None:
    assert cure in cure_text(text, field)


@pytest.mark.parametrize("made", [
    {"upper_mm": 0.1, "lower_mm": -0.02}, {"plus": 0.1, "minus": 0.02}, {"max": 0.1, "min": -0.02},
    {"half_width_mm": {"upper": 0.1, "lower": -0.02}}, {"half_width_mm": "(+0.1/-0.02)"},
])  # fmt: skip
def test_limits_of_a_zone_are_cured_with_their_numbers(made: dict[str, Any]) -> None:
    """closed form: +0.1 / -0.02 has its middle at 0.04 and is 0.12 wide."""
    problems = problems_of(load_design, replaced(DEMO, ("fiducials", "manufacturing"), made), error=DesignError)
    assert any("bias 0.04, half-width 0.06" in problem.hint for problem in problems)


def test_what_looks_like_no_slip_has_no_cure() -> None:
    """A box where a zone could stand is named, and a number of a thousand digits is not written again."""
    box = {"min_mm": [-45, -45, -85], "max_mm": [45, 45, 15]}
    problems = problems_of(load_design, replaced(DEMO, ("fiducials", "points", 8), box), error=DesignError)
    assert {problem.pointer for problem in problems} >= {f"/fiducials/points/8/{name}" for name in box}
    assert cure_text("0" + 1000 * "9", "x_mm") == ""


def test_rows_are_read_as_they_are_asked_for() -> None:
    """A million rows are never in memory together."""

    class Endless(io.RawIOBase):
        given = 0

        def readable(self) -> bool:
            return True

        def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
            text = (b"a,b\n" if not self.given else b"") + b"1,2\n" * (len(buffer) // 4 - 1)
            self.given += len(text)
            buffer[: len(text)] = text
            return len(text)

    stream = Endless()
    table = read_people_table(io.BufferedReader(stream), "b.csv", DesignError)
    assert next(table.rows) == (2, ["1", "2"])
    assert stream.given < 1_000_000
