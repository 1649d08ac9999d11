from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.preset_entry import PresetEntry


T = TypeVar("T", bound="PresetList")


@_attrs_define
class PresetList:
    """
    Attributes:
        presets (list[PresetEntry]): Every preset.
    """

    presets: list[PresetEntry]

    def to_dict(self) -> dict[str, Any]:
        from ..models.preset_entry import PresetEntry  # noqa: PLC0415

        presets = []
        for presets_item_data in self.presets:
            presets_item = presets_item_data.to_dict()
            presets.append(presets_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "presets": presets,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.preset_entry import PresetEntry  # noqa: PLC0415

        d = dict(src_dict)
        presets = []
        _presets = d.pop("presets")
        for presets_item_data in _presets:
            presets_item = PresetEntry.from_dict(presets_item_data)

            presets.append(presets_item)

        preset_list = cls(
            presets=presets,
        )

        return preset_list
