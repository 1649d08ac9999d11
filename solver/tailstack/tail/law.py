"""A linear law with uniform and triangular sources: data, and its columns as the lattice takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel
from .spectrum import law_iv

UNIFORM, TRIANGULAR = 0, 1
_VARIANCES = np.array([1 / 3, 1 / 6])


@dataclass(frozen=True, slots=True, eq=False)
class LinearLaw:
    """e = mean + N(0, covariance) + columns @ u, in mm; any frame, the same for all three.

    columns are already multiplied by the half-widths: column j is the displacement at u_j = 1.
    """

    mean: Array  # (3,) mm
    covariance: Array  # (3, 3) mm^2: the Gaussian part only
    columns: Array  # (3, k) mm
    kinds: NDArray[np.int64]  # (k,) UNIFORM or TRIANGULAR

    @property
    def total_covariance(self) -> Array:
        """(3, 3) mm^2, bounded sources included."""
        return np.asarray(self.covariance + (self.columns * _VARIANCES[self.kinds]) @ self.columns.T)


def linear_law(
    mean: Array, covariance: Array, columns: Array | None = None, kinds: Sequence[int] | None = None
) -> LinearLaw:
    """A checked :class:`LinearLaw`; columns (3, k) mm and kinds (k,) default to none and to uniform.

    Raises ValueError for wrong shapes, values that are not finite, or a covariance that is not one.
    """
    mean, covariance = law_iv(mean, covariance)
    columns = np.zeros((3, 0)) if columns is None else np.asarray(columns, dtype=np.float64)
    if columns.ndim != 2 or columns.shape[0] != 3:
        raise ValueError(f"columns must have shape (3, k), got {columns.shape}")
    if not np.isfinite(columns).all():
        raise ValueError("columns must be finite")
    kind_array = np.zeros(columns.shape[1], dtype=np.int64) if kinds is None else np.asarray(kinds, dtype=np.int64)
    if kind_array.shape != (columns.shape[1],):
        raise ValueError(f"kinds must have shape ({columns.shape[1]},), got {kind_array.shape}")
    if not np.isin(kind_array, (UNIFORM, TRIANGULAR)).all():
        raise ValueError(f"kinds are {UNIFORM} (uniform) or {TRIANGULAR} (triangular), got {kind_array.tolist()}")
    return LinearLaw(mean, covariance, np.ascontiguousarray(columns), kind_array)


@kernel()
def uniform_columns(columns: Array, kinds: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """:func:`lattice_columns` of columns (3, k) and their kinds (k,)."""
    count = kinds.size
    kept = 0
    split = 0
    for j in range(count):
        if columns[0, j] != 0.0 or columns[1, j] != 0.0 or columns[2, j] != 0.0:
            kept += 1
            if kinds[j] == TRIANGULAR:
                split += 1
    h = np.empty((kept + split, 3))
    source = np.empty(kept + split, dtype=np.int64)
    one = 0
    two = kept
    for j in range(count):
        if columns[0, j] != 0.0 or columns[1, j] != 0.0 or columns[2, j] != 0.0:
            scale = 0.5 if kinds[j] == TRIANGULAR else 1.0
            for a in range(3):
                h[one, a] = columns[a, j] * scale
            source[one] = j
            one += 1
            if kinds[j] == TRIANGULAR:
                for a in range(3):
                    h[two, a] = columns[a, j] * scale
                source[two] = j
                two += 1
    return h, source


def lattice_columns(law: LinearLaw) -> tuple[Array, NDArray[np.int64]]:
    """((K, 3) uniform columns, (K,) source of each): a triangular source is the sum of two uniform ones of half width.

    Columns of length zero are dropped.
    """
    h, source = uniform_columns(law.columns, law.kinds)
    return h, source
