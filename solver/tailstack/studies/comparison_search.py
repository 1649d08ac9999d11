"""Where a smooth cost is least, and how far what is plausible reaches: one number, looked for along a line."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

REFINEMENTS = 10  # bisections of an end


def least(cost: Callable[[float], float], low: float, high: float, near: float) -> float:
    """Where a function is least between two places, by golden section to within ``near``; ends included."""
    section = (sqrt(5) - 1) / 2
    ends = low, high
    inner = [high - section * (high - low), low + section * (high - low)]
    costs = [cost(inner[0]), cost(inner[1])]
    while high - low > near:
        if costs[0] <= costs[1]:
            high, inner[1], costs[1] = inner[1], inner[0], costs[0]
            inner[0] = high - section * (high - low)
            costs[0] = cost(inner[0])
        else:
            low, inner[0], costs[0] = inner[0], inner[1], costs[1]
            inner[1] = low + section * (high - low)
            costs[1] = cost(inner[1])
    return min((*inner, *ends), key=cost)


def last(plausible: Callable[[float], float], inside: float, outside: float, level: float) -> float:
    """The last plausible place between one that is and one that is not."""
    for _ in range(REFINEMENTS):
        middle = (inside + outside) / 2
        if plausible(middle) >= level:
            inside = middle
        else:
            outside = middle
    return inside


def reach(plausible: Callable[[float], float], seed: float, end: float, step: float, level: float) -> float:
    """How far from a plausible place the plausible ones go towards ``end``, by steps that double."""
    inside, direction = seed, 1.0 if end > seed else -1.0
    while inside != end:
        further = min(seed + step, end) if direction > 0 else max(seed - step, end)
        if plausible(further) < level:
            return last(plausible, inside, further, level)
        inside, step = further, 2 * step
    return inside
