"""Fiducials are balls, and what an image shows of one is not centred on the image of its centre: a known shift."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ..fields import Length, Record, Typical, refusal
from ..geometry.arrays import frozen
from ..geometry.camera import image_of
from ..laws import Drawn
from ..ranges import BALL_MM
from ..system import Act, ArrayLike, Effect, Place, Scene, System, no_sources
from .kind import Doubt, EffectKind, PlausibilityTest, Setting

SHADOW = 0.8  # share of the outline's shift that the centroid of an even ball's shadow has


class OfFiducials(Record):
    """What the fiducials say of it."""

    diameter_mm: Annotated[Length, Typical(1.5, 10), BALL_MM] | None = Field(default=None, examples=[3.0])
    """Diameter of the balls that are the fiducials, mm: the shift of a ball's image from the image of its centre is
    then a known bias. Absent, or where your software corrects it: none."""
    image_point: Literal["outline", "shadow"] | None = Field(default=None, examples=["outline"])
    """With diameter_mm: what your software takes for the image of a ball. outline (default): the middle of its
    elliptical outline; shadow: the centroid of its grey values, which is shifted by four fifths of that."""

    @model_validator(mode="after")
    def _needs_a_diameter(self) -> Self:
        if self.image_point is not None and self.diameter_mm is None:
            raise refusal("unused-field", "image_point is read only with diameter_mm", at="image_point")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class BallEffect(Effect):
    """The images of balls are shifted by a share, its parameter, of what their outlines are."""

    radius_mm: float
    views: tuple[str, ...]

    def act(self, scene: Scene) -> tuple[Act, ...]:
        acts = []
        for view in self.views:
            shifts = outline_shifts(scene.projections[view], scene.fiducials_mm, self.radius_mm)
            rows = np.zeros((2 * scene.points, 1), shifts.dtype)
            rows[: shifts.size, 0] = shifts.ravel()
            acts.append(Act(Place.IMAGES, view, rows))
        return tuple(acts)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return tuple((Place.IMAGES, view) for view in self.views)


def outline_shifts(projection: ArrayLike, points: ArrayLike, radius_mm: float) -> ArrayLike:
    """(n, 2) px: from the image of a ball's centre to the middle of the ellipse that is its outline.

    projection (3, 4), points (n, 3) mm.  With the dual quadric of the ball, ``X X' - r^2 diag(1, 1, 1, 0)``, the dual
    conic of its outline is ``p p' - r^2 A A'`` (p the image of the centre, A the left 3x3 block of the projection), and
    the pole of the line at infinity, its last column, is the ellipse's middle.  The centroid of the shadow of an even
    ball lies on the way there, at 0.8 to four digits for any ball that is small against its distance (integrated
    numerically; Clackdoyle and Mennessier 2011, doi:10.1088/0031-9155/56/23/003, give 20 % less).
    """
    left = projection[:, :3]
    image = points @ left.T + projection[:, 3]
    spread = radius_mm**2 * (left @ left[2])
    middle = (image * image[:, 2:] - spread)[:, :2] / (image[:, 2:] ** 2 - spread[2])
    return np.asarray(middle - image_of(image))


def ball_images(radius_mm: float, share: float, views: tuple[str, ...]) -> BallEffect:
    """The effect in views with these names: share of the outline's shift that the located point has."""
    label, pointer, known = "shift of the balls' images", "/fiducials/diameter_mm", frozen([share])
    return BallEffect("ball_images", label, pointer, Drawn.UNIT, no_sources(1), known, radius_mm, views)


def _compile(section: OfFiducials, setting: Setting) -> Iterator[Effect]:
    if section.diameter_mm is not None:
        share = SHADOW if section.image_point == "shadow" else 1.0
        yield ball_images(section.diameter_mm / 2, share, tuple(view.name for view in setting.views))


def _find(system: System) -> BallEffect | None:
    return next((effect for effect in system.effects if isinstance(effect, BallEffect)), None)


def _not_modelled(system: System) -> str:
    return "" if _find(system) else "the shift of a large ball's centre in its image (0.05 px for 10 mm balls)"


def _doubt_size(system: System) -> Iterator[Doubt]:
    if (balls := _find(system)) is None:
        return
    points, diameter = system.fiducials_mm, 2 * balls.radius_mm
    gaps = np.linalg.norm(points[:, None] - points, axis=2)[np.triu_indices(len(points), 1)]
    if diameter > (nearest := float(gaps.min()) if gaps.size else np.inf):
        words = f"balls of {diameter:.4g} mm: two of them, {nearest:.4g} mm apart, would be in one place"
        yield Doubt("/fiducials/diameter_mm", f"{words}. Check its unit, which is mm.", diameter, nearest)


SIZE = PlausibilityTest(
    "ball-size",
    "Balls that would touch, or that no image shows",
    "The distance of the nearest two fiducials; 0.3 mm: a judgement, markers of radiostereometry have 0.5 to 1 mm.",
    _doubt_size,
)

KIND = EffectKind(host="fiducials", section=OfFiducials, compile=_compile, not_modelled=_not_modelled, doubts=(SIZE,))
