"""What is left of an image's distortion after its correction: a polynomial of the place in the image."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    AnyLaw,
    CoverageFactor,
    HalfWidth,
    Record,
    Typical,
    leave_out_later,
    refusal,
    with_law,
)
from ..geometry.arrays import Array, frozen
from ..geometry.camera import image_centre_px
from ..laws import Drawn
from ..ranges import FIELD_PX
from ..system import Act, ArrayLike, Effect, Law, Place, Scene, Sources, System
from ..tolerances import HowOften, coverage_of, level_field
from .kind import EffectKind, Setting, name_views


class ImageField(Record):
    """What is left of the image's distortion after its correction: a polynomial.

    Along u and along v, the shift of an image point is a sum of ``c x^i y^j``, where (x, y) is its place from the
    image's centre in units of half the diagonal; so c is the shift in the corner, px, and varies by itself.
    """

    half_widths_px: Annotated[list[HalfWidth], Field(min_length=1, max_length=4), Typical(0.02, 1), FIELD_PX] = Field(
        examples=[[0.0, 0.0, 0.1, 0.3]]
    )
    """Half-width of the coefficients of degree 0, 1, 2, 3, px, in this order; every coefficient of a degree has the
    same one. Degrees 0 and 1 (shift, scale, shear) are absorbed by DLT."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["normal"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn")
    _law = with_law("half_widths_px")


class FieldOfView(Record):
    """What a view says of it."""

    image_field: ImageField | None = None
    """What is left of the image's distortion after its correction. Needs image_size_px. Absent: none."""

    @model_validator(mode="after")
    def _needs_a_size(self) -> Self:
        stated = any(getattr(self, name, None) is not None for name in ("preset", "image_size_px"))
        if self.image_field is not None and not stated:
            words = "an image field is measured from the image's centre in half diagonals, and the size is not stated"
            raise refusal("missing-field", words, "give image_size_px: [W, H]", "image_field")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class FieldEffect(Effect):
    """Source j shifts every image point along ``axis[j]`` by its value, px, times ``x**i y**j`` with the powers of its
    row: x and y are the nominal place in the image, from its centre and in units of half its diagonal."""

    view: str
    centre_px: Array  # (2,)
    half_diagonal_px: float
    axis: NDArray[np.int64]  # (k,) 0: u, 1: v
    powers: NDArray[np.int64]  # (k, 2)

    def act(self, scene: Scene) -> tuple[Act, ...]:
        shifts = field_shifts(scene.project(self.view), self.centre_px, self.half_diagonal_px, self.axis, self.powers)
        return (Act(Place.IMAGES, self.view, shifts.reshape(2 * len(shifts), len(self.axis))),)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.IMAGES, self.view),)


def field_powers(degree: int) -> NDArray[np.int64]:
    """(n, 2) powers (i, j) of the monomials ``x**i y**j`` of one degree."""
    return np.array([(degree - j, j) for j in range(degree + 1)], dtype=np.int64)


def field_shifts(
    images: ArrayLike, centre_px: Array, half_diagonal_px: float, axis: NDArray[np.int64], powers: NDArray[np.int64]
) -> ArrayLike:
    """(n, 2, k) shift of images (n, 2), px, per px of each coefficient."""
    place = (images - centre_px) / half_diagonal_px
    values = place[:, None, 0] ** powers[:, 0] * place[:, None, 1] ** powers[:, 1]
    shifts = np.zeros((len(images), 2, len(axis)), values.dtype)
    for j, along in enumerate(axis.tolist()):
        shifts[:, along, j] = values[:, j]
    return shifts


def image_field(
    view: str,
    size_px: tuple[int, int],
    half_widths_px: list[float],
    law: Law,
    coverage: float = 1.0,
    pointer: str = "",
    drawn: Drawn = Drawn.UNIT,
) -> FieldEffect:
    """The effect in a view with an image of this size: the coefficients of every degree that has some half-width, px,
    first those of u, then those of v."""
    degrees = [degree for degree, half_width in enumerate(half_widths_px) if half_width > 0]
    exponents = np.concatenate([np.zeros((0, 2), dtype=np.int64), *map(field_powers, degrees)])
    powers, axis = np.tile(exponents, (2, 1)), np.repeat([0, 1], len(exponents))
    sources = Sources(
        tuple(f"{'uv'[along]}.x{i}y{j}" for along, (i, j) in zip(axis, powers.tolist(), strict=True)),
        (law,) * len(axis),
        frozen([half_widths_px[i + j] for i, j in powers.tolist()]),
        frozen([coverage] * len(axis)),
        ("px",) * len(axis),
        frozen(np.eye(len(axis))),
    )
    centre, half_diagonal = frozen(image_centre_px(size_px)), float(np.hypot(*size_px)) / 2
    name, label = f"image_field:{view}", f"image field, {view}"
    none = frozen(np.zeros(len(axis)))
    return FieldEffect(name, label, pointer, drawn, sources, none, view, centre, half_diagonal, axis, powers)


def _compile(section: FieldOfView, setting: Setting) -> Iterator[Effect]:
    if (field := section.image_field) is not None:
        (view,) = setting.views
        assert view.image_size_px is not None  # the section has made sure
        law, coverage = Law(field.distribution), coverage_of(field.distribution, field.coverage_factor)
        pointer = f"{setting.pointer}/image_field"
        yield image_field(view.name, view.image_size_px, field.half_widths_px, law, coverage, pointer, field.drawn)


def _not_modelled(system: System) -> str:
    return name_views("image distortion that its correction leaves", FieldEffect, system)


KIND = EffectKind(host="view", section=FieldOfView, compile=_compile, not_modelled=_not_modelled)
