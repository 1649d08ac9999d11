"""The exact law of |N(m, S)| against oracles, closed forms, and quadratures that share no code with it; exp, sin and
cos of its lanes against the maths library."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from math import erf, pi, sqrt
from pathlib import Path

import mpmath
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from laws import norm_cvar
from tailstack.kernels.numerics import eigen_symmetric, exponential, principal_axes, share_lost, sine_and_cosine
from tailstack.tail.gaussian import (
    law_on_axes,
    norm_cdf,
    norm_gradient_jit,
    norm_mean,
    norm_quantile,
    norm_sf,
)

ORACLE = json.loads((Path(__file__).parents[1] / "data/oracles/norm_of_gaussian.json").read_text())
PROBABILITIES = (1e-4, 0.01, 0.3, 0.5, 0.7, 0.95, 0.999, 1 - 1e-6)


@pytest.mark.parametrize("case", ORACLE["cases"], ids=lambda c: f"b={c['b']}")
def test_published_cases(case):
    """P95 and mean of the shared cases (two quadratures, 1e-12; the stated tolerance is 1e-6)."""
    assert norm_quantile(0.95, case["b"], case["S"]) == pytest.approx(case["P95"], rel=1e-11)
    assert norm_mean(case["b"], case["S"]) == pytest.approx(case["mean"], rel=1e-11)


@pytest.mark.parametrize("rank", [1, 2, 3])
@pytest.mark.parametrize("p", PROBABILITIES)
def test_central_isotropic_is_chi(rank, p):
    """Closed form: chi-square with `rank` degrees of freedom, in units that are not 1."""
    variances = np.array([1.0] * rank + [0.0] * (3 - rank)) * 0.04
    expected = 0.2 * sqrt(stats.chi2.ppf(p, rank) if p < 0.9 else stats.chi2.isf(1 - p, rank))
    assert norm_quantile(p, np.zeros(3), np.diag(variances)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("p", PROBABILITIES)
def test_isotropic_is_noncentral_chi(ratio, p):
    """SciPy's (Boost's) noncentral chi-square, at our quantile: relative error of the probability."""
    r = norm_quantile(p, np.array([0.0, ratio, 0.0]), np.eye(3))
    if p < 0.5:
        assert stats.ncx2.cdf(r * r, 3, ratio**2) == pytest.approx(p, rel=1e-10)
    else:
        assert stats.ncx2.sf(r * r, 3, ratio**2) == pytest.approx(1 - p, rel=1e-9)


def test_one_axis_folded_normal_to_the_last_digits():
    """Closed form: |m + sigma z| on one axis; ratio 1e3 and 1e4, both tails, in mpmath."""
    for ratio in (0.5, 3.0, 1e3, 1e4):
        for p in PROBABILITIES:
            with mpmath.workdps(40):
                start = (
                    ratio + float(stats.norm.ppf(p))
                    if ratio > 100
                    else norm_quantile(p, np.array([ratio, 0, 0]), np.diag([1.0, 0, 0]))
                )
                exact = mpmath.findroot(
                    lambda r, a=ratio, q=p: mpmath.ncdf(r - a) - mpmath.ncdf(-r - a) - mpmath.mpf(q), start
                )
            value = norm_quantile(p, np.array([ratio, 0.0, 0.0]), np.diag([1.0, 0.0, 0.0]))
            assert value == pytest.approx(float(exact), rel=1e-12), (ratio, p)


def test_closed_forms_of_a_bias_across_one_axis_and_of_the_mean():
    """Closed form: m perpendicular to rank-one noise, r^2 = m^2 + (sigma z)^2; the excess over m keeps its digits."""
    for sigma in (1e-3, 1.0, 30.0):
        for p in PROBABILITIES:
            z = float(stats.norm.isf((1 - p) / 2))
            value = norm_quantile(p, np.array([0.0, 3.0, 4.0]), np.diag([sigma**2, 0, 0]))
            assert value == pytest.approx(sqrt(25 + (sigma * z) ** 2), rel=1e-13)
    # Noncentral chi with three degrees of freedom, and the folded normal.
    for a in (1e-3, 0.7, 3.0, 200.0):
        three = sqrt(2 / pi) * np.exp(-a * a / 2) + (a + 1 / a) * erf(a / sqrt(2))
        assert norm_mean(np.array([0, 0, a]), np.eye(3)) == pytest.approx(three, rel=1e-10)
        one = sqrt(2 / pi) * np.exp(-a * a / 2) + a * erf(a / sqrt(2))
        assert norm_mean(np.array([0, 0, a]), np.diag([0, 0, 1.0])) == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize("p", [1e-3, 0.6, 1 - 1e-6])
@pytest.mark.parametrize(
    ("m", "variances"),
    [((1000.0, 3.0, 0.0), (1.0, 0.2, 0.0)), ((0.0, 30.0, 0.0), (1.0, 1e-3, 0.0)), ((0.02, 0.5, 0.0), (1.0, 1e-6, 0.0))],
)
def test_singular_and_sharp_laws_in_high_precision(p, m, variances):
    """Independent: rank two with all scale ratios, one mpmath integral of the other axis's exact probability."""
    r = norm_quantile(p, np.array(m), np.diag(variances))
    s1, s2 = sqrt(variances[0]), sqrt(variances[1])
    with mpmath.workdps(30):

        def slice_probability(z):
            h2 = mpmath.mpf(r) ** 2 - (m[1] + s2 * z) ** 2
            if h2 <= 0:
                return mpmath.mpf(0)
            h = mpmath.sqrt(h2)
            if p > 0.9:
                return (mpmath.ncdf(-(h - m[0]) / s1) + mpmath.ncdf((-h - m[0]) / s1)) * mpmath.npdf(z)
            return (mpmath.ncdf((h - m[0]) / s1) - mpmath.ncdf((-h - m[0]) / s1)) * mpmath.npdf(z)

        ends = [(-r - m[1]) / s2, (r - m[1]) / s2]
        inside = sorted({*[mpmath.mpf(e) for e in ends if abs(e) < 12], *map(mpmath.mpf, range(-12, 13, 2))})
        inside = [z for z in inside if ends[0] <= z <= ends[1]] or [mpmath.mpf(ends[0]), mpmath.mpf(ends[1])]
        value = mpmath.quad(slice_probability, inside)
        if p > 0.9:  # what lies outside the slab altogether
            value += mpmath.ncdf(min(ends[0], inside[0])) + mpmath.ncdf(-max(ends[1], inside[-1]))
    expected = mpmath.mpf(1) - mpmath.mpf(p) if p > 0.9 else p
    assert float(value) == pytest.approx(float(expected), rel=2e-9)


def norm_pdf(r, m, S):
    variances, along, _ = principal_axes(m, S)
    return law_on_axes(variances, along, r)[2]


def test_probability_density_and_tail_agree():
    m, S = np.array([0.3, -0.2, 0.5]), np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
    for r in (0.1, 0.7, 1.3, 2.5):
        assert norm_cdf(r, m, S) + norm_sf(r, m, S) == pytest.approx(1.0, abs=1e-13)
        step = 1e-5
        slope = (norm_sf(r - step, m, S) - norm_sf(r + step, m, S)) / (2 * step)
        assert norm_pdf(r, m, S) == pytest.approx(slope, rel=1e-7)
    assert norm_sf(6.0, m, S) == pytest.approx(quad(norm_pdf, 6.0, 9.0, (m, S), epsabs=0, epsrel=1e-10)[0], rel=1e-9)


@pytest.mark.parametrize("p", [1e-4, 0.05, 0.3, 0.6, 0.95, 0.9999])
@pytest.mark.parametrize(
    ("m", "variances"), [((0, 0, 0), (1, 1, 1)), ((0, 0, 3), (1, 0.04, 0)), ((50, 1, 0), (1, 0.1, 0.2))]
)
def test_tail_mean_is_the_integral_of_the_quantile(m, variances, p):
    """Independent of the contour formula: r + int_r^inf P(|e| > x) dx / (1 - p), by QUADPACK."""
    mean, covariance = np.array(m, float), np.diag(np.array(variances, float))
    r = norm_quantile(p, mean, covariance)
    middle = norm_quantile(0.5 + p / 2, mean, covariance)
    far = norm_quantile(1 - 1e-6 * (1 - p), mean, covariance) + 5.0
    area = sum(quad(norm_sf, a, b, (mean, covariance), epsabs=1e-13)[0] for a, b in ((r, middle), (middle, far)))
    assert norm_cvar(p, mean, covariance) == pytest.approx(r + area / (1 - p), rel=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_mean_of_laws_of_any_shape(seed):
    """independent: E|e| as the integral of the tail of |e| over the radius, spreads from equal to 1 : 1e-5 : 1e-10."""
    rng = np.random.default_rng([5, seed])
    variances = np.sort(10.0 ** rng.uniform(-2 * (seed % 6), 0, 3))[::-1]
    mean = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 1) * (seed % 3 > 0)
    covariance = np.diag(variances)
    size, sigma = float(np.linalg.norm(mean)), float(np.sqrt(variances[0]))
    edges = [max(size + k * sigma, 0.0) for k in (-9, -3, -1, 0, 1, 3, 9, 12)]
    parts = (quad(norm_sf, a, b, (mean, covariance), epsabs=1e-13, limit=400)[0] for a, b in pairwise(edges))
    assert norm_mean(mean, covariance) == pytest.approx(edges[0] + sum(parts), rel=1e-10)


@pytest.mark.parametrize("p", [0.01, 0.5, 0.95, 0.9999])
@pytest.mark.parametrize("seed", range(4))
def test_gradient_against_finite_differences(p, seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(3, 3)) * [1.0, 0.3, 0.2]
    S, m = factor @ factor.T, rng.normal(size=3) * seed
    r, _, dm, dS = norm_gradient_jit(m, S, p)
    assert r == norm_quantile(p, m, S)
    np.testing.assert_array_equal(dS, dS.T)
    along_m, along_s = rng.normal(size=3), rng.normal(size=(3, 3))
    along_s = along_s + along_s.T

    def slope(function, h):  # fourth order
        return (8 * (function(h) - function(-h)) - function(2 * h) + function(-2 * h)) / (12 * h)

    h = 1e-3 * sqrt(np.trace(S))
    assert dm @ along_m == pytest.approx(slope(lambda t: norm_quantile(p, m + t * along_m, S), h), rel=1e-5, abs=1e-7)
    h = 1e-3 * np.linalg.eigvalsh(S)[0]
    assert (dS * along_s).sum() == pytest.approx(slope(lambda t: norm_quantile(p, m, S + t * along_s), h), rel=1e-6)


def test_gradient_into_a_direction_without_variance():
    """One-sided difference at a singular covariance: the contour has no 1/l in it."""
    m, S, up = np.array([0.4, 0.0, 0.3]), np.diag([1.0, 0.0, 0.0]), np.diag([0.0, 0.5, 1.0])
    _, _, _, dS = norm_gradient_jit(m, S, 0.9)

    def value(t):
        return norm_quantile(0.9, m, S + t * up)

    h = 1e-5
    assert (dS * up).sum() == pytest.approx((4 * value(h) - value(2 * h) - 3 * value(0.0)) / (2 * h), rel=1e-5)


def test_no_spread_and_the_edge_of_the_support():
    m, zero = np.array([3.0, 0.0, 4.0]), np.zeros((3, 3))
    assert norm_quantile(0.95, m, zero) == norm_cvar(0.95, m, zero) == 5.0
    assert norm_mean(m, zero) == pytest.approx(5.0, rel=1e-14)
    assert (norm_cdf(4.999, m, zero), norm_cdf(5.0, m, zero), norm_sf(5.0, m, zero)) == (0.0, 1.0, 0.0)
    m, S = np.array([0.0, 2.0, 0.0]), np.diag([1.0, 0.0, 0.0])
    assert (norm_cdf(1.9, m, S), norm_sf(1.9, m, S), norm_pdf(1.9, m, S)) == (0.0, 1.0, 0.0)
    assert norm_cdf(0.0, m, S) == 0.0
    assert norm_cdf(2.0, m, S) == 0.0
    assert 0.0 <= norm_cdf(2.0 + 1e-15, m, S) < 1e-6
    # Closed form: m = (0, 2, 0), noise along x; E sqrt(4 + z^2) over |z| >= z_p, by QUADPACK.
    for p in (1e-3, 0.5):
        z = stats.norm.isf((1 - p) / 2)
        area = quad(lambda x: 2 * stats.norm.pdf(x) * sqrt(4 + x * x), z, 12, epsabs=1e-13)[0]
        assert norm_cvar(p, np.array([0, 2.0, 0]), np.diag([1.0, 0, 0])) == pytest.approx(area / (1 - p), rel=1e-10)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ((0.95, (0, 0), np.eye(3)), r"shape \(3,\), got \(2,\)"),
        ((0.95, (0, 0, 0), np.eye(2)), r"shape \(3, 3\), got \(2, 2\)"),
        ((0.95, (0, np.nan, 0), np.eye(3)), "mean must be finite"),
        ((0.95, (0, 0, 0), np.diag([1, np.inf, 1])), "covariance must be finite"),
        ((0.95, (0, 0, 0), [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
        ((0.95, (0, 0, 0), np.diag([1, 1, -1e-3])), "positive semidefinite.*-0.001"),
        *(((p, np.zeros(3), np.eye(3)), "strictly between 0 and 1") for p in (0.0, 1.0, -1.0, np.nan)),
    ],
)
def test_what_is_no_law_and_no_probability_is_named(law, message):
    with pytest.raises(ValueError, match=message):
        norm_quantile(*law)


@pytest.mark.parametrize("seed", range(20))
def test_eigen_solver_against_lapack(seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 1, 3)
    matrix = factor @ factor.T if seed % 2 else rng.normal(size=(3, 3)) + rng.normal(size=(3, 3)).T
    matrix = (matrix + matrix.T) / 2
    values, vectors, _ = eigen_symmetric(matrix)
    scale = np.abs(matrix).max()
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix)[::-1], atol=1e-14 * scale * 3)
    np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, matrix, atol=1e-14 * scale * 3)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("sigma", [1e-7, 3e-8, 1e-9, 1e-12, 1e-20, 1e-35, 1e-150])
def test_noise_lost_in_the_digits_of_the_mean(sigma: float) -> None:
    """closed form: |m + n| = |m| + n along m, to terms of sigma^2 / |m|, which no digit shows."""
    m = np.array([9.18, 6.87, -19.37])
    factor = np.array([[1.0, 0.2, -0.4], [0.0, 0.7, 0.1], [0.3, 0.0, 1.3]]) * sigma
    S = factor @ factor.T
    size, direction = np.linalg.norm(m), m / np.linalg.norm(m)
    along = sqrt(direction @ S @ direction)
    assert norm_quantile(0.95, m, S) == pytest.approx(size + stats.norm.ppf(0.95) * along, rel=2e-15)
    assert norm_cvar(0.95, m, S) == pytest.approx(size + stats.norm.pdf(stats.norm.ppf(0.95)) / 0.05 * along, rel=2e-15)
    assert norm_mean(m, S) == pytest.approx(size, rel=1e-14)
    if sigma > 1e-30:  # below it the law has no spread at all
        _, _, dm, dS = norm_gradient_jit(m, S, 0.95)
        np.testing.assert_allclose(dm, direction, atol=5e-6)
        slope = stats.norm.ppf(0.95) / (2 * along)
        np.testing.assert_allclose(direction @ dS @ direction, slope, rtol=1e-5)
    if sigma > 1e-13:
        near = float(1e-14 * size / along + 1e-5)
        assert norm_sf(float(size + along), m, S) == pytest.approx(stats.norm.sf(1.0), rel=near)


def test_exponential() -> None:
    for x in [*np.linspace(-10, 10, 997), -1e-300, 0.0, 1e-9]:
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=4e-15)
    for x in np.linspace(-30, 30, 101):
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=1e-13)
    for x in np.linspace(-60, -30, 101):
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=3e-10)
    assert exponential(-700.0) == exponential(-math.inf) == pytest.approx(math.exp(-64), rel=1e-9)
    assert math.isnan(exponential(math.nan)) or exponential(math.nan) == exponential(-64.0)


def test_share_lost() -> None:
    """However little is lost, and where all is."""
    for x in [*np.geomspace(1e-300, 700, 2000), 0.0, math.inf]:
        assert share_lost(float(x)) == pytest.approx(-math.expm1(-x), rel=2e-15, abs=0.0)


@pytest.mark.parametrize(
    ("largest", "most"), [(10.0, 2e-16), (1e4, 2e-16), (9e5, 2e-16), (1e9, 1.2e-7), (1e12, 1.3e-4)]
)
def test_sine_and_cosine(largest: float, most: float) -> None:
    rng = np.random.default_rng(3)
    quarters = np.arange(-8, 9) * math.pi / 4
    for x in [*rng.uniform(-largest, largest, 4000), *quarters, 0.0, -0.0]:
        sine, cosine = sine_and_cosine(float(x))
        assert abs(sine - math.sin(x)) <= most
        assert abs(cosine - math.cos(x)) <= most
        assert sine**2 + cosine**2 == pytest.approx(1.0, abs=1e-15)
