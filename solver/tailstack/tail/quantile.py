"""Quantile of |e|^2 for e ~ N(m, S), compiled: a start, and a third-order correction on the contour's nodes.

With ``d = r^2 - |m|^2``, ``log P(tail; d) = log p_tail`` is solved by reversion of its third-order Taylor series.
Function and three derivatives come from one set of nodes, and so do their values at the next, nearby d; two
rounds give full precision from a start good to a per cent.
"""

from __future__ import annotations

from math import erf, exp, fabs, log, log1p, sqrt

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .contour import EXACT, MAX_NODES, cumulant, moments_on_nodes, tail_nodes
from .spectrum import brought_near, principal_axes

_SQRT2PI = sqrt(2 * 3.141592653589793)


@kernel()
def normal_quantile_jit(p: float) -> float:
    """Standard normal quantile, 0 < p < 1, to 1e-9: Acklam's rational start, one Halley step on erf."""
    q = p if p < 0.5 else 1.0 - p
    if q > 0.02425:
        u = q - 0.5
        v = u * u
        num = (
            (((-39.69683028665376 * v + 220.9460984245205) * v - 275.9285104469687) * v + 138.3577518672690) * v
            - 30.66479806614716
        ) * v + 2.506628277459239
        den = (
            (((-54.47609879822406 * v + 161.5858368580409) * v - 155.6989798598866) * v + 66.80131188771972) * v
            - 13.28068155288572
        ) * v + 1.0
        x = u * num / den
    else:
        w = sqrt(-2.0 * log(q))
        num = (
            (((-0.007784894002430293 * w - 0.3223964580411365) * w - 2.400758277161838) * w - 2.549732539343734) * w
            + 4.374664141464968
        ) * w + 2.938163982698783
        den = (((0.007784695709041462 * w + 0.3224671290700398) * w + 2.445134137142996) * w + 3.754408661907416) * w
        den += 1.0
        x = num / den
    return x if p < 0.5 else -x


@kernel()
def _pearson_excess(p: float, l: Array, m: Array) -> float:  # noqa: E741
    """Quantile of d by Pearson's (1959) shifted chi-square on three cumulants, Wilson-Hilferty for the chi-square."""
    c1 = 0.0
    c2 = 0.0
    c3 = 0.0
    for i in range(3):
        mm = m[i] * m[i]
        c1 += l[i]
        c2 += l[i] * (l[i] + 2.0 * mm)
        c3 += l[i] * l[i] * (l[i] + 3.0 * mm)
    h = c2 * c2 * c2 / (c3 * c3)
    t = 2.0 / (9.0 * h)
    cube = 1.0 - t + normal_quantile_jit(p) * sqrt(t)
    return c1 + sqrt(c2 * h) * (cube * cube * cube - 1.0)


@kernel()
def _lower_start(p: float, l: Array, m: Array) -> float:  # noqa: E741
    """Lower quantile of d from the Lugannani-Rice (1980) formula, solved for its saddle s < 0 and never leaving it.

    Three cumulants say nothing about the lower tail (the Pearson law may start above the quantile), while d = k'(s)
    lies inside the support for every s.  Good to a few per cent of the probability.
    """
    z = normal_quantile_jit(p)
    _, _, k2, _ = cumulant(0.0, l, m)
    theta = -z / sqrt(k2)
    lo = 0.0
    hi = np.inf
    for _ in range(100):
        k0, d, k2, _ = cumulant(-theta, l, m)
        w = -sqrt(max(2.0 * (-theta * d - k0), 1e-300))
        slope = exp(-0.5 * w * w) / _SQRT2PI
        if w > -6.0:
            tail = 0.5 * (1.0 + erf(w / sqrt(2.0))) + slope * (1.0 / w + 1.0 / (theta * sqrt(k2)))
        else:  # Mills' ratio: 1/w cancels
            tail = slope * (1.0 / (theta * sqrt(k2)) + 1.0 / (w * w * w))
        if not tail > 0.0:
            hi = theta
            theta = 0.5 * (lo + hi)
            continue
        g = log(tail / p)
        if fabs(g) < 0.01:
            return d
        if g > 0.0:
            lo = theta
        else:
            hi = theta
        factor = g * tail / (slope * sqrt(k2) * theta)
        new = theta * exp(min(max(factor, -2.0), 2.0))
        if not (lo < new < hi):
            new = 0.5 * (lo + hi) if hi < np.inf else 4.0 * theta
        theta = new
    return cumulant(-theta, l, m)[1]


@kernel()
def excess_quantile(
    p: float,
    l: Array,  # noqa: E741
    m: Array,
    agreement: float = EXACT,
) -> tuple[float, float, bool]:
    """(d, density of Q at it, converged) with ``P(|e|^2 - |m|^2 <= d) = p``.  l, m: eigenbasis, l[0] > 0.

    agreement: of two successive steps on the contour (``tail_nodes``).
    """
    floor = 0.0  # the support of d starts here: e cannot leave the mean along an axis of zero variance
    total = 0.0  # the mean of d
    for i in range(3):
        total += l[i]
        if l[i] > 0.0:
            floor -= m[i] * m[i]
    lo = floor
    hi = np.inf
    d = floor
    if p >= 0.3:
        d = _pearson_excess(p, l, m)
    if not d > floor:
        d = _lower_start(p, l, m)
    # Each formula is at its best on its own side of the mean; P(Q <= mean) < 0.7, so no digits are lost either way.
    upper = d > total
    target = log1p(-p) if upper else log(p)
    sign = 1.0 if upper else -1.0
    sr = np.empty(MAX_NODES)
    si = np.empty(MAX_NODES)
    gr = np.empty(MAX_NODES)
    gi = np.empty(MAX_NODES)
    base = 0.0
    log_factor = 0.0
    n = 0
    fresh = False
    sound = False
    for _ in range(100):
        if not fresh:
            n, log_factor, sound = tail_nodes(d, upper, l, m, sr, si, gr, gi, agreement)
            base = d
            fresh = True
        a0, a1, a2, a3 = moments_on_nodes(d - base, n, sr, si, gr, gi)
        t0 = sign * a0
        if not (t0 > 0.0 and a1 > 0.0):
            if d == base:
                return d, np.nan, False
            fresh = False
            continue
        l1 = -a1 / t0 * sign
        g = log_factor + log(t0) - target
        # Series of log t: t' = -sign a1, t'' = sign a2, t''' = -sign a3.
        t2 = sign * a2 / t0
        t3 = -sign * a3 / t0
        l2 = t2 - l1 * l1
        l3 = t3 - 3.0 * l1 * t2 + 2.0 * l1 * l1 * l1
        if g * l1 > 0.0:
            hi = min(hi, d)
        else:
            lo = max(lo, d)
        v = -g / l1
        b2 = 0.5 * l2 / l1
        b3 = l3 / (6.0 * l1)
        step = v
        if fabs(b2 * v) < 0.2 and fabs((2.0 * b2 * b2 - b3) * v * v) < 0.2:
            step = v - b2 * v * v + (2.0 * b2 * b2 - b3) * v * v * v
        # Newton on log P against log r is the safer of two steps down: it cannot leave the support.
        new = d + step
        if not new > lo:
            new = 0.5 * (lo + d)
        if not new < hi:
            new = 0.5 * (hi + d)
        step = new - d
        d = new
        if fabs(g) < 2e-4 or fabs(step) <= 1e-15 * fabs(d):
            if sound:
                density = a1 * exp(log_factor) * (1.0 + step * (-a2 / a1 + 0.5 * step * a3 / a1))
                return d, density, True
            return d, a1 * exp(log_factor), False
        if fabs(g) > 0.7:
            fresh = False
    return d, np.nan, False


@kernel()
def quantile_on_axes(p: float, variances: Array, m: Array, agreement: float = EXACT) -> float:
    """:func:`norm_quantile_jit` with the covariance's principal axes known: variances (3,), mean (3,) along them."""
    m, shift = brought_near(variances, m)
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if variances[0] == 0.0:
        return size
    d, _, converged = excess_quantile(p, variances, m, agreement)
    if not converged:
        return np.nan
    return shift + sqrt(max(size * size + d, 0.0))


@kernel()
def norm_quantile_jit(mean: Array, covariance: Array, p: float) -> float:
    """The p-quantile of |e|, mm, from compiled code; NaN when it did not converge.  Nothing is checked."""
    variances, m, _ = principal_axes(mean, covariance)
    return quantile_on_axes(p, variances, m)
