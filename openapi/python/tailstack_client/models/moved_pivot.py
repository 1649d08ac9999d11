from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="MovedPivot")


@_attrs_define
class MovedPivot:
    """A pivot that was free.

    Attributes:
        contributor (str): structure_connector or connector_flange.
        label (str): What the document calls the interface.
        before_mm (list[float]): Pivot before, con, mm.
        after_mm (list[float]): Pivot after, con, mm.
    """

    contributor: str
    label: str
    before_mm: list[float]
    after_mm: list[float]

    def to_dict(self) -> dict[str, Any]:
        contributor = self.contributor

        label = self.label

        before_mm = []
        for before_mm_item_data in self.before_mm:
            before_mm_item: float
            before_mm_item = before_mm_item_data
            before_mm.append(before_mm_item)

        after_mm = []
        for after_mm_item_data in self.after_mm:
            after_mm_item: float
            after_mm_item = after_mm_item_data
            after_mm.append(after_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "contributor": contributor,
                "label": label,
                "before_mm": before_mm,
                "after_mm": after_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        contributor = d.pop("contributor")

        label = d.pop("label")

        before_mm = []
        _before_mm = d.pop("before_mm")
        for before_mm_item_data in _before_mm:

            def _parse_before_mm_item(data: object) -> float:
                return cast(float, data)

            before_mm_item = _parse_before_mm_item(before_mm_item_data)

            before_mm.append(before_mm_item)

        after_mm = []
        _after_mm = d.pop("after_mm")
        for after_mm_item_data in _after_mm:

            def _parse_after_mm_item(data: object) -> float:
                return cast(float, data)

            after_mm_item = _parse_after_mm_item(after_mm_item_data)

            after_mm.append(after_mm_item)

        moved_pivot = cls(
            contributor=contributor,
            label=label,
            before_mm=before_mm,
            after_mm=after_mm,
        )

        return moved_pivot
