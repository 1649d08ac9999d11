"""The law of |e| for e ~ N(m, S) in three dimensions: probability, density, quantile, mean, tail mean, gradient.

Exact to about 1e-12 relative for any mean (3,) mm and any positive semidefinite covariance (3, 3) mm^2, singular
ones included, by contour integration of the moment generating function of |e|^2 (``contour.py``).  Mean and
covariance are in one and the same frame, whichever; the norm does not see it.

Functions ending in ``_jit`` check nothing and may be called from compiled code.

The quantile has a start and a third-order correction on the contour's nodes: with ``d = r^2 - |m|^2``, ``log P(tail;
d) = log p_tail`` is solved by reversion of its third-order Taylor series. Function and three derivatives come from
one set of nodes, and so do their values at the next, nearby d; two rounds give full precision from a start good to a
per cent."""

from __future__ import annotations

from math import atan2, cos, cosh, erf, exp, expm1, fabs, hypot, log, log1p, pi, sin, sinh, sqrt

import numpy as np

from ..arrays import Array
from ..errors import NotConvergedError, Problem
from ..kernels import kernel
from .contour import EXACT, MAX_NODES, cumulant, log_tail, moments_on_nodes, tail_nodes
from .spectrum import brought_near, law_iv, principal_axes

__all__ = [
    "norm_cdf",
    "norm_cvar",
    "norm_mean",
    "norm_pdf",
    "norm_quantile",
    "norm_quantile_gradient",
    "norm_quantile_jit",
    "norm_sf",
]


@kernel()
def norm_law_jit(mean: Array, covariance: Array, r: float) -> tuple[float, float, float]:
    """(P(|e| <= r), P(|e| > r), density at r in 1/mm), each with its own relative accuracy.

    NaN when the contour did not converge.  The density of a law without spread is returned as 0.
    """
    variances, m, _ = principal_axes(mean, covariance)
    return law_on_axes(variances, m, r)


@kernel()
def law_on_axes(
    l: Array,  # noqa: E741
    m: Array,
    r: float,
    agreement: float = EXACT,
) -> tuple[float, float, float]:
    """:func:`norm_law_jit` with the covariance's principal axes known: variances (3,), mean (3,) along them."""
    m, shift = brought_near(l, m)
    r -= shift
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    d = (r - size) * (r + size)
    floor = 0.0
    total = 0.0
    for i in range(3):
        total += l[i]
        if l[i] > 0.0:
            floor -= m[i] * m[i]
    if l[0] == 0.0:
        return (1.0, 0.0, 0.0) if r >= size else (0.0, 1.0, 0.0)
    if r <= 0.0 or d - floor <= -1e-15 * floor:  # outside the support, or at its edge to the last digit
        return 0.0, 1.0, 0.0
    upper = d > total
    tail, hazard, converged = log_tail(d, upper, l, m, agreement)
    if not converged:
        return np.nan, np.nan, np.nan
    probability = exp(tail)
    density = 2.0 * r * hazard * probability
    if upper:
        return 1.0 - probability, probability, density
    return probability, 1.0 - probability, density


@kernel()
def norm_mean_jit(mean: Array, covariance: Array) -> float:
    """E|e| = pi^(-1/2) int_0^inf (1 - E exp(-t^2 |e|^2)) / t^2 dt, by the trapezoidal rule in log t.

    In log t the integrand is analytic and bounded in the strip |Im| < pi/4, whatever m and S: the moment
    generating function is at most 1 where Re(t^2) >= 0.  So one step serves all: the error of 0.15 is
    exp(-2 pi (pi/4) / 0.15) = 5e-15.
    """
    l, m, _ = principal_axes(mean, covariance)  # noqa: E741
    return _mean_on_axes(l, m)


@kernel()
def _mean_on_axes(l: Array, m: Array) -> float:  # noqa: E741
    square = 0.0
    for i in range(3):
        square += l[i] + m[i] * m[i]
    if square == 0.0:
        return 0.0
    step = 0.15
    total = 0.0
    for k in range(-240, 241):
        v = k * step
        t = exp(v)
        exponent = 0.0
        for i in range(3):
            w = 2.0 * t * t * l[i] / square
            exponent -= 0.5 * log1p(w) + t * t * m[i] * m[i] / (square * (1.0 + w))
        total += -expm1(exponent) / t
    return step * total * sqrt(square / pi)


def _erfcx_coefficients() -> Array:
    """Coefficients of Weideman's rational expansion of the Faddeeva function, N = 40, by its defining sum."""
    n = 40
    m = 2 * n
    scale = sqrt(n / sqrt(2.0))
    out = np.zeros(n)
    for j in range(n):
        acc = 0.0
        for k in range(-m + 1, m):
            theta = k * pi / m
            t = scale * sin(0.5 * theta) / cos(0.5 * theta)
            acc += exp(-t * t) * (scale * scale + t * t) * cos((j + 1) * theta)
        out[j] = acc / (2 * m)
    return out


_COEFFICIENTS = _erfcx_coefficients()
_SCALE = sqrt(40 / sqrt(2.0))


@kernel()
def _erfcx(z: complex) -> complex:
    """exp(z^2) erfc(z) for Re z >= 0 (Weideman 1994, SIAM J. Numer. Anal. 31, 1497-1518: w(i z))."""
    denominator = _SCALE + z
    ratio = (_SCALE - z) / denominator
    acc = 0.0 + 0.0j
    for j in range(_COEFFICIENTS.size - 1, -1, -1):
        acc = acc * ratio + _COEFFICIENTS[j]
    return 2.0 * acc / (denominator * denominator) + 1.0 / (sqrt(pi) * denominator)


@kernel()
def _mean_above(d: float, size: float, l: Array, m: Array) -> tuple[float, bool]:  # noqa: E741
    """(E[(|e| - r)+], converged) with r^2 = size^2 + d above the mean of |e|^2.

    int_r^inf P(|e| > rho) d rho taken under the contour: each node contributes sqrt(pi/s)/2 erfcx(r sqrt(s)).
    """
    sr = np.empty(MAX_NODES)
    si = np.empty(MAX_NODES)
    gr = np.empty(MAX_NODES)
    gi = np.empty(MAX_NODES)
    n, b, converged = tail_nodes(d, True, l, m, sr, si, gr, gi)
    r = sqrt(max(size * size + d, 0.0))
    total = 0.0
    for k in range(n):
        modulus = sqrt(hypot(sr[k], si[k]))
        angle = 0.5 * atan2(si[k], sr[k])
        root = complex(modulus * cos(angle), modulus * sin(angle))
        weight = complex(gr[k], gi[k]) / (root * root * root)
        total += (weight * _erfcx(r * root)).real
    return 0.5 * sqrt(pi) * exp(b) * total, converged


@kernel()
def _mean_below(p: float, d: float, density: float, size: float, l: Array, m: Array) -> tuple[float, bool]:  # noqa: E741
    """(E[(r - |e|)+], converged) = int_0^r P(|e| <= rho) d rho, r below the mean, by tanh-sinh quadrature.

    log P(|e| <= rho) is concave in rho (Prekopa: balls are Minkowski-convex in their radius), so the integrand falls
    below r at least as fast as an exponential of width P/f: 40 widths are all of it.
    """
    r = sqrt(size * size + d)
    span = min(r, 40.0 * p / (2.0 * r * density))
    floor = 0.0
    for i in range(3):
        if l[i] > 0.0:
            floor -= m[i] * m[i]
    edge = sqrt(max(size * size + floor, 0.0))
    span = min(span, r - edge)
    step = 0.08
    total = 0.0
    converged = True
    for k in range(40, -41, -1):  # away from r
        v = 0.5 * pi * sinh(k * step)
        fraction = 1.0 / (1.0 + exp(2.0 * v))  # distance from r, in spans; accurate at both ends
        weight = 0.25 * pi * cosh(k * step) / (cosh(v) * cosh(v))
        gap = span * fraction
        drop = d - gap * (2.0 * r - gap)
        if drop - floor <= 1e-13 * (fabs(d) - floor):  # all rounding, and the weights are as small there
            continue
        tail, _, sound = log_tail(drop, drop > l[0] + l[1] + l[2], l, m)
        converged = converged and sound
        total += weight * exp(tail)
        if tail < log(p) - 40.0:
            break
    return step * span * total, converged


@kernel()
def norm_cvar_jit(mean: Array, covariance: Array, p: float) -> tuple[float, float]:
    """(r, E[|e| given |e| >= r]) at the p-quantile r; NaN when something did not converge."""
    l, m, _ = principal_axes(mean, covariance)  # noqa: E741
    m, shift = brought_near(l, m)
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if l[0] == 0.0:
        return size, size
    d, density, converged = excess_quantile(p, l, m)
    r = sqrt(max(size * size + d, 0.0))
    if d > l[0] + l[1] + l[2]:
        above, sound = _mean_above(d, size, l, m)
    else:
        below, sound = _mean_below(p, d, density, size, l, m)
        above = _mean_on_axes(l, m) - r + below
    if not (converged and sound):
        return np.nan, np.nan
    return shift + r, shift + r + above / (1.0 - p)


@kernel()
def norm_gradient_jit(mean: Array, covariance: Array, p: float) -> tuple[float, float, Array, Array]:
    """(r, density at r, dr/dm (3,), dr/dS (3, 3)) at the p-quantile; r is NaN when it did not converge.

    dr = dr_dm . dm + sum_ij dr_dS[i, j] dS[i, j] for symmetric dS.  By the implicit function theorem
    dr = dP(|e| > r) / f(r), and P's derivatives are the same contour integral with the derivatives of the cumulant
    generating function K inside: with ``u = I - 2 s S``, K_m = 2 s u^-1 m, K_S = s u^-1 + 2 s^2 u^-1 m m' u^-1.
    In the eigenbasis no difference of eigenvalues appears, so equal ones do no harm.
    """
    l, m, vectors = principal_axes(mean, covariance)  # noqa: E741
    m, shift = brought_near(l, m)
    dm = np.zeros(3)
    ds = np.zeros((3, 3))
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if l[0] == 0.0:
        return np.nan, np.nan, dm, ds
    d, _, converged = excess_quantile(p, l, m)
    sr = np.empty(MAX_NODES)
    si = np.empty(MAX_NODES)
    gr = np.empty(MAX_NODES)
    gi = np.empty(MAX_NODES)
    n, b, sound = tail_nodes(d, d > l[0] + l[1] + l[2], l, m, sr, si, gr, gi)
    if not (converged and sound):
        return np.nan, np.nan, dm, ds
    r = sqrt(max(size * size + d, 0.0))
    local_m = np.zeros(3)
    local_s = np.zeros((3, 3))
    inverse = np.empty(3, dtype=np.complex128)
    density = 0.0
    for k in range(n):
        s = complex(sr[k], si[k])
        g = complex(gr[k], gi[k])
        density += gr[k]
        for i in range(3):
            inverse[i] = 1.0 / (1.0 - 2.0 * l[i] * s)
        for i in range(3):
            local_m[i] += 2.0 * m[i] * (g * inverse[i]).real
            local_s[i, i] += (g * inverse[i]).real
            for j in range(i + 1):
                local_s[i, j] += 2.0 * m[i] * m[j] * (g * s * inverse[i] * inverse[j]).real
    scale = 1.0 / (2.0 * r * density)
    for i in range(3):
        for j in range(i):
            local_s[j, i] = local_s[i, j]
    for i in range(3):
        for a in range(3):
            dm[i] += scale * vectors[i, a] * local_m[a]
            for j in range(i + 1):
                for c in range(3):
                    ds[i, j] += scale * vectors[i, a] * local_s[a, c] * vectors[j, c]
                ds[j, i] = ds[i, j]
    return shift + r, 2.0 * r * density * exp(b), dm, ds


def probability_iv(p: float) -> float:
    """Check 0 < p < 1.  Raises ValueError."""
    p = float(p)
    if not 0.0 < p < 1.0:
        raise ValueError(f"a probability strictly between 0 and 1 is needed, got {p}")
    return p


def sound(value: float, what: str, mean: Array, covariance: Array) -> float:
    """The value of a compiled function.  Raises NotConvergedError where it is NaN."""
    if value != value:
        raise NotConvergedError(
            Problem(
                "",
                "tail-not-converged",
                f"{what} of |N(m, S)| did not converge for m = {mean.tolist()} mm, S = {covariance.tolist()} mm^2",
                "report this law: every mean and positive semidefinite covariance is meant to be handled",
            )
        )
    return float(value)


def _radius_iv(r: float) -> float:
    r = float(r)
    if not r >= 0.0:
        raise ValueError(f"a radius must be >= 0 mm, got {r}")
    return r


def norm_cdf(r: float, mean: Array, covariance: Array) -> float:
    """P(|e| <= r).  r >= 0 mm, mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return sound(norm_law_jit(mean, covariance, _radius_iv(r))[0], "the probability", mean, covariance)


def norm_sf(r: float, mean: Array, covariance: Array) -> float:
    """P(|e| > r), accurate when it is small.  r >= 0 mm, mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return sound(norm_law_jit(mean, covariance, _radius_iv(r))[1], "the probability", mean, covariance)


def norm_pdf(r: float, mean: Array, covariance: Array) -> float:
    """Density of |e| at r >= 0 mm, in 1/mm.  Raises ValueError, also for a zero covariance, which has none."""
    mean, covariance = law_iv(mean, covariance)
    if not np.any(covariance):
        raise ValueError("a law with zero covariance has no density")
    return sound(norm_law_jit(mean, covariance, _radius_iv(r))[2], "the density", mean, covariance)


def norm_quantile(p: float, mean: Array, covariance: Array) -> float:
    """The r, mm, with P(|e| <= r) = p.  mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return sound(norm_quantile_jit(mean, covariance, probability_iv(p)), "the quantile", mean, covariance)


def norm_mean(mean: Array, covariance: Array) -> float:
    """E|e|, mm.  mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return float(norm_mean_jit(mean, covariance))


def norm_cvar(p: float, mean: Array, covariance: Array) -> float:
    """E[|e| given |e| >= r_p], mm: the mean of the worst 1 - p (expected shortfall).  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return sound(norm_cvar_jit(mean, covariance, probability_iv(p))[1], "the tail mean", mean, covariance)


def norm_quantile_gradient(p: float, mean: Array, covariance: Array) -> tuple[float, Array, Array]:
    """(r, dr/dm (3,), dr/dS (3, 3) symmetric, 1/mm) at the p-quantile r, mm.

    For symmetric dS, dr = sum_ij dr_dS[i, j] dS[i, j].  Raises ValueError, also for a zero covariance: |m| + O(sqrt(S))
    has no derivative by S there.
    """
    mean, covariance = law_iv(mean, covariance)
    if not np.any(covariance):
        raise ValueError("the quantile has no derivative by the covariance where the covariance is zero")
    r, _, dm, ds = norm_gradient_jit(mean, covariance, probability_iv(p))
    return sound(r, "the gradient", mean, covariance), dm, ds


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
