"""Reports: the record, and what is made of it for people.  The spreadsheet is read back by another library."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
import sys
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
from gate_scenes import judge_files
from jsonschema import Draft202012Validator
from matplotlib import font_manager
from pypdf import PdfReader
from service_scenes import EXAMPLES, convert_by_libreoffice, limited, luminance, small_design
from work_driver import run_job

from plain_data import problems_of
from tailstack import load_design, optimise, score, verify
from tailstack.results import Score
from tailstack.sweeping import read_axes, sweep
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.problems import PdfUnavailable
from tailstack_service.report import html as html_module
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.comparing import compute_comparison
from tailstack_service.report.records import Report
from tailstack_service.schemas import json_schema

HOSTILE = "<script>alert(1)</script>\"&'"
FORMULA = '=HYPERLINK("http://127.0.0.1","x")'
DIGITS = 1e-15  # a cell holds sixteen digits
VOID = {"meta", "br", "img", "link", "input", "hr", "wbr"}


rendered = cache(render)


@pytest.fixture(scope="module")
def report() -> Report:
    return compute_report(load_design(limited(0.9)), ReportContents(trials=20_000, seed=3))


@pytest.fixture(scope="module")
def body(report: Report) -> bytes:
    return to_json(report)


def hostile_design() -> dict[str, Any]:
    """Names from a stranger: markup where text is expected, and formulas."""
    design = limited(0.9, name=HOSTILE)
    design["targets"][0]["name"] = FORMULA
    design["requirements"][0]["name"] = HOSTILE
    design["views"][0]["name"] = "</svg><script>x"
    design["fiducials"]["points"][0]["label"] = '"><img src=x onerror=alert(1)>'
    design["description"] = "</pre></script><script>alert(2)</script>"
    return design


class Page(HTMLParser):
    """What a reader of HTML finds: elements in their order, texts, and whether every element is closed."""

    def __init__(self, content: bytes) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self.record = self.style = ""
        self.feed(content.decode())
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data
            self.record += data if self.elements[-1][1].get("id") == "tailstack-record" else ""
        elif self.open and self.open[-1] == "style":
            self.style += data
        else:
            self.texts.append(data)

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


# --- the record -----------------------------------------------------------------------------------


def test_its_parts_and_the_design_in_it_are_what_the_verbs_answer(report: Report, body: bytes) -> None:
    design = load_design(limited(0.9))
    assert report.score == score(design, fifty_shots=True)
    assert report.verification == verify(design, trials=20_000, seed=3)
    assert report.optimisation is None
    assert load_design(report.design).sha256 == design.sha256 == report.provenance.design_sha256
    book = openpyxl.load_workbook(io.BytesIO(rendered("report", body, "xlsx")))
    lines = [str(row[0].value or "") for row in book["Design"].iter_rows(min_row=2)]
    assert load_design("\n".join(lines) + "\n").sha256 == report.provenance.design_sha256


def test_the_headline_says_the_verdict_with_its_numbers(report: Report) -> None:
    check = report.verification
    assert check is not None
    low, high = check.targets[0].p95_interval_mm
    assert report.headline.status == ("pass" if high <= 0.9 else "fail" if low > 0.9 else "inconclusive")
    for number in (f"{check.targets[0].p95_mm:.3f}", f"{low:.3f}", f"{high:.3f}", "0.9"):
        assert number in report.headline.sentence
    assert 1 <= len(report.headline.matters) <= 3


def test_sampled_and_first_order_shares_are_of_one_distribution(report: Report) -> None:
    """sampled: no bin differs by more than five standard errors plus what first order errs by."""
    (shown,) = report.distributions
    assert shown.sampled is not None
    assert shown.trials == 20_000
    drawn, law = np.array(shown.sampled), np.array(shown.first_order)
    assert law.sum() == pytest.approx(1.0, abs=0.02)
    assert drawn.sum() == pytest.approx(1.0, abs=0.02)
    assert np.all(np.abs(drawn - law) < 5 * np.sqrt(law / shown.trials + 1e-9) + 0.002)
    p95 = float(np.interp(0.95, np.cumsum(law), shown.edges_mm[1:]))
    assert p95 == pytest.approx(report.score.targets[0].p95_mm, rel=0.02)


@pytest.mark.long
def test_a_job_with_an_optimisation_gives_what_is_computed_here() -> None:
    design = small_design()
    design["optimise"] |= {"starts": 2, "seed": 5}
    parts = ("score", "verification", "optimisation")
    here = compute_report(load_design(design), ReportContents(parts, trials=4_000))
    assert here.optimisation is not None
    assert f"{here.optimisation.p95_after_mm:.2f}" in "".join(here.headline.matters)
    Draft202012Validator(json_schema("report")).validate(json.loads(to_json(here)))
    outcome, recorded = run_job("report", {"design": design, "parts": list(parts), "trials": 4_000, "seed": 0})
    assert outcome.answer == to_json(here)
    assert {json.loads(unit.spec)["of"] for unit in recorded} == {"verification", "optimisation"}


def test_a_report_without_a_check_says_what_it_rests_on() -> None:
    report = compute_report(load_design(limited(0.9)), ReportContents(parts=("score",)))
    assert report.verification is None
    assert report.headline.basis == "first order"
    assert report.distributions[0].sampled is None
    page = Page(render("report", to_json(report), "html"))
    assert "Requirements, by estimate" in "".join(page.texts)


# --- HTML -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_html_asks_nothing_of_any_network(body: bytes) -> None:
    content = rendered("report", body, "html")
    page = Page(content)
    assert not page.open
    for tag, attributes in page.elements:
        assert tag not in ("link", "img", "iframe", "object", "embed", "base", "form", "use", "image")
        for name, value in attributes.items():
            assert not name.startswith("on")
            assert name != "style"  # the policy lets no such style count
            if name in ("src", "href", "xlink:href", "action", "data", "srcset", "poster"):
                assert value is not None
                assert value.startswith("#")
    assert b"@import" not in content
    assert not re.search(rb"url\((?!#)", content)
    policy = next(m for m in page.of("meta") if m.get("http-equiv") == "Content-Security-Policy")["content"]
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    (script,) = [text for text, how in zip(page.scripts, page.of("script"), strict=True) if "type" not in how]
    for directive, text in (("script-src", script), ("style-src", page.style)):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{directive} 'sha256-{digest}'" in policy


def test_html_can_be_read_without_seeing_it(body: bytes) -> None:
    page = Page(rendered("report", body, "html"))
    assert page.of("html")[0]["lang"] == "en"
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert all(th.get("scope") in ("col", "row") for th in page.of("th"))
    assert len(page.of("table")) == len(page.of("caption")) > 4
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for svg in page.of("svg"):
        assert svg["role"] == "img"
        assert set((svg["aria-labelledby"] or "").split()) <= set(ids)
    for _, attributes in page.elements:
        if "href" in attributes:
            assert (attributes["href"] or "")[1:] in ids


@pytest.mark.long
def test_html_shows_names_and_never_runs_them() -> None:
    report = compute_report(load_design(hostile_design()), ReportContents(trials=2_000))
    page = Page(render("report", to_json(report), "html"))
    running = [text for text, script in zip(page.scripts, page.of("script"), strict=True) if "type" not in script]
    assert running == [(TEMPLATES / "viewer.js").read_text(encoding="utf-8").strip()]
    assert not page.of("img")
    assert HOSTILE in "".join(page.texts)
    assert json.loads(page.record)["design"]["description"] == hostile_design()["description"]


TEMPLATES = Path(html_module.__file__).parent / "templates"
CSS = "".join((TEMPLATES / name).read_text(encoding="utf-8") for name in ("report.css", "screen.css"))


THEMES = [dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block)) for block in re.findall(r":root \{[^}]*\}", CSS)]
ON_ANY_GROUND = ("ink", "quiet", "below", "link")


@pytest.mark.parametrize("theme", THEMES, ids=["light", "dark"])
def test_text_stands_out_from_its_ground(theme: dict[str, str]) -> None:
    """published: WCAG 2.2, 1.4.3, a contrast of at least 4.5."""
    pairs = [(name, f"{name}-ground") for name in ("pass", "fail", "open", "plain")]
    pairs += [(name, "ground") for name in ("pass", "fail", "open", "plain")]
    pairs += [(name, ground) for name in ON_ANY_GROUND for ground in theme if ground.endswith("ground")]
    pairs += [(name, "raised") for name in ON_ANY_GROUND]
    for name, ground in pairs:
        darker, lighter = sorted(luminance(theme[which]) for which in (name, ground))
        assert (lighter + 0.05) / (darker + 0.05) >= 4.5, (name, ground)


# --- spreadsheet ----------------------------------------------------------------------------------


@pytest.mark.long
def test_the_spreadsheet_holds_the_numbers_with_their_units(report: Report, body: bytes) -> None:
    """independent: read back by openpyxl."""
    content = rendered("report", body, "xlsx")
    book = openpyxl.load_workbook(io.BytesIO(content))
    assert book.sheetnames[:2] == ["Summary", "Provenance"]
    front, origin = (
        [str(cell.value) for row in book[name].iter_rows() for cell in row if cell.value is not None]
        for name in book.sheetnames[:2]
    )
    assert report.headline.sentence in front
    assert report.headline.status in front
    assert report.provenance.design_sha256 in origin
    assert hashlib.sha256(body).hexdigest() in origin

    heads, rows = sheet(book["Targets"])
    assert "P95, mm" in heads
    assert rows[0][heads.index("P95, mm")] == pytest.approx(report.score.targets[0].p95_mm, rel=DIGITS)
    heads, rows = sheet(book["Budget"])
    for column, field in (("Share of variance", "variance_share"), ("P95 without, mm", "p95_without_mm")):
        found = [row[heads.index(column)] for row in rows]
        wanted = [getattr(line, field) for line in report.score.targets[0].contributors]
        assert sorted(found) == pytest.approx(sorted(wanted), rel=DIGITS, abs=0), column
    heads, rows = sheet(book["Monte Carlo"])
    assert report.verification is not None
    target = report.verification.targets[0]
    found = [rows[0][heads.index(name)] for name in ("P95 from, mm", "P95, mm", "P95 to, mm")]
    low, high = target.p95_interval_mm
    assert found == pytest.approx([low, target.p95_mm, high], rel=DIGITS)


@pytest.mark.long
def test_the_spreadsheet_shows_as_many_digits_as_the_pages_and_holds_all(body: bytes) -> None:
    """independent: Python's own rounding to three significant digits; cells are read back by openpyxl."""
    book = openpyxl.load_workbook(io.BytesIO(rendered("report", body, "xlsx")))
    heads, rows = sheet(book["Budget"])
    for column in ("Sensitivity, mm/unit", "dP95/dh, mm/unit", "Half-width at limit, unit", "Slack, unit"):
        place = heads.index(column)
        cells = [row[place] for row in book["Budget"].iter_rows(min_row=3, max_row=2 + len(rows))]
        seen = [(cell.value, cell.number_format) for cell in cells if cell.value]
        assert len(seen) > 5
        for value, form in seen:
            decimals = len(form.partition(".")[2])
            shown = float(f"{value:.2e}") if "E" in form else round(value, decimals)
            assert shown == pytest.approx(float(f"{value:.2e}"), rel=1e-12), (column, form)
    values = {row[heads.index("Sensitivity, mm/unit")] for row in rows}
    assert any(value and abs(value - float(f"{value:.6g}")) > 0 for value in values)  # rounded on the sheet alone


def sheet(page: Any) -> tuple[list[str], list[list[Any]]]:
    """Headers (second row) and the rows below them, up to the first empty one."""
    rows = [[cell.value for cell in row] for row in page.iter_rows(min_row=2)]
    heads = [str(value) for value in rows[0] if value is not None]
    body = []
    for row in rows[1:]:
        if row[0] is None:
            break
        body.append(row[: len(heads)])
    return heads, body


def test_no_text_becomes_a_formula() -> None:
    report = compute_report(load_design(hostile_design()), ReportContents(parts=("score",)))
    book = openpyxl.load_workbook(io.BytesIO(render("report", to_json(report), "xlsx")))
    cells = [cell for page in book for row in page.iter_rows() for cell in row]
    formulas = {cell.value for page in book for row in page.iter_rows() for cell in row if cell.data_type == "f"}
    assert all(re.fullmatch(r"=[A-Z$(][A-Z0-9$():*/+,^=. -]*", text) for text in formulas), "ours: of numbers alone"
    found = [cell for cell in cells if cell.value == FORMULA]
    assert found
    assert all(cell.data_type == "s" and cell.quotePrefix for cell in found)


def test_every_text_of_the_spreadsheet_fits_into_its_row() -> None:
    """independent: the letters' widths in DejaVu Sans, which is wider than Calibri, and lines broken between words."""
    for kind, body in results().items():
        book = openpyxl.load_workbook(io.BytesIO(rendered(kind, body, "xlsx")))
        for page in book.worksheets:
            across = {str(span).split(":")[0]: span for span in page.merged_cells.ranges}
            widths = [width_of(page, place) for place in range(page.max_column + 1)]
            for row in page.iter_rows():
                high = page.row_dimensions[row[0].row].height or 15.0
                for cell in row:
                    if cell.data_type != "s" or not cell.value or (page.title == "Record" and cell.row > 1):
                        continue
                    span = across.get(cell.coordinate)
                    places = range(span.min_col, span.max_col + 1) if span else [cell.column]
                    wide = sum(widths[place] for place in places) - 9 * (cell.alignment.indent or 0) - 5
                    lines = sum(lines_of(part, wide, cell.font) for part in str(cell.value).split("\n"))
                    points = 1.164 * (cell.font.sz or 11)
                    assert lines * points <= high + 1, (kind, page.title, cell.coordinate, cell.value)
                    assert lines == 1 or cell.alignment.wrap_text, (kind, page.title, cell.coordinate)


def width_of(page: Any, place: int) -> float:
    """px of a column, whose width is stated in digits of Calibri, 7 px each, and 5 px around them."""
    stated = [column.width for column in page.column_dimensions.values() if column.min <= place <= column.max]
    return 7.0 * (stated[0] if stated else 8.43)


@cache
def advance(letter: str, family: str, weight: str) -> float:
    """Width of a letter in ems."""
    path = font_manager.findfont(font_manager.FontProperties(family=family, weight=weight))
    font = font_manager.get_font(path)
    font.set_size(1000, 72)
    return float(font.load_char(ord(letter)).linearHoriAdvance) / 65536 / 1000


def lines_of(text: str, wide: float, font: Any) -> int:
    """How many lines a text takes, broken between words."""
    family, weight = "monospace" if "Courier" in font.name else "DejaVu Sans", "bold" if font.b else "normal"
    lines, room = 1, wide
    for word in re.findall(r"\s*\S+", text):
        length = sum(advance(letter, family, weight) for letter in word) * font.sz * 96 / 72
        if length > room and room < wide:
            lines, room = lines + 1, wide
        lines += int(length // wide)
        room -= length % wide
    return lines


def test_the_spreadsheet_prints_on_as_many_pages_as_it_has_sheets_and_few_more(body: bytes, tmp_path: Path) -> None:
    """oracle: LibreOffice.  Only the design, a line a row, is longer than a page."""
    path = tmp_path / "report.xlsx"
    path.write_bytes(content := rendered("report", body, "xlsx"))
    convert_by_libreoffice(path, "pdf")
    sheets = openpyxl.load_workbook(io.BytesIO(content)).sheetnames
    assert len(PdfReader(tmp_path / "report.pdf").pages) <= len(sheets) + 8


# --- PDF ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_no_page_of_the_pdf_but_the_last_is_half_empty(body: bytes) -> None:
    """Where the lowest words of each page stand; those of its pictures count, its foot does not."""
    read = PdfReader(io.BytesIO(rendered("report", body, "pdf")))
    assert read.metadata is not None
    assert read.metadata.title == "Tolerance-budget report: eight beads, two seats"
    for place, page in enumerate(read.pages[:-1], 1):
        heights: list[float] = []

        def note(text: str, cm: list[float], tm: list[float], *_: Any, found: list[float] = heights) -> None:
            if text.strip():
                found.append(tm[4] * cm[1] + tm[5] * cm[3] + cm[5])

        page.extract_text(visitor_text=note)
        above_foot = [y for y in heights if y > 55]
        assert min(above_foot) < 0.5 * float(page.mediabox.height), place


@pytest.mark.long
def test_pictures_of_three_views_are_as_large_in_the_pdf_as_those_of_two() -> None:
    """Letters of a line that stands below each view: their size on paper, in points."""
    sizes = {}
    for name in ("demo", "gallery/third_view"):
        record = to_json(compute_report(load_design(EXAMPLES / f"{name}.yaml"), ReportContents(parts=("score",))))
        found: list[float] = []

        def note(text: str, cm: list[float], tm: list[float], _: Any, size: float, seen: list[float] = found) -> None:
            if "at the detector" in text:
                seen.append(size * abs(cm[3] * tm[3]))

        for page in PdfReader(io.BytesIO(render("report", record, "pdf"))).pages:
            page.extract_text(visitor_text=note)
        sizes[name] = max(found)
    assert sizes["gallery/third_view"] == pytest.approx(sizes["demo"], rel=0.05)
    assert sizes["demo"] > 5


@pytest.mark.parametrize(("limit_mm", "decimals"), [(1.0, 2), (0.9, 3)])
def test_pictures_and_comparisons_have_the_digits_of_the_tables(limit_mm: float, decimals: int) -> None:
    """closed form: an estimate is good to 1 % of its limit, 0.01 mm of 1 mm and 0.009 mm of 0.9 mm."""
    first, second = (load_design(limited(limit_mm, name=name)) for name in ("this", "other"))
    found = compute_comparison(first, second, ReportContents(parts=("score",)))
    page = render("report", to_json(found.first), "html").decode()
    lengths = re.findall(r"<text[^>]*>(?:P95|as it is,) \d+\.(\d+) mm</text>", page)
    assert len(lengths) >= 3
    assert {len(digits) for digits in lengths} == {decimals}
    page = render("comparison", to_json(found), "html").decode()
    told = re.findall(r"P95 goes from \d+\.(\d+) to \d+\.(\d+) mm", found.headline.sentence)
    drawn = re.findall(r"<text[^>]*>(?:[\w ]+, )?P95 \d+\.(\d+) mm</text>", page)
    assert len(told) == 1
    assert len(drawn) >= 2
    assert {len(digits) for digits in (*told[0], *drawn)} == {decimals}


def test_pictures_are_named_above_them(body: bytes) -> None:
    text = rendered("report", body, "html").decode()
    figures = re.findall(r"<figure id=.*?</figure>", text, re.DOTALL)
    assert len(figures) > 5
    for figure in figures:
        assert figure.index("<figcaption><strong>") < figure.index("<svg")
    target, requirement = "Target tip", "tip-accuracy"
    named = {"waterfall": target, "levers": requirement, "distribution-1": target}
    for name, of in named.items():
        figure = next(figure for figure in figures if f'id="figure-{name}"' in figure)
        assert f"<strong>{of}: </strong>" in figure


@pytest.mark.parametrize(
    ("failure", "code", "word"),
    [
        (ImportError("No module named 'weasyprint'"), "missing-package", "pip install"),
        (OSError("cannot load library 'libpango-1.0-0'"), "missing-library", "libpango-1.0-0"),
    ],
)
def test_missing_libraries_are_named(
    body: bytes, monkeypatch: pytest.MonkeyPatch, failure: Exception, code: str, word: str
) -> None:
    class Absent:
        def find_spec(self, name: str, *_: Any) -> None:
            if name == "weasyprint":
                raise failure

    for name in [name for name in sys.modules if name.partition(".")[0] == "weasyprint"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    (problem,) = problems_of(render, "report", body, "pdf", error=PdfUnavailable)
    assert problem.code == code
    assert word in problem.hint


# --- every kind of result -------------------------------------------------------------------------


KINDS = ("score", "verification", "optimisation", "sweep", "gate", "report", "comparison")


@cache
def results() -> dict[str, bytes]:
    """One result of every kind that has chapters."""
    design, other = load_design(limited(0.9)), load_design(limited(5.0, name="looser"))
    axis = {"pointer": "/views/0/fiducial_noise_px", "values": [0.2, 0.3, 0.4]}
    files = {f"{limit}.yaml": limited(limit) for limit in (0.9, 5.0)}
    few = ReportContents(trials=4_000)
    made = (
        score(design), verify(design, trials=4_000), optimise(load_design(small_design()), starts=1),
        sweep(design, read_axes(design, [axis])), judge_files(files, mode="auto", policy=None),
        compute_report(design, few), compute_comparison(design, other, few),
    )  # fmt: skip
    return dict(zip(KINDS, map(to_json, made), strict=True))


@pytest.mark.long("pdf-report", "xlsx-verification", "xlsx-sweep")
@pytest.mark.parametrize(
    ("form", "kind"),
    [*product(("html", "xlsx", "json"), KINDS), ("pdf", "report")],  # which is the page, through one printer for all
)
def test_every_kind_in_every_format_and_again_the_same(form: str, kind: str) -> None:
    record = results()[kind]
    first = rendered(kind, record, form)
    if form == "html" or kind == "report":  # one writer of XLSX for all kinds
        assert first == render(kind, record, form)
    assert len(first) < 4_000_000
    if form == "html":
        page = Page(first)
        assert not page.open
        assert json.loads(page.record) == json.loads(record)
        assert hashlib.sha256(record).hexdigest() in "".join(page.texts)
        assert page.of("svg") or kind == "gate"
        regions = [attributes["aria-label"] for _, attributes in page.elements if attributes.get("role") == "region"]
        assert len(set(regions)) == len(regions), "what a screen reader lists"
    if form == "json":
        assert first == record
    if form == "xlsx":
        assert openpyxl.load_workbook(io.BytesIO(first)).sheetnames[:2] == ["Summary", "Provenance"]


@pytest.mark.long
def test_a_page_shows_the_worst_targets_and_the_spreadsheet_all() -> None:
    design = limited(0.9, optimise=None)
    spread = [{"name": f"t{k}", "position_mm": [0.0, 0.0, 30.0 + k]} for k in range(45)]
    record = score(load_design({**design, "targets": spread}))
    worst = sorted(record.targets, key=lambda target: target.p95_mm, reverse=True)
    page = "".join(Page(render("score", to_json(record), "html")).texts)
    assert worst[0].name in page
    assert "30 more rows are in the spreadsheet" in page  # of 90: an error at the tool and a localised one per target
    book = openpyxl.load_workbook(io.BytesIO(render("score", to_json(record), "xlsx")))
    _, rows = sheet(book["Targets"])
    assert [row[0] for row in rows[::2]] == [target.name for target in worst]


def test_what_has_no_chapters_is_refused(body: bytes) -> None:
    with pytest.raises(ValueError, match="no report is made of 'validation'"):
        render("validation", body, "html")
    with pytest.raises(ValueError, match="no format"):
        render("report", body, "docx")


def test_a_score_out_of_its_range_still_becomes_a_report() -> None:
    design = limited(9.0)
    for view in design["views"]:
        view["fiducial_noise_px"] = view["target_noise_px"] = 60.0
    record = score(load_design(design))
    assert isinstance(record, Score)
    assert record.validity.status == "not valid"
    texts = "".join(Page(render("score", to_json(record), "html")).texts)
    assert "unknown" in texts
