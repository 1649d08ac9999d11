"""Convex allocation at a fixed layout: the oracle, the closed form, and the bound it is built on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tailstack import InfeasibleError
from tailstack.optimisation.allocation import FROBENIUS, allocate, allocate_by_trace
from tailstack.tail.gaussian import norm_quantile

CASE = json.loads((Path(__file__).parents[1] / "data" / "oracles" / "convex_allocation.json").read_text())
NOISE, GAINS, COST = (np.array(CASE[key]) for key in ("Sigma_noise", "G_rows", "cost_coeff"))


@pytest.mark.parametrize("limit", CASE["results"])
@pytest.mark.parametrize("bound", ["fro", "trace", "lmax"])
def test_oracle_costs(limit, bound):
    """oracle: cvxpy, IPOPT and closed form."""
    expected = CASE["results"][limit]
    found = allocate(NOISE, GAINS, COST, float(limit), bound)
    assert found.cost == pytest.approx(expected[f"{bound}_cost"], rel=CASE["tol_rel_cost"])
    if bound == "trace":
        assert found.half_width == pytest.approx(expected["trace_tau_closed"], rel=1e-9)
        assert found.cost == pytest.approx(expected["trace_cost_closed"], rel=1e-9)
    if bound == "fro":
        total = NOISE + (GAINS.T * found.half_width**2 / 3) @ GAINS
        assert norm_quantile(0.95, np.zeros(3), total) == pytest.approx(expected["P95_gauss_at_fro"], rel=1e-5)
        assert found.half_width == pytest.approx(expected["fro_tau_rad"], rel=1e-3)


@pytest.mark.parametrize("bound", ["fro", "trace", "lmax"])
def test_bounds_are_above_the_exact_quantile(bound):
    """independent: the exact law at the allocation never exceeds the limit, over random problems."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        root = rng.normal(size=(3, 3)) * 0.05
        gains, cost = rng.normal(size=(6, 3)) * 100, rng.uniform(0.5, 5, 6)
        found = allocate(root @ root.T, gains, cost, 1.0, bound)
        total = root @ root.T + (gains.T * found.half_width**2 / 3) @ gains
        assert norm_quantile(0.95, np.zeros(3), total) <= 1.0 + 1e-6


def test_frobenius_bound_over_spectra():
    """independent: ratio of bound to exact P95^2 over a grid of spectra stays within 1 and 1.019 (P95: 1.0093)."""
    ratios = []
    for a in np.linspace(0, 1, 15):
        for b in np.linspace(0, a, 8):
            spectrum = np.array([1.0, a, b])
            exact = norm_quantile(0.95, np.zeros(3), np.diag(spectrum)) ** 2
            ratios.append((spectrum.sum() + FROBENIUS * np.linalg.norm(spectrum)) / exact)
    assert min(ratios) > 1 - 1e-9
    assert max(ratios) < 1.0093**2


def test_one_tolerance_by_hand():
    """closed form: one gain g: tau = sqrt(3 (limit^2/3.8415 - tr S)) / |g|."""
    found = allocate_by_trace(np.eye(3) * 0.01, np.array([[0, 165.0, 0]]), np.array([1.0]), 1.0)
    assert found.half_width[0] == pytest.approx(np.sqrt(3 * (1 / 3.841458820694124 - 0.03)) / 165, rel=1e-12)


def test_noise_over_the_limit_is_infeasible():
    for bound in ("fro", "trace", "lmax"):
        with pytest.raises(InfeasibleError, match="without any tolerance"):
            allocate(np.eye(3), GAINS, COST, 0.5, bound)
