"""Laws of linear models, written briefly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tailstack.tail.declared import LinearLaw


def linear_law(
    mean: ArrayLike, covariance: ArrayLike, columns: ArrayLike | None = None, kinds: ArrayLike | None = None
) -> LinearLaw:
    """mean (3,) mm, covariance (3, 3) mm^2; columns (3, k) mm and kinds (k,) are none and uniform where not given."""
    columns = np.zeros((3, 0)) if columns is None else np.ascontiguousarray(columns, dtype=np.float64)
    kinds = np.zeros(columns.shape[1], dtype=np.int64) if kinds is None else np.asarray(kinds, dtype=np.int64)
    return LinearLaw(np.asarray(mean, np.float64), np.asarray(covariance, np.float64), columns, kinds)
