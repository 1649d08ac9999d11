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

**Coordinates that an affine map has moved** (Eq 18 with small angles: the estimator assumes ``R X``, R = I + [w]x, and
normalises that).  In Hartley's frame of what it assumes, ``y' = L y``, a row p of the projection is ``L^-T p``, so the
unit norm of p becomes ``p'Q p``, ``Q = diag((L'L)^-1, 1)``, and I turns into Q in both places of K:

    K(mu) = G_w - mu Q - G_u (D - s^2 mu Q)^-1 G_u - G_v (D - s^2 mu Q)^-1 G_v.

With ``R'R = (1 + w'w) I - w w'`` the block of Q is ``gamma (I + w w')`` (w in the object frame): D - s^2 mu Q is
diagonal less one dyad, and its inverse exact (Sherman and Morrison).

Arguments below, lanes unless said:

- ``metric``: None, or (gamma, w0, w1, w2);
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
def in_metric(metric, a0, a1, a2):
    """Block of Q times a vector."""
    if metric is None:
        return a0, a1, a2
    gamma, w0, w1, w2 = metric
    along = gamma * dot3(w0, w1, w2, a0, a1, a2)
    return fma(gamma, a0, w0 * along), fma(gamma, a1, w1 * along), fma(gamma, a2, w2 * along)


@lane_jit
def resolvent(metric, d, shift):
    """``(D - shift Q)^-1``: its diagonal (4), and the vector (3) and factor of the dyad beside it (0: none)."""
    if metric is None:
        zero = splat(0.0)
        s0, s1 = reciprocal_shifted(d[0], splat(d[4]), shift), reciprocal_shifted(d[1], splat(d[5]), shift)
        s2, s3 = reciprocal_shifted(d[2], splat(d[6]), shift), reciprocal_shifted(d[3], splat(d[7]), shift)
        return s0, s1, s2, s3, zero, zero, zero, zero
    gamma, w0, w1, w2 = metric
    inner = gamma * shift
    s0 = reciprocal_shifted(d[0], splat(d[4]), inner)
    s1 = reciprocal_shifted(d[1], splat(d[5]), inner)
    s2 = reciprocal_shifted(d[2], splat(d[6]), inner)
    s3 = reciprocal_shifted(d[3], splat(d[7]), shift)
    q0, q1, q2 = s0 * w0, s1 * w1, s2 * w2
    return s0, s1, s2, s3, q0, q1, q2, inner / fma(-inner, dot3(w0, w1, w2, q0, q1, q2), splat(1.0))


@lane_jit
def apply_resolvent(metric, s, x0, x1, x2, x3):
    """:func:`resolvent` times a vector."""
    s0, s1, s2, s3, q0, q1, q2, beta = s
    if metric is None:
        return x0 * s0, x1 * s1, x2 * s2, x3 * s3
    along = beta * dot3(q0, q1, q2, x0, x1, x2)
    return fma(along, q0, x0 * s0), fma(along, q1, x1 * s1), fma(along, q2, x2 * s2), x3 * s3


@lane_jit
def shifted_rows(metric, g, a0, a1, a2, s):
    """First (or second) row that belongs to a third row (a, 1): ``(D - s^2 mu Q)^-1 G p3``."""
    x0, x1, x2, x3 = symmetric_times(g, a0, a1, a2, splat(1.0))
    return apply_resolvent(metric, s, x0, x1, x2, x3)


@lane_jit
def squared_in_metric(metric, x0, x1, x2, x3):
    """``x'Q x`` of a row."""
    if metric is None:
        return fma(x0, x0, fma(x1, x1, fma(x2, x2, x3 * x3)))
    q0, q1, q2 = in_metric(metric, x0, x1, x2)
    return fma(x0, q0, fma(x1, q1, fma(x2, q2, x3 * x3)))


@lane_jit
def full_norm2(metric, scale2, a0, a1, a2, u, v):
    """Squared norm of the 12-vector (p1, p2, p3) in Hartley's coordinates."""
    u0, u1, u2, u3 = u
    v0, v1, v2, v3 = v
    first_two = squared_in_metric(metric, u0, u1, u2, u3) + squared_in_metric(metric, v0, v1, v2, v3)
    q0, q1, q2 = in_metric(metric, a0, a1, a2)
    return fma(scale2, first_two, fma(a0, q0, fma(a1, q1, fma(a2, q2, splat(1.0)))))


@lane_jit
def refine(metric, equations, inverse_norm2, factor, steps, iterate):
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
        s = resolvent(metric, d, scale2 * mu)
        u = shifted_rows(metric, gu, a0, a1, a2, s)
        v = shifted_rows(metric, gv, a0, a1, a2, s)
        w0, w1, w2, w3 = symmetric_times(gw, a0, a1, a2, one)
        q0, q1, q2, q3 = symmetric_times(gu, u[0], u[1], u[2], u[3])
        r0, r1, r2, r3 = symmetric_times(gv, v[0], v[1], v[2], v[3])
        b0, b1, b2 = in_metric(metric, a0, a1, a2)
        e0, e1, e2 = (w0 - q0) - fma(mu, b0, r0), (w1 - q1) - fma(mu, b1, r1), (w2 - q2) - fma(mu, b2, r2)
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
def factor_at(metric, equations, tau):
    """Factor of the leading block of K(tau) by its own formula; its pivots prove or refute."""
    moment, d, scale2 = equations
    gu, gv, gw = moment
    s = resolvent(metric, d, scale2 * tau)
    su, sv = sandwich(gu, s[0], s[1], s[2], s[3]), sandwich(gv, s[0], s[1], s[2], s[3])
    if metric is None:
        return factor3(
            (gw[0] - su[0]) - (sv[0] + tau),
            (gw[1] - su[1]) - sv[1],
            (gw[2] - su[2]) - sv[2],
            (gw[4] - su[4]) - (sv[4] + tau),
            (gw[5] - su[5]) - sv[5],
            (gw[7] - su[7]) - (sv[7] + tau),
        )
    gamma, w0, w1, w2 = metric
    t, beta = tau * gamma, s[7]
    u0, u1, u2, _ = symmetric_times(gu, s[4], s[5], s[6], splat(0.0))
    v0, v1, v2, _ = symmetric_times(gv, s[4], s[5], s[6], splat(0.0))
    return factor3(
        (gw[0] - su[0]) - (sv[0] + fma(t, fma(w0, w0, splat(1.0)), beta * fma(u0, u0, v0 * v0))),
        (gw[1] - su[1]) - (sv[1] + fma(t, w0 * w1, beta * fma(u0, u1, v0 * v1))),
        (gw[2] - su[2]) - (sv[2] + fma(t, w0 * w2, beta * fma(u0, u2, v0 * v2))),
        (gw[4] - su[4]) - (sv[4] + fma(t, fma(w1, w1, splat(1.0)), beta * fma(u1, u1, v1 * v1))),
        (gw[5] - su[5]) - (sv[5] + fma(t, w1 * w2, beta * fma(u1, u2, v1 * v2))),
        (gw[7] - su[7]) - (sv[7] + fma(t, fma(w2, w2, splat(1.0)), beta * fma(u2, u2, v2 * v2))),
    )


@lane_jit
def size_of(metric, mu):
    """``|mu|`` times the largest eigenvalue of Q."""
    if metric is None:
        return absolute(mu)
    gamma, w0, w1, w2 = metric
    largest = fma(gamma, dot3(w0, w1, w2, w0, w1, w2), gamma)
    return absolute(mu) * select(largest > splat(1.0), largest, splat(1.0))


@lane_jit
def resect(tables, view, metric, images, estimate):
    """Third row (a, 1) and rows p1, p2 (px, about the mean image) of one view into ``estimate``.

    ``estimate`` gets a (3), p1 (4), p2 (4), 1/|a|^2 (1/a'Q a with a metric), mean u, mean v: 14 vectors.  Returns the
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
    at_zero = (i0, i1, i2, i3, zero, zero, zero, zero)
    u = shifted_rows(None, gu, a0, a1, a2, at_zero)
    v = shifted_rows(None, gv, a0, a1, a2, at_zero)
    inverse_norm2 = one / full_norm2(metric, scale2, a0, a1, a2, u, v)
    mu = fma(a0, k03, fma(a1, k13, fma(a2, k23, k33))) * inverse_norm2
    everyone = one > zero
    start = (a0, a1, a2, mu, everyone)
    a0, a1, a2, mu, active = refine(metric, equations, inverse_norm2, factor, QUICK_STEPS, start)

    # K(mu) >= K(0) - mu (1 + s^2 / (d_min - lam) G_w), times the largest eigenvalue of Q where there is a metric, and
    # the smallest eigenvalue of a positive definite 3x3 matrix is at least 4 det / trace^2: where that already settles
    # it, no second factorisation is needed
    smallest = min(min(d[0], d[1]), min(d[2], d[3]))
    size = size_of(metric, mu)
    shift = scale2 * size
    trace = k00 + k11 + k22
    drop = size * fma(scale2, (gw[0] + gw[4]) + (gw[7] + gw[9]), splat(smallest) - shift)
    determinant_inverse = factor[3] * factor[4] * factor[5]
    settled = drop * trace * trace * determinant_inverse < splat(4.0) * (splat(smallest) - shift)
    proven = factor[6] & settled
    small = shift < splat(LARGEST_SHIFT * smallest)
    if any_lane((active | ~proven) & small):
        factor = factor_at(metric, equations, mu)
        tau = mu
        last = (a0, a1, a2, mu, active)
        a0, a1, a2, mu, active = refine(metric, equations, inverse_norm2, factor, MAX_STEPS, last)
        # tau was a Rayleigh quotient, so no eigenvalue but the smallest may lie below it
        proven = proven | (factor[6] & (mu - tau <= splat(1e-9) * trace))
        small = small & (scale2 * size_of(metric, mu) < splat(LARGEST_SHIFT * smallest))

    s = resolvent(metric, d, scale2 * mu)
    u0, u1, u2, u3 = shifted_rows(metric, gu, a0, a1, a2, s)
    v0, v1, v2, v3 = shifted_rows(metric, gv, a0, a1, a2, s)
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
    b0, b1, b2 = in_metric(metric, a0, a1, a2)
    norm2 = fma(a0, b0, fma(a1, b1, a2 * b2))
    store(estimate, 88, one / norm2)
    store(estimate, 96, mean_u)
    store(estimate, 104, mean_v)
    return proven & small & ~active & (norm2 > zero)


@lane_jit
def carry_to_object_frame(tables, view, estimate):
    """The estimate of :func:`resect` in the frame of what its view sees, carried over to the object frame.

    With y' = A y + b of the frame of the view, a row (p, p3) becomes (A'p, p.b + p3), and (a, 1) is scaled to end in 1
    again.  Only without a metric.
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
