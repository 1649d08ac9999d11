"""The law that sources make together, from what each does to an error; a file of its own, so that the kernel reaches no
more than it uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.numerics import VANISHING_MM
from ..kernels.store import kernel
from ..laws import SUMS, Law

NORMAL, BOUNDED = -1, -2  # beside the places in SUMS of those that have columns in a law
KIND = {Law.NORMAL: NORMAL, Law.BOUNDED: BOUNDED} | {law: kind for kind, law in enumerate(SUMS)}


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
