"""What a displacement of images can be anywhere in a cell, and wherever views look, bounded from above, compiled."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from .mixture import factorise, substitute

ROUNDING = 2.0**-44  # of sums of absolute values: fewer than 2^9 operations, each to 2^-53


class Forms(NamedTuple):
    """Whitened displacements of images, ``y' B y / (w . y)^2`` of where a bead is, y = (x, 1)."""

    quadratic: Array  # (R, K, 4, 4) symmetric
    size: Array  # (R, K, 4, 4) of absolute terms
    depth: Array  # (R, 4)
    moved: Array  # (R, 3, 4) the linear numerator, for each axis along which a bead may be displaced
    moved_size: Array  # (R, 3, 4)
    of_view: NDArray[np.int64]  # (R,) whose image that is


class ViewTurns(NamedTuple):
    """All that P numbers, each from -1 to 1, do to where views look: each belongs to one of V views.

    A view that is turned sees a point x where it saw ``x + sum of t_p ways_p (x, 1)`` before, and a displacement s like
    ``s + sum of t_p spins_p s``; both but for ``bent`` of their distance from its pivot, and of their length.
    """

    ways: Array  # (P, 3, 4) mm
    spins: Array  # (P, 3, 3)
    of_view: NDArray[np.int64]  # (P,)
    bent: Array  # (V,)
    pivots_mm: Array  # (V, 3)


@kernel(nogil=True)
def enclose(
    forms: Forms, turns: ViewTurns, made: Array, centres: Array, along: NDArray[np.int64], half: Array, reach: Array,
    displaced: Array,
) -> Array:  # fmt: skip
    """(n, 2^P, 8): at each corner of what turns the views, and of n cells, an upper bound of the sum of squares of the
    whitened displacements anywhere in the cell and wherever the views look, by the unknowns ``along`` (n,), as far as
    it is convex there: the largest of the bounds bounds all; inf where the source of a view is too near.

    centres (n, 3); half, reach (3,): half the extent of a cell, and of all of them about 0; displaced (n, 3) mm:
    where the point is taken to have been displaced.  A displacement is N(x) / w(x)^2, N quadratic and w linear: with
    d from the centre, ``1 / w^2 = (1 - 2 s.d / w + E) / w^2``, ``|E| <= 3 r^2 / (1 - r)^4`` where ``|s.d| <= r w``.

    made (3, 3): what unit normal errors of a bead are multiplied by.  With D what they do to its images,
    ``f' (1 + D D')^-1 f`` is the least of ``|f - D u|^2 + |u|^2``: any u will do, and the best at the centre is taken.
    """
    rows, count = forms.quadratic.shape[:2]
    params, corners = len(turns.of_view), 1 << len(turns.of_view)
    far, terms, by_shift = np.ones(4), np.zeros((rows, count)), np.zeros((rows, 3))
    bent, whole = 0.0, sqrt((reach**2).sum())
    for v in range(len(turns.bent)):
        bent = max(bent, turns.bent[v] * (whole + sqrt((turns.pivots_mm[v] ** 2).sum())))
    for j in range(3):
        far[j] = reach[j] + bent
        for p in range(params):
            far[j] += abs(turns.ways[p, j, 3])
            for a in range(3):
                far[j] += abs(turns.ways[p, j, a]) * reach[a]
    for r in range(rows):
        for a in range(4):
            for j in range(3):
                by_shift[r, j] += forms.moved_size[r, j, a] * far[a]
            for b in range(4):
                terms[r] += far[a] * forms.size[r, :, a, b] * far[b]
    total, y, slope, is_made = np.zeros((len(centres), corners, 8)), np.ones(4), np.zeros(4), made.any()
    by_made, square, inner = np.zeros((rows, 3)), np.zeros(rows), np.zeros((3, 3))
    units, shift = np.zeros((1, 3)), np.zeros(3)
    way, lacks, wide, turned, at_turn = np.zeros((params, 3)), np.zeros(3), np.zeros(3), np.zeros(params), np.zeros(8)
    for i in range(len(centres)):
        y[:3] = centres[i]
        k = along[i]
        shift[:] = displaced[i]
        own = 0.0
        if is_made:
            if i == 0 or (centres[i] != centres[i - 1]).any():
                for a in range(3):
                    for b in range(3):
                        inner[a, b] = 1.0 if a == b else 0.0
                for r in range(rows):
                    w = 0.0
                    for a in range(4):
                        w += forms.depth[r, a] * y[a]
                    square[r] = w * w
                    for a in range(3):
                        by_made[r, a] = 0.0
                        for j in range(3):
                            moved = forms.moved[r, j]
                            here = moved[0] * y[0] + moved[1] * y[1] + moved[2] * y[2] + moved[3]
                            by_made[r, a] += here * made[j, a]
                        by_made[r, a] /= square[r]
                    for a in range(3):
                        for b in range(3):
                            inner[a, b] += by_made[r, a] * by_made[r, b]
                factorise(inner)
            units[:] = 0.0
            for r in range(rows):
                seen = 0.0
                for a in range(4):
                    curved = forms.quadratic[r, k, a]
                    seen += y[a] * (curved[0] * y[0] + curved[1] * y[1] + curved[2] * y[2] + curved[3])
                for a in range(3):
                    units[0, a] += by_made[r, a] * seen / square[r]
            substitute(inner, units)
            for a in range(3):
                own += units[0, a] * units[0, a]
                for b in range(3):
                    shift[a] += made[a, b] * units[0, b]
        for c in range(corners):
            for corner in range(8):
                total[i, c, corner] = own
        for r in range(rows):
            depth, moved, view = forms.depth[r], forms.moved[r], forms.of_view[r]
            bent = turns.bent[view]
            away = bent * (sqrt(((y[:3] - turns.pivots_mm[view]) ** 2).sum()) + sqrt((half**2).sum()))
            for j in range(3):
                lacks[j], wide[j] = away, half[j]
            for p in range(params):
                if turns.of_view[p] == view:
                    for j in range(3):
                        path = turns.ways[p, j]
                        way[p, j] = path[0] * y[0] + path[1] * y[1] + path[2] * y[2] + path[3]
                        wide[j] += abs(way[p, j])
                        lacks[j] += abs(path[0]) * half[0] + abs(path[1]) * half[1] + abs(path[2]) * half[2]
            for j in range(3):
                wide[j] += lacks[j]
            w = depth[0] * y[0] + depth[1] * y[1] + depth[2] * y[2] + depth[3]
            ratio = (abs(depth[0]) * wide[0] + abs(depth[1]) * wide[1] + abs(depth[2]) * wide[2]) / w
            if not (w > 0.0 and ratio <= 0.5):
                total[i] = inf
                break
            excess = 3 * ratio**2 / (1 - ratio) ** 4
            value, largest, bend = 0.0, 0.0, 0.0
            for a in range(4):
                curved = forms.quadratic[r, k, a]
                slope[a] = curved[0] * y[0] + curved[1] * y[1] + curved[2] * y[2] + curved[3]
                pulled = shift[0] * moved[0, a] + shift[1] * moved[1, a] + shift[2] * moved[2, a]
                value += (slope[a] - pulled) * y[a]
                slope[a] = 2 * slope[a] - pulled
                if a < 3:
                    sides = abs(curved[0]) * wide[0] + abs(curved[1]) * wide[1] + abs(curved[2]) * wide[2]
                    bend += wide[a] * sides
                    largest += abs(slope[a]) * wide[a]
            size = terms[r, k]
            for j in range(3):
                size += abs(shift[j]) * by_shift[r, j]
            long = bent * sqrt(shift[0] ** 2 + shift[1] ** 2 + shift[2] ** 2)
            for p in range(params):
                turned[p] = 0.0
            for j in range(3):  # what the displacement does once it is turned
                here = moved[j, 0] * y[0] + moved[j, 1] * y[1] + moved[j, 2] * y[2] + moved[j, 3]
                about = abs(moved[j, 0]) * wide[0] + abs(moved[j, 1]) * wide[1] + abs(moved[j, 2]) * wide[2]
                bend += long * (abs(here) + about)
                for p in range(params):
                    if turns.of_view[p] == view:
                        spin = turns.spins[p, j]
                        other = spin[0] * shift[0] + spin[1] * shift[1] + spin[2] * shift[2]
                        turned[p] -= other * here
                        bend += abs(other) * about
            for p in range(params):
                largest += abs(turned[p])
            rest = abs(value) * excess + largest * (2 * ratio + excess) + bend * (1 + 2 * ratio + excess)
            rest = (rest + 8 * ROUNDING * size) / w**2
            for a in range(3):
                slope[a] = slope[a] / w**2 - 2 * value / w**3 * depth[a]
                rest += abs(slope[a]) * lacks[a]
            value /= w**2
            for p in range(params):
                if turns.of_view[p] == view:
                    to_side = slope[0] * way[p, 0] + slope[1] * way[p, 1] + slope[2] * way[p, 2]
                    turned[p] = turned[p] / w**2 + to_side
            for corner in range(8):
                at = value - slope[0] * half[0] if corner & 4 == 0 else value + slope[0] * half[0]
                at = at - slope[1] * half[1] if corner & 2 == 0 else at + slope[1] * half[1]
                at_turn[corner] = at - slope[2] * half[2] if corner & 1 == 0 else at + slope[2] * half[2]
            for c in range(corners):
                more = 0.0
                for p in range(params):
                    more += turned[p] if (c >> p) & 1 else -turned[p]
                for corner in range(8):
                    total[i, c, corner] += (abs(at_turn[corner] + more) + rest) ** 2
    return total
