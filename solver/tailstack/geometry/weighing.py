"""By what triangulations weigh their rows; a file of its own, so that kernels reach no more than they use."""

from __future__ import annotations

from enum import IntEnum


class Weighing(IntEnum):
    """By what a triangulation weighs the two rows of each view."""

    ALIKE = 0  # the rows of Eq 5 as they are
    BY_NOISE = 1  # by the inverse of what the noise of the images makes of them
    BY_IMAGES = 2  # such that the squares of the target's residuals in the images, px, are least
