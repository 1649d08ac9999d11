from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Ratio")


@_attrs_define
class Ratio:
    """A ratio of two sampled numbers, from the same trials.

    Attributes:
        value (float): The ratio.
        interval (list[float]): Its confidence interval.
        first_order (float | None): The same ratio to first order; null where it is 1 by definition.
    """

    value: float
    interval: list[float]
    first_order: float | None

    def to_dict(self) -> dict[str, Any]:
        value = self.value

        interval = []
        for interval_item_data in self.interval:
            interval_item: float
            interval_item = interval_item_data
            interval.append(interval_item)

        first_order: float | None
        first_order = self.first_order

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "value": value,
                "interval": interval,
                "first_order": first_order,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        value = d.pop("value")

        interval = []
        _interval = d.pop("interval")
        for interval_item_data in _interval:

            def _parse_interval_item(data: object) -> float:
                return cast(float, data)

            interval_item = _parse_interval_item(interval_item_data)

            interval.append(interval_item)

        def _parse_first_order(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        first_order = _parse_first_order(d.pop("first_order"))

        ratio = cls(
            value=value,
            interval=interval,
            first_order=first_order,
        )

        return ratio
