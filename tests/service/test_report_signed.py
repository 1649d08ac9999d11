"""A report is a document that somebody signs: title block, what nobody stated, the beads as drawn, the yield beside the
verdict, and numbers as numbers in a spreadsheet.  Pages are read back by other libraries than those that wrote them."""

from __future__ import annotations

import io
import os
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import openpyxl
import pytest
from pypdf import PdfReader
from service_scenes import EXAMPLES, limited, write_json
from test_report_figures import check_picture, distribution, texts
from test_report_rendering import Page

from family import COMMAND, SOURCES, run_python
from tailstack import load_design, score, verify
from tailstack.sweeping import read_axes, sweep
from tailstack_service.audit import audit, read_report
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.charts import draw_budgets, draw_distribution, draw_shares
from tailstack_service.report.comparing import compute_comparison
from tailstack_service.report.records import ErrorDistribution

BLOCK = {"number": "DG-1042", "revision": "C", "date": "2026-11-28", "author": "M. Keller"}

WORDS = ("Document", "Revision", "Date", "Author", "Checked", "Approved")

ASSUMED = ["/interfaces", "/targets/0/position_mm", "/views/0/fiducial_noise_px"]

FEW = ReportContents(trials=20_000, seed=3)

NUMBER = re.compile(r"[-+−]?\d[\d,]*(\.\d+)?(e[-+]\d+)?( (mm|px|%|deg))?")


def designs() -> tuple[dict[str, Any], dict[str, Any]]:
    plain = limited(0.9)
    return plain, {**plain, "document": BLOCK, "assumed": ASSUMED}


@cache
def results() -> dict[str, Any]:
    """Of every kind that is of designs: its name as a record, and a result whose design says everything."""
    plain, signed = map(load_design, designs())
    axes = read_axes(signed, [{"pointer": "/views/0/fiducial_noise_px", "values": [0.2, 0.3]}])
    return {
        "report": compute_report(signed, FEW), "score": score(signed), "verification": verify(signed, trials=20_000),
        "comparison": compute_comparison(plain, signed, FEW), "sweep": sweep(signed, axes),
    }  # fmt: skip


def page(kind: str) -> str:
    html = render(kind, to_json(results()[kind]), "html").replace(b"<wbr>", b"")  # where a name may be broken
    return " ".join(" ".join(Page(html).texts).split())


@pytest.mark.parametrize("kind", ["report", "score", "verification", "comparison", "sweep"])
def test_every_page_has_the_title_block_and_says_what_nobody_stated(kind: str) -> None:
    text = page(kind)
    for entry in BLOCK.values():
        assert entry in text
    assert re.search(" .*".join(WORDS), text)
    count = len(score(load_design(designs()[1])).provenance.assumed)
    assert f"on {count} assumed values" in text
    assert "What nobody stated" in text
    assert re.search("interfaces[/.]structure_connector[/.]tolerances[/.]rx[/.]half_width_deg", text)


def test_what_the_design_does_not_say_is_a_box_to_sign() -> None:
    html = render("score", to_json(score(load_design(designs()[0]))), "html").decode()
    assert html.count('<div class="open"><dt>') == len(WORDS)
    assert "assumed value" not in html
    signed = render("score", to_json(results()["score"]), "html").decode()
    assert signed.count('<div class="open"><dt>') == len(WORDS) - len(BLOCK)
    table = signed.partition('<table class="approval">')[2].partition("</table>")[0]
    assert re.findall(r"<th scope=\"col\">(\w+)", table) == ["Role", "Name", "Date", "Signature"]
    rows = re.findall(r'<th scope="row">(\w+)</th><td>(.*?)</td><td></td><td></td>', table)
    assert rows == [("Author", BLOCK["author"]), ("Checked", ""), ("Approved", "")]


# --- one page -------------------------------------------------------------------------------------


def demanding(count: int, long: int) -> dict[str, Any]:
    """Requirements and a title block that is full; where all is six times as long, as long as it may be."""
    asked = [
        {
            "name": f"{k} " + "requirement " * long,
            "limit_mm": 0.2 + k / 9,
            "ids": [f"SYS-REQ-{k}-{j}" for j in range(long)],
        }
        for k in range(count)
    ]
    people = dict.fromkeys(("number", "revision", "author", "checker", "approver"), "M. Weber" * long)
    block = {"date": "2026-11-28"} | people
    return limited(0.9) | {"requirements": asked, "document": block, "name": "drill guide " * long}


@pytest.mark.long("1-6")
@pytest.mark.parametrize(("count", "long"), [(1, 6), (26, 1)])
def test_a_summary_is_one_page_whatever_the_design_asks_for(count: int, long: int) -> None:
    """Rows go first; where a single one is too long for a page, all of it is smaller."""
    body = to_json(score(load_design(demanding(count, long))))
    content = render("score", body, "pdf", summary=True)
    (only,) = PdfReader(io.BytesIO(content)).pages
    assert [round(float(length)) for length in only.mediabox[2:]] == [595, 842], "A4, points"
    text = " ".join(only.extract_text().split())
    for words in ("Approval", "Signature", "Document", "0 requirement", "SYS-REQ-0-0", "SHA-256 of this record"):
        assert words in text
    assert ("more rows are in the spreadsheet" in text) == (count > 1)
    assert read_report(content, "x").result.body == body


@pytest.mark.long
def test_a_summary_of_every_kind_is_one_page() -> None:
    for kind, result in results().items():
        content = render(kind, to_json(result), "pdf", summary=True)
        assert len(PdfReader(io.BytesIO(content)).pages) == 1, kind


def test_a_summary_is_a_pdf(tmp_path: Path, refused: Any) -> None:
    file = tmp_path / "score.json"
    file.write_bytes(to_json(results()["score"]))
    for more, words in (
        (("--format", "html"), "--summary is a page of PDF; got html"),
        (("-o", str(tmp_path / "a.xlsx")), "--summary is a page of PDF; got xlsx"),
        (("--verify",), "a report is verified as it is"),
    ):
        assert words in refused("report", file, "--summary", *more)
    assert main(["report", str(file), "--summary", "-o", str(tmp_path)]) == 0
    content = (tmp_path / "score.summary.pdf").read_bytes()
    assert {each.what: each.answer for each in audit(content, "x", fast=True).questions}["pages"] == "same"


def test_the_beads_are_listed_as_drawn() -> None:
    design = load_design(designs()[1])
    book = openpyxl.load_workbook(io.BytesIO(render("report", to_json(results()["report"]), "xlsx")))
    head, *rows = list(book["Beads"].iter_rows(min_row=2, values_only=True))
    assert head[:7] == ("Bead", "x, mm", "y, mm", "z, mm", "x ±, mm", "y ±, mm", "z ±, mm")
    made = design.document.fiducials.manufacturing
    assert made is not None
    listed = {row[0]: row[1:7] for row in rows if row[0] in design.fiducials.labels}
    assert listed == {
        label: pytest.approx((*at, *(made.half_width_mm,) * 3), rel=1e-14)
        for label, at in zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True)
    }
    assert str(made.distribution) in page("report")


@pytest.mark.parametrize("kind", ["report", "score", "verification", "comparison", "sweep"])
def test_no_cell_of_a_spreadsheet_holds_a_number_as_a_text(kind: str) -> None:
    """But for names: labels, revisions and hashes are texts whatever they look like."""
    book = openpyxl.load_workbook(io.BytesIO(render(kind, to_json(results()[kind]), "xlsx")))
    texts = [
        (sheet.title, cell.coordinate, cell.value)
        for sheet in book.worksheets
        if sheet.title not in ("Record", "Provenance") and not sheet.title.startswith("Design")
        for row in sheet.iter_rows()
        for cell in row
        if isinstance(cell.value, str) and NUMBER.fullmatch(cell.value)
    ]
    assert texts == []
    values = {cell.value for row in book["Summary"].iter_rows() for cell in row}
    assert any(isinstance(value, float) for value in values)


def test_the_yield_stands_beside_the_verdict_of_every_score() -> None:
    design = limited(0.9)
    html = page("score")
    unit = score(load_design(design)).targets[0].per_unit
    assert unit.yield_fraction is not None
    assert f"{100 * unit.yield_fraction:.1f} %" in html.partition("What matters")[0]
    free = {**design, "requirements": []}
    free.pop("optimise", None)
    text = " ".join(Page(render("score", to_json(score(load_design(free))), "html")).texts)
    assert "P95 that 95 % of units keep" in text.partition("What matters")[0]


# --- the same bytes -------------------------------------------------------------------------------


ENVIRONMENTS = (
    {"PYTHONHASHSEED": "1", "TZ": "UTC", "LC_ALL": "C"},
    {"PYTHONHASHSEED": "2", "TZ": "Asia/Tokyo", "LC_ALL": "C.UTF-8", "NUMBA_NUM_THREADS": "1"},
)


@pytest.mark.long
def test_processes_that_differ_write_the_same_bytes(tmp_path: Path) -> None:
    """Files of one design, written by processes that differ in what a report must not show."""
    design = write_json(tmp_path / "design.json", limited(0.9))
    written = []
    for number, environment in enumerate(ENVIRONMENTS):
        folder = tmp_path / str(number)
        asked = ("report", design, "--trials", "4000", "--format", "html,pdf,xlsx,json", "-o", folder)
        done = run_python(*COMMAND, *asked, said=environment)
        assert done.returncode in (0, 1, 4), done.stderr
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert sorted(written[0]) == ["design.html", "design.pdf", "design.report.json", "design.xlsx"]
    assert written[0] == written[1]


# --- charts ---------------------------------------------------------------------------------------


LONG = " ".join(f"adapter{k} of the carrier on its third spigot" for k in range(5))  # two hundred letters

SHOWN = ErrorDistribution("tip $a$", (0.0, 0.5, 1.0, 1.5), (0.5, 0.3, 0.2), (0.48, 0.31, 0.21), 5000)

DRAW = f"""
import sys
from tailstack_service.report.charts import draw_distribution
from tailstack_service.report.records import ErrorDistribution
sys.stdout.write(draw_distribution({SHOWN!r}, 0.87, (0.85, 0.89), 1.0, "d"))
"""


@pytest.mark.long
def test_neither_a_home_that_cannot_be_written_nor_settings_beside_the_design_change_a_chart(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("font.size: 31\nlines.linewidth: 9\naxes.facecolor: red\n")
    kept = {name: value for name, value in os.environ.items() if name not in ("MPLCONFIGDIR", "XDG_CACHE_HOME")}
    told = {"PYTHONPATH": SOURCES, "PYTHONUTF8": "1", "HOME": "/proc/nobody", "XDG_CONFIG_HOME": "/proc/nobody"}
    drawn = run_python("-c", DRAW, env={**kept, **told}, cwd=tmp_path, check=True)
    assert drawn.stderr == ""
    assert drawn.stdout == draw_distribution(SHOWN, 0.87, (0.85, 0.89), 1.0, "d")
    assert [path.name for path in tmp_path.iterdir()] == ["matplotlibrc"]


def test_settings_of_matplotlib_are_as_they_were() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw_distribution(distribution("tip", 0.5), 0.87, None, None, "d")
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("target", ["tip", "Spitze der Nadel, 针尖", "a $x_1$ \\frac b"])
def test_looks_stand_in_attributes(target: str) -> None:
    """The content security policy lets neither style attributes nor references to other files count."""
    svg = draw_distribution(distribution(target, 0.5), 0.87, (0.85, 0.89), 1.0, "d")
    check_picture(svg)
    assert target in svg
    assert not re.search(r"style=|<style|<use|href|<image|<!DOCTYPE|metadata", svg)


def words_of(svg: str) -> str:
    return " ".join(words for words, *_ in texts(check_picture(svg)))


def test_a_long_name_is_whole_and_hides_nothing() -> None:
    design = load_design(EXAMPLES / "demo.yaml")
    target = score(design).targets[0]
    renamed = tuple(replace(entry, label=LONG) if entry.name == "hand_eye" else entry for entry in target.contributors)
    assert f"{LONG} tx" in words_of(draw_shares(renamed, "tip"))
    assert f"{LONG} tx" in words_of(draw_budgets(target, replace(target, contributors=renamed)))
