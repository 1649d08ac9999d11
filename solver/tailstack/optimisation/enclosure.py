"""What a displacement of images can be anywhere in a cell, bounded from above, compiled."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..kernels.store import kernel

ROUNDING = 2.0**-44  # of sums of absolute values: fewer than 2^9 operations, each to 2^-53


class Forms(NamedTuple):
    """Whitened displacements of images, ``y' B y / (w . y)^2`` of where a bead is, y = (x, 1)."""

    quadratic: Array  # (R, K, 4, 4) symmetric
    size: Array  # (R, K, 4, 4) of absolute terms
    depth: Array  # (R, 4)
    moved: Array  # (R, 3, 4) the linear numerator, for each axis along which a bead may be displaced
    moved_size: Array  # (R, 3, 4)


@kernel(nogil=True)
def enclose(forms: Forms, centres: Array, half: Array, reach: Array, displaced: Array) -> Array:
    """(n, K, 8): at each corner of n cells an upper bound of the sum of squares of the whitened displacements anywhere
    in the cell, as far as it is convex there: the largest of the eight bounds the cell; inf where the source of a view
    is too near.

    centres (n, 3); half, reach (3,): half the extent of a cell, and of all of them about 0; displaced (n, K, 3) mm:
    where the point is taken to have been displaced.  A displacement is N(x) / w(x)^2, N quadratic and w linear: with
    d from the centre, ``1 / w^2 = (1 - 2 s.d / w + E) / w^2``, ``|E| <= 3 r^2 / (1 - r)^4`` where ``|s.d| <= r w``.
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
    total, y, slope = np.zeros((len(centres), count, 8)), np.ones(4), np.zeros(4)
    for i in range(len(centres)):
        y[:3] = centres[i]
        for r in range(rows):
            depth, moved = forms.depth[r], forms.moved[r]
            w = depth[0] * y[0] + depth[1] * y[1] + depth[2] * y[2] + depth[3]
            ratio = (abs(depth[0]) * half[0] + abs(depth[1]) * half[1] + abs(depth[2]) * half[2]) / w
            if not (w > 0.0 and ratio <= 0.5):
                total[i] = inf
                continue
            excess = 3 * ratio**2 / (1 - ratio) ** 4
            for k in range(count):
                value, largest, shift = 0.0, 0.0, displaced[i, k]
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
                    total[i, k, corner] += (abs(at) + rest) ** 2
    return total
