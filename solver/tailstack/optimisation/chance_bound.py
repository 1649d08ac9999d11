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

from collections.abc import Callable
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..tail.declared import LinearLaw, lattice_columns
from ..tail.lattice import Accuracy, balls, build, on_principal_axes, sines

ACCURACY = Accuracy(5e-9, 1e-8, 6e4)
ERROR, SLOPES = 1e-7, 3.0  # absolute, of a chance; times what the terms tell of it, as slopes are off by as much
FIRST, LAST, OCTAVE = 1e-2, 2.0, 6  # t at the first radius by m; the last radius; tangents until it has doubled
FAR, AWAY, LEAST = 10.0, 0.6, 0.02  # t by m, distance from 0 by the quantile, and g, up to where tangents touch
TRIED, SURE = 8, 0.99  # radii, and how much of the way to where two others promise p
ENOUGH = 0.01  # of what m takes from the chance, by which it may be less than p
BLOCK = 1024  # waves that are summed together
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
    rows = np.arange(np.log2(LAST / sqrt(FIRST * m)))
    touches = sqrt(FIRST * m) * (1 + np.arange(OCTAVE) / OCTAVE) * 2.0 ** rows[:, None]
    every = touches.ravel()
    radii = np.array([every[0] * (1 - 0.5 / OCTAVE), *(every[1:] + every[:-1]) / 2, every[-1] * (1 + 0.5 / OCTAVE)])
    kites = _kites(*net)

    def alone(r: float) -> float:
        return float((lattice.w * balls(r, lattice.t)).sum()) + error

    def together(r: float) -> float:
        terms = lattice.w * balls(r, lattice.t)
        low, high = _chords(lattice.k, terms, unit, net[0], kites, touches, radii, away_mm, error)
        return _most_within(m, radii**2, alone(r), low, high)

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
    touches: Array,
    radii: Array,
    away_mm: float,
    error: float,
) -> tuple[Array, Array]:
    """(J,) and (J,): between each two radii (J + 1,) of u the ends of a chord, over the square of the radius, above g.

    terms (n,) of wave vectors k (n, 3); unit (3, 3): y of u; directions (D, 3) and kites: of :func:`_kites`; touches
    (J / OCTAVE, OCTAVE): a radius between each two, in each row twice those of the row before.
    """
    owner, corners = kites
    farthest = away_mm / np.linalg.norm(directions @ unit.T, axis=1)
    told = sum_waves(np.ascontiguousarray((k @ unit).T), terms, directions, touches, farthest)
    value = np.maximum(told[:, :, 0] + error, LEAST)
    slope = told[:, :, 1:] / value[:, :, None]
    offset = np.log(value) - touches.reshape(-1, 1) * (slope * directions).sum(axis=2)
    falls = -np.einsum("jqa,qva->jqv", slope[:, owner], corners).max(axis=2)
    good = (value[:, owner] > LEAST) & (falls > 0)  # elsewhere the tangent before holds as well
    alpha, rate = np.full(len(owner), np.log(terms.sum() + error)), np.zeros(len(owner))
    ends = np.empty((len(told), 2))
    for j, own in enumerate(good):
        alpha, rate = np.where(own, offset[j, owner], alpha), np.where(own, falls[j], rate)
        ends[j] = [np.exp(alpha - rate * radius).max() for radius in radii[j : j + 2]]
    return ends[:, 0], ends[:, 1]


@kernel(nogil=True)
def sum_waves(waves: Array, terms: Array, directions: Array, touches: Array, farthest: Array) -> Array:
    """(J, D, 4): at touches (J / M, M) along each of D directions (D, 3), as far as that is not beyond ``farthest``
    (D,), the sum of terms (n,) times the cosines of ``wave . point``, waves (3, n), and its slopes by the point; 0
    beyond.

    In each row touches are twice those of the row before: so are angles, and ``cos 2x = 1 - 2 sin^2 x``.
    """
    rows, columns = touches.shape
    found = np.zeros((rows * columns, len(directions), 4))
    phases, sines_of, cosines, pulls = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty((3, BLOCK))
    for begin in range(0, len(terms), BLOCK):  # what is summed stays near
        some = terms[begin : begin + BLOCK]
        count = len(some)
        phase, sine, cosine = phases[:count], sines_of[:count], cosines[:count]
        for a in range(3):
            for i in range(count):
                pulls[a, i] = -waves[a, begin + i] * some[i]
        for j in range(len(directions)):
            x, y, z = directions[j]
            for i in range(count):
                phase[i] = waves[0, begin + i] * x + waves[1, begin + i] * y + waves[2, begin + i] * z
            for column in range(columns):
                sines(touches[0, column], phase, sine, cosine)
                for row in range(rows):
                    if touches[row, column] > farthest[j]:
                        break
                    if row:
                        for i in range(count):
                            doubled = 2.0 * sine[i]
                            cosine[i], sine[i] = 1.0 - doubled * sine[i], doubled * cosine[i]
                    own = found[row * columns + column, j]
                    own[0] += np.dot(some, cosine)
                    for a in range(3):
                        own[a + 1] += np.dot(pulls[a, :count], sine)
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
