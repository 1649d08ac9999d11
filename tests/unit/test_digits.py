"""How many decimals a length has, and how a share is written: closed form, by what an error leaves to be known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tailstack.results.digits import ESTIMATE, FINEST, count_decimals, decimals_of, exact, in_percent


@pytest.mark.parametrize(
    ("size_mm", "error", "decimals"),
    [(0.6, 0.01, 3), (0.8, 0.01, 3), (1.0, 0.01, 2), (1.0, 0.00999, 2), (2.0, 0.01, 2), (1.0, 0.003, 3),
     (0.05, 0.01, 4), (600.0, 0.01, 0), (0.8, 0.1, 3), (0.0, 0.01, 3)],
)  # fmt: skip
def test_decimals_of_a_size_and_its_error(size_mm: float, error: float, decimals: int) -> None:
    assert count_decimals(size_mm, error) == decimals


@given(st.floats(0.02, 500.0), st.floats(1e-4, ESTIMATE))
def test_the_last_digit_is_of_the_decade_of_the_error(size_mm: float, error: float) -> None:
    decimals = count_decimals(size_mm, error)
    if 0 < decimals < FINEST:
        assert 0.98 * 10.0**-decimals <= size_mm * error < 10 * 10.0**-decimals


def judged(value: float, low: float, high: float | None, limit: float) -> Any:
    return SimpleNamespace(value=value, interval=(low, high), limit=limit)


def test_an_answer_has_the_decimals_of_its_finest_requirement() -> None:
    estimates = judged(1.144, 1.144 / 1.01, 1.144 * 1.01, 1.0), judged(0.442, 0.438, 0.446, 0.8)
    assert decimals_of(estimates[:1]) == 2
    assert decimals_of(estimates) == 3
    assert decimals_of([judged(1.1451, 1.1443, 1.1459, 1.0)]) == 4  # a simulation to 0.07 %
    assert decimals_of([judged(0.5, 0.0, None, 0.8)]) == 3
    assert decimals_of((), 1.2) == 2


@pytest.mark.parametrize(
    ("value", "text"), [(0.6, "0.600"), (0.8, "0.800"), (0.6254, "0.6254"), (1.0, "1.000"), (1e-5, "1e-05")]
)
def test_what_is_stated_is_never_rounded(value: float, text: str) -> None:
    assert exact(value, 3) == text


@pytest.mark.parametrize(
    ("fraction", "decimals", "text"),
    [(0.39, 0, "39 %"), (1.0, 1, "100.0 %"), (0.99999, 1, "> 99.9 %"), (1e-5, 1, "< 0.1 %"), (0.0, 0, "0 %"),
     (0.208, 1, "20.8 %")],
)  # fmt: skip
def test_a_share_is_written_one_way(fraction: float, decimals: int, text: str) -> None:
    assert in_percent(fraction, decimals) == text
