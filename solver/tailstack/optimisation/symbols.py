"""Object arrays of CasADi scalars, or of arrays, on which the compiled model's own source runs."""

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


def gram(matrix: ArrayLike) -> ArrayLike:
    """``matrix @ matrix.T`` (m, m), in CasADi for symbols: an object array multiplies them one by one."""
    if not any(type(each).__module__.startswith("casadi") for each in matrix.flat):
        return np.asarray(matrix @ matrix.T)
    import casadi as ca  # a problem is read where it is not installed, for a report

    whole = ca.reshape(ca.vertcat(*matrix.T.ravel()), *matrix.shape)
    return elements(ca.vec(ca.mtimes(whole, whole.T))).reshape(len(matrix), len(matrix))


def elements(vector: Any) -> ArrayLike:
    """A CasADi column as an object array of its scalars."""
    return side_by_side([vector[k] for k in range(vector.numel())])


def side_by_side(values: ArrayLike) -> ArrayLike:
    """Values (n, m) of n scalars in m cases as an object array (n,) of arrays (m,)."""
    out = np.empty(len(values), dtype=object)
    for k, each in enumerate(values):
        out[k] = each
    return out
