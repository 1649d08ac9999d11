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
inequalities via semidefinite programming", Math. Program. 156).  In a plane alpha is 2 and the factor 1/2, on a line
it is Gauss's 4/9.  By symmetry, with x = e - m,

    2 P(|e| >= r) = P(|x + m| >= r) + P(|x - m| >= r) <= P(x not in E1) + P(x not in E2)

for E1 inside both balls of radius r about m and -m, E2 inside their union.  E1: the ellipsoid of least tr(W S), by
the S-lemma again ``tr(W S) = 1/u^2`` with ``tr S u^2 + 2 sqrt(m'S m) u = R^2 = r^2 - |m|^2``.  E2: the ball
|x|^2 <= R^2, in which one of |x + m|^2, |x - m|^2 (their mean is |x|^2 + |m|^2) is at most r^2.  A bound, not always
the supremum.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..geometry.arrays import Array
from ..kernels.numerics import principal_axes
from ..results import Bounds
from .gaussian import law_iv, norm_quantile, probability_iv

_GAUSS = (1.0, 4 / 9, 1 / 2, 0.4 ** (2 / 3))  # by how many directions the error varies in


def _best_kappa(odds: float, l: Array, m: Array) -> float:  # noqa: E741
    """Where the derivative ``1 - sum w_i / (l_i + kappa)^2``, w_i = odds l_i m_i^2, vanishes; 0 if nowhere.

    It is concave and increasing: Newton's steps from below never pass the root, and no single term may exceed 1 at it.
    """
    weights = odds * l * m * m
    kappa = max(0.0, float((np.sqrt(weights) - l).max()))
    for _ in range(60):
        terms = weights / (l + kappa) ** 2
        slope = 1.0 - float(terms.sum())
        if slope >= 0.0:
            break
        step = -0.5 * slope / float((terms / (l + kappa)).sum())
        kappa += step
        if step <= 1e-15 * kappa:
            break
    return kappa


def _moment_square(eps: float, l: Array, m: Array) -> float:  # noqa: E741
    """r^2, mm^2, of the module's formula: variances l (k,) mm^2 that are not 0, all of the mean m (3,) mm."""
    along = m[: l.size]
    kappa = _best_kappa(1.0 / eps - 1.0, l, along)
    share = l / (l + kappa)
    lost = float(((1.0 - share) * along * along).sum() + (m[l.size :] ** 2).sum())
    return float((l + share * along * along).sum()) / eps + kappa + lost


def _unimodal_square(goal: float, trace: float, b: float) -> float:
    """R^2, mm^2, with ``1/u^2 + tr S/R^2 = goal``; b = sqrt(m'S m), mm^2.

    With ``y = sqrt(b^2 + R^2 tr S) - b`` it is the cubic ``y^3 + 2 b y^2 - a (y + b) = 0``, ``a = 2 (tr S)^2 / goal``.
    It is convex at y > 0 and not negative at sqrt(a), from where Newton's steps fall to the root.
    """
    a = 2.0 * trace * trace / goal
    y = sqrt(a)
    for _ in range(60):
        lower = y - (((y + 2.0 * b) * y - a) * y - a * b) / ((3.0 * y + 4.0 * b) * y - a)
        if not lower < y:
            break
        y = lower
    return y * (y + 2.0 * b) / trace


def bounds(p: float, mean: Array, covariance: Array) -> Bounds:
    """The ladder at probability p, mm; covariance (3, 3) mm^2 is the total one.  Raises ValueError."""
    p = probability_iv(p)
    mean, covariance = law_iv(mean, covariance)
    gaussian = norm_quantile(p, mean, covariance)
    l, m, _ = principal_axes(mean, covariance)  # noqa: E741
    square = float((mean * mean).sum())
    if l[0] == 0.0:
        return Bounds(gaussian, sqrt(square), sqrt(square))
    moments = sqrt(_moment_square(1.0 - p, l[l > 0.0], m))
    trace, across = float(np.trace(covariance)), sqrt(max(float(mean @ covariance @ mean), 0.0))
    gauss = _GAUSS[int((l > 0.0).sum())]
    unimodal = sqrt(square + _unimodal_square(2.0 * (1.0 - p) / gauss, trace, across))
    # Wider classes have larger quantiles, so the moment bound holds here too (it is the smaller one for small p).
    return Bounds(gaussian, min(unimodal, moments), moments)
