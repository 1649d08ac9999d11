"""How far apart two images must be to be told apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Array
from .camera import cross

OVERLAP_PX = 10.0  # judgement: images closer than this are not told apart by every segmentation
BACKGROUND_PX = 3.0  # judgement: between two shadows, a pixel of background beside the blurred edge of each


def needed_gap(projection: Array, radius_mm: float | None, depth: Any, other: Any) -> Any:
    """Distance, px, that the images of two fiducials at these depths, mm, need to be told apart.

    Of balls: the radius of both shadows, each by its own magnification, and some background between them.  A radius of
    None: how large the fiducials are is not known, and they need ``OVERLAP_PX``.  projection (3, 4), its last row of
    length 1; depths may be floats, arrays or symbols.
    """
    if radius_mm is None:
        return OVERLAP_PX + 0.0 * (depth + other)
    left = projection[:, :3]
    focal = max(float(np.linalg.norm(cross(row, left[2]))) for row in left[:2])
    return radius_mm * focal * (1 / depth + 1 / other) + BACKGROUND_PX
