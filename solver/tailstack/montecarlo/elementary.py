"""log, sine and cosine in lanes, without a maths library.

Polynomials of the usual kind (Cody-Waite reduction, the minimax coefficients of fdlibm), written with
explicit fused multiply-adds: libm differs in its last digit between machines, these do not.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from .lanes import as_bits, as_lanes, bits_set, fma, lane_entry, lane_jit, load, select, splat, splat_bits, store

_MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
_ONE = np.uint64(0x3FF0000000000000)  # pattern of 1.0

_TWO52 = np.uint64(0x4330000000000000)  # pattern of 2^52: integers below 2^52 or-ed in become exact doubles
_EXPONENT_OFFSET = 2.0**52 + 1023.0
_ROUNDER = 1.5 * 2.0**52  # adding and subtracting rounds to the nearest integer
_52 = np.uint64(52)
_62 = np.uint64(62)
_63 = np.uint64(63)
_LN2 = 0.6931471805599453
_PIO2_HIGH = 1.5707963267341256  # first 33 bits of pi/2: multiples up to 2^20 are exact
_PIO2_LOW = 6.077100506506192e-11


@lane_jit
def natural_log(x):
    """log of positive normal doubles; absolute error below 2e-15 on (0, 1]."""
    pattern = as_bits(x)
    exponent = as_lanes((pattern >> splat_bits(_52)) | splat_bits(_TWO52)) - splat(_EXPONENT_OFFSET)
    mantissa = as_lanes((pattern & splat_bits(_MANTISSA)) | splat_bits(_ONE))
    large = mantissa > splat(1.4142135623730951)
    mantissa = select(large, mantissa * splat(0.5), mantissa)
    exponent = select(large, exponent + splat(1.0), exponent)
    # log m = 2 artanh s, s = (m - 1) / (m + 1), |s| < 0.1716
    s = (mantissa - splat(1.0)) / (mantissa + splat(1.0))
    z = s * s
    p = fma(z, splat(1.479819860511658591e-01), splat(1.531383769920937332e-01))
    p = fma(z, p, splat(1.818357216161805012e-01))
    p = fma(z, p, splat(2.222219843214978396e-01))
    p = fma(z, p, splat(2.857142874366239149e-01))
    p = fma(z, p, splat(3.999999999940941908e-01))
    p = fma(z, p, splat(6.666666666666735130e-01))
    return fma(exponent, splat(_LN2), fma(s * z, p, s + s))


@lane_jit
def sine_cosine_small(x):
    """(sin x, cos x) for |x| <= pi/4, to the last place."""
    z = x * x
    p = fma(z, splat(1.58969099521155010221e-10), splat(-2.50507602534068634195e-08))
    p = fma(z, p, splat(2.75573137070700676789e-06))
    p = fma(z, p, splat(-1.98412698298579493134e-04))
    p = fma(z, p, splat(8.33333333332248946124e-03))
    p = fma(z, p, splat(-1.66666666666666324348e-01))
    sine = fma(x * z, p, x)
    q = fma(z, splat(-1.13596475577881948265e-11), splat(2.08757232129817482790e-09))
    q = fma(z, q, splat(-2.75573143513906633035e-07))
    q = fma(z, q, splat(2.48015872894767294178e-05))
    q = fma(z, q, splat(-1.38888888888741095749e-03))
    q = fma(z, q, splat(4.16666666666666019037e-02))
    return sine, fma(z * z, q, fma(z, splat(-0.5), splat(1.0)))


@lane_jit
def sine_cosine(x):
    """(sin x, cos x) for |x| < 1e6 rad, absolute error below 2e-16 for the angles of a mount."""
    shifted = fma(x, splat(0.6366197723675814), splat(_ROUNDER))
    quarter = shifted - splat(_ROUNDER)
    sine, cosine = sine_cosine_small(fma(quarter, splat(-_PIO2_LOW), fma(quarter, splat(-_PIO2_HIGH), x)))
    turns = as_bits(shifted)  # its lowest bits count quarter turns
    swapped = bits_set((turns << splat_bits(_63)) & splat_bits(np.uint64(1 << 63)))
    half = (turns << splat_bits(_62)) & splat_bits(np.uint64(1 << 63))
    quarter_bit = (turns << splat_bits(_63)) & splat_bits(np.uint64(1 << 63))
    sine_out = select(swapped, cosine, sine)
    cosine_out = select(swapped, sine, cosine)
    # quadrants 2, 3: sine negative; quadrants 1, 2: cosine negative
    return as_lanes(as_bits(sine_out) ^ half), as_lanes(as_bits(cosine_out) ^ half ^ quarter_bit)


@lane_entry
def tabulate(x, out):
    """Apply the three functions to a padded array: rows of ``out`` are log, sin, cos.  For tests and tables."""
    for i in range(0, x.size, 8):
        value = load(x, i)
        store(out, i, natural_log(value))
        sine, cosine = sine_cosine(value)
        store(out, x.size + i, sine)
        store(out, 2 * x.size + i, cosine)
