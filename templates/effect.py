"""What it is, in a sentence, and what it does to whom.

This text is what ``./run new effect NAME`` writes, and runs as it is: beads that sag along z with the square of their
distance from the z axis, at every shot.  Replace the numbers of the section, ``act`` and the words;
docs/adding/effect.md says what finishes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ..fields import BOUNDED_WORDS, COVERAGE_WORDS, AnyLaw, CoverageFactor, HalfWidth, Record, Typical, with_law
from ..geometry.arrays import frozen
from ..laws import Drawn
from ..ranges import Meant
from ..system import Act, Effect, Law, Place, Scene, Sources, System
from ..tolerances import coverage_of
from .kind import EffectKind, Excess, Setting

SAG_MM = Meant("sag", "mm", 0.001, "less than anybody measures", 5.0, "a structure that sags like a rope")
NAME, WORDS = "skeleton", "skeleton of the structure"
LARGEST_MM = 5.0


class Skeleton(Record):
    """How far a bead at 100 mm from the z axis may sag along z, drawn at every shot."""

    half_width_mm: Annotated[HalfWidth, Typical(0.05, 1), SAG_MM] = Field(examples=[0.1])
    """Half-width of the sag, mm."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_mm")


class OfDesign(Record):
    """What a design says of it."""

    skeleton: Skeleton | None = Field(
        default=None,
        description=f"Half-width and law of the {WORDS}. Absent: none.",
    )


@dataclass(frozen=True, slots=True, eq=False)
class SkeletonEffect(Effect):
    """A bead at (x, y) sags by (x^2 + y^2) / (100 mm)^2 times the parameter, mm."""

    def act(self, scene: Scene) -> tuple[Act, ...]:
        away = (scene.fiducials_mm[:, :2] / 100) ** 2
        sag = np.zeros(scene.fiducials_mm.shape, scene.fiducials_mm.dtype)
        sag[:, 2] = sag[:, 2] - away[:, 0] - away[:, 1]
        return (Act(Place.BEADS, None, sag.reshape(-1, 1)),)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.BEADS, None),)


def _compile(section: OfDesign, setting: Setting) -> Iterator[Effect]:
    if (own := section.skeleton) is not None:
        coverage = frozen([coverage_of(own.distribution, own.coverage_factor)])
        width, along = frozen([own.half_width_mm]), frozen(np.eye(1))
        sources = Sources(("sag",), (Law(own.distribution),), width, coverage, ("mm",), along)
        yield SkeletonEffect(NAME, WORDS, "/skeleton", Drawn.SHOT, sources, known=frozen([0.0]))


def _say_not_modelled(system: System) -> str:
    return "" if any(effect.name == NAME for effect in system.effects) else WORDS


def _limits(system: System) -> Iterator[Excess]:
    own = (effect.sources.half_width[0] for effect in system.effects if effect.name == NAME)
    if any(width > LARGEST_MM for width in own):
        yield Excess(f"a sag of more than {LARGEST_MM:g} mm")


KIND = EffectKind(
    host="design",
    section=OfDesign,
    compile=_compile,
    not_modelled=_say_not_modelled,
    limits=_limits,
)
