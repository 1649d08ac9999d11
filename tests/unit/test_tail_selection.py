"""Units picked by rank, against NumPy's sorting."""

from __future__ import annotations

import numpy as np
import pytest

from tailstack.tail.per_unit import nearest_units, units_at_ranks

RNG = np.random.default_rng(20)
VALUES = {
    "even": RNG.uniform(-1, 1, 2048),
    "all but a few in one bucket": RNG.standard_cauchy(2048) ** 3,
    "many alike": RNG.integers(0, 5, 2048) * 0.1,
    "all alike": np.full(64, 1.25),
    "neighbours": 1.0 + RNG.integers(0, 3, 64) * np.spacing(1.0),
    "one": np.array([0.3]),
    "over the whole range": np.array([-1.7e308, 0.0, 1.0, 1.7e308]),
    "not finite at the end": np.array([2.0, np.inf, 1.0, np.inf]),
}


@pytest.mark.parametrize("name", VALUES)
def test_ranks_are_those_of_a_sort(name):
    values = VALUES[name]
    ranks = np.unique(np.linspace(0, values.size - 1, 33).astype(np.int64))
    units = units_at_ranks(values, ranks)
    assert np.array_equal(values[units], np.sort(values)[ranks])
    if np.unique(values).size == values.size:
        assert np.array_equal(units, np.argsort(values)[ranks])


def test_all_ranks_are_all_units():
    for name in ("even", "many alike", "all alike"):
        values = VALUES[name]
        assert np.unique(units_at_ranks(values, np.arange(values.size))).size == values.size


def test_a_value_that_is_no_number_ends_nothing():
    """It comes after the others, as NumPy has it."""
    values = np.array([3.0, np.nan, 1.0, 2.0, np.nan])
    assert units_at_ranks(values, np.array([0, 1, 2])).tolist() == [2, 3, 0]
    assert units_at_ranks(np.full(3, np.nan), np.array([1])).size == 1


@pytest.mark.parametrize("count", [1, 20, 64])
@pytest.mark.parametrize("name", ["even", "many alike", "all alike"])
def test_nearest_are_the_first_of_a_sort(name, count):
    away = np.abs(VALUES[name])
    near = nearest_units(away, count)
    assert np.unique(near).size == count
    assert np.array_equal(away[near], np.sort(away)[:count])
