"""Many designs from one: numbers of the document varied over a grid, each point scored or checked.

A point whose design is refused is a row with the reason; only what is wrong with the sweep itself ends it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, isfinite, prod
from typing import Any, Literal

import numpy as np

from .design import Design, compile_design, load_design
from .design.numbers import read_numbers
from .design.pointers import Place, locate_numbers, name_of, pointer_of, set_numbers, value_at
from .errors import Problem, TailstackError, describe_refusal
from .geometry.arrays import Array
from .montecarlo import MAX_TRIALS
from .results import Score, TargetEstimate, TargetScore, Verification
from .results.sweep import Sweep, SweepAxis, SweepPoint, SweepTarget
from .scoring import provenance, score
from .units import unit_label
from .verification import verify

MOST_AXES, MOST_POINTS = 6, 1_000_000
SIGNIFICANT = 12  # digits of the values of a range: 0.3, not 0.30000000000000004

Check = Literal["score", "verification"]
Progress = Callable[[int, int], None]


class SweepError(TailstackError, slug="invalid-request", title="The request is not valid", exit_code=2):
    """What is to be varied is not there, not a number, or not said in full."""


@dataclass(frozen=True, slots=True)
class VariedNumber:
    """A number of a design document and the values it takes."""

    pointer: str
    places: tuple[Place, ...]  # the steps to each number that takes the value
    values: tuple[float, ...]


def read_axes(design: Design, asked: Sequence[Mapping[str, Any]]) -> tuple[VariedNumber, ...]:
    """Axes from ``{"pointer", "values"}`` or ``{"pointer", "start", "stop", "count"}``.

    A pointer (RFC 6901) leads to a number of the document as it was written; a step ``*`` stands for every element of
    a list or mapping.  Raises SweepError that points at ``/axes/0/...``.
    """
    if not 1 <= len(asked) <= MOST_AXES:
        raise SweepError(Problem("/axes", "axes", f"a sweep has 1 to {MOST_AXES} axes; got {len(asked)}"))
    axes: list[VariedNumber] = []
    for index, entry in enumerate(asked):
        where = f"/axes/{index}"
        pointer = entry.get("pointer")
        if not isinstance(pointer, str):
            raise SweepError(Problem(f"{where}/pointer", "missing-field", "an axis names the number it varies"))
        places = locate_numbers(design.source.data, pointer, f"{where}/pointer", SweepError)
        axis = VariedNumber(pointer, places, _values(entry, where))
        for earlier in axes:
            if set(earlier.places) & set(axis.places):
                detail = f"{pointer} is varied by {earlier.pointer} already"
                raise SweepError(Problem(f"{where}/pointer", "given-twice", detail, "give its values once"))
        axes.append(axis)
    if count_points(axes) > MOST_POINTS:
        detail = f"a sweep has at most {MOST_POINTS:,} points; these axes make {count_points(axes):,}"
        raise SweepError(Problem("/axes", "too-many", detail, "take fewer values"))
    return tuple(axes)


def count_points(axes: Sequence[VariedNumber]) -> int:
    """Points of the grid."""
    return prod(len(axis.values) for axis in axes)


@dataclass(frozen=True, slots=True)
class PointCheck:
    """How each point of a sweep is computed; trials, seed and max_trials are those of ``verify``."""

    kind: Check = "score"
    trials: int | None = None
    seed: int = 0  # one for all points, which then differ by their designs alone
    max_trials: int = MAX_TRIALS


def sweep(
    design: Design,
    axes: Sequence[VariedNumber] | Mapping[str, Sequence[float] | Array],
    *,
    check: Check = "score",
    trials: int | None = None,
    seed: int = 0,
    max_trials: int = MAX_TRIALS,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Score, or check by Monte Carlo, the design with every combination of the axes' values.

    axes: values by path, ``{"views.*.fiducial_noise_px": [0.1, 0.3]}``, in the unit of the field, or what ``read_axes``
    gave; the last one runs fastest.  A point whose design is refused is a row with the reason.  trials, seed,
    max_trials, threads: of each check, see ``verify``; one seed for all points.  ``progress(done, total)`` is called
    after each point.  Raises DesignError and IllPosedError where the design itself cannot be compiled, SweepError.
    """
    if isinstance(axes, Mapping):
        data = design.source.data
        axes = read_axes(design, [{"pointer": pointer_of(data, path), "values": axes[path]} for path in axes])
    total, each = count_points(axes), PointCheck(check, trials, seed, max_trials)
    points: list[SweepPoint] = []
    for number in range(total):
        points += sweep_points(design, axes, range(number, number + 1), each, threads=threads)
        if progress is not None:
            progress(number + 1, total)
    return assemble_sweep(design, axes, points, each)


def sweep_points(
    design: Design,
    axes: Sequence[VariedNumber],
    numbers: Iterable[int],
    check: PointCheck,
    *,
    threads: int | None = None,
) -> tuple[SweepPoint, ...]:
    """Points of the grid by their numbers, the last axis running fastest."""
    places = (np.unravel_index(number, [len(axis.values) for axis in axes]) for number in numbers)
    points = (tuple(axis.values[k] for axis, k in zip(axes, place, strict=True)) for place in places)
    return tuple(_compute_point(design, axes, values, check, threads) for values in points)


def _compute_point(
    design: Design, axes: Sequence[VariedNumber], values: tuple[float, ...], check: PointCheck, threads: int | None
) -> SweepPoint:
    """The design with these values; refused with the reason where it cannot be computed."""
    result: Score | Verification
    try:
        data = set_numbers(design.source.data, [axis.places for axis in axes], values)
        varied = load_design(data, base_directory=design.source.directory)
        if check.kind == "score":
            result = score(varied, losses=False)
        else:
            result = verify(varied, trials=check.trials, seed=check.seed, max_trials=check.max_trials, threads=threads)
    except TailstackError as error:
        return SweepPoint(values, "refused", describe_refusal(error), (), None)
    targets = tuple(_target(target) for target in result.targets)
    return SweepPoint(values, "ok", None, targets, result.verdict.status, result.measures)


def assemble_sweep(
    design: Design, axes: Sequence[VariedNumber], points: Sequence[SweepPoint], check: PointCheck
) -> Sweep:
    """The record, from all points in their order.  Raises what compiling the design raises."""
    verified, system = check.kind == "verification", compile_design(design)
    return Sweep(
        schema="tailstack/sweep/1",
        axes=tuple(_axis(design, axis) for axis in axes),
        check=check.kind,
        seed=check.seed if verified else None,
        trials=check.trials if verified else None,
        max_trials=check.max_trials if verified and check.trials is None else None,
        points=tuple(points),
        provenance=provenance(system, simulated=verified, missed=bool(system.loss_probability)),
    )


def _axis(design: Design, axis: VariedNumber) -> SweepAxis:
    base = {float(value_at(design.source.data, place)) for place in axis.places}
    field = next(str(step) for step in reversed(axis.places[0]) if isinstance(step, str))
    name = name_of(design.source.data, axis.pointer)
    return SweepAxis(axis.pointer, unit_label(field), base.pop() if len(base) == 1 else None, axis.values, name)


def _target(target: TargetScore | TargetEstimate) -> SweepTarget:
    if isinstance(target, TargetEstimate):
        limit = None if target.exceedance is None else target.exceedance.limit_mm
    else:
        limit = target.limit_mm
    return SweepTarget(
        name=target.name,
        p95_mm=target.p95_mm,
        p95_interval_mm=target.p95_interval_mm if isinstance(target, TargetEstimate) else None,
        mean_norm_mm=target.mean_norm_mm,
        bias_norm_mm=hypot(*target.bias_mm),
        localisation_p95_mm=target.localisation.p95_mm,
        limit_mm=limit,
    )


# --- the grid -------------------------------------------------------------------------------------


def _values(entry: Mapping[str, Any], where: str) -> tuple[float, ...]:
    unknown = sorted(set(entry) - {"pointer", "values", "start", "stop", "count"})
    if unknown:
        raise SweepError(Problem(f"{where}/{unknown[0]}", "unknown-field", "an axis has no such field"))
    ends = [entry.get(name) for name in ("start", "stop", "count")]
    listed = entry.get("values")
    if (listed is None) == (None in ends) or (listed is not None and ends != [None] * 3):
        hint = (
            'for example {"pointer": ..., "values": [0.1, 0.2]} or {"pointer": ..., "start": 0, "stop": 1, "count": 5}'
        )
        raise SweepError(Problem(where, "one-of", "an axis has values, or start, stop and count", hint))
    if listed is not None:
        numbers = read_numbers(listed, f"{where}/values", SweepError)
        if not len(numbers):
            raise SweepError(Problem(f"{where}/values", "wrong-type", "values is a list of at least one number"))
        return tuple(_number(value, f"{where}/values/{k}") for k, value in enumerate(numbers.tolist()))
    start, stop = (_number(entry[name], f"{where}/{name}") for name in ("start", "stop"))
    count = entry["count"]
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST_POINTS:
        detail = f"count is a whole number from 1 to {MOST_POINTS:,}; got {count!r:.40}"
        raise SweepError(Problem(f"{where}/count", "out-of-range", detail))
    if count == 1:
        return (start,)
    steps = (start + (stop - start) * (k / (count - 1)) for k in range(count - 1))
    values = (*(float(f"{value:.{SIGNIFICANT}g}") for value in steps), stop)
    return tuple(_number(value, where) for value in values)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise SweepError(Problem(where, "wrong-type", f"expected a finite number; got {value!r:.40}"))
    return float(value)
