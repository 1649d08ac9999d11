from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="SweepAxis")


@_attrs_define
class SweepAxis:
    """A number of the design that was varied.

    Attributes:
        pointer (str): JSON pointer (RFC 6901) into the design document; a step * stands for every element.
        unit (str): Unit of the values: deg, mm, px, N or empty.
        base (float | None): What the design as it stands has there; null where a pointer with * leads to several
            values.
        values (list[float]): Values that were put there, in `unit`.
    """

    pointer: str
    unit: str
    base: float | None
    values: list[float]

    def to_dict(self) -> dict[str, Any]:
        pointer = self.pointer

        unit = self.unit

        base: float | None
        base = self.base

        values = self.values

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "pointer": pointer,
                "unit": unit,
                "base": base,
                "values": values,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        pointer = d.pop("pointer")

        unit = d.pop("unit")

        def _parse_base(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        base = _parse_base(d.pop("base"))

        values = cast(list[float], d.pop("values"))

        sweep_axis = cls(
            pointer=pointer,
            unit=unit,
            base=base,
            values=values,
        )

        return sweep_axis
