"""What holds for every law: invariance, order, and the theorems the documentation appeals to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import special_ortho_group

from laws import linear_law, norm_cvar
from tailstack.tail.bounded import worst_case
from tailstack.tail.bounds import bounds
from tailstack.tail.declared import LinearLaw, law_cdf, law_quantile
from tailstack.tail.gaussian import norm_cdf, norm_gradient_jit, norm_mean, norm_quantile, norm_sf

pytestmark = pytest.mark.hostile

many = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
some = settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))

seeds = st.integers(0, 2**32 - 1)
probabilities = st.floats(1e-4, 1 - 1e-6)
exponents = st.floats(-7, 0)


@st.composite
def gaussians(draw, centred=False):
    """(mean, covariance): any rank, eigenvalue ratios to 1e7 and more, bias up to 1e4 of the noise."""
    rng = np.random.default_rng(draw(seeds))
    values = np.array([10 ** draw(exponents), 10 ** draw(exponents), 1.0])
    values[:2] *= [draw(st.booleans()), draw(st.booleans())]
    turn = special_ortho_group.rvs(3, random_state=rng)
    covariance = (turn * values) @ turn.T
    mean = rng.normal(size=3) * 10 ** draw(st.floats(-4, 4)) * (not centred)
    return mean, (covariance + covariance.T) / 2


@st.composite
def laws(draw, centred=False):
    """A declared law of one to six sources over isotropic-ish noise."""
    rng = np.random.default_rng(draw(seeds))
    k = draw(st.integers(1, 6))
    factor = rng.normal(size=(3, 3)) * 0.2
    return linear_law(
        rng.normal(size=3) * draw(st.floats(0, 2)) * (not centred),
        factor @ factor.T + 0.02 * np.eye(3),
        rng.normal(size=(3, k)) * draw(st.floats(0.05, 1)),
        rng.integers(0, 2, k),
    )


@many
@given(gaussians(), probabilities, seeds)
def test_turning_changes_nothing(law, p, seed):
    m, S = law
    turn = special_ortho_group.rvs(3, random_state=seed)
    turned = turn @ S @ turn.T
    # A covariance turned in doubles is another covariance: eps of its size moves variances that are smaller than that.
    blur = 4e-16 * np.trace(S)
    tolerance = 1e-10 + 10 * np.sqrt(blur) / norm_quantile(p, m, S) * (np.linalg.eigvalsh(S)[0] < 1e4 * blur)
    assert norm_quantile(p, turn @ m, (turned + turned.T) / 2) == pytest.approx(norm_quantile(p, m, S), rel=tolerance)


@many
@given(gaussians(), probabilities, st.floats(-8, 8))
def test_units_change_nothing(law, p, exponent):
    m, S = law
    scale = 10**exponent
    assert norm_quantile(p, scale * m, scale**2 * S) == pytest.approx(scale * norm_quantile(p, m, S), rel=1e-10)


@many
@given(gaussians(), probabilities)
def test_probability_undoes_the_quantile(law, p):
    r = norm_quantile(p, *law)
    step = 3e-12 * r
    # One part in 1e12 of r either way brackets p: the quantile is right to that.
    assert norm_cdf(max(r - step, 0.0), *law) <= p + 1e-11
    assert norm_sf(r + step, *law) <= 1 - p + 1e-11
    assert norm_cdf(r + step, *law) >= p - 1e-11


@many
@given(gaussians(centred=True), gaussians(centred=True), probabilities)
def test_more_noise_is_never_less_risk_without_bias(law, more, p):
    """Anderson's theorem: a ball is symmetric and convex, adding independent noise can only move mass out of it."""
    zero = np.zeros(3)
    assert norm_quantile(p, zero, law[1] + more[1]) >= norm_quantile(p, zero, law[1]) * (1 - 1e-11)


@many
@given(gaussians(), gaussians(), st.floats(0.01, 0.999))
def test_more_noise_is_never_less_mean_or_tail_mean(law, more, p):
    """With a bias quantiles may fall, but |.| is convex: mean and tail mean grow (increasing convex order)."""
    m, S = law
    assert norm_mean(m, S + more[1]) >= norm_mean(m, S) * (1 - 1e-12)
    assert norm_cvar(p, m, S + more[1]) >= norm_cvar(p, m, S) * (1 - 1e-9)


@many
@given(gaussians(), st.floats(0.01, 0.999))
def test_tail_mean_exceeds_quantile_and_mean(law, p):
    assert norm_cvar(p, *law) >= max(norm_quantile(p, *law), norm_mean(*law)) * (1 - 1e-11)


@many
@given(gaussians(), st.floats(0.01, 0.999))
def test_gradient_obeys_euler(law, p):
    """r is homogeneous: of degree 1 in m and 1/2 in S together."""
    m, S = law
    r, _, dm, dS = norm_gradient_jit(m, S, p)
    assert dm @ m + 2 * (dS * S).sum() == pytest.approx(r, rel=1e-7)


@many
@given(gaussians(), st.floats(0.05, 0.9999))
def test_bounds_are_a_ladder(law, p):
    ladder = bounds(p, *law)
    assert ladder.gaussian <= ladder.unimodal * (1 + 1e-12)
    assert ladder.unimodal <= ladder.moments * (1 + 1e-12)


@some
@given(laws(), st.floats(0.05, 0.999), seeds)
def test_declared_law_turning_and_units(law, p, seed):
    turn = special_ortho_group.rvs(3, random_state=seed) * 7.0
    moved = LinearLaw(turn @ law.mean, turn @ law.covariance @ turn.T, turn @ law.columns, law.kinds)
    assert law_quantile(moved, p).quantile_mm == pytest.approx(7 * law_quantile(law, p).quantile_mm, rel=2e-6)


@some
@given(laws(), st.floats(0.05, 0.999))
def test_declared_law_within_its_bounds(law, p):
    """Every declared law is symmetric log-concave about its mean, so the unimodal bound holds for it."""
    result = law_quantile(law, p)
    ladder = bounds(p, law.mean, law.total_covariance)
    assert result.quantile_mm <= ladder.unimodal * (1 + 1e-9)
    assert law_cdf(law, result.quantile_mm) == pytest.approx(p, abs=1e-6)


@some
@given(laws(centred=True), st.floats(0.05, 0.999))
def test_removing_a_source_never_raises_the_quantile_without_bias(law, p):
    """Anderson's theorem again: the rest is symmetric log-concave."""
    total = law_quantile(law, p).quantile_mm
    for j in range(law.kinds.size):
        kept = np.arange(law.kinds.size) != j
        rest = replace(law, columns=np.ascontiguousarray(law.columns[:, kept]), kinds=law.kinds[kept])
        assert law_quantile(rest, p).quantile_mm <= total * (1 + 1e-6)
    assert law_quantile(replace(law, covariance=0.5 * law.covariance), p).quantile_mm <= total * (1 + 1e-6)


@some
@given(laws(), seeds)
def test_worst_case_is_worse_than_any_point_of_the_box(law, seed):
    rng = np.random.default_rng(seed)
    box = rng.normal(size=(3, 3)) * 0.3
    worst = worst_case(law, box, 0.95).quantile.quantile_mm
    inside = LinearLaw(law.mean + box @ rng.uniform(-1, 1, 3), law.covariance, law.columns, law.kinds)
    assert law_quantile(inside, 0.95).quantile_mm <= worst * (1 + 1e-6)
