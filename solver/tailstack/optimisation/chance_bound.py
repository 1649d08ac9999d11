"""A quantile from a mean square: what is proven of a sum where, of one part, no more is known than how large it is.

X is a sum of normal, uniform and triangular laws about 0.  Y, independent of it, is another, of which only a mean
square is known, ``E Y' W Y >= m``.  ``g(y) = P(|X + y| <= r)`` is even and log-concave (Prekopa 1973), so it falls
along every ray, and Y may be made smaller by a factor until its mean square is m: that only raises E g(Y).  The fourth
cumulants of such laws are at most 0, so ``t = Y' W Y`` then has ``E t = m`` and ``E t^2 <= 3 m^2``, and

    g(y) <= a - b t + c t^2 at every y, with c >= 0:    P(|X + Y| <= r) <= a - b m + 3 c m^2.

*At every y.*  log g lies below its tangents.  Of u with ``u' u = t``, one at each direction of a net and each radius
bounds g about there by ``exp(alpha - s |u|)``, which is convex in t: between two radii it is below its chord.
a, b and c are the best for these chords (a linear programme), raised by what they lack.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..tail.declared import LinearLaw, lattice_columns
from ..tail.lattice import Accuracy, balls, build, on_principal_axes, sines, sum_of_products

ACCURACY = Accuracy(5e-9, 1e-8, 6e4)
ERROR, SLOPES = 1e-7, 3.0  # absolute, of a chance; times what the terms tell of it, as slopes are off by as much
FIRST, LAST, RATIO = 1e-2, 4.0, 1.4  # t at the first radius by m, and at the last; from one to the next
FAR, AWAY, LEAST = 10.0, 0.6, 0.02  # t by m, distance from 0 by the quantile, and g, up to where tangents touch
TRIED, SURE = 8, 0.99  # radii, and how much of the way to where two others promise p
ENOUGH = 0.01  # of what m takes from the chance, by which it may be less than p
LARGEST, MOST = 0.25, 2.0  # m, beyond which more proves no more; radius by the least quantile


def raise_quantile(
    law: LinearLaw, p: float, least_mm: float, known: Callable[[Array], float], net: tuple[Array, NDArray[np.int64]]
) -> float:
    """mm that the p-quantile of |X + Y| is not below, X of this law, which is about 0, alone not below ``least_mm``.

    known: m of W (3, 3) 1/mm^2; net: directions (n, 3) and triangles between them and their opposites.  No more than
    ``least_mm`` is said of a law that would be sampled.
    """
    frame = on_principal_axes(np.zeros(3), law.covariance, lattice_columns(law)[0])
    lattice = build(least_mm, frame, ACCURACY, True)
    if not lattice.volume or frame.dimension < 3:
        return least_mm
    here = lattice.w * balls(least_mm, lattice.t)  # g(y) is the sum of them times the cosines of k . y
    weight = (lattice.k.T * here) @ lattice.k / 2  # g falls by y' W y about 0
    if np.linalg.eigvalsh(weight)[0] <= 0 or (whole := known(frame.axes @ weight @ frame.axes.T)) <= ERROR:
        return least_mm
    m = min(whole, LARGEST)
    below = least_mm * (1 - 1e-3)
    steep = (here.sum() - (lattice.w * balls(below, lattice.t)).sum()) / (least_mm - below)
    most_mm = float(min(least_mm + m / steep, MOST * least_mm))
    unit = np.linalg.inv(np.linalg.cholesky(weight)).T  # y of u
    away_mm = min(AWAY * least_mm, np.sqrt(FAR * m * np.linalg.eigvalsh(unit @ unit.T)[2]))
    if not (lattice := build(most_mm, frame._replace(away=np.full(3, away_mm)), ACCURACY, True)).volume:
        return least_mm
    error = ERROR + SLOPES * lattice.decade
    t = FIRST * m * RATIO ** np.arange(np.ceil(np.log(LAST / (FIRST * m)) / np.log(RATIO)) + 1)
    kites = _kites(*net)

    def alone(r: float) -> float:
        return float((lattice.w * balls(r, lattice.t)).sum()) + error

    def together(r: float) -> float:
        terms = lattice.w * balls(r, lattice.t)
        pieces = list(_chords(lattice.k, terms, unit, net[0], kites, np.sqrt(t), away_mm, error))
        low, high = (np.array(each) for each in zip(*pieces, strict=True))
        return _most_within(m, t, alone(r), low, high)

    over_mm, over = most_mm, together(most_mm)
    if over <= p:
        return most_mm
    found_mm, found = least_mm, alone(least_mm) - (alone(most_mm) - over)  # m takes nearly the same at a smaller radius
    for _ in range(TRIED):
        if found >= p:
            break
        r = found_mm + SURE * (over_mm - found_mm) * (p - found) / (over - found)
        if (chance := together(r)) > p:
            over_mm, over, found = r, chance, (found + p) / 2  # so the next is nearer to the other (Illinois)
            continue
        found_mm, found = r, chance
        if p - found <= ENOUGH * (alone(r) - found):
            break
    return found_mm


def _kites(directions: Array, faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """(Q,) which of directions (n, 3) is at one corner, and all corners (Q, 4, 3), of the thirds of the faces (F, 3)
    about each of theirs, or of their opposites."""
    corners = np.concatenate([directions, -directions])[faces]
    edges, middle = corners + np.roll(corners, -1, axis=1), corners.sum(axis=1, keepdims=True)
    kites = np.stack([corners, edges, np.roll(edges, 1, axis=1), np.broadcast_to(middle, corners.shape)], axis=2)
    kites *= np.where(faces < len(directions), 1.0, -1.0)[:, :, None, None]
    kites /= np.linalg.norm(kites, axis=3, keepdims=True)
    return (faces % len(directions)).ravel(), kites.reshape(-1, 4, 3)


def _chords(
    k: Array,
    terms: Array,
    unit: Array,
    directions: Array,
    kites: tuple[NDArray[np.int64], Array],
    radii: Array,
    away_mm: float,
    error: float,
) -> Iterator[tuple[float, float]]:
    """Between each two radii of u the ends of a chord, over the square of the radius, above g.

    terms (n,) of wave vectors k (n, 3); unit (3, 3): y of u; directions (D, 3) and kites: of :func:`_kites`.
    """
    owner, corners = kites
    waves = np.ascontiguousarray((k @ unit).T)
    alpha, rate = np.full(len(owner), np.log(terms.sum() + error)), np.zeros(len(owner))
    near = np.linalg.norm(directions @ unit.T, axis=1)
    for begin, end in pairwise(radii):
        at = (begin + end) / 2
        told = np.zeros((len(directions), 4))
        if (touched := at * near <= away_mm).any():
            told[touched] = sum_waves(waves, terms, at * directions[touched])
        value = np.maximum(told[:, 0] + error, LEAST)
        slope = told[:, 1:] / value[:, None]
        falls = -np.einsum("qa,qva->qv", slope[owner], corners).max(axis=1)
        good = (value[owner] > LEAST) & (falls > 0)  # elsewhere the tangent before holds as well
        offset = np.log(value) - at * (slope * directions).sum(axis=1)
        alpha, rate = np.where(good, offset[owner], alpha), np.where(good, falls, rate)
        yield float(np.exp(alpha - rate * begin).max()), float(np.exp(alpha - rate * end).max())


@kernel(nogil=True)
def sum_waves(waves: Array, terms: Array, points: Array) -> Array:
    """(P, 4): at each of P points (P, 3) the sum of terms (n,) times the cosines of ``wave . point``, waves (3, n), and
    the slopes of this sum by the point."""
    count = len(terms)
    found, seen = np.empty((len(points), 4)), np.empty((4, count))
    phase, sine = np.empty(count), np.empty(count)
    for j in range(len(points)):
        for i in range(count):
            phase[i] = waves[0, i] * points[j, 0] + waves[1, i] * points[j, 1] + waves[2, i] * points[j, 2]
        sines(1.0, phase, sine, seen[0])
        for a in range(3):
            for i in range(count):
                seen[a + 1, i] = -waves[a, i] * sine[i]
        for a in range(4):
            found[j, a] = sum_of_products(terms, seen[a])
    return found


def _most_within(m: float, t: Array, whole: float, low: Array, high: Array) -> float:
    """The least a - b m + 3 c m^2 of those above g: at most ``whole`` everywhere, and between two of t (J + 1,) below
    the chord from low to high (J,)."""
    at = np.concatenate([[0.0, t[0]], t[:-1], t[1:]])
    above = np.concatenate([[whole, whole], low, high])
    middle = np.concatenate([[0.0, 0.0], *[(t[:-1] + t[1:]) / 2] * 2])
    square = middle * (2 * at - middle)  # t^2 lies above its tangent
    rows = np.column_stack([-np.ones(len(at)), at / m, -square / m**2])
    rows = np.vstack([rows, [0.0, 1.0, -2 * t[-1] / m]])  # beyond the last it rises
    room = np.append((whole - above) / m, 0.0)
    a, b, c = linprog([1, -1, 3], A_ub=rows, b_ub=room, bounds=[(None, None), (0, None), (0, None)]).x
    c += max(b - 2 * c * t[-1] / m, 0.0) * m / (2 * t[-1])
    lacks = max((rows @ [a, b, c] - room)[:-1].max(), 0.0)
    return float(whole + m * (a + lacks - b + 3 * c))
