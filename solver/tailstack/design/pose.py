"""Rigid transforms as a document states them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from ..fields import Angles, Matrix44, Point, Quaternion, Record, Rotation3, only_one


class Pose(Record):
    """A rigid transform as one rotation, in one of three forms, and a translation."""

    rotation_deg: Angles | None = Field(default=None, examples=[[0.0, 0.0, 90.0]])
    """[rx, ry, rz] in degrees, composed as R = Rx(rx) Ry(ry) Rz(rz)."""
    rotation: Rotation3 | None = Field(default=None, examples=[[[1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    """Rotation matrix, row by row."""
    quaternion_wxyz: Quaternion | None = Field(default=None, examples=[[1.0, 0.0, 0.0, 0.0]])
    """Unit quaternion, scalar first."""
    translation_mm: Point = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, 120.0]])
    """Added after the rotation, mm."""

    _one_rotation = only_one("rotation_deg", "rotation", "quaternion_wxyz")


def _pose_kind(value: Any) -> str | None:
    if isinstance(value, list | tuple):
        return "<matrix>"
    return "<pose>" if isinstance(value, dict | Pose) else None


Transform = Annotated[
    Annotated[Matrix44, Tag("<matrix>")] | Annotated[Pose, Tag("<pose>")],
    Discriminator(
        _pose_kind,
        custom_error_type="wrong-type",
        custom_error_message="a transform is a 4x4 matrix or a mapping with a rotation and translation_mm",
    ),
]
