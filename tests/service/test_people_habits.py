"""Every habit of people's tables by every reader: read, or refused with its cure; the page shows what comes of each."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from service_scenes import EXAMPLES, ROOT

from people_habits import PAGE, make_table
from tailstack import load_design
from tailstack_service.cli.main import main
from tailstack_service.problems import RequestError
from tailstack_service.tables import read_table

FILES = ROOT / "tests" / "data" / "people_tables"
DEMO, CARRIER = EXAMPLES / "demo.yaml", EXAMPLES / "integrations" / "step" / "carrier.step"


def test_no_habit_changes_a_number_in_silence_and_the_page_shows_what_becomes_of_each() -> None:
    """independent: the numbers are those that were written.  ``python tests/people_habits.py`` prints the table."""
    assert make_table() in PAGE.read_text(encoding="utf-8")


def test_decimal_commas_go_out_as_they_came_in(tmp_path: Path) -> None:
    table, back = tmp_path / "designs.csv", tmp_path / "scores.csv"
    table.write_text("variant;views.*.fiducial_noise_px\na;0,25\nb;0,5\n", encoding="utf-8")
    assert main(["score", str(DEMO), "--batch", str(table), "-o", str(back)]) == 0
    rows = [line.split(";") for line in back.read_text(encoding="utf-8").splitlines()]
    assert [row[1] for row in rows[1:]] == ["0,25", "0,5"]
    assert all("." not in cell for row in rows[1:] for cell in row)
    table.write_text("variant,views.*.fiducial_noise_px\na,0.25\nb,0.5\n", encoding="utf-8")
    assert main(["score", str(DEMO), "--batch", str(table), "-o", str(back)]) == 0
    points = [line.split(",") for line in back.read_text(encoding="utf-8").splitlines()]
    assert [[cell.replace(",", ".") for cell in row] for row in rows[1:]] == points[1:]


def test_remarks_of_a_table_of_designs_are_said(tmp_path: Path, call: Any) -> None:
    table = tmp_path / "designs.csv"
    table.write_text("variant,views.*.fiducial_noise_px\n#1,0.25\n# a remark\n#2,0.5\n", encoding="utf-8")
    code, out, said = call("score", DEMO, "--batch", table)
    assert code == 0
    assert [line.split(",")[0] for line in out.splitlines()] == ["variant", "#1", "#2"]
    assert "1 row was left out, as it begins with # and is a remark: line 3" in said


def test_units_in_a_row_are_those_of_the_fields() -> None:
    text = b"variant,views.AP.fiducial_noise_px\n,mm\na,0.3\n"
    with pytest.raises(RequestError, match="unit 'mm'"):
        read_table(io.BytesIO(text), "csv")


def test_a_step_file_in_wrong_units_is_doubted(tmp_path: Path, call: Any) -> None:
    """A carrier of 80 mm whose file says micrometres."""
    text = CARRIER.read_text(encoding="utf-8").replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.MICRO.,.METRE.)")
    (tmp_path / "small.step").write_text(text, encoding="utf-8")
    for target in ("beads.csv", "design.yaml"):
        code, _, said = call("convert", tmp_path / "small.step", "-o", tmp_path / target)
        assert (code, "the two fiducials farthest apart are" in " ".join(said.split())) == (0, True), target


def test_lost_names_of_a_step_file_are_said(tmp_path: Path, call: Any, refused: Any) -> None:
    file = tmp_path / "names.step"
    file.write_bytes(CARRIER.read_bytes().replace(b"BEAD1", "\u7403".encode("shift-jis")))
    assert "Shift-JIS" in call("convert", file, "-o", tmp_path / "design.yaml")[2]
    assert "Shift-JIS" in refused("convert", file, "--name", "BEAD?X", "-o", tmp_path / "d.yaml")


def test_points_of_slicer_are_taken_whatever_their_name(tmp_path: Path) -> None:
    for name in ("points.json", "lps.csv", "good.fcsv"):
        (tmp_path / name).write_bytes((FILES / name).read_bytes())
        assert main(["convert", str(tmp_path / name), "-o", str(tmp_path / "again.csv"), "--force"]) == 0
        made = tmp_path / "made.yaml"
        assert main(["convert", str(tmp_path / name), "--base", str(DEMO), "-o", str(made), "--force"]) == 0
        assert load_design(made).fiducials.positions_mm[0] == (-25, -28, -70)
