from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ConvergencePoint")


@_attrs_define
class ConvergencePoint:
    """P95 of the first so many trials, with its order-statistic interval.

    Attributes:
        trials (int): So many first trials.
        p95_mm (float): Their P95, mm.
        interval_mm (list[float]): Its order-statistic interval, mm.
    """

    trials: int
    p95_mm: float
    interval_mm: list[float]

    def to_dict(self) -> dict[str, Any]:
        trials = self.trials

        p95_mm = self.p95_mm

        interval_mm = []
        for interval_mm_item_data in self.interval_mm:
            interval_mm_item: float
            interval_mm_item = interval_mm_item_data
            interval_mm.append(interval_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "trials": trials,
                "p95_mm": p95_mm,
                "interval_mm": interval_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        trials = d.pop("trials")

        p95_mm = d.pop("p95_mm")

        interval_mm = []
        _interval_mm = d.pop("interval_mm")
        for interval_mm_item_data in _interval_mm:

            def _parse_interval_mm_item(data: object) -> float:
                return cast(float, data)

            interval_mm_item = _parse_interval_mm_item(interval_mm_item_data)

            interval_mm.append(interval_mm_item)

        convergence_point = cls(
            trials=trials,
            p95_mm=p95_mm,
            interval_mm=interval_mm,
        )

        return convergence_point
