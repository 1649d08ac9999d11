"""Laws with uniform and triangular sources, their summaries, folded columns and batched removals, against quadrature,
closed forms, differences and sampling."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from math import comb, factorial, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import j0, j1

from laws import linear_law, norm_cvar
from scenes import random_system
from tailstack.budget import budget, lines_of
from tailstack.contributors import error_law
from tailstack.errors import NotConvergedError
from tailstack.laws import SUMS
from tailstack.propagation.linear import linearise
from tailstack.system import Law
from tailstack.tail.declared import (
    GAUSSIAN_METHOD,
    LATTICE_METHOD,
    SAMPLED_METHOD,
    LawGradient,
    LawReading,
    accuracy_for,
    end_of,
    lattice_columns,
    law_cdf,
    law_exceedance,
    law_gradient,
    law_quantile,
    quantiles_at,
    solve_about,
    solve_on_axes,
)
from tailstack.tail.gaussian import norm_cdf, norm_gradient_jit, norm_mean, norm_quantile, norm_sf
from tailstack.tail.lattice import (
    LOG_SINC,
    Accuracy,
    along_line,
    ball_integral,
    ball_sums,
    bessel_j01,
    build,
    fold_small,
    higher_orders,
    in_plane,
    on_principal_axes,
    sines,
)
from tailstack.tail.sampling import sample

UNIFORM, TRIANGULAR = SUMS.index(Law.UNIFORM), SUMS.index(Law.TRIANGULAR)
CUBE = json.loads((Path(__file__).parents[1] / "data/oracles/noise_covariance_cube8.json").read_text())
NOISE = np.array(CUBE["Sigma"])


def average(law, function):
    """Mean of function(mean shifted by the columns) over two sources, by Gauss-Legendre: no lattice in it."""
    x, w = np.polynomial.legendre.leggauss(24)
    rules = []
    for kind in law.kinds:
        if kind == UNIFORM:
            rules.append(list(zip(x, w / 2, strict=True)))
        else:
            half, weight = (x + 1) / 2, w / 2 * (1 - (x + 1) / 2)
            rules.append([*zip(-half, weight, strict=True), *zip(half, weight, strict=True)])
    first, second = rules
    return sum(a * b * function(law.mean + law.columns @ np.array([u, v])) for u, a in first for v, b in second)


def quantile_by_quadrature(law, low, high):
    """P95, which lies between."""
    return brentq(lambda r: average(law, lambda m: norm_cdf(r, m, law.covariance)) - 0.95, low, high, xtol=1e-10)


def mount_columns(position, pivot, degrees, mm):
    """(3, 6) displacement of a point by a mount's half-widths: three rotations about its pivot, three translations."""
    lever = np.array(position) - np.array(pivot)
    turns = [np.radians(degrees) * np.cross(axis, lever) for axis in np.eye(3)]
    return np.column_stack([*turns, *(mm * np.eye(3))])


COLUMNS = np.hstack(
    [mount_columns((0, 0, 70), (0, 0, -95), 0.25, 0.1), mount_columns((0, 0, 70), (0, 0, -145), 0.15, 0.2)]
)
REFERENCE = linear_law(np.zeros(3), NOISE, COLUMNS)
SPREAD = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
SKEWED = linear_law([0.3, -0.2, 0.5], SPREAD, np.array([[0.6, 0.1], [-0.2, 0.5], [0.1, 0.4]]), [UNIFORM, TRIANGULAR])


def test_the_reference_of_the_method_notes_and_of_a_sample():
    """Published, sampled: 1.2889 (its standard error is some 1e-4); the Gaussian of equal covariance to all digits."""
    result = law_quantile(REFERENCE, 0.95)
    assert result.quantile_mm == pytest.approx(1.2889, abs=4e-4)
    assert result.method == LATTICE_METHOD
    assert result.error_mm < 1e-6
    assert norm_quantile(0.95, REFERENCE.mean, REFERENCE.total_covariance) == pytest.approx(1.3574, abs=5e-5)
    # Two million draws: the probability at our quantile within 3.5 standard errors (0.00054).
    rng = np.random.default_rng(11)
    n = 2_000_000
    e = rng.standard_normal((n, 3)) @ np.linalg.cholesky(NOISE).T + rng.uniform(-1, 1, (n, 12)) @ COLUMNS.T
    for p in (0.05, 0.5, 0.95, 0.999):
        inside = ((e**2).sum(axis=1) <= law_quantile(REFERENCE, p).quantile_mm ** 2).mean()
        assert abs(inside - p) < 3.5 * sqrt(p * (1 - p) / n)


@pytest.mark.parametrize("p", [1e-3, 0.2, 0.5, 0.95, 0.9999])
def test_two_sources_by_quadrature(p):
    result = law_quantile(SKEWED, p)
    assert average(SKEWED, lambda m: norm_cdf(result.quantile_mm, m, SKEWED.covariance)) == pytest.approx(p, abs=2e-8)
    assert law_cdf(SKEWED, result.quantile_mm) == pytest.approx(p, abs=2e-8)
    assert law_exceedance(SKEWED, result.quantile_mm) == pytest.approx(1 - p, abs=2e-8)
    step = 1e-4
    slope = (law_cdf(SKEWED, result.quantile_mm + step) - law_cdf(SKEWED, result.quantile_mm - step)) / (2 * step)
    assert result.density == pytest.approx(slope, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("p", [0.5, 0.95, 0.99])
@pytest.mark.parametrize("spread", [0.05, 2.0])
def test_one_law_at_many_means_by_quadrature(p, spread):
    """independent: Gauss-Legendre over both sources; means that go together, and others, which are solved alone."""
    means = np.random.default_rng(5).normal(size=(6, 3))
    means *= (1 + spread * np.linspace(0, 1, 6)[:, None]) / np.linalg.norm(means, axis=1)[:, None]
    found = quantiles_at(SKEWED, means, p)
    for mean, r in zip(means, found, strict=True):
        moved = replace(SKEWED, mean=mean)
        assert average(moved, lambda m, r=r: norm_cdf(r, m, SKEWED.covariance)) == pytest.approx(p, abs=2e-5)
    frame = on_principal_axes(np.zeros(3), SKEWED.covariance, lattice_columns(SKEWED)[0])
    together = solve_about(p, means @ frame.axes, frame, accuracy_for(p, False))
    assert np.isnan(together).all() == (spread > 1)
    assert not np.isnan(together).any() or spread > 1


def test_sum_of_uniforms_on_a_line_is_irwin_hall():
    """Closed form: six equal uniform sources on one skew axis, a bias across it, no noise."""
    n, half = 6, 0.3
    axis = np.array([2, -1, 2]) / 3
    law = linear_law([1, 2, 0], np.zeros((3, 3)), half * np.outer(axis, np.ones(n)))  # (1, 2, 0) is perpendicular

    def cdf(x):  # of the sum of n uniforms on (0, 1)
        return sum((-1) ** k * comb(n, k) * (x - k) ** n for k in range(int(x) + 1)) / factorial(n)

    for p in (0.1, 0.5, 0.95, 0.999):
        result = law_quantile(law, p)
        along = sqrt(result.quantile_mm**2 - 5)
        shift = along / (2 * half)
        assert cdf(n / 2 + shift) - cdf(n / 2 - shift) == pytest.approx(p, abs=5e-7)


@pytest.mark.parametrize("r", [0.2, 0.9, 2.0])
def test_lattice_without_sources_is_the_gaussian_law(r):
    """The lattice and the contour integral share no code."""
    m, S = np.array([0.3, -0.2, 0.5]), SKEWED.covariance
    lattice = build(r, on_principal_axes(m, S, np.empty((0, 3))), Accuracy(1e-13, 1e-13, 1e7), False)
    value, density, _ = ball_sums(r, 3, lattice.t, lattice.w)
    assert value == pytest.approx(norm_cdf(r, m, S), abs=1e-11)
    assert density > 0


def test_one_uniform_source():
    """|2 u| <= r: the slowest lattice sum there is, within its own stated error."""
    law = linear_law(np.zeros(3), np.zeros((3, 3)), np.array([[0.0], [2.0], [0.0]]))
    result = law_quantile(law, 0.9)
    assert abs(result.quantile_mm - 1.8) <= result.error_mm < 1e-5
    assert LawReading(law, 0.95).mean_norm_mm == pytest.approx(1.0, abs=1e-6)
    assert LawReading(law, 0.9).cvar_mm == pytest.approx(1.9, abs=1e-6)


def test_coarse_errors_are_stated_honestly():
    rng = np.random.default_rng(8)
    for _ in range(12):
        factor = rng.normal(size=(3, 3)) * rng.uniform(0.05, 0.3)
        law = linear_law(rng.normal(size=3) * 0.5, factor @ factor.T + 1e-3 * np.eye(3), rng.normal(size=(3, 7)) * 0.4)
        coarse, fine = law_quantile(law, 0.95, fine=False), law_quantile(law, 0.95)
        assert abs(coarse.quantile_mm - fine.quantile_mm) <= 4 * coarse.error_mm
        assert fine.error_mm < 1e-5


def slopes_of(law, p) -> LawGradient:
    return law_gradient(law, law_quantile(law, p), fine=False)


def test_derivatives_of_laws_off_the_lattice():
    """A plane (differences of exact sums) and a Gaussian (contour)."""
    S = np.diag([0.0, 0.09, 0.04])
    flat = linear_law([0, 0.2, 0.1], S, np.array([[0.0], [0.5], [0.3]]))
    slopes = slopes_of(flat, 0.9)
    longer = linear_law(flat.mean, S, flat.columns * 1.002)
    shorter = linear_law(flat.mean, S, flat.columns * 0.998)
    slope = (law_quantile(longer, 0.9).quantile_mm - law_quantile(shorter, 0.9).quantile_mm) / 0.004
    assert slopes.by_log_column[0] == pytest.approx(slope, rel=1e-3)
    plain = slopes_of(linear_law([0.1, 0, 0], NOISE), 0.9)
    _, _, dm, ds = norm_gradient_jit(np.array([0.1, 0, 0]), NOISE, 0.9)
    np.testing.assert_allclose(plain.by_mean, dm)
    np.testing.assert_allclose(plain.by_covariance, ds)


FAR = linear_law(
    [16.5, -5.0, -4.5],
    [[0.010, 0.002, 0.001], [0.002, 0.012, -0.003], [0.001, -0.003, 0.009]],
    np.array([[0.20, -0.05], [0.03, 0.18], [-0.06, 0.10]]),
    [UNIFORM, TRIANGULAR],
)


@pytest.mark.long
def test_a_mean_far_beyond_the_spread_has_the_quantile_and_slopes_of_quadrature():
    """independent: Gauss-Legendre over both sources of the Gaussian's own law, and its differences; far too many points
    for a lattice.  Sampled: 4 standard errors as stated; slopes to 2 %."""
    p, step, quantile = 0.95, 1e-3, partial(quantile_by_quadrature, low=15, high=25)
    total, slopes = law_quantile(FAR, p), slopes_of(FAR, p)
    assert total.method == SAMPLED_METHOD
    assert total.error_mm < 1e-4
    assert abs(total.quantile_mm - quantile(FAR)) < 4 * total.error_mm
    up, down = (quantile(replace(FAR, mean=FAR.mean + s * step * np.eye(3)[0])) for s in (1, -1))
    assert slopes.by_mean[0] == pytest.approx((up - down) / (2 * step), rel=2e-3)
    for j in range(2):
        grow = np.ones(2)
        grow[j] += step
        up, down = (quantile(replace(FAR, columns=FAR.columns * by)) for by in (grow, 2 - grow))
        assert slopes.by_log_column[j] == pytest.approx((up - down) / (2 * step), abs=0.02 * 0.1)
    block = np.diag([0.01, 0.005, 0.002])
    up, down = (quantile(replace(FAR, covariance=FAR.covariance + s * step * block)) for s in (1, -1))
    assert (slopes.by_covariance * block).sum() == pytest.approx((up - down) / (2 * step), rel=0.02)


@pytest.mark.long("2", "20", "200")
@pytest.mark.parametrize("spreads", [0, 2, 8, 20, 50, 200, 1000])
def test_a_bias_of_any_size_costs_a_bounded_number_of_points(spreads):
    """Points are counted, not time: two million of a lattice, 65,536 of a sample.

    independent: the quantile by quadrature over both sources, 4 of the errors stated."""
    law = replace(FAR, mean=FAR.mean / np.linalg.norm(FAR.mean) * spreads * 0.15)
    h, _ = lattice_columns(law)
    frame = on_principal_axes(law.mean, law.covariance, h)
    solution = solve_on_axes(0.95, frame, accuracy_for(0.95, True))
    assert solution.lattice.t.size < 2e6
    assert solution.found or sample(law.mean, law.covariance, h, 12).x.shape[0] == 65_536
    quantile = law_quantile(law, 0.95)
    assert (quantile.method == LATTICE_METHOD) == solution.found
    expected = quantile_by_quadrature(law, quantile.quantile_mm - 0.1, quantile.quantile_mm + 0.1)
    assert abs(quantile.quantile_mm - expected) < 4 * quantile.error_mm + 1e-7


@pytest.mark.long
def test_many_small_columns_are_one_gaussian_with_what_that_changes_stated():
    """independent: 400,000 draws of all 200 columns themselves; 4 standard errors of both."""
    rng = np.random.default_rng(3)
    columns = np.hstack([rng.normal(size=(3, 198)) * 0.008, rng.normal(size=(3, 2)) * 0.15])
    law = linear_law([12.0, 3.0, -4.0], np.eye(3) * 4e-4, columns)
    found = law_quantile(law, 0.95)
    assert found.method == SAMPLED_METHOD
    norms = []
    for _ in range(8):
        drawn = law.mean + rng.normal(size=(50_000, 3)) * 0.02 + rng.uniform(-1, 1, (50_000, 200)) @ columns.T
        norms.append(np.linalg.norm(drawn, axis=1))
    ordered = np.sort(np.concatenate(norms))
    spread = 4 * sqrt(0.95 * 0.05 * ordered.size)
    low, high = (ordered[int(0.95 * ordered.size + s * spread)] for s in (-1, 1))
    assert low - 4 * found.error_mm < found.quantile_mm < high + 4 * found.error_mm
    assert found.error_mm < 0.002  # of 13 mm; nearly all of it is the bound of what the Gaussian changes
    points = sample(law.mean, law.covariance, law.columns.T, 8)
    assert points.explicit.sum() == 32
    assert 0 < points.folded < 2e-3


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="between 0 and 1"):
        law_quantile(SKEWED, 1.0)
    with pytest.raises(ValueError, match=">= 0 mm"):
        law_cdf(SKEWED, -1.0)


def test_bessel_functions_and_sines_in_lanes_are_those_of_the_libraries():
    for x in (0.0, 1e-9, 1e-3, 0.5, 2.4, 10.0, 29.99, 30.01, 77.0, 900.0):
        assert bessel_j01(x) == pytest.approx((j0(x), j1(x)), abs=3e-15)
    # independent: the C library's, up to angles of a hundred thousand.
    t = np.concatenate([[0.0, 1e-9], np.linspace(0, 40, 1001), np.geomspace(40, 1e5, 500)])
    s, c = np.empty(t.size), np.empty(t.size)
    sines(1.7, t, s, c)
    assert np.abs(s - np.sin(1.7 * t)).max() < 1e-15
    assert np.abs(c - np.cos(1.7 * t)).max() < 1e-15


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_ball_transforms_against_quadrature(dimension):
    """Independent: the transform of the sphere of radius x, integrated over x; derivatives by differences."""
    surface = {
        1: lambda x, t: 2 * np.cos(x * t),
        2: lambda x, t: 2 * pi * x * j0(x * t),
        3: lambda x, t: 4 * pi * x**2 * np.sinc(x * t / pi),
    }[dimension]
    one = np.ones(1)
    for t in (0.0, 1e-3, 0.7, 12.0):
        value, first, second = ball_sums(1.3, dimension, np.array([t]), one)
        assert value == pytest.approx(quad(surface, 0, 1.3, (t,))[0], rel=1e-9)
        assert first == pytest.approx(surface(1.3, t), rel=1e-9)
        h = 1e-5
        assert second == pytest.approx((surface(1.3 + h, t) - surface(1.3 - h, t)) / (2 * h), rel=1e-6, abs=1e-6)
        inner = quad(lambda x, t=t: ball_sums(x, dimension, np.array([t]), one)[0], 0, 1.3, epsabs=1e-11)[0]
        assert ball_integral(1.3, dimension, np.array([t]), one) == pytest.approx(inner, rel=1e-7)


def draw_norms(law, count, seed):
    """(count,) norms of independent draws of a law's own deviates."""
    rng, k = np.random.default_rng(seed), law.kinds.size
    u = rng.uniform(-1, 1, (count, k))
    u = np.where(law.kinds == TRIANGULAR, 0.5 * (u + rng.uniform(-1, 1, (count, k))), u)
    root = np.linalg.cholesky(law.covariance + 1e-18 * np.eye(3))
    return np.linalg.norm(law.mean + rng.standard_normal((count, 3)) @ root.T + u @ law.columns.T, axis=1)


SMALL = np.random.default_rng(41).normal(size=(3, 6)) * 0.1  # columns of some 0.2 mm
DOMINATED = {
    "one normal axis": linear_law([0, 0.01, -0.04], np.diag([45.0, 0.02, 0.03]) ** 2, SMALL),
    "one normal axis, wider": linear_law([0, 0.01, -0.04], np.diag([100.0, 0.02, 0.03]) ** 2, SMALL),
    "askew, with a bias": linear_law(
        [3, -4, 1], 1e-3 * np.eye(3) + 40.0**2 * np.full((3, 3), 1 / 3), SMALL, [TRIANGULAR] * 3 + [UNIFORM] * 3
    ),
    "two normal axes": linear_law([0, 0.01, -0.04], np.diag([45.0, 60.0, 0.03]) ** 2, SMALL[:, :3] * [1, 1, 0.1]),
    "one uniform column": linear_law([0, 0.01, 0], np.eye(3) * 4e-3, np.column_stack([[90.0, 1, 0], SMALL])),
    "one triangular column": linear_law(
        [0, 0.01, 0], np.eye(3) * 4e-3, np.column_stack([[90.0, 1, 0], SMALL]), [TRIANGULAR] + [UNIFORM] * 6
    ),
}


@pytest.mark.long("one normal axis, wider", "two normal axes", "one uniform column")
@pytest.mark.parametrize("name", DOMINATED)
def test_a_law_that_one_source_dominates(name):
    """sampled: 5e5 draws of the deviates themselves, 4.5 standard errors.  closed form: the quantile is homogeneous in
    the lengths of the law, so that its derivatives by all of them add up to itself."""
    law, count = DOMINATED[name], 500_000
    total = law_quantile(law, 0.95)
    summary = LawReading(law, 0.95)
    assert total.density > 0
    norms = np.sort(draw_norms(law, count, 17))
    spread = 4.5 * sqrt(0.95 * 0.05 * count)
    low, high = (norms[int(0.95 * count + s * spread)] for s in (-1, 1))
    assert low - 4 * total.error_mm < total.quantile_mm < high + 4 * total.error_mm
    assert total.error_mm < 1e-3 * total.quantile_mm
    near = ((norms > 0.99 * total.quantile_mm) & (norms < 1.01 * total.quantile_mm)).mean()
    assert total.density == pytest.approx(near / (0.02 * total.quantile_mm), rel=0.05)
    assert summary.mean_norm_mm == pytest.approx(norms.mean(), abs=4.5 * norms.std() / sqrt(count) + 2e-3)
    worst = norms[int(0.95 * count) :]
    assert summary.cvar_mm == pytest.approx(worst.mean(), rel=3e-3)
    slopes = law_gradient(law, total)
    every = slopes.by_mean @ law.mean + 2 * (slopes.by_covariance * law.covariance).sum() + slopes.by_log_column.sum()
    assert every == pytest.approx(total.quantile_mm, rel=2e-3)


def test_a_sample_that_does_not_reach_the_sphere_is_refused():
    """Lines that touch the sphere nowhere tell no density there; 0 would be read as an exact answer."""
    law = DOMINATED["one normal axis"]
    points = sample(law.mean, law.covariance, lattice_columns(law)[0], 6)
    asleep = replace(points, x=points.x * [1, 0, 0] + [0, 1e4, 0], along=np.array([0.0, 0.0, 1e-12]))
    with pytest.raises(NotConvergedError, match="how exact it is cannot be told"):
        asleep.quantile(0.5)


TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
PLANE = TURN @ np.diag([0, 0.09, 0.02]) @ TURN.T
TWO_SOURCES = {
    "long": SKEWED,
    "short": linear_law([0.1, 0.4, 0.2], SPREAD, np.array([[0.05, 0.02], [-0.02, 0.07], [0.03, 0.09]])),
    "plane": linear_law(
        TURN @ [0.4, 0.1, -0.3], PLANE, TURN @ [[0, 0], [0.6, 0.2], [-0.3, 0.5]], [UNIFORM, TRIANGULAR]
    ),
}


@pytest.mark.parametrize("name", TWO_SOURCES)
def test_summary_of_two_sources(name):
    """independent: Gaussian contours averaged over both sources by quadrature; short columns are folded, long not."""
    law, p = TWO_SOURCES[name], 0.95
    r = law_quantile(law, p).quantile_mm
    for limit in (0.5 * r, 1.03 * r, 40.0):  # inside the lattice, beyond it, beyond the law
        found = LawReading(law, p, limit)
        expected = average(law, lambda m, x=limit: norm_sf(x, m, law.covariance))
        assert found.exceedance == pytest.approx(expected, abs=3e-8)
    assert average(law, lambda m: norm_cdf(found.quantile.quantile_mm, m, law.covariance)) == pytest.approx(p, abs=2e-8)
    assert found.mean_norm_mm == pytest.approx(average(law, lambda m: norm_mean(m, law.covariance)), rel=1e-6)
    area = quad(lambda x: average(law, lambda m: norm_sf(x, m, law.covariance)), r, r + 2.5, epsabs=1e-8, limit=3)[0]
    assert found.cvar_mm == pytest.approx(r + area / 0.05, rel=4e-6)
    assert LawReading(law, p).exceedance is None


SQUARE = linear_law(np.zeros(3), np.zeros((3, 3)), np.eye(3)[:, :2])


def test_summary_of_other_laws():
    """closed form: the Gaussian's own functions; a square of half side 1, P(|e| <= r) = pi r^2 / 4 up to r = 1."""
    found = LawReading(linear_law([0.3, 0, 0.1], SPREAD), 0.95, 1.0)
    mean = np.array([0.3, 0, 0.1])
    assert found.quantile.method == GAUSSIAN_METHOD
    assert found.quantile.quantile_mm == norm_quantile(0.95, mean, SPREAD)
    assert found.mean_norm_mm == norm_mean(mean, SPREAD)
    assert found.cvar_mm == norm_cvar(0.95, mean, SPREAD)
    assert found.exceedance == norm_sf(1.0, mean, SPREAD)
    square = law_quantile(SQUARE, 0.5)
    assert square.method == SAMPLED_METHOD
    assert square.quantile_mm == pytest.approx(sqrt(2 / np.pi), abs=5e-4)
    assert law_exceedance(SQUARE, 0.9) == pytest.approx(1 - np.pi * 0.81 / 4, abs=5e-4)
    with pytest.raises(ValueError, match="limit must be >= 0"):
        LawReading(TWO_SOURCES["long"], 0.95, -1.0)


@pytest.mark.long
def test_the_mean_norm_of_a_square():
    """closed form: the mean distance of a square's points from its middle."""
    assert LawReading(SQUARE, 0.5).mean_norm_mm == pytest.approx((sqrt(2) + np.log(1 + sqrt(2))) / 3, abs=5e-4)


def test_the_end_of_a_law_is_beyond_its_quantile():
    """independent: the contour's tail of the Gaussian of equal moments; the bound is beyond, by a quarter at most."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        sigma = np.sort(rng.uniform(0.05, 1, 3))[::-1]
        mean = rng.normal(size=3) * rng.choice([0, 0.3, 3])
        for probability in (1e-4, 1e-7):
            frame = on_principal_axes(mean, np.diag(sigma**2), np.empty((0, 3)))
            end = end_of(frame, np.full(3, 1e3), probability)
            assert norm_sf(end, mean, np.diag(sigma**2)) <= probability
            assert end < 1.25 * norm_quantile(1 - probability, mean, np.diag(sigma**2))
    frame = on_principal_axes(np.zeros(3), np.eye(3), np.empty((0, 3)))
    assert end_of(frame, np.array([1.0, 2, 2]), 1e-9) == pytest.approx(3.0)


def test_small_columns_are_one_polynomial():
    """independent: the logarithms of sin x / x summed one by one, at the points of a line of the lattice."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(30, 3)) * 0.03
    folded, _, columns, degree = fold_small(0.09 * np.eye(3), columns, 1e-9)
    assert len(columns) > 27
    np.testing.assert_allclose(folded, 0.09 * np.eye(3) + columns.T @ columns / 3, rtol=1e-12, atol=1e-16)
    orders = higher_orders(columns, degree, 0, 1, 2)
    plane, line = np.empty((degree + 1, degree + 1)), np.empty(degree + 1)
    in_plane(orders, 4.0, plane)
    along_line(plane, -3.0, 0.7, line)
    for n in (-6, 0, 1, 9):
        k = np.array([4.0, -3.0, 0.7 * n])
        x = columns @ k
        exact = np.log(np.sinc(x / np.pi)).sum() + (x**2).sum() / 6
        weight = np.exp(-0.5 * k @ folded @ k)  # what of it reaches the characteristic function
        assert weight * abs(np.polyval(line[::-1], n) - exact) < 1e-9
        assert abs(exact) > 1e-5  # the series is felt


def test_folding_keeps_the_characteristic_function():
    """independent: products of sin x / x at random points, for columns from very short to long beside the noise."""
    rng = np.random.default_rng(8)
    seen = []
    for scale in (0.01, 0.05, 0.1, 0.2, 0.5):
        columns = rng.normal(size=(24, 3)) * scale
        for threshold in (1e-9, 1e-6):
            folded, long, small, degree = fold_small(SPREAD, columns, threshold)
            assert len(long) + len(small) == len(columns)
            seen.append((len(small) / len(columns), degree))
            k = rng.normal(size=(4000, 3)) * rng.uniform(0, 6, (4000, 1)) / np.sqrt(np.diag(folded))
            x = k @ columns.T
            true = np.exp(-0.5 * ((k @ SPREAD) * k).sum(axis=1)) * np.sinc(x / np.pi).prod(axis=1)
            powers = np.zeros(len(k))
            for d in range(4, degree + 1, 2):
                powers += LOG_SINC[d] * ((k @ small.T) ** d).sum(axis=1)
            form = np.exp(-0.5 * ((k @ folded) * k).sum(axis=1) + powers) * np.sinc(k @ long.T / np.pi).prod(axis=1)
            assert np.abs(form - true).max() < 2 * threshold
    assert {degree for _, degree in seen} > {4, 8}
    assert any(0 < share < 1 for share, _ in seen)


def test_derivatives_with_small_and_long_columns():
    """independent: central differences of the exact quantile in mean, covariance and every column."""
    rng = np.random.default_rng(4)
    columns = np.hstack([rng.normal(size=(3, 20)) * 0.04, rng.normal(size=(3, 3)) * 0.5])
    law, p, step = linear_law([0.2, -0.1, 0.3], SPREAD, columns), 0.95, 2e-2
    found = law_gradient(law, law_quantile(law, p), fine=False)

    def quantile(mean=law.mean, covariance=SPREAD, columns=columns):
        return law_quantile(linear_law(mean, covariance, columns), p).quantile_mm

    for j in (0, 7, 19, 20, 22):
        longer, shorter = columns.copy(), columns.copy()
        longer[:, j] *= 1 + step
        shorter[:, j] *= 1 - step
        slope = (quantile(columns=longer) - quantile(columns=shorter)) / (2 * step)
        assert found.by_log_column[j] == pytest.approx(slope, rel=5e-3, abs=2e-6)
    block = SPREAD * 0.3
    slope = (quantile(covariance=SPREAD + step * block) - quantile(covariance=SPREAD - step * block)) / (2 * step)
    assert (found.by_covariance * block).sum() == pytest.approx(slope, rel=1e-4)
    along = step * np.eye(3)[0]
    slope = (quantile(mean=law.mean + along) - quantile(mean=law.mean - along)) / (2 * step)
    assert found.by_mean[0] == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_p95_without_any_line(seed):
    """independent: the exact quantile of the law put together without the line, to 1e-4; heavy lines and light."""
    model_system = random_system(np.random.default_rng(seed), fiducials=8)
    model = linearise(model_system, model_system.targets[0])
    for error in ("tcp", "localisation"):
        at = error_law(model, error, 0.95)
        rows = budget(model, at, law_quantile(at.law, 0.95))
        for line, row in zip(lines_of(model), rows, strict=True):
            covariance, columns, kinds = np.zeros((3, 3)), [], []
            for block in model.blocks:
                gain = block.gain(error)
                for j, law in enumerate(block.laws):
                    if block is line.block and j in line.sources:
                        continue
                    if law is Law.NORMAL:
                        covariance += np.outer(gain[:, j], gain[:, j]) * block.std[j] ** 2
                    else:
                        columns.append(gain[:, j] * block.half_width[j])
                        kinds.append(UNIFORM if law is Law.UNIFORM else TRIANGULAR)
            stacked = np.array(columns).reshape(-1, 3).T
            exact = law_quantile(linear_law(at.law.mean, covariance, stacked, kinds), 0.95).quantile_mm
            assert row.p95_without_mm == pytest.approx(exact, rel=1e-4), (line.block.contributor, line.component)
