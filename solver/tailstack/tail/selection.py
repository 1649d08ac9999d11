"""Units picked by their rank, compiled: without sorting all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..kernels import kernel

_SHARED = 4  # values to a bucket


@kernel()
def _at_rank(values: Array, units: NDArray[np.int64], rank: int) -> int:
    """Which of the units (k,) has this rank among them, from 0; they are reordered.  The range of values is halved."""
    while True:
        low = np.inf
        high = -np.inf
        for unit in units:
            low = min(low, values[unit])
            high = max(high, values[unit])
        pivot = low + 0.5 * (high - low)
        if not low <= pivot < high:  # all alike, or neighbours
            pivot = low
        below = 0
        for i in range(units.size):
            if values[units[i]] <= pivot:
                units[i], units[below] = units[below], units[i]
                below += 1
        if below == units.size or below == 0:
            return units[rank]  # type: ignore[no-any-return]
        if rank < below:
            units = units[:below]
        else:
            units = units[below:]
            rank -= below


@kernel()
def units_at_ranks(values: Array, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """The units at these ranks (k,), from 0, of the values (n,) in ascending order.

    Values are dealt into buckets of equal width, and only those looked into that hold a rank.
    """
    n = values.size
    low = np.inf
    high = -np.inf
    for i in range(n):
        low = min(low, values[i])
        high = max(high, values[i])
    buckets = n // _SHARED + 1
    scale = buckets / (high - low)
    bucket = np.empty(n, np.int64)
    start = np.zeros(buckets + 1, np.int64)
    for i in range(n):
        place = (values[i] - low) * scale
        bucket[i] = int(place) if place < buckets else buckets - 1  # what is not a number too
        start[bucket[i] + 1] += 1
    for k in range(buckets):
        start[k + 1] += start[k]
    free = start.copy()
    dealt = np.empty(n, np.int64)
    for i in range(n):
        k = bucket[i]
        dealt[free[k]] = i
        free[k] += 1
    out = np.empty(ranks.size, np.int64)
    for i in range(ranks.size):
        k = bucket[dealt[ranks[i]]]
        out[i] = _at_rank(values, dealt[start[k] : start[k + 1]], ranks[i] - start[k])
    return out


@kernel()
def nearest_units(away: Array, count: int) -> NDArray[np.int64]:
    """The `count` units with the smallest values (n,), 1 <= count <= n."""
    near = np.empty(count, np.int64)
    kept = 0
    for i in range(away.size):
        if kept == count and not away[i] < away[near[kept - 1]]:
            continue
        kept = min(kept + 1, count)
        place = kept - 1
        while place > 0 and away[i] < away[near[place - 1]]:
            near[place] = near[place - 1]
            place -= 1
        near[place] = i
    return near
