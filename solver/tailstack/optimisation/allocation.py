"""Tolerance allocation at a fixed layout: convex in the variances, under convex bounds of the tail.

With the layout fixed and no bias, ``S(v) = S_noise + sum_i v_i g_i g_i'`` is linear in the variances
``v_i = tau_i^2 / 3`` of uniform tolerances of half-width tau_i, and the cost ``sum c_i / tau_i``, or
``sum c_i (3 v_i)^(-1/2)``,
is convex in them.  Each bound below is convex in S and at least the Gaussian P95 squared, so the feasible set is
convex and inside the true one; ratios to the exact P95 squared over all spectra:

- ``fro``:   ``tr S + 2.8415 |S|_F``   1.0000-1.0093 (a second-order cone; checked numerically, not proven);
- ``trace``: ``3.8415 tr S``          1.000-1.214 (a theorem: equality at rank one), optimum in closed form;
- ``lmax``:  ``7.8147 lambda_max(S)`` 1.000-1.426 (a theorem: equality at S = I).

It stops being convex when the bias moves with the tolerances, or when the layout does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
from scipy.stats import chi2

from ..errors import InfeasibleError, NotConvergedError, Problem
from ..system import Array

Bound = Literal["fro", "trace", "lmax"]
_ONE, _THREE = float(chi2.ppf(0.95, 1)), float(chi2.ppf(0.95, 3))
FROBENIUS = _ONE - 1.0  # exact at rank one, where tr S = |S|_F


@dataclass(frozen=True, slots=True, eq=False)
class Allocation:
    """Half-widths (k,) in the native unit of each gain, and their cost."""

    bound: Bound
    half_width: Array
    cost: float


def _infeasible(noise: float, limit_mm: float) -> InfeasibleError:
    return InfeasibleError(
        Problem(
            "/requirements",
            "noise-alone-exceeds-limit",
            f"without any tolerance the bound of P95 is {sqrt(noise):.4g} mm, over the limit of {limit_mm:g} mm",
            "loosen the limit, lower the noise or move the fiducials: no tolerance helps",
        )
    )


def allocate_by_trace(noise: Array, gains: Array, cost: Array, limit_mm: float) -> Allocation:
    """Closed form under the trace bound: ``tau_i = s (c_i / |g_i|^2)^(1/3)``.

    noise (3, 3) mm^2; gains (k, 3), mm per unit of each tolerance; cost (k,).  From stationarity of the Lagrangian,
    ``c_i / tau_i^2 = 2/3 lambda |g_i|^2 tau_i``; s makes the bound tight.  Raises InfeasibleError.
    """
    room = limit_mm**2 / _ONE - float(np.trace(noise))
    if room <= 0:
        raise _infeasible(_ONE * float(np.trace(noise)), limit_mm)
    size2 = (gains**2).sum(axis=1)
    shape = (cost / size2) ** (1 / 3)
    half_width = shape * sqrt(3 * room / float((size2 * shape**2).sum()))
    return Allocation("trace", half_width, float((cost / half_width).sum()))


def allocate(noise: Array, gains: Array, cost: Array, limit_mm: float, bound: Bound = "fro") -> Allocation:
    """Cheapest uniform tolerances whose bound of P95 is within the limit; see :func:`allocate_by_trace`.

    Raises InfeasibleError when the noise alone is over the limit, NotConvergedError when the solver stops early.
    """
    if bound == "trace":
        return allocate_by_trace(noise, gains, cost, limit_mm)
    alone = float(np.trace(noise)) + FROBENIUS * float(np.linalg.norm(noise))
    if bound == "lmax":
        alone = _THREE * float(np.linalg.eigvalsh(noise)[-1])
    if alone >= limit_mm**2:
        raise _infeasible(alone, limit_mm)
    return _by_cone(noise, gains, cost, limit_mm, bound)


def _by_cone(noise: Array, gains: Array, cost: Array, limit_mm: float, bound: Bound) -> Allocation:
    import cvxpy as cp

    # In units of the closed form's optimum the variables are near 1, whatever rad and mm are.
    start = allocate_by_trace(noise * min(1.0, 0.5 * limit_mm**2 / (_ONE * np.trace(noise))), gains, cost, limit_mm)
    unit = start.half_width**2 / 3
    scaled = cp.Variable(len(cost), pos=True)
    outer = np.einsum("ia,ib,i->iab", gains, gains, unit) / limit_mm**2
    total = noise / limit_mm**2 + sum(scaled[i] * outer[i] for i in range(len(cost)))
    if bound == "fro":
        within = cp.trace(total) + FROBENIUS * cp.norm(total, "fro") <= 1
    else:
        within = _THREE * cp.lambda_max(total) <= 1
    price = cost / start.half_width
    problem = cp.Problem(cp.Minimize(price / price.sum() @ cp.power(scaled, -0.5)), [within])
    problem.solve(solver=cp.CLARABEL)
    if problem.status != cp.OPTIMAL:
        detail = f"the conic solver stopped with status {problem.status!r}"
        raise NotConvergedError(Problem("/optimise", "allocation-not-converged", detail, "report the design"))
    half_width = start.half_width * np.sqrt(np.asarray(scaled.value, dtype=np.float64))
    return Allocation(bound, half_width, float((cost / half_width).sum()))
