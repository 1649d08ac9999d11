"""Risk per unit: closed forms where installation and shots are Gaussian or absent, brute force elsewhere."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scipy import stats

from laws import linear_law
from tailstack.laws import SUMS, Law
from tailstack.tail import per_unit
from tailstack.tail.declared import LinearLaw, law_cdf, law_quantile
from tailstack.tail.gaussian import norm_quantile
from tailstack.tail.pairs import sample_pair
from tailstack.tail.per_unit import (
    average_at,
    distance_at,
    draw_units,
    position_of,
    read_units,
    solve_between,
    unit_coordinates,
    unit_risk,
)

NOISE = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]]) / 10
COLUMNS = np.array([[0.7, 0.0, 0.1, 0.3], [0.0, 0.6, 0.2, -0.2], [0.1, 0.0, 0.3, 0.2]])
SHOT = linear_law(np.zeros(3), NOISE)
FIXED = np.zeros((3, 3))
INSTALLED, LOUD = linear_law([0.2, 0, 0.1], NOISE * 20, COLUMNS), linear_law(np.zeros(3), NOISE * 8)
BOUNDED_SHOT = linear_law(np.zeros(3), NOISE / 10, np.diag([0.3, 0.05, 0.1]))


@pytest.mark.parametrize("p", [0.3, 0.95])
@pytest.mark.parametrize("gaussian", [False, True])
def test_brute_force(p, gaussian):
    """Independent draws of 20 000 units, each solved: within 4 joint standard errors."""
    unit = linear_law([0.2, 0, 0.1], NOISE * 20 if gaussian else FIXED, COLUMNS)
    limit = 1.15
    risk = unit_risk(unit, SHOT, p, limit)
    rng = np.random.default_rng(1)
    n = 20_000
    d = unit.mean + rng.uniform(-1, 1, (n, 4)) @ COLUMNS.T
    if gaussian:
        d = d + rng.multivariate_normal(np.zeros(3), unit.covariance, n)
    own = np.array([norm_quantile(p, row, NOISE) for row in d])
    reference = (own <= limit).mean()
    spread = sqrt(reference * (1 - reference) / n)
    assert abs(risk.yield_fraction - reference) < 4 * sqrt(risk.yield_standard_error**2 + spread**2)
    percentile = np.quantile(own, 0.95)
    slope = (np.quantile(own, 0.96) - np.quantile(own, 0.94)) / 0.02
    spread = sqrt(0.05 * 0.95 / n) * slope
    assert abs(risk.value_mm - percentile) < 4 * sqrt(risk.standard_error_mm**2 + spread**2)
    assert 0 < risk.yield_standard_error < 0.01


@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.7])
def test_as_many_units_keep_a_quantile_as_it_says_where_shots_are_bounded(fraction):
    """closed form: F(Q(y)) = y, where another fraction is required; uncorrected shots are 0.016 or more off."""
    unit = linear_law([0.2, 0, 0.1], FIXED, COLUMNS)
    limit = read_units(unit, BOUNDED_SHOT, 0.95, fraction).quantile.value_mm
    assert unit_risk(unit, BOUNDED_SHOT, 0.95, limit, 0.99).yield_fraction == pytest.approx(fraction, abs=0.004)


def test_shot_correction_is_right_for_a_single_unit():
    """One unit and no spread of the installation: its quantile is that of the declared law, not of the Gaussian."""
    at = replace(BOUNDED_SHOT, mean=np.array([1.0, 0.0, 0.0]))
    risk = unit_risk(linear_law([1, 0, 0], FIXED), BOUNDED_SHOT, 0.95, 1.2)
    assert risk.value_mm == pytest.approx(law_quantile(at, 0.95).quantile_mm, rel=2e-4)
    assert abs(norm_quantile(0.95, at.mean, at.total_covariance) / risk.value_mm - 1) > 2e-3


def test_where_one_part_is_absent_the_rest_is_the_law():
    unit = linear_law([0.3, 0.4, 0], FIXED)
    own = norm_quantile(0.95, unit.mean, NOISE)
    risk = unit_risk(unit, SHOT, 0.95, own * 1.001)
    assert (risk.yield_fraction, risk.yield_standard_error, risk.units) == (1.0, 0.0, 1)
    assert risk.value_mm == pytest.approx(own, rel=1e-12)
    assert unit_risk(unit, SHOT, 0.95, own * 0.999).yield_fraction == 0.0
    # R(d) = |d|: the exact quantile of the installation is the percentile of units.
    unit = linear_law([0.1, 0, 0], NOISE * 10, COLUMNS)
    silent = linear_law(np.zeros(3), FIXED)
    quantile = law_quantile(unit, 0.95)
    risk = unit_risk(unit, silent, 0.95, quantile.quantile_mm)
    assert risk.yield_fraction == pytest.approx(0.95, abs=2e-3)
    assert risk.value_mm == pytest.approx(quantile.quantile_mm, rel=3e-3)
    # Closed form: chi without shots, chi without an installation, a distance without either.
    ball, nothing = linear_law(np.zeros(3), 0.09 * np.eye(3)), linear_law(np.zeros(3), FIXED)
    apart, alike = (read_units(*laws, 0.8, 0.95).quantile for laws in ((ball, nothing), (nothing, ball)))
    assert apart.value_mm == pytest.approx(0.3 * stats.chi.ppf(0.95, 3), rel=2e-4)
    assert alike.value_mm == pytest.approx(0.3 * stats.chi.ppf(0.8, 3), rel=1e-10)
    assert (alike.standard_error_mm, alike.density) == (0.0, 0.0)
    assert read_units(linear_law([3, 4, 0], FIXED), nothing, 0.8, 0.95).quantile.value_mm == pytest.approx(5, rel=1e-12)


@pytest.mark.parametrize(("n", "width"), [(1, 1), (7, 3), (200, 16)])
def test_averages_of_ranks_are_those_of_a_convolution(n, width):
    """independent: numpy's convolution with a triangle, and its interpolation."""
    rng = np.random.default_rng(n)
    ranked = np.sort(rng.normal(size=n))
    window = width - np.abs(np.arange(1.0 - width, width))
    averages, weights = (np.convolve(x, window, "full")[width - 1 :][:n] for x in (ranked, np.ones(n)))
    averages /= weights
    for at in (0.0, n - 1.0, *rng.uniform(0, n - 1, 20)):
        value = np.interp(at, np.arange(n), averages)
        assert average_at(ranked, width, float(at)) == pytest.approx(value, rel=1e-12)
        assert position_of(ranked, width, float(value)) == pytest.approx(at, abs=1e-9 * n)
    assert position_of(ranked, width, averages[-1] + 1.0) == n - 1
    assert position_of(ranked, width, averages[0] - 1.0) == 0


def test_bad_arguments_are_named():
    unit = linear_law([0.1, 0, 0], NOISE)
    with pytest.raises(ValueError, match="belongs to the installation"):
        unit_risk(unit, unit, 0.95)
    with pytest.raises(ValueError, match="limit must be >= 0"):
        unit_risk(unit, SHOT, 0.95, -1.0)
    with pytest.raises(ValueError, match="between 0 and 1"):
        read_units(linear_law([0.1, 0, 0], NOISE), SHOT, 0.95, 1.0)


@pytest.mark.long
def test_quantile_against_nested_draws():
    """Independent: 4000 units drawn plainly, 3000 shots each, nothing solved; within 4 joint standard errors (1 run in
    16 000), the draws fixed."""
    unit = linear_law([0.2, 0, 0.1], NOISE, COLUMNS, [0, 1, 0, 1])
    shot = linear_law(np.zeros(3), NOISE, np.diag([0.3, 0.05, 0.1]))
    n, p, fraction = 4000, 0.9, 0.95
    rng = np.random.default_rng(11)
    u = rng.uniform(-1, 1, (n, 4))
    u[:, [1, 3]] = (u[:, [1, 3]] + rng.uniform(-1, 1, (n, 2))) / 2
    d = unit.mean + u @ COLUMNS.T + rng.multivariate_normal(np.zeros(3), NOISE, n)
    root = np.linalg.cholesky(NOISE).T
    own = np.empty(n)
    for block in np.split(np.arange(n), 20):
        s = rng.standard_normal((200, 3000, 3)) @ root + rng.uniform(-1, 1, (200, 3000, 3)) * [0.3, 0.05, 0.1]
        own[block] = np.quantile(np.linalg.norm(d[block, None] + s, axis=2), p, axis=1)
    reference = np.quantile(own, fraction)
    slope = (np.quantile(own, fraction + 0.02) - np.quantile(own, fraction - 0.02)) / 0.04
    found = read_units(unit, shot, p, fraction).quantile
    spread = sqrt(fraction * (1 - fraction) / n) * slope
    assert abs(found.value_mm - reference) < 4 * sqrt(found.standard_error_mm**2 + spread**2)
    assert found.standard_error_mm < 0.005 * found.value_mm
    assert found.density == pytest.approx(1 / slope, rel=0.3)


@pytest.mark.parametrize("fraction", [0.8, 0.99])
@pytest.mark.parametrize("shot", [0.02, 0.2, 2.0])
def test_quantile_of_isotropic_laws(fraction, shot):
    """Closed form: R increases with |d|, hence its quantile is R at that of |d|; noncentral chi-square."""
    unit, p = 0.5, 0.9

    def own(distance):
        return shot * sqrt(stats.ncx2.ppf(p, 3, (distance / shot) ** 2))

    distance = stats.chi.ppf(fraction, 3) * unit
    slope = (own(1.001 * distance) - own(0.999 * distance)) / (0.002 * distance)
    installation, shots = (linear_law(np.zeros(3), s**2 * np.eye(3)) for s in (unit, shot))
    found = read_units(installation, shots, p, fraction).quantile
    # The control is R's own order: what is left is the curvature of R across the window.
    assert found.value_mm == pytest.approx(own(distance), rel=2e-4)
    assert found.density == pytest.approx(stats.chi.pdf(distance / unit, 3) / unit / slope, rel=0.15)


def test_quantile_does_not_see_the_frame():
    """Another frame is another sample of the same units: within 4 joint standard errors."""
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    unit, shot = linear_law([0.2, 0, 0.1], NOISE * 5, COLUMNS), linear_law(np.zeros(3), NOISE * 3)
    other, another = (
        linear_law(turn @ law.mean, turn @ law.covariance @ turn.T, turn @ law.columns) for law in (unit, shot)
    )
    a, b = read_units(unit, shot, 0.95, 0.9).quantile, read_units(other, another, 0.95, 0.9).quantile
    assert abs(a.value_mm - b.value_mm) < 4 * sqrt(a.standard_error_mm**2 + b.standard_error_mm**2)


@pytest.mark.parametrize("bounded_shots", [False, True])
def test_neighbouring_laws_have_neighbouring_quantiles(bounded_shots):
    """On a smooth path through equal eigenvalues, no step leaves the path's parabola by more than 2e-4."""
    values = []
    for t in np.linspace(-0.02, 0.02, 17):
        covariance = np.array([[1 + t, 0.003, 0], [0.003, 1 - t, 0], [0, 0, 0.3]]) * 0.1
        unit = linear_law([0.2, 0.1 * t, 0.1], covariance, COLUMNS * (1 + t))
        shot = linear_law(np.zeros(3), NOISE * (1 - t), np.diag([0.3, 0.05, 0.1 + t]) if bounded_shots else None)
        values.append(read_units(unit, shot, 0.95, 0.95, log2_units=7).quantile.value_mm)
    t = np.linspace(-1, 1, 17)
    left = np.array(values) / np.polyval(np.polyfit(t, values, 2), t) - 1
    assert np.abs(np.diff(left)).max() < 2e-4
    assert np.ptp(values) > 0.005  # the path goes somewhere


@pytest.mark.parametrize("p", [0.3, 0.95])
def test_units_left_unsolved_are_told_apart_rightly(p):
    """Independent: every unit of the same sample solved; the same share below the limit, the same value at the rank."""
    units = draw_units(INSTALLED, LOUD, p, 7)
    own = np.array([norm_quantile(p, offset, LOUD.covariance) for offset in units.offset])
    low, high = units.low, units.high
    assert (low <= own * (1 + 1e-12)).all()
    assert (own <= high * (1 + 1e-12)).all()
    limit = float(np.quantile(own, 0.7))
    good, between = high <= limit, (low <= limit) & (high > limit)
    assert (good | between)[own <= limit].all()
    assert not good[own > limit].any()
    assert between.mean() < 0.1
    risk = unit_risk(INSTALLED, LOUD, p, limit, log2_units=7)
    # The control moves the share by the sampling error it takes away, and not by more.
    assert abs(risk.yield_fraction - 0.7) < 4 * sqrt(0.3 * 0.7 / risk.units)
    for rank in (100, 1500, 1945):
        assert np.sort(solve_between(units, rank, rank))[rank] == pytest.approx(np.sort(own)[rank], rel=1e-12)


def test_few_units_are_solved(monkeypatch):
    """Counted, not timed: of 2048 units, at a quantile and a limit."""
    solved = []
    solve = per_unit.norm_quantiles
    monkeypatch.setattr(per_unit, "norm_quantiles", lambda p, means, S: solved.append(len(means)) or solve(p, means, S))
    risk = unit_risk(INSTALLED, LOUD, 0.95, 1.8, log2_units=7)
    assert sum(solved) < 0.3 * risk.units


def test_yield_and_its_error_are_those_of_the_whole_sample():
    """Independent: every unit solved, and the standard error from the means of the 16 blocks."""
    units = draw_units(INSTALLED, LOUD, 0.95, 7)
    own = np.array([norm_quantile(0.95, offset, LOUD.covariance) for offset in units.offset])
    size = np.linalg.norm(units.offset, axis=1)
    assert units.distance == pytest.approx(size, rel=1e-14)
    for limit in (np.sort(own)[[200, 1000, 1900]] + 1e-6).tolist():
        y = distance_at(units, limit)
        excess = 1.0 * (own <= limit) - (size <= y)
        error = excess.reshape(16, 128).mean(axis=1).std(ddof=1) / 4
        risk = unit_risk(INSTALLED, LOUD, 0.95, limit, log2_units=7)
        assert risk.yield_fraction == pytest.approx(excess.mean() + law_cdf(INSTALLED, y), abs=1e-4)
        assert risk.yield_standard_error == pytest.approx(np.hypot(error, 0.5 / 2048), rel=1e-9)
    assert np.isnan(distance_at(units, 0.5 * own.min()))
    assert np.isnan(distance_at(units, 2 * own.max()))


def test_units_are_spread_evenly_and_answer_twice_alike():
    """Closed form: each block takes every 128th part of the range of every coordinate once, and blocks differ."""
    z, u = unit_coordinates(2, (SUMS.index(Law.UNIFORM),) * 3, 7)
    assert z.shape == (2048, 2)
    for column in (*stats.norm.cdf(z).T, *((u + 1) / 2).T):
        for block in column.reshape(16, 128):
            assert np.sort((block * 128).astype(int)).tolist() == list(range(128))
    assert np.unique(u).size == u.size
    unit = linear_law([0.1, 0, 0], NOISE * 10, COLUMNS)
    risk = unit_risk(unit, SHOT, 0.95)
    assert (risk.yield_fraction, risk.yield_standard_error, risk.limit_mm) == (None, None, None)
    assert risk == unit_risk(unit, SHOT, 0.95)


@pytest.mark.parametrize(("p", "fraction"), [(0.9, 0.5), (0.95, 0.8), (0.99, 0.9), (0.95, 0.95), (0.9, 0.99)])
def test_as_many_units_keep_a_limit_as_its_quantile_says(p, fraction):
    """closed form: F(limit) >= y is Q(y) <= limit.  At limits as near to the quantile as rounding allows, too."""
    for shot in (LOUD, linear_law(np.zeros(3), NOISE, np.diag([0.3, 0.05, 0.1]))):
        value = unit_risk(INSTALLED, shot, p, None, fraction, 6).value_mm
        near = [value, np.nextafter(value, 0), np.nextafter(value, 9)]
        for limit in [float(level) for level in (*near, 0.9 * value, 0.999 * value, 1.001 * value, 1.1 * value)]:
            risk = unit_risk(INSTALLED, shot, p, limit, fraction, 6)
            assert risk.value_mm == value
            assert (risk.yield_fraction >= fraction) == (value <= limit)
            assert 0 <= risk.yield_fraction <= 1


@pytest.mark.parametrize("gaussian", [False, True])
def test_slopes_are_those_of_the_value(gaussian):
    """independent: central differences of the value, whose units are the same each time, by small steps."""
    installation = linear_law([0.2, 0, 0.1], NOISE * 20 if gaussian else NOISE, COLUMNS)
    by, by_shot = read_units(installation, SHOT, 0.95, 0.9, log2_units=7).gradient()

    def along(step, mean=0.0, covariance=FIXED, columns=0.0, shot=FIXED):
        """The slope along a change of the laws."""
        ends = []
        for side in (step, -step):
            once = LinearLaw(
                installation.mean + side * mean, installation.covariance + side * covariance,
                installation.columns * (1 + side * columns), installation.kinds,
            )  # fmt: skip
            shots = linear_law(np.zeros(3), NOISE + side * shot)
            ends.append(read_units(once, shots, 0.95, 0.9, log2_units=7).quantile.value_mm)
        return (ends[0] - ends[1]) / (2 * step)

    turn = np.array([[0.5, 0.2, 0.0], [0.2, -0.3, 0.1], [0.0, 0.1, 0.8]])
    for axis in np.eye(3):
        assert by.by_mean @ axis == pytest.approx(along(1e-4, mean=axis), rel=2e-2, abs=3e-4)
    assert (by.by_covariance * turn).sum() == pytest.approx(along(1e-5, covariance=turn), rel=2e-2, abs=3e-4)
    assert (by_shot * turn).sum() == pytest.approx(along(1e-5, shot=turn), rel=2e-2, abs=3e-4)
    for column, one in enumerate(np.eye(4)):
        assert by.by_log_column[column] == pytest.approx(along(1e-4, columns=one), rel=2e-2, abs=3e-4)


@pytest.mark.parametrize("guess_mm", [-1.0, 0.0, 0.3, 5.0])
def test_two_vectors_are_solved_wherever_they_are_looked_for(guess_mm: float) -> None:
    """independent: 0 is known where all directions have room; where one component alone has none, it is normal."""
    rays = sample_pair(0.01 * np.eye(6), np.zeros((6, 0)), np.zeros(0, dtype=np.int64), 8)
    for room, expected in ((np.full(6, 0.5), 0.0), (np.array([0, 5, 5, 5, 5, 5.0]), 0.1 * stats.norm.ppf(0.75))):
        (found,) = rays.quantiles(np.zeros((1, 6)), 0.5, room, np.array([guess_mm]))
        assert found == pytest.approx(expected, rel=0.03)
