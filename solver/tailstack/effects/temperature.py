"""Operation at another temperature than that at which the structure was measured: structure and connector grow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Self

import numpy as np
from pydantic import Field

from ..errors import Problem
from ..fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    INTERFACES,
    AnyLaw,
    CoverageFactor,
    Point,
    Record,
    Typical,
    leave_out_later,
    with_law,
)
from ..geometry.arrays import frozen
from ..laws import Drawn
from ..ranges import DIFFERENCE_K, EXPANSION
from ..system import Act, ArrayLike, Effect, Place, Scene, Sources, System
from ..tolerances import HowOften, Source, gather_sources, level_field
from .kind import EffectKind, Limit, Pivots, Proportional, Setting

_Expansion = Annotated[float, Field(ge=-100, le=1000), Typical(5, 100), EXPANSION]


class Temperature(Record):
    """Operation at another temperature than that at which the fiducials were measured.

    The structure grows about its seat on the connector, the connector about its seat on the flange.
    """

    difference_k: Annotated[float, Field(ge=-300, le=300), Typical(-20, 20), DIFFERENCE_K] = Field(
        default=0.0, examples=[15.0]
    )
    """Known difference, K: operation less measurement. Default 0."""
    half_width_k: Annotated[float, Field(ge=0, le=300), Typical(0.5, 10), DIFFERENCE_K] = Field(
        default=0.0, examples=[5.0]
    )
    """Half-width of the difference about it, K."""
    distribution: AnyLaw | None = Field(
        default=None, description=BOUNDED_WORDS + " Required with half_width_k.", examples=["uniform"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])
    structure_expansion_um_per_m_k: _Expansion = Field(examples=[47.0])
    """Thermal expansion of the structure, um/(m K): PEEK 47, aluminium 23, steel 12 to 16, titanium 9."""
    connector_expansion_um_per_m_k: _Expansion = Field(default=0.0, examples=[23.0])
    """The same of the connector. Default 0."""
    seat_mm: Annotated[Point, Typical(-100, 100)] | None = Field(default=None, examples=[[0.0, 0.0, -95.0]])
    """Where structure and connector hold each other, con, mm. Default the pivot of structure_connector."""
    flange_seat_mm: Annotated[Point, Typical(-100, 100)] | None = Field(default=None, examples=[[0.0, 0.0, -150.0]])
    """Where the connector sits on the flange, con, mm. Default the pivot of connector_flange."""
    drawn: HowOften = level_field(Drawn.SHOT)

    _as_before = leave_out_later("drawn")
    _law = with_law("half_width_k")


class OfDesign(Record):
    """What a design says of it."""

    temperature: Temperature | None = None
    """Operation at another temperature. Absent: nothing expands."""


@dataclass(frozen=True, slots=True, eq=False)
class ThermalEffect(Effect):
    """Structure and connector grow in proportion to the difference, its parameter, about their seats."""

    structure_per_k: float  # relative
    connector_per_k: float  # relative
    seat_mm: ArrayLike  # (3,) con: where structure and connector hold each other
    flange_seat_mm: ArrayLike  # (3,) con: where the connector sits on the flange
    at_pivots: tuple[bool, bool] = (False, False)  # whether the two are the pivots of the interfaces, and go with them

    def act(self, scene: Scene) -> tuple[Act, ...]:
        grown = self.structure_per_k * (scene.fiducials_mm - self.seat_mm)
        apart = self.connector_per_k * (self.seat_mm - self.flange_seat_mm)  # how the seats move away from one another
        return Act(Place.BEADS, None, grown.reshape(-1, 1)), Act(Place.CONNECTOR, None, -apart[:, None])

    def with_seats_at(self, first_pivot_mm: ArrayLike, second_pivot_mm: ArrayLike) -> Self:
        return replace(
            self,
            seat_mm=first_pivot_mm if self.at_pivots[0] else self.seat_mm,
            flange_seat_mm=second_pivot_mm if self.at_pivots[1] else self.flange_seat_mm,
        )

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.BEADS, None), (Place.CONNECTOR, None))


def temperature(
    difference_k: float,
    sources: Sources,
    expansion_per_k: tuple[float, float],
    seats_mm: tuple[ArrayLike, ArrayLike],
    at_pivots: tuple[bool, bool] = (False, False),
    drawn: Drawn = Drawn.SHOT,
) -> ThermalEffect:
    """The effect: sources of the difference about the known one, none or one in K; expansions of the structure and the
    connector, relative; their seats (3,), con."""
    name, known = "temperature", frozen([difference_k])
    return ThermalEffect(name, name, f"/{name}", drawn, sources, known, *expansion_per_k, *seats_mm, at_pivots)


def _compile(section: OfDesign, setting: Setting) -> Iterator[Effect]:
    if (declared := section.temperature) is None:
        return
    pivots = [setting.pivots_mm.get(interface, (0.0, 0.0, 0.0)) for interface in INTERFACES]
    stated = declared.seat_mm, declared.flange_seat_mm
    first, second = (frozen(pivot if seat is None else seat) for seat, pivot in zip(stated, pivots, strict=True))
    law, width, factor = str(declared.distribution), declared.half_width_k, declared.coverage_factor
    sources = gather_sources([Source("difference", law, width, factor, "K", np.ones(1))] if width > 0 else [], 1)
    expansions = declared.structure_expansion_um_per_m_k * 1e-6, declared.connector_expansion_um_per_m_k * 1e-6
    at_pivots = declared.seat_mm is None, declared.flange_seat_mm is None
    yield temperature(declared.difference_k, sources, expansions, (first, second), at_pivots, declared.drawn)


def _check(section: OfDesign, pivots_mm: Pivots) -> Iterator[Problem]:
    """What expands does so about a seat: it is stated, or the pivot of a declared interface."""
    if (declared := section.temperature) is None:
        return
    needed = [("seat_mm", declared.seat_mm, "structure_connector")]
    if declared.connector_expansion_um_per_m_k != 0:
        needed.append(("flange_seat_mm", declared.flange_seat_mm, "connector_flange"))
    for field, given, interface in needed:
        if given is None and interface not in pivots_mm:
            detail = f"{field} is not given, and interfaces.{interface}, whose pivot it would be, is not declared"
            yield Problem(f"/temperature/{field}", "missing-field", detail, f"give {field}: [x, y, z] in con, mm")


def _not_modelled(system: System) -> str:
    return "" if _find(system) else "thermal expansion"


def _find(system: System) -> list[ThermalEffect]:
    return [effect for effect in system.effects if isinstance(effect, ThermalEffect)]


def _limits(system: System) -> Iterator[Limit]:
    """How much the structure grows or shrinks at most: it errs by as much."""
    growth = [
        abs(heat.structure_per_k) * (abs(heat.known[0]) + heat.sources.half_width.sum()) for heat in _find(system)
    ]
    yield Proportional("growth by temperature of {} %", max(growth, default=0.0))


KIND = EffectKind(
    host="design", section=OfDesign, compile=_compile, not_modelled=_not_modelled, check=_check, limits=_limits
)
