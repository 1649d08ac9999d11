from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="BeamAngle")


@_attrs_define
class BeamAngle:
    """The angle between the beams of two views.

    Attributes:
        view (str): Name of the other view.
        angle_deg (float): Between the lines of both beams, whichever way they run, deg: 0 to 90.
    """

    view: str
    angle_deg: float

    def to_dict(self) -> dict[str, Any]:
        view = self.view

        angle_deg = self.angle_deg

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "angle_deg": angle_deg,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        view = d.pop("view")

        angle_deg = d.pop("angle_deg")

        beam_angle = cls(
            view=view,
            angle_deg=angle_deg,
        )

        return beam_angle
