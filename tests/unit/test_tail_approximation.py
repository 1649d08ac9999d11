"""The smooth closed form: published digits, cumulants by quadrature, floats and CasADi alike."""

from __future__ import annotations

import json
from math import radians, sqrt
from pathlib import Path

import casadi
import numpy as np
import pytest
from scipy import stats

from tailstack.tail.approximation import (
    _moment_at_quantile,
    columns_in_cumulants,
    pearson_square,
    square_cumulants,
    unit_quantile_squared,
)

DATA = Path(__file__).parents[1] / "data/oracles"
NDTRI_95 = 1.6448536269514722
CASES = json.loads((DATA / "norm_of_gaussian.json").read_text())["cases"]


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"b={c['b']}")
def test_published_values(case):
    square = pearson_square(*square_cumulants(case["b"], case["S"]), NDTRI_95)
    assert sqrt(square) == pytest.approx(case["pearsonWH"], rel=1e-12)


def test_best_known_placement_sits_on_its_limit():
    """Published: rotations of uniform half-width tau about the two pivots, P95 at the recorded optimum is the limit."""
    case = json.loads((DATA / "placement_best_known.json").read_text())
    columns = []
    for j, tau in enumerate(case["tau_deg"]):
        lever = np.array(case["target"]) - np.array(case["pivot1"] if j < 3 else case["pivot2"])
        columns.append(radians(tau) * np.cross(np.eye(3)[j % 3], lever))
    total = np.array(case["Sigma_noise"]) + sum(np.outer(g, g) / 3 for g in columns)
    square = pearson_square(*square_cumulants(np.zeros(3), total, columns), NDTRI_95)
    assert sqrt(square) == pytest.approx(case["threshold_mm"], rel=1e-6)


@pytest.mark.parametrize("kind", ["uniform", "triangular"])
def test_cumulants_against_quadrature(kind):
    """Independent: cumulants of |m + g u + N(0, D)|^2, the moments by Gauss rules exact for the polynomials at hand."""
    m, g, D = np.array([0.4, -0.2, 0.7]), np.array([0.9, 0.3, -0.5]), np.diag([0.2, 0.05, 0.1])
    x, wx = np.polynomial.hermite_e.hermegauss(8)
    if kind == "uniform":
        u, wu = np.polynomial.legendre.leggauss(8)
        wu, variance = wu / 2, 1 / 3
    else:  # density 1 - |u|: a rule for each half
        v, wv = np.polynomial.legendre.leggauss(8)
        half, weight = (v + 1) / 2, wv / 2 * (1 - (v + 1) / 2)
        u, wu, variance = np.concatenate([-half, half]), np.concatenate([weight, weight]), 1 / 6
    a, b, c, t = np.meshgrid(x, x, x, u, indexing="ij")
    weight = np.einsum("i,j,k,l->ijkl", wx, wx, wx, wu) / (2 * np.pi) ** 1.5
    e = m[:, None] + np.sqrt(np.diag(D))[:, None] * np.stack([a, b, c]).reshape(3, -1) + g[:, None] * t.ravel()
    q, weight = (e**2).sum(axis=0), weight.ravel()
    mean = weight @ q
    columns = ([g],) if kind == "uniform" else ([], [g])
    c1, c2, c3 = square_cumulants(m, D + variance * np.outer(g, g), *columns)
    assert c1 == pytest.approx(mean, rel=1e-12)
    assert 2 * c2 == pytest.approx(weight @ (q - mean) ** 2, rel=1e-11)
    assert 8 * c3 == pytest.approx(weight @ (q - mean) ** 3, rel=1e-10)


def test_what_columns_add_to_cumulants_is_the_same_for_every_mean_and_covariance():
    """Independent: each column by itself (held against quadrature above)."""
    rng = np.random.default_rng(3)
    columns, kinds = rng.normal(size=(2, 3, 5)), np.array([0, 1, 1, 0, 1])
    second, third, shape = columns_in_cumulants(columns, kinds)
    root, mean = rng.normal(size=(3, 3)), rng.normal(size=3)
    total = root @ root.T
    for own, by_second, by_third, by_shape in zip(columns, second, third, shape, strict=True):
        c1, c2, c3 = square_cumulants(mean, total, own[:, kinds == 0].T, own[:, kinds == 1].T)
        plain = square_cumulants(mean, total)
        assert (c1, c2) == pytest.approx((plain[0], plain[1] + by_second), rel=1e-12)
        rest = np.trace(by_shape @ (total + np.outer(mean, mean)))
        assert c3 == pytest.approx(plain[2] + by_third + rest, rel=1e-12)


def test_no_skewness_is_the_normal_quantile():
    """|e|^2 nearly normal (bias a thousand times the noise): c1 + z sqrt(2 c2), closed form."""
    c = square_cumulants([1000.0, 0, 0], np.diag([1.0, 0, 0]))
    assert sqrt(pearson_square(*c, NDTRI_95)) == pytest.approx(1000 + NDTRI_95, rel=1e-9)
    assert pearson_square(5.0, 2.0, 0.0, NDTRI_95) == pytest.approx(5 + 2 * NDTRI_95, rel=1e-14)


UNIFORM = [[0.7, 0.0, 0.1], [0.1, 0.2, 0.3]]
TRIANGULAR = [[0.0, 0.6, 0.0]]
BOUNDED = np.array(UNIFORM).T @ np.array(UNIFORM) / 3 + np.array(TRIANGULAR).T @ np.array(TRIANGULAR) / 6
UNIT = np.array([[0.05, 0.01, 0.0], [0.01, 0.02, -0.01], [0.0, -0.01, 0.03]])
SHOT = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
MEAN = np.array([0.3, -0.1, 0.2])


@pytest.mark.long("0.9-0.95-0.1", "0.9-0.95-0.5", "0.95-0.8-2.0")
@pytest.mark.parametrize("scale", [0.1, 0.5, 2.0])
@pytest.mark.parametrize(("p", "fraction"), [(0.9, 0.95), (0.95, 0.8)])
def test_per_unit_against_nested_draws(scale, p, fraction):
    """Independent: 3000 units drawn plainly, 1500 shots each.

    The 3 % are for the closed form; the standard error of the draws is 0.2 ... 1.0 %, their seed fixed.
    """
    rng = np.random.default_rng(3)
    n = 3000
    d = MEAN + rng.multivariate_normal(np.zeros(3), UNIT, n) + rng.uniform(-1, 1, (n, 2)) @ UNIFORM
    d = d + (rng.uniform(-0.5, 0.5, (n, 1)) + rng.uniform(-0.5, 0.5, (n, 1))) @ TRIANGULAR
    s = scale * rng.standard_normal((n, 1500, 3)) @ np.linalg.cholesky(SHOT).T
    reference = np.quantile(np.quantile(np.linalg.norm(d[:, None] + s, axis=2), p, axis=1), fraction)
    square = unit_quantile_squared(p, fraction, MEAN, UNIT + BOUNDED, scale**2 * SHOT, UNIFORM, TRIANGULAR)
    assert sqrt(square) == pytest.approx(reference, rel=0.03)


@pytest.mark.parametrize("shot", [0.02, 0.2, 2.0])
@pytest.mark.parametrize("fraction", [0.8, 0.95, 0.99])
def test_per_unit_isotropic(shot, fraction):
    """Closed form: R at the quantile of |d|, by chi and noncentral chi-square."""
    distance = stats.chi.ppf(fraction, 3)
    exact = shot * sqrt(stats.ncx2.ppf(0.95, 3, (distance / shot) ** 2))
    square = unit_quantile_squared(0.95, fraction, [0, 0, 0], np.eye(3), shot**2 * np.eye(3), [], [])
    assert sqrt(square) == pytest.approx(exact, rel=0.01)


def test_per_unit_where_one_part_is_absent():
    """Closed form: without shots the quantile of |d|; without an installation that of |m + shot|; without both |m|."""
    none = np.zeros((3, 3))
    cumulants = square_cumulants(MEAN, UNIT + BOUNDED, UNIFORM, TRIANGULAR)
    still = unit_quantile_squared(0.95, 0.9, MEAN, UNIT + BOUNDED, none, UNIFORM, TRIANGULAR)
    assert still == pytest.approx(pearson_square(*cumulants, stats.norm.ppf(0.9)), rel=2e-5)
    alike = unit_quantile_squared(0.95, 0.9, MEAN, none, SHOT, [], [])
    assert alike == pytest.approx(pearson_square(*square_cumulants(MEAN, SHOT), NDTRI_95), rel=2e-5)
    fixed = unit_quantile_squared(0.95, 0.9, MEAN, none, none, [], [])
    assert fixed == pytest.approx(MEAN @ MEAN, rel=2e-5)


def test_moment_at_quantile_is_the_derivative_by_the_metric():
    """Independent: differences of the quantile of |L d|^2, L a root of the metric, from the cumulants of L d."""
    base = np.array([[1.4, 0.2, -0.1], [0.2, 1.1, 0.3], [-0.1, 0.3, 2.0]])
    total, step = UNIT + BOUNDED, 1e-5

    def quantile(metric):
        root = np.linalg.cholesky(metric).T
        moved = square_cumulants(root @ MEAN, root @ total @ root.T, UNIFORM @ root.T, TRIANGULAR @ root.T)
        return pearson_square(*moved, stats.norm.ppf(0.9))

    moment = np.array(_moment_at_quantile(0.9, base, MEAN, total, (UNIFORM, TRIANGULAR)))
    assert np.allclose(moment, moment.T, rtol=1e-14)
    assert np.trace(base @ moment) == pytest.approx(quantile(base), rel=1e-12)
    for i in range(3):
        for j in range(i + 1):
            change = np.zeros((3, 3))
            change[i, j] = change[j, i] = step
            slope = (quantile(base + change) - quantile(base - change)) / (2 * step)
            assert slope == pytest.approx(np.sum(change * moment) / step, rel=1e-7)


@pytest.mark.parametrize(("unit", "shot"), [(1.3, 0.7), (0.0, 0.7), (1.3, 0.0)])
@pytest.mark.parametrize("with_mean", [False, True])
def test_per_unit_symbols_and_floats_agree(unit, shot, with_mean):
    """Independent: the slopes by standard deviations against differences of floats, one-sided at the limits."""
    u, s = casadi.SX.sym("u"), casadi.SX.sym("s")
    mean = MEAN if with_mean else np.zeros(3)

    def square(u, s):
        def scaled(by, rows):
            return [[by * float(x) for x in row] for row in rows]

        covariance, shots = scaled(u * u, UNIT + BOUNDED), scaled(s * s, SHOT)
        columns = scaled(u, UNIFORM), scaled(u, TRIANGULAR)
        return unit_quantile_squared(0.95, 0.9, [float(m) for m in mean], covariance, shots, *columns)

    expression = square(u, s)
    function = casadi.Function("f", [u, s], [expression, *(casadi.gradient(expression, x) for x in (u, s))])
    value, by_unit, by_shot = (float(v) for v in function(unit, shot))
    assert value == pytest.approx(square(unit, shot), rel=1e-13)
    assert np.isfinite([by_unit, by_shot]).all()
    step = 1e-5
    if unit:
        slope = (square(unit + step, shot) - square(unit - step, shot)) / (2 * step)
        assert by_unit == pytest.approx(slope, rel=1e-7)
    if shot:
        slope = (square(unit, shot + step) - square(unit, shot - step)) / (2 * step)
        assert by_shot == pytest.approx(slope, rel=1e-7)
