"""Scrambled Sobol points, the very ones of ``scipy.stats.qmc.Sobol``, whose package takes a second to import.

Direction numbers by Joe and Kuo (2008), from the file that SciPy carries; linear matrix scrambling (Matousek 1998) and
a digital shift, drawn from the generator in SciPy's order.  A test holds the two to the same bits.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel

BITS = 30
_NUMBERS = Path(scipy.__file__).parent / "stats" / "_sobol_direction_numbers.npz"

Words = NDArray[np.uint32]


@kernel()
def _expanded(poly: NDArray[np.int64], first: NDArray[np.int64]) -> Words:
    """(D, BITS) direction numbers: Bratley and Fox's recurrence over primitive polynomials, most significant first."""
    count = poly.size
    v = np.zeros((count, BITS), dtype=np.int64)
    for d in range(count):
        degree = 0
        while poly[d] >> (degree + 1):
            degree += 1
        for j in range(BITS):
            if d == 0:
                v[d, j] = 1
            elif j < degree:
                v[d, j] = first[d, j]
            else:
                new = v[d, j - degree]
                for k in range(degree):
                    if (poly[d] >> (degree - 1 - k)) & 1:
                        new ^= v[d, j - k - 1] << (k + 1)
                v[d, j] = new
    out = np.empty((count, BITS), dtype=np.uint32)
    for d in range(count):
        for j in range(BITS):
            out[d, j] = v[d, j] << (BITS - 1 - j)
    return out


@lru_cache(maxsize=1)
def _published() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    with np.load(_NUMBERS) as numbers:
        return numbers["poly"].astype(np.int64), numbers["vinit"].astype(np.int64)


@lru_cache(maxsize=4)
def _direction_numbers(dimension: int) -> Words:
    poly, first = _published()
    if dimension > poly.size:
        raise ValueError(f"Sobol points have at most {poly.size} dimensions, got {dimension}")
    return np.asarray(_expanded(poly[:dimension], first[:dimension]))


@kernel()
def _points(v: Words, rows: NDArray[np.uint32], shift: Words, count: int) -> Array:
    """(count, D) points of scrambled direction numbers, in the order of the Gray code.

    rows (D, BITS, BITS): of lower triangular matrices, the diagonal of ones left out.
    """
    dimension = v.shape[0]
    scrambled = np.zeros((dimension, BITS), dtype=np.uint32)
    for d in range(dimension):
        for p in range(BITS):
            word = np.uint32(1 << (BITS - 1 - p))
            for k in range(p):
                word |= np.uint32(rows[d, p, k] << np.uint32(BITS - 1 - k))
            for j in range(BITS):
                both = word & v[d, j]
                both ^= both >> np.uint32(16)
                both ^= both >> np.uint32(8)
                both ^= both >> np.uint32(4)
                both ^= both >> np.uint32(2)
                both ^= both >> np.uint32(1)
                scrambled[d, j] |= np.uint32((both & np.uint32(1)) << np.uint32(BITS - 1 - p))
    out = np.empty((count, dimension))
    here = shift.copy()
    scale = 1.0 / (1 << BITS)
    for i in range(count):
        for d in range(dimension):
            out[i, d] = here[d] * scale
        lowest = 0
        while (i >> lowest) & 1:
            lowest += 1
        for d in range(dimension):
            here[d] ^= scrambled[d, lowest]
    return out


def scrambled_sobol(dimension: int, log2_count: int, rng: np.random.Generator) -> Array:
    """(2^log2_count, dimension) scrambled points in [0, 1).  Raises ValueError beyond 21201 dimensions."""
    rng = rng.spawn(1)[0]  # as SciPy does with a generator it is given
    bits = rng.integers(2, size=(dimension, BITS), dtype=np.uint32)
    shift = np.dot(bits, 2 ** np.arange(BITS, dtype=np.uint32))
    rows = rng.integers(2, size=(dimension, BITS, BITS), dtype=np.uint32)
    return np.asarray(_points(_direction_numbers(dimension), rows, shift, 1 << log2_count))
