"""A torsor as a design states it, known part and tolerances, and what they compile to: rad, mm, laws.

Interfaces, hand-eye calibration and motion between the shots are all stated in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from .fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    AnyLaw,
    Coordinate,
    CoverageFactor,
    Degrees,
    HalfWidth,
    HalfWidthDegrees,
    Record,
    with_law,
)
from .geometry.arrays import Array, frozen
from .ranges import KNOWN_DEG, KNOWN_MM, SEAT_DEG, SEAT_MM
from .system import TORSOR_COMPONENTS, Law, Sources, no_sources

DEFAULT_COVERAGE = 2.0


class Bias(Record):
    """A known displacement: X -> R (X - pivot) + pivot + t with R = Rx(rx) Ry(ry) Rz(rz)."""

    rx_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, description="Rotation about x, degrees.", examples=[0.1])
    ry_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, description="Rotation about y, degrees.", examples=[0.0])
    rz_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, description="Rotation about z, degrees.", examples=[0.0])
    tx_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, description="Translation along x, mm.", examples=[0.0])
    ty_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, description="Translation along y, mm.", examples=[0.0])
    tz_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, description="Translation along z, mm.", examples=[0.05])

    @property
    def torsor(self) -> Array:
        """(6,) rad, mm."""
        turns = [radians(self.rx_deg), radians(self.ry_deg), radians(self.rz_deg)]
        return frozen([*turns, self.tx_mm, self.ty_mm, self.tz_mm])


class RotationTolerance(Record):
    """Half-width of one rotation."""

    half_width_deg: Annotated[HalfWidthDegrees, SEAT_DEG] = Field(
        description="Half-width h of the rotation, degrees.", examples=[0.05]
    )
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_deg")


class TranslationTolerance(Record):
    """Half-width of one translation."""

    half_width_mm: Annotated[HalfWidth, SEAT_MM] = Field(
        description="Half-width h of the translation, mm.", examples=[0.02]
    )
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_mm")


class Tolerances(Record):
    """One tolerance per component of the torsor; a component that is not given does not vary."""

    rx: RotationTolerance | None = Field(default=None, description="Rotation about x through the pivot.")
    ry: RotationTolerance | None = Field(default=None, description="Rotation about y through the pivot.")
    rz: RotationTolerance | None = Field(default=None, description="Rotation about z through the pivot.")
    tx: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along x.")
    ty: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along y.")
    tz: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along z.")

    @property
    def sources(self) -> Sources:
        """One source per declared component; its direction (6,) is that unit torsor."""
        return compile_sources({name: getattr(self, name) for name in TORSOR_COMPONENTS})


class Source(NamedTuple):
    """A scalar source as a design states it, its half-width in rad, mm, N, K, px or as a part of one."""

    name: str
    law: str
    half_width: float
    coverage_factor: float | None
    unit: str
    direction: Array  # (d,)


def gather_sources(stated: Sequence[Source], dimension: int) -> Sources:
    """Independent sources that act on a vector of ``dimension`` d."""
    if not stated:
        return no_sources(dimension)
    names, laws, half_widths, factors, units, directions = zip(*stated, strict=True)
    coverage = [coverage_of(law, factor) for law, factor in zip(laws, factors, strict=True)]
    ways = frozen(np.column_stack(directions))
    return Sources(names, tuple(map(Law, laws)), frozen(half_widths), frozen(coverage), units, ways)


def compile_sources(components: Mapping[str, RotationTolerance | TranslationTolerance | None]) -> Sources:
    """One source for each of d components that has a tolerance, rad or mm; its direction (d,) is that component."""
    stated = []
    for (name, item), way in zip(components.items(), np.eye(len(components)), strict=True):
        if item is not None:
            if isinstance(item, RotationTolerance):
                width, unit = radians(item.half_width_deg), "rad"
            else:
                width, unit = item.half_width_mm, "mm"
            stated.append(Source(name, item.distribution, width, item.coverage_factor, unit, way))
    return gather_sources(stated, len(components))


def coverage_of(law: str, factor: float | None) -> float:
    """Standard deviations in a half-width under a normal law, 1 under others."""
    if law != "normal":
        return 1.0
    return DEFAULT_COVERAGE if factor is None else factor
