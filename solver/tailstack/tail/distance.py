"""A quantile and probabilities of one law, coarse, from one lattice: how far units lie from where they should."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, sqrt

from .ball import ball_sums
from .declared import LinearLaw, lattice_columns, law_cdf_coarse, law_quantile_coarse, tolerances
from .declared_kernels import on_principal_axes, solve_on_axes, start_radius


def quantile_and_probabilities(law: LinearLaw, p: float, radii: Sequence[float]) -> tuple[float, list[float]]:
    """(p-quantile of |e|, P(|e| <= r) for each of the radii, 0 where that is NaN); mm.

    As good as ``law_quantile_coarse`` and ``law_cdf_coarse``.  The lattice of the quantile serves radii up to some 8 %
    above it; beyond, and for laws that have no lattice, it is those two.
    """
    h, _ = lattice_columns(law)
    found = False
    if h.shape[0]:
        sigma, m, S, turned, _, dimension, offset = on_principal_axes(law.mean, law.covariance, h)
        start = start_radius(p, sigma, m, turned)
        found, rho, _, _, largest, t, w = solve_on_axes(p, start, sigma, m, S, turned, dimension, *tolerances(p, False))

    def probability(r: float) -> float:
        if isnan(r):
            return 0.0
        if not found or r * r - offset > largest * largest:
            return law_cdf_coarse(law, r)
        if r * r <= offset:
            return 0.0
        return min(max(float(ball_sums(sqrt(r * r - offset), dimension, t, w)[0]), 0.0), 1.0)

    quantile = sqrt(rho * rho + offset) if found else law_quantile_coarse(law, p).quantile_mm
    return quantile, [probability(r) for r in radii]
