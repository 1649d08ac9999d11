"""Laws of linear models, written briefly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tailstack.tail.declared import LinearLaw
from tailstack.tail.gaussian import norm_excess, norm_quantile


def linear_law(
    mean: ArrayLike, covariance: ArrayLike, columns: ArrayLike | None = None, kinds: ArrayLike | None = None
) -> LinearLaw:
    """mean (3,) mm, covariance (3, 3) mm^2; columns (3, k) mm and kinds (k,) are none and uniform where not given."""
    columns = np.zeros((3, 0)) if columns is None else np.ascontiguousarray(columns, dtype=np.float64)
    kinds = np.zeros(columns.shape[1], dtype=np.int64) if kinds is None else np.asarray(kinds, dtype=np.int64)
    return LinearLaw(np.asarray(mean, np.float64), np.asarray(covariance, np.float64), columns, kinds)


def norm_cvar(p: float, mean: np.ndarray, covariance: np.ndarray) -> float:
    """E[|e| given |e| >= r_p], mm: the mean of the worst 1 - p (expected shortfall)."""
    r = norm_quantile(p, mean, covariance)
    return r + norm_excess(r, mean, covariance) / (1.0 - p)
