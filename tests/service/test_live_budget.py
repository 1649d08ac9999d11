"""The sheets What if of a report: their formulas, evaluated here, against the printed numbers and against new scores.

independent: formulas are read back by openpyxl and evaluated by the few lines below, not by who wrote them.
"""

from __future__ import annotations

import io
import re
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
from service_scenes import convert_by_libreoffice, limited, small_design

from tailstack import load_design, score
from tailstack.results import Contributor, TargetScore
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.records import Report

FUNCTIONS = {
    "SQRT": np.sqrt, "MAX": max, "MIN": min, "SUM": np.sum, "SUMSQ": lambda cells: np.sum(cells**2),
    "SUMPRODUCT": lambda first, second: np.sum(first * second), "IF": lambda test, yes, no: yes if test else no(),
}  # fmt: skip


class Sheet:
    """A sheet whose cells may be changed; numbers that hang on them are computed anew."""

    def __init__(self, content: bytes, name: str = "What if") -> None:
        texts, values = (openpyxl.load_workbook(io.BytesIO(content), data_only=kept)[name] for kept in (False, True))
        self.cells: dict[str, Any] = {cell.coordinate: cell.value for row in texts.iter_rows() for cell in row}
        self.kept: dict[str, Any] = {cell.coordinate: cell.value for row in values.iter_rows() for cell in row}
        self.column = {cell.value.partition(",")[0]: cell.column_letter for cell in texts[2] if cell.value}
        half_widths = texts[self.column["Half-width"]][2:]
        self.entries = [cell.row for cell in half_widths if cell.value is not None]
        self.yellow = [cell.row for cell in half_widths if str(cell.fill.fgColor.rgb).endswith("FFF4C2")]
        self.last = next(cell.row for cell in texts["A"] if cell.value == "Together")

    def at(self, head: str, row: int) -> Any:
        return self.cells[f"{self.column[head]}{row}"]

    def number(self, head: str, row: int) -> float:
        return self._number(f"{self.column[head]}{row}")

    def _number(self, place: str) -> float:
        cell = self.cells[place]
        if not isinstance(cell, str):
            return float(cell or 0.0)
        assert cell.startswith("="), cell
        text = cell[1:].replace("$", "").replace("^", "**").replace("=0,0,", "==0,0,lambda:")
        text = re.sub(r"\b([A-Z])(\d+):[A-Z](\d+)", r"many('\1',\2,\3)", text)
        text = re.sub(r"(?<!['A-Z])\b([A-Z]\d+)\b", r"one('\1')", text)
        many = {"many": lambda letter, a, b: np.array([self._number(f"{letter}{k}") for k in range(a, b + 1)])}
        return float(eval(text, {"one": self._number, **many, **FUNCTIONS}))


def content_of(report: Report) -> bytes:
    return render("report", to_json(report), "xlsx")


@cache
def made(limit: float) -> tuple[Report, bytes]:
    report = compute_report(load_design(limited(limit)), ReportContents(parts=("score",)))
    return report, content_of(report)


def row_of(sheet: Sheet, words: str, component: str) -> int:
    return next(
        row for row in sheet.entries
        if words in sheet.at("Contributor", row) and (sheet.at("Component", row) or "") == component
    )  # fmt: skip


def line_of(target: TargetScore, name: str, component: str) -> Contributor:
    return next(line for line in target.contributors if (line.name, line.component) == (name, component))


@pytest.mark.parametrize("limit", [0.9, 0.6, 0.4])
def test_every_formula_comes_to_what_is_kept_beside_it_and_printed(limit: float) -> None:
    report, content = made(limit)
    sheet, target = Sheet(content), report.score.targets[0]
    computed = [place for place, cell in sheet.cells.items() if isinstance(cell, str) and cell.startswith("=")]
    assert len(computed) >= 3 * len(sheet.entries) + 4
    for place in computed:
        assert sheet._number(place) == pytest.approx(sheet.kept[place], rel=1e-9), place
    assert sheet.yellow == sheet.entries
    check = report.score.verdict.checks[0]
    assert sheet.number("Value", sheet.last) == pytest.approx(check.value, rel=1e-12)
    assert sheet.number("Limit less value", sheet.last) == pytest.approx(check.limit - check.value, rel=1e-9)
    assert sheet.number("Contribution", sheet.last) == pytest.approx(np.sqrt(np.trace(target.covariance_mm2)), rel=1e-9)
    assert sheet.number("Share of variance", sheet.last) == pytest.approx(1.0, rel=1e-9)
    for allowance in report.allowances:
        if allowance.half_width == 0:
            continue
        component = "" if allowance.component == "all" else allowance.component
        row = row_of(sheet, allowance.label, component)
        line = line_of(target, allowance.contributor, allowance.component)
        assert sheet.number("Half-width", row) == pytest.approx(allowance.half_width, rel=1e-12)
        assert sheet.number("Share of variance", row) == pytest.approx(line.variance_share, rel=1e-9, abs=1e-15)
        if allowance.at_limit is not None:
            assert sheet.number("At limit", row) == pytest.approx(allowance.at_limit, rel=1e-9)
            assert sheet.number("Slack", row) == pytest.approx(allowance.slack, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("limit", [0.9, 0.6])
def test_a_half_width_at_its_limit_brings_the_value_to_the_limit(limit: float) -> None:
    content, count = made(limit)[1], 0
    for row in Sheet(content).entries:
        sheet = Sheet(content)
        if sheet.at("At limit", row) is not None:
            sheet.cells[f"{sheet.column['Half-width']}{row}"] = sheet.number("At limit", row)
            assert sheet.number("Value", sheet.last) == pytest.approx(limit, rel=1e-9)
            assert sheet.number("Slack", row) == pytest.approx(0.0, abs=1e-9)
            others = [each for each in sheet.entries if each != row and sheet.at("At limit", each) is not None]
            for each in others:
                assert sheet.number("Slack", each) == pytest.approx(0.0, abs=1e-6), "slack is spent once"
            count += 1
    assert count >= 1


def test_changed_half_widths_give_the_shares_of_a_new_score_and_nearly_its_value() -> None:
    """Shares to nine digits, as a half-width changes no sensitivity; the value is what the sheet calls an estimate: all
    six tolerances of an interface are changed by a fifth, and by a half."""
    _, content = made(0.9)
    for factor, within in ((0.8, 0.005), (1.2, 0.005), (0.5, 0.03), (1.5, 0.03)):
        sheet, design = Sheet(content), deepcopy(limited(0.9))
        tolerances = design["interfaces"]["connector_flange"]["tolerances"]
        for component, entry in tolerances.items():
            name = next(field for field in entry if field.startswith("half_width"))
            entry[name] *= factor
            row = row_of(sheet, "connector_flange", component)
            sheet.cells[f"{sheet.column['Half-width']}{row}"] *= factor
        truth = score(load_design(design)).targets[0]
        assert sheet.number("Value", sheet.last) == pytest.approx(truth.p95_mm, rel=within)
        rss = np.sqrt(np.trace(truth.covariance_mm2))
        assert sheet.number("Contribution", sheet.last) == pytest.approx(rss, rel=1e-9)
        share = sheet.number("Share of variance", row_of(sheet, "connector_flange", "rx"))
        assert share == pytest.approx(line_of(truth, "connector_flange", "rx").variance_share, rel=1e-9)


@pytest.mark.long
def test_a_spreadsheet_program_computes_what_is_computed_here(tmp_path: Path) -> None:
    """oracle: LibreOffice, of half-widths that were all changed."""
    content, path = made(0.9)[1], tmp_path / "changed.xlsx"
    sheet, book = Sheet(content), openpyxl.load_workbook(io.BytesIO(content))
    for k, row in enumerate(sheet.entries):
        place = f"{sheet.column['Half-width']}{row}"
        book["What if"][place] = sheet.cells[place] = (0.6 + 0.2 * (k % 4)) * sheet.cells[place]
    book.save(path)
    convert_by_libreoffice(path, "xlsx", tmp_path / "computed")
    found = openpyxl.load_workbook(tmp_path / "computed" / path.name, data_only=True)["What if"]
    for place, cell in sheet.cells.items():
        if isinstance(cell, str) and cell.startswith("="):
            assert found[place].value == pytest.approx(sheet._number(place), rel=1e-9), place
    assert sheet.number("Value", sheet.last) != pytest.approx(Sheet(content).number("Value", sheet.last), rel=0.01)


def test_without_a_limit_the_sheet_tells_p95_and_no_slack() -> None:
    design = load_design(small_design(requirements=None, optimise=None))
    report = compute_report(design, ReportContents(parts=("score",)))
    sheet = Sheet(content_of(report))
    assert sheet.number("Value", sheet.last) == pytest.approx(report.score.targets[0].p95_mm, rel=1e-12)
    assert all(sheet.at("Slack", row) is None for row in sheet.entries)
    assert sheet.at("Limit", sheet.last) is None
    row = row_of(sheet, "connector_flange", "rx")
    sheet.cells[f"{sheet.column['Half-width']}{row}"] += 1e-5
    slope = (sheet.number("Value", sheet.last) - report.score.targets[0].p95_mm) / 1e-5
    line = line_of(report.score.targets[0], "connector_flange", "rx")
    assert slope == pytest.approx(line.dp95_per_unit, rel=1e-3), "as the budget prints it"
