"""Worst case over bounded components by brute force; bounds of the quantile by oracle, programmes and extremal laws."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from math import sqrt
from pathlib import Path

import cvxpy
import numpy as np
import pytest

from laws import linear_law
from tailstack.errors import LimitError
from tailstack.tail import sampling
from tailstack.tail.bounded import worst_case
from tailstack.tail.bounds import bounds
from tailstack.tail.declared import SAMPLED_METHOD, law_quantile

S = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
BOUNDED = np.array([[0.3, 0.0, -0.1, 0.2], [0.1, 0.2, 0.3, -0.1], [0.0, -0.25, 0.1, 0.05]])
SOURCES = np.array([[0.5, 0.0, 0.2], [0.0, 0.4, 0.1], [0.1, 0.2, -0.6]])


def _check_by_brute_force(law, bounded):
    """What is found is the worst of all vertices."""
    found = worst_case(law, bounded, 0.95)
    signs = itertools.product((1.0, -1.0), repeat=bounded.shape[1])
    every = {s: law_quantile(replace(law, mean=law.mean + bounded @ s), 0.95).quantile_mm for s in signs}
    assert found.quantile.quantile_mm == pytest.approx(max(every.values()), rel=1e-9)
    assert every[tuple(float(s) for s in found.signs)] == pytest.approx(max(every.values()), rel=1e-9)
    return found


@pytest.mark.parametrize("mean", [(0, 0, 0), (0.3, -0.1, 0.2)])
@pytest.mark.parametrize("columns", [None, SOURCES])
def test_brute_force(mean, columns):
    law = linear_law(mean, S, columns)
    found = _check_by_brute_force(law, BOUNDED)
    assert found.vertices == (16 if any(mean) else 8)
    np.testing.assert_allclose(found.law.mean, law.mean + BOUNDED @ np.array(found.signs))


@pytest.mark.parametrize("mean", [(0, 0, 0), (0.3, -0.1, 0.2)])
def test_brute_force_of_many_vertices_that_are_hard_to_tell_apart(mean):
    """brute force: seven short components, of whose 128 vertices none can be left out beforehand."""
    rng = np.random.default_rng(7)
    law, bounded = linear_law(mean, S, SOURCES), 0.03 * rng.normal(size=(3, 7))
    _check_by_brute_force(law, bounded)


def test_the_declared_law_overrules_the_gaussian_ranking():
    """Found by search: the Gaussian of equal covariance ranks another vertex first than the declared law does."""
    rng = np.random.default_rng(0)
    overruled = 0
    for _ in range(60):
        columns = np.diag(rng.uniform(0.1, 2, 3)) @ rng.normal(size=(3, 2))
        bounded = rng.normal(size=(3, 2)) * 0.5
        law = linear_law(rng.normal(size=3) * 0.2, np.eye(3) * 0.02, columns)
        plain = linear_law(law.mean, law.total_covariance)
        overruled += _check_by_brute_force(law, bounded).signs != worst_case(plain, bounded, 0.95).signs
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
    _check_by_brute_force(law, BOUNDED[:, :2])


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


CASES = json.loads((Path(__file__).parents[1] / "data/oracles/moment_only_bound.json").read_text())["cases"]


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"b={c['b']}")
def test_published_moment_bounds(case):
    value = bounds(0.95, case["b"], case["S"]).moments
    assert value == pytest.approx(case["P95_dro_dual"], rel=1e-8)
    if case["chebyshev_zero_mean"] is not None:
        assert value == pytest.approx(case["chebyshev_zero_mean"], rel=1e-14)
    if case["gauss"] is not None:
        assert bounds(0.95, case["b"], case["S"]).gaussian == pytest.approx(case["gauss"], rel=1e-11)


@pytest.mark.parametrize("seed", range(5))
def test_moment_bound_against_a_semidefinite_solver(seed):
    """Independent: the programme itself by cvxpy (Clarabel): the probability at our r is 1 - p."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(3, 3)) * [1.0, 0.6, 0.3]
    m, S = rng.normal(size=3) * 0.5 * seed, factor @ factor.T
    r = bounds(0.9, m, S).moments
    second = np.block([[S + np.outer(m, m), m[:, None]], [m[None, :], np.ones((1, 1))]])
    M, t = cvxpy.Variable((4, 4), PSD=True), cvxpy.Variable(nonneg=True)
    indicator = np.diag([0.0, 0, 0, 1]) + t * np.diag([1.0, 1, 1, -(r**2)])
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.trace(M @ second)), [M - indicator >> 0])
    assert problem.solve(solver=cvxpy.CLARABEL) == pytest.approx(0.1, rel=2e-5)


def test_closed_forms_on_one_axis_and_without_mean():
    eps = 0.02
    cantelli = 3 + 2 * sqrt(1 / eps - 1)
    assert bounds(1 - eps, np.array([3, 0, 0]), np.diag([4, 0, 0])).moments == pytest.approx(cantelli, rel=1e-12)
    S = np.diag([1.0, 0.5, 0.2])
    assert bounds(1 - eps, np.zeros(3), S).moments == pytest.approx(sqrt(1.7 / eps), rel=1e-14)
    gauss = sqrt(0.4 ** (2 / 3) * 1.7 / eps)  # Gauss-Camp-Meidell with alpha = 3
    assert bounds(1 - eps, np.zeros(3), S).unimodal == pytest.approx(gauss, rel=1e-12)
    on_a_line = bounds(1 - eps, np.zeros(3), np.diag([0, 4, 0])).unimodal  # Gauss's own inequality
    assert on_a_line == pytest.approx(2 * sqrt(4 / 9 / eps), rel=1e-12)


def test_unimodal_bound_is_attained_without_mean():
    """The extremal law: mass at 0 and U^(1/3) on a sphere of radius r (5/2)^(1/3); its exceedance in closed form."""
    eps = 0.03
    S = np.eye(3) * 0.7
    r = bounds(1 - eps, np.zeros(3), S).unimodal
    radius = r * 2.5 ** (1 / 3)
    mass = 2.1 / (0.6 * radius**2)  # E|e|^2 = mass * radius^2 * 3/5 = tr S
    assert mass * (1 - (r / radius) ** 3) == pytest.approx(eps, rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_unimodal_bound_holds_for_a_heavy_mixture(seed):
    """Uniform laws on symmetric bodies mixed badly on purpose: ellipsoid and segment along the mean, sampled.

    400 000 points: the standard error of the exceedance is below 5e-4, and it must stay under eps + 3 of them.
    """
    rng = np.random.default_rng(seed)
    m = rng.normal(size=3) * [0, 0.3, 1, 3][seed % 4]
    n, eps = 400_000, 0.1
    axis = m / np.linalg.norm(m) if m.any() else np.array([0, 0, 1.0])
    ball = rng.normal(size=(n, 3))
    ball *= (rng.random(n) ** (1 / 3) / np.linalg.norm(ball, axis=1))[:, None]
    long = rng.random(n) < 0.2
    x = np.where(long[:, None], rng.uniform(-4, 4, n)[:, None] * axis, 0.3 * ball)
    S = 0.8 * 0.09 / 5 * np.eye(3) + 0.2 * 16 / 3 * np.outer(axis, axis)
    r = bounds(1 - eps, m, S).unimodal
    assert (np.linalg.norm(m + x, axis=1) > r).mean() < eps + 1.5e-3


def test_no_spread():
    ladder = bounds(0.95, np.array([3.0, 4.0, 0]), np.zeros((3, 3)))
    assert (ladder.gaussian, ladder.unimodal, ladder.moments) == (5.0, 5.0, 5.0)
