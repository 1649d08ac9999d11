"""Errors of the intrinsics that an estimator assumes: focal length and principal point, assumed less true.

Independent in each view.  Estimators that assume no intrinsics do not feel them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field

from ..fields import (
    COVERAGE_WORDS,
    LAW_WORDS,
    CoverageFactor,
    ImagePoint,
    RandomLaw,
    Record,
    Typical,
    leave_out_later,
    with_law,
)
from ..geometry.arrays import frozen
from ..laws import Drawn
from ..ranges import FOOT_ERROR_PX, SHARE
from ..system import INTRINSICS, DirectEffect, Effect, Place, Sources, System
from ..tolerances import HowOften, Source, gather_sources, level_field
from .kind import EffectKind, Limit, Proportional, Setting

NAME = "assumed_intrinsics"
UNITS = ("1", "px", "px")


class FocalError(Record):
    """Error of the assumed focal length, as a part of the true one."""

    bias_rel: Annotated[float, Field(ge=-0.5, le=0.5), Typical(-0.1, 0.1), SHARE] = Field(default=0.0, examples=[0.01])
    """Known and fixed: 0.01 is an assumed focal length that is 1 % too long. Default 0."""
    half_width_rel: Annotated[float, Field(ge=0, le=1), Typical(0.001, 0.2), SHARE] = Field(
        default=0.0, examples=[0.01]
    )
    """Half-width h, as a part of the focal length. Default 0."""
    distribution: RandomLaw | None = Field(
        default=None, description=LAW_WORDS + ". Required with half_width_rel.", examples=["uniform"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_rel")


class PrincipalPointError(Record):
    """Error of the assumed principal point."""

    bias_px: Annotated[ImagePoint, Typical(-100, 100), FOOT_ERROR_PX] = Field(default=(0.0, 0.0), examples=[[5.0, 0.0]])
    """Known and fixed, [u, v], px: assumed less true. Default 0."""
    half_width_px: Annotated[float, Field(ge=0, le=1e4), Typical(1, 200), FOOT_ERROR_PX] = Field(
        default=0.0, examples=[10.0]
    )
    """Half-width h of each coordinate, px."""
    distribution: RandomLaw | None = Field(
        default=None, description=LAW_WORDS + ". Required with half_width_px.", examples=["uniform"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_px")


class IntrinsicsError(Record):
    """How wrong the assumed intrinsics of a view may be, independently in each view."""

    focal: FocalError | None = None
    """Of the focal length. Absent: exact."""
    principal_point: PrincipalPointError | None = None
    """Of the principal point. Absent: exact."""
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn")


class IntrinsicsOfView(Record):
    """What a view says of it."""

    intrinsics_error: IntrinsicsError | None = None
    """How wrong the assumed focal length and principal point are, for the estimators that believe them (pose,
    pose_with_prior). Absent: as wrong as intrinsics_prior says; without that, exact."""


def intrinsics_error(
    view: str, known: object, sources: Sources, pointer: str = "", drawn: Drawn = Drawn.UNIT
) -> DirectEffect:
    """The effect in a view: known (3,) and sources (3, k) in the order and units of ``system.INTRINSICS``."""
    name, label = f"{NAME}:{view}", f"assumed intrinsics, {view}"
    return DirectEffect(name, label, pointer, drawn, sources, frozen(known), Place.INTRINSICS, view)


def _compile(section: IntrinsicsOfView, setting: Setting) -> Iterator[Effect]:
    """As declared; otherwise the prior is taken at its word."""
    (view,), error = setting.views, section.intrinsics_error
    if error is None:
        if view.intrinsics_prior is None:
            return
        focal_rel_sd, foot_px_sd = view.intrinsics_prior
        error = IntrinsicsError(
            focal=FocalError(half_width_rel=focal_rel_sd, distribution="normal", coverage_factor=1.0),
            principal_point=PrincipalPointError(half_width_px=foot_px_sd, distribution="normal", coverage_factor=1.0),
        )
    focal, centre = error.focal or FocalError(), error.principal_point or PrincipalPointError()
    widths = (focal.half_width_rel, centre.half_width_px, centre.half_width_px)
    parts: tuple[FocalError | PrincipalPointError, ...] = (focal, centre, centre)
    stated = [
        Source(name, part.distribution or "normal", width, part.coverage_factor, unit, way)
        for name, part, width, unit, way in zip(INTRINSICS, parts, widths, UNITS, np.eye(3), strict=True)
        if width
    ]
    sources, pointer = gather_sources(stated, 3), f"{setting.pointer}/intrinsics_error"
    yield intrinsics_error(view.name, [focal.bias_rel, *centre.bias_px], sources, pointer, error.drawn)


NEAR, COUNTED_FAR = 6.0, 3.0  # radii of the fiducials; how often a known error counts for a target beyond


def _limits(system: System) -> Iterator[Limit]:
    """The largest known error of intrinsics that are believed: P95 errs by up to 1.3 times it, and by up to 4.8 times
    it where a target lies many radii of the fiducials away.

    1000 px of the principal point count as 1.
    """
    known = [error.known / (1.0, 1000.0, 1000.0) for error in system.believed_errors if error is not None]
    size = float(np.abs([np.zeros(3), *known]).max())
    middle = system.fiducials_mm.mean(axis=0)
    away = max(np.linalg.norm(each.position_mm - middle) for each in system.targets)
    if away > NEAR * np.sqrt(((system.fiducials_mm - middle) ** 2).sum(axis=1).mean()):
        words = "intrinsics that are known to be wrong, for a target far away, which may change P95 by {} %"
        yield Proportional(words, COUNTED_FAR * size)
    else:
        yield Proportional("intrinsics that are known to be {} % wrong", size)


# what an estimator believes without a doubt that the design states is said apart (``scoring.provenance``)
KIND = EffectKind(host="view", section=IntrinsicsOfView, compile=_compile, limits=_limits)
