"""Text from records: what is printed is what the record holds, on a page of 100 columns."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tailstack.results import Check, Contributor, Finding, Verdict
from tailstack_service.rendering.score import grouped
from tailstack_service.rendering.tables import WIDTH, columns, number, percent, shortened, table, wrapped
from tailstack_service.rendering.verdict import checks_table, findings_text, verdict_text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"), (0.0, "0"), (1.14375, "1.144"), (0.05, "0.05000"), (1234.5, "1234"), (12345.6, "1.235e+04"),
        (-0.5, "-0.5000"), (1e-7, "1e-07"), (0.00123456, "0.001235"),
    ],
)  # fmt: skip
def test_numbers(value: float | None, text: str) -> None:
    assert number(value) == text


@given(st.floats(min_value=1e-12, max_value=1e12), st.integers(2, 6))
def test_a_printed_number_is_the_number_to_its_digits(value: float, digits: int) -> None:
    assert float(number(value, digits)) == pytest.approx(value, rel=0.5000001 * 10.0 ** (1 - digits))


@pytest.mark.parametrize(
    ("fraction", "text"), [(None, "-"), (0.0, "0.0"), (1e-5, "<0.1"), (0.123, "12.3"), (1.0, "100.0"), (6e-4, "0.1")]
)
def test_percentages(fraction: float | None, text: str) -> None:
    assert percent(fraction) == text


@given(st.text(max_size=60), st.integers(2, 40))
def test_shortened_texts_fit_and_hold_nothing_that_could_repaint_a_terminal(text: str, width: int) -> None:
    short = shortened(text, width)
    assert columns(short) <= width
    assert not {unicodedata.category(c) for c in short} & {"Cc", "Cf", "Zl", "Zp"}


def test_long_names_keep_their_end() -> None:
    assert shortened("workspace-of-the-left-arm[12]", 12).endswith("[12]"[-3:])


@given(st.lists(st.tuples(st.text(max_size=50), st.text("0123456789.", max_size=9)), max_size=6))
def test_tables_are_aligned_and_fit(rows: list[tuple[str, str]]) -> None:
    lines = table(("name", "value\nmm"), rows).split("\n")
    assert len(lines) == 3 + len(rows)
    assert max(map(columns, lines)) <= WIDTH


def test_wide_tables_give_way_in_their_texts() -> None:
    row = ("a-rather-long-name-of-a-thing", "another-rather-long-name", *["1234567.8"] * 6)
    lines = table(("thing", "other", *["value\nmm"] * 6), [row], left=2).split("\n")
    assert max(map(columns, lines)) <= WIDTH
    assert lines[-1].count("1234567.8") == 6


@given(st.lists(st.text("abcdefgh", min_size=1, max_size=30), min_size=1, max_size=60))
def test_wrapping_keeps_every_word(words: list[str]) -> None:
    text = wrapped(" ".join(words), first="note: ", indent="  ")
    assert text.removeprefix("note: ").split() == words
    assert max(map(columns, text.split("\n"))) <= WIDTH


def line(name: str, component: str, share: float) -> Contributor:
    return Contributor(name, component, "normal", 0.1, "deg", 0.05, 2.0, share, 0.3, 1.0)


def test_budget_lines_are_grouped_and_sorted_by_share() -> None:
    contributors = (
        line("noise", "all", 0.2), line("seat", "rx", 0.1), line("seat", "ry", 0.3), line("seat", "all", 0.4),
        line("arm", "tx", 0.25),
    )  # fmt: skip
    found = [(total.name, [part.component for part in parts]) for total, parts in grouped(contributors)]
    assert found == [("seat", ["ry", "rx"]), ("arm", []), ("noise", [])]


def check(status: str, **changes: object) -> Check:
    fields: dict[str, object] = {
        "requirement": "tip", "target": "entry", "error": "tcp", "risk": "pooled", "quantile": 0.95, "value_mm": 1.25,
        "interval_mm": (1.2, 1.3), "limit_mm": 1.5, "yield_fraction": None, "min_yield": None, "status": status,
    }  # fmt: skip
    return Check(**{**fields, **changes})  # type: ignore[arg-type]


def test_checks_show_value_interval_limit_and_status() -> None:
    last = checks_table((check("pass"),)).split("\n")[-1].split()
    assert last == ["tip", "entry", "P95", "tcp,", "pooled", "1.250", "1.200", "..", "1.300", "1.500", "pass"]


def test_a_yield_is_shown_against_what_is_required() -> None:
    text = checks_table((check("fail", risk="per_unit", yield_fraction=0.9, min_yield=0.95), check("pass")))
    assert "90.0 >= 95.0" in text
    assert "yield" in text


def test_the_verdict_comes_last_and_findings_before_it() -> None:
    finding = Finding("requirement-failed", "error", "tip is beyond its limit")
    verdict = Verdict("fail", "Monte Carlo", (check("fail"),), (finding,))
    text = verdict_text(verdict, colour=False)
    assert text.endswith("\n\nverdict: fail (Monte Carlo)")
    assert "error: [requirement-failed] tip is beyond its limit" in text
    assert "\x1b[31m" in verdict_text(verdict, colour=True)
    assert findings_text((), colour=True) == ""
