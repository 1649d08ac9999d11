from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Exceedance")


@_attrs_define
class Exceedance:
    """How often the error is beyond a limit.

    Attributes:
        limit_mm (float): The limit, mm.
        probability (float): Share of trials whose error is beyond it.
        interval (list[float]): Confidence interval of that probability.
    """

    limit_mm: float
    probability: float
    interval: list[float]

    def to_dict(self) -> dict[str, Any]:
        limit_mm = self.limit_mm

        probability = self.probability

        interval = []
        for interval_item_data in self.interval:
            interval_item: float
            interval_item = interval_item_data
            interval.append(interval_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "limit_mm": limit_mm,
                "probability": probability,
                "interval": interval,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        limit_mm = d.pop("limit_mm")

        probability = d.pop("probability")

        interval = []
        _interval = d.pop("interval")
        for interval_item_data in _interval:

            def _parse_interval_item(data: object) -> float:
                return cast(float, data)

            interval_item = _parse_interval_item(interval_item_data)

            interval.append(interval_item)

        exceedance = cls(
            limit_mm=limit_mm,
            probability=probability,
            interval=interval,
        )

        return exceedance
