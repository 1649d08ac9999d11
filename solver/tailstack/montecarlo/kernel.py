"""The full nonlinear chain, eight trials at a time, without a 2N x 12 singular value decomposition.

**Resection.**  With fiducials ``y~ = (y, 1)`` in the object frame, ``D = sum y~ y~'`` diagonal, and images
(u, v) counted from their own mean, DLT minimises ``sum |p1.y~ - s u p3.y~|^2 + |p2.y~ - s v p3.y~|^2`` over
unit (p1, p2, p3), s the image scale of Hartley.  Stationarity for the smallest eigenvalue ``lam = s^2 mu``
eliminates ``p1 = s (D - lam)^-1 G_u p3`` (p2 likewise) and leaves (Eqs 2-3, reduced exactly)

    K(mu) p3 = [ G_w - mu I - G_u (D - s^2 mu)^-1 G_u - G_v (D - s^2 mu)^-1 G_v ] p3 = 0,

``G_f = sum f y~ y~'`` for f = u, v, w = u^2 + v^2.  ``p3 = (a, 1)`` without loss: its last entry is the mean
depth.  The top three rows give ``a``, the Rayleigh quotient of the whole 12-vector gives mu; starting from
mu = 0 the pair converges quadratically, and after one refactoring a fixed factor does.

**Proof that it is the smallest.**  The inertia of ``M'M - lam`` is that of ``D - lam`` (twice) plus that of K.
If ``D > lam`` and the leading 3x3 block of K(tau) is positive definite (pivots of its factorisation), at
most one eigenvalue lies below tau (interlacing).  tau is a Rayleigh quotient, hence not below the
smallest; the eigenvalue found must not exceed it.

**Triangulation.**  Rows ``(u_t p3 - p1) / |a|`` (Eq 5), normal matrix ``[[M, b], [b', c]]``; (M - lam) y = -b with
lam the Rayleigh quotient of (y, 1), fixed factor of M.  ``lam < 4 det M / tr(M)^2 <= lambda_min(M)`` proves
the smallest.

A lane that fails a proof, does not converge or is not finite is flagged; the caller redoes it by SVD.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator, misc"
from __future__ import annotations

from numba import njit

from .elementary import sine_cosine
from .lanes import absolute, any_lane, fma, load, select, splat, square_root, store
from .streams import fill_deviates

# Steps stop when the last one is below this (relative to 1, the scale of the unknowns): the next one is
# smaller by the rate of convergence, which the limit on the number of steps keeps below 0.02.
STEP = 1e-10
MAX_STEPS = 6
# Largest lam / D for which three Newton steps of the reciprocal are exact to rounding.
LARGEST_SHIFT = 0.01
RESULTS = 6  # per target: tcp (3), localisation (3)


@njit
def scratch_size(counts):
    """Doubles of scratch: deviates, points, images of one view, a and p1, p2 per view, rotations, results."""
    n, v, t, d = counts[0], counts[1], counts[2], counts[6]
    return 8 * (d + 3 * n + 2 * n + 12 * v + 2 * v + 36 + RESULTS * t + 8)


@njit
def dot3(ax, ay, az, bx, by, bz):
    return fma(ax, bx, fma(ay, by, az * bz))


@njit
def mount_torsor(tables, mount, z):
    """The six components of one mount's torsor."""
    gains = tables.gains
    offset, k = tables.gain_starts[mount, 0], tables.gain_starts[mount, 1]
    start = 8 * tables.starts[1 + mount]
    t0, t1, t2 = splat(tables.torsors[mount, 0]), splat(tables.torsors[mount, 1]), splat(tables.torsors[mount, 2])
    t3, t4, t5 = splat(tables.torsors[mount, 3]), splat(tables.torsors[mount, 4]), splat(tables.torsors[mount, 5])
    for j in range(k):
        xi = load(z, start + 8 * j)
        at = offset + j
        t0 = fma(splat(gains[at]), xi, t0)
        t1 = fma(splat(gains[at + k]), xi, t1)
        t2 = fma(splat(gains[at + 2 * k]), xi, t2)
        t3 = fma(splat(gains[at + 3 * k]), xi, t3)
        t4 = fma(splat(gains[at + 4 * k]), xi, t4)
        t5 = fma(splat(gains[at + 5 * k]), xi, t5)
    return t0, t1, t2, t3, t4, t5


@njit
def write_mount(tables, mount, z, pose, at):
    """Rotation (9, Rx Ry Rz or I + [w]x: Eqs 12, 13) and translation (3) of a mount into ``pose``."""
    rx, ry, rz, tx, ty, tz = mount_torsor(tables, mount, z)
    one = splat(1.0)
    if tables.counts[5] != 0:
        store(pose, at, one)
        store(pose, at + 8, -rz)
        store(pose, at + 16, ry)
        store(pose, at + 24, rz)
        store(pose, at + 32, one)
        store(pose, at + 40, -rx)
        store(pose, at + 48, -ry)
        store(pose, at + 56, rx)
        store(pose, at + 64, one)
    else:
        sa, ca = sine_cosine(rx)
        sb, cb = sine_cosine(ry)
        sc, cc = sine_cosine(rz)
        sasb, casb = sa * sb, ca * sb
        store(pose, at, cb * cc)
        store(pose, at + 8, -(cb * sc))
        store(pose, at + 16, sb)
        store(pose, at + 24, fma(sasb, cc, ca * sc))
        store(pose, at + 32, fma(-sasb, sc, ca * cc))
        store(pose, at + 40, -(sa * cb))
        store(pose, at + 48, fma(-casb, cc, sa * sc))
        store(pose, at + 56, fma(casb, sc, sa * cc))
        store(pose, at + 64, ca * cb)
    store(pose, at + 72, tx)
    store(pose, at + 80, ty)
    store(pose, at + 88, tz)


@njit
def rotate(pose, at, x, y, z):
    return (
        dot3(load(pose, at), load(pose, at + 8), load(pose, at + 16), x, y, z),
        dot3(load(pose, at + 24), load(pose, at + 32), load(pose, at + 40), x, y, z),
        dot3(load(pose, at + 48), load(pose, at + 56), load(pose, at + 64), x, y, z),
    )


@njit
def move_error(tables, mount, pose, at, nominal, e0, e1, e2):
    """Error of ``nominal + e`` after the mount: ``R e + (R - 1)(nominal - p) + t``; no large numbers cancel."""
    x = splat(nominal[0] - tables.pivots[mount, 0])
    y = splat(nominal[1] - tables.pivots[mount, 1])
    z = splat(nominal[2] - tables.pivots[mount, 2])
    r0, r1, r2 = rotate(pose, at, x, y, z)
    f0, f1, f2 = rotate(pose, at, e0, e1, e2)
    return (
        f0 + ((r0 - x) + load(pose, at + 72)),
        f1 + ((r1 - y) + load(pose, at + 80)),
        f2 + ((r2 - z) + load(pose, at + 88)),
    )


@njit
def place_points(tables, z, points):
    """Fiducials with their manufacturing errors, object frame."""
    n = tables.counts[0]
    into, spread, start = tables.into_frame, tables.spread, 8 * tables.starts[0]
    for i in range(n):
        m0 = splat(spread[i, 0]) * load(z, start + 24 * i)
        m1 = splat(spread[i, 1]) * load(z, start + 24 * i + 8)
        m2 = splat(spread[i, 2]) * load(z, start + 24 * i + 16)
        for c in range(3):
            moved = dot3(splat(into[3 * c]), splat(into[3 * c + 1]), splat(into[3 * c + 2]), m0, m1, m2)
            store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]) + moved)


@njit
def camera_row(tables, view, row, pose):
    """Row of the projection of the object frame when the structure is moved by interface 1.

    ``X -> R (X - p) + p + t`` with ``X = E y + c`` gives ``A R E y + A (R (c - p) + p + t) + b``.
    """
    k = 4 * row
    a0, a1, a2 = splat(tables.cameras[view, k]), splat(tables.cameras[view, k + 1]), splat(tables.cameras[view, k + 2])
    g0 = dot3(a0, a1, a2, load(pose, 0), load(pose, 24), load(pose, 48))
    g1 = dot3(a0, a1, a2, load(pose, 8), load(pose, 32), load(pose, 56))
    g2 = dot3(a0, a1, a2, load(pose, 16), load(pose, 40), load(pose, 64))
    e = tables.out_of_frame
    x0 = splat(tables.centre[0] - tables.pivots[0, 0])
    x1 = splat(tables.centre[1] - tables.pivots[0, 1])
    x2 = splat(tables.centre[2] - tables.pivots[0, 2])
    s0 = load(pose, 72) + splat(tables.pivots[0, 0])
    s1 = load(pose, 80) + splat(tables.pivots[0, 1])
    s2 = load(pose, 88) + splat(tables.pivots[0, 2])
    return (
        dot3(g0, g1, g2, splat(e[0]), splat(e[3]), splat(e[6])),
        dot3(g0, g1, g2, splat(e[1]), splat(e[4]), splat(e[7])),
        dot3(g0, g1, g2, splat(e[2]), splat(e[5]), splat(e[8])),
        dot3(g0, g1, g2, x0, x1, x2) + (dot3(a0, a1, a2, s0, s1, s2) + splat(tables.cameras[view, k + 3])),
    )


@njit
def fixed_row(tables, view, row):
    k = 4 * row
    m = tables.fixed_images
    return splat(m[view, k]), splat(m[view, k + 1]), splat(m[view, k + 2]), splat(m[view, k + 3])


@njit
def symmetric_times(g, x0, x1, x2, x3):
    """Product of a symmetric 4x4 (10 entries, upper triangle by rows) and a 4-vector."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    return (
        fma(g00, x0, fma(g01, x1, fma(g02, x2, g03 * x3))),
        fma(g01, x0, fma(g11, x1, fma(g12, x2, g13 * x3))),
        fma(g02, x0, fma(g12, x1, fma(g22, x2, g23 * x3))),
        fma(g03, x0, fma(g13, x1, fma(g23, x2, g33 * x3))),
    )


@njit
def factor3(k00, k01, k02, k11, k12, k22):
    """LDL' of a symmetric 3x3: (l10, l20, l21, 1/d0, 1/d1, 1/d2, smallest pivot's sign mask)."""
    one, zero = splat(1.0), splat(0.0)
    i0 = one / k00
    l10, l20 = k01 * i0, k02 * i0
    d1 = fma(-l10, k01, k11)
    i1 = one / d1
    c = fma(-l20, k01, k12)
    l21 = c * i1
    d2 = fma(-l21, c, fma(-l20, k02, k22))
    i2 = one / d2
    return l10, l20, l21, i0, i1, i2, (k00 > zero) & (d1 > zero) & (d2 > zero)


@njit
def solve3(f, b0, b1, b2):
    l10, l20, l21, i0, i1, i2, _ = f
    y1 = fma(-l10, b0, b1)
    y2 = fma(-l21, y1, fma(-l20, b0, b2))
    x2 = y2 * i2
    x1 = fma(-l21, x2, y1 * i1)
    x0 = fma(-l10, x1, fma(-l20, x2, b0 * i0))
    return x0, x1, x2


@njit
def reciprocal_shifted(d, inverse, shift):
    """1 / (d - shift) by Newton's iteration from 1/d; relative error (shift/d)^8."""
    x = fma(inverse, shift * inverse, inverse)
    gap = splat(d) - shift
    two = splat(1.0)
    x = fma(x, fma(-gap, x, two), x)
    return fma(x, fma(-gap, x, two), x)


@njit
def centred(g, shift, d):
    """Moments about the mean image: subtract ``shift`` D from a moment matrix."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    return (
        fma(-shift, splat(d[0]), g00), g01, g02, g03,
        fma(-shift, splat(d[1]), g11), g12, g13,
        fma(-shift, splat(d[2]), g22), g23,
        fma(-shift, splat(d[3]), g33),
    )  # fmt: skip


@njit
def sandwich(g, d0, d1, d2, d3):
    """Upper triangle of G diag(d) G for a symmetric G."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    a00, a01, a02, a03 = g00 * d0, g01 * d1, g02 * d2, g03 * d3
    a10, a11, a12, a13 = g01 * d0, g11 * d1, g12 * d2, g13 * d3
    a20, a21, a22, a23 = g02 * d0, g12 * d1, g22 * d2, g23 * d3
    a30, a31, a32, a33 = g03 * d0, g13 * d1, g23 * d2, g33 * d3
    return (
        fma(a00, g00, fma(a01, g01, fma(a02, g02, a03 * g03))),
        fma(a00, g01, fma(a01, g11, fma(a02, g12, a03 * g13))),
        fma(a00, g02, fma(a01, g12, fma(a02, g22, a03 * g23))),
        fma(a00, g03, fma(a01, g13, fma(a02, g23, a03 * g33))),
        fma(a10, g01, fma(a11, g11, fma(a12, g12, a13 * g13))),
        fma(a10, g02, fma(a11, g12, fma(a12, g22, a13 * g23))),
        fma(a10, g03, fma(a11, g13, fma(a12, g23, a13 * g33))),
        fma(a20, g02, fma(a21, g12, fma(a22, g22, a23 * g23))),
        fma(a20, g03, fma(a21, g13, fma(a22, g23, a23 * g33))),
        fma(a30, g03, fma(a31, g13, fma(a32, g23, a33 * g33))),
    )


@njit
def image_fiducials(tables, view, points, pose, images, z):
    """Noisy images of all fiducials into ``images``; returns the moments G_u and G_v about the nominal mean."""
    n = tables.counts[0]
    if (tables.counts[7] & 1) != 0 and tables.counts[4] == 0:
        m00, m01, m02, m03 = camera_row(tables, view, 0, pose)
        m10, m11, m12, m13 = camera_row(tables, view, 1, pose)
        m20, m21, m22, m23 = camera_row(tables, view, 2, pose)
    else:
        m00, m01, m02, m03 = fixed_row(tables, view, 0)
        m10, m11, m12, m13 = fixed_row(tables, view, 1)
        m20, m21, m22, m23 = fixed_row(tables, view, 2)
    noise = splat(tables.noise[view, 0])
    start = 16 * view * (n + tables.counts[2])
    zero, one = splat(0.0), splat(1.0)
    for i in range(n):
        x0, x1, x2 = load(points, 24 * i), load(points, 24 * i + 8), load(points, 24 * i + 16)
        inverse = one / fma(m20, x0, fma(m21, x1, fma(m22, x2, m23)))
        u = fma(m00, x0, fma(m01, x1, fma(m02, x2, m03))) * inverse
        v = fma(m10, x0, fma(m11, x1, fma(m12, x2, m13))) * inverse
        store(images, 16 * i, fma(noise, load(z, start + 16 * i), u))
        store(images, 16 * i + 8, fma(noise, load(z, start + 16 * i + 8), v))
    return moments(tables.products, images, n, 0), moments(tables.products, images, n, 8)


@njit
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
        g9 = g9 + f
    return g0, g1, g2, g3, g4, g5, g6, g7, g8, g9


@njit
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
        g9 = g9 + w
    return g0, g1, g2, g3, g4, g5, g6, g7, g8, g9


@njit
def resect(tables, view, images, gu, gv, estimate):
    """Third row (a, 1) and rows p1, p2 (px, about the mean image) of one view into ``estimate``.

    ``estimate`` gets a (3), p1 (4), p2 (4), 1/|a|^2, mean u, mean v: 14 vectors.  Returns the mask of lanes
    in which the result is proven and converged.
    """
    n = tables.counts[0]
    d = tables.diagonal
    one, zero = splat(1.0), splat(0.0)
    i0, i1, i2, i3 = splat(d[4]), splat(d[5]), splat(d[6]), splat(d[7])
    mean_u, mean_v = gu[9] * i3, gv[9] * i3
    gu, gv = centred(gu, mean_u, d), centred(gv, mean_v, d)
    gw = square_moments(tables.products, images, n, mean_u, mean_v)
    scale2 = splat(2.0) * splat(d[3]) / gw[9]

    su, sv = sandwich(gu, i0, i1, i2, i3), sandwich(gv, i0, i1, i2, i3)
    k00, k01, k02, k03 = gw[0] - su[0] - sv[0], gw[1] - su[1] - sv[1], gw[2] - su[2] - sv[2], gw[3] - su[3] - sv[3]
    k11, k12, k13 = gw[4] - su[4] - sv[4], gw[5] - su[5] - sv[5], gw[6] - su[6] - sv[6]
    k22, k23 = gw[7] - su[7] - sv[7], gw[8] - su[8] - sv[8]
    f = factor3(k00, k01, k02, k11, k12, k22)
    a0, a1, a2 = solve3(f, -k03, -k13, -k23)

    # Rayleigh quotient at mu = 0, then one refactoring with K(mu) = K - mu C, C = 1 + s^2 (G_u D^-2 G_u + G_v D^-2 G_v)
    u0, u1, u2, u3 = symmetric_times(gu, a0, a1, a2, one)
    v0, v1, v2, v3 = symmetric_times(gv, a0, a1, a2, one)
    w0, w1, w2, w3 = symmetric_times(gw, a0, a1, a2, one)
    u0, u1, u2, u3 = u0 * i0, u1 * i1, u2 * i2, u3 * i3
    v0, v1, v2, v3 = v0 * i0, v1 * i1, v2 * i2, v3 * i3
    q0, q1, q2, q3 = symmetric_times(gu, u0, u1, u2, u3)
    r0, r1, r2, r3 = symmetric_times(gv, v0, v1, v2, v3)
    value = fma(a0, w0 - q0 - r0, fma(a1, w1 - q1 - r1, fma(a2, w2 - q2 - r2, w3 - q3 - r3)))
    first_two = fma(u0, u0, fma(u1, u1, fma(u2, u2, u3 * u3))) + fma(v0, v0, fma(v1, v1, fma(v2, v2, v3 * v3)))
    tau = value / fma(scale2, first_two, fma(a0, a0, fma(a1, a1, fma(a2, a2, one))))
    cu, cv = sandwich(gu, i0 * i0, i1 * i1, i2 * i2, i3 * i3), sandwich(gv, i0 * i0, i1 * i1, i2 * i2, i3 * i3)
    ts = tau * scale2
    k00, k11, k22 = (
        fma(-ts, cu[0] + cv[0], k00) - tau,
        fma(-ts, cu[4] + cv[4], k11) - tau,
        fma(-ts, cu[7] + cv[7], k22) - tau,
    )
    k01, k02, k12 = fma(-ts, cu[1] + cv[1], k01), fma(-ts, cu[2] + cv[2], k02), fma(-ts, cu[5] + cv[5], k12)
    c03, c13, c23 = scale2 * (cu[3] + cv[3]), scale2 * (cu[6] + cv[6]), scale2 * (cu[8] + cv[8])
    k03, k13, k23 = fma(-tau, c03, k03), fma(-tau, c13, k13), fma(-tau, c23, k23)
    f = factor3(k00, k01, k02, k11, k12, k22)
    a0, a1, a2 = solve3(f, -k03, -k13, -k23)
    c00 = fma(scale2, cu[0] + cv[0], one)
    c01, c02 = scale2 * (cu[1] + cv[1]), scale2 * (cu[2] + cv[2])
    c11, c12 = fma(scale2, cu[4] + cv[4], one), scale2 * (cu[5] + cv[5])
    c22 = fma(scale2, cu[7] + cv[7], one)

    mu = tau
    active = one > zero
    for _ in range(MAX_STEPS):
        shift = scale2 * mu
        s0, s1 = reciprocal_shifted(d[0], i0, shift), reciprocal_shifted(d[1], i1, shift)
        s2, s3 = reciprocal_shifted(d[2], i2, shift), reciprocal_shifted(d[3], i3, shift)
        u0, u1, u2, u3 = symmetric_times(gu, a0, a1, a2, one)
        v0, v1, v2, v3 = symmetric_times(gv, a0, a1, a2, one)
        w0, w1, w2, w3 = symmetric_times(gw, a0, a1, a2, one)
        u0, u1, u2, u3 = u0 * s0, u1 * s1, u2 * s2, u3 * s3
        v0, v1, v2, v3 = v0 * s0, v1 * s1, v2 * s2, v3 * s3
        q0, q1, q2, q3 = symmetric_times(gu, u0, u1, u2, u3)
        r0, r1, r2, r3 = symmetric_times(gv, v0, v1, v2, v3)
        e0, e1, e2 = (w0 - q0) - fma(mu, a0, r0), (w1 - q1) - fma(mu, a1, r1), (w2 - q2) - fma(mu, a2, r2)
        e3 = (w3 - q3) - (r3 + mu)
        first_two = fma(u0, u0, fma(u1, u1, fma(u2, u2, u3 * u3))) + fma(v0, v0, fma(v1, v1, fma(v2, v2, v3 * v3)))
        norm2 = fma(scale2, first_two, fma(a0, a0, fma(a1, a1, fma(a2, a2, one))))
        dmu = fma(a0, e0, fma(a1, e1, fma(a2, e2, e3))) / norm2
        # the residual at mu + dmu, to first order in dmu: the next pass measures it exactly
        e0 = fma(-dmu, fma(c00, a0, fma(c01, a1, fma(c02, a2, c03))), e0)
        e1 = fma(-dmu, fma(c01, a0, fma(c11, a1, fma(c12, a2, c13))), e1)
        e2 = fma(-dmu, fma(c02, a0, fma(c12, a1, fma(c22, a2, c23))), e2)
        x0, x1, x2 = solve3(f, e0, e1, e2)
        a0, a1, a2 = select(active, a0 - x0, a0), select(active, a1 - x1, a1), select(active, a2 - x2, a2)
        mu = select(active, mu + dmu, mu)
        step = absolute(x0) + absolute(x1) + absolute(x2)
        active = active & ~(step <= splat(STEP))
        if not any_lane(active):
            break

    shift = scale2 * mu
    u0, u1, u2, u3 = symmetric_times(gu, a0, a1, a2, one)
    v0, v1, v2, v3 = symmetric_times(gv, a0, a1, a2, one)
    s0, s1 = reciprocal_shifted(d[0], i0, shift), reciprocal_shifted(d[1], i1, shift)
    s2, s3 = reciprocal_shifted(d[2], i2, shift), reciprocal_shifted(d[3], i3, shift)
    store(estimate, 0, a0)
    store(estimate, 8, a1)
    store(estimate, 16, a2)
    store(estimate, 24, u0 * s0)
    store(estimate, 32, u1 * s1)
    store(estimate, 40, u2 * s2)
    store(estimate, 48, u3 * s3)
    store(estimate, 56, v0 * s0)
    store(estimate, 64, v1 * s1)
    store(estimate, 72, v2 * s2)
    store(estimate, 80, v3 * s3)
    norm2 = fma(a0, a0, fma(a1, a1, a2 * a2))
    store(estimate, 88, one / norm2)
    store(estimate, 96, mean_u)
    store(estimate, 104, mean_v)

    # K's leading block was positive definite at tau; the eigenvalue must not lie above tau by more than rounding.
    smallest_d = d[0] if d[0] < d[1] else d[1]
    smallest_d = smallest_d if smallest_d < d[2] else d[2]
    small = absolute(ts) + absolute(shift) < splat(LARGEST_SHIFT * smallest_d)
    below = mu - tau < splat(1e-9) * (k00 + k11 + k22)
    return f[6] & small & below & ~active & (norm2 > zero)


@njit
def triangulate(tables, target, estimates, z):
    """Target in the object frame from all views: (y0, y1, y2, mask of proven lanes)."""
    n, views = tables.counts[0], tables.counts[1]
    one, zero = splat(1.0), splat(0.0)
    m00, m01, m02, m11, m12, m22, b0, b1, b2, c = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for view in range(views):
        at = 112 * view
        start = 16 * view * (n + tables.counts[2]) + 16 * (n + target)
        sigma = splat(tables.noise[view, 1])
        a0, a1, a2 = load(estimates, at), load(estimates, at + 8), load(estimates, at + 16)
        weight = load(estimates, at + 88)
        for row in range(2):
            image = fma(sigma, load(z, start + 8 * row), splat(tables.target_images[target, view, row]))
            t = image - load(estimates, at + 96 + 8 * row)
            p = at + 24 + 32 * row
            r0, r1 = fma(t, a0, -load(estimates, p)), fma(t, a1, -load(estimates, p + 8))
            r2, r3 = fma(t, a2, -load(estimates, p + 16)), t - load(estimates, p + 24)
            h0, h1, h2, h3 = weight * r0, weight * r1, weight * r2, weight * r3
            m00, m01, m02, b0 = fma(h0, r0, m00), fma(h0, r1, m01), fma(h0, r2, m02), fma(h0, r3, b0)
            m11, m12, b1 = fma(h1, r1, m11), fma(h1, r2, m12), fma(h1, r3, b1)
            m22, b2, c = fma(h2, r2, m22), fma(h2, r3, b2), fma(h3, r3, c)
    f = factor3(m00, m01, m02, m11, m12, m22)
    y0, y1, y2 = solve3(f, -b0, -b1, -b2)
    active = one > zero
    eigenvalue = zero
    for _ in range(MAX_STEPS):
        e0 = fma(m00, y0, fma(m01, y1, fma(m02, y2, b0)))
        e1 = fma(m01, y0, fma(m11, y1, fma(m12, y2, b1)))
        e2 = fma(m02, y0, fma(m12, y1, fma(m22, y2, b2)))
        e3 = fma(b0, y0, fma(b1, y1, fma(b2, y2, c)))
        norm2 = fma(y0, y0, fma(y1, y1, fma(y2, y2, one)))
        eigenvalue = fma(e0, y0, fma(e1, y1, fma(e2, y2, e3))) / norm2
        x0, x1, x2 = solve3(f, fma(-eigenvalue, y0, e0), fma(-eigenvalue, y1, e1), fma(-eigenvalue, y2, e2))
        y0, y1, y2 = select(active, y0 - x0, y0), select(active, y1 - x1, y1), select(active, y2 - x2, y2)
        step = absolute(x0) + absolute(x1) + absolute(x2)
        active = active & ~(step <= splat(STEP) * square_root(norm2))
        if not any_lane(active):
            break
    trace = m00 + m11 + m22
    proven = eigenvalue * trace * trace * (f[3] * f[4] * f[5]) < splat(4.0)
    return y0, y1, y2, f[6] & proven & ~active


@njit
def chain_errors(tables, target, pose, z, y0, y1, y2, results):
    """Localisation error (con) and TCP error (tcp) of one target into ``results`` (6 vectors)."""
    active = tables.counts[7]
    nominal = tables.targets_frame[target]
    y0, y1, y2 = y0 - splat(nominal[0]), y1 - splat(nominal[1]), y2 - splat(nominal[2])
    e = tables.out_of_frame
    e0 = dot3(splat(e[0]), splat(e[1]), splat(e[2]), y0, y1, y2)
    e1 = dot3(splat(e[3]), splat(e[4]), splat(e[5]), y0, y1, y2)
    e2 = dot3(splat(e[6]), splat(e[7]), splat(e[8]), y0, y1, y2)
    if tables.counts[4] != 0 and (active & 1) != 0:
        # Eq 18: the estimator is equivariant to the rigid motion of its coordinates, so q_hat = T_err1 q_hat_0
        e0, e1, e2 = move_error(tables, 0, pose, 0, tables.targets[target], e0, e1, e2)
    store(results, 24, e0)
    store(results, 32, e1)
    store(results, 40, e2)
    if (active & 2) != 0:
        e0, e1, e2 = move_error(tables, 1, pose, 96, tables.targets[target], e0, e1, e2)
    r = tables.to_tcp
    t0 = dot3(splat(r[0]), splat(r[1]), splat(r[2]), e0, e1, e2)
    t1 = dot3(splat(r[3]), splat(r[4]), splat(r[5]), e0, e1, e2)
    t2 = dot3(splat(r[6]), splat(r[7]), splat(r[8]), e0, e1, e2)
    if (active & 4) != 0:
        t0, t1, t2 = move_error(tables, 2, pose, 192, tables.targets_tcp[target], t0, t1, t2)
    t0 = t0 + splat(tables.execution_bias[0])
    t1 = t1 + splat(tables.execution_bias[1])
    t2 = t2 + splat(tables.execution_bias[2])
    offset, k = tables.gain_starts[3, 0], tables.gain_starts[3, 1]
    for j in range(k):
        xi = load(z, 8 * (tables.starts[4] + j))
        t0 = fma(splat(tables.gains[offset + j]), xi, t0)
        t1 = fma(splat(tables.gains[offset + k + j]), xi, t1)
        t2 = fma(splat(tables.gains[offset + 2 * k + j]), xi, t2)
    store(results, 0, t0)
    store(results, 8, t1)
    store(results, 16, t2)


@njit
def squared_reprojection(tables, images, estimate):
    """Sum over fiducials of the squared distance between image and reprojection, px^2, one view."""
    one, total = splat(1.0), splat(0.0)
    a0, a1, a2 = load(estimate, 0), load(estimate, 8), load(estimate, 16)
    mean_u, mean_v = load(estimate, 96), load(estimate, 104)
    for i in range(tables.counts[0]):
        x0, x1, x2 = splat(tables.nominal[i, 0]), splat(tables.nominal[i, 1]), splat(tables.nominal[i, 2])
        inverse = one / fma(a0, x0, fma(a1, x1, fma(a2, x2, one)))
        u = dot3(load(estimate, 24), load(estimate, 32), load(estimate, 40), x0, x1, x2) + load(estimate, 48)
        v = dot3(load(estimate, 56), load(estimate, 64), load(estimate, 72), x0, x1, x2) + load(estimate, 80)
        u = (load(images, 16 * i) - mean_u) - u * inverse
        v = (load(images, 16 * i + 8) - mean_v) - v * inverse
        total = fma(u, u, fma(v, v, total))
    return total


@njit
def run_chain(tables, z, points, images, estimates, pose, results, want_reprojection):
    """One group of eight trials from its deviates ``z`` to ``results``; then flag and reprojection RMS."""
    n, views, targets, active = tables.counts[0], tables.counts[1], tables.counts[2], tables.counts[7]
    for mount in range(3):
        if (active >> mount) & 1:
            write_mount(tables, mount, z, pose, 96 * mount)
    if tables.counts[3] != 0:
        place_points(tables, z, points)
    good = splat(1.0) > splat(0.0)
    squares = splat(0.0)
    for view in range(views):
        gu, gv = image_fiducials(tables, view, points, pose, images, z)
        estimate = estimates[112 * view : 112 * view + 112]
        good = good & resect(tables, view, images, gu, gv, estimate)
        if want_reprojection:
            squares = squares + squared_reprojection(tables, images, estimate)
    for target in range(targets):
        y0, y1, y2, proven = triangulate(tables, target, estimates, z)
        good = good & proven
        chain_errors(tables, target, pose, z, y0, y1, y2, results[48 * target : 48 * target + 48])
    at = 48 * targets
    store(results, at, select(good, splat(0.0), splat(1.0)))
    store(results, at + 8, square_root(squares / splat(1.0 * views * n)))


@njit(cache=True, nogil=True)
def run_trials(tables, keys, units, trials, given, errors, flags, reprojection, want_reprojection, scratch):
    """Run trials in groups of eight.

    trials, units: (n,) int64 indices, n a multiple of 8.  ``given``: (d, n) deviates, or (0, 0) to draw them from
    ``keys``.  Fills errors (6 T, n), flags (n,) and, when wanted, reprojection (n,) px.
    """
    n, views, targets, d = tables.counts[0], tables.counts[1], tables.counts[2], tables.counts[6]
    at = 0
    z = scratch[at : at + 8 * d]
    at += 8 * d
    points = scratch[at : at + 24 * n]
    at += 24 * n
    images = scratch[at : at + 16 * n]
    at += 16 * n
    estimates = scratch[at : at + 112 * views]
    at += 112 * views
    pose = scratch[at : at + 288]
    at += 288
    results = scratch[at : at + 48 * targets + 16]
    for i in range(n):
        for c in range(3):
            store(points, 24 * i + 8 * c, splat(tables.nominal[i, c]))
    rows = 6 * targets
    for group in range(0, trials.size, 8):
        if given.shape[0] > 0:
            for k in range(d):
                for lane in range(8):
                    z[8 * k + lane] = given[k, group + lane]
        else:
            fill_deviates(tables.segments, 0, keys[0], load(units, group), z)
            fill_deviates(tables.segments, 1, keys[1], load(trials, group), z)
        run_chain(tables, z, points, images, estimates, pose, results, want_reprojection)
        for row in range(rows):
            for lane in range(8):
                errors[row, group + lane] = results[8 * row + lane]
        for lane in range(8):
            flags[group + lane] = results[8 * rows + lane] != 0.0
            if want_reprojection:
                reprojection[group + lane] = results[8 * rows + 8 + lane]
