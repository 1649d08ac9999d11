"""Where targets and seat lie from the tool's and the flange's origin, and what else the transforms may mean.

At the executed pose a target is at the tool, a standoff away, and the pivot of the flange at its origin.  Where one is
far from the other as written, and near it by another reading of a number, that reading is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..units import OTHER_LENGTHS
from .cameras import compile_transform
from .document import DesignDocument, Pose
from .meanings import read_transform, scale_translation, write_numbers

TARGET, PIVOT = "target-off-tool", "pivot-off-flange"  # the rules that tell them
STANDOFF_MM = 20.0  # nearer than this, nothing is doubted
NEARER = 0.2  # of the distance as it is written: a reading that is told
FARTHEST_MM = 300.0
# By a smaller one anything meets the origin
SCALES = {unit: factor for unit, factor in OTHER_LENGTHS.items() if factor > 1}


class ToolReading(NamedTuple):
    """Another reading of a transform, the targets or the seat's pivot."""

    pointer: str
    words: str
    cure: str
    away_mm: float  # between what should be near


class ToolDoubt(NamedTuple):
    """Two places that should be near one another, and the readings that bring them there, the nearest first."""

    rule: str
    what: str
    away_mm: float
    readings: list[ToolReading]


Transforms = dict[str, Array]
Gap = Callable[[Transforms, Array, Array], float]  # of transforms, targets (T, 3) and the pivot (3,) of the flange, con


def doubt_tool(document: DesignDocument) -> Iterator[ToolDoubt]:
    """What is far apart, and near by another reading; a target that is far from the tool by any."""
    stated = {name: getattr(document.transforms, name) for name in ("T_flange_con", "T_tcp_flange")}
    seat = document.interfaces.connector_flange
    if not any(value is not None for value in stated.values()):
        return
    written = {name: compile_transform(value, "", []) for name, value in stated.items()}
    pivot = np.zeros(3) if seat is None else np.array(seat.pivot_mm)
    targets = np.array([_middle(target) for target in document.targets])
    readings = [*_read_transforms(stated, written), *_read_places()]
    away = _miss_tool(written, targets, pivot)
    if away > STANDOFF_MM:
        found = _find(readings, _miss_tool, away, written, targets, pivot)
        if found or away > FARTHEST_MM:
            yield ToolDoubt(TARGET, "the nearest target lies {} mm from the tool's origin (tcp)", away, found)
            return
    apart = _miss_seat(written, targets, pivot)
    if stated["T_flange_con"] is not None and pivot.any() and apart > STANDOFF_MM:
        # where the target is at the tool, the transforms are right: then it is the pivot
        readings = [each for each in readings if away > STANDOFF_MM or each[0].startswith("/interfaces")]
        found = _find(readings, _miss_seat, apart, written, targets, pivot)
        if found:
            yield ToolDoubt(PIVOT, "the pivot of connector_flange lies {} mm from the flange's origin", apart, found)


def _middle(target: Any) -> Any:
    shape = target.region and (target.region.box or target.region.sphere)
    return shape.centre_mm if shape else target.position_mm


def _miss_tool(transforms: Transforms, targets: Array, pivot: Array) -> float:
    whole = transforms["T_tcp_flange"] @ transforms["T_flange_con"]
    return float(np.linalg.norm(targets @ whole[:3, :3].T + whole[:3, 3], axis=1).min())


def _miss_seat(transforms: Transforms, targets: Array, pivot: Array) -> float:
    at = transforms["T_flange_con"]
    return float(np.linalg.norm(at[:3, :3] @ pivot + at[:3, 3]))


Reading = tuple[
    str, str, str, Transforms, float, float
]  # pointer, words, cure, transforms, scales of targets and pivot


def _find(
    readings: list[Reading], gap: Gap, away: float, written: Transforms, targets: Array, pivot: Array
) -> list[ToolReading]:
    found: dict[str, ToolReading] = {}
    for pointer, words, cure, read, targets_by, pivot_by in readings:
        left = gap(written | read, targets_by * targets, pivot_by * pivot)
        if left <= max(NEARER * away, STANDOFF_MM / 2):
            found.setdefault(cure, ToolReading(pointer, words, cure, left))  # an inverse may be a sign: once
    return sorted(found.values(), key=lambda reading: reading.away_mm)


def _read_transforms(stated: dict[str, Any], written: Transforms) -> Iterator[Reading]:
    inverses: dict[str, tuple[str, Array]] = {}
    for name, value in stated.items():
        if value is None:
            continue
        _, to, of = name.split("_")
        for form, matrix in read_transform(value, written[name], f"{to} to {of}"):
            for unit, factor in {"": 1.0, **(SCALES if not form else {})}.items():
                if not form and not unit:
                    continue
                read = scale_translation(matrix, factor)
                cure = f"write {name}: {write_numbers(read)}"
                if isinstance(value, Pose) and np.array_equal(read[:3, :3], written[name][:3, :3]):
                    cure = f"write {name}: translation_mm: {write_numbers(read[:3, 3])}"
                if form.startswith("its inverse"):
                    inverses[name] = cure, read
                words = f"{name} in {unit}" if unit else f"{name} read as {form}"
                yield f"/transforms/{name}", words, cure, {name: read}, 1.0, 1.0
    if len(inverses) == 2:
        cures = " and ".join(cure for cure, _ in inverses.values())
        both = {name: read for name, (_, read) in inverses.items()}
        yield "/transforms", "both transforms read as their inverses", cures, both, 1.0, 1.0


def _read_places() -> Iterator[Reading]:
    for unit, factor in SCALES.items():
        yield "/targets", f"the targets in {unit}", f"multiply the targets by {factor:g}", {}, factor, 1.0
        at = "/interfaces/connector_flange/pivot_mm"
        yield at, f"the pivot in {unit}", f"multiply pivot_mm by {factor:g}", {}, 1.0, factor
