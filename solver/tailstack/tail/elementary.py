"""exp, sin and cos without a call: a loop over them runs in the processor's lanes.

numba's own go to the maths library, one number at a time.  Everything here is straight-line arithmetic, so that LLVM
takes eight turns of the loop around it at once.
"""

from __future__ import annotations

from math import fabs

from ..kernels.store import kernel

_LEAST = -64.0  # exp is 0 to all purposes below it
# pi/2 in three parts of 33 bits (Cody and Waite): n times one of the first two is exact for n < 2^20.
_HALF_PI_1 = 1.57079632673412561417e00
_HALF_PI_2 = 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21
_TWO_OVER_PI = 6.36619772367581382433e-01
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and taking it away rounds to the nearest whole number


@kernel()
def _lossless(y: float) -> float:
    """exp(8 y) - 1 for -1 <= y <= 0.5, to a rounding or two however small y is: Taylor's polynomial and three times the
    square of what it is 1 less than."""
    u = 1.0 + y * (1.0 / 13.0)
    u = 1.0 + y * (1.0 / 12.0) * u
    u = 1.0 + y * (1.0 / 11.0) * u
    u = 1.0 + y * (1.0 / 10.0) * u
    u = 1.0 + y * (1.0 / 9.0) * u
    u = 1.0 + y * (1.0 / 8.0) * u
    u = 1.0 + y * (1.0 / 7.0) * u
    u = 1.0 + y * (1.0 / 6.0) * u
    u = 1.0 + y * (1.0 / 5.0) * u
    u = 1.0 + y * (1.0 / 4.0) * u
    u = 1.0 + y * (1.0 / 3.0) * u
    u = 1.0 + y * (1.0 / 2.0) * u
    u = y * u
    u *= 2.0 + u  # the square less 1: while u is small, nothing of it is lost
    u *= 2.0 + u
    u *= 2.0 + u
    return u


@kernel()
def exponential(x: float) -> float:
    """exp(x) for -64 <= x <= 30, exp(-64) below: relative error 4e-15 for -10 < x < 10, 1e-13 at -30, 2e-10 at -60.

    Taylor's polynomial of x / 64 and six squarings.
    """
    e = 1.0 + _lossless(max(x, _LEAST) * (1.0 / 64.0))
    e *= e
    e *= e
    e *= e
    return e


@kernel()
def share_lost(x: float) -> float:
    """1 - exp(-x) for x >= 0, to 1e-15 relative, however small x is."""
    u = _lossless(-min(x, -_LEAST) * (1.0 / 64.0))
    u *= 2.0 + u
    u *= 2.0 + u
    u *= 2.0 + u
    return -u


@kernel()
def sine_and_cosine(x: float) -> tuple[float, float]:
    """sin(x) and cos(x) to 2e-16 absolute for |x| < 1e6; beyond, and to 1e15, off by no more than rounding x itself is.

    Turned to |x| <= pi/4, Taylor's polynomials there.
    """
    turns = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    y = ((x - turns * _HALF_PI_1) - turns * _HALF_PI_2) - turns * _HALF_PI_3
    z = y * y
    s = 1.0 - z * (1.0 / 210.0)
    s = 1.0 - z * (1.0 / 156.0) * s
    s = 1.0 - z * (1.0 / 110.0) * s
    s = 1.0 - z * (1.0 / 72.0) * s
    s = 1.0 - z * (1.0 / 42.0) * s
    s = 1.0 - z * (1.0 / 20.0) * s
    s = y * (1.0 - z * (1.0 / 6.0) * s)
    c = 1.0 - z * (1.0 / 240.0)
    c = 1.0 - z * (1.0 / 182.0) * c
    c = 1.0 - z * (1.0 / 132.0) * c
    c = 1.0 - z * (1.0 / 90.0) * c
    c = 1.0 - z * (1.0 / 56.0) * c
    c = 1.0 - z * (1.0 / 30.0) * c
    c = 1.0 - z * (1.0 / 12.0) * c
    c = 1.0 - z * (1.0 / 2.0) * c
    quarter = turns - 4.0 * ((turns * 0.25 + _ROUND) - _ROUND)  # -2 ... 2
    odd = fabs(quarter) == 1.0
    first = c if odd else s
    second = s if odd else c
    sine = -first if (quarter < 0.0) | (quarter == 2.0) else first
    cosine = -second if (quarter == 1.0) | (fabs(quarter) == 2.0) else second
    return sine, cosine
