from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.spread_compared_of import check_spread_compared_of
from ..models.spread_compared_of import SpreadComparedOf
from typing import cast


T = TypeVar("T", bound="SpreadCompared")


@_attrs_define
class SpreadCompared:
    """Standard deviation from trial to trial, within installations, or between their means.

    Attributes:
        of (SpreadComparedOf): vectors: root of the trace of the covariance; norms: standard deviation of the norms.
        measured_mm (float): Measured spread, mm.
        predicted_mm (float): Predicted spread, mm.
        ratio (float): Measured over predicted.
        interval (list[float] | None): Confidence interval of the ratio, as if the law had the predicted shape; null
            without n.
    """

    of: SpreadComparedOf
    measured_mm: float
    predicted_mm: float
    ratio: float
    interval: list[float] | None

    def to_dict(self) -> dict[str, Any]:
        of: str = self.of

        measured_mm = self.measured_mm

        predicted_mm = self.predicted_mm

        ratio = self.ratio

        interval: list[float] | None
        if isinstance(self.interval, list):
            interval = []
            for interval_type_0_item_data in self.interval:
                interval_type_0_item: float
                interval_type_0_item = interval_type_0_item_data
                interval.append(interval_type_0_item)

        else:
            interval = self.interval

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "of": of,
                "measured_mm": measured_mm,
                "predicted_mm": predicted_mm,
                "ratio": ratio,
                "interval": interval,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        of = check_spread_compared_of(d.pop("of"))

        measured_mm = d.pop("measured_mm")

        predicted_mm = d.pop("predicted_mm")

        ratio = d.pop("ratio")

        def _parse_interval(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                interval_type_0 = []
                _interval_type_0 = data
                for interval_type_0_item_data in _interval_type_0:

                    def _parse_interval_type_0_item(data: object) -> float:
                        return cast(float, data)

                    interval_type_0_item = _parse_interval_type_0_item(interval_type_0_item_data)

                    interval_type_0.append(interval_type_0_item)

                return interval_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        interval = _parse_interval(d.pop("interval"))

        spread_compared = cls(
            of=of,
            measured_mm=measured_mm,
            predicted_mm=predicted_mm,
            ratio=ratio,
            interval=interval,
        )

        return spread_compared
