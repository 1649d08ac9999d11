"""What beads that are drilled in one clamping have in common: they sit together off from where they are drawn.

A turn, a shift and a scale, beside what each bead has of its own (``manufacturing``).  Of all beads together, turn and
shift are those of the seat; of beads in several clampings they bend the structure, which no seat does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ..fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    AnyLaw,
    CoverageFactor,
    Name,
    Point,
    Record,
    Typical,
    leave_out_later,
    refusal,
    refuse_repeated,
    with_law,
)
from ..geometry.arrays import frozen
from ..laws import Drawn
from ..ranges import BEAD_PLACE_MM, DRILLING_SCALE, SEAT_DEG
from ..system import Act, ArrayLike, Effect, Law, Place, Scene, Sources, System
from ..tolerances import HowOften, Tolerances, coverage_of, level_field
from .kind import EffectKind, Limit, Proportional, Setting

LARGEST_DEG = 1.0  # a turn by a is taken to first order: what is left out is a^2 / 2 of the lever, 0.015 %


class ScaleTolerance(Record):
    """Half-width of a scale: distances from the pivot, as a part of themselves."""

    half_width_rel: Annotated[float, Field(ge=0, le=0.1), Typical(2e-5, 1e-3), DRILLING_SCALE] = Field(
        examples=[0.0001]
    )
    """Half-width h, as a part of every distance from the pivot: 0.0001 is 5 um at 50 mm."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["normal"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_rel")


class Clamping(Record):
    """Fiducials that were drilled in one clamping, and how far they may sit off together."""

    name: Name | None = Field(default=None, examples=["upper face"])
    """Name; default C1, C2, ... by position in the list."""
    fiducials: Annotated[list[Name], Field(min_length=1)] | None = Field(default=None, examples=[["F1", "F2", "F3"]])
    """Labels of those drilled in it. Default: all."""
    pivot_mm: Annotated[Point, Typical(-60, 60)] | None = Field(default=None, examples=[[0.0, 0.0, -95.0]])
    """Point in con that turn and scale are about, mm: the datum they are drilled from. Default the centroid of its
    fiducials."""
    tolerances: Annotated[
        Tolerances,
        Typical(0.005, 0.1, of="half_width_deg"),
        Typical(0.005, 0.1, of="half_width_mm"),
        SEAT_DEG,
        BEAD_PLACE_MM,
    ] = Field(default_factory=Tolerances)
    """Half-width and law of their common turn and shift."""
    scale: ScaleTolerance | None = None
    """Of their common scale. Absent: exact."""
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn")

    @model_validator(mode="after")
    def _small(self) -> Self:
        for name, tolerance in list(self.tolerances.components.items())[:3]:
            if tolerance is not None and tolerance.width > LARGEST_DEG:
                words = f"{name} is at most {LARGEST_DEG:g} degree here, for it is taken to first order"
                cure = "a part that turns by more is not drilled but mounted: state it as an interface"
                raise refusal("out-of-range", f"{words}; got {tolerance.width:g}", cure, "tolerances")
        return self

    @property
    def sources(self) -> Sources:
        """Direction (7, k): a torsor and a scale, rad, mm and 1."""
        own = self.tolerances.sources
        direction = np.vstack([own.direction, np.zeros((1, own.count))])
        if (scale := self.scale) is None:
            return replace(own, direction=frozen(direction))
        return Sources(
            (*own.names, "scale"),
            (*own.laws, Law(scale.distribution)),
            frozen([*own.half_width, scale.half_width_rel]),
            frozen([*own.coverage_factor, coverage_of(scale.distribution, scale.coverage_factor)]),
            (*own.units, "1"),
            frozen(np.column_stack([direction, np.eye(7)[-1]])),
            own.together,
        )


class CommonOfFiducials(Record):
    """What the fiducials say of it."""

    common: Annotated[list[Clamping], Field(min_length=1, max_length=6)] | None = None
    """What fiducials drilled in one clamping have in common, clamping by clamping, beside what each has of its own
    (manufacturing). Absent: nothing."""

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        names = [name for name, _, _ in _name_each(self)]
        refuse_repeated(names, "clampings", "common/{}/name", "names are unique")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class ClampingEffect(Effect):
    """A bead at X is off by t + w x (X - p) + s (X - p): torsor (w, t) and scale s are the seven parameters."""

    fiducials: tuple[str, ...] | None  # labels; None: all
    pivot_mm: ArrayLike | None  # (3,) con; None: the centroid of these

    def own(self, scene: Scene) -> list[int]:
        """Which fiducials of a scene are drilled in it."""
        return [i for i, label in enumerate(scene.labels) if self.fiducials is None or label in self.fiducials]

    def act(self, scene: Scene) -> tuple[Act, ...]:
        points, own = scene.fiducials_mm, self.own(scene)
        steps = np.zeros((*points.shape, 7), points.dtype)
        if own:
            away = (points[own] - self.with_pivot_in(scene).pivot_mm).T
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                steps[own, a, k], steps[own, b, k] = -away[b], away[a]
                steps[own, k, 3 + k] = 1.0
                steps[own, k, 6] = away[k]
        return (Act(Place.BEADS, None, steps.reshape(-1, 7)),)

    def with_pivot_in(self, scene: Scene) -> Self:
        if self.pivot_mm is not None or not (own := self.own(scene)):
            return self
        return replace(self, pivot_mm=scene.fiducials_mm[own].sum(axis=0) / len(own))

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.BEADS, None),)


def _name_each(section: CommonOfFiducials) -> Iterator[tuple[str, Clamping, str]]:
    """Name, clamping and where it stands among the fiducials."""
    for index, declared in enumerate(section.common or ()):
        yield declared.name or f"C{index + 1}", declared, f"/fiducials/common/{index}"


def _compile(section: CommonOfFiducials, setting: Setting) -> Iterator[Effect]:
    for name, each, pointer in _name_each(section):
        pivot = None if each.pivot_mm is None else frozen(each.pivot_mm)
        labels = None if each.fiducials is None else tuple(each.fiducials)
        name, label = f"clamping:{name}", f"drilled in one clamping, {name}"
        yield ClampingEffect(name, label, pointer, each.drawn, each.sources, frozen(np.zeros(7)), labels, pivot)


def _list_fiducials(section: CommonOfFiducials) -> Iterator[tuple[str, Sequence[str]]]:
    return ((f"{pointer}/fiducials", each.fiducials) for _, each, pointer in _name_each(section) if each.fiducials)


def _limits(system: System) -> Iterator[Limit]:
    """How much beads spread or draw together at most: first order errs by as much."""
    each = (effect.sources for effect in system.effects if isinstance(effect, ClampingEffect))
    widths = [width for own in each for width, name in zip(own.half_width, own.names, strict=True) if name == "scale"]
    yield Proportional("a common scale of the fiducials of {} %", float(max(widths, default=0.0)))


KIND = EffectKind(
    host="fiducials", section=CommonOfFiducials, compile=_compile, list_fiducials=_list_fiducials, limits=_limits
)
