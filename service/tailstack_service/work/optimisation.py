"""An optimisation in units: some starts each; the last look settles, verifies and compares what they ended at.

``optimise`` is replayed with the recorded ends, so the document is that of one undisturbed process, byte for byte.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from tailstack.errors import InfeasibleError, NotConvergedError, TailstackError
from tailstack.optimisation.optimising import Asked, ask, finish
from tailstack.optimisation.program import Point
from tailstack.optimisation.search import Prepared, Search, conclude, prepare_search, solve_start
from tailstack.packed import pack, unpack

from ..documents import to_json
from .kinds import Done, More, Step
from .requests import canonical, loaded_design
from .task import UnitResult

Key = tuple[bytes, int | None, int | None]  # design, seed, starts

# Building the programme costs as much as solving ten starts from it (0.4 s and 0.03 s at twelve fiducials), and every
# process that is given a unit has to build it once.
STARTS_PER_UNIT = 4


def advance(request: dict[str, Any], results: Iterable[UnitResult]) -> Step:
    """First every start, at every number of fiducials; then the answer."""
    asked = _asked(*_key(request))
    held = {unit.spec: unit.result for unit in results}
    specs = [_spec(position, first) for position in _searched(asked) for first in _groups(asked)]
    missing = tuple(spec for spec in specs if spec not in held)
    if missing:
        starts = asked.starts * len(_searched(asked))
        return More(missing, 0, f"solving from {starts} starts, then the best is settled and verified")

    def searched(position: int) -> Search:
        prepared = _prepared(*_key(request), position)
        if isinstance(prepared, TailstackError):
            raise prepared
        if position not in _searched(asked):
            points = [solve_start(prepared, k) for k in range(len(prepared.begun))]
        else:
            points = [point for first in _groups(asked) for point in _points(held[_spec(position, first)])]
        return conclude(prepared, (point for point in points))

    return Done(to_json(finish(asked, searched, threads=1)))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """Where some starts end; nothing where the search is refused before it begins: the last look says why."""
    prepared = _prepared(*_key(request), spec["position"])
    if isinstance(prepared, TailstackError):
        return _bytes([])
    numbers = range(spec["first"], min(spec["first"] + spec["count"], len(prepared.begun)))
    return _bytes([solve_start(prepared, number) for number in numbers])


def _searched(asked: Asked) -> list[int]:
    """Numbers of fiducials, by position, whose starts are units of their own: where a layout may change."""
    return [position for position, problem in enumerate(asked.problems) if problem.places]


def _groups(asked: Asked) -> range:
    return range(0, asked.starts, STARTS_PER_UNIT)


def _spec(position: int, first: int) -> bytes:
    return canonical({"what": "starts", "position": position, "first": first, "count": STARTS_PER_UNIT})


def _key(request: dict[str, Any]) -> Key:
    return canonical(request["design"]), request.get("seed"), request.get("starts")


@lru_cache(maxsize=4)
def _asked(design: bytes, seed: int | None, starts: int | None) -> Asked:
    return ask(loaded_design(design), seed=seed, starts=starts)


@lru_cache(maxsize=2)  # a large programme holds hundreds of megabytes
def _prepared(design: bytes, seed: int | None, starts: int | None, position: int) -> Prepared | TailstackError:
    """A search before its starts are solved, or its refusal: that takes a search of its own to find."""
    asked = _asked(design, seed, starts)
    try:
        return prepare_search(asked.problems[position], starts=asked.starts, seed=asked.seed, threads=1)
    except (InfeasibleError, NotConvergedError) as refused:
        return refused


def _bytes(points: list[Point]) -> bytes:
    head = {"solved": [point.solved for point in points], "iterations": [point.iterations for point in points]}
    arrays = [[p.x, p.row_multipliers, p.bound_multipliers, np.array(p.objective)] for p in points]
    return pack(head, [array for own in arrays for array in own])


def _points(content: bytes) -> list[Point]:
    head, arrays = unpack(content)
    own = [arrays[k : k + 4] for k in range(0, len(arrays), 4)]
    return [
        Point(x, rows, bounds, float(objective), solved, iterations)
        for (x, rows, bounds, objective), solved, iterations in zip(
            own, head["solved"], head["iterations"], strict=True
        )
    ]
