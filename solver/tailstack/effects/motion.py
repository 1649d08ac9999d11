"""Motion between the shots: the structure against the target by the time of one view's shot."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, pi
from typing import Annotated

import numpy as np
from pydantic import Field

from ..fields import Point, Record, Typical, leave_out_later
from ..geometry.arrays import frozen
from ..laws import Drawn
from ..ranges import MOTION_DEG, MOTION_MM
from ..system import DirectEffect, Effect, Place, Sources, System
from ..tolerances import HowOften, Tolerances, level_field
from .kind import EffectKind, Excess, Limit, Setting

# motion between the shots, standard deviations: of the beads in all directions together (root mean square over them,
# mm), and of the turn (rad), which nu takes for small beside the motion
CALIBRATED = (3.0, pi / 180)


class Motion(Record):
    """How far the structure may have moved against the target by the time of one shot."""

    label: Annotated[str, Field(max_length=200)] = Field(default="", examples=["breathing"])
    """What moves, in your words."""
    pivot_mm: Annotated[Point, Typical(-100, 100)] = Field(examples=[[0.0, 0.0, -95.0]])
    """Point in con that the motion is reduced at, mm: rotations turn about it."""
    tolerances: Annotated[
        Tolerances,
        Typical(0.005, 0.3, of="half_width_deg"),
        Typical(0.01, 0.3, of="half_width_mm"),
        MOTION_DEG,
        MOTION_MM,
    ]
    """Half-width and law per component."""
    drawn: HowOften = level_field(Drawn.SHOT)

    _as_before = leave_out_later("drawn")


class MotionOfView(Record):
    """What a view says of it."""

    motion: Motion | None = None
    """Motion of the structure against the target between the shots, as this view sees it. Absent: none."""


def motion(
    view: str,
    pivot_mm: object,
    sources: Sources,
    known: object = (0.0,) * 6,
    label: str = "",
    pointer: str = "",
    drawn: Drawn = Drawn.SHOT,
) -> DirectEffect:
    """The effect before the shot of a view: sources (6, k) and known (6,), rad and mm, about a pivot (3,) in con."""
    name, label = f"motion:{view}", label or f"motion before shot {view}"
    return DirectEffect(name, label, pointer, drawn, sources, frozen(known), Place.SHOT, view, frozen(pivot_mm))


def _compile(section: MotionOfView, setting: Setting) -> Iterator[Effect]:
    if (declared := section.motion) is not None:
        view, sources, at = setting.views[0].name, declared.tolerances.sources, f"{setting.pointer}/motion"
        yield motion(view, declared.pivot_mm, sources, label=declared.label, pointer=at, drawn=declared.drawn)


def _not_modelled(system: System) -> str:
    return "" if system.effects_at(Place.SHOT) else "motion between the shots"


def _limits(system: System) -> Iterator[Limit]:
    """Half-widths where bounded: of the beads, and of the turn."""
    shift = turn = 0.0
    for effect in system.effects_at(Place.SHOT):
        assert isinstance(effect, DirectEffect)
        columns = effect.sources.direction * effect.sources.spread  # (6, k)
        levers = system.fiducials_mm - effect.pivot_mm
        steps = np.cross(columns[:3].T[:, None], levers) + columns[3:].T[:, None]  # (k, N, 3)
        shift = max(shift, float(np.sqrt((steps**2).sum(axis=(0, 2)).mean())))
        turn = max(turn, float(np.sqrt((columns[:3] ** 2).sum())))
    if shift > CALIBRATED[0] or turn > CALIBRATED[1]:
        yield Excess(
            f"a motion between the shots of {shift:.3g} mm at the fiducials and {degrees(turn):.3g} deg, standard "
            f"deviation (calibrated: to {CALIBRATED[0]:g} mm and {degrees(CALIBRATED[1]):g} deg)"
        )


KIND = EffectKind(host="view", section=MotionOfView, compile=_compile, not_modelled=_not_modelled, limits=_limits)
