from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.change_kind import ChangeKind
from ..models.change_kind import check_change_kind
from typing import cast


T = TypeVar("T", bound="Change")


@_attrs_define
class Change:
    """One field of the design document that differs.

    Attributes:
        pointer (str): JSON pointer into the second design; into the first for what was removed.
        name (str): The same with names for numbers: views AP fiducial_noise_px.
        unit (str): Unit of the field; empty where it has none.
        kind (ChangeKind): changed, added or removed.
        first (None | str): Value in the first design as JSON; null where it was added.
        second (None | str): Value in the second design as JSON; null where it was removed.
    """

    pointer: str
    name: str
    unit: str
    kind: ChangeKind
    first: None | str
    second: None | str

    def to_dict(self) -> dict[str, Any]:
        pointer = self.pointer

        name = self.name

        unit = self.unit

        kind: str = self.kind

        first: None | str
        first = self.first

        second: None | str
        second = self.second

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "pointer": pointer,
                "name": name,
                "unit": unit,
                "kind": kind,
                "first": first,
                "second": second,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        pointer = d.pop("pointer")

        name = d.pop("name")

        unit = d.pop("unit")

        kind = check_change_kind(d.pop("kind"))

        def _parse_first(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        first = _parse_first(d.pop("first"))

        def _parse_second(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        second = _parse_second(d.pop("second"))

        change = cls(
            pointer=pointer,
            name=name,
            unit=unit,
            kind=kind,
            first=first,
            second=second,
        )

        return change
