"""Directions and points in the words of a message."""

from __future__ import annotations

import numpy as np

from .arrays import Array


def direction_name(vector: Array) -> str:
    """x, y or z where (3,) is along one of them, otherwise the unit vector; its sign is made positive."""
    unit = vector / np.linalg.norm(vector)
    largest = int(np.argmax(np.abs(unit)))
    unit = unit * (1.0 if unit[largest] > 0 else -1.0)
    if 1 - unit[largest] < 1e-6:
        return "xyz"[largest]
    return "(" + ", ".join(f"{value + 0.0:.3f}" for value in np.round(unit, 3)) + ")"


def point_name(point_mm: Array) -> str:
    """(3,) in mm, four digits."""
    tidy = np.where(np.abs(point_mm) < 1e-6, 0.0, point_mm)
    return "(" + ", ".join(f"{value:.4g}" for value in tidy) + ") mm"
