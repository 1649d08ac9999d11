"""A sweep in units: some points of the grid each."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from pydantic import TypeAdapter

from tailstack.design import compile_design
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.shards import shard_trials
from tailstack.results.sweep import SweepPoint
from tailstack.sweeping import (
    PointCheck,
    SweepError,
    VariedNumber,
    assemble_sweep,
    count_points,
    read_axes,
    sweep_points,
)

from ...documents import to_json
from ...problems import RefusedAt
from ...processes.task import Outcome, UnitResult
from ..content import canonical, design_of, loaded_design
from .parts import plan_spans

_POINTS = TypeAdapter(tuple[SweepPoint, ...])
TARGETS_PER_UNIT = 16  # scores of a unit times their targets: some fifty milliseconds
TYPICAL_TRIALS = 2**17  # of a check to the precision that is asked for by default


def plan(request: dict[str, Any], results: Iterable[UnitResult]) -> Outcome:
    """Every point at once, then the record."""
    design, axes = design_of(request), _axes(request)
    spans = plan_spans("points", count_points(axes), _points_per_unit(request), results)
    if isinstance(spans, Outcome):
        return spans
    points = [point for span in spans for point in _POINTS.validate_json(span)]
    return Outcome(answer=to_json(assemble_sweep(design, axes, points, _check(request))))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """Some points, as JSON."""
    axes, first = _axes(request), spec["first"]
    numbers = range(first, min(first + spec["count"], count_points(axes)))
    points = sweep_points(design_of(request), axes, numbers, _check(request), threads=1)
    return canonical(_POINTS.dump_python(points))


def _check(request: dict[str, Any]) -> PointCheck:
    given = {name: request[name] for name in ("trials", "seed", "max_trials") if name in request}
    return PointCheck(request.get("check", "score"), **given)


def _axes(request: dict[str, Any]) -> tuple[VariedNumber, ...]:
    try:
        return read_axes(design_of(request), request["axes"])
    except SweepError as error:
        raise RefusedAt.place(error) from None


def _points_per_unit(request: dict[str, Any]) -> int:
    """By the design as it stands: points differ in a few numbers."""
    per_unit, targets = _size(canonical(request["design"]))
    if _check(request).kind == "score":
        return max(TARGETS_PER_UNIT // targets, 1)
    return max(per_unit // (request.get("trials") or TYPICAL_TRIALS), 1)


@lru_cache(maxsize=4)
def _size(content: bytes) -> tuple[int, int]:
    """Trials that make a unit, and targets, of a design.  Raises DesignError, IllPosedError."""
    system = compile_design(loaded_design(content))
    return shard_trials(compile_plan(system), 0), len(system.targets)
