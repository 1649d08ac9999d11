from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ConvertedBody")


@_attrs_define
class ConvertedBody:
    """
    Attributes:
        label (str): Label of the fiducial that it became; if it was left, its name, which may be empty.
        path (str): Names of the assembly, of its instances and of the body, with slashes between them.
        position_mm (list[float] | None): Centre of its sphere, con, mm; null: it has no sphere, or the file does not
            say where it is.
        diameter_mm (float | None): Diameter of its sphere, mm; null: it has none, or the file does not say where it is.
        reason (str): Why it was left; empty: it became a fiducial.
    """

    label: str
    path: str
    position_mm: list[float] | None
    diameter_mm: float | None
    reason: str

    def to_dict(self) -> dict[str, Any]:
        label = self.label

        path = self.path

        position_mm: list[float] | None
        if isinstance(self.position_mm, list):
            position_mm = []
            for position_mm_type_0_item_data in self.position_mm:
                position_mm_type_0_item: float
                position_mm_type_0_item = position_mm_type_0_item_data
                position_mm.append(position_mm_type_0_item)

        else:
            position_mm = self.position_mm

        diameter_mm: float | None
        diameter_mm = self.diameter_mm

        reason = self.reason

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "label": label,
                "path": path,
                "position_mm": position_mm,
                "diameter_mm": diameter_mm,
                "reason": reason,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        label = d.pop("label")

        path = d.pop("path")

        def _parse_position_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                position_mm_type_0 = []
                _position_mm_type_0 = data
                for position_mm_type_0_item_data in _position_mm_type_0:

                    def _parse_position_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    position_mm_type_0_item = _parse_position_mm_type_0_item(position_mm_type_0_item_data)

                    position_mm_type_0.append(position_mm_type_0_item)

                return position_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        position_mm = _parse_position_mm(d.pop("position_mm"))

        def _parse_diameter_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        diameter_mm = _parse_diameter_mm(d.pop("diameter_mm"))

        reason = d.pop("reason")

        converted_body = cls(
            label=label,
            path=path,
            position_mm=position_mm,
            diameter_mm=diameter_mm,
            reason=reason,
        )

        return converted_body
