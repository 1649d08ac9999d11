"""The largest norms of a run: enough of them for a quantile with its interval.

A rank that is asked for and was not kept is drawn again (``simulate.deepen``), never replaced by another.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, inf, sqrt

import numpy as np

from ..geometry.arrays import Array


def tail_size(trials: int, quantile: float) -> int:
    """How many of the largest norms to keep for this quantile: its interval at any usual confidence, and slack."""
    beyond = trials * (1 - quantile)
    return min(trials, ceil(beyond + 8 * sqrt(beyond + 1)) + 16)


def take_largest(values: Array, count: int) -> Array:
    """The ``count`` largest, in any order."""
    return values if len(values) <= count else np.partition(values, len(values) - count)[-count:]


@dataclass(slots=True)
class Tail:
    """The largest norms of one error so far, mm."""

    parts: list[Array] = field(default_factory=list)
    size: int = 0  # norms in the parts
    floor: float = -inf  # every norm above is in the parts

    def add(self, norms: Array, floor: float) -> None:
        """Norms that are complete above their floor."""
        if floor > self.floor:
            self.floor = floor
        else:
            norms = norms[norms > self.floor]
        self.parts.append(norms)
        self.size += len(norms)

    def cut(self, keep: int) -> None:
        """Forget all but the ``keep`` largest."""
        norms = np.concatenate(self.parts)
        self.parts.clear()
        norms.partition(len(norms) - keep)
        self._hold(norms[-keep:].copy())
        self.floor = max(self.floor, float(self.parts[0][0]))

    def settle(self, keep: int) -> Array:
        """The ``keep`` largest, ascending."""
        norms = np.concatenate(self.parts)
        self.parts.clear()
        norms = norms[norms >= self.floor]
        whole = len(norms) <= keep
        norms = np.sort(take_largest(norms, keep))
        if len(norms) and not (whole and self.floor == -inf):
            self.floor = float(norms[0])
        self._hold(norms)
        return norms

    def _hold(self, norms: Array) -> None:
        self.parts, self.size = [norms], len(norms)
