"""A requirement passes just where its margin is not negative, and every format prints the same numbers for it.

Expected statuses are read off value, interval and limit as they are printed; formats are read with nothing of what
wrote them: a parser of HTML, other libraries for spreadsheets and PDF.
"""

from __future__ import annotations

import io
import json
import re
from html.parser import HTMLParser
from itertools import product
from typing import Any
from xml.etree import ElementTree

import openpyxl
import pytest
from gate_scenes import judge_files
from service_scenes import sound_design

from tailstack import load_design, score, verify
from tailstack.design import Design
from tailstack_service.documents import to_json
from tailstack_service.gate.formats import FORMATS
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.rendering import render
from tailstack_service.rendering.text import Page, write_on
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.comparing import compute_comparison

YIELDS = (None, 0.5, 0.8, 0.9, 0.95, 0.99)  # None: pooled
QUANTILES = (0.9, 0.95, 0.99)
FACTORS = (0.88, 1.0, 1.12)  # of the value: fails, is open, passes


def named(quantile: float, fraction: float | None, factor: float) -> str:
    """Short, for a terminal cuts long names where many columns meet."""
    return f"r{QUANTILES.index(quantile)}{YIELDS.index(fraction)}{FACTORS.index(factor)}"


def requirement(quantile: float, fraction: float | None, limit_mm: float, name: str) -> dict[str, Any]:
    entry = {"name": name, "quantile": quantile, "limit_mm": limit_mm}
    return entry if fraction is None else entry | {"risk": "per_unit", "min_yield": fraction}


@pytest.fixture(scope="module")
def values() -> dict[tuple[float, float | None], float]:
    """What the score says of each, by a limit that is far away."""
    asked = list(product(QUANTILES, YIELDS))
    design = sound_design(requirements=[requirement(*key, 50.0, f"r{k}") for k, key in enumerate(asked)])
    checks = json.loads(to_json(score(load_design(design))))["verdict"]["checks"]
    return {key: check["value"] for key, check in zip(asked, checks, strict=True)}


@pytest.fixture(scope="module")
def design(values: dict[tuple[float, float | None], float]) -> Design:
    """Requirements at every quantile and yield, with limits that they fail, may keep and keep."""
    requirements = [
        requirement(*key, round(factor * values[key], 4), named(*key, factor))
        for key, factor in product(values, FACTORS)
    ]
    return load_design(sound_design(requirements=requirements))


def words_of(check: dict[str, Any]) -> str:
    keep = "" if check["min_yield"] is None else f" that {100 * check['min_yield']:g} % of units keep"
    return f"P{100 * check['quantile']:g}{keep}"


def agree(checks: list[dict[str, Any]]) -> None:
    """Status, margin, interval, value and yield of checks in JSON say the same."""
    for check in checks:
        low, high = check["interval"]
        assert low <= check["value"] <= high
        assert check["margin"] == check["limit"] - high
        assert (check["status"] == "pass") == (check["margin"] >= 0)
        assert (check["status"] == "fail") == (low > check["limit"])
        assert check["headline"] == words_of(check)
        if check["min_yield"] is not None:
            assert (check["yield_fraction"] >= check["min_yield"]) == (check["value"] <= check["limit"])


def same_row(cells: list[str], check: dict[str, Any]) -> None:
    """A row of a table as printed: value, ends of the interval, limit, margin, ..., status."""
    numbers = [float(cell.replace("−", "-")) for cell in cells[-6:-1]]
    low, high = check["interval"]
    expected = [check["value"], low, high, check["limit"], check["margin"]]
    assert numbers == pytest.approx(expected, abs=6e-4), check["requirement"]
    assert cells[-1] == check["status"]
    assert (cells[-1] == "pass") == (not cells[-2].startswith(("-", "−")))


def without_units(cells: list[str]) -> list[str]:
    """A row of a page without what units keep and have to keep, which stand before its status."""
    return [*cells[:-3], cells[-1]]


# --- every format ---------------------------------------------------------------------------------


@pytest.mark.long
def test_pass_is_a_margin_that_is_not_negative_at_every_quantile_and_yield(checks: dict[str, dict[str, Any]]) -> None:
    found = checks.values()
    by_factor = [{check["status"] for name, check in checks.items() if name.endswith(str(k))} for k in range(3)]
    assert by_factor == [{"fail"}, {"inconclusive"}, {"pass"}]
    for quantile, fraction in product(QUANTILES, YIELDS[1:]):
        same = [c for c in found if (c["quantile"], c["min_yield"]) == (quantile, fraction)]
        assert len({c["value"] for c in same}) == 1
    for quantile in QUANTILES:  # what more units keep is more
        rising = [next(c["value"] for c in found if (c["quantile"], c["min_yield"]) == (quantile, y))
                  for y in YIELDS[1:]]  # fmt: skip
        assert rising == sorted(rising)
        assert rising[-1] > 1.02 * rising[0]


@pytest.fixture(scope="module")
def report(design: Design) -> bytes:
    return to_json(compute_report(design, ReportContents(parts=("score",))))


@pytest.fixture(scope="module")
def checks(report: bytes) -> dict[str, dict[str, Any]]:
    record = json.loads(report)
    agree(record["score"]["verdict"]["checks"])
    headline = record["headline"]
    assert headline["status"] == "fail"
    assert headline["margin"] == headline["limit"] - headline["interval"][1] < 0
    return {check["requirement"]: check for check in record["score"]["verdict"]["checks"]}


class Rows(HTMLParser):
    """Texts of the cells of every row of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False
        self.feed(page)

    def handle_starttag(self, tag: str, _: Any) -> None:
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.inside = True
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.rows[-1][-1] += data.strip()


@pytest.mark.long
def test_the_first_page_of_a_report_lists_each_requirement(report: bytes, checks: dict[str, dict[str, Any]]) -> None:
    page = render("report", report, "html").decode()
    first, chapters = page[: page.index("<nav")], page[page.index("<nav") :]
    rows = [row for row in Rows(first).rows if row[0] in checks]
    assert {row[0] for row in rows} == set(checks)
    assert len(rows) == len(checks)
    for row in rows:
        same_row(without_units(row), checks[row[0]])
        assert row[2].replace(" of the error at the tool", "") == words_of(checks[row[0]])
    for row in (row for row in Rows(chapters).rows if row[0] in checks):  # the chapter's own table
        same_row(without_units(row), checks[row[0]])


def test_a_spreadsheet_has_them_as_numbers(report: bytes, checks: dict[str, dict[str, Any]]) -> None:
    book = openpyxl.load_workbook(io.BytesIO(render("report", report, "xlsx")))
    numbers = ("Value, mm", "From, mm", "To, mm", "Limit, mm", "Margin, mm")
    for sheet in ("Requirements", "Checks"):
        rows = list(book[sheet].iter_rows(values_only=True))
        header = next(row for row in rows if set(numbers) <= set(row))
        found = {row[0]: dict(zip(header, row, strict=True)) for row in rows if row[0] in checks}
        assert found.keys() == checks.keys()
        for name, row in found.items():
            check = checks[name]
            expected = (check["value"], *check["interval"], check["limit"], check["margin"])
            assert [row[number] for number in numbers] == pytest.approx(expected, rel=1e-15)
            assert (row["Status"] == "pass") == (row["Margin, mm"] >= 0)
            assert row["Status"] == check["status"]


@pytest.mark.long
def test_the_gauge_shows_one_distribution(values: dict[tuple[float, float | None], float]) -> None:
    """Mean and CVaR are known of all units together, so they stand beside nothing else."""
    for fraction, beside in ((None, True), (0.9, False)):
        entry = requirement(0.95, fraction, 2.0, "only")
        record = to_json(
            compute_report(load_design(sound_design(requirements=[entry])), ReportContents(parts=("score",)))
        )
        page = render("report", record, "html").decode()
        gauge = page[page.index('id="figure-headline"') : page.index("<table")]
        assert ("CVaR95" in gauge) == beside
        assert ("mean" in gauge) == beside
        assert f"{values[0.95, fraction]:.2f} mm" in gauge  # good to 1 % of 2 mm
        assert (f"that {100 * fraction:g} % of units keep" in gauge) if fraction else "units" not in gauge


@pytest.mark.long
def test_a_comparison_says_what_fails_and_has_one_p95_of_each_target(
    values: dict[tuple[float, float | None], float],
) -> None:
    kept = [requirement(0.95, 0.9, 1.2 * values[0.95, 0.9], "units"), requirement(0.99, None, 3.0, "tail")]
    missed = [requirement(0.95, 0.9, 0.8 * values[0.95, 0.9], "units"), requirement(0.99, None, 0.3, "tail")]
    first, second = (load_design(sound_design(requirements=entries)) for entries in (kept, missed))
    for options in (ReportContents(parts=("score",)), ReportContents(trials=20_000, seed=2)):
        found = compute_comparison(first, second, options)
        page = render("comparison", to_json(found), "html").decode()
        start = page[page.index("<main") : page.index("<nav")]
        sentence = re.search(r'<p class="sentence">([^<]*)', start)[1]  # type: ignore[index]
        assert sentence.startswith("The second design misses ")
        assert "units" in sentence
        assert "tail" in sentence
        rows = Rows(start).rows
        signed = next(k for k, row in enumerate(rows) if "Signature" in row)  # the lines to sign come after
        said = {(row[1], row[0], row[-1]) for row in rows[1:signed]}
        each = (("First", "pass"), ("Second", "fail"))
        assert said == {(name, *judged) for name in ("units", "tail") for judged in each}
        shown = set(re.findall(r"P95 ([\d.]+) mm", start))
        assert len(shown) == 1  # the designs differ in what is asked of them
        p95 = found.differences[0].first_p95_mm
        assert shown == {f"{p95:.{max(3, len(min(shown)) - 2)}f}"}  # three decimals at least: a limit is 0.3 mm


def test_a_gate_says_the_same_in_each_of_its_formats(design: Design, checks: dict[str, dict[str, Any]]) -> None:
    data = sound_design(requirements=[entry.model_dump(exclude_none=True) for entry in design.document.requirements])
    record = judge_files({"a.yaml": data}, policy=None)
    numbers = {n["requirement"]: n for n in json.loads(to_json(record))["designs"][0]["numbers"]}
    assert set(numbers) == set(checks)
    for name, number in numbers.items():
        check = checks[name]
        same = ("headline", "value", "interval", "limit", "margin", "status")
        assert {key: number[key] for key in same} == {key: check[key] for key in same}
        assert (number["status"] == "pass") == (number["margin"] >= 0)
    with write_on(Page(160, details=True)):
        texts = {name: render(record) for name, render in FORMATS.items()}
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in texts["markdown"].splitlines()]
    table = {row[1]: row for row in rows if len(row) == 10 and row[1] in checks}
    assert set(table) == set(checks)
    lines = {line.split()[0]: line for line in texts["text"].splitlines() if re.match(r"  r\d", line)}
    suite = ElementTree.fromstring(texts["junit"])
    cases = {re.search(r"(r\d\d\d), target", case.get("name", ""))[1]: case for case in suite.iter("testcase")  # type: ignore[index]
             if ", target" in case.get("name", "")}  # fmt: skip
    said = [result["message"]["text"] for result in json.loads(texts["sarif"])["runs"][0]["results"]]
    sarif = {found[0]: text for text in said if (found := re.match(r"r\d\d\d", text))}
    assert set(sarif) == {name for name, check in checks.items() if check["status"] != "pass"}
    for name, check in checks.items():
        assert table[name][3] == words_of(check)
        same_row([*table[name][:-1], table[name][-1].split()[-1]], check)
        cells = lines[name].replace(" .. ", " ").split()
        same_row([*cells[:-2], cells[-1]], check)
        assert (cases[name].find("failure") is None) == (check["status"] == "pass")
        if name in sarif:
            low, high = check["interval"]
            stated = r"is ([\d.]+) mm \(between ([\d.]+) and ([\d.]+)\), limit ([\d.]+) mm"
            for words in (sarif[name], cases[name].find("failure").get("message")):  # type: ignore[union-attr]
                printed = [float(number) for number in re.search(stated, words).groups()]  # type: ignore[union-attr]
                assert printed[:3] == pytest.approx([check["value"], low, high], abs=6e-4)
                assert printed[3] == pytest.approx(check["limit"], abs=1e-9)
                assert words_of(check) in words.replace(" of the error at the tool", "")


# --- Monte Carlo ----------------------------------------------------------------------------------


@pytest.mark.long
def test_a_check_decides_at_the_yield_that_is_asked_for(values: dict[tuple[float, float | None], float]) -> None:
    """The same in JSON, text and HTML, for what passes at 90 % and not at 99 %."""
    limit = (values[0.95, 0.9] * values[0.95, 0.99]) ** 0.5
    entries = [requirement(0.95, y, round(limit, 4), f"r{1000 * y:.0f}") for y in (0.5, 0.9, 0.99)]
    entries += [requirement(0.99, 0.8, round(values[0.99, 0.8], 4), "open")]
    found = verify(load_design(sound_design(requirements=entries)), trials=20_000, seed=4)
    record = json.loads(to_json(found))
    checks = record["verdict"]["checks"]
    agree(checks)
    assert [check["status"] for check in checks] == ["pass", "pass", "fail", "inconclusive"]
    with write_on(Page(160, details=True)):
        text = OPERATIONS["verification"].write(found)
    page = render("verification", to_json(found), "html").decode()
    rows = Rows(page[: page.index("<nav")]).rows
    for check in checks:
        line = next(line for line in text.splitlines() if line.startswith(check["requirement"]))
        cells = line.replace(" .. ", " ").split()
        same_row([*cells[:-2], cells[-1]], check)
        same_row(without_units(next(row for row in rows if row[0] == check["requirement"])), check)
        # first order agrees where it is calibrated
        assert check["value"] == pytest.approx(values[check["quantile"], check["min_yield"]], rel=0.04)
    assert "FAIL" in page.upper()


def test_a_yield_that_so_few_units_cannot_show_is_open_and_its_margin_not_known() -> None:
    entry = requirement(0.95, 0.999, 50.0, "nearly-all")
    found = verify(load_design(sound_design(requirements=[entry])), trials=5000)
    (check,) = json.loads(to_json(found))["verdict"]["checks"]
    assert (check["status"], check["interval"][1], check["margin"]) == ("inconclusive", None, None)
    assert check["yield_fraction"] == 1.0
