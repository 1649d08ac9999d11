"""P(|e| <= r) for e = m + N(0, S) + sum_j h_j u_j, by Poisson summation of the characteristic function.

Lay copies of the law on a lattice of periods L_a.  Integrated over the ball of radius r about 0 their sum is

    sum_n P(|e - n L| <= r) = (1 / (L_1 L_2 L_3)) sum_k phi(k) B_r(|k|),     k_a = 2 pi n_a / L_a

with ``phi(k) = exp(i k'm - k'S k / 2) prod_j sin(k'h_j) / (k'h_j)``, u_j uniform on (-1, 1), and B_r the Fourier
transform of the ball.  (A source that is the sum of two uniform ones is split by the caller.)  The
copies other than the law itself reach the ball only if some ``|e_a - m_a| > L_a - r - |m_a|``.  Uniform laws are
strictly sub-Gaussian (their moment generating function lies below the normal one of equal variance), so with
``L_a = r + |m_a| + c sigma_a`` that has probability below ``2 exp(-c^2/2)`` per axis.  The sum on the right
converges as fast as phi falls; it is cut where an envelope of its terms falls below a threshold.

Axes on which nothing varies are left out (they must come last): the ball becomes a disc or an interval.  Its transform
is ``B_r(t) = 4 pi (sin rt - rt cos rt) / t^3`` for the ball, ``2 pi r J1(rt) / t`` for the disc, ``2 sin(rt) / t`` for
the interval; the derivative by r is the transform of the sphere of radius r.

A manufactured structure has three small sources a fiducial.  Each is nearly Gaussian beside all the others; what it is
not is a short series of its logarithm, and the series of all of them add up to one polynomial (:func:`fold_small`).
"""

from __future__ import annotations

from math import comb, cos, exp, fabs, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.numerics import VANISHING_MM, exponential, principal_axes, sine_and_cosine
from ..kernels.store import kernel
from ..laws import NORMAL

SMALL_BOX = 1e3  # lattice points below which the plain bound of the extent is cheaper than the search for the true one
_LANES = 8  # lines are computed to a multiple of this, so that no loop ends in single steps

# Coefficients of log(sin x / x) by powers of x, from x^4 on (the x^2 of it is the column's Gaussian part).
LOG_SINC = np.zeros(13)
LOG_SINC[4:13:2] = (-1 / 180, -1 / 2835, -1 / 37800, -1 / 467775, -691 / 3831077250)
# The same by powers (m, i, l) of the three products in x = k'h: times (m + i + l)! / (m! i! l!).
_WEIGHTS = np.zeros((13, 13, 13))
for _m, _i, _l in np.ndindex(_WEIGHTS.shape):
    if _m + _i + _l < LOG_SINC.size:
        _WEIGHTS[_m, _i, _l] = LOG_SINC[_m + _i + _l] * comb(_m + _i, _i) * comb(_m + _i + _l, _l)


class PrincipalLaw(NamedTuple):
    """A law on the principal axes of its total covariance; axes on which nothing varies come last and are zeroed."""

    sigma: Array  # (3,) mm, standard deviations along the axes; 0 on an axis that is left out
    mean: Array  # (3,) mm
    S: Array  # (3, 3) mm^2, the Gaussian part
    h: Array  # (K, 3) mm, uniform columns
    away: Array  # (3,) mm, the farthest from 0 that a mean may lie which the lattice is to serve
    axes: Array  # (3, 3) in columns, in the frame of the law
    dimension: int  # how many axes are not left out
    offset: float  # mm^2, squared length of the mean along those that are


class Accuracy(NamedTuple):
    """What a lattice sum may leave out, and how large it may become."""

    threshold: float  # of a term
    aliasing: float  # of the probability that copies of the law bring in
    largest_box: float  # lattice points looked at


class Lattice(NamedTuple):
    """The terms of a sum: the probability is ``sum_i w_i B_r(t_i)`` for every radius up to that it was built for."""

    t: Array  # (n,) 1/mm, |k|
    w: Array  # (n,) phi, of both +-k, over the volume
    k: Array  # (n, 3) 1/mm, or (0, 3)
    volume: float  # mm^dimension; 0: there would be too many points, and there are none
    decade: float  # root sum of squares of the smallest terms, which tells the error of those left out


class Folded(NamedTuple):
    """Columns with the small ones taken into the Gaussian part, but for the higher orders of their logarithm."""

    S: Array  # (3, 3) mm^2, with the variance of the small ones
    long: Array  # (K - s, 3) mm
    small: Array  # (s, 3) mm
    degree: int  # of the series


@kernel()
def assemble_law(
    gain: Array, std: Array, half_width: Array, kinds: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """The covariance (3, 3) mm^2 of what is normal, and columns (3, k) mm and kinds (k,) of what is not; of a law whose
    spread vanishes all 0."""
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = 0
    largest = 0.0
    for j in range(kinds.size):
        if kinds[j] == NORMAL:
            x, y, z = gain[0, j] * std[j], gain[1, j] * std[j], gain[2, j] * std[j]
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
        elif kinds[j] >= 0 and half_width[j] > 0.0:
            count += 1
            for a in range(3):
                largest = max(largest, abs(gain[a, j] * half_width[j]))
    covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    columns = np.zeros((3, count))
    own = np.zeros(count, dtype=np.int64)
    vanishes = covariance[0, 0] + covariance[1, 1] + covariance[2, 2] < VANISHING_MM**2 and not largest > VANISHING_MM
    if vanishes:
        covariance[:] = 0.0
    count = 0
    for j in range(kinds.size):
        if kinds[j] >= 0 and half_width[j] > 0.0:
            own[count] = kinds[j]
            for a in range(3):
                columns[a, count] = 0.0 if vanishes else gain[a, j] * half_width[j]
            count += 1
    return covariance, columns, own


def assemble_pair(
    gain: Array, std: Array, half_width: Array, kinds: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """:func:`assemble_law` of two vectors: covariance (6, 6), columns (6, k), kinds (k,)."""
    scaled, wide = gain[:, kinds == NORMAL] * std[kinds == NORMAL], (kinds >= 0) & (half_width > 0.0)
    return scaled @ scaled.T, gain[:, wide] * half_width[wide], kinds[wide]


@kernel()
def on_principal_axes(mean: Array, covariance: Array, h: Array) -> PrincipalLaw:
    """The frame of a law: mean (3,) mm, covariance (3, 3) mm^2 of its Gaussian part, uniform columns h (K, 3) mm."""
    total = covariance.copy()
    for j in range(h.shape[0]):
        for a in range(3):
            for b in range(3):
                total[a, b] += h[j, a] * h[j, b] / 3.0
    variances, m, axes = principal_axes(mean, total)
    S = axes.T @ covariance @ axes
    turned = h @ axes
    sigma = np.sqrt(variances)
    dimension = 0
    offset = 0.0
    for a in range(3):
        if sigma[a] > 0.0:
            dimension += 1
        else:
            offset += m[a] * m[a]
            m[a] = 0.0
            S[a, :] = 0.0
            S[:, a] = 0.0
            turned[:, a] = 0.0
    return PrincipalLaw(sigma, m, S, turned, np.abs(m), axes, dimension, offset)


@kernel()
def reach_of(frame: PrincipalLaw, aliasing: float) -> Array:
    """(3,) mm, the distance from the mean that each coordinate exceeds with total probability below `aliasing`."""
    c = sqrt(2.0 * log(6.0 / aliasing))
    reach = np.zeros(3)
    for a in range(3):
        bounded = c * sqrt(max(frame.S[a, a], 0.0))
        for j in range(frame.h.shape[0]):
            bounded += fabs(frame.h[j, a])
        reach[a] = min(c * frame.sigma[a], bounded)
    return reach


# --- small columns as one polynomial ---------------------------------------------------------------------------------


@kernel()
def inverse_of(S: Array) -> tuple[Array, bool]:
    """(S^-1 (3, 3), whether S (3, 3) is regular enough to have one)."""
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
def _rows_where(h: Array, mask: NDArray[np.bool_], wanted: bool) -> Array:
    """The rows of h (K, 3) whose mask (K,) is `wanted`; in loops, as indexing by a mask takes seconds to compile."""
    out = np.empty((np.sum(mask == wanted), 3))
    count = 0
    for j in range(h.shape[0]):
        if mask[j] == wanted:
            out[count] = h[j]
            count += 1
    return out


@kernel()
def fold_small(S: Array, h: Array, budget: float) -> Folded:
    """Which of the columns h (K, 3) mm are small beside S (3, 3) mm^2 and one another, and the degree of their series.

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
            return Folded(S.copy(), h, _rows_where(h, short, True), 4)
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
    return Folded(folded, _rows_where(h, short, False), _rows_where(h, short, True), degree)


@kernel()
def sum_of_products(x: Array, y: Array) -> float:
    """x'y of x (n,) and y (n,) by eight sums side by side: in lanes, and in an order that is written here.

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
    and k_middle: every column of small (s, 3) mm at once, so that a line of the lattice costs the same for two columns
    as for fifty.  outer, middle, inner: which axis is which."""
    size = degree + 1
    out = np.zeros((size, size, size))
    power = np.ones((3, size, small.shape[0]))
    for d in range(1, size):
        for j in range(small.shape[0]):
            power[0, d, j] = power[0, d - 1, j] * small[j, inner]
            power[1, d, j] = power[1, d - 1, j] * small[j, outer]
            power[2, d, j] = power[2, d - 1, j] * small[j, middle]
    both = np.empty(small.shape[0])
    for m in range(size):
        for i in range(size - m):
            for j in range(both.size):
                both[j] = power[0, m, j] * power[1, i, j]
            first = max((m + i) % 2, 4 - m - i)  # even orders from 4 on
            for l in range(first, size - m - i, 2):  # noqa: E741
                out[m, i, l] = _WEIGHTS[m, i, l] * sum_of_products(both, power[2, l])
    return out


@kernel()
def in_plane(orders: Array, k: float, out: Array) -> None:
    """Fill out (D, D), by powers of k_middle, then k_inner: the sum over powers of k_outer, which is k in 1/mm, of the
    orders (D, D, D)."""
    size = orders.shape[0]
    for m in range(size):
        for l in range(size - m):  # noqa: E741
            total = 0.0
            for i in range(size - 1 - m - l, -1, -1):
                total = total * k + orders[m, i, l]
            out[l, m] = total


@kernel()
def along_line(plane: Array, k: float, step: float, out: Array) -> None:
    """Fill out (D,): coefficients in n of the polynomial at k_middle = k, k_inner = n step, 1/mm; plane (D, D)."""
    size = plane.shape[0]
    for m in range(size):
        out[m] = 0.0
    for l in range(size - 1, -1, -1):  # noqa: E741
        for m in range(size - l):  # Horner's rule for all of them side by side
            out[m] = out[m] * k + plane[l, m]
    scale = 1.0
    for m in range(size):
        out[m] *= scale
        scale *= step


# --- how far a lattice extends ---------------------------------------------------------------------------------------


@kernel()
def _ball_envelope(t: float, r: float, dimension: int) -> float:
    """A decreasing bound of |B_r(t)|, t >= 0."""
    if dimension == 1:
        return min(2.0 * r, 2.0 / t)
    if dimension == 2:
        return min(pi * r * r, 2.2 * r * sqrt(2.0 * pi / (r * t)) / t)
    return min(4.0 / 3.0 * pi * r * r * r, 4.0 * pi * (1.0 + r * t) / (t * t * t))


@kernel()
def gaussian_extent(r: float, volume: float, S: Array, threshold: float) -> Array:
    """(3,) largest |k_a|, 1/mm, at which the Gaussian factor of S (3, 3) mm^2 alone lets a term pass the threshold; inf
    if S is singular.

    Always enough, and free: ``k'S k <= q`` reaches ``sqrt(q (S^-1)_aa)`` along axis a.
    """
    extent = np.full(3, np.inf)
    inverse, regular = inverse_of(S)
    if regular:
        reach = 2.0 * log(_ball_envelope(1e-300, r, 3) / (threshold * volume))
        for a in range(3):
            extent[a] = sqrt(max(reach, 0.0) * inverse[a, a])
    return extent


@kernel()
def _rays(sigma: Array, h: Array, dimension: int) -> Array:
    """(n, 3) directions in which a spectrum is looked at, of any length: the axes; a spread, in units of 1/sigma (3,)
    (Fibonacci points of the half sphere); and those perpendicular to columns h (K, 3), where it has spikes."""
    columns = h.shape[0]
    spread = 32 if dimension == 3 else 12 if dimension == 2 else 0
    spikes = min(columns * (columns - 1) // 2, 400) if dimension == 3 else columns if dimension == 2 else 0
    out = np.zeros((dimension + spread + spikes, 3))
    n = 0
    for a in range(dimension):
        out[n, a] = 1.0
        n += 1
    for i in range(spread):
        if dimension == 3:
            z = (i + 0.5) / spread
            angle = 2.399963229728653 * i
            out[n, 0] = sqrt(1.0 - z * z) * cos(angle) / sigma[0]
            out[n, 1] = sqrt(1.0 - z * z) * sin(angle) / sigma[1]
            out[n, 2] = z / sigma[2]
        else:
            angle = pi * (i + 0.5) / spread
            out[n, 0] = cos(angle) / sigma[0]
            out[n, 1] = sin(angle) / sigma[1]
        n += 1
    for j in range(columns):
        if dimension == 2:
            out[n, 0] = -h[j, 1]
            out[n, 1] = h[j, 0]
            n += 1
        elif dimension == 3:
            for i in range(j + 1, columns):
                if n < out.shape[0]:
                    for a in range(3):
                        b, c = (a + 1) % 3, (a + 2) % 3
                        out[n, a] = h[j, b] * h[i, c] - h[j, c] * h[i, b]
                    n += 1
    return out


@kernel()
def _beyond(size: float, quadratic: float, along: Array, r: float, dimension: int, goal: float) -> bool:
    """Whether the envelope of the terms at ``size k``, |k| = 1, is below the goal.

    It decreases along every ray: ``|sin x / x| <= min(1, 1/x)``.  quadratic: k'S k; along: (K,) |k'h|.
    """
    product = goal
    for j in range(along.size):
        product *= max(1.0, size * along[j])
    return exp(-0.5 * quadratic * size * size) * _ball_envelope(size, r, dimension) < product


@kernel()
def spectral_extent(r: float, volume: float, frame: PrincipalLaw, threshold: float) -> Array:
    """(3,) largest |k_a|, 1/mm, at which a term's envelope reaches the threshold; 0 on an axis that is left out.

    The set is star-shaped about 0, with spikes where k is perpendicular to many columns.  Its extent is taken along
    the axes, the cross products of the columns (the spikes) and a spread of other directions.
    """
    h, S, dimension = frame.h, frame.S, frame.dimension
    furthest = 1e9 / frame.sigma[0]
    goal = threshold * volume
    extent = np.zeros(3)
    along = np.empty(h.shape[0])
    rays = _rays(frame.sigma, h, dimension)
    for n in range(rays.shape[0]):
        k = rays[n]
        length = sqrt(k[0] * k[0] + k[1] * k[1] + k[2] * k[2])
        if not length > 0.0:
            continue
        k /= length
        quadratic = 0.0
        low = np.inf
        for a in range(3):
            if k[a] != 0.0:
                low = min(low, extent[a] / fabs(k[a]))
            for b in range(3):
                quadratic += k[a] * S[a, b] * k[b]
        for j in range(h.shape[0]):
            along[j] = fabs(k[0] * h[j, 0] + k[1] * h[j, 1] + k[2] * h[j, 2])
        if low > 0.0 and _beyond(low, quadratic, along, r, dimension, goal):
            continue  # this ray stays inside the box there is
        high = max(2.0 * low, 2.0 / frame.sigma[0])
        while high < furthest and not _beyond(high, quadratic, along, r, dimension, goal):
            low = high
            high *= 2.0
        for _ in range(4):
            middle = 0.5 * (low + high)
            if _beyond(middle, quadratic, along, r, dimension, goal):
                high = middle
            else:
                low = middle
        for a in range(3):
            extent[a] = max(extent[a], fabs(k[a]) * high)
    return extent


@kernel()
def box_size(period: Array, extent: Array) -> float:
    """Number of lattice points in half of the box that holds every term above the threshold; period (3,) mm, extent
    (3,) 1/mm."""
    size = 0.5
    for a in range(3):
        if period[a] > 0.0:
            size *= 2.0 * np.floor(extent[a] * period[a] / (2.0 * pi)) + 1.0
    return size


# --- the terms -------------------------------------------------------------------------------------------------------


class _Tables(NamedTuple):
    """sin and cos of n k'h for the steps n along one axis, a row a column; 0 and 1 in the room behind."""

    sin: Array
    cos: Array


class _Line(NamedTuple):
    """What the points of one line of the lattice have, by their place on it."""

    numerator: Array  # of the product of sin x / x
    denominator: Array
    bound: Array  # of the product: its inverse is an envelope
    exponent: Array  # of the Gaussian factor and the small columns'
    turned: Array  # cos(k'm), in the end the weight
    size: Array  # |k|, 1/mm
    reach: Array  # exp(exponent)
    ball: Array  # bound of the ball's transform, in the end of the term


@kernel()
def _tabulate(angle: Array, half: int, mirrored: bool, room: int) -> _Tables:
    """For angles (K,) of one step, rad: 0 <= n <= half, or -half <= n <= half where mirrored, and `room` more."""
    start = half if mirrored else 0
    length = start + half + 1
    sines = np.zeros((angle.size, length + room))
    cosines = np.ones((angle.size, length + room))
    for j in range(angle.size):
        for i in range(1, half + 1):
            s = sin(i * angle[j])
            c = cos(i * angle[j])
            sines[j, start + i] = s
            cosines[j, start + i] = c
            if mirrored:
                sines[j, start - i] = -s
                cosines[j, start - i] = c
    return _Tables(sines, cosines)


@kernel()
def _multiply_columns(line: _Line, table: _Tables, low: int, count: int, start: Array, turn: Array, dx: Array) -> None:
    """Products over the columns of sin x / x and of its envelope, for `count` points of a line from its place `low` on.

    x = start + i dx (K,), rad; turn (2, K): sin and cos of x at k_inner = 0.  sin(a + n b) comes from the addition
    theorem and the table of sin(n b): loops the compiler vectorises.
    """
    numerator, denominator, bound = line.numerator, line.denominator, line.bound
    for i in range(count):
        numerator[i] = 1.0
        denominator[i] = 1.0
        bound[i] = 1.0
    for j in range(start.size):
        line_s = table.sin[j, low : low + count]
        line_c = table.cos[j, low : low + count]
        at, by, start_s, start_c = start[j], dx[j], turn[0, j], turn[1, j]
        for i in range(count):
            x = at + i * by
            s = start_s * line_c[i] + start_c * line_s[i]
            near = fabs(x) < 1e-4
            numerator[i] *= 1.0 - x * x / 6.0 if near else s
            denominator[i] *= 1.0 if near else x
            bound[i] *= max(1.0, fabs(x))


@kernel()
def lattice_terms(
    r: float, period: Array, extent: Array, mean: Array, folded: Folded, threshold: float, capacity: int, keep: bool
) -> Lattice:
    """The lattice for radii up to r, mm; its k only if they are to be kept.

    period (3,) mm, 0 on an axis that is left out; extent (3,) 1/mm; mean (3,) mm; folded: the columns; threshold of a
    term; capacity: no more terms than these.  The last decade are the terms within a factor of ten of the threshold:
    what was left out is of their kind, smaller, and of either sign.
    """
    S, h, small, degree = folded.S, folded.long, folded.small, folded.degree
    dimension = 0
    volume = 1.0
    last = np.zeros(3, dtype=np.int64)
    step = np.zeros(3)
    for a in range(3):
        if period[a] > 0.0:
            dimension += 1
            volume *= period[a]
            step[a] = 2.0 * pi / period[a]
            last[a] = int(extent[a] / step[a])
    inner = dimension - 1  # lines of the lattice run along it
    outer = (inner + 1) % 3
    middle = (inner + 2) % 3
    half = last[inner]
    length = 2 * half + 1
    along_inner = _tabulate(h[:, inner] * step[inner], half, True, _LANES)
    along_outer = _tabulate(h[:, outer] * step[outer], last[outer], False, 0)
    along_middle = _tabulate(h[:, middle] * step[middle], last[middle], True, 0)
    phases = _tabulate(np.array([mean[inner] * step[inner]]), half, True, _LANES)
    polynomial = np.empty(degree + 1)
    plane = np.empty((degree + 1, degree + 1))
    orders = higher_orders(small, degree, outer, middle, inner)
    room = length + _LANES
    line = _Line(
        np.empty(room), np.empty(room), np.empty(room), np.empty(room),
        np.empty(room), np.empty(room), np.empty(room), np.empty(room),
    )  # fmt: skip
    exponent, turned, size, reach, ball = line.exponent, line.turned, line.size, line.reach, line.ball
    start, turn, dx = np.empty(h.shape[0]), np.empty((2, h.shape[0])), h[:, inner] * step[inner]
    t, w, k = np.empty(capacity), np.empty(capacity), np.zeros((capacity if keep else 0, 3))
    sii = S[inner, inner]
    kk = step[inner]
    largest = _ball_envelope(0.0, r, dimension) if dimension == 1 else _ball_envelope(1e-300, r, dimension)
    lowest = max(log(threshold * volume / largest), -60.0)
    n = 0
    decade = 0.0
    for n1 in range(last[outer] + 1):
        k1 = n1 * step[outer]
        if small.shape[0] > 0:
            in_plane(orders, k1, plane)
        for n2 in range(-last[middle] if n1 > 0 else 0, last[middle] + 1):
            k2 = n2 * step[middle]
            m2 = n2 + last[middle]
            half_line = n1 == 0 and n2 == 0
            t2 = k1 * k1 + k2 * k2
            floor = lowest
            if t2 > 0.0:  # no point of this line is nearer to 0
                floor = max(floor, log(threshold * volume / _ball_envelope(sqrt(t2), r, dimension)))
            constant = -0.5 * (
                S[outer, outer] * k1 * k1 + 2.0 * S[outer, middle] * k1 * k2 + S[middle, middle] * k2 * k2
            )
            linear = -(S[inner, outer] * k1 + S[inner, middle] * k2)
            low = half if half_line else 0
            high = length
            if sii > 0.0:  # where the Gaussian factor alone is above the threshold
                centre = linear / sii
                square = centre * centre + 2.0 * (constant - floor) / sii
                if square < 0.0:
                    continue
                low = max(low, half + int(np.ceil((centre - sqrt(square)) / kk)))
                high = min(high, half + int(np.floor((centre + sqrt(square)) / kk)) + 1)
                if high <= low:
                    continue
            elif constant < floor:
                continue
            used = high - low
            count = (used + _LANES - 1) // _LANES * _LANES
            offset = float(low - half)
            for j in range(h.shape[0]):
                start[j] = h[j, outer] * k1 + h[j, middle] * k2 + offset * dx[j]
                s1, c1 = along_outer.sin[j, n1], along_outer.cos[j, n1]
                s2, c2 = along_middle.sin[j, m2], along_middle.cos[j, m2]
                turn[0, j] = s1 * c2 + c1 * s2
                turn[1, j] = c1 * c2 - s1 * s2
            _multiply_columns(line, along_inner, low, count, start, turn, dx)
            phase = mean[outer] * k1 + mean[middle] * k2
            phase_c = cos(phase)
            phase_s = sin(phase)
            line_s = phases.sin[0, low : low + count]
            line_c = phases.cos[0, low : low + count]
            for i in range(count):
                k3 = (i + offset) * kk
                exponent[i] = constant + k3 * (linear - 0.5 * sii * k3)
                turned[i] = phase_c * line_c[i] - phase_s * line_s[i]
                size[i] = sqrt(t2 + k3 * k3)
            if small.shape[0] > 0:
                along_line(plane, k2, kk, polynomial)
                for i in range(count):
                    reach[i] = polynomial[degree]
                for d in range(degree - 1, -1, -1):  # Horner's rule for the whole line: in lanes
                    coefficient = polynomial[d]
                    for i in range(count):
                        reach[i] = reach[i] * (i + offset) + coefficient
                for i in range(count):
                    exponent[i] += reach[i]
            for i in range(count):
                reach[i] = exponential(exponent[i]) if exponent[i] > floor else 0.0
            if dimension == 3:  # _ball_envelope in lanes
                for i in range(count):
                    x = size[i]
                    ball[i] = min(largest, 4.0 * pi * (1.0 + r * x) / (x * x * x))
            else:
                for i in range(count):
                    ball[i] = _ball_envelope(size[i], r, dimension)
            for i in range(count):
                ball[i] *= reach[i] / volume
                turned[i] *= 2.0 * reach[i] * line.numerator[i] / (line.denominator[i] * volume)
            if half_line and low == half:
                turned[0] *= 0.5  # k = 0 has no twin
            for i in range(used):
                term = ball[i]
                least = threshold * line.bound[i]
                if term < least or n == capacity:
                    continue
                if term < 10.0 * least:
                    decade += (turned[i] * term * volume / reach[i]) ** 2
                t[n] = size[i]
                w[n] = turned[i]
                if keep:
                    k[n, outer] = k1
                    k[n, middle] = k2
                    k[n, inner] = (i + offset) * kk
                n += 1
    return Lattice(t[:n], w[:n], k[: n if keep else 0], volume, sqrt(decade))


@kernel()
def build(radius: float, frame: PrincipalLaw, accuracy: Accuracy, keep: bool) -> Lattice:
    """The lattice of a law for radii up to `radius`, mm; of volume 0 where it would have too many points.

    keep: whether its k are wanted too.
    """
    folded = fold_small(frame.S, frame.h, accuracy.threshold)
    rest = PrincipalLaw(
        frame.sigma, frame.mean, folded.S, folded.long, frame.away, frame.axes, frame.dimension, frame.offset
    )
    reach = reach_of(rest, accuracy.aliasing)
    period = np.zeros(3)
    volume = 1.0
    for a in range(frame.dimension):
        period[a] = radius + max(fabs(frame.mean[a]), frame.away[a]) + reach[a]
        volume *= period[a]
    extent = gaussian_extent(radius, volume, folded.S, accuracy.threshold)
    size = box_size(period, extent) if np.isfinite(extent).all() else np.inf
    if size > SMALL_BOX:  # worth the search for the true extent of all factors together
        extent = spectral_extent(radius, volume, rest, accuracy.threshold)
        size = box_size(period, extent)
    if not size < accuracy.largest_box:
        return Lattice(np.empty(0), np.empty(0), np.empty((0, 3)), 0.0, 0.0)
    return lattice_terms(radius, period, extent, frame.mean, folded, accuracy.threshold, int(size) + 2, keep)


# --- transforms of the ball ------------------------------------------------------------------------------------------


@kernel()
def bessel_j01(x: float) -> tuple[float, float]:
    """J0 and J1 at x >= 0, to about 1e-15: the means of cos(x sin a) and sin(a) sin(x sin a) over all angles a.

    The rule of equal steps is exact but for J_n(x), n four times the nodes of a quarter turn: nothing is left of it.
    """
    nodes = 8 + int(x / 3.0)
    first, second = 0.0, 0.0
    for k in range(nodes):
        s = sin(0.5 * pi * (k + 0.5) / nodes)
        first += cos(x * s)
        second += s * sin(x * s)
    return first / nodes, second / nodes


@kernel()
def sines(scale: float, t: Array, s: Array, c: Array) -> None:
    """s, c (n,) = sin, cos of scale t, as :func:`sine_and_cosine`: in lanes."""
    for i in range(t.size):
        s[i], c[i] = sine_and_cosine(scale * t[i])


@kernel()
def balls(r: float, t: Array) -> Array:
    """(n,) transforms B_r(t) of the ball in three dimensions."""
    s = np.empty(t.size)
    out = np.empty(t.size)
    sines(r, t, s, out)
    for i in range(t.size):
        x = r * t[i]
        if x < 1e-2:
            out[i] = 4.0 * pi * r * r * r * (1.0 / 3.0 - x * x / 30.0 + x * x * x * x / 840.0)
        else:
            out[i] = 4.0 * pi * (s[i] - x * out[i]) / (t[i] * t[i] * t[i])
    return out


@kernel()
def flat_balls(r: float, dimension: int, t: Array) -> tuple[Array, Array, Array]:
    """(n,) transforms B_r(t) of the disc or the interval of radius r mm, and their first two derivatives by r."""
    f0, f1, f2 = np.empty(t.size), np.empty(t.size), np.empty(t.size)
    for i in range(t.size):
        x = r * t[i]
        if dimension == 2:
            j0, j1 = bessel_j01(x)
            f0[i] = 2.0 * pi * (r * j1 / t[i] if t[i] > 0.0 else 0.5 * r * r)
            f1[i], f2[i] = 2.0 * pi * r * j0, 2.0 * pi * (j0 - x * j1)
        else:
            f0[i] = 2.0 * (sin(x) / t[i] if t[i] > 0.0 else r)
            f1[i], f2[i] = 2.0 * cos(x), -2.0 * t[i] * sin(x)
    return f0, f1, f2


@kernel()
def ball_sums(r: float, dimension: int, t: Array, w: Array) -> tuple[float, float, float]:
    """sum w B_r(t) and its first two derivatives by r, for the ball, the disc or the interval of radius r mm.

    t (n,) 1/mm, w (n,): the terms of a lattice.
    """
    f0 = 0.0
    f1 = 0.0
    f2 = 0.0
    if dimension == 3:
        s = np.empty(t.size)
        c = np.empty(t.size)
        terms = np.empty(t.size)
        sines(r, t, s, c)
        for i in range(t.size):
            x = r * t[i]
            z = x * x
            near = x < 1e-2
            per = 1.0 / (1.0 if near else t[i])
            sine = s[i]
            turned = x * c[i]
            ball = (sine - turned) * (per * per * per)
            terms[i] = r * r * r * (1.0 / 3.0 - z / 30.0 + z * z / 840.0) if near else ball
            s[i] = r * r * (1.0 - z / 6.0 + z * z / 120.0) if near else r * sine * per
            c[i] = r * (2.0 - 2.0 * z / 3.0) if near else (sine + turned) * per
        f0, f1, f2 = sum_of_products(w, terms), sum_of_products(w, s), sum_of_products(w, c)
        scale = 4.0 * pi
    elif dimension == 2:
        for i in range(t.size):
            j0, j1 = bessel_j01(r * t[i])
            f0 += w[i] * (r * j1 / t[i] if t[i] > 0.0 else 0.5 * r * r)
            f1 += w[i] * r * j0
            f2 += w[i] * (j0 - r * t[i] * j1)
        scale = 2.0 * pi
    else:
        for i in range(t.size):
            f0 += w[i] * (sin(r * t[i]) / t[i] if t[i] > 0.0 else r)
            f1 += w[i] * cos(r * t[i])
            f2 -= w[i] * t[i] * sin(r * t[i])
        scale = 2.0
    return scale * f0, scale * f1, scale * f2


@kernel()
def disc_integral(x: float) -> float:
    """int_0^1 y J1(x y) dy / x, x >= 0: the mean of ``sin(a)^2 (sin z - z cos z) / z^3``, z = x sin a, over all angles,
    by the rule of :func:`bessel_j01`."""
    nodes = 8 + int(x / 3.0)
    total = 0.0
    for k in range(nodes):
        s = sin(0.5 * pi * (k + 0.5) / nodes)
        z = x * s
        z2 = z * z
        near = 1.0 / 3.0 - z2 / 30.0 + z2 * z2 / 840.0
        total += s * s * (near if z < 0.04 else (sin(z) - z * cos(z)) / (z2 * z))
    return total / nodes


@kernel()
def ball_integral(r: float, dimension: int, t: Array, w: Array) -> float:
    """int_0^r sum w B_x(t) dx for the ball, the disc or the interval: the integral of the probability over the radius.

    t (n,) 1/mm, w (n,): the terms of a lattice for radii up to r mm or more.
    """
    flat = 0.0
    if dimension == 2:
        for i in range(t.size):
            flat += w[i] * disc_integral(r * t[i])
        return 2.0 * pi * r * r * r * flat
    if dimension == 1:
        for i in range(t.size):
            half = 0.5 * r * t[i]
            ratio = sin(half) / half if half > 0.0 else 1.0
            flat += w[i] * ratio * ratio
        return r * r * flat
    s = np.empty(t.size)
    c = np.empty(t.size)
    sines(r, t, s, c)
    r2 = r * r
    for i in range(t.size):
        x = r * t[i]
        z = x * x
        near = x < 0.05
        t2 = 1.0 if near else t[i] * t[i]
        inner = r2 * r2 * (1.0 / 12.0 - z / 180.0 + z * z / 6720.0)
        s[i] = inner if near else (2.0 * (1.0 - c[i]) - x * s[i]) / (t2 * t2)
    return 4.0 * pi * sum_of_products(w, s)
