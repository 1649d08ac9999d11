"""Where the targets lie in the tool's frame, and what else the two transforms may mean that brings them near it.

At the executed pose the target is at the tool, a standoff away: a target that is far from the tcp's origin and near it
by another reading of one of the transforms tells that reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..ranges import LENGTHS
from .cameras import compile_transform
from .document import DesignDocument, Pose
from .meanings import read_transform, write_numbers

STANDOFF_MM = 20.0  # nearer than this, nothing is doubted
NEARER = 0.2  # of the distance as it is written: a reading that is said
FARTHEST_MM = 300.0
SCALES = {unit: factor for unit, factor in LENGTHS.items() if factor > 1}  # by a smaller one anything meets the origin
NAMES = ("T_flange_con", "T_tcp_flange")


class ToolReading(NamedTuple):
    """Another reading of the transforms, or of the targets."""

    pointer: str
    words: str
    cure: str
    away_mm: float  # of the nearest target from the tcp's origin


def list_places(document: DesignDocument) -> list[tuple[str, Array]]:
    """(name, (3,) mm con) of each target, of a region its middle."""
    places = []
    for target in document.targets:
        region = target.region
        shape = region and (region.box or region.sphere)
        places.append((target.name, np.array(shape.centre_mm if shape else target.position_mm)))
    return places


def find_readings(document: DesignDocument) -> tuple[float, list[ToolReading]]:
    """How far the nearest target is from the tcp's origin, mm, and the readings that bring it near, the nearest first;
    none where it is near as it is written, or no transform is given."""
    stated = {name: getattr(document.transforms, name) for name in NAMES}
    if all(each is None for each in stated.values()):
        return 0.0, []
    written = {name: compile_transform(value, "", []) for name, value in stated.items()}
    points = np.array([place for _, place in list_places(document)])
    away = _measure(written, points)
    if away <= STANDOFF_MM:
        return away, []
    readings = [
        each for each in _list_readings(stated, written, points) if each.away_mm <= max(NEARER * away, STANDOFF_MM / 2)
    ]
    once = {each.cure: each for each in reversed(readings)}  # of an inverse and a sign that are the same, the first
    return away, sorted(once.values(), key=lambda reading: reading.away_mm)


def _measure(transforms: dict[str, Array], points: Array) -> float:
    whole = transforms["T_tcp_flange"] @ transforms["T_flange_con"]
    return float(np.linalg.norm(points @ whole[:3, :3].T + whole[:3, 3], axis=1).min())


def _list_readings(stated: dict[str, Any], written: dict[str, Array], points: Array) -> Iterator[ToolReading]:
    inverses = {}
    for name, value in stated.items():
        if value is None:
            continue
        _, to, of = name.split("_")
        for form, matrix in read_transform(value, written[name], f"{to} to {of}"):
            if form.startswith("its inverse"):
                inverses[name] = matrix
            for unit, factor in {"": 1.0, **(SCALES if not form else {})}.items():
                if form or unit:
                    read = matrix * np.array([1.0, 1.0, 1.0, factor])
                    read[3, 3] = 1.0
                    words = f"{name} in {unit}" if unit else f"{name} read as {form}"
                    yield ToolReading(
                        f"/transforms/{name}", words, _write(name, value, read, written[name]),
                        _measure(written | {name: read}, points),
                    )  # fmt: skip
    if len(inverses) == 2:
        cures = " and ".join(_write(name, stated[name], read, written[name]) for name, read in inverses.items())
        yield ToolReading("/transforms", "both transforms read as their inverses", cures, _measure(inverses, points))
    for unit, factor in SCALES.items():
        cure = f"multiply the targets by {factor:g}"
        yield ToolReading("/targets", f"the targets in {unit}", cure, _measure(written, factor * points))


def _write(name: str, value: Any, read: Array, written: Array) -> str:
    if np.array_equal(read[:3, :3], written[:3, :3]) and isinstance(value, Pose):
        return f"write {name}: translation_mm: {write_numbers(read[:3, 3])}"
    return f"write {name}: {write_numbers(read)}"
