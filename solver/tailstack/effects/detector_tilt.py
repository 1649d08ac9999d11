"""Tilt of the detector about the axes of its image, once per unit.

The images of a tilted detector are those of an upright one, mapped by a homography: estimators of all eleven unknowns
(dlt, reprojection) absorb it, those that believe the intrinsics (pose, pose_with_prior) take it for a motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ..fields import Degrees, Record, Typical, leave_out_later, refusal
from ..geometry.arrays import frozen
from ..geometry.camera import intrinsics_of
from ..laws import Drawn
from ..ranges import TILT_DEG
from ..system import Act, Effect, Place, Scene, Sources, System
from ..tolerances import HowOften, RotationTolerance, compile_sources, level_field
from .kind import EffectKind, Setting, name_views

AXES = ("about_u", "about_v")
LARGEST_DEG = 1.0  # a turn by a stretches the image by a^2 / 2 too, which is left out: 0.015 % at one degree

Turn = Annotated[RotationTolerance, Typical(0.02, 0.5, of="half_width_deg"), TILT_DEG]


class DetectorTilt(Record):
    """How far a view's detector may be turned out of the plane of its image.

    Both turns are about the foot of the perpendicular from the source: by a positive one the detector's far end, at
    large v (about u) or large u (about v), moves away from the source.
    """

    about_u: Turn | None = None
    """About the axis along u. Absent: none."""
    about_v: Turn | None = None
    """About the axis along v. Absent: none."""
    bias_about_u_deg: Annotated[Degrees, Typical(-0.25, 0.25), TILT_DEG] = Field(default=0.0, examples=[0.2])
    """Known turn about u, degrees. Default 0."""
    bias_about_v_deg: Annotated[Degrees, Typical(-0.25, 0.25), TILT_DEG] = Field(default=0.0, examples=[0.2])
    """Known turn about v, degrees. Default 0."""
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn")

    @model_validator(mode="after")
    def _small(self) -> Self:
        for axis in AXES:
            tolerance, field = getattr(self, axis), f"bias_{axis}_deg"
            stated = {field: abs(getattr(self, field))}
            if tolerance is not None:
                stated[f"{axis}/half_width_deg"] = tolerance.half_width_deg
            for at, degrees in stated.items():
                if degrees > LARGEST_DEG:
                    words = f"a tilt is at most {LARGEST_DEG:g} degree, for it is taken to first order; got {degrees:g}"
                    raise refusal("out-of-range", words, "state the view's projection as it is calibrated", at)
        return self


class TiltOfView(Record):
    """What a view says of it."""

    detector_tilt: DetectorTilt | None = None
    """Tilt of the detector out of the plane of its image, for the estimators that believe the intrinsics; the others
    absorb it. Absent: none."""


@dataclass(frozen=True, slots=True, eq=False)
class TiltEffect(Effect):
    """A turn by a moves the image at (x, y) px from the principal point by (x, y) times a y / f about u and a x / f
    about v, f px the focal length: where the ray meets the plane that was turned, to first order in a."""

    view: str

    def act(self, scene: Scene) -> tuple[Act, ...]:
        focal_u, _, focal_v, *foot = intrinsics_of(scene.projections[self.view]).tolist()
        place = scene.project(self.view) - np.array(foot)
        shifts = np.stack([place * place[:, 1:] / focal_v, place * place[:, :1] / focal_u], axis=-1)
        return (Act(Place.IMAGES, self.view, shifts.reshape(-1, 2)),)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.IMAGES, self.view),)


def detector_tilt(
    view: str, sources: Sources, known: object = (0.0, 0.0), pointer: str = "", drawn: Drawn = Drawn.UNIT
) -> TiltEffect:
    """The effect in a view: sources (2, k) and known (2,), rad, about u and about v."""
    name, label = f"detector_tilt:{view}", f"tilt of the detector, {view}"
    return TiltEffect(name, label, pointer, drawn, sources, frozen(known), view)


def _compile(section: TiltOfView, setting: Setting) -> Iterator[Effect]:
    if (declared := section.detector_tilt) is not None:
        sources = compile_sources({axis: getattr(declared, axis) for axis in AXES})
        known = np.deg2rad([declared.bias_about_u_deg, declared.bias_about_v_deg])
        yield detector_tilt(setting.views[0].name, sources, known, f"{setting.pointer}/detector_tilt", declared.drawn)


def _not_modelled(system: System) -> str:
    return name_views("a tilt of the detector", TiltEffect, system) if system.estimator.believes_intrinsics else ""


KIND = EffectKind(host="view", section=TiltOfView, compile=_compile, not_modelled=_not_modelled)
