"""What a displacement of images can be anywhere in a cell, bounded from above, compiled."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from .mixture import solve_positive

ROUNDING = 2.0**-44  # of sums of absolute values: fewer than 2^9 operations, each to 2^-53


class Forms(NamedTuple):
    """Whitened displacements of images, ``y' B y / (w . y)^2`` of where a bead is, y = (x, 1)."""

    quadratic: Array  # (R, K, 4, 4) symmetric
    size: Array  # (R, K, 4, 4) of absolute terms
    depth: Array  # (R, 4)
    moved: Array  # (R, 3, 4) the linear numerator, for each axis along which a bead may be displaced
    moved_size: Array  # (R, 3, 4)


@kernel(nogil=True)
def enclose(
    forms: Forms, made: Array, centres: Array, along: NDArray[np.int64], half: Array, reach: Array, displaced: Array
) -> Array:
    """(P, 8): at each corner of P cells an upper bound of the sum of squares of the whitened displacements anywhere in
    the cell, by the unknowns ``along`` (P,), as far as it is convex there: the largest of the eight bounds the cell;
    inf where the source of a view is too near.

    centres (P, 3); half, reach (3,): half the extent of a cell, and of all of them about 0; displaced (P, 3) mm: where
    the point is taken to have been displaced.  A displacement is N(x) / w(x)^2, N quadratic and w linear: with
    d from the centre, ``1 / w^2 = (1 - 2 s.d / w + E) / w^2``, ``|E| <= 3 r^2 / (1 - r)^4`` where ``|s.d| <= r w``.

    made (3, 3): what unit normal errors of a bead are multiplied by.  With D what they do to its images,
    ``f' (1 + D D')^-1 f`` is the least of ``|f - D u|^2 + |u|^2``: any u will do, and the best at the centre is taken.
    """
    rows, count = forms.quadratic.shape[:2]
    far, bend, terms, by_shift = np.ones(4), np.zeros((rows, count)), np.zeros((rows, count)), np.zeros((rows, 3))
    far[:3] = reach
    for r in range(rows):
        for a in range(4):
            for j in range(3):
                by_shift[r, j] += forms.moved_size[r, j, a] * far[a]
            for b in range(4):
                terms[r] += far[a] * forms.size[r, :, a, b] * far[b]
                if a < 3 and b < 3:
                    bend[r] += half[a] * np.abs(forms.quadratic[r, :, a, b]) * half[b]
    total, y, slope, is_made = np.zeros((len(centres), 8)), np.ones(4), np.zeros(4), made.any()
    by_made, inner, units, shift = np.zeros((rows, 3)), np.zeros((3, 3)), np.zeros((1, 3)), np.zeros(3)
    for i in range(len(centres)):
        y[:3] = centres[i]
        k = along[i]
        shift[:] = displaced[i]
        if is_made:
            inner[:] = 0.0
            units[:] = 0.0
            for a in range(3):
                inner[a, a] = 1.0
            for r in range(rows):
                w, seen = 0.0, 0.0
                by_made[r] = 0.0
                for a in range(4):
                    w += forms.depth[r, a] * y[a]
                    for b in range(4):
                        seen += y[a] * forms.quadratic[r, k, a, b] * y[b]
                    for j in range(3):
                        by_made[r] += forms.moved[r, j, a] * y[a] * made[j]
                for a in range(3):
                    units[0, a] += by_made[r, a] * seen / w**4
                    inner[a] += by_made[r, a] * by_made[r] / w**4
            solve_positive(inner, units)
            for a in range(3):
                total[i] += units[0, a] ** 2
                shift[a] += (made[a] * units[0]).sum()
        for r in range(rows):
            depth, moved = forms.depth[r], forms.moved[r]
            w = depth[0] * y[0] + depth[1] * y[1] + depth[2] * y[2] + depth[3]
            ratio = (abs(depth[0]) * half[0] + abs(depth[1]) * half[1] + abs(depth[2]) * half[2]) / w
            if not (w > 0.0 and ratio <= 0.5):
                total[i] = inf
                break
            excess = 3 * ratio**2 / (1 - ratio) ** 4
            value, largest = 0.0, 0.0
            for a in range(4):
                bent = forms.quadratic[r, k, a]
                slope[a] = bent[0] * y[0] + bent[1] * y[1] + bent[2] * y[2] + bent[3]
                pulled = shift[0] * moved[0, a] + shift[1] * moved[1, a] + shift[2] * moved[2, a]
                value += (slope[a] - pulled) * y[a]
                slope[a] = 2 * slope[a] - pulled
            for a in range(3):
                largest += abs(slope[a]) * half[a]
            size = terms[r, k]
            for j in range(3):
                size += abs(shift[j]) * by_shift[r, j]
            rest = abs(value) * excess + largest * (2 * ratio + excess) + bend[r, k] * (1 + 2 * ratio + excess)
            rest = (rest + 8 * ROUNDING * size) / w**2
            for a in range(3):
                slope[a] = (slope[a] / w**2 - 2 * value / w**3 * depth[a]) * half[a]
            value /= w**2
            for corner in range(8):
                at = value - slope[0] if corner & 4 == 0 else value + slope[0]
                at = at - slope[1] if corner & 2 == 0 else at + slope[1]
                at = at - slope[2] if corner & 1 == 0 else at + slope[2]
                total[i, corner] += (abs(at) + rest) ** 2
    return total
