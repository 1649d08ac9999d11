"""The largest norms of a run: all of them while they are few, and later those among which a quantile can still be.

Of n trials the tail above P95 is n / 20 norms, 800 MB for two thousand million trials.  Yet an order statistic asks
only for the norms near it and for *how many* lie beyond, and the mean beyond a quantile for their sum.  After m trials
a quantile of all that will be drawn is, but for one time in 1e15, among the m (1 - q) +- 8 sqrt(m (1 - q)) largest:
outside of these windows norms are counted and summed, exactly and so in any order, and forgotten.  What is kept grows
with the square root of the trials.  A rank that is asked for and was not kept is drawn again (``simulate.deepen``),
never replaced by another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, floor, inf, sqrt

import numpy as np

from ..geometry.arrays import Array

UNIT_BITS = 53 + 1074  # of the unit in which sums are counted: every float64 is a whole number of it
_LOW = (1 << 26) - 1


def tail_size(trials: int, quantile: float) -> int:
    """How many of the largest norms to keep for this quantile: its interval at any usual confidence, and slack."""
    beyond = trials * (1 - quantile)
    return min(trials, ceil(beyond + 8 * sqrt(beyond + 1)) + 16)


def take_largest(values: Array, count: int) -> Array:
    """The ``count`` largest, in any order."""
    return values if len(values) <= count else np.partition(values, len(values) - count)[-count:]


def sum_exactly(values: Array) -> int:
    """The sum of finite numbers that are not negative, in units of ``2**-UNIT_BITS``, without any rounding."""
    mantissas, exponents = np.frexp(values)
    whole = (mantissas * 2.0**53).astype(np.int64)
    total = 0
    for exponent in np.unique(exponents):
        own = whole[exponents == exponent]
        total += ((int((own >> 26).sum()) << 26) + int((own & _LOW).sum())) << (int(exponent) + 1074)
    return total


def to_float(total: int) -> float:
    """A sum in units of ``2**-UNIT_BITS`` as the nearest float64."""
    return total / (1 << UNIT_BITS)


@dataclass(slots=True)
class Gap:
    """Norms strictly between two others that were counted and summed, and not kept."""

    low: float
    high: float
    count: int = 0
    total: int = 0  # of the norms, in units of 2**-UNIT_BITS mm
    squares: int = 0  # of their squares, each rounded, in units of 2**-UNIT_BITS mm^2
    largest: float = -inf

    def absorb(self, norms: Array) -> None:
        """Norms that lie in it."""
        if len(norms):
            self.count += len(norms)
            self.total += sum_exactly(norms)
            self.squares += sum_exactly(norms * norms)
            self.largest = max(self.largest, float(norms.max()))

    def join(self, other: Gap) -> None:
        """Another gap that lies in it."""
        self.count += other.count
        self.total += other.total
        self.squares += other.squares
        self.largest = max(self.largest, other.largest)


@dataclass(slots=True)
class Tail:
    """The largest norms of one error so far, mm."""

    parts: list[Array] = field(default_factory=list)
    size: int = 0  # norms in the parts
    floor: float = -inf  # every norm above is in the parts or in a gap
    gaps: list[Gap] = field(default_factory=list)  # rising
    _room: int = 0

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
        norms.partition(len(norms) - keep)
        self._hold(norms[-keep:].copy())
        self.floor = max(self.floor, float(self.parts[0][0]))

    def settle(self, keep: int | None = None) -> Array:
        """The ``keep`` largest (None: all), ascending, after the norms that lie in gaps went there."""
        norms = np.concatenate(self.parts)
        self.parts.clear()
        # a part that is not complete down to a gap leaves that one, and what is below it, without a count
        self.floor = max([self.floor, *(gap.high for gap in self.gaps if gap.low < self.floor)])
        self.gaps = [gap for gap in self.gaps if gap.low >= self.floor]
        norms = norms[norms >= self.floor]
        whole = keep is None or len(norms) <= keep
        norms = np.sort(norms if keep is None else take_largest(norms, keep))
        if len(norms) and not (whole and self.floor == -inf):
            self.floor = float(norms[0])
        for gap in self.gaps:
            norms = _move(norms, gap)
        self._hold(norms)
        return norms

    def thin(self, trials: int, quantiles: Sequence[float], room: int) -> None:
        """After so many trials: keep no more than the quantiles can still need, once there is more than ``room``."""
        if self.size <= max(room, self._room):
            return
        norms = self.settle()
        if self.floor == inf:  # there is nothing else but trials without an answer
            return
        windows = self._windows(norms, trials, quantiles)
        self.floor = windows[0][0]
        norms = norms[np.searchsorted(norms, self.floor) :]
        edges = [*pairwise(windows), (windows[-1], (inf, inf))]
        gaps = [Gap(low, high) for (_, low), (high, _) in edges if low < high]
        for gap in gaps:
            for old in self.gaps:
                if gap.low <= old.low and old.high <= gap.high:
                    gap.join(old)
            norms = _move(norms, gap)
        self.gaps = gaps
        self._hold(norms)
        self._room = 2 * self.size

    def _hold(self, norms: Array) -> None:
        self.parts, self.size = [norms], len(norms)

    def _windows(self, norms: Array, trials: int, quantiles: Sequence[float]) -> list[tuple[float, float]]:
        """Closed intervals, rising and apart, in which quantiles can be, and no gap is."""
        windows = []
        for quantile in sorted(quantiles):
            beyond = trials * (1 - quantile)
            low = self._of_rank(norms, tail_size(trials, quantile))[0]
            high = self._of_rank(norms, floor(beyond - 8 * sqrt(beyond + 1)) - 16)[1]
            windows.append((min(low, high), max(low, high)))  # both ends may be those of one gap
        apart = windows[:1]
        for low, high in windows[1:]:
            if low <= apart[-1][1]:
                apart[-1] = apart[-1][0], max(apart[-1][1], high)
            else:
                apart.append((low, high))
        for gap in self.gaps:
            apart = [part for window in apart for part in _without(window, gap)]
        return apart

    def _of_rank(self, norms: Array, rank: int) -> tuple[float, float]:
        """The ``rank``-th largest norm, twice; the ends of the gap that it lies in, the upper one first.

        Above the largest it is infinite; below the smallest, the smallest that is kept.
        """
        if rank < 1:
            return inf, inf
        for gap in reversed(self.gaps):
            above = len(norms) - int(np.searchsorted(norms, gap.high))
            if rank <= above:
                break
            rank -= gap.count
            if rank <= above:
                return gap.high, gap.low
        value = float(norms[max(len(norms) - rank, 0)])
        return value, value


def _move(norms: Array, gap: Gap) -> Array:
    """Ascending norms without those that lie in a gap, which absorbs them."""
    first, stop = np.searchsorted(norms, gap.low, side="right"), np.searchsorted(norms, gap.high)
    if stop <= first:
        return norms
    gap.absorb(norms[first:stop])
    return np.concatenate([norms[:first], norms[stop:]])


def _without(window: tuple[float, float], gap: Gap) -> list[tuple[float, float]]:
    low, high = window
    return [(low, gap.low), (gap.high, high)] if low <= gap.low and gap.high <= high else [window]
