"""Worst case over bounded components: brute force, interior points, limits."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tailstack.errors import LimitError
from tailstack.tail import sampling
from tailstack.tail.bounded import worst_case
from tailstack.tail.declared import SAMPLED_METHOD, LinearLaw, law_quantile, linear_law

S = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
BOUNDED = np.array([[0.3, 0.0, -0.1, 0.2], [0.1, 0.2, 0.3, -0.1], [0.0, -0.25, 0.1, 0.05]])
SOURCES = np.array([[0.5, 0.0, 0.2], [0.0, 0.4, 0.1], [0.1, 0.2, -0.6]])


def _at(law, bounded, s):
    return law_quantile(LinearLaw(law.mean + bounded @ np.array(s), law.covariance, law.columns, law.kinds), 0.95)


@pytest.mark.parametrize("mean", [(0, 0, 0), (0.3, -0.1, 0.2)])
@pytest.mark.parametrize("columns", [None, SOURCES])
def test_brute_force(mean, columns):
    law = linear_law(mean, S, columns)
    found = worst_case(law, BOUNDED, 0.95)
    every = {s: _at(law, BOUNDED, s).quantile_mm for s in itertools.product((1.0, -1.0), repeat=4)}
    assert found.quantile.quantile_mm == pytest.approx(max(every.values()), rel=1e-9)
    assert every[tuple(float(s) for s in found.signs)] == pytest.approx(max(every.values()), rel=1e-9)
    assert found.vertices == (16 if any(mean) else 8)
    np.testing.assert_allclose(found.law.mean, law.mean + BOUNDED @ np.array(found.signs))


@pytest.mark.parametrize("mean", [(0, 0, 0), (0.3, -0.1, 0.2)])
def test_brute_force_of_many_vertices_that_are_hard_to_tell_apart(mean):
    """brute force: seven short components, of whose 128 vertices none can be left out beforehand."""
    rng = np.random.default_rng(7)
    law, bounded = linear_law(mean, S, SOURCES), 0.03 * rng.normal(size=(3, 7))
    found = worst_case(law, bounded, 0.95)
    every = {s: _at(law, bounded, s).quantile_mm for s in itertools.product((1.0, -1.0), repeat=7)}
    assert found.quantile.quantile_mm == pytest.approx(max(every.values()), rel=1e-9)
    assert every[tuple(float(s) for s in found.signs)] == pytest.approx(max(every.values()), rel=1e-9)


@pytest.mark.parametrize("columns", [None, SOURCES])
def test_nothing_inside_the_box_is_worse(columns):
    """The theorem (quasi-convexity) tried on 40 interior and face points."""
    law = linear_law([0.3, -0.1, 0.2], S, columns)
    worst = worst_case(law, BOUNDED, 0.95).quantile.quantile_mm
    rng = np.random.default_rng(4)
    for i in range(40):
        s = rng.uniform(-1, 1, 4)
        if i % 2:
            s[rng.integers(4)] = rng.choice([-1, 1])
        assert _at(law, BOUNDED, s).quantile_mm <= worst + 1e-8


def test_the_declared_law_overrules_the_gaussian_ranking():
    """Found by search: the Gaussian of equal covariance ranks another vertex first than the declared law does."""
    rng = np.random.default_rng(0)
    overruled = 0
    for _ in range(60):
        columns = np.diag(rng.uniform(0.1, 2, 3)) @ rng.normal(size=(3, 2))
        bounded = rng.normal(size=(3, 2)) * 0.5
        law = linear_law(rng.normal(size=3) * 0.2, np.eye(3) * 0.02, columns)
        plain = linear_law(law.mean, law.total_covariance)
        found = worst_case(law, bounded, 0.95)
        best = max(_at(law, bounded, s).quantile_mm for s in itertools.product((1.0, -1.0), repeat=2))
        assert found.quantile.quantile_mm == pytest.approx(best, rel=1e-8)
        overruled += found.signs != worst_case(plain, bounded, 0.95).signs
    assert overruled > 0


def test_twelve_bounded_components_beside_a_large_bias_cost_a_few_samples(monkeypatch):
    """closed form: nearly isotropic, the worst vertex is the one farthest away.  Work is counted, not timed: points at
    which a probability was asked for; it was 4,096 vertices times 65,536 points."""
    asked = []
    ask = sampling.Sample.shares

    def count(points, r):
        asked.append(len(points.x))
        return ask(points, r)

    monkeypatch.setattr(sampling.Sample, "shares", count)
    rng = np.random.default_rng(8)
    law = linear_law([14.0, -9.0, 3.0], np.eye(3) * 0.02**2, np.eye(3) * 0.05)
    bounded = rng.normal(size=(3, 12)) * 0.1
    found = worst_case(law, bounded, 0.95)
    sizes = {s: np.linalg.norm(law.mean + bounded @ s) for s in itertools.product((1, -1), repeat=12)}
    assert found.quantile.method == SAMPLED_METHOD
    assert sizes[found.signs] == max(sizes.values())
    assert sum(asked) < 2e6


def test_in_a_plane():
    """The lattice over vertices needs three dimensions; in a plane every vertex is asked one by one."""
    law = linear_law([0, 0.1, 0], np.diag([0, 0.04, 0.09]), np.array([[0.0], [0.4], [0.3]]))
    found = worst_case(law, BOUNDED[:, :2], 0.95)
    best = max(_at(law, BOUNDED[:, :2], s).quantile_mm for s in itertools.product((1.0, -1.0), repeat=2))
    assert found.quantile.quantile_mm == pytest.approx(best, rel=1e-9)


def test_no_bounded_components_and_zero_columns():
    law = linear_law([0.3, 0, 0], S, SOURCES)
    assert worst_case(law, np.zeros((3, 0)), 0.95).quantile == law_quantile(law, 0.95)
    padded = np.column_stack([np.zeros(3), [-0.5, 0, 0], np.zeros(3)])
    assert worst_case(law, padded, 0.95).signs == (1, -1, 1)


def test_no_noise_at_all_is_the_longest_corner():
    found = worst_case(linear_law([1, 0, 0], np.zeros((3, 3))), np.diag([1.0, 2.0, 3.0]), 0.95)
    assert found.quantile.quantile_mm == pytest.approx(np.sqrt(4 + 4 + 9), rel=1e-14)


def test_limits():
    law = linear_law(np.zeros(3), S)
    assert worst_case(law, np.ones((3, 12)), 0.95).vertices == 2048
    with pytest.raises(LimitError, match="13 bounded components"):
        worst_case(law, np.ones((3, 13)), 0.95)
    with pytest.raises(ValueError, match=r"shape \(3, q\)"):
        worst_case(law, np.ones((2, 3)), 0.95)
