"""What shared lattices, folded columns and batched removals give, against quadrature, closed forms and differences."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from scipy.integrate import quad

from laws import linear_law
from scenes import random_system
from tail_references import average
from tailstack.budget import budget, lines_of
from tailstack.contributors import error_law
from tailstack.propagation.linear import linearise
from tailstack.system import Law
from tailstack.tail.declared import (
    GAUSSIAN_METHOD,
    SAMPLED_METHOD,
    TRIANGULAR,
    UNIFORM,
    end_of,
    law_exceedance,
    law_gradient,
    law_quantile,
    law_summary,
)
from tailstack.tail.gaussian import norm_cdf, norm_cvar, norm_mean, norm_quantile, norm_sf
from tailstack.tail.lattice import LOG_SINC, along_line, fold_small, higher_orders, in_plane, on_principal_axes, sines

NOISE = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]])
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
PLANE = TURN @ np.diag([0, 0.09, 0.02]) @ TURN.T
TWO_SOURCES = {
    "long": linear_law([0.3, -0.2, 0.5], NOISE, np.array([[0.6, 0.1], [-0.2, 0.5], [0.1, 0.4]]), [UNIFORM, TRIANGULAR]),
    "short": linear_law([0.1, 0.4, 0.2], NOISE, np.array([[0.05, 0.02], [-0.02, 0.07], [0.03, 0.09]])),
    "plane": linear_law(
        TURN @ [0.4, 0.1, -0.3], PLANE, TURN @ [[0, 0], [0.6, 0.2], [-0.3, 0.5]], [UNIFORM, TRIANGULAR]
    ),
}


@pytest.mark.parametrize("name", TWO_SOURCES)
def test_summary_of_two_sources(name):
    """independent: Gaussian contours averaged over both sources by quadrature; short columns are folded, long not."""
    law, p = TWO_SOURCES[name], 0.95
    r = law_quantile(law, p).quantile_mm
    for limit in (0.0, 0.5 * r, 1.03 * r, 1.4 * r, 40.0):  # inside the lattice, beyond it, beyond the law
        found = law_summary(law, p, limit)
        expected = average(law, lambda m, x=limit: norm_sf(x, m, law.covariance))
        assert found.exceedance == pytest.approx(expected, abs=3e-8)
    assert average(law, lambda m: norm_cdf(found.quantile.quantile_mm, m, law.covariance)) == pytest.approx(p, abs=2e-8)
    assert found.mean_norm_mm == pytest.approx(average(law, lambda m: norm_mean(m, law.covariance)), rel=1e-6)
    area = quad(lambda x: average(law, lambda m: norm_sf(x, m, law.covariance)), r, r + 2.5, epsabs=1e-8, limit=3)[0]
    assert found.cvar_mm == pytest.approx(r + area / 0.05, rel=4e-6)
    assert law_summary(law, p).exceedance is None


def test_summary_of_other_laws():
    """closed form: the Gaussian's own functions; a square of half side 1, P(|e| <= r) = pi r^2 / 4 up to r = 1."""
    found = law_summary(linear_law([0.3, 0, 0.1], NOISE), 0.95, 1.0)
    mean = np.array([0.3, 0, 0.1])
    assert found.quantile.method == GAUSSIAN_METHOD
    assert found.quantile.quantile_mm == norm_quantile(0.95, mean, NOISE)
    assert found.mean_norm_mm == norm_mean(mean, NOISE)
    assert found.cvar_mm == norm_cvar(0.95, mean, NOISE)
    assert found.exceedance == norm_sf(1.0, mean, NOISE)
    square = law_summary(linear_law(np.zeros(3), np.zeros((3, 3)), np.eye(3)[:, :2]), 0.5, 0.9)
    assert square.quantile.method == SAMPLED_METHOD
    assert square.quantile.quantile_mm == pytest.approx(sqrt(2 / np.pi), abs=5e-4)
    assert square.exceedance == pytest.approx(1 - np.pi * 0.81 / 4, abs=5e-4)
    assert square.mean_norm_mm == pytest.approx((sqrt(2) + np.log(1 + sqrt(2))) / 3, abs=5e-4)
    with pytest.raises(ValueError, match="limit must be >= 0"):
        law_summary(TWO_SOURCES["long"], 0.95, -1.0)


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
            folded, long, small, degree = fold_small(NOISE, columns, threshold)
            assert len(long) + len(small) == len(columns)
            seen.append((len(small) / len(columns), degree))
            k = rng.normal(size=(4000, 3)) * rng.uniform(0, 6, (4000, 1)) / np.sqrt(np.diag(folded))
            x = k @ columns.T
            true = np.exp(-0.5 * ((k @ NOISE) * k).sum(axis=1)) * np.sinc(x / np.pi).prod(axis=1)
            powers = np.zeros(len(k))
            for d in range(4, degree + 1, 2):
                powers += LOG_SINC[d] * ((k @ small.T) ** d).sum(axis=1)
            form = np.exp(-0.5 * ((k @ folded) * k).sum(axis=1) + powers) * np.sinc(k @ long.T / np.pi).prod(axis=1)
            assert np.abs(form - true).max() < 2 * threshold
    assert {degree for _, degree in seen} > {4, 8}
    assert any(0 < share < 1 for share, _ in seen)


def test_sines_in_lanes():
    """independent: the C library's, up to angles of a hundred thousand."""
    t = np.concatenate([[0.0, 1e-9], np.linspace(0, 40, 1001), np.geomspace(40, 1e5, 500)])
    s, c = np.empty(t.size), np.empty(t.size)
    sines(1.7, t, s, c)
    assert np.abs(s - np.sin(1.7 * t)).max() < 1e-15
    assert np.abs(c - np.cos(1.7 * t)).max() < 1e-15


def test_derivatives_with_small_and_long_columns():
    """independent: central differences of the exact quantile in mean, covariance and every column."""
    rng = np.random.default_rng(4)
    columns = np.hstack([rng.normal(size=(3, 20)) * 0.04, rng.normal(size=(3, 3)) * 0.5])
    law, p, step = linear_law([0.2, -0.1, 0.3], NOISE, columns), 0.95, 2e-2
    found = law_gradient(law, law_quantile(law, p), fine=False)

    def quantile(mean=law.mean, covariance=NOISE, columns=columns):
        return law_quantile(linear_law(mean, covariance, columns), p).quantile_mm

    for j in (0, 7, 19, 20, 22):
        longer, shorter = columns.copy(), columns.copy()
        longer[:, j] *= 1 + step
        shorter[:, j] *= 1 - step
        slope = (quantile(columns=longer) - quantile(columns=shorter)) / (2 * step)
        assert found.by_log_column[j] == pytest.approx(slope, rel=5e-3, abs=2e-6)
    block = NOISE * 0.3
    slope = (quantile(covariance=NOISE + step * block) - quantile(covariance=NOISE - step * block)) / (2 * step)
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


def test_exceedance_of_a_summary_is_the_exceedance():
    """At limits of either side of the shared lattice's edge."""
    law = TWO_SOURCES["short"]
    for limit in np.linspace(0.6, 1.5, 10):
        assert law_summary(law, 0.95, limit).exceedance == pytest.approx(law_exceedance(law, limit), abs=2e-8)
