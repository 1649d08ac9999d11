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
- ``d``: eight floats, D and 1 / D; ``scale2``: s^2; ``mu``: px^2; ``third``: the third row (a, 1); the others are
  ``(D - s^2 mu)^-1 G p3``;
- ``equations``: ((gu, gv, gw), d, scale2), all that K(mu) is made of;
- ``tables``, ``images``: as in ``kernel``.
"""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import (
    absolute,
    add_to_diagonal,
    any_lane,
    dot,
    factor3,
    fma,
    join,
    lane_jit,
    load,
    loads,
    multiply,
    negative,
    reciprocal_shifted,
    repeat,
    sandwich,
    select,
    size_of,
    solve3,
    splat,
    splats,
    store,
    subtract,
    symmetric_times,
    times_from_left,
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
def moments(products, images, n, coordinate):
    """``sum f y~ y~'`` of one image coordinate (0 or 8)."""
    g = repeat(splat(0.0), 10)
    for i in range(n):
        g = fma(load(images, 16 * i + coordinate), splats(products[i], g), g)
    return g


@lane_jit
def square_moments(products, images, n, mean_u, mean_v):
    """``sum w y~ y~'``, w the squared distance to the mean image."""
    g = repeat(splat(0.0), 10)
    for i in range(n):
        u, v = load(images, 16 * i) - mean_u, load(images, 16 * i + 8) - mean_v
        g = fma(fma(u, u, v * v), splats(products[i], g), g)
    return g


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
def refine(equations, inverse_norm2, factor, steps, iterate):
    """Fixed-factor steps on K(mu) (a, 1) = 0 with exact residuals, mu by the Rayleigh quotient.

    inverse_norm2: of the 12-vector of the first iterate, the quotient's denominator: its residual goes to zero all the
    same.  factor: of the leading block of K.  steps: at most so many.  iterate: (a, 1), mu, and the mask of active
    lanes; the last one is returned.  Lanes that are not active keep their values: a lane's digits do not depend on its
    neighbours.
    """
    (gu, gv, gw), d, scale2 = equations
    third, mu, active = iterate
    one = splat(1.0)
    for _ in range(steps):
        s = resolvent(d, scale2 * mu)
        u, v = multiply(symmetric_times(gu, third), s), multiply(symmetric_times(gv, third), s)
        less = subtract(symmetric_times(gw, third), symmetric_times(gu, u))
        r0, r1, r2, r3 = symmetric_times(gv, v)
        e = subtract(less, join(fma(mu, third[0:3], (r0, r1, r2)), r3 + mu))
        mu = select(active, fma(dot(third, e), inverse_norm2, mu), mu)
        step = solve3(factor, e[0:3])
        third = join(select(active, subtract(third[0:3], step), third[0:3]), one)
        active = active & ~(size_of(step) <= splat(STEP))
        if not any_lane(active):
            break
    return third, mu, active


@lane_jit
def factor_at(equations, tau):
    """Factor of the leading block of K(tau) by its own formula; its pivots prove or refute."""
    (gu, gv, gw), d, scale2 = equations
    s, ones = resolvent(d, scale2 * tau), repeat(splat(1.0), 4)
    return factor3(subtract(subtract(gw, sandwich(gu, s)), add_to_diagonal(sandwich(gv, s), tau, ones)))


@lane_jit
def resect(tables, view, images, estimate):
    """Third row (a, 1) and rows p1, p2 (px, about the mean image) of one view into ``estimate``.

    ``estimate`` gets a (3), p1 (4), p2 (4), 1/|a|^2, mean u, mean v: 14 vectors.  Returns the
    mask of lanes in which the result is proven and converged.
    """
    d = tables.diagonal[view]
    diagonal, inverse = splats(d, 4), splats(d[4:], 4)
    one, zero = splat(1.0), splat(0.0)
    products, n = tables.products[view], tables.counts[FIDUCIALS]
    gu, gv = moments(products, images, n, 0), moments(products, images, n, 8)
    mean_u, mean_v = gu[9] * inverse[3], gv[9] * inverse[3]
    # about the mean image
    gu, gv = add_to_diagonal(gu, -mean_u, diagonal), add_to_diagonal(gv, -mean_v, diagonal)
    gw = square_moments(products, images, n, mean_u, mean_v)
    scale2 = splat(2.0 * d[3]) / gw[9]
    equations = ((gu, gv, gw), d, scale2)

    k = subtract(subtract(gw, sandwich(gu, inverse)), sandwich(gv, inverse))
    factor = factor3(k)
    third = join(solve3(factor, negative((k[3], k[6], k[8]))), one)
    # (a, 1)' K(0) (a, 1) is the last pivot; over the norm of the 12-vector it is the Rayleigh quotient
    u, v = multiply(symmetric_times(gu, third), inverse), multiply(symmetric_times(gv, third), inverse)
    inverse_norm2 = one / fma(scale2, dot(u, u) + dot(v, v), dot(third, third))
    mu = dot(third, (k[3], k[6], k[8], k[9])) * inverse_norm2
    start = (third, mu, one > zero)
    third, mu, active = refine(equations, inverse_norm2, factor, QUICK_STEPS, start)

    # K(mu) >= K(0) - mu (1 + s^2 / (d_min - lam) G_w), and the smallest eigenvalue of a positive definite 3x3 matrix is
    # at least 4 det / trace^2: where that already settles it, no second factorisation is needed
    smallest = min(min(d[0], d[1]), min(d[2], d[3]))
    size = absolute(mu)
    shift = scale2 * size
    trace = k[0] + k[4] + k[7]
    drop = size * fma(scale2, (gw[0] + gw[4]) + (gw[7] + gw[9]), splat(smallest) - shift)
    determinant_inverse = factor[3] * factor[4] * factor[5]
    settled = drop * trace * trace * determinant_inverse < splat(4.0) * (splat(smallest) - shift)
    proven = factor[6] & settled
    small = shift < splat(LARGEST_SHIFT * smallest)
    if any_lane((active | ~proven) & small):
        factor = factor_at(equations, mu)
        tau = mu
        third, mu, active = refine(equations, inverse_norm2, factor, MAX_STEPS, (third, mu, active))
        # tau was a Rayleigh quotient, so no eigenvalue but the smallest may lie below it
        proven = proven | (factor[6] & (mu - tau <= splat(1e-9) * trace))
        small = small & (scale2 * absolute(mu) < splat(LARGEST_SHIFT * smallest))

    s = resolvent(d, scale2 * mu)
    u, v = multiply(symmetric_times(gu, third), s), multiply(symmetric_times(gv, third), s)
    a = third[0:3]
    norm2 = dot(a, a)
    store(estimate, 0, a + u + v + (one / norm2, mean_u, mean_v))
    return proven & small & ~active & (norm2 > zero)


@lane_jit
def carry_to_object_frame(tables, view, estimate):
    """The estimate of :func:`resect` in the frame of what its view sees, carried over to the object frame.

    With y' = A y + b of the frame of the view, a row (p, p3) becomes (A'p, p.b + p3), and (a, 1) is scaled to end in 1
    again.
    """
    linear, shift = splats(tables.view_frames[view], 9), splats(tables.view_frames[view, 9:], 3)
    third, one = loads(estimate, 0, 3), splat(1.0)
    inverse = one / (dot(third, shift) + one)
    a = multiply(inverse, times_from_left(third, linear))
    store(estimate, 0, a)
    for row in range(24, 88, 32):
        p = loads(estimate, row, 3)
        carried = join(times_from_left(p, linear), dot(p, shift) + load(estimate, row + 24))
        store(estimate, row, multiply(inverse, carried))
    store(estimate, 88, one / dot((a[2], a[1], a[0]), (a[2], a[1], a[0])))


@lane_jit
def squared_reprojection(tables, view, images, estimate):
    """Sum over the fiducials that a view sees of the squared distance between image and reprojection, px^2."""
    one, total = splat(1.0), splat(0.0)
    third, mean = join(loads(estimate, 0, 3), one), loads(estimate, 96, 2)
    for i in range(tables.counts[FIDUCIALS]):
        x = splats(tables.nominal[i], 3)
        inverse = one / dot(third, join(x, one))
        u = dot(loads(estimate, 24, 3), x) + load(estimate, 48)
        v = dot(loads(estimate, 56, 3), x) + load(estimate, 80)
        u, v = subtract(subtract(loads(images, 16 * i, 2), mean), multiply(inverse, (u, v)))
        seen = splat(tables.products[view, i, 9])
        total = fma(seen * u, u, fma(seen * v, v, total))
    return total
