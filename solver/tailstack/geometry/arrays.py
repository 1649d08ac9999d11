"""The array that nearly everything here is made of; a file of its own, so that kernels reach no more than they use."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[np.float64]
ArrayLike = Any  # numpy arrays of floats, of complex numbers or of CasADi scalars; static typing cannot say that


def frozen(values: Any, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """A read-only copy of numbers, C-contiguous: for another layout, kernels would be compiled again."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array
