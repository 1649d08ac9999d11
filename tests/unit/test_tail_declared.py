"""Laws with uniform and triangular sources against quadrature over them, closed forms and sampling."""

from __future__ import annotations

import json
from dataclasses import replace
from math import comb, factorial, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import j0, j1

from laws import linear_law
from tail_references import average
from tailstack.errors import NotConvergedError
from tailstack.tail.declared import (
    LATTICE_METHOD,
    SAMPLED_METHOD,
    TRIANGULAR,
    UNIFORM,
    LawGradient,
    accuracy_for,
    lattice_columns,
    law_cdf,
    law_exceedance,
    law_gradient,
    law_quantile,
    law_summary,
    solve_on_axes,
)
from tailstack.tail.gaussian import norm_cdf, norm_gradient_jit, norm_quantile
from tailstack.tail.lattice import Accuracy, ball_integral, ball_sums, bessel_j01, build, on_principal_axes
from tailstack.tail.sampling import sample

CUBE = json.loads((Path(__file__).parents[1] / "data/oracles/noise_covariance_cube8.json").read_text())
NOISE = np.array(CUBE["Sigma"])


def mount_columns(position, pivot, degrees, mm):
    """(3, 6) displacement of a point by a mount's half-widths: three rotations about its pivot, three translations."""
    lever = np.array(position) - np.array(pivot)
    turns = [np.radians(degrees) * np.cross(axis, lever) for axis in np.eye(3)]
    return np.column_stack([*turns, *(mm * np.eye(3))])


COLUMNS = np.hstack(
    [mount_columns((0, 0, 70), (0, 0, -95), 0.25, 0.1), mount_columns((0, 0, 70), (0, 0, -145), 0.15, 0.2)]
)
REFERENCE = linear_law(np.zeros(3), NOISE, COLUMNS)
SKEWED = linear_law(
    [0.3, -0.2, 0.5],
    [[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]],
    np.array([[0.6, 0.1], [-0.2, 0.5], [0.1, 0.4]]),
    [UNIFORM, TRIANGULAR],
)


def test_reference_of_the_method_notes():
    """Published, sampled: 1.2889 (its standard error is some 1e-4); the Gaussian of equal covariance to all digits."""
    result = law_quantile(REFERENCE, 0.95)
    assert result.quantile_mm == pytest.approx(1.2889, abs=4e-4)
    assert result.method == LATTICE_METHOD
    assert result.error_mm < 1e-6
    assert norm_quantile(0.95, REFERENCE.mean, REFERENCE.total_covariance) == pytest.approx(1.3574, abs=5e-5)


def test_reference_by_sampling():
    """Two million draws: the probability at our quantile within 3.5 standard errors (0.00054)."""
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
    assert law_summary(law, 0.95).mean_norm_mm == pytest.approx(1.0, abs=1e-6)
    assert law_summary(law, 0.9).cvar_mm == pytest.approx(1.9, abs=1e-6)


def test_square_without_noise_by_sampling():
    """Closed form: uniform on a square of half side 1, P(|e| <= r) = pi r^2 / 4, r <= 1; within 4 standard errors."""
    law = linear_law(np.zeros(3), np.zeros((3, 3)), np.eye(3)[:, :2])
    result = law_quantile(law, 0.5)
    assert result.method == SAMPLED_METHOD
    assert abs(result.quantile_mm - sqrt(2 / pi)) < 4 * result.error_mm + 1e-9
    assert result.error_mm < 1e-4


def test_sharp_law_agrees_with_its_blunt_neighbour():
    """Noise of 0.3 um beside tolerances of a millimetre: sampled, within 4 standard errors of the lattice at 30 um.

    The two laws differ by less than tr(S)/2r in the quantile (second order in the noise).
    """
    columns = np.random.default_rng(2).normal(size=(3, 5)) * [1.0, 0.8, 0.5, 0.4, 0.3]
    blunt = law_quantile(linear_law([3, 0, 1], np.eye(3) * 0.03**2, columns), 0.95)
    sharp = law_quantile(linear_law([3, 0, 1], np.eye(3) * 3e-4**2, columns), 0.95)
    assert sharp.method == SAMPLED_METHOD
    assert abs(sharp.quantile_mm - blunt.quantile_mm) < 4 * (sharp.error_mm + blunt.error_mm) + 1.5 * 0.03**2


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
    p, step = 0.95, 1e-3

    def quantile(law):
        return brentq(lambda r: average(law, lambda m: norm_cdf(r, m, law.covariance)) - p, 15, 25, xtol=1e-10)

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
    expected = brentq(
        lambda r: average(law, lambda m: norm_cdf(r, m, law.covariance)) - 0.95, quantile.quantile_mm - 0.1,
        quantile.quantile_mm + 0.1, xtol=1e-9,
    )  # fmt: skip
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


def test_bessel_functions_against_scipy():
    for x in (0.0, 1e-9, 1e-3, 0.5, 2.4, 10.0, 29.99, 30.01, 77.0, 900.0):
        assert bessel_j01(x) == pytest.approx((j0(x), j1(x)), abs=3e-15)


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
        if dimension == 3:
            inner = quad(lambda x, t=t: ball_sums(x, 3, np.array([t]), one)[0], 0, 1.3, epsabs=1e-11)[0]
            assert ball_integral(1.3, np.array([t]), one) == pytest.approx(inner, rel=1e-7)


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
    """sampled: 2e6 draws of the deviates themselves, 4.5 standard errors.  closed form: the quantile is homogeneous in
    the lengths of the law, so that its derivatives by all of them add up to itself."""
    law, count = DOMINATED[name], 2_000_000
    total = law_quantile(law, 0.95)
    summary = law_summary(law, 0.95)
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
