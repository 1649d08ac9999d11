"""Object arrays of CasADi scalars, on which the compiled model's own source runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..system import ArrayLike


def plain(values: Any) -> ArrayLike:
    """An object array of Python numbers: numpy's own scalars would not hand over to symbols."""
    return np.asarray(values, dtype=float).astype(object)


def times(values: ArrayLike, factor: ArrayLike) -> ArrayLike:
    """``values * factor`` for an object array and one symbol: CasADi would make a matrix of its own of the product."""
    out = np.empty(values.shape, dtype=object)
    for index in np.ndindex(values.shape):
        out[index] = values[index] * factor
    return out


def elements(vector: Any) -> ArrayLike:
    """A CasADi column as an object array of its scalars."""
    out = np.empty(vector.numel(), dtype=object)
    for k in range(vector.numel()):
        out[k] = vector[k]
    return out
