"""An optimisation in units: some starts each, and the points of a front; the last look settles, verifies, compares.

Where views are free it is one unit: which way to aim is tried one after another, each from what the last one gave.

``optimise`` is replayed with what is recorded, so the document is that of one undisturbed process, byte for byte.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from tailstack.errors import InfeasibleError, NotConvergedError, TailstackError
from tailstack.montecarlo.shards import Pending, pack, unpack
from tailstack.optimisation.cost_bound import enough_for
from tailstack.optimisation.course import optimise_task
from tailstack.optimisation.front import front_factors, front_point, mark_dominated
from tailstack.optimisation.program import Point
from tailstack.optimisation.search import (
    Control,
    Iterate,
    PreparedSearch,
    Search,
    conclude_search,
    prepare_search,
    solve_start,
)
from tailstack.optimisation.task import OptimisationTask, frees_views, read_task
from tailstack.results import FrontPoint

from ...documents import to_json
from ...processes.task import Outcome, UnitResult
from ..content import canonical, loaded_design
from .parts import compute_whole, plan_whole

_FRONT_POINT = TypeAdapter(FrontPoint)
Key = tuple[bytes, int | None, int | None, float | None]  # design, seed, starts, gap

# Building the programme costs as much as solving ten starts from it (0.4 s and 0.03 s at twelve fiducials), and every
# process that is given a unit has to build it once.
STARTS_PER_UNIT = 4
ONE_THREAD = Control(threads=1)


def plan(request: dict[str, Any], results: Iterable[UnitResult]) -> Outcome:
    """First every start, at every number of fiducials; then the points of a front; then the answer."""
    if frees_views(loaded_design(canonical(request["design"]))):
        return plan_whole(tuple(results))
    task = _task(*_key(request))
    held = {unit.spec: unit.result for unit in results}
    try:
        ends = {position: _ends(task, held, position) for position in _list_searches(task)}
    except Pending as pending:
        starts = task.starts * len(_list_searches(task))
        note = f"solving from {starts} starts, then the best is settled and verified"
        return Outcome(more=pending.wanted, note=note)
    try:
        searcher = RecordedSearcher(_key(request), task, ends, held)
        return Outcome(answer=to_json(optimise_task(task, searcher, ONE_THREAD)))
    except Pending as pending:
        return Outcome(more=pending.wanted, note=f"{len(pending.wanted)} points of the front")


@dataclass(frozen=True, slots=True)
class RecordedSearcher:
    """A searcher of what is recorded; it raises Pending with the specs of the points of a front that are not."""

    key: Key
    task: OptimisationTask
    ends: Mapping[int, list[Point]]  # where the starts at a number of fiducials ended, where these are units
    held: Mapping[bytes, bytes]

    def search(self, position: int) -> Search:
        prepared = _prepare(*self.key, position)
        if isinstance(prepared, TailstackError):
            raise type(prepared)(prepared.problems)
        recorded = self.ends.get(position)
        solved = (solve_start(prepared, start) for start in prepared.starts)
        return conclude_search(prepared, solved if recorded is None else (point for point in recorded), ONE_THREAD)

    def trace_front(self, position: int, search: Search) -> tuple[FrontPoint, ...]:
        prepared = _prepare(*self.key, position)
        assert isinstance(prepared, PreparedSearch)  # or it had not been searched
        specs = _front_specs(self.task, position, search, prepared)
        _all_there(specs, self.held)
        return mark_dominated([_FRONT_POINT.validate_json(self.held[spec]) for spec in specs])


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """Where some starts end, or a point of the front.

    Nothing where the search is refused before it begins: the last look says why.
    """
    if spec["what"] == "whole":
        from ..optimisation import OPERATION

        return compute_whole(OPERATION, request)
    prepared = _prepare(*_key(request), spec["position"])
    if isinstance(prepared, TailstackError):
        return _bytes([])
    if spec["what"] == "front":
        iterates = tuple(
            Iterate(
                _points(b64decode(item["point"]))[0],
                (prepared.ends if item["led"] else prepared.starts)[item["start"]].parameters,
            )
            for item in spec["found"]
        )
        search = Search(prepared.program, iterates, prepared.terms, 0, 0, (), "")
        point = front_point(_task(*_key(request)), search, spec["number"], spec["factor"], ONE_THREAD)
        return canonical(_FRONT_POINT.dump_python(point))
    wanted = islice(prepared.starts, spec["first"], spec["first"] + spec["count"])
    return _bytes([solve_start(prepared, start) for start in wanted])


def _all_there(specs: list[bytes], held: Mapping[bytes, bytes]) -> None:
    missing = [spec for spec in specs if spec not in held]
    if missing:
        raise Pending(missing)


def _ends(task: OptimisationTask, held: Mapping[bytes, bytes], position: int) -> list[Point]:
    """Where the starts at one number of fiducials ended.  Raises Pending for those at all numbers."""
    _all_there([_spec(place, first) for place in _list_searches(task) for first in _groups(task)], held)
    return [point for first in _groups(task) for point in _points(held[_spec(position, first)])]


def _front_specs(task: OptimisationTask, position: int, search: Search, prepared: PreparedSearch) -> list[bytes]:
    """The best layouts go into the spec: to find them again would take every start."""
    starts = {id(begun.parameters): number for number, begun in enumerate(prepared.starts)}
    led = {id(end.parameters): number for number, end in prepared.ends.items()}
    layouts = []
    for item in search.iterates:
        was_led = id(item.parameters) in led
        number = (led if was_led else starts)[id(item.parameters)]
        layouts.append({"start": number, "led": was_led, "point": b64encode(_bytes([item.point])).decode()})
    return [
        canonical({"what": "front", "position": position, "number": number, "factor": factor, "found": layouts})
        for number, factor in enumerate(front_factors(task.request, search))
    ]


def _list_searches(task: OptimisationTask) -> list[int]:
    """Numbers of fiducials, by position, whose starts are units of their own: where a layout may change."""
    return [position for position, problem in enumerate(task.problems) if problem.places]


def _groups(task: OptimisationTask) -> range:
    return range(0, task.starts, STARTS_PER_UNIT)


def _spec(position: int, first: int) -> bytes:
    return canonical({"what": "starts", "position": position, "first": first, "count": STARTS_PER_UNIT})


def _key(request: dict[str, Any]) -> Key:
    return canonical(request["design"]), request.get("seed"), request.get("starts"), request.get("gap")


@lru_cache(maxsize=4)
def _task(design: bytes, seed: int | None, starts: int | None, gap: float | None) -> OptimisationTask:
    return read_task(loaded_design(design), seed=seed, starts=starts, gap=gap)


@lru_cache(maxsize=2)  # a large programme holds hundreds of megabytes
def _prepare(
    design: bytes, seed: int | None, starts: int | None, gap: float | None, position: int
) -> PreparedSearch | TailstackError:
    """A search before its starts are solved, or its refusal: that takes a search of its own to find."""
    task = _task(design, seed, starts, gap)
    problem = task.problems[position]
    try:
        enough = enough_for(problem, gap)
        return prepare_search(problem, starts=task.starts, seed=task.seed, control=ONE_THREAD, enough=enough)
    except (InfeasibleError, NotConvergedError) as refused:
        return refused.with_traceback(None)  # its frames hold the programme


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
