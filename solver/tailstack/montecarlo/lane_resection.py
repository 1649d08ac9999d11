"""Resection of eight trials at a time without a 2N x 12 singular value decomposition (Eqs 2-3).

**Resection.**  With fiducials ``y~ = (y, 1)`` in the object frame, ``D = sum y~ y~'`` diagonal, and images
(u, v) counted from their own mean, DLT minimises ``sum |p1.y~ - s u p3.y~|^2 + |p2.y~ - s v p3.y~|^2`` over
unit (p1, p2, p3), s the image scale of Hartley.  Stationarity for the smallest eigenvalue ``lam = s^2 mu``
eliminates ``p1 = s (D - lam)^-1 G_u p3`` (p2 likewise) and leaves (Eqs 2-3, reduced exactly)

    K(mu) p3 = [ G_w - mu I - G_u (D - s^2 mu)^-1 G_u - G_v (D - s^2 mu)^-1 G_v ] p3 = 0,

``G_f = sum f y~ y~'`` for f = u, v, w = u^2 + v^2.  ``p3 = (a, 1)`` without loss: its last entry is the mean
depth.  The top three rows give ``a``, the Rayleigh quotient of the whole 12-vector gives mu; starting from
mu = 0, steps with the factor of K(0) gain about four digits each, and K(mu) is factored anew where they do not.

**Proof that it is the smallest.**  The inertia of ``M'M - lam`` is that of ``D - lam`` (twice) plus that of K.
If ``D > lam`` and the leading 3x3 block of K(tau) is positive definite (by a bound, else by the pivots of
its factorisation), at most one eigenvalue lies below tau (interlacing).  tau is a Rayleigh quotient,
hence not below the smallest; the eigenvalue found must not exceed it.

Arguments below, lanes unless said:

- ``g``, ``gu``, ``gv``, ``gw``: moment matrices as ten entries, the upper triangle by rows, px (``gw``: px^2);
- ``d``: eight floats, D and 1 / D; ``scale2``: s^2; ``mu``: px^2; ``a0``, ``a1``, ``a2``: the third row (a, 1);
- ``equations``: ((gu, gv, gw), d, scale2), all that K(mu) is made of;
- ``tables``, ``images``: as in ``kernel``.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import (
    absolute,
    any_lane,
    dot3,
    factor3,
    fma,
    lane_jit,
    load,
    reciprocal_shifted,
    sandwich,
    select,
    solve3,
    splat,
    store,
    symmetric_times,
)
from .tables import FIDUCIALS

# Steps stop when the last one is below this (relative to 1, the scale of the unknowns).  The next one would be
# smaller by the rate of convergence: 1e-6 to 1e-4 on good layouts, and never slow if it got here in so few steps.
STEP = 1e-12
QUICK_STEPS = 5
MAX_STEPS = 6
# Largest lam / D for which three Newton steps of the reciprocal are exact to rounding.
LARGEST_SHIFT = 0.01


@lane_jit
def centre(g, shift, d):
    """Moments about the mean image: subtract ``shift`` D from a moment matrix."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    return (
        fma(-shift, splat(d[0]), g00), g01, g02, g03,
        fma(-shift, splat(d[1]), g11), g12, g13,
        fma(-shift, splat(d[2]), g22), g23,
        fma(-shift, splat(d[3]), g33),
    )  # fmt: skip


@lane_jit
def moments(products, images, n, coordinate):
    """``sum f y~ y~'`` of one image coordinate (0 or 8)."""
    zero = splat(0.0)
    g0, g1, g2, g3, g4, g5, g6, g7, g8, g9 = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(n):
        f = load(images, 16 * i + coordinate)
        g0 = fma(f, splat(products[i, 0]), g0)
        g1 = fma(f, splat(products[i, 1]), g1)
        g2 = fma(f, splat(products[i, 2]), g2)
        g3 = fma(f, splat(products[i, 3]), g3)
        g4 = fma(f, splat(products[i, 4]), g4)
        g5 = fma(f, splat(products[i, 5]), g5)
        g6 = fma(f, splat(products[i, 6]), g6)
        g7 = fma(f, splat(products[i, 7]), g7)
        g8 = fma(f, splat(products[i, 8]), g8)
        g9 = fma(f, splat(products[i, 9]), g9)
    return g0, g1, g2, g3, g4, g5, g6, g7, g8, g9


@lane_jit
def square_moments(products, images, n, mean_u, mean_v):
    """``sum w y~ y~'``, w the squared distance to the mean image."""
    zero = splat(0.0)
    g0, g1, g2, g3, g4, g5, g6, g7, g8, g9 = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(n):
        u, v = load(images, 16 * i) - mean_u, load(images, 16 * i + 8) - mean_v
        w = fma(u, u, v * v)
        g0 = fma(w, splat(products[i, 0]), g0)
        g1 = fma(w, splat(products[i, 1]), g1)
        g2 = fma(w, splat(products[i, 2]), g2)
        g3 = fma(w, splat(products[i, 3]), g3)
        g4 = fma(w, splat(products[i, 4]), g4)
        g5 = fma(w, splat(products[i, 5]), g5)
        g6 = fma(w, splat(products[i, 6]), g6)
        g7 = fma(w, splat(products[i, 7]), g7)
        g8 = fma(w, splat(products[i, 8]), g8)
        g9 = fma(w, splat(products[i, 9]), g9)
    return g0, g1, g2, g3, g4, g5, g6, g7, g8, g9


@lane_jit
def resolvent(d, shift):
    """``(D - shift)^-1``, its diagonal."""
    return (
        reciprocal_shifted(d[0], splat(d[4]), shift),
        reciprocal_shifted(d[1], splat(d[5]), shift),
        reciprocal_shifted(d[2], splat(d[6]), shift),
        reciprocal_shifted(d[3], splat(d[7]), shift),
    )


@lane_jit
def shifted_rows(g, a0, a1, a2, s):
    """First (or second) row that belongs to a third row (a, 1): ``(D - s^2 mu)^-1 G p3``."""
    x0, x1, x2, x3 = symmetric_times(g, a0, a1, a2, splat(1.0))
    return x0 * s[0], x1 * s[1], x2 * s[2], x3 * s[3]


@lane_jit
def square_of(x):
    """``x'x`` of a row."""
    return fma(x[0], x[0], fma(x[1], x[1], fma(x[2], x[2], x[3] * x[3])))


@lane_jit
def full_norm2(scale2, a0, a1, a2, u, v):
    """Squared norm of the 12-vector (p1, p2, p3) in Hartley's coordinates."""
    return fma(scale2, square_of(u) + square_of(v), fma(a0, a0, fma(a1, a1, fma(a2, a2, splat(1.0)))))


@lane_jit
def refine(equations, inverse_norm2, factor, steps, iterate):
    """Fixed-factor steps on K(mu) (a, 1) = 0 with exact residuals, mu by the Rayleigh quotient.

    inverse_norm2: of the 12-vector of the first iterate, the quotient's denominator: its residual goes to zero all the
    same.  factor: of the leading block of K.  steps: at most so many.  iterate: a (3), mu, and the mask of active
    lanes; the last one is returned.  Lanes that are not active keep their values: a lane's digits do not depend on its
    neighbours.
    """
    moment, d, scale2 = equations
    gu, gv, gw = moment
    a0, a1, a2, mu, active = iterate
    one = splat(1.0)
    for _ in range(steps):
        s = resolvent(d, scale2 * mu)
        u = shifted_rows(gu, a0, a1, a2, s)
        v = shifted_rows(gv, a0, a1, a2, s)
        w0, w1, w2, w3 = symmetric_times(gw, a0, a1, a2, one)
        q0, q1, q2, q3 = symmetric_times(gu, u[0], u[1], u[2], u[3])
        r0, r1, r2, r3 = symmetric_times(gv, v[0], v[1], v[2], v[3])
        e0, e1, e2 = (w0 - q0) - fma(mu, a0, r0), (w1 - q1) - fma(mu, a1, r1), (w2 - q2) - fma(mu, a2, r2)
        e3 = (w3 - q3) - (r3 + mu)
        value = fma(a0, e0, fma(a1, e1, fma(a2, e2, e3)))
        mu = select(active, fma(value, inverse_norm2, mu), mu)
        x0, x1, x2 = solve3(factor, e0, e1, e2)
        a0, a1, a2 = select(active, a0 - x0, a0), select(active, a1 - x1, a1), select(active, a2 - x2, a2)
        active = active & ~(absolute(x0) + absolute(x1) + absolute(x2) <= splat(STEP))
        if not any_lane(active):
            break
    return a0, a1, a2, mu, active


@lane_jit
def factor_at(equations, tau):
    """Factor of the leading block of K(tau) by its own formula; its pivots prove or refute."""
    moment, d, scale2 = equations
    gu, gv, gw = moment
    s = resolvent(d, scale2 * tau)
    su, sv = sandwich(gu, s[0], s[1], s[2], s[3]), sandwich(gv, s[0], s[1], s[2], s[3])
    return factor3(
        (gw[0] - su[0]) - (sv[0] + tau),
        (gw[1] - su[1]) - sv[1],
        (gw[2] - su[2]) - sv[2],
        (gw[4] - su[4]) - (sv[4] + tau),
        (gw[5] - su[5]) - sv[5],
        (gw[7] - su[7]) - (sv[7] + tau),
    )


@lane_jit
def resect(tables, view, images, estimate):
    """Third row (a, 1) and rows p1, p2 (px, about the mean image) of one view into ``estimate``.

    ``estimate`` gets a (3), p1 (4), p2 (4), 1/|a|^2, mean u, mean v: 14 vectors.  Returns the
    mask of lanes in which the result is proven and converged.
    """
    d = tables.diagonal[view]
    one, zero = splat(1.0), splat(0.0)
    i0, i1, i2, i3 = splat(d[4]), splat(d[5]), splat(d[6]), splat(d[7])
    products, n = tables.products[view], tables.counts[FIDUCIALS]
    gu, gv = moments(products, images, n, 0), moments(products, images, n, 8)
    mean_u, mean_v = gu[9] * i3, gv[9] * i3
    gu, gv = centre(gu, mean_u, d), centre(gv, mean_v, d)
    gw = square_moments(products, images, n, mean_u, mean_v)
    scale2 = splat(2.0 * d[3]) / gw[9]
    equations = ((gu, gv, gw), d, scale2)

    su, sv = sandwich(gu, i0, i1, i2, i3), sandwich(gv, i0, i1, i2, i3)
    k00, k01, k02, k03 = gw[0] - su[0] - sv[0], gw[1] - su[1] - sv[1], gw[2] - su[2] - sv[2], gw[3] - su[3] - sv[3]
    k11, k12, k13 = gw[4] - su[4] - sv[4], gw[5] - su[5] - sv[5], gw[6] - su[6] - sv[6]
    k22, k23, k33 = gw[7] - su[7] - sv[7], gw[8] - su[8] - sv[8], gw[9] - su[9] - sv[9]
    factor = factor3(k00, k01, k02, k11, k12, k22)
    a0, a1, a2 = solve3(factor, -k03, -k13, -k23)
    # (a, 1)' K(0) (a, 1) is the last pivot; over the norm of the 12-vector it is the Rayleigh quotient
    at_zero = (i0, i1, i2, i3)
    u = shifted_rows(gu, a0, a1, a2, at_zero)
    v = shifted_rows(gv, a0, a1, a2, at_zero)
    inverse_norm2 = one / full_norm2(scale2, a0, a1, a2, u, v)
    mu = fma(a0, k03, fma(a1, k13, fma(a2, k23, k33))) * inverse_norm2
    everyone = one > zero
    start = (a0, a1, a2, mu, everyone)
    a0, a1, a2, mu, active = refine(equations, inverse_norm2, factor, QUICK_STEPS, start)

    # K(mu) >= K(0) - mu (1 + s^2 / (d_min - lam) G_w), and the smallest eigenvalue of a positive definite 3x3 matrix is
    # at least 4 det / trace^2: where that already settles it, no second factorisation is needed
    smallest = min(min(d[0], d[1]), min(d[2], d[3]))
    size = absolute(mu)
    shift = scale2 * size
    trace = k00 + k11 + k22
    drop = size * fma(scale2, (gw[0] + gw[4]) + (gw[7] + gw[9]), splat(smallest) - shift)
    determinant_inverse = factor[3] * factor[4] * factor[5]
    settled = drop * trace * trace * determinant_inverse < splat(4.0) * (splat(smallest) - shift)
    proven = factor[6] & settled
    small = shift < splat(LARGEST_SHIFT * smallest)
    if any_lane((active | ~proven) & small):
        factor = factor_at(equations, mu)
        tau = mu
        last = (a0, a1, a2, mu, active)
        a0, a1, a2, mu, active = refine(equations, inverse_norm2, factor, MAX_STEPS, last)
        # tau was a Rayleigh quotient, so no eigenvalue but the smallest may lie below it
        proven = proven | (factor[6] & (mu - tau <= splat(1e-9) * trace))
        small = small & (scale2 * absolute(mu) < splat(LARGEST_SHIFT * smallest))

    s = resolvent(d, scale2 * mu)
    u0, u1, u2, u3 = shifted_rows(gu, a0, a1, a2, s)
    v0, v1, v2, v3 = shifted_rows(gv, a0, a1, a2, s)
    store(estimate, 0, a0)
    store(estimate, 8, a1)
    store(estimate, 16, a2)
    store(estimate, 24, u0)
    store(estimate, 32, u1)
    store(estimate, 40, u2)
    store(estimate, 48, u3)
    store(estimate, 56, v0)
    store(estimate, 64, v1)
    store(estimate, 72, v2)
    store(estimate, 80, v3)
    norm2 = fma(a0, a0, fma(a1, a1, a2 * a2))
    store(estimate, 88, one / norm2)
    store(estimate, 96, mean_u)
    store(estimate, 104, mean_v)
    return proven & small & ~active & (norm2 > zero)


@lane_jit
def carry_to_object_frame(tables, view, estimate):
    """The estimate of :func:`resect` in the frame of what its view sees, carried over to the object frame.

    With y' = A y + b of the frame of the view, a row (p, p3) becomes (A'p, p.b + p3), and (a, 1) is scaled to end in 1
    again.
    """
    f, one = tables.view_frames[view], splat(1.0)
    b0, b1, b2 = splat(f[9]), splat(f[10]), splat(f[11])
    a0, a1, a2 = load(estimate, 0), load(estimate, 8), load(estimate, 16)
    inverse = one / (dot3(a0, a1, a2, b0, b1, b2) + one)
    norm2 = splat(0.0)
    for k in range(3):
        a = inverse * dot3(a0, a1, a2, splat(f[k]), splat(f[3 + k]), splat(f[6 + k]))
        norm2 = fma(a, a, norm2)
        store(estimate, 8 * k, a)
    for row in range(24, 88, 32):
        p0, p1, p2 = load(estimate, row), load(estimate, row + 8), load(estimate, row + 16)
        for k in range(3):
            p = dot3(p0, p1, p2, splat(f[k]), splat(f[3 + k]), splat(f[6 + k]))
            store(estimate, row + 8 * k, inverse * p)
        store(estimate, row + 24, inverse * (dot3(p0, p1, p2, b0, b1, b2) + load(estimate, row + 24)))
    store(estimate, 88, one / norm2)


@lane_jit
def squared_reprojection(tables, view, images, estimate):
    """Sum over the fiducials that a view sees of the squared distance between image and reprojection, px^2."""
    one, total = splat(1.0), splat(0.0)
    a0, a1, a2 = load(estimate, 0), load(estimate, 8), load(estimate, 16)
    mean_u, mean_v = load(estimate, 96), load(estimate, 104)
    for i in range(tables.counts[FIDUCIALS]):
        x0, x1, x2 = splat(tables.nominal[i, 0]), splat(tables.nominal[i, 1]), splat(tables.nominal[i, 2])
        inverse = one / fma(a0, x0, fma(a1, x1, fma(a2, x2, one)))
        u = dot3(load(estimate, 24), load(estimate, 32), load(estimate, 40), x0, x1, x2) + load(estimate, 48)
        v = dot3(load(estimate, 56), load(estimate, 64), load(estimate, 72), x0, x1, x2) + load(estimate, 80)
        u = (load(images, 16 * i) - mean_u) - u * inverse
        v = (load(images, 16 * i + 8) - mean_v) - v * inverse
        seen = splat(tables.products[view, i, 9])
        total = fma(seen * u, u, fma(seen * v, v, total))
    return total
