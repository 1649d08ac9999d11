from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="InstallationLevel")


@_attrs_define
class InstallationLevel:
    """A fixed installation error of the structure.

    Attributes:
        rotation_deg (float): About each axis through the pivot, deg.
        translation_mm (float): Along (1, 1, 1), mm.
    """

    rotation_deg: float
    translation_mm: float

    def to_dict(self) -> dict[str, Any]:
        rotation_deg = self.rotation_deg

        translation_mm = self.translation_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "rotation_deg": rotation_deg,
                "translation_mm": translation_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        rotation_deg = d.pop("rotation_deg")

        translation_mm = d.pop("translation_mm")

        installation_level = cls(
            rotation_deg=rotation_deg,
            translation_mm=translation_mm,
        )

        return installation_level
