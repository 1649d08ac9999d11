"""A compliance is that of a passive structure: symmetric (Maxwell and Betti), and no push moves it against itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..field_names import write_value
from ..fields import refusal
from ..geometry.arrays import Array

ROUNDING = 1e-3  # of the largest entry: what three digits in a document leave


def check_passive(rows: Sequence[Sequence[float]]) -> None:
    """Refuse a compliance (3, 3), mm/N, that is not symmetric or not positive semidefinite within rounding."""
    matrix = np.array(rows)
    scale = float(np.abs(matrix).max())
    gaps = np.abs(matrix - matrix.T)
    mean = (matrix + matrix.T) / 2
    values, axes = np.linalg.eigh(mean)
    if gaps.max() > ROUNDING * scale:
        i, j = (int(k) for k in np.unravel_index(gaps.argmax(), gaps.shape))
        halves = [np.triu(matrix), np.tril(matrix)]
        half = next((each for each in halves if np.array_equal(each, matrix)), None)
        whole = mean if half is None else half + half.T - np.diag(np.diag(half))
        what = "the mean of the two is" if half is None else "with both of its halves it is"
        cure = (
            f"matrix_mm_per_n: {write_value(whole.tolist(), 6)}"
            if np.linalg.eigvalsh(whole)[0] >= -ROUNDING * scale
            else ""
        )
        raise refusal(
            "not-symmetric",
            f"a compliance is symmetric; {_name(i, j)} is {matrix[i, j]:g}, {_name(j, i)} {matrix[j, i]:g}",
            f"{what} {cure}" if cure else "check the signs and the order of its entries",
            "matrix_mm_per_n",
        )
    if values[0] < -ROUNDING * scale or np.diag(matrix).min() < 0:
        axis = axes[:, 0] * (1 if axes[np.abs(axes[:, 0]).argmax(), 0] > 0 else -1)
        along = ", ".join(f"{each + 0.0:.3g}" for each in axis.round(3))
        cure = "a deflection goes with the force: check the signs"
        if values[-1] <= ROUNDING * scale:
            cure = f"a deflection goes with the force: matrix_mm_per_n: {write_value((-mean).tolist(), 6)}"
        elif np.diag(matrix).min() >= 0:
            i, j = max(((i, j) for i in range(3) for j in range(i)), key=lambda pair: _excess(matrix, *pair))
            most = float(np.sqrt(matrix[i, i] * matrix[j, j]))
            cure = f"between {'xyz'[j]} and {'xyz'[i]} it is at most {most:g}, the geometric mean of its two diagonals"
        raise refusal(
            "not-passive",
            f"a compliance has no negative eigenvalue; along [{along}] it is {min(values[0], 0):.4g} mm/N: what is "
            "pushed there would move against the force",
            cure,
            "matrix_mm_per_n",
        )


def _excess(matrix: Array, i: int, j: int) -> float:
    return float(abs(matrix[i, j]) - np.sqrt(matrix[i, i] * matrix[j, j]))


def _name(i: int, j: int) -> str:
    return f"row {i + 1}, column {j + 1}"
