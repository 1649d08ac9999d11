"""Object arrays of CasADi scalars, on which the compiled model's own source runs."""

from __future__ import annotations

from typing import Any

import numpy as np

# Floats, or object arrays of CasADi SX scalars; static typing cannot say both.
Duck = Any


def plain(values: Any) -> Duck:
    """An object array of Python numbers: numpy's own scalars would not hand over to symbols."""
    return np.asarray(values, dtype=float).astype(object)


def times(values: Duck, factor: Duck) -> Duck:
    """``values * factor`` for an object array and one symbol: CasADi would make a matrix of its own of the product."""
    out = np.empty(values.shape, dtype=object)
    for index in np.ndindex(values.shape):
        out[index] = values[index] * factor
    return out


def elements(vector: Any) -> Duck:
    """A CasADi column as an object array of its scalars."""
    out = np.empty(vector.numel(), dtype=object)
    for k in range(vector.numel()):
        out[k] = vector[k]
    return out
