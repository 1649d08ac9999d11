"""The array that nearly everything here is made of; a file of its own, so that kernels reach no more than they use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
