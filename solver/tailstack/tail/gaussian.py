"""The law of |e| for e ~ N(m, S) in three dimensions: probability, density, quantile, mean, tail mean, gradient.

Exact to about 1e-12 relative for any mean (3,) mm and any positive semidefinite covariance (3, 3) mm^2, singular
ones included, by contour integration of the moment generating function of |e|^2.  Mean and covariance are in one and
the same frame, whichever; the norm does not see it.

Functions ending in ``_jit`` check nothing and may be called from compiled code.

The quantile has a start and a third-order correction on the contour's nodes: with ``d = r^2 - |m|^2``, ``log P(tail;
d) = log p_tail`` is solved by reversion of its third-order Taylor series.  Function and three derivatives come from
one set of nodes, and so do their values at the next, nearby d; two rounds give full precision from a start good to a
per cent.

**The contour** goes through the saddle point of a tail integral of ``Q = |e|^2``.  In the eigenbasis of S (variances
``l_i``, mean ``m_i``), with ``u_i = 1 - 2 s l_i``,

    log E exp(s (Q - |m|^2)) = k(s) = sum_i [ -1/2 log u_i + 2 s^2 l_i m_i^2 / u_i ],      Re s < 1 / (2 max l)

The excess ``d = Q - |m|^2`` is the variable everywhere: with a bias a thousand times the noise, ``|m|^2`` would
otherwise cancel against x and take six digits with it.  Nothing divides by ``l_i``: a singular S is not special.

    P(Q > x) =  1/(2 pi i) int_{c - i inf}^{c + i inf} exp(k(s) - s d) / s ds,   0 < c < 1 / (2 max l)
    P(Q <= x) = the same with c < 0 and the sign reversed (the pole at 0 is then on the other side)

Both tails keep their relative accuracy, however small.  c is the saddle of the whole integrand, and the path is
bent to the right, where exp(-s d) decays.  Rice (1980, "Distribution of quadratic forms in normal random variables:
evaluation by numerical integration", SIAM J. Sci. Stat. Comput. 1, 438-448) uses the parabola
``c + i t + a t^2`` that follows the path of steepest descent to third order (a is a sixth of the ratio of the
third to the second derivative of the exponent).  Far out a parabola runs into trouble: about c the means contribute
``w^2 / (1 - 2 l w)`` times a positive factor, w = s - c, whose real part turns positive once w leans to the right by
more than 45 degrees.  So the path here is the hyperbola of the same curvature with asymptotes a little steeper
than 45 degrees (slope b = 0.85),

    s = c + C (b (cosh tau - 1) + i sinh tau),      C = b / (2 a),

on which that term always decays and the rest decays doubly exponentially in tau.  Every singularity lies on the real
axis, off the path, so the trapezoidal rule in tau converges geometrically.  The nodes are kept: a neighbouring
d, densities, derivatives and conditional means are other weights on the same nodes.
"""

from __future__ import annotations

from math import cos, exp, fabs, log, log1p, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import wofz

from ..errors import NotConvergedError, Problem
from ..geometry.arrays import Array
from ..kernels.numerics import eigen_symmetric, exponential, principal_axes, share_lost, sine_and_cosine
from ..kernels.store import kernel
from .approximation import pearson_square
from .lattice import sum_of_products

Complex = NDArray[np.complex128]

MAX_NODES = 1024
_LANES = 8  # nodes are computed so many at a time
_SLOPE = 0.85  # of the asymptotes: at 1 a Gaussian factor stops decaying far out, at 0.5 the nodes double
AGREEMENT = 3e-8  # of two successive steps: the finer one, twice as many digits, is at rounding
SYMMETRY_TOLERANCE = 1e-9  # of the largest entry
PSD_TOLERANCE = 1e-9  # of the largest eigenvalue: what products like J S J^T leave behind, with a margin


class Path(NamedTuple):
    """A hyperbola through the saddle of a tail integral."""

    crossing: float  # 1/mm^2, where it crosses the real axis: c
    size: float  # 1/mm^2: C
    cumulant: float  # k(c)
    excess: float  # mm^2: d
    l: Array  # noqa: E741  (3,) mm^2, variances
    m: Array  # (3,) mm, mean along their axes


class Nodes(NamedTuple):
    """Nodes and weights of an integral over the path: over them, for any h that is real on the real axis,

    1/(2 pi i) int h(s) exp(k(s) - s d) ds = exp(log_factor) sum_k Re[ h(s_k) g_k ]
    """

    s: Complex  # (n,) 1/mm^2
    g: Complex  # (n,)
    log_factor: float
    converged: bool  # two successive steps agree; the finer one is the answer


@kernel()
def cumulant(s: float, l: Array, m: Array) -> tuple[float, float, float, float]:  # noqa: E741
    """k(s) and its first three derivatives at real s < 1 / (2 max l), 1/mm^2.  l (3,) mm^2, m (3,) mm."""
    k0 = 0.0
    k1 = 0.0
    k2 = 0.0
    k3 = 0.0
    for i in range(3):
        li = l[i]
        if li > 0.0:
            mm = m[i] * m[i]
            v = 1.0 / (1.0 - 2.0 * s * li)
            lv = li * v
            k0 += -0.5 * log1p(-2.0 * s * li) + 2.0 * s * s * lv * mm
            k1 += lv + 4.0 * s * lv * v * mm * (1.0 - s * li)
            k2 += 2.0 * lv * lv + 4.0 * lv * v * v * mm
            k3 += 8.0 * lv * lv * lv + 24.0 * lv * lv * v * v * mm
    return k0, k1, k2, k3


@kernel()
def saddle(d: float, upper: bool, l: Array, m: Array) -> float:  # noqa: E741
    """The real s where ``k'(s) - d - 1/s = 0``: in (0, 1/(2 max l)) for the upper tail, below 0 for the lower.

    Solved to 0.1 %: the integral does not depend on where the path crosses, only its cost does.
    """
    top = 0.5 / float(l[0])
    if upper:
        lo, hi = 0.0, top
        s = 0.5 * top
    else:
        lo, hi = -np.inf, 0.0
        s = -0.5 * top
    for _ in range(200):
        _, k1, k2, _ = cumulant(s, l, m)
        g = k1 - d - 1.0 / s
        slope = k2 + 1.0 / (s * s)
        if g > 0.0:
            hi = s
        else:
            lo = s
        step = -g / slope
        if fabs(step) < 1e-3 * min(fabs(s), top - s):
            return s + step
        new = s + step
        if not upper and new < 4.0 * s:  # far out 1/s and k' are powers of s: quadruple rather than overshoot
            new = 4.0 * s
        if new <= lo or new >= hi:
            new = 0.5 * (s + hi) if g <= 0.0 else (0.5 * (s + lo) if lo > -np.inf else 4.0 * s)
        s = new
    return s


@kernel()
def _integrands(path: Path, first: int, stride: int, step: float, lanes: Array, count: int) -> None:
    """(s, g) at the nodes ``tau = (first + i stride) step``: real, imaginary parts one after the other in
    lanes (4 _LANES,), count of each.

    ``g = exp(k(s) - s d - (k(c) - c d)) (ds/dtau) / i``.  No branch and no call in the loop: it runs in lanes.
    """
    c, size, k_c, d, l, m = path  # noqa: E741
    for i in range(count):
        falling = exponential(-0.5 * (first + i * stride) * step)
        half = 0.5 * (1.0 / falling - falling)  # sinh of half of tau
        cosh1 = 2.0 * half * half
        right = _SLOPE * size * cosh1
        si = 2.0 * size * half * sqrt(1.0 + half * half)
        sr = c + right
        er = -k_c - right * d
        ei = -si * d
        qr = 1.0
        qi = 0.0
        for a in range(3):  # an axis with l = 0 changes nothing
            ur = 1.0 - 2.0 * l[a] * sr
            ui = -2.0 * l[a] * si
            modulus2 = ur * ur + ui * ui
            w = 2.0 * l[a] * m[a] * m[a] / modulus2
            s2r = sr * sr - si * si
            s2i = 2.0 * sr * si
            er += w * (s2r * ur + s2i * ui)
            ei += w * (s2i * ur - s2r * ui)
            # Principal square root: Im u < 0 on the upper half of the path, so the branch is never crossed.
            root = sqrt(0.5 * (sqrt(modulus2) + fabs(ur)))
            other = 0.5 * ui / root
            rr = root if ur >= 0.0 else -other
            ri = other if ur >= 0.0 else -root
            before = qr
            qr = before * rr - qi * ri
            qi = before * ri + qi * rr
        sine, cosine = sine_and_cosine(ei)
        scale = exponential(er) / (qr * qr + qi * qi)
        zr = scale * (cosine * qr + sine * qi)
        zi = scale * (sine * qr - cosine * qi)
        jr = size * (1.0 + cosh1)  # (ds/dtau) / i
        ji = -_SLOPE * si
        lanes[i] = sr
        lanes[_LANES + i] = si
        lanes[2 * _LANES + i] = zr * jr - zi * ji
        lanes[3 * _LANES + i] = zr * ji + zi * jr


@kernel()
def tail_nodes(d: float, upper: bool, l: Array, m: Array) -> Nodes:  # noqa: E741
    """Nodes for the tail of an excess d, mm^2, above or below it; l (3,) mm^2 with l[0] > 0, m (3,) mm."""
    c = saddle(d, upper, l, m)
    k0, _, k2, k3 = cumulant(c, l, m)
    f2 = k2 + 1.0 / (c * c)
    # Above 0 the pole's own third derivative would bend the path to the left, round the pole, where exp(-s d) grows.
    a = (k3 - 2.0 / (c * c * c)) / (6.0 * f2)
    if upper:
        a = max(a, 0.25 * k3 / (6.0 * k2))
    path = Path(c, 0.5 * _SLOPE / a, k0, d, l, m)
    step = 1.0 / (sqrt(f2) * path.size)
    # Deep in the lower tail of a biased law s d cancels against s |m|^2; what rounding leaves is not disagreement.
    agree = AGREEMENT + min(2e-15 * fabs(c * d), 0.1)
    nodes = np.empty(MAX_NODES, dtype=np.complex128)
    weights = np.empty(MAX_NODES, dtype=np.complex128)
    lanes = np.empty(4 * _LANES)
    n = 0
    tail = 0.0  # sum Re[g / s]
    density = 0.0  # sum Re[g]
    converged = False
    for level in range(8):
        old_tail = tail
        old_density = density
        k = 0 if level == 0 else 1
        stride = 1 if level == 0 else 2
        quiet = 0
        lane = _LANES
        while n < MAX_NODES:
            if lane == _LANES:  # a count known to the compiler would be unrolled, and then not run in lanes
                _integrands(path, k, stride, step, lanes, lanes.size // 4)
                lane = 0
            xr, xi = lanes[lane], lanes[_LANES + lane]
            yr, yi = lanes[2 * _LANES + lane], lanes[3 * _LANES + lane]
            lane += 1
            if k == 0:
                yr *= 0.5
                yi *= 0.5
            nodes[n] = complex(xr, xi)
            weights[n] = complex(yr, yi)
            n += 1
            tail += (yr * xr + yi * xi) / (xr * xr + xi * xi)
            density += yr
            # Derivatives weight the far nodes by (s/c)^2 more: they must be negligible too.
            far = (fabs(yr) + fabs(yi)) * (1.0 + (xr * xr + xi * xi) / (c * c))
            quiet = quiet + 1 if far < 1e-16 * fabs(density) else 0
            if quiet == 2:
                break
            k += stride
        if level > 0:
            converged = fabs(tail - 2.0 * old_tail) <= agree * fabs(tail) and fabs(
                density - 2.0 * old_density
            ) <= agree * fabs(density)
        if converged or n >= MAX_NODES:
            break
        step *= 0.5
    return Nodes(nodes[:n], weights[:n] * (step / pi), k0 - c * d, converged)


@kernel()
def moments_on_nodes(delta: float, nodes: Nodes) -> tuple[float, float, float, float]:
    """``sum Re[s^j g exp(-s delta)]`` for j = -1, 0, 1, 2: tail, density and two derivatives at d + delta, mm^2."""
    a0 = 0.0
    a1 = 0.0
    a2 = 0.0
    a3 = 0.0
    for k in range(nodes.s.size):
        x = nodes.s[k]
        y = nodes.g[k]
        if delta != 0.0:
            falling = exp(-x.real * delta)
            y *= complex(falling * cos(x.imag * delta), -falling * sin(x.imag * delta))
        z = x * y
        a0 += (y.real * x.real + y.imag * x.imag) / (x.real * x.real + x.imag * x.imag)
        a1 += y.real
        a2 += z.real
        a3 += z.real * x.real - z.imag * x.imag
    return a0, a1, a2, a3


@kernel()
def log_tail(d: float, upper: bool, l: Array, m: Array) -> tuple[float, float, bool]:  # noqa: E741
    """(log of the tail probability, density of Q over the tail probability, converged) at excess d, mm^2.

    l (3,) mm^2 with l[0] > 0, m (3,) mm.
    """
    nodes = tail_nodes(d, upper, l, m)
    a0, a1, _, _ = moments_on_nodes(0.0, nodes)
    t = a0 if upper else -a0
    return nodes.log_factor + log(t), a1 / t, nodes.converged


# --- the law of the length --------------------------------------------------------------------------------

_FAR, _NEAR = 1e8, 1e6  # lengths of the mean, in largest standard deviations


@kernel()
def brought_near(variances: Array, m: Array) -> tuple[Array, float]:
    """(a mean (3,) in the same direction, by how much it is shorter): where the noise is lost in the digits of |m|.

    What |e| exceeds |m| by depends on the direction of m and, through the curvature of the sphere, on sigma / |m|.
    From a mean 1e8 standard deviations away, taking one 1e6 away changes it by less than 1e-6 standard deviations, a
    relative 1e-14 of |e|, and the contour of the nearer law has all its digits.
    """
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    sigma = sqrt(variances[0])
    if sigma == 0.0 or size < _FAR * sigma:
        return m, 0.0
    near = m * (_NEAR * sigma / size)
    return near, size - _NEAR * sigma


@kernel()
def law_on_axes(l: Array, m: Array, r: float) -> tuple[float, float, float]:  # noqa: E741
    """(P(|e| <= r), P(|e| > r), density at r in 1/mm), each with its own relative accuracy; NaN: not converged.

    l (3,) mm^2: variances of the principal axes, descending; m (3,) mm: the mean along them; r in mm.  The density of a
    law without spread is returned as 0.
    """
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
    tail, hazard, converged = log_tail(d, upper, l, m)
    if not converged:
        return np.nan, np.nan, np.nan
    probability = exp(tail)
    density = 2.0 * r * hazard * probability
    if upper:
        return 1.0 - probability, probability, density
    return probability, 1.0 - probability, density


# Nodes t of E|e|, at equal steps of log t; how many there are where the law spreads in space, and else.
_STEP, _FIRST = 0.15, -46
_SQUARES = np.exp(2 * _STEP * np.arange(_FIRST, 120))
_INVERSES = _STEP / np.sqrt(_SQUARES)
_NODES_IN_SPACE, _NEGLIGIBLE = 120, 1e-17
_BELOW = np.array([_STEP * np.exp(k * (_FIRST - 1) * _STEP) / -np.expm1(-k * _STEP) for k in (1, 3)])


@kernel()
def mean_on_axes(variances: Array, m: Array) -> float:
    """E|e|, mm, = pi^(-1/2) int_0^inf (1 - E exp(-t^2 |e|^2)) / t^2 dt, by the trapezoidal rule in log t.

    variances (3,) mm^2 of the principal axes, m (3,) mm the mean along them.  In log t the integrand is analytic and
    bounded in the strip |Im| < pi/4, whatever m and S: the moment generating function is at most 1 where Re(t^2) >= 0.
    So one step serves all: the error of 0.15 is exp(-2 pi (pi/4) / 0.15) = 5e-15.  In units of E|e|^2 the integrand is
    ``t - E|e|^4 t^3 / 2 + O(t^5)`` towards 0, and 1/t less the generating function over t towards infinity: below
    exp(-7), and where that is negligible, the rule is a geometric series.  The function, at most 1 / sqrt(p) with p the
    product of all 1 + 2 t^2 l, is exp(-drift) / sqrt(p); what it lacks to 1 is put together without a difference of
    like numbers.
    """
    square = 0.0
    for i in range(3):
        square += variances[i] + m[i] * m[i]
    if square == 0.0:
        return 0.0
    a, b, c = variances[0] / square, variances[1] / square, variances[2] / square
    ma, mb, mc = m[0] * m[0] / square, m[1] * m[1] / square, m[2] * m[2] / square
    fourth = 1.0 + 2.0 * (a * (a + 2.0 * ma) + b * (b + 2.0 * mb) + c * (c + 2.0 * mc))
    z = 2.0 * _SQUARES[_NODES_IN_SPACE]
    least = _INVERSES[_NODES_IN_SPACE] / sqrt((1.0 + z * a) * (1.0 + z * b) * (1.0 + z * c))
    count = _NODES_IN_SPACE if least < _NEGLIGIBLE else _SQUARES.size
    terms = np.empty(count)
    for k in range(count):  # no branch and no call: in lanes
        z = _SQUARES[k]
        u, v, w = 2.0 * z * a, 2.0 * z * b, 2.0 * z * c
        more = u + v + w + (u * v + u * w + v * w) + u * v * w  # p - 1
        drift = ma * (1.0 + v) * (1.0 + w) + mb * (1.0 + u) * (1.0 + w) + mc * (1.0 + u) * (1.0 + v)
        root = sqrt(1.0 + more)
        terms[k] = more / (root * (1.0 + root)) + share_lost(z * drift / (1.0 + more)) / root
    ends = _BELOW[0] - 0.5 * fourth * _BELOW[1] + _INVERSES[count - 1] / (exp(_STEP) - 1.0)
    return float((ends + sum_of_products(_INVERSES[:count], terms)) * sqrt(square / pi))


@kernel()
def norm_mean_jit(mean: Array, covariance: Array) -> float:
    """:func:`mean_on_axes` of a mean (3,) mm and a covariance (3, 3) mm^2 in any frame."""
    variances, m, _ = principal_axes(mean, covariance)
    return mean_on_axes(variances, m)


@kernel()
def norm_gradient_jit(mean: Array, covariance: Array, p: float) -> tuple[float, float, Array, Array]:
    """(r in mm, density at r in 1/mm, dr/dm (3,), dr/dS (3, 3) in 1/mm) at the p-quantile; r is NaN when it did not
    converge.  mean (3,) mm, covariance (3, 3) mm^2.

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
    nodes = tail_nodes(d, d > l[0] + l[1] + l[2], l, m)
    if not (converged and nodes.converged):
        return np.nan, np.nan, dm, ds
    r = sqrt(max(size * size + d, 0.0))
    local_m = np.zeros(3)
    local_s = np.zeros((3, 3))
    inverse = np.empty(3, dtype=np.complex128)
    density = 0.0
    for k in range(nodes.s.size):
        s = nodes.s[k]
        g = nodes.g[k]
        density += g.real
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
    dm[:] = scale * (vectors @ local_m)
    turned = vectors @ local_s @ vectors.T
    ds[:] = 0.5 * scale * (turned + turned.T)
    return shift + r, 2.0 * r * density * exp(nodes.log_factor), dm, ds


def law_iv(mean: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]:
    """Check a mean (3,) mm and a covariance (3, 3) mm^2 and return them as contiguous float arrays.

    Raises ValueError naming the rule that is broken and what arrived.
    """
    mean = np.ascontiguousarray(mean, dtype=np.float64)
    covariance = np.ascontiguousarray(covariance, dtype=np.float64)
    for name, array, shape in (("mean", mean, (3,)), ("covariance", covariance, (3, 3))):
        if array.shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite, got {array.tolist()}")
    if np.abs(covariance - covariance.T).max() > SYMMETRY_TOLERANCE * np.abs(covariance).max():
        raise ValueError(
            f"covariance must be symmetric to {SYMMETRY_TOLERANCE:g} of its largest entry, got {covariance.tolist()}"
        )
    values, _, _ = eigen_symmetric(covariance)
    if values[2] < -PSD_TOLERANCE * max(values[0], 0.0):
        raise ValueError(
            f"covariance must be positive semidefinite; its smallest eigenvalue is {values[2]:.3g}, "
            f"its largest {values[0]:.3g}"
        )
    return mean, covariance


def probability_iv(p: float) -> float:
    """Check 0 < p < 1.  Raises ValueError."""
    p = float(p)
    if not 0.0 < p < 1.0:
        raise ValueError(f"a probability strictly between 0 and 1 is needed, got {p}")
    return p


def sound(value: float, what: str, mean: Array, covariance: Array) -> float:
    """The value of a compiled function.  Raises NotConvergedError where it is NaN."""
    if value != value:
        detail = f"{what} of |N(m, S)| did not converge for m = {mean.tolist()} mm, S = {covariance.tolist()} mm^2"
        hint = "report this law: every mean and positive semidefinite covariance is meant to be handled"
        raise NotConvergedError(Problem("", "tail-not-converged", detail, hint))
    return float(value)


def _law_at(r: float, mean: Array, covariance: Array) -> tuple[float, float, float]:
    """:func:`law_on_axes` of a law that is checked here.  Raises ValueError, NotConvergedError."""
    mean, covariance = law_iv(mean, covariance)
    r = float(r)
    if not r >= 0.0:
        raise ValueError(f"a radius must be >= 0 mm, got {r}")
    variances, m, _ = principal_axes(mean, covariance)
    below, above, density = law_on_axes(variances, m, r)
    return sound(below, "the probability", mean, covariance), float(above), float(density)


def norm_cdf(r: float, mean: Array, covariance: Array) -> float:
    """P(|e| <= r).  r >= 0 mm, mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    return _law_at(r, mean, covariance)[0]


def norm_sf(r: float, mean: Array, covariance: Array) -> float:
    """P(|e| > r), accurate when it is small.  r >= 0 mm, mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    return _law_at(r, mean, covariance)[1]


def norm_quantile(p: float, mean: Array, covariance: Array) -> float:
    """The r, mm, with P(|e| <= r) = p.  mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return sound(norm_quantile_jit(mean, covariance, probability_iv(p)), "the quantile", mean, covariance)


def norm_mean(mean: Array, covariance: Array) -> float:
    """E|e|, mm.  mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    return float(norm_mean_jit(mean, covariance))


def norm_excess(r: float, mean: Array, covariance: Array) -> float:
    """E[(|e| - r)+], mm.  r >= 0 mm, mean (3,) mm, covariance (3, 3) mm^2.  Raises ValueError."""
    mean, covariance = law_iv(mean, covariance)
    l, m, _ = principal_axes(mean, covariance)  # noqa: E741
    m, shift = brought_near(l, m)
    size, r = sqrt(float((m * m).sum())), r - shift
    if l[0] == 0.0:
        return max(size - r, 0.0)
    d = (r - size) * (r + size)
    if r > 0.0 and d > l.sum():
        above = _mean_above(d, r, l, m)
    else:
        above = norm_mean(m, np.diag(l)) - r + (_mean_below(r, l, m) if r > 0.0 else 0.0)
    return sound(above, "the tail mean", mean, covariance)


def _mean_above(d: float, r: float, l: Array, m: Array) -> float:  # noqa: E741
    """E[(|e| - r)+], mm, with r^2 = |m|^2 + d above the mean of |e|^2; NaN: not converged.

    int_r^inf P(|e| > rho) d rho taken under the contour: each node contributes sqrt(pi/s)/2 erfcx(r sqrt(s)).
    """
    nodes = tail_nodes(d, True, l, m)
    root = np.sqrt(nodes.s)
    total = (nodes.g / root**3 * wofz(1j * r * root)).real.sum()  # wofz(i z) = exp(z^2) erfc(z)
    return float(0.5 * sqrt(pi) * exp(nodes.log_factor) * total) if nodes.converged else np.nan


def _mean_below(r: float, l: Array, m: Array) -> float:  # noqa: E741
    """E[(r - |e|)+] = int_0^r P(|e| <= rho) d rho, mm, on principal axes."""
    from scipy.integrate import quad  # the mean beyond a quantile below the mean is rarely asked for

    edge = min(sqrt(float((m[l == 0.0] ** 2).sum())), r)
    return float(quad(lambda rho: law_on_axes(l, m, rho)[0], edge, r, epsabs=0.0, epsrel=1e-11, limit=200)[0])


@kernel()
def normal_quantile(p: float) -> float:
    """Standard normal quantile, 0 < p < 1, to 4.5e-4: a start (Hastings 1955; Abramowitz and Stegun 26.2.23)."""
    t = sqrt(-2.0 * log(min(p, 1.0 - p)))
    x = t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))
    return x if p > 0.5 else -x


@kernel()
def gaussian_cumulants(l: Array, m: Array) -> tuple[float, float, float]:  # noqa: E741
    """c1, c2, c3 of |e|^2 (``approximation.py``), mm^2, mm^4, mm^6.

    l (3,) mm^2: variances of the principal axes; m (3,) mm: the mean along them.
    """
    c1 = 0.0
    c2 = 0.0
    c3 = 0.0
    for i in range(3):
        mm = m[i] * m[i]
        c1 += l[i] + mm
        c2 += l[i] * (l[i] + 2.0 * mm)
        c3 += l[i] * l[i] * (l[i] + 3.0 * mm)
    return c1, c2, c3


@kernel()
def excess_quantile(p: float, l: Array, m: Array) -> tuple[float, float, bool]:  # noqa: E741
    """(d in mm^2, density of Q at it, converged) with ``P(|e|^2 - |m|^2 <= d) = p``.

    l (3,) mm^2: variances of the principal axes, l[0] > 0; m (3,) mm: the mean along them.
    """
    floor = 0.0  # the support of d starts here: e cannot leave the mean along an axis of zero variance
    total = 0.0  # the mean of d
    for i in range(3):
        total += l[i]
        if l[i] > 0.0:
            floor -= m[i] * m[i]
    lo = floor
    hi = np.inf
    _, c2, c3 = gaussian_cumulants(l, m)
    d = pearson_square(total, c2, c3, normal_quantile(p))
    if not d > floor:  # three cumulants say nothing about the lower tail
        d = 0.5 * (floor + total)
    # Each formula is at its best on its own side of the mean; P(Q <= mean) < 0.7, so no digits are lost either way.
    upper = d > total and p >= 0.3
    target = log1p(-p) if upper else log(p)
    sign = 1.0 if upper else -1.0
    base = d
    nodes = tail_nodes(d, upper, l, m)
    fresh = True
    for _ in range(100):
        if not fresh:
            nodes = tail_nodes(d, upper, l, m)
            base = d
        a0, a1, a2, a3 = moments_on_nodes(d - base, nodes)
        t0 = sign * a0
        if not (t0 > 0.0 and a1 > 0.0):
            if d == base:
                return d, np.nan, False
            fresh = False
            continue
        l1 = -a1 / t0 * sign
        g = nodes.log_factor + log(t0) - target
        if g * l1 > 0.0:
            hi = min(hi, d)
        else:
            lo = max(lo, d)
        if not upper and fabs(g) > 0.2:
            # log P bends strongly in d and hardly in the logarithm of d - floor: a step there cannot leave the support.
            new = floor + (d - floor) * exp(min(max(-g / (l1 * (d - floor)), -4.0), 4.0))
            fresh = False
        else:
            # Derivatives of log t; those of t are a1, a2, a3 with alternating signs.
            t2 = sign * a2 / t0
            t3 = -sign * a3 / t0
            l2 = t2 - l1 * l1
            l3 = t3 - 3.0 * l1 * t2 + 2.0 * l1 * l1 * l1
            v = -g / l1
            b2 = 0.5 * l2 / l1
            b3 = l3 / (6.0 * l1)
            new = d + v
            if fabs(b2 * v) < 0.2 and fabs((2.0 * b2 * b2 - b3) * v * v) < 0.2:
                new = d + v - b2 * v * v + (2.0 * b2 * b2 - b3) * v * v * v
            fresh = fabs(g) < 0.7
        if not new > lo:
            new = 0.5 * (lo + d)
        if not new < hi:
            new = 0.5 * (hi + d)
        step = new - d
        d = new
        if fabs(g) < 2e-4 or fabs(step) <= 1e-15 * fabs(d):
            density = a1 * exp(nodes.log_factor)
            if nodes.converged:
                density *= 1.0 + step * (-a2 / a1 + 0.5 * step * a3 / a1)
            return d, density, nodes.converged
    return d, np.nan, False


@kernel()
def quantile_on_axes(p: float, variances: Array, m: Array) -> float:
    """The p-quantile of |e|, mm; NaN: not converged.  variances (3,) mm^2 of the principal axes, mean (3,) mm along
    them."""
    m, shift = brought_near(variances, m)
    size = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if variances[0] == 0.0:
        return size
    d, _, converged = excess_quantile(p, variances, m)
    if not converged:
        return np.nan
    return shift + sqrt(max(size * size + d, 0.0))


@kernel()
def norm_quantile_jit(mean: Array, covariance: Array, p: float) -> float:
    """:func:`quantile_on_axes` of a mean (3,) mm and a covariance (3, 3) mm^2 in any frame."""
    variances, m, _ = principal_axes(mean, covariance)
    return quantile_on_axes(p, variances, m)


@kernel()
def norm_quantiles(p: float, means: Array, covariance: Array) -> Array:
    """(n,) mm: the p-quantile of |N(m, S)| for each of the means (n, 3) mm, S (3, 3) mm^2; NaN: not converged."""
    out = np.empty(means.shape[0])
    m = np.zeros(3)
    variances, _, axes = principal_axes(m, covariance)
    for i in range(out.size):
        for a in range(3):
            m[a] = 0.0
            for k in range(3):
                m[a] += axes[k, a] * means[i, k]
        out[i] = quantile_on_axes(p, variances, m)
    return out
