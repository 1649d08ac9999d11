"""Many small uniform columns at once: the logarithm of their characteristic function as one polynomial.

A manufactured structure has three small sources a fiducial.  Each is nearly Gaussian beside all the others; what it
is not is a short series, and the series of all of them add up.
"""

from __future__ import annotations

from math import comb, log

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel

# Coefficients of log(sin x / x) by powers of x, from x^4 on (the x^2 of it is the column's Gaussian part).
LOG_SINC = np.zeros(13)
LOG_SINC[4:13:2] = (-1 / 180, -1 / 2835, -1 / 37800, -1 / 467775, -691 / 3831077250)
# The same by powers (m, i, l) of the three products in x = k'h: times (m + i + l)! / (m! i! l!).
_WEIGHTS = np.zeros((13, 13, 13))
for _m, _i, _l in np.ndindex(_WEIGHTS.shape):
    if _m + _i + _l < LOG_SINC.size:
        _WEIGHTS[_m, _i, _l] = LOG_SINC[_m + _i + _l] * comb(_m + _i, _i) * comb(_m + _i + _l, _l)


@kernel()
def inverse_of(S: Array) -> tuple[Array, bool]:
    """(S^-1 (3, 3), whether S is regular enough to have one)."""
    out = np.empty((3, 3))
    determinant = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
        - S[0, 1] * (S[1, 0] * S[2, 2] - S[1, 2] * S[2, 0])
        + S[0, 2] * (S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0])
    )
    if not determinant > 1e-9 * max(S[0, 0], S[1, 1], S[2, 2]) ** 3:
        return out, False
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = (S[a, c] * S[b, d] - S[a, d] * S[b, c]) / determinant
    return out, True


@kernel()
def rows_where(h: Array, mask: NDArray[np.bool_], wanted: bool) -> Array:
    """The rows of h (K, 3) whose mask is `wanted`; in loops, as indexing by a mask takes seconds to compile."""
    count = 0
    for j in range(h.shape[0]):
        if mask[j] == wanted:
            count += 1
    out = np.empty((count, 3))
    count = 0
    for j in range(h.shape[0]):
        if mask[j] == wanted:
            for a in range(3):
                out[count, a] = h[j, a]
            count += 1
    return out


@kernel()
def fold_small(S: Array, h: Array, budget: float) -> tuple[Array, NDArray[np.bool_], int]:
    """(S with the Gaussian part of small columns (3, 3), which ones (K,), degree of their series).

    ``log (sin x / x) = -x^2/6 - x^4/180 - ...``, to x^12 at most: a column that is short beside the spread of all small
    ones together, ``G = S + sum h h'/3``, is summed as its series, which along a line of the lattice is one polynomial
    for all of them.  With rho^2 = h'G^-1 h:

    - where all ``|k'h| <= 2`` the terms cut off after x^d change phi by at most ``6.5e-3 rho^(d+2)`` a column (the
      largest of ``c x^(d+2) exp(-x^2 / (2 rho^2))``, c the next coefficient, and a factor 1.7 for the rest of the
      series, d = 4 ... 12); their sum stays below ``budget``;
    - elsewhere ``exp(-k'G k / 2) <= exp(-2 / rho^2)``, so does phi (its envelope falls along every ray, and at
      ``|k'h| = 2`` each ``sin x / x`` is below its Gaussian part), and both are kept below ``budget``.

    All coefficients (``LOG_SINC``) are negative, so the Gaussian part bounds the factor.
    """
    columns = h.shape[0]
    short = np.ones(columns, dtype=np.bool_)
    folded = S.copy()
    cut = np.zeros(13)  # by degree: what leaving out the rest changes
    changed = True
    while changed:
        changed = False
        for a in range(3):
            for b in range(3):
                folded[a, b] = S[a, b]
        for j in range(columns):
            if short[j]:
                for a in range(3):
                    for b in range(3):
                        folded[a, b] += h[j, a] * h[j, b] / 3.0
        inverse, regular = inverse_of(folded)
        if not regular:
            short[:] = False
            return S.copy(), short, 4
        cut[:] = 0.0
        for j in range(columns):
            if short[j]:
                rho2 = 0.0
                for a in range(3):
                    for b in range(3):
                        rho2 += h[j, a] * inverse[a, b] * h[j, b]
                if not (6.5e-3 * rho2**7 * columns < budget and -log(budget) * rho2 < 2.0):
                    short[j] = False
                    changed = True
                power = 6.5e-3 * rho2 * rho2
                for d in range(4, 13, 2):
                    power *= rho2
                    cut[d] += power
    degree = 4
    while degree < 12 and cut[degree] > budget:
        degree += 2
    return folded, short, degree


@kernel()
def _products(x: Array, y: Array, out: Array) -> None:
    for i in range(x.size):
        out[i] = x[i] * y[i]


@kernel()
def sum_of_products(x: Array, y: Array) -> float:
    """x'y by eight sums side by side: in lanes, and in an order that is written here.

    An order left to the compiler (``fastmath``) depends on what the function is inlined into, and so on which process
    compiled it.
    """
    a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    whole = x.size // 8 * 8
    for i in range(0, whole, 8):
        a += x[i] * y[i]
        b += x[i + 1] * y[i + 1]
        c += x[i + 2] * y[i + 2]
        d += x[i + 3] * y[i + 3]
        e += x[i + 4] * y[i + 4]
        f += x[i + 5] * y[i + 5]
        g += x[i + 6] * y[i + 6]
        h += x[i + 7] * y[i + 7]
    for i in range(whole, x.size):
        a += x[i] * y[i]
    return ((a + b) + (c + d)) + ((e + f) + (g + h))


@kernel()
def higher_orders(small: Array, degree: int, outer: int, middle: int, inner: int) -> Array:
    """(D, D, D), D = degree + 1: coefficients of ``-sum_j (x^4/180 + ... )``, x = k'h_j, by powers of k_inner, k_outer
    and k_middle: every column at once, so that a line of the lattice costs the same for two columns as for fifty."""
    size = degree + 1
    count = small.shape[0]
    out = np.zeros((size, size, size))
    power = np.ones((3, size, count))
    for j in range(count):
        power[0, 1, j] = small[j, inner]
        power[1, 1, j] = small[j, outer]
        power[2, 1, j] = small[j, middle]
    for a in range(3):
        for d in range(2, size):
            _products(power[a, d - 1], power[a, 1], power[a, d])
    both = np.empty(count)
    for m in range(size):
        for i in range(size - m):
            _products(power[0, m], power[1, i], both)
            first = max((m + i) % 2, 4 - m - i)  # even orders from 4 on
            for l in range(first, size - m - i, 2):  # noqa: E741
                out[m, i, l] = _WEIGHTS[m, i, l] * sum_of_products(both, power[2, l])
    return out


@kernel()
def in_plane(orders: Array, k: float, out: Array) -> None:
    """Fill out (D, D): the sum over powers of k_outer, which is k."""
    size = orders.shape[0]
    for m in range(size):
        for l in range(size - m):  # noqa: E741
            total = 0.0
            for i in range(size - 1 - m - l, -1, -1):
                total = total * k + orders[m, i, l]
            out[m, l] = total


@kernel()
def along_line(plane: Array, k: float, step: float, out: Array) -> None:
    """Fill out (D,): coefficients in n of the polynomial at k_middle = k, k_inner = n step."""
    size = plane.shape[0]
    scale = 1.0
    for m in range(size):
        total = 0.0
        for l in range(size - 1 - m, -1, -1):  # noqa: E741
            total = total * k + plane[m, l]
        out[m] = total * scale
        scale *= step
