"""Risk per unit: closed forms where installation and shots are Gaussian or absent, brute force elsewhere."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from scipy import stats

from tailstack.tail.declared import LinearLaw, law_quantile, linear_law, norm_quantile_of
from tailstack.tail.gaussian import norm_quantile
from tailstack.tail.per_unit import unit_risk

NOISE = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]]) / 10
COLUMNS = np.array([[0.7, 0.0, 0.1, 0.3], [0.0, 0.6, 0.2, -0.2], [0.1, 0.0, 0.3, 0.2]])
SHOT = linear_law(np.zeros(3), NOISE)
FIXED = np.zeros((3, 3))


def test_isotropic_shots_depend_on_the_distance_only():
    """Closed form: R is a function of |d|, so the yield is P(|d| <= R^-1(limit)); noncentral chi both ways."""
    unit, shot, limit, p = 0.5, 0.2, 1.2, 0.95
    installation, shots = (linear_law(np.zeros(3), s**2 * np.eye(3)) for s in (unit, shot))
    risk = unit_risk(installation, shots, p, limit)
    distance = stats.chi.ppf(0.95, 3) * unit
    percentile = shot * sqrt(stats.ncx2.ppf(p, 3, (distance / shot) ** 2))
    low, high = 0.0, 2.0
    for _ in range(60):
        middle = (low + high) / 2
        inside = stats.ncx2.cdf((limit / shot) ** 2, 3, (middle / shot) ** 2) >= p
        low, high = (middle, high) if inside else (low, middle)
    # The control variate is then the indicator itself: hardly any sampling error is left.
    assert risk.yield_fraction == pytest.approx(stats.chi.cdf(low / unit, 3), abs=1.5e-3)
    assert risk.p95_of_units_mm == pytest.approx(percentile, abs=2e-3)


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
    assert abs(risk.p95_of_units_mm - percentile) < 4 * sqrt(risk.p95_standard_error_mm**2 + spread**2)
    assert 0 < risk.yield_standard_error < 0.01
    assert 0 < risk.solved < 2 * risk.units


def test_shots_with_bounded_columns():
    """400 units drawn plainly and each solved with the declared law; within 4 joint standard errors."""
    unit = linear_law([0.2, 0, 0.1], FIXED, COLUMNS)
    shot = linear_law(np.zeros(3), NOISE, np.diag([0.3, 0.05, 0.1]))
    risk = unit_risk(unit, shot, 0.95, 1.2)
    d = unit.mean + np.random.default_rng(3).uniform(-1, 1, (400, 4)) @ COLUMNS.T
    own = np.array([law_quantile(LinearLaw(row, NOISE, shot.columns, shot.kinds), 0.95).quantile_mm for row in d])
    reference = (own <= 1.2).mean()
    spread = sqrt(reference * (1 - reference) / 400)
    assert abs(risk.yield_fraction - reference) < 4 * sqrt(risk.yield_standard_error**2 + spread**2)


def test_shot_correction_is_right_for_a_single_unit():
    """One unit and no spread of the installation: its quantile is that of the declared law, not of the Gaussian."""
    shot = linear_law(np.zeros(3), NOISE / 10, np.diag([0.3, 0.05, 0.1]))
    at = linear_law([1, 0, 0], NOISE / 10, np.diag([0.3, 0.05, 0.1]))
    risk = unit_risk(linear_law([1, 0, 0], FIXED), shot, 0.95, 1.2)
    assert risk.p95_of_units_mm == pytest.approx(law_quantile(at, 0.95).quantile_mm, rel=2e-4)
    assert abs(norm_quantile_of(at, 0.95) / risk.p95_of_units_mm - 1) > 2e-3


def test_all_units_alike():
    unit = linear_law([0.3, 0.4, 0], FIXED)
    own = norm_quantile(0.95, unit.mean, NOISE)
    risk = unit_risk(unit, SHOT, 0.95, own * 1.001)
    assert (risk.yield_fraction, risk.yield_standard_error, risk.units) == (1.0, 0.0, 1)
    assert risk.p95_of_units_mm == pytest.approx(own, rel=1e-12)
    assert unit_risk(unit, SHOT, 0.95, own * 0.999).yield_fraction == 0.0


def test_no_shot_noise_is_the_law_of_the_offset():
    """R(d) = |d|: the exact quantile of the installation is the percentile of units."""
    unit = linear_law([0.1, 0, 0], NOISE * 10, COLUMNS)
    silent = linear_law(np.zeros(3), FIXED)
    quantile = law_quantile(unit, 0.95)
    risk = unit_risk(unit, silent, 0.95, quantile.quantile_mm)
    assert risk.yield_fraction == pytest.approx(0.95, abs=2e-3)
    assert risk.p95_of_units_mm == pytest.approx(quantile.quantile_mm, rel=3e-3)


def test_no_limit_no_yield_and_same_answer_twice():
    unit = linear_law([0.1, 0, 0], NOISE * 10, COLUMNS)
    risk = unit_risk(unit, SHOT, 0.95)
    assert (risk.yield_fraction, risk.yield_standard_error, risk.limit_mm) == (None, None, None)
    assert risk == unit_risk(unit, SHOT, 0.95)


def test_generous_and_impossible_limits():
    unit = linear_law([0.1, 0, 0], NOISE * 10, COLUMNS)
    assert unit_risk(unit, SHOT, 0.95, 100.0).yield_fraction == 1.0
    assert unit_risk(unit, SHOT, 0.95, 0.0).yield_fraction == 0.0


def test_bad_arguments_are_named():
    unit = linear_law([0.1, 0, 0], NOISE)
    with pytest.raises(ValueError, match="belongs to the installation"):
        unit_risk(unit, unit, 0.95)
    with pytest.raises(ValueError, match="limit must be >= 0"):
        unit_risk(unit, SHOT, 0.95, -1.0)
