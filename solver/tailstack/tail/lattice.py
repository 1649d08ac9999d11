"""Many small uniform columns at once: the logarithm of their characteristic function as one polynomial.

A manufactured structure has three small sources a fiducial.  Each is nearly Gaussian beside all the others; what it
is not is a short series, and the series of all of them add up.

P(|e| <= r) for e = m + N(0, S) + sum_j h_j u_j, by Poisson summation of the characteristic function.

Lay copies of the law on a lattice of periods L_a.  Integrated over the ball of radius r about 0 their sum is

    sum_n P(|e - n L| <= r) = (1 / (L_1 L_2 L_3)) sum_k phi(k) B_r(|k|),     k_a = 2 pi n_a / L_a

with ``phi(k) = exp(i k'm - k'S k / 2) prod_j sin(k'h_j) / (k'h_j)``, u_j uniform on (-1, 1), and B_r the Fourier
transform of the ball.  (A triangular source is two uniform ones of half the width: the caller splits it.)  The
copies other than the law itself reach the ball only if some ``|e_a - m_a| > L_a - r - |m_a|``.  Uniform laws are
strictly sub-Gaussian (their moment generating function lies below the normal one of equal variance), so with
``L_a = r + |m_a| + c sigma_a`` that has probability below ``2 exp(-c^2/2)`` per axis.  The sum on the right
converges as fast as phi falls; it is cut where an envelope of its terms falls below a threshold.

Axes on which nothing varies are left out (they must come last): the ball becomes a disc or an interval.

The Fourier transform of the ball is ``B_r(t) = 4 pi (sin rt - rt cos rt) / t^3`` for the ball, ``2 pi r J1(rt) / t``
for the disc, ``2 sin(rt) / t`` for the interval; its derivative by r is the transform of the sphere of radius r.
"""

from __future__ import annotations

from math import comb, cos, exp, fabs, log, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel
from .elementary import exponential, sine_and_cosine

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


_REFUSED = -1  # more points than the caller allows
_LANES = 8  # lines are computed to a multiple of this, so that no loop ends in single steps


@kernel()
def _ball_envelope(t: float, r: float, dimension: int) -> float:
    """A decreasing bound of |B_r(t)|, t >= 0."""
    if dimension == 1:
        return min(2.0 * r, 2.0 / t)
    if dimension == 2:
        return min(pi * r * r, 2.2 * r * sqrt(2.0 * pi / (r * t)) / t)
    return min(4.0 / 3.0 * pi * r * r * r, 4.0 * pi * (1.0 + r * t) / (t * t * t))


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
def spectral_extent(r: float, volume: float, sigma: Array, S: Array, h: Array, threshold: float) -> Array:
    """(3,) largest |k_a| at which a term's envelope reaches the threshold, 1/mm; 0 on an axis with sigma = 0.

    The set is star-shaped about 0, with spikes where k is perpendicular to many columns.  Its extent is taken along
    the axes, the cross products of the columns (the spikes) and a spread of other directions.
    """
    dimension = 0
    for a in range(3):
        if sigma[a] > 0.0:
            dimension += 1
    columns = h.shape[0]
    spread = 0
    spikes = 0
    if dimension == 3:
        spread = 32
        spikes = min(columns * (columns - 1) // 2, 400)
    elif dimension == 2:
        spread = 12
        spikes = columns
    extent = np.zeros(3)
    k = np.zeros(3)
    along = np.empty(columns)
    first = 0
    second = 0
    goal = threshold * volume
    for number in range(dimension + spread + spikes):
        k[:] = 0.0
        if number < dimension:
            k[number] = 1.0
        elif number < dimension + spread:
            i = number - dimension
            if dimension == 3:  # Fibonacci points of the half sphere, in units of 1/sigma
                z = (i + 0.5) / spread
                angle = 2.399963229728653 * i
                k[0] = sqrt(1.0 - z * z) * cos(angle) / sigma[0]
                k[1] = sqrt(1.0 - z * z) * sin(angle) / sigma[1]
                k[2] = z / sigma[2]
            else:
                angle = pi * (i + 0.5) / spread
                k[0] = cos(angle) / sigma[0]
                k[1] = sin(angle) / sigma[1]
        elif dimension == 3:
            second += 1
            if second >= columns:
                first += 1
                second = first + 1
            for a in range(3):
                b = (a + 1) % 3
                c = (a + 2) % 3
                k[a] = h[first, b] * h[second, c] - h[first, c] * h[second, b]
        else:
            j = number - dimension - spread
            k[0] = -h[j, 1]
            k[1] = h[j, 0]
        size = sqrt(k[0] * k[0] + k[1] * k[1] + k[2] * k[2])
        if not size > 0.0:
            continue
        k /= size
        quadratic = 0.0
        low = np.inf
        for a in range(3):
            if k[a] != 0.0:
                low = min(low, extent[a] / fabs(k[a]))
            for b in range(3):
                quadratic += k[a] * S[a, b] * k[b]
        for j in range(columns):
            along[j] = fabs(k[0] * h[j, 0] + k[1] * h[j, 1] + k[2] * h[j, 2])
        if low > 0.0 and _beyond(low, quadratic, along, r, dimension, goal):
            continue  # this ray stays inside the box there is
        high = max(2.0 * low, 2.0 / sigma[0])
        while high < 1e9 / sigma[0] and not _beyond(high, quadratic, along, r, dimension, goal):
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
    """Number of lattice points in half of the box that holds every term above the threshold."""
    size = 0.5
    for a in range(3):
        if period[a] > 0.0:
            size *= 2.0 * np.floor(extent[a] * period[a] / (2.0 * pi)) + 1.0
    return size


@kernel()
def _tables(angle: Array, half: int, mirrored: bool, room: int) -> tuple[Array, Array]:
    """sin and cos of i angle_j for 0 <= i <= half, or -half <= i <= half where mirrored: two (K, length + room)
    tables, 0 and 1 in the room behind."""
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
    return sines, cosines


@kernel()
def gaussian_extent(r: float, volume: float, S: Array, threshold: float) -> Array:
    """(3,) largest |k_a| at which the Gaussian factor alone lets a term pass the threshold; inf if S is singular.

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
def lattice_terms(
    period: Array,
    extent: Array,
    r: float,
    mean: Array,
    S: Array,
    h: Array,
    small: Array,
    degree: int,
    threshold: float,
    t_out: Array,
    w_out: Array,
    k_out: Array,
) -> tuple[int, float]:
    """Fill |k| (n,), weights (n,) and, if k_out has rows, k (n, 3); return (n, root sum of squares of the last decade).

    ``sum_i w_i B_r(t_i)`` is the probability: weights hold phi, both of +-k, and 1 / volume.  period, extent (3,): 0
    on an axis that is left out.  The last decade are the terms within a factor of ten of the threshold: what was
    left out is of their kind, smaller, and of either sign.  n = -1 when the terms do not fit in t_out.  small (s, 3):
    columns whose Gaussian part is already in S, and the degree of their series: see :func:`fold_small`.
    """
    columns = h.shape[0]
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
    keep = k_out.shape[0] > 0
    capacity = t_out.size
    inner = dimension - 1
    outer = (inner + 1) % 3
    middle = (inner + 2) % 3
    # Along a line sin(a + n b) comes from the addition theorem and tables of sin(n b): loops the compiler vectorises.
    half = last[inner]
    length = 2 * half + 1
    table_s, table_c = _tables(h[:, inner] * step[inner], half, True, _LANES)
    outer_s, outer_c = _tables(h[:, outer] * step[outer], last[outer], False, 0)
    middle_s, middle_c = _tables(h[:, middle] * step[middle], last[middle], True, 0)
    sway = np.array([mean[inner] * step[inner]])
    mean_s, mean_c = _tables(sway, half, True, _LANES)
    beyond = np.empty(degree + 1)
    plane = np.empty((degree + 1, degree + 1))
    folded = small.shape[0] > 0
    orders = higher_orders(small, degree, outer, middle, inner)
    numerator = np.empty(length + _LANES)
    denominator = np.empty(length + _LANES)
    bound = np.empty(length + _LANES)
    exponent = np.empty(length + _LANES)
    turned = np.empty(length + _LANES)
    size = np.empty(length + _LANES)
    reach = np.empty(length + _LANES)
    ball = np.empty(length + _LANES)
    sii = S[inner, inner]
    kk = step[inner]
    largest = _ball_envelope(0.0, r, dimension) if dimension == 1 else _ball_envelope(1e-300, r, dimension)
    lowest = max(log(threshold * volume / largest), -60.0)
    n = 0
    decade = 0.0
    for n1 in range(last[outer] + 1):
        k1 = n1 * step[outer]
        if folded:
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
                room = centre * centre + 2.0 * (constant - floor) / sii
                if room < 0.0:
                    continue
                room = sqrt(room)
                low = max(low, half + int(np.ceil((centre - room) / kk)))
                high = min(high, half + int(np.floor((centre + room) / kk)) + 1)
                if high <= low:
                    continue
            elif constant < floor:
                continue
            used = high - low
            count = (used + _LANES - 1) // _LANES * _LANES
            for i in range(count):
                numerator[i] = 1.0
                denominator[i] = 1.0
                bound[i] = 1.0
            offset = float(low - half)
            for j in range(columns):
                start = h[j, outer] * k1 + h[j, middle] * k2
                dx = h[j, inner] * kk
                start_s = outer_s[j, n1] * middle_c[j, m2] + outer_c[j, n1] * middle_s[j, m2]
                start_c = outer_c[j, n1] * middle_c[j, m2] - outer_s[j, n1] * middle_s[j, m2]
                line_s = table_s[j, low : low + count]
                line_c = table_c[j, low : low + count]
                start += offset * dx
                for i in range(count):
                    x = start + i * dx
                    s = start_s * line_c[i] + start_c * line_s[i]
                    near = fabs(x) < 1e-4
                    numerator[i] *= 1.0 - x * x / 6.0 if near else s
                    denominator[i] *= 1.0 if near else x
                    bound[i] *= max(1.0, fabs(x))
            phase = mean[outer] * k1 + mean[middle] * k2
            phase_c = cos(phase)
            phase_s = sin(phase)
            line_s = mean_s[0, low : low + count]
            line_c = mean_c[0, low : low + count]
            for i in range(count):
                k3 = (i + offset) * kk
                exponent[i] = constant + k3 * (linear - 0.5 * sii * k3)
                turned[i] = phase_c * line_c[i] - phase_s * line_s[i]
                size[i] = sqrt(t2 + k3 * k3)
            if folded:
                along_line(plane, k2, kk, beyond)
                for i in range(count):
                    place = i + offset
                    power = beyond[degree]
                    for d in range(degree - 1, -1, -1):
                        power = power * place + beyond[d]
                    exponent[i] += power
            for i in range(count):
                reach[i] = exponential(exponent[i]) if exponent[i] > floor else 0.0
            if dimension == 3:  # _ball_envelope in lanes
                for i in range(count):
                    t = size[i]
                    ball[i] = min(largest, 4.0 * pi * (1.0 + r * t) / (t * t * t))
            else:
                for i in range(count):
                    ball[i] = _ball_envelope(size[i], r, dimension)
            for i in range(count):
                ball[i] *= reach[i] / volume
                turned[i] *= 2.0 * reach[i] * numerator[i] / (denominator[i] * volume)
            if half_line and low == half:
                turned[0] *= 0.5  # k = 0 has no twin
            for i in range(used):
                term = ball[i]
                least = threshold * bound[i]
                if term < least:
                    continue
                if n >= capacity:
                    return _REFUSED, 0.0
                if term < 10.0 * least:
                    decade += (turned[i] * term * volume / reach[i]) ** 2
                t_out[n] = size[i]
                w_out[n] = turned[i]
                if keep:
                    k_out[n, outer] = k1
                    k_out[n, middle] = k2
                    k_out[n, inner] = (i + offset) * kk
                n += 1
    return n, sqrt(decade)


@kernel()
def bessel_j01(x: float) -> tuple[float, float]:
    """J0 and J1 at x >= 0: Miller's backward recurrence, Hankel's expansion beyond 30 (both to about 1e-15)."""
    if x < 1e-8:
        return 1.0, 0.5 * x
    if x < 30.0:
        order = 2 * int((x + 36.0) / 2.0)
        above = 0.0
        here = 1e-200
        even = 0.0
        for j in range(order, 0, -1):
            below = 2.0 * j / x * here - above
            above = here
            here = below
            if j % 2 == 1 and j > 1:
                even += here
        norm = here + 2.0 * even
        return here / norm, above / norm
    out0 = 0.0
    out1 = 0.0
    for nu in range(2):
        mu = 4.0 * nu * nu
        p = 1.0
        q = 0.0
        term = 1.0
        for j in range(1, 24):
            term *= (mu - (2.0 * j - 1.0) ** 2) / (8.0 * j * x)
            sign = 1.0 if (j // 2) % 2 == 0 else -1.0
            if j % 2 == 1:
                q += sign * term
            else:
                p += sign * term
            if fabs(term) < 1e-17:
                break
        angle = x - 0.5 * nu * pi - 0.25 * pi
        value = sqrt(2.0 / (pi * x)) * (p * cos(angle) - q * sin(angle))
        if nu == 0:
            out0 = value
        else:
            out1 = value
    return out0, out1


@kernel()
def sines(scale: float, t: Array, s: Array, c: Array) -> None:
    """s, c (n,) = sin, cos of scale t, as :func:`sine_and_cosine`: in lanes."""
    for i in range(t.size):
        s[i], c[i] = sine_and_cosine(scale * t[i])


@kernel()
def _ball(r: float, t: Array, w: Array, s: Array, c: Array) -> tuple[float, float, float]:
    """sum w B_r(t) / (4 pi) and its first two derivatives by r; s, c: sin and cos of r t, which are overwritten."""
    terms = np.empty(t.size)
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
    return sum_of_products(w, terms), sum_of_products(w, s), sum_of_products(w, c)


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
def ball_sums(r: float, dimension: int, t: Array, w: Array) -> tuple[float, float, float]:
    """sum w B_r(t) and its first two derivatives by r, for the ball, the disc or the interval of radius r."""
    f0 = 0.0
    f1 = 0.0
    f2 = 0.0
    if dimension == 3:
        s = np.empty(t.size)
        c = np.empty(t.size)
        sines(r, t, s, c)
        f0, f1, f2 = _ball(r, t, w, s, c)
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
def _integral(r: float, t: Array, w: Array, s: Array, c: Array) -> float:
    """s is overwritten."""
    r2 = r * r
    for i in range(t.size):
        x = r * t[i]
        z = x * x
        near = x < 0.05
        t2 = 1.0 if near else t[i] * t[i]
        inner = r2 * r2 * (1.0 / 12.0 - z / 180.0 + z * z / 6720.0)
        s[i] = inner if near else (2.0 * (1.0 - c[i]) - x * s[i]) / (t2 * t2)
    return sum_of_products(w, s)


@kernel()
def ball_integral(r: float, t: Array, w: Array) -> float:
    """int_0^r sum w B_x(t) dx in three dimensions: the integral of the probability over the radius."""
    s = np.empty(t.size)
    c = np.empty(t.size)
    sines(r, t, s, c)
    return 4.0 * pi * _integral(r, t, w, s, c)
