"""Small symmetric linear algebra in lanes."""

# mypy: ignore-errors
from __future__ import annotations

from .lanes import fma, lane_jit, splat


@lane_jit
def dot3(ax, ay, az, bx, by, bz):
    return fma(ax, bx, fma(ay, by, az * bz))


@lane_jit
def symmetric_times(g, x0, x1, x2, x3):
    """Product of a symmetric 4x4 (10 entries, upper triangle by rows) and a 4-vector."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    return (
        fma(g00, x0, fma(g01, x1, fma(g02, x2, g03 * x3))),
        fma(g01, x0, fma(g11, x1, fma(g12, x2, g13 * x3))),
        fma(g02, x0, fma(g12, x1, fma(g22, x2, g23 * x3))),
        fma(g03, x0, fma(g13, x1, fma(g23, x2, g33 * x3))),
    )


@lane_jit
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


@lane_jit
def solve3(f, b0, b1, b2):
    l10, l20, l21, i0, i1, i2, _ = f
    y1 = fma(-l10, b0, b1)
    y2 = fma(-l21, y1, fma(-l20, b0, b2))
    x2 = y2 * i2
    x1 = fma(-l21, x2, y1 * i1)
    x0 = fma(-l10, x1, fma(-l20, x2, b0 * i0))
    return x0, x1, x2


@lane_jit
def reciprocal_shifted(d, inverse, shift):
    """1 / (d - shift) by Newton's iteration from 1/d; relative error (shift/d)^8."""
    x = fma(inverse, shift * inverse, inverse)
    gap = splat(d) - shift
    two = splat(1.0)
    x = fma(x, fma(-gap, x, two), x)
    return fma(x, fma(-gap, x, two), x)


@lane_jit
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
