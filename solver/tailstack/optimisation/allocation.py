"""Tolerance allocation at a fixed layout: convex in the variances, under a convex bound of the tail.

With the layout fixed and no bias, the covariance at a target is affine in the variances ``v_i = (per_i h_i)^2`` of
the tolerances, ``S(v) = S_noise + sum_i v_i g_i g_i'``, per_i the standard deviation per half-width (1/sqrt 3
uniform, 1/sqrt 6 triangular, 1/coverage normal).  The bound below is convex in S, so in v, and the
costs ``w h^-n`` and ``w exp(-h/s)`` are convex in v (powers v^(-n/2), and exp of the convex -sqrt v): a convex
programme, whose dual bounds its optimum from below.

It stops being convex when the bias moves with the tolerances (bounded laws), when the risk is per unit, and when the
layout moves.  And its optimum is that of the bound.  It brackets the optimum under the exact law only for normal
tolerances (:func:`gaussian_bracket`); for uniform and triangular ones, whose tails are lighter than those of the
Gaussian law of the same covariance, the true optimum may be cheaper than anything computed here.

*The bound* of a Gaussian quantile is convex in the covariance, which makes tolerance allocation a convex programme.

With q_k the p-quantile of chi-square with k degrees of freedom, the squared p-quantile of |N(0, S)| is at most
``tr S + c |S|_F``, c = max(0, (q_k - k) / sqrt k over k = 1, 2, 3), 2.8415 at p = 0.95: exact at one, two or three
equal eigenvalues from p = 0.61.  It is checked numerically: over grids of spectra and p from 0.05 to 0.999999 no ratio
to the exact squared quantile fell below 1.  ``c = q_1 - 1`` alone is no bound below p = 0.945: at p = 0.9 it is up to
4.8 % too small, at equal eigenvalues.  Largest ratios of bound to exact squared quantile (those of the trace, max_k
(q_k / k) tr S, a theorem from p = 0.785 on, are 1.475 at p = 0.95; of 7.81 times the largest eigenvalue 2.034):

    p    0.8     0.9     0.95    0.99    0.999
         1.186   1.063   1.0187  1.125   1.231
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from ..errors import InfeasibleError, NotConvergedError, Problem
from ..geometry.arrays import Array
from .least_cost import (
    PriceCurves,
    Programme,
    Widths,
    cheapest_widths,
    curves_of,
    log_costs,
    solve_programme,
    total_cost,
)
from .prices import Price

# Half-widths are as good as the square root of the gap, so it is asked for near rounding; what is reached is checked.
_SOLVER_OPTIONS = {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12}
_LARGEST_GAP = 1e-6  # relative, between cost and dual bound: what an answer is accepted by
# The six numbers of a symmetric matrix, scaled so that their Euclidean norm is the Frobenius norm.
_ROWS, _COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
_WEIGHTS = np.array([1.0, 1.0, 1.0, sqrt(2), sqrt(2), sqrt(2)])


@dataclass(frozen=True, slots=True, eq=False)
class BoundedAllocation:
    """Half-widths, what they cost, and what no allocation under the same bound can undercut."""

    half_width: Array  # (k,) native units
    cost: float
    lower_bound_cost: float  # Lagrangian bound, recomputed from the multipliers
    gap: float  # (cost - lower_bound_cost) / cost


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """The tolerances that are to be chosen, in units of each limit; the others are part of the noise."""

    p: float
    noise: Array  # (t, 3, 3) over limit^2
    outer: Array  # (t, k, 3, 3): per^2 g g' over limit^2, per squared half-width
    curves: PriceCurves
    lower: Array  # (k,)
    upper: Array  # (k,) finite

    def covariance(self, half_width: Array) -> Array:
        """(t, 3, 3) over limit^2."""
        return np.asarray(self.noise + np.einsum("tiab,i->tab", self.outer, half_width**2))

    def ratios(self, half_width: Array) -> Array:
        """(t,) the bound over limit^2."""
        return squared_bound(self.covariance(half_width), self.p)


def allocate(
    noise: Array,
    gains: Array,
    prices: Sequence[Price],
    std_per_half_width: Array,
    limits_mm: Array | float,
    *,
    lower: Array | float,
    upper: Array | float,
    p: float = 0.95,
) -> BoundedAllocation:
    """Cheapest half-widths between lower and upper with the bound of the p-quantile within the limit at every target.

    noise (t, 3, 3) or (3, 3) mm^2; gains (t, k, 3) or (k, 3), mm per native unit of each tolerance; std_per_half_width
    (k,); limits_mm (t,); lower (k,) >= 0, upper (k,) may be inf.  Grades are priced by the power law through them.
    Raises InfeasibleError when the tightest half-widths exceed the bound, NotConvergedError when the duality gap stays
    above 1e-6.
    """
    gains = np.asarray(gains, dtype=np.float64).reshape(-1, len(prices), 3)
    limits = np.broadcast_to(np.asarray(limits_mm, dtype=np.float64), gains.shape[:1])
    low, high = (np.broadcast_to(np.asarray(b, dtype=np.float64), len(prices)) for b in (lower, upper))
    case, curves, free = _case(noise, gains, prices, np.asarray(std_per_half_width), limits, low, high, p)

    def answer(chosen: Array, dual: float | None) -> BoundedAllocation:
        half_width = np.array(np.broadcast_to(high, len(prices)))
        half_width[free] = chosen
        cost = total_cost(curves, half_width)
        fixed = cost - total_cost(case.curves, chosen)
        least = cost if dual is None else min(fixed + dual, cost)
        gap = (cost - least) / cost if cost > 0 else 0.0
        return BoundedAllocation(half_width, cost, least, gap)

    tightest = case.ratios(case.lower)
    if tightest.max() >= 1:
        raise _refuse_infeasible(tightest, limits, p)
    if case.ratios(case.upper).max() <= 1:
        return answer(case.upper, None)
    widths, multipliers, matrices = _by_cone(case, _unit(case))
    excess = case.ratios(widths)
    # The bound is convex in the variances: on the way to the tightest it is below its chord.
    theta = min(1.0, float(((1 - tightest) / (np.maximum(excess, 1) - tightest)).min()))
    widths = np.sqrt(case.lower**2 + theta * (widths**2 - case.lower**2))
    result = answer(widths, _dual_bound(case, multipliers, matrices))
    if not result.gap <= _LARGEST_GAP:
        raise _refuse_unconverged(f"the cost is {result.gap:.1e} of itself above its dual bound, not {_LARGEST_GAP:g}")
    return result


def gaussian_bracket(allocate: Callable[[Array], BoundedAllocation], limits_mm: Array, p: float) -> tuple[float, float]:
    """(least, attained) cost around the optimum under the exact law, for normal tolerances without bias.

    ``allocate``: the allocation within limits (t,).  The bound divided by :func:`frobenius_excess` is nowhere above the
    exact squared quantile (checked, not proven), so its optimum is not dearer than the true one; the bound's own
    optimum meets the limit.
    """
    return allocate(limits_mm * sqrt(frobenius_excess(p))).lower_bound_cost, allocate(limits_mm).cost


def _case(
    noise: Array, gains: Array, prices: Sequence[Price], per: Array, limits: Array, low: Array, high: Array, p: float
) -> tuple[_Case, PriceCurves, NDArray[np.bool_]]:
    """(programme's data, all curves (k,), which are to be chosen (k,)); the others stay at their high (k,)."""
    curves = curves_of(prices)
    scaled = gains * per[:, None] / limits[:, None, None]
    outer = np.einsum("tia,tib->tiab", scaled, scaled)
    # Alone and without noise a tolerance uses up the limit here: rank one
    size = (1 + frobenius_constant(p)) * (scaled**2).sum(axis=2).max(axis=0)
    seen = size > 0
    free = seen & (high > low)
    reach = np.full(len(prices), np.inf)
    reach[seen] = 1.01 / np.sqrt(size[seen])  # a little beyond, so that the limit and not this stops it
    base = np.asarray(noise, dtype=np.float64).reshape(-1, 3, 3) / limits[:, None, None] ** 2
    still = seen & ~free
    base = base + np.einsum("tiab,i->tab", outer[:, still], high[still] ** 2)
    top = np.minimum(high, np.maximum(reach, 2 * low))
    case = _Case(p, base, outer[:, free], curves.only(free), low[free], top[free])
    return case, curves, free


def _refuse_infeasible(ratios: Array, limits: Array, p: float) -> InfeasibleError:
    worst = int(ratios.argmax())
    least = sqrt(float(ratios[worst])) * float(limits[worst])
    detail = (
        f"with every tolerance at its smallest the bound of P{100 * p:g} is {least:.4g} mm, "
        f"not below the limit of {limits[worst]:g} mm"
    )
    hint = "loosen the limit, lower the noise or the smallest half-widths, or move the fiducials"
    return InfeasibleError(Problem("/requirements", "smallest-tolerances-exceed-limit", detail, hint))


def _refuse_unconverged(detail: str) -> NotConvergedError:
    return NotConvergedError(Problem("/optimise", "allocation-not-converged", detail, "report the design"))


def _unit(case: _Case) -> Array:
    """(k,) unit of the solver's variables, in which they are near 1 whatever rad, mm and the cost's unit are.

    The optimum under the bound by the trace, max_k (q_k / k) tr S (limits doubled in the square where even the smallest
    half-widths break it), but not far below the largest: there the solver would see nothing but the box.
    """
    constant = float((chi_square_quantile(case.p, _MULTIPLICITY) / _MULTIPLICITY).max())
    size = constant * np.trace(case.outer, axis1=2, axis2=3)  # (t, k)
    noise = constant * np.trace(case.noise, axis1=1, axis2=2)
    aim = max(1.0, 2.0 * float((noise + size @ case.lower**2).max()))
    widths, by_square = Widths(case.curves, case.lower, case.upper), np.ascontiguousarray(size / aim)
    best = solve_programme(Programme(widths, noise / aim, by_square), np.zeros(len(noise)))
    return np.asarray(np.maximum(best, 0.03 * case.upper))


def _vectors(symmetric: Array) -> Array:
    """(..., 6) of (..., 3, 3), with the Frobenius norm as their length."""
    return np.asarray(symmetric[..., _ROWS, _COLUMNS] * _WEIGHTS)


def _by_cone(case: _Case, unit: Array) -> tuple[Array, Array, Array]:
    """(half-widths (k,), multipliers (t,), cost per relative limit^2, M (t, 3, 3)): <M, S> touches each bound.

    The cost of tolerance i is ``exp(offset_i - rate_i z_i)``, x its scaled variance, with ``z <= log(x) / 2`` (power
    laws) or ``z <= sqrt(x) - 1`` (exponentials): decreasing in z, so these hold with equality.
    """
    import cvxpy as cp

    curves, targets, tilt = case.curves, case.noise.shape[0], frobenius_constant(case.p)
    log_scale = float(np.logaddexp.reduce(log_costs(curves, unit)))  # the scale itself may underflow
    rate = np.where(curves.exponential, unit / curves.scale, curves.exponent)
    outer = case.outer * (unit**2)[:, None, None]
    x, z = cp.Variable(len(unit)), cp.Variable(len(unit))
    constraints = [x >= (case.lower / unit) ** 2, x <= (case.upper / unit) ** 2]
    powers, falling = np.flatnonzero(~curves.exponential), np.flatnonzero(curves.exponential)
    constraints += [z[powers] <= cp.log(x[powers]) / 2] if powers.size else []
    constraints += [z[falling] <= cp.sqrt(x[falling]) - 1] if falling.size else []
    matrices = tilt * np.swapaxes(_vectors(outer), 1, 2).reshape(6 * targets, -1)
    total = cp.reshape(tilt * _vectors(case.noise).ravel() + matrices @ x, (targets, 6), order="C")
    traces = np.trace(case.noise, axis1=1, axis2=2) + np.trace(outer, axis1=2, axis2=3) @ x
    within = traces + cp.norm(total, 2, axis=1) <= 1
    cost = cp.sum(cp.exp(log_costs(curves, unit) - log_scale - cp.multiply(rate, z)))
    problem = cp.Problem(cp.Minimize(cost), [*constraints, within])
    # Not problem.solve: it warns of an almost solved programme, where the dual bound below is the judge.
    data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts=_SOLVER_OPTIONS)
    solution = chain.invert(chain.solve_via_data(problem, data, solver_opts=_SOLVER_OPTIONS), inverse)
    if solution.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
        raise _refuse_unconverged(f"the conic solver stopped with status {solution.status!r}")
    problem.unpack(solution)
    scaled = np.asarray(x.value, dtype=np.float64)
    multipliers = np.maximum(np.asarray(within.dual_value, dtype=np.float64).reshape(targets), 0.0)
    half_width = np.clip(unit * np.sqrt(np.maximum(scaled, 0.0)), case.lower, case.upper)
    covariance = case.covariance(half_width)
    tangents = np.eye(3) + tilt * covariance / np.linalg.norm(covariance, axis=(1, 2))[:, None, None]
    return half_width, exp(log_scale) * multipliers, tangents


def _dual_bound(case: _Case, multipliers: Array, matrices: Array) -> float:
    """Least Lagrangian over the box: a lower bound of the programme for any multipliers >= 0.

    The bound is at least ``<M, S>`` for its tangent M = I + c Z with |Z|_F <= 1, and with it in the
    bound's place the Lagrangian is a sum over the tolerances, minimised one by one.
    """
    charge = np.einsum("t,tab,tiab->i", multipliers, matrices, case.outer)
    best = cheapest_widths(case.curves, charge, case.lower, case.upper)
    room = 1 - np.einsum("tab,tab->t", matrices, case.noise)
    return float(total_cost(case.curves, best) + charge @ best**2 - multipliers @ room)


_MULTIPLICITY = np.array([1.0, 2.0, 3.0])


def chi_square_quantile(p: float, degrees: Array) -> Array:
    """As ``scipy.stats.chi2.ppf`` has it, whose package takes half a second of every process that imports it."""
    quantiles: Array = 2 * gammaincinv(degrees / 2, p)
    return quantiles


def frobenius_constant(p: float) -> float:
    """c of the bound: exact at the worst of one, two and three equal eigenvalues."""
    return max(0.0, float(((chi_square_quantile(p, _MULTIPLICITY) - _MULTIPLICITY) / np.sqrt(_MULTIPLICITY)).max()))


def frobenius_excess(p: float) -> float:
    """At least the largest ratio of the bound to the exact squared quantile over all spectra.

    Measured, not proven: 1.01864 at p = 0.95; elsewhere the worst of equal eigenvalues and 1.2 %, the most by which any
    spectrum exceeded them (1.13 %, at p = 0.942).
    """
    if p == 0.95:
        return 1.0187
    c = frobenius_constant(p)
    return 1.012 * float(((_MULTIPLICITY + c * np.sqrt(_MULTIPLICITY)) / chi_square_quantile(p, _MULTIPLICITY)).max())


def squared_bound(covariance: Array, p: float) -> Array:
    """(t,) mm^2, at least the squared p-quantile of |N(0, S)| for each S of covariance (t, 3, 3) mm^2."""
    trace = np.trace(covariance, axis1=1, axis2=2)
    return np.asarray(trace + frobenius_constant(p) * np.linalg.norm(covariance, axis=(1, 2)))
