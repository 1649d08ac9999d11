from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="SurvivedLoss")


@_attrs_define
class SurvivedLoss:
    """What was asked for when fiducials are lost, and the worst loss of the new design.

    Attributes:
        limit_mm (float): Limit of P95 of the error at the tool after a loss, mm.
        lost (list[str]): Labels of the fiducials whose loss is worst.
        target (str): Target at which it is.
        estimate_mm (float): P95 there without them, by estimate, mm.
        p95_mm (float): The same by Monte Carlo, with a fresh seed, mm.
        interval_mm (list[float | None]): Where that lies, mm; the upper end null where it is not known.
        trials (int): Trials of the check.
    """

    limit_mm: float
    lost: list[str]
    target: str
    estimate_mm: float
    p95_mm: float
    interval_mm: list[float | None]
    trials: int

    def to_dict(self) -> dict[str, Any]:
        limit_mm = self.limit_mm

        lost = self.lost

        target = self.target

        estimate_mm = self.estimate_mm

        p95_mm = self.p95_mm

        interval_mm = []
        for interval_mm_item_data in self.interval_mm:
            interval_mm_item: float | None
            interval_mm_item = interval_mm_item_data
            interval_mm.append(interval_mm_item)

        trials = self.trials

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "limit_mm": limit_mm,
                "lost": lost,
                "target": target,
                "estimate_mm": estimate_mm,
                "p95_mm": p95_mm,
                "interval_mm": interval_mm,
                "trials": trials,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        limit_mm = d.pop("limit_mm")

        lost = cast(list[str], d.pop("lost"))

        target = d.pop("target")

        estimate_mm = d.pop("estimate_mm")

        p95_mm = d.pop("p95_mm")

        interval_mm = []
        _interval_mm = d.pop("interval_mm")
        for interval_mm_item_data in _interval_mm:

            def _parse_interval_mm_item(data: object) -> float | None:
                if data is None:
                    return data
                return cast(float | None, data)

            interval_mm_item = _parse_interval_mm_item(interval_mm_item_data)

            interval_mm.append(interval_mm_item)

        trials = d.pop("trials")

        survived_loss = cls(
            limit_mm=limit_mm,
            lost=lost,
            target=target,
            estimate_mm=estimate_mm,
            p95_mm=p95_mm,
            interval_mm=interval_mm,
            trials=trials,
        )

        return survived_loss
