"""Tail integrals of a quadratic form in normals, on a contour through their saddle point.

``Q = |e|^2`` with e ~ N(m, S); in the eigenbasis of S (variances ``l_i``, mean ``m_i``), with ``u_i = 1 - 2 s l_i``,

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
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from .elementary import exponential, sine_and_cosine

Complex = NDArray[np.complex128]

MAX_NODES = 1024
_LANES = 8  # nodes are computed so many at a time
_SLOPE = 0.85  # of the asymptotes: at 1 a Gaussian factor stops decaying far out, at 0.5 the nodes double
AGREEMENT = 3e-8  # of two successive steps: the finer one, twice as many digits, is at rounding


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
