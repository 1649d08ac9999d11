"""The smooth closed form: published digits, cumulants by quadrature, floats and CasADi alike."""

from __future__ import annotations

import json
from math import radians, sqrt
from pathlib import Path

import casadi
import numpy as np
import pytest

from tailstack.tail.approximation import (
    pearson_chi2_quantile,
    pearson_wh_quantile,
    pearson_wh_quantile_squared,
    square_cumulants,
)

DATA = Path(__file__).parents[1] / "data/oracles"
CASES = json.loads((DATA / "norm_of_gaussian.json").read_text())["cases"]


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"b={c['b']}")
def test_published_values(case):
    assert pearson_wh_quantile(0.95, case["b"], case["S"]) == pytest.approx(case["pearsonWH"], rel=1e-12)
    assert pearson_chi2_quantile(0.95, case["b"], case["S"]) == pytest.approx(case["pearson_chi2"], rel=1e-11)


def test_best_known_placement_sits_on_its_limit():
    """Published: rotations of uniform half-width tau about the two pivots, P95 at the recorded optimum is the limit."""
    case = json.loads((DATA / "placement_best_known.json").read_text())
    columns = []
    for j, tau in enumerate(case["tau_deg"]):
        lever = np.array(case["target"]) - np.array(case["pivot1"] if j < 3 else case["pivot2"])
        columns.append(radians(tau) * np.cross(np.eye(3)[j % 3], lever))
    total = np.array(case["Sigma_noise"]) + sum(np.outer(g, g) / 3 for g in columns)
    value = pearson_wh_quantile(0.95, np.zeros(3), total, uniform=columns)
    assert value == pytest.approx(case["threshold_mm"], rel=1e-6)


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
    c1, c2, c3 = square_cumulants(m, D + variance * np.outer(g, g), **{kind: [g]})
    assert c1 == pytest.approx(mean, rel=1e-12)
    assert 2 * c2 == pytest.approx(weight @ (q - mean) ** 2, rel=1e-11)
    assert 8 * c3 == pytest.approx(weight @ (q - mean) ** 3, rel=1e-10)


def test_symbols_and_floats_agree():
    m, S, g = [0.3, -0.2, 0.5], [[0.4, 0.1, 0.0], [0.1, 0.3, 0.05], [0.0, 0.05, 0.2]], [0.5, 0.1, 0.0]
    scale = casadi.SX.sym("scale")
    expression = pearson_wh_quantile_squared(
        0.99, square_cumulants([scale * v for v in m], S, [[scale * v for v in g]]), casadi.sqrt
    )
    function = casadi.Function("f", [scale], [expression, casadi.gradient(expression, scale)])
    value, slope = (float(v) for v in function(1.3))

    def number(t):
        return pearson_wh_quantile(0.99, [t * v for v in m], S, [[t * v for v in g]]) ** 2

    assert value == pytest.approx(number(1.3), rel=1e-14)
    assert slope == pytest.approx((number(1.3 + 1e-5) - number(1.3 - 1e-5)) / 2e-5, rel=1e-8)


def test_no_skewness_is_the_normal_quantile():
    """|e|^2 nearly normal (bias a thousand times the noise): c1 + z sqrt(2 c2), closed form."""
    c = square_cumulants([1000.0, 0, 0], np.diag([1.0, 0, 0]))
    assert sqrt(pearson_wh_quantile_squared(0.95, c, sqrt)) == pytest.approx(1000 + 1.6448536269514722, rel=1e-9)
    normal = pearson_wh_quantile_squared(0.95, (5.0, 2.0, 0.0), sqrt)
    assert normal == pytest.approx(5 + 2 * 1.6448536269514722, rel=1e-14)


def test_no_spread_has_no_chi_square():
    with pytest.raises(ValueError, match="third cumulant"):
        pearson_chi2_quantile(0.95, [10.0, 0, 0], np.zeros((3, 3)))
