"""The one way in which a test waits: for a condition, under one generous limit, and with a word of what was last seen.

A limit is never what a test is about: it only ends a test whose condition will not come true any more.  What a test
wants to know of time it asks of a clock that it turns (``turned_clock.py``), or as a count.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from typing import TypeVar

LIMIT_SECONDS = float(os.environ.get("TAILSTACK_TESTS_LIMIT_SECONDS", "600"))  # of every wait in the tests
LOOK_SECONDS = 0.01  # between the first looks at a condition
# Of what was waited for already, between later ones: to look takes from what is waited for, where processors are few
SHARE, MOST_LOOK_SECONDS = 0.1, 0.25

T = TypeVar("T")


def until(condition: Callable[[], T], says: Callable[[], object] = lambda: "it never came true") -> T:
    """What the condition gives once it is true; ``says`` is asked what there is to see where it never becomes so."""
    begun = time.monotonic()
    while not (found := condition()):
        time.sleep(_gap(time.monotonic() - begun, says))
    return found


async def until_async(condition: Callable[[], T], says: Callable[[], object] = lambda: "it never came true") -> T:
    """The same inside of an event loop, which goes on meanwhile."""
    begun = time.monotonic()
    while not (found := condition()):
        await asyncio.sleep(_gap(time.monotonic() - begun, says))
    return found


def _gap(waited: float, says: Callable[[], object]) -> float:
    """Seconds until the next look, for who has waited so long; an AssertionError beyond the limit."""
    assert waited < LIMIT_SECONDS, f"after {LIMIT_SECONDS:g} s: {says()}"
    return min(max(LOOK_SECONDS, SHARE * waited), MOST_LOOK_SECONDS)
