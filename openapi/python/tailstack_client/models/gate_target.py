from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="GateTarget")


@_attrs_define
class GateTarget:
    """The error at one target: what a later gate compares with.

    Attributes:
        name (str): Name of the target, or of one sample of a region (zone[3]).
        first_order_p95_mm (float): First-order P95 of the TCP error, mm.
        p95_mm (float | None): Sampled P95 of the TCP error, mm; null where nothing was drawn.
        p95_interval_mm (list[float] | None): Confidence interval of it, mm; null where nothing was drawn.
        cvar95_mm (float): Mean of the worst 5 % of the TCP error's norm, mm.
        position_mm (list[float] | None): Position of the target, con, mm; null in records of earlier versions.
    """

    name: str
    first_order_p95_mm: float
    p95_mm: float | None
    p95_interval_mm: list[float] | None
    cvar95_mm: float
    position_mm: list[float] | None

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        first_order_p95_mm = self.first_order_p95_mm

        p95_mm: float | None
        p95_mm = self.p95_mm

        p95_interval_mm: list[float] | None
        if isinstance(self.p95_interval_mm, list):
            p95_interval_mm = []
            for p95_interval_mm_type_0_item_data in self.p95_interval_mm:
                p95_interval_mm_type_0_item: float
                p95_interval_mm_type_0_item = p95_interval_mm_type_0_item_data
                p95_interval_mm.append(p95_interval_mm_type_0_item)

        else:
            p95_interval_mm = self.p95_interval_mm

        cvar95_mm = self.cvar95_mm

        position_mm: list[float] | None
        if isinstance(self.position_mm, list):
            position_mm = []
            for position_mm_type_0_item_data in self.position_mm:
                position_mm_type_0_item: float
                position_mm_type_0_item = position_mm_type_0_item_data
                position_mm.append(position_mm_type_0_item)

        else:
            position_mm = self.position_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "first_order_p95_mm": first_order_p95_mm,
                "p95_mm": p95_mm,
                "p95_interval_mm": p95_interval_mm,
                "cvar95_mm": cvar95_mm,
                "position_mm": position_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        first_order_p95_mm = d.pop("first_order_p95_mm")

        def _parse_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_mm = _parse_p95_mm(d.pop("p95_mm"))

        def _parse_p95_interval_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                p95_interval_mm_type_0 = []
                _p95_interval_mm_type_0 = data
                for p95_interval_mm_type_0_item_data in _p95_interval_mm_type_0:

                    def _parse_p95_interval_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    p95_interval_mm_type_0_item = _parse_p95_interval_mm_type_0_item(p95_interval_mm_type_0_item_data)

                    p95_interval_mm_type_0.append(p95_interval_mm_type_0_item)

                return p95_interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        p95_interval_mm = _parse_p95_interval_mm(d.pop("p95_interval_mm"))

        cvar95_mm = d.pop("cvar95_mm")

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

        gate_target = cls(
            name=name,
            first_order_p95_mm=first_order_p95_mm,
            p95_mm=p95_mm,
            p95_interval_mm=p95_interval_mm,
            cvar95_mm=cvar95_mm,
            position_mm=position_mm,
        )

        return gate_target
