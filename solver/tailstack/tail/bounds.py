"""Upper bounds of the quantile of |e| when only part of the law is granted: Gaussian, unimodal, two moments.

**Moments only.**  Over all laws with mean m and covariance S (variances ``l_i``, mean ``m_i`` in the eigenbasis), the
largest P(|e| >= r) is a semidefinite programme (S-lemma): minimise tr(M W) over M >= 0, M >= A_t,
``A_t = diag(t, t, t, 1 - t r^2)``, t >= 0, W the second moments of (e, 1).  With ``W = F F'`` the least M is the
positive part of ``F'A_t F``, an arrow matrix with at most one negative eigenvalue -nu.  Its secular equation in
kappa = nu/t gives t, and asking for the value eps = 1 - p leaves one convex function of one variable:

    r^2 = tr S/eps + |m|^2 + min over kappa >= 0 of  kappa + (1/eps - 1) sum_i l_i m_i^2 / (l_i + kappa)

Every kappa >= 0 gives a feasible M, hence a true upper bound; the minimum is the supremum itself.  On one axis it is
Cantelli's ``|m| + s sqrt(1/eps - 1)``, without mean Chebyshev's ``sqrt(tr S / eps)``.

**Symmetric-unimodal.**  e - m is a mixture of uniform laws on convex bodies symmetric about 0 (central convex unimodal,
Dharmadhikari & Joag-Dev 1988; every symmetric log-concave density is, so every law this package declares).  It is
then star-unimodal: e - m = U^(1/3) Y with U uniform on (0, 1) independent of Y.  For an ellipsoid {x'Wx <= 1} and
z = Y'WY,

    P((e - m)'W(e - m) >= 1) = E (1 - z^(-3/2))+  <=  (3/5) (2/5)^(2/3) E z  =  (2/5)^(2/3) tr(W S)

because the tangent from the origin, touching at z = (5/2)^(2/3), lies above the curve, and E z = (5/3) tr(W S).
This is the multivariate Gauss inequality for alpha = 3 (Van Parys, Goulart & Kuhn 2016, "Generalized Gauss
inequalities via semidefinite programming", Math. Program. 156).  By symmetry, with x = e - m,

    2 P(|e| >= r) = P(|x + m| >= r) + P(|x - m| >= r) <= P(x not in E1) + P(x not in E2)

for E1 inside both balls of radius r about m and -m, E2 inside their union.  E1: the ellipsoid of least tr(W S), by
the S-lemma again ``tr(W S) = 1/u^2`` with ``tr S u^2 + 2 sqrt(m'S m) u = R^2 = r^2 - |m|^2``.  E2: the ball
|x|^2 <= R^2, in which one of |x + m|^2, |x - m|^2 (their mean is |x|^2 + |m|^2) is at most r^2.  A bound, not always
the supremum.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import fabs, sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from ..results import Bounds
from .gaussian import norm_quantile_jit, probability_iv, sound
from .spectrum import law_iv, principal_axes

_GAUSS_3 = 0.4 ** (2 / 3)


@dataclass(frozen=True, slots=True, eq=False)
class MomentBound:
    """r with P(|e| >= r) <= 1 - p for every law of these moments, and the dual point that proves it.

    The quadratic ``(x, 1)'M(x, 1)`` is >= 0 everywhere and >= 1 where |x| >= r (as M - diag(t, t, t, 1 - t r^2) >= 0,
    t >= 0), and its expectation is 1 - p.
    """

    r: float  # mm
    M: Array  # (4, 4)
    t: float  # 1/mm^2


@kernel()
def _best_kappa(odds: float, l: Array, m: Array) -> float:  # noqa: E741
    """Where the derivative ``1 - sum w_i / (l_i + kappa)^2``, w_i = odds l_i m_i^2, vanishes; 0 if nowhere.

    It is concave and increasing: Newton's steps from below never pass the root, and no single term may exceed 1 at it.
    """
    kappa = 0.0
    for i in range(3):
        if l[i] > 0.0:
            kappa = max(kappa, sqrt(odds * l[i]) * fabs(m[i]) - l[i])
    for _ in range(60):
        slope = 1.0
        curvature = 0.0
        for i in range(3):
            if l[i] > 0.0:
                term = odds * l[i] * m[i] * m[i] / (l[i] + kappa) ** 2
                slope -= term
                curvature += 2.0 * term / (l[i] + kappa)
        if slope >= 0.0 or curvature == 0.0:
            break
        step = -slope / curvature
        kappa += step
        if step <= 1e-15 * kappa:
            break
    return kappa


@kernel()
def _moment_square(eps: float, l: Array, m: Array) -> tuple[float, float, float]:  # noqa: E741
    """(r^2, kappa, 1/t) of the module's formula."""
    kappa = _best_kappa(1.0 / eps - 1.0, l, m)
    numerator = 0.0
    rest = kappa
    for i in range(3):
        share = l[i] / (l[i] + kappa) if l[i] > 0.0 else 0.0
        numerator += l[i] + share * m[i] * m[i]
        rest += (1.0 - share) * m[i] * m[i]
    return numerator / eps + rest, kappa, numerator / eps


@kernel()
def _unimodal_square(goal: float, trace: float, b: float) -> float:
    """R^2 with ``1/u^2 + tr S/R^2 = goal``, by bisection to the last digit; b = sqrt(m'S m)."""
    low = trace / goal  # E2 alone already reaches the goal here
    high = 2.0 * (2.0 * trace / goal + b / sqrt(0.5 * goal))  # E1 twice: E2 is never the more likely one to be missed
    for _ in range(120):
        square = 0.5 * (low + high)
        u = square / (b + sqrt(b * b + trace * square))  # the positive root, without cancellation
        if 1.0 / (u * u) + trace / square > goal:
            low = square
        else:
            high = square
        if high - low <= 4e-16 * high:
            break
    return high


def moment_bound(p: float, mean: Array, covariance: Array) -> MomentBound:
    """The largest p-quantile of |e| over all laws with this mean (3,) mm and covariance (3, 3) mm^2, certified.

    Raises ValueError for a bad law or p, or a zero covariance (there is nothing to bound).
    """
    p = probability_iv(p)
    mean, covariance = law_iv(mean, covariance)
    l, m, axes = principal_axes(mean, covariance)  # noqa: E741
    if l[0] == 0.0:
        raise ValueError("a law with zero covariance has one possible value; it needs no bound")
    square, kappa, inverse_t = _moment_square(1.0 - p, l, m)
    t = 1.0 / inverse_t
    free = np.where(l + kappa > 0, 1.0 / np.where(l + kappa > 0, l + kappa, 1.0), 0.0)
    w = np.append(-m * free, 1.0 + float((m * m * free).sum()))
    w /= sqrt(1.0 + float((l * (m * free) ** 2).sum()))
    M = np.diag([t, t, t, 1.0 - t * square]) + kappa * t * np.outer(w, w)
    turn = np.eye(4)
    turn[:3, :3] = axes
    return MomentBound(sqrt(square), turn @ M @ turn.T, t)


@kernel()
def _ladder(p: float, mean: Array, covariance: Array) -> tuple[float, float, float]:
    """Gaussian (NaN: not converged), symmetric-unimodal and moment quantile; nothing is checked."""
    l, m, _ = principal_axes(mean, covariance)  # noqa: E741
    size2 = mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]
    trace = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    moments = sqrt(_moment_square(1.0 - p, l, m)[0]) if l[0] > 0.0 else sqrt(size2)
    unimodal = sqrt(size2)
    if trace > 0.0:
        across = 0.0
        for i in range(3):
            for j in range(3):
                across += mean[i] * covariance[i, j] * mean[j]
        square = _unimodal_square(2.0 * (1.0 - p) / _GAUSS_3, trace, sqrt(max(across, 0.0)))
        # Wider classes have larger quantiles, so the moment bound holds here too (it is the smaller one for small p).
        unimodal = min(sqrt(size2 + square), moments)
    return norm_quantile_jit(mean, covariance, p), unimodal, moments


def moment_quantile(p: float, mean: Array, covariance: Array) -> float:
    """The largest p-quantile of |e|, mm, over all laws with this mean and covariance.  Raises ValueError."""
    return float(_ladder(probability_iv(p), *law_iv(mean, covariance))[2])


def unimodal_quantile(p: float, mean: Array, covariance: Array) -> float:
    """An upper bound, mm, of the p-quantile of |e| over laws symmetric-unimodal about the mean.  Raises ValueError."""
    return float(_ladder(probability_iv(p), *law_iv(mean, covariance))[1])


def bounds(p: float, mean: Array, covariance: Array) -> Bounds:
    """The ladder at probability p, mm; covariance (3, 3) mm^2 is the total one.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    gaussian, unimodal, moments = _ladder(probability_iv(p), mean, covariance)
    return Bounds(sound(gaussian, "the quantile", mean, covariance), unimodal, moments)
