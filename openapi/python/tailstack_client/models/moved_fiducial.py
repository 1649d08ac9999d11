from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="MovedFiducial")


@_attrs_define
class MovedFiducial:
    """A fiducial that could move; ``before_mm`` is None for one that is new, ``after_mm`` for one left out.

    Attributes:
        label (str): Label of the fiducial.
        before_mm (list[float] | None): Position before, con, mm; null for one that is new.
        after_mm (list[float] | None): Position after, con, mm; null for one that was left out.
    """

    label: str
    before_mm: list[float] | None
    after_mm: list[float] | None

    def to_dict(self) -> dict[str, Any]:
        label = self.label

        before_mm: list[float] | None
        if isinstance(self.before_mm, list):
            before_mm = []
            for before_mm_type_0_item_data in self.before_mm:
                before_mm_type_0_item: float
                before_mm_type_0_item = before_mm_type_0_item_data
                before_mm.append(before_mm_type_0_item)

        else:
            before_mm = self.before_mm

        after_mm: list[float] | None
        if isinstance(self.after_mm, list):
            after_mm = []
            for after_mm_type_0_item_data in self.after_mm:
                after_mm_type_0_item: float
                after_mm_type_0_item = after_mm_type_0_item_data
                after_mm.append(after_mm_type_0_item)

        else:
            after_mm = self.after_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "label": label,
                "before_mm": before_mm,
                "after_mm": after_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        label = d.pop("label")

        def _parse_before_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                before_mm_type_0 = []
                _before_mm_type_0 = data
                for before_mm_type_0_item_data in _before_mm_type_0:

                    def _parse_before_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    before_mm_type_0_item = _parse_before_mm_type_0_item(before_mm_type_0_item_data)

                    before_mm_type_0.append(before_mm_type_0_item)

                return before_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        before_mm = _parse_before_mm(d.pop("before_mm"))

        def _parse_after_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                after_mm_type_0 = []
                _after_mm_type_0 = data
                for after_mm_type_0_item_data in _after_mm_type_0:

                    def _parse_after_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    after_mm_type_0_item = _parse_after_mm_type_0_item(after_mm_type_0_item_data)

                    after_mm_type_0.append(after_mm_type_0_item)

                return after_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        after_mm = _parse_after_mm(d.pop("after_mm"))

        moved_fiducial = cls(
            label=label,
            before_mm=before_mm,
            after_mm=after_mm,
        )

        return moved_fiducial
