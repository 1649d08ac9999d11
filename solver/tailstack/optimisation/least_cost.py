"""The cheapest half-widths within limits in closed form, compiled.

A limit in closed form is Pearson's form of moments that are polynomials in the half-widths; the squares of all limits
are taken to be linear in the squares of the half-widths, as a mean square is, again where that led until it is settled.
That programme is solved by its dual: at what the limits charge for the square of each half-width, each is the cheapest
by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..tail.approximation import pearson_slopes, pearson_square
from .mixture import solve_positive
from .prices import Price

AIM = 4e-6  # of a limit: how far below it the values are brought
LEAST = 1e-6  # of a limit: a standard deviation that every law has, as the form has no value without any
EXACT, TRIES = 1e-9, 50  # of a limit: how far the programme is solved, and how many steps that may take
LARGEST = 300.0  # logarithm of a multiplier at which everything is at its least
MOST_STEPS = 40
_MET = 1e-11  # of a multiplier, relative, to which a single limit is met
_TINY = 1e-20  # of a complex step
# What each moment grows as a power of: mean (3,), covariance (3, 3), what columns add to c3 (3, 3), covariance of what
# is drawn again (3, 3), and what columns add to c2 and to c3
DEGREES = np.repeat([1.0, 2.0, 4.0, 2.0, 4.0, 6.0], [3, 9, 9, 9, 1, 1])


class PriceCurves(NamedTuple):
    """Prices as arrays (k,): ``weight h^-exponent``, or ``weight exp(-h / scale)`` where ``exponential``."""

    exponential: NDArray[np.bool_]
    weight: Array
    exponent: Array
    scale: Array

    def only(self, chosen: NDArray[np.bool_]) -> PriceCurves:
        return PriceCurves(self.exponential[chosen], self.weight[chosen], self.exponent[chosen], self.scale[chosen])


def curves_of(prices: Sequence[Price]) -> PriceCurves:
    """Those of prices; of grades the power law through them."""
    exponential = np.array([price.curve == "exponential" for price in prices])
    rows = [(price.weight, price.exponent, price.scale) for price in prices]
    return PriceCurves(exponential, *np.array(rows, dtype=np.float64).reshape(-1, 3).T.copy())


@kernel()
def log_costs(curves: PriceCurves, half_width: Array) -> Array:
    """(k,) logarithm of the cost of each half-width (k,) > 0."""
    fall = np.where(curves.exponential, half_width / curves.scale, curves.exponent * np.log(half_width))
    return np.log(curves.weight) - fall


@kernel()
def total_cost(curves: PriceCurves, half_width: Array) -> float:
    """Of all half-widths (k,) > 0."""
    return float(np.exp(log_costs(curves, half_width)).sum())


@kernel()
def cheapest_widths(curves: PriceCurves, charge: Array, lower: Array, upper: Array) -> Array:
    """(k,) least ``cost(h) + charge h^2`` in [lower, upper], charge (k,) >= 0; both terms are convex in h."""
    out = upper.copy()
    for k in range(out.size):
        if charge[k] > 0.0:
            scale, exponent = curves.scale[k], curves.exponent[k]
            part = log(curves.weight[k] / 2.0) - log(charge[k])
            if curves.exponential[k]:
                best = scale * _product_logarithm(part - 2.0 * log(scale))
            else:
                best = exp((log(exponent) + part) / (exponent + 2.0))
            out[k] = min(max(best, lower[k]), upper[k])
    return out


@kernel()
def _product_logarithm(y: float) -> float:
    """x with ``x + log x = y``, Lambert's W of exp(y): the sum is concave, Newton's steps come from below."""
    x = y if y > 1.0 else exp(y)
    for _ in range(20):
        step = x * (1.0 + y - log(x)) / (1.0 + x) - x if x > 0.0 else 0.0
        x += step
        if abs(step) <= 1e-15 * x:
            break
    return x


class Widths(NamedTuple):
    """K half-widths that are to be chosen."""

    curves: PriceCurves
    lower: Array  # (K,)
    upper: Array  # (K,)


class Programme(NamedTuple):
    """The least cost with ``fixed + by_square h^2 <= 1`` for each of T limits."""

    widths: Widths
    fixed: Array  # (T,)
    by_square: Array  # (T, K)


@kernel()
def _choose(programme: Programme, multipliers: Array) -> Array:
    """(K,) half-widths, the cheapest at what the multipliers (T,) of the limits charge for their squares."""
    charge, widths = np.maximum(multipliers @ programme.by_square, 0.0), programme.widths
    return cheapest_widths(widths.curves, charge, widths.lower, widths.upper)


@kernel()
def _excess(programme: Programme, half_width: Array) -> Array:
    """(T,) beyond each limit."""
    return programme.fixed + programme.by_square @ half_width**2 - 1.0


@kernel()
def _falling(programme: Programme, half_width: Array, multipliers: Array) -> Array:
    """(K,) by how much the squares of the half-widths that are chosen fall for a little more charge; at a bound they
    stay."""
    curves, lower, upper = programme.widths
    charge, steep = np.maximum(multipliers @ programme.by_square, 0.0), curves.exponent * (curves.exponent + 1.0)
    scale = np.where(curves.exponential, curves.scale, half_width)
    bend = np.exp(log_costs(curves, half_width)) / scale**2 * np.where(curves.exponential, 1.0, steep)
    return np.where((half_width > lower) & (half_width < upper), 4.0 * half_width**2 / (bend + 2.0 * charge), 0.0)


@kernel()
def _meet(programme: Programme, t: int, multipliers: Array, near: float) -> None:
    """Put one multiplier where its limit, which is broken without it, is kept at the others as they are, in place: by
    Newton's method for its logarithm, within what is known to be too little and too much.  near: it may be there."""
    if _excess(programme, programme.widths.lower)[t] >= 0.0:
        multipliers[t] = exp(LARGEST)
        return
    at, reach = log(near) if near > 0.0 else log_costs(programme.widths.curves, programme.widths.upper).max(), 4.0
    low, high = -np.inf, np.inf
    own = programme.by_square[t]
    for _ in range(4 * TRIES):
        multipliers[t] = exp(at)
        half_width = _choose(programme, multipliers)
        over = programme.fixed[t] + own @ half_width**2 - 1.0
        if over > 0.0:
            low = at
        else:
            high = at
        slope = multipliers[t] * (own**2 @ _falling(programme, half_width, multipliers))
        step = over / slope if slope > 0.0 else np.inf
        if abs(step) <= _MET or high - low <= _MET or low >= LARGEST:
            break
        if low < at + step < high and abs(step) <= reach:
            at += step
        elif high - low < np.inf:
            at = 0.5 * (low + high)
        else:
            at += reach if over > 0.0 else -reach
            reach *= 2.0


@kernel()
def _dual(programme: Programme, multipliers: Array) -> float:
    half_width = _choose(programme, multipliers)
    return float(total_cost(programme.widths.curves, half_width) + multipliers @ _excess(programme, half_width))


@kernel()
def _meet_all(programme: Programme, multipliers: Array) -> None:
    """Newton's method in the dual with what is not above 0 held at 0 (Bertsekas 1982, SIAM Journal on Control and
    Optimization 20, 221-246), in place."""
    for _ in range(TRIES):
        half_width = _choose(programme, multipliers)
        excess = _excess(programme, half_width)
        free = (multipliers > 0.0) | (excess > 0.0)
        own, step = programme.by_square * free.reshape(-1, 1), (excess * free).reshape(1, -1)
        bend = (own * _falling(programme, half_width, multipliers)) @ own.T
        if np.abs(step).max() <= EXACT or not bend.any():
            return
        solve_positive(bend + 1e-9 * np.trace(bend) * np.eye(free.size), step)
        here, part = _dual(programme, multipliers), 1.0
        moved = np.maximum(multipliers + step[0], 0.0)
        while _dual(programme, moved) < here + 1e-4 * (excess @ (moved - multipliers)) and part > 1e-15:
            part /= 2.0
            moved = np.maximum(multipliers + part * step[0], 0.0)
        multipliers[:] = moved


@kernel()
def solve_programme(programme: Programme, multipliers: Array) -> Array:
    """(K,) half-widths; the least where they do not keep the limits.

    multipliers (T,): those that are above 0 are sought there first; what was found is left in them.
    """
    near = multipliers.copy()
    multipliers[:] = 0.0
    for met in range(multipliers.size):
        excess = _excess(programme, _choose(programme, multipliers))
        if excess.max() <= EXACT:
            break
        t = int(excess.argmax())
        _meet(programme, t, multipliers, near[t])
        if met > 0:
            _meet_all(programme, multipliers)
    return _choose(programme, multipliers)


class ClosedLimits(NamedTuple):
    """T limits by K half-widths, mm or the unit of each measure; of two vectors the one that varies more.

    Pooled, everything is held; of units or mountings, what is drawn again is the shot.
    """

    fixed: Array  # (T, 32) moments, as ``DEGREES`` has them, without the half-widths
    added: Array  # (T, K, 32) what each half-width adds, per power of it
    normal: Array  # (T,) quantiles of the standard normal law, of what is held
    normal_of_shots: Array  # (T,)
    nested: NDArray[np.bool_]  # (T,)
    limit: Array  # (T,)
    level: Array  # (T,) of the logarithm of the square, as read
    tilt: Array  # (T, K)

    def anchor(self, logs: Array, ratios: Array) -> None:
        """Lead each through its value over its limit (T,) as read where the squares had these logarithms (T,); NaN: it
        was not read."""
        self.level[:] += np.where(np.isnan(ratios), 0.0, 2 * np.log(np.maximum(ratios, LEAST)) - logs)

    def turn(self, t: int, half_width: Array, slopes: Array) -> None:
        """Give one, at half-widths (K,), the slopes (K,) that were read there of the logarithm of its value."""
        moved = 2 * slopes - log_squares(self, half_width)[1][t]
        self.tilt[t] += moved
        self.level[t] -= float(moved @ np.log(half_width))


@kernel()
def _square(moments: NDArray[np.complex128], normal: float, normal_of_shots: float, nested: bool) -> complex:
    """Square of a value in closed form, of its moments (32,).

    Of units, or mountings, the offset d has E[dd'] = D where |d| is at its quantile (``tail/approximation.py``, Q = I),
    and R^2 is Pearson's form of the shots at D.
    """
    m, add2, add3 = moments[:3], moments[30], moments[31]
    c, shape, shot = moments[3:12].reshape(3, 3), moments[12:21].reshape(3, 3), moments[21:30].reshape(3, 3)
    c1, c2, c3 = 0j, add2, add3
    square, cm = np.empty((3, 3), np.complex128), np.empty(3, np.complex128)
    for a in range(3):
        cm[a] = c[a, 0] * m[0] + c[a, 1] * m[1] + c[a, 2] * m[2]
        c1 += c[a, a] + m[a] * m[a]
        c2 += 2.0 * m[a] * cm[a]
        c3 += 3.0 * cm[a] * cm[a]
        for b in range(3):
            square[a, b] = c[a, 0] * c[0, b] + c[a, 1] * c[1, b] + c[a, 2] * c[2, b]
            c2 += c[a, b] * c[a, b]
            c3 += square[a, b] * c[a, b] + shape[a, b] * (c[a, b] + m[a] * m[b])
    held: complex = pearson_square(c1, c2, c3, normal)
    if not nested:
        return held
    by_c2, by_c3 = pearson_slopes(c2, c3, normal)
    trace, d1, d2, s1, s2, s3 = 0j, 0j, 0j, 0j, 0j, 0j
    for a in range(3):
        s1 += shot[a, a]
        for b in range(3):
            cube = square[a, 0] * c[0, b] + square[a, 1] * c[1, b] + square[a, 2] * c[2, b]
            twice = shot[a, 0] * shot[0, b] + shot[a, 1] * shot[1, b] + shot[a, 2] * shot[2, b]
            offset = c[a, b] + m[a] * m[b] + 3.0 * by_c3 * cube
            offset += 2.0 * by_c2 * (square[a, b] + cm[a] * m[b] + m[a] * cm[b] + shape[a, b] / 3.0)
            trace += offset if a == b else 0j
            d1 += shot[a, b] * offset
            d2 += twice * offset
            s2 += shot[a, b] * shot[a, b]
            s3 += twice * shot[a, b]
    length = held / trace
    of_unit: complex = pearson_square(s1 + held, s2 + 2.0 * length * d1, s3 + 3.0 * length * d2, normal_of_shots)
    return of_unit


@kernel()
def log_squares(closed: ClosedLimits, half_width: Array) -> tuple[Array, Array]:
    """Logarithms (T,) of the squares of all values over their limits at half-widths (K,), and their slopes (T, K) by
    the logarithms of the half-widths: by complex steps (Squire and Trapp 1998, SIAM Review 40, 110-112)."""
    count, own = closed.tilt.shape
    logs, slopes = np.empty(count), np.empty((count, own))
    powers, moments = np.empty((own, DEGREES.size)), np.empty(DEGREES.size, np.complex128)
    for k in range(own):
        powers[k] = half_width[k] ** DEGREES
    widths = np.log(half_width)
    for t in range(count):
        parts = closed.added[t] * powers
        base = closed.fixed[t] + parts.sum(axis=0)
        for k in range(own):
            for i in range(DEGREES.size):
                moments[i] = complex(base[i], _TINY * DEGREES[i] * parts[k, i])
            found = np.log(_square(moments, closed.normal[t], closed.normal_of_shots[t], closed.nested[t]))
            slopes[t, k] = found.imag / _TINY + closed.tilt[t, k]
            logs[t] = found.real - 2.0 * log(closed.limit[t]) + closed.level[t] + closed.tilt[t] @ widths
    return logs, slopes


@kernel()
def find_cheapest(closed: ClosedLimits, widths: Widths, half_width: Array, settled: float) -> tuple[Array, Array]:
    """(half-widths (K,) of the least cost within all limits, multipliers (T,), above 0 of those that hold it up), from
    some half-widths on, until a step changes none by more than ``settled``, relative.

    From the second step on by the mixture of two that leaves least of both (Anderson 1965, Journal of the ACM 12,
    547-560): such steps creep, and some swing.
    """
    multipliers, moved = np.zeros(closed.limit.size), np.zeros(half_width.size)
    ended = end = np.log(half_width)
    for step in range(MOST_STEPS):
        logs, slopes = log_squares(closed, half_width)
        fixed, by_square = np.exp(logs) / (1.0 - AIM) ** 2, np.empty(slopes.shape)
        for t in range(fixed.size):
            linear = 0.5 * fixed[t] * slopes[t]
            by_square[t] = linear / half_width**2
            fixed[t] -= linear.sum()
        end = np.log(solve_programme(Programme(widths, fixed, by_square), multipliers))
        move = end - np.log(half_width)
        if np.abs(move).max() <= settled:
            break
        other, back = move - moved, 0.0
        if step > 0:
            back = float(move @ other) / max(float(other @ other), 1e-300)
        half_width = np.minimum(np.maximum(np.exp(end - back * (end - ended)), widths.lower), widths.upper)
        ended, moved = end, move
    return np.exp(end), multipliers
