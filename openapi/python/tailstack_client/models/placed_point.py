from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="PlacedPoint")


@_attrs_define
class PlacedPoint:
    """A fiducial or target by its name.

    Attributes:
        label (str): Label of the fiducial, or name of the target.
        position_mm (list[float]): Nominal position in con, mm.
    """

    label: str
    position_mm: list[float]

    def to_dict(self) -> dict[str, Any]:
        label = self.label

        position_mm = []
        for position_mm_item_data in self.position_mm:
            position_mm_item: float
            position_mm_item = position_mm_item_data
            position_mm.append(position_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "label": label,
                "position_mm": position_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        label = d.pop("label")

        position_mm = []
        _position_mm = d.pop("position_mm")
        for position_mm_item_data in _position_mm:

            def _parse_position_mm_item(data: object) -> float:
                return cast(float, data)

            position_mm_item = _parse_position_mm_item(position_mm_item_data)

            position_mm.append(position_mm_item)

        placed_point = cls(
            label=label,
            position_mm=position_mm,
        )

        return placed_point
